"""Usual mistakes in a campaign's positions and drives, each with its correction: units, frames, axes, columns."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.checks.flags import DataFlag, FlagCode, flagged
from pouring_robot.estimation.frames.fit import FrameFit, fit_frames
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES, affine_map
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, evenly_spaced, rms
from pouring_robot.mechanism.rotations import rotation_matrices
from pouring_robot.robot.description.drawing import Drawing
from pouring_robot.robot.description.drive import Drive

Change = Callable[[FloatArray], FloatArray]
LENGTH_MISTAKES = (
    (1e-3, "millimetres under a heading in metres"),
    (1e3, "metres under a heading in millimetres"),
    (25.4, "inches under a heading in millimetres"),
    (0.0254, "inches under a heading in metres"),
)
ANGLE_MISTAKES = (
    (math.pi / 180.0, "degrees under a heading in radians"),
    (180.0 / math.pi, "radians under a heading in degrees"),
)
_HEADED = {"metres": "m", "millimetres": "mm", "radians": "rad", "degrees": "deg"}
DRIVE_MISTAKES = {"length": LENGTH_MISTAKES, "angle": ANGLE_MISTAKES}
LEFT_HANDED = "the axes of the measured positions are left-handed"
HOPELESS_M, GAIN = 0.02, 0.2
"""No robot's errors explain misfits above the first; a mistake, undone, leaves at most the second, a share of them."""
_ALIKE, _OF_A_UNIT = 0.98, 0.2
"""Least correlation at which the drawing determines the unit of distances, and how near its factor must be to one."""
_TELLING_SPREAD = 1e-2  # below it the affine map is poorly determined
_NEARLY = 5.0  # stretch of a nearly rigid map; the nearest of the mistaken units differ by more
_UNITS_APART = 1e-3  # ratio of spreads, smaller than two units of length explain: the target alone moved
_REACHED = 0.8  # share of the rows that must have a pose with corrected drives
_GLANCE = 20  # rows; if that share of all has a pose, fewer than half of these do once in 2,000 times (binomial)
_QUARTER_TURNS = (90, -90, 180, -180)  # degrees between usual zeros of a turning joint; limits distinguish half turns
_KEYS = {"length": "ratio", "angle": "mm_per_turn"}  # of a slide, by what commands it
_PARALLEL = 1.0 - 1e-6  # cosine between axes that are parallel in the drawing, up to its rounding
_MOST_ORDERED = 3  # up to so many drives of a kind all orders are tried; of more, exchanges of any two


