"""Possible causes of error of a robot, as plain data: families of causes, the parts they act on, and names of parts.

The definition of the pouring robot declares them; :mod:`pouring_robot.effects` knows the families and makes effects of
them. For a robot from a robot file it makes causes over the robot's groups (``default_causes.py``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class CauseEntry:
    """One cause: a family of effects on some parts."""

    id: str  # name in files and on the command line
    family: str  # which family, see :data:`pouring_robot.effects.available.FAMILIES`.
    story: str  # one-line description for people
    options: Mapping[str, Any] = field(default_factory=dict)  # of the family; ``drives`` are given by their joints


@dataclass(frozen=True)
class Thermometers:
    """Thermometers of one kind."""

    name: str  # the condition is ``<name>_rise_k``
    word: str  # its name in sentences on what data depend on
    label: str  # of a plot axis, without unit
    members: Mapping[str, str]  # columns (without unit), with the words for the temperature of each
    record: str  # what to record, in words
    vary: str  # which measurement shows what depends on it
    least_spread_k: float = 20.0  # with a smaller spread it counts as constant, in K
    by_pose: bool = False  # whether its effect may depend on the pose
    moves_joints: bool = False  # whether it may displace joints
    expected: bool = True  # whether to report that a campaign does not have it
    # smallest rise above the cold machine while it is hot, in K; 0 for what stays cold
    hot_rise_k: float = 0.0
    # its fixed temperature while it is hot, whatever was measured; None: it has none
    hot_degC: float | None = None


@dataclass(frozen=True)
class AxisTilt:
    """A tilt of one joint's axis that leaves the next joint where it was."""

    joint: str  # the joint whose axis is tilted
    directions: str  # axes of its placement about which it is tilted
    after: str = ""  # the joint that is turned back; "" where everything behind the tilted joint turns with it
    # sign of that rotation: -1 for a joint behind the tilted one in the chain, +1 for one that is placed on the end
    # body, against the chain's direction
    back: float = -1.0
    # rotary joint before it whose zero has the same effect on what follows, by the placement axis along its axis
    zeros: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Placements:
    """Which joints may be displaced from the drawing, and which axes may be tilted."""

    # joints whose positions count, by part of the machine
    centres: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    tilts: tuple[AxisTilt, ...] = ()
    # names of the joints of a part where something unknown displaces them
    centre_words: Mapping[str, str] = field(default_factory=dict)
    # joints whose axes something unknown may tilt together, by name of the group
    axis_groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    # joint that turns what follows it about its own z axis, by the parameter's name
    twists: Mapping[str, str] = field(default_factory=dict)
    twist_words: str = ""  # their collective name
    along: Mapping[str, str] = field(default_factory=dict)  # axes along which a joint may be displaced, if not all

    @property
    def places(self) -> tuple[str, ...]:
        """All joints whose positions count."""
        return tuple(joint for joints in self.centres.values() for joint in joints)


@dataclass(frozen=True)
class PartNames:
    """Names of a robot's parts in sentences."""

    base: str = "base"  # the body that carries the robot
    body: str = "end body"  # the end body
    moved: str = "tool"  # what the robot moves
    tip: str = "tool"  # where errors count
    # of drives, by group; other groups keep their own names
    groups: Mapping[str, str] = field(default_factory=dict)
    force: Mapping[str, str] = field(default_factory=dict)  # labels of the mean force on groups, with unit, by group


@dataclass(frozen=True)
class Causes:
    """All possible causes of one robot, with what belongs to them."""

    entries: tuple[CauseEntry, ...]  # causes, in the order they are listed
    placements: Placements  # joints and axes
    thermometers: tuple[Thermometers, ...]  # in the order they are mentioned
    # thermometer of each drive, by joint
    drive_thermometers: Mapping[str, str] = field(default_factory=dict)
    words: PartNames = field(default_factory=PartNames)
    # of the axes that carry the robot: what to record and which measurement shows what depends on them, by name
    travel_words: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    own_weight: bool = True  # whether the links' own weight is part of what drives carry

    def members(self, name: str) -> tuple[str, ...]:
        """Return the columns of the thermometers of a kind, or a thermometer itself."""
        return next((tuple(t.members) for t in self.thermometers if t.name == name), (name,))

    @property
    def beside_drives(self) -> tuple[str, ...]:
        """Columns of the drives' thermometers, and of the other thermometers of the same kinds."""
        own = {*self.drive_thermometers.values()}
        return tuple(member for t in self.thermometers if own & {*t.members} for member in t.members)


METROLOGY_SCALE = CauseEntry(
    "metrology_scale", "metrology_scale", "the measuring device's millimetre is not a millimetre"
)
AMBIENT = Thermometers(
    "ambient",
    "hall temperature",
    "hall above reference",
    {"ambient": "hall temperature"},
    "the temperature of the hall (ambient_degC)",
    "measure the same poses in a cold and in a warm hall",
    least_spread_k=5.0,
)
