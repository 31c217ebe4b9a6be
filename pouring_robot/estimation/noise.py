"""The noise of what was measured: how large that of each kind is, and where the figure comes from.

Before a fit it is as stated, or the scatter of rows that repeat a pose (:func:`noise_beforehand`). Where it is neither,
:meth:`NoiseLevel.from_left_over` takes it from what a fit leaves over (:func:`noise_ratio`), again until both agree:
in a calibration ``settled_noise`` of :mod:`pouring_robot.estimation.map_fit`, in a diagnosis
:mod:`pouring_robot.diagnosis.searched` by ``noise_left`` of :mod:`pouring_robot.diagnosis.diagnoser`, of where they
disagree ``diagnosis/where/dependence.py``. A fit, a whole search and a sum of processes cost and hand on other things,
so each says itself when its rounds end. From where on that is too large to pass for noise, :func:`largest_noise` says.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import Literal

import numpy as np
import scipy.special
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.columns import SET
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.instruments import instruments_of
from pouring_robot.estimation.kinds import KINDS, LENGTHS, Kind, are, kinds_of, unit_of
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.given import expect
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray, Indices

Source = Literal["stated", "repeats", "residuals", "none"]
LEAST_NOISE = 1e-6
"""In m or rad: what is left over of exact data is less, and as noise would make of rounding an error of the robot. No
device that robots are measured with reads better."""
FALSE_ALARMS = 1e-3  # share of sound campaigns and robots that chance may accuse
LEAST_FACTOR = 2.0
"""By which a noise that is stated may be off: a data sheet's figure is not better known."""
_FEWEST_DOF = 12
_ROUND_OFF = 1e-9  # degrees of freedom: fewer are what adding up leaves of none, of either sign
_SAME_DRIVE = 1e-6  # m or rad: no drive is told to stand finer
_SAME_LOAD = 0.01
"""Of the largest: a load that is weighed is never twice the same, and what a hundredth of it does is less than noise
unless all of it does a hundred times as much."""


