"""Coverage of the 95 % intervals and held-out error of calibration on virtual robots with known errors.

python scripts/calibration_study.py --runs 400 --parameters geometry --json study.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from pouring_robot.cli.shared.options import progress_bars
from pouring_robot.exceptions import PouringRobotError
from pouring_robot.io.files import write_whole
from scripts.coverage_study import StudyOptions, coverage_study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study, print its figures, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--rows", type=int, default=150, help="poses of each campaign")
    parser.add_argument("--parameters", nargs="+", default=["geometry"], help="sets, groups or patterns")
    parser.add_argument("--positions-only", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", metavar="FILE", help="write the figures")
    given = parser.parse_args(arguments)
    options = StudyOptions(
        runs=given.runs,
        rows=given.rows,
        parameters=tuple(given.parameters),
        sigma_rotation_rad=None if given.positions_only else 5e-5,
        seed=given.seed,
    )
    try:
        with progress_bars() as progress:
            result = coverage_study(options, progress=progress)
        for name, value in result.figures().items():
            print(f"{name:28s} {value:.4g}")
        for line in result.failed:
            print(line, file=sys.stderr)
        if given.json:
            write_whole(given.json, json.dumps(result.figures(), indent=1) + "\n")
    except PouringRobotError as error:
        print(f"calibration_study: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
