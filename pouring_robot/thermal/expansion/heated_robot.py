"""The robot as built under the heat of its melt: temperatures where the ladle really is, and the pose that follows.

Temperatures depend on the pose and the pose on temperatures. Both are settled by turns: temperatures at a closure, the
closure at these temperatures, until a turn no longer moves the ladle. Inside one closure the temperatures are held.
What the last turn still moved is reported.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.solver import ClosureResult
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location import LadleLocation
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.growth import ThermalExpansion
from pouring_robot.thermal.expansion.warm_robot import WarmRobot, drawing_of, passive_lengths
from pouring_robot.thermal.network.assembly import ThermalNetwork
from pouring_robot.thermal.network.field import TemperatureField
from pouring_robot.thermal.network.history import HeatHistory, Placed
from pouring_robot.thermal.network.transient import DEFAULT_OPTIONS, TransientOptions, simulate
from pouring_robot.thermal.network.truss import TrussNetwork, TrussTemperatures

SETTLED_M = 1e-10
"""A turn of temperatures and closure that moves the platform's origin by less ends the turns."""
MOST_TURNS = 12

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

    Args:
        robot: the robot as built, cold.
        heat: how warm it is; None: not at all.
        network: its thermal network; by default made from the robot and the properties of ``heat`` when it is needed.

    Raises:
        BadInputError: it is another robot than the pouring robot.
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

    def built_as(self, robot: PouringRobot) -> HeatedRobot:
        """Return another robot of the same drawing in the same heat; the network is shared."""
        return self if robot is self.robot else HeatedRobot(robot, self.heat, self.network)

    @functools.cached_property
    def network(self) -> ThermalNetwork:
        """The robot's thermal network.

        Raises:
            BadInputError: the properties do not fit the layout.
        """
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
        """Return the temperatures at a pose that is held, or None for a cold robot; ``near`` as the network's.

        Raises:
            ThermalSolutionError: no temperatures are found.
        """
        if self.heat is None:
            return None
        if self.after_s is None:
            return self.network.steady(pose, *self.temperatures_degC, near)
        history = HeatHistory.constant(*self.temperatures_degC, self.after_s)
        return simulate(self.network, history, pose, options=options)[-1]

    def truss(self, state: WarmState) -> TrussTemperatures | None:
        """Return how warm the truss is over the robot in a state; None for a cold robot.

        Raises:
            ThermalSolutionError: no temperatures are found.
        """
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
        """Take temperatures and closure by turns until a turn no longer moves the ladle; first near a pose.

        Raises:
            NoSolutionError: what ``close`` raises, or no temperatures are found.
        """
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
        """Return the warm robot at a commanded pose; its ``location`` is where the ladle is.

        Raises:
            UnreachablePoseError: a joint would pass its limits.
            ClosureError: the robot cannot take these drive values.
            ThermalSolutionError: no temperatures are found.
        """
        drives = self.robot.kinematics.inverse(pose)
        return self.settle(pose, lambda warm: [warm.forward(drives, near=pose)])

    def shares(self, state: WarmState, frames: Sequence[str]) -> dict[str, PoseShares]:
        """Return what geometry and heat do, alone and together, to some frames; heat alone as warm as the whole.

        Raises:
            NoSolutionError: the cold robot, or the warm drawing, cannot take this command.
            UnknownFrameError: there is no such frame.
        """
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
