"""Closed poses as starts where the inverse kinematics is unknown: followed from a closed home."""

from collections.abc import Mapping

import numpy as np

from pouring_robot.batch.interface import Engine
from pouring_robot.batch.records import BatchStart
from pouring_robot.batch.structure import fixed
from pouring_robot.exceptions import BadInputError, ClosureError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions, ClosureResult, ClosureSolver

_STEPS = 8


def closed_home(
    mechanism: ClosedChainMechanism, home: Mapping[str, float], options: ClosureOptions = DEFAULT_OPTIONS
) -> ClosureResult:
    """Return a closed configuration at or near given joint values, by name in m or rad; others start at zero.

    Drives have the values of ``home``; where the loops do not close with these, drives that are not named may move.

    Raises:
        UnknownJointError: a name is not that of a joint.
        BadInputError: a value is not finite, or a named joint has several freedoms.
        ClosureError: the mechanism does not close there.
    """
    start = mechanism.with_joint_values(mechanism.neutral_configuration(), home)
    named = tuple(name for name in mechanism.loops.drives if name in home)
    solver = ClosureSolver(mechanism, options=options)
    try:
        return solver.solve_from(start)
    except ClosureError:
        if len(named) == len(mechanism.loops.drives):
            raise
        yielding = ClosureSolver(mechanism.with_drives(named), options=options)
        return solver.solve_from(yielding.solve_from(start).configuration)


class HomotopyStarts:
    """Closed poses for any drive values, followed from one closed home in even steps, all samples at once.

    The last step may have an engine of its own, ``last``, with stricter options than those on the way. Raises as
    :func:`closed_home`.
    """

    def __init__(self, engine: Engine, home: Mapping[str, float], last: Engine | None = None) -> None:
        self.engine, self._last = engine, last or engine
        mechanism = engine.structure.mechanism
        closed = closed_home(mechanism, home, engine.options)
        self._home = engine.start_at(closed.configuration[None])
        values = closed.joint_values | dict(home)  # a configuration does not know of whole turns
        self._home_drives = np.array([values[name] for name in mechanism.loops.drives])

    def starts(self, drives: FloatArray) -> BatchStart:
        """Return closed poses for drives (n, drives), in m and rad; NaN where a step finds none.

        A serial arm needs no start: it gets its home's locked joints. Raises BadInputError where the shape is wrong.
        """
        drives = fixed(drives)
        if drives.ndim != 2 or drives.shape[1] != self._home_drives.size:
            raise BadInputError(f"drives must have the shape (n, {self._home_drives.size}), not {drives.shape}")
        start = self._home[np.zeros(len(drives), dtype=np.int64)]
        serial = not self.engine.structure.mechanism.anchors
        for step in range(_STEPS if serial else 1, _STEPS + 1):
            share = step / _STEPS
            engine = self._last if step == _STEPS else self.engine
            start = engine.close((1.0 - share) * self._home_drives + share * drives, start).as_start()
        return start
