"""Targets that were held at one place while the drives moved, as a ball in a socket or a pin in a hole."""

from collections.abc import Iterator

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.robot.description.drawing import Drawing

LONGEST_RUN = 4  # rows whose readings, which are noisy, are not alike to the last digit by chance
_TOGETHER = 0.2  # drives that keep the target within this share of what they do each by itself work together
_FEWEST = 0.5  # share of a run that must have a pose


def runs_of(same: BoolArray, longest: int) -> Iterator[Indices]:
    """Yield the rows of every run of ``longest`` or more in which each step ``same[i]`` (row i to i+1) is set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    for start, end in edges.reshape(-1, 2):
        if end - start + 1 >= longest:
            yield np.arange(start, end + 1)


def moved(campaign: Campaign) -> BoolArray:
    """Return whether drives moved from each row to the next, (n - 1,)."""
    return np.asarray(np.abs(np.diff(campaign.drives, axis=0)).max(axis=1) > 1e-3)


def held_rows(campaign: Campaign, drawing: Drawing, poses: PoseStack) -> list[Indices]:
    """Return the runs of rows in which the drives together kept the target where it is stated to be, by the drawing.

    In a run the place is the same to the last digit. That a sensor hung is the other reason: then the drives moved as
    they liked, and take the target as far as where each has the values that it had in other rows of the run. ``poses``
    are those of the drawing for the drives of the campaign, (n,).
    """
    runs = _runs(campaign)
    left, target = _from_one_place(poses, runs)
    if target is None:
        return []
    drives = np.array(campaign.drives)
    for rows in runs:
        steps = np.arange(drives.shape[1]) * rows.size // drives.shape[1]
        drives[rows] = np.column_stack([np.roll(own, step) for own, step in zip(drives[rows].T, steps, strict=True)])
    within, far = np.concatenate(runs), np.full_like(left, np.nan)
    apart = nominal_poses(drawing, drives[within])
    far[within] = apart.position_m + apart.rotation @ target
    return [rows for rows in runs if _spread(left[rows]) < _TOGETHER * _spread(far[rows])]


def at_one_place(campaign: Campaign, poses: PoseStack) -> PoseStack:
    """Return poses (n,) that keep the target at one place in each run of rows in which it is stated to be at one.

    How far those of the drawing scatter there is the robot's error itself, and no cause of it.
    """
    return PoseStack(poses.position_m - _from_one_place(poses, _runs(campaign))[0], poses.rotation)


def _runs(campaign: Campaign) -> list[Indices]:
    """Return the runs of rows of a session whose place is the same to the last digit while drives move.

    None where most rows have a place of their own: these were read by a device, which hung in the others. Drives that
    move along a line turn the target about some point nearly, and would pass for a ball that sits there.
    """
    sessions, moving = np.array(campaign.sessions), moved(campaign)
    same = (np.diff(campaign.position_m, axis=0) == 0.0).all(axis=1) & (sessions[1:] == sessions[:-1])
    again = sum(rows.size for rows in runs_of(same, 2))
    if 2 * again < np.count_nonzero(campaign.position_measured.all(axis=1)):
        return []
    return [rows for rows in runs_of(same, LONGEST_RUN) if moving[rows[:-1]].any()]


def _from_one_place(poses: PoseStack, runs: list[Indices]) -> tuple[FloatArray, FloatArray | None]:
    """Return how far the target is from one place a run, (n, 3), in m, and where on the tool that is least, (3,), in m.

    0 in rows of no run and without pose; None where no run has poses enough.
    """
    left, middles = np.zeros_like(poses.position_m), np.zeros_like(poses.rotation)
    known = poses.complete
    members = [rows[known[rows]] for rows in runs if np.mean(known[rows]) >= _FEWEST]
    if not members:
        return left, None
    for rows in members:
        left[rows] = poses.position_m[rows] - poses.position_m[rows].mean(axis=0)
        middles[rows] = poses.rotation[rows] - poses.rotation[rows].mean(axis=0)
    target = np.asarray(np.linalg.lstsq(middles.reshape(-1, 3), -left.ravel(), rcond=1e-9)[0], dtype=np.float64)
    return left + middles @ target, target


def _spread(places: FloatArray) -> float:
    """Return the root mean square distance of places (n, 3) from their middle; NaN where too few are known."""
    known = places[np.isfinite(places).all(axis=1)]
    enough = len(known) >= _FEWEST * len(places)
    return float(np.sqrt(((known - known.mean(axis=0)) ** 2).sum(axis=1).mean())) if enough else np.nan
