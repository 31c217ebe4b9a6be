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
from numpy.typing import NDArray

from pouring_robot.mechanism.arrays import FloatArray


def element_to_disc(points_m: FloatArray, normals: FloatArray, radius_m: float) -> FloatArray:
    """Return the view factor from plane elements to a disc with nothing in between.

    Args:
        points_m: where the elements are, shape (..., 3), in m.
        normals: unit normals of their radiating sides, shape (..., 3), broadcast against the points.
        radius_m: of the disc.

    Returns:
        Shape (...): 0 to 1; zero behind the disc (z <= 0) and for elements turned away.
    """
    x, y, z = (points_m[..., k] for k in range(3))
    offset = np.hypot(x, y)
    height = np.where(z > 0.0, z, 1.0)
    # Axes: radial, tangential, z; an element on the disc's axis may take any radial direction.
    safe = np.where(offset > 0.0, offset, 1.0)
    cosine, sine = np.where(offset > 0.0, x / safe, 1.0), np.where(offset > 0.0, y / safe, 0.0)
    radial = cosine * normals[..., 0] + sine * normals[..., 1]
    tangential = cosine * normals[..., 1] - sine * normals[..., 0]
    vertical = normals[..., 2] + 0.0 * radial
    across = radius_m * np.hypot(radial, tangential)
    # The rim is above the element's horizon where across * cos(angle - middle) + constant > 0.
    constant = -radial * offset - vertical * height
    half = np.arccos(np.clip(-constant / np.where(across > 0.0, across, 1.0), -1.0, 1.0))
    whole = constant >= across
    half = np.where(whole, np.pi, half)
    middle = np.where(whole, 0.0, np.arctan2(tangential, radial))
    start, end = middle - half, middle + half
    flat, sines, cosines = _arc_integrals(radius_m, offset, height, start, end)
    arc = height * radius_m * (radial * cosines + tangential * sines)
    arc = arc + vertical * radius_m * (radius_m * flat - offset * cosines)
    chord = _chord_angle(radius_m, offset, height, (radial, tangential, vertical), start, end)
    factor = -(arc + np.where(whole, 0.0, chord)) / (2.0 * np.pi)
    hidden = (z <= 0.0) | (constant <= -across)
    return np.asarray(np.where(hidden, 0.0, np.clip(factor, 0.0, 1.0)))


