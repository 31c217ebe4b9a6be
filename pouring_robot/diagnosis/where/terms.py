"""Terms that disagreement is tested for: which condition, along which channel, by which course over the rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse
import scipy.special
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from pouring_robot.diagnosis.descriptions import poses
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.facts import in_words, known_facts, numbers
from pouring_robot.estimation.instruments import are, component_name
from pouring_robot.inference.courses import separate, standardised
from pouring_robot.inference.nuisance import Nuisance
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import GRAVITY_M_S2
from pouring_robot.robot.description.definition import Drive

POSE = "pose"
_SOME, _MANY = 40, 80
"""Rows from which a condition may act quadratically, and as a spline; with fewer only in lines."""
_KNOTS, _TIME_KNOTS = (0.5,), (0.2, 0.4, 0.6, 0.8)
"""Inner knots of splines, as quantiles: more for time, in which things step."""


@dataclass(frozen=True, eq=False)
class FreeResiduals:
    """Residuals of a model of which only two frames were fitted.

    Attributes:
        residual: measured minus predicted over the noise, shape (m,).
        row: row of each equation, (m,).
        component: component of each equation in the tracker's axes, (m,).
        sigma: noise of each equation, (m,), in m or rad.
        nuisance: what the frames can explain.
        axes: axes of the base in the tracker's frame, (3, 3).
        drives: whitened derivative of the prediction by the drives, (m, D), per m and rad; None if not at hand.
        noise_known: False where ``sigma`` was guessed or taken from these very residuals.
        noise_freedoms: degrees of freedom of an estimated noise (from repeats); infinite where it was stated.
    """

    residual: FloatArray
    row: NDArray[np.intp]
    component: NDArray[np.intp]
    sigma: FloatArray
    nuisance: Nuisance
    axes: FloatArray
    drives: FloatArray | None = None
    noise_known: bool = True
    noise_freedoms: float = float("inf")

    @cached_property
    def cleared(self) -> FloatArray:
        """The residual without what the frames explain, (m,)."""
        return self.nuisance.cleared(self.residual)

    def excess(self, squares: float, freedoms: float) -> float:
        """Return the probability that noise alone makes so large a sum of squares, of so many degrees of freedom."""
        if np.isinf(self.noise_freedoms):
            return float(scipy.special.chdtrc(freedoms, squares))
        return float(scipy.special.fdtrc(freedoms, self.noise_freedoms, squares / freedoms))

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """Which equations are of rotations, (m,)."""
        return are("rotation", self.component)

    @property
    def shown(self) -> tuple[int, ...]:
        """Components measured; of a place or a rotation all three, as they are turned into the axes of the base."""

        def together(k: int) -> int:
            return k // 3 if k < 6 else k

        seen = set(np.unique(self.component).tolist())
        groups = {together(k) for k in seen}
        return tuple(k for k in range(max(seen) + 3) if together(k) in groups)


@dataclass(frozen=True, eq=False)
class Channel:
    """A direction in which every row may be off: a component in the base's axes, or a drive.

    Attributes:
        name: ``y``, ``rx``, a drive's symbol …
        words: the same in sentences.
        of_drive: whether it is a drive.
        turning: whether it counts in rad.
        column: what one m or rad of it adds to the whitened prediction, (m,).
        by_row: the same as a sparse matrix (n, m) that sums each row.
        rows: number of rows that show it.
    """

    name: str
    words: str
    of_drive: bool
    turning: bool
    column: FloatArray
    by_row: scipy.sparse.csr_array
    rows: int

    @cached_property
    def weight(self) -> float:
        """Sum of squares of the column."""
        return float(self.column @ self.column)


@dataclass(frozen=True, eq=False)
class Term:
    """One way in which one condition may act.

    Attributes:
        condition: its name in words; several terms share it.
        channel: what it moves.
        course: shape (n, k): the channel is off by a combination of these.
        values: what the condition is in the user's unit, (n,), where that is one number; else None.
        unit: of ``values``.
        by_pose: whether what it does is a matter of pose.
    """

    condition: str
    channel: Channel
    course: FloatArray
    values: FloatArray | None = None
    unit: str = ""
    by_pose: bool = False

    @property
    def kind(self) -> tuple[str, bool, bool]:
        """What terms that belong together share: the condition, drive or end body, and whether by pose."""
        return self.condition, self.channel.of_drive, self.by_pose


def _channels(data: FreeResiduals, given: Conditions) -> tuple[list[Channel], list[Channel]]:
    """Return the measured components in the base's axes, and the drives where their columns are known."""

    def channel(name: str, turning: bool, column: FloatArray, words: str = "") -> Channel:
        places = (data.row, np.arange(column.size))
        by_row = scipy.sparse.csr_array((column, places), shape=(len(given), column.size))
        shown = np.unique(data.row[column != 0.0]).size
        return Channel(name, words or name, bool(words), turning, column, by_row, shown)

    end = []
    for k in data.shown:
        same_kind = data.component // 3 == k // 3
        column = (
            np.where(same_kind, data.axes[data.component % 3, k % 3], 0.0) if k < 6 else 1.0 * (data.component == k)
        )
        end.append(channel(component_name(k), 3 <= k < 6, column / data.sigma))
    columns = () if data.drives is None else data.drives.T
    drives = zip(given.robot.drives, columns, strict=False)
    return end, [channel(d.symbol, d.unit == "rad", column, d.words) for d, column in drives]