@dataclass(frozen=True, eq=False)
class Comparison:
    """Commands and measurements, with the mistakes found so far undone."""

    drives: FloatArray  # (n, drives), in m and rad
    poses: PoseStack  # nominal poses for them; NaN where there are none
    position_m: FloatArray  # measured, (n, 3)
    rotation_vector_rad: FloatArray | None  # measured, (n, 3); None: none was
    inverted: bool = False  # whether the measured poses are inverse: the tracker seen from the end body

    def __getitem__(self, rows: Indices) -> Self:
        vectors = None if self.rotation_vector_rad is None else self.rotation_vector_rad[rows]
        return type(self)(self.drives[rows], self.poses[rows], self.position_m[rows], vectors, self.inverted)

    @property
    def spread_m(self) -> float:
        """Median distance of the measured positions from their median, in m."""
        return _spread(self.position_m) or math.inf

    @property
    def size_m(self) -> float:
        """Scale of misfits of positions, in m: the smaller of the measured and the commanded spread.

        Positions a thousand times smaller have a misfit a thousand times smaller; that alone is no improvement.
        """
        return min(self.spread_m, max(_spread(self.poses.position_m), _UNITS_APART * self.spread_m))

    @property
    def turned_rad(self) -> float:
        """Median angle between commanded rotations and their mean, in rad; of a large angle its chord."""
        rotation = self.poses.rotation[self.poses.complete]
        return float(np.median(np.linalg.norm(rotation - rotation.mean(axis=0), axis=(1, 2)))) / math.sqrt(2.0)

    @functools.cached_property
    def affine(self) -> FloatArray:
        """The linear map from commanded to measured positions, (3, 3), rigid for sound data.

        Each coordinate is fitted to the rows in which it was measured; NaN where these determine it poorly.
        """
        found = np.full((3, 3), np.nan)
        for k, measured in enumerate(np.isfinite(self.position_m).T):
            rows = self.poses.complete & measured
            affine, spread = affine_map(self.poses, self.position_m[:, k : k + 1], rows) if rows.any() else (None, 0.0)
            if spread > _TELLING_SPREAD:
                found[k] = affine
        return found

    @property
    def stretch(self) -> float:
        """How far the map is from rigid along measured columns: root mean square of the logarithm of its stretches."""
        return rms(np.log(np.linalg.norm(self.affine, axis=1)))

    @property
    def stretched(self) -> bool:
        """Whether a column of positions has a unit other than the drives': the map is far from rigid along it."""
        return bool(_stretches(self.affine, 1.0).any())

    def fit(self, metres_per_rad: float, *, rotations: bool = True, rough: bool = False) -> FrameFit:
        """Fit the two frames; see :func:`fit_frames`."""
        vectors = self.rotation_vector_rad if rotations else None
        rotation = None if vectors is None else rotation_matrices(vectors)
        return fit_frames(self.poses, self.position_m, rotation, metres_per_rad, rough=rough)

    def turned(self, change: Change) -> Self:
        """Return the same with measured rotation vectors changed, if there are any."""
        vectors = self.rotation_vector_rad
        return self if vectors is None else dataclasses.replace(self, rotation_vector_rad=change(vectors))

    def inverse(self) -> Self:
        """Return the same with the measured poses taken as inverse: the tracker seen from the target."""
        return dataclasses.replace(self, poses=self.poses.inverse(), inverted=True)

    def turned_by(self, other: Self) -> float:
        """Return how far rotation vectors are from another's, but for a common change, in rad, at most half a turn."""
        if self.rotation_vector_rad is None or other.rotation_vector_rad is None:
            return 0.0
        return min(_spread(self.rotation_vector_rad - other.rotation_vector_rad), math.pi)

    def with_drives(self, drawing: Drawing, change: Change) -> Self | None:
        """Return the same with drives changed; None where too few of them have a pose."""
        drives = change(self.drives)
        some = evenly_spaced(len(drives), _GLANCE)
        if len(some) < len(drives) and nominal_poses(drawing, drives[some]).complete.mean() < 0.5:
            return None
        poses = nominal_poses(drawing, drives)
        if poses.complete.sum() < max(FEWEST_FOR_FRAMES, _REACHED * len(drives)):
            return None
        return dataclasses.replace(self, drives=drives, poses=poses.inverse() if self.inverted else poses)


def _stretches(affine: FloatArray, factor: float) -> BoolArray:
    """Return which columns of positions, times a factor, are stretched or shrunk beyond any error of a robot, (3,)."""
    size = factor * np.linalg.norm(affine, axis=1)
    return np.asarray((size < 1.0 / _NEARLY) | (size > _NEARLY))


def _spread(vectors: FloatArray) -> float:
    """Return the median distance of vectors (n, 3) from their median, in their unit."""
    median = np.nanmedian if np.isnan(vectors).any() else np.median  # ten times as fast for a few hundred rows
    return float(median(np.linalg.norm(vectors - median(vectors, axis=0), axis=1)))


@dataclass(frozen=True, eq=False)
class Mistake:
    """A usual mistake: its message, the quantities concerned, and what undoes it (None: it cannot be undone)."""

    code: FlagCode
    message: str
    names: Sequence[str]
    undo: Callable[[Comparison], Comparison | None]
    equals: tuple[str, ...] = ()  # messages of others that fit as well

    def of_its_headings(self, campaign: Campaign) -> bool:
        """Return whether the headings have the unit that the message of a wrong unit ends with."""
        unit = _HEADED[self.message.rpartition(" ")[2]]
        return all(campaign.heading(name).rpartition("_")[2] == unit for name in self.names)

    @property
    def in_words(self) -> str:
        """The message, with those of mistakes that are equally possible."""
        return "; equally possible: ".join([self.message, *self.equals])


