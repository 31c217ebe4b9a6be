"""The robot as built under the heat of its melt: temperatures where the ladle really is, and the pose that follows.

Temperatures depend on the pose and the pose on temperatures. Both are settled by turns: temperatures at a closure, the
closure at these temperatures, until a turn no longer moves the ladle. Inside one closure the temperatures are held.
What the last turn still moved is reported.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location import LadleLocation
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.growth import ThermalExpansion
from pouring_robot.thermal.expansion.truss import TrussNetwork, TrussTemperatures
from pouring_robot.thermal.network.assembly import DEFAULT_OPTIONS, ThermalNetwork, TransientOptions, simulate
from pouring_robot.thermal.network.history import HeatHistory, Placed
from pouring_robot.thermal.network.parts import TemperatureField

SETTLED_M = 1e-10
"""A turn of temperatures and closure that moves the platform's origin by less ends the turns."""
MOST_TURNS = 12


class WarmRobot(PouringRobot):
    """The robot as built, its parts grown by heat: does what :class:`PouringRobot` does, warm.

    Heat is applied first and the geometric error in the joint's displaced frame, so that a U-joint centre stands at its
    grown nominal place plus its offset. Where the legs that are not driven stand at a pose, their growth displaces a
    joint; so the robot is made for one pose, and elsewhere the value of such a leg's joint (nothing else) is off by the
    change of its growth. ``passive_lengths_m``: length without heat of each leg that is not driven, by its prismatic
    joint; by default that of the drawing at the pose.
    """

    def __init__(
        self,
        robot: PouringRobot,
        expansion: ThermalExpansion,
        pose: PlatformPose,
        passive_lengths_m: Mapping[str, float] | None = None,
    ) -> None:
        # Not super().__init__: model, nominal solver and kinematics are the given robot's, and building takes time.
        self.__dict__.update(vars(robot))
        self.expansion, self.pose = expansion, pose
        passive = passive_lengths_m or passive_lengths(robot, robot.kinematics.joint_values(pose))
        mechanism = robot.kinematics.mechanism.with_stiffness(robot.actual_solver.mechanism.loops.stiffness)
        for errors in (expansion.placements(robot.kinematics, passive), robot.model.placement_errors()):
            mechanism = mechanism.displaced({joint: error.to_se3() for joint, error in errors.items()})
        self.actual_solver = ClosureSolver(mechanism, robot.actual_solver.energy.loads, robot.actual_solver.options)

    def actual_drives(self, drives: Mapping[str, float]) -> dict[str, float]:
        """Return where the drives stand for commanded values, in m and rad: offset, then grown with the leg."""
        growth = self.expansion.drive_offsets(drives, self._drive_offsets)
        return {name: value + growth.get(name, 0.0) for name, value in super().actual_drives(drives).items()}

    def solve(self) -> ClosureResult:
        """Close the robot at the drive values that a controller commands for its pose."""
        return self.forward(self.kinematics.inverse(self.pose), near=self.pose)


def passive_lengths(robot: PouringRobot, joint_values: Mapping[str, float]) -> dict[str, float]:
    """Return the value of the prismatic joint of each leg that is not driven, in m, by its name."""
    drives = robot.nominal_solver.mechanism.loops.drives
    return {name: value for name, value in joint_values.items() if name.endswith("_s3") and name not in drives}


def drawing_of(robot: PouringRobot) -> PouringRobot:
    """Return the robot of the drawing of the same layout: no geometric errors, no drive offsets, no loads."""
    bare = robot.model.model_copy(update={"joint_placements": {}, "drive_offsets": {}})
    return PouringRobot(bare, options=robot.actual_solver.options)


Close = Callable[[WarmRobot], Sequence[ClosureResult]]
"""Closes a warm robot: first with the drive values of the last turn, at last with those it then chooses."""


@dataclass(frozen=True, eq=False)
class WarmState:
    """Temperatures and robot that belong together."""

    field: TemperatureField | None  # the temperatures; None for a cold robot
    robot: WarmRobot  # as built and as warm as that
    result: ClosureResult  # its closure
    turns: int  # how often temperatures were taken anew
    unsettled_m: float  # by how much the last taking of temperatures moved the moving platform's origin, drives held

    @functools.cached_property
    def location(self) -> LadleLocation:
        """Where the ladle should be and where it is, warm, for the robot's pose as command."""
        return self.robot.locate(self.robot.pose)


@dataclass(frozen=True)
class PoseShares:
    """What geometry and heat do to a frame, alone and together; differences to the nominal pose in the fixed platform.

    Geometry: errors, drive offsets and loads; heat alone acts on the drawing; together is the actual pose.
    """

    geometry: PoseDifference
    heat: PoseDifference
    together: PoseDifference

    @property
    def remainder_m(self) -> FloatArray:
        """What the shares leave of the whole: together - geometry - heat, shape (3,), in m. Not zero."""
        return np.asarray(self.together.translation_m - self.geometry.translation_m - self.heat.translation_m)

    @property
    def remainder_rad(self) -> FloatArray:
        """The same of the rotation vectors, shape (3,), in rad; of second order even for small turns."""
        return np.asarray(self.together.rotation_rad - self.geometry.rotation_rad - self.heat.rotation_rad)


