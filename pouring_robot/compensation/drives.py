"""Drive values that bring any robot as built to a target; started beside a singular pose if necessary.

The search starts at the pose of the drawing. Where an arm is stretched out, or axes of its wrist are collinear, its
drives command fewer freedoms than elsewhere. Newton then stalls although the target is near, as the effect of the
drives there is of second order. Beside the pose they command all freedoms, and Newton continues from there.
"""

from collections.abc import Iterator

import numpy as np

from pouring_robot.exceptions import NoSolutionError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.redundancy import redundant_drives
from pouring_robot.mechanism.joint_limits import joint_reach
from pouring_robot.robot.inverse import REACHED, InverseSolution, Target, bring, freedoms, longest_steps
from pouring_robot.robot.location import Location
from pouring_robot.robot.robot import Robot

_ASIDE = 1.0 / 3.0
"""Distance beside a pose, as a share of Newton's longest step: small, but not numerically singular."""


def bring_to(robot: Robot, wanted: Location, target: Target) -> tuple[InverseSolution | None, bool]:
    """Return what brings the robot as built to a target, where the drawing is at ``wanted``; and if that is singular.

    A pose is singular if the drives command more around it than in it, and Newton stalls there before the target or
    does not settle. Of all starts beside it that settle within the limits, the one with the nearest position is taken,
    then the nearest attitude, then the nearest drives; without any, or any as near, the point where Newton stalled.
    None if that is no nearer than the drives of ``wanted``, or if Newton settled nowhere.

    Raises NoSolutionError if the loops do not close on the way from the pose itself.
    """
    here = np.array(list(wanted.drives.values()))
    solver, close, start = robot.nominal_solver, robot.close_nominal, wanted.nominal.configuration
    ranks = bring(solver, close, target, here, start, ranks=None).ranks
    stood = bring(robot.actual_solver, robot.close_actual, target, here, wanted.actual.configuration, ranks)
    if stood.settled and (stood.met or sum(ranks) == min(6, len(here) - redundant_drives(solver.mechanism))):
        return stood, False

    longest, starts, found = longest_steps(solver.mechanism), [], []
    for share in _shares(len(here)):
        drives = here + _ASIDE * longest * share
        try:
            closed = close(drives, start)
            starts.append((freedoms(solver, closed, target), drives, closed.configuration))
        except NoSolutionError:
            continue  # beside the pose the loops need not close
        if len(starts) == 1 and stood.settled and sum(starts[0][0]) <= sum(ranks):
            return stood, False  # it commands no more anywhere: the robot cannot cancel what remains
    most = max((commanded for commanded, _, _ in starts), key=sum, default=ranks)

    for commanded, drives, configuration in starts:
        if commanded == most:
            try:
                one = bring(robot.actual_solver, robot.close_actual, target, drives, configuration, most)
            except NoSolutionError:
                continue  # nor on the way from there
            mechanism = robot.actual_solver.mechanism
            reach = joint_reach(mechanism, one.result.joint_values | mechanism.named_drives(one.drives))
            if one.settled and not any(joint.beyond for joint in reach):
                found.append(one)

    def nearness(one: InverseSolution) -> tuple[float, ...]:
        # Rounded, so that always the same of an elbow's two sides is taken; all that reach the target are equally near.
        errors = (max(1, round(size / REACHED)) for size in (one.place_m, one.angle_rad))
        return *errors, round(float(np.abs((one.drives - here) / longest).max()), 6)

    best = min(found, key=nearness, default=stood)
    if stood.settled and _nearer(stood.left, best.left):
        best = stood
    before = target.left(wanted.actual.pose(wanted.loops.base_frame, target.frame or str(wanted.loops.end_frame)))
    # Beside it the position has priority, as elsewhere; where Newton stalled, it may not cost attitude.
    good = best.settled and _nearer(best.left, before, at_no_cost=best is stood)
    return (best if good else None), True


def _shares(count: int) -> Iterator[FloatArray]:
    """Yield displacements, (drives,), as shares: of all drives, each by a different one, then of each drive alone."""
    apart = np.linspace(0.5, 1.0, count)
    for shares in (apart, apart * (-1.0) ** np.arange(count), *np.eye(count)):
        yield shares
        yield -shares


def _nearer(left: FloatArray, other: FloatArray, *, at_no_cost: bool = False) -> bool:
    """Return whether less is left, (6,), than other: of position, ``at_no_cost`` to attitude, or else of attitude."""
    (place, angle), (placed, turned) = (np.linalg.norm(one.reshape(2, 3), axis=1) for one in (left, other))
    if place < placed - REACHED:
        return not at_no_cost or bool(angle <= turned + REACHED)
    return bool(place <= placed + REACHED and angle < turned - REACHED)