def _turned(code: FlagCode, message: str, change: Change, names: Sequence[str] = columns.ROTATION) -> Mistake:
    """Return a mistake of rotation vectors; the change converts rows (n, 3) as read into vectors in rad."""
    return Mistake(code, message, names, lambda data: data.turned(change))


def _turn_mistakes() -> Iterator[Mistake]:
    words = "the measured rotation vectors seem to"
    signs = (np.array(signs) for signs in itertools.product((1.0, -1.0), repeat=3))
    for sign in itertools.islice(signs, 1, None):
        reversed_ = [name for name, s in zip(columns.ROTATION, sign, strict=True) if s < 0.0]
        code = FlagCode.MIRRORED_AXES
        message = f"of the measured rotation vectors {' and '.join(reversed_)} seem to have the wrong sign"
        if len(reversed_) == 3:
            code, message = FlagCode.ROTATION_INVERTED, f"{words} turn the other way (tracker seen from target)"
        yield _turned(code, message, functools.partial(np.multiply, sign), reversed_)
    for factor, wrong in ANGLE_MISTAKES:
        yield _turned(FlagCode.ROTATION_UNIT, f"{words} hold {wrong}", functools.partial(np.multiply, factor))
    about = {
        "xyz": "roll, pitch and yaw about fixed x, y and z",
        "XYZ": "about moving x, y and z",
        "ZYX": "about moving z, y and x, as A, B and C of KUKA",
        "ZYZ": "about moving z, y and z, as O, A and T of Kawasaki",
    }
    for sequence, meaning in about.items():
        for factor, unit, option in ((1.0, "", ""), (math.pi / 180.0, " in degrees", ", degrees=True")):
            message = f"{words} be Euler angles{unit}: {meaning}"
            message += f" (SciPy: Rotation.from_euler('{sequence}', angles{option}).as_rotvec())"
            yield _turned(FlagCode.EULER_ANGLES, message, functools.partial(_from_euler, sequence, factor))


