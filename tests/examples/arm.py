"""The six-axis arm: forward a chain of rotations, inverse in closed form by its spherical wrist. Units: m, rad."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tests.examples.drawing import ALUMINIUM, STEEL, ball_kg, bar_kg, slope

Array = npt.NDArray[np.float64]

AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]])
COLUMN, SHOULDER, UPPER, ELBOW, FORE, WRIST = 0.45, 0.15, 0.60, 0.12, 0.62, 0.10
ORIGINS = np.array(
    [[0, 0, COLUMN], [SHOULDER, 0, 0], [0, 0, UPPER], [FORE / 2, 0, ELBOW], [FORE / 2, 0, 0], [WRIST, 0, 0]]
)
"""Of each joint in the one before it."""


MASSES = np.array(
    [
        0.0,  # the turret stays at its height
        bar_kg(ALUMINIUM, 0.075, UPPER),
        bar_kg(ALUMINIUM, 0.065, float(np.hypot(FORE / 2, ELBOW))),
        bar_kg(ALUMINIUM, 0.045, FORE / 2),
        ball_kg(0.050),
        bar_kg(STEEL, 0.035, 0.03),
    ]
)
CENTRES = np.array(
    [[0, 0, 0], [0, 0, UPPER / 2], [FORE / 4, 0, ELBOW / 2], [FORE / 4, 0, 0], [0, 0, 0], [-0.015, 0, 0]]
)
"""Centre of mass of what each joint carries, in the joint's frame."""


def _frames(drives: Array, origin: Array | float, tilt: Array | float) -> Iterator[tuple[Array, Array]]:
    """Yield position (n, 3) and rotation (n, 3, 3) behind each joint."""
    position, rotation = np.zeros((len(drives), 3)), np.tile(np.eye(3), (len(drives), 1, 1))
    places = np.broadcast_to(ORIGINS + origin, (len(drives), 6, 3))
    tilts = np.zeros((len(drives), 6, 3)) + tilt
    turns = Rotation.from_rotvec(tilts.reshape(-1, 3)).as_matrix().reshape(-1, 6, 3, 3)
    for k, axis in enumerate(AXES):
        position = position + np.einsum("nij,nj->ni", rotation, places[:, k])
        rotation = rotation @ turns[:, k] @ Rotation.from_rotvec(drives[:, k, None] * axis).as_matrix()
        yield position, rotation


def forward(drives: Array, origin: Array | float = 0.0, tilt: Array | float = 0.0) -> tuple[Array, Array]:
    """Return position (n, 3) and rotation (n, 3, 3) of the flange for joint angles, shape (n, 6).

    Args:
        drives: joint angles.
        origin: by how much the joints are displaced, in the joint before, shape (6, 3) or (n, 6, 3).
        tilt: rotation vector by which a joint's frame is turned, shape (6, 3) or (n, 6, 3).
    """
    *_, flange = _frames(drives, origin, tilt)
    return flange


def weight(drives: Array, payload: Array) -> Array:
    """Return the torque of gravity on each joint, shape (n, 6), in Nm, with a payload (n,) in kg at the flange."""
    return -slope(lambda angles: _height_kg(angles, 0.0, payload), drives)


def moments(drives: Array, payload: Array) -> Array:
    """Return the torque of gravity on each joint across its axis, shape (n, 6, 3), in Nm; see :func:`weight`."""
    still = np.zeros((len(drives), 18))
    found = -slope(lambda turned: _height_kg(drives, turned.reshape(-1, 6, 3), payload), still)
    return np.asarray(found.reshape(-1, 6, 3) * (1 - AXES))


def _height_kg(drives: Array, tilt: Array | float, payload: Array) -> Array:
    """Return the height of every part and of the payload times its mass, together, (n,)."""
    frames = list(_frames(drives, 0.0, tilt))
    own = sum(m * (p + R @ c)[:, 2] for m, c, (p, R) in zip(MASSES, CENTRES, frames, strict=True))
    return np.asarray(own + payload * frames[-1][0][:, 2])


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
