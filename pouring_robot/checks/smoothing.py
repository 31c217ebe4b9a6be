"""What a smooth error of the robot can explain of the residuals, so that single wrong rows stand out.

A robot's own errors vary smoothly with pose and conditions, or are the answer to a smooth error of its drives, which
near a singular pose is large. A wrong row is neither. So residuals are looked at twice: in the pose, and as the
drive errors that would explain them; from both, what a low-order function of pose and conditions explains is taken.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.batch import engine_for
from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames.fit import robust_sigma
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import GeometricParameter, drive_parameters
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drawing import Drawing
from pouring_robot.robot.parameters import ParameterCatalogue

_RIDGE = 1e-3
ROWS_PER_TERM = 4
_NINETY_PER_CENT = 1.645  # deviations of a normal error that nine in ten stay within
_VARIES = 1e-6  # of rotations, root mean square; below it they stand still
_SLOW = ("time", "temperature")


def drive_effect(drawing: Drawing, drives: FloatArray, T_end_target: pin.SE3) -> FloatArray:
    """Return how the target on the nominal robot moves with its drives, (n, 6, drives), in base axes; NaN without pose.

    Displacement of its origin (m) and rotation vector (rad), per m and rad.
    """
    frames = OuterFrames(pin.SE3.Identity(), T_end_target)
    return _effect(drawing, drives, frames, drive_parameters(drawing.mechanism))


def joint_effect(
    robot: RobotDefinition, drawing: Drawing, drives: FloatArray, frames: OuterFrames
) -> tuple[FloatArray, FloatArray]:
    """Return how it moves with every drive, then every displacement of every joint, and a small error of each.

    Shapes (n, 6, p) in tracker axes, per m and rad, NaN without pose; and (p,), 1 mm or 1 mrad.
    """
    catalogue = ParameterCatalogue(robot, drawing.mechanism)
    local: tuple[GeometricParameter, ...] = (*catalogue.drives, *catalogue.placements)
    small = np.array([MM if parameter.unit == "m" else MRAD for parameter in local])
    return _effect(drawing, drives, frames, local), small


def _effect(
    drawing: Drawing, drives: FloatArray, frames: OuterFrames, parameters: Sequence[GeometricParameter]
) -> FloatArray:
    engine, start = engine_for(drawing.mechanism), drawing.starts(drives)
    reached = np.flatnonzero(np.isfinite(start.position).all(axis=1))
    closed = engine.close(drives[reached], start[reached])
    matrix = engine.transfer(closed, parameters).matrix
    effect = np.full((len(drives), *matrix.shape[1:]), np.nan)
    effect[reached] = frames.carried(matrix, PoseStack(closed.position, closed.rotation))
    return effect


def drive_errors(effect: FloatArray, units: Sequence[str], residual: FloatArray, metres_per_rad: float) -> FloatArray:
    """Return the drive errors that would explain residuals best, (n, drives), in m; NaN where the effect is not known.

    Where residuals do not fix all drives, the least such errors are returned.

    Args:
        effect: (n, 6, drives); see :func:`drive_effect`.
        units: of the drives, ``m`` or ``rad``. An angle counts as the length it moves the target at the median pose.
        residual: (n, 3) positions, in m, or (n, 6) with rotation vectors, in rad; in base axes.
        metres_per_rad: how rotations weigh against positions, in m.
    """
    reach = np.nanmedian(np.linalg.norm(effect[:, :3], axis=1), axis=0)
    scale = np.where((np.array(units) == "rad") & (reach > 0.0), reach, 1.0)
    count = residual.shape[1]
    weight = np.array([1.0, 1.0, 1.0, *[metres_per_rad] * 3])[:count]
    known = np.isfinite(effect).all(axis=(1, 2))
    inverse = np.linalg.pinv(weight[:, None] * effect[known, :count] / scale, rcond=1e-9)
    errors = np.full((len(effect), len(units)), np.nan)
    errors[known] = np.einsum("nij,nj->ni", inverse, weight * residual[known])
    return errors


def smooth_terms(campaign: Campaign, poses: PoseStack, *, with_time: bool = True) -> FloatArray:
    """Return the terms a smooth error may have, (n, terms), each scaled to its spread; NaN only where no pose is.

    Constant, linear in pose and conditions, and quadratic in the pose where there are rows enough. The pose is its
    position and what of its rotation varies.
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
    """Return the constant and linear terms, (n,) each, and how many of them are of the pose alone, which come first."""
    pose_terms = [_scaled(values) for values in (*poses.position_m.T, *_turns(poses).T)]
    kinds = {quantity.name: quantity.kind for quantity in columns.condition_columns(campaign.robot)}
    kept = (name for name in campaign.conditions if with_time or kinds[name] not in _SLOW)
    conditions = [campaign.conditions[name] for name in kept]
    conditions += [] if campaign.approach is None else list(campaign.approach.T)
    terms = [np.ones(len(campaign)), *pose_terms]
    for values in conditions:
        if np.unique(values[np.isfinite(values)]).size > 1:
            terms.append(_scaled(np.where(np.isfinite(values), values, np.nanmedian(values))))
    return terms, 1 + len(pose_terms)


