"""A plan, the expected results of a fit to it, and a picture of both."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.campaign.columns import approach_names
from pouring_robot.campaign.plan import PosePlan
from pouring_robot.design.plan_rows import PlannedConditions
from pouring_robot.design.request import PlannedParameter, PlanRequest
from pouring_robot.estimation.identifiability import BaseParameters, observability
from pouring_robot.exceptions import BadInputError, counted, some
from pouring_robot.io.files import CSV_SUFFIXES, check_ending, write_whole
from pouring_robot.io.tables import csv_text
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.report.plots import COLOURS, draw_box, new_figure, own_look, png_of
from pouring_robot.report.result import Result
from pouring_robot.robot.description.command import CommandAxis, command_box
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.pouring.definition import PouringDefinition


class UndeterminedError(BadInputError):
    """The measurements cannot determine the wanted parameters."""

    def __init__(
        self,
        what: str,
        found: BaseParameters,
        frames: Collection[str],
        *,
        reducible: bool = True,
        everywhere: bool = False,
        priors: bool = False,
    ) -> None:
        self.groups, self.unseen = found.groups, found.unseen  # which cannot be distinguished; which have no effect
        # those to leave out, so that the others are determined
        self.too_many = tuple(name for name in found.names if name not in found.base and name not in frames)
        parts = []
        for group in self.groups:
            own = [name for name in group.members if name not in frames]
            own += ["the frames of tracker and target"] if len(own) < len(group.members) else []
            parts.append(f"{group.hidden} of {some(own, 6, ' + ')}")
        parts += [f"{some(self.unseen, 4)} (without effect)"] if self.unseen else []
        hidden = counted(len(found.names) - found.rank, "combination")
        leave = [f"leave out {some(self.too_many, 6)}{' (--reduce does so)' if reducible else ''}"]
        # What remains after a reduction needs more poses; where all poses together do not suffice, more do not help.
        mend = leave if self.too_many and (reducible or everywhere) else []
        mend += [] if everywhere else ["plan more poses"]
        mend += ["let tolerances count as priors (--priors)"] if not priors and (reducible or not everywhere) else []
        super().__init__(
            f"{what} cannot determine {hidden} of the parameters: "
            f"{some(parts, 3, '; ')}; {', or '.join(mend)}{'; more poses do not help' if everywhere else ''}"
        )


@dataclass(frozen=True, eq=False)
class PlanQuality:
    """Expected results of a fit to a plan; standard deviations in inner units."""

    covariance: FloatArray  # of the f frame numbers that can be distinguished and the parameters, shape (f + P, f + P)
    parameter_std: FloatArray  # shape (P,)
    ladle_poses: FloatArray  # commands of the workspace, in m and rad, shape (g, k)
    ladle_std: FloatArray  # of the working frame there, x y z in m and rotation vector in rad, shape (g, 6)
    singular_values: FloatArray  # of the plan with the frames projected out, per shown unit (mm, mrad ...), shape (P,)
    poses: int  # number of poses

    @property
    def ladle_position_std_m(self) -> FloatArray:
        """Root of the summed variances of x, y, z at each workspace pose, shape (g,), in m."""
        return np.asarray(np.linalg.norm(self.ladle_std[:, :3], axis=1))

    @property
    def ladle_rms_m(self) -> float:
        """Standard deviation of the ladle's position: root mean square over the workspace, in m."""
        return float(np.sqrt(np.mean(self.ladle_position_std_m**2)))

    @property
    def ladle_rms_rad(self) -> float:
        """The same for its orientation, in rad."""
        return float(np.sqrt(np.mean(np.sum(self.ladle_std[:, 3:] ** 2, axis=1))))

    @property
    def ladle_worst_m(self) -> float:
        """Largest standard deviation of the ladle's position in the workspace, in m."""
        return float(self.ladle_position_std_m.max())

    @property
    def indices(self) -> dict[str, float]:
        """O1 to O5, by name."""
        return observability(self.singular_values, self.poses)


