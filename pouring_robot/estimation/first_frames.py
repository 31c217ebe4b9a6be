"""Where a fit starts: both outer frames, for the present robot, fitted to whatever was measured.

With enough complete positions :mod:`pouring_robot.estimation.frames.fit` fits them; with single coordinates and
distances, least squares by Levenberg-Marquardt from many starts. Both need the measurement model, which imports the
folder of frames.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from pouring_robot.batch import BatchClosure
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames.fit import fit_frames
from pouring_robot.estimation.frames.outer import FRAME_STD, FRAMES, OuterFrames
from pouring_robot.estimation.frames.starts import CUBE_ROTATIONS, FEWEST_FOR_FRAMES
from pouring_robot.estimation.kinds import are
from pouring_robot.estimation.measurement import ModelledRows, Prediction, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses, WhitenedEquations, whiten
from pouring_robot.exceptions import FrameFitError
from pouring_robot.mechanism.arrays import FloatArray

_STEPS, _SETTLED, _LEAST_DAMPING, _MOST_DAMPING = 60, 1e-9, 1e-9, 1e6


def first_frames(rows: ModelledRows, measured: MeasuredPoses) -> Unknowns:
    """Return where to start: both outer frames fitted robustly for the present robot, all parameters zero.

    Where too few rows have a complete position, single coordinates and distances are used; without any, there are no
    frames, and both stay the identity. Raises FrameFitError if too few rows were measured, or rotations alone.
    """
    closure = rows.present()
    poses = PoseStack(closure.position, closure.rotation)
    whole = int((poses.complete & np.isfinite(measured.position_m).all(axis=1)).sum())
    if whole < FEWEST_FOR_FRAMES and not measured.framed:
        frames = OuterFrames(pin.SE3.Identity(), pin.SE3.Identity())
    elif whole < FEWEST_FOR_FRAMES:
        frames = _searched_frames(measured, closure)
    else:
        scale = measured.sigma_position_m / measured.sigma_rotation_rad
        frames = fit_frames(poses, measured.position_m, measured.rotation, scale).frames
    return Unknowns.zero(frames, len(rows.model.parameters) + len(rows.model.sessions))


def _searched_frames(measured: MeasuredPoses, closure: BatchClosure) -> OuterFrames:
    """Return the frames that best fit whatever was measured of positions: coordinates, distances, a few positions.

    Least squares from many starts, for the present robot: the 24 rotations that align axes with axes, each shifted so
    that the measured coordinates agree on average; for distances, to all sides of the device at the mean distance.
    Frames that the data leave open stay near their start.
    """
    known = measured.known[:, : FRAMES // 2 + 1]
    used = known.any(axis=1) & closure.closed
    places = used & known[:, ~are("rotation", np.arange(known.shape[1]))].any(axis=1)
    if used.sum() < FEWEST_FOR_FRAMES or not places.any():
        raise FrameFitError(int(places.sum()), FEWEST_FOR_FRAMES)
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
    return [
        OuterFrames(pin.SE3(turn, seen + side - turn @ places), pin.SE3.Identity())
        for turn in CUBE_ROTATIONS
        for side in sides
    ]


def _refined(measured: MeasuredPoses, closure: BatchClosure, frames: OuterFrames) -> tuple[float, OuterFrames]:
    """Run Levenberg-Marquardt; return the sum of squares and the frames."""
    equations, damping = _equations(measured, closure, frames), 1e-3
    cost = float(equations.residual @ equations.residual)
    for _ in range(_STEPS):
        jacobian = equations.derivatives
        normal = jacobian.T @ jacobian
        # Also along directions that the data leave open, where round-off would determine the step.
        hold = (damping * np.trace(normal) / FRAMES + FRAME_STD**-2) * np.eye(FRAMES)
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
    seen, disagreement = Prediction.of(closure, frames), closure.disagreement
    redundant = np.zeros((*disagreement.shape, FRAMES)) if disagreement.size else None
    return whiten(measured, replace(seen, jacobian=frames.jacobian(seen.poses), disagreement=redundant))
