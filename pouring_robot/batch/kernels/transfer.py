r"""Compiled: the error-transfer matrix G of many samples.

At the minimum ``dx = -H^-1 dg/dp``. Only the platform's rows are wanted, so H^-1 is applied to the platform's unit
vectors once (adjoint): the platform part u of the answer is the inverse Schur complement, its joints are
:math:`\lambda`. In the order of freedoms of :mod:`pouring_robot.batch.kernels.hessian`, a parameter that moves frame a
with the twist J and stands after the earlier joints m has

.. math:: G = (E^T W + L^T W^T) J, \quad E = u - \sum_{earlier} D_m \lambda_m, \quad L = -\sum_{later} D_m \lambda_m

and a seat, which moves frame b and comes first, :math:`G = -(E + L)^T W^T J`. Passing joint k changes the matrix
in front of J by the dyad of :math:`\lambda_k` and :math:`(W - W^T) D_k`, the bracket form of the wrench applied to D_k.

Matrices of six output rows are stored column by column, so that a loop over rows is one run of neighbours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pouring_robot.batch.kernels.algebra import Rotation, Triple, cross, product, turn, turn_back
from pouring_robot.batch.kernels.compiler import compiled, outermost
from pouring_robot.batch.kernels.hessian import chain_columns, factorise, solve_platform
from pouring_robot.batch.kernels.loops import (
    FORCE,
    ORIGIN_B,
    TORQUE,
    carry,
    platform_rotation,
    rotation_at,
    sines_cosines,
    triple_at,
)
from pouring_robot.batch.kernels.newton import CLOSED, NOT_FINITE, SINGULAR
from pouring_robot.batch.kernels.samples import load_state, place_errors
from pouring_robot.batch.kernels.workspace import Room, evaluate_room
from pouring_robot.batch.structure import IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray

# Loops open by less carry no wrench that counts (m or rad).
_SECOND_ORDER_ABOVE = 1e-12
# A pivot of the platform's block that is a smaller share of the chains' stiffness is round-off of zero.
_SINGULAR_RATIO = 1e-13


class TransferRoom(NamedTuple):
    """Working arrays of one thread; see the module for the letters.

    Attributes:
        unit: u, one row of six an output, (36,).
        multipliers: lambda of the present chain, P an output, (6 P,).
        front: the matrix in front of J, (36,), column by column.
        through: ``E + L``, one row of six an output, (36,).
        site: ``front J`` of the present site, (36,), column by column.
        column: six numbers.
    """

    unit: FloatArray
    multipliers: FloatArray
    front: FloatArray
    through: FloatArray
    site: FloatArray
    column: FloatArray


class Columns(NamedTuple):
    """Which columns G has.

    Attributes:
        site_start: columns of site s are ``order[site_start[s] : site_start[s + 1]]``, (sites + 1,).
        order: column numbers by site.
        twists: the twist of each placement column, in the site's turned axes, (columns, 6).
        drives: column of each drive or -1, (drives,).
    """

    site_start: IntArray
    order: IntArray
    twists: FloatArray
    drives: IntArray


def make_transfer_room(star: Star) -> TransferRoom:
    """Return working arrays for a star."""
    return TransferRoom(
        np.zeros(36), np.zeros(6 * len(star.passive_count)), np.zeros(36), np.zeros(36), np.zeros(36), np.zeros(6)
    )


@compiled
def fill_row(matrix: FloatArray, row: int, value: float) -> None:
    """Set G of one sample to one value; matrix (n, columns, 6)."""
    for p in range(matrix.shape[1]):
        for r in range(6):
            matrix[row, p, r] = value


@compiled
def determined(star: Star, room: Room) -> bool:
    """Return whether no pivot of the factorised platform's block is round-off: the drives determine the platform."""
    largest = 0.0
    for c in range(6):
        largest = max(largest, room.schur[7 * c])  # the diagonal holds one over the pivot's root
    return bool(_SINGULAR_RATIO * star.revolute.shape[0] * star.stiffness[0] * largest * largest < 1.0)


@compiled
def invert_platform(room: Room, work: TransferRoom) -> None:
    """Write u: the inverse Schur complement."""
    for r in range(6):
        for c in range(6):
            work.column[c] = 1.0 if c == r else 0.0
        solve_platform(room.schur, work.column)
        for c in range(6):
            work.unit[6 * r + c] = work.column[c]


