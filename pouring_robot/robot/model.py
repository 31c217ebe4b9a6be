"""The model file: one YAML file that says how this robot differs from the drawing.

It names a layout, the placement errors of joints and the offsets of drives. Values stay in the units people write (mm,
mrad), so that reading and writing again changes no digit; :meth:`RobotModel.displacements` and
:meth:`RobotModel.drive_offset_values` return SI values. Methods that need the robot's description raise
DescriptionError where one of its files is wrong, and UnknownLayoutError where the layout does not exist.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
import pydantic

from pouring_robot.exceptions import BadInputError, DescriptionError, TooLargeError, UnknownJointError, closest
from pouring_robot.io.argument_checks import as_path, expect
from pouring_robot.io.files import write_whole
from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate, yaml_text
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.robot_file import FORMAT as ROBOT_FORMAT
from pouring_robot.robot.description.urdf import carriers, parsed, perturb_urdf
from pouring_robot.robot.effect_stack import EffectEntry, LearnedCampaign
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.pouring.definition import PouringDefinition
from pouring_robot.robot.pouring.names import DEFAULT_LAYOUT

Triple = tuple[float, float, float]
_ZERO: Triple = (0.0, 0.0, 0.0)
_LARGEST_SHARE = 0.1
"""Largest error as a share of the robot's reach: a larger one is a wrong unit or another robot."""
_LARGEST_MRAD = {"placement error": (100.0, ""), "drive offset": (200.0 * np.pi, ", a tenth of a turn")}
"""Largest angular errors: a link turned by 100 mrad moves what it carries by a tenth of its distance. The zero of a
drive depends on how it was homed, not on the shape of a part, and may be off by several teeth of a gear."""


class JointPlacement(StrictModel):
    """How one joint is displaced from its nominal placement, in its own nominal frame."""

    translation_mm: Triple = _ZERO  # displacement of the joint's origin
    rotation_mrad: Triple = _ZERO  # rotation vector that turns its nominal axes into the actual ones

    def to_se3(self) -> pin.SE3:
        """Return the displacement as the pose of the actual placement in the nominal one."""
        return pin.SE3(pin.exp3(np.array(self.rotation_mrad) * MRAD), np.array(self.translation_mm) * MM)

    @classmethod
    def from_se3(cls, pose_nominal_to_actual: pin.SE3) -> JointPlacement:
        """Make a displacement from the pose of the actual placement in the nominal one."""
        expect(pose_nominal_to_actual, pin.SE3, "a displacement is a pinocchio.SE3")
        shift, turn = pose_nominal_to_actual.translation / MM, pin.log3(pose_nominal_to_actual.rotation) / MRAD
        return cls(translation_mm=tuple(shift.tolist()), rotation_mrad=tuple(turn.tolist()))


class DriveOffset(StrictModel):
    """How far a drive is beyond its command: one of the two values, as the drive is a length or an angle."""

    offset_mm: float | None = None  # of a linear drive
    offset_mrad: float | None = None  # of a rotary drive

    @pydantic.model_validator(mode="after")
    def _one(self) -> DriveOffset:
        if (self.offset_mm is None) == (self.offset_mrad is None):
            raise ValueError("give either offset_mm or offset_mrad")
        return self

    @property
    def unit(self) -> Literal["m", "rad"]:
        """Unit of the drive it fits."""
        return "rad" if self.offset_mm is None else "m"

    def to_si(self) -> float:
        """Return the offset in m or rad."""
        return (self.offset_mrad or 0.0) * MRAD if self.offset_mm is None else self.offset_mm * MM


