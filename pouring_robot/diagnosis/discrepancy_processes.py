"""Gaussian processes of the discrepancy: each place of a robot that something unknown may move, by each condition.

What moves is the measured body, the base, the drives, joints, or the target; conditions are the pose, time and order,
sessions, the load, temperatures, travels, the side of approach, and a drive's own value. The data decide which of them
matters, and how fast anything varies with it.
"""

import functools
import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pouring_robot.diagnosis.rows import CampaignRows, LinearRows
from pouring_robot.effects.base import EffectParameter
from pouring_robot.effects.condition_facts import in_words, numbers
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.families.joints import axis_parameters, place_parameters
from pouring_robot.estimation.kinds import component_name
from pouring_robot.inference.gaussian_processes.kernels import (
    cycling,
    row_by_row,
    separate,
    smooth,
    standardised,
    wandering,
)
from pouring_robot.inference.gaussian_processes.processes import (
    CHANCE,
    CONSTANT,
    Channel,
    Part,
    Process,
    sums_of,
)
from pouring_robot.io.units import MRAD
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.mechanism.local_parameters import COMPONENTS
from pouring_robot.robot.description.drive import Drive

_USUAL = 0.3e-3
"""Usual size of something unknown, in m and rad; evidence is averaged from a hundredth to ten times this size."""
_VARIED = 0.1  # usual share by which the size of an effect varies; evidence is averaged over the same range about it
DRIVES, SEEN, TARGET = "drives", "readings", "target"
CYCLES = "time, in cycles"
SIDE, SESSION = "side of approach", "session"
OTHERS = "other drives"
_MOST_BY_CHANCE = 600
PoseLengths = dict[str, tuple[float, int]]
"""Length scales over the standardised pose, in words, each with the largest number of its columns."""
# Length scales, in a table in docs/inference.md, "One discrepancy". Where there are several they are equally probable.
_POSE_LENGTHS: PoseLengths = {"widely": (1.2, 50), "finely": (0.6, 80)}
_COMPONENT_LENGTHS: PoseLengths = {"": (1.2, 40)}
_REGION_LENGTH, _REGION_MOST = 1.5, 12
_NUMBER_LENGTH, _KIND_LENGTH = 1.0, 2.0  # of standardised values: one number; all thermometers of a kind
_OTHERS_MOST = 8
_SLIDE_LENGTHS_M = (0.5, 0.05, 0.02, 0.008, 0.003)
_TURN_LENGTHS_RAD = (1.5, 0.3, 0.1)
_LEAN_LENGTHS = {"coarsely": 0.5, "finely": 0.25}
_DURATIONS = {"d": 86400.0, "h": 3600.0, "min": 60.0, "s": 1.0}
_LEAN_UNIT_M, _LEAN_UNIT_RAD = 0.3, 0.4

Lengths = dict[str, FloatArray]  # courses (n, k) by the length scale in words
Inside = Callable[[str], Channel]  # gives the channel of a single local parameter by its name


