"""Run the same commands with other BLAS kernels and thread counts, and report how far their answers differ.

    python scripts/studies/same_everywhere.py

NumPy and SciPy each contain an OpenBLAS, which uses the kernel that ``OPENBLAS_CORETYPE`` names, not the machine's.
Each run is a separate process: location of the ladle, a calibration, diagnoses of campaigns with and without a missing
effect. Prints a Markdown table of the largest differences from the first run; exit code 1 if a verdict differs.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.robot.export.shipped_files import examples_path

ROOT = Path(__file__).resolve().parents[2]
KERNELS = ("Prescott", "Haswell", "Zen", "SkylakeX")
THREADS = (1, 2)
ACTUAL = examples_path() / "actual.yaml"
POSES = examples_path() / "poses.csv"
CAMPAIGN, SOUND = "missing.csv", "sound.csv"
COMMANDS = {
    "path": f"path {POSES} --model {ACTUAL} --json",
    "calibrate": f"calibrate {CAMPAIGN} --out calibrated --overwrite --json",
    "diagnose, errors missing": f"diagnose {CAMPAIGN} --out found --overwrite --json",
    "diagnose, nothing missing": f"diagnose {SOUND} --model {ACTUAL} --out none --overwrite --json",
}
_RUN = """
import sys
from threadpoolctl import threadpool_info
from pouring_robot.cli import main
code = main()
used = {(info["architecture"], info["num_threads"]) for info in threadpool_info() if info["user_api"] == "blas"}
print("\\n" + repr(sorted(used)), file=sys.stderr)
sys.exit(code)
"""


def run(command: str, folder: Path, kernel: str = "", threads: int = 1) -> tuple[dict[str, Any], str]:
    """Run a command and return its figures and the kernels that it says it used."""
    chosen = {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": str(threads)}
    chosen |= {"OPENBLAS_CORETYPE": kernel} if kernel else {}
    done = subprocess.run(
        [sys.executable, "-c", _RUN, *command.split()],
        cwd=folder,
        env=os.environ | chosen,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{command} under {kernel}: {done.stderr}")
    return json.loads(done.stdout) if "--json" in command else {}, done.stderr.splitlines()[-1]


def numbers(figures: Any, name: str = "") -> dict[str, float]:
    """Return all numbers of figures, by where they stand; how long something took is none."""
    if isinstance(figures, dict):
        return {k: v for key, value in figures.items() for k, v in numbers(value, f"{name}.{key}").items()}
    if isinstance(figures, list):
        return {k: v for at, value in enumerate(figures) for k, v in numbers(value, f"{name}[{at}]").items()}
    if isinstance(figures, bool) or not isinstance(figures, int | float) or "seconds" in name:
        return {}
    return {name: float(figures)}


def words(figures: Any) -> Any:
    """Return all that is no number: verdicts, names, their order."""
    if isinstance(figures, dict):
        return {key: words(value) for key, value in figures.items()}
    if isinstance(figures, list):
        return [words(value) for value in figures]
    return figures if isinstance(figures, str | bool | None) else 0


def largest(one: dict[str, float], other: dict[str, float]) -> dict[str, float]:
    """Return the largest difference of two runs' numbers by kind, as a share of the largest number of its kind.

    Numbers whose key has the same name are of a kind: the forces of all chains at all poses, all standard deviations.
    """
    if one.keys() != other.keys():
        return {"other figures": np.inf}
    scale: dict[str, float] = {}
    apart: dict[str, float] = {}
    for name, value in one.items():
        kind = kind_of(name)
        scale[kind] = max(scale.get(kind, 0.0), abs(value))
        apart[kind] = max(apart.get(kind, 0.0), abs(value - other[name]))
    shares = {kind: value / (scale[kind] or 1.0) for kind, value in apart.items()}
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def kind_of(name: str) -> str:
    """Return the last key on the way to a number."""
    return re.sub(r"\[\d+\]", "", name).rsplit(".", 1)[-1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return its exit code."""
    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args(arguments)
    differ = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for out, more in ((CAMPAIGN, "--seed 1"), (SOUND, "--seed 2")):
            run(f"campaign simulate --random 50 {more} --model {ACTUAL} --out {out}", folder)
        print("| command | asked for | used, threads | words the same | numbers | largest differences, shares |")
        print("|---|---|---|---|---|---|")
        for what, command in COMMANDS.items():
            first: dict[str, Any] | None = None
            for kernel, threads in [(kernel, 1) for kernel in KERNELS] + [(KERNELS[1], t) for t in THREADS[1:]]:
                figures, used = run(command, folder, kernel, threads)
                first = first or figures
                same = words(figures) == words(first)
                shares = list(largest(numbers(first), numbers(figures)).items())[:3]
                differ += not same
                told = ", ".join(f"{kind} {share:.0e}" for kind, share in shares if share) or "none"
                row = (what, kernel, used, "yes" if same else "NO", len(numbers(figures)), told)
                print("| " + " | ".join(map(str, row)) + " |", flush=True)
    return int(bool(differ))


if __name__ == "__main__":
    sys.exit(main())
