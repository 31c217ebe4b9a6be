"""Any robot: the nominal robot and the robot as built, side by side, for commanded drives.

    robot = Robot.load("delta/robot.yaml")
    robot.locate_drives([[0.1, 0.1, 0.2]])      # where it should be and where it is
    robot.transfer([0.1, 0.1, 0.2])             # G: how each local parameter moves it

:class:`~pouring_robot.robot.pouring_robot.PouringRobot` adds what only the pouring robot has: poses as commands.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pouring_robot.batch.interface import Engine
from pouring_robot.batch.records import BatchClosure, BatchStart
from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.io.argument_checks import as_tuple, expect
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, finite
from pouring_robot.mechanism.closure.energy import NO_LOADS, Loads
from pouring_robot.mechanism.closure.redundancy import redundant_drives
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions, ClosureResult, ClosureSolver
from pouring_robot.mechanism.closure.status import STATUS_NAMES
from pouring_robot.mechanism.conditioning import AxisWeakness, Dexterity, dexterity
from pouring_robot.mechanism.joint_limits import ROUND_OFF, JointReach, joint_reach, refuse_beyond
from pouring_robot.mechanism.local_parameters import LocalParameter, drive_parameters
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.command_table import read_command_lines
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.inverse import InverseSolution, Target, search, starts_near
from pouring_robot.robot.location import OUT_OF_REACH, Location, error_dataset, frames_of
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose

if TYPE_CHECKING:
    import xarray as xr

    from pouring_robot.robot.description.command import CommandAxis
    from pouring_robot.robot.parameter_catalogue import ParameterCatalogue

Command = PlatformPose | Target | FloatArray | Sequence[float]
"""A command: a target of the end body, drive values, or a pose of the pouring robot's platform."""
NUMBERS = "numbers are drive values, in m and rad, and a pose is a PlatformPose or a Target"
"""For error messages: what a command of numbers means."""
LOADED = "give a Robot, as load_robot and Robot.load make it"
"""For error messages: what to give where a robot is expected."""
LOCATED = "give a location, as robot.locate(pose) and robot.location_at(drives) return"
"""For error messages: what to give where a location is expected."""


