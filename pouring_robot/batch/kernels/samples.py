"""Compiled: loops over samples. Each call takes a range of samples, so that threads share the work by ranges.

A sample's result depends on its own input only, never on the range or the thread it fell to.
"""

from __future__ import annotations

import math

from pouring_robot.batch.kernels.algebra import dot
from pouring_robot.batch.kernels.compiler import compiled, outermost
from pouring_robot.batch.kernels.loops import SHIFT, TURN, displace, displace_one, residual_of, triple_at
from pouring_robot.batch.kernels.newton import CLOSED, GAP_TOO_LARGE, NOT_FINITE, close_one
from pouring_robot.batch.kernels.workspace import Room
from pouring_robot.batch.structure import IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray

_ROTATION_TOLERANCE = 1e-6


@compiled
def load_state(
    star: Star, room: Room, position: FloatArray, rotation: FloatArray, joints: FloatArray, row: int
) -> bool:
    """Copy one sample's pose and joints into the room; return whether they are finite and the axes orthonormal."""
    total, skew = 0.0, 0.0
    chains, count = star.revolute.shape
    for i in range(chains):
        for k in range(count):
            room.joints[i * count + k] = joints[row, i, k]
            total += abs(joints[row, i, k])
    for c in range(3):
        room.platform[9 + c] = position[row, c]
        total += abs(position[row, c])
        for k in range(3):
            room.platform[3 * c + k] = rotation[row, c, k]
    for c in range(3):
        for k in range(c + 1):
            product = 1.0 if c == k else 0.0
            for m in range(3):
                product -= room.platform[3 * m + c] * room.platform[3 * m + k]
            skew += abs(product)
    return math.isfinite(total) and skew < _ROTATION_TOLERANCE


@compiled
def load_drives(star: Star, room: Room, drives: FloatArray, row: int) -> bool:
    """Put one sample's drive values over its joints; return whether they are finite."""
    total = 0.0
    for d in range(star.drives.shape[0]):
        room.joints[star.drives[d, 0] * star.revolute.shape[1] + star.drives[d, 1]] = drives[row, d]
        total += abs(drives[row, d])
    return math.isfinite(total)


@compiled
def load_sites(star: Star, room: Room) -> None:
    """Put all placements back to those without errors."""
    for i in range(room.sites.shape[0]):
        for k in range(room.sites.shape[1]):
            for c in range(12):
                room.sites[i, k, c] = star.placements[i, k, c]


@compiled
def finite_row(array: FloatArray, row: int) -> bool:
    """Return whether the six-component errors of a sample are finite numbers; array (n, sites, 6)."""
    total = 0.0
    for site in range(array.shape[1]):
        for c in range(6):
            total += abs(array[row, site, c])
    return math.isfinite(total)


@compiled
def place_errors(
    star: Star, room: Room, axes: FloatArray, errors: FloatArray, single_site: IntArray, row: int, first: int
) -> bool:
    """Put the errors of one sample into the room's sites; return whether they are finite.

    ``errors`` is (n, sites, 6), or (1, sites, 6) for all samples, put in place with sample ``first``, or (n, 1, 6) with
    the site of each sample in ``single_site`` (n,), or (0, ...) for none.
    """
    if errors.shape[0] == 0:
        return True
    if single_site.shape[0] > 0:
        load_sites(star, room)
        per_chain = star.placements.shape[1] - 1
        displace_one(star.placements, axes, errors[row], 0, single_site[row], per_chain, room.sites)
        return finite_row(errors, row)
    if errors.shape[0] > 1 or row == first:
        at = row if errors.shape[0] > 1 else 0
        load_sites(star, room)
        displace(star.placements, axes, errors[at], room.sites)
    return finite_row(errors, row if errors.shape[0] > 1 else 0)


@compiled
def small_gaps(star: Star, room: Room, options: FloatArray) -> bool:
    """Return whether no loop is open by more than ``options[4]`` (m) and ``options[5]`` (rad)."""
    for i in range(star.revolute.shape[0]):
        shift, turned = triple_at(room.gaps, i, SHIFT), triple_at(room.gaps, i, TURN)
        if not (dot(shift, shift) <= options[4] ** 2 and dot(turned, turned) <= options[5] ** 2):
            return False
    return True


@outermost
def close_samples(
    star: Star,
    room: Room,
    axes: FloatArray,
    first: int,
    last: int,
    drives: FloatArray,
    start_position: FloatArray,
    start_rotation: FloatArray,
    start_joints: FloatArray,
    errors: FloatArray,
    single_site: IntArray,
    options: FloatArray,
    max_iterations: int,
    position: FloatArray,
    rotation: FloatArray,
    joints: FloatArray,
    residual: FloatArray,
    iterations: IntArray,
    status: IntArray,
) -> None:
    """Close samples ``first`` to ``last``; the last six arrays are written. See the engine's ``close``."""
    chains, count = star.revolute.shape
    for row in range(first, last):
        code, steps = NOT_FINITE, 0
        sound = load_state(star, room, start_position, start_rotation, start_joints, row)
        sound = load_drives(star, room, drives, row) and sound
        if place_errors(star, room, axes, errors, single_site, row, first) and sound:
            code, steps, _ = close_one(star, room, options, max_iterations)
        if code == CLOSED and not small_gaps(star, room, options):
            code = GAP_TOO_LARGE
        status[row], iterations[row] = code, steps
        good = code == CLOSED
        for c in range(3):
            position[row, c] = room.platform[9 + c] if good else math.nan
            for k in range(3):
                rotation[row, c, k] = room.platform[3 * c + k] if good else math.nan
        for i in range(chains):
            for k in range(count):
                joints[row, i, k] = room.joints[i * count + k] if good else math.nan
            residual_of(room.gaps, i, residual, row)
            for c in range(6):
                residual[row, i, c] = residual[row, i, c] if good else math.nan
