"""The robot of the drawing as the controller believes it: closed poses for drive values."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pouring_robot.batch.records import BatchCommand, BatchStart
from pouring_robot.exceptions import BadInputError, NoSolutionError, closest
from pouring_robot.io.given import expect
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
    """Closes the robot of the drawing from home joint values (m, rad; zero where not named) outwards.

    On the way there loops may be open as those with errors, at the end as far as the options say. Where it does
    not close at its home it raises ClosureError. A robot with closed forms overrides it.
    """

    def __init__(self, mechanism: ClosedChainMechanism, home: Mapping[str, float], options: ClosureOptions) -> None:
        self.mechanism, self._home, self._options = mechanism, dict(home), options
        self._known: dict[tuple[int, bytes], BatchStart] = {}

    @property
    def most_open(self) -> tuple[float, float]:
        """How far its loops may be open where it stands: m and rad."""
        return self._options.max_gap_m, self._options.max_gap_rad

    @functools.cached_property
    def engine(self) -> Engine:
        """What closes it for many drive values; loops may be open as those with errors."""
        from pouring_robot.batch import engine_for  # heavy

        return engine_for(self.mechanism)

    @functools.cached_property
    def _followed(self) -> HomotopyStarts:
        from pouring_robot.batch import HomotopyStarts, engine_for

        return HomotopyStarts(self.engine, self._home, last=engine_for(self.mechanism, options=self._options))

    def starts(self, drives: FloatArray, /) -> BatchStart:
        """Return the closed poses of drive values (n, drives), in m and rad; NaN where no pose has them."""
        key = len(drives), drives.tobytes()
        if key not in self._known:  # one campaign is asked for many times
            if len(self._known) == _KEPT:
                del self._known[next(iter(self._known))]
            self._known[key] = self._followed.starts(drives)
        return self._known[key]

    def commands(self, commands: FloatArray, /) -> BatchCommand:
        """Return the drives of commands (n, k), in m and rad, and the closed poses, NaN where there is none.

        Here the drive values are the commands.
        """
        return BatchCommand(commands, commands, self.starts(commands))

    def in_reach(self, start: BatchStart, /) -> BoolArray:
        """Return where there is a closed pose with all joints within their limits, (n,)."""
        values = self.engine.structure.joint_values(start.joints)
        return np.isfinite(start.position).all(axis=1) & within_limits(self.mechanism, values)

    def configuration_at(self, drives: FloatArray, /) -> FloatArray:
        """Return the closed configuration (nq,) of drives (drives,), in m and rad, or raise NoSolutionError."""
        start = self.starts(drives[None])
        if not np.isfinite(start.joints).all():
            raise NoSolutionError("no pose of the drawing has these drive values; check them against the joint limits")
        return np.asarray(self.engine.structure.configurations(start.joints)[0])

    def check_drives(self, drives: Mapping[str, float]) -> None:
        """Refuse drive values (BadInputError) unless there is one for each drive and for nothing else."""
        wanted = self.mechanism.loops.drives
        expect(drives, Mapping, "drive values, in m and rad, are a mapping by the names of their joints")
        for name in drives:
            if name not in wanted:
                raise BadInputError(f"'{name}' is not a drive{closest(name, wanted)}")
        missing = [name for name in wanted if name not in drives]
        if missing:
            raise BadInputError(f"the value of drive '{missing[0]}' is missing; give all of {', '.join(wanted)}")


def agreed(drawing: Drawing, drives: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return redundant drives (n, drives), in m and rad, that agree, near some that do not, and which do, (n,).

    Drives that no pose has stay as they are, and those of a robot that has none to spare. Where a joint cannot turn
    further drives agree to first order though loops are wide open: they do not count as agreeing.
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
    # An unknown gap, of what does not close, is no gap that fits.
    return drives, (gaps <= drawing.most_open).all(axis=1)
