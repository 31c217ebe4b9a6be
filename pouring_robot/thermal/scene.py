"""The robot in colours: displacement of each part (the paper's Fig. 8), or temperatures over a shift.

Also the bench of the pouring robot, with sliders for the melt.
"""

import dataclasses
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import bodies_at
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location import LadleLocation, Location
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.view.bench import PageRequest, RobotBench
from pouring_robot.robot.view.nominal_and_actual import drawn_robot, exaggeration_for, frame_places
from pouring_robot.thermal.expansion.displacement import DisplacementField
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, WarmRobot
from pouring_robot.thermal.network.heat_balance import SOLVER
from pouring_robot.thermal.network.temperature_field import TemperatureField
from pouring_robot.thermal.network.thermal_network import ThermalNetwork
from pouring_robot.thermal.report import ShiftHeat
from pouring_robot.viewer import ColourScale, Curve, Scene, SceneArrows, SceneRobot, Step, camera_on
from pouring_robot.viewer.scene import STEEL

_LEG_INKS = ((0.0, 0.45, 0.70), (0.35, 0.70, 0.90), (0.0, 0.62, 0.45), (0.60, 0.65, 0.10))
_HEAT, _MELT, _AFTER = "heat", "melt_degC", "after_min"
_ROUGHLY = {**SOLVER, "rtol": 1e-3, "atol": 0.1}
_LONGEST_MIN, _COOLEST, _HOTTEST = 240.0, 1200.0, 1750.0


def displacement_scene(robot: PouringRobot, field: DisplacementField, title: str, configuration: FloatArray) -> Scene:
    """Return the nominal robot at a configuration (nq,); each visual has the colour of the nearest point of its part.

    Visuals that belong to no part of the field, such as the rails, are grey.
    """
    mechanism = robot.nominal_solver.mechanism
    places = bodies_at(mechanism.shared_model, [configuration])
    drawn = drawn_robot(mechanism, places, "robot", "coloured by displacement")
    parts, world = np.array(field.parts), frame_places(mechanism, places, mechanism.loops.base_frame)[0]
    values = np.full(drawn.visual.ngeoms, np.nan)
    for k, (link, place) in enumerate(zip(drawn.links, _middles(drawn)[0], strict=True)):
        indices = np.flatnonzero(parts == _part(link))
        if indices.size:
            middle = world[:3, :3].T @ (place - world[:3, 3])
            nearest = indices[int(np.linalg.norm(field.points_m[indices] - middle, axis=1).argmin())]
            values[k] = field.distance_m[nearest] / MM
    rows = [
        (part.replace("_", " "), f"mean {mean / MM:.2f}, most {most / MM:.2f} mm")
        for part, (mean, most) in field.by_part.items()
    ]
    scale = ColourScale("displacement", "mm", 0.0, field.largest_m / MM)
    scene = Scene(title, (_coloured(drawn, scale, values[None]),), steps=(Step("", tuple(rows)),), scale=scale)
    # The truss is a part here: its colour counts, so it is not drawn pale.
    return dataclasses.replace(scene, camera=camera_on(scene), background_links=())


def shift_scene(robot: PouringRobot, shift: ShiftHeat, title: str) -> Scene:
    """Return a shift of the nominal robot over time: parts coloured by temperature, the ladle moved by heat."""
    mechanism, cold, warm = robot.nominal_solver.mechanism, shift.bodies[:, 0], shift.bodies[:, 1]
    drawn = drawn_robot(mechanism, warm, "robot", "coloured by temperature", reference=cold)
    values = _temperatures(drawn, mechanism.shared_model, shift.fields)
    scale = ColourScale("temperature", "°C", float(np.nanmin(values)), float(np.nanmax(values)))
    frame, moved = list(shift.moved.items())[-1]
    words, starts = frame.replace("_", " "), frame_places(mechanism, cold, frame)[:, :3, 3]
    shifts = np.array([difference.translation_m for difference in moved])
    turned = np.einsum("kij,kj->ki", frame_places(mechanism, cold, mechanism.loops.base_frame)[:, :3, :3], shifts)
    table = shift.to_frame()
    minutes, melt = table["time_min"].to_numpy(), table["melt_degC"].to_numpy()
    distances = np.linalg.norm(shifts, axis=1)
    legs = np.array([field.leg_degC for field in shift.fields])
    steps = []
    for k, minute in enumerate(minutes.tolist()):
        means = [(f"leg {n}, mean", f"{value:.0f} °C") for n, value in enumerate(legs[k], start=1)]
        lip_moved = (f"{words} moved by heat, x y z", " ".join(f"{v / MM:+z.2f}" for v in shifts[k]) + " mm")
        platform = ("platform", f"{shift.fields[k].platform_degC:.0f} °C")
        steps.append(Step(f"{minute:.1f} min", (("melt", f"{melt[k]:.0f} °C"), *means, platform, lip_moved)))
    curves = [Curve(f"leg {n + 1}", "°C", legs[:, n], ink) for n, ink in enumerate(_LEG_INKS)]
    return Scene(
        title=title,
        robots=(_coloured(drawn, scale, values),),
        arrows=(SceneArrows("moved", starts[:, None], turned[:, None], label=f"{words}, by heat alone"),),
        steps=tuple(steps),
        at=minutes,
        axis="time, min",
        curves=(Curve(f"{words} moved", "mm", distances / MM), *curves),
        scale=scale,
        first=int(distances.argmax()),
        exaggeration=exaggeration_for(float(distances.max())),
    )


