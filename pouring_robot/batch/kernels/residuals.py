"""Compiled by Numba: poses of the chains' ends, residuals of the loops and their energy; the arrays of all kernels.

The same formulas, for one pose and in NumPy, are in ``mechanism/closure/energy.py``, against which they are tested.
The working arrays, one workspace per thread, are made outside, so that kernels allocate nothing.
"""

import math
from typing import NamedTuple

import numpy as np

from pouring_robot.batch.kernels.algebra import (
    Rotation,
    Triple,
    combined,
    cross,
    dot,
    log_coefficients,
    minus,
    plus,
    product,
    residual_wrench,
    rotation_from_vector,
    scaled,
    turn,
    turn_back,
    turn_between,
)
from pouring_robot.batch.kernels.compiler import compiled
from pouring_robot.batch.structure import ByteArray, CountArray, IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray


class Workspace(NamedTuple):
    """Working arrays of one thread, for C chains of J joints with P passive places."""

    sites: FloatArray  # present placements, as in ``Star``, (C, J + 2, 12)
    joints: FloatArray  # values chain by chain, m or rad, (C J,)
    before: FloatArray  # joints before the step, (C J,)
    platform: FloatArray  # rotation and position of the end frame in the base frame, (12,)
    platform_before: FloatArray  # before the step, (12,)
    frames: FloatArray  # z axis (the joint's own), origin and x axis of each joint's placement, in base axes, (C, J, 9)
    # What ``evaluate`` finds about each loop, in base axes:
    origin_b: FloatArray  # origin of frame b, (C, 3)
    gap: FloatArray  # origin of b minus origin of a, (C, 3)
    turned: FloatArray  # w, which with v is log6 turned from frame b into base axes, (C, 3)
    shift: FloatArray  # v, (C, 3)
    force: FloatArray  # with which b pulls at a, (C, 3)
    torque: FloatArray  # about the origin of b, (C, 3)
    axes_a: FloatArray  # rotation of frame a, (C, 9)
    columns: FloatArray  # joint twists of the passive places about the chain's reference point, (C, 6 P)
    stiff: FloatArray  # W times the columns, (C, 6 P)
    factor: FloatArray  # unit lower triangle and inverse diagonal of each chain's L D L^T, (C, P P)
    coupling: FloatArray  # L^-1 times the chain's coupling to the platform, about the platform's origin, (C, 6 P)
    schur: FloatArray  # Cholesky factor of the platform's Schur complement, lower, with inverse diagonal, (36,)
    step: FloatArray  # of the platform, (6,)
    joint_step: FloatArray  # of the passive places, (C, P)
    matrix: FloatArray  # W of one chain, (36,)
    blocks: FloatArray  # (6, 9)
    # Of G, whose letters are those of ``transfer``:
    unit: FloatArray  # u, one row of six an output, (36,)
    multipliers: FloatArray  # lambda of the present chain, P an output, (6 P,)
    front: FloatArray  # the matrix in front of J, column by column, (36,)
    through: FloatArray  # ``E + L``, one row of six an output, (36,)
    answer: FloatArray  # ``front J`` of the present site, column by column, (36,)


class Samples(NamedTuple):
    """Where n samples start, as in ``BatchStart``, and their errors, as in ``SiteErrors``."""

    position: FloatArray
    rotation: FloatArray
    joints: FloatArray
    errors: FloatArray
    site: IntArray


class Closures(NamedTuple):
    """Results of n samples, as in ``BatchClosure``."""

    position: FloatArray
    rotation: FloatArray
    joints: FloatArray
    residual: FloatArray
    iterations: CountArray
    status: ByteArray


def make_workspace(star: Star) -> Workspace:
    """Return working arrays for a star; its sites are those without errors."""
    chains, joints = star.revolute.shape
    places = star.passive.shape[1]
    count, six = chains * joints, (chains, 6 * places)
    shapes = (count, count, 12, 12, (chains, joints, 9), *[(chains, 3)] * 6, (chains, 9), six, six)
    more = ((chains, places * places), six, 36, 6, (chains, places), 36, (6, 9), 36, 6 * places, 36, 36, 36)
    return Workspace(star.placements.copy(), *(np.zeros(shape) for shape in (*shapes, *more)))


@compiled
def three(row: FloatArray, at: int) -> Triple:
    """Return three consecutive numbers."""
    return row[at], row[at + 1], row[at + 2]


@compiled
def nine(row: FloatArray) -> Rotation:
    """Return the first nine numbers, a rotation."""
    a, b, c = three(row, 0), three(row, 3), three(row, 6)
    return a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]


@compiled
def put(row: FloatArray, at: int, a: Triple) -> None:
    """Store three consecutive numbers."""
    row[at], row[at + 1], row[at + 2] = a


@compiled
def carry(star: Star, work: Workspace, i: int) -> tuple[Rotation, Triple]:
    """Return rotation and origin of frame a of chain i, and write the frames of its joints."""
    count = star.revolute.shape[1]
    r, place = nine(work.sites[i, 0]), three(work.sites[i, 0], 9)
    for k in range(count):
        axis = (r[2], r[5], r[8])
        put(work.frames[i, k], 0, axis)
        put(work.frames[i, k], 3, place)
        put(work.frames[i, k], 6, (r[0], r[3], r[6]))
        at = i * count + k
        if star.revolute[i, k]:
            s, c = math.sin(work.joints[at]), math.cos(work.joints[at])
            x, y = (c * r[0] + s * r[1], c * r[3] + s * r[4], c * r[6] + s * r[7]), (r[1], r[4], r[7])
            y = (c * y[0] - s * r[0], c * y[1] - s * r[3], c * y[2] - s * r[6])
            r = (x[0], y[0], r[2], x[1], y[1], r[5], x[2], y[2], r[8])
        else:
            place = plus(place, scaled(work.joints[at], axis))
        place = plus(place, turn(r, three(work.sites[i, k + 1], 9)))
        r = product(r, nine(work.sites[i, k + 1]))
    return r, place


