"""Gross errors of single rows, before any fit; also poses out of reach, and jumps of the measuring set-up.

A robot's errors vary smoothly with pose and conditions, or are due to smooth errors of its drives, whose effect is
large near a singular pose (:mod:`pouring_robot.checks.smooth_errors`). A gross error is neither. So residuals are
examined twice: in the pose, and as the drive errors that would explain them. From both, a low-order function of pose
and conditions is subtracted. What a fit does with gross errors that pass: :mod:`pouring_robot.inference.gross_errors`.
"""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, flagged, where
from pouring_robot.checks.jumps import JUMP_WINDOW, jumps
from pouring_robot.checks.smooth_errors import (
    ROWS_PER_TERM,
    TELLING_ROWS,
    Aligned,
    drive_errors,
    leftover,
    prediction_variance,
    robust_fit,
    sized,
    target_effect,
    unexplained,
)
from pouring_robot.checks.units_and_axes import Comparison
from pouring_robot.estimation.frames.fit import FrameFit
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.exceptions import FrameFitError
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray, Indices, evenly_spaced
from pouring_robot.mechanism.local_parameters import drive_parameters

GROSS_SIGMAS = 8.0
"""A row has a gross error beyond this many robust deviations: in the pose, in the drive errors that would explain it,
and from what errors of all joints explain. The deviation is that of a row from the prediction by the others."""
_PLAIN = 1.0
_IMPOSSIBLE_M, _IMPOSSIBLE_RAD = 0.05, 0.15
_HIDING = 0.1  # share beyond which wrong rows set the deviation they are judged by, that of nine rows in ten
_TIMES_BETTER = 3.0  # rows that shifted together agree with frames of their own, as the others do with theirs
_FEWEST = 12


def check_rows(aligned: Aligned) -> Iterator[DataFlag]:
    """Yield gross errors, unreachable poses and jumps."""
    campaign, data, fit = aligned.campaign, aligned.data, aligned.fit
    rows = np.flatnonzero(data.poses.complete & campaign.usable)
    if rows.size < _FEWEST or data.inverted:
        return
    score = scores_of(aligned)
    distance = np.linalg.norm(np.nan_to_num(fit.position_residual_m), axis=1)
    angle = np.zeros(len(campaign))
    plain = distance / max(fit.position_scale_m, 1e-12)
    if fit.rotation_residual_rad is not None:
        angle = np.linalg.norm(np.nan_to_num(fit.rotation_residual_rad), axis=1)
        plain = np.maximum(plain, angle / max(fit.rotation_scale_rad or 0.0, 1e-12))
    # A row that is no worse than others before smoothing must stand out twice as far after it.
    wrong = np.flatnonzero((score > GROSS_SIGMAS) & ((plain > _PLAIN) | (score > 2.0 * GROSS_SIGMAS)))
    far = (distance > _IMPOSSIBLE_M) | (angle > _IMPOSSIBLE_RAD)
    if wrong.size:  # near the edge of reach joint errors do not act smoothly, but the other rows show them
        beyond = np.minimum(_beyond_joints(aligned, wrong), score[wrong])
        # Under conditions that no other row had, the correct pose is uncertain.
        uncertain = np.where(far[wrong], 0.0, prediction_variance(campaign, data.poses, wrong))
        wrong = wrong[beyond > GROSS_SIGMAS * np.sqrt(1.0 + uncertain)]
    apart = np.union1d(wrong, np.flatnonzero(plain > GROSS_SIGMAS))
    alone = _not_together(data, fit, apart, campaign.metadata.metres_per_rad)
    single = np.intersect1d(wrong, alone)
    steps = list(jumps(aligned, single))
    for row in (single if steps else wrong).tolist():
        yield _gross_error(campaign, row, float(distance[row]), float(angle[row]), float(score[row]), bool(far[row]))
    yield from steps
    hidden = np.setdiff1d(alone[far[alone]], wrong)
    if hidden.size > _HIDING * rows.size:  # near a singular pose small errors of drives move a sound row as far
        by_drives = np.abs(_by_drives(aligned)[0][hidden]).max(axis=1)
        if np.count_nonzero(by_drives > _IMPOSSIBLE_M) > _HIDING * rows.size:
            yield _belonging_elsewhere(
                campaign, hidden, float(np.median(distance[hidden])), float(np.median(angle[hidden]))
            )


def scores_of(aligned: Aligned) -> FloatArray:
    """Return how far each row is from what a smooth error of the robot explains, (n,), in robust deviations.

    The smaller of two: the deviation of its pose, and that of the drive errors that would explain it, or of what they
    leave. Near a singular pose the first is large for a sound row, but not the second.
    """
    (terms, pose), floors = aligned.smooth, aligned.floors
    in_pose = np.max([unexplained(terms, pose[:, k], floor) for k, floor in enumerate(floors)], axis=0)
    drives, residual = _by_drives(aligned)
    by_drives = [unexplained(terms, errors, floors[0]) for errors in drives.T]
    by_residual = [unexplained(terms, residual[:, k], floor) for k, floor in enumerate(floors)]
    return np.asarray(np.minimum(in_pose, np.max([*by_drives, *by_residual], axis=0)), dtype=np.float64)


