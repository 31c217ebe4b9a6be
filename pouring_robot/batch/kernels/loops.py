"""Compiled: where the chains end, how far the loops are open, and the energy of that.

Layout of the working arrays, C chains of J joints with P passive places:

- ``sites`` (C, J + 2, 12): present placements, as in :class:`~pouring_robot.batch.structure.Star`.
- ``joints`` (C J,): joint values chain by chain, m or rad; ``circle`` (2 C J,): their sines, then their cosines.
- ``platform`` (12,): rotation and position of the end frame in the base frame.
- ``frames`` (C, J, 9): z axis (the joint's own), origin and x axis of each joint's placement, in base axes.
- ``gaps`` (C, 27): what :func:`evaluate` finds about each loop, by the offsets below. All vectors in base axes; the
  residual's parts v and w are those of log6 turned from frame b into base axes.
"""

from __future__ import annotations

from pouring_robot.batch.kernels.algebra import (
    Rotation,
    Triple,
    cross,
    dot,
    log_coefficients,
    product,
    residual_wrench,
    rotation_from_vector,
    sine_cosine,
    turn,
    turn_back,
    turn_between,
)
from pouring_robot.batch.kernels.compiler import compiled
from pouring_robot.batch.structure import BoolArray
from pouring_robot.mechanism.arrays import FloatArray

ORIGIN_B = 0  # origin of frame b
GAP = 3  # origin of b minus origin of a
TURN = 6  # w
SHIFT = 9  # v
FORCE = 12
TORQUE = 15  # about the origin of b
AXES_A = 18  # rotation of frame a
GAPS_WIDTH = 27


@compiled
def rotation_at(array: FloatArray, i: int, k: int) -> Rotation:
    """Return the rotation stored at ``array[i, k]``."""
    return (
        array[i, k, 0],
        array[i, k, 1],
        array[i, k, 2],
        array[i, k, 3],
        array[i, k, 4],
        array[i, k, 5],
        array[i, k, 6],
        array[i, k, 7],
        array[i, k, 8],
    )


@compiled
def platform_rotation(platform: FloatArray) -> Rotation:
    """Return the rotation part of a pose (12,)."""
    return (
        platform[0],
        platform[1],
        platform[2],
        platform[3],
        platform[4],
        platform[5],
        platform[6],
        platform[7],
        platform[8],
    )


@compiled
def triple_at(array: FloatArray, i: int, start: int) -> Triple:
    """Return three neighbouring numbers of row i."""
    return array[i, start], array[i, start + 1], array[i, start + 2]


@compiled
def put(array: FloatArray, i: int, start: int, a: Triple) -> None:
    """Store three neighbouring numbers in row i."""
    array[i, start], array[i, start + 1], array[i, start + 2] = a


@compiled
def sines_cosines(joints: FloatArray, circle: FloatArray) -> None:
    """Write the sines of all joint values, then their cosines, into ``circle`` (2 C J,)."""
    count = joints.size
    for at in range(count):
        circle[at], circle[count + at] = sine_cosine(joints[at])


@compiled
def carry(
    sites: FloatArray, revolute: BoolArray, joints: FloatArray, circle: FloatArray, frames: FloatArray, i: int
) -> tuple[Rotation, Triple]:
    """Return rotation and origin of frame a of chain i; writes the frames of its joints.

    ``circle`` holds sine and cosine of all joints, see :func:`sines_cosines`.
    """
    count, joint_count = revolute.shape[1], joints.size
    r = rotation_at(sites, i, 0)
    x, y, z = sites[i, 0, 9], sites[i, 0, 10], sites[i, 0, 11]
    for k in range(count):
        frames[i, k, 0], frames[i, k, 1], frames[i, k, 2] = r[2], r[5], r[8]
        frames[i, k, 3], frames[i, k, 4], frames[i, k, 5] = x, y, z
        frames[i, k, 6], frames[i, k, 7], frames[i, k, 8] = r[0], r[3], r[6]
        at = i * count + k
        if revolute[i, k]:
            s, c = circle[at], circle[joint_count + at]
            r = (
                c * r[0] + s * r[1],
                c * r[1] - s * r[0],
                r[2],
                c * r[3] + s * r[4],
                c * r[4] - s * r[3],
                r[5],
                c * r[6] + s * r[7],
                c * r[7] - s * r[6],
                r[8],
            )
        else:
            value = joints[at]
            x, y, z = x + value * r[2], y + value * r[5], z + value * r[8]
        step = turn(r, (sites[i, k + 1, 9], sites[i, k + 1, 10], sites[i, k + 1, 11]))
        x, y, z = x + step[0], y + step[1], z + step[2]
        r = product(r, rotation_at(sites, i, k + 1))
    return r, (x, y, z)


