"""What may go wrong with a robot, as plain data: families of causes on parts that it names, and its own words.

A robot may declare this; :mod:`pouring_robot.effects` makes its effects of it, and knows the families. For a robot that
declares nothing a library over its groups is built there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class CauseEntry:
    """One cause: a family of effects on some parts.

    Attributes:
        id: name in files and on the command line.
        family: which family, see :data:`pouring_robot.effects.registry.FAMILIES`.
        story: one line for people.
        options: of the family; ``drives`` are named by their joints.
    """

    id: str
    family: str
    story: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Thermometers:
    """Thermometers of one kind.

    Attributes:
        name: the condition is ``<name>_rise_k``.
        word: in sentences on what data depend on.
        label: of an axis, without unit.
        members: columns (without unit) with the word for each one's temperature.
        record: what to record, in words.
        vary: which measurement makes show what depends on it.
        least_spread_k: with less it was held still, in K.
        by_pose: whether it may act differently in different poses.
        moves_joints: whether it may displace joints.
        expected: whether it is worth saying that a campaign does not have it.
        hot_rise_k: how far above the cold machine it is at least while it is hot, in K; 0 for what stays cold.
        hot_degC: how warm it is then, where nothing that was seen changes that.
    """

    name: str
    word: str
    label: str
    members: Mapping[str, str]
    record: str
    vary: str
    least_spread_k: float = 20.0
    by_pose: bool = False
    moves_joints: bool = False
    expected: bool = True
    hot_rise_k: float = 0.0
    hot_degC: float | None = None  # noqa: N815 - units are spelt as in the campaign files


@dataclass(frozen=True)
class AxisTilt:
    """A tilt of one joint's axis that leaves the next joint where it was.

    Attributes:
        joint: whose axis is tilted.
        directions: axes of its placement across it.
        after: the joint that is turned back; "" where all behind the tilted one turns with it.
        back: sign with which that one is turned: -1 behind it in the chain, +1 where it is placed on the end body,
            against the chain's direction.
    """

    joint: str
    directions: str
    after: str = ""
    back: float = -1.0


@dataclass(frozen=True)
class Placements:
    """Which joints may stand elsewhere than drawn, and which axes may be tilted.

    Attributes:
        centres: joints whose places count, by part of the machine.
        tilts: axes.
        centre_words: what the joints of a part are called where something unknown displaces them.
        axis_groups: joints whose axes something unknown may tilt together, by words.
        twists: joint that turns what comes behind it about its own z axis, by the parameter's name.
        twist_words: what they are called together.
        along: axes along which a joint may be displaced, where not all.
        tolerances: of the robot; None: the shipped ones.
    """

    centres: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    tilts: tuple[AxisTilt, ...] = ()
    centre_words: Mapping[str, str] = field(default_factory=dict)
    axis_groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    twists: Mapping[str, str] = field(default_factory=dict)
    twist_words: str = ""
    along: Mapping[str, str] = field(default_factory=dict)
    tolerances: Path | None = None

    @property
    def places(self) -> tuple[str, ...]:
        """All joints whose places count."""
        return tuple(joint for joints in self.centres.values() for joint in joints)


@dataclass(frozen=True)
class Words:
    """What parts of a robot are called in sentences.

    Attributes:
        base: the body that carries the robot.
        body: the end body.
        moved: what the robot moves.
        tip: where errors count.
        groups: of drives, by group; a group that is not named keeps its name.
        force: labels of the mean force on groups, with unit, by group.
    """

    base: str = "base"
    body: str = "end body"
    moved: str = "tool"
    tip: str = "tool"
    groups: Mapping[str, str] = field(default_factory=dict)
    force: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Causes:
    """Everything of the kind for one robot.

    Attributes:
        entries: causes, in the order they are listed.
        placements: joints and axes.
        thermometers: in the order they are spoken of.
        drive_thermometers: which thermometer tells how warm a drive is, by joint.
        words: of the robot.
        travel_words: of the axes that carry it: what to record and which measurement shows what depends on it, by name.
        own_weight: whether the links' own weight counts among what drives carry.
    """

    entries: tuple[CauseEntry, ...]
    placements: Placements
    thermometers: tuple[Thermometers, ...]
    drive_thermometers: Mapping[str, str] = field(default_factory=dict)
    words: Words = field(default_factory=Words)
    travel_words: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    own_weight: bool = True

    def members(self, name: str) -> tuple[str, ...]:
        """Return the columns of the thermometers of a kind, or a thermometer itself."""
        return next((tuple(t.members) for t in self.thermometers if t.name == name), (name,))


AMBIENT = Thermometers(
    "ambient",
    "hall temperature",
    "hall above reference",
    {"ambient": "hall temperature"},
    "the temperature of the hall (ambient_degC)",
    "measure the same poses in a cold and in a warm hall",
    least_spread_k=5.0,
)