class Robot:
    """The nominal robot and the robot as built (default: the pouring robot's drawing); threads may share it.

    Heat and effects that depend on conditions are not applied; a warning says so where the model has them;
    ``robots_under`` applies these effects. ``loads`` (weight and compliant drives) act on the actual robot; a payload
    hangs at the robot file's ``payload_frame`` unless they name a frame. ``options`` say when a closure has converged.
    Methods that take a command raise BadInputError where it is not a command of this robot, UnreachablePoseError where
    a joint of the drawing (of the pouring robot: or one as built) would exceed its limits, NoSolutionError where no
    pose solves it. The constructor raises BadInputError where the model names a joint or drive the robot does not have.
    """

    def __init__(
        self,
        model: RobotModel | Path | str | None = None,
        loads: Loads = NO_LOADS,
        options: ClosureOptions = DEFAULT_OPTIONS,
    ) -> None:
        self._make(RobotModel.of(model), loads, options)
        self.model.warn_of_left_out(type(self).__name__)

    @classmethod
    def without_warning(cls, model: RobotModel) -> Self:
        """Make the robot of a model without the warning: the caller applies what is left out, or reports it."""
        robot = cls.__new__(cls)
        robot._make(model, NO_LOADS, DEFAULT_OPTIONS)
        return robot

    def _make(self, model: RobotModel, loads: Loads, options: ClosureOptions) -> None:
        self.model = model
        self.model.check_errors()
        self.drawing = self.model.definition.drawing()
        if self.drawing.mechanism.loops.redundant_drives:
            options = replace(options, most_disagreement_m=self.model.definition.most_disagreement_m)
        self.nominal_solver = ClosureSolver(self.drawing.mechanism, options=options)
        loads = replace(loads, payload_frame=loads.payload_frame or self.model.definition.payload_frame)
        self.actual_solver = ClosureSolver(self.model.mechanism(), loads, options)

    @classmethod
    def load(cls, model: RobotModel | Path | str | None = None) -> Self:
        """Load a robot from a model, a model file or a robot file; raises DescriptionError where a file is wrong."""
        return cls(model)

    def built_as(self, model: RobotModel) -> Self:
        """Return a robot of the same, shared, drawing with the joint placements and drive offsets of another model."""
        expect(model, RobotModel, "a robot is built as a RobotModel says, such as RobotModel.load reads")
        model.check_errors()
        other = copy.copy(self)
        other.__dict__.pop("unseen_displacements", None)
        other.model = model
        stiff = self.drawing.mechanism.with_stiffness(self.actual_solver.mechanism.loops.stiffness)
        solver = self.actual_solver
        other.actual_solver = ClosureSolver(stiff.displaced(model.displacements()), solver.energy.loads, solver.options)
        return other

    def __repr__(self) -> str:
        errors = len(self.model.joint_placements) + len(self.model.drive_offsets)
        return f"<{type(self).__name__}: {' '.join(*self.model.named.items())}, {errors} displaced joints and drives>"

    @functools.cached_property
    def parameters(self) -> ParameterCatalogue:
        """Every geometric error of the drawing by name."""
        from pouring_robot.robot.parameter_catalogue import ParameterCatalogue

        return ParameterCatalogue(self.model.definition, self.drawing.mechanism)

    @functools.cached_property
    def unseen_displacements(self) -> tuple[str, ...]:
        """Displaced joints that no pose in the base frame shows: those that carry everything (a rail), or a finger."""
        seen = self.drawing.mechanism.seen_joints
        return tuple(joint for joint in self.model.joint_placements if joint not in seen)

    @property
    def idle_drives(self) -> tuple[str, ...]:
        """Drives that move nothing measured in the base frame, such as those beyond the end frame."""
        mechanism = self.drawing.mechanism
        seen = mechanism.seen_joints
        leading = {mimic.leader for mimic in mechanism.mimics if mimic.joint in seen}
        return tuple(drive for drive in mechanism.loops.drives if drive not in seen | leading)

    def actual_drive_values(self, drives: FloatArray) -> FloatArray:
        """Return the drive values of the robot as built for commands (..., drives), in m and rad."""
        return self.model.actual_drive_values(drives)

    def actual_drives(self, drives: Mapping[str, float]) -> dict[str, float]:
        """Return the same by name, for all drives; raises BadInputError for a missing drive or an unknown name."""
        self.drawing.check_drives(drives)
        mechanism = self.drawing.mechanism
        commands = np.array([drives[name] for name in mechanism.loops.drives])
        return mechanism.named_drives(self.actual_drive_values(commands))

    def locate_drives(self, drives: ArrayLike) -> xr.Dataset:
        """Return where the robot should be and where it is for commands (n, drives), in m and rad.

        Returns:
            A dataset with the dimensions ``pose``, ``frame`` and ``axis``: nominal and actual positions (m), rotation
            vectors (rad) and their differences, and a ``status``. A command without a solution is NaN, and its status
            says why; no error is raised for it.

        Raises:
            BadInputError: the array has another shape, holds a number that is not finite or is masked, or is a table
                with headings, which are not read.
        """
        names, commanded = self.drawing.mechanism.loops.drives, self.commands_of(drives)
        start = self.drawing.starts(commanded)
        closed = self.close(commanded, start)
        answered = np.isfinite(start.position).all(axis=1)  # otherwise the drawing has no pose for these drives
        units = [drive.unit for drive in self.model.definition.drives]
        coordinates = {
            "drive": list(names),
            "unit": ("drive", units),
            "commanded_drives": (("pose", "drive"), commanded, {"units": "m or rad, see 'unit'"}),
        }
        return self._dataset(start, closed, self._in_reach(start, closed) | (answered & ~closed.closed), coordinates)

    def commands_of(self, drives: ArrayLike) -> FloatArray:
        """Return a copy of commands (n, drives), in m and rad; raises BadInputError like :meth:`locate_drives`."""
        names = self.drawing.mechanism.loops.drives
        demand = f"drives must be finite numbers of the shape (n, {len(names)}): {', '.join(names)}"
        return finite(drives, (None, len(names)), demand)

    def _in_reach(self, start: BatchStart, closed: BatchClosure) -> BoolArray:
        """Return which nominal poses are within the joint limits, and also as built where that counts, (n,)."""
        return self.drawing.in_reach(start)

    def _dataset(
        self, start: BatchStart, closed: BatchClosure, reachable: BoolArray, coordinates: Mapping[str, Any]
    ) -> xr.Dataset:
        """Return nominal poses and those as built as a dataset; ``reachable``, (n,): which are within joint limits."""
        status = np.where(reachable, np.array(STATUS_NAMES)[closed.status], OUT_OF_REACH)
        nominal = frames_of(self.drawing.mechanism, start.position, start.rotation)
        actual = frames_of(self.actual_solver.mechanism, closed.position, closed.rotation)
        return error_dataset(self.drawing.mechanism.loops, status, nominal, actual, coordinates)

    def close(self, drives: FloatArray, start: BatchStart) -> BatchClosure:
        """Close the robot as built for commanded drives (n, drives), in m and rad, from closed nominal poses."""
        return self.engine().close(self.actual_drive_values(drives), start)

    @property
    def loaded(self) -> bool:
        """Whether the robot as built carries weight or has compliant drives."""
        loads = self.actual_solver.energy.loads
        return bool(loads.gravity or loads.drive_stiffness)

    def engine(self) -> Engine:
        """Return the engine that closes the robot as built for many commands; raises BadInputError under loads."""
        from pouring_robot.batch import engine_for

        if self.loaded:
            raise BadInputError("under loads a robot is closed command by command: use transfer or location_at")
        return engine_for(self.actual_solver.mechanism, options=self.actual_solver.options)

    @property
    def accuracy_m(self) -> float | None:
        """Required accuracy of the working frame, in m, if one is stated."""
        return None

    @property
    def picture_notes(self) -> tuple[str, ...]:
        """Notes on its pictures, a line each."""
        from pouring_robot.robot.visuals import visuals  # pictures only

        _, why, mend = visuals(self.drawing.mechanism)
        return (f"pictures show lines between its joints, as {why}; {mend}",) if why else ()

    def read_commands(self, path: Path, beside: Iterable[str] = ()) -> Mapping[int, Command]:
        """Read commands by line number from a table, which may also have columns ``beside``, or raise TableError."""
        return read_command_lines(path, self.model.definition)

    def pose_command(self, position_m: FloatArray, turn_rad: FloatArray | None) -> Command:
        """Return the command for the end body's position, (3,), in m, and rotation vector, (3,), in rad (None: any)."""
        return Target(position_m, None if turn_rad is None else pin.exp3(turn_rad))

    def command_at(self, values: FloatArray) -> Command:
        """Return the command for numbers (k,), in m and rad; see :meth:`RobotDefinition.command_axes`."""
        return values

    @functools.cached_property
    def command_axes(self) -> tuple[CommandAxis, ...]:
        """The numbers that make up a command."""
        return self.model.definition.command_axes(self.drawing.mechanism)

    def location_of(self, command: Command) -> Location:
        """Return where the robot should be and where it is, for drive values or a target."""
        return self.location_to(command) if isinstance(command, Target) else self.location_at(self.drives_of(command))

    def actual_of(self, command: Command) -> ClosureResult:
        """Return the closed robot as built at a command, without the nominal one; raises like :meth:`location_of`."""
        return self.location_of(command).actual

    def drives_of(self, command: Command) -> FloatArray:
        """Return the drive values of a command, (drives,), in m and rad."""
        if isinstance(command, PlatformPose):
            raise BadInputError(f"{self.model.definition.name} is commanded by drive values or a target, not a tilt")
        return self.drives_to(command).drives if isinstance(command, Target) else self._commanded(command)

    def location_at(self, drives: Sequence[float] | FloatArray) -> Location:
        """Return where the robot should be and where it is for one command (drives,), in m and rad."""
        values = self._commanded(drives)
        nominal = self.close_nominal(values, self.drawing.configuration_at(values))
        return self._located(values, nominal)

    def _commanded(self, drives: Sequence[float] | FloatArray) -> FloatArray:
        names = self.drawing.mechanism.loops.drives
        return finite(drives, (len(names),), f"give one finite value for each drive: {', '.join(names)}; {NUMBERS}")

    def location_in_the_middle(self) -> Location:
        """Return the location at the home, or in the middle of the workspace; raises NoSolutionError."""
        definition = self.model.definition
        try:
            return self.location_at(definition.home_drives)
        except NoSolutionError as problem:
            at = "" if definition.file.home else " (all joints at zero, as the file gives none)"
            why = str(problem).partition(";")[0]  # the rest advises on drive values, and the user gave none
            raise NoSolutionError(
                f"{definition.path}: the robot cannot stand at its home{at}: {why}; write under home: the values "
                "(m, rad) of all joints at a pose that it can reach"
            ) from problem

    def location_to(self, target: Target) -> Location:
        """Return the location for a target: at the drive values that bring the nominal end body there."""
        found = self.drives_to(target)
        return self._located(found.drives, found.result)

    def drives_to(self, target: Target) -> InverseSolution:
        """Return the drive values that bring a frame of the nominal robot to a target; see :meth:`location_to`."""
        expect(target, Target, "a target is a Target: a place, in m, and a rotation matrix if its attitude counts")
        starts = starts_near(target, self.drawing, self.model.definition.home_drives, lambda: self._workspace)
        return search(self.nominal_solver, self.close_nominal, target, starts, self._refuse_beyond)

    def _refuse_beyond(self, found: InverseSolution) -> None:
        refuse_beyond(self._reach(found.drives, found.result.within(self.model.definition.drawn_fit)))

    @functools.cached_property
    def _workspace(self) -> tuple[FloatArray, BatchStart]:
        return self.model.definition.workspace(self.drawing)

    def close_nominal(self, drives: FloatArray, start: FloatArray) -> ClosureResult:
        """Like :meth:`close_actual`, for the nominal robot."""
        return self.nominal_solver.solve(self.drawing.mechanism.named_drives(drives), start)

    def close_actual(self, drives: FloatArray, start: FloatArray) -> ClosureResult:
        """Close the robot as built for one command (drives,), in m and rad, from a configuration (nq,)."""
        return self.actual_solver.solve(self.drawing.mechanism.named_drives(self.actual_drive_values(drives)), start)

    def _reach(self, drives: FloatArray, nominal: ClosureResult) -> tuple[JointReach, ...]:
        return joint_reach(self.drawing.mechanism, nominal.joint_values | self.drawing.mechanism.named_drives(drives))

    def _located(self, drives: FloatArray, nominal: ClosureResult) -> Location:
        reach = self._reach(drives, nominal)
        refuse_beyond(reach)
        named, actual = self.drawing.mechanism.named_drives(drives), self.close_actual(drives, nominal.configuration)
        return Location(named, nominal, actual, reach)

    def dexterity(self, location: Location) -> Dexterity:
        """Return condition number and distance to singularity of the actual robot at a location."""
        expect(location, Location, LOCATED)
        mechanism = self.actual_solver.mechanism
        prismatic = tuple(mechanism.unit_of(name) == "m" for name in mechanism.loops.drives)
        moved = closed_chain_transfer(self.actual_solver, location.actual, drive_parameters(mechanism)).matrix
        redundant, closed = redundant_drives(mechanism), bool(mechanism.loops.loops)
        return dexterity(moved, prismatic, self._length_m(location), self._task_rows, redundant, closed)

    _task_rows: Sequence[int] = range(6)

    def axis_weakness(self, location: Location) -> AxisWeakness | None:
        """Return how far the tilt of one axis moves the working frame sideways; None: unknown."""
        return None

    def _length_m(self, location: Location) -> float:
        """Return the characteristic length, in m: the mean distance of the driven joints from the end body.

        It is one metre where that is zero.
        """
        mechanism = location.nominal.mechanism
        end = location.nominal.pose("universe", str(mechanism.loops.end_frame)).translation
        data = mechanism.frames_at(location.nominal.configuration)
        joints = [data.oMi[mechanism.joint_id(name)].translation for name in mechanism.loops.drives]
        length = float(np.linalg.norm(np.array(joints) - end, axis=1).mean())
        return length if length > ROUND_OFF else 1.0

    def transfer(
        self, command: Command, parameters: str | Sequence[str | LocalParameter] = "geometry", frame: str | None = None
    ) -> xr.DataArray:
        """Return G of the robot as built at one command: how each local parameter moves a frame.

        Args:
            command: drive values, (drives,), in m and rad, a target, or a pose of the pouring robot's platform.
            parameters: sets, groups, names or patterns of :attr:`parameters`, or local parameters themselves.
            frame: the observed frame (default: the one whose error counts).

        Returns:
            Dimensions ``component`` (displacement x, y, z, rotation vector rx, ry, rz, in the base's axes) and
            ``parameter``; the coordinates ``unit`` and ``per`` give the units of a number: ``unit`` per ``per``.

        Raises like all methods that take a command, and UnknownFrameError; also BadInputError where a parameter name is
        unknown, and NoSolutionError where the drives do not determine the frame.
        """
        closed = self.actual_of(command)
        chosen: dict[str, LocalParameter] = {}
        for item in as_tuple(parameters):
            local = isinstance(item, LocalParameter)
            found = [item] if local else [p.local for p in self.parameters.match(item)]
            chosen |= {parameter.name: parameter for parameter in found}
        frame = frame or closed.mechanism.loops.working_frame
        return closed_chain_transfer(self.actual_solver, closed, list(chosen.values()), frame).to_dataarray()


AnyRobot: TypeAlias = RobotDefinition | RobotModel | Robot | Path | str | None
"""How a robot is given: itself, its definition or model, or the path of either's file; None: the pouring robot."""


def definition_of(robot: AnyRobot) -> RobotDefinition:
    """Return the definition of the given robot; raises BadInputError where it is not a robot, or a file is wrong."""
    if isinstance(robot, RobotDefinition):
        return robot
    return (robot.model if isinstance(robot, Robot) else RobotModel.of(robot)).definition
