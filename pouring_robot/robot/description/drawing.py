"""The nominal robot, as the controller assumes it: closed poses for drive values."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pouring_robot.batch.records import BatchCommand, BatchStart
from pouring_robot.exceptions import BadInputError, NoSolutionError, closest
from pouring_robot.io.argument_checks import expect
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureOptions
from pouring_robot.mechanism.joint_limits import within_limits
from pouring_robot.mechanism.local_parameters import drive_parameters

if TYPE_CHECKING:
    from pouring_robot.batch import Engine, HomotopyStarts

_KEPT = 4
_AGREE_M, _MOST_STEPS = 1e-12, 20


class Drawing:
    """Closes the nominal robot, starting from home joint values (m, rad; zero where not named).

    On the way loops may be open as far as those of a robot with errors, at the end only as far as the options say.
    Raises ClosureError where the robot does not close at its home. A robot with closed forms overrides this class.
    """

    def __init__(self, mechanism: ClosedChainMechanism, home: Mapping[str, float], options: ClosureOptions) -> None:
        self.mechanism, self._home, self._options = mechanism, dict(home), options
        self._known: dict[tuple[int, bytes], BatchStart] = {}

    @property
    def most_open(self) -> tuple[float, float]:
        """How far its loops may be open at a closed pose: m and rad."""
        return self._options.max_gap_m, self._options.max_gap_rad

    @functools.cached_property
    def engine(self) -> Engine:
        """Engine that closes it for many drive values; loops may be open as far as those of a robot with errors."""
        from pouring_robot.batch import engine_for  # slow to import

        return engine_for(self.mechanism)

    @functools.cached_property
    def _followed(self) -> HomotopyStarts:
        from pouring_robot.batch import HomotopyStarts, engine_for

        return HomotopyStarts(self.engine, self._home, last=engine_for(self.mechanism, options=self._options))

    def starts(self, drives: FloatArray, /) -> BatchStart:
        """Return the closed poses for drive values (n, drives), in m and rad; NaN where there is none."""
        key = len(drives), drives.tobytes()
        if key not in self._known:  # the same campaign is requested many times
            if len(self._known) == _KEPT:
                del self._known[next(iter(self._known))]
            self._known[key] = self._followed.starts(drives)
        return self._known[key]

    def commands(self, commands: FloatArray, /) -> BatchCommand:
        """Return the drive values for commands (n, k), in m and rad, and the closed poses, NaN where there is none.

        In this class commands are drive values.
        """
        return BatchCommand(commands, commands, self.starts(commands))

    def in_reach(self, start: BatchStart, /) -> BoolArray:
        """Return which poses are closed with all joints within their limits, (n,)."""
        values = self.engine.structure.joint_values(start.joints)
        return np.isfinite(start.position).all(axis=1) & within_limits(self.mechanism, values)

    def configuration_at(self, drives: FloatArray, /) -> FloatArray:
        """Return the closed configuration (nq,) for drive values (drives,), in m and rad, or raise NoSolutionError."""
        start = self.starts(drives[None])
        if not np.isfinite(start.joints).all():
            raise NoSolutionError("no pose of the drawing has these drive values; check them against the joint limits")
        return np.asarray(self.engine.structure.configurations(start.joints)[0])

    def check_drives(self, drives: Mapping[str, float]) -> None:
        """Raise BadInputError unless there is a value for each drive and for nothing else."""
        wanted = self.mechanism.loops.drives
        expect(drives, Mapping, "drive values, in m and rad, are a mapping by the names of their joints")
        for name in drives:
            if name not in wanted:
                raise BadInputError(f"'{name}' is not a drive{closest(name, wanted)}")
        missing = [name for name in wanted if name not in drives]
        if missing:
            raise BadInputError(f"the value of drive '{missing[0]}' is missing; give all of {', '.join(wanted)}")


def agreed(drawing: Drawing, drives: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return redundant drive values (n, drives), in m and rad, adjusted until they agree, and which do, (n,).

    Values without a closed pose are left unchanged, and so are those of a robot without redundant drives. Where a joint
    cannot turn further, drives agree to first order although loops are wide open: these do not count as agreeing.
    """
    if not drawing.mechanism.loops.redundant_drives:
        return drives, np.ones(len(drives), dtype=bool)
    engine, parameters = drawing.engine, drive_parameters(drawing.mechanism)
    closed = engine.close(drives, drawing.starts(drives))
    for _ in range(_MOST_STEPS):
        apart = np.nan_to_num(closed.disagreement)
        if np.abs(apart).max(initial=0.0) < _AGREE_M:
            break
        slopes = np.nan_to_num(np.asarray(engine.transfer(closed, parameters).disagreement, dtype=float))
        drives = drives - (np.linalg.pinv(slopes) @ apart[..., None])[..., 0]
        closed = engine.close(drives, closed.as_start())
    gaps = np.linalg.norm(closed.residual.reshape(len(drives), -1, 2, 3), axis=-1).max(axis=1, initial=0.0)
    # A gap is NaN where the closure failed, and then does not count as small enough.
    return drives, (gaps <= drawing.most_open).all(axis=1)
