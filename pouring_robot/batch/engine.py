"""The choice of engine: the compiled one for a star of serial chains or a serial arm, else the one row by row."""

import numpy as np

from pouring_robot.batch.compiled import CompiledEngine
from pouring_robot.batch.interface import Engine
from pouring_robot.batch.records import BatchClosure
from pouring_robot.batch.row_by_row import GeneralEngine
from pouring_robot.exceptions import UnsupportedMechanismError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions


def engine_for(
    mechanism: ClosedChainMechanism, threads: int | None = None, options: ClosureOptions = DEFAULT_OPTIONS
) -> Engine:
    """Return the fastest engine for a mechanism; results do not depend on the choice. Raises as the engines do."""
    if mechanism.loops.redundant_drives:
        return GeneralEngine(mechanism, options)
    try:
        return CompiledEngine(mechanism, threads, options)
    except UnsupportedMechanismError:  # no star, no serial arm
        return GeneralEngine(mechanism, options)


def seen_from_rest(engine: Engine, closed: BatchClosure) -> tuple[Engine, BatchClosure]:
    """Return an engine and closures seen from a fixed frame, in which weight has one direction.

    That frame is the base or, if the base moves, such as a table under a tool, the root of the tree.
    """
    mechanism = engine.structure.mechanism
    carriers = mechanism.frame_paths[mechanism.loops.base_frame]
    if not {*carriers} & mechanism.joint_columns.keys() - {*mechanism.loops.locked_joints}:
        return engine, closed
    rest = GeneralEngine(mechanism.seen_from("universe"), engine.options)
    values = engine.structure.joint_values(closed.joints)
    start = rest.start_at(engine.structure.configurations(closed.joints))
    return rest, rest.close(np.column_stack([values[drive] for drive in mechanism.loops.drives]), start)