def _by_drives(aligned: Aligned) -> tuple[FloatArray, FloatArray]:
    """Return the drive errors that explain each row best, and the residuals they leave; see :func:`drive_errors`."""
    from_base = OuterFrames(pin.SE3.Identity(), aligned.fit.frames.T_end_target)
    local = drive_parameters(aligned.drawing.mechanism)
    effect = target_effect(aligned.drawing, aligned.data.drives, from_base, local)
    return drive_errors(
        effect, [drive.unit for drive in local], aligned.smooth[1], aligned.floors[0] / aligned.floors[-1]
    )


def _beyond_joints(aligned: Aligned, rows: Indices) -> FloatArray:
    """Return how far rows (k,) are from what errors of all joints explain, (k,), in robust deviations.

    A deviation is that of the component after errors of joints, or after smooth errors where these explain more, as
    where drives are off. Infinite where the campaign is too short for this; of a long one some rows suffice.
    """
    (smooth, pose), floors = aligned.smooth, aligned.floors
    used = np.union1d(rows, evenly_spaced(len(pose), TELLING_ROWS))
    terms = aligned.joint_terms(used).reshape(used.size * len(floors), -1)
    residual = pose[used] / floors
    known = np.isfinite(terms).all(axis=1) & np.isfinite(residual.ravel())
    if known.sum() < ROWS_PER_TERM * np.linalg.matrix_rank(terms[known]):
        return np.full(rows.size, np.inf)
    _, remaining, _ = robust_fit(terms, residual.ravel(), 1.0)
    scores = []
    for k, floor in enumerate(floors):
        size, deviation = sized(remaining.reshape(residual.shape)[:, k], 1.0)
        near = leftover(smooth, pose[:, k], floor)[1] / floor
        scores.append(size / min(deviation, near))
    return np.asarray(np.max(scores, axis=0)[np.searchsorted(used, rows)])


def _gross_error(campaign: Campaign, row: int, distance: float, angle: float, score: float, far: bool) -> DataFlag:
    names, off = _off(campaign, distance, angle)
    metrics = {"distance_mm": distance / MM, "angle_mrad": angle / MRAD, "deviations": score}
    code, said = (
        FlagCode.UNREACHABLE_POSE,
        f"the measured pose cannot belong to these drive values: it is {off} from theirs",
    )
    if not far:
        others = f"{score:.0f} robust standard deviations from what the other rows predict"
        code, said = FlagCode.OUTLIER, f"gross error: {off} from the nominal robot, {others}"
    return flagged(campaign, code, f"line {campaign.lines[row]}: {said}", [row], names, metrics)


def _off(campaign: Campaign, distance: float, angle: float) -> tuple[tuple[str, ...], str]:
    """Return the columns of a measured pose that is off by so much, in m and rad, and how far, in words."""
    turned = (columns.ROTATION, f" and {angle / MRAD:.3g} mrad") if campaign.full_pose else ((), "")
    return (*columns.POSITION, *turned[0]), f"{distance / MM:.3g} mm{turned[1]}"


def _belonging_elsewhere(campaign: Campaign, rows: Indices, distance: float, angle: float) -> DataFlag:
    """Return the finding of rows (k,) so many that they mask each other where rows are judged by the others."""
    names, off = _off(campaign, distance, angle)
    message = (
        f"drives and measurements do not agree in {len(rows)} rows: {where(campaign, rows)} differ from the nominal "
        f"robot by {off} (medians); the others agree with it"
    )
    metrics = {"distance_mm": distance / MM, "angle_mrad": angle / MRAD}
    return flagged(campaign, FlagCode.NO_AGREEMENT, message, rows, names, metrics)


def _not_together(data: Comparison, fit: FrameFit, rows: Indices, metres_per_rad: float) -> Indices:
    """Return rows (k,) without those, a tenth of all or more, that frames of their own explain.

    There tracker or target was moved, once or several times.
    """
    fewest = max(JUMP_WINDOW, len(data.poses) // 10)
    if rows.size < fewest:
        return rows
    try:
        own = data[rows].fit(metres_per_rad)
    except FrameFitError:  # too few whole positions
        return rows
    before, after = _sizes(fit, metres_per_rad), _sizes(own, metres_per_rad)
    apart = after > np.minimum(before[rows] / _TIMES_BETTER, 2.0 * GROSS_SIGMAS * np.median(before))
    if np.count_nonzero(~apart) >= fewest:
        return _not_together(data, fit, rows[apart], metres_per_rad)
    halves = np.array_split(rows, 2) if rows.size >= 2 * fewest else []
    return np.concatenate([_not_together(data, fit, half, metres_per_rad) for half in halves]) if halves else rows


def _sizes(fit: FrameFit, metres_per_rad: float) -> FloatArray:
    """Return the residual of each row after fitting frames, (n,), in m, an angle as the length of equal weight."""
    turn = 0.0 if fit.rotation_residual_rad is None else np.nan_to_num(fit.rotation_residual_rad)
    residual = np.hypot(np.nan_to_num(fit.position_residual_m), metres_per_rad * turn)
    return np.asarray(np.linalg.norm(residual, axis=1))