def _from_euler(sequence: str, factor: float, angles: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    vectors = np.full(angles.shape, np.nan)
    known = np.isfinite(angles).all(axis=1)
    vectors[known] = Rotation.from_euler(sequence, angles[known] * factor).as_rotvec()
    return vectors


TURN_MISTAKES = tuple(_turn_mistakes())


def mistaken_distances(campaign: Campaign, poses: PoseStack) -> Iterator[DataFlag]:
    """Find distances that have another unit or zero, by the nominal poses.

    For a target at t on a body at p, R and a point c, d² = |p|² + 2 p·Rt - 2 c·(p + Rt) + |t|² + |c|². So whatever t
    and c are, the part of |p|² that the other terms cannot explain is in d² once, in the square of its unit. Where they
    explain all of it, as for a body that turns about the end of one crank, nothing can be said. A device with another
    zero, such as a draw wire, reads r = d - s, and d² = r² + 2 s r + s²: the unexplained part of |p|² is that of r²
    plus 2 s times that of r. From the place in another row it is |p|² + 2 p·Rt + t·RᵀRt of the differences p and R.
    """
    if campaign.distance_m is None:
        return
    distance, start = campaign.distance_m[:, 0], campaign.distance_start
    usable = poses.complete & (distance > 0.0)
    fixed, between = (np.flatnonzero(usable & one) for one in (start == -1, (start >= 0) & poses.complete[start]))
    place, turned = poses.position_m[fixed], poses.rotation[fixed]
    others = [np.ones((fixed.size, 1)), place, np.einsum("nij,ni->nj", turned, place), turned.reshape(-1, 9)]
    yield from _mistaken(campaign, distance[fixed], place, np.hstack(others))
    place, turned = (all_[between] - all_[start[between]] for all_ in (poses.position_m, poses.rotation))
    others = [np.einsum("nij,ni->nj", turned, place), np.einsum("nij,nik->njk", turned, turned).reshape(-1, 9)]
    yield from _mistaken(campaign, distance[between], place, np.hstack(others))


def _mistaken(campaign: Campaign, read: FloatArray, place: FloatArray, others: FloatArray) -> Iterator[DataFlag]:
    """Find it in distances (n,): their squares are those of places (n, 3) plus a combination of others (n, k)."""
    axes, sizes, _ = np.linalg.svd(others, full_matrices=False)
    axes = axes[:, sizes > 1e-9 * sizes.max(initial=0.0)]
    if read.size < 2 * axes.shape[1] or not read.size:
        return
    terms = np.column_stack([np.square(place).sum(axis=1), np.square(read), read])
    drawn, measured, once = (terms - axes @ (axes.T @ terms)).T
    heading, quantities = campaign.heading(columns.DISTANCE), [columns.DISTANCE]
    if wrong := _other_unit(drawn, measured):
        message = f"column '{heading}' seems to hold {wrong}"
        yield flagged(campaign, FlagCode.DISTANCE_UNIT, message, quantities=quantities)
        return
    short = float(once @ (drawn - measured)) / (2.0 * max(float(once @ once), np.finfo(float).tiny))
    # Misfit of a distance: half that of its square, over it; the unknown places take up most of what is missing.
    before, after = (rms((measured + 2.0 * s * once - drawn) / (2.0 * read)) for s in (0.0, short))
    possible = bool((read + 2.0 * short > 0.0).all())  # no wrong zero doubles a reading
    if possible and abs(short) > HOPELESS_M and after < GAIN * before:
        message = (
            f"all distances in '{heading}' seem to be {short / MM:.3g} mm too short: wherever device and target are, "
        )
        message += f"they differ from the robot by {before / MM:.3g} mm, and with that added by {after / MM:.3g} mm"
        figures = {"short_mm": short / MM, "misfit_before_mm": before / MM, "misfit_after_mm": after / MM}
        yield flagged(campaign, FlagCode.DISTANCE_ZERO, message, quantities=quantities, metrics=figures)


def _other_unit(drawn: FloatArray, measured: FloatArray) -> str:
    """Return in words the mistake of units between drawn and measured squares of distances (n,); "" for none."""
    together, size = float(drawn @ measured), float(drawn @ drawn)
    if not together > _ALIKE * math.sqrt(size * float(measured @ measured)):
        return ""
    factor = math.sqrt(together / size)
    return next((wrong for unit, wrong in LENGTH_MISTAKES if abs(unit * factor - 1.0) < _OF_A_UNIT), "")


def position_mistakes(campaign: Campaign, drawing: Drawing, data: Comparison) -> Iterator[Mistake]:
    """Yield every mistake that could make positions and drives disagree."""
    affine = data.affine
    for factor, wrong in LENGTH_MISTAKES:
        fits = ~_stretches(affine, factor)  # what does not make the map nearly rigid is not tried
        if fits.all():
            message = f"the measured positions seem to hold {wrong}"
            yield Mistake(FlagCode.POSITION_UNIT, message, columns.POSITION, functools.partial(_placed, factor=factor))
        for k in np.flatnonzero(fits).tolist():
            alone = np.where(np.arange(3) == k, factor, 1.0)
            message = f"column '{campaign.heading(columns.POSITION[k])}' seems to hold {wrong}"
            undo = functools.partial(_placed, factor=alone)
            yield Mistake(FlagCode.POSITION_UNIT, message, columns.POSITION[k : k + 1], undo)
    if not data.inverted:
        message = "the measured poses seem to be inverse (tracker seen from target)"
        turned = columns.ROTATION if data.rotation_vector_rad is not None else ()
        yield Mistake(FlagCode.FRAMES_SWAPPED, message, (*columns.POSITION, *turned), Comparison.inverse)
    if np.isfinite(affine).all() and np.linalg.det(affine) < 0.0:
        message = f"{LEFT_HANDED}: one is reversed, or two are exchanged"
        yield Mistake(FlagCode.MIRRORED_AXES, message, columns.POSITION, reversed_x)
    yield from _drive_mistakes(campaign, drawing)


def mirror_mistakes(campaign: Campaign) -> Iterator[Mistake]:
    """Yield every way in which positions become left-handed; measured rotations may show which it is."""
    headings, code = [campaign.heading(name) for name in columns.POSITION], FlagCode.MIRRORED_AXES
    for k, heading in enumerate(headings):
        undo = functools.partial(_placed, factor=np.where(np.arange(3) == k, -1.0, 1.0))
        yield Mistake(code, f"column '{heading}' seems to have the wrong sign", columns.POSITION[k : k + 1], undo)
    for pair in itertools.combinations(range(3), 2):
        order = np.arange(3)
        order[list(pair)] = pair[::-1]
        named = " and ".join(f"'{headings[k]}'" for k in pair)
        undo = functools.partial(_placed, order=order)
        yield Mistake(code, f"columns {named} seem to be exchanged", [columns.POSITION[k] for k in pair], undo)
    message = "one is reversed, or two are exchanged, and so are those of the rotations"
    yield Mistake(code, message, (*columns.POSITION, *columns.ROTATION), _mirrored)


def reversed_x(data: Comparison) -> Comparison:
    """Return the same with x reversed: positions alone fit any mirror image equally well."""
    return _placed(data, np.array([-1.0, 1.0, 1.0]))


def _placed(data: Comparison, factor: float | FloatArray = 1.0, order: Indices | slice = slice(None)) -> Comparison:
    """Return the same with columns of positions in another order, and times a factor."""
    return dataclasses.replace(data, position_m=data.position_m[:, order] * factor)


def _mirrored(data: Comparison) -> Comparison:
    """Return the same with positions and rotations mirrored: x is reversed, and so are turns about y and z."""
    return reversed_x(data).turned(functools.partial(np.multiply, [1.0, -1.0, -1.0]))


def _drive_mistakes(campaign: Campaign, drawing: Drawing) -> Iterator[Mistake]:
    """Yield wrong units of single drives, and of all of a kind; wrong signs and zeros; exchanged columns."""
    drives = campaign.robot.drives
    headings = [f"'{campaign.heading(drive.column)}'" for drive in drives]
    places, same = np.arange(len(drives)), np.eye(len(drives))
    flipped = [np.diag(np.where(places == k, -1.0, 1.0)) for k in places]

    def mistake(code: FlagCode, message: str, change: FloatArray, shift: float | FloatArray = 0.0) -> Mistake:
        """Return a mistake of drives: commands are right once multiplied by a matrix, their values once shifted."""
        moved = np.flatnonzero((change != same).any(axis=0) | (np.asarray(shift) != 0.0))
        names = [drives[k].column for k in moved]

        def corrected(given: FloatArray) -> FloatArray:
            commands = campaign.robot.commanded(given)
            right = np.column_stack([*commands.values()]) @ change
            return campaign.robot.drive_values(dict(zip(commands, right.T, strict=True))) + shift

        return Mistake(code, message, names, lambda data: data.with_drives(drawing, corrected))

    for kind, members in _by(campaign, "command").items():
        some = [[member] for member in members] + ([members] if len(members) > 1 else [])
        for (factor, wrong), concerned in itertools.product(DRIVE_MISTAKES[kind], some):
            several, named = len(concerned) > 1, ", ".join(headings[k] for k in concerned)
            message = f"column{'s' * several} {named} seem{'s' * (not several)} to hold {wrong}"
            yield mistake(FlagCode.DRIVE_UNIT, message, np.diag(np.where(np.isin(places, concerned), factor, 1.0)))
    for drive, change in zip(drives, flipped, strict=True):
        yield mistake(FlagCode.DRIVE_REVERSED, reversed_words(campaign, drive.column), change)
    limits = drawing.mechanism.joint_limits()
    for k, drive in enumerate(drives):
        ends = sum(limits.get(drive.joint, (math.nan,)))
        if drive.unit == "m" and abs(ends) > 0.0:
            sign, key = "negative" if drive.factor > 0.0 else "positive", _KEYS[drive.command]
            message = (
                f"column {headings[k]} seems to be counted from the other end of the slide "
                f"(a {sign} {key}, zero: {ends - drive.zero:.6g})"
            )
            yield mistake(FlagCode.DRIVE_REVERSED, message, flipped[k], (ends - 2.0 * drive.zero) * (places == k))
    # Turning drives may have another zero: those of controllers, and of tables of links, differ by quarter turns.
    turning = [(k, drive) for k, drive in enumerate(drives) if drive.unit == "rad"]
    for (k, drive), turn in itertools.product(turning, _QUARTER_TURNS):
        zero = drive.zero + math.radians(turn)  # whole turns away it may be beyond the joint's limits
        message = (
            f"column {headings[k]} seems to count from another zero, where the joint stands at "
            f"{math.degrees(zero):.6g}° (zero: {zero:.6g})"
        )
        yield mistake(FlagCode.DRIVE_ZERO, message, same, math.radians(turn) * (places == k))
    # Rods, or the controller (Fanuc's third joint), keep the direction of a forearm whatever the upper arm does.
    for before, k, along in _parallel(drives, drawing):
        change = same.copy()
        each = along * drives[before].factor / drives[k].factor  # by which a command of the one before counts
        change[before, k] = -each
        named = f"'{drives[before].column}'" + ("" if abs(each) == 1.0 else f" times {abs(each):g}")
        message = (
            f"column {headings[k]} seems to count from a fixed direction, whatever '{drives[before].column}' does: the "
            f"joint itself turns by '{drives[k].column}' {'minus' if each > 0.0 else 'plus'} {named}"
        )
        yield mistake(FlagCode.DRIVE_ABSOLUTE, message, change)
    for members in _by(campaign, "command").values():
        for order in _orders(members):
            moved = [(k, by) for k, by in zip(members, order, strict=True) if k != by]
            wrong = ", ".join(f"{headings[k]} holds {drives[by].column}" for k, by in moved)
            change = same.copy()
            change[members] = change[list(order)]
            yield mistake(FlagCode.DRIVES_EXCHANGED, f"columns of drives seem to be exchanged: {wrong}", change)


def _parallel(drives: Sequence[Drive], drawing: Drawing) -> Iterator[tuple[int, int, float]]:
    """Yield each turning drive, each it carries about a parallel axis, and +1, or -1 where the axes are opposite."""
    model = drawing.mechanism.shared_model
    turning = {model.getJointId(drive.joint): k for k, drive in enumerate(drives) if drive.unit == "rad"}
    axes = dict(zip(turning, drawing.mechanism.joint_axes([*turning])[:, 3:], strict=True))
    for joint, k in turning.items():
        if (carrier := model.parents[joint]) in turning:
            along = float(axes[carrier] @ model.jointPlacements[joint].rotation @ axes[joint])
            if abs(along) > _PARALLEL:
                yield turning[carrier], k, round(along)


def reversed_words(campaign: Campaign, name: str) -> str:
    """Return the message for a drive of the opposite sign."""
    return f"column '{campaign.heading(name)}' seems to be counted the other way: its sign is reversed"


def _orders(members: list[int]) -> Iterator[tuple[int, ...]]:
    """Yield other orders: all of few members, exchanges of two of many."""
    if len(members) <= _MOST_ORDERED:
        yield from itertools.islice(itertools.permutations(members), 1, None)
        return
    for first, second in itertools.combinations(members, 2):
        yield tuple({first: second, second: first}.get(member, member) for member in members)


def _by(campaign: Campaign, what: str) -> dict[str, list[int]]:
    """Return the drives by their unit or the kind of their command."""
    kinds = [getattr(drive, what) for drive in campaign.robot.drives]
    return {kind: [k for k, own in enumerate(kinds) if own == kind] for kind in dict.fromkeys(kinds)}
