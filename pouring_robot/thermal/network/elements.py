"""Bodies cut into elements: the bars of the platforms, read off the URDF, and the ladle.

The platforms are frames of boxes. Each box is cut into cells along its longest edge; cells that touch, of one box or
of two, conduct heat through the area they share. Faces that touch nothing exchange heat with melt and surroundings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from lxml import etree

from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.layout_schema import LayoutEntry
from pouring_robot.thermal.network.view_factors import Boxes

FACE_NORMALS = np.concatenate([-np.eye(3), np.eye(3)])
"""Outward normals of a box: -x, -y, -z, +x, +y, +z; shape (6, 3)."""
_TOUCHING_M = 1e-7


def link_boxes(urdf: str, link: str, *, skip_round: bool = False) -> Boxes:
    """Return the boxes a link is drawn with, in the link's frame; cylinders, such as wheels, may be skipped.

    Raises:
        DescriptionError: the URDF has no such link, or it is drawn with other shapes or with turned boxes.
    """
    visuals = etree.fromstring(urdf.encode()).findall(f"link[@name='{link}']/visual")
    if skip_round:
        visuals = [one for one in visuals if one.find("geometry/cylinder") is None]
    if not visuals:
        raise DescriptionError("URDF", f"link '{link}', which the thermal model needs, is missing or has no shape")
    lower, upper = [], []
    for visual in visuals:
        box, origin = visual.find("geometry/box"), visual.find("origin")
        placed = {} if origin is None else origin.attrib
        if box is None or np.any(_numbers(placed.get("rpy", "0 0 0"))):
            raise DescriptionError("URDF", f"link '{link}': the thermal model takes boxes along the link's axes only")
        half, centre = 0.5 * _numbers(box.get("size")), _numbers(placed.get("xyz", "0 0 0"))
        lower.append(centre - half)
        upper.append(centre + half)
    return Boxes(np.array(lower), np.array(upper))


def _numbers(text: str) -> FloatArray:
    return np.array([float(part) for part in text.split()])


def merged(boxes: Boxes) -> Boxes:
    """Return the same solid with boxes joined that continue one another: fewer to look through."""
    rest = [np.array(pair) for pair in zip(boxes.lower_m, boxes.upper_m, strict=True)]
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
    return Boxes(*np.stack(done, axis=1))


@dataclass(frozen=True, eq=False)
class BarCells:
    """Cells of a frame of bars, N of them, in the frame of its link."""

    centres_m: FloatArray  # middles, shape (N, 3)
    half_m: FloatArray  # half edges, shape (N, 3)
    face_area_m2: FloatArray  # free area by face, in the order of :data:`FACE_NORMALS`, shape (N, 6)
    contacts: tuple[tuple[int, int, float], ...]  # first cell, second cell, area in m² over distance in m

    @classmethod
    def cut(cls, boxes: Boxes, cells_per_bar: int) -> BarCells:
        """Cut boxes into cells along their longest edges and find which touch."""
        lower, upper = [], []
        for low, high in zip(boxes.lower_m, boxes.upper_m, strict=True):
            axis = int(np.argmax(high - low))
            cuts = np.linspace(low[axis], high[axis], cells_per_bar + 1)
            corners = np.tile([[low], [high]], (1, cells_per_bar, 1))
            corners[0, :, axis], corners[1, :, axis] = cuts[:-1], cuts[1:]
            lower.append(corners[0])
            upper.append(corners[1])
        low, high = np.concatenate(lower), np.concatenate(upper)
        half = 0.5 * (high - low)
        edges = 2.0 * half
        areas = np.stack([edges[:, (k + 1) % 3] * edges[:, (k + 2) % 3] for k in range(3)] * 2, axis=1)
        contacts = _find_contacts(low, high, half, areas)
        return cls(0.5 * (low + high), half, np.maximum(areas, 0.0), contacts)

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.centres_m)

    @property
    def volume_m3(self) -> FloatArray:
        """Of every cell, shape (N,)."""
        return np.asarray(np.prod(2.0 * self.half_m, axis=1))

    @property
    def face_centres_m(self) -> FloatArray:
        """Middle of every face, shape (N, 6, 3)."""
        return self.centres_m[:, None] + FACE_NORMALS * self.half_m[:, None]

    def nearest(self, point_m: FloatArray) -> int:
        """Return the cell whose solid is nearest to a point, shape (3,)."""
        gap = np.maximum(np.abs(self.centres_m - point_m) - self.half_m, 0.0)
        return int(np.argmin(np.linalg.norm(gap, axis=1)))


def _find_contacts(
    low: FloatArray, high: FloatArray, half: FloatArray, areas: FloatArray
) -> tuple[tuple[int, int, float], ...]:
    """Find touching cells; their common area is taken off the free faces in ``areas``."""
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
    """The ladle as the network sees it; SI units."""

    melt_centre_m: FloatArray  # middle of the melt's surface in the moving platform's frame, shape (3,)
    melt_radius_m: float
    inner_area_m2: float  # of the lining wetted by the melt
    outer_area_m2: float  # of the shell
    wall_m: float  # lining and shell together
    trunnions_m: FloatArray  # where the two trunnions enter the hangers, in the moving platform, shape (2, 3)
    trunnion_area_m2: float  # of one trunnion
    trunnion_length_m: float  # from shell to hanger

    @classmethod
    def of(cls, entry: LayoutEntry) -> LadleSections:
        """Work them out from a layout, with the cone of ``ladle.urdf.xacro``."""
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
        """Area of a plane slab that conducts like the curved wall: geometric mean of inside and outside."""
        return math.sqrt(self.inner_area_m2 * self.outer_area_m2)


def _cup_area(top: float, bottom: float, height: float) -> float:
    """Return the area of a truncated cone's wall and bottom, in m²."""
    return math.pi * ((top + bottom) * math.hypot(height, top - bottom) + bottom**2)
