"""The noise of a campaign: as stated, or from repeats of a pose.

Where it is neither, a fit says what it leaves over: :func:`pouring_robot.estimation.solver.fit_with_noise`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.data import Campaign
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.mechanism.arrays import FloatArray

Source = Literal["stated", "repeats", "residuals", "none"]
_FEWEST_FREEDOMS = 12
_SAME_DRIVE = 1e-6  # m or rad: the last digit of a campaign file
_FIRST_GUESS_M, _FIRST_GUESS_RAD = 1e-3, 1e-3


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations of one measured component.

    Attributes:
        position_m: of a coordinate, in m.
        rotation_rad: of a rotation component, in rad.
        position_source: where the figure comes from; ``none``: nothing of it was measured.
        rotation_source: the same for rotations.
        position_freedoms: degrees of freedom of a figure from repeats, infinite for any other: see :attr:`freedoms`.
        rotation_freedoms: the same for rotations.
    """

    position_m: float
    rotation_rad: float
    position_source: Source
    rotation_source: Source
    position_freedoms: float = float("inf")
    rotation_freedoms: float = float("inf")

    @classmethod
    def stated(cls, position_m: float, rotation_rad: float | None) -> NoiseLevel:
        """Return the noise of a device; None: it measures positions only."""
        if rotation_rad is None:
            return cls(position_m, _FIRST_GUESS_RAD, "stated", "none")
        return cls(position_m, rotation_rad, "stated", "stated")

    @property
    def turned(self) -> bool:
        """Whether rotations were measured."""
        return self.rotation_source != "none"

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of each measured component of a pose, shape (6,) or (3,), in m and rad."""
        return np.repeat([self.position_m, self.rotation_rad] if self.turned else [self.position_m], 3)

    @property
    def freedoms(self) -> float:
        """Degrees of freedom behind the less well known figure, to judge a sum of squares by; infinite where stated.

        A noise that k repeats gave is itself uncertain, by 1 / sqrt(2 k): a sum of n squared residuals over its square
        follows n F(n, k), not chi-square(n). With fewer than about 100 freedoms chi-square takes chance for a gap.
        """
        return min(self.position_freedoms, self.rotation_freedoms)

    @property
    def from_residuals(self) -> bool:
        """Whether a figure is what the fit left over, so that it cannot serve to judge the fit."""
        return "residuals" in (self.position_source, self.rotation_source)


def repeats(campaign: Campaign, rows: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return the rows that were commanded alike, in the same session and from the same side: groups of two or more."""
    drives = np.round(campaign.drives[rows] / _SAME_DRIVE).astype(np.int64)
    approach = np.zeros((rows.size, 4)) if campaign.approach is None else np.nan_to_num(campaign.approach[rows])
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, row in enumerate(rows.tolist()):
        key = (campaign.sessions[row], *drives[k].tolist(), *approach[k].tolist())
        groups.setdefault(key, []).append(row)
    return [np.array(members, dtype=np.intp) for members in groups.values() if len(members) > 1]


def repeat_noise(
    measured: MeasuredPoses, groups: list[NDArray[np.intp]]
) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
    """Return the scatter of repeats about their means and its degrees of freedom, of positions and of rotations.

    Args:
        measured: all rows of the campaign.
        groups: rows commanded alike.

    Returns:
        Standard deviation in m and rad with its freedoms, each; None with fewer than 12 freedoms.
    """
    sums, freedoms = np.zeros(2), np.zeros(2)
    for rows in groups:
        position = measured.position_m[rows]
        counts = np.isfinite(position).sum(axis=0)
        for k in np.flatnonzero(counts > 1):
            values = position[np.isfinite(position[:, k]), k]
            sums[0] += float(((values - values.mean()) ** 2).sum())
            freedoms[0] += values.size - 1
        turned = measured.rotation[rows][np.isfinite(measured.rotation[rows]).all(axis=(1, 2))]
        if len(turned) > 1:
            stack = Rotation.from_matrix(turned)
            sums[1] += float(((stack * stack.mean().inv()).as_rotvec() ** 2).sum())
            freedoms[1] += 3 * (len(turned) - 1)
    found = [
        (float(np.sqrt(total / freedom)), float(freedom)) if freedom >= _FEWEST_FREEDOMS and total > 0.0 else None
        for total, freedom in zip(sums, freedoms, strict=True)
    ]
    return found[0], found[1]


def stated_noise(campaign: Campaign, rows: NDArray[np.intp]) -> NoiseLevel:
    """Return the noise that metadata or repeats tell; ``residuals`` with a first guess where neither does.

    Args:
        campaign: the data.
        rows: the rows that may be looked at.
    """
    blank = MeasuredPoses.from_campaign(campaign, 1.0, 1.0)
    from_repeats = repeat_noise(blank, repeats(campaign, rows))
    metadata = campaign.metadata
    chosen: list[tuple[float, Source, float]] = []
    for given, seen, guess in (
        (metadata.sigma_position_m, from_repeats[0], _FIRST_GUESS_M),
        (metadata.sigma_rotation_rad, from_repeats[1], _FIRST_GUESS_RAD),
    ):
        if given is not None:
            chosen.append((given, "stated", float("inf")))
        elif seen is not None:
            chosen.append((seen[0], "repeats", seen[1]))
        else:
            chosen.append((guess, "residuals", float("inf")))
    if not campaign.rotation_measured.any():
        chosen[1] = (chosen[1][0], "none", float("inf"))
    (position, position_source, known), (rotation, rotation_source, turned) = chosen
    return NoiseLevel(position, rotation, position_source, rotation_source, known, turned)
