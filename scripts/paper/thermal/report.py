"""The study of the paper's section 5 as a table for the terminal and as files: CSV, JSON, Markdown, PNG."""

from __future__ import annotations

import functools
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from pouring_robot.io.tables import csv_text
from pouring_robot.io.units import MM
from pouring_robot.thermal.regression.methods import METHODS
from pouring_robot.thermal.regression.table import ErrorTable
from scripts.paper.claims import COLUMNS, Claim
from scripts.paper.page import PaperReport, claims_table, tally
from scripts.paper.thermal import plots
from scripts.paper.thermal.claims import judge_all
from scripts.paper.thermal.study import AXES, ThermalStudy


def _methods_table(study: ThermalStudy) -> Table:
    """Return what the paper's method and ours leave on poses that none has seen; no verdict hangs on it."""
    title = f"Not in the paper: held-out error of each method on {len(study.others)} poses, rms (mean ± spread) in mm"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("method")
    for axis in AXES:
        table.add_column(axis, justify="right")
    found = {axis: study.unseen(axis) for axis in AXES}
    for name in found["X"]:
        left = (found[axis][name] for axis in AXES)
        cells = (f"{one.rms / MM:.3f} ({one.mean / MM:+.3f} ± {one.spread / MM:.3f})" for one in left)
        table.add_row(METHODS.get(name, f"{name.replace('single', 'sensitive set')} alone"), *cells)
    return table


@dataclass(frozen=True, eq=False)
class ThermalReport(PaperReport):
    """The judged study.

    Attributes:
        study: what was computed.
        claims: row by row.
    """

    title: ClassVar[str] = "The paper's thermal errors, claim by claim"
    part: ClassVar[str] = "thermal"

    study: ThermalStudy
    claims: list[Claim]

    @classmethod
    def of(cls, study: ThermalStudy) -> ThermalReport:
        """Judge a study."""
        return cls(study, judge_all(study))

    @property
    def heading(self) -> str:
        """What was computed, on one line."""
        study = self.study
        return (
            f"layout {study.layout}, {len(study.poses)} poses at 10° of tilt, seed {study.seed}, "
            f"{len(study.melts_degC)} melt temperatures; properties from thermal.yaml, nothing tuned"
        )

    def renderables(self) -> list[RenderableType]:
        """Return everything there is to print."""
        return [
            Text(self.heading),
            "",
            claims_table("The paper's section 5, claim by claim", self.claims),
            Text(tally(self.claims)),
            "",
            _methods_table(self.study),
        ]

    @functools.cached_property
    def figures(self) -> dict[str, bytes]:
        """Return the pictures by file name; PNG."""
        study = self.study
        return {
            "paper_fig6.png": plots.lining_and_chains(study),
            "paper_fig7.png": plots.chains_with_radiation(study),
            "paper_fig8.png": plots.deformation(study),
            "paper_fig9.png": plots.errors_over_temperature(study),
            "paper_fig10.png": plots.choice_of_sets(study),
            "paper_fig11.png": plots.contest_picture(study, 11),
            "paper_fig12.png": plots.contest_picture(study, 12),
        }

    def record(self) -> dict[str, Any]:
        """Return all figures, ready for JSON."""
        study = self.study
        return {
            "layout": study.layout,
            "seed": study.seed,
            "poses": [p.figures() for p in study.poses],
            "melts_degC": list(study.melts_degC),
            "moved_mm": {axis: (study.moved[:, :, a] / MM).tolist() for a, axis in enumerate(AXES)},
            "drawings": [asdict(draw) for draw in study.draws],
            "drawings_of_the_other_layout": [asdict(draw) for draw in study.other_draws],
            "claims": [asdict(claim) for claim in self.claims],
        }

    def claim_rows(self) -> list[dict[str, Any]]:
        """Return one row a claim."""
        return [{name: getattr(claim, name) for name in COLUMNS} for claim in self.claims]

    def tables(self) -> dict[str, str]:
        """Return the error sets and their poses as CSV by file name, as ``pouring-robot regress`` reads them."""
        study, tables = self.study, self.study.tables
        names = tuple(f"{name}_{axis.lower()}" for name in tables["X"].names for axis in AXES)
        errors = study.moved.reshape(len(study.melts_degC), -1)
        poses = ([f"P{k}", *(f"{v:.9g}" for v in pose.to_mm_deg())] for k, pose in enumerate(study.poses, start=1))
        return {
            "error_sets.csv": ErrorTable(tables["X"].temperatures_K, errors, names).csv(),
            "poses.csv": csv_text(("set", "x_mm", "y_mm", "z_mm", "tilt_deg"), poses),
        }
