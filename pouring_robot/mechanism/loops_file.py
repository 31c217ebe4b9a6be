"""Which loops of a URDF tree are closed, and which of its joints are driven.

A URDF is a tree; a loops file says which pairs of its frames coincide on the real machine. Two formats are read: our
own (``robot_description/config/loops.yaml``) and the ``robot.yaml`` of Gepetto's example-parallel-robots (keys
``closed_loop``, ``type``, ``name_mot``).
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Self

import pydantic
from ruamel.yaml.comments import CommentedMap

from pouring_robot.exceptions import BadInputError, DescriptionError
from pouring_robot.io.argument_checks import as_path
from pouring_robot.io.typed_yaml import Entries, Entry, StrictModel, read_yaml, validate
from pouring_robot.mechanism.joint_types import JointKind

LoopKind = Literal["6d", "3d"]
AxialStiffness = Entry[pydantic.PositiveFloat, Literal["N/m"]]
TorsionStiffness = Entry[pydantic.PositiveFloat, Literal["Nm/rad"]]

# Struts of steel between yokes: stiff along, softer against turning. The pose hardly depends on their ratio, as long as
# sqrt(k_rot / k_trans), here 0.03 m, is at most 0.1 m.
DEFAULT_TRANSLATION_STIFFNESS = 1.0e8
DEFAULT_ROTATION_STIFFNESS = 1.0e5


class LoopSpec(StrictModel):
    """One closure: ``frame_b`` must coincide with ``frame_a`` (6d: fully; 3d: their origins)."""

    name: str
    frame_a: str
    frame_b: str
    type: LoopKind = "6d"


class LoopStiffness(Entries):
    """Stiffness of a closed joint: how strongly the parts resist being forced together."""

    translation: AxialStiffness
    rotation: TorsionStiffness


class LoopsFile(StrictModel):
    """A loops file as written, in our own format."""

    mechanism: str = "closed chain"  # what it is called
    base_frame: str = "universe"  # poses are seen from it
    end_frame: str | None = None  # the body that all chains carry; a mechanism without loops must name it
    tool_frames: tuple[str, ...] = ()  # further frames on that body that are reported; the last is where the tool works
    cut_joints: tuple[str, ...] = ()  # joints that carry the end body in the tree only
    locked_joints: tuple[str, ...] = ()  # joints that take no part in the closure
    # joints of another kind than the URDF says, such as ``spherical``, which URDF does not know
    joint_types: dict[str, JointKind] = pydantic.Field(default_factory=dict)
    drives: tuple[str, ...] = pydantic.Field(min_length=1)
    loops: tuple[LoopSpec, ...] = ()  # what is closed; nothing for a serial arm
    # of each closure
    stiffness: LoopStiffness = LoopStiffness(
        translation=AxialStiffness(value=DEFAULT_TRANSLATION_STIFFNESS, unit="N/m", source="assumed"),
        rotation=TorsionStiffness(value=DEFAULT_ROTATION_STIFFNESS, unit="Nm/rad", source="assumed"),
    )
    # whether drives outnumber freedoms, so that all rarely agree: loops may stay open, and what they leave is measured
    redundant_drives: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the loops, in order."""
        return tuple(loop.name for loop in self.loops)

    @property
    def loop_frames(self) -> tuple[str, ...]:
        """The frames that loops close, two of each loop."""
        return tuple(name for loop in self.loops for name in (loop.frame_a, loop.frame_b))

    @property
    def reported_frames(self) -> tuple[str, ...]:
        """The frames whose poses are reported: the end frame, then the tool frames."""
        return (*((self.end_frame,) if self.end_frame else ()), *self.tool_frames)

    @property
    def working_frame(self) -> str:
        """The frame whose error counts: the last of the reported ones; raises BadInputError where there is none."""
        if not self.reported_frames:
            raise BadInputError("the loops file names no end_frame and no tool_frames; name the frame that counts")
        return self.reported_frames[-1]

    @property
    def stiffness_si(self) -> tuple[float, float]:
        """Translation stiffness in N/m and rotation stiffness in Nm/rad."""
        return self.stiffness.translation.value, self.stiffness.rotation.value

    @pydantic.model_validator(mode="after")
    def _sound(self) -> Self:
        for what, names in (("loop", self.names), ("drive", self.drives), ("cut joint", self.cut_joints)):
            twice = {name for name in names if names.count(name) > 1}
            if twice:
                raise ValueError(f"{what} '{min(twice)}' occurs twice")
        changed = set(self.joint_types) & {*self.drives, *self.cut_joints}
        if changed:
            raise ValueError(f"joint '{min(changed)}' is driven or cut, so joint_types cannot change it")
        both = set(self.drives) & {*self.locked_joints, *self.cut_joints}
        if both:
            raise ValueError(f"joint '{min(both)}' cannot be a drive and locked or cut as well")
        if self.loops:
            return self
        if self.end_frame is None:
            raise ValueError("without loops, 'end_frame' must name the frame that the drives move")
        if self.cut_joints:
            raise ValueError(f"joint '{self.cut_joints[0]}' is cut, but no loop holds what it carried; give the loops")
        return self


def _from_gepetto(content: CommentedMap, path: Path) -> dict[str, Any]:
    """Translate the keys of Gepetto's ``robot.yaml``."""
    unknown = {str(key) for key in content} - {"closed_loop", "type", "name_mot", "joint_name", "joint_type"}
    if unknown:
        raise DescriptionError(path, f"unknown key '{min(unknown)}' beside 'closed_loop'")
    pairs, drives = content["closed_loop"], content.get("name_mot") or []
    if not isinstance(pairs, list) or any(not isinstance(pair, list) or len(pair) != 2 for pair in pairs):
        raise DescriptionError(path, "'closed_loop' must be a list of pairs of frame names")
    kinds = content.get("type") or ["6d"] * len(pairs)
    if not isinstance(kinds, list) or len(kinds) != len(pairs):
        raise DescriptionError(path, f"'type' must be a list of {len(pairs)} kinds, one a closed loop")
    loops = [
        {"name": f"loop_{i}", "frame_a": pair[0], "frame_b": pair[1], "type": str(kind).lower()}
        for i, (pair, kind) in enumerate(zip(pairs, kinds, strict=True), start=1)
    ]
    drives = [drives] if isinstance(drives, str) else drives
    return {"loops": loops, "drives": drives, "joint_types": _gepetto_joint_types(content, path)}


def _gepetto_joint_types(content: CommentedMap, path: Path) -> dict[str, str]:
    """Return the changes of joints under ``joint_name`` and ``joint_type``, such as ``UJOINT_XY``, by our names."""
    names, kinds = content.get("joint_name") or [], content.get("joint_type") or []
    if not isinstance(names, list) or not isinstance(kinds, list) or len(names) != len(kinds):
        raise DescriptionError(path, "'joint_name' and 'joint_type' must be lists of one length")
    return {
        str(name): str(kind).lower().replace("ujoint", "universal") for name, kind in zip(names, kinds, strict=True)
    }


def load_loops(path: Path | str, said: Mapping[str, Any] = MappingProxyType({})) -> LoopsFile:
    """Read a loops file of either format; raises DescriptionError where it is missing or a key in it is wrong.

    Values ``said`` elsewhere replace its keys, which it then need not have.
    """
    path = as_path(path)
    content = read_yaml(path)
    if "closed_loop" in content:
        content = CommentedMap(_from_gepetto(content, path))
    content.update(said)
    return validate(LoopsFile, content, path)
