"""Facts about each condition: what to record for it, how to plot over it, how to vary it to distinguish effects.

A new condition needs an entry here, beside its place in :mod:`pouring_robot.effects.conditions`.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.effects.conditions import FORCE, LOAD, RISE, SIDES, Conditions
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.io.units import MM, UNITS
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.robot.description.cause_types import Causes, Thermometers
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drive import Drive

INERTIAS = "inertias of the links in the URDF"
_KILO, _HOUR_S = 1e3, 3600.0
Drawn = Callable[[Conditions], tuple[str, FloatArray | None]]
"""A label and (n,) numbers in its unit; None where the campaign does not have them."""


@dataclass(frozen=True, eq=False)
class Axis:
    """Axis over which effects and residuals are plotted."""

    label: str  # with its unit
    values: FloatArray  # shape (n,)
    of_rows: bool = False  # whether it is only the order of the rows, where nothing else varies


@dataclass(frozen=True)
class ConditionFacts:
    """Facts about one condition."""

    axis: Drawn = lambda _: ("", None)  # label and values for plots over it
    word: str = ""  # its name in sentences on what data depend on; "" where another condition replaces it there
    sources: tuple[str, ...] = ()  # where it comes from: columns of a campaign's table, ``section.key`` of the YAML
    record: str = ""  # the same in words
    vary: str = ""  # which measurement reveals what depends on it
    least_spread: float = 0.0  # range in SI units; with less it was held still. 0 where that does not apply
    varied: str = ""  # condition by whose range that is judged, if not by its own
    by_pose: bool = False  # whether every campaign varies it, as it depends on the pose
    expected: bool = True  # whether to report that a campaign does not have it


@functools.lru_cache(maxsize=16)
def known_facts(robot: RobotDefinition) -> dict[str, ConditionFacts]:
    """Return the facts about a robot's conditions by their names, in the order in which they are mentioned."""
    causes = causes_of(robot)
    words = causes.words
    load = _drawn(f"weight on the {words.body} [kN]", "weight_n", lambda weight: weight / _KILO)
    least_n = _least_load_n(robot, causes)
    found = {"weight_n": replace(_of_weight(causes, load, least_n), word="load")}
    found["joint_moments"] = ConditionFacts(
        _drawn("mean moment on a joint [Nm]", "joint_moments", lambda given: np.abs([*given.values()]).mean(axis=0)),
        sources=(INERTIAS,),
        record=f"the {INERTIAS}",
        vary="measure with the arm stretched out and folded, in all directions",
        by_pose=True,
    )
    for group, drives in robot.groups.items():
        borne = drives[0].load
        label = words.force.get(group, f"mean {borne} on {group} [k{next(iter(UNITS[borne]))}]")
        found[f"{group}{FORCE}"] = _force(causes, f"{group}{FORCE}", label, least_n)
    found |= {f"{travel}_m": _travel(robot, travel, causes.travel_words.get(travel)) for travel in robot.travels}
    found["truss_span_m"] = ConditionFacts(
        sources=("truss.span_m",), record="the length of the rails (truss span in campaign.yaml)"
    )
    found |= {f"{t.name}{RISE}": _rise(t, causes.drive_thermometers.values()) for t in causes.thermometers}
    found["approach"] = replace(_approach("approach", robot.drives), word="side of approach")
    found |= {f"{group}{SIDES}": _approach(f"{group}{SIDES}", drives) for group, drives in robot.groups.items()}
    found["time_s"] = ConditionFacts(
        _time, "time", vary="measure the same poses again hours later", least_spread=_HOUR_S
    )
    found["session"] = ConditionFacts(
        _drawn("session", "session", lambda number: 1.0 + number),
        sources=("session",),
        record="the session of every row (session)",
        vary="set up base and device again and measure the same poses",
    )
    return found | of_drives(robot) | _OF_POSE


def facts_of(name: str, robot: RobotDefinition) -> ConditionFacts:
    """Return the facts about a condition; empty ones if there are none."""
    return known_facts(robot).get(name, ConditionFacts())


