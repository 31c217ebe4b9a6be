"""What a sensitivity study writes: CSV, JSON, pictures and a page; and its tables."""

import json
from dataclasses import dataclass
from pathlib import Path

from pouring_robot.io.files import write_together
from pouring_robot.io.tables import csv_text
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Table, html_page
from pouring_robot.sensitivity.findings import ErrorRow, SensitivityFindings

_DRAWN = 12


@dataclass(frozen=True, eq=False, repr=False)
class SensitivityReport(SensitivityFindings):
    """What each error does alone, and how that is written."""

    def save(self, folder: Path) -> list[Path]:
        """Write ``sensitivity.csv``, ``.json``, pictures and ``report.html`` into a folder, which is made.

        Raises:
            OutputError: the folder cannot be written to.
        """
        from pouring_robot.report.plots import png_of, svg_of
        from pouring_robot.sensitivity.plots import box_plots, distributions

        rows = [row.figures() for row in self.rows]
        files: dict[Path, str | bytes] = {
            folder / "sensitivity.csv": csv_text(rows[0], (row.values() for row in rows)),
            folder / "sensitivity.json": json.dumps(self.figures(), indent=1, ensure_ascii=False) + "\n",
        }
        plots: list[Plot] = []
        for samples in self.samples:
            strongest = samples.subset([row.parameter for row in self.of_model(samples.kind)[:_DRAWN]])
            title = f"{self.robot}, {samples.kind}: the {len(strongest.labels)} strongest errors, {self.poses} poses"
            drawn = {
                "sizes": box_plots(strongest, title, self.request.limit_m),
                "spread": distributions(strongest, strongest.labels, title),
            }
            for name, figure in drawn.items():
                files[folder / f"{name}_{samples.kind.replace(' ', '_')}.png"] = png_of(figure)
                plots.append(Plot(f"{samples.kind}: {name} over the poses", svg_of(figure)))
        blocks: list[Block] = [
            Paragraph(self.headline, "headline"),
            Paragraph(missed_line(self)),
            Heading("What to control"),
            Lines(control_lines(self) or ["nothing passes the limit"]),
            Heading("Pictures"),
            *plots,
            Heading("Each error alone"),
            errors_table(self),
        ]
        if self.dh:
            blocks += [Heading("The DH table"), dh_table(self)]
        links = {"a row an error": "sensitivity.csv", "all figures": "sensitivity.json"}
        title = f"Sensitivity of {self.robot}"
        files[folder / "report.html"] = html_page(title, title, blocks, links=links)
        return list(write_together(files))


def missed_line(found: SensitivityFindings) -> str:
    """Return by how much first order misses."""
    missed, moved = (value / MM for value in found.missed_m)
    return f"first order misses exact closures by {missed:.2g} mm at most, where the robot moves {moved:.3g} mm"


def control_lines(found: SensitivityFindings) -> list[str]:
    """Return what to hold tightly, a line a part."""
    return [
        f"control {control.part}: {' '.join(control.errors)} (main direction {control.directions}, up to "
        f"{control.largest_m / MM:.3f} mm)"
        for control in found.controls
    ]


def errors_table(found: SensitivityFindings) -> Table:
    """Return the errors of the closed robot, the strongest first, with the open branch beside them if there is one."""
    opened = {row.parameter.name: row for row in found.of_model("open branch")}
    rows = []
    for row in found.of_model("closed chain"):
        beside = _cells(opened[row.parameter.name]) if opened else []
        rows.append([row.parameter.name, row.parameter.part, *_cells(row), row.shape, *beside])
    head = ["error", "part", "largest mm", "class", "mrad", "main", "spread"]
    return Table(head + (["open mm", "class", "mrad", "main"] if opened else []), rows)


def dh_table(found: SensitivityFindings) -> Table:
    """Return the nominal DH table, a row a transform."""
    rows = found.dh_rows()
    cells = [[f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
    return Table([name.replace("_", " ") for name in rows[0]], cells)


def _cells(row: ErrorRow) -> list[str]:
    order = "none" if row.class_mm is None else f"1e{row.class_mm}"
    return [f"{row.distance_m / MM:.3f}", order, f"{row.angle_rad / MRAD:.2f}", row.main]