@dataclass(frozen=True)
class Noise:
    """The noise of one kind of instrument."""

    sigma: float = 1e-3  # standard deviation of a component, in m or rad
    source: Source = "none"  # where the figure comes from; ``none``: nothing of the kind was measured
    dof: float = float("inf")  # of a figure from repeats, infinite for any other: see :attr:`NoiseLevel.dof`


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of every kind."""

    kinds: Mapping[Kind, Noise]  # a kind that is left out was not measured
    settled: bool = True  # False where what a fit leaves over was still another when the fits that told it ended

    @classmethod
    def stated(cls, position_m: float, rotation_rad: float | None) -> NoiseLevel:
        """Return the noise of a device, or raise BadInputError; None: it measures positions only."""
        given: dict[Kind, tuple[float, str]] = {"position": (position_m, "m")}
        given |= {} if rotation_rad is None else {"rotation": (rotation_rad, "rad")}
        for kind, (size, unit) in given.items():
            said = f"the noise of a {kind} must be above 0 and at most 1 {unit}"
            expect(size, Real, said)
            if not 0.0 < size <= 1.0:
                raise BadInputError(f"{said}, not {size:g} {unit}")
        return cls({kind: Noise(float(size), "stated") for kind, (size, _) in given.items()})

    def __getitem__(self, kind: Kind) -> Noise:
        return self.kinds.get(kind, Noise())

    @property
    def position_m(self) -> float:
        """Standard deviation of a coordinate, in m."""
        return self["position"].sigma

    @property
    def rotation_rad(self) -> float:
        """Standard deviation of a rotation component, in rad."""
        return self["rotation"].sigma

    def of(self, kind: Kind | None) -> NoiseLevel:
        """Return that of a kind alone; None: of all."""
        return self if kind is None else NoiseLevel({kind: self[kind]}, self.settled)

    def times(self, factors: Mapping[Kind, float]) -> NoiseLevel:
        """Return other sizes, none below :data:`LEAST_NOISE`."""
        changed = {k: replace(self[k], sigma=max(self[k].sigma * f, LEAST_NOISE)) for k, f in factors.items()}
        return NoiseLevel({**self.kinds, **changed})

    def from_left_over(
        self, kinds: Iterable[Kind], components: Indices, residual: FloatArray, freedom: FloatArray, fewest: float = 1.0
    ) -> NoiseLevel:
        """Return it with that of some kinds taken from what a fit with it leaves over, by :func:`noise_ratio`.

        ``components`` is what each of the m equations is of, ``residual`` is over this noise.
        """
        chosen = {kind: are(kind, components) for kind in kinds}
        return self.times(
            {kind: noise_ratio(residual[own], freedom[own], fewest) for kind, own in chosen.items() if own.any()}
        )

    def told_by(self, left: NoiseLevel, dof: Mapping[Kind, float], rate: float) -> NoiseLevel:
        """Return it with what a fit leaves over, of so many degrees of freedom a kind, where nothing better tells it.

        That is where nothing is said, or where few repeats say as much: what is left beyond them (lack of fit, F) is no
        more than chance makes in that rate of campaigns. The repeats, which are among the rows, are then outnumbered.
        """
        found = dict(self.kinds)
        for kind, noise in self.kinds.items():
            sigma = left[kind].sigma
            if noise.source == "residuals":
                found[kind] = replace(noise, sigma=sigma)
            elif noise.source == "repeats" and dof[kind] > noise.dof:
                squares = dof[kind] * (sigma / noise.sigma) ** 2
                if NoiseLevel({kind: noise}).lack_of_fit_p(squares, dof[kind]) > rate:
                    found[kind] = replace(noise, sigma=sigma, dof=dof[kind])
        return NoiseLevel(found)

    def lack_of_fit_p(self, squares: float, dof: float, share: float = 1.0) -> float:
        """Return the probability that noise alone leaves such a sum of squares, over it, of so many degrees of freedom.

        Repeats that tell it are among what is left, and apart from each other by just as much: what is left beyond them
        is asked (lack of fit: Draper & Smith, *Applied Regression Analysis*, 1998, ch. 2). ``share`` is what a robust
        loss leaves on average of the square of each.
        """
        repeated = share * sum(noise.dof for noise in self.kinds.values() if math.isfinite(noise.dof))
        beyond = dof - repeated
        return p_value(max(squares - repeated, 0.0), beyond, self.dof) if beyond >= 1.0 else 1.0

    def apart(self, other: NoiseLevel) -> float:
        """Return by which share of the other's its sizes differ at most."""
        return max((abs(self[kind].sigma / other[kind].sigma - 1.0) for kind in self.measured), default=0.0)

    @property
    def measured(self) -> tuple[Kind, ...]:
        """The kinds that were measured."""
        return tuple(kind for kind in KINDS if self[kind].source != "none")

    @property
    def words(self) -> str:
        """The sizes of what was measured, in words."""
        units = {kind: unit_of(kind) for kind in self.measured}
        return " and ".join(f"{self[kind].sigma / si:.2g} {unit}" for kind, (unit, si) in units.items())

    @property
    def doubts(self) -> list[str]:
        """What makes a noise that nobody states a rough one, in words: that hardly any is left over, or no one size."""
        unstated = [kind for kind in self.measured if self[kind].source != "stated"]
        exact = [kind for kind in self.open_kinds if self[kind].sigma <= LEAST_NOISE]
        why = {
            "its estimate had not settled when the fits ended": [] if self.settled else unstated,
            f"residuals are nearly zero, so {LEAST_NOISE / MM:g} mm or mrad stands for it": exact,
        }
        keys = {words: ", ".join(map(noise_key, kinds)) for words, kinds in why.items() if kinds}
        return [f"{words}: state it ({names} in the YAML)" for words, names in keys.items()]

    def too_large(self, components: Indices, residual: FloatArray, freedom: FloatArray) -> list[str]:
        """Return of which kinds that are stated a fit leaves over so much less that chance is no reason, in words.

        Arguments are as those of :meth:`from_left_over`.
        """
        left, found = self.from_left_over(self.measured, components, residual, freedom), []
        for kind in self.measured:
            dof, times = float(freedom[are(kind, components)].sum()), self[kind].sigma / left[kind].sigma
            chance = float(scipy.special.chdtr(max(dof, 0.0), dof / times**2))
            if self[kind].source == "stated" and times > LEAST_FACTOR and chance < FALSE_ALARMS:
                (unit, si), each = unit_of(kind), "coordinate" if kind == "position" else kind
                found.append(
                    f"the noise stated for each {each} is {times:.2g} times the residuals, "
                    f"{left[kind].sigma / si:.2g} {unit}: "
                    f"errors below the stated noise go unseen, and intervals are too wide; state the scatter of "
                    f"repeated measurements ({noise_key(kind)} in the YAML)"
                )
        return found

    @property
    def open_kinds(self) -> tuple[Kind, ...]:
        """The kinds whose noise is what a fit leaves over."""
        return tuple(kind for kind in KINDS if self[kind].source == "residuals")

    def unseen(self, components: Indices) -> str:
        """Return in words which kinds of what a campaign measured are not among components; "" where all are."""
        seen = kinds_of(components)
        missing = [kind for kind in self.measured if kind not in seen]
        return f" (no {' and no '.join(missing)} measured)" if missing else ""

    @property
    def length_kind(self) -> Kind:
        """What counts as length: positions, or what was measured in their stead."""
        return next((kind for kind in LENGTHS if kind in self.measured), "position")

    @property
    def length_m(self) -> float:
        """Standard deviation of that, in m."""
        return self[self.length_kind].sigma

    def figures(self) -> dict[str, float | str | None]:
        """Return sizes and sources as results hold them, in mm and mrad; None: nothing of the kind was measured."""
        found: dict[str, float | str | None] = {}
        for kind in KINDS:
            (unit, si), seen = unit_of(kind), kind in self.measured
            if seen or kind in ("position", "rotation"):
                found[f"{kind}_{unit}"] = self[kind].sigma / si if seen else None
                found[f"{kind}_source"] = self[kind].source
        return found

    @property
    def turned(self) -> bool:
        """Whether rotations were measured."""
        return "rotation" in self.measured

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of each measured component of a pose, shape (6,) or (3,), in m and rad."""
        return np.repeat([self.position_m, self.rotation_rad] if self.turned else [self.position_m], 3)

    @property
    def dof(self) -> float:
        """Degrees of freedom behind the less well known figure, to judge a sum of squares by; infinite where stated.

        A noise that k repeats gave is itself uncertain, by 1 / sqrt(2 k): a sum of n squared residuals over its square
        follows n F(n, k), not chi-square(n). With fewer than about 100 of them chi-square takes chance for a gap.
        """
        return min((noise.dof for noise in self.kinds.values()), default=float("inf"))

    @property
    def from_residuals(self) -> bool:
        """Whether a figure is what the fit left over, so that it cannot serve to judge the fit."""
        return bool(self.open_kinds)


def noise_key(kind: Kind) -> str:
    """Return under which key of ``metrology`` a campaign's YAML states the noise of a kind."""
    return f"sigma_{kind}_{unit_of(kind)[0]}"


