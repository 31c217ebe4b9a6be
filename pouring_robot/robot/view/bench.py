"""The robot behind the sliders of a live page: pose or drive values, and every geometric error by name."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import pinocchio as pin
import pydantic

from pouring_robot.exceptions import BadInputError, PouringRobotError
from pouring_robot.io.typed_yaml import StrictModel
from pouring_robot.io.units import LARGEST, shown_in
from pouring_robot.mechanism.local_parameters import DriveParameter
from pouring_robot.robot.description.command import CommandAxis
from pouring_robot.robot.location import LadleLocation, Location
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import Parameter
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.view.nominal_and_actual import at_location, pose_scene
from pouring_robot.viewer import Scene
from pouring_robot.viewer.page import film

POSE, DRIVES = "pose", "drives"
_MOST_AT_FIRST = 100.0
_Shown = Annotated[pydantic.FiniteFloat, pydantic.Field(ge=-LARGEST, le=LARGEST)]
_LARGEST = {"mm": 2.0, "mrad": 10.0}


class PageRequest(StrictModel):
    """A request of a page."""

    commanded: str  # the group of sliders that commands the robot: the one moved last
    settled: bool  # whether the slider was released
    values: dict[str, _Shown]  # of all sliders, by their ids, in their units
    errors: dict[str, _Shown]  # geometric errors by name, in mm or mrad, on top of the model's


class RobotBench:
    """A robot, initially at a location, that a page moves; the page keeps the state, so several may share a bench."""

    def __init__(self, robot: Robot, location: Location, exaggeration: float | None = None) -> None:
        self.robot, self.location = robot, location
        words = location.loops.working_frame.replace("_", " ")
        title = f"Where the {words} really is, and what moves it"
        scene = pose_scene([location], exaggeration)
        # Errors that are too small to be seen are to be enlarged by their sliders, not by the factor alone.
        factor = exaggeration or min(scene.exaggeration, _MOST_AT_FIRST)
        self.scene: Scene = dataclasses.replace(scene, title=title, exaggeration=factor)
        self._changed: tuple[dict[str, float], Robot] = ({}, robot)
        mechanism = robot.nominal_solver.mechanism
        self._axes: dict[str, tuple[CommandAxis, ...]] = {DRIVES: robot.model.definition.drive_axes(mechanism)}
        if isinstance(location, LadleLocation):
            self._axes = {POSE: robot.command_axes, **self._axes}
        self._parameters = {p.name: p for p in robot.parameters.parameters.values() if not (p.dh and p.dh.drops_out)}

    def sliders(self) -> dict[str, Any]:
        """Return the groups of sliders and the available geometric errors, ready for JSON."""
        values, names = self._values(self.location), dict[str, list[str]]()
        for parameter in self._parameters.values():
            names.setdefault(_set_of(parameter), []).append(parameter.name)
        drives = zip(self._axes[DRIVES], self.robot.model.definition.drives, strict=True)
        joints = {a.heading: d.joint if (d.factor, d.zero) == (1.0, 0.0) else f"motor of {d.joint}" for a, d in drives}
        return {
            "groups": [
                {
                    "name": name,
                    "commands": True,
                    "sliders": [_slider(a, joints.get(a.heading, a.quantity.name), values[a.heading]) for a in axes],
                }
                for name, axes in self._axes.items()
            ],
            "errors": {
                "values": {},
                "names": names,
                "units": {name: shown_in(p.unit)[0] for name, p in self._parameters.items()},
                "largest": _LARGEST,
            },
        }

    def answer(self, wanted: Any) -> dict[str, Any]:
        """Return the poses of all bodies for a page's request, or why the robot cannot take that pose."""
        try:
            wish = PageRequest.model_validate(wanted)
            location = self.located(self._with_errors(wish.errors), wish)
        except PouringRobotError as problem:
            return {"refused": str(problem)}
        except pydantic.ValidationError as problem:
            return {"refused": f"the page sent an invalid request: {problem.errors()[0]['msg']}"}
        return {"film": film(at_location(self.scene, location)), "values": self._values(location)}

    def located(self, robot: Robot, wish: PageRequest) -> Location:
        """Return a robot's location for a page's request."""
        return robot.location_of(self.command(robot, wish))

    def command(self, robot: Robot, wish: PageRequest) -> Any:
        """Return the command of a request: drives where they were moved last, otherwise the pose if there is one."""
        group = DRIVES if wish.commanded == DRIVES or POSE not in self._axes else POSE
        missing = [axis.heading for axis in self._axes[group] if axis.heading not in wish.values]
        if missing:
            raise BadInputError(f"the page gives no value for {missing[0]}")
        values = np.array([axis.value(wish.values[axis.heading]) for axis in self._axes[group]])
        return values if group == DRIVES else robot.command_at(values)

    def _values(self, location: Location) -> dict[str, float]:
        """Return the values of all sliders that command the robot, by id."""
        inner: dict[str, Sequence[float]] = {DRIVES: list(location.drives.values())}
        if isinstance(location, LadleLocation):
            inner[POSE] = location.commanded.values
        return {
            axis.heading: axis.shown(value)
            for group, axes in self._axes.items()
            for axis, value in zip(axes, inner[group], strict=True)
        }

    def _with_errors(self, errors: Mapping[str, float]) -> Robot:
        """Return the robot with errors added; the previous one if they have not changed."""
        if unknown := [name for name in errors if name not in self._parameters]:
            raise BadInputError(f"there is no geometric error '{unknown[0]}'")
        if errors != self._changed[0]:
            found = {self._parameters[name]: value for name, value in errors.items()}
            self._changed = (
                dict(errors),
                self.robot.built_as(with_errors(self.robot.model, found)) if errors else self.robot,
            )
        return self._changed[1]


def with_errors(model: RobotModel, errors: Mapping[Parameter, float]) -> RobotModel:
    """Return a model with errors added, in mm or mrad: placements composed in order, drive offsets summed."""
    moved, offsets = dict[str, pin.SE3](), dict[str, float]()
    for parameter, value in errors.items():
        local, size = parameter.local, value * shown_in(parameter.unit)[1]
        if isinstance(local, DriveParameter):
            offsets[local.joint] = offsets.get(local.joint, 0.0) + size
        else:
            step = pin.exp6(pin.Motion(size * np.array(local.twist)))
            moved[local.joint] = moved.get(local.joint, pin.SE3.Identity()) * step
    return model.displaced(moved, offsets)


def _set_of(parameter: Parameter) -> str:
    """Return the heading under which a page lists an error."""
    if isinstance(parameter.local, DriveParameter):
        return "drives"
    chain = f", chain {parameter.chain}" if parameter.chain else ""
    return ("DH table" if parameter.dh else "joint placements") + chain


def _slider(axis: CommandAxis, name: str, value: float) -> dict[str, Any]:
    unit = axis.heading.rpartition("_")[2]
    ends = sorted((axis.shown(axis.lower), axis.shown(axis.upper)))
    if not all(map(math.isfinite, ends)):  # a joint without limits
        ends = [value - 180.0, value + 180.0] if unit == "deg" else [value - 500.0, value + 500.0]
    return {"id": axis.heading, "label": name, "unit": unit, "lower": ends[0], "upper": ends[1], "value": value}
