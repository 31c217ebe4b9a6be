"""Targets that were held at one place while the drives moved, as a ball in a socket or a pin in a hole."""

from collections.abc import Sequence

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.estimation.noise import alike
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.robot.description.drawing import Drawing

_SAME_PLACE_M = 1e-9  # more than rounding adds to a place, and finer than any device reads
_MOVED = 1e-3  # m or rad; drives that differ by more have moved
_TOGETHER = 0.2  # share of the target's motion by drives independent of each other, below which they work together
_LEAST_SHARE = 0.5  # share of the rows at a place that must have a pose


def held_rows(campaign: Campaign, drawing: Drawing, poses: PoseStack) -> list[Indices]:
    """Return the rows at each place where the drives together kept the target, by the drawing; else none.

    Readings are also equal to the last digit where a sensor hung. Then the drives moved independently, and move the
    target as far as if the values of each were permuted among the rows there. ``poses`` are the nominal ones for the
    campaign's drives, (n,).
    """
    places = _places(campaign)
    if not places:
        return []
    offset, target = _from_one_place(poses, places)
    drives, far, rows = np.array(campaign.drives), np.full_like(offset, np.nan), np.concatenate(places)
    for own in places:
        steps = np.arange(drives.shape[1]) * own.size // drives.shape[1]
        drives[own] = np.column_stack([np.roll(one, step) for one, step in zip(drives[own].T, steps, strict=True)])
    apart = nominal_poses(drawing, drives[rows])
    far[rows] = apart.position_m + apart.rotation @ target
    return places if _spread(offset, places) < _TOGETHER * _spread(far, places) else []


def at_one_place(campaign: Campaign, poses: PoseStack) -> PoseStack:
    """Return poses (n,) that keep the target at one place in the rows that state one place.

    The scatter of the nominal poses there is the robot's error itself, not a cause of it.
    """
    return PoseStack(poses.position_m - _from_one_place(poses, _places(campaign))[0], poses.rotation)


def _places(campaign: Campaign) -> list[Indices]:
    """Return the rows of a session that are stated to be at one place, reached with different drives each time.

    None where most rows have a place of their own: a device read these, and hung in the others. Drives that move along
    a line nearly turn the target about some point, and would pass for a ball held there.
    """
    whole = np.flatnonzero(campaign.position_measured.all(axis=1) & np.isfinite(campaign.drives).all(axis=1))
    counted = np.round(campaign.position_m[whole] / _SAME_PLACE_M).astype(np.int64)
    found = [rows for rows in alike(campaign, whole, counted) if np.ptp(campaign.drives[rows], axis=0).max() > _MOVED]
    return found if 2 * sum(rows.size for rows in found) >= whole.size else []


def _from_one_place(poses: PoseStack, places: Sequence[Indices]) -> tuple[FloatArray, FloatArray]:
    """Return the target's offset from one place, (n, 3), in m, and the point of the tool that minimises it, (3,), in m.

    0 in rows of no place, NaN without pose.
    """
    offset, middles, known = 0.0 * poses.position_m, np.zeros_like(poses.rotation), poses.complete
    for rows in (own[known[own]] for own in places):
        if rows.size:
            offset[rows] = poses.position_m[rows] - poses.position_m[rows].mean(axis=0)
            middles[rows] = poses.rotation[rows] - poses.rotation[rows].mean(axis=0)
    target = np.linalg.lstsq(middles.reshape(-1, 3), -np.nan_to_num(offset).ravel(), rcond=1e-9)[0]
    return offset + middles @ target, np.asarray(target, dtype=np.float64)


def _spread(target: FloatArray, places: Sequence[Indices]) -> float:
    """Return the median distance of the target, (n, 3), from its mean at each place; NaN: too few are known."""
    known = np.isfinite(target[:, 0])
    there = [target[rows[known[rows]]] for rows in places if known[rows].any()]
    if sum(map(len, there)) < _LEAST_SHARE * sum(map(len, places)):
        return np.nan
    return float(np.median(np.linalg.norm(np.concatenate([own - own.mean(axis=0) for own in there]), axis=1)))
