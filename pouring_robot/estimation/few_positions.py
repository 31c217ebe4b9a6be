"""The two outer frames from whatever was measured of places: single coordinates, distances, a few positions.

Least squares from many starts, of the present robot: the 24 ways of laying axes along axes, each shifted so that what
coordinates there are agree on average; for distances, to all sides of the device at the mean distance. Frames that the
data leave open stay near their start.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from pouring_robot.batch import BatchClosure
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames.outer import FRAMES, OuterFrames
from pouring_robot.estimation.frames.starts import FEWEST_ROWS
from pouring_robot.estimation.measurement import Prediction
from pouring_robot.estimation.residuals import MeasuredPoses, WhitenedEquations, whiten
from pouring_robot.exceptions import FrameFitError
from pouring_robot.mechanism.arrays import FloatArray

_STEPS, _SETTLED, _LEAST_DAMPING, _MOST_DAMPING = 60, 1e-9, 1e-9, 1e6


def searched_frames(measured: MeasuredPoses, closure: BatchClosure) -> OuterFrames:
    """Return the frames that fit best.

    Args:
        measured: n rows.
        closure: the same rows of the present robot.

    Raises:
        FrameFitError: fewer than :data:`FEWEST_ROWS` rows tell anything of places.
    """
    told = measured.known[:, : FRAMES // 2 + 1].any(axis=1) & closure.closed
    if told.sum() < FEWEST_ROWS:
        raise FrameFitError(int(told.sum()), FEWEST_ROWS)
    found = [_refined(measured, closure, start) for start in _starts(measured, closure)]
    return min(found, key=lambda one: one[0])[1]


def _starts(measured: MeasuredPoses, closure: BatchClosure) -> list[OuterFrames]:
    places = np.nanmean(closure.position, axis=0)
    known = np.isfinite(measured.position_m)
    seen = np.where(known, measured.position_m, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    sides = np.zeros((1, 3))
    if not known.any():
        residual = measured.residual(Prediction.of(closure, OuterFrames(pin.SE3.Identity(), pin.SE3.Identity())))
        away = np.nanmean(residual[:, FRAMES // 2] + np.linalg.norm(closure.position, axis=1))
        sides = away * np.concatenate([np.eye(3), -np.eye(3)])
    turns = Rotation.create_group("O").as_matrix()
    return [
        OuterFrames(pin.SE3(turn, seen + side - turn @ places), pin.SE3.Identity()) for turn in turns for side in sides
    ]


def _refined(measured: MeasuredPoses, closure: BatchClosure, frames: OuterFrames) -> tuple[float, OuterFrames]:
    """Run Levenberg-Marquardt; return the sum of squares and the frames."""
    equations, damping = _equations(measured, closure, frames), 1e-3
    cost = float(equations.residual @ equations.residual)
    for _ in range(_STEPS):
        jacobian = np.asarray(equations.jacobian)
        normal = jacobian.T @ jacobian
        hold = damping * (np.trace(normal) / FRAMES) * np.eye(FRAMES)
        step: FloatArray = -np.linalg.solve(normal + hold, jacobian.T @ equations.residual)
        moved = frames.moved(step)
        trial = _equations(measured, closure, moved)
        better = float(trial.residual @ trial.residual)
        if better < cost:
            frames, equations, cost, damping = moved, trial, better, max(0.1 * damping, _LEAST_DAMPING)
        else:
            damping *= 10.0
        if np.abs(step).max() < _SETTLED or damping > _MOST_DAMPING:
            break
    return cost, frames


def _equations(measured: MeasuredPoses, closure: BatchClosure, frames: OuterFrames) -> WhitenedEquations:
    jacobian = frames.jacobian(PoseStack(closure.position, closure.rotation))
    redundant = np.zeros((*closure.disagreement.shape, FRAMES)) if closure.disagreement.size else None
    seen = replace(Prediction.of(closure, frames), jacobian=jacobian, disagreement=redundant)
    return whiten(measured, seen)
