"""Drive values for a pose in which a robot is singular: searched from beside it.

Where an arm is stretched out, or axes of its wrist lie on one line, its drives command less than elsewhere. Newton then
stands still although the target is near, as what they do to it there grows with their square. Beside the pose they
command all that they ever do, and Newton goes on from there.
"""

from collections.abc import Iterator

import numpy as np

from pouring_robot.exceptions import NoSolutionError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.redundancy import redundant_drives
from pouring_robot.mechanism.poses import joint_reach
from pouring_robot.robot.inverse import REACHED, Reached, Target, bring, freedoms, longest_steps
from pouring_robot.robot.location import Location
from pouring_robot.robot.robot import Robot

_ASIDE = 1.0 / 3.0
"""How far beside a pose, of Newton's longest step: small, and far from being singular for lack of digits."""


def bring_to(robot: Robot, wanted: Location, target: Target) -> tuple[Reached | None, bool]:
    """Return what brings the robot as built to a target, where the drawing stands at ``wanted``; and if it is singular.

    Singular is a pose around which the drives command more than in it, where Newton stands still without having met
    the target, or does not settle. Of all starts beside it that settle within the limits, those with the nearest place
    count, and of them the nearest drives. Where there is none, or none as near, it is where Newton stood still; None if
    that is no better than the drives of ``wanted``: place or attitude are further off, or neither is nearer.

    Raises NoSolutionError if the loops do not close on the way from the pose itself.
    """
    here = np.array(list(wanted.drives.values()))
    solver, close, start = robot.nominal_solver, robot.close_nominal, wanted.nominal.configuration
    ranks = bring(solver, close, target, here, start, ranks=None).ranks
    stood = bring(robot.actual_solver, robot.close_actual, target, here, wanted.actual.configuration, ranks)
    if stood.settled and (stood.met or sum(ranks) == min(6, len(here) - redundant_drives(solver.mechanism))):
        return stood, False

    longest, starts = longest_steps(solver.mechanism), []
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

    found = []
    for commanded, drives, configuration in starts:
        if commanded == most:
            try:
                one = bring(robot.actual_solver, robot.close_actual, target, drives, configuration, most)
            except NoSolutionError:
                continue  # nor on the way from there
            if one.settled and not _beyond(robot, one):
                found.append(one)

    def nearness(one: Reached) -> tuple[int, float]:
        # Rounded, so that of an elbow's two sides it is always the same that is taken.
        return round(one.place_m / REACHED), round(float(np.abs((one.drives - here) / longest).max()), 6)

    best = min(found, key=nearness, default=stood)
    if stood.settled and stood.place_m < best.place_m - REACHED:
        best = stood
    return (None if best is stood and stood.settled and not _better(stood, wanted, target) else best), True


def _shares(count: int) -> Iterator[FloatArray]:
    """Yield displacements, (drives,), in shares: of all drives, none as much as another, then of each alone."""
    apart = np.linspace(0.5, 1.0, count)
    for shares in (apart, apart * (-1.0) ** np.arange(count), *np.eye(count)):
        yield shares
        yield -shares


def _better(found: Reached, wanted: Location, target: Target) -> bool:
    """Return whether place or attitude are nearer than with the drives of ``wanted``, at no cost of the other."""
    frame = target.frame or str(wanted.loops.end_frame)
    before = target.left(wanted.actual.pose(wanted.loops.base_frame, frame))
    was, now = (np.linalg.norm(left.reshape(2, 3), axis=1) for left in (before, found.left))
    return bool((now < was - REACHED).any() and (now <= was + REACHED).all())


def _beyond(robot: Robot, found: Reached) -> bool:
    """Return whether a joint stands beyond its limits."""
    mechanism = robot.actual_solver.mechanism
    return any(
        one.beyond for one in joint_reach(mechanism, found.result.joint_values | mechanism.named_drives(found.drives))
    )
