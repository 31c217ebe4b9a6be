"""The six-axis arm: a chain of rotations one way, its spherical wrist in closed form the other. Units: m, rad."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]

AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]])
COLUMN, SHOULDER, UPPER, ELBOW, FORE, WRIST = 0.45, 0.15, 0.60, 0.12, 0.62, 0.10
ORIGINS = np.array(
    [[0, 0, COLUMN], [SHOULDER, 0, 0], [0, 0, UPPER], [FORE / 2, 0, ELBOW], [FORE / 2, 0, 0], [WRIST, 0, 0]]
)
"""Of each joint in the one before it."""


def forward(drives: Array, origin: Array | float = 0.0, tilt: Array | float = 0.0) -> tuple[Array, Array]:
    """Return position (n, 3) and rotation (n, 3, 3) of the flange for joint angles, shape (n, 6).

    Args:
        drives: joint angles.
        origin: by how much the joints are displaced, in the joint before, shape (6, 3) or (n, 6, 3).
        tilt: rotation vector by which a joint's frame is turned, shape (6, 3).
    """
    position, rotation = np.zeros((len(drives), 3)), np.tile(np.eye(3), (len(drives), 1, 1))
    places = np.broadcast_to(ORIGINS + origin, (len(drives), 6, 3))
    turns = Rotation.from_rotvec(np.zeros((6, 3)) + tilt).as_matrix()
    for k, axis in enumerate(AXES):
        position = position + np.einsum("nij,nj->ni", rotation, places[:, k])
        rotation = rotation @ turns[k] @ Rotation.from_rotvec(drives[:, k, None] * axis).as_matrix()
    return position, rotation


def inverse(position: Array, rotation: Array) -> Array:
    """Return joint angles for poses of the flange, shape (n, 6): facing the target, elbow up, wrist bent downwards."""
    x, y, z = (position - WRIST * rotation[:, :, 0]).T
    first = np.arctan2(y, x)
    level, height, fore = np.hypot(x, y) - SHOULDER, z - COLUMN, np.hypot(FORE, ELBOW)
    bend = np.arccos((level**2 + height**2 - UPPER**2 - fore**2) / (2.0 * UPPER * fore))
    third = bend - np.arctan2(FORE, ELBOW)
    ahead = FORE * np.cos(third) + ELBOW * np.sin(third)
    above = UPPER - FORE * np.sin(third) + ELBOW * np.cos(third)
    second = np.arctan2(level, height) - np.arctan2(ahead, above)
    elbow = Rotation.from_euler("ZY", np.stack([first, second + third], axis=1)).as_matrix()
    wrist = Rotation.from_matrix(np.swapaxes(elbow, 1, 2) @ rotation).as_euler("XYX")
    return np.column_stack([first, second, third, wrist])


def targets(random: np.random.Generator, count: int) -> Array:
    """Return joint angles spread over the workspace in front of the robot, shape (count, 6)."""
    lower, upper = [-1.5, -0.6, -0.6, -1.8, 0.4, -2.8], [1.5, 0.8, 0.5, 1.8, 1.9, 2.8]
    return np.asarray(random.uniform(lower, upper, size=(count, 6)))
