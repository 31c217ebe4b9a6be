r"""Compiled: Newton's step, with the chains eliminated one by one; ``newton`` takes it until a sample is closed.

Write R for the columns by which the relative twist of frame b against frame a follows the freedoms: +I for the
platform, minus the joint's twist for a joint. In the order seat, platform, site 1, joint 1, site 2, joint 2, ... the
second derivative of the energy by an earlier freedom m and a later one n is

.. math:: \partial_m \partial_n E = R_m^T\, W\, R_n

with W of ``algebra.wrench_stiffness``, exactly, whether or not the loop is closed: W lacks
symmetry by the bracket form of the wrench, which is what the motion of the columns adds. (The derivative of a later
joint's gradient by an earlier joint turns the later one's column; in the other order it does not.)

Far from the minimum W is replaced by K at the midpoint of frames a and b, where it is right to second order in the
residual (``Jlog(e) Ad(exp(-e/2)) = I - ad(e)^2 / 24 + ...``).

The chains meet in the platform only. So each chain's joints are eliminated (``L D L^T``), the platform's 6 x 6 Schur
complement is solved, and the joints follow.
"""

from __future__ import annotations

import math

from pouring_robot.batch.kernels.algebra import Triple, cross, wrench_stiffness
from pouring_robot.batch.kernels.compiler import compiled
from pouring_robot.batch.kernels.loops import GAP, ORIGIN_B, SHIFT, TURN, triple_at
from pouring_robot.batch.kernels.workspace import Room
from pouring_robot.batch.structure import Star
from pouring_robot.mechanism.arrays import FloatArray

# A pivot that is a smaller share of its joint's stiffness is round-off of zero.
_IDLE_RATIO = 1e-12


@compiled
def factorise(star: Star, room: Room, exact: bool, damping: float) -> bool:
    """Factorise the Hessian at the evaluated state; return whether it is positive definite."""
    s = room.schur
    for c in range(36):
        s[c] = 0.0
    for i in range(star.revolute.shape[0]):
        rho = chain_columns(star, room, i, exact)
        if not eliminate(star, room, i, rho, damping):
            return False
        add_platform_block(star, room, rho, exact)
    for c in range(6):
        s[7 * c] *= 1.0 + damping
    subtract_chains(star, room)
    return cholesky(s)


@compiled
def chain_columns(star: Star, room: Room, i: int, exact: bool) -> Triple:
    """Write ``columns``, ``stiff`` and (exact) ``matrix`` of chain i; return its reference point from the platform's.

    The reference point is the origin of frame b, or (not exact) the midpoint of frames a and b.
    """
    kt, kr = star.stiffness[0], star.stiffness[1]
    x, y, z = triple_at(room.gaps, i, ORIGIN_B)
    if exact:
        v, w = triple_at(room.gaps, i, SHIFT), triple_at(room.gaps, i, TURN)
        wrench_stiffness(v, w, kt, kr, room.matrix, room.blocks)
    else:
        x -= 0.5 * room.gaps[i, GAP]
        y -= 0.5 * room.gaps[i, GAP + 1]
        z -= 0.5 * room.gaps[i, GAP + 2]
    for n in range(len(star.passive_count)):
        k = star.passive[i, n]
        if k < 0:
            for c in range(6):
                room.columns[i, 6 * n + c], room.stiff[i, 6 * n + c] = 0.0, 0.0
            continue
        axis = (room.frames[i, k, 0], room.frames[i, k, 1], room.frames[i, k, 2])
        if star.revolute[i, k]:
            arm = (x - room.frames[i, k, 3], y - room.frames[i, k, 4], z - room.frames[i, k, 5])
            d0, d1, d2 = cross(axis, arm)
            d3, d4, d5 = axis
        else:
            d0, d1, d2 = axis
            d3, d4, d5 = 0.0, 0.0, 0.0
        at = 6 * n
        room.columns[i, at], room.columns[i, at + 1], room.columns[i, at + 2] = d0, d1, d2
        room.columns[i, at + 3], room.columns[i, at + 4], room.columns[i, at + 5] = d3, d4, d5
        if exact:
            m = room.matrix
            for c in range(6):
                row = 6 * c
                room.stiff[i, at + c] = (
                    m[row] * d0
                    + m[row + 1] * d1
                    + m[row + 2] * d2
                    + m[row + 3] * d3
                    + m[row + 4] * d4
                    + m[row + 5] * d5
                )
        else:
            room.stiff[i, at], room.stiff[i, at + 1], room.stiff[i, at + 2] = kt * d0, kt * d1, kt * d2
            room.stiff[i, at + 3], room.stiff[i, at + 4], room.stiff[i, at + 5] = kr * d3, kr * d4, kr * d5
    return x - room.platform[9], y - room.platform[10], z - room.platform[11]


