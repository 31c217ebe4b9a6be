"""How something unknown may act on this robot: where it acts, and by which condition."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pouring_robot.diagnosis.rows import CampaignRows, LinearRows
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.drives import CHANNELS, LEGS
from pouring_robot.effects.facts import in_words
from pouring_robot.effects.joints import axis_parameters, centre_parameters
from pouring_robot.inference.courses import separate, smooth, standardised, wandering
from pouring_robot.inference.discrepancy import Description
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import COMPONENTS
from pouring_robot.robot.pouring.names import CHAIN_JOINTS

_PRIOR_STD = 0.3e-3
"""Usual size of something unknown, in m and rad."""
_AXES = 1e3
_MIXED_WITH_POSE = ("load", "melt temperature", "platform temperature")
_MOVING_JOINTS = ("load", "platform temperature")
WHERE = {
    "drives": CHANNELS,
    "fixed platform": tuple(f"base.{c}" for c in COMPONENTS),
    "seen place": tuple(f"tracker.{c}" for c in COMPONENTS),
}


def descriptions(rows: CampaignRows, linear: LinearRows) -> Iterator[Description]:
    """Yield the descriptions that a campaign's conditions allow."""
    maker = _Maker(rows, linear)
    for by, course in _of_one_condition(rows.conditions):
        for where in WHERE:
            yield maker(where, by, course)
    yield from _constant(maker, rows.conditions)
    yield from _of_pose(maker, rows.conditions)
    yield from _of_own_drive(maker, rows.conditions)
    yield from _of_joints(maker, rows.conditions)
    each = np.eye(len(rows))
    yield maker("drives", "row, by chance", each)
    yield maker("fixed platform", "row, by chance", each)


class _Maker:
    """Puts courses on channels."""

    def __init__(self, rows: CampaignRows, linear: LinearRows) -> None:
        self._rows, self._linear = rows, linear

    def columns(self, channel: str, course: FloatArray, prior_std: float = _PRIOR_STD) -> FloatArray:
        """Return the columns of one channel along courses (n, k)."""
        return np.asarray(prior_std * self._rows.channel(channel, self._linear)[:, None] * course[self._linear.row])

    def __call__(self, where: str, by: str, course: FloatArray) -> Description:
        """Return the description that all channels of a place follow a course, each with its own coefficients."""
        return Description(where, by, np.hstack([self.columns(name, course) for name in WHERE[where]]))


def _of_one_condition(given: Conditions) -> Iterator[tuple[str, FloatArray]]:
    """Yield what may depend on one condition, with its courses."""
    n = len(given)
    if given.time_known:
        yield "time", wandering(given.time_s)
    yield "order", wandering(np.arange(n, dtype=float))
    if given.session.max() > 0:
        yield "session", separate(given.session)
    if given.truss_travel_m is not None:
        yield "truss travel", wandering(given.truss_travel_m)
    for by, values in _numbers(given).items():
        yield by, smooth(standardised(values), 1.0)
    if given.leg_rise_k is not None:
        yield "leg temperatures", smooth(standardised(given.leg_rise_k), 2.0, most=20)
    if given.approach is not None:
        yield "approach side", given.approach
    pose = poses(given)
    yield "way from the pose before", np.diff(pose, axis=0, prepend=pose[:1])


def _numbers(given: Conditions) -> dict[str, FloatArray]:
    """Return the conditions that are one number a row, by name; those that the campaign has."""
    return in_words(given, "weight_n", "melt_rise_k", "ambient_rise_k", "platform_rise_k")


def poses(given: Conditions) -> FloatArray:
    """Return standardised x, y, z and tilt, (n, 4)."""
    return standardised(np.column_stack([given.position_m, given.tilt_rad]))


