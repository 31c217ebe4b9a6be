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

    Points and unit normals of the radiating sides are of shape (..., 3) and are broadcast; the factors, shape (...),
    are zero behind the disc (z <= 0) and for elements turned away.
    """
    points, turned = np.broadcast_arrays(np.asarray(points_m, dtype=float), np.asarray(normals, dtype=float))
    factors = np.empty(points.shape[:-1])
    points, turned = (np.ascontiguousarray(array).reshape(-1, 3) for array in (points, turned))
    unhidden_factors(points, turned, radius_m, factors.reshape(-1))
    return factors


@dataclass(frozen=True, eq=False)
class DiscChords:
    """Parallel chords that stand for a disc; along neither axis, so that no edge of a bar runs along one."""

    radius_m: float  # of the disc
    chords_m: FloatArray  # how far from the middle, half the length and the weight of each, shape (C, 3), in m
    way: tuple[float, float]  # direction of the chords in x and y

    @classmethod
    def of(cls, radius_m: float, count: int = 24) -> DiscChords:
        """Cut a disc by Gauss's rule for a half circle: ∫ √(1-v²) f dv = π/(C+1) Σ sin² f(cos)."""
        angles = np.pi * np.arange(1, count + 1) / (count + 1)
        sines = np.sin(angles)
        parts = np.cos(angles), sines, np.pi / (count + 1) * sines
        return cls(radius_m, radius_m * np.stack(parts, axis=-1), (np.cos(0.4), np.sin(0.4)))


@dataclass(frozen=True, eq=False)
class Boxes:
    """Lower and upper corners of boxes with edges along the axes of their frame, shape (N, 3) each, in m."""

    lower_m: FloatArray
    upper_m: FloatArray


def visible_share(points_m: FloatArray, normals: FloatArray, disc: DiscChords, boxes: Boxes) -> FloatArray:
    """Return which share of its unhidden view factor an element keeps behind boxes.

    Multiplied by :func:`element_to_disc`, the share carries the error of the chords only where something is hidden.
    Lines of sight start at the elements, shape (N, 3); each has M normals, shape (N, M, 3), and as many shares.
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
    """Return view factors of elements, boxes in between; facets and their normals: shape (N, M, 3), factors (N, M).

    The line of sight that serves all facets of an element starts in its middle, shape (N, 3): thin or far elements need
    no more.
    """
    factors = element_to_disc(facets_m, normals, disc.radius_m)
    seen = factors.any(axis=1)
    if seen.any():
        factors[seen] *= visible_share(middles_m[seen], normals[seen], disc, boxes)
    return factors