@compiled
def eliminate(star: Star, room: Room, i: int, rho: Triple, damping: float) -> bool:
    """Factorise chain i's own block and write its coupling; return whether the block is positive semidefinite."""
    places = len(star.passive_count)
    d, wd, low, z = room.columns, room.stiff, room.factor, room.coupling
    for n in range(places):
        if star.passive[i, n] < 0:
            for m in range(n):
                low[i, n * places + m] = 0.0
            low[i, n * places + n] = 1.0
            for c in range(6):
                z[i, 6 * n + c] = 0.0
            continue
        # Rows are later joints: the earlier joint's column stands on the left of W.
        for m in range(n + 1):
            total = 0.0
            for c in range(6):
                total += d[i, 6 * m + c] * wd[i, 6 * n + c]
            low[i, n * places + m] = total
        diagonal = low[i, n * places + n]
        low[i, n * places + n] = diagonal * (1.0 + damping)
        f0, f1, f2 = wd[i, 6 * n], wd[i, 6 * n + 1], wd[i, 6 * n + 2]
        z0, z1, z2 = -f0, -f1, -f2
        z3 = -(wd[i, 6 * n + 3] + rho[1] * f2 - rho[2] * f1)
        z4 = -(wd[i, 6 * n + 4] + rho[2] * f0 - rho[0] * f2)
        z5 = -(wd[i, 6 * n + 5] + rho[0] * f1 - rho[1] * f0)
        # The row still holds H; turned into L D from the left, then into L.
        for m in range(1, n):
            entry = low[i, n * places + m]
            for k in range(m):
                entry -= low[i, n * places + k] * low[i, m * places + k]
            low[i, n * places + m] = entry
        pivot = low[i, n * places + n]
        for m in range(n):
            entry = low[i, n * places + m]
            ratio = entry * low[i, m * places + m]
            low[i, n * places + m] = ratio
            pivot -= ratio * entry
            z0 -= ratio * z[i, 6 * m]
            z1 -= ratio * z[i, 6 * m + 1]
            z2 -= ratio * z[i, 6 * m + 2]
            z3 -= ratio * z[i, 6 * m + 3]
            z4 -= ratio * z[i, 6 * m + 4]
            z5 -= ratio * z[i, 6 * m + 5]
        z[i, 6 * n], z[i, 6 * n + 1], z[i, 6 * n + 2] = z0, z1, z2
        z[i, 6 * n + 3], z[i, 6 * n + 4], z[i, 6 * n + 5] = z3, z4, z5
        if not pivot > _IDLE_RATIO * diagonal:
            if not pivot > -_IDLE_RATIO * diagonal:
                return False
            low[i, n * places + n] = 0.0  # it only repeats what earlier joints do: it idles, and stays where it is
            continue
        low[i, n * places + n] = 1.0 / pivot
    return True