def terms(data: FreeResiduals, given: Conditions) -> list[Term]:
    """Return what can be tested under these conditions; constant and absent conditions have no term.

    Conditions act on the components of the end body's pose. Sides, turns of a screw, forces and temperatures of single
    drives act on the drive too, in proportion to the change of the condition alone: what they do on average is a matter
    of pose.
    """
    end, drives = _channels(data, given)
    by_pose = in_words(given, numbers(given, moves_joints=True))
    n = len(given)
    found: list[Term] = []
    for name, values, unit in _numbers(given):
        course = _spline(values, n, _TIME_KNOTS if name in ("time", "order of measurement") else _KNOTS)
        if course is None:
            continue
        found += [Term(name, channel, course, values, unit) for channel in end]
        if name in by_pose and n >= _SOME:
            mixed = course[:, :1] * poses(given)
            found += [Term(name, channel, mixed, values, unit, by_pose=True) for channel in end]
    if given.session.max() > 0:
        found += [Term("session", channel, _centred(separate(given.session))) for channel in end]
    if n >= _SOME:
        found += [Term(POSE, channel, _pose(given), by_pose=True) for channel in end]
    if drives:
        found += _of_drives(given, drives)
    elif given.approach is not None:
        for drive, values in zip(given.robot.drives, given.approach.T, strict=True):
            if np.ptp(values) > 0.0:
                found += [
                    Term(f"side of {drive.symbol}", channel, _centred(values[:, None]), values) for channel in end
                ]
    return found


def untested(given: Conditions) -> tuple[str, ...]:
    """Return the conditions that the campaign does not have or did not vary."""
    facts = known_facts(given.robot)
    wanted = [name for name, fact in facts.items() if fact.word]
    varied = {
        word
        for word, values in in_words(given, wanted).items()
        if _varies(values.reshape(len(given), -1)[:, 0]) and (word != "time" or given.time_known)
    }
    return tuple(
        facts[name].word
        for name in wanted
        if facts[name].word not in varied and (facts[name].expected or given.value(name) is not None)
    )


def _varies(values: FloatArray) -> bool:
    return bool(np.ptp(values) > 1e-9 * (1.0 + np.abs(values).max()))


