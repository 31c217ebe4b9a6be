"""View factors from small plane or cylindrical elements to a disc that a frame of bars partly hides.

All lengths in m, in a frame with the disc's centre at the origin and the disc in the plane z = 0, radiating into the
half-space z > 0. Boxes with edges along the axes of their frame are arrays (B, 2, 3) of lower and upper corners.

Unobstructed factors are exact: the area integral over the disc is converted to one along its outline (Sparrow's contour
integration), F = -1/(2π) n · ∮ (r × dr)/|r|², which has a closed form on a circle. Where the element's own horizon cuts
the disc, the outline is the arc above the horizon and the chord that closes it. For parallel and perpendicular
elements this gives the published forms B-12 to B-14 of Howell's catalogue of configuration factors.

For obstruction by boxes the disc is cut into chords. On a chord the integrand of the view factor has a primitive, and
the shadow of a box, seen from a point, is an interval: both are exact. Across the chords the integral is Gauss's rule
for a half circle (Chebyshev of the second kind). So shadows, and the areas they cover, change continuously with the
element's position. The loops over elements, chords and boxes are compiled.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pouring_robot.batch.kernels.algebra import cross, dot
from pouring_robot.batch.kernels.compiler import compiled, outermost
from pouring_robot.batch.structure import IntArray
from pouring_robot.mechanism.arrays import FloatArray

_WAY_X, _WAY_Y = math.cos(0.4), math.sin(0.4)
"""Direction of the chords of a disc: parallel to no axis, so that no edge of a bar is parallel to them."""


@dataclass(frozen=True, eq=False)
class DiscChords:
    """Parallel chords that represent a disc."""

    radius_m: float  # of the disc
    chords_m: FloatArray  # distance from the centre, half length and weight of each, shape (C, 3), in m

    @classmethod
    def of(cls, radius_m: float, count: int = 24) -> Self:
        """Cut a disc by Gauss's rule for a half circle: ∫ √(1-v²) f dv = π/(C+1) Σ sin² f(cos)."""
        angles = np.pi * np.arange(1, count + 1) / (count + 1)
        sines = np.sin(angles)
        parts = np.cos(angles), sines, np.pi / (count + 1) * sines
        return cls(radius_m, radius_m * np.stack(parts, axis=-1))


def hidden_view_factors(
    facets_m: FloatArray, middles_m: FloatArray, normals: FloatArray, disc: DiscChords, boxes_m: FloatArray
) -> FloatArray:
    """Return view factors of elements' facets, with boxes in between, shape (N, M).

    Facets and their unit normals are (N, M, 3); behind the disc (z <= 0) or facing away their factors are zero. Lines
    of sight of all facets of an element start at its centre, shape (N, 3), which suffices for thin or distant elements.
    The chords cause an error only where something is hidden.
    """
    chords, count, facets = len(disc.chords_m), len(boxes_m), normals.shape[1]
    bounds, pieces, facing, totals = (np.empty(n) for n in ((2, 5, 2), (chords, count, 2), (facets, 2), (2, facets)))
    room = bounds, pieces, np.empty(chords, dtype=np.int64), np.empty(count, dtype=np.int64), facing, totals
    factors = np.empty(normals.shape[:2])
    facets_m, middles_m, normals = (np.ascontiguousarray(array) for array in (facets_m, middles_m, normals))
    write_factors(facets_m, middles_m, normals, boxes_m, disc.radius_m, disc.chords_m, room, factors)
    return factors


@compiled
def _arc_integrals(radius: float, offset: float, height: float, start: float, end: float) -> tuple[float, float, float]:
    """Integrate 1, sin and cos over K - L cos along an arc, with K = a² + ρ² + z² and L = 2aρ; in 1/m².

    It is written with the Fourier coefficient q of the integrand, to avoid cancellation as L goes to zero.
    """
    total, ripple = radius**2 + offset**2 + height**2, 2.0 * radius * offset
    # K ± L from distances to the far and the near edge, to avoid cancellation close to the rim.
    root = math.sqrt(((offset - radius) ** 2 + height**2) * ((offset + radius) ** 2 + height**2))
    q = ripple / (total + root)
    flat, cosines = 0.0, 0.0
    for angle, sign in ((start, -1.0), (end, 1.0)):
        sine, cosine_part = math.sin(angle), 1.0 - q * math.cos(angle)
        turned = math.atan2(q * sine, cosine_part)
        slope = turned / q if q > 1e-9 else sine / cosine_part
        flat += sign * (angle + 2.0 * turned) / root
        cosines += sign * (angle * q + 2.0 * total * slope / (total + root)) / root
    rise = (math.cos(start) - math.cos(end)) / (total - ripple * math.cos(start))
    return flat, math.log1p(ripple * rise) / ripple if ripple > 0.0 else rise, cosines