@compiled
def evaluate(
    sites: FloatArray,
    revolute: BoolArray,
    stiffness: FloatArray,
    joints: FloatArray,
    circle: FloatArray,
    platform: FloatArray,
    frames: FloatArray,
    gaps: FloatArray,
) -> tuple[float, float]:
    """Write frames and gaps of all loops; return the energy (J) and the largest residual component (m or rad)."""
    kt, kr = stiffness[0], stiffness[1]
    energy, largest = 0.0, 0.0
    seat = revolute.shape[1] + 1
    sines_cosines(joints, circle)
    r_platform = platform_rotation(platform)
    for i in range(revolute.shape[0]):
        r_a, a = carry(sites, revolute, joints, circle, frames, i)
        arm = turn(r_platform, (sites[i, seat, 9], sites[i, seat, 10], sites[i, seat, 11]))
        b = (platform[9] + arm[0], platform[10] + arm[1], platform[11] + arm[2])
        w = turn_between(r_a, product(r_platform, rotation_at(sites, i, seat)))
        gap = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
        c, _, _ = log_coefficients(dot(w, w))
        wg = cross(w, gap)
        wwg = cross(w, wg)
        # Seen from frame a the translation part is V(w)^-1 gap; turned to frame b it is V(-w)^-1 gap.
        v = (
            gap[0] + 0.5 * wg[0] + c * wwg[0],
            gap[1] + 0.5 * wg[1] + c * wwg[1],
            gap[2] + 0.5 * wg[2] + c * wwg[2],
        )
        force, torque = residual_wrench(v, w, kt, kr)
        put(gaps, i, ORIGIN_B, b)
        put(gaps, i, GAP, gap)
        put(gaps, i, TURN, w)
        put(gaps, i, SHIFT, v)
        put(gaps, i, FORCE, force)
        put(gaps, i, TORQUE, torque)
        for k in range(9):
            gaps[i, AXES_A + k] = r_a[k]
        energy += 0.5 * (kt * dot(v, v) + kr * dot(w, w))
        # NaN must win: it compares false with everything.
        for value in (v[0], v[1], v[2], w[0], w[1], w[2]):
            if not abs(value) <= largest:
                largest = abs(value)
    return energy, largest


@compiled
def axes_of_a(gaps: FloatArray, i: int) -> Rotation:
    """Return the rotation of frame a of loop i."""
    return (
        gaps[i, AXES_A],
        gaps[i, AXES_A + 1],
        gaps[i, AXES_A + 2],
        gaps[i, AXES_A + 3],
        gaps[i, AXES_A + 4],
        gaps[i, AXES_A + 5],
        gaps[i, AXES_A + 6],
        gaps[i, AXES_A + 7],
        gaps[i, AXES_A + 8],
    )


@compiled
def residual_of(gaps: FloatArray, i: int, residual: FloatArray, row: int) -> None:
    """Write log6 of loop i, (linear, angular) in m and rad, as Pinocchio gives it, into ``residual[row, i]``."""
    r_a = axes_of_a(gaps, i)
    gap, w = triple_at(gaps, i, GAP), triple_at(gaps, i, TURN)
    c, _, _ = log_coefficients(dot(w, w))
    wg = cross(w, gap)
    wwg = cross(w, wg)
    v = (gap[0] - 0.5 * wg[0] + c * wwg[0], gap[1] - 0.5 * wg[1] + c * wwg[1], gap[2] - 0.5 * wg[2] + c * wwg[2])
    linear, angular = turn_back(r_a, v), turn_back(r_a, w)
    for k in range(3):
        residual[row, i, k], residual[row, i, 3 + k] = linear[k], angular[k]


@compiled
def displace(placements: FloatArray, axes: FloatArray, error: FloatArray, sites: FloatArray) -> None:
    """Write ``placement o SE3(exp3(rotation), translation)`` of every site that has an error.

    Args:
        placements: (C, J + 2, 12), before the error.
        axes: turn of each site's frame, (C (J + 1), 3, 3).
        error: translation (m) and rotation vector (rad) of each site, (C (J + 1), 6).
        sites: (C, J + 2, 12), written; sites without an error are left as they are.
    """
    per_chain = placements.shape[1] - 1
    for number in range(error.shape[0]):
        displace_one(placements, axes, error, number, number, per_chain, sites)


@compiled
def displace_one(
    placements: FloatArray, axes: FloatArray, error: FloatArray, row: int, site: int, per_chain: int, sites: FloatArray
) -> None:
    """Displace one site by row ``row`` of ``error``; see :func:`displace`."""
    e = (error[row, 0], error[row, 1], error[row, 2], error[row, 3], error[row, 4], error[row, 5])
    if e[0] == 0.0 and e[1] == 0.0 and e[2] == 0.0 and e[3] == 0.0 and e[4] == 0.0 and e[5] == 0.0:
        return
    i, k = site // per_chain, site % per_chain
    if k == per_chain - 1:
        k += 1  # the tip stands between the joints and the seat
    a = (
        axes[site, 0, 0],
        axes[site, 0, 1],
        axes[site, 0, 2],
        axes[site, 1, 0],
        axes[site, 1, 1],
        axes[site, 1, 2],
        axes[site, 2, 0],
        axes[site, 2, 1],
        axes[site, 2, 2],
    )
    r = rotation_at(placements, i, k)
    shift = turn(r, turn_back(a, (e[0], e[1], e[2])))
    turned = product(r, rotation_from_vector(turn_back(a, (e[3], e[4], e[5]))))
    for m in range(9):
        sites[i, k, m] = turned[m]
    for m in range(3):
        sites[i, k, 9 + m] = placements[i, k, 9 + m] + shift[m]


@compiled
def move_platform(platform: FloatArray, step: FloatArray, factor: float) -> None:
    """Move the platform by a twist step (velocity of its origin, angular velocity; base axes), in place."""
    turned = product(
        rotation_from_vector((factor * step[3], factor * step[4], factor * step[5])), platform_rotation(platform)
    )
    for k in range(9):
        platform[k] = turned[k]
    for k in range(3):
        platform[9 + k] += factor * step[k]
