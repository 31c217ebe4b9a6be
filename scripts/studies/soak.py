"""Run the commands in turn for an hour in one process, and check whether its memory, files and threads grow.

    python scripts/studies/soak.py --minutes 60 --seed 1

Every round draws other robots and another campaign: it sweeps, places, heats, compensates, simulates, checks,
calibrates, diagnoses and exports. Prints a Markdown table, a line for every sixth of the time: medians over its
rounds. Exit code 1 if the last sixth uses over 5 % more memory than the second, or more files or threads; the first
sixth fills caches.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import psutil

from pouring_robot.cli.app import main as command_line
from pouring_robot.robot.export.shipped_files import examples_path

PARTS = 6
MOST_GROWTH = 1.05
ROUND = """
sweep {sweep} --out {out}/s
path {poses} --model {model} --html {out}/p.html --out {out}/p.csv
thermal --at-mm 0 0 -600 --tilt-deg 0 --csv {out}/t.csv
compensate {poses} --model {model} --out {out}/c.csv
campaign simulate --random 60 --seed {seed} --model {model} --out {out}/m.csv
campaign check {out}/m.csv
calibrate {out}/m.csv --out {out}/k
diagnose {out}/m.csv --out {out}/d
export --model {model} --out {out}/e
"""


def one_round(seed: int, folder: Path) -> None:
    """Run every command once.

    Raises:
        SystemExit: a command fails.
    """
    examples = examples_path()
    files = {
        "model": examples / "actual.yaml",
        "poses": examples / "poses.csv",
        "out": folder,
        "sweep": folder / "s.yaml",
    }
    study = (examples / "sweep.yaml").read_text(encoding="utf-8")
    files["sweep"].write_text(study.replace("samples: 500", "samples: 50").replace("seed: 1", f"seed: {seed}"))
    for line in ROUND.strip().splitlines():
        words = [word.format(seed=seed, **files) for word in line.split()]
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = command_line(words)
        if code:
            raise SystemExit(f"{' '.join(words)}: exit code {code}\n{said.getvalue()}")


def soak(minutes: float, seed: int, fewest: int = 2 * PARTS) -> list[tuple[float, float, float, float]]:
    """Return, after each round: minutes since the start, memory in MB, open files, threads."""
    own, start, found = psutil.Process(), time.monotonic(), list[tuple[float, float, float, float]]()
    while len(found) < fewest or found[-1][0] < minutes:
        with tempfile.TemporaryDirectory() as folder:
            one_round(seed + len(found), Path(folder))
        passed = (time.monotonic() - start) / 60.0
        found.append((passed, own.memory_info().rss / 2.0**20, float(own.num_fds()), float(own.num_threads())))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    print("| rounds | minutes | memory MB | open files | threads |")
    print("|---|---|---|---|---|")
    found = np.array(soak(given.minutes, given.seed))
    parts = np.array_split(found, PARTS)
    middles = [np.median(part[:, 1:], axis=0) for part in parts]
    for part, (memory, files, threads) in zip(parts, middles, strict=True):
        print(f"| {len(part)} | {part[0, 0]:.1f} to {part[-1, 0]:.1f} | {memory:.0f} | {files:.0f} | {threads:.0f} |")
    grown = bool(np.any(middles[-1] > np.array([MOST_GROWTH, 1.0, 1.0]) * middles[1]))
    return int(grown)


if __name__ == "__main__":
    sys.exit(main())
