"""The hexapod: leg lengths in closed form, its pose by least squares on them. Units: m, rad."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]

HOME = np.array([0.0, 0.0, 0.70])


def _circle(radius: float, degrees: tuple[float, ...]) -> Array:
    angle = np.radians(degrees)
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(6)], axis=1)


BASE = _circle(0.45, (-12.0, 12.0, 108.0, 132.0, 228.0, 252.0))
TABLE = _circle(0.30, (-48.0, 48.0, 72.0, 168.0, 192.0, 288.0))
LENGTH = np.linalg.norm(HOME + TABLE - BASE, axis=1)
"""Of each leg at zero."""


def inverse(position: Array, rotation: Array) -> Array:
    """Return how much longer each leg is than at zero, shape (n, 6), for poses (n, 3) and (n, 3, 3)."""
    legs = position[:, None, :] + np.einsum("nij,kj->nki", rotation, TABLE) - BASE
    return np.asarray(np.linalg.norm(legs, axis=-1) - LENGTH)


def forward(
    drives: Array, base: Array | float = 0.0, table: Array | float = 0.0, leg: Array | float = 0.0
) -> tuple[Array, Array]:
    """Return position (n, 3) and rotation (n, 3, 3) of the table for strokes of the legs, shape (n, 6).

    Args:
        drives: how much longer each leg is commanded than at zero.
        base: by how much the joint centres on the base are displaced, shape (6, 3).
        table: likewise, those on the table.
        leg: how much longer the legs are than commanded, shape (6,) or (n, 6).
    """
    anchors, feet = BASE + base, TABLE + table
    lengths = np.broadcast_to(LENGTH + leg, drives.shape) + drives
    poses = np.array([_pose(anchors, feet, wanted) for wanted in lengths])
    return poses[:, :3], np.asarray(Rotation.from_rotvec(poses[:, 3:]).as_matrix())


def _pose(anchors: Array, feet: Array, lengths: Array) -> Array:
    """Return position and rotation vector with legs of these lengths."""

    def gaps(pose: Array) -> Array:
        legs = pose[:3] + feet @ Rotation.from_rotvec(pose[3:]).as_matrix().T - anchors
        return np.asarray(np.linalg.norm(legs, axis=1) - lengths)

    start = np.array([0.0, 0.0, HOME[2] + np.mean(lengths - LENGTH), 0.0, 0.0, 0.0])
    found = least_squares(gaps, start, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    if np.abs(found.fun).max() > 1e-12:
        raise ValueError(f"legs of {lengths} m do not fit")
    return np.asarray(found.x)


def targets(random: np.random.Generator, count: int) -> Array:
    """Return drive values of poses spread over the workspace, shape (count, 6)."""
    position = HOME + random.uniform([-0.10, -0.10, -0.06], [0.10, 0.10, 0.08], size=(count, 3))
    rotation = Rotation.from_rotvec(random.uniform(-0.20, 0.20, size=(count, 3))).as_matrix()
    return inverse(position, rotation)
