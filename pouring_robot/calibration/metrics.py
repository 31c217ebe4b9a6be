"""How good a calibration is: residuals, accuracy and repeatability after ISO 9283, uncertainty of the ladle."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.intervals import deviations95, largest_std
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray, Indices, rms
from pouring_robot.mechanism.rotations import moved_point, tilts_alone

_FEWEST_REPEATS = 3


@dataclass(frozen=True)
class Misfit:
    """How far measurements are from predictions; NaN where nothing was measured."""

    rows: int
    rms_mm: float  # root mean square of a coordinate; where no position was measured, of a distance or closure
    p95_mm: float  # length of a row's measured values that 95 % of the rows do not exceed; ``max_mm`` the largest
    max_mm: float
    rms_mrad: float  # root mean square of a rotation component; ``p95_mrad`` and ``max_mrad`` of the angle likewise
    p95_mrad: float
    max_mrad: float
    axis_rms_mm: tuple[float, float, float]  # root mean square of x, y and z; ``axis_rms_mrad`` of rotation components
    axis_rms_mrad: tuple[float, float, float]
    line_rms_mm: float  # root mean square of a distance or closure

    @classmethod
    def of(cls, difference: FloatArray) -> Self:
        """Return the misfit of differences (n, K) in m and rad, NaN where missing."""
        position, turn, line = difference[:, :3] / MM, difference[:, 3:6] / MRAD, difference[:, 6:] / MM
        length = difference[:, length_columns(difference)] / MM
        return cls(
            int(np.isfinite(difference).any(axis=1).sum()),
            rms(length),
            *_largest(length),
            rms(turn),
            *_largest(turn),
            (rms(position[:, 0]), rms(position[:, 1]), rms(position[:, 2])),
            (rms(turn[:, 0]), rms(turn[:, 1]), rms(turn[:, 2])),
            rms(line),
        )


def length_columns(difference: FloatArray) -> slice:
    """Return which columns of differences (n, K) count as lengths: positions, else distances and closures."""
    placed = np.isfinite(difference[:, :3]).any() or difference.shape[1] <= 6
    return slice(0, 3) if placed else slice(6, None)


def values_a_row(vectors: FloatArray) -> float:
    """Return how many values (n, k) rows with any have on average; 0 where nothing was measured."""
    seen = np.isfinite(vectors)
    return float(seen.sum() / max(int(seen.any(axis=1).sum()), 1))


def row_lengths(vectors: FloatArray) -> FloatArray:
    """Return the length of what was measured in each row (n, k), (n,), in its unit; NaN where nothing was."""
    seen = np.isfinite(vectors)
    return np.where(seen.any(axis=1), np.linalg.norm(np.where(seen, vectors, 0.0), axis=1), np.nan)


def _largest(vectors: FloatArray) -> tuple[float, float]:
    lengths = row_lengths(vectors)
    lengths = lengths[np.isfinite(lengths)]
    return (float(np.quantile(lengths, 0.95)), float(lengths.max())) if lengths.size else (float("nan"), float("nan"))


@dataclass(frozen=True)
class PosePerformance:
    """Accuracy and repeatability at poses that were measured repeatedly, after ISO 9283:1998, 7.2.

    AP is the distance from the predicted to the mean attained position; RP = l̄ + 3 S_l, with l the distances of the
    single positions from their mean. Angles likewise; NaN for positions only. Each figure is that of the worst pose, as
    the standard requires. The standard also requires 30 cycles per pose; here they are as many as were measured, three
    repeats or more: ``cycles`` is the least number of repeats.
    """

    poses: int
    cycles: int
    ap_before_mm: float
    ap_after_mm: float
    ap_before_mrad: float
    ap_after_mrad: float
    rp_mm: float
    rp_mrad: float


def pose_performance(
    measured: MeasuredPoses, before: FloatArray, after: FloatArray, groups: Sequence[Indices]
) -> PosePerformance | None:
    """Return ISO 9283-style figures, or None without a pose measured three times.

    ``before`` and ``after`` are measured minus predicted by the present and the calibrated model, shape (n, K), in m
    and rad; of the groups of rows with the same command, those with two are left out.
    """
    known = [rows[measured.known[rows, :3].all(axis=1)] for rows in groups]
    known = [rows for rows in known if rows.size >= _FEWEST_REPEATS]
    if not known:
        return None
    figures = np.array([_figures(before[rows, :6], after[rows, :6]) for rows in known])
    worst = (float(np.nanmax(column)) if np.isfinite(column).any() else float("nan") for column in figures.T)
    return PosePerformance(len(known), min(rows.size for rows in known), *worst)


def _figures(before: FloatArray, after: FloatArray) -> list[float]:
    """Return AP before and after in mm, the same in mrad, and RP in mm and mrad; NaN from fewer than three repeats."""
    accuracies, repeatabilities = list[float](), list[float]()
    for part, unit in ((slice(0, 3), MM), (slice(3, 6), MRAD)):
        whole = [one[np.isfinite(one[:, part]).all(axis=1), part] / unit for one in (before, after)]
        was, now = (one if len(one) >= _FEWEST_REPEATS else np.full((_FEWEST_REPEATS, 3), np.nan) for one in whole)
        accuracies += [float(np.linalg.norm(one.mean(axis=0))) for one in (was, now)]
        # Repeats share their prediction, so the differences scatter as the measurements do.
        lengths = np.linalg.norm(now - now.mean(axis=0), axis=1)
        repeatabilities.append(float(lengths.mean() + 3.0 * lengths.std(ddof=1)))
    return accuracies + repeatabilities


@dataclass(frozen=True, eq=False)
class LadleUncertainty:
    """Standard deviation of the predicted pouring lip, as the device would see it, without measurement noise.

    The lip is assumed to move rigidly with the target: a rotation of the platform that looks like one of the target on
    it does not count if rotations were measured. If only positions were, that rotation was not observed, and it counts
    as far as tolerances leave it open. Distances, or one or two of the three coordinates, hardly determine where device
    and target are: where nothing else was measured, the lip is in the robot's own base.
    """

    position_m: FloatArray  # commanded origin of the end body, shape (n, 3), in m
    tilt_rad: FloatArray | None  # commanded rotation about y, shape (n,), in rad; None where it rotates otherwise, too
    std_m: FloatArray  # of x, y and z in axes of the tracker, or of the base, shape (n, 3), in m
    located: bool  # whether the device located the target, so that the axes are the tracker's
    dof: float = math.inf  # degrees of freedom of the standard deviations

    @property
    def half_width_m(self) -> FloatArray:
        """Half the 95 % interval of the worst coordinate of each pose, shape (n,), in m."""
        return np.asarray(deviations95(self.dof) * self.std_m.max(axis=1))


def workspace_rows(model: MeasurementModel) -> ModelledRows:
    """Return commands within the robot's reach, spread over the workspace."""
    return model.at(*model.model.definition.workspace(model.drawing))


