"""Checks of single rows and of their order: outliers, poses out of reach, jumps of the measuring set-up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, Rows, Severity, found
from pouring_robot.checks.smoothing import (
    ROWS_PER_TERM,
    drive_effect,
    drive_errors,
    filled,
    foretelling,
    joint_effect,
    leftover,
    robust_fit,
    sized,
    smooth_terms,
    unexplained,
)
from pouring_robot.checks.units_and_axes import Comparison
from pouring_robot.estimation.frames.fit import FrameFit
from pouring_robot.mechanism.arrays import FloatArray, evenly
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.description.drawing import Drawing

OUTLIER_SIGMAS = 8.0
"""A row is an outlier beyond this many robust deviations: in the pose, in the drives that would explain it, and of what
errors of all joints explain. The deviation is that of a row against what the others foretell."""
_PLAIN = 1.0
_IMPOSSIBLE_M, _IMPOSSIBLE_RAD = 0.05, 0.15
_JUMP_SIGMAS = 5.0
"""A step counts beyond this many deviations of one row; a steady drift, taken for a step, stays below three."""
_JUMP_WINDOW = 10
_JUMP_PLACES = 400
_LARGE_JUMP_M, _LARGE_JUMP_RAD = 1e-3, 2e-3
_FEWEST = 12
_TELLING_ROWS = 1000  # many times the errors of joints there are


def check_rows(campaign: Campaign, drawing: Drawing, data: Comparison, fit: FrameFit) -> Iterator[DataFlag]:
    """Yield outliers, unreachable poses and jumps, given data whose mistakes of units and frames are undone."""
    rows = np.flatnonzero(data.poses.complete & campaign.usable)
    if rows.size < _FEWEST or data.inverted:
        return
    score = outlier_scores(campaign, drawing, data, fit)
    distance = np.linalg.norm(np.nan_to_num(fit.position_residual_m), axis=1)
    angle = np.zeros(len(campaign))
    plain = distance / max(fit.position_scale_m, 1e-12)
    if fit.rotation_residual_rad is not None:
        angle = np.linalg.norm(np.nan_to_num(fit.rotation_residual_rad), axis=1)
        plain = np.maximum(plain, angle / max(fit.rotation_scale_rad or 0.0, 1e-12))
    # A row that is no worse than others before any smoothing has to stand out twice as far after it.
    wrong = np.flatnonzero((score > OUTLIER_SIGMAS) & ((plain > _PLAIN) | (score > 2.0 * OUTLIER_SIGMAS)))
    far = (distance > _IMPOSSIBLE_M) | (angle > _IMPOSSIBLE_RAD)
    if wrong.size:  # near the edge of reach errors of joints are not smooth, but the other rows tell of them
        beyond = np.minimum(_beyond_joints(campaign, drawing, data, fit, wrong), score[wrong])
        # Under conditions that no other row had nobody knows what is right.
        uncertain = np.where(far[wrong], 0.0, foretelling(campaign, data.poses, wrong))
        wrong = wrong[beyond > OUTLIER_SIGMAS * np.sqrt(1.0 + uncertain)]
    for row in wrong:
        yield _outlier(campaign, int(row), float(distance[row]), float(angle[row]), float(score[row]), bool(far[row]))
    yield from _jumps(campaign, data, fit, wrong)


def outlier_scores(campaign: Campaign, drawing: Drawing, data: Comparison, fit: FrameFit) -> FloatArray:
    """Return how far each row is from what a smooth error of the robot explains, (n,), in robust deviations.

    The lesser of two: how far its pose is off, and how far the drive errors that would explain it are off. Near a
    singular pose the first is large for a sound row, but not the second.
    """
    terms = smooth_terms(campaign, data.poses)
    pose, floors = _residuals(campaign, fit, terms)
    in_pose = np.max([unexplained(terms, pose[:, k], floor) for k, floor in enumerate(floors)], axis=0)
    effect = drive_effect(drawing, data.drives, fit.frames.T_end_target)
    units = [drive.unit for drive in campaign.robot.drives]
    drives = drive_errors(effect, units, pose, floors[0] / floors[-1])
    in_drives = np.max([unexplained(terms, errors, floors[0]) for errors in drives.T], axis=0)
    return np.asarray(np.minimum(in_pose, in_drives), dtype=np.float64)


def _beyond_joints(campaign: Campaign, drawing: Drawing, data: Comparison, fit: FrameFit, rows: Rows) -> FloatArray:
    """Return how far rows (k,) are from what errors of all joints explain, (k,), in robust deviations.

    A deviation is that of the component: beside errors of joints, or beside smooth errors where these explain more, as
    where drives are off. Infinite where the campaign is too short to tell; of a long one some rows do.
    """
    smooth = smooth_terms(campaign, data.poses)
    pose, floors = _residuals(campaign, fit, smooth)
    used = np.union1d(rows, evenly(len(campaign), _TELLING_ROWS))
    effect, small = joint_effect(campaign.robot, drawing, data.drives[used], fit.frames)
    frames = fit.frames.jacobian(data.poses[used]) * np.tile([MM] * 3 + [MRAD] * 3, 2)
    turn = np.kron(np.eye(2), fit.frames.T_tracker_base.rotation.T)
    terms = (turn @ np.concatenate([effect * small, frames], axis=2))[:, : len(floors)] / np.array(floors)[:, None]
    terms, residual = terms.reshape(used.size * len(floors), -1), pose[used] / floors
    known = np.isfinite(terms).all(axis=1) & np.isfinite(residual.ravel())
    if known.sum() < ROWS_PER_TERM * np.linalg.matrix_rank(terms[known]):
        return np.full(rows.size, np.inf)
    _, left, _ = robust_fit(terms, residual.ravel(), 1.0)
    scores = []
    for k, floor in enumerate(floors):
        size, deviation = sized(left.reshape(residual.shape)[:, k], 1.0)
        near = leftover(smooth, pose[:, k], floor)[1] / floor
        scores.append(size / min(deviation, near))
    return np.asarray(np.max(scores, axis=0)[np.searchsorted(used, rows)])


def _residuals(campaign: Campaign, fit: FrameFit, terms: FloatArray) -> tuple[FloatArray, list[float]]:
    """Return residuals in fixed-platform axes, (n, 3) or (n, 6), in m and rad, and the noise of each column."""
    noise = campaign.metadata.sigma_position_m or 1e-6
    position = _turned(fit, fit.position_residual_m, terms, noise)
    if fit.rotation_residual_rad is None:
        return position, [noise] * 3
    turn_noise = campaign.metadata.sigma_rotation_rad or 1e-6
    turn = _turned(fit, fit.rotation_residual_rad, terms, turn_noise)
    return np.concatenate([position, turn], axis=1), [noise] * 3 + [turn_noise] * 3


def _turned(fit: FrameFit, residual: FloatArray, terms: FloatArray, noise: float) -> FloatArray:
    """Turn residuals into fixed-platform axes; a missing cell is filled by what the other rows say of it."""
    smooth = np.column_stack([filled(terms, residual[:, k], noise) for k in range(3)])
    return np.asarray(smooth @ fit.frames.T_tracker_base.rotation)  # in the axes of the fixed platform


def _outlier(campaign: Campaign, row: int, distance: float, angle: float, score: float, far: bool) -> DataFlag:
    names = (*columns.POSITION, *(columns.ROTATION if campaign.full_pose else ()))
    off = f"{distance * 1e3:.3g} mm" + (f" and {angle * 1e3:.3g} mrad" if campaign.full_pose else "")
    metrics = {"distance_mm": distance * 1e3, "angle_mrad": angle * 1e3, "deviations": score}
    line = f"line {campaign.lines[row]}"
    if far:
        message = f"{line}: the drives cannot reach the measured pose; it is {off} from theirs"
        return found(campaign, FlagCode.UNREACHABLE_POSE, message, [row], names, metrics)
    message = (
        f"{line}: outlier, {off} from the nominal robot, {score:.0f} robust deviations from what the other rows say of "
        "its errors"
    )
    return found(campaign, FlagCode.OUTLIER, message, [row], names, metrics)


def _jumps(campaign: Campaign, data: Comparison, fit: FrameFit, wrong: Rows) -> Iterator[DataFlag]:
    """Yield the largest lasting step of each session's residuals, if there is a clear one."""
    terms = smooth_terms(campaign, data.poses, with_time=False)
    pose, floors = _residuals(campaign, fit, terms)
    pose[wrong] = np.nan
    inliers = np.asarray(np.isfinite(pose).all(axis=1) & np.isfinite(terms).all(axis=1), dtype=np.bool_)
    for session, members in campaign.rows_by_session().items():
        rows = members[inliers[members]]
        # With more terms than a quarter of the rows, they would explain any step.
        kept = terms[:, : max(1, rows.size // 4)]
        if rows.size >= 2 * _JUMP_WINDOW:
            yield from _jump(campaign, session, rows, kept[rows], pose[rows], np.array(floors))


def _jump(
    campaign: Campaign, session: str, rows: Rows, terms: FloatArray, pose: FloatArray, floors: FloatArray
) -> Iterator[DataFlag]:
    """Fit a step at every place beside the smooth terms, keep the one that explains most, and judge it robustly."""
    places = np.unique(np.linspace(_JUMP_WINDOW, len(rows) - _JUMP_WINDOW, _JUMP_PLACES).astype(int))
    steps = (np.arange(len(rows))[:, None] >= places).astype(float)
    basis, _ = np.linalg.qr(terms)
    free_steps = steps - basis @ (basis.T @ steps)
    free_pose = (pose - basis @ (basis.T @ pose)) / floors
    power = np.maximum((free_steps**2).sum(axis=0), 1e-9)
    gain = ((free_steps.T @ free_pose) ** 2).sum(axis=1) / power
    place = int(places[int(np.argmax(gain))])
    design = np.column_stack([terms, np.arange(len(rows)) >= place])
    fits = [robust_fit(design, pose[:, k], float(floors[k])) for k in range(pose.shape[1])]
    step = np.array([coefficients[-1] for coefficients, _, _ in fits])
    size = float(max(abs(coefficients[-1]) / scale for coefficients, _, scale in fits))
    if size < _JUMP_SIGMAS:
        return
    row, distance, angle = int(rows[place]), float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
    large = distance > _LARGE_JUMP_M or angle > _LARGE_JUMP_RAD
    turn = f" and {angle * 1e3:.3g} mrad" if pose.shape[1] > 3 else ""
    yield found(
        campaign,
        FlagCode.MEASUREMENT_JUMP,
        f"from about line {campaign.lines[row]} on all measurements are shifted by {distance * 1e3:.3g} mm{turn} "
        f"(session {session})",
        [row],
        columns.POSITION,
        {"step_mm": distance * 1e3, "step_mrad": angle * 1e3, "deviations": size},
        severity=Severity.WARNING if large else Severity.NOTE,
    )
