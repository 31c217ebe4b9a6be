"""Masses of the bodies of the example robots, from their radii and lengths. Units: m, kg, N."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

GRAVITY = 9.80665
ALUMINIUM, STEEL = 2700.0, 7850.0


def bar_kg(density: float, radius: float, length: float) -> float:
    """Return the mass of a round bar or disc."""
    return float(density * np.pi * radius**2 * length)


def ball_kg(radius: float) -> float:
    """Return the mass of a steel ball."""
    return float(STEEL * 4.0 / 3.0 * np.pi * radius**3)


def slope(height_kg: Callable[[Array], Array], at: Array, step: float = 1e-5) -> Array:
    """Return how potential energy, of masses times heights (n,), rises with each coordinate, shape (n, k)."""
    moves = step * np.eye(at.shape[1])
    return GRAVITY / (2.0 * step) * np.stack([height_kg(at + m) - height_kg(at - m) for m in moves], axis=1)
