"""What may go wrong with a robot, as plain data: families of causes on parts that it names, and its own words.

The pouring robot's definition declares this; :mod:`pouring_robot.effects` makes its effects of it, and knows the
families. For a robot of a robot file one over its groups is made there (``default_causes.py``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class CauseEntry:
    """One cause: a family of effects on some parts."""

    id: str  # name in files and on the command line
    family: str  # which family, see :data:`pouring_robot.effects.available.FAMILIES`.
    story: str  # one line for people
    options: Mapping[str, Any] = field(default_factory=dict)  # of the family; ``drives`` are named by their joints


@dataclass(frozen=True)
class Thermometers:
    """Thermometers of one kind."""

    name: str  # the condition is ``<name>_rise_k``
    word: str  # in sentences on what data depend on
    label: str  # of an axis, without unit
    members: Mapping[str, str]  # columns (without unit) with the word for each one's temperature
    record: str  # what to record, in words
    vary: str  # which measurement makes show what depends on it
    least_spread_k: float = 20.0  # with less it was held still, in K
    by_pose: bool = False  # whether it may act differently in different poses
    moves_joints: bool = False  # whether it may displace joints
    expected: bool = True  # whether it is worth saying that a campaign does not have it
    # how far above the cold machine it is at least while it is hot, in K; 0 for what stays cold
    hot_rise_k: float = 0.0
    # how warm it is then, where nothing that was seen changes that
    hot_degC: float | None = None


@dataclass(frozen=True)
class AxisTilt:
    """A tilt of one joint's axis that leaves the next joint where it was."""

    joint: str  # whose axis is tilted
    directions: str  # axes of its placement across it
    after: str = ""  # the joint that is turned back; "" where all behind the tilted one turns with it
    # sign with which that one is turned: -1 behind it in the chain, +1 where it is placed on the end body, against the
    # chain's direction
    back: float = -1.0
    # turning joint before it whose zero turns what follows alike, by the axis of the placement that lies along its axis
    zeros: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Placements:
    """Which joints may stand elsewhere than drawn, and which axes may be tilted."""

    # joints whose places count, by part of the machine
    centres: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    tilts: tuple[AxisTilt, ...] = ()
    # what the joints of a part are called where something unknown displaces them
    centre_words: Mapping[str, str] = field(default_factory=dict)
    # joints whose axes something unknown may tilt together, by words
    axis_groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    # joint that turns what comes behind it about its own z axis, by the parameter's name
    twists: Mapping[str, str] = field(default_factory=dict)
    twist_words: str = ""  # what they are called together
    along: Mapping[str, str] = field(default_factory=dict)  # axes along which a joint may be displaced, where not all

    @property
    def places(self) -> tuple[str, ...]:
        """All joints whose places count."""
        return tuple(joint for joints in self.centres.values() for joint in joints)


@dataclass(frozen=True)
class PartNames:
    """What parts of a robot are called in sentences."""

    base: str = "base"  # the body that carries the robot
    body: str = "end body"  # the end body
    moved: str = "tool"  # what the robot moves
    tip: str = "tool"  # where errors count
    # of drives, by group; a group that is not named keeps its name
    groups: Mapping[str, str] = field(default_factory=dict)
    force: Mapping[str, str] = field(default_factory=dict)  # labels of the mean force on groups, with unit, by group


@dataclass(frozen=True)
class Causes:
    """Everything of the kind for one robot."""

    entries: tuple[CauseEntry, ...]  # causes, in the order they are listed
    placements: Placements  # joints and axes
    thermometers: tuple[Thermometers, ...]  # in the order they are spoken of
    # which thermometer tells how warm a drive is, by joint
    drive_thermometers: Mapping[str, str] = field(default_factory=dict)
    words: PartNames = field(default_factory=PartNames)
    # of the axes that carry it: what to record and which measurement shows what depends on it, by name
    travel_words: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    own_weight: bool = True  # whether the links' own weight counts among what drives carry

    def members(self, name: str) -> tuple[str, ...]:
        """Return the columns of the thermometers of a kind, or a thermometer itself."""
        return next((tuple(t.members) for t in self.thermometers if t.name == name), (name,))

    @property
    def beside_drives(self) -> tuple[str, ...]:
        """Columns of the thermometers that tell how warm drives are, and of the others of their kinds."""
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
