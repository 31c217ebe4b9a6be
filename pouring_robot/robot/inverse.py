"""Inverse kinematics: drive values that bring a body of any robot to a pose, its position first, then its attitude.

Newton's method with the exact Jacobian of the closed mechanism (G for its drives), from several starts
(:func:`search`). A robot with fewer than six degrees of freedom meets the position as far as it can and uses the
remaining freedoms for the attitude: a delta only positions, an arm does both. The pouring robot has a closed form:
:mod:`pouring_robot.robot.pouring.kinematics`.
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.batch.records import BatchStart
from pouring_robot.exceptions import BadInputError, NoSolutionError, UnreachablePoseError, UnreachableTargetError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, finite
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.redundancy import disagreement, redundant_drives
from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.description.drawing import Drawing

REACHED, _SETTLED = 1e-9, 1e-11
"""A target is met when position and attitude are this near, in m and rad; Newton goes on to a hundredth of that."""
_MOST_STEPS = 60
_MOST_TRIES = 12
_SINGULAR = 1e-7  # for the drawing, whose directions are either commanded or exactly not
_ROUNDED = 1e-6  # how far from orthonormal rounding may leave the axes of a rotation
_LONGEST = {"m": 0.1, "rad": 0.3}

Close = Callable[[FloatArray, FloatArray], ClosureResult]
"""Closes a robot for commanded drives (drives,), in m and rad, from a configuration (nq,)."""


@dataclass(frozen=True, eq=False)
class Target:
    """The wanted pose of a frame of the end body, in the base; raises BadInputError if it is not a valid pose."""

    position_m: FloatArray  # of its origin, shape (3,), in m
    rotation: FloatArray | None = None  # of its axes, shape (3, 3); None: any
    frame: str | None = None  # the frame; None: the end frame

    def __post_init__(self) -> None:
        place = finite(self.position_m, (3,), "the place of a target must be three finite numbers, in m")
        object.__setattr__(self, "position_m", place)
        if self.rotation is not None:
            demand = "the attitude of a target must be a rotation matrix, 3 × 3"
            rotation = finite(self.rotation, (3, 3), demand)
            if np.abs(rotation.T @ rotation - np.eye(3)).max() > _ROUNDED or np.linalg.det(rotation) < 0.0:
                raise BadInputError(demand)
            object.__setattr__(self, "rotation", rotation)

    def left(self, pose: pin.SE3) -> FloatArray:
        """Return a pose minus the target, (6,): displacement in m and rotation vector in rad, in the base's axes."""
        turn = np.zeros(3) if self.rotation is None else pin.log3(pose.rotation @ self.rotation.T)
        return np.concatenate([pose.translation - self.position_m, turn])


@dataclass(frozen=True, eq=False)
class InverseSolution:
    """Where Newton ended."""

    drives: FloatArray  # drive values to command, shape (drives,), in m and rad
    result: ClosureResult  # the robot closed with them
    left: FloatArray  # remaining error, as :meth:`Target.left` returns it
    ranks: tuple[int, int]  # how many freedoms the drives command here: of the position, and besides of the attitude
    settled: bool  # whether the iteration converged

    @property
    def met(self) -> bool:
        """Whether the target is reached."""
        return max(self.place_m, self.angle_rad) < REACHED

    @property
    def place_m(self) -> float:
        """Remaining position error, in m."""
        return float(np.linalg.norm(self.left[:3]))

    @property
    def angle_rad(self) -> float:
        """Remaining attitude error, in rad."""
        return float(np.linalg.norm(self.left[3:]))


def search(
    solver: ClosureSolver,
    close: Close,
    target: Target,
    starts: Iterable[tuple[FloatArray, FloatArray]],
    refuse: Callable[[InverseSolution], None],
) -> InverseSolution:
    """Return the solution for a target that :func:`bring` finds from the first start that leads there.

    ``starts`` are drive values (drives,) and configurations (nq,); ``refuse`` raises UnreachablePoseError where joints
    are beyond their limits.

    Raises:
        NoSolutionError: no start leads there; of the reasons a joint's limit comes first, then the nearest pose.
        BadInputError: the target does not determine all drives.
    """
    refusals: list[NoSolutionError] = []
    asked, redundant = 3 if target.rotation is None else 6, redundant_drives(solver.mechanism)
    for drives, configuration in starts:
        try:
            found = bring(solver, close, target, drives, configuration)
            if not found.met:
                refusals.append(UnreachableTargetError(found.left, len(drives) - redundant, asked))
                continue
            refuse(found)
        except NoSolutionError as problem:
            refusals.append(problem)
            continue
        if (count := len(drives) - redundant) > sum(found.ranks):
            more = "give its attitude too, or " if target.rotation is None else ""
            raise BadInputError(
                f"the pose determines {sum(found.ranks)} of {count} freedoms; {more}give the drive values"
            )
        return found
    best = min(refusals, key=_preferred, default=NoSolutionError("the robot closes nowhere near its home"))
    if not isinstance(best, UnreachablePoseError | UnreachableTargetError):
        why = str(best).partition(";")[0]  # the rest advises on drive values, and the user gave none
        raise NoSolutionError(f"the pose is out of reach: on the way to it {why}") from best
    raise best


