"""View factors from small plane or cylindrical elements to a disc, and what a frame of bars hides of the disc.

All lengths in m, in a frame with the disc's centre at the origin and the disc in the plane z = 0, radiating into the
half-space z > 0.

Unhidden factors are exact: the area integral over the disc is turned into one along its outline (Sparrow's contour
integration), F = -1/(2π) n · ∮ (r × dr)/|r|², which has a closed form on a circle. Where the element's own horizon cuts
the disc, the outline is the arc above the horizon and the chord that closes it. For parallel and perpendicular
elements this gives the published forms B-12 to B-14 of Howell's catalogue of configuration factors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.network.view_kernels import unhidden_factors, visible_shares


def element_to_disc(points_m: FloatArray, normals: FloatArray, radius_m: float) -> FloatArray:
    """Return the view factor from plane elements to a disc with nothing in between.

    Args:
        points_m: where the elements are, shape (..., 3), in m.
        normals: unit normals of their radiating sides, shape (..., 3), broadcast against the points.
        radius_m: of the disc.

    Returns:
        Shape (...): 0 to 1; zero behind the disc (z <= 0) and for elements turned away.
    """
    points, turned = np.broadcast_arrays(np.asarray(points_m, dtype=float), np.asarray(normals, dtype=float))
    factors = np.empty(points.shape[:-1])
    points, turned = (np.ascontiguousarray(array).reshape(-1, 3) for array in (points, turned))
    unhidden_factors(points, turned, radius_m, factors.reshape(-1))
    return factors


@dataclass(frozen=True, eq=False)
class DiscChords:
    """Parallel chords that stand for a disc; along neither axis, so that no edge of a bar runs along one.

    Attributes:
        radius_m: of the disc.
        chords_m: how far from the middle, half the length and the weight of each, shape (C, 3), in m.
        way: direction of the chords in x and y.
    """

    radius_m: float
    chords_m: FloatArray
    way: tuple[float, float]

    @classmethod
    def of(cls, radius_m: float, count: int = 24) -> DiscChords:
        """Cut a disc by Gauss's rule for a half circle: ∫ √(1-v²) f dv = π/(C+1) Σ sin² f(cos)."""
        angles = np.pi * np.arange(1, count + 1) / (count + 1)
        sines = np.sin(angles)
        parts = np.cos(angles), sines, np.pi / (count + 1) * sines
        return cls(radius_m, radius_m * np.stack(parts, axis=-1), (np.cos(0.4), np.sin(0.4)))


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes with edges along the axes of the disc's frame, in m.

    Attributes:
        lower_m: their lower corners, shape (N, 3).
        upper_m: their upper corners, shape (N, 3).
    """

    lower_m: FloatArray
    upper_m: FloatArray


def visible_share(points_m: FloatArray, normals: FloatArray, disc: DiscChords, boxes: Boxes) -> FloatArray:
    """Return which share of its unhidden view factor an element keeps behind boxes.

    Multiplied by :func:`element_to_disc`, the share carries the error of the chords only where something is hidden.

    Args:
        points_m: the elements, shape (N, 3), in m; here the lines of sight start.
        normals: M normals for each element, shape (N, M, 3).
        disc: what is seen.
        boxes: what hides it.

    Returns:
        Shape (N, M), 0 to 1.
    """
    share, chords, count = np.empty(normals.shape[:2]), len(disc.chords_m), len(boxes.lower_m)
    facets = normals.shape[1]
    room = (
        np.empty((2, 5, 2)),
        np.empty((chords, count, 2)),
        np.empty(chords, dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty((facets, 2)),
        np.empty((2, facets)),
    )
    points, normals = np.ascontiguousarray(points_m), np.ascontiguousarray(normals)
    visible_shares(points, normals, disc.radius_m, disc.chords_m, disc.way, boxes.lower_m, boxes.upper_m, room, share)
    return share


def hidden_view_factors(
    facets_m: FloatArray, middles_m: FloatArray, normals: FloatArray, disc: DiscChords, boxes: Boxes
) -> FloatArray:
    """Return view factors of elements with several facets each, boxes in between.

    Args:
        facets_m: where the facets are, shape (N, M, 3), in m.
        middles_m: where the line of sight starts that serves all facets of an element, shape (N, 3): thin or far
            elements need no more.
        normals: shape (N, M, 3).
        disc: what is seen.
        boxes: what hides it.

    Returns:
        Shape (N, M), 0 to 1.
    """
    factors = element_to_disc(facets_m, normals, disc.radius_m)
    seen = factors.any(axis=1)
    if seen.any():
        factors[seen] *= visible_share(middles_m[seen], normals[seen], disc, boxes)
    return factors
