"""Which engine a mechanism gets."""

from pouring_robot.batch.compiled import CompiledEngine
from pouring_robot.batch.general import GeneralEngine
from pouring_robot.batch.interface import Engine
from pouring_robot.exceptions import UnsupportedMechanismError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions


def engine_for(
    mechanism: ClosedChainMechanism, threads: int | None = None, options: ClosureOptions = DEFAULT_OPTIONS
) -> Engine:
    """Return the fastest engine that takes a mechanism with an end frame; results depend on neither it nor its threads.

    Raises:
        BadInputError: the mechanism names no end frame, or the number of threads is not positive.
    """
    if mechanism.loops.redundant_drives:
        return GeneralEngine(mechanism, options)
    try:
        return CompiledEngine(mechanism, threads, options)
    except UnsupportedMechanismError:  # no star, no serial arm
        return GeneralEngine(mechanism, options)
