"""Smooth errors, which a correct row may have: low-order functions of pose and conditions, or of drives, are fitted.

Checks for gross errors and jumps look at the residuals; nothing is corrected. Each row has a leave-one-out residual,
scaled by its robust deviation; the loss is Huber's, then Tukey's (:mod:`pouring_robot.estimation.robust`).
"""

import functools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.checks.stationary_target import at_one_place
from pouring_robot.checks.units_and_axes import Comparison
from pouring_robot.estimation.frames.fit import FrameFit
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.estimation.frames.starts import TURNING
from pouring_robot.estimation.noise import LEAST_NOISE
from pouring_robot.estimation.robust import huber_weights, tukey_weights
from pouring_robot.io.units import MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import FloatArray, Indices, robust_sigma
from pouring_robot.mechanism.local_parameters import GeometricParameter
from pouring_robot.robot.description.drawing import Drawing
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue

ROWS_PER_TERM = 4  # rows that a term of a smooth function needs
TELLING_ROWS = 1000  # many times the number of joint errors
_RIDGE = 1e-3
_STILL = 1e-4  # largest change of weights, up to 1, in a last step: residuals then change by as little of their scale
_NINETY_PER_CENT = 1.645  # standard deviations that nine in ten normal errors stay within
_GAP_SIGMAS = 100.0  # of the rows that agree; tails of an inaccurate robot have no gap so wide
_SLOW = ("time", "temperature")


@dataclass(frozen=True, eq=False)
class Aligned:
    """A campaign compared with the nominal robot, both frames fitted."""

    campaign: Campaign
    drawing: Drawing
    data: Comparison  # its commands and measurements with the mistakes found undone
    fit: FrameFit

    @property
    def residuals(self) -> list[tuple[FloatArray, float]]:
        """Residuals of positions and, if measured, rotations, (n, 3) each, in m and rad, with their noise."""
        stated = self.campaign.metadata
        found = [(self.fit.position_residual_m, stated.sigma_position_m or LEAST_NOISE)]
        if self.fit.rotation_residual_rad is not None:
            found.append((self.fit.rotation_residual_rad, stated.sigma_rotation_rad or LEAST_NOISE))
        return found

    @functools.cached_property
    def floors(self) -> list[float]:
        """Noise of each column of residuals, 3 or 6."""
        return np.repeat([noise for _, noise in self.residuals], 3).tolist()

    @functools.cached_property
    def smooth(self) -> tuple[FloatArray, FloatArray]:
        """The smooth terms, and residuals in base axes, (n, 3) or (n, 6); missing cells are predicted by others."""
        return self.smoothed(with_time=True)

    def smoothed(self, *, with_time: bool) -> tuple[FloatArray, FloatArray]:
        """Return :attr:`smooth`, or the same without terms of slowly changing conditions."""
        terms = _smooth_terms(self.campaign, at_one_place(self.campaign, self.data.poses), with_time)
        turn = self.fit.frames.T_tracker_base.rotation
        whole = (np.column_stack([_filled(terms, one, floor) for one in raw.T]) for raw, floor in self.residuals)
        return terms, np.concatenate([residual @ turn for residual in whole], axis=1)

    def joint_effect(self, rows: Indices) -> tuple[FloatArray, FloatArray]:
        """Return the Jacobian of the target in rows (k,) for every drive, then every displacement of every joint.

        Shape (k, 6, p), see :func:`target_effect`; also a small error of each, (p,), 1 mm or 1 mrad.
        """
        catalogue = ParameterCatalogue(self.campaign.robot, self.drawing.mechanism)
        local: tuple[GeometricParameter, ...] = (*catalogue.drives, *catalogue.placements)
        effect = target_effect(self.drawing, self.data.drives[rows], self.fit.frames, local)
        return effect, np.array([shown_in(parameter.unit)[1] for parameter in local])

    def joint_terms(self, rows: Indices) -> FloatArray:
        """Return how small errors of all joints and of the two frames change residuals of rows (k,), over their noise.

        Shape (k, 3 or 6, terms), in base axes, as :attr:`smooth`; NaN where there is no pose.
        """
        effect, small = self.joint_effect(rows)
        frames = self.fit.frames.jacobian(self.data.poses[rows]) * np.tile([MM] * 3 + [MRAD] * 3, 2)
        turn = np.kron(np.eye(2), self.fit.frames.T_tracker_base.rotation.T)
        terms = (turn @ np.concatenate([effect * small, frames], axis=2))[:, : len(self.floors)]
        return np.asarray(terms / np.array(self.floors)[:, None])


