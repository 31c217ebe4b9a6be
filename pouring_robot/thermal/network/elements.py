"""Bodies cut into elements: bars of the platforms from the URDF, the ladle, and legs with their view factors at a pose.

The platforms are frames of boxes. Each box is cut into cells along its longest edge; cells that touch, of the same or
of different boxes, conduct heat through their common area. Free faces exchange heat with melt and surroundings.

A leg consists of two rods. The moving rod is cut from the lower U-joint centre upwards, independently of the pose, so
that its elements are pieces of steel that keep their heat when the leg changes its length. The fixed rod's housing is
cut around the upper U-joint centre. Where the rod is inside the housing the two touch; only the part outside is exposed
to air and radiation.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from lxml import etree

from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.robot.description.urdf import origin_pose
from pouring_robot.robot.pouring.layout_schema import Layout, Leg
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.thermal.network.view_factors import DiscChords, hidden_view_factors

FACE_NORMALS = np.concatenate([-np.eye(3), np.eye(3)])
"""Outward normals of a box: -x, -y, -z, +x, +y, +z; shape (6, 3)."""
_TOUCHING_M = 1e-7
FACETS = 16
"""Facets around a rod."""


def link_boxes(urdf: str, link: str, *, skip_round: bool = False) -> FloatArray:
    """Return the boxes of a link's visuals, in the link's frame, (B, 2, 3); cylinders, such as wheels, may be skipped.

    Raises:
        DescriptionError: the URDF has no such link, or it has other shapes, rotated boxes or an invalid origin.
    """
    visuals = etree.fromstring(urdf.encode()).findall(f"link[@name='{link}']/visual")
    if skip_round:
        visuals = [one for one in visuals if one.find("geometry/cylinder") is None]
    if not visuals:
        raise DescriptionError("URDF", f"link '{link}', which the thermal model needs, is missing or has no shape")
    boxes = []
    for visual in visuals:
        box, placed = visual.find("geometry/box"), origin_pose(visual)
        if box is None or (placed.rotation != np.eye(3)).any():
            raise DescriptionError("URDF", f"link '{link}': the thermal model takes boxes along the link's axes only")
        half = 0.5 * np.array(box.get("size").split(), dtype=float)
        boxes.append([placed.translation - half, placed.translation + half])
    return np.array(boxes)


def merged(boxes_m: FloatArray) -> FloatArray:
    """Return the same solid with adjoining boxes (B, 2, 3) of equal section merged: fewer to search."""
    rest = list(boxes_m)
    done: list[FloatArray] = []
    while rest:
        box = rest.pop()
        for k, other in enumerate(rest):
            same = np.all(np.abs(box - other) < _TOUCHING_M, axis=0)
            meet = (np.abs(box[0] - other[1]) < _TOUCHING_M) | (np.abs(box[1] - other[0]) < _TOUCHING_M)
            if same.sum() == 2 and meet[~same].all():
                rest[k] = np.array([np.minimum(box[0], other[0]), np.maximum(box[1], other[1])])
                break
        else:
            done.append(box)
    return np.array(done)


@dataclass(frozen=True, eq=False)
class BarCells:
    """Cells of a frame of bars, N of them, in the frame of its link."""

    centres_m: FloatArray  # middles, shape (N, 3)
    half_m: FloatArray  # half edges, shape (N, 3)
    face_area_m2: FloatArray  # free area by face, in the order of :data:`FACE_NORMALS`, shape (N, 6)
    contacts: tuple[tuple[int, int, float], ...]  # first cell, second cell, area in m² over distance in m

    @classmethod
    def cut(cls, boxes_m: FloatArray, cells_per_bar: int) -> Self:
        """Cut boxes (B, 2, 3) into cells along their longest edges and find those that touch."""
        cells = []
        for low, high in boxes_m:
            axis = int(np.argmax(high - low))
            cuts = np.linspace(low[axis], high[axis], cells_per_bar + 1)
            corners = np.tile([[low], [high]], (1, cells_per_bar, 1))
            corners[0, :, axis], corners[1, :, axis] = cuts[:-1], cuts[1:]
            cells.append(corners)
        low, high = np.concatenate(cells, axis=1)
        half = 0.5 * (high - low)
        edges = 2.0 * half
        areas = np.tile(edges[:, [1, 2, 0]] * edges[:, [2, 0, 1]], 2)
        contacts = _find_contacts(low, high, half, areas)
        return cls(0.5 * (low + high), half, np.maximum(areas, 0.0), contacts)

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.centres_m)

    @property
    def volume_m3(self) -> FloatArray:
        """Volume of every cell, shape (N,)."""
        return np.asarray(np.prod(2.0 * self.half_m, axis=1))

    @property
    def face_centres_m(self) -> FloatArray:
        """Centre of every face, shape (N, 6, 3)."""
        return self.centres_m[:, None] + FACE_NORMALS * self.half_m[:, None]

    def nearest(self, point_m: FloatArray) -> int:
        """Return the cell whose solid is nearest to a point, shape (3,)."""
        gap = np.maximum(np.abs(self.centres_m - point_m) - self.half_m, 0.0)
        return int(np.argmin(np.linalg.norm(gap, axis=1)))


def _find_contacts(
    low: FloatArray, high: FloatArray, half: FloatArray, areas: FloatArray
) -> tuple[tuple[int, int, float], ...]:
    """Find touching cells; their common area is subtracted from the free faces in ``areas``."""
    contacts = []
    for i in range(len(low)):
        overlap = np.minimum(high[i], high[i + 1 :]) - np.maximum(low[i], low[i + 1 :])
        for j in np.flatnonzero(np.all(overlap > -_TOUCHING_M, axis=1)) + i + 1:
            shared = overlap[j - i - 1]
            axis = int(np.argmin(shared))
            area = float(np.prod(np.maximum(np.delete(shared, axis), 0.0)))
            if area <= _TOUCHING_M**2:
                continue
            contacts.append((i, int(j), area / (half[i, axis] + half[j, axis])))
            towards = 3 if low[j, axis] + high[j, axis] > low[i, axis] + high[i, axis] else 0
            areas[i, axis + towards] -= area
            areas[j, axis + 3 - towards] -= area
    return tuple(contacts)


@dataclass(frozen=True)
class LadleSections:
    """Dimensions of the ladle for the network; SI units."""

    melt_centre_m: FloatArray  # middle of the melt's surface in the moving platform's frame, shape (3,)
    melt_radius_m: float
    inner_area_m2: float  # of the lining wetted by the melt
    outer_area_m2: float  # of the shell
    wall_m: float  # lining and shell together
    trunnions_m: FloatArray  # where the two trunnions enter the hangers, in the moving platform, shape (2, 3)
    trunnion_area_m2: float  # of one trunnion
    trunnion_length_m: float  # from shell to hanger

    @classmethod
    def of(cls, entry: Layout) -> Self:
        """Compute them from a layout, with the cone of ``ladle.urdf.xacro``."""
        ladle, platform = entry.ladle, entry.moving_platform
        top, bottom, height = ladle.outer_radius_top.metres, ladle.outer_radius_bottom.metres, ladle.height.metres
        wall, level, drop = ladle.wall.metres, ladle.melt_below_rim.metres, platform.trunnion_drop.metres
        rim = np.array(ladle.rim_centre.metres)
        surface = top - wall + (bottom - top) * level / (height - wall)
        reach = top + platform.hanger_gap.metres
        return cls(
            melt_centre_m=rim - np.array([0.0, 0.0, level]),
            melt_radius_m=surface,
            inner_area_m2=_cup_area(surface, bottom - wall, height - wall - level),
            outer_area_m2=_cup_area(top, bottom, height),
            wall_m=wall,
            trunnions_m=rim + np.array([[0.0, side * reach, -drop] for side in (-1.0, 1.0)]),
            trunnion_area_m2=math.pi * ladle.trunnion_radius.metres**2,
            trunnion_length_m=reach - (top + (bottom - top) * drop / height),
        )

    @property
    def conducting_area_m2(self) -> float:
        """Area of a plane slab that conducts like the curved wall: geometric mean of inner and outer area."""
        return math.sqrt(self.inner_area_m2 * self.outer_area_m2)


def _cup_area(top: float, bottom: float, height: float) -> float:
    """Return the area of a truncated cone's wall and bottom, in m²."""
    return math.pi * ((top + bottom) * math.hypot(height, top - bottom) + bottom**2)


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
    def of(cls, leg: Leg, moving: int, fixed: int) -> Self:
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

    def path_weights_m(self, lengths_m: FloatArray) -> FloatArray:
        """Return the length within each element of the path from upper to lower U-joint centre.

        The path goes down the fixed rod to its lower end, where the nut is assumed, and on along the moving rod. Leg
        lengths are of shape (4,), in m; the result is of shape (4, N + F), in m, and each row sums to the leg's length.
        """
        below = np.minimum(-self.fixed_edges_m[0], lengths_m)
        rod = _overlap(self.moving_edges_m, np.zeros(len(LEGS)), lengths_m - below)
        # A leg cannot extend beyond the rod's end; layouts with too short a rod are for the user to correct.
        return np.concatenate([rod, _overlap(self.fixed_edges_m, -below, np.zeros(len(LEGS)))], axis=1)


