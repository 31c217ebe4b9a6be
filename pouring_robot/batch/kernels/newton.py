"""Compiled: Newton's step, and the closure of one sample."""

from __future__ import annotations

import math

from pouring_robot.batch.kernels.algebra import cross, dot, minus
from pouring_robot.batch.kernels.compiler import compiled
from pouring_robot.batch.kernels.hessian import factorise, solve_platform
from pouring_robot.batch.kernels.loops import evaluate, joint_twist, keep_state, move, step_back, three
from pouring_robot.batch.kernels.workspace import FORCE, ORIGIN_B, TORQUE, Room
from pouring_robot.batch.structure import Star
from pouring_robot.mechanism.arrays import FloatArray

CLOSED, NOT_CONVERGED, GAP_TOO_LARGE, NOT_FINITE, SINGULAR = 0, 1, 2, 3, 4

# Share of the diagonal that keeps soft directions (1e-6 of the stiff ones) from moving.
_FLOOR_DAMPING = 1e-4


@compiled
def close_one(star: Star, room: Room, options: FloatArray, max_iterations: int) -> tuple[int, int, float]:
    """Close one sample from the state in ``room``; return status, steps taken and the largest residual component.

    ``options``: largest step that may end the search, residual that counts as closed, error that may be left, and
    length of steps that are round-off if they do not shrink.

    As ``closure.ClosureSolver``, with two refinements. The step after a short step reuses its
    factors. A step that raises the energy is followed by a damped one before it is judged: the mechanism is a million
    times stiffer in some directions than in others, so a good long step leaves the floor of a narrow curved valley,
    and the damped one, which moves in stiff directions only, returns to the floor.
    """
    step_tolerance, closed_below, left_over, round_off = options[0], options[1], options[2], options[3]
    energy, largest, length, previous = 0.0, 0.0, 0.0, math.inf
    damping, scale, share_before = 0.0, 1.0, 1.0
    # Each stage stands once in the loop: it is long once everything is inlined.
    first, stale, exact, factored, reused, to_floor = True, True, False, False, False, False
    for iteration in range(1, max_iterations + 1):
        if stale:
            trial, residual = evaluate(star, room)
            if first:
                energy, largest, first = trial, residual, False
            stale = False
        solvable = factored or factorise(star, room, exact and not to_floor, _FLOOR_DAMPING if to_floor else damping)
        if not solvable and not to_floor:
            if not exact:
                damping = max(10.0 * damping, 1e-4)
            exact = False
            continue
        accepted = False
        if solvable:
            step = solve_step(star, room)
            if not to_floor:
                length = step
                keep_state(room)
            move(star, room, 1.0 if to_floor else scale)
            trial, residual = evaluate(star, room)
            # Round-off of the energy: near the minimum it may rise by a few last digits.
            accepted = trial <= energy * (1.0 + 1e-12) + 1e-18
        short = length < step_tolerance and scale == 1.0 and not to_floor
        if accepted or short:
            sharp = (exact or residual < closed_below) and damping == 0.0 and scale == 1.0 and not to_floor
            share = length / previous if previous < math.inf else 1.0
            # The step measures the error before it; what it leaves is smaller by as much as steps shrink. The worse
            # of two steps counts: Newton may set stiff and soft directions right in turns.
            settled = length * max(share, share_before) < left_over or (share > 0.5 and previous < round_off)
            if settled and short and sharp:
                return CLOSED, iteration, residual
            # Energy that no longer falls steeply is there to stay: from here the residual's curvature counts.
            exact = residual >= closed_below and trial > 0.01 * energy
            # Factors keep while the loops' wrenches do: against soft directions even a small wrench counts.
            reused = sharp and length < 1e-5 and abs(largest - residual) < 1e-8 and not reused
            factored, to_floor = reused, False
            energy, largest, previous, share_before, scale = trial, residual, length, share, 1.0
            damping = 0.1 * damping if damping > 1e-6 else 0.0
        elif not to_floor:
            factored, to_floor = False, True
        else:
            step_back(room)
            factored, to_floor, stale, scale = False, False, True, 0.25 * scale
            if scale < 1e-3:
                scale, damping = 1.0, max(10.0 * damping, 1e-4)
    return NOT_CONVERGED, max_iterations, largest


@compiled
def solve_step(star: Star, room: Room) -> float:
    """Write the Newton step from the factorised Hessian and the present gaps; return its largest component."""
    places = len(star.passive_count)
    s, step = room.schur, room.step
    for c in range(6):
        step[c] = 0.0
    for i in range(star.revolute.shape[0]):
        force, torque = three(room.gaps[i], FORCE), three(room.gaps[i], TORQUE)
        b = three(room.gaps[i], ORIGIN_B)
        moment = cross(minus(b, three(room.platform, 9)), force)
        for c in range(3):
            step[c] -= force[c]
            step[3 + c] -= torque[c] + moment[c]
        for n in range(places):
            downhill = 0.0
            if star.passive[i, n] >= 0:
                linear, angular = joint_twist(star, room, i, star.passive[i, n], b)
                downhill = dot(linear, force) + dot(angular, torque)
            for m in range(n):
                downhill -= room.factor[i, n * places + m] * room.joint_step[i, m]
            room.joint_step[i, n] = downhill
            scaled = downhill * room.factor[i, n * places + n]
            for c in range(6):
                step[c] -= scaled * room.coupling[i, 6 * n + c]
    solve_platform(s, step)
    longest = 0.0
    for c in range(6):
        if not abs(step[c]) <= longest:
            longest = abs(step[c])
    for i in range(star.revolute.shape[0]):
        for n in range(places - 1, -1, -1):
            total = room.joint_step[i, n]
            for c in range(6):
                total -= room.coupling[i, 6 * n + c] * step[c]
            total *= room.factor[i, n * places + n]
            for m in range(n + 1, places):
                total -= room.factor[i, m * places + n] * room.joint_step[i, m]
            room.joint_step[i, n] = total
            if not abs(total) <= longest:
                longest = abs(total)
    return longest