def foretelling(campaign: Campaign, poses: PoseStack, rows: NDArray[np.intp]) -> FloatArray:
    """Return the variance of what all other rows foretell of some rows (k,), over that of a row, (k,).

    Of a linear error of pose and conditions. Beyond all that the others had it is large: they tell nothing there.
    """
    terms = np.column_stack(_linear_terms(campaign, poses, with_time=True)[0])
    others = np.delete(terms, rows, axis=0)
    others = others[np.isfinite(others).all(axis=1)]
    spread = np.linalg.inv(others.T @ others + _RIDGE * np.eye(terms.shape[1]))
    return np.asarray(np.einsum("ij,jk,ik->i", terms[rows], spread, terms[rows]))


def _turns(poses: PoseStack) -> FloatArray:
    """Return what varies of the rotation matrices, (n, up to 9): cosine and sine where they turn about one axis."""
    rotation = poses.rotation.reshape(-1, 9)
    known = poses.complete
    if not known.any():
        return np.empty((len(poses), 0))
    middle = rotation[known].mean(axis=0)
    _, sizes, axes = np.linalg.svd(rotation[known] - middle, full_matrices=False)
    return np.asarray((rotation - middle) @ axes[sizes > _VARIES * np.sqrt(known.sum())].T)


def _scaled(values: FloatArray) -> FloatArray:
    spread = float(np.nanstd(values))
    centred = values - np.nanmedian(values)
    return centred / spread if spread > 1e-12 else 0.0 * centred


def unexplained(terms: FloatArray, values: FloatArray, floor: float) -> FloatArray:
    """Return what the terms leave of a column of values, (n,), in robust deviations; see :func:`leftover`."""
    size, deviation = leftover(terms, values, floor)
    return size / deviation


def leftover(terms: FloatArray, values: FloatArray, floor: float) -> tuple[FloatArray, float]:
    """Return what the terms leave of a column of values, each row judged without itself, and its robust deviation.

    Args:
        terms: (n, terms) as :func:`smooth_terms` gives them.
        values: (n,) residuals; of NaN rows nothing is left.
        floor: the least standard deviation that counts, in the unit of the values: the measurement noise.
    """
    _, left, scale = robust_fit(terms, values, floor)
    return sized(left, scale)


def sized(left: FloatArray, least: float) -> tuple[FloatArray, float]:
    """Return the sizes of leftovers (n,), 0 for NaN, and their robust deviation, which is no less than given."""
    size = np.abs(np.nan_to_num(left))
    # Errors of a crooked robot have long tails: nine rows in ten, not only the middle ones, set the scale.
    if np.isfinite(left).any():
        least = max(least, float(np.nanquantile(np.abs(left), 0.9)) / _NINETY_PER_CENT)
    return size, least


def filled(terms: FloatArray, values: FloatArray, floor: float) -> FloatArray:
    """Return values (n,) with missing ones replaced by what the terms, fitted to the others, say of them."""
    if np.isfinite(values).all() or not np.isfinite(values).any():
        return values
    coefficients, _, _ = robust_fit(terms, values, floor)
    return np.where(np.isfinite(values), values, terms @ coefficients)


def robust_fit(terms: FloatArray, values: FloatArray, floor: float) -> tuple[FloatArray, FloatArray, float]:
    """Return coefficients (terms,), leftover of each row judged without itself (n,), and its deviation."""
    known = np.isfinite(values) & np.isfinite(terms).all(axis=1)
    design, target = terms[known], values[known]
    weight = np.ones(len(design))
    coefficients = np.zeros(design.shape[1])
    left, scale = target.copy(), max(robust_sigma(target), floor, 1e-12)
    for step in range(20):
        weighted = design * weight[:, None]
        inverse = np.linalg.inv(weighted.T @ design + _RIDGE * np.eye(design.shape[1]))
        leverage = ((design @ inverse) * weighted).sum(axis=1)
        coefficients = inverse @ (weighted.T @ target)
        left = (target - design @ coefficients) / np.clip(1.0 - leverage, 0.2, 1.0)
        scale = max(robust_sigma(left), floor, 1e-12)
        size = np.minimum(np.abs(left) / scale, 1e6)
        # Huber first, which finds the way from anywhere; then Tukey, to which a gross error counts nothing.
        huber = 1.5 / np.maximum(size, 1.5)
        weight = huber if step < 8 else np.where(size < 4.7, (1.0 - (size / 4.7) ** 2) ** 2, 0.0)
    full = np.full(values.size, np.nan)
    full[known] = left
    return coefficients, full, scale