@compiled
def add_platform_block(star: Star, room: Room, rho: Triple, exact: bool) -> None:
    """Add a chain's W, moved to the platform's origin, to the lower triangle of ``schur``."""
    s = room.schur
    x, y, z = rho
    if not exact:
        kt, kr = star.stiffness[0], star.stiffness[1]
        s[0] += kt
        s[7] += kt
        s[14] += kt
        # Rows 3-5: torque about the platform's origin, rho x force.
        s[19] -= kt * z
        s[20] += kt * y
        s[24] += kt * z
        s[26] -= kt * x
        s[30] -= kt * y
        s[31] += kt * x
        s[21] += kr + kt * (y * y + z * z)
        s[28] += kr + kt * (x * x + z * z)
        s[35] += kr + kt * (x * x + y * y)
        s[27] -= kt * x * y
        s[33] -= kt * x * z
        s[34] -= kt * y * z
        return
    m = room.matrix
    for c in range(6):  # torque rows: add rho x force
        f0, f1, f2 = m[c], m[6 + c], m[12 + c]
        m[18 + c] += y * f2 - z * f1
        m[24 + c] += z * f0 - x * f2
        m[30 + c] += x * f1 - y * f0
    for c in range(6):  # turning about the platform's origin: add the columns of omega x rho
        f0, f1, f2 = m[6 * c], m[6 * c + 1], m[6 * c + 2]
        m[6 * c + 3] += y * f2 - z * f1
        m[6 * c + 4] += z * f0 - x * f2
        m[6 * c + 5] += x * f1 - y * f0
    for c in range(6):
        for k in range(c + 1):
            s[6 * c + k] += 0.5 * (m[6 * c + k] + m[6 * k + c])


@compiled
def subtract_chains(star: Star, room: Room) -> None:
    """Take what the eliminated chains give way off the platform's block."""
    s, places = room.schur, len(star.passive_count)
    # The 21 entries of the lower triangle, in registers.
    s00 = s[0]
    s10, s11 = s[6], s[7]
    s20, s21, s22 = s[12], s[13], s[14]
    s30, s31, s32, s33 = s[18], s[19], s[20], s[21]
    s40, s41, s42, s43, s44 = s[24], s[25], s[26], s[27], s[28]
    s50, s51, s52, s53, s54, s55 = s[30], s[31], s[32], s[33], s[34], s[35]
    for i in range(star.revolute.shape[0]):
        for n in range(places):
            weight = room.factor[i, n * places + n]
            z0, z1, z2 = triple_at(room.coupling, i, 6 * n)
            z3, z4, z5 = triple_at(room.coupling, i, 6 * n + 3)
            y = weight * z0
            s00 -= y * z0
            y = weight * z1
            s10 -= y * z0
            s11 -= y * z1
            y = weight * z2
            s20 -= y * z0
            s21 -= y * z1
            s22 -= y * z2
            y = weight * z3
            s30 -= y * z0
            s31 -= y * z1
            s32 -= y * z2
            s33 -= y * z3
            y = weight * z4
            s40 -= y * z0
            s41 -= y * z1
            s42 -= y * z2
            s43 -= y * z3
            s44 -= y * z4
            y = weight * z5
            s50 -= y * z0
            s51 -= y * z1
            s52 -= y * z2
            s53 -= y * z3
            s54 -= y * z4
            s55 -= y * z5
    s[0] = s00
    s[6], s[7] = s10, s11
    s[12], s[13], s[14] = s20, s21, s22
    s[18], s[19], s[20], s[21] = s30, s31, s32, s33
    s[24], s[25], s[26], s[27], s[28] = s40, s41, s42, s43, s44
    s[30], s[31], s[32], s[33], s[34], s[35] = s50, s51, s52, s53, s54, s55


@compiled
def cholesky(s: FloatArray) -> bool:
    """Factorise the platform's block in place; return whether it is positive definite."""
    for c in range(6):
        for k in range(c):
            total = s[6 * c + k]
            for m in range(k):
                total -= s[6 * c + m] * s[6 * k + m]
            s[6 * c + k] = total * s[7 * k]
        pivot = s[7 * c]
        for m in range(c):
            pivot -= s[6 * c + m] * s[6 * c + m]
        if not pivot > 0.0:
            return False
        s[7 * c] = 1.0 / math.sqrt(pivot)
    return True


@compiled
def solve_platform(s: FloatArray, x: FloatArray) -> None:
    """Solve the factorised 6 x 6 system in place."""
    for c in range(6):
        total = x[c]
        for k in range(c):
            total -= s[6 * c + k] * x[k]
        x[c] = total * s[7 * c]
    for c in range(5, -1, -1):
        total = x[c]
        for k in range(c + 1, 6):
            total -= s[6 * k + c] * x[k]
        x[c] = total * s[7 * c]