def _arc_integrals(
    radius: float, offset: FloatArray, height: FloatArray, start: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate 1, sin and cos over K - L cos along an arc, with K = a² + ρ² + z² and L = 2aρ; in 1/m².

    Written with the Fourier coefficient q of the integrand so that nothing cancels as L goes to zero.
    """
    total, ripple = radius**2 + offset**2 + height**2, 2.0 * radius * offset
    # K ± L as distances to the far and the near edge: no cancellation close to the rim.
    root = np.sqrt(((offset - radius) ** 2 + height**2) * ((offset + radius) ** 2 + height**2))
    q = ripple / (total + root)
    safe_q, safe_ripple = np.where(q > 1e-9, q, 1.0), np.where(ripple > 0.0, ripple, 1.0)

    def primitives(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        lead = np.sin(angle) / (1.0 - q * np.cos(angle))
        turned = np.arctan2(q * np.sin(angle), 1.0 - q * np.cos(angle))
        slope = np.where(q > 1e-9, turned / safe_q, lead)
        return (angle + 2.0 * turned) / root, (angle * q + 2.0 * total * slope / (total + root)) / root

    first, last = primitives(start), primitives(end)
    rise = (np.cos(start) - np.cos(end)) / (total - ripple * np.cos(start))
    sines = np.where(ripple > 0.0, np.log1p(ripple * rise) / safe_ripple, rise)
    return last[0] - first[0], sines, last[1] - first[1]


def _chord_angle(
    radius: float,
    offset: FloatArray,
    height: FloatArray,
    normal: tuple[FloatArray, FloatArray, FloatArray],
    start: FloatArray,
    end: FloatArray,
) -> FloatArray:
    """Return the signed angle, in rad, under which the element sees the chord from the arc's end to its start."""

    def ray(angle: FloatArray) -> FloatArray:
        return np.stack([radius * np.cos(angle) - offset, radius * np.sin(angle), -height + 0.0 * angle], axis=-1)

    far, near = ray(end), ray(start)
    turn = np.sum(np.cross(far, near) * np.stack(np.broadcast_arrays(*normal), axis=-1), axis=-1)
    return np.asarray(np.arctan2(turn, np.sum(far * near, axis=-1)))


@dataclass(frozen=True, eq=False)
class DiscSample:
    """Points that stand for equal areas of a disc, on a sunflower spiral: no edge of a bar runs along a row of them.

    Attributes:
        radius_m: of the disc.
        points_m: shape (Q, 3), in m, in the disc's frame.
    """

    radius_m: float
    points_m: FloatArray

    @classmethod
    def of(cls, radius_m: float, count: int = 512) -> DiscSample:
        """Spread points over a disc."""
        number = np.arange(count) + 0.5
        radii = radius_m * np.sqrt(number / count)
        angles = number * np.pi * (3.0 - np.sqrt(5.0))
        return cls(radius_m, np.stack([radii * np.cos(angles), radii * np.sin(angles), np.zeros(count)], axis=-1))


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes with edges along the axes of the disc's frame, in m.

    Attributes:
        lower_m: their lower corners, shape (N, 3).
        upper_m: their upper corners, shape (N, 3).
    """

    lower_m: FloatArray
    upper_m: FloatArray


def blocked(points_m: FloatArray, sample: DiscSample, boxes: Boxes) -> NDArray[np.bool_]:
    """Return which points of the disc are hidden from which points of space by boxes (slab test).

    Args:
        points_m: shape (N, 3), in m.
        sample: Q points of the disc.
        boxes: what stands in between.

    Returns:
        Shape (N, Q): whether the line between them meets a box.
    """
    hidden = np.zeros((len(points_m), len(sample.points_m)), dtype=bool)
    for lower, upper in zip(boxes.lower_m, boxes.upper_m, strict=True):
        rows = _in_between(points_m, sample.radius_m, lower, upper)
        # Shares of the way at which the line enters and leaves the box; the ends themselves do not count.
        enter, leave = 1e-9, 1.0 - 1e-9
        for k in (2, 0, 1):
            here = points_m[rows, k, None]
            step = sample.points_m[None, :, k] - here if k < 2 else -here
            inverse = 1.0 / np.where(np.abs(step) > 1e-12, step, 1e-12)
            one, other = (lower[k] - here) * inverse, (upper[k] - here) * inverse
            enter = np.maximum(enter, np.minimum(one, other))
            leave = np.minimum(leave, np.maximum(one, other))
        hidden[rows] |= enter < leave
    return hidden


def _in_between(points_m: FloatArray, radius_m: float, lower: FloatArray, upper: FloatArray) -> NDArray[np.intp]:
    """Return the points, by number, from which some line to the disc may meet a box: where cone and box overlap."""
    height = points_m[:, 2, None]
    safe = np.where(np.abs(height) > 1e-9, height, 1e-9)
    shares = np.clip((height - np.array([lower[2], upper[2]])) / safe, 0.0, 1.0)  # of the way at the box's heights
    near = (np.maximum(height[:, 0], 0.0) >= lower[2]) & (np.minimum(height[:, 0], 0.0) <= upper[2])
    for k in (0, 1):
        middle, spread = points_m[:, k, None] * (1.0 - shares), radius_m * shares
        near &= ((middle + spread).max(axis=1) >= lower[k] - 1e-9) & ((middle - spread).min(axis=1) <= upper[k] + 1e-9)
    return np.flatnonzero(near)


def visible_share(points_m: FloatArray, normals: FloatArray, sample: DiscSample, boxes: Boxes) -> FloatArray:
    """Return which share of its unhidden view factor an element keeps behind boxes.

    Weights of the disc's points are the integrand of the view factor; multiplied by :func:`element_to_disc`, the
    share carries the error of the sampling only where something is hidden.

    Args:
        points_m: the elements, shape (N, 3), in m; here the lines of sight start.
        normals: M normals for each element, shape (N, M, 3).
        sample: Q points of the disc.
        boxes: what hides it.

    Returns:
        Shape (N, M), 0 to 1.
    """
    hidden = blocked(points_m, sample, boxes)
    counts = np.count_nonzero(hidden, axis=1)
    share = np.repeat((counts < hidden.shape[1])[:, None].astype(float), normals.shape[1], axis=1)
    partly = np.flatnonzero((counts > 0) & (counts < hidden.shape[1]))
    ray = sample.points_m[None] - points_m[partly, None]  # (N, Q, 3)
    square = np.einsum("nqk,nqk->nq", ray, ray)
    # Single precision: the sampling is coarser than that by far.
    facing = np.matmul(ray.astype(np.float32), np.swapaxes(normals[partly], 1, 2).astype(np.float32))  # (N, Q, M)
    np.maximum(facing, 0.0, out=facing)
    emission = (np.maximum(points_m[partly, None, 2], 0.0) / square**2).astype(np.float32)  # (N, Q)
    full, dark = (np.einsum("nqm,nq->nm", facing, weight) for weight in (emission, emission * hidden[partly]))
    share[partly] = 1.0 - dark / np.where(full > 0.0, full, 1.0)
    return share


def hidden_view_factors(
    facets_m: FloatArray, middles_m: FloatArray, normals: FloatArray, sample: DiscSample, boxes: Boxes
) -> FloatArray:
    """Return view factors of elements with several facets each, boxes in between.

    Args:
        facets_m: where the facets are, shape (N, M, 3), in m.
        middles_m: where the line of sight starts that serves all facets of an element, shape (N, 3): thin or far
            elements need no more.
        normals: shape (N, M, 3).
        sample: points of the disc.
        boxes: what hides it.

    Returns:
        Shape (N, M), 0 to 1.
    """
    factors = element_to_disc(facets_m, normals, sample.radius_m)
    seen = factors.any(axis=1)
    if seen.any():
        factors[seen] *= visible_share(middles_m[seen], normals[seen], sample, boxes)
    return factors