class HeatedRobot:
    """A robot as built, warmed by its melt. Holds solver workspace: one object a thread.

    ``heat``: how warm it is; None: not at all. ``network``: by default made when it is needed, from the robot and the
    properties of ``heat``; where these do not fit the layout, or it is another robot than the pouring robot,
    BadInputError is raised. Its methods raise ThermalSolutionError where no temperatures are found,
    UnreachablePoseError or ClosureError where the robot, warm or cold, cannot take a command, UnknownFrameError for a
    frame it has not.
    """

    def __init__(
        self, robot: PouringRobot, heat: HeatSection | None = None, network: ThermalNetwork | None = None
    ) -> None:
        if not isinstance(robot, PouringRobot):
            raise BadInputError(
                f"only a PouringRobot is heated by its melt, and this is a {type(robot).__name__}; any robot is "
                "compensated by compensate_drives(robot, robot.location_at(drives))"
            )
        self.robot, self.heat = robot, heat
        self._given_network = network

    def built_as(self, robot: PouringRobot) -> Self:
        """Return another robot of the same drawing in the same heat; the network is shared."""
        return self if robot is self.robot else type(self)(robot, self.heat, self.network)

    @functools.cached_property
    def network(self) -> ThermalNetwork:
        """The robot's thermal network."""
        return self._given_network or ThermalNetwork(self.robot, self.properties)

    @functools.cached_property
    def properties(self) -> ThermalProperties:
        """Materials and surfaces, those of the model file in place."""
        return (self.heat or HeatSection()).thermal_properties()

    @property
    def temperatures_degC(self) -> tuple[float, float]:  # noqa: N802 - the unit keeps its capital
        """Melt and surroundings."""
        heat = self.heat or HeatSection()
        melt, ambient = self.network.temperatures_K(heat.melt_degC, heat.ambient_degC)
        return melt - ZERO_CELSIUS_K, ambient - ZERO_CELSIUS_K

    @property
    def after_s(self) -> float | None:
        """How long the melt has been there; None: until nothing changes any more."""
        return 60.0 * self.heat.after_min if self.heat and self.heat.after_min else None

    def field(
        self, pose: Placed, near: TemperatureField | None = None, options: TransientOptions = DEFAULT_OPTIONS
    ) -> TemperatureField | None:
        """Return the temperatures at a pose that is held, or None for a cold robot; ``near`` as the network's."""
        if self.heat is None:
            return None
        if self.after_s is None:
            return self.network.steady(pose, *self.temperatures_degC, near)
        history = HeatHistory.constant(*self.temperatures_degC, self.after_s)
        return simulate(self.network, history, pose, options=options)[-1]

    def truss(self, state: WarmState) -> TrussTemperatures | None:
        """Return how warm the truss is over the robot in a state; None for a cold robot."""
        if state.field is None:
            return None
        network = TrussNetwork(self.network)
        return network.temperatures(state.result, state.field.melt_K, state.field.ambient_K, self.after_s)

    def expansion(self, field: TemperatureField | None) -> ThermalExpansion:
        """Return how much the parts have grown; measured temperatures take the place of computed ones."""
        if field is None or self.heat is None:
            return ThermalExpansion((0.0, 0.0, 0.0, 0.0))
        return ThermalExpansion.from_field(field, self.heat.measured_degC)

    def settle(self, pose: PlatformPose, close: Close) -> WarmState:
        """Take temperatures and closure by turns until a turn no longer moves the ladle; first near a pose."""
        place: Placed = pose
        passive, field = None, None
        before, moved = np.full(3, np.inf), 0.0 if self.heat is None else np.inf
        for turns in range(1, MOST_TURNS + 1):
            field = self.field(place, field)
            warm = WarmRobot(self.robot, self.expansion(field), pose, passive)
            found = close(warm)
            if self.heat is not None:
                moved = float(np.linalg.norm(found[0].pose_base_to_end.translation - before))
            place = result = found[-1]
            state = WarmState(field, warm, result, turns, moved)
            if moved < SETTLED_M:
                break
            before = np.array(result.pose_base_to_end.translation)
            passive = passive_lengths(self.robot, result.joint_values)
        return state

    def locate(self, pose: PlatformPose) -> WarmState:
        """Return the warm robot at a commanded pose; its ``location`` is where the ladle is."""
        drives = self.robot.kinematics.inverse(pose)
        return self.settle(pose, lambda warm: [warm.forward(drives, near=pose)])

    def shares(self, state: WarmState, frames: Sequence[str]) -> dict[str, PoseShares]:
        """Return what geometry and heat do, alone and together, to some frames; heat alone as warm as the whole."""
        pose, base = state.robot.pose, state.location.loops.base_frame
        cold = self.robot.locate(pose)
        warm = WarmRobot(drawing_of(self.robot), state.robot.expansion, pose).solve()
        return {
            frame: PoseShares(
                cold.difference(frame),
                PoseDifference.between(cold.nominal.pose(base, frame), warm.pose(base, frame)),
                state.location.difference(frame),
            )
            for frame in frames
        }
