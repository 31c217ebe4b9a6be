"""The study of the paper's section 4 as tables for the terminal and as files: CSV, JSON, Markdown, PNG."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from pouring_robot.io.tables import rows_csv
from pouring_robot.io.units import MM, MRAD
from pouring_robot.report.plots import png_of
from pouring_robot.sensitivity.samples import box_plots, distributions
from scripts.paper.claims import COLUMNS, Claim
from scripts.paper.geometry.comparison import AxisRow, Lesson, axis_rows, lesson, parameter_rows
from scripts.paper.geometry.parameter_claims import PARAMETER_CLAIMS
from scripts.paper.geometry.plots import mark, open_against_closed
from scripts.paper.geometry.shape_claims import SHAPE_CLAIMS
from scripts.paper.geometry.size_claims import SIZE_CLAIMS
from scripts.paper.geometry.study import ANGLE_ERROR_RAD, LENGTH_ERROR_M, PILE_M, GeometryStudy
from scripts.paper.page import PaperReport, claims_table, tally

_CLOSED = "an error acts through all four chains, and only the inclination of the legs constrains Y"


@dataclass(frozen=True, eq=False)
class GeometryReport(PaperReport):
    """The judged study.

    Attributes:
        study: what was computed.
        table: claims on the parameters themselves.
        opened: claims on their effect, in the paper's open branch.
        closed: the same claims, on the closed chain.
        axes: both models, coordinate by coordinate.
        lesson: figures of their comparison.
    """

    title: ClassVar[str] = "The paper's geometric errors, claim by claim"
    part: ClassVar[str] = "geometry"

    study: GeometryStudy
    table: list[Claim]
    opened: list[Claim]
    closed: list[Claim]
    axes: list[AxisRow]
    lesson: Lesson

    @classmethod
    def of(cls, study: GeometryStudy) -> GeometryReport:
        """Judge a study."""
        opened, closed = (
            [claim(study, errors.of_chain(1)) for claim in (*SIZE_CLAIMS, *SHAPE_CLAIMS)]
            for errors in (study.open_branch, study.closed_chain)
        )
        # The reasons are those of open branches; here every error acts through all four chains.
        closed = [replace(claim, why=_CLOSED, used=False) for claim in closed]
        table = [claim(study) for claim in PARAMETER_CLAIMS]
        return cls(study, table, opened, closed, axis_rows(study), lesson(study))

    @property
    def heading(self) -> str:
        """What was computed, on one line."""
        return (
            f"layout {self.study.layout_name}, {len(self.study.command)} poses drawn from its workspace, "
            f"seed {self.study.seed}; errors of {LENGTH_ERROR_M / MM:g} mm and {ANGLE_ERROR_RAD / MRAD:g} mrad, "
            "one at a time, at o"
        )

    def renderables(self) -> list[RenderableType]:
        """Return everything there is to print."""
        first = [*self.table, *self.opened]
        return [
            Text(self.heading),
            "",
            claims_table("The paper's section 4, claim by claim (open branch, as in the paper)", first),
            Text(tally(first, starred=True)),
            Text(
                "* the layout or the place of S_1 was inferred from this statement, because the paper's drawing "
                "and Table 1 are missing; agreement is a weak test"
            ),
            "",
            claims_table(
                "The same statements on the closed chain: four chains hold the platform", self.closed, short=True
            ),
            Text(f"{tally(self.closed)}; readings and rules as above; why: {_CLOSED}"),
            "",
            _axes_table(self.axes),
            "",
            _parameters_table(self.study),
            "",
            *(Text(f"- {sentence}") for sentence in self.lesson.sentences(len(self.study.closed_chain.parameters))),
        ]

    @functools.cached_property
    def figures(self) -> dict[str, bytes]:
        """Return the pictures by file name; PNG."""
        opened, closed = (errors.of_chain(1) for errors in (self.study.open_branch, self.study.closed_chain))
        labels = opened.reaching(MM).labels
        which = f"chain 1, {opened.translation_m.shape[1]} poses"
        drawn = {
            "paper_fig4_open.png": box_plots(
                opened.reaching(MM), f"Fig. 4, open branch: errors that pass 1 mm ({which})"
            ),
            "paper_fig5_open.png": distributions(opened, labels, f"Fig. 5, open branch: how they spread ({which})"),
            "paper_fig4_closed.png": box_plots(
                closed.reaching(MM), f"Fig. 4 for the closed chain: errors that pass 1 mm ({which})"
            ),
            "paper_fig5_closed.png": distributions(
                closed, labels, f"Fig. 5 for the closed chain: how the same errors spread ({which})"
            ),
        }
        for name in ("paper_fig5_open.png", "paper_fig5_closed.png"):
            mark(drawn[name], PILE_M)
        return {
            **{name: png_of(figure) for name, figure in drawn.items()},
            "paper_open_closed.png": open_against_closed(
                self.study, f"What an error does in its open branch and in the closed chain ({which})"
            ),
        }

    def record(self) -> dict[str, Any]:
        """Return all figures, ready for JSON."""
        layout = self.study.layout
        return {
            "layout": self.study.layout_name,
            "poses": len(self.study.command),
            "seed": self.study.seed,
            "workspace": {
                "lower_mm": (layout.box[0][:3] / MM).tolist(),
                "upper_mm": (layout.box[1][:3] / MM).tolist(),
                "tilt_rad": [float(corner[3]) for corner in layout.box],
            },
            "errors": {"length_mm": LENGTH_ERROR_M / MM, "angle_mrad": ANGLE_ERROR_RAD / MRAD},
            "claims": [{"model": model, **asdict(claim)} for model, claim in self._all()],
            "axes": [{**asdict(row), "ratio": row.ratio} for row in self.axes],
            "lesson": asdict(self.lesson),
        }

    def claim_rows(self) -> list[dict[str, Any]]:
        """Return one row a claim and model."""
        rows = [(model, claim, {name: getattr(claim, name) for name in COLUMNS}) for model, claim in self._all()]
        return [{"model": model, **row, "used": claim.used} for model, claim, row in rows]

    def tables(self) -> dict[str, str]:
        """Return one row an error as CSV."""
        rows = parameter_rows(self.study)
        rows = [{k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows]
        return {"parameters.csv": rows_csv(rows)}

    def _all(self) -> list[tuple[str, Claim]]:
        parts = (("table", self.table), ("open branch", self.opened), ("closed chain", self.closed))
        return [(model, claim) for model, claims in parts for claim in claims]


def _axes_table(rows: Sequence[AxisRow]) -> Table:
    table = Table(
        title="Open branch and closed chain: root mean square over poses; all errors: taken as independent",
        title_justify="left",
        title_style="bold",
    )
    table.add_column("of o")
    for name in (
        "one error, open",
        "one error, closed",
        "closed / open",
        "all 25 of a branch, open",
        "all 100, closed",
    ):
        table.add_column(name, justify="right")
    for row in rows:
        figures = (row.open_single, row.closed_single, row.ratio, row.open_all, row.closed_all)
        table.add_row(row.coordinate, *(f"{value:.2f}" for value in figures))
    return table


def _parameters_table(study: GeometryStudy) -> Table:
    opened, closed = study.open_branch.of_chain(1), study.closed_chain.of_chain(1)
    table = Table(
        title="Chain 1, error by error: mean |ΔX| |ΔY| |ΔZ| and largest distance of o, mm",
        title_justify="left",
        title_style="bold",
    )
    table.add_column("error")
    for model in ("open", "closed"):
        for name in ("X", "Y", "Z", "largest"):
            table.add_column(f"{model} {name}", justify="right")
    table.add_column("closed / open largest", justify="right")
    for k, label in enumerate(opened.labels):
        cells, tops = [], []
        for errors in (opened, closed):
            tops.append(float(errors.distance_m[k].max()))
            cells += [f"{value / MM:.3f}" for value in (*errors.mean_m[k], tops[-1])]
        ratio = f"{tops[1] / tops[0]:.2f}" if tops[0] > 1e-9 else "from 0"
        table.add_row(label, *cells, ratio)
    return table
