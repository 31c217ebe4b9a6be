"""Jumps: places in a session from which on all measurements are shifted, as where tracker or target was moved."""

from collections.abc import Iterator

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, flagged
from pouring_robot.checks.smooth_errors import ROWS_PER_TERM, TELLING_ROWS, Aligned, robust_fit
from pouring_robot.estimation.noise import commands
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray, Indices, evenly_spaced

_JUMP_SIGMAS = 5.0
"""A step counts beyond this many deviations of one row; a steady drift, taken for a step, stays below three."""
JUMP_WINDOW = 10  # rows on either side that a step needs
_JUMP_PLACES = 400
_LARGE_JUMP_M, _LARGE_JUMP_RAD = 1e-3, 2e-3


def jumps(aligned: Aligned, wrong: Indices) -> Iterator[DataFlag]:
    """Yield the largest lasting step of each session's residuals, if there is a clear one."""
    campaign, (terms, pose) = aligned.campaign, aligned.smoothed(with_time=False)
    pose[wrong] = np.nan
    inliers = np.asarray(np.isfinite(pose).all(axis=1) & aligned.data.poses.complete)
    for session, members in campaign.rows_by_session().items():
        rows = members[inliers[members]]
        command = commands(campaign.drives[rows])
        # Readings repeated before the robot moves have the same errors of the pose: they say no more about a step.
        rows = rows[np.append(True, (np.diff(command, axis=0) != 0).any(axis=1))[: rows.size]]
        # With more terms than a quarter of the rows, they would explain any step.
        kept = terms[:, : max(1, rows.size // 4)]
        if rows.size >= 2 * JUMP_WINDOW:
            jump = _jump(campaign, session, rows, kept[rows], pose[rows], np.array(aligned.floors))
            if jump is not None and _beside_joints(aligned, pose, rows, jump.rows[0]):
                yield jump


def _jump(
    campaign: Campaign, session: str, rows: Indices, terms: FloatArray, pose: FloatArray, floors: FloatArray
) -> DataFlag | None:
    """Fit a step at every place along with the smooth terms, keep the one that explains most, and test it robustly."""
    places = np.unique(np.linspace(JUMP_WINDOW, len(rows) - JUMP_WINDOW, _JUMP_PLACES).astype(int))
    steps = (np.arange(len(rows))[:, None] >= places).astype(float)
    basis, _ = np.linalg.qr(terms)
    free_steps = steps - basis @ (basis.T @ steps)
    free_pose = (pose - basis @ (basis.T @ pose)) / floors
    power = np.maximum((free_steps**2).sum(axis=0), 1e-9)
    gain = ((free_steps.T @ free_pose) ** 2).sum(axis=1) / power
    best = int(np.argmax(gain))
    place = int(places[best])
    design = np.column_stack([terms, np.arange(len(rows)) >= place])
    fits = [robust_fit(design, pose[:, k], float(floors[k])) for k in range(pose.shape[1])]
    step = np.array([coefficients[-1] for coefficients, _, _ in fits])
    # Part of the step outside the smooth terms: in rows sorted by pose, pose may explain most of it.
    distinct = np.sqrt(power[best] / (place * (1.0 - place / len(rows))))
    size = float(distinct * max(abs(coefficients[-1]) / scale for coefficients, _, scale in fits))
    if size < _JUMP_SIGMAS:
        return None
    row, distance, angle = int(rows[place]), float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
    large = distance > _LARGE_JUMP_M or angle > _LARGE_JUMP_RAD
    turn = f" and {angle / MRAD:.3g} mrad" if pose.shape[1] > 3 else ""
    return flagged(
        campaign,
        FlagCode.MEASUREMENT_JUMP,
        f"from about line {campaign.lines[row]} on, all measurements are shifted by {distance / MM:.3g} mm{turn} "
        f"(session {session})",
        [row],
        columns.POSITION,
        {"step_mm": distance / MM, "step_mrad": angle / MRAD, "deviations": size},
        severity=Severity.WARNING if large else Severity.NOTE,
    )


def _beside_joints(aligned: Aligned, pose: FloatArray, rows: Indices, first: int) -> bool:
    """Return whether residuals of a session's rows (k,) step at row ``first`` also after errors of all joints.

    Where an arm changes its posture, the effects of joint errors step with it. A campaign too short to distinguish
    joints from a step counts as having one.
    """
    before, behind = rows[rows < first], rows[rows >= first]
    some = [side[evenly_spaced(side.size, TELLING_ROWS)] for side in (before, behind)]
    used, floors = np.union1d(np.concatenate(some), evenly_spaced(len(pose), TELLING_ROWS)), aligned.floors
    within = np.column_stack([np.isin(used, rows), np.isin(used, behind)]).astype(float)
    steps = within[:, None, :, None] * np.eye(len(floors))[:, None, :]
    terms = aligned.joint_terms(used)
    design = np.concatenate([terms, steps.reshape(used.size, len(floors), -1)], axis=2).reshape(pose[used].size, -1)
    values = (pose[used] / floors).ravel()
    known = np.isfinite(values) & np.isfinite(design).all(axis=1)
    if known.sum() < ROWS_PER_TERM * np.linalg.matrix_rank(design[known]):
        return True
    coefficients, _, scale = robust_fit(design, values, 1.0)
    count, after = within.sum(axis=0)
    variance = np.diag(np.linalg.pinv(design[known].T @ design[known], hermitian=True))[-len(floors) :]
    distinct = 1.0 / np.sqrt(variance * after * (1.0 - after / count))
    return bool((distinct * np.abs(coefficients[-len(floors) :]) > _JUMP_SIGMAS * scale).any())
