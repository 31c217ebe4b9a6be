r"""Compiled: Newton's step, with the chains eliminated one by one, and the closure of one sample.

Write R for the columns of the Jacobian of the relative twist of frame b against frame a by the freedoms: +I for the
platform, minus the joint's twist for a joint. In the order seat, platform, site 1, joint 1, site 2, joint 2, ... the
second derivative of the energy by an earlier freedom m and a later one n is

.. math:: \partial_m \partial_n E = R_m^T\, W\, R_n

with W of ``algebra.wrench_stiffness``, exactly, whether or not the loop is closed: the asymmetry of W is the bracket
form of the wrench, which is what the motion of the columns adds. (The derivative of a later joint's gradient by an
earlier joint turns the later one's column; in the other order it does not.)

Far from the minimum W is replaced by K at the midpoint of frames a and b, which is correct up to second-order terms in
the residual (``Jlog(e) Ad(exp(-e/2)) = I - ad(e)^2 / 24 + ...``).

The chains meet only at the platform. So each chain's joints are eliminated (``L D L^T``), the platform's 6 x 6 Schur
complement is solved, and the joints follow.
"""

import math

from pouring_robot.batch.kernels.algebra import Triple, cross, dot, minus, plus, scaled, wrench_stiffness
from pouring_robot.batch.kernels.compiler import compiled
from pouring_robot.batch.kernels.residuals import Workspace, copy, evaluate, joint_twist, move, put, three
from pouring_robot.batch.structure import Star
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.null_space import SINGULAR_RATIO
from pouring_robot.mechanism.closure.status import CLOSED, NOT_CONVERGED, STAYS, settles

# Share of the diagonal that keeps soft directions (1e-6 of the stiff ones) from moving.
_FLOOR_DAMPING = 1e-4
# A pivot that is a smaller share of its joint's stiffness is round-off of zero; the platform's, SINGULAR_RATIO of all
# loops'.
_IDLE_RATIO = 1e-12
_settles = compiled(settles)


@compiled
def close_one(star: Star, work: Workspace, options: FloatArray, max_iterations: int) -> tuple[int, int]:
    """Close one sample from the state in ``work``; return status and steps taken.

    ``options``: largest step that may end the search, residual that counts as closed, error that may be left, and
    length of steps that are round-off if they do not shrink.

    As ``closure.ClosureSolver``, except after a step that raises the energy. The solver then takes an undamped step
    before judging, and this function a damped one: the mechanism is a million times stiffer in some directions than in
    others, so a good long step leaves the floor of a narrow curved valley, and the damped one, which moves in stiff
    directions only, returns to the floor. Where that also ends higher, the solver damps the next step from the best
    state; here a quarter of the step is tried first, repeatedly.
    """
    step_tolerance, closed_below, left_over, round_off = options[0], options[1], options[2], options[3]
    energy, largest, length, previous = 0.0, 0.0, 0.0, 0.0
    damping, scale, share_before = 0.0, 1.0, 0.0
    # Each stage stands once in the loop: it is long once everything is inlined.
    first, stale, exact, factored, reused, to_floor = True, True, False, False, False, False
    for iteration in range(1, max_iterations + 1):
        if stale:
            trial, residual = evaluate(star, work)
            if first:
                energy, largest, first = trial, residual, False
            stale = False
        solvable = factored or factorise(star, work, exact and not to_floor, _FLOOR_DAMPING if to_floor else damping)
        if not solvable and not to_floor:
            if not exact:
                damping = max(10.0 * damping, 1e-4)
            exact = False
            continue
        accepted = False
        if solvable:
            step = solve_step(star, work)
            if not to_floor:
                length = step
                copy(work.platform, work.platform_before)
                copy(work.joints, work.before)
            move(star, work, 1.0 if to_floor else scale)
            trial, residual = evaluate(star, work)
            # Round-off of the energy: near the minimum it may rise by a few last digits.
            accepted = trial <= energy * (1.0 + 1e-12) + 1e-18
        short = length < step_tolerance and scale == 1.0 and not to_floor
        if accepted or short:
            sharp = (exact or residual < closed_below) and damping == 0.0 and scale == 1.0 and not to_floor
            share, settled = _settles(length, previous, share_before, left_over, round_off)
            if settled and short and sharp:
                return CLOSED, iteration
            exact = residual >= closed_below and trial > STAYS * energy
            # Factors keep while the loops' wrenches do: against soft directions even a small wrench counts.
            reused = sharp and length < 1e-5 and abs(largest - residual) < 1e-8 and not reused
            factored, to_floor = reused, False
            energy, largest, previous, share_before, scale = trial, residual, length, share, 1.0
            damping = 0.1 * damping if damping > 1e-6 else 0.0
        elif not to_floor:
            factored, to_floor = False, True
        else:
            copy(work.platform_before, work.platform)
            copy(work.before, work.joints)
            factored, to_floor, stale, scale = False, False, True, 0.25 * scale
            if scale < 1e-3:
                scale, damping = 1.0, max(10.0 * damping, 1e-4)
    return NOT_CONVERGED, max_iterations


