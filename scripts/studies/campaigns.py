"""Calibrate every campaign of a folder with geometry only, and report the held-out error.

    python scripts/studies/campaigns.py ../campaigns --json figures.json

Each sub-folder holds ``campaign.csv`` and ``campaign.yaml``; ``truth.json``, where there is one, is read after the fit
and only to sort the table by its ``kind``. Prints a Markdown table and a summary; exit code 1 if the held-out error,
positions and rotations each over their noise, is larger than without calibration, or a null case was changed.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import track

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.campaign.data import Campaign
from pouring_robot.exceptions import BadInputError, PouringRobotError
from pouring_robot.io.files import check_writable, write_whole

HEADINGS = ("case", "kind", "kept", "before mm", "after mm", "floor mm", "before mrad", "after mrad", "floor mrad", "s")
_ALIKE = 1e-6  # below this share two errors are the same


@dataclass(frozen=True)
class Case:
    """Held-out figures of one campaign; NaN where nothing was measured or no fit was made.

    Attributes:
        name: of the folder.
        kind: what ``truth.json`` calls it; "" without one.
        kept: groups of parameters that were kept.
        vetoed: groups that were chosen, but refused by the held-out rows.
        before_mm: RMS of a coordinate without calibration; ``after_mm`` with it; ``floor_mm`` by noise alone.
        before_mrad: the same of rotations.
        seconds: taken.
        refused: why nothing was calibrated; "" where something was.
    """

    name: str
    kind: str
    kept: tuple[str, ...] = ()
    vetoed: tuple[str, ...] = ()
    before_mm: float = math.nan
    after_mm: float = math.nan
    floor_mm: float = math.nan
    before_mrad: float = math.nan
    after_mrad: float = math.nan
    floor_mrad: float = math.nan
    seconds: float = 0.0
    refused: str = ""

    @property
    def ratio(self) -> float:
        """Held-out error after over before, positions and rotations each over their noise."""
        after = (self.after_mm / self.floor_mm, self.after_mrad / self.floor_mrad)
        before = (self.before_mm / self.floor_mm, self.before_mrad / self.floor_mrad)
        return math.hypot(*(v for v in after if math.isfinite(v))) / math.hypot(
            *(v for v in before if math.isfinite(v))
        )

    @property
    def worse(self) -> bool:
        """Whether the held-out error is larger than without calibration."""
        return self.ratio > 1.0 + _ALIKE

    @property
    def partly_worse(self) -> str:
        """Which of positions and rotations is further off than without calibration, and by how much; "" if neither."""
        parts = (("position", self.before_mm, self.after_mm), ("rotation", self.before_mrad, self.after_mrad))
        return ", ".join(f"{name} +{a / b - 1.0:.1%}" for name, b, a in parts if a > b * (1.0 + _ALIKE))

    @property
    def above_floor(self) -> float:
        """The larger of both errors after calibration over its noise floor."""
        ratios = (self.after_mm / self.floor_mm, self.after_mrad / self.floor_mrad)
        return max((ratio for ratio in ratios if math.isfinite(ratio)), default=math.nan)


def run_case(folder: Path) -> Case:
    """Calibrate one campaign."""
    truth = folder / "truth.json"
    began = time.perf_counter()
    try:
        found = calibrate(Campaign.read(folder / "campaign.csv"), None, CalibrationOptions())
    except PouringRobotError as error:
        return Case(folder.name, _kind(truth), refused=str(error), seconds=time.perf_counter() - began)
    before, after = (found.misfit(found.split.test, after=a) for a in (False, True))
    floor = found.floor(found.split.test)
    return Case(
        folder.name,
        _kind(truth),
        tuple(group.name for group in found.selection.groups),
        found.refused.groups if found.refused else (),
        before.rms_mm,
        after.rms_mm,
        floor["rms_mm"],
        before.rms_mrad,
        after.rms_mrad,
        floor["rms_mrad"],
        time.perf_counter() - began,
    )


def _kind(truth: Path) -> str:
    return str(json.loads(truth.read_text(encoding="utf-8")).get("kind", "")) if truth.is_file() else ""


def row(case: Case) -> str:
    """Return a case as a line of the table."""
    if case.refused:
        return f"| {case.name} | {case.kind} | refused: {case.refused} |"
    figures = (case.before_mm, case.after_mm, case.floor_mm, case.before_mrad, case.after_mrad, case.floor_mrad)
    cells = (*(f"{v:.4f}" if math.isfinite(v) else "–" for v in figures), f"{case.seconds:.1f}")
    kept = " + ".join(case.kept) or ("nothing" if not case.vetoed else f"nothing (refused: {' + '.join(case.vetoed)})")
    mark = f" ({case.partly_worse})" if case.partly_worse else ""
    return f"| {case.name} | {case.kind} | {kept}{mark} | {' | '.join(cells)} |"


def summary(cases: Sequence[Case]) -> list[str]:
    """Return the outcome, a line a fact."""
    fitted = [case for case in cases if not case.refused]
    worse = [case.name for case in fitted if case.worse]
    lines = [
        f"{len(cases)} campaigns, {len(cases) - len(fitted)} refused, {sum(bool(c.kept) for c in fitted)} changed, "
        f"{sum(bool(c.vetoed) for c in fitted)} left as they were because held-out rows refused what was found",
        f"worse on held-out rows than without calibration: {len(worse)} of {len(fitted)} {' '.join(worse)}".rstrip(),
        "positions or rotations alone worse: "
        + ("; ".join(f"{case.name} {case.partly_worse}" for case in fitted if case.partly_worse) or "none"),
    ]
    for unit in ("mm", "mrad"):
        lines.append(f"held-out {unit} over the floor, RMS over campaigns: {_pooled(fitted, unit)}")
    null = [case for case in fitted if case.kind == "null"]
    if null:
        moved = [case.name for case in null if case.kept]
        lines.append(
            f"null cases: {len(null)}, {len(moved)} moved {' '.join(moved)}".rstrip()
            + f"; held-out error over floor at most {max(case.above_floor for case in null):.3f}"
        )
    return lines


def _pooled(cases: Sequence[Case], unit: str) -> str:
    found = []
    for when in ("before", "after"):
        ratios = [getattr(case, f"{when}_{unit}") / getattr(case, f"floor_{unit}") for case in cases]
        known = [ratio**2 for ratio in ratios if math.isfinite(ratio)]
        found.append(f"{when} {math.sqrt(sum(known) / len(known)):.3f}" if known else f"{when} –")
    return ", ".join(found)


def _figures(case: Case) -> dict[str, object]:
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(case).items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all campaigns and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds one sub-folder a campaign")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures")
    given = parser.parse_args(arguments)
    try:
        if given.json:
            check_writable(given.json)
        folders = sorted(path.parent for path in given.folder.glob("*/campaign.csv"))
        if not folders:
            raise BadInputError(f"{given.folder}: no sub-folder holds a campaign.csv; give the folder above them")
        print(f"| {' | '.join(HEADINGS)} |\n|{'---|' * len(HEADINGS)}")
        cases = []
        for folder in track(folders, "calibrating", console=Console(stderr=True), transient=True):
            cases.append(run_case(folder))
            print(row(cases[-1]), flush=True)
        print("\n" + "\n".join(summary(cases)))
        if given.json:
            write_whole(given.json, json.dumps([_figures(case) for case in cases], indent=1, allow_nan=False) + "\n")
    except PouringRobotError as error:
        print(f"calibrate_campaigns: {error}", file=sys.stderr)
        return error.exit_code
    wrong = any(case.worse or (case.kind == "null" and case.kept) for case in cases)
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
