"""The delta in closed form: three spheres that meet. Its platform only translates. Units: m, rad."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tests.examples.drawing import ALUMINIUM, ball_kg, bar_kg, slope

Array = npt.NDArray[np.float64]

AZIMUTH = 2.0 * np.pi / 3.0 * np.arange(3)
OUTWARDS = np.stack([np.cos(AZIMUTH), np.sin(AZIMUTH), np.zeros(3)], axis=1)
BASE = 0.20 * OUTWARDS
PLATFORM = 0.05 * OUTWARDS
UPPER = np.full(3, 0.30)
FORE = np.full(3, 0.75)


def forward(
    drives: Array,
    base: Array | float = 0.0,
    platform: Array | float = 0.0,
    upper: Array | float = 0.0,
    fore: Array | float = 0.0,
) -> tuple[Array, Array]:
    """Return position (n, 3) and rotation (n, 3, 3) of the platform for arm angles below the level, shape (n, 3).

    Args:
        drives: angle of each upper arm, downwards.
        base: by how much the drives' centres are displaced, shape (3, 3).
        platform: likewise, the joints on the platform, shape (3, 3).
        upper: how much longer the upper arms are, shape (3,) or (n, 3).
        fore: likewise, the forearms.
    """
    down = np.array([0.0, 0.0, -1.0])
    arms = (UPPER + upper)[..., None] * (np.cos(drives)[..., None] * OUTWARDS + np.sin(drives)[..., None] * down)
    centres = BASE + base + arms - (PLATFORM + platform)
    radius = np.broadcast_to(FORE + fore, drives.shape)
    # The origin moves to the first centre, x to the second one, and the third lies in the plane z = 0.
    second, third = centres[:, 1] - centres[:, 0], centres[:, 2] - centres[:, 0]
    width = np.linalg.norm(second, axis=1)
    x_axis = second / width[:, None]
    shift = np.sum(x_axis * third, axis=1)
    rest = third - shift[:, None] * x_axis
    height = np.linalg.norm(rest, axis=1)
    y_axis = rest / height[:, None]
    z_axis = np.cross(x_axis, y_axis)
    x = (radius[:, 0] ** 2 - radius[:, 1] ** 2 + width**2) / (2.0 * width)
    y = (radius[:, 0] ** 2 - radius[:, 2] ** 2 + shift**2 + height**2 - 2.0 * shift * x) / (2.0 * height)
    z = -np.sqrt(radius[:, 0] ** 2 - x**2 - y**2) * np.sign(z_axis[:, 2])  # of both points the lower one
    position = centres[:, 0] + x[:, None] * x_axis + y[:, None] * y_axis + z[:, None] * z_axis
    return position, np.tile(np.eye(3), (len(drives), 1, 1))


def inverse(position: Array) -> Array:
    """Return the arm angles that put the platform at points, elbows outwards; (n, 3) to (n, 3)."""
    reach = position[:, None, :] + PLATFORM - BASE
    level, drop = np.sum(reach * OUTWARDS, axis=-1), -reach[..., 2]
    share = (np.sum(reach**2, axis=-1) + UPPER**2 - FORE**2) / (2.0 * UPPER)
    return np.asarray(np.arctan2(drop, level) - np.arccos(share / np.hypot(level, drop)))


def weight(drives: Array, payload: Array) -> Array:
    """Return the torque of gravity on each drive, shape (n, 3), in Nm, with a payload (n,) in kg at the gripper."""
    upper_kg, fore_kg = bar_kg(ALUMINIUM, 0.016, UPPER[0]), bar_kg(ALUMINIUM, 0.007, FORE[0])
    end_kg = bar_kg(ALUMINIUM, 0.06, 0.012) + bar_kg(ALUMINIUM, 0.008, 0.06) + 6.0 * ball_kg(0.010)

    def height_kg(angles: Array) -> Array:
        elbows, platform = -UPPER * np.sin(angles), forward(angles)[0][:, 2]
        arms = (upper_kg / 2.0 + fore_kg / 2.0 + ball_kg(0.012)) * elbows.sum(axis=1)
        return np.asarray(arms + (1.5 * fore_kg + end_kg + payload) * platform)

    return -slope(height_kg, drives)


def targets(random: np.random.Generator, count: int) -> Array:
    """Return drive values of points spread over a cylinder below the base, shape (count, 3)."""
    radius, angle = 0.25 * np.sqrt(random.uniform(size=count)), random.uniform(0.0, 2.0 * np.pi, size=count)
    height = random.uniform(-0.78, -0.55, size=count)
    return inverse(np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1))
