"""The batch engine for stars and serial arms: closures and transfer matrices of many samples at once, on all cores.

It solves the same problem as ``closure.ClosureSolver``, without loads, on arrays read from the same Pinocchio model; a
serial arm's closure is its forward kinematics. A sample without an answer holds NaN and has a status that says why;
none is left out silently.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from pouring_robot.batch.interface import Engine
from pouring_robot.batch.kernels.residuals import Closures, Samples, make_workspace
from pouring_robot.batch.kernels.samples import carry_samples, close_samples
from pouring_robot.batch.kernels.transfer import Columns, branch_samples, transfer_samples
from pouring_robot.batch.records import BatchClosure, BatchStart, BatchTransfer, SiteErrors, shaped
from pouring_robot.batch.structure import ByteArray, IntArray, Star, StarStructure, fixed
from pouring_robot.exceptions import BadInputError, UnknownJointError
from pouring_robot.io.argument_checks import whole
from pouring_robot.mechanism.arrays import FloatArray, lock_arrays
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.assembly_mode import Shares, jumps, largest_turn
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions
from pouring_robot.mechanism.closure.status import CLOSED, MODE_ENDS, NOT_CONVERGED
from pouring_robot.mechanism.local_parameters import GeometricParameter, LocalParameter, PlacementParameter

_SAMPLES_AT_A_TIME = 512


class CompiledEngine(Engine):
    """Closes a star mechanism, or computes a serial arm's pose, for many samples. Safe to use from several threads.

    Results do not depend on the number of its threads, by default one a core. Raises UnsupportedMechanismError where
    the mechanism is not a star of serial chains, BadInputError where the number of threads is not positive.
    """

    def __init__(
        self, mechanism: ClosedChainMechanism, threads: int | None = None, options: ClosureOptions = DEFAULT_OPTIONS
    ) -> None:
        if threads is not None:
            whole(threads, 1, "the number of threads must be positive")
        self.structure: StarStructure = StarStructure.from_mechanism(mechanism)
        self.threads = threads or len(os.sched_getaffinity(0))
        self.options = options
        self._largest_turn = largest_turn(mechanism)
        self._smaller = Shares(mechanism, self.structure.displaced_star, options.most_steps)

    def _closed(self, drives: FloatArray, start: BatchStart, placed: SiteErrors) -> BatchClosure:
        """Close every sample; large errors grow in steps, from none, as in ``closure.ClosureSolver``.

        Of a serial arm's start only the locked joints count.
        """
        shaped(start.joints, (len(start), *self.structure.star.revolute.shape), "the start's joints")
        for i, names in enumerate(self.structure.joint_names):
            if np.any(np.nan_to_num(start.joints[:, i, len(names) :])):
                raise BadInputError(f"chain {i + 1} has {len(names)} joints; the start's values beyond them must be 0")
        options = self.options
        own = np.linalg.norm(placed.errors[..., 3:], axis=-1).max(axis=1, initial=0.0) if len(placed.errors) else 0.0
        steps = np.broadcast_to(options.growth_steps(np.fmax(own, self._largest_turn)), len(start))
        if self.structure.is_serial or steps.max(initial=1) == 1:
            return self._straight(drives, start, placed)
        result = self._empty_for(start)
        straight = np.flatnonzero(steps == 1)
        result.put(straight, self._straight(drives[straight], start[straight], placed[straight]))
        for number in np.unique(steps[steps > 1]).tolist():
            rows = np.flatnonzero(steps == number)
            spent = np.zeros(len(start), dtype=np.int64)
            for finer, smooth in options.growth_passes(number):
                result.put(rows, self._followed(drives[rows], start[rows], placed[rows], finer, smooth))
                spent[rows] += result.iterations[rows]
                rows = rows[result.status[rows] == MODE_ENDS]
                if not rows.size:
                    break
            result.iterations[steps == number] = spent[steps == number]
        return result

    def _followed(
        self, drives: FloatArray, start: BatchStart, placed: SiteErrors, steps: int, smooth: int
    ) -> BatchClosure:
        """Follow the drawing's mode while errors grow; samples that leave it get the status for that."""
        result = self._empty_for(start)
        spent, rows = np.zeros(len(start), dtype=np.int64), np.arange(len(start))
        before = np.full(len(start), np.inf)
        for step in range(steps + 1):
            star = self._smaller[step / steps] if step < steps and self._largest_turn else None
            smaller = SiteErrors(step / steps * placed[rows].errors, placed[rows].site)
            most_open = None if step == steps else np.inf
            closed = self._straight(drives[rows], start[rows], smaller, most_open, star=star)
            spent[rows] += closed.iterations
            if step:
                moved = np.linalg.norm(closed.position - start.position[rows], axis=1)
                astray = (closed.iterations > smooth) | jumps(moved, before[rows])
                closed.refuse(astray | (closed.status == NOT_CONVERGED), MODE_ENDS)
                before[rows] = moved
            result.put(rows, closed)
            start, rows = start.replaced(rows, closed), rows[closed.status != MODE_ENDS]
            if not rows.size:
                break
        result.iterations[:] = spent
        return result

    def _straight(
        self,
        drives: FloatArray,
        start: BatchStart,
        placed: SiteErrors,
        most_open: float | None = None,
        chain: IntArray | None = None,
        star: Star | None = None,
    ) -> BatchClosure:
        """Close every sample directly from its start, or carry the end frame by one ``chain`` each, (n,).

        Loops may stay open by ``most_open`` (m, rad), or as options say; a ``star`` replaces the mechanism's own.
        """
        result, samples, drives = self._empty_for(start), _samples(start, placed), fixed(drives)
        written = Closures(*(getattr(result, name) for name in Closures._fields))
        if chain is not None or self.structure.is_serial:
            own = fixed(np.zeros(len(start)) if chain is None else chain, np.int64)
            self._share(len(start), carry_samples, samples, drives, own, written, star=star)
            result.residual[result.closed] = 0.0
            return result
        options = self.options
        limits = (options.step_tolerance, options.closed_below, options.left_over, options.round_off)
        open_by = (options.max_gap_m, options.max_gap_rad) if most_open is None else (most_open, most_open)
        settings = fixed([*limits, *open_by])
        self._share(len(start), close_samples, samples, drives, settings, options.max_iterations, written, star=star)
        return result

    def carry(
        self, chain: IntArray, drives: FloatArray, start: BatchStart, errors: SiteErrors | FloatArray | None = None
    ) -> BatchClosure:
        """Carry the end frame by one open chain of each sample, (n,) from 0; all joints but the drives are held.

        Its loops count as closed; the other arguments and the errors raised are those of :meth:`close`.
        """
        count, (chains, joints) = len(start), self.structure.star.revolute.shape
        drives = shaped(drives, (count, len(self.structure.mechanism.loops.drives)), "'drives'")
        shaped(start.joints, (count, chains, joints), "the start's joints")
        if chain.shape != (count,) or not np.isin(chain, range(chains)).all():
            raise BadInputError(f"'chain' must hold {count} numbers of chains from 0 to {chains - 1}")
        placed = SiteErrors.take(errors, count, self.structure.site_count)
        carried = self._straight(drives, start, placed, chain=chain)
        lock_arrays(carried)
        return carried

    def _empty_for(self, start: BatchStart) -> BatchClosure:
        return BatchClosure.empty(len(start), start.joints.shape[1:], len(self.structure.mechanism.anchors))

    def _transfer(
        self, closed: BatchClosure, chosen: tuple[GeometricParameter, ...], placed: SiteErrors
    ) -> BatchTransfer:
        kernel = branch_samples if self.structure.is_serial else transfer_samples  # an arm is its only branch
        return self._of_kernel(kernel, closed.status, chosen, _samples(closed.as_start(), placed))

    def transfer_open_branch(
        self,
        joints: FloatArray,
        parameters: Sequence[LocalParameter] | None = None,
        errors: SiteErrors | FloatArray | None = None,
    ) -> BatchTransfer:
        """Return G of open branches: each column moves the platform as its own chain alone would carry it.

        Joints (n, chains, joints), in m and rad, are held; parameters, errors and exceptions as in :meth:`transfer`.
        """
        count = len(joints)
        joints = shaped(joints, (count, *self.structure.star.revolute.shape), "'joints'")
        placed = SiteErrors.take(errors, count, self.structure.site_count)
        samples = Samples(fixed(np.zeros((0, 3))), fixed(np.zeros((0, 3, 3))), joints, placed.errors, placed.site)
        return self._of_kernel(branch_samples, np.zeros(count, dtype=np.uint8), self._chosen(parameters), samples)

    def _of_kernel(
        self, kernel: Callable[..., None], status: ByteArray, chosen: tuple[GeometricParameter, ...], samples: Samples
    ) -> BatchTransfer:
        """Return G as computed by a kernel; samples that are not closed keep their status."""
        matrix, found = np.empty((len(status), len(chosen), 6)), np.empty_like(status)
        self._share(len(status), kernel, samples, self._columns(chosen), matrix, found)
        return BatchTransfer(chosen, np.swapaxes(matrix, 1, 2), np.where(status == CLOSED, found, status))

    def _columns(self, parameters: Sequence[GeometricParameter]) -> Columns:
        """Sort the columns by the site that each displaces."""
        structure = self.structure
        sites = np.full(len(parameters), structure.site_count)
        twists = np.zeros((len(parameters), 6))
        drive_names = structure.mechanism.loops.drives
        drives = np.full(len(drive_names), -1)
        for p, parameter in enumerate(parameters):
            if isinstance(parameter, PlacementParameter):
                sites[p] = structure.site(parameter.joint)
                axes = structure.star.site_axes[sites[p]].reshape(3, 3)
                twists[p] = (np.reshape(parameter.twist, (2, 3)) @ axes).ravel()
                continue
            if parameter.joint not in drive_names:
                raise UnknownJointError(parameter.joint, drive_names)
            if drives[drive_names.index(parameter.joint)] >= 0:
                raise BadInputError(f"parameter '{parameter.name}' occurs twice")
            drives[drive_names.index(parameter.joint)] = p
        order = np.argsort(sites, kind="stable")
        start = np.searchsorted(sites[order], np.arange(structure.site_count + 1))
        return Columns(fixed(start, np.int64), fixed(order, np.int64), fixed(twists), fixed(drives, np.int64))

    def _share(self, count: int, kernel: Callable[..., None], *arguments: Any, star: Star | None = None) -> None:
        """Run a kernel over ranges of samples on the threads; the ranges do not depend on the number of threads."""
        own = star or self.structure.star

        def run(first: int) -> None:
            kernel(own, make_workspace(own), *arguments, (first, min(first + _SAMPLES_AT_A_TIME, count)))

        starts = range(0, count, _SAMPLES_AT_A_TIME)
        if self.threads == 1 or len(starts) < 2:
            for first in starts:
                run(first)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            for _ in pool.map(run, starts):
                pass


def _samples(start: BatchStart, placed: SiteErrors) -> Samples:
    return Samples(start.position, start.rotation, start.joints, placed.errors, placed.site)
