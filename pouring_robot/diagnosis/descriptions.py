"""How something unknown may act on a robot: where it acts, and by which condition."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pouring_robot.diagnosis.rows import CampaignRows, LinearRows
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.drives import channel
from pouring_robot.effects.facts import in_words, numbers
from pouring_robot.effects.joints import axis_parameters, place_parameters
from pouring_robot.inference.courses import separate, smooth, standardised, wandering
from pouring_robot.inference.discrepancy import Description
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import COMPONENTS
from pouring_robot.robot.description.definition import Drive

_PRIOR_STD = 0.3e-3
"""Usual size of something unknown, in m and rad."""
_AXES = 1e3
DRIVES, SEEN = "drives", "seen place"
BY_CHANCE = "row, by chance"
_MOST_BY_CHANCE = 1300
"""Columns for rows that may each be off by chance. Of too many rows some, evenly spread: they show it, too."""


def descriptions(rows: CampaignRows, linear: LinearRows, *, by_chance: bool = True) -> Iterator[Description]:
    """Yield the descriptions that a campaign's conditions allow, and that its measurements can show at all.

    Args:
        rows: the campaign.
        linear: residuals and derivatives at the present state.
        by_chance: whether what differs from row to row by chance counts as something unknown. Where the noise is not
            stated it is noise, of the robot if not of the device.
    """
    return (found for found in _descriptions(rows, linear, by_chance) if found.columns.any())


def _descriptions(rows: CampaignRows, linear: LinearRows, by_chance: bool) -> Iterator[Description]:
    maker = _Maker(rows, linear)
    given, base = rows.conditions, rows.conditions.causes.words.base
    for by, course in _of_one_condition(given):
        for where in maker.where:
            yield maker(where, by, course)
    yield from _constant(maker, given)
    yield from _of_pose(maker, given)
    yield from _of_own_drive(maker, given)
    yield from _of_joints(maker, given)
    for where in (DRIVES, base) if by_chance else ():
        count = min(len(rows), _MOST_BY_CHANCE // len(maker.where[where]))
        chosen = np.linspace(0, len(rows) - 1, count).astype(np.intp)
        yield maker(where, BY_CHANCE, np.eye(len(rows))[:, chosen])


class _Maker:
    """Puts courses on channels."""

    def __init__(self, rows: CampaignRows, linear: LinearRows) -> None:
        self._rows, self._linear = rows, linear
        given = rows.conditions
        self.where = {
            DRIVES: tuple(channel(drive) for drive in given.robot.drives),
            given.causes.words.base: tuple(f"base.{c}" for c in COMPONENTS),
            SEEN: tuple(f"tracker.{c}" for c in COMPONENTS),
        }

    def columns(self, channel: str, course: FloatArray, prior_std: float = _PRIOR_STD) -> FloatArray:
        """Return the columns of one channel along courses (n, k)."""
        return np.asarray(prior_std * self._rows.channel(channel, self._linear)[:, None] * course[self._linear.row])

    def __call__(self, where: str, by: str, course: FloatArray) -> Description:
        """Return the description that all channels of a place follow a course, each with its own coefficients."""
        return Description(where, by, np.hstack([self.columns(name, course) for name in self.where[where]]))


def _of_one_condition(given: Conditions) -> Iterator[tuple[str, FloatArray]]:
    """Yield what may depend on one condition, with its courses."""
    n = len(given)
    if given.time_known:
        yield "time", wandering(given.time_s)
    yield "order", wandering(np.arange(n, dtype=float))
    if given.session.max() > 0:
        yield "session", separate(given.session)
    for by, values in in_words(given, (f"{name}_m" for name in given.travels)).items():
        yield by, wandering(values)
    for by, values in in_words(given, numbers(given)).items():
        yield by, smooth(standardised(values), 1.0)
    for kind in given.causes.thermometers:
        rises = given.value(f"{kind.name}_rise_k")
        if len(kind.members) > 1 and rises is not None:
            yield kind.word, smooth(standardised(rises), 2.0, most=20)
    if given.approach is not None:
        yield "approach side", given.approach
    pose = poses(given)
    yield "way from the pose before", np.diff(pose, axis=0, prepend=pose[:1])


def poses(given: Conditions) -> FloatArray:
    """Return standardised x, y, z and what of the end body's turn varies, (n, 3 to 6)."""
    return standardised(np.hstack([given.position_m, given.turn_rad]))