def _drawn(label: str, name: str, shown: Callable[[Any], FloatArray] = np.asarray) -> Drawn:
    """Return how a condition is plotted: its values, converted by ``shown`` to the unit of the label."""

    def axis(given: Conditions) -> tuple[str, FloatArray | None]:
        values = given.value(name)
        return label, None if values is None else shown(values)

    return axis


def _time(given: Conditions) -> tuple[str, FloatArray | None]:
    return ("time [h]", given.time_s / _HOUR_S) if given.time_known else ("row", given.time_s)


def _screw(given: Conditions) -> tuple[str, FloatArray | None]:
    pitch, label = given.screw_pitch_m, "turn of screw 1 [°]"
    return label, None if pitch is None else np.mod(360.0 * given.lengths_m[:, 0] / pitch, 360.0)


def _least_load_n(robot: RobotDefinition, causes: Causes) -> float:
    """Return the smallest range of a load that counts as varied, in N.

    Arms carry a tenth of their weight or more: a tenth of that. Where the load is far more than the robot's weight, as
    that of a ladle, half a kilonewton.
    """
    if not causes.own_weight:
        return 500.0
    return max(1.0, 0.01 * GRAVITY_M_S2 * float(pin.computeTotalMass(robot.drawing().mechanism.shared_model)))


def _of_weight(causes: Causes, axis: Drawn, least_n: float) -> ConditionFacts:
    """Return the facts about a condition that depends on the load; a tare counts where the links' weight does not."""
    words, tare = causes.words, () if causes.own_weight else ("ladle.tare_kg", "ladle.centre_of_mass_mm")
    return ConditionFacts(
        axis,
        sources=(LOAD, *tare),
        record=f"the load ({LOAD})" + (f", and state tare and centre of mass of the {words.moved}" if tare else ""),
        vary=f"measure the same poses with the {words.moved} empty and full",
        least_spread=least_n,
        varied="weight_n",
    )


def _force(causes: Causes, name: str, label: str, least_n: float) -> ConditionFacts:
    found = _of_weight(causes, _drawn(label, name, lambda force: np.asarray(force.mean(axis=1)) / _KILO), least_n)
    return replace(found, sources=(INERTIAS,), record=f"the {INERTIAS}") if causes.own_weight else found


def _least_way_m(robot: RobotDefinition, joints: Iterable[str], most: float) -> float:
    """Return the smallest range of sliding joints that counts as varied, in m: half the longest way, up to ``most``."""
    limits = robot.drawing().mechanism.joint_limits()
    ways = (high - low for low, high in (limits.get(joint, (-np.inf, np.inf)) for joint in joints))
    return min(most, 0.5 * max(ways))


def _travel(robot: RobotDefinition, name: str, words: tuple[str, str] | None) -> ConditionFacts:
    record, vary = words or (
        f"the position of the base ({name}_m)",
        "measure at both ends and in the middle of its travel, with and without load",
    )
    word = name.replace("_", " ")
    least = _least_way_m(robot, (name,), 1.0)
    return ConditionFacts(_drawn(f"{word} [m]", f"{name}_m"), word, (f"{name}_m",), record, vary, least)


def _rise(kind: Thermometers, of_drives: Iterable[str]) -> ConditionFacts:
    """Return the facts about a kind of thermometer; of several, the mean of those on drives is plotted."""
    members, driven = list(kind.members), set(of_drives)
    shown = [k for k, member in enumerate(members) if member in driven] or list(range(len(members)))

    def mean(rise: FloatArray) -> FloatArray:
        return np.asarray(rise.reshape(len(rise), -1)[:, shown].mean(axis=1))

    axis = _drawn(f"{kind.label} [K]", f"{kind.name}{RISE}", mean)
    sources = tuple(f"{member}_degC" for member in kind.members)
    return ConditionFacts(axis, kind.word, sources, kind.record, kind.vary, kind.least_spread_k, expected=kind.expected)


def _approach(name: str, drives: Sequence[Drive]) -> ConditionFacts:
    columns = tuple(drive.approach_column for drive in drives)
    return ConditionFacts(
        _drawn("drives that came from below", name, lambda side: 1.0 * (side > 0.0).sum(axis=1)),
        sources=columns,
        record=f"the side each drive was approached from ({' to '.join(dict.fromkeys((columns[0], columns[-1])))})",
        vary="measure the same poses from both sides of every drive",
        least_spread=1.0,
    )