@dataclass(frozen=True, eq=False)
class LegExposure:
    """All elements of the four legs at a pose; shapes (4, N + F) unless stated otherwise."""

    lengths_m: FloatArray  # leg lengths, shape (4,)
    down: FloatArray  # unit vectors from upper to lower U-joint centre, in the disc's frame, shape (4, 3)
    centres_m: FloatArray  # middle of the exposed part of each element, in the disc's frame, shape (4, N + F, 3)
    from_upper_joint_m: FloatArray  # distance of the element's middle from the upper U-joint centre, positive downwards
    area_m2: FloatArray  # outside surface exposed to air
    view_factor: FloatArray  # mean around the element, from it to the melt's surface
    # how the view factor varies around the rod: h of F(n) = mean + h · n + …, in the disc's frame, (4, N + F, 3)
    first_harmonic: FloatArray
    touching_m2: FloatArray  # surface of each moving element inside each fixed element, shape (4, N, F)

    @classmethod
    def at(cls, grid: LegGrid, upper_m: FloatArray, lower_m: FloatArray, disc: DiscChords, boxes_m: FloatArray) -> Self:
        """Place the elements between U-joint centres in the disc's frame, (4, 3) each, and compute their view factors.

        Boxes (B, 2, 3) hide the melt.
        """
        along = upper_m - lower_m
        lengths = np.linalg.norm(along, axis=1)
        along = along / lengths[:, None]
        pieces, heights = _exposed_rod(grid, lengths)
        fixed_middle = grid.fixed_middles_m + lengths[:, None]
        moving_middle = np.tile(0.5 * (grid.moving_edges_m[1:] + grid.moving_edges_m[:-1]), (len(LEGS), 1))
        view_heights = np.concatenate([heights, fixed_middle], axis=1)
        centres = lower_m[:, None] + view_heights[..., None] * along[:, None]
        around = 2.0 * math.pi * grid.outer_m
        outside = np.concatenate([pieces, np.tile(grid.step_m[grid.moving :], (len(LEGS), 1))], axis=1)
        area = around * outside
        mean, harmonic = _seen_around(centres, along, grid.outer_m, area > 0.0, disc, boxes_m)
        ends = itertools.pairwise(grid.fixed_edges_m)
        inside = [_overlap(grid.moving_edges_m, lengths + a, lengths + b) for a, b in ends]
        touching = around[0] * np.stack(inside, axis=-1)
        below = lengths[:, None] - np.concatenate([moving_middle, fixed_middle], axis=1)
        return cls(lengths, -along, centres, below, area, mean, harmonic, touching)