def _constant(maker: _Maker, given: Conditions) -> Iterator[Description]:
    """Yield what stands off by a constant: drives, joint centres, axes."""
    one = np.ones((len(given), 1))
    yield maker("drives", "a constant", one)
    for channel in CHANNELS:
        yield Description(channel.partition(".")[2], "a constant", maker.columns(channel, one))
    centres = {j: [n for p in found for n in p.changes] for j, found in centre_parameters(one[:, 0]).items()}
    groups = {
        "joint centres": list(centres),
        "upper joint centres": [j for j in centres if j.endswith("_s1")],
        "lower joint centres": [j for j in centres if j.endswith("_seat_mount")],
        **{f"joint centre {joint}": [joint] for joint in centres},
    }
    for where, joints in groups.items():
        yield Description(where, "a constant", np.hstack([maker.columns(n, one) for j in joints for n in centres[j]]))
    axes = axis_parameters(one[:, 0])
    tilts = {
        joint: np.column_stack([sum(maker.columns(n, c[:, None]) for n, c in p.changes.items()) for p in found])
        for joint, found in axes.items()
    }
    # The changes are those of a mrad; brought back to the usual size of something unknown.
    yield Description("joint axes", "a constant", _AXES * np.hstack(list(tilts.values())))
    outer = [columns for joint, columns in tilts.items() if joint.endswith(("_s1", "_s5"))]
    yield Description("axes on the platforms", "a constant", _AXES * np.hstack(outer))
    twists = [maker.columns(f"{joints[3]}.rz", one) for joints in CHAIN_JOINTS]
    yield Description("twist of the legs", "a constant", np.hstack(twists))


def _of_pose(maker: _Maker, given: Conditions) -> Iterator[Description]:
    pose = poses(given)
    wide, fine = smooth(pose, 1.2, most=50), smooth(pose, 0.6, most=80)
    for where in ("seen place", "drives"):
        yield maker(where, "pose", wide)
        yield maker(where, "pose, finely", fine)
    for by, values in _numbers(given).items():
        if by in _MIXED_WITH_POSE:
            factor = standardised(values)[:, None]
            yield maker("seen place", f"pose and {by}", wide * factor)
            yield maker("drives", f"pose and {by}", fine * factor)
    if given.session.max() > 0:
        sessions = separate(given.session)
        regional = smooth(pose, 1.5, most=12)
        yield maker("seen place", "pose and session", np.hstack([regional * s[:, None] for s in sessions.T]))
    cells = np.clip(((pose + 1.8) / 3.6 * np.array([2.0, 2.0, 3.0, 4.0])).astype(np.int64), 0, 3)
    yield maker("drives", "cell of x, z and tilt", separate(cells[:, [0, 2, 3]]))
    yield maker("drives", "cell of x, y and z", separate(cells[:, :3]))


def _of_own_drive(maker: _Maker, given: Conditions) -> Iterator[Description]:
    """Yield what each drive may do by its own value: waves of unknown pitch, sag by length and lean."""
    for length_m in (0.5, 0.05, 0.02, 0.008, 0.003):
        parts = [maker.columns(CHANNELS[k], smooth(given.drives[:, k], length_m, most=70)) for k in LEGS]
        yield Description("legs", f"own length, waves of {1e3 * length_m:g} mm", np.hstack(parts))
    for angle_rad in (1.5, 0.3, 0.1):
        course = smooth(given.drives[:, 3], angle_rad)
        yield Description("tilt drive", f"own angle, waves of {angle_rad:g} rad", maker.columns(CHANNELS[3], course))
    for size in (0.5, 0.25):
        parts = []
        for k in LEGS:
            place = np.column_stack([given.drives[:, k] / 0.3, given.lean_rad[:, k] / 0.4])
            parts.append(maker.columns(CHANNELS[k], smooth(place, size, most=50)))
        yield Description("legs", f"own length and lean ({'coarsely' if size > 0.3 else 'finely'})", np.hstack(parts))


def _of_joints(maker: _Maker, given: Conditions) -> Iterator[Description]:
    """Yield joints that stand elsewhere by time, load or temperature."""
    n = len(given)
    centres = [name for found in centre_parameters(np.ones(n)).values() for p in found for name in p.changes]
    courses: list[tuple[str, FloatArray]] = []
    if given.time_known:
        courses.append(("time", wandering(given.time_s, most=12)))
    courses += [(by, standardised(values)[:, None]) for by, values in _numbers(given).items() if by in _MOVING_JOINTS]
    for by, course in courses:
        yield Description("joint centres", by, np.hstack([maker.columns(name, course) for name in centres]))