def _coloured(drawn: SceneRobot, scale: ColourScale, values: FloatArray) -> SceneRobot:
    """Return the robot with visuals in the colours of values (k, visuals); grey, a colour of no value, where NaN."""
    colours = np.where(np.isfinite(values)[..., None], scale.colours(np.nan_to_num(values)), STEEL)
    return dataclasses.replace(drawn, colours=colours)


def _temperatures(drawn: SceneRobot, model: pin.Model, fields: list[TemperatureField]) -> FloatArray:
    """Return the temperature of each visual's part, (k, visuals), in °C; rods: of the element nearest to its middle."""
    values, middles = np.full((len(fields), drawn.visual.ngeoms), np.nan), _middles(drawn)
    of_part = {
        "platform": [field.platform_degC for field in fields],
        "fixed_platform": [field.fixed_platform_degC for field in fields],
        "ladle": [field.shell_degC for field in fields],
    }
    for v, link in enumerate(drawn.links):
        part = _part(link)
        if part in LEGS:
            leg = LEGS.index(part)
            centre = drawn.bodies[:, model.getJointId(f"{part}_s1"), :3, 3]
            away = np.linalg.norm(middles[:, v] - centre, axis=1)
            for k, field in enumerate(fields):
                fixed = "fixed_rod" in link or "upper" in link
                rod = slice(field.bodies.grid.moving, None) if fixed else slice(0, field.bodies.grid.moving)
                nearest = np.abs(field.exposure.from_upper_joint_m[leg, rod] - away[k]).argmin()
                values[k, v] = field.leg_elements_degC[leg, rod][nearest]
        elif part in of_part:
            values[:, v] = of_part[part]
    return values


def _part(link: str) -> str:
    """Return the part of the field to which a link belongs."""
    leg = link.partition("_")[0]
    if leg in LEGS:
        return leg
    return {"moving_platform": "platform", "trolley": "truss", "truss_bridge": "truss"}.get(
        link, link.split("_lip", maxsplit=1)[0]
    )


def _middles(drawn: SceneRobot) -> FloatArray:
    """Return the middle of every visual in the world, shape (k, visuals, 3), in m."""
    places = []
    for item in drawn.visual.geometryObjects:
        item.geometry.computeLocalAABB()
        middle = np.array([*(np.asarray(item.geometry.aabb_center) * np.asarray(item.meshScale)), 1.0])
        places.append((drawn.bodies[:, item.parentJoint] @ item.placement.homogeneous @ middle)[:, :3])
    return np.stack(places, axis=1)


class PouringBench(RobotBench):
    """Adds sliders for the temperature of the melt and the time since it came; at time zero the robot is cold.

    While a slider moves, temperatures are computed once, at the ladle's nominal pose, to a kelvin; when it is released,
    temperatures and closure are iterated until both converge.
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
        melt, _ = self._heat.temperatures_degC
        limits = {"lower": min(_COOLEST, melt), "upper": max(_HOTTEST, melt), "value": melt}
        time = {"lower": 0.0, "upper": _LONGEST_MIN, "value": 0.0}
        sliders = [
            {"id": _MELT, "label": "melt", "unit": "°C", **limits},
            {"id": _AFTER, "label": "time since the melt came", "unit": "min", **time},
        ]
        found["groups"].append({"name": _HEAT, "sliders": sliders})
        return found

    def located(self, robot: Robot, wish: PageRequest) -> Location:
        """Return the robot's location under the heat of a page's request."""
        after = wish.values.get(_AFTER, 0.0)
        if after <= 0.0 or not isinstance(robot, PouringRobot):
            return super().located(robot, wish)
        pose = self.command(robot, wish)
        if not isinstance(pose, PlatformPose):
            pose = robot.kinematics.forward(robot.drawing.mechanism.named_drives(pose))
        if _MELT not in wish.values:
            raise BadInputError("the page gives no temperature of the melt")
        heat = self._heat.with_values(melt_degC=wish.values[_MELT], after_min=after)
        heated = HeatedRobot(robot, heat, self._network)
        self._network = heated.network
        if wish.settled:
            return heated.locate(pose).location
        return WarmRobot(robot, heated.expansion(heated.field(pose, solver=_ROUGHLY)), pose).locate(pose)
