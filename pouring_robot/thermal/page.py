"""Temperatures and what they move in tables and lines, for the terminal and for a page."""

from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.report.page import Block, Paragraph, Plot, Table, html_page
from pouring_robot.report.plots import svg_of
from pouring_robot.robot.location_figures import decimals
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.thermal.plots import pose_picture, shift_picture
from pouring_robot.thermal.report import PoseHeat, ShiftHeat


def html_report(found: PoseHeat | ShiftHeat, drawn: PoseHeat | ShiftHeat, title: str) -> str:
    """Return what is found, drawn at more times, as one page without outside files; ``title``: how it was computed."""
    figure = pose_picture(drawn, "") if isinstance(drawn, PoseHeat) else shift_picture(drawn, "")
    plot = Plot("Temperatures, and what they move", svg_of(figure))
    told = [Paragraph(found.headline, "headline"), Paragraph(title), plot, *blocks(found)]
    return html_page("Heat", "Heat", told)


def blocks(found: PoseHeat | ShiftHeat) -> list[Block]:
    """Return temperatures and growth of the parts, what heat moves, the balance and bending; or a row a time."""
    return _pose(found) if isinstance(found, PoseHeat) else _shift(found)


def _pose(found: PoseHeat) -> list[Block]:
    rows = []
    for one in found.parts:
        cells = (
            decimals(v, 3 if name == "growth_mm" else 1) if v is not None else "" for name, v in one.figures().items()
        )
        rows.append((one.part.replace("_", " "), *cells))
    moves = []
    for frame, difference in found.moved.items():
        shift, turn = ([decimals(v, 3, sign=True) for v in part] for part in difference.to_mm_mrad())
        moves.append((frame, *shift, f"{difference.distance_m / MM:.3f}", *turn))
    balance, bending = found.field.balance, found.bending
    gains = balance.melt_radiation_W + balance.melt_conduction_W
    losses = balance.ambient_film_W + balance.ambient_radiation_W
    matters = "MATTERS" if found.bending_matters else "does not matter"
    at_lip = abs(bending.tilt_error_rad) * found.lever_m / MM
    return [
        Paragraph("temperatures: degC; across: K from side to side, settled; growth: mm"),
        Table(("part", "mean", "hottest", "across", "grows by"), rows),
        Paragraph("moved by heat alone: mm, mrad"),
        Table(("frame", "x", "y", "z", "|xyz|", "rx", "ry", "rz"), moves),
        Paragraph(
            f"heat: {gains / 1e3:.2f} kW from the melt ({balance.melt_radiation_W / 1e3:.2f} by radiation, "
            f"{balance.melt_conduction_W / 1e3:.2f} through the lining), {losses / 1e3:.2f} kW to the surroundings "
            f"({balance.ambient_film_W / 1e3:.2f} by air), {abs(balance.stored_W) / 1e3:.2f} kW stored"
        ),
        Paragraph(
            f"bending: legs bow up to {float(bending.bow_m.max()) / MM:.2f} mm; not in the figures above: leg 4 would "
            f"tilt the ladle by {bending.tilt_error_rad / MRAD:+.2f} mrad, {at_lip:.2f} mm at the lip: {matters} "
            f"against a tenth of the required {found.accuracy_m / MM:g} mm"
        ),
    ]


def _shift(found: ShiftHeat) -> list[Block]:
    end, lip = found.moved
    shown = {
        "min": "time_min",
        "melt": "melt_degC",
        **{f"leg {i}": f"{leg}_degC" for i, leg in enumerate(LEGS, start=1)},
        "platform": "platform_degC",
        "fixed pl.": "fixed_platform_degC",
        "shell": "ladle_shell_degC",
        **{axis: f"{end}_moved_{axis}_mm" for axis in "xyz"},
        "|o|": f"{end}_moved_mm",
        "|lip|": f"{lip}_moved_mm",
    }
    digits = {column: 3 if column.endswith("_mm") else 1 for column in shown.values()} | {"melt_degC": 0}
    rows = [
        [decimals(row[name], digits[name]) for name in shown.values()] for row in found.to_frame().to_dict("records")
    ]
    title = "means: degC; the platform's origin o and the lip, moved by heat alone: mm"
    return [Paragraph(title), Table(list(shown), rows)]