@compiled
def enter_chain(star: Star, room: Room, work: TransferRoom, i: int, exact: bool) -> Triple:
    """Write lambda, ``front`` before the first joint and ``through`` of chain i; return its reference point."""
    places = len(star.passive_count)
    kt, kr = star.stiffness[0], star.stiffness[1]
    rho = chain_columns(star, room, i, exact)
    for r in range(6):
        u = 6 * r
        for n in range(places - 1, -1, -1):
            total = 0.0
            for c in range(6):
                total -= room.coupling[i, 6 * n + c] * work.unit[u + c]
            total *= room.factor[i, n * places + n]
            for m in range(n + 1, places):
                total -= room.factor[i, m * places + n] * work.multipliers[r * places + m]
            work.multipliers[r * places + n] = total
        spin = (work.unit[u + 3], work.unit[u + 4], work.unit[u + 5])
        lever = cross(spin, rho)
        q0, q1, q2 = work.unit[u] + lever[0], work.unit[u + 1] + lever[1], work.unit[u + 2] + lever[2]
        q3, q4, q5 = spin
        if exact:
            m_ = room.matrix
            for c in range(6):
                work.front[6 * c + r] = (
                    m_[c] * q0 + m_[6 + c] * q1 + m_[12 + c] * q2 + m_[18 + c] * q3 + m_[24 + c] * q4 + m_[30 + c] * q5
                )
        else:
            work.front[r], work.front[6 + r], work.front[12 + r] = kt * q0, kt * q1, kt * q2
            work.front[18 + r], work.front[24 + r], work.front[30 + r] = kr * q3, kr * q4, kr * q5
        through = work.through
        through[u], through[u + 1], through[u + 2], through[u + 3], through[u + 4], through[u + 5] = (
            q0,
            q1,
            q2,
            q3,
            q4,
            q5,
        )
        for n in range(places):
            share = work.multipliers[r * places + n]
            for c in range(6):
                work.front[6 * c + r] -= share * room.stiff[i, 6 * n + c]
                through[u + c] -= share * room.columns[i, 6 * n + c]
    return rho[0] + room.platform[9], rho[1] + room.platform[10], rho[2] + room.platform[11]


@compiled
def bracket(room: Room, i: int, d: tuple[Triple, Triple]) -> tuple[Triple, Triple]:
    """Return the bracket form of loop i's wrench applied to a twist about frame b: ``(W^T - W) D``."""
    force, torque = triple_at(room.gaps, i, FORCE), triple_at(room.gaps, i, TORQUE)
    linear = cross(d[1], force)
    one, two = cross(d[0], force), cross(d[1], torque)
    return linear, (one[0] + two[0], one[1] + two[1], one[2] + two[2])


@compiled
def pass_joint(star: Star, room: Room, work: TransferRoom, i: int, n: int) -> None:
    """Change ``front`` as passive place n of chain i turns from a later into an earlier freedom."""
    d = (triple_at(room.columns, i, 6 * n), triple_at(room.columns, i, 6 * n + 3))
    linear, angular = bracket(room, i, d)
    places = len(star.passive_count)
    for c in range(3):
        for r in range(6):
            share = work.multipliers[r * places + n]
            work.front[6 * c + r] -= share * linear[c]
            work.front[18 + 6 * c + r] -= share * angular[c]


@compiled
def turn_to_seat(room: Room, work: TransferRoom, i: int, exact: bool) -> None:
    """Turn ``front`` behind the last joint, ``(E + L)^T W``, into the seat's ``-(E + L)^T W^T``."""
    for c in range(36):
        work.front[c] = -work.front[c]
    if exact:
        for r in range(6):
            q = work.through
            at = 6 * r
            linear, angular = bracket(room, i, ((q[at], q[at + 1], q[at + 2]), (q[at + 3], q[at + 4], q[at + 5])))
            for c in range(3):
                work.front[6 * c + r] += linear[c]
                work.front[18 + 6 * c + r] += angular[c]


@compiled
def apply_front(work: TransferRoom, linear: Triple, angular: Triple, at: int) -> None:
    """Write ``front`` times a twist into column ``at`` of ``site``."""
    f = work.front
    for r in range(6):
        work.site[6 * at + r] = (
            f[r] * linear[0]
            + f[6 + r] * linear[1]
            + f[12 + r] * linear[2]
            + f[18 + r] * angular[0]
            + f[24 + r] * angular[1]
            + f[30 + r] * angular[2]
        )


