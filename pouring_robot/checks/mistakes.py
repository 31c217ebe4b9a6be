"""The usual mistakes of a campaign's positions and drives, each with what undoes it: units, frames, axes, columns."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.checks.flags import FlagCode, Rows
from pouring_robot.estimation.frame_fit import FrameFit, fit_frames
from pouring_robot.estimation.frame_starts import FEWEST_ROWS, affine_map
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import rotation_matrices
from pouring_robot.robot.description.drawing import Drawing

LENGTH_MISTAKES = ((1e-3, "millimetres under a heading in metres"), (1e3, "metres under a heading in millimetres"))
ANGLE_MISTAKES = (
    (math.pi / 180.0, "degrees under a heading in radians"),
    (180.0 / math.pi, "radians under a heading in degrees"),
)
DRIVE_MISTAKES = {"length": LENGTH_MISTAKES, "angle": ANGLE_MISTAKES}
_TELLING_SPREAD = 1e-2  # below it the affine map says little
_UNITS_APART = 1e-3  # spreads less alike than two units of length: the target alone moved
_REACHED = 0.8  # share of the rows that must have a pose with drives put right
_MOST_ORDERED = 3  # drives of a kind of which all orders are tried; of more, any two are exchanged


@dataclass(frozen=True, eq=False)
class Comparison:
    """Commands and measurements side by side, as far as the mistakes found are undone.

    Attributes:
        drives: (n, drives) in m and rad.
        poses: nominal poses for them; NaN where there are none.
        position_m: (n, 3) measured positions, in m.
        rotation_vector_rad: (n, 3) measured rotation vectors, in rad, or None.
        inverted: whether the measured poses are those of the tracker's side seen from the end body's.
    """

    drives: FloatArray
    poses: PoseStack
    position_m: FloatArray
    rotation_vector_rad: FloatArray | None
    inverted: bool = False

    def __getitem__(self, rows: Rows) -> Comparison:
        """Return some of the rows."""
        vectors = None if self.rotation_vector_rad is None else self.rotation_vector_rad[rows]
        return Comparison(self.drives[rows], self.poses[rows], self.position_m[rows], vectors, self.inverted)

    @property
    def spread_m(self) -> float:
        """Median distance of the measured positions from their middle, in m."""
        return _spread(self.position_m) or math.inf

    @property
    def size_m(self) -> float:
        """What misfits of positions are counted in, in m: the lesser spread, measured or commanded.

        Positions a thousand times smaller miss by a thousand times less; that alone is no better.
        """
        return min(self.spread_m, max(_spread(self.poses.position_m), _UNITS_APART * self.spread_m))

    def fit(self, metres_per_rad: float, *, rotations: bool = True) -> FrameFit:
        """Fit the two frames; see :func:`fit_frames`."""
        vectors = self.rotation_vector_rad if rotations else None
        rotation = None if vectors is None else rotation_matrices(vectors)
        return fit_frames(self.poses, self.position_m, rotation, metres_per_rad)

    def with_drives(self, drawing: Drawing, change: Callable[[FloatArray], FloatArray]) -> Comparison | None:
        """Return the same with drives changed; None where too few of them have a pose."""
        drives = change(self.drives)
        poses = nominal_poses(drawing, drives)
        if poses.complete.sum() < max(FEWEST_ROWS, _REACHED * len(drives)):
            return None
        return dataclasses.replace(self, drives=drives, poses=poses.inverse() if self.inverted else poses)


def _spread(positions_m: FloatArray) -> float:
    return float(np.nanmedian(np.linalg.norm(positions_m - np.nanmedian(positions_m, axis=0), axis=1)))


@dataclass(frozen=True, eq=False)
class Mistake:
    """A usual mistake as it would be told, the quantities it is about, and what undoes it (None: it cannot be)."""

    code: FlagCode
    message: str
    names: Sequence[str]
    undo: Callable[[Comparison], Comparison | None]


def position_mistakes(campaign: Campaign, drawing: Drawing, data: Comparison) -> Iterator[Mistake]:
    """Yield every mistake that could make positions and drives disagree."""
    for factor, wrong in LENGTH_MISTAKES:
        message = f"the measured positions seem to hold {wrong}"
        yield Mistake(FlagCode.POSITION_UNIT, message, columns.POSITION, functools.partial(_scaled, factor=factor))
    if not data.inverted:
        message = "the measured poses seem to be inverse: the tracker seen from the target"
        turned = columns.ROTATION if data.rotation_vector_rad is not None else ()
        yield Mistake(FlagCode.FRAMES_SWAPPED, message, (*columns.POSITION, *turned), _inverted)
    complete = data.poses.complete & np.isfinite(data.position_m).all(axis=1)
    affine, spread = affine_map(data.poses, data.position_m, complete)
    if spread > _TELLING_SPREAD and np.linalg.det(affine) < 0.0:
        message = "the axes of the measured positions are left-handed: one is reversed, or two are exchanged"
        reversed_x = functools.partial(_scaled, factor=np.array([-1.0, 1.0, 1.0]))
        yield Mistake(FlagCode.MIRRORED_AXES, message, columns.POSITION, reversed_x)
    yield from _drive_units(campaign, drawing)
    yield from _drives_reversed(campaign, drawing)
    yield from _drives_exchanged(campaign, drawing)


def _scaled(data: Comparison, factor: float | FloatArray) -> Comparison:
    return dataclasses.replace(data, position_m=data.position_m * factor)


def _inverted(data: Comparison) -> Comparison:
    return dataclasses.replace(data, poses=data.poses.inverse(), inverted=True)


def _drives_changed(campaign: Campaign, drawing: Drawing, code: FlagCode, message: str, change: FloatArray) -> Mistake:
    """Return a mistake of drives; the right values are those given times a matrix."""
    moved = np.flatnonzero((change != np.eye(len(change))).any(axis=0))
    names = [campaign.robot.drives[k].column for k in moved]
    return Mistake(code, message, names, lambda data: data.with_drives(drawing, lambda drives: drives @ change))


def _drive_units(campaign: Campaign, drawing: Drawing) -> Iterator[Mistake]:
    """Yield wrong units of single drives, and of all drives of a kind."""
    for kind, members in _by(campaign, "command").items():
        alone = [[member] for member in members]
        for factor, wrong in DRIVE_MISTAKES[kind]:
            for concerned in (*alone, members) if len(members) > 1 else alone:
                headings = ", ".join(f"'{campaign.heading(campaign.robot.drives[k].column)}'" for k in concerned)
                several = len(concerned) > 1
                message = f"column{'s' * several} {headings} seem{'s' * (not several)} to hold {wrong}"
                scale = np.ones(len(campaign.robot.drives))
                scale[concerned] = factor
                yield _drives_changed(campaign, drawing, FlagCode.DRIVE_UNIT, message, np.diag(scale))


def _drives_reversed(campaign: Campaign, drawing: Drawing) -> Iterator[Mistake]:
    """Yield single drives that are counted the other way."""
    for k, drive in enumerate(campaign.robot.drives):
        signs = np.ones(len(campaign.robot.drives))
        signs[k] = -1.0
        message = f"column '{campaign.heading(drive.column)}' seems to be counted the other way: its sign is reversed"
        yield _drives_changed(campaign, drawing, FlagCode.DRIVE_REVERSED, message, np.diag(signs))


def _drives_exchanged(campaign: Campaign, drawing: Drawing) -> Iterator[Mistake]:
    """Yield exchanged columns of drives that move joints of a kind."""
    drives = campaign.robot.drives
    for members in _by(campaign, "unit").values():
        for order in _orders(members):
            moved = [(k, by) for k, by in zip(members, order, strict=True) if k != by]
            wrong = ", ".join(f"'{campaign.heading(drives[k].column)}' holds {drives[by].column}" for k, by in moved)
            message = f"columns of drives seem to be exchanged: {wrong}"
            change = np.eye(len(drives))
            for k, by in moved:
                change[k, k] = 0.0
                change[k, by] = 1.0
            yield _drives_changed(campaign, drawing, FlagCode.DRIVES_EXCHANGED, message, change)


def _orders(members: list[int]) -> Iterator[tuple[int, ...]]:
    """Yield other orders: all of few members, exchanges of two of many."""
    if len(members) <= _MOST_ORDERED:
        yield from itertools.islice(itertools.permutations(members), 1, None)
        return
    for first, second in itertools.combinations(members, 2):
        yield tuple({first: second, second: first}.get(member, member) for member in members)


def _by(campaign: Campaign, what: str) -> dict[str, list[int]]:
    """Return the drives by their unit or the kind of their command."""
    groups: dict[str, list[int]] = {}
    for index, drive in enumerate(campaign.robot.drives):
        groups.setdefault(getattr(drive, what), []).append(index)
    return groups