@compiled
def _unhidden(point: FloatArray, normal: FloatArray, radius: float) -> float:
    """Return the view factor from a plane element to the disc."""
    x, y, height = point[0], point[1], point[2]
    if height <= 0.0:
        return 0.0
    offset = math.hypot(x, y)
    # Axes: radial, tangential, z; an element on the disc's axis may take any radial direction.
    cosine, sine = (x / offset, y / offset) if offset > 0.0 else (1.0, 0.0)
    radial, tangential = cosine * normal[0] + sine * normal[1], cosine * normal[1] - sine * normal[0]
    vertical, across = normal[2], radius * math.hypot(radial, tangential)
    # The rim is above the element's horizon where across * cos(angle - middle) + constant > 0.
    constant = -radial * offset - vertical * height
    if constant <= -across:
        return 0.0
    whole = constant >= across
    half = math.pi if whole else math.acos(-constant / across)
    middle = 0.0 if whole else math.atan2(tangential, radial)
    start, end = middle - half, middle + half
    flat, sines, cosines = _arc_integrals(radius, offset, height, start, end)
    integral = height * radius * (radial * cosines + tangential * sines)
    integral += vertical * radius * (radius * flat - offset * cosines)
    if not whole:  # the signed angle that the chord, from the arc's end to its start, subtends at the element
        far = (radius * math.cos(end) - offset, radius * math.sin(end), -height)
        near = (radius * math.cos(start) - offset, radius * math.sin(start), -height)
        integral += math.atan2(dot(cross(far, near), (radial, tangential, vertical)), dot(far, near))
    factor: float = min(max(-integral / (2.0 * math.pi), 0.0), 1.0)
    return factor


@compiled
def _shadow(
    point: tuple[float, float, float],
    chord: tuple[float, float, float, float, float],
    box: FloatArray,
    bounds: FloatArray,
) -> tuple[float, float]:
    """Return the interval of a chord that a box hides from a point; empty where it ends before it begins.

    A ray from the point p to a point q on the chord meets the box where p + (q - p)/s is in it, s >= 1. Each side of
    the box bounds s from below or above, linearly in the position on the chord; the interval is where all lower bounds
    are below all upper ones.

    ``chord``: its origin and its direction in x and y, and half its length.
    """
    x, y, z = point
    at_x, at_y, way_x, way_y, half = chord
    near, far = max(1.0 - box[1, 2] / z, 1e-9), min(1.0 - box[0, 2] / z, 1.0 - 1e-9)
    if near >= far:
        return 1.0, -1.0
    bounds[0, 0, 0], bounds[0, 0, 1] = 1.0 / far, 0.0
    bounds[1, 0, 0], bounds[1, 0, 1] = 1.0 / near, 0.0
    below, above = 1, 1
    for k in range(4):
        axis, high = k // 2, k % 2
        here, start, way = (x, at_x, way_x) if axis == 0 else (y, at_y, way_y)
        side = box[high, axis] - here
        if abs(side) < 1e-12:
            side = 1e-12
        if (side > 0.0) == (high == 1):
            bounds[0, below, 0], bounds[0, below, 1] = (start - here) / side, way / side
            below += 1
        else:
            bounds[1, above, 0], bounds[1, above, 1] = (start - here) / side, way / side
            above += 1
    begin, end = -half, half
    for i in range(below):
        for j in range(above):
            # lower bound <= upper bound: 0 <= constant + slope * position
            constant, slope = bounds[1, j, 0] - bounds[0, i, 0], bounds[1, j, 1] - bounds[0, i, 1]
            if slope > 0.0:
                begin = max(begin, -constant / slope)
            elif slope < 0.0:
                end = min(end, -constant / slope)
            elif constant < 0.0:
                return 1.0, -1.0
    return begin, end


@compiled
def _primitives(place: float, square: float) -> tuple[float, float]:
    """Return ∫ w dw/(w² + D²)² and ∫ dw/(w² + D²)² up to a position w; ``square``: D²."""
    whole, root = place * place + square, math.sqrt(square)
    return -0.5 / whole, (place / whole + math.atan(place / root) / root) / (2.0 * square)


@compiled
def _add_piece(totals: FloatArray, facing: FloatArray, begin: float, end: float, square: float, weight: float) -> None:
    """Add to the total of each normal the contribution of a piece of a chord, where the normal faces the piece.

    ``facing``: for each normal, slope and constant of n · (q - p) along the chord.
    """
    first, last = _primitives(begin, square), _primitives(end, square)
    for m in range(len(facing)):
        slope, constant = facing[m, 0], facing[m, 1]
        at_begin, at_end = slope * begin + constant, slope * end + constant
        if at_begin <= 0.0 and at_end <= 0.0:
            continue
        one, other = first, last
        if at_begin < 0.0:
            one = _primitives(-constant / slope, square)
        elif at_end < 0.0:
            other = _primitives(-constant / slope, square)
        totals[m] += weight * (slope * (other[0] - one[0]) + constant * (other[1] - one[1]))