@compiled
def apply_site(work: TransferRoom, axes: tuple[Triple, Triple, Triple], arm: Triple) -> None:
    """Write ``front J`` for a site with the given axes; ``arm`` goes from its origin to the reference point."""
    nothing = (0.0, 0.0, 0.0)
    for k in range(3):
        axis = axes[k]
        apply_front(work, axis, nothing, k)
        apply_front(work, cross(axis, arm), axis, 3 + k)


@compiled
def write_columns(work: TransferRoom, columns: Columns, site: int, matrix: FloatArray, row: int) -> None:
    """Write G's columns of one site."""
    s = work.site
    for at in range(columns.site_start[site], columns.site_start[site + 1]):
        p = columns.order[at]
        t = columns.twists
        t0, t1, t2, t3, t4, t5 = t[p, 0], t[p, 1], t[p, 2], t[p, 3], t[p, 4], t[p, 5]
        for r in range(6):
            matrix[row, p, r] = (
                s[r] * t0 + s[6 + r] * t1 + s[12 + r] * t2 + s[18 + r] * t3 + s[24 + r] * t4 + s[30 + r] * t5
            )


@compiled
def axes_from(r: Rotation) -> tuple[Triple, Triple, Triple]:
    """Return the three axes of a rotation."""
    return (r[0], r[3], r[6]), (r[1], r[4], r[7]), (r[2], r[5], r[8])


@compiled
def site_axes(room: Room, i: int, k: int) -> tuple[Triple, Triple, Triple]:
    """Return the axes of joint k's placement in chain i."""
    z = (room.frames[i, k, 0], room.frames[i, k, 1], room.frames[i, k, 2])
    x = (room.frames[i, k, 6], room.frames[i, k, 7], room.frames[i, k, 8])
    return x, cross(z, x), z


@compiled
def joint_twist(star: Star, room: Room, i: int, k: int, reference: Triple) -> tuple[Triple, Triple]:
    """Return joint k's twist about a point."""
    axis = (room.frames[i, k, 0], room.frames[i, k, 1], room.frames[i, k, 2])
    if not star.revolute[i, k]:
        return axis, (0.0, 0.0, 0.0)
    return cross(axis, arm_of(room, i, k, reference)), axis


@compiled
def arm_of(room: Room, i: int, k: int, reference: Triple) -> Triple:
    """Return the vector from joint k's origin to a point."""
    frames = room.frames
    return reference[0] - frames[i, k, 3], reference[1] - frames[i, k, 4], reference[2] - frames[i, k, 5]


@compiled
def transfer_one(
    star: Star, room: Room, work: TransferRoom, columns: Columns, matrix: FloatArray, row: int, exact: bool
) -> None:
    """Write G of the evaluated and factorised sample."""
    invert_platform(room, work)
    joints = star.revolute.shape[1]
    for i in range(star.revolute.shape[0]):
        reference = enter_chain(star, room, work, i, exact)
        for k in range(joints):
            site = i * (joints + 1) + k
            if columns.site_start[site] < columns.site_start[site + 1]:
                apply_site(work, site_axes(room, i, k), arm_of(room, i, k, reference))
                write_columns(work, columns, site, matrix, row)
            n = star.place[i, k]
            if n >= 0:
                if exact:
                    pass_joint(star, room, work, i, n)
                continue
            for d in range(star.drives.shape[0]):
                if star.drives[d, 0] == i and star.drives[d, 1] == k and columns.drives[d] >= 0:
                    linear, angular = joint_twist(star, room, i, k, reference)
                    apply_front(work, linear, angular, 0)
                    for r in range(6):
                        matrix[row, columns.drives[d], r] = work.site[r]
        turn_to_seat(room, work, i, exact)
        seat = i * (joints + 1) + joints
        b = triple_at(room.gaps, i, ORIGIN_B)
        arm = (reference[0] - b[0], reference[1] - b[1], reference[2] - b[2])
        turned = product(platform_rotation(room.platform), rotation_at(room.sites, i, joints + 1))
        apply_site(work, axes_from(turned), arm)
        write_columns(work, columns, seat, matrix, row)


@compiled
def write_branch_column(matrix: FloatArray, row: int, p: int, sign: float, linear: Triple, angular: Triple) -> None:
    """Write one column of an open branch's G."""
    for c in range(3):
        matrix[row, p, c], matrix[row, p, 3 + c] = sign * linear[c], sign * angular[c]


