"""Schema of the robot file, ``robot.yaml``: its keys, and checks of them that need no other file."""

from pathlib import Path
from typing import Literal, Self

import pydantic

from pouring_robot.exceptions import closest
from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate
from pouring_robot.mechanism.joint_types import JointKind
from pouring_robot.mechanism.loops_file import LoopSpec, LoopStiffness

FORMAT = "pouring_robot/robot/1"
POSITION, ROTATION = ("x", "y", "z"), ("rx", "ry", "rz")
DISTANCE = ("distance", "distance_from")
MEASURED, AMBIENT = (*POSITION, *ROTATION, DISTANCE[0]), "ambient"
TAKEN = frozenset({"sample", "session", "time", "payload", AMBIENT, *POSITION, *ROTATION, *DISTANCE})
"""Names of columns that campaigns have for any robot."""
_JOINT_UNIT = "m or rad"  # description of a key; messages about wrong values show it


class DriveEntry(StrictModel):
    """One drive of a robot file."""

    joint: str  # the URDF joint that it moves
    column: str = ""  # name of its column in a campaign, without unit; by default the joint's name
    ratio: float = 1.0  # how far the joint moves for a command of one of the same kind (a gear; below 1: a reduction)
    # travel of a sliding joint per turn of its motor; the command is then an angle
    mm_per_turn: float | None = None
    zero: float = pydantic.Field(default=0.0, description=_JOINT_UNIT)  # value of the joint at a command of zero

    @pydantic.model_validator(mode="after")
    def _moves(self) -> Self:
        if self.ratio == 0.0 or self.mm_per_turn == 0.0:
            raise ValueError("a ratio of 0 moves nothing")
        if self.ratio != 1.0 and self.mm_per_turn is not None:
            raise ValueError("give either ratio or mm_per_turn")
        return self


class RobotFile(StrictModel):
    """Content of a robot file; paths are relative to it."""

    format: Literal["pouring_robot/robot/1"]  # kind and version of the file
    # name of the robot in campaigns and reports
    name: str = pydantic.Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    urdf: str | None = None  # the URDF; or ``xacro`` with its ``mappings``
    xacro: str | None = None
    mappings: dict[str, str] = pydantic.Field(default_factory=dict)
    # poses are relative to it. Where ``loops`` is a file, the keys from here to ``locked_joints`` may be in that file.
    base_frame: str | None = None
    end_frame: str | None = None  # the body whose pose is measured
    tool_frames: tuple[str, ...] = ()  # further frames on that body; the error counts at the last one
    # closed loops, in the file itself or in a loops file; none for a serial arm
    loops: tuple[LoopSpec, ...] | str = ()
    cut_joints: tuple[str, ...] = ()  # joints that carry the end body in the tree only
    locked_joints: tuple[str, ...] = ()  # joints that take no part in the closure
    # joints of another type than in the URDF, such as ``spherical`` or ``universal_xy``
    joint_types: dict[str, JointKind] = pydantic.Field(default_factory=dict)
    stiffness: LoopStiffness | None = None  # of each closure
    drives: tuple[DriveEntry, ...] = pydantic.Field(min_length=1)  # what the controller commands, in this order
    # whether there are more drives than degrees of freedom: their disagreement is then a measurement
    redundant_drives: bool = False
    # drives that share a cause, all angles or all lengths, like the first; by default all angles, and all lengths
    groups: dict[str, tuple[str, ...]] = pydantic.Field(default_factory=dict)
    # joints that may be displaced, or only along one of their axes (``anchor.tx``); by default all. Where no external
    # device measures, joints that are left out define the frame in which the others' errors are given.
    places: tuple[str, ...] | None = None
    axes: tuple[str, ...] | None = None  # joints whose axes may be tilted; by default all
    tolerances: str | None = None  # the robot's own tolerances file
    # force on a linear drive for which its stretch is stated; ``usual_moment_nm``: moment on a rotary drive
    usual_force_n: float = pydantic.Field(default=1000.0, gt=0.0)
    usual_moment_nm: float | None = pydantic.Field(default=None, gt=0.0)  # by default from their effort limits
    payload_frame: str | None = None  # where a payload hangs
    travel: tuple[str, ...] = ()  # joints that carry base_frame and all in it; they take no part in the closure
    # joint values near which the robot closes; by default all zero
    home: dict[str, float] = pydantic.Field(default_factory=dict, description=_JOINT_UNIT)

    @pydantic.model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.urdf is None) == (self.xacro is None):
            raise ValueError("give either urdf or xacro")
        if not isinstance(self.loops, str) and (self.base_frame is None or self.end_frame is None):
            raise ValueError("base_frame and end_frame are needed; only a loops file may name them instead")
        # Keys about drives override a loops file, which would be blamed if its check came first.
        joints = {entry.joint for entry in self.drives}
        for group, members in self.groups.items():
            if len(set(members)) < max(len(members), 1):
                raise ValueError(f"group '{group}' names {'a drive twice' if members else 'no drive'}")
            for member in members:
                if member not in joints:
                    raise ValueError(f"group '{group}' names '{member}', which is not a drive{closest(member, joints)}")
        columns = [entry.column or entry.joint for entry in self.drives]
        if len(joints) < len(self.drives):
            raise ValueError("two drives move the same joint")
        if taken := TAKEN.intersection(columns):
            name = min(taken)
            raise ValueError(
                f"a drive's column cannot be '{name}', which campaigns have for something else; set column: to another "
                f"name, such as column: {name}_drive"
            )
        both = joints.intersection((*self.locked_joints, *self.travel))
        if both:
            raise ValueError(f"'{min(both)}' is a drive; remove it from locked_joints and travel")
        twice = {column for column in columns if columns.count(column) > 1}
        if twice:
            mend = "name one otherwise; of joints that move together let one be the drive, and the others mimic it"
            raise ValueError(f"two drives have the column '{min(twice)}'; {mend}")
        return self

    @property
    def along(self) -> dict[str, str] | None:
        """Axes (``xyz``) along which each joint of ``places`` may be displaced; None: all joints, along all."""
        found: dict[str, str] = {}
        for name in self.places or ():
            joint, _, axis = name.rpartition(".t") if name.endswith((".tx", ".ty", ".tz")) else (name, "", "xyz")
            found[joint] = "".join(sorted({*found.get(joint, ""), *axis}))
        return None if self.places is None else found

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a robot file; raises DescriptionError where it cannot be read, or a key or value in it is wrong."""
        return validate(cls, read_yaml(path, "a robot file, robot.yaml"), path)
