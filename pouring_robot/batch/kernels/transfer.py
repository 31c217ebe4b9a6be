r"""Compiled: the error-transfer matrix G of many samples.

At the minimum ``dx = -H^-1 dg/dp``. Only the platform's rows are needed, so H^-1 is applied once to the platform's unit
vectors (adjoint method): the platform part u of the solution is the inverse Schur complement, its joint part is
:math:`\lambda`. In the order of freedoms of :mod:`pouring_robot.batch.kernels.closing`, a parameter that moves frame a
with the twist J and comes after the earlier joints m has

.. math:: G = (E^T W + L^T W^T) J, \quad E = u - \sum_{earlier} D_m \lambda_m, \quad L = -\sum_{later} D_m \lambda_m

and a seat, which moves frame b and comes first, :math:`G = -(E + L)^T W^T J`. Passing joint k changes the matrix
in front of J by the dyad of :math:`\lambda_k` and :math:`(W - W^T) D_k`, minus the bracket form of the wrench applied
to D_k.

Matrices of six output rows are stored by column, so that a loop over rows reads consecutive memory.
"""

import math
from typing import NamedTuple

from pouring_robot.batch.kernels.algebra import (
    Rotation,
    Triple,
    combined,
    cross,
    minus,
    plus,
    product,
    scaled,
    transposed,
)
from pouring_robot.batch.kernels.closing import chain_columns, factorise, row_times, solve_platform
from pouring_robot.batch.kernels.compiler import compiled, outermost
from pouring_robot.batch.kernels.residuals import (
    Samples,
    Workspace,
    arm_of,
    branch_end,
    evaluate,
    joint_twist,
    nine,
    put,
    three,
)
from pouring_robot.batch.kernels.samples import Rows, load_joints, load_state, place_errors
from pouring_robot.batch.structure import ByteArray, IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.status import CLOSED, NOT_FINITE, SINGULAR

# Loops open by less carry no wrench that counts (m or rad).
_SECOND_ORDER_ABOVE = 1e-12


class Columns(NamedTuple):
    """The columns of G."""

    site_start: IntArray  # columns of site s are ``order[site_start[s] : site_start[s + 1]]``, (sites + 1,)
    order: IntArray  # column numbers by site
    twists: FloatArray  # the twist of each placement column, in the site's turned axes, (columns, 6)
    drives: IntArray  # column of each drive or -1, (drives,)


@compiled
def determined(work: Workspace) -> bool:
    """Return whether no pivot of the factorised platform's block is round-off: the drives determine the platform."""
    least = math.inf
    for c in range(6):
        least = min(least, work.schur[7 * c])  # see ``closing.cholesky``
    return bool(least > 0.0)


@compiled
def enter_chain(star: Star, work: Workspace, i: int, exact: bool) -> Triple:
    """Write lambda, ``front`` before the first joint and ``through`` of chain i; return its reference point."""
    places = star.passive.shape[1]
    rho = chain_columns(star, work, i, exact)
    coupling, factor, w = work.coupling[i], work.factor[i], work.matrix
    for r in range(6):
        u, own = 6 * r, r * places
        force, spin = three(work.unit, u), three(work.unit, u + 3)
        for n in range(places - 1, -1, -1):
            total = -row_times(coupling, 6 * n, force, spin) * factor[n * places + n]
            for m in range(n + 1, places):
                total -= factor[m * places + n] * work.multipliers[own + m]
            work.multipliers[own + n] = total
        through = work.through[u : u + 6]
        put(through, 0, plus(force, cross(spin, rho)))
        put(through, 3, spin)
        for c in range(6):
            total = 0.0
            for k in range(6):
                total += w[6 * k + c] * through[k]
            work.front[6 * c + r] = total
        for n in range(places):
            share = work.multipliers[own + n]
            for c in range(6):
                work.front[6 * c + r] -= share * work.stiff[i, 6 * n + c]
                through[c] -= share * work.columns[i, 6 * n + c]
    return plus(rho, three(work.platform, 9))


@compiled
def bracket(work: Workspace, i: int, linear: Triple, angular: Triple) -> tuple[Triple, Triple]:
    """Return the bracket form of loop i's wrench applied to a twist about frame b: ``(W^T - W) D``."""
    force, torque = three(work.force[i], 0), three(work.torque[i], 0)
    return cross(angular, force), plus(cross(linear, force), cross(angular, torque))


@compiled
def add_to_front(work: Workspace, r: int, share: float, twist: tuple[Triple, Triple]) -> None:
    """Add a share of a twist to row r of ``front``."""
    for c in range(3):
        work.front[6 * c + r] += share * twist[0][c]
        work.front[18 + 6 * c + r] += share * twist[1][c]


@compiled
def apply_front(work: Workspace, linear: Triple, angular: Triple, at: int) -> None:
    """Write ``front`` times a twist into column ``at`` of ``answer``."""
    f = work.front
    for r in range(6):
        along = f[r] * linear[0] + f[6 + r] * linear[1] + f[12 + r] * linear[2]
        work.answer[6 * at + r] = along + f[18 + r] * angular[0] + f[24 + r] * angular[1] + f[30 + r] * angular[2]


@compiled
def write_site(work: Workspace, columns: Columns, site: int, axes: Rotation, arm: Triple, matrix: FloatArray) -> None:
    """Write G's columns of a site with the given axes (rows); ``arm`` goes from its origin to the reference point."""
    for k in range(3):
        axis = (axes[3 * k], axes[3 * k + 1], axes[3 * k + 2])
        apply_front(work, axis, (0.0, 0.0, 0.0), k)
        apply_front(work, cross(axis, arm), axis, 3 + k)
    s = work.answer
    for at in range(columns.site_start[site], columns.site_start[site + 1]):
        p = columns.order[at]
        t = columns.twists[p]
        for r in range(6):
            along = s[r] * t[0] + s[6 + r] * t[1] + s[12 + r] * t[2]
            matrix[p, r] = along + s[18 + r] * t[3] + s[24 + r] * t[4] + s[30 + r] * t[5]