@compiled
def arm_of(work: Workspace, i: int, k: int, point: Triple) -> Triple:
    """Return the vector from joint k's origin in chain i to a point."""
    return minus(point, three(work.frames[i, k], 3))


@compiled
def joint_twist(star: Star, work: Workspace, i: int, k: int, point: Triple) -> tuple[Triple, Triple]:
    """Return the twist of joint k in chain i about a point."""
    axis = three(work.frames[i, k], 0)
    if not star.revolute[i, k]:
        return axis, (0.0, 0.0, 0.0)
    return cross(axis, arm_of(work, i, k, point)), axis


@compiled
def shift_over(gap: Triple, w: Triple, side: float) -> Triple:
    """Return ``V(side w)^-1 gap``, the translation part of log6: for a's axes (side 1) or b's (-1), in base axes."""
    c, _, _ = log_coefficients(dot(w, w))
    across = cross(w, gap)
    return combined(gap, -0.5 * side, across, c, cross(w, across))


@compiled
def evaluate(star: Star, work: Workspace) -> tuple[float, float]:
    """Write frames and gaps of all loops; return the energy (J) and the largest residual component (m or rad)."""
    kt, kr = star.stiffness[0], star.stiffness[1]
    energy, largest = 0.0, 0.0
    seat = star.revolute.shape[1] + 1
    r_platform, origin = nine(work.platform), three(work.platform, 9)
    for i in range(star.revolute.shape[0]):
        r_a, a = carry(star, work, i)
        b = plus(origin, turn(r_platform, three(work.sites[i, seat], 9)))
        w = turn_between(r_a, product(r_platform, nine(work.sites[i, seat])))
        gap = minus(b, a)
        v = shift_over(gap, w, -1.0)
        force, torque = residual_wrench(v, w, kt, kr)
        put(work.origin_b[i], 0, b)
        put(work.gap[i], 0, gap)
        put(work.turned[i], 0, w)
        put(work.shift[i], 0, v)
        put(work.force[i], 0, force)
        put(work.torque[i], 0, torque)
        for k in range(9):
            work.axes_a[i, k] = r_a[k]
        energy += 0.5 * (kt * dot(v, v) + kr * dot(w, w))
        # NaN must win: it compares false with everything.
        for value in (v[0], v[1], v[2], w[0], w[1], w[2]):
            if not abs(value) <= largest:
                largest = abs(value)
    return energy, largest


@compiled
def residual_of(work: Workspace, i: int, residual: FloatArray) -> None:
    """Write log6 of loop i, (linear, angular) in m and rad, as Pinocchio gives it, (6,)."""
    r_a, w = nine(work.axes_a[i]), three(work.turned[i], 0)
    put(residual, 0, turn_back(r_a, shift_over(three(work.gap[i], 0), w, 1.0)))
    put(residual, 3, turn_back(r_a, w))


@compiled
def branch_end(star: Star, work: Workspace, i: int) -> tuple[Rotation, Triple, Triple]:
    """Return frame a's rotation, the vector from the end frame's origin to frame a's, and the end frame's origin."""
    seat = work.sites[i, star.revolute.shape[1] + 1]
    r_a, a = carry(star, work, i)
    offset = turn(r_a, turn_back(nine(seat), three(seat, 9)))
    return r_a, offset, minus(a, offset)


@compiled
def displace(star: Star, work: Workspace, site: int, error: FloatArray) -> None:
    """Write ``placement o SE3(exp3(rotation), translation)`` of a site for its error (6,), in m and rad."""
    per_chain = star.placements.shape[1] - 1
    i, k = site // per_chain, site % per_chain
    if k == per_chain - 1:
        k += 1  # the tip stands between the joints and the seat
    axes, r = nine(star.site_axes[site]), nine(star.placements[i, k])
    turned = product(r, rotation_from_vector(turn_back(axes, three(error, 3))))
    for m in range(9):
        work.sites[i, k, m] = turned[m]
    shift = turn(r, turn_back(axes, three(error, 0)))
    put(work.sites[i, k], 9, plus(three(star.placements[i, k], 9), shift))


@compiled
def copy(numbers: FloatArray, to: FloatArray) -> None:
    """Copy numbers."""
    for at in range(numbers.size):
        to[at] = numbers[at]


@compiled
def move(star: Star, work: Workspace, share: float) -> None:
    """Move by a share of the step: a twist of the platform in base axes, and the steps of the joints."""
    step, platform = work.step, work.platform
    turned = product(rotation_from_vector(scaled(share, three(step, 3))), nine(platform))
    for k in range(9):
        platform[k] = turned[k]
    for k in range(3):
        platform[9 + k] += share * step[k]
    joints = star.revolute.shape[1]
    for i in range(star.revolute.shape[0]):
        for n in range(star.passive.shape[1]):
            if star.passive[i, n] >= 0:
                work.joints[i * joints + star.passive[i, n]] += share * work.joint_step[i, n]