def target_effect(
    drawing: Drawing, drives: FloatArray, frames: OuterFrames, parameters: Sequence[GeometricParameter]
) -> FloatArray:
    """Return the nominal robot's Jacobian of the target for p parameters, (n, 6, p), in tracker axes; NaN without pose.

    Displacement of its origin (m) and rotation vector (rad), per m and rad.
    """
    engine, start = drawing.engine, drawing.starts(drives)
    reached = np.flatnonzero(np.isfinite(start.position).all(axis=1))
    closed = engine.close(drives[reached], start[reached])
    matrix = engine.transfer(closed, parameters).matrix
    effect = np.full((len(drives), *matrix.shape[1:]), np.nan)
    effect[reached] = frames.carried(matrix, PoseStack(closed.position, closed.rotation))
    return effect


def drive_errors(
    effect: FloatArray, units: Sequence[str], residual: FloatArray, metres_per_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Return the drive errors that explain residuals best, (n, drives), in m, and the residuals they leave.

    Both are NaN where the effect is not known. Where residuals do not determine all drives, the smallest such errors
    are returned; components that no drive moves are left.

    Args:
        effect: (n, 6, drives); see :func:`target_effect`.
        units: of the drives, ``m`` or ``rad``. An angle counts as the length it moves the target at the median pose.
        residual: (n, 3) positions, in m, or (n, 6) with rotation vectors, in rad; in base axes.
        metres_per_rad: how rotations weigh against positions, in m.
    """
    reach = np.nanmedian(np.linalg.norm(effect[:, :3], axis=1), axis=0)
    scale = np.where((np.array(units) == "rad") & (reach > 0.0), reach, 1.0)
    count = residual.shape[1]
    weight = np.array([1.0, 1.0, 1.0, *[metres_per_rad] * 3])[:count]
    known = np.isfinite(effect).all(axis=(1, 2))
    moved = effect[:, :count] / scale
    inverse = np.linalg.pinv(weight[:, None] * moved[known], rcond=1e-9)
    errors = np.full((len(effect), len(units)), np.nan)
    errors[known] = np.einsum("nij,nj->ni", inverse, weight * residual[known])
    return errors, residual - np.einsum("nij,nj->ni", moved, errors)


def _smooth_terms(campaign: Campaign, poses: PoseStack, with_time: bool) -> FloatArray:
    """Return the terms a smooth error may have, (n, terms), each scaled to its spread; NaN only without a pose.

    Constant, linear in pose and conditions, and quadratic in the pose where there are enough rows. The pose is its
    position and the varying components of its rotation.
    """
    terms, first = _linear_terms(campaign, poses, with_time)
    pose_terms = terms[1:first]
    squares = [a * b for i, a in enumerate(pose_terms) for b in pose_terms[i:]]
    rows = int(campaign.usable.sum())
    if rows < ROWS_PER_TERM * len(terms):
        terms = terms[:first] if rows >= ROWS_PER_TERM * first else terms[:1]
    elif rows >= ROWS_PER_TERM * (len(terms) + len(squares)):
        terms += squares
    return np.column_stack(terms)


def _linear_terms(campaign: Campaign, poses: PoseStack, with_time: bool) -> tuple[list[FloatArray], int]:
    """Return the constant and linear terms, (n,) each, and how many of the first depend on the pose alone."""
    pose_terms = [_scaled(values) for values in (*poses.position_m.T, *_turns(poses).T)]
    kinds = {quantity.name: quantity.kind for quantity in campaign.robot.condition_columns}
    kept = (name for name in campaign.conditions if with_time or kinds[name] not in _SLOW)
    conditions = [campaign.conditions[name] for name in kept]
    conditions += [] if campaign.approach is None else list(campaign.approach.T)
    return [np.ones(len(campaign)), *pose_terms, *condition_terms(conditions)], 1 + len(pose_terms)


def condition_terms(conditions: Iterable[FloatArray]) -> Iterator[FloatArray]:
    """Yield conditions (n,) that vary, centred and scaled to their spread; a missing cell is replaced by the median."""
    for values in conditions:
        if np.unique(values[np.isfinite(values)]).size > 1:
            yield np.nan_to_num(_scaled(values))


def prediction_variance(campaign: Campaign, poses: PoseStack, rows: Indices) -> FloatArray:
    """Return the variance with which all other rows predict some rows (k,), over that of a row, (k,).

    The error predicted is linear in pose and conditions. The variance is large where the others would have to be
    extrapolated. The effect of conditions may differ from pose to pose. For usual rows this adds no more than their
    deviation, and is not counted; for rows under conditions that hardly another one had it adds much more.
    """
    linear, first = _linear_terms(campaign, poses, with_time=True)
    apart = [a * b for a in linear[1:first] for b in linear[first:]]
    terms = np.column_stack([*linear, *apart])
    ridge = np.repeat([_RIDGE, float(len(apart))], [len(linear), len(apart)])

    def variance(columns: int) -> FloatArray:
        own = terms[:, :columns]
        others = np.delete(own, rows, axis=0)
        others = others[np.isfinite(others).all(axis=1)]
        spread = np.linalg.inv(others.T @ others + np.diag(ridge[:columns]))
        return np.asarray(np.einsum("ij,jk,ik->i", own[rows], spread, own[rows]))

    alike = variance(len(linear))
    return alike + np.maximum(variance(len(ridge)) - alike - 1.0, 0.0)


def _turns(poses: PoseStack) -> FloatArray:
    """Return the varying components of rotation matrices, (n, up to 9): cosine and sine for turns about one axis."""
    rotation = poses.rotation.reshape(-1, 9)
    known = poses.complete
    middle = rotation[known].mean(axis=0)
    _, sizes, axes = np.linalg.svd(rotation[known] - middle, full_matrices=False)
    return np.asarray((rotation - middle) @ axes[sizes > TURNING * np.sqrt(known.sum())].T)


def _scaled(values: FloatArray) -> FloatArray:
    """Return values (n,) minus their median, over their spread, NaN where missing; 0 where they are constant."""
    spread = float(np.nanstd(values))
    centred = values - np.nanmedian(values)
    return centred / spread if spread > 1e-12 else 0.0 * centred


def unexplained(terms: FloatArray, values: FloatArray, floor: float) -> FloatArray:
    """Return the sizes of the residuals of values from the terms, (n,), in robust deviations; see :func:`leftover`."""
    size, deviation = leftover(terms, values, floor)
    return size / deviation


def leftover(terms: FloatArray, values: FloatArray, floor: float) -> tuple[FloatArray, float]:
    """Return the sizes of leave-one-out residuals of values from smooth terms (n, t), and their robust deviation.

    Sizes are 0 in NaN rows; ``floor`` is the least deviation, in the unit of the values: the noise.
    """
    _, residual, scale = robust_fit(terms, values, floor)
    return sized(residual, scale)


def sized(left: FloatArray, least: float) -> tuple[FloatArray, float]:
    """Return the sizes of residuals (n,), 0 for NaN, and their robust deviation, which is no less than ``least``.

    Errors of an inaccurate robot have long tails, so nine rows in ten set the scale, not only the middle ones. Only
    rows that agree count, as more than a tenth may be wrong. From the median, which fewer than half cannot move far,
    the scale grows as long as the rows within its reach raise it: over tails, not over a gap to wrong rows.
    """
    size, deviation, before = np.abs(np.nan_to_num(left)), max(least, robust_sigma(left)), 0.0
    while deviation > before and np.isfinite(left).any():
        before, agreeing = deviation, np.abs(left) <= _GAP_SIGMAS * deviation
        deviation = max(before, float(np.quantile(size[agreeing], 0.9)) / _NINETY_PER_CENT)
    return size, deviation


def _filled(terms: FloatArray, values: FloatArray, floor: float) -> FloatArray:
    """Return values (n,) with missing ones predicted by the terms, fitted to the others."""
    if np.isfinite(values).all() or not np.isfinite(values).any():
        return values
    coefficients, _, _ = robust_fit(terms, values, floor)
    return np.where(np.isfinite(values), values, terms @ coefficients)


def robust_fit(terms: FloatArray, values: FloatArray, floor: float) -> tuple[FloatArray, FloatArray, float]:
    """Return coefficients (terms,), leave-one-out residuals (n,), and their deviation."""
    known = np.isfinite(values) & np.isfinite(terms).all(axis=1)
    design, target = terms[known], values[known]
    weight, ridge = np.ones(len(design)), _RIDGE * np.eye(design.shape[1])
    # Huber first, which converges from any start; then Tukey, which gives gross errors no weight.
    for weights_of, steps in ((huber_weights, 8), (tukey_weights, 12)):
        for _ in range(steps):
            weighted = design * weight[:, None]
            inverse = np.linalg.inv(weighted.T @ design + ridge)
            leverage = ((design @ inverse) * weighted).sum(axis=1)
            coefficients = inverse @ (weighted.T @ target)
            residual = (target - design @ coefficients) / np.clip(1.0 - leverage, 0.2, 1.0)
            scale = max(robust_sigma(residual), floor)
            before, weight = weight, weights_of(np.abs(residual) / scale)
            if np.abs(weight - before).max(initial=0.0) < _STILL:
                break
    full = np.full(values.size, np.nan)
    full[known] = residual
    return coefficients, full, scale
