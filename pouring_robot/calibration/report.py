"""The output of a calibration: lines and tables, one self-contained HTML page, model file, URDF and figures."""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from pouring_robot.calibration.findings import (
    CalibrationFindings,
    Movement,
    ParameterLine,
    combination_lines,
    group_effects,
    parameter_lines,
)
from pouring_robot.calibration.plots import plots
from pouring_robot.calibration.summary import (
    MODEL,
    calibration_metrics,
    next_measurements,
    notes_of,
    warnings_of,
    warnings_of_the_model,
)
from pouring_robot.checks.flags import where
from pouring_robot.exceptions import DescriptionError, OutputError, counted
from pouring_robot.io.figures import json_text
from pouring_robot.io.files import check_folder, refuse_present, write_together
from pouring_robot.io.units import MM
from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Row, Table, html_page
from pouring_robot.robot.description.urdf import urdf_files
from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot
from pouring_robot.robot.model import RobotModel

FIGURES, REPORT = "calibration.json", "report.html"
SHOWN, WIDTH = 6, 60  # combinations, and letters of each, shown on a terminal; the page shows all


def gap_table(calibration: CalibrationFindings) -> Table:
    """Return the table of errors: rows, what, RMS, P95 and largest in mm and mrad."""
    parts = (("held out", calibration.split.test), ("fitted", calibration.split.train))
    rows: list[Row] = []
    for name, part in parts:
        for label, after in (("before", False), ("after", True)):
            misfit = calibration.misfit(part, after=after)
            rows.append((name, label, *_cells(dataclasses.asdict(misfit)), str(misfit.rows)))
    floors = {_cells(calibration.floor(part)): name for name, part in parts}
    # Held-out rows may have other kinds of measurement than fitted ones, such as lines alone: each then has its own.
    rows += [("noise", "floor" if len(floors) == 1 else name, *cells, "–") for cells, name in floors.items()]
    return Table(("rows", "", "RMS mm", "P95 mm", "max mm", "RMS mrad", "P95 mrad", "max mrad", "count"), rows)


def _cells(figures: Mapping[str, float]) -> tuple[str, ...]:
    names = ("rms_mm", "p95_mm", "max_mm", "rms_mrad", "p95_mrad", "max_mrad")
    return tuple(_number(figures.get(name, math.nan)) for name in names)