@compiled
def _boxes_between(point: tuple[float, float, float], radius: float, boxes: FloatArray, between: IntArray) -> int:
    """Write the indices of boxes that the cone from a point to the disc may meet; return their number."""
    count = 0
    for box in range(len(boxes)):
        # Where on the way down to the disc the box begins and ends.
        begin, end = 1.0 - boxes[box, 1, 2] / point[2], 1.0 - boxes[box, 0, 2] / point[2]
        begin, end = max(begin, 0.0), min(end, 1.0)
        meets = begin < end
        for k in range(2):
            at_begin, at_end = point[k] * (1.0 - begin), point[k] * (1.0 - end)
            meets = meets and max(at_begin + radius * begin, at_end + radius * end) > boxes[box, 0, k]
            meets = meets and min(at_begin - radius * begin, at_end - radius * end) < boxes[box, 1, k]
        if meets:
            between[count] = box
            count += 1
    return count


@compiled
def _hidden_pieces(
    point: tuple[float, float, float],
    chord: tuple[float, float, float, float, float],
    boxes: FloatArray,
    between: IntArray,
    bounds: FloatArray,
    pieces: FloatArray,
) -> int:
    """Write the pieces of a chord that boxes hide, (boxes, 2), disjoint and in order; return their number."""
    count = 0
    for box in between:
        begin, end = _shadow(point, chord, boxes[box], bounds)
        if not begin < end:
            continue
        at = count
        while at > 0 and pieces[at - 1, 0] > begin:
            pieces[at, 0], pieces[at, 1] = pieces[at - 1, 0], pieces[at - 1, 1]
            at -= 1
        pieces[at, 0], pieces[at, 1] = begin, end
        count += 1
    kept = min(count, 1)
    for k in range(1, count):
        if pieces[k, 0] <= pieces[kept - 1, 1]:
            pieces[kept - 1, 1] = max(pieces[kept - 1, 1], pieces[k, 1])
        else:
            pieces[kept, 0], pieces[kept, 1] = pieces[k, 0], pieces[k, 1]
            kept += 1
    return kept


@outermost
def write_factors(
    facets: FloatArray,
    middles: FloatArray,
    normals: FloatArray,
    boxes: FloatArray,
    radius: float,
    chords: FloatArray,
    room: tuple[FloatArray, FloatArray, IntArray, IntArray, FloatArray, FloatArray],
    factors: FloatArray,
) -> None:
    """Write the view factor of each facet of each element, (N, M).

    Facets and normals are (N, M, 3), middles (N, 3), the chords of the disc (C, 3) as in :class:`DiscChords`; the
    arrays of ``room``, for intermediate results, are (2, 5, 2), (C, B, 2), (C,), (B,), (M, 2), (2, M).
    """
    bounds, pieces, counts, numbers, facing, totals = room
    for n in range(len(facets)):
        visible = False
        for m in range(facets.shape[1]):
            factors[n, m] = _unhidden(facets[n, m], normals[n, m], radius)
            visible = visible or factors[n, m] > 0.0
        x, y, z = middles[n]
        near = _boxes_between((x, y, z), radius, boxes, numbers) if visible and z > 0.0 else 0
        if near == 0:
            continue
        found, between = 0, numbers[:near]
        for c in range(len(chords)):
            chord = (-_WAY_Y * chords[c, 0], _WAY_X * chords[c, 0], _WAY_X, _WAY_Y, chords[c, 1])
            counts[c] = _hidden_pieces((x, y, z), chord, boxes, between, bounds, pieces[c])
            found += counts[c]
        if found == 0:
            continue
        along, across = x * _WAY_X + y * _WAY_Y, y * _WAY_X - x * _WAY_Y
        totals[:] = 0.0
        for c in range(len(chords)):
            lateral, half, weight = chords[c, 0] - across, chords[c, 1], chords[c, 2]
            square = lateral * lateral + z * z
            for m in range(facets.shape[1]):
                normal = normals[n, m]
                facing[m, 0] = normal[0] * _WAY_X + normal[1] * _WAY_Y
                facing[m, 1] = (normal[1] * _WAY_X - normal[0] * _WAY_Y) * lateral - normal[2] * z
            _add_piece(totals[0], facing, -half - along, half - along, square, weight)
            for k in range(counts[c]):
                begin, end = pieces[c, k]
                _add_piece(totals[1], facing, begin - along, end - along, square, weight)
        for m in range(facets.shape[1]):
            if totals[0, m] > 0.0:
                factors[n, m] *= min(max(1.0 - totals[1, m] / totals[0, m], 0.0), 1.0)