@compiled
def write_branch_site(
    columns: Columns,
    site: int,
    matrix: FloatArray,
    row: int,
    sign: float,
    axes: tuple[Triple, Triple, Triple],
    arm: Triple,
) -> None:
    """Write an open branch's columns of one site; ``arm`` goes from its origin to the platform's."""
    x, y, z = axes
    t = columns.twists
    for at in range(columns.site_start[site], columns.site_start[site + 1]):
        p = columns.order[at]
        shift = (
            x[0] * t[p, 0] + y[0] * t[p, 1] + z[0] * t[p, 2],
            x[1] * t[p, 0] + y[1] * t[p, 1] + z[1] * t[p, 2],
            x[2] * t[p, 0] + y[2] * t[p, 1] + z[2] * t[p, 2],
        )
        spin = (
            x[0] * t[p, 3] + y[0] * t[p, 4] + z[0] * t[p, 5],
            x[1] * t[p, 3] + y[1] * t[p, 4] + z[1] * t[p, 5],
            x[2] * t[p, 3] + y[2] * t[p, 4] + z[2] * t[p, 5],
        )
        lever = cross(spin, arm)
        linear = (shift[0] + lever[0], shift[1] + lever[1], shift[2] + lever[2])
        write_branch_column(matrix, row, p, sign, linear, spin)


@compiled
def branch_end(star: Star, room: Room, i: int) -> tuple[Rotation, Triple, Triple]:
    """Return frame a's rotation, the way from the end frame's origin to frame a's, and the end frame's origin."""
    seat_at = star.revolute.shape[1] + 1
    r_a, a = carry(room.sites, star.revolute, room.joints, room.circle, room.frames, i)
    way = (room.sites[i, seat_at, 9], room.sites[i, seat_at, 10], room.sites[i, seat_at, 11])
    offset = turn(r_a, turn_back(rotation_at(room.sites, i, seat_at), way))
    return r_a, offset, (a[0] - offset[0], a[1] - offset[1], a[2] - offset[2])


@outermost
def transfer_samples(
    star: Star,
    room: Room,
    work: TransferRoom,
    axes: FloatArray,
    first: int,
    last: int,
    position: FloatArray,
    rotation: FloatArray,
    joints: FloatArray,
    errors: FloatArray,
    single_site: IntArray,
    columns: Columns,
    matrix: FloatArray,
    status: IntArray,
) -> None:
    """Write G (n, columns, 6) of closed samples ``first`` to ``last``; a sample not closed (NaN) gives NaN."""
    for row in range(first, last):
        status[row] = NOT_FINITE
        sound = load_state(star, room, position, rotation, joints, row)
        if place_errors(star, room, axes, errors, single_site, row, first) and sound:
            _, residual = evaluate_room(star, room)
            exact = residual >= _SECOND_ORDER_ABOVE
            status[row] = SINGULAR
            if factorise(star, room, exact, 0.0) and determined(star, room):
                status[row] = CLOSED
        if status[row] == CLOSED:
            transfer_one(star, room, work, columns, matrix, row, exact)
        else:
            fill_row(matrix, row, math.nan)


@outermost
def branch_samples(
    star: Star,
    room: Room,
    axes: FloatArray,
    first: int,
    last: int,
    joints: FloatArray,
    errors: FloatArray,
    single_site: IntArray,
    columns: Columns,
    matrix: FloatArray,
    status: IntArray,
) -> None:
    """Write the open branches' G (n, columns, 6) of samples ``first`` to ``last``.

    A column is the twist of the end frame carried by its own chain alone, all joints held.
    """
    chains, count = star.revolute.shape
    for row in range(first, last):
        total = 0.0
        for i in range(chains):
            for k in range(count):
                room.joints[i * count + k] = joints[row, i, k]
                total += abs(joints[row, i, k])
        if not (place_errors(star, room, axes, errors, single_site, row, first) and math.isfinite(total)):
            status[row] = NOT_FINITE
            fill_row(matrix, row, math.nan)
            continue
        status[row] = CLOSED
        sines_cosines(room.joints, room.circle)
        for i in range(chains):
            r_a, offset, end = branch_end(star, room, i)
            for k in range(count):
                site = i * (count + 1) + k
                write_branch_site(columns, site, matrix, row, 1.0, site_axes(room, i, k), arm_of(room, i, k, end))
            arm = (-offset[0], -offset[1], -offset[2])
            write_branch_site(columns, i * (count + 1) + count, matrix, row, -1.0, axes_from(r_a), arm)
            for d in range(star.drives.shape[0]):
                if star.drives[d, 0] == i and columns.drives[d] >= 0:
                    linear, angular = joint_twist(star, room, i, star.drives[d, 1], end)
                    write_branch_column(matrix, row, columns.drives[d], 1.0, linear, angular)
