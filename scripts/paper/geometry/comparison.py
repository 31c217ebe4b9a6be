"""How far the paper's open branches underestimate the effect of the same errors on the closed robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.sensitivity.samples import AXES
from scripts.paper.geometry.study import LENGTH_ERROR_M, POSITION_BOUNDARY_M, ErrorSamples, GeometryStudy, error_size

_ALL_COLUMNS = ("ΔX mm", "ΔY mm", "ΔZ mm", "rotation X mrad", "rotation Y mrad", "rotation Z mrad")


@dataclass(frozen=True)
class AxisRow:
    """One coordinate of o, root mean square over poses; position in mm, rotation in mrad.

    Attributes:
        coordinate: which, with its unit.
        open_single, closed_single: of one error: root mean square over all errors as well.
        open_all, closed_all: of all errors together, independent of each other: one branch with its own, and the robot.
    """

    coordinate: str
    open_single: float
    closed_single: float
    open_all: float
    closed_all: float

    @property
    def ratio(self) -> float:
        """How many times an error does in the closed chain what it does in its branch."""
        return self.closed_single / self.open_single


def axis_rows(study: GeometryStudy) -> list[AxisRow]:
    """Compare both models coordinate by coordinate, over the errors of all chains."""
    opened, closed = _squares(study.open_branch), _squares(study.closed_chain)
    chains = len(study.table.chains)
    return [
        AxisRow(
            name,
            float(np.sqrt(opened[:, k].mean())),
            float(np.sqrt(closed[:, k].mean())),
            float(np.sqrt(opened[:, k].sum() / chains)),
            float(np.sqrt(closed[:, k].sum())),
        )
        for k, name in enumerate(_ALL_COLUMNS)
    ]


def _squares(errors: ErrorSamples) -> FloatArray:
    """Return the mean square of the six coordinates of each error, shape (P, 6), in mm² and mrad²."""
    turns = np.square(errors.rotation_rad).mean(axis=1) / MRAD**2
    return np.concatenate([np.square(errors.rms_m / MM), turns], axis=1)


def parameter_rows(study: GeometryStudy) -> list[dict[str, Any]]:
    """Return one row an error: mean and largest absolute coordinates in both models, in mm and mrad."""
    rows = []
    for k, parameter in enumerate(study.open_branch.parameters):
        length = parameter.unit == "m"
        row: dict[str, Any] = {
            "parameter": parameter.name,
            "error": error_size(parameter) / (MM if length else MRAD),
            "unit": "mm" if length else "mrad",
            "displaces": parameter.joint,
        }
        for name, errors in (("open", study.open_branch), ("closed", study.closed_chain)):
            for a, axis in enumerate(AXES):
                row[f"{name}_mean_{axis.lower()}_mm"] = errors.mean_m[k, a] / MM
            for a, axis in enumerate(AXES):
                row[f"{name}_max_{axis.lower()}_mm"] = errors.peak_m[k, a] / MM
            row[f"{name}_max_distance_mm"] = float(errors.distance_m[k].max()) / MM
            row[f"{name}_max_turn_mrad"] = float(errors.angle_rad[k].max()) / MRAD
        rows.append(row)
    return rows


@dataclass(frozen=True)
class Lesson:
    """Figures of the comparison.

    Attributes:
        ratios: closed over open for an error, by X, Y, Z.
        over_1mm, over_10mm: errors that pass the limit in a coordinate: open, closed.
        without_effect: errors of chain 1 that move o by less than 1e-3 mm in the closed chain.
        weaker: share of errors that move o less (by root mean square distance) in the closed chain.
        first_order: largest distance between first order and exact closure, and the distance that o moves there, in mm.
        first_order_tenth: the largest distance between them for errors of a tenth of the size, in mm.
        lean_m: how far leg 1 leans sideways over its length at y = 0, in m.
        leg_y_m: mean absolute ΔY from an error of leg 1's length (d4), in m.
        left_open: largest gap and angle that the loops are left with, in µm and mrad.
    """

    ratios: tuple[float, float, float]
    over_1mm: tuple[int, int]
    over_10mm: tuple[int, int]
    without_effect: tuple[str, ...]
    weaker: float
    first_order: tuple[float, float]
    first_order_tenth: float
    lean_m: float
    leg_y_m: float
    left_open: tuple[float, float]

    def sentences(self, errors: int) -> list[str]:
        """Return what to learn from it, for a study of this many errors."""
        x, y, z = self.ratios
        return [
            f"Of {errors} errors, {self.over_1mm[0]} exceed 1 mm in their open branch and {self.over_1mm[1]} in the "
            f"closed chain; {self.over_10mm[0]} and {self.over_10mm[1]} exceed the required 10 mm, each alone.",
            f"Closing the loops multiplies the effect of an error by {x:.2f} in X, {y:.2f} in Y and {z:.2f} in Z "
            "(root mean square over errors and poses).",
            f"Only the inclination of the legs constrains Y, {self.lean_m / MM:.0f} mm from upper to lower U joint: "
            f"{LENGTH_ERROR_M / MM:g} mm on leg 1 (d4) move o by {self.leg_y_m / MM:.2f} mm in Y on average.",
            f"In the closed chain {listed_or_none(self.without_effect)} of chain 1 move o by less than 1e-3 mm: "
            f"passive joints compensate them. {self.weaker:.0%} of all errors move o less than in their branch.",
            f"First order differs from the exact closure by {self.first_order[0]:.3f} mm at most, where o moves by "
            f"{self.first_order[1]:.1f} mm; with errors a tenth as large by {self.first_order_tenth:.4f} mm. The "
            "difference scales with power "
            f"{math.log10(self.first_order[0] / self.first_order_tenth):.2f} of the error.",
            f"Rigid parts would not fit: the closure residual is up to {self.left_open[0]:.2f} µm and "
            f"{self.left_open[1]:.2f} mrad.",
        ]


def listed_or_none(names: tuple[str, ...]) -> str:
    """Return names for a sentence."""
    return ", ".join(names) if names else "no errors"


def lesson(study: GeometryStudy) -> Lesson:
    """Compare the closed robot with the open branches."""
    opened, closed = study.open_branch, study.closed_chain
    rows = axis_rows(study)

    def over(limit_m: float) -> tuple[int, int]:
        return len(opened.reaching(limit_m).parameters), len(closed.reaching(limit_m).parameters)

    distances = [np.sqrt(np.square(errors.distance_m).mean(axis=1)) for errors in (opened, closed)]
    own = closed.of_chain(1)
    idle = own.distance_m.max(axis=1) < POSITION_BOUNDARY_M
    sizes = np.array([error_size(parameter) for parameter in closed.parameters])
    linear = study.closure.first_order(closed.parameters, sizes)
    checked = linear.shape[1]
    gap = np.linalg.norm(linear - closed.translation_m[:, :checked], axis=-1)
    worst = np.unravel_index(int(gap.argmax()), gap.shape)
    tenth = study.closure.exact(closed.parameters, 0.1 * sizes, poses=checked)[0]
    return Lesson(
        ratios=(rows[0].ratio, rows[1].ratio, rows[2].ratio),
        over_1mm=over(MM),
        over_10mm=over(study.layout.workspace.accuracy.metres),
        without_effect=tuple(name for name, none in zip(own.labels, idle, strict=True) if none),
        weaker=float(np.mean(distances[1] < distances[0])),
        first_order=(float(gap[worst]) / MM, float(closed.distance_m[worst]) / MM),
        first_order_tenth=float(np.linalg.norm(0.1 * linear - tenth, axis=-1).max()) / MM,
        lean_m=abs(abs(study.layout.fixed_centres.metres[0][1]) - abs(study.layout.moving_centres.metres[0][1])),
        leg_y_m=float(own.mean_m[own.labels.index("d4"), 1]),
        left_open=study.closure.left_open,
    )
