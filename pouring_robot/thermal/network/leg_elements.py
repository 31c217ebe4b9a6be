"""The legs cut into elements, and what each element sees of the melt at a pose.

A leg is two rods. The moving rod is cut once and for all from the lower U-joint centre upwards, so that its elements
are pieces of steel that keep their heat when the leg changes its length; the fixed rod's housing is cut around the
upper U-joint centre. Where the rod is inside the housing the two touch; only what is outside meets air and radiation.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.layout_schema import Leg
from pouring_robot.thermal.network.view_factors import Boxes, DiscChords, hidden_view_factors

LEGS = 4
FACETS = 16
"""Facets around a rod."""


@dataclass(frozen=True, eq=False)
class LegGrid:
    """Elements of one leg, the same for all four: N of the moving rod, then F of the fixed rod."""

    moving: int  # N
    fixed: int  # F
    # ends of the moving rod's elements, from the lower U-joint centre upwards, shape (N + 1,)
    moving_edges_m: FloatArray
    fixed_edges_m: FloatArray  # ends of the fixed rod's, from the upper U-joint centre upwards, shape (F + 1,)
    step_m: FloatArray  # length of every element, shape (N + F,)
    outer_m: FloatArray  # its radii, shape (N + F,); the moving rod is solid
    inner_m: FloatArray

    @classmethod
    def of(cls, leg: Leg, moving: int, fixed: int) -> LegGrid:
        """Cut the rods of a layout's leg."""
        below, above, length = leg.housing_below.metres, leg.housing_above.metres, leg.spindle_length.metres
        edges = np.linspace(0.0, length, moving + 1), np.linspace(-below, above, fixed + 1)
        of_rods = (
            (length / moving, (below + above) / fixed),
            (leg.spindle_radius.metres, leg.housing_outer_radius.metres),
            (0.0, leg.housing_inner_radius.metres),
        )
        return cls(moving, fixed, *edges, *(np.repeat(pair, (moving, fixed)) for pair in of_rods))

    @property
    def section_m2(self) -> FloatArray:
        """Cross-section of every element, shape (N + F,)."""
        return np.asarray(math.pi * (self.outer_m**2 - self.inner_m**2))

    @property
    def fixed_middles_m(self) -> FloatArray:
        """Middles of the fixed rod's elements, from the upper U-joint centre upwards, shape (F,)."""
        return np.asarray(0.5 * (self.fixed_edges_m[1:] + self.fixed_edges_m[:-1]))

    @property
    def upper_joint_shares(self) -> FloatArray:
        """How the upper U joint's heat is shared by the fixed rod's elements, shape (F,): between the two nearest."""
        return np.array([np.interp(0.0, self.fixed_middles_m, unit) for unit in np.eye(self.fixed)])

    def path_weights_m(self, lengths_m: FloatArray) -> FloatArray:
        """Return how many metres of the way from upper to lower U-joint centre run through each element.

        The way goes down the fixed rod to its lower end, where the nut is taken to sit, and on along the moving rod.
        Leg lengths are of shape (4,), in m; the result is of shape (4, N + F), in m, and each row sums to the leg's.
        """
        below = np.minimum(-self.fixed_edges_m[0], lengths_m)
        rod = _overlap(self.moving_edges_m, np.zeros(LEGS), lengths_m - below)
        # A leg drawn out beyond the rod's end does not exist; layouts with too short a rod are the user's to mend.
        return np.concatenate([rod, _overlap(self.fixed_edges_m, -below, np.zeros(LEGS))], axis=1)


