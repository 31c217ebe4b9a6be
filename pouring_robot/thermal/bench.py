"""The bench of the pouring robot: its melt warms it."""

from typing import Any

from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location import LadleLocation, Location
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.view.bench import RobotBench, Wish
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot, WarmRobot
from pouring_robot.thermal.network.assembly import ThermalNetwork, TransientOptions

_HEAT, _MELT, _AFTER = "heat", "melt_degC", "after_min"
_ROUGHLY = TransientOptions(relative_tolerance=1e-3, absolute_tolerance_K=0.1)
_LONGEST_MIN, _COOLEST, _HOTTEST = 240.0, 1200.0, 1750.0


class PouringBench(RobotBench):
    """Adds the temperature of the melt and the time since it came, at zero cold.

    While a slider moves temperatures are taken once, where the ladle should be, and to a kelvin; when it is let go of,
    by turns with the closure until both are settled.
    """

    robot: PouringRobot

    def __init__(self, robot: PouringRobot, location: LadleLocation, exaggeration: float | None = None) -> None:
        """Draw it once; its thermal network is made when it is first warm."""
        super().__init__(robot, location, exaggeration)
        self._heat = robot.model.heat or HeatSection()
        self._network: ThermalNetwork | None = None

    def sliders(self) -> dict[str, Any]:
        """Return the sliders of any robot and those of the melt."""
        found = super().sliders()
        melt = self._heat.melt_degC or self._heat.thermal_properties().melt.temperature.value
        limits = {"lower": min(_COOLEST, melt), "upper": max(_HOTTEST, melt), "value": melt}
        time = {"lower": 0.0, "upper": _LONGEST_MIN, "value": 0.0}
        sliders = [
            {"id": _MELT, "label": "melt", "unit": "°C", **limits},
            {"id": _AFTER, "label": "time since the melt came", "unit": "min", **time},
        ]
        found["groups"].append({"name": _HEAT, "sliders": sliders})
        return found

    def located(self, robot: Robot, wish: Wish) -> Location:
        """Return where the robot stands, as warm as the page wants it."""
        after = wish.values.get(_AFTER, 0.0)
        if after <= 0.0 or not isinstance(robot, PouringRobot):
            return super().located(robot, wish)
        command = self.command(robot, wish)
        pose = command if isinstance(command, PlatformPose) else robot.kinematics.forward(
            dict(zip(robot.nominal_solver.mechanism.loops.drives, command.tolist(), strict=True))
        )  # fmt: skip
        if _MELT not in wish.values:
            raise BadInputError("the page gives no temperature of the melt")
        heat = self._heat.with_values(melt_degC=wish.values[_MELT], after_min=after)
        heated = HeatedRobot(robot, heat, self._network)
        self._network = heated.network
        if wish.settled:
            return heated.locate(pose).location
        return WarmRobot(robot, heated.expansion(heated.field(pose, options=_ROUGHLY)), pose).locate(pose)
