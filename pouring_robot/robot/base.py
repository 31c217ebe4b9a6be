"""Any robot: the robot of the drawing and the robot as built, side by side, for commanded drives.

    robot = Robot.load("delta/robot.yaml")
    robot.locate_drives([[0.1, 0.1, 0.2]])      # where it should be and where it is
    robot.transfer_at([0.1, 0.1, 0.2])          # G: how each local parameter moves it

:class:`~pouring_robot.robot.robot.PouringRobot` adds what only the pouring robot has: poses as commands.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure import DEFAULT_OPTIONS, ClosureOptions, ClosureResult, ClosureSolver
from pouring_robot.mechanism.energy import NO_LOADS, Loads
from pouring_robot.mechanism.parameters import LocalParameter
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.location import error_dataset, frames_of
from pouring_robot.robot.model import RobotModel

if TYPE_CHECKING:
    import xarray as xr

    from pouring_robot.batch import BatchClosure, BatchStart
    from pouring_robot.robot.parameters import ParameterCatalogue


def as_it_stands(model: RobotModel | Path | str | None, who: str) -> RobotModel:
    """Return a model, and warn the caller of ``who``, a function of the library, of what its robot leaves out of it."""
    loaded = RobotModel.of(model)
    for line in loaded.left_out(who):
        warnings.warn(line, stacklevel=3)
    return loaded


class Robot:
    """The robot of the drawing and as built. Holds solver workspace: one object a thread.

    Args:
        model: the robot as built; without one, the drawing of the pouring robot's default layout.
        loads: weight and yielding drives of the actual robot.
        options: when a closure counts as found.

    Raises:
        BadInputError: the model names a joint or drive that the robot does not have.
    """

    def __init__(
        self,
        model: RobotModel | None = None,
        loads: Loads = NO_LOADS,
        options: ClosureOptions = DEFAULT_OPTIONS,
    ) -> None:
        """Build both mechanisms."""
        self.model = model or RobotModel()
        self.model.check_drive_offsets()
        self._drive_offsets = self.model.drive_offset_values()
        self.drawing = self.model.definition.drawing()
        self.nominal_solver = ClosureSolver(self.drawing.mechanism, options=options)
        self.actual_solver = ClosureSolver(self.model.mechanism(), loads, options)

    @classmethod
    def load(cls, model: RobotModel | Path | str | None = None) -> Self:
        """Load a robot from a model, a model file or a robot file.

        The robot stands cold and without effects that depend on conditions: where the model tells of them, a warning
        says so.

        Raises:
            DescriptionError: a file is wrong.
        """
        return cls(as_it_stands(model, f"{cls.__name__}.load"))

    def __repr__(self) -> str:
        """Return name and number of errors."""
        errors = len(self.model.joint_placements) + len(self.model.drive_offsets)
        return f"<{type(self).__name__}: {self._called}, {errors} displaced joints and drives>"

    @property
    def _called(self) -> str:
        return self.model.definition.name

    @functools.cached_property
    def parameters(self) -> ParameterCatalogue:
        """Every geometric error of the drawing by name."""
        from pouring_robot.robot.parameters import ParameterCatalogue

        return ParameterCatalogue(self.model.definition, self.nominal_solver.mechanism)

    @functools.cached_property
    def unseen_displacements(self) -> tuple[str, ...]:
        """Displaced joints that no pose seen from the base frame shows: they carry it, such as a rail."""
        paths, loops = self.actual_solver.mechanism.frame_paths, self.actual_solver.mechanism.loops
        frames = (*loops.reported_frames, *(name for loop in loops.loops for name in (loop.frame_a, loop.frame_b)))
        seen = {joint for frame in frames for joint in paths[frame]} - {*paths[loops.base_frame]}
        return tuple(joint for joint in self.model.joint_placements if joint not in seen)

    def actual_drives(self, drives: Mapping[str, float]) -> dict[str, float]:
        """Return where the drives of the robot as built stand for commanded values, in m and rad."""
        return {name: value + self._drive_offsets.get(name, 0.0) for name, value in drives.items()}

    def locate_drives(self, drives: ArrayLike) -> xr.Dataset:
        """Return where the robot should be and where it is for many commands.

        Args:
            drives: commanded drives in the order of the robot file, shape (n, drives), in m and rad.

        Returns:
            A dataset with the dimensions ``pose``, ``frame`` and ``axis``: nominal and actual positions (m), rotation
            vectors (rad) and their differences, and a ``status``. A command that has no answer is NaN, its status
            says why; nothing is raised for it.

        Raises:
            BadInputError: the array has another shape or holds a number that is not finite.
        """
        from pouring_robot.batch import STATUS_NAMES

        names = self.nominal_solver.mechanism.loops.drives
        commanded = np.asarray(drives, dtype=float)
        if commanded.ndim != 2 or commanded.shape[1] != len(names) or not np.isfinite(commanded).all():
            raise BadInputError(f"drives must be finite numbers of the shape (n, {len(names)}): {', '.join(names)}")
        start = self.drawing.starts(commanded)
        closed = self.close(commanded, start)
        nominal = frames_of(self.nominal_solver.mechanism, start.position, start.rotation)
        actual = frames_of(self.actual_solver.mechanism, closed.position, closed.rotation)
        units = [drive.unit for drive in self.model.definition.drives]
        coordinates = {
            "drive": list(names),
            "unit": ("drive", units),
            "commanded_drives": (("pose", "drive"), commanded),
        }
        status = np.array(STATUS_NAMES)[closed.status]
        return error_dataset(self.nominal_solver.mechanism.loops, status, nominal, actual, coordinates)

    def close(self, drives: FloatArray, start: BatchStart) -> BatchClosure:
        """Close the robot as built for commanded drives (n, drives), in m and rad, from closed poses of the drawing.

        Raises:
            BadInputError: the robot carries loads, under which it is closed pose by pose.
        """
        from pouring_robot.batch import engine_for

        loads = self.actual_solver.energy.loads
        if loads.gravity or loads.drive_stiffness:
            raise BadInputError("under loads a robot is closed command by command: use transfer_at or closed_at")
        engine = engine_for(self.actual_solver.mechanism, options=self.actual_solver.options)
        offsets = self.actual_drives(dict.fromkeys(self.nominal_solver.mechanism.loops.drives, 0.0))
        return engine.close(drives + np.array(list(offsets.values())), start)

    def closed_at(self, drives: Sequence[float] | FloatArray) -> tuple[ClosureResult, ClosureResult]:
        """Return the closed robot of the drawing and as built for one command (drives,), in m and rad.

        Raises:
            BadInputError: the number of drives is wrong.
            NoSolutionError: no pose has these drive values.
        """
        mechanism = self.nominal_solver.mechanism
        if np.shape(drives) != (len(mechanism.loops.drives),):
            raise BadInputError(f"give one value for each drive: {', '.join(mechanism.loops.drives)}")
        configuration = self.drawing.configuration_at(np.asarray(drives, dtype=float))
        named = dict(zip(mechanism.loops.drives, np.asarray(drives, dtype=float).tolist(), strict=True))
        nominal = self.nominal_solver.solve(named, configuration)
        return nominal, self.actual_solver.solve(self.actual_drives(named), nominal.configuration)

    def transfer_at(
        self,
        drives: Sequence[float] | FloatArray,
        parameters: str | Sequence[str | LocalParameter] = "geometry",
        frame: str | None = None,
    ) -> xr.DataArray:
        """Return G of the robot as built at one command: how each local parameter moves a frame.

        Args:
            drives: the command, (drives,), in m and rad.
            parameters: sets, groups, names or patterns of :attr:`parameters`, or local parameters themselves.
            frame: the observed frame (default: the one whose error counts).

        Returns:
            Dimensions ``component`` (displacement x, y, z, rotation vector rx, ry, rz, in the base's axes) and
            ``parameter``; the coordinates ``unit`` and ``per`` give the units of a number: ``unit`` per ``per``.

        Raises:
            BadInputError: no parameter has a name, or the number of drives is wrong.
            UnknownFrameError: there is no such frame.
            NoSolutionError: no pose has these drive values, or they do not determine the frame.
        """
        return self._transfer(self.closed_at(drives)[1], parameters, frame)

    def _transfer(
        self, closed: ClosureResult, parameters: str | Sequence[str | LocalParameter], frame: str | None
    ) -> xr.DataArray:
        named = (parameters,) if isinstance(parameters, str) else parameters
        chosen: dict[str, LocalParameter] = {}
        for item in named:
            found = [p.local for p in self.parameters.match(item)] if isinstance(item, str) else [item]
            chosen |= {parameter.name: parameter for parameter in found}
        frame = frame or closed.mechanism.loops.working_frame
        return closed_chain_transfer(self.actual_solver, closed, list(chosen.values()), frame).to_dataarray()