@compiled
def solve_step(star: Star, work: Workspace) -> float:
    """Write the Newton step from the factorised Hessian and the present gaps; return its largest component."""
    places = star.passive.shape[1]
    s, step = work.schur, work.step
    step[:] = 0.0
    for i in range(star.revolute.shape[0]):
        force, torque = three(work.force[i], 0), three(work.torque[i], 0)
        b = three(work.origin_b[i], 0)
        moment = cross(minus(b, three(work.platform, 9)), force)
        for c in range(3):
            step[c] -= force[c]
            step[3 + c] -= torque[c] + moment[c]
        for n in range(places):
            downhill = 0.0
            if star.passive[i, n] >= 0:
                linear, angular = joint_twist(star, work, i, star.passive[i, n], b)
                downhill = dot(linear, force) + dot(angular, torque)
            for m in range(n):
                downhill -= work.factor[i, n * places + m] * work.joint_step[i, m]
            work.joint_step[i, n] = downhill
            scaled = downhill * work.factor[i, n * places + n]
            for c in range(6):
                step[c] -= scaled * work.coupling[i, 6 * n + c]
    solve_platform(s, step)
    longest = 0.0
    for c in range(6):
        if not abs(step[c]) <= longest:
            longest = abs(step[c])
    for i in range(star.revolute.shape[0]):
        for n in range(places - 1, -1, -1):
            total = work.joint_step[i, n]
            for c in range(6):
                total -= work.coupling[i, 6 * n + c] * step[c]
            total *= work.factor[i, n * places + n]
            for m in range(n + 1, places):
                total -= work.factor[i, m * places + n] * work.joint_step[i, m]
            work.joint_step[i, n] = total
            if not abs(total) <= longest:
                longest = abs(total)
    return longest


@compiled
def factorise(star: Star, work: Workspace, exact: bool, damping: float) -> bool:
    """Factorise the Hessian at the evaluated state; return whether it is positive semidefinite."""
    s = work.schur
    s[:] = 0.0
    for i in range(star.revolute.shape[0]):
        rho = chain_columns(star, work, i, exact)
        if not eliminate(star, work, i, rho, damping):
            return False
        add_platform_block(work, rho)
    for c in range(6):
        s[7 * c] *= 1.0 + damping
    subtract_chains(star, work)
    return cholesky(s, SINGULAR_RATIO * star.revolute.shape[0] * star.stiffness[0])


@compiled
def chain_columns(star: Star, work: Workspace, i: int, exact: bool) -> Triple:
    """Write ``matrix``, ``columns`` and ``stiff`` of chain i; return its reference point from the platform's.

    The reference point is the origin of frame b, or (not exact) the midpoint of frames a and b.
    """
    kt, kr = star.stiffness[0], star.stiffness[1]
    columns, stiff = work.columns[i], work.stiff[i]
    reference = three(work.origin_b[i], 0)
    if exact:
        wrench_stiffness(three(work.shift[i], 0), three(work.turned[i], 0), kt, kr, work.matrix, work.blocks)
    else:
        reference = minus(reference, scaled(0.5, three(work.gap[i], 0)))
        work.matrix[:] = 0.0
        for c in range(3):
            work.matrix[7 * c], work.matrix[21 + 7 * c] = kt, kr
    for n in range(star.passive.shape[1]):
        at, k = 6 * n, star.passive[i, n]
        if k < 0:
            columns[at : at + 6] = 0.0
            stiff[at : at + 6] = 0.0
            continue
        linear, angular = joint_twist(star, work, i, k, reference)
        put(columns, at, linear)
        put(columns, at + 3, angular)
        for c in range(6):
            stiff[at + c] = row_times(work.matrix, 6 * c, linear, angular)
    return minus(reference, three(work.platform, 9))


