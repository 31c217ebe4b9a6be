"""Run commands on increasing numbers of rows, poses or samples, each in a separate process, and report their cost.

    python scripts/studies/growth.py --longest 180

A size is tried if the previous one took, in proportion to the sizes, less than ``--longest`` processor seconds. Prints
a Markdown table: processor seconds, largest memory, and the exponent with which time has grown since the previous size
(1: in proportion).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from pouring_robot.robot.export.shipped_files import examples_path

ROOT = Path(__file__).resolve().parents[2]
ACTUAL = examples_path() / "actual.yaml"
# Of this process, which does nothing else, and of no child of another's.
_RUN = """
import json, resource, sys
from pouring_robot.cli import main
told = sys.argv.pop(1)
code = main()
used = resource.getrusage(resource.RUSAGE_SELF)
json.dump([used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0], open(told, "w"))
sys.exit(code)
"""


def run(command: str, folder: Path) -> tuple[float, float]:
    """Run a command; return seconds of processor and the largest memory in MB."""
    told = folder / "told.json"
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    line = [sys.executable, "-c", _RUN, str(told), *command.split()]
    done = subprocess.run(line, cwd=folder, env=variables, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{command}: {done.stderr}")
    seconds, memory = json.loads(told.read_text(encoding="ascii"))
    return seconds, memory


def campaign(folder: Path, rows: int) -> None:
    """Write a campaign of so many rows."""
    run(f"campaign simulate --random {rows} --model {ACTUAL} --out c.csv --overwrite", folder)


def poses(folder: Path, count: int) -> None:
    """Write so many poses."""
    head, *rows = (examples_path() / "poses.csv").read_text(encoding="utf-8").splitlines()
    given = [rows[k % len(rows)] for k in range(count)]
    (folder / "p.csv").write_text("\n".join([head, *given]) + "\n", encoding="utf-8")


def study(folder: Path, samples: int) -> None:
    """Write a sweep of so many closures: 54 poses a sample."""
    text = (examples_path() / "sweep.yaml").read_text(encoding="utf-8")
    text = text.replace("samples: 500", f"samples: {max(2, samples // 54)}")
    (folder / "s.yaml").write_text(text, encoding="utf-8")


ROWS = (200, 2000, 20_000, 100_000)
GROWN: dict[str, tuple[Callable[[Path, int], None], str, tuple[int, ...]]] = {
    "campaign check, rows": (campaign, "campaign check c.csv --json", ROWS),
    "calibrate, rows": (campaign, "calibrate c.csv --out c --overwrite --json", ROWS),
    "diagnose, rows": (campaign, "diagnose c.csv --out d --overwrite --json", ROWS),
    "path, poses": (poses, f"path p.csv --model {ACTUAL} --json", (100, 1000, 10_000)),
    "path --at-once, poses": (poses, f"path p.csv --model {ACTUAL} --at-once --json", (1000, 10_000, 100_000)),
    "sweep, closures": (study, "sweep s.yaml --out s{size} --json", (10**5, 10**6, 10**7)),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--longest", type=float, default=180.0, help="seconds of processor (default 180)")
    parser.add_argument("--only", action="append", choices=GROWN)
    given = parser.parse_args(arguments)
    print("| command | size | processor s | memory MB | grown to the power |")
    print("|---|---|---|---|---|")
    for name in given.only or GROWN:
        prepare, command, sizes = GROWN[name]
        before: tuple[int, float] | None = None
        with tempfile.TemporaryDirectory() as place:
            for size in sizes:
                if before and before[1] * size / before[0] > given.longest:
                    print(f"| {name} | {size} | not tried | | |", flush=True)
                    continue
                prepare(Path(place), size)
                seconds, memory = run(command.format(size=size), Path(place))
                power = f"{math.log(seconds / before[1]) / math.log(size / before[0]):.2f}" if before else ""
                print(f"| {name} | {size} | {seconds:.1f} | {memory:.0f} | {power} |", flush=True)
                before = size, seconds
    return 0


if __name__ == "__main__":
    sys.exit(main())
