"""Rows that repeat a pose, and how far what was measured of them scatters."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.data import Campaign
from pouring_robot.estimation.noise import LEAST_NOISE, Noise
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.mechanism.arrays import FloatArray, Indices

_FEWEST_FREEDOMS = 12
_SAME_DRIVE = 1e-6  # m or rad: the last digit of a campaign file


def commands(drives: FloatArray) -> NDArray[np.int64]:
    """Return commanded drives (n, D), in m and rad, as whole numbers that are equal where the command is the same."""
    return np.round(drives / _SAME_DRIVE).astype(np.int64)


def repeats(campaign: Campaign, rows: Indices) -> list[Indices]:
    """Return the rows that were commanded alike, in the same session and from the same side: groups of two or more."""
    drives = commands(campaign.drives[rows])
    approach = np.zeros((rows.size, 1)) if campaign.approach is None else np.nan_to_num(campaign.approach[rows])
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, row in enumerate(rows.tolist()):
        key = (campaign.sessions[row], *drives[k].tolist(), *approach[k].tolist())
        groups.setdefault(key, []).append(row)
    return [np.array(members, dtype=np.intp) for members in groups.values() if len(members) > 1]


def repeat_noise(measured: MeasuredPoses, groups: list[Indices]) -> tuple[Noise | None, Noise | None]:
    """Return the scatter of repeats about their means, of positions and of rotations; None with under 12 freedoms."""
    sums, freedoms = np.zeros(2), np.zeros(2)
    for rows in groups:
        for column in measured.position_m[rows].T:
            values = column[np.isfinite(column)]
            if values.size > 1:
                sums[0] += float(((values - values.mean()) ** 2).sum())
                freedoms[0] += values.size - 1
        turned = measured.rotation[rows][np.isfinite(measured.rotation[rows]).all(axis=(1, 2))]
        if len(turned) > 1:
            stack = Rotation.from_matrix(turned)
            sums[1] += float(((stack * stack.mean().inv()).as_rotvec() ** 2).sum())
            freedoms[1] += 3 * (len(turned) - 1)
    found = [
        Noise(float(np.sqrt(total / freedom)), "repeats", float(freedom))
        if freedom >= _FEWEST_FREEDOMS and total > freedom * LEAST_NOISE**2  # exact repeats do not tell the noise
        else None
        for total, freedom in zip(sums, freedoms, strict=True)
    ]
    return found[0], found[1]
