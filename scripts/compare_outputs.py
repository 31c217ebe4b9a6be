"""Run the same commands in two checkouts and compare what they print and write.

    python scripts/compare_outputs.py ../before . [--campaigns ../shared/campaigns --cases 0:60:10] [--only 'readme/*']

Both sides use this interpreter and the same arguments and file names, each in its own scratch folder with links to the
checkout's ``examples``, ``scripts`` and ``tests``. Compared are exit codes, standard output, standard error of refused
commands, and every text file and Zarr array written: texts exactly, except for runs of blanks and elapsed times,
numbers within tolerances. A decimal number may also differ by one in its last printed digit, by rounding. Pictures,
pages and meshes need only exist. Prints a line per command; exit code 1 if one differs.
"""

from __future__ import annotations

import argparse
import difflib
import fnmatch
import json
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import yaml

AT = "--at-mm -100 20 -600 --tilt-deg 17"
ACTUAL = "--model examples/actual.yaml"
RIG = "rig/case_008/campaign.csv"
SHIFT = "time_min,melt_degC\n0,1700\n60,1700\n90,1500\n"
HEATED = "format: pouring_robot/model/1\nlayout: paper\nheat: {melt_degC: 1650, after_min: 45}\n"
INPUTS = {"shift.csv": SHIFT, "heated.yaml": HEATED, "bad.csv": "q1_mm\nx\n", "bad.yaml": "format: 3\n"}
"""Input files that every scratch folder gets."""

# A command starts with the name of a subcommand, of a script, or with the name of a module after `-m`.
COMMANDS = {
    "demo": f"path examples/poses.csv {ACTUAL} --html demo/ladle.html --png demo/ladle.png",
    "readme/pose": f"pose {AT} {ACTUAL} --html ladle.html",
    "readme/path": f"path examples/poses.csv {ACTUAL}",
    "readme/robots": "robots",
    "readme/effects": "effects",
    "readme/compensate": f"compensate {AT} {ACTUAL} --melt-degC 1700",
    "readme/thermal": f"thermal {AT}",
    "readme/export": f"export {ACTUAL} --out as_built",
    "readme/sweep": "sweep examples/sweep.yaml --out results",
    "json/pose": f"pose {AT} {ACTUAL} --json",
    "json/path": f"path examples/poses.csv {ACTUAL} --json",
    "json/robots": "robots --json",
    "json/effects": "effects --json",
    "json/compensate": f"compensate {AT} {ACTUAL} --melt-degC 1700 --json",
    "json/thermal": f"thermal {AT} --json",
    "heat/pose": f"pose {AT} {ACTUAL} --melt-degC 1700",
    "heat/model": f"pose {AT} --model heated.yaml",
    "heat/commands": f"compensate examples/poses.csv {ACTUAL} --melt-degC 1700 --out commands.csv",
    "heat/one pose": f"thermal {AT} --after-min 30 --png heat.png",
    "heat/shift": "thermal --history shift.csv --every-min 10 --png shift.png",
    "refused/pose": "pose --at-mm -100 20 -6000 --tilt-deg 17",
    "refused/model": f"pose {AT} --model bad.yaml",
    "refused/diagnose": "diagnose bad.csv --out nothing",
    "refused/calibrate": "calibrate missing.csv --out nothing",
    "rig/make": "-m tests.rig --out rig --cases 9 --seed 777",
    "rig/diagnose": f"diagnose {RIG} --out found",
    "rig/again": f"diagnose {RIG} --out again --model found/model.yaml",
    "rig/blind": f"diagnose {RIG} --out blind --exclude tilt_drive_compliance",
    "rig/calibrate": f"calibrate {RIG} --out rig_calibrated",
    "campaign/plan": "campaign plan --out plan.csv --poses 60 --parameters geometry --priors",
    "campaign/simulate": f"campaign simulate --plan plan.csv {ACTUAL} --seed 1 --out measured.csv",
    "campaign/check": "campaign check measured.csv",
    "campaign/calibrate": "calibrate measured.csv --out calibrated",
    "campaign/pose": f"pose {AT} --model calibrated/calibrated.yaml",
    "paper/geometry": "reproduce_paper.py geometry",
    "paper/thermal": "reproduce_paper.py thermal",
}
HELP = (
    "examples", "robots", "robot", "pose", "path", "view", "campaign", "diagnose", "effects", "calibrate",
    "compensate", "sensitivity", "sweep", "thermal", "regress", "export",
)  # fmt: skip
COMMANDS |= {f"help/{name}": f"{name} --help" for name in HELP}
COMMANDS |= {f"help/campaign {name}": f"campaign {name}" for name in ("plan --help", "simulate --help", "check --help")}