@dataclass(frozen=True, eq=False)
class Places:
    """What can move in a campaign's rows."""

    given: Conditions  # the conditions of the rows
    drives: tuple[Channel, ...]  # one channel for each drive
    seen: tuple[Channel, ...]  # the components of the measured body, in the axes of the base

    @classmethod
    def of(
        cls,
        given: Conditions,
        row: Indices,
        component: Indices,
        sigma: FloatArray,
        axes: FloatArray,
        drives: Sequence[Channel],
    ) -> Self:
        """Return the places from m equations, each with its row, component and noise, (m,) each, in m or rad.

        ``axes`` are those of the base in the tracker's frame, (3, 3), ``drives`` the channels of a m or rad of each.
        """
        sums, body = sums_of(row, len(given)), []
        for k in shown(component):
            own = np.where(component // 3 == k // 3, axes[component % 3, k % 3], 0.0) if k < 6 else component == k
            body.append(Channel(component_name(k), own / sigma, sums, 3 <= k < 6))
        named = zip(given.robot.drives, drives, strict=True)
        return cls(given, tuple(replace(c, name=d.symbol, turning=d.unit == "rad") for d, c in named), tuple(body))


def shown(component: Indices) -> tuple[int, ...]:
    """Return the measured components; all three of a position or a rotation, as they are rotated into other axes."""
    measured = set(np.unique(component).tolist())
    groups = {k // 3 if k < 6 else k for k in measured}
    return tuple(k for k in range(max(measured) + 3) if (k // 3 if k < 6 else k) in groups)


def processes_of(rows: CampaignRows, linear: LinearRows, axes: FloatArray, *, chance: bool = True) -> Iterator[Process]:
    """Yield the processes that a campaign's conditions allow, and that its measurements can show at all.

    ``axes`` are those of the base in the tracker's frame, (3, 3); ``chance`` is whether independent errors in every row
    count as something unknown. Where the noise is not stated they are noise, of the robot if not of the device.
    """
    given = rows.conditions
    sums, unit = sums_of(linear.row, len(given)), np.ones(len(given))
    drives = rows.moving_drives(linear, sums)
    places = Places.of(given, linear.row, linear.component, linear.sigma, axes, drives)
    inside = functools.cache(lambda name: Channel(name, rows.channel(name, linear), sums))
    # What differs from row to row moves both ends of a reading, each as in its own row.
    moving = functools.cache(lambda name: rows.moving(name, {name: unit}, linear, sums))
    base = [moving(f"base.{component}") for component in COMPONENTS]
    alone, by_pose = list(_of_one_condition(given)), list(_of_pose(given, _POSE_LENGTHS))
    for process in (
        *(_moved(SEEN, by, places.seen, lengths) for by, lengths in (*alone, *by_pose, *_of_cycles(given))),
        *(_moved(DRIVES, by, places.drives, lengths) for by, lengths in (*alone, *by_pose)),
        *(_moved(given.causes.words.base, by, base, lengths) for by, lengths in alone),
        *(  # mounted anew, or slipped
            _moved(TARGET, by, [moving(f"tool.{component}") for component in COMPONENTS], lengths)
            for by, lengths in alone
            if by == SESSION
        ),
        *_of_own_value(places),
        *_of_other_drives(places),
        by_chance_at(DRIVES, places.drives, len(given)),
        by_chance_at(given.causes.words.base, base, len(given)),
        *_constant(inside, places),
        *_joints(moving, given),
    ):
        if process.seen and (chance or process.by != CHANCE):
            yield process


def disagreements_of(places: Places) -> Iterator[Process]:
    """Yield how each component of the measured body may be off, in the axes of the base, and what one drive can do.

    Each is a process of its own, so that what one component shows is not diluted by the others. A drive depends on its
    own value at length scales that are short against its stroke: slower changes depend on the pose.
    """
    given, found = places.given, []
    pose = _of_pose(given, _COMPONENT_LENGTHS)
    for by, lengths in (*_of_one_condition(given), *pose, *_of_cycles(given)):
        found.append((by, {words: _without_mean(course) for words, course in lengths.items()}))
    for one in places.seen:
        yield from (_moved(one.name, by, [one], lengths) for by, lengths in found)
        yield by_chance_at(one.name, [one], len(given))
    for k, (drive, one) in enumerate(zip(given.robot.drives, places.drives, strict=True)):
        yield _moved(drive.words, CONSTANT, [one], {"": _USUAL * np.ones((len(given), 1))})
        if given.approach is not None:
            side = _USUAL * given.approach[:, k : k + 1]
            yield _moved(drive.words, SIDE, [one], {"": _without_mean(side)})
        varying = _varying(drive.words, [(one, given.drives[:, k])], drive.unit == "m", short=True)
        lengths = {words: _without_mean(parts[0].course) for words, parts in varying.lengths.items()}
        yield _moved(drive.words, varying.by, [one], lengths)
    if _may_be_coupled(given):
        values, drives = _USUAL * standardised(given.drives), given.robot.drives
        for (drive, one), (k, other) in itertools.product(zip(drives, places.drives, strict=True), enumerate(drives)):
            if drive != other:
                yield _moved(drive.words, f"value of {other.words}", [one], {"": values[:, k : k + 1]})


def _without_mean(course: FloatArray) -> FloatArray:
    """Return a course without its mean, (n, k), as a constant has a process of its own."""
    return np.asarray(course - course.mean(axis=0))


def varied(effect: Channel, given: Conditions) -> Iterator[Process]:
    """Yield how the size of an effect's part of the whitened prediction may vary with each condition."""
    for by, lengths in (*_of_one_condition(given), *_of_pose(given, _POSE_LENGTHS)):
        sizes = {words: Part(effect, course).rms for words, course in lengths.items()}
        varying = {words: _VARIED / size * lengths[words] for words, size in sizes.items() if size > 0.0}
        if varying:
            yield _moved(effect.name, by, [effect], varying)


def by_chance_at(where: str, channels: Sequence[Channel], count: int) -> Process:
    """Return the process that a place has an independent error in every row."""
    course = _USUAL * row_by_row(count, _MOST_BY_CHANCE // len(channels))
    return Process(where, CHANCE, {"": tuple(Part(channel, course) for channel in channels)})


def _moved(where: str, by: str, channels: Iterable[Channel], lengths: Lengths) -> Process:
    """Return the process that all channels follow a condition, each independently."""
    return Process(where, by, {words: tuple(Part(c, course) for c in channels) for words, course in lengths.items()})


def _of_one_condition(given: Conditions) -> Iterator[tuple[str, Lengths]]:
    """Yield each condition with courses of the usual size."""
    for by, course in _courses(given):
        yield by, {"": _USUAL * course}


def _of_cycles(given: Conditions) -> Iterator[tuple[str, Lengths]]:
    """Yield waves in time, by their periods."""
    waves = cycling(given.time_s) if given.time_known else {}
    if waves:
        yield CYCLES, {_between(*periods): _USUAL * wave for periods, wave in waves.items()}


def _between(least_s: float, most_s: float) -> str:
    unit, size = next((unit, size) for unit, size in _DURATIONS.items() if least_s >= 2.0 * size or unit == "s")
    return f"{least_s / size:.3g} to {most_s / size:.3g} {unit}"


def _courses(given: Conditions) -> Iterator[tuple[str, FloatArray]]:
    if given.time_known:
        yield "time", wandering(given.time_s)
    yield "order", wandering(np.arange(len(given), dtype=float))
    if given.session.max() > 0:
        yield SESSION, separate(given.session)
    for by, values in _changing(given, (f"{name}_m" for name in given.travels)).items():
        yield by, wandering(values)
    for by, values in _changing(given, numbers(given)).items():
        yield by, smooth(standardised(values), _NUMBER_LENGTH)
    for kind in given.causes.thermometers:
        rises = given.value(f"{kind.name}_rise_k")
        if len(kind.members) > 1 and rises is not None and np.ptp(rises, axis=0).any():
            yield kind.word, smooth(standardised(rises), _KIND_LENGTH, most=20)
    if given.approach is not None:
        yield SIDE, given.approach
    pose = poses(given)
    yield "way from the pose before", np.diff(pose, axis=0, prepend=pose[:1])


def _changing(given: Conditions, names: Iterable[str]) -> dict[str, FloatArray]:
    """Return conditions (n,) by their names in sentences, without constant ones: nothing can depend on these."""
    return {by: values for by, values in in_words(given, names).items() if np.ptp(values) > 0.0}


def poses(given: Conditions) -> FloatArray:
    """Return standardised x, y, z and varying rotation components of the end body, (n, 3 to 6)."""
    return standardised(np.hstack([given.position_m, given.turn_rad]))


def _of_pose(given: Conditions, scales: PoseLengths) -> Iterator[tuple[str, Lengths]]:
    """Yield courses of the pose, and of the pose times a condition, whose effect may differ by pose."""
    pose = poses(given)
    lengths = {words: _USUAL * smooth(pose, length, most=most) for words, (length, most) in scales.items()}
    yield "pose", lengths
    for by, values in _changing(given, numbers(given, by_pose=True)).items():
        factor = standardised(values)[:, None]
        yield f"pose and {by}", {words: course[:, :50] * factor for words, course in lengths.items()}
    if given.session.max() > 0:
        regional = _USUAL * smooth(pose, _REGION_LENGTH, most=_REGION_MOST)
        yield "pose and session", {"": np.hstack([regional * s[:, None] for s in separate(given.session).T])}


def _of_own_value(places: Places) -> Iterator[Process]:
    """Yield how each drive may depend on its own value: smoothly on any scale; sag by length and lean."""
    given, of_drive = places.given, dict(zip(places.given.robot.drives, places.drives, strict=True))
    for group, drives in given.robot.groups.items():
        name, slides = given.causes.words.groups.get(group, group), drives[0].unit == "m"
        values = [(of_drive[d], given.drives[:, k]) for d, k in zip(drives, given.places(drives), strict=True)]
        yield replace(_varying(name, values, slides), same_as=_as_general(given, drives))
        if slides:
            yield from _by_lean(given, name, drives, of_drive)


def _may_be_coupled(given: Conditions) -> bool:
    """Return whether drives may be coupled: shafts, belts and rods lead past joints of open chains.

    Drives of closed loops set the pose together, so that a process of the pose covers this.
    """
    return bool(np.count_nonzero(np.ptp(given.drives, axis=0)) > 1) and not given.robot.loops.loops


def _of_other_drives(places: Places) -> Iterator[Process]:
    """Yield the process that each drive follows all others, in proportion or by any smooth function of each."""
    if not _may_be_coupled(places.given):
        return
    values = standardised(places.given.drives).T
    ways = {
        "in proportion": [value[:, None] for value in values],
        "smoothly": [smooth(value, _NUMBER_LENGTH, most=_OTHERS_MOST) for value in values],
    }
    lengths = {
        words: tuple(
            Part(channel, _USUAL * np.hstack([course for j, course in enumerate(courses) if j != k]))
            for k, channel in enumerate(places.drives)
        )
        for words, courses in ways.items()
    }
    turning = [drive.joint for drive in places.given.robot.drives if drive.unit == "rad"]
    yield Process(DRIVES, OTHERS, lengths, same_as=_of_families(places.given, {"coupling"}, turning))


def _varying(where: str, values: Sequence[tuple[Channel, FloatArray]], slides: bool, *, short: bool = False) -> Process:
    """Return the process that each channel is a smooth function of its own values (n,), on any (or short) scale."""
    lengths, unit = (_SLIDE_LENGTHS_M, "mm") if slides else (_TURN_LENGTHS_RAD, "mrad")
    scales = {
        f"{1e3 * s:g} {unit}": tuple(Part(c, _USUAL * smooth(v, s, most=70)) for c, v in values)
        for s in lengths[1 if short else 0 :]
    }
    return Process(where, "own length" if slides else "own angle", scales)


def _by_lean(
    given: Conditions, name: str, drives: Sequence[Drive], of_drive: Mapping[Drive, Channel]
) -> Iterator[Process]:
    """Yield how swinging slides may depend on their length and lean."""
    if given.swing_rad is None:
        return
    swinging = [
        (of_drive[d], np.column_stack([given.drives[:, k] / _LEAN_UNIT_M, given.swing_rad[:, k] / _LEAN_UNIT_RAD]))
        for d, k in zip(drives, given.places(drives), strict=True)
        if np.isfinite(given.swing_rad[:, k]).all()
    ]
    if swinging:
        lengths = {
            words: tuple(Part(c, _USUAL * smooth(v, size, most=50)) for c, v in swinging)
            for words, size in _LEAN_LENGTHS.items()
        }
        yield Process(name, "own length and lean", lengths)


def _as_general(given: Conditions, drives: Sequence[Drive]) -> frozenset[str]:
    """Return the effects that can be any function of the drives' own values."""
    general = (e.id for e in given.causes.entries if e.options.get("all_main"))
    return _of_families(given, {"periodic"}, [drive.joint for drive in drives]) & frozenset(general)


def _tilt(inside: Inside, parameter: EffectParameter) -> Channel:
    """Return the channel of a tilt of an axis by a rad."""
    parts = [change[0] / MRAD * inside(name).column for name, change in parameter.changes.items()]
    return Channel(parameter.name, np.asarray(sum(parts)), inside(next(iter(parameter.changes))).rows, turning=True)


def _constant(inside: Inside, places: Places) -> Iterator[Process]:
    """Yield constant errors: of drives, joint positions, axes."""
    given, placements = places.given, places.given.causes.placements

    def still(where: str, channels: Iterable[Channel], said_by: frozenset[str]) -> Process:
        return replace(_moved(where, CONSTANT, channels, {"": _USUAL * np.ones((len(given), 1))}), same_as=said_by)

    joints = [drive.joint for drive in given.robot.drives]
    yield still(DRIVES, places.drives, _of_families(given, {"zero"}, joints))
    for joint, own in zip(joints, places.drives, strict=True):
        yield still(joint, [own], _of_families(given, {"zero"}, [joint]))
    displaced, tilted = _of_families(given, {"centres", "placement"}), _of_families(given, {"tilts", "placement"})
    centres = {j: [n for p in found for n in p.changes] for j, found in place_parameters(given).items()}
    several = placements.centres if len(placements.centres) > 1 else {}
    groups = {
        "joint centres": list(centres),
        **{placements.centre_words[name]: list(joints) for name, joints in several.items()},
        **{f"joint centre {joint}": [joint] for joint in centres},
    }
    for where, group in groups.items():
        yield still(where, [inside(name) for j in group for name in centres[j]], displaced)
    tilts = {joint: [_tilt(inside, p) for p in found] for joint, found in axis_parameters(given).items()}
    if tilts:
        yield still("joint axes", [c for found in tilts.values() for c in found], tilted)
    for where, axes in placements.axis_groups.items():
        yield still(where, [c for joint, found in tilts.items() if joint in axes for c in found], tilted)
    if placements.twists:
        yield still(placements.twist_words, [inside(f"{j}.rz") for j in placements.twists.values()], tilted)


def _of_families(given: Conditions, families: Collection[str], drives: Collection[str] = ()) -> frozenset[str]:
    """Return the effects of some families that act on drives, given by their joints; by default on anything."""
    entries = (e for e in given.causes.entries if e.family in families)
    return frozenset(entry.id for entry in entries if {*drives} <= {*entry.options.get("drives", ())})


def _joints(inside: Inside, given: Conditions) -> Iterator[Process]:
    """Yield how joint centres may move with time, load or temperature."""
    found = place_parameters(given)
    centres = [inside(name) for parameters in found.values() for p in parameters for name in p.changes]
    if given.time_known:
        yield _moved("joint centres", "time", centres, {"": _USUAL * wandering(given.time_s, most=12)})
    for by, values in _changing(given, numbers(given, moves_joints=True)).items():
        yield _moved("joint centres", by, centres, {"": _USUAL * standardised(values)[:, None]})