def _numbers(given: Conditions) -> Iterator[tuple[str, FloatArray, str]]:
    """Yield conditions that are one number a row, in the user's unit."""
    hours = (given.time_s - given.time_s.min()) / 3600.0
    yield ("time", hours, "h") if given.time_known else ("order of measurement", given.time_s, "")
    for name, values in in_words(given, ("weight_n",)).items():
        yield name, values / GRAVITY_M_S2, "kg"
    for name, values in in_words(given, (f"{travel}_m" for travel in given.travels)).items():
        yield name, values, "m"
    kinds = sorted(given.causes.thermometers, key=lambda kind: len(kind.members) > 1)
    for member, word in (item for kind in kinds for item in kind.members.items()):
        if member in given.rises:
            yield word, given.rises[member], "K above reference"


def _of_drives(given: Conditions, channels: Sequence[Channel]) -> Iterator[Term]:
    """Yield what may act through one drive alone."""
    n = len(given)
    for k, (drive, channel) in enumerate(zip(given.robot.drives, channels, strict=True)):
        if given.approach is not None and np.ptp(given.approach[:, k]) > 0.0:
            values = given.approach[:, k]
            yield Term(f"side of {channel.name}", channel, _centred(values[:, None]), values)
        own = _spline(given.drives[:, k], n)
        if own is not None and n >= _SOME:
            yield Term(f"{'angle' if channel.turning else 'length'} of {channel.name}", channel, own, by_pose=True)
        if drive.unit == "m":
            yield from _of_slide(given, k, drive, channel)
    if given.weight_n is None or given.force_by_weight is None or not _varies(given.weight_n):
        return
    more = given.weight_n - given.weight_n.mean()
    for channel, by_weight in zip(channels, given.force_by_weight.T, strict=True):
        yield Term("load", channel, (by_weight * more)[:, None], given.weight_n / GRAVITY_M_S2, "kg", by_pose=True)


def _of_slide(given: Conditions, k: int, drive: Drive, channel: Channel) -> Iterator[Term]:
    """Yield what a sliding drive alone may do: turns of its screw, its own temperature."""
    if given.screw_pitch_m is not None and len(given) >= _SOME:
        turn = 2.0 * np.pi * given.drives[:, k] / given.screw_pitch_m
        waves = [np.cos(turn), np.sin(turn), np.cos(2.0 * turn), np.sin(2.0 * turn)]
        yield Term(f"turn of {channel.name}", channel, _centred(np.column_stack(waves)))
    thermometer = given.causes.drive_thermometers.get(drive.joint, "")
    rise = given.rises.get(thermometer)
    if rise is not None and _varies(rise):
        word = next(kind.members[thermometer] for kind in given.causes.thermometers if thermometer in kind.members)
        course = ((rise - rise.mean()) * given.drives[:, k])[:, None]
        yield Term(word, channel, course, rise, "K above reference")


def _centred(course: FloatArray) -> FloatArray:
    return np.asarray(course - course.mean(axis=0))


def _spline(values: FloatArray, n: int, inner: tuple[float, ...] = _KNOTS) -> FloatArray | None:
    """Return a line first, then what bends: cubic splines, with few rows or values a parabola."""
    if not _varies(values):
        return None
    line = standardised(values)
    distinct = np.unique(np.round(line, 6)).size
    if distinct == 2 or n < _SOME:
        return np.asarray(line[:, None])
    if n < _MANY or distinct < 8:
        return _centred(np.column_stack([line, line**2]))
    places = np.quantile(values, [0.0, *inner, 1.0])
    if (np.diff(places) <= 0.0).any():
        return _centred(np.column_stack([line, line**2]))
    knots = np.concatenate([[places[0]] * 3, places, [places[-1]] * 3])
    return _centred(np.column_stack([line, BSpline.design_matrix(values, knots, 3).toarray()[:, 1:-1]]))


def _pose(given: Conditions) -> FloatArray:
    """Return all products of two of x, y, z and turns, with lines and a constant; a tilt alone to its third power."""
    pose = poses(given)
    columns = [np.ones((len(given), 1)), pose]
    if len(given) >= _MANY:
        first, second = np.triu_indices(pose.shape[1])
        columns += [pose[:, first] * pose[:, second], pose[:, 3:] ** 3]
    return np.hstack(columns)
