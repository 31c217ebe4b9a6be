r"""Closing the loops: damped Newton on the closure energy, symmetric in the chains.

Four UPU chains over-constrain the platform: any axis error makes rigid closure impossible. The solution is the minimum
of :math:`\sum_i \tfrac12 e_i^T K e_i` over the loops' residuals, with yielding drives and gravity where there are any
(:mod:`~.energy`). The residuals that remain are part of the result: parts would be forced together.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import eigenpy
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.exceptions import BadInputError, ClosureError
from pouring_robot.io.argument_checks import as_tuple, expect
from pouring_robot.mechanism.arrays import FloatArray, Indices, ReadOnly, numbers
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.assembly_mode import Shares, jumps, largest_turn
from pouring_robot.mechanism.closure.energy import NO_LOADS, ClosureEnergy, EnergyState, Loads
from pouring_robot.mechanism.closure.null_space import Spectrum, is_regular
from pouring_robot.mechanism.closure.status import GAP_TOO_LARGE, MODE_ENDS, NOT_CONVERGED, STATUS_NAMES, STAYS, settles
from pouring_robot.mechanism.joint_limits import ROUND_OFF
from pouring_robot.report.result import Result

# Singular values of the constraint Jacobian (m and rad, all of order one) below this are zero: perturbations
# of interest start at a micrometre or a microradian.
LEAST_SINGULAR_VALUE = 1e-8
# A joint idles if it has at least this share in a motion that opens no loop.
_IDLE_SHARE = 1e-6


@dataclass(frozen=True)
class ClosureOptions:
    """When a closure counts as found; a value that is not a number of 0 or more raises BadInputError."""

    step_tolerance: float = 1e-7  # largest component of the last Newton step, in m or rad
    left_over: float = 3e-14  # what it may leave, in m or rad: its length times the share by which steps shrink
    round_off: float = ROUND_OFF  # steps that are shorter and no longer shrink are round-off, in m or rad
    max_iterations: int = 240  # Newton steps before giving up
    max_gap_m: float = 0.01  # largest distance that may be left open; ``max_gap_rad``: largest angle
    max_gap_rad: float = 0.1
    # the same of redundant drives, which disagree by what is wrong with the robot: not known before it is calibrated
    most_disagreement_m: float = np.inf
    # loops open by less (m or rad) count as closed exactly: Gauss-Newton then converges quadratically
    closed_below: float = 1e-9
    # largest turn of a displaced joint (rad) that is closed in one go. Beyond that a mechanism may have several
    # assembly modes; errors grow, so that the one is found that grows out of the drawing's.
    one_go: float = 0.02
    growth_step: float = 0.007  # turn by which they grow at a time (rad), in ``most_steps`` at most
    most_steps: int = 10
    smooth_below: int = 10  # where a step of growth takes more Newton steps, or jumps, all are made finer
    refinements: tuple[int, ...] = (1, 8, 64)  # times finer, in turn; a mode from which the finest jump ends there

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            said = f"{name} of a closure is a number from 0 on, not {value}"
            given = numbers(as_tuple(value), (None,), said)
            if not given.size or not (given >= 0.0).all():
                raise BadInputError(said)

    def growth_passes(self, steps: int) -> list[tuple[int, int]]:
        """Return in how many steps errors grow, ever finer, and how many Newton steps each may take to be smooth."""
        *first, finest = self.refinements
        return [(steps * finer, self.smooth_below) for finer in first] + [(steps * finest, self.max_iterations)]

    def growth_steps(self, turns: FloatArray | float) -> NDArray[np.int64]:
        """Return the numbers of steps in which errors of these angles (rad) grow."""
        steps = np.clip(np.ceil(np.asarray(turns) / self.growth_step), 1, self.most_steps).astype(np.int64)
        return np.where(np.asarray(turns) > self.one_go, steps, 1)


DEFAULT_OPTIONS = ClosureOptions()


def largest_norm(vectors: FloatArray) -> float:
    """Return the length of the longest row; zero where there is none."""
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


@dataclass(frozen=True, eq=False, repr=False)
class ClosureResult(ReadOnly, Result):
    """A closed configuration and how well it is closed. Its arrays are read-only; results compare by identity."""

    mechanism: ClosedChainMechanism
    configuration: FloatArray  # Pinocchio's, shape (nq,)
    residual: FloatArray  # what is left open in each loop, log6, shape (loops, 6), in m and rad
    # with which frame b of each loop pulls at frame a's chain, in the axes of frame b, shape (loops, 6), in N and Nm
    internal_wrench: FloatArray
    energy: float  # closure energy at the minimum, in J
    iterations: int  # Newton steps taken
    jacobian: FloatArray  # derivative of the residual by all joint velocities, shape (loops, 6, nv)
    commanded: FloatArray  # configuration that holds the commanded drives, shape (nq,); differs where drives yield

    @property
    def headline(self) -> str:
        """How well it is closed."""
        if not self.mechanism.anchors:
            return "no loops: the pose follows from the drives"
        return (
            f"left open {self.gap_m * 1e6:.3g} µm and {self.gap_rad * 1e3:.3g} mrad after {self.iterations} iterations"
        )

    def _table(self) -> Any:
        """One row a loop: its residual in m and rad, and the wrench it carries in N and Nm."""
        parts = (self.residual, {"{}_m": 0, "r{}_rad": 3}), (self.internal_wrench, {"f{}_N": 0, "t{}_Nm": 3})
        table: dict[str, Any] = {"loop": self.mechanism.loops.names}
        for array, columns in parts:
            table |= {f.format(a): array[:, first + k] for f, first in columns.items() for k, a in enumerate("xyz")}
        return table

    def within(self, options: ClosureOptions) -> Self:
        """Return the result itself; raises ClosureError where a loop is open further than options allow."""
        most_m, most_rad, reason = options.max_gap_m, options.max_gap_rad, "the parts do not fit together"
        if self.mechanism.loops.redundant_drives:
            most_m, most_rad, reason = options.most_disagreement_m, np.inf, "the drives disagree"
        if self.gap_m > most_m or self.gap_rad > most_rad:
            raise _failure(self.mechanism, reason, self.residual, self.iterations, GAP_TOO_LARGE)
        return self

    @functools.cached_property
    def joint_values(self) -> dict[str, float]:
        """Value of every one-freedom joint, in m or rad."""
        return self.mechanism.joint_values(self.configuration)

    @property
    def gap_m(self) -> float:
        """Largest distance left open between two frames that should coincide, in m."""
        return largest_norm(self.residual[:, :3])

    @property
    def gap_rad(self) -> float:
        """Largest angle left open, in rad."""
        return largest_norm(self.residual[:, 3:])

    @property
    def internal_force_n(self) -> float:
        """Largest force with which a loop's two frames pull at each other, in N."""
        return largest_norm(self.internal_wrench[:, :3])

    @property
    def internal_torque_nm(self) -> float:
        """Largest torque between a loop's two frames, in Nm."""
        return largest_norm(self.internal_wrench[:, 3:])

    @functools.cached_property
    def rank(self) -> int:
        """Rank of the loops' Jacobian over all joints that move: freedoms = joint freedoms - rank."""
        return int(np.linalg.matrix_rank(self._loop_rows(self.mechanism.closing_columns), LEAST_SINGULAR_VALUE))

    def _loop_rows(self, columns: Indices) -> FloatArray:
        """Return the Jacobian of the loops by the given velocity columns and their followers; (6 loops, columns)."""
        rows = self.jacobian.reshape(-1, self.jacobian.shape[2])
        return np.asarray(rows @ self.mechanism.coupling[:, columns])

    @property
    def freedoms(self) -> int:
        """Freedoms of the closed mechanism if its loops were rigid."""
        return int(self.mechanism.closing_columns.size) - self.rank

    @functools.cached_property
    def idle_joints(self) -> tuple[str, ...]:
        """Joints that can move while drives and loops stand still, such as a rod that spins about its own axis."""
        mechanism = self.mechanism
        columns = mechanism.passive_columns
        _, values, directions = np.linalg.svd(self._loop_rows(columns))
        idle = directions[np.count_nonzero(values > LEAST_SINGULAR_VALUE) :] @ mechanism.coupling[:, columns].T
        moving = set(np.flatnonzero((np.abs(idle) > _IDLE_SHARE).any(axis=0)).tolist())
        return tuple(name for name, own in mechanism.joint_columns.items() if moving.intersection(own))

    def pose(self, base_frame: str, frame: str) -> pin.SE3:
        """Return the pose of ``frame`` in ``base_frame``; raises UnknownFrameError where a frame does not exist."""
        placements = self._placements
        base, tip = (placements[self.mechanism.frame_id(name)] for name in (base_frame, frame))
        return base.actInv(tip)

    @functools.cached_property
    def _placements(self) -> list[pin.SE3]:
        # Copies: a frame of the workspace itself would keep the whole workspace alive, a megabyte a result.
        return [pose.copy() for pose in self.mechanism.frames_at(self.configuration).oMf]

    @property
    def pose_base_to_end(self) -> pin.SE3:
        """Pose of the loops file's ``end_frame`` in its ``base_frame``."""
        loops = self.mechanism.loops
        if loops.end_frame is None:
            raise BadInputError("the loops file names no end_frame; ask for a pose between two frames instead")
        return self.pose(loops.base_frame, loops.end_frame)


