"""Drives that bring any robot as built to a target; beside a singular pose where need be.

They are searched from where the drawing stands. Where an arm is stretched out, or axes of its wrist lie on one line,
its drives command less than elsewhere. Newton then stands still although the target is near, as what they do to it
there grows with their square. Beside the pose they command all that they ever do, and Newton goes on from there.
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
"""How far beside a pose, of Newton's longest step: small, and far from being singular for lack of digits."""


def bring_to(robot: Robot, wanted: Location, target: Target) -> tuple[InverseSolution | None, bool]:
    """Return what brings the robot as built to a target, where the drawing stands at ``wanted``; and if it is singular.

    Singular is a pose around which the drives command more than in it, where Newton stands still without having met
    the target, or does not settle. Of all starts beside it that settle within the limits, the nearest place counts,
    then the nearest attitude, then the nearest drives. Where there is none, or none as near, it is where Newton stood
    still. None if that is no nearer than the drives of ``wanted``, or if Newton settled nowhere.

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
            return stood, False  # it commands no more anywhere: what is left is what it cannot do
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
        # Rounded, so that of an elbow's two sides it is always the same that is taken; what is met is equally near.
        left = (max(1, round(size / REACHED)) for size in (one.place_m, one.angle_rad))
        return *left, round(float(np.abs((one.drives - here) / longest).max()), 6)

    best = min(found, key=nearness, default=stood)
    if stood.settled and _nearer(stood.left, best.left):
        best = stood
    before = target.left(wanted.actual.pose(wanted.loops.base_frame, target.frame or str(wanted.loops.end_frame)))
    # Beside it the place comes first, as elsewhere; where Newton stood still, an attitude is no price for it.
    good = best.settled and _nearer(best.left, before, at_no_cost=best is stood)
    return (best if good else None), True


def _shares(count: int) -> Iterator[FloatArray]:
    """Yield displacements, (drives,), in shares: of all drives, none as much as another, then of each alone."""
    apart = np.linspace(0.5, 1.0, count)
    for shares in (apart, apart * (-1.0) ** np.arange(count), *np.eye(count)):
        yield shares
        yield -shares


def _nearer(left: FloatArray, other: FloatArray, *, at_no_cost: bool = False) -> bool:
    """Return whether less is left, (6,), than other: of the place, ``at_no_cost`` of the attitude, or else of that."""
    (place, angle), (placed, turned) = (np.linalg.norm(one.reshape(2, 3), axis=1) for one in (left, other))
    if place < placed - REACHED:
        return not at_no_cost or bool(angle <= turned + REACHED)
    return bool(place <= placed + REACHED and angle < turned - REACHED)
