"""Which engine a mechanism gets: the compiled one if it is a star of serial chains or a serial arm, else row by row."""

from pouring_robot.batch.compiled import CompiledEngine
from pouring_robot.batch.interface import Engine
from pouring_robot.batch.row_by_row import GeneralEngine
from pouring_robot.exceptions import UnsupportedMechanismError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions


def engine_for(
    mechanism: ClosedChainMechanism, threads: int | None = None, options: ClosureOptions = DEFAULT_OPTIONS
) -> Engine:
    """Return the fastest engine that takes a mechanism; results do not depend on it. Raises as the engines do."""
    if mechanism.loops.redundant_drives:
        return GeneralEngine(mechanism, options)
    try:
        return CompiledEngine(mechanism, threads, options)
    except UnsupportedMechanismError:  # no star, no serial arm
        return GeneralEngine(mechanism, options)