@compiled
def row_times(matrix: FloatArray, at: int, linear: Triple, angular: Triple) -> float:
    """Return the product of six consecutive numbers and a twist."""
    return dot(three(matrix, at), linear) + dot(three(matrix, at + 3), angular)


@compiled
def eliminate(star: Star, work: Workspace, i: int, rho: Triple, damping: float) -> bool:
    """Factorise chain i's own block and write its coupling; return whether the block is positive semidefinite."""
    places = star.passive.shape[1]
    d, wd, low, z = work.columns[i], work.stiff[i], work.factor[i], work.coupling[i]
    for n in range(places):
        row = n * places
        if star.passive[i, n] < 0:
            low[row : row + n] = 0.0
            low[row + n] = 1.0
            z[6 * n : 6 * n + 6] = 0.0
            continue
        force, torque = three(wd, 6 * n), three(wd, 6 * n + 3)
        # Rows are later joints: the earlier joint's column stands on the left of W.
        for m in range(n + 1):
            low[row + m] = row_times(d, 6 * m, force, torque)
        diagonal = low[row + n]
        pivot = diagonal * (1.0 + damping)
        moment = plus(torque, cross(rho, force))
        z0, z1, z2, z3, z4, z5 = -force[0], -force[1], -force[2], -moment[0], -moment[1], -moment[2]
        # The row still holds H; turned into L D from the left, then into L.
        for m in range(1, n):
            entry = low[row + m]
            for k in range(m):
                entry -= low[row + k] * low[m * places + k]
            low[row + m] = entry
        for m in range(n):
            entry, earlier = low[row + m], 6 * m
            ratio = entry * low[m * places + m]
            low[row + m] = ratio
            pivot -= ratio * entry
            z0, z1, z2 = z0 - ratio * z[earlier], z1 - ratio * z[earlier + 1], z2 - ratio * z[earlier + 2]
            z3, z4, z5 = z3 - ratio * z[earlier + 3], z4 - ratio * z[earlier + 4], z5 - ratio * z[earlier + 5]
        put(z, 6 * n, (z0, z1, z2))
        put(z, 6 * n + 3, (z3, z4, z5))
        if pivot > _IDLE_RATIO * diagonal:
            low[row + n] = 1.0 / pivot
        elif pivot > -_IDLE_RATIO * diagonal:
            low[row + n] = 0.0  # it only repeats what earlier joints do: it idles, and stays where it is
        else:
            return False
    return True


@compiled
def add_platform_block(work: Workspace, rho: Triple) -> None:
    """Add a chain's W, moved to the platform's origin, to the lower triangle of ``schur``."""
    x, y, z = rho
    m = work.matrix
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
            work.schur[6 * c + k] += 0.5 * (m[6 * c + k] + m[6 * k + c])


@compiled
def subtract_chains(star: Star, work: Workspace) -> None:
    """Subtract the Schur terms of the eliminated chains from the platform's block."""
    places = star.passive.shape[1]
    for i in range(star.revolute.shape[0]):
        for n in range(places):
            weight, z = work.factor[i, n * places + n], work.coupling[i, 6 * n : 6 * n + 6]
            for c in range(6):
                share = weight * z[c]
                for k in range(c + 1):
                    work.schur[6 * c + k] -= share * z[k]


@compiled
def cholesky(s: FloatArray, idle: float) -> bool:
    """Factorise the platform's block in place; return whether it is positive semidefinite.

    A pivot no larger than ``idle`` (N/m, and Nm/rad about a metre's arm) is round-off of zero: nothing holds the
    platform in that direction, and it does not move in it.
    """
    for c in range(6):
        for k in range(c):
            total = s[6 * c + k]
            for m in range(k):
                total -= s[6 * c + m] * s[6 * k + m]
            if s[7 * k] == 0.0 and total * total > idle * s[7 * c]:
                return False  # what idles is coupled to what does not: the block is indefinite
            s[6 * c + k] = total * s[7 * k]
        pivot = s[7 * c]
        for m in range(c):
            pivot -= s[6 * c + m] * s[6 * c + m]
        if not pivot >= -idle:
            return False
        s[7 * c] = 1.0 / math.sqrt(pivot) if pivot > idle else 0.0
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
