"""Definition of any robot: its URDF, its loops, its drives and their names in files.

A robot is defined by a ``robot.yaml``, and so is the pouring robot (:mod:`pouring_robot.robot.pouring.definition`):

    format: pouring_robot/robot/1
    name: ur10
    urdf: ur10.urdf                       # or xacro: and mappings:
    base_frame: base_link
    end_frame: tool0
    drives:
      - {joint: shoulder_pan_joint}       # column: the name of its campaign column, by default the joint's
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pouring_robot.exceptions import DescriptionError, UnknownJointError, closest
from pouring_robot.io.files import read_text
from pouring_robot.io.quantity_columns import Quantity
from pouring_robot.io.typed_yaml import validate, yaml_text
from pouring_robot.io.units import joint_shown_in
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions
from pouring_robot.mechanism.joint_limits import WRITTEN, in_limits
from pouring_robot.mechanism.joint_types import NOT_IN_URDF, change_joints
from pouring_robot.mechanism.loops_file import LoopsFile, load_loops
from pouring_robot.robot.description.command import CommandAxis, command_box
from pouring_robot.robot.description.drawing import Drawing, agreed
from pouring_robot.robot.description.drive import Drive
from pouring_robot.robot.description.robot_file import AMBIENT, TAKEN, RobotFile
from pouring_robot.robot.description.urdf import (
    carriers,
    check_sound,
    limits_of,
    meshes_from,
    parsed,
    reach,
    read_urdf,
    robot_name,
)

if TYPE_CHECKING:
    from pouring_robot.batch import BatchStart
    from pouring_robot.robot.description.cause_types import Causes
    from pouring_robot.robot.dh.table import DHTable

_WORKSPACE_SAMPLES = 200
_DRAWN_FIT = 1e-4
"""How far the loops of a drawing may be open, over its reach and in rad: drawings state 0.1 mm per metre."""
_MEASURED_FIT = 0.03
"""How far commands of redundant drives may disagree, over the reach. Anchors measured by hand are off by a few percent:
those of the Hangprinter in ``examples/machines`` make its lines disagree by up to 1 %."""
JointLimits = Mapping[str, tuple[float, float] | None]
ParameterGroups = Mapping[str, tuple[str, tuple[str, ...]]]
ParameterSets = Mapping[str, tuple[str, ...]]
_GROUPS: ParameterGroups = {
    "drives": ("zero offsets of the drives", ("drive.*",)),
    "joint_places": ("places of the joints", ("*.t?",)),
    "joint_axes": ("axes of the joints", ("*.r?",)),
}
_SETS: ParameterSets = {
    "geometry": ("drives", "joint_places", "joint_axes"),
    "centres": ("drives", "joint_places"),
    "axes": ("joint_axes",),
    "all": ("drives", "joint_places", "joint_axes"),
}
ROTATIONS, SLIDES = "rotations", "slides"
"""Groups of the drives that a file puts in no group: angles and lengths."""


class RobotDefinition:
    """A nominal robot, from its robot file and path; raises DescriptionError where their content is wrong."""

    inner_joints: frozenset[str] = frozenset()
    """Joints whose distances from the previous one are machined in one part; they have a separate tolerance."""
    expected_thermometers: tuple[str, ...] = ()
    """Those of :attr:`thermometers` that a campaign is expected to have: nobody has one on every link."""
    causes: Causes | None = None
    """Possible causes of error, if the robot declares its own; None: those of any robot."""

    def __init__(self, file: RobotFile, path: Path) -> None:
        self.file, self.path = file, path
        loops = self._loops()
        # What URDF can express goes into the URDF, so that these joints can be displaced and exported like others.
        not_in_urdf = {name: kind for name, kind in loops.joint_types.items() if kind in NOT_IN_URDF}
        self._kinds = {name: kind for name, kind in loops.joint_types.items() if name not in not_in_urdf}
        self.loops = loops.model_copy(update={"joint_types": not_in_urdf})
        root = parsed(self.urdf(), self.source)
        check_sound(root, self.source)
        kinds = {str(joint.get("name")): str(joint.get("type")) for joint in root.iterfind("joint")}
        self._links = tuple(str(link.get("name")) for link in root.iterfind("link"))
        self.drives = tuple(Drive.of(entry, kinds, path) for entry in file.drives)
        for name in (*file.travel, *file.home, *self._displaced):
            if name not in kinds:
                raise DescriptionError(path, f"'{name}' is not a joint of the robot{closest(name, kinds)}")
        # A campaign states the values of joints that carry the base; poses are in the base, so no loop moves them.
        carrying = [joint for joint in file.travel if kinds[joint] != "fixed"]
        base, end = self.loops.base_frame, self.loops.end_frame
        known = (name for name in (base, end, *self.loops.loop_frames) if name is not None)
        above = {name: {*joints} for name, joints in carriers(root, *known).items()}
        self._check_travels(carrying, above)
        locked = tuple(dict.fromkeys((*self.loops.locked_joints, *carrying)))
        self.loops = self.loops.model_copy(update={"locked_joints": locked})
        frames = (*self._links, *kinds)
        for key, link in (("end_frame", end), ("payload_frame", file.payload_frame)):
            if link is not None and link not in frames:
                raise DescriptionError(path, f"{key} '{link}' is not a link of the robot{closest(link, frames)}")
        moving = {*(name for name, kind in kinds.items() if kind != "fixed"), *self.loops.cut_joints}
        held = carriers(root, *filter(None, (self.payload_frame, end))).values()
        first, *others = ([joint for joint in joints if joint in moving] for joints in held)
        if any(other != first for other in others):
            problem = f"payload_frame '{self.payload_frame}' moves relative to end_frame '{end}'"
            raise DescriptionError(path, f"{problem}; name a link that is fixed to it")
        limits = {str(joint.get("name")): limits_of(joint) for joint in root.iterfind("joint")}
        self._check_home(limits)
        self._check_zeros(limits)
        for drive in self.drives:
            if end is not None and drive.joint in above[base] & above[end]:
                problem = f"base_frame '{base}' is carried by the drive '{drive.joint}'"
                raise DescriptionError(
                    path, (f"{problem}, so poses seen from it do not show that drive; name a link above it")
                )

    @classmethod
    def load(cls, path: Path | str) -> RobotDefinition:
        """Read a robot file and the files it names; raises DescriptionError where something in them is wrong."""
        return cls(RobotFile.load(path), Path(path))

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.name}, {len(self.drives)} drives, {len(self.loops.loops)} loops>"

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.file.name

    def _loops(self) -> LoopsFile:
        file = self.file
        shared = RobotFile.model_fields.keys() & LoopsFile.model_fields.keys() - {"loops", "drives"}
        given: dict[str, Any] = {key: value for key in shared if (value := getattr(file, key))}
        given["drives"] = tuple(entry.joint for entry in file.drives)
        if isinstance(file.loops, str):
            return load_loops(self.path.parent / file.loops, given)
        return validate(LoopsFile, {"mechanism": file.name, "loops": file.loops} | given, self.path)

    def _check_travels(self, travels: Iterable[str], above: Mapping[str, Collection[str]]) -> None:
        """Refuse a travel, held at its home, that does not carry all frames; ``above``: the frames' carriers."""
        for travel, (frame, joints) in itertools.product(travels, above.items()):
            if travel not in joints:
                problem = f"travel '{travel}' would be held at its home, but it does not carry '{frame}'"
                mend = f"make it a drive, or leave it out: a travel carries '{self.loops.base_frame}' and all on it"
                raise DescriptionError(self.path, f"{problem}; {mend}")

    def _check_home(self, limits: JointLimits) -> None:
        """Refuse a home that is beyond a joint's limits."""
        for name, value in self.file.home.items():
            lower, upper = limits[name] or (value, value)
            if not in_limits(value, lower, upper, WRITTEN):
                beyond = f"home: '{name}' at {value:g} is beyond its limits {lower:g} to {upper:g} (m, rad)"
                raise DescriptionError(self.path, beyond)

    def _check_zeros(self, limits: JointLimits) -> None:
        """Refuse implausible zeros of drives, which are mostly given in mm or degrees.

        At a command of zero a drive may be beyond its limits, at a switch, but hardly by more than their range. Angles
        are known up to whole turns. A slide without limits stays within the robot's size.
        """
        for drive in (drive for drive in self.drives if drive.zero):
            lower, upper = limits[drive.joint] or (0.0, 0.0)
            whole = 2.0 * math.pi if drive.unit == "rad" else 0.0 if limits[drive.joint] else self.reach_m
            least, most = min(2.0 * lower - upper, -whole), max(2.0 * upper - lower, whole)
            if not least <= drive.zero <= most:
                unit, si = joint_shown_in(drive.unit)
                problem = f"drive '{drive.joint}': zero {drive.zero:g} {drive.unit} is nowhere near its range"
                mend = f"zero is in m or rad: write {drive.zero:g} {unit} as {drive.zero * si:.6g}"
                raise DescriptionError(self.path, f"{problem}; {mend}")

    @property
    def source(self) -> Path:
        """The file that the geometry comes from."""
        return self.path.parent / (self.file.urdf or self.file.xacro or "")

    def urdf(self) -> str:
        """Return the URDF of the drawing, as first read; raises DescriptionError where it is wrong."""
        return self._drawn

    @functools.cached_property
    def _drawn(self) -> str:
        if self.file.urdf is not None:
            drawn = read_urdf(self.source)
        else:
            from pouring_robot.robot.description.xacro_to_urdf import run_xacro

            drawn = run_xacro(self.source, self.file.mappings)
        if self._kinds:
            parsed(drawn, self.source)
            try:
                drawn = change_joints(drawn, self._kinds)
            except UnknownJointError as problem:
                raise DescriptionError(self.path, f"joint_types: {problem}") from problem
        return meshes_from(drawn, self.source.parent)

    @functools.cached_property
    def reach_m(self) -> float:
        """Length of the longest chain from the root to a joint, stretched out, in m; the robot's size.

        Slides in a robot with loops, which hold them near the home, count with their home value only.
        """
        return reach(self.urdf(), self.file.home, () if self.loops.loops else [drive.joint for drive in self.drives])

    @property
    def drawn_fit(self) -> ClosureOptions:
        """Closure tolerances of the drawing, which has no errors: its loops fit to the precision of the drawing."""
        return replace(DEFAULT_OPTIONS, max_gap_m=_DRAWN_FIT * self.reach_m, max_gap_rad=_DRAWN_FIT)

    @property
    def payload_frame(self) -> str:
        """Frame at which a payload hangs; by default the end frame."""
        return self.file.payload_frame or str(self.loops.end_frame)

    @property
    def own_weight(self) -> bool:
        """Whether the weight of all links loads the drives; otherwise a campaign states the weight of its ladle."""
        return self.causes is None or self.causes.own_weight

    @property
    def most_disagreement_m(self) -> float:
        """How far redundant drives may disagree, in m, and still command a pose."""
        return _MEASURED_FIT * self.reach_m

    def files_beside(self) -> dict[str, bytes]:
        """Return the files that make the exported URDF a robot again, by name: robot file and its own tolerances."""
        given = self.file.model_dump(mode="json", exclude_defaults=True, exclude={"xacro", "mappings", "joint_types"})
        loops = self.loops.model_dump(mode="json", exclude_defaults=True, exclude={"mechanism", "drives"})
        extra = {} if self.tolerances_file is None else {"tolerances": read_text(self.tolerances_file).encode()}
        names = {key: f"{key}.yaml" for key in extra}
        content = {**given, "urdf": f"{robot_name(parsed(self.urdf()))}.urdf", **loops, **names}
        return {"robot.yaml": yaml_text(content).encode()} | {names[key]: text for key, text in extra.items()}

    @property
    def tolerances_file(self) -> Path | None:
        """The robot's own tolerances; None: the shipped ones."""
        return None if self.file.tolerances is None else self.path.parent / self.file.tolerances

    @property
    def drive_columns(self) -> tuple[Quantity, ...]:
        """Columns of the commanded drives in a table."""
        words = {("m", "angle"): "the angle of the motor, which this column holds for the slide"}
        return tuple(
            Quantity(drive.column, drive.command, required=True, words=words.get((drive.unit, drive.command), ""))
            for drive in self.drives
        )

    @property
    def condition_columns(self) -> tuple[Quantity, ...]:
        """Columns of the conditions of a pose, besides drives and measurement; all are optional."""
        taken = {*(drive.column for drive in self.drives), *self.travels, *TAKEN}
        parts = (name for name in self.thermometers if name not in taken)
        return (
            Quantity("session", "label"),
            Quantity("time", "time"),
            *(Quantity(drive.approach_column, "sign") for drive in self.drives),
            *(Quantity(drive.force_column, drive.load) for drive in self.drives),
            Quantity("payload", "mass"),
            *(Quantity(name, "length") for name in self.travels),
            *(Quantity(name, "temperature") for name in (AMBIENT, *parts)),
        )

    @property
    def ranged_columns(self) -> tuple[Quantity, ...]:
        """Columns of drives and conditions that have a range in a campaign."""
        columns = (*self.drive_columns, *self.condition_columns)
        return tuple(quantity for quantity in columns if quantity.kind not in ("label", "sign"))

    def drive_values(self, numbers: Mapping[str, FloatArray]) -> FloatArray:
        """Return the values of driven joints, (n, drives), in m and rad, from columns (n,); missing ones are NaN."""
        empty = np.full(next(iter(numbers.values())).size, np.nan)
        return np.stack([drive.value(numbers.get(drive.column, empty)) for drive in self.drives], axis=-1)

    def commanded(self, drives: FloatArray) -> dict[str, FloatArray]:
        """Return the columns of commands, by name, (n,) each, in m and rad, for drive values (n, drives)."""
        return {drive.column: drive.commanded(values) for drive, values in zip(self.drives, drives.T, strict=True)}

    def mechanism(self) -> ClosedChainMechanism:
        """Return the nominal mechanism."""
        return ClosedChainMechanism(self.urdf(), self.loops, self.path, home=self.file.home)

    def drawing(self, mechanism: ClosedChainMechanism | None = None) -> Drawing:
        """Return the object that closes the nominal robot for drive values, on its ``mechanism`` if that is at hand."""
        return Drawing(mechanism, self.file.home, self.drawn_fit) if mechanism else self._drawing

    @functools.cached_property
    def _drawing(self) -> Drawing:
        return self.drawing(self.mechanism())

    def workspace(self, drawing: Drawing, count: int = _WORKSPACE_SAMPLES) -> tuple[FloatArray, BatchStart]:
        """Return up to ``count`` drive values spread over the workspace, (n, drives), in m and rad, and closed poses.

        Redundant drives agree there. Samples that do not close or exceed joint limits are left out.
        """
        drives, agree = agreed(drawing, self._spread(drawing.mechanism, count))
        commands = drawing.commands(drives)
        kept = np.flatnonzero(agree & drawing.in_reach(commands.start))
        return commands.drives[kept], commands.start[kept]

    def _spread(self, mechanism: ClosedChainMechanism, count: int) -> FloatArray:
        """Return commands spread evenly between their limits, (count, k), in m and rad."""
        from scipy.stats import qmc  # slow to import, and used only here

        lower, upper = command_box(self.command_axes(mechanism))
        return np.asarray(lower + (upper - lower) * qmc.Halton(len(lower), scramble=False).random(count + 1)[1:])

    def command_axes(self, mechanism: ClosedChainMechanism) -> tuple[CommandAxis, ...]:
        """Return the numbers of a command of the nominal mechanism: its drives."""
        return self.drive_axes(mechanism)

    def drive_axes(self, mechanism: ClosedChainMechanism) -> tuple[CommandAxis, ...]:
        """Return the drives with their limits.

        A rotary joint without limits gets one full turn; a slide without limits stays at home, as its range is unknown.
        """
        limits, axes = mechanism.joint_limits(), []
        for drive, column, home in zip(self.drives, self.drive_columns, self.home_drives.tolist(), strict=True):
            turn = 0.0 if drive.unit == "m" else math.pi
            lower, upper = limits.get(drive.joint, (home - turn, home + turn))
            axes.append(CommandAxis(column, lower, upper, drive))
        return tuple(axes)

    @property
    def command_columns(self) -> tuple[Quantity, ...]:
        """Columns of a command in a table."""
        return self.drive_columns

    def dh_table(self, nominal: ClosedChainMechanism) -> DHTable | None:
        """Return the DH table of the drawing; None for a robot that has none."""
        return None

    @property
    def parameter_groups(self) -> ParameterGroups:
        """Parameters that one physical cause changes together, by group: meaning on the machine, and name patterns."""
        along, axes, found = self.file.along, self.file.axes, dict(_GROUPS)
        if along is not None:
            patterns = tuple(f"{joint}.t[{letters}]" for joint, letters in along.items())
            found["joint_places"] = (_GROUPS["joint_places"][0], patterns)
        if axes is not None:
            found["joint_axes"] = (_GROUPS["joint_axes"][0], tuple(f"{joint}.r?" for joint in axes))
        return {name: group for name, group in found.items() if group[1]}

    @property
    def _displaced(self) -> tuple[str, ...]:
        """Joints that the file allows to be displaced."""
        return (*(self.file.along or ()), *(self.file.axes or ()))

    def check_displaced(self, joints: Collection[str]) -> None:
        """Raise DescriptionError where the file allows a joint to be displaced that is not in a chain."""
        for joint in self._displaced:
            if joint not in joints:
                raise DescriptionError(self.path, f"'{joint}' is not a joint of the chains{closest(joint, joints)}")

    @property
    def parameter_sets(self) -> ParameterSets:
        """Named sets of groups."""
        known = self.parameter_groups
        return {name: tuple(group for group in groups if group in known) for name, groups in _SETS.items()}

    @property
    def home_drives(self) -> FloatArray:
        """Drive values at the home, (drives,), in m and rad."""
        return np.array([self.file.home.get(drive.joint, 0.0) for drive in self.drives])

    @functools.cached_property
    def groups(self) -> dict[str, tuple[Drive, ...]]:
        """Drives that share a cause, by group: those with the unit of its first drive. Default groups hold the rest."""
        by_joint = {drive.joint: drive for drive in self.drives}
        named = {name: [by_joint[joint] for joint in joints] for name, joints in self.file.groups.items()}
        units = {name: members[0].unit for name, members in named.items()} | {ROTATIONS: "rad", SLIDES: "m"}
        found = {name: [drive for drive in named.get(name, ()) if drive.unit == unit] for name, unit in units.items()}
        rest = [drive for drive in self.drives if drive not in itertools.chain(*found.values())]
        for name in (ROTATIONS, SLIDES):
            found[name] += [drive for drive in rest if drive.unit == units[name]]
        return {name: tuple(members) for name, members in found.items() if members}

    @property
    def thermometers(self) -> tuple[str, ...]:
        """Names that a temperature column may have beside ``ambient``: links and groups."""
        return tuple(dict.fromkeys((*self._links, *self.groups)))

    @property
    def tool_words(self) -> tuple[str, str]:
        """Words in sentences for what is carried, and for the point on it whose error counts."""
        return "the tool", self.loops.working_frame

    @property
    def travels(self) -> tuple[str, ...]:
        """Names of the columns with the position of the base, in m."""
        return self.file.travel
