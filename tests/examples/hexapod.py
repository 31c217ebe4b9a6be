"""The hexapod: leg lengths in closed form, its pose by Newton's method on them. Units: m, rad."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tests.examples.drawing import ALUMINIUM, STEEL, ball_kg, bar_kg, slope

Array = npt.NDArray[np.float64]

HOME = np.array([0.0, 0.0, 0.70])
_NEWTON_STEPS = 10


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
    return _poses(anchors, feet, lengths)


def _poses(anchors: Array, feet: Array, lengths: Array) -> tuple[Array, Array]:
    """Return positions and rotations with legs of these lengths, shape (n, 6), by Newton's method from level."""
    position, turn = np.zeros((len(lengths), 3)), Rotation.identity(len(lengths))
    position[:, 2] = HOME[2] + np.mean(lengths - LENGTH, axis=1)
    for _ in range(_NEWTON_STEPS):
        arms = feet @ np.swapaxes(turn.as_matrix(), 1, 2)
        legs = position[:, None] + arms - anchors
        size = np.linalg.norm(legs, axis=2)
        along = legs / size[..., None]
        slopes = np.concatenate([along, np.cross(arms, along)], axis=2)
        step = np.linalg.solve(slopes, (lengths - size)[..., None])[..., 0]
        position, turn = position + step[:, :3], Rotation.from_rotvec(step[:, 3:]) * turn
    if np.abs(step).max() > 1e-12:
        raise ValueError("some legs do not fit")
    return position, np.asarray(turn.as_matrix())


def weight(drives: Array, payload: Array) -> Array:
    """Return the force of gravity along each leg, shape (n, 6), in N, with a payload (n,) in kg on the table."""
    table_kg, barrel_kg = bar_kg(ALUMINIUM, 0.33, 0.02), bar_kg(ALUMINIUM, 0.022, 0.40)
    rods = LENGTH - 0.40 + 0.15
    position, rotation = forward(drives)
    turns = Rotation.from_matrix(rotation)

    def moved(twist: Array) -> tuple[Array, Array]:
        return position + twist[:, :3], (Rotation.from_rotvec(twist[:, 3:]) * turns).as_matrix()

    def height_kg(twist: Array) -> Array:
        place, axes = moved(twist)
        feet = place[:, None, 2] + axes[:, 2] @ TABLE.T
        rising = feet / (LENGTH + inverse(place, axes))  # of a leg's direction
        legs = barrel_kg * 0.20 * rising + 3.0 * ball_kg(0.016) * feet
        legs += bar_kg(STEEL, 0.012, 1.0) * rods * (feet - rods / 2.0 * rising)
        load = table_kg * 0.03 + payload * 0.10
        return np.asarray(legs.sum(axis=1) + (table_kg + payload) * place[:, 2] + load * axes[:, 2, 2])

    at, step = np.zeros((len(drives), 6)), 1e-5
    ways = [moved(sign * step * unit + at) for unit in np.eye(6) for sign in (1.0, -1.0)]
    lengths = np.stack([inverse(*way) for way in ways]).reshape(6, 2, len(drives), 6)
    jacobian = (lengths[:, 0] - lengths[:, 1]) / (2.0 * step)  # of legs by twists: (twist, n, leg)
    return np.asarray(-np.linalg.solve(jacobian.transpose(1, 0, 2), slope(height_kg, at)[..., None])[..., 0])


def targets(random: np.random.Generator, count: int) -> Array:
    """Return drive values of poses spread over the workspace, shape (count, 6)."""
    position = HOME + random.uniform([-0.10, -0.10, -0.06], [0.10, 0.10, 0.08], size=(count, 3))
    rotation = Rotation.from_rotvec(random.uniform(-0.20, 0.20, size=(count, 3))).as_matrix()
    return inverse(position, rotation)