def ladle_uncertainty(
    rows: ModelledRows,
    unknowns: Unknowns,
    covariances: Sequence[FloatArray],
    dof: float = math.inf,
    *,
    located: bool,
    turned: bool,
) -> LadleUncertainty:
    """Return the uncertainty of the lip by that of the unknowns, in m and rad, at their calibrated values.

    Of several ``covariances`` the largest counts, see :func:`~pouring_robot.estimation.intervals.largest_std`; ``dof``
    are their degrees of freedom. ``located`` states whether all three coordinates were measured, so that their axes are
    known, ``turned`` whether rotations were, so that the attitude of the target is known.
    """
    seen = rows.linearise(unknowns)
    closed = seen.closed
    jacobian, rotation = seen.derivatives[closed], seen.closure.rotation[closed]
    if not turned:
        jacobian[:, 3:, 6:FRAMES] = 0.0  # the target's attitude is not known; the lip follows the platform's
    tool = rows.model.engine.structure.mechanism.T_end_tool
    arm = tool.translation - unknowns.frames.T_end_target.translation
    axes = unknowns.frames.T_tracker_base.rotation
    lever = np.einsum("ij,njk,k->ni", axes, rotation, arm)
    lip = moved_point(jacobian, lever)
    if not located:
        lip[:, :, :FRAMES] = 0.0
        lip = axes.T @ lip
    tilt = tilts_alone(rows.start.rotation[closed])
    return LadleUncertainty(rows.start.position[closed], tilt, largest_std(lip, covariances), located, dof)