TEXTS = {".csv", ".json", ".md", ".txt", ".urdf", ".xml", ".yaml", ".yml"}
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\d.]*\d)")
# How long something took, and when: never the same twice.
VOLATILE = re.compile(r'\b\d+(?:\.\d+)? (?:m?s|min)\b|"(?:\w*seconds|created)": [^,}\n]+|\d{4}-\d\d-\d\dT[\d:.+Z]+')


@dataclass
class Side:
    """One checkout, and the scratch folder in which its commands run."""

    checkout: Path
    folder: Path
    seconds: float = 0.0  # of CPU, of the last command
    seen: dict[Path, int] = field(default_factory=dict)

    def prepare(self) -> None:
        """Lay out the scratch folder."""
        self.folder.mkdir(parents=True)
        for name in ("examples", "scripts", "tests"):
            (self.folder / name).symlink_to(self.checkout / name)
        for name, content in INPUTS.items():
            (self.folder / name).write_text(content, encoding="utf-8")
        dict(self.new_files())

    def run(self, command: str) -> dict[str, str]:
        """Run a command and return its texts by name: exit code, output, and files written since the last one."""
        environment = os.environ | {
            "PYTHONPATH": str(self.checkout),
            "OPENBLAS_NUM_THREADS": "1",
            "COLUMNS": "120",
            "NO_COLOR": "1",
            "TERM": "dumb",
        }
        out, err = (self.folder / name for name in (".out", ".err"))
        with out.open("w") as output, err.open("w") as errors:
            process = subprocess.Popen(
                self._argv(command), cwd=self.folder, env=environment, stdout=output, stderr=errors
            )
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = code = os.waitstatus_to_exitcode(status)
        self.seconds = usage.ru_utime + usage.ru_stime
        texts = {"exit code": f"code {code}", "output": out.read_text(encoding="utf-8")}
        if code:
            texts["errors"] = err.read_text(encoding="utf-8")
        return texts | dict(self.new_files())

    def _argv(self, command: str) -> list[str]:
        first, *rest = shlex.split(command)
        if first == "-m":
            return [sys.executable, first, *rest]
        if first.endswith(".py"):  # scripts may have moved between the checkouts
            found = sorted((self.checkout / "scripts").rglob(first))
            return [sys.executable, str(found[0] if found else first), *rest]
        return [sys.executable, "-m", "pouring_robot", first, *rest]

    def new_files(self) -> Iterator[tuple[str, str]]:
        """Yield names and contents of files written since the last call; of pictures and the like the name only."""
        for path in sorted(self.folder.rglob("*")):
            changed = path.stat().st_mtime_ns
            if not path.is_file() or path.name in {".out", ".err"} or self.seen.get(path) == changed:
                continue
            self.seen[path] = changed
            name = path.relative_to(self.folder)
            store = next((p for p in path.parents if p.suffix == ".zarr"), None)
            if store is None:
                yield str(name), _text(path) if path.suffix in TEXTS else "is there"
            elif path == store / "zarr.json":
                yield str(store.relative_to(self.folder)), _arrays(store)


def _text(path: Path) -> str:
    """Return a text file; a YAML file one value a line, as where lines are broken depends on the length of numbers."""
    text = path.read_text(encoding="utf-8")
    if path.suffix not in {".yaml", ".yml"}:
        return text
    comments = [line for line in text.splitlines() if line.startswith("#")]
    return "\n".join([*comments, json.dumps(yaml.safe_load(text), indent=1, default=str)])


def _arrays(store: Path) -> str:
    """Return the arrays of a Zarr store as text, with all digits."""
    import xarray as xr

    with xr.open_zarr(store, consolidated=False) as data:
        return "\n".join(
            f"{name} {' '.join(data[name].dims)}: {' '.join(map(str, data[name].to_numpy().ravel().tolist()))}"
            for name in sorted(map(str, data.variables))
        )


@dataclass(frozen=True)
class Tolerance:
    """How far two numbers may be apart, in the unit they are printed in."""

    relative: float = 1e-6
    absolute: float = 1e-9

    def allows(self, before: str, after: str) -> bool:
        """Whether two printed numbers are the same; integers must be."""
        if before == after:
            return True
        one, two = (_value(text) for text in (before, after))
        size = max(abs(one), abs(two))
        digit = max(_last_digit(before), _last_digit(after))
        exact = digit == 0.0
        return abs(one - two) <= (0.0 if exact else self.absolute + self.relative * size + digit * (1.0 + 1e-6))


def _value(number: str) -> float:
    return float(number.replace("−", "-"))


def _last_digit(number: str) -> float:
    """Return the size of one in the last digit of a decimal number, 0 of an integer."""
    digits, _, exponent = number.lower().partition("e")
    _, point, decimals = digits.partition(".")
    return float(10.0 ** (int(exponent or 0) - len(decimals))) if point or exponent else 0.0


