"""What a smooth error of the robot can explain of the residuals, so that single wrong rows stand out.

A robot's own errors vary smoothly with pose and conditions, or are the answer to a smooth error of its drives, which
near a singular pose is large. A wrong row is neither. So residuals are looked at twice: in the pose, and as the
drive errors that would explain them; from both, what a low-order function of pose and conditions explains is taken.
"""

from __future__ import annotations

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frame_fit import FrameFit, robust_sigma
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics

_RIDGE = 1e-3
_ROWS_PER_TERM = 4
_NINETY_PER_CENT = 1.645  # deviations of a normal error that nine in ten stay within
ARM_M = 0.5
"""An angle at the platform counts as the length it sweeps at this arm, in m: about the size of the platform."""


def drive_sensitivity(kinematics: FourUPUKinematics, poses: PoseStack) -> FloatArray:
    """Return ∂(q1, q2, q3, q4)/∂(x, y, z, tilt) of the nominal robot, (n, 4, 4), in m and rad.

    q_i = |d_i| with d_i = p + R B_i - A_i, and q4 = tilt - psi_4 with psi_4 = atan2(-d_4x, -d_4z).
    """
    arms = np.einsum("nij,kj->nki", poses.rotation, kinematics.moving_centres_m)
    legs = poses.position_m[:, None] + arms - kinematics.fixed_centres_m
    turning = np.stack([arms[..., 2], np.zeros_like(arms[..., 0]), -arms[..., 0]], axis=-1)  # e_y × R B
    along = legs / np.linalg.norm(legs, axis=2, keepdims=True)
    matrix = np.zeros((len(poses), 4, 4))
    matrix[:, :3, :3] = along[:, :3]
    matrix[:, :3, 3] = np.einsum("nki,nki->nk", along[:, :3], turning[:, :3])
    x, z = legs[:, 3, 0], legs[:, 3, 2]
    psi_x, psi_z = z / (x**2 + z**2), -x / (x**2 + z**2)
    matrix[:, 3, 0], matrix[:, 3, 2] = -psi_x, -psi_z
    matrix[:, 3, 3] = 1.0 - psi_x * turning[:, 3, 0] - psi_z * turning[:, 3, 2]
    return matrix


def drive_errors(kinematics: FourUPUKinematics, poses: PoseStack, fit: FrameFit, residual: FloatArray) -> FloatArray:
    """Return the drive errors (n, 4), in m and rad, that would explain residuals best.

    Args:
        kinematics: of the nominal robot.
        poses: its poses.
        fit: the two frames.
        residual: (n, 3) positions, in m, or (n, 6) with rotation vectors, in rad; in fixed-platform axes.

    Three coordinates do not fix four drives: without rotations the least such errors are returned, an angle counted
    as the length it sweeps at :data:`ARM_M`.
    """
    sensitivity = drive_sensitivity(kinematics, poses)
    position = residual[:, :3]
    arm = poses.rotation @ fit.frames.T_end_target.translation
    if residual.shape[1] == 3:
        lever = np.zeros((len(poses), 3, 4))
        lever[:, :, :3] = np.eye(3)
        lever[:, 0, 3], lever[:, 2, 3] = arm[:, 2], -arm[:, 0]
        weigh = np.diag([1.0, 1.0, 1.0, 1.0 / ARM_M])
        answer = np.full_like(sensitivity, np.nan)
        regular = np.isfinite(sensitivity).all(axis=(1, 2))
        answer[regular] = np.linalg.pinv(sensitivity[regular], rcond=1e-9)
        mapped = lever @ answer @ weigh
        errors = np.full((len(poses), 4), np.nan)
        errors[regular] = np.einsum(
            "ij,njk,nk->ni", weigh, np.linalg.pinv(mapped[regular], rcond=1e-9), position[regular]
        )
        return errors
    tilt = residual[:, 4]
    centre = position - tilt[:, None] * np.stack([arm[:, 2], np.zeros(len(poses)), -arm[:, 0]], axis=-1)
    explained: FloatArray = np.einsum("nij,nj->ni", sensitivity, np.column_stack([centre, tilt]))
    return explained


def smooth_terms(campaign: Campaign, poses: PoseStack, *, with_time: bool = True) -> FloatArray:
    """Return the terms a smooth error may have, (n, terms), each scaled to its spread; NaN only where no pose is.

    Constant, linear in pose and conditions, and quadratic in the pose where there are rows enough.
    """
    tilt = np.arctan2(poses.rotation[:, 0, 2], poses.rotation[:, 0, 0])
    pose_terms = [_scaled(values) for values in (*poses.position_m.T, tilt)]
    # What is poured and the hall move nothing by themselves; parts warm with time.
    slow = ("time", *(name for name in campaign.robot.thermometers if name != "melt"))
    conditions = [
        campaign.quantity(name) for name in ("payload", *campaign.robot.travels, *(slow if with_time else ()))
    ]
    conditions += [] if campaign.approach is None else list(campaign.approach.T)
    terms = [np.ones(len(campaign)), *pose_terms]
    terms += [_scaled(_filled(values)) for values in conditions if values is not None and np.isfinite(values).any()]
    squares = [pose_terms[i] * pose_terms[j] for i in range(4) for j in range(i, 4)]
    rows = int(campaign.usable.sum())
    if rows < _ROWS_PER_TERM * len(terms):
        terms = terms[:5] if rows >= _ROWS_PER_TERM * 5 else terms[:1]
    elif rows >= _ROWS_PER_TERM * (len(terms) + len(squares)):
        terms += squares
    return np.column_stack(terms)


def _filled(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nanmedian(values))


def _scaled(values: FloatArray) -> FloatArray:
    spread = float(np.nanstd(values))
    centred = values - np.nanmedian(values)
    return centred / spread if spread > 1e-12 else 0.0 * centred


def unexplained(terms: FloatArray, values: FloatArray, floor: float) -> FloatArray:
    """Return what the terms leave of a column of values, each row judged without itself, in robust deviations.

    Args:
        terms: (n, terms) as :func:`smooth_terms` gives them.
        values: (n,) residuals; NaN rows are left out.
        floor: the least standard deviation that counts, in the unit of the values: the measurement noise.

    Returns:
        (n,) leftover over its robust standard deviation; 0 for rows left out.
    """
    _, left, scale = robust_fit(terms, values, floor)
    size = np.abs(np.nan_to_num(left))
    # Errors of a crooked robot have long tails: nine rows in ten, not only the middle ones, set the scale.
    if np.isfinite(left).any():
        scale = max(scale, float(np.nanquantile(np.abs(left), 0.9)) / _NINETY_PER_CENT)
    return size / scale


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
        leverage = np.einsum("ni,ij,nj->n", design, inverse, weighted)
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