def starts_near(
    target: Target, drawing: Drawing, home: FloatArray, workspace: Callable[[], tuple[FloatArray, BatchStart]]
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield drive values and configurations to start from: home (drives,), then the nearest poses of the workspace.

    ``workspace`` returns drive values (n, drives) and poses spread over it; it is only called where they are needed.
    """
    with contextlib.suppress(NoSolutionError):
        yield home, drawing.configuration_at(home)
    drives, start = workspace()
    apart = np.linalg.norm(start.position - target.position_m, axis=1)
    if target.rotation is not None:
        apart = apart + 0.1 * np.linalg.norm(start.rotation - target.rotation, axis=(1, 2))
    for k in np.argsort(apart)[:_MOST_TRIES].tolist():
        yield drives[k], drawing.configuration_at(drives[k])


def _preferred(refusal: NoSolutionError) -> tuple[int, float]:
    """Return a key that sorts reasons: a joint's limit first, then the nearest pose, then a closure that failed."""
    if isinstance(refusal, UnreachableTargetError):
        return 1, float(np.abs(refusal.left).max())
    return 0 if isinstance(refusal, UnreachablePoseError) else 2, 0.0


def bring(
    solver: ClosureSolver,
    close: Close,
    target: Target,
    drives: FloatArray,
    start: FloatArray,
    ranks: tuple[int, int] | None = None,
) -> InverseSolution:
    """Return the drive values nearest to a target that Newton finds from ``drives`` (m, rad) and ``start``, (nq,).

    ``close`` closes the robot of the solver. ``ranks`` are those of the drawing, because errors make a robot as built
    seem to command directions that its drives hardly move; None: determined on the way. Raises where the robot does not
    close or is singular.
    """
    mechanism, base = solver.mechanism, solver.mechanism.loops.base_frame
    parameters, redundant = drive_parameters(mechanism), redundant_drives(mechanism)
    frame = target.frame or str(mechanism.loops.end_frame)
    before = np.inf
    for _ in range(_MOST_STEPS):
        result = close(drives, start)
        error = target.left(result.pose(base, frame))
        matrix = closed_chain_transfer(solver, result, parameters, frame).matrix
        step, found = _step(matrix, error, target.rotation is not None, ranks)
        if redundant:
            step = _agreeing(step, matrix, *disagreement(solver, result, redundant, parameters))
        size = float(np.abs(step).max())
        if done := bool(settled(size, before)):
            break
        before = size
        drives = drives + limited(step, mechanism)
        start = result.configuration
    return InverseSolution(drives, result, error, found, done)


def settled(size: FloatArray | float, before: FloatArray | float) -> BoolArray:
    """Return whether Newton has converged, from its last residual or step and the one before (m or rad, any shape).

    Round-off may end the iteration a little earlier; the result is then reported as it is.
    """
    return np.asarray((size < _SETTLED) | ((size < REACHED) & (size > 0.5 * before)))


def limited(step: FloatArray, mechanism: ClosedChainMechanism) -> FloatArray:
    """Return Newton steps of a mechanism's drives, (..., drives), scaled to be no longer than :func:`longest_steps`."""
    longest = longest_steps(mechanism)
    return np.asarray(step / np.maximum(1.0, np.abs(step / longest).max(axis=-1, keepdims=True)))


def longest_steps(mechanism: ClosedChainMechanism) -> FloatArray:
    """Return the longest step of each drive of a mechanism, (drives,), in m and rad.

    It moves no joint of the drive, its own or one that mimics it, further than 0.1 m or 0.3 rad. Joints that carry
    nothing do not count: a nut may turn as often as its screw is long.
    """

    def longest(drive: str) -> float:
        moved = mechanism.with_followers({drive: 1.0}).items()
        steps = [_LONGEST[mechanism.unit_of(j)] / abs(rate) for j, rate in moved if rate and j in mechanism.seen_joints]
        return min(steps, default=_LONGEST[mechanism.unit_of(drive)])

    return np.array([longest(drive) for drive in mechanism.loops.drives])


def freedoms(solver: ClosureSolver, result: ClosureResult, target: Target) -> tuple[int, int]:
    """Return how many freedoms of a target the drives command at a closed pose, as :attr:`InverseSolution.ranks`."""
    mechanism = solver.mechanism
    frame = target.frame or str(mechanism.loops.end_frame)
    matrix = closed_chain_transfer(solver, result, drive_parameters(mechanism), frame).matrix
    return _step(matrix, np.zeros(6), target.rotation is not None, None)[1]


def _step(
    matrix: FloatArray, error: FloatArray, turned: bool, ranks: tuple[int, int] | None
) -> tuple[FloatArray, tuple[int, int]]:
    """Return the step of the drives that cancels the remaining error, (drives,), and the ranks that it uses."""
    sizes = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.where(sizes > 0.0, sizes, 1.0)
    place, placed = _inverse(scaled[:3], ranks and ranks[0])
    step, turns = -place @ error[:3], 0
    if turned:
        projector = np.eye(len(step)) - place @ scaled[:3]
        turn, turns = _inverse(scaled[3:] @ projector, ranks and ranks[1])
        step -= turn @ (error[3:] + scaled[3:] @ step)
    return step / np.where(sizes > 0.0, sizes, 1.0), (placed, turns)


def _agreeing(step: FloatArray, matrix: FloatArray, gaps: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return a step of redundant drives that also removes their disagreement (r,), by its Jacobian (r, drives)."""
    projector = np.eye(len(step)) - np.linalg.pinv(matrix, _SINGULAR) @ matrix
    return np.asarray(step - np.linalg.pinv(slopes @ projector) @ (gaps + slopes @ step))


def _inverse(matrix: FloatArray, rank: int | None) -> tuple[FloatArray, int]:
    """Return the pseudo-inverse of a matrix (3, n), truncated to its largest singular values, and its rank."""
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    kept = int(np.count_nonzero(s > _SINGULAR)) if rank is None else rank
    return vt[:kept].T @ ((u[:, :kept] / s[:kept]).T), kept
