"""The engine for any mechanism, row by row with Pinocchio: any loops, joints of several freedoms, shared joints.

Its results and its speed are those of the solver and the G of single poses.
"""

from collections.abc import Callable

import numpy as np

from pouring_robot.batch.interface import Engine
from pouring_robot.batch.records import BatchClosure, BatchStart, BatchTransfer, SiteErrors, shaped
from pouring_robot.batch.structure import Structure, seat_joints
from pouring_robot.exceptions import BadInputError, ClosureError, SingularPoseError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.redundancy import disagreement, redundant_drives
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions, ClosureSolver
from pouring_robot.mechanism.closure.status import CLOSED, NOT_FINITE, SINGULAR, STATUS_NAMES
from pouring_robot.mechanism.local_parameters import GeometricParameter, placements
from pouring_robot.mechanism.transfer import closed_chain_transfer


class GeneralEngine(Engine):
    """Closes any mechanism, sample by sample; raises BadInputError where the loops file names no end frame."""

    def __init__(self, mechanism: ClosedChainMechanism, options: ClosureOptions = DEFAULT_OPTIONS) -> None:
        if mechanism.loops.end_frame is None:
            raise BadInputError("the loops file names no end_frame; name the frame whose pose is wanted")
        self.structure, self.options = Structure(mechanism, _site_joints(mechanism)), options

    def _closed(self, drives: FloatArray, start: BatchStart, placed: SiteErrors) -> BatchClosure:
        mechanism, count = self.structure.mechanism, len(start)
        shaped(start.joints, (count, mechanism.shared_model.nq), "the start's joints")
        solver_of, redundant = _solvers(self.structure, placed, self.options), redundant_drives(mechanism)
        result = BatchClosure.empty(count, (mechanism.shared_model.nq,), len(mechanism.anchors), redundant)
        for row in range(count):
            solver = solver_of(row)
            if solver is None or not np.isfinite(drives[row]).all() or not np.isfinite(start.joints[row]).all():
                result.status[row] = NOT_FINITE
                continue
            try:
                closed = solver.solve(mechanism.named_drives(drives[row]), start.joints[row])
            except ClosureError as problem:
                result.status[row] = STATUS_NAMES.index(problem.status)
                result.iterations[row] = problem.iterations
                continue
            pose = solver.mechanism.pose_base_to_end(closed.configuration)
            result.position[row], result.rotation[row] = pose.translation, pose.rotation
            result.joints[row], result.residual[row] = closed.configuration, closed.residual
            result.iterations[row], result.status[row] = closed.iterations, CLOSED
            if redundant:
                result.disagreement[row], _ = disagreement(solver, closed, redundant)
        return result

    def _transfer(
        self, closed: BatchClosure, chosen: tuple[GeometricParameter, ...], placed: SiteErrors
    ) -> BatchTransfer:
        solver_of = _solvers(self.structure, placed, self.options)
        matrix, status = np.full((len(closed), 6, len(chosen)), np.nan), closed.status.copy()
        redundant = np.full((len(closed), closed.disagreement.shape[1], len(chosen)), np.nan)
        for row in np.flatnonzero(closed.status == CLOSED).tolist():
            solver = solver_of(row)
            if solver is None:
                status[row] = NOT_FINITE
                continue
            try:
                result = solver.result_at(closed.joints[row])
                matrix[row] = closed_chain_transfer(solver, result, chosen).matrix
                if redundant.size:
                    redundant[row] = disagreement(solver, result, redundant.shape[1], chosen)[1]
            except SingularPoseError:
                status[row] = SINGULAR
        return BatchTransfer(chosen, matrix, status, redundant)


def _solvers(
    structure: Structure, placed: SiteErrors, options: ClosureOptions
) -> Callable[[int], ClosureSolver | None]:
    """Return a function that returns the solver of a sample by number: None where one of its errors is not finite."""

    def displaced(joints: tuple[str, ...], errors: FloatArray) -> ClosureSolver | None:
        if not np.isfinite(errors).all():
            return None
        return ClosureSolver(structure.mechanism.displaced(placements(joints, errors)), options=options)

    joints, errors, site = structure.site_joints, placed.errors, placed.site
    if site.size:
        return lambda row: displaced((joints[site[row]],), errors[row])
    if len(errors) > 1:
        return lambda row: displaced(joints, errors[row])
    common = displaced(joints, errors[0]) if len(errors) else ClosureSolver(structure.mechanism, options=options)
    return lambda row: common


def _site_joints(mechanism: ClosedChainMechanism) -> tuple[str, ...]:
    """Return the moving joints that carry some but not all of base, end and loop frames, then the loops' seats."""
    model, loops, paths = mechanism.shared_model, mechanism.loops, mechanism.frame_paths
    ends = (loops.base_frame, str(loops.end_frame), *loops.loop_frames)
    every = dict.fromkeys(name for end in ends for name in paths[end])
    moving = [name for name in every if name in mechanism.seen_joints and model.existJointName(name)]
    seats = (name for loop in range(len(loops.loops)) for name in seat_joints(mechanism, loop))
    return tuple(dict.fromkeys([*moving, *seats]))