def noise_beforehand(campaign: Campaign, rows: Indices) -> NoiseLevel:
    """Return the noise that metadata, or repeats among some rows, tell; else a first guess, to be fitted."""
    measured = instruments_of(campaign)
    places, turns = measured[:2]
    shown = repeat_noise(PoseStack(places.position_m, turns.rotation), repeats(campaign, rows))
    there = {instrument.kind for instrument in measured if instrument.known.any()}
    found: dict[Kind, Noise] = {}
    for kind, seen in itertools.zip_longest(KINDS, shown):
        given = getattr(campaign.metadata, f"sigma_{kind}_{'rad' if kind == 'rotation' else 'm'}")
        noise = seen or Noise(source="residuals") if given is None else Noise(given, "stated")
        found[kind] = noise if kind in there else Noise(noise.sigma)
    return NoiseLevel(found)


def commands(drives: FloatArray) -> NDArray[np.int64]:
    """Return commanded drives (n, D), in m and rad, as whole numbers that are equal where the command is the same."""
    return np.round(drives / _SAME_DRIVE).astype(np.int64)


def repeats(campaign: Campaign, rows: Indices) -> list[Indices]:
    """Return the rows that were commanded alike in one session: groups of two or more.

    That is with all that somebody sets, sides, loads and travels, too: what these do is no noise.
    """
    settings = [commands(campaign.drives[rows])]
    for quantity in campaign.robot.condition_columns:
        if quantity.kind in SET and (values := campaign.quantity(quantity.name)) is not None:
            largest = np.abs(np.nan_to_num(values)).max(initial=0.0) if quantity.kind == "mass" else 0.0
            settings.append(_levels(values[rows], max(_SAME_LOAD * largest, _SAME_DRIVE))[:, None])
    return alike(campaign, rows, np.hstack(settings))