def _constant(maker: _Maker, given: Conditions) -> Iterator[Description]:
    """Yield what stands off by a constant: drives, places of joints, axes."""
    one = np.ones((len(given), 1))
    yield maker(DRIVES, "a constant", one)
    for drive in given.robot.drives:
        yield Description(drive.joint, "a constant", maker.columns(channel(drive), one))
    placements = given.causes.placements
    centres = {j: [n for p in found for n in p.changes] for j, found in place_parameters(placements, one[:, 0]).items()}
    several = placements.centres if len(placements.centres) > 1 else {}
    groups = {
        "joint centres": list(centres),
        **{placements.centre_words[name]: list(joints) for name, joints in several.items()},
        **{f"joint centre {joint}": [joint] for joint in centres},
    }
    for where, joints in groups.items():
        yield Description(where, "a constant", np.hstack([maker.columns(n, one) for j in joints for n in centres[j]]))
    tilts = {
        joint: np.column_stack([sum(maker.columns(n, c[:, None]) for n, c in p.changes.items()) for p in found])
        for joint, found in axis_parameters(placements, one[:, 0]).items()
    }
    # The changes are those of a mrad; brought back to the usual size of something unknown.
    if tilts:
        yield Description("joint axes", "a constant", _AXES * np.hstack(list(tilts.values())))
    for where, axes in placements.axis_groups.items():
        outer = [columns for joint, columns in tilts.items() if joint in axes]
        yield Description(where, "a constant", _AXES * np.hstack(outer))
    if placements.twists:
        twists = [maker.columns(f"{joint}.rz", one) for joint in placements.twists.values()]
        yield Description(placements.twist_words, "a constant", np.hstack(twists))


def _of_pose(maker: _Maker, given: Conditions) -> Iterator[Description]:
    pose = poses(given)
    wide, fine = smooth(pose, 1.2, most=50), smooth(pose, 0.6, most=80)
    for where in (SEEN, DRIVES):
        yield maker(where, "pose", wide)
        yield maker(where, "pose, finely", fine)
    for by, values in in_words(given, numbers(given, by_pose=True)).items():
        factor = standardised(values)[:, None]
        yield maker(SEEN, f"pose and {by}", wide * factor)
        yield maker(DRIVES, f"pose and {by}", fine * factor)
    if given.session.max() > 0:
        sessions = separate(given.session)
        regional = smooth(pose, 1.5, most=12)
        yield maker(SEEN, "pose and session", np.hstack([regional * s[:, None] for s in sessions.T]))
    counts = np.array([2.0, 2.0, 3.0, *(4.0,) * (pose.shape[1] - 3)])
    cells = np.clip(((pose + 1.8) / 3.6 * counts).astype(np.int64), 0, 3)
    if given.turn_rad.shape[1] == 1:
        yield maker(DRIVES, "cell of x, z and tilt", separate(cells[:, [0, 2, 3]]))
    yield maker(DRIVES, "cell of x, y and z", separate(cells[:, :3]))


def _of_own_drive(maker: _Maker, given: Conditions) -> Iterator[Description]:
    """Yield what each drive may do by its own value: waves of unknown pitch, sag by length and lean."""
    for group, drives in given.robot.groups.items():
        name = given.causes.words.groups.get(group, group)
        if drives[0].unit == "m":
            yield from _of_slides(maker, given, name, drives)
        else:
            yield from _of_turns(maker, given, name, drives)


def _of_slides(maker: _Maker, given: Conditions, name: str, drives: tuple[Drive, ...]) -> Iterator[Description]:
    places = list(zip(drives, given.places(drives), strict=True))
    for length_m in (0.5, 0.05, 0.02, 0.008, 0.003):
        parts = [maker.columns(channel(d), smooth(given.drives[:, k], length_m, most=70)) for d, k in places]
        yield Description(name, f"own length, waves of {1e3 * length_m:g} mm", np.hstack(parts))
    if given.swing_rad is None:
        return
    swinging = [(d, k) for d, k in places if np.isfinite(given.swing_rad[:, k]).all()]
    for size in (0.5, 0.25) if swinging else ():
        parts = []
        for d, k in swinging:
            place = np.column_stack([given.drives[:, k] / 0.3, given.swing_rad[:, k] / 0.4])
            parts.append(maker.columns(channel(d), smooth(place, size, most=50)))
        yield Description(name, f"own length and lean ({'coarsely' if size > 0.3 else 'finely'})", np.hstack(parts))


def _of_turns(maker: _Maker, given: Conditions, name: str, drives: tuple[Drive, ...]) -> Iterator[Description]:
    places = list(zip(drives, given.places(drives), strict=True))
    joints = {drive.joint for drive in drives}
    periodic = (e for e in given.causes.entries if e.family == "periodic" and e.options.get("all_main"))
    same = frozenset(entry.id for entry in periodic if joints <= {*entry.options["drives"]})
    for angle_rad in (1.5, 0.3, 0.1):
        parts = [maker.columns(channel(d), smooth(given.drives[:, k], angle_rad)) for d, k in places]
        yield Description(name, f"own angle, waves of {angle_rad:g} rad", np.hstack(parts), same)


def _of_joints(maker: _Maker, given: Conditions) -> Iterator[Description]:
    """Yield joints that stand elsewhere by time, load or temperature."""
    found = place_parameters(given.causes.placements, np.ones(len(given)))
    centres = [name for parameters in found.values() for p in parameters for name in p.changes]
    courses: list[tuple[str, FloatArray]] = []
    if given.time_known:
        courses.append(("time", wandering(given.time_s, most=12)))
    moving = in_words(given, numbers(given, moves_joints=True))
    courses += [(by, standardised(values)[:, None]) for by, values in moving.items()]
    for by, course in courses:
        yield Description("joint centres", by, np.hstack([maker.columns(name, course) for name in centres]))
