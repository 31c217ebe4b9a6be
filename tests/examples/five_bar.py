"""The five-bar in closed form: circles that meet, in the plane z = 0. Units: m, rad."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

BASE = np.array([[-0.15, 0.0], [0.15, 0.0]])
CRANK = np.array([0.25, 0.25])
COUPLER = np.array([0.39, 0.39])


def forward(
    drives: Array, base: Array | float = 0.0, crank: Array | float = 0.0, coupler: Array | float = 0.0
) -> tuple[Array, Array]:
    """Return position (n, 3) and rotation (n, 3, 3) of the tool for crank angles from +y, shape (n, 2).

    Args:
        drives: left and right crank angle, counted anticlockwise.
        base: by how much the drives' centres are displaced, shape (2, 2).
        crank: how much longer the cranks are, shape (2,) or (n, 2).
        coupler: likewise, the couplers.
    """
    elbows = BASE + base + (CRANK + crank)[..., None] * np.stack([-np.sin(drives), np.cos(drives)], axis=-1)
    across = elbows[:, 1] - elbows[:, 0]
    distance = np.linalg.norm(across, axis=1)
    first, second = np.broadcast_to(COUPLER + coupler, drives.shape).T
    foot = (first**2 - second**2 + distance**2) / (2.0 * distance)
    along = across / distance[:, None]
    ahead = np.stack([-along[:, 1], along[:, 0]], axis=1)
    arm = foot[:, None] * along + np.sqrt(first**2 - foot**2)[:, None] * ahead
    angle = np.arctan2(-arm[:, 0], arm[:, 1])
    position = np.zeros((len(drives), 3))
    position[:, :2] = elbows[:, 0] + arm
    rotation = np.tile(np.eye(3), (len(drives), 1, 1))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(angle)
    rotation[:, 1, 0] = np.sin(angle)
    rotation[:, 0, 1] = -rotation[:, 1, 0]
    return position, rotation


def inverse(tip: Array) -> Array:
    """Return the crank angles that put the tool at points in the plane, elbows outwards; (n, 2) to (n, 2)."""
    reach = tip[:, None, :] - BASE
    distance = np.linalg.norm(reach, axis=-1)
    corner = np.arccos((CRANK**2 + distance**2 - COUPLER**2) / (2.0 * CRANK * distance))
    return np.asarray(np.arctan2(-reach[..., 0], reach[..., 1]) + np.array([1.0, -1.0]) * corner)


def targets(random: np.random.Generator, count: int) -> Array:
    """Return drive values of points spread over the working area, shape (count, 2)."""
    return inverse(random.uniform([-0.18, 0.36], [0.18, 0.54], size=(count, 2)))