class ClosureSolver:
    """Closes a mechanism for drive values, under loads if given; threads may share it."""

    def __init__(
        self, mechanism: ClosedChainMechanism, loads: Loads = NO_LOADS, options: ClosureOptions = DEFAULT_OPTIONS
    ) -> None:
        expect(mechanism, ClosedChainMechanism, "what is closed is a ClosedChainMechanism")
        expect(loads, Loads, "loads are Loads")
        expect(options, ClosureOptions, "options of a closure are ClosureOptions")
        self.mechanism, self.options = mechanism, options
        self.energy = ClosureEnergy(mechanism, loads)
        self._smaller = Shares(mechanism, functools.partial(ClosureEnergy, loads=loads), options.most_steps)

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        """Pickle the arguments it was made from: Pinocchio's constraints cannot be pickled."""
        return type(self), (self.mechanism, self.energy.loads, self.options)

    def solve(self, drives: Mapping[str, float], start: FloatArray) -> ClosureResult:
        """Close the loops for drives, in m or rad, from a configuration (nq,), which also holds the locked joints.

        Raises:
            UnknownJointError: a name is not that of a joint.
            BadInputError: a value is not finite.
            ClosureError: the loops stay open, or Newton does not converge.
        """
        configuration = self.mechanism.with_joint_values(start, drives)
        if not np.all(np.isfinite(configuration)):
            raise BadInputError("the start configuration holds a value that is not a finite number")
        configuration = self.mechanism.with_mimics(configuration, drives)
        state, iterations = self._grown(configuration)
        return self._result(state, configuration, iterations).within(self.options)

    def solve_from(self, configuration: FloatArray) -> ClosureResult:
        """Close the loops from a configuration (nq,) that already holds the drive values; raises as :meth:`solve`."""
        return self.solve({}, configuration)

    def result_at(self, configuration: FloatArray) -> ClosureResult:
        """Return the result at a configuration, shape (nq,), that is known to be closed with drives at command."""
        return self._result(self.energy.evaluate(configuration, configuration), configuration, 0)

    def _result(self, state: EnergyState, commanded: FloatArray, iterations: int) -> ClosureResult:
        return ClosureResult(
            self.mechanism,
            state.configuration,
            state.residual,
            (state.wrench[:, None, :] @ state.jlog)[:, 0],
            state.energy,
            iterations,
            state.jacobian,
            commanded.copy(),  # the caller may go on with its own
        )

    def _grown(self, commanded: FloatArray) -> tuple[EnergyState, int]:
        """Return the minimum and the Newton steps to it; large errors grow in steps, from none."""
        mechanism, options = self.mechanism, self.options
        steps = int(options.growth_steps(largest_turn(mechanism))) if mechanism.anchors else 1
        if steps == 1:
            return self._minimise(self.energy, self.energy.evaluate(commanded, commanded), commanded)
        spent = 0
        for finer, smooth in options.growth_passes(steps):
            state, count, share = self._followed(commanded, finer, smooth)
            spent += count
            if share == 1.0:
                return state, spent
        reason = f"the drawing's assembly mode ends at {share:.1%} of the errors"
        raise _failure(mechanism, reason, state.residual, spent, MODE_ENDS)

    def _followed(self, commanded: FloatArray, steps: int, smooth: int) -> tuple[EnergyState, int, float]:
        """Follow the mode of the drawing while errors grow; return its last state, Newton steps and share."""
        energy = self._smaller[0.0]
        state, spent = self._minimise(energy, energy.evaluate(commanded, commanded), commanded)
        place, moved = self._place(state), np.inf
        for step in range(1, steps + 1):
            energy = self.energy if step == steps else self._smaller[step / steps]
            try:
                trial, count = self._minimise(energy, energy.evaluate(state.configuration, commanded), commanded)
            except ClosureError as error:
                return state, spent + error.iterations, (step - 1) / steps
            spent, before, reached = spent + count, moved, self._place(trial)
            moved = float(np.linalg.norm(reached - place))
            if count > smooth or jumps(moved, before):
                return state, spent, (step - 1) / steps
            state, place = trial, reached
        return state, spent, 1.0

    def _place(self, state: EnergyState) -> FloatArray:
        """Return the end frame's position, in m, (3,); of a mechanism without one, the configuration."""
        mechanism = self.mechanism
        if mechanism.loops.end_frame is None:
            return state.configuration
        return np.array(mechanism.pose_base_to_end(state.configuration).translation)

    @np.errstate(over="ignore", invalid="ignore")  # a step too far, from which it goes back
    def _minimise(self, energy: ClosureEnergy, state: EnergyState, commanded: FloatArray) -> tuple[EnergyState, int]:
        """Run Newton: Gauss-Newton far away, the exact Hessian where residuals remain, a watchdog over both.

        The energy is a curved valley, stiff across and soft along, so a good step along it first climbs its wall. One
        step may therefore end higher than the best one so far (watchdog technique: Chamberlain, Powell, Lemarechal and
        Pedersen, Math. Programming Study 16, 1982); if the next does not fall below it, the search returns to the best
        state and shortens its step by Levenberg's term.
        """
        options, best, forced = self.options, state, energy.loads.gravity
        if not energy.free_columns.size:  # the drives alone say where everything is
            return state, 0
        damping = previous = share_before = 0.0
        climbed = exact = kept = False
        for iteration in range(1, options.max_iterations + 1):
            # Next to the minimum the factors of the last Hessian still serve, and cost nothing.
            step = self._step(energy, state, exact, damping, kept)
            length = np.abs(step).max()
            trial = energy.evaluate(pin.integrate(energy.model, state.configuration, step), commanded)
            closed = not forced and np.abs(trial.residual).max(initial=0.0) < options.closed_below
            short = length < options.step_tolerance
            share, settled = settles(length, previous, share_before, options.left_over, options.round_off)
            sharp = not damping and (exact or closed)
            if settled and short and sharp:
                return trial, iteration
            kept = sharp and short and not kept
            exact = not closed and (forced or trial.elastic > STAYS * state.elastic)  # residuals of weight stay, too
            if trial.energy <= best.energy or short:  # near the minimum it may rise by a few last digits
                best = state = trial
                previous, share_before = length, share
                damping, climbed = 0.0, False
            elif not (damping or climbed) and np.isfinite(trial.energy):
                state, climbed = trial, True
            else:
                best = state = energy.evaluate(best.configuration, commanded)  # the Hessian reads the workspace
                damping, climbed = max(10.0 * damping, 1e-4), False
        reason = "Newton's steps do not settle"
        raise _failure(self.mechanism, reason, best.residual, options.max_iterations, NOT_CONVERGED)

    def _step(self, energy: ClosureEnergy, state: EnergyState, exact: bool, damping: float, kept: bool) -> FloatArray:
        """Return the Newton step over all velocity columns, or one with the kept factors of the step before; (nv,)."""
        basis, workspace = energy.basis, energy.workspace
        downhill = -(basis.T @ state.gradient)
        if kept and workspace.factors is not None:
            return np.asarray(basis @ workspace.factors.solve(downhill))
        for full in (energy.hessian, energy.gauss_newton_hessian)[0 if exact else 1 :]:
            hessian = basis.T @ full(state) @ basis
            if damping:
                hessian[np.diag_indices_from(hessian)] *= 1.0 + damping
            workspace.factors = eigenpy.LLT(hessian)
            if is_regular(workspace.factors, hessian):  # positive definite: the step goes downhill
                return np.asarray(basis @ workspace.factors.solve(downhill))
            workspace.factors, spectrum = None, Spectrum.of(hessian)
            if spectrum.is_semidefinite:  # what idles stays where it is
                break
        return np.asarray(basis @ spectrum.solve(downhill))


def _failure(
    mechanism: ClosedChainMechanism, reason: str, residual: FloatArray, iterations: int, status: int
) -> ClosureError:
    gaps, turns = (np.linalg.norm(part, axis=1) for part in (residual[:, :3], residual[:, 3:]))
    names = mechanism.loops.names
    return ClosureError(
        reason,
        iterations=iterations,
        gap_m=largest_norm(residual[:, :3]),
        gap_rad=largest_norm(residual[:, 3:]),
        worst_loop=names[int(np.argmax(gaps + 0.1 * turns))] if names else None,
        status=STATUS_NAMES[status],
    )