def of_drives(robot: RobotDefinition) -> dict[str, ConditionFacts]:
    """Return the facts about the drives' own values, for the kinds of drives that a robot has."""
    found = {}
    slides, turns = ([drive for drive in robot.drives if drive.unit == unit] for unit in ("m", "rad"))
    if slides:
        first = slides[0]
        found["screw_pitch_m"] = ConditionFacts(
            _screw,
            sources=("drives.screw_pitch_mm",),
            record="the pitch of the screws (screw pitch in campaign.yaml)",
            vary="measure at several places within one turn of the screws",
        )
        group = next((name for name, drives in robot.groups.items() if first in drives), "the drives")
        found["lengths_m"] = ConditionFacts(
            _drawn(f"length of {first.words} [mm]", "lengths_m", lambda lengths: lengths[:, 0] / MM),
            vary=f"measure with {group} as short and as long as possible",
            least_spread=_least_way_m(robot, (drive.joint for drive in slides), 0.1),
            by_pose=True,
        )
    if turns:
        which = turns[0].words if len(turns) == 1 else "every joint"
        found["angles_rad"] = ConditionFacts(
            _drawn(f"{turns[0].symbol} [°]", "angles_rad", lambda angles: np.degrees(angles[:, 0])),
            vary=f"move {which} through its whole range",
            least_spread=0.2,
        )
    return found


_Z = _drawn("z [mm]", "position_m", lambda place: place[:, 2] / MM)
_OF_POSE = {
    "tilt_rad": ConditionFacts(
        _drawn("tilt [°]", "tilt_rad", np.degrees),
        vary="measure at the edges of the workspace, at both ends of the tilt",
        least_spread=0.3,
        by_pose=True,
    ),
    "position_m": ConditionFacts(
        _Z, vary="measure at the edges of the workspace, in many orientations", least_spread=0.1, by_pose=True
    ),
    "height_m": ConditionFacts(_Z, by_pose=True),
}
ALWAYS = ("tilt_rad", "height_m", "time_s")  # what anything can be plotted over


def held_still(name: str, conditions: Conditions) -> bool:
    """Return whether a campaign hardly varied a condition: no column of it has a large enough range."""
    facts = facts_of(name, conditions.robot)
    values = conditions.value(facts.varied or name) if facts.least_spread else None
    return values is not None and bool((np.ptp(values.reshape(len(values), -1), axis=0) < facts.least_spread).all())


def in_words(conditions: Conditions, names: Iterable[str]) -> dict[str, Any]:
    """Return those conditions that a campaign has, by their names in sentences."""
    found = {facts_of(name, conditions.robot).word: conditions.value(name) for name in names}
    return {word: values for word, values in found.items() if values is not None}


def numbers(conditions: Conditions, *, by_pose: bool = False, moves_joints: bool = False) -> tuple[str, ...]:
    """Return the names of the load and of temperatures that are one number per row, whether a campaign has them or not.

    Of these, if asked for, only those that may act differently in different poses, or may displace joints.
    """
    kinds = [t for t in conditions.causes.thermometers if len(t.members) == 1]
    kept = [t for t in kinds if t.by_pose >= by_pose and t.moves_joints >= moves_joints]
    return ("weight_n", *(f"{t.name}{RISE}" for t in kept))


def axis_over(wanted: Iterable[str], conditions: Conditions) -> Axis:
    """Return the axis of the first condition that varies in a campaign; the order of the rows where none does."""
    for name in wanted:
        label, values = facts_of(name, conditions.robot).axis(conditions)
        if values is not None and np.ptp(values) > 0.0:
            return Axis(label, values)
    return Axis("row", np.arange(len(conditions), dtype=float), of_rows=True)


def sources(needs: Iterable[str], robot: RobotDefinition) -> tuple[str, ...]:
    """Return the columns and YAML keys that conditions come from; one without facts keeps its name."""
    return tuple(dict.fromkeys(name for need in needs for name in (facts_of(need, robot).sources or (need,))))