def _overlap(edges: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the length of each element between start and end of each leg, shape (4, elements), in m."""
    upper = np.minimum(edges[None, 1:], end[:, None])
    return np.asarray(np.maximum(upper - np.maximum(edges[None, :-1], start[:, None]), 0.0))


def _exposed_rod(grid: LegGrid, lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return length outside the housing and the height of its middle above the lower joint, (4, N) each, in m."""
    edges = grid.moving_edges_m
    start, end = lengths + grid.fixed_edges_m[0], lengths + grid.fixed_edges_m[-1]
    under = _overlap(edges, np.full(len(LEGS), -1.0), start)
    over = _overlap(edges, end, np.full(len(LEGS), edges[-1] + 1.0))
    # An element that protrudes at both ends has the view of the longer piece.
    height = np.where(under >= over, edges[None, :-1] + 0.5 * under, edges[None, 1:] - 0.5 * over)
    return under + over, height


def _seen_around(
    centres: FloatArray, along: FloatArray, radii: FloatArray, exposed: BoolArray, disc: DiscChords, boxes_m: FloatArray
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
    factors[exposed] = hidden_view_factors(surface[exposed], centres[exposed], normals[exposed], disc, boxes_m)
    harmonic = 2.0 / FACETS * np.einsum("lem,lemk->lek", factors, normals)
    return factors.mean(axis=-1), harmonic