@dataclass(frozen=True, eq=False)
class LegExposure:
    """All elements of the four legs at a pose; shapes (4, N + F) unless said otherwise."""

    lengths_m: FloatArray  # leg lengths, shape (4,)
    down: FloatArray  # unit vectors from upper to lower U-joint centre, in the disc's frame, shape (4, 3)
    centres_m: FloatArray  # middle of the exposed part of each element, in the disc's frame, shape (4, N + F, 3)
    from_upper_joint_m: FloatArray  # distance of the element's middle from the upper U-joint centre, positive downwards
    area_m2: FloatArray  # outside surface that meets air
    view_factor: FloatArray  # mean around the element, from it to the melt's surface
    # how the view factor varies around the rod: h of F(n) = mean + h · n + …, in the disc's frame, (4, N + F, 3)
    first_harmonic: FloatArray
    touching_m2: FloatArray  # surface of each moving element inside each fixed element, shape (4, N, F)

    @classmethod
    def at(cls, grid: LegGrid, upper_m: FloatArray, lower_m: FloatArray, disc: DiscChords, boxes: Boxes) -> LegExposure:
        """Place the elements between U-joint centres in the disc's frame, (4, 3) each, and look at the melt from each.

        ``boxes`` hide it.
        """
        along = upper_m - lower_m
        lengths = np.linalg.norm(along, axis=1)
        along = along / lengths[:, None]
        pieces, heights = _exposed_rod(grid, lengths)
        fixed_middle = grid.fixed_middles_m + lengths[:, None]
        moving_middle = np.tile(0.5 * (grid.moving_edges_m[1:] + grid.moving_edges_m[:-1]), (LEGS, 1))
        view_heights = np.concatenate([heights, fixed_middle], axis=1)
        centres = lower_m[:, None] + view_heights[..., None] * along[:, None]
        around = 2.0 * math.pi * grid.outer_m
        outside = np.concatenate([pieces, np.tile(grid.step_m[grid.moving :], (LEGS, 1))], axis=1)
        area = around * outside
        mean, harmonic = _seen_around(centres, along, grid.outer_m, area > 0.0, disc, boxes)
        ends = itertools.pairwise(grid.fixed_edges_m)
        inside = [_overlap(grid.moving_edges_m, lengths + a, lengths + b) for a, b in ends]
        touching = around[0] * np.stack(inside, axis=-1)
        below = lengths[:, None] - np.concatenate([moving_middle, fixed_middle], axis=1)
        return cls(lengths, -along, centres, below, area, mean, harmonic, touching)


def _overlap(edges: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return how much of each element lies between start and end of each leg, shape (4, elements), in m."""
    upper = np.minimum(edges[None, 1:], end[:, None])
    return np.asarray(np.maximum(upper - np.maximum(edges[None, :-1], start[:, None]), 0.0))


def _exposed_rod(grid: LegGrid, lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return length outside the housing and the height of its middle above the lower joint, (4, N) each, in m."""
    edges = grid.moving_edges_m
    start, end = lengths + grid.fixed_edges_m[0], lengths + grid.fixed_edges_m[-1]
    under = _overlap(edges, np.full(LEGS, -1.0), start)
    over = _overlap(edges, end, np.full(LEGS, edges[-1] + 1.0))
    # An element that sticks out at both ends looks out of the longer piece.
    height = np.where(under >= over, edges[None, :-1] + 0.5 * under, edges[None, 1:] - 0.5 * over)
    return under + over, height


def _seen_around(
    centres: FloatArray,
    along: FloatArray,
    radii: FloatArray,
    exposed: NDArray[np.bool_],
    disc: DiscChords,
    boxes: Boxes,
) -> tuple[FloatArray, FloatArray]:
    """Return mean view factor, (4, E), and its first harmonic around the rods, (4, E, 3)."""
    angles = 2.0 * math.pi * np.arange(FACETS) / FACETS
    helper = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    first = np.cross(along, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    around = np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]  # (4, M, 3)
    normals = np.broadcast_to(around[:, None], (*centres.shape[:2], FACETS, 3))
    surface = centres[:, :, None] + radii[None, :, None, None] * normals
    factors = np.zeros((*exposed.shape, FACETS))
    factors[exposed] = hidden_view_factors(surface[exposed], centres[exposed], normals[exposed], disc, boxes)
    harmonic = 2.0 / FACETS * np.einsum("lem,lemk->lek", factors, normals)
    return factors.mean(axis=-1), harmonic
