"""The model file: one YAML that says how this robot differs from the drawing.

It names a layout and the placement errors of joints. It is kept in the units people write (mm, mrad), so that
reading and writing again changes no digit; SI values come out of :meth:`RobotModel.placement_errors`.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any, Literal

import pinocchio as pin
import pydantic
from ruamel.yaml import YAML

from pouring_robot.description import PlacementError, description_folder, perturb_urdf, render_urdf
from pouring_robot.exceptions import BadInputError, DescriptionError, ModelFileError, UnknownJointError
from pouring_robot.files import write_whole
from pouring_robot.loops import LoopsFile, load_loops
from pouring_robot.mechanism import ClosedChainMechanism
from pouring_robot.poses import MM, MRAD
from pouring_robot.yaml_files import StrictModel, read_yaml, validate

Triple = tuple[float, float, float]
_ZERO: Triple = (0.0, 0.0, 0.0)
# More than this is a mistake of units, not a machining error.
_LARGEST_MM, _LARGEST_MRAD = 50.0, 100.0


class JointPlacement(StrictModel):
    """How one joint is displaced from its nominal placement, in its own nominal frame.

    Attributes:
        translation_mm: displacement of the joint's origin.
        rotation_mrad: rotation vector that turns its nominal axes into the actual ones.
    """

    translation_mm: Triple = _ZERO
    rotation_mrad: Triple = _ZERO

    @pydantic.model_validator(mode="after")
    def _small(self) -> JointPlacement:
        for values, limit, unit in (
            (self.translation_mm, _LARGEST_MM, "mm"),
            (self.rotation_mrad, _LARGEST_MRAD, "mrad"),
        ):
            largest = max(values, key=abs)
            if abs(largest) > limit:
                raise ValueError(f"{largest} {unit} is no placement error (limit {limit} {unit}); check the unit")
        return self

    def to_si(self) -> PlacementError:
        """Return the same error in m and rad."""
        tx, ty, tz = (value * MM for value in self.translation_mm)
        rx, ry, rz = (value * MRAD for value in self.rotation_mrad)
        return PlacementError(translation_m=(tx, ty, tz), rotation_rad=(rx, ry, rz))


class RobotModel(StrictModel):
    """A robot as built: a layout and its errors.

    Attributes:
        format: kind and version of the file.
        description: a line for people.
        layout: name of the layout in the dimensions file.
        layouts_file: another dimensions file than the shipped one, relative to the model file's folder.
        joint_placements: placement error of each joint that has one, by URDF joint name.
    """

    format: Literal["pouring_robot/model/1"] = "pouring_robot/model/1"
    description: str = ""
    layout: str = "paper"
    layouts_file: str | None = None
    joint_placements: dict[str, JointPlacement] = pydantic.Field(default_factory=dict)

    _folder: Path = pydantic.PrivateAttr(default_factory=Path)

    @classmethod
    def load(cls, path: Path | str) -> RobotModel:
        """Read a model file and check that the robot has the joints it names.

        Raises:
            ModelFileError: the file cannot be read, or a key, value, layout or joint in it is wrong.
        """
        path = Path(path)
        model = validate(cls, read_yaml(path, ModelFileError), path, ModelFileError)
        model._folder = path.parent
        try:
            model.urdf()
        except UnknownJointError as problem:
            raise ModelFileError(path, f"joint_placements: {problem}") from problem
        except BadInputError as problem:
            if isinstance(problem, DescriptionError):
                raise
            raise ModelFileError(path, str(problem)) from problem
        return model

    def __eq__(self, other: object) -> bool:
        """Compare what the files say and which dimensions file they mean, not where the model files lie."""
        if not isinstance(other, RobotModel):
            return NotImplemented
        here, there = (model.layouts_path and model.layouts_path.resolve() for model in (self, other))
        ours, theirs = (model.model_dump(exclude={"layouts_file"}) for model in (self, other))
        return ours == theirs and here == there

    __hash__ = None  # type: ignore[assignment]

    def save(self, path: Path | str) -> Path:
        """Write the model file, whole or not at all; what equals the default is left out.

        Raises:
            OutputError: the place cannot be written to.
        """
        path = Path(path)
        content: dict[str, Any] = {"format": self.format, "layout": self.layout}
        content |= self.model_dump(mode="json", exclude_defaults=True)
        if self.layouts_file:
            content["layouts_file"] = os.path.relpath(self.layouts_path or "", path.parent)
        stream = io.StringIO()
        yaml = YAML()
        yaml.default_flow_style = None
        yaml.dump(content, stream)
        return write_whole(path, stream.getvalue())

    @property
    def layouts_path(self) -> Path | None:
        """The dimensions file in use, or None for the shipped one."""
        return self._folder / self.layouts_file if self.layouts_file else None

    def placement_errors(self) -> dict[str, PlacementError]:
        """Return the joint placement errors in m and rad."""
        return {joint: error.to_si() for joint, error in self.joint_placements.items()}

    def loops(self) -> LoopsFile:
        """Return the shipped declaration of the four loops."""
        return load_loops(loops_file())

    def nominal_urdf(self, chain_order: tuple[int, ...] = (1, 2, 3, 4)) -> str:
        """Return the robot of the drawing as URDF.

        Raises:
            DescriptionError: the description or the dimensions file is broken.
            UnknownLayoutError: there is no such layout.
        """
        return render_urdf(self.layout, chain_order=chain_order, layouts_file=self.layouts_path)

    def urdf(self, chain_order: tuple[int, ...] = (1, 2, 3, 4)) -> str:
        """Return the robot as built as URDF: the drawing with every joint displaced by its error.

        Raises:
            UnknownJointError: the model displaces a joint that the robot does not have.
            BadInputError: the model displaces the joint at which the tree is cut.
        """
        for joint in self.loops().cut_joints:
            if joint in self.joint_placements:
                raise BadInputError(
                    f"joint '{joint}' only carries the platform in the URDF tree; displace the platform's seats "
                    "(leg1_seat_mount ...) instead"
                )
        return perturb_urdf(self.nominal_urdf(chain_order), self.placement_errors())

    def tree_urdf(self) -> str:
        """Return the robot as built for programs that know no loops.

        In :meth:`urdf` the joint that only carries the platform in the tree stands as drawn. Here it stands so
        that the carrying chain meets the platform at its displaced seat.
        """
        return meet_at_cut_joints(self.urdf(), self.loops())

    def nominal_mechanism(self, chain_order: tuple[int, ...] = (1, 2, 3, 4)) -> ClosedChainMechanism:
        """Return the mechanism of the drawing."""
        return ClosedChainMechanism(self.nominal_urdf(chain_order), self.loops(), loops_file())

    def mechanism(self, chain_order: tuple[int, ...] = (1, 2, 3, 4)) -> ClosedChainMechanism:
        """Return the mechanism as built."""
        return ClosedChainMechanism(self.urdf(chain_order), self.loops(), loops_file())


def meet_at_cut_joints(urdf: str, loops: LoopsFile) -> str:
    """Return the URDF with its cut joints placed so that the loops of the carrying chains are closed in the tree."""
    mechanism = ClosedChainMechanism(urdf, loops)
    model, paths = mechanism.shared_model, mechanism.frame_paths
    data = model.createData()
    pin.framesForwardKinematics(model, data, mechanism.neutral_configuration())
    errors = {}
    for cut in loops.cut_joints:
        for loop in loops.loops:
            if paths[loop.frame_a] == paths[cut][:-1]:
                mount, foot, seat = (data.oMf[mechanism.frame_id(name)] for name in (cut, loop.frame_a, loop.frame_b))
                moved = mount.actInv(foot * seat.actInv(mount))
                turn = pin.log3(moved.rotation)
                errors[cut] = PlacementError(tuple(moved.translation.tolist()), tuple(turn.tolist()))
    return perturb_urdf(urdf, errors)


def loops_file() -> Path:
    """Return the shipped loops file."""
    return description_folder() / "config" / "loops.yaml"