@compiled
def site_axes(work: Workspace, i: int, k: int) -> Rotation:
    """Return the axes of joint k's placement in chain i, as rows."""
    z, x = three(work.frames[i, k], 0), three(work.frames[i, k], 6)
    y = cross(z, x)
    return x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]


@compiled
def transfer_one(star: Star, work: Workspace, columns: Columns, matrix: FloatArray, exact: bool) -> None:
    """Write G (columns, 6) of the evaluated and factorised sample."""
    work.unit[:] = 0.0
    for r in range(6):  # u is the inverse Schur complement
        work.unit[7 * r] = 1.0
        solve_platform(work.schur, work.unit[6 * r : 6 * r + 6])
    joints, places = star.revolute.shape[1], star.passive.shape[1]
    for i in range(star.revolute.shape[0]):
        reference = enter_chain(star, work, i, exact)
        for k in range(joints):
            site = i * (joints + 1) + k
            if columns.site_start[site] < columns.site_start[site + 1]:
                write_site(work, columns, site, site_axes(work, i, k), arm_of(work, i, k, reference), matrix)
            n = star.place[i, k]
            if n >= 0 and exact:  # passive place n turns from a later into an earlier freedom
                turned = bracket(work, i, three(work.columns[i], 6 * n), three(work.columns[i], 6 * n + 3))
                for r in range(6):
                    add_to_front(work, r, -work.multipliers[r * places + n], turned)
            for d in range(star.drives.shape[0]):
                if star.drives[d, 0] == i and star.drives[d, 1] == k and columns.drives[d] >= 0:
                    linear, angular = joint_twist(star, work, i, k, reference)
                    apply_front(work, linear, angular, 0)
                    for r in range(6):
                        matrix[columns.drives[d], r] = work.answer[r]
        # ``front`` behind the last joint, (E + L)^T W, turns into the seat's -(E + L)^T W^T.
        for c in range(36):
            work.front[c] = -work.front[c]
        for r in range(6 if exact else 0):
            add_to_front(work, r, 1.0, bracket(work, i, three(work.through, 6 * r), three(work.through, 6 * r + 3)))
        arm = minus(reference, three(work.origin_b[i], 0))
        turned_axes = product(nine(work.platform), nine(work.sites[i, joints + 1]))
        write_site(work, columns, i * (joints + 1) + joints, transposed(turned_axes), arm, matrix)


@compiled
def write_branch_site(
    columns: Columns, site: int, matrix: FloatArray, sign: float, axes: Rotation, arm: Triple
) -> None:
    """Write an open branch's columns of a site with axes (rows); ``arm`` goes from its origin to the platform's."""
    x, y, z = (axes[0], axes[1], axes[2]), (axes[3], axes[4], axes[5]), (axes[6], axes[7], axes[8])
    for at in range(columns.site_start[site], columns.site_start[site + 1]):
        p = columns.order[at]
        t = columns.twists[p]
        shift = combined(scaled(t[0], x), t[1], y, t[2], z)
        spin = combined(scaled(t[3], x), t[4], y, t[5], z)
        put(matrix[p], 0, scaled(sign, plus(shift, cross(spin, arm))))
        put(matrix[p], 3, scaled(sign, spin))


@outermost
def transfer_samples(
    star: Star, work: Workspace, samples: Samples, columns: Columns, matrix: FloatArray, status: ByteArray, rows: Rows
) -> None:
    """Write G (n, columns, 6) of closed samples; a sample not closed (NaN) gives NaN."""
    first, last = rows
    for row in range(first, last):
        status[row] = NOT_FINITE
        sound = load_state(star, work, samples, row)
        if place_errors(star, work, samples, row, first) and sound:
            _, residual = evaluate(star, work)
            exact = residual >= _SECOND_ORDER_ABOVE
            status[row] = SINGULAR
            if factorise(star, work, exact, 0.0) and determined(work):
                status[row] = CLOSED
        if status[row] == CLOSED:
            transfer_one(star, work, columns, matrix[row], exact)
        else:
            matrix[row, :, :] = math.nan


@outermost
def branch_samples(
    star: Star, work: Workspace, samples: Samples, columns: Columns, matrix: FloatArray, status: ByteArray, rows: Rows
) -> None:
    """Write the open branches' G (n, columns, 6) of samples, of which only the joints count.

    A column is the twist of the end frame carried by its own chain alone, all joints held.
    """
    (first, last), (chains, count) = rows, star.revolute.shape
    for row in range(first, last):
        sound = load_joints(star, work, samples.joints[row])
        if not (place_errors(star, work, samples, row, first) and sound):
            status[row] = NOT_FINITE
            matrix[row, :, :] = math.nan
            continue
        status[row] = CLOSED
        for i in range(chains):
            r_a, offset, end = branch_end(star, work, i)
            for k in range(count):
                site = i * (count + 1) + k
                write_branch_site(columns, site, matrix[row], 1.0, site_axes(work, i, k), arm_of(work, i, k, end))
            seat = i * (count + 1) + count
            write_branch_site(columns, seat, matrix[row], -1.0, transposed(r_a), scaled(-1.0, offset))
            for d in range(star.drives.shape[0]):
                if star.drives[d, 0] == i and columns.drives[d] >= 0:
                    linear, angular = joint_twist(star, work, i, star.drives[d, 1], end)
                    put(matrix[row, columns.drives[d]], 0, linear)
                    put(matrix[row, columns.drives[d]], 3, angular)