class RobotModel(StrictModel):
    """A robot as built: a layout and its errors, by URDF joint name; files are relative to the model file's folder."""

    format: Literal["pouring_robot/model/1"] = "pouring_robot/model/1"
    description: str = ""  # a line for people
    robot: str | None = None  # robot file of another robot than the pouring robot
    layout: str = DEFAULT_LAYOUT  # name of the pouring robot's layout in the dimensions file
    layouts_file: str | None = None  # dimensions file that replaces the shipped one
    joint_placements: dict[str, JointPlacement] = pydantic.Field(default_factory=dict)
    drive_offsets: dict[str, DriveOffset] = pydantic.Field(default_factory=dict)  # added to commands
    heat: HeatSection | None = None  # how warm it is; left out: as cold as the drawing
    effects: list[EffectEntry] = pydantic.Field(default_factory=list)  # found by diagnosis, the oldest first
    learned: dict[str, LearnedCampaign] = pydantic.Field(default_factory=dict)  # campaigns effects were learned from

    _file: Path | None = pydantic.PrivateAttr(default=None)
    _folder: Path = pydantic.PrivateAttr(default_factory=Path)  # of the file; absolute, as the process may change its
    _placed: dict[str, JointPlacement] = pydantic.PrivateAttr(default_factory=dict)
    _defined: tuple[Any, RobotDefinition] | None = pydantic.PrivateAttr(default=None)

    @pydantic.model_validator(mode="after")
    def _sound(self) -> RobotModel:
        for entry in self.effects:
            if entry.learned and entry.learned not in self.learned:
                raise ValueError(f"'{entry.effect}' was learned in '{entry.learned}', but 'learned' has no such entry")
        if self.robot is not None:
            for key in ("layout", "layouts_file", "heat"):
                if key in self.model_fields_set and getattr(self, key) is not None:
                    raise ValueError(f"'{key}' is for the pouring robot only; leave it out with 'robot'")
        return self

    @classmethod
    def for_robot(cls, robot: RobotDefinition | Path | str) -> RobotModel:
        """Return the nominal model of a robot, given its definition or robot file."""
        path = robot.path if isinstance(robot, RobotDefinition) else as_path(robot)
        model = cls(robot=str(path.absolute()))
        if isinstance(robot, RobotDefinition):
            model._defined = (model.robot_path, model.layout, model.layouts_path), robot
        model.definition  # noqa: B018 - report errors in the file now
        return model

    @classmethod
    def load(cls, path: Path | str) -> RobotModel:
        """Read a model file, or the nominal model of a robot file; raises DescriptionError where it is wrong."""
        path = as_path(path)
        content = read_yaml(path, "a model file, YAML")
        if content.get("format") == ROBOT_FORMAT:
            return cls.for_robot(path)
        model = validate(cls, content, path)
        model._file, model._folder = path, path.absolute().parent
        try:
            model.check_errors()
            for name, learned in model.learned.items():
                learned.check(model.definition, f"learned.{name}")
            model.urdf()
        except UnknownJointError as problem:
            raise DescriptionError(path, f"joint_placements: {problem}") from problem
        except BadInputError as problem:
            if isinstance(problem, DescriptionError):
                raise
            raise model.fault(str(problem)) from problem
        return model

    def fault(self, problem: str) -> BadInputError:
        """Return the error for a problem with the model; it names the model file, if there is one."""
        return DescriptionError(self._file, problem) if self._file else BadInputError(problem)

    @classmethod
    def of(cls, model: RobotModel | Path | str | None) -> RobotModel:
        """Return a model: itself, of its file, or (None) the default drawing; raises BadInputError otherwise."""
        if isinstance(model, Path | str):
            return cls.load(model)
        expect(model, RobotModel | None, "a model is a RobotModel or the path of its file")
        return model or cls()

    def __eq__(self, other: object) -> bool:
        """Compare the contents of the files and the dimensions file they refer to, not where the model files are."""
        if not isinstance(other, RobotModel):
            return NotImplemented
        here, there = (model.layouts_path and model.layouts_path.resolve() for model in (self, other))
        ours, theirs = (model.model_dump(exclude={"robot", "layouts_file"}) for model in (self, other))
        return ours == theirs and here == there and self.robot_path == other.robot_path

    __hash__ = None  # type: ignore[assignment]

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write the model file atomically, without defaults.

        Raises OutputError where that is impossible, or the file exists already and ``overwrite`` is not set.
        """
        return write_whole(path, self.file_text(as_path(path).parent), overwrite=overwrite)

    def file_text(self, folder: Path) -> str:
        """Return the text of the model file for a folder, to which its paths are relative."""
        content: dict[str, Any] = {"format": self.format}
        content |= {"robot": ""} if self.robot else {"layout": self.layout}
        content |= self.model_dump(mode="json", exclude_defaults=True)
        if self.robot_path:
            content["robot"] = os.path.relpath(self.robot_path, folder)
        if self.layouts_file:
            content["layouts_file"] = os.path.relpath(self.layouts_path or "", folder)
        return yaml_text(content, default_flow_style=None)

    @property
    def file(self) -> Path | None:
        """The model file it was read from, as the caller named it; None if it was not read from a file."""
        return self._file

    @property
    def layouts_path(self) -> Path | None:
        """The dimensions file in use, or None for the shipped one."""
        return self._folder / self.layouts_file if self.layouts_file else None

    @property
    def robot_path(self) -> Path | None:
        """The robot file, or None for the pouring robot."""
        return (self._folder / self.robot).resolve() if self.robot else None

    @property
    def definition(self) -> RobotDefinition:
        """Definition of the nominal robot: URDF, loops, drives, names."""
        wanted = (self.robot_path, self.layout, self.layouts_path)
        if self._defined is None or self._defined[0] != wanted:
            path, layout = self.robot_path, (self.layout, self.layouts_path)
            self._defined = wanted, RobotDefinition.load(path) if path else PouringDefinition(*layout)
        return self._defined[1]

    @property
    def named(self) -> dict[str, str]:
        """Which robot it is, for printed figures: by name, or by the layout of the pouring robot."""
        return {"robot": self.definition.name} if self.robot else {"layout": self.layout}

    @property
    def is_drawing(self) -> bool:
        """Whether the model has no placement error and no drive offset."""
        return not self.drive_offsets and all(error == JointPlacement() for error in self.joint_placements.values())

    @property
    def conditional(self) -> tuple[str, ...]:
        """The effects that depend on conditions, by id."""
        return tuple(dict.fromkeys(entry.effect for entry in self.effects if not entry.placed))

    def cautions(self, name: str = "the model") -> tuple[str, ...]:
        """Return the reasons, a line each, why the model called ``name`` should not be used."""
        worse = (campaign for campaign, learned in self.learned.items() if learned.worse)
        advice = "rows held out there fit worse than without it: do not use it"
        return tuple(f"{name} with what it learned in '{campaign}': {advice}" for campaign in worse)

    def left_out(
        self, who: str, name: str = "the model", *, warm: bool = False, under: bool = False
    ) -> tuple[str, ...]:
        """Return, a line each, which parts of the model called ``name`` the caller ``who`` ignores.

        Heat is not mentioned if the caller handles it (``warm``), nor are conditional effects if it does (``under``).
        """
        lines = []
        if self.heat is not None and not warm:
            lines.append(f"{who} uses the cold robot; the heat section of {name} is left out")
        if self.conditional and not under:
            effects = ", ".join(self.conditional)
            lines.append(f"{who} does not apply the effects of {name} that depend on conditions: {effects}")
        return tuple(lines)

    def warn_of_left_out(self, who: str, name: str = "the model") -> None:
        """Warn the library's user of what ``who``, a part of the library, ignores, and of :meth:`cautions`."""
        lines, frame, level = (*self.cautions(name), *self.left_out(who, name)), sys._getframe(), 1
        while lines and frame.f_back and frame.f_globals.get("__name__", "").startswith("pouring_robot."):
            frame, level = frame.f_back, level + 1
        for line in lines:
            warnings.warn(line, stacklevel=level)

    def displacements(self) -> dict[str, pin.SE3]:
        """Return the displacement of each joint as the pose of its actual placement in the nominal one."""
        return {joint: error.to_se3() for joint, error in self.joint_placements.items()}

    def drive_offset_values(self) -> dict[str, float]:
        """Return the offset of each drive that has one, in m or rad."""
        return {drive: offset.to_si() for drive, offset in self.drive_offsets.items()}

    def actual_drive_values(self, commands: FloatArray) -> FloatArray:
        """Return the values of the drives for commands (..., drives), in m and rad: the commands plus the offsets."""
        offsets = self.drive_offset_values()
        return np.asarray(commands + np.array([offsets.get(drive.joint, 0.0) for drive in self.definition.drives]))

    def displaced(self, placements: Mapping[str, pin.SE3], drives: Mapping[str, float]) -> RobotModel:
        """Return the model with further displacements, as poses in the present placements, and offsets (m, rad)."""
        joints = dict(self.joint_placements)
        for joint, moved in placements.items():
            joints[joint] = JointPlacement.from_se3(joints[joint].to_se3() * moved if joint in joints else moved)
        offsets, units = dict(self.drive_offsets), {drive.joint: drive.unit for drive in self.definition.drives}
        for joint, added in drives.items():
            total = added + (offsets[joint].to_si() if joint in offsets else 0.0)
            entry = {"offset_mm": total / MM} if units[joint] == "m" else {"offset_mrad": total / MRAD}
            offsets[joint] = DriveOffset(**entry)
        return self.model_copy(update={"joint_placements": joints, "drive_offsets": offsets})

    def check_errors(self) -> None:
        """Raise BadInputError where an offset is of no drive or in the wrong unit, or an error is implausibly large.

        That is more than a tenth of the robot's reach, or 100 mrad; for a rotary drive, more than a tenth of a turn.
        """
        drives = {drive.joint: drive for drive in self.definition.drives} if self.drive_offsets else {}
        for joint, offset in self.drive_offsets.items():
            if joint not in drives:
                raise BadInputError(f"drive_offsets: the robot has no drive '{joint}'{closest(joint, drives)}")
            if offset.unit != drives[joint].unit:
                wanted = "offset_mm" if drives[joint].unit == "m" else "offset_mrad"
                raise BadInputError(f"drive_offsets: '{joint}' needs {wanted}")
            self._check_size(joint, "drive offset", (offset.offset_mm or 0.0,), (offset.offset_mrad or 0.0,))
        for joint, error in self.joint_placements.items():
            if error != self._placed.get(joint):  # equal ones were checked as offsets
                self._check_size(joint, "placement error", error.translation_mm, error.rotation_mrad)

    def _check_size(self, joint: str, kind: str, lengths_mm: tuple[float, ...], turns_mrad: tuple[float, ...]) -> None:
        length, turn = (max(values, key=abs) for values in (lengths_mm, turns_mrad))
        # If all axes meet in a point, the drawing has no length to compare an error with.
        limit = _LARGEST_SHARE * (self.definition.reach_m or np.inf) / MM if length else 0.0
        limit_mrad, of = _LARGEST_MRAD[kind]
        for value, most, unit, why in (
            (length, limit, "mm", ", a tenth of the robot's reach"),
            (turn, limit_mrad, "mrad", of),
        ):
            if abs(value) > most:
                raise TooLargeError(
                    f"'{joint}': {value:.6g} {unit} is too large for a {kind} (limit {most:.0f} {unit}{why})"
                )

    def urdf(self) -> str:
        """Return the URDF of the robot as built: the drawing with every joint displaced by its error.

        Raises UnknownJointError where a joint does not exist, BadInputError where the tree is cut at it.
        """
        drawn, loops = self.definition.urdf(), self.definition.loops
        for joint in loops.cut_joints:
            if joint in self.joint_placements:
                frame = loops.loops[0].frame_b
                seat, *_ = (*carriers(parsed(drawn), frame)[frame], frame)
                raise BadInputError(
                    f"joint '{joint}' only carries the end body in the URDF tree; displace the joints that place the "
                    f"chains' seats on it ({seat} ...) instead"
                )
        return perturb_urdf(drawn, self.displacements(), self.definition.source)

    def with_offsets_placed(self) -> RobotModel:
        """Return the same robot with each drive's offset as a displacement of its joint along or about its axis.

        A joint's placement M moved by an offset o and then by the command q is M moved by q + o. A joint that mimics
        the drive no longer receives its offset, and is displaced by its own share of it.
        """
        if not self.drive_offsets:
            return self
        self.check_errors()
        mechanism, placed = self.mechanism(), dict[str, JointPlacement]()
        offsets = mechanism.with_followers(self.drive_offset_values())
        axes = mechanism.joint_axes([mechanism.joint_id(name) for name in offsets])
        for (name, offset), axis in zip(offsets.items(), axes, strict=True):
            present = self.joint_placements.get(name, JointPlacement()).to_se3()
            placed[name] = JointPlacement.from_se3(present * pin.exp6(pin.Motion(axis * offset)))
        placements = {**self.joint_placements, **placed}
        moved = self.model_copy(update={"joint_placements": placements, "drive_offsets": {}})
        moved._placed = placed  # a spindle that follows a slide may turn far for a small offset of the slide
        return moved

    def mechanism(self) -> ClosedChainMechanism:
        """Return the mechanism of the robot as built."""
        drawn = self.definition
        return ClosedChainMechanism(
            self.urdf(), drawn.loops, drawn.path, built_in=self.displacements(), home=drawn.file.home
        )
