"""A plan at the user's edge: the file that ``campaign simulate`` reads, figures for JSON, and the picture."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.design.columns import box
from pouring_robot.design.compare import Comparison
from pouring_robot.design.planning import MeasurementPlan, PlanQuality
from pouring_robot.io.files import write_whole
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.report.plots import COLOURS, draw_box, new_figure, png_of
from pouring_robot.robot.pouring.layout import Layout
from pouring_robot.robot.pouring.names import LEGS


def plan_table(plan: MeasurementPlan) -> tuple[list[str], list[list[str]]]:
    """Return headings and rows of the plan's file; conditions that are not planned have no column.

    A sample is named after its pose; the second visit of a pose, from the other side, has a ``b``.
    """
    request = plan.request
    headings = ["sample", "x_mm", "y_mm", "z_mm", "tilt_deg"]
    headings += list(columns.APPROACHES) if request.both_sides else []
    headings += ["payload_kg"] if request.loads_kg else []
    headings += [f"{leg}_degC" for leg in LEGS] if request.leg_degC else []
    rows = []
    for pose, visit, number in zip(plan.poses.tolist(), plan.conditions, plan.pose_numbers.tolist(), strict=True):
        x, y, z, tilt = pose
        row = [f"{number}{'b' if visit.side < 0 else ''}", *(f"{value / MM:.1f}" for value in (x, y, z))]
        row.append(f"{math.degrees(tilt):.2f}")
        row += [str(visit.side)] * len(columns.APPROACHES) if request.both_sides else []
        row += [f"{visit.payload_kg:g}"] if request.loads_kg else []
        row += [f"{visit.leg_degC:g}"] * len(LEGS) if request.leg_degC else []
        rows.append(row)
    return headings, rows


def plan_text(plan: MeasurementPlan) -> str:
    """Return the plan's file as CSV text, in the order to measure."""
    headings, rows = plan_table(plan)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows(rows)
    return stream.getvalue()


def plan_figures(plan: MeasurementPlan, comparison: Comparison | None = None) -> dict[str, Any]:
    """Return everything worth knowing about a plan, ready for JSON, in the units people use."""
    request, quality = plan.request, plan.quality
    headings, rows = plan_table(plan)
    noise = request.noise
    figures: dict[str, Any] = {
        "criterion": request.criterion,
        "value": plan.value,
        "poses": request.poses,
        "rows": len(rows),
        "seed": request.seed,
        "sigma_mm": noise.position_m / MM,
        "sigma_mrad": None if noise.rotation_rad is None else noise.rotation_rad / MRAD,
        "priors": request.priors is not None,
        "indices": quality.indices,
        "parameters": [
            {"name": p.name, "std": float(std * p.shown_factor), "unit": p.shown_unit}
            for p, std in zip(plan.parameters, quality.parameter_std, strict=True)
        ],
        "left_out": list(plan.left_out),
        "ladle": _ladle_figures(quality),
        "plan": [
            {name: cell if name == "sample" else float(cell) for name, cell in zip(headings, row, strict=True)}
            for row in rows
        ],
    }
    if comparison is not None:
        figures["random_plans"] = {
            "count": len(comparison.random_m),
            "median_rms_mm": float(np.median(comparison.random_m)) / MM,
            "median_rms_mrad": float(np.median(comparison.random_rad)) / MRAD,
            "ratio_mm": comparison.ratio,
            "ratio_mrad": comparison.ratio_rad,
        }
    return figures


def _ladle_figures(quality: PlanQuality) -> dict[str, Any]:
    by_axis = np.sqrt(np.mean(quality.ladle_std**2, axis=0))
    worst = int(np.argmax(quality.ladle_position_std_m))
    x, y, z, tilt = quality.ladle_poses[worst].tolist()
    return {
        "frame": "ladle_lip",
        "rms_mm": quality.ladle_rms_m / MM,
        "rms_mrad": quality.ladle_rms_rad / MRAD,
        "worst_mm": quality.ladle_worst_m / MM,
        "worst_at": {"x_mm": x / MM, "y_mm": y / MM, "z_mm": z / MM, "tilt_deg": math.degrees(tilt)},
        "rms_by_axis_mm": dict(zip("xyz", (by_axis[:3] / MM).tolist(), strict=True)),
        "rms_by_axis_mrad": dict(zip("xyz", (by_axis[3:] / MRAD).tolist(), strict=True)),
    }


def write_picture(plan: MeasurementPlan, layout: Layout, path: Path | str) -> Path:
    """Draw where the poses lie (x-z, y-z, tilt-z) and the ladle's expected standard deviation over the workspace.

    Args:
        plan: the plan.
        layout: gives the workspace box.
        path: the PNG file; written whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    figure = new_figure(11.0, 10.5, dpi=120)
    sights = figure.subplot_mosaic("XYTT;AABB", height_ratios=(1.4, 1.0), width_ratios=(1.0, 1.0, 1.2, 1.2))
    edge = np.array([1e3, 1e3, 1e3, math.degrees(1.0)])
    lower, upper = (corner * edge for corner in box(layout))
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
    quality = plan.quality
    sights["T"].set_title("poses of one place are drawn a little apart", fontsize="small")
    figure.suptitle(
        f"{plan.request.poses} poses, {len(plan.poses)} measurements, criterion {plan.request.criterion}: "
        f"the lip is then known to {quality.ladle_rms_m / MM:.3f} mm RMS, {quality.ladle_worst_m / MM:.3f} mm at worst"
    )
    return write_whole(path, png_of(figure))


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