@dataclass(frozen=True, eq=False, repr=False)
class MeasurementPlan(Result):
    """A plan."""

    request: PlanRequest
    axes: tuple[CommandAxis, ...]  # of a command
    robot: RobotDefinition
    parameters: tuple[PlannedParameter, ...]
    left_out: tuple[str, ...]  # names of parameters that were requested but left out: those kept have the same effect
    poses: FloatArray  # rows in the order to measure them, commands in m and rad, shape (rows, k)
    conditions: tuple[PlannedConditions, ...]  # of each row
    pose_plan: PosePlan  # the same, in the form that ``simulate_campaign`` takes
    quality: PlanQuality
    value: float  # the criterion's index, per shown unit

    @property
    def headline(self) -> str:
        """How many poses and measurements, and how well the pouring lip will then be known."""
        return (
            f"{self.request.poses} poses, {len(self.poses)} measurements, criterion {self.request.criterion}: "
            f"standard deviation of {self.robot.tool_words[1]} {self.quality.ladle_rms_m / MM:.3f} mm RMS, "
            f"{self.quality.ladle_worst_m / MM:.3f} mm at worst"
        )

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Return headings and rows of the plan's file; conditions that are not planned have no column.

        A sample has the number of its pose; the second visit of a pose, from the other side, also has a ``b``.
        """
        columns = {"sample": list(self.pose_plan.samples)}
        for axis, values in zip(self.axes, self.poses.T.tolist(), strict=True):
            columns[axis.heading] = [axis.text(value) for value in values]
        by_order = () if self.request.both_sides else approach_names(self.robot)
        given = self.pose_plan.given(self.robot).items()
        columns |= {name: [f"{value:g}" for value in values] for name, values in given if name not in by_order}
        return list(columns), [list(row) for row in zip(*columns.values(), strict=True)]

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows by heading, in the order to measure."""
        headings, rows = self.table()
        return [
            {name: cell if name == "sample" else float(cell) for name, cell in zip(headings, row, strict=True)}
            for row in rows
        ]

    _table = rows

    def csv(self) -> str:
        """Return the plan's file as text, in the order to measure."""
        return csv_text(*self.table())

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write the plan's file, which ``campaign simulate`` reads, whole or not at all.

        Raises OutputError where that is impossible, or where the file exists and ``overwrite`` is not set.
        """
        check_ending(Path(path), CSV_SUFFIXES)
        return write_whole(path, self.csv(), overwrite=overwrite)

    def figures(self) -> dict[str, Any]:
        """Return everything worth knowing about the plan, ready for JSON, in the units people use."""
        request, noise, quality = self.request, self.request.noise, self.quality
        by_axis = np.sqrt(np.mean(quality.ladle_std**2, axis=0))
        worst = quality.ladle_poses[int(np.argmax(quality.ladle_position_std_m))].tolist()
        return {
            "criterion": request.criterion,
            "value": self.value,
            "poses": request.poses,
            "rows": len(self.poses),
            "seed": request.seed,
            "sigma_mm": noise.position_m / MM,
            "sigma_mrad": noise.rotation_rad / MRAD if noise.turned else None,
            "priors": request.priors is not None,
            "indices": quality.indices,
            "parameters": [
                {"name": p.name, "std": float(std / si), "unit": unit}
                for p, std in zip(self.parameters, quality.parameter_std, strict=True)
                for unit, si in (p.shown_in,)
            ],
            "left_out": list(self.left_out),
            "ladle": {
                "frame": self.robot.loops.working_frame,
                "rms_mm": quality.ladle_rms_m / MM,
                "rms_mrad": quality.ladle_rms_rad / MRAD,
                "worst_mm": quality.ladle_worst_m / MM,
                "worst_at": {axis.heading: axis.shown(value) for axis, value in zip(self.axes, worst, strict=True)},
                "rms_by_axis_mm": dict(zip("xyz", (by_axis[:3] / MM).tolist(), strict=True)),
                "rms_by_axis_mrad": dict(zip("xyz", (by_axis[3:] / MRAD).tolist(), strict=True)),
            },
            "plan": self.rows(),
        }


@own_look()
def plot(plan: MeasurementPlan) -> bytes:
    """Return a PNG of the commands, two coordinates at a time (for the pouring robot x-z, y-z and tilt-z).

    Below them is the working frame's expected standard deviation.
    """
    figure = new_figure(11.0, 10.5, dpi=120)
    lower, upper = np.sort(_shown(plan.axes, np.array(command_box(plan.axes))), axis=0)
    high = min(2, len(plan.axes) - 1)
    shown = [k for k in range(len(plan.axes)) if k != high][:3] or [high]  # one drive alone: against itself
    names = [axis.heading.replace("_", " [") + "]" for axis in plan.axes]
    above, below = "XYT"[: len(shown)], "AB"[: len(shown)]
    mosaic = "XYTT;AABB" if len(shown) == 3 else f"{above};{below}"
    sights = figure.subplot_mosaic(mosaic, height_ratios=(1.4, 1.0))
    poses = _shown(plan.axes, plan.poses)
    for key, axis in zip(above, shown, strict=True):
        draw_box(sights[key], (lower[axis], upper[axis]), (lower[high], upper[high]))
        sights[key].margins(0.12)
        across, up = _spread(poses[:, axis], poses[:, high], upper[axis] - lower[axis], upper[high] - lower[high])
        _points(sights[key], plan, across, up)
        sights[key].set(xlabel=names[axis], ylabel=names[high])
        sights[key].grid(alpha=0.25)
    figure.legend(*sights["X"].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    grid, std = _shown(plan.axes, plan.quality.ladle_poses), plan.quality.ladle_position_std_m / MM
    for key, axis in zip(below, (shown[-1], shown[0]), strict=False):
        if isinstance(plan.robot, PouringDefinition):
            drawn = sights[key].contourf(*_mapped(grid[:, axis], grid[:, high], std), levels=12, cmap="viridis")
        else:  # its commands form no grid
            drawn = sights[key].scatter(grid[:, axis], grid[:, high], c=std, cmap="viridis")
        figure.colorbar(drawn, ax=sights[key], label="mm")
        tip = f"expected standard deviation of {plan.robot.tool_words[1]}"
        sights[key].set(xlabel=names[axis], ylabel=names[high], title=tip)
    sights[above[-1]].set_title("poses of one place are drawn a little apart", fontsize="small")
    figure.suptitle(plan.headline)
    return png_of(figure)


def _shown(axes: Sequence[CommandAxis], commands: FloatArray) -> FloatArray:
    """Return commands (n, k), in m and rad, as in their table, in mm and degrees."""
    return np.array([[axis.shown(value) for axis, value in zip(axes, one, strict=True)] for one in commands.tolist()])


def _points(place: Any, plan: MeasurementPlan, across: FloatArray, up: FloatArray) -> None:
    """Draw poses, one colour for each load and temperature; those visited from both sides have a ring."""
    states = list(dict.fromkeys((c.payload_kg, c.drive_degC) for c in plan.conditions))
    for k, state in enumerate(states):
        rows = [(c.payload_kg, c.drive_degC) == state for c in plan.conditions]
        words = [f"{state[0]:g} kg"] if plan.request.loads_kg else []
        words += [f"{state[1]:g} °C"] if plan.request.drive_degC else []
        label = ", ".join(words) or "pose"
        place.scatter(across[rows], up[rows], s=26, alpha=0.8, color=COLOURS[k % len(COLOURS)], label=label)
    both = [c.side < 0 for c in plan.conditions]
    if any(both):
        ring = {"s": 90, "facecolors": "none", "edgecolors": "black", "label": "visited from both sides"}
        place.scatter(across[both], up[both], **ring)


def _spread(across: FloatArray, up: FloatArray, width: float, height: float) -> tuple[FloatArray, FloatArray]:
    """Return coincident points moved a little apart, on a spiral, so that each can be seen."""
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
    import pandas as pd

    table = pd.DataFrame({"across": np.round(across, 6), "up": np.round(up, 6), "square": values**2})
    mean = table.pivot_table("square", "up", "across")
    return mean.columns.to_numpy(), mean.index.to_numpy(), np.sqrt(mean.to_numpy())