def difference(before: str, after: str, tolerance: Tolerance) -> tuple[float, str]:
    """Return how far two texts are apart.

    Args:
        before: one text.
        after: the other.
        tolerance: of their numbers.

    Returns:
        The largest difference of two numbers over the larger of them, and the first lines that differ; "" if none do.
    """
    largest = 0.0
    first, second = (VOLATILE.sub("…", text).splitlines() for text in (before, after))
    first, second = ([" ".join(line.split()) for line in lines if line.strip()] for lines in (first, second))
    for one, two in zip(first, second, strict=False):
        if NUMBER.sub("#", one) != NUMBER.sub("#", two):
            break
        for a, b in zip(NUMBER.findall(one), NUMBER.findall(two), strict=True):
            size = max(abs(_value(a)), abs(_value(b)))
            largest = max(largest, abs(_value(a) - _value(b)) / size if size else 0.0)
            if not tolerance.allows(a, b):
                return largest, f"{a} → {b} in: {one[:100]}"
    if [NUMBER.sub("#", line) for line in first] == [NUMBER.sub("#", line) for line in second]:
        return largest, ""
    changes = [line for line in difflib.unified_diff(first, second, lineterm="", n=0) if line[:3] not in {"---", "+++"}]
    return math.inf, " | ".join(line[:110] for line in changes if line[0] in "-+")[:330]


def compare(before: dict[str, str], after: dict[str, str], tolerance: Tolerance) -> tuple[float, list[str]]:
    """Return the largest difference of two sets of texts, and a line for each that differs."""
    faults = [f"{name}: only before" for name in sorted(before.keys() - after.keys())]
    faults += [f"{name}: only after" for name in sorted(after.keys() - before.keys())]
    largest = 0.0
    for name in (name for name in before if name in after):
        size, fault = difference(before[name], after[name], tolerance)
        largest = max(largest, size)
        if fault:
            faults.append(f"{name}: {fault}")
    return largest, faults


def commands(campaigns: Path | None, cases: slice, patterns: Sequence[str]) -> dict[str, str]:
    """Return the commands by name: the list above, and diagnose and calibrate of the chosen campaigns."""
    chosen = dict(COMMANDS)
    for path in sorted(campaigns.resolve().glob("*/campaign.csv"))[cases] if campaigns else ():
        for kind in ("diagnose", "calibrate"):
            chosen[f"{kind}/{path.parent.name}"] = shlex.join([kind, str(path), "--out", f"{kind}_{path.parent.name}"])
    return {n: c for n, c in chosen.items() if not patterns or any(fnmatch.fnmatch(n, p) for p in patterns)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the commands and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="a checkout")
    parser.add_argument("after", type=Path, help="another")
    parser.add_argument("--campaigns", type=Path, help="folder with one sub-folder a campaign")
    parser.add_argument("--cases", default=":", metavar="SLICE", help="which of them, as in 0:60:10 (all)")
    parser.add_argument("--only", action="append", default=[], metavar="PATTERN", help="commands by name; repeatable")
    parser.add_argument("--relative", type=float, default=1e-6, help="tolerance, as a share of the number (1e-6)")
    parser.add_argument("--absolute", type=float, default=1e-9, help="tolerance, in the printed unit (1e-9)")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep what was written in this new folder")
    given = parser.parse_args(arguments)
    cases = slice(*(int(part) if part else None for part in given.cases.split(":")))
    chosen = commands(given.campaigns, cases, given.only)
    if not chosen:
        parser.error(f"no command is called {' or '.join(given.only)}")
    tolerance = Tolerance(given.relative, given.absolute)
    differing = 0
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(2) as pool:
        folder = given.keep.resolve() if given.keep else Path(scratch)
        sides = [Side(getattr(given, name).resolve(), folder / name) for name in ("before", "after")]
        for side in sides:
            side.prepare()
        print("| command | | largest difference | CPU s before | after |\n|---|---|---|---|---|", flush=True)
        for name, command in chosen.items():
            before, after = pool.map(Side.run, sides, [command] * 2)
            largest, faults = compare(before, after, tolerance)
            differing += bool(faults)
            seconds = " | ".join(f"{side.seconds:.1f}" for side in sides)
            print(f"| {name} | {'differs' if faults else 'same'} | {largest:.1e} | {seconds} |")
            print("".join(f"    {fault}\n" for fault in faults[:8]), end="", flush=True)
    print(f"\n{len(chosen)} commands, {differing} differ")
    return 1 if differing else 0


if __name__ == "__main__":
    raise SystemExit(main())
