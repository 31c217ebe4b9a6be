"""The plot of a plan: where its poses lie in the workspace, and how well the ladle will be known there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pouring_robot.design.result import MeasurementPlan
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.report.plots import COLOURS, draw_box, new_figure, png_of
from pouring_robot.robot.pouring.layout import Layout


def plot(plan: MeasurementPlan, layout: Layout) -> bytes:
    """Draw where the poses lie (x-z, y-z, tilt-z) and the ladle's expected standard deviation over the workspace.

    Args:
        plan: the plan.
        layout: gives the workspace box.

    Returns:
        A PNG file.
    """
    figure = new_figure(11.0, 10.5, dpi=120)
    sights = figure.subplot_mosaic("XYTT;AABB", height_ratios=(1.4, 1.0), width_ratios=(1.0, 1.0, 1.2, 1.2))
    edge = np.array([1e3, 1e3, 1e3, math.degrees(1.0)])
    lower, upper = (corner * edge for corner in layout.box)
    poses = plan.poses * edge
    for key, axis, name in (("X", 0, "x [mm]"), ("Y", 1, "y [mm]"), ("T", 3, "tilt [°]")):
        draw_box(sights[key], (lower[axis], upper[axis]), (lower[2], upper[2]))
        sights[key].margins(0.12)
        across, up = _spread(poses[:, axis], poses[:, 2], upper[axis] - lower[axis], upper[2] - lower[2])
        _points(sights[key], plan, across, up)
        sights[key].set(xlabel=name, ylabel="z [mm]")
        sights[key].grid(alpha=0.25)
    handles, labels = sights["X"].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    grid, std = plan.quality.ladle_poses * edge, plan.quality.ladle_position_std_m / MM
    for key, axis, name in (("A", 3, "tilt [°]"), ("B", 0, "x [mm]")):
        across, up, mean = _mapped(grid[:, axis], grid[:, 2], std)
        drawn = sights[key].contourf(across, up, mean, levels=12, cmap="viridis")
        figure.colorbar(drawn, ax=sights[key], label="mm")
        sights[key].set(xlabel=name, ylabel="z [mm]", title="expected standard deviation of the pouring lip")
    sights["T"].set_title("poses of one place are drawn a little apart", fontsize="small")
    figure.suptitle(plan.headline)
    return png_of(figure)


def _points(place: Any, plan: MeasurementPlan, across: FloatArray, up: FloatArray) -> None:
    """Draw poses, one colour for each load and temperature; those visited from both sides have a ring."""
    states = list(dict.fromkeys((c.payload_kg, c.leg_degC) for c in plan.conditions))
    for k, state in enumerate(states):
        rows = [(c.payload_kg, c.leg_degC) == state for c in plan.conditions]
        told = [f"{state[0]:g} kg"] if plan.request.loads_kg else []
        told += [f"{state[1]:g} °C"] if plan.request.leg_degC else []
        label = ", ".join(told) or "pose"
        place.scatter(across[rows], up[rows], s=26, alpha=0.8, color=COLOURS[k % len(COLOURS)], label=label)
    both = [c.side < 0 for c in plan.conditions]
    if any(both):
        place.scatter(
            across[both], up[both], s=90, facecolors="none", edgecolors="black", label="visited from both sides"
        )


def _spread(across: FloatArray, up: FloatArray, width: float, height: float) -> tuple[FloatArray, FloatArray]:
    """Return points of one place moved a little apart, on a spiral, so that each can be seen."""
    seen: dict[tuple[float, float], int] = {}
    moved = []
    for place in zip(np.round(across, 3).tolist(), np.round(up, 3).tolist(), strict=True):
        k = seen[place] = seen.get(place, -1) + 1
        radius, angle = 0.014 * math.sqrt(k), 2.399963 * k  # the golden angle
        moved.append((radius * math.cos(angle) * width, radius * math.sin(angle) * height))
    apart = np.array(moved)
    return across + apart[:, 0], up + apart[:, 1]


def _mapped(across: FloatArray, up: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return root mean squares over a grid of two coordinates, the others averaged; NaN where no pose is in reach."""
    columns_at, rows_at = np.unique(np.round(across, 6)), np.unique(np.round(up, 6))
    i, j = np.searchsorted(rows_at, np.round(up, 6)), np.searchsorted(columns_at, np.round(across, 6))
    total, count = np.zeros((2, len(rows_at), len(columns_at)))
    np.add.at(total, (i, j), values**2)
    np.add.at(count, (i, j), 1.0)
    with np.errstate(invalid="ignore"):
        return columns_at, rows_at, np.sqrt(total / count)