def _number(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else "–"


def effect_table(calibration: CalibrationFindings) -> Table:
    """Return the table of groups: what was found to be off, and what that does at the target."""
    rows = [
        (line.meaning, _number(line.moved_mm), _number(line.moved_mrad), str(line.count), line.name)
        for line in group_effects(calibration)
    ]
    return Table(("on the machine", "moves the target by mm", "mrad", "parameters", "group"), rows)


def _movement(line: Movement) -> Row:
    return f"{line.value:+z.4f}", f"{line.half_width:.4f}", line.unit, f"{line.prior_std:.3g}"


_MOVEMENT = ("off by", "± 95 %", "unit", "tolerance (1σ)")


def parameter_table(lines: Iterable[ParameterLine]) -> Table:
    """Return the table of parameters, the most significant movement first."""
    order = sorted(lines, key=lambda line: (line.verdict != "moved", -line.surprise))
    rows = [(line.name, *_movement(line), f"{max(line.learnt, 0.0):.0%}", line.verdict) for line in order]
    return Table(("parameter", *_MOVEMENT, "learnt", ""), rows)


def combination_table(calibration: CalibrationFindings, width: int = 10_000) -> Table:
    """Return the table of identifiable combinations, their texts cut to a width."""
    rows = []
    for line in combination_lines(calibration):
        name = line.name if len(line.name) <= width else line.name[: width - 2] + " …"
        rows.append((name, *_movement(line), "moved" if line.moved else ""))
    return Table(("what the data determine", *_MOVEMENT, ""), rows)


def selection_table(calibration: CalibrationFindings) -> Table:
    """Return the table of the groups that were tried."""
    rows = [
        (
            " + ".join(step.kept) or "frames only",
            step.tried or "–",
            f"{step.rms:.3f}",
            f"{step.gain:+z.4f}",
            f"{step.gain_error:.4f}",
            "kept" if step.accepted and step.tried else "",
        )
        for step in calibration.selection.steps
    ]
    return Table(("kept so far", "tried", "validation RMS / noise", "gain", "± 1σ", ""), rows)


def performance_line(calibration: CalibrationFindings) -> str:
    """Return accuracy and repeatability in words."""
    found = calibration.performance
    if found is None:
        return "ISO 9283 accuracy and repeatability: unknown, as no pose was measured three times or more"
    line = (
        f"ISO 9283 ({found.poses} poses, {found.cycles} or more repeats; the standard asks for 30): accuracy "
        f"{found.ap_before_mm:.3f} mm before, {found.ap_after_mm:.3f} mm after; repeatability {found.rp_mm:.3f} mm"
    )
    if math.isfinite(found.rp_mrad):
        line += f"; attitude {found.ap_before_mrad:.3f} mrad before, {found.ap_after_mrad:.3f} mrad after"
        line += f", repeatability {found.rp_mrad:.3f} mrad"
    return line


def ladle_line(calibration: CalibrationFindings) -> str:
    """Return how well the ladle is known."""
    half, measured = (ladle.half_width_m / MM for ladle in (calibration.ladle, calibration.ladle_measured))
    if not half.size:
        return "the workspace box holds no pose the robot can take"
    _, point = calibration.present.definition.tool_words
    # Closures need no device, and have no frames.
    device = any(kind != "closure" for kind in calibration.noise.measured)
    # Errors that frames and robot share are known by their sum only: the point goes with the target, as nobody saw it.
    axes = " in the device's axes, fixed to the target," if device else ""
    if device and not calibration.ladle.located:
        axes = " in the robot's base, as the data hardly determine where device and target are,"
    return (
        f"uncertainty of each coordinate of {point}{axes} if the model holds: ±{np.median(half):.3f} mm "
        f"(95 %, median of {half.size} poses), at worst ±{half.max():.3f} mm, in the measured poses "
        f"±{np.median(measured):.3f} mm; the noise of a measurement comes on top"
    )


def group_lines(calibration: CalibrationFindings) -> list[str]:
    """Return the dependent groups by name: what of them can be identified, and how much cannot."""
    lines = []
    for group in calibration.base.groups:
        members = ", ".join(group.members)
        lines.append(f"{len(group.members)} dependent, {group.hidden} direction(s) not observable: {members}")
        lines += [f"    identifiable: {text}" for text in group.texts()]
    if calibration.base.unseen:
        lines.append(f"without any effect here: {', '.join(calibration.base.unseen)}")
    return lines


def split_line(calibration: CalibrationFindings) -> str:
    """Return which rows were used for what."""
    split, left_out = calibration.split, calibration.left_out
    lines = f" ({where(calibration.campaign, left_out)})" if left_out.size else ""
    return (
        f"held out for the test: {split.test_name} ({split.test.size} rows) from {split.train.size} rows in "
        f"{len(split.folds)} blocks; then fitted: all {split.rows.size}; left out: "
        f"{counted(left_out.size, 'row')}{lines}"
    )


def html_report(calibration: CalibrationFindings) -> str:
    """Return the report as one self-contained page."""
    lines = parameter_lines(calibration)
    unseen = [line.name for line in lines if not line.seen]
    left = f"{len(unseen)} more have no effect here and are unchanged: {', '.join(unseen)}" if unseen else ""
    notes = [Paragraph(f"Note: {line}.") for line in notes_of(calibration)]
    moved: list[Block] = [*notes, Paragraph("nothing")]
    if lines:
        moved = [
            effect_table(calibration),
            *notes,
            Paragraph("Combinations that move the target alike count as one:"),
            combination_table(calibration),
            Paragraph("Each parameter by itself; where several act alike, tolerances distribute the error among them:"),
            parameter_table(line for line in lines if line.seen),
            Paragraph(left),
        ]
    blocks: list[Block] = [
        Paragraph(calibration.headline, "lead"),
        *(Paragraph(line, "warn") for line in warnings_of(calibration)),
        Paragraph(f"{calibration.campaign.path}: {split_line(calibration)}"),
        Heading("Error before and after"),
        gap_table(calibration),
        Paragraph(performance_line(calibration)),
        Paragraph(ladle_line(calibration)),
        Heading("What moved"),
        *moved,
        Heading("What to measure next"),
        Lines(next_measurements(calibration)),
        Heading("Pictures"),
        *(Plot(title, svg) for title, svg in plots(calibration)),
        Heading("Which combinations this campaign can distinguish"),
        Lines(group_lines(calibration), mono=True),
        Heading("How groups were chosen"),
        selection_table(calibration) if calibration.selection.steps else Paragraph("all were kept, as asked for"),
        Heading("Findings of the data checks"),
        Lines([str(flag) for flag in calibration.flags] or ["nothing"]),
    ]
    title = f"Calibration with {calibration.campaign.path.name}"
    links = {"the calibrated model": MODEL, "all figures": FIGURES}
    return html_page(title, blocks, links=links, data=[calibration.campaign.path])


def write_calibration(calibration: CalibrationFindings, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
    """Write model file, URDF with meshes and loops, ``calibration.json`` and ``report.html``; see the calibration."""
    folder, model = check_folder(folder), described(calibration)
    refuse_present([folder / name for name in (FIGURES, REPORT)], overwrite=overwrite)  # before the work
    try:
        tree = urdf_files(ClosedRobot.of(model).urdf, folder, model.definition.files_beside())
    except DescriptionError as error:
        raise OutputError(folder, error.problem) from error
    files: dict[Path, bytes | str] = dict(tree)
    files[folder / FIGURES] = json_text(calibration_metrics(calibration))
    files[folder / REPORT] = html_report(calibration)
    files[folder / MODEL] = model.file_text(folder)  # others may wait for it
    return [path for path in write_together(files, overwrite=overwrite) if path.parent == folder]


def described(calibration: CalibrationFindings) -> RobotModel:
    """Return the calibrated model with a description that says how good it is, warnings first."""
    said = [f"{line[0].upper()}{line[1:]}." for line in warnings_of_the_model(calibration)]
    said += [calibration.headline, f"Calibrated with {calibration.campaign.path.name}."]
    if calibration.present.description:
        said.append(f"Before: {calibration.present.description}")
    return calibration.calibrated.model_copy(update={"description": " ".join(said)})
