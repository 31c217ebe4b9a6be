"""Temperatures and the resulting displacements as tables, lines and pictures, for the terminal and for a page.

The results that it shows, and their JSON, are in :mod:`pouring_robot.thermal.report`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from pouring_robot.io.units import MM, MRAD
from pouring_robot.report.page import Block, Paragraph, Plot, Table, html_page
from pouring_robot.report.plots import ASH, BRICK, MOSS, STEEL, new_figure, own_look, svg_of, tidy
from pouring_robot.robot.pouring.names import CHAINS, LEGS
from pouring_robot.thermal.network.temperature_field import TemperatureField
from pouring_robot.thermal.report import PoseHeat, ShiftHeat

_LEGS = (STEEL, "#81b1d5", BRICK, "#e8a598")
_AXES = (STEEL, MOSS, BRICK)


def html_report(found: PoseHeat | ShiftHeat, drawn: PoseHeat | ShiftHeat, title: str, blocks: Sequence[Block]) -> str:
    """Return the results and ``blocks`` as one page without external files; ``drawn``: the results to plot.

    ``title``: how they were computed.
    """
    plot = Plot("Temperatures, and what they move", svg_of(picture(drawn, "")))
    return html_page("Heat", [Paragraph(found.headline, "headline"), Paragraph(title), plot, *blocks])


def blocks(found: PoseHeat | ShiftHeat) -> list[Block]:
    """Return temperatures and growth of parts, displacements by heat, heat balance and bending; or a row per time."""
    return _pose(found) if isinstance(found, PoseHeat) else _shift(found)


def _pose(found: PoseHeat) -> list[Block]:
    rows = []
    for part, figures in found.parts.items():
        cells = (f"{v:z.{3 if name == 'growth_mm' else 1}f}" if v is not None else "" for name, v in figures.items())
        rows.append((part.replace("_", " "), *cells))
    moves = []
    for frame, difference in found.moved.items():
        shift, turn = ([f"{v:+z.3f}" for v in part] for part in difference.to_mm_mrad())
        moves.append((frame, *shift, f"{difference.distance_m / MM:.3f}", *turn))
    balance = found.field.balance
    gains = balance.melt_radiation_W + balance.melt_conduction_W
    losses = balance.ambient_film_W + balance.ambient_radiation_W
    matters = "MATTERS" if found.bending_matters else "does not matter"
    return [
        Paragraph(
            "temperatures: degC; across: K from side to side, steady; growth: mm, of a platform over half its width"
        ),
        Table(("part", "mean", "hottest", "across", "grows by"), rows),
        Paragraph("moved by heat alone: mm, mrad"),
        Table(("frame", "x", "y", "z", "|xyz|", "rx", "ry", "rz"), moves),
        Paragraph(
            f"heat: {gains / 1e3:.2f} kW from the melt ({balance.melt_radiation_W / 1e3:.2f} by radiation, "
            f"{balance.melt_conduction_W / 1e3:.2f} through the lining), {losses / 1e3:.2f} kW to the surroundings "
            f"({balance.ambient_film_W / 1e3:.2f} by air), {balance.stored_W / 1e3:z.2f} kW stored"
        ),
        Paragraph(
            f"bending (not in the figures above): legs bow up to {float(found.bending.bow_m.max()) / MM:.2f} mm; leg 4 "
            f"would tilt the ladle by {found.bending_tilt_rad / MRAD:+z.2f} mrad and move the lip by "
            f"{found.bending_lip_m / MM:.2f} mm: {matters} against a tenth of the required {found.accuracy_m / MM:g} mm"
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
        [f"{row[name]:z.{digits[name]}f}" for name in shown.values()] for row in found.to_frame().to_dict("records")
    ]
    title = "mean temperatures: degC; platform's origin o and lip, moved by heat alone: mm"
    return [Paragraph(title), Table(list(shown), rows)]


def draw_legs(panel: Axes, field: TemperatureField) -> None:
    """Draw the temperature along each leg, upper U joint on the left."""
    for k, i in enumerate(CHAINS):
        inside = field.between_joints[k] > 0.0
        positions_m = field.exposure.from_upper_joint_m
        order = np.argsort(positions_m[k][inside])
        place, value = (a[k][inside][order] for a in (positions_m / MM, field.leg_elements_degC))
        style = "--" if i % 2 == 0 else "-"
        panel.plot(place, value, style, color=_LEGS[k], linewidth=1.8, label=f"leg {i}")
    panel.set_xlabel("from the upper U joint down, mm")
    panel.set_ylabel("°C")
    panel.legend(fontsize=9, frameon=False)
    tidy(panel)


def draw_moves(panel: Axes, heat: PoseHeat) -> None:
    """Draw how far heat moves each frame, axis by axis."""
    for a, axis in enumerate("xyz"):
        values = [difference.translation_m[a] / MM for difference in heat.moved.values()]
        places = np.arange(len(values)) + 0.25 * (a - 1)
        bars = panel.bar(places, values, 0.22, color=_AXES[a], label=axis)
        panel.bar_label(bars, fmt="%+.2f", fontsize=8, padding=2)
    panel.axhline(0.0, color=ASH, linewidth=0.8)
    panel.set_xticks(range(len(heat.moved)), [name.replace("_", " ") for name in heat.moved])
    panel.set_ylabel("moved by heat alone, mm")
    panel.margins(y=0.12)
    panel.legend(fontsize=9, frameon=False, ncols=3)
    tidy(panel)


@own_look()
def picture(heat: PoseHeat | ShiftHeat, title: str) -> Any:
    """Draw a pose or a shift under heat, as a matplotlib figure."""
    return pose_picture(heat, title) if isinstance(heat, PoseHeat) else shift_picture(heat, title)


def pose_picture(heat: PoseHeat, title: str) -> Any:
    """Draw temperatures along the legs next to the deformation."""
    figure = new_figure(10.0, 4.2)
    left, right = figure.subplots(1, 2)
    draw_legs(left, heat.field)
    draw_moves(right, heat)
    figure.suptitle(title, fontsize=11)
    return figure


@own_look()
def shift_picture(shift: ShiftHeat, title: str) -> Any:
    """Draw melt, parts and deformation over time."""
    figure = new_figure(10.0, 7.0)
    melt, parts, moved = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 2.0, 2.0))
    table, (end, lip) = shift.to_frame(), shift.moved
    minutes = table["time_min"]
    melt.plot(minutes, table["melt_degC"], color="#8f2d16", linewidth=1.8)
    melt.set_ylabel("melt, °C")
    for k, i in enumerate(CHAINS):
        style = "--" if i % 2 == 0 else "-"
        parts.plot(minutes, table[f"leg{i}_degC"], style, color=_LEGS[k], linewidth=1.8, label=f"leg {i}")
    parts.plot(minutes, table["platform_degC"], color="#4a4a4a", linewidth=1.8, label="platform")
    parts.plot(minutes, table["fixed_platform_degC"], color=ASH, linewidth=1.2, label="fixed platform")
    parts.set_ylabel("mean, °C")
    parts.legend(fontsize=8, frameon=False, ncols=6)
    for axis, colour in zip("xyz", _AXES, strict=True):
        values, label = table[f"{end}_moved_{axis}_mm"], f"{axis} of {end.replace('_', ' ')}"
        moved.plot(minutes, values, color=colour, linewidth=1.6, label=label)
    sizes = table[f"{lip}_moved_mm"]
    moved.plot(minutes, sizes, color="#4a4a4a", linewidth=1.6, linestyle=":", label=f"distance of {lip}")
    moved.axhline(0.0, color=ASH, linewidth=0.8)
    moved.set_ylabel("moved by heat alone, mm")
    moved.set_xlabel("min")
    moved.legend(fontsize=8, frameon=False, ncols=4)
    changes = [minutes[k] for k in range(1, len(minutes)) if shift.poses[k] != shift.poses[k - 1]]
    for panel in (melt, parts, moved):
        for time in changes:
            panel.axvline(time, color=ASH, linewidth=0.8, linestyle="--")
        panel.margins(y=0.15)
        tidy(panel)
    figure.suptitle("; ".join(filter(None, (title, "dashed: the pose changes" if changes else ""))), fontsize=11)
    return figure