def alike(campaign: Campaign, rows: Indices, keys: NDArray[np.int64]) -> list[Indices]:
    """Return those of the rows (k,) that have session and keys, (k, m), in common: groups of two or more."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for row, key in zip(rows.tolist(), keys.tolist(), strict=True):
        groups.setdefault((campaign.sessions[row], *key), []).append(row)
    return [np.array(members, dtype=np.intp) for members in groups.values() if len(members) > 1]


def _levels(values: FloatArray, apart: float) -> NDArray[np.int64]:
    """Return values (n,) as numbers that are equal where one is less than so far above the least of them; NaN: -1.

    Counted from the values themselves: steps of a scale would part readings that lie on both sides of one.
    """
    found, level, least = np.full(values.size, -1, dtype=np.int64), -1, -np.inf
    for k in np.argsort(values)[: np.isfinite(values).sum()]:
        if values[k] >= least + apart:
            level, least = level + 1, values[k]
        found[k] = level
    return found


def repeat_noise(measured: PoseStack, groups: list[Indices]) -> tuple[Noise | None, Noise | None]:
    """Return the scatter of repeats about their means, of places and of rotations; None under 12 degrees of freedom."""
    sums, dof = np.zeros(2), np.zeros(2)
    for rows in groups:
        for column in measured.position_m[rows].T:
            values = column[np.isfinite(column)]
            if values.size > 1:
                sums[0] += float(((values - values.mean()) ** 2).sum())
                dof[0] += values.size - 1
        turned = measured.rotation[rows][np.isfinite(measured.rotation[rows]).all(axis=(1, 2))]
        if len(turned) > 1:
            stack = Rotation.from_matrix(turned)
            sums[1] += float(((stack * stack.mean().inv()).as_rotvec() ** 2).sum())
            dof[1] += 3 * (len(turned) - 1)
    found = [
        Noise(float(np.sqrt(total / freedom)), "repeats", float(freedom))
        if freedom >= _FEWEST_DOF and total > freedom * LEAST_NOISE**2  # exact repeats do not tell the noise
        else None
        for total, freedom in zip(sums, dof, strict=True)
    ]
    return found[0], found[1]


def noise_ratio(residual: FloatArray, freedom: FloatArray, fewest: float = 1.0) -> float:
    """Return the noise that residuals (m,) show over the one they are in units of; 1 with too few equations left over.

    ``freedom`` (m,) is what noise makes of the square of each on average, over its variance: n equations on which p
    unknowns were spent have n - p together. Of more than ``fewest`` something is told; where priors hold the unknowns,
    each counted by how far the data determine it, by any share of one.
    """
    left = max(float(freedom.sum()), _ROUND_OFF)
    return float(np.sqrt(np.square(residual).sum() / left)) if left > fewest else 1.0


def p_value(squares: float, dof: float, noise_dof: float) -> float:
    """Return the probability that noise alone makes such a sum of squares over its variance, by its degrees of freedom.

    ``noise_dof`` as of :attr:`NoiseLevel.dof`.
    """
    if np.isinf(noise_dof):
        return float(scipy.special.chdtrc(dof, squares))
    return float(scipy.special.fdtrc(dof, noise_dof, squares / dof))


def largest_noise(noise: NoiseLevel, components: Indices, tolerated: Iterable[FloatArray]) -> dict[Kind, float]:
    """Return how large what is left over may be at most to pass for noise, in m or rad, of each kind it stands for.

    It is what all errors within the robot's tolerances make together, root mean square. A device that scatters by more
    shows none of them, so nobody measures the robot with it: what is left is then a misfit that nothing explains. Less
    may still be a poor device. ``tolerated`` has a column (m,) an error: what one standard deviation of it changes
    beyond what frames absorb, over the noise; ``components`` is what each of the m equations is of. Where they absorb
    all, :data:`LEAST_NOISE` may be left.
    """
    variance = sum((column**2 for column in tolerated), np.zeros(len(components)))
    seen = {kind: are(kind, components) for kind in noise.open_kinds}
    sizes = {kind: noise[kind].sigma * float(np.sqrt(variance[own].mean())) for kind, own in seen.items() if own.any()}
    return {kind: max(size, LEAST_NOISE) for kind, size in sizes.items()}
