"""The plot of a plan: where its poses lie in the workspace, and how well the ladle will be known there."""

import math
from typing import Any

import numpy as np

from pouring_robot.design.result import MeasurementPlan
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.report.plots import COLOURS, draw_box, new_figure, png_of
from pouring_robot.robot.description.command import command_box
from pouring_robot.robot.pouring.definition import PouringDefinition


def plot(plan: MeasurementPlan) -> bytes:
    """Return a PNG of where the commands lie, two numbers at a time (of the pouring robot x-z, y-z and tilt-z).

    Beside it, the working frame's expected standard deviation there.
    """
    figure = new_figure(11.0, 10.5, dpi=120)
    edge = np.array([axis.shown(1.0) for axis in plan.axes])
    lower, upper = (corner * edge for corner in command_box(plan.axes))
    high = min(2, len(plan.axes) - 1)
    shown = [k for k in range(len(plan.axes)) if k != high][:3]
    names = [axis.heading.replace("_", " [") + "]" for axis in plan.axes]
    above, below = "XYT"[: len(shown)], "AB"[: len(shown)]
    mosaic = "XYTT;AABB" if len(shown) == 3 else f"{above};{below}"
    sights = figure.subplot_mosaic(mosaic, height_ratios=(1.4, 1.0))
    poses = plan.poses * edge
    for key, axis in zip(above, shown, strict=True):
        draw_box(sights[key], (lower[axis], upper[axis]), (lower[high], upper[high]))
        sights[key].margins(0.12)
        across, up = _spread(poses[:, axis], poses[:, high], upper[axis] - lower[axis], upper[high] - lower[high])
        _points(sights[key], plan, across, up)
        sights[key].set(xlabel=names[axis], ylabel=names[high])
        sights[key].grid(alpha=0.25)
    handles, labels = sights["X"].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    grid, std = plan.quality.ladle_poses * edge, plan.quality.ladle_position_std_m / MM
    for key, axis in zip(below, (shown[-1], shown[0]), strict=False):
        if isinstance(plan.robot, PouringDefinition):
            drawn = sights[key].contourf(*_mapped(grid[:, axis], grid[:, high], std), levels=12, cmap="viridis")
        else:  # its commands lie on no grid
            drawn = sights[key].scatter(grid[:, axis], grid[:, high], c=std, cmap="viridis")
        figure.colorbar(drawn, ax=sights[key], label="mm")
        tip = f"expected standard deviation of {plan.robot.tool_words[1]}"
        sights[key].set(xlabel=names[axis], ylabel=names[high], title=tip)
    sights[above[-1]].set_title("poses of one place are drawn a little apart", fontsize="small")
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
        ring = {"s": 90, "facecolors": "none", "edgecolors": "black", "label": "visited from both sides"}
        place.scatter(across[both], up[both], **ring)


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
