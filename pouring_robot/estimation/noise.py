"""The measurement noise: how large that of each kind is, and where the figure comes from.

Before a fit it is as stated, or the scatter of rows that repeat a pose (:func:`noise_beforehand`). Where neither is
known, :meth:`NoiseLevel.from_left_over` takes it from the residuals of a fit (:func:`noise_ratio`), repeated until both
agree: in a calibration ``settled_noise`` of :mod:`pouring_robot.estimation.map_fit`, in a diagnosis
``diagnosis/search_and_noise.py`` by ``noise_left`` of :mod:`pouring_robot.diagnosis.diagnoser`, for where they
disagree ``diagnosis/where/dependence.py``. A fit, a whole search and a sum of processes differ in cost and in what they
pass on, so each has its own rule for ending. :func:`largest_noise` returns the size beyond which it is not noise.
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
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray, Indices

Source = Literal["stated", "repeats", "residuals", "none"]
LEAST_NOISE = 1e-6
"""In m or rad. Residuals of exact data are smaller; taken as noise they would turn rounding into an error of the robot.
No device for measuring robots is more precise."""
FALSE_ALARMS = 1e-3  # share of sound campaigns and robots that may be flagged by chance
LEAST_FACTOR = 2.0
"""Factor by which a stated noise may be wrong: a data sheet's figure is not better known."""
_FEWEST_DOF = 12
_ROUND_OFF = 1e-9  # degrees of freedom: fewer are the round-off of none, of either sign
_SAME_DRIVE = 1e-6  # m or rad: no drive is commanded more finely
_SAME_LOAD = 0.01
"""Share of the largest load: a load that is weighed is never twice the same, and the effect of a hundredth of it is
less than noise unless that of all of it is more than a hundred times the noise."""


@dataclass(frozen=True)
class Noise:
    """The noise of one kind of instrument."""

    sigma: float = 1e-3  # standard deviation of a component, in m or rad
    source: Source = "none"  # where the figure comes from; ``none``: nothing of the kind was measured
    dof: float = float("inf")  # degrees of freedom of a figure from repeats, else infinite: see :attr:`NoiseLevel.dof`


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of every kind."""

    kinds: Mapping[Kind, Noise]  # a kind that is left out was not measured
    settled: bool = True  # False where the fits that determine it ended before the residuals agreed with it

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
        """Return the noise of one kind alone; None: of all."""
        return self if kind is None else NoiseLevel({kind: self[kind]}, self.settled)

    def times(self, factors: Mapping[Kind, float]) -> NoiseLevel:
        """Return the noise times factors by kind, nowhere below :data:`LEAST_NOISE`."""
        changed = {k: replace(self[k], sigma=max(self[k].sigma * f, LEAST_NOISE)) for k, f in factors.items()}
        return NoiseLevel({**self.kinds, **changed})

    def from_left_over(
        self, kinds: Iterable[Kind], components: Indices, residual: FloatArray, freedom: FloatArray, fewest: float = 1.0
    ) -> NoiseLevel:
        """Return the noise with that of some kinds from the residuals of a fit with it, by :func:`noise_ratio`.

        ``components`` is the component of each of the m equations, ``residual`` is divided by this noise.
        """
        chosen = {kind: are(kind, components) for kind in kinds}
        return self.times(
            {kind: noise_ratio(residual[own], freedom[own], fewest) for kind, own in chosen.items() if own.any()}
        )

    def pooled_with(self, left: NoiseLevel, dof: Mapping[Kind, float], rate: float) -> NoiseLevel:
        """Return the noise with that from residuals, with ``dof`` degrees of freedom by kind, where that is better.

        That is where it is not stated, or where it comes from few repeats that agree: the residuals beyond them (lack
        of fit, F) are no more than chance makes in a share ``rate`` of campaigns. The repeats are among the rows, which
        then outnumber them.
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
        """Return the probability that noise alone gives such a sum of squared residuals over it, with so many ``dof``.

        Repeats that determine the noise contribute exactly their scatter to the residuals: what remains beyond them is
        tested (lack of fit: Draper & Smith, *Applied Regression Analysis*, 1998, ch. 2). ``share`` is the part of each
        square that a robust loss leaves on average.
        """
        repeated = share * sum(noise.dof for noise in self.kinds.values() if math.isfinite(noise.dof))
        beyond = dof - repeated
        return p_value(max(squares - repeated, 0.0), beyond, self.dof) if beyond >= 1.0 else 1.0

    def apart(self, other: NoiseLevel) -> float:
        """Return the largest difference of sizes from another noise, relative to that."""
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
        """Why a noise that is not stated is only rough, in words: it is hardly above zero, or did not settle."""
        unstated = [kind for kind in self.measured if self[kind].source != "stated"]
        exact = [kind for kind in self.open_kinds if self[kind].sigma <= LEAST_NOISE]
        why = {
            "its estimate had not settled when the fits ended": [] if self.settled else unstated,
            f"residuals are nearly zero, so {LEAST_NOISE / MM:g} mm or mrad stands for it": exact,
        }
        keys = {words: ", ".join(map(noise_key, kinds)) for words, kinds in why.items() if kinds}
        return [f"{words}: state it ({names} in the YAML)" for words, names in keys.items()]

    def too_large(self, components: Indices, residual: FloatArray, freedom: FloatArray) -> list[str]:
        """Return, in words, the kinds whose stated noise is larger than residuals by more than chance explains.

        Arguments are those of :meth:`from_left_over`.
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
        """The kinds whose noise comes from the residuals of a fit."""
        return tuple(kind for kind in KINDS if self[kind].source == "residuals")

    def unseen(self, components: Indices) -> str:
        """Return in words which measured kinds are not among components; "" where all are."""
        seen = kinds_of(components)
        missing = [kind for kind in self.measured if kind not in seen]
        return f" (no {' and no '.join(missing)} measured)" if missing else ""

    @property
    def length_kind(self) -> Kind:
        """The kind that counts as length: positions, or what was measured instead."""
        return next((kind for kind in LENGTHS if kind in self.measured), "position")

    @property
    def length_m(self) -> float:
        """Standard deviation of that, in m."""
        return self[self.length_kind].sigma

    def figures(self) -> dict[str, float | str | None]:
        """Return sizes and sources as in results, in mm and mrad; None: nothing of the kind was measured."""
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
        """Degrees of freedom of the less well known figure, for tests of sums of squares; infinite where stated.

        A noise from k repeats is itself uncertain, by 1 / sqrt(2 k): a sum of n squared residuals over its square
        follows n F(n, k), not chi-square(n). With fewer than about 100 repeats chi-square mistakes chance for a gap.
        """
        return min((noise.dof for noise in self.kinds.values()), default=float("inf"))

    @property
    def from_residuals(self) -> bool:
        """Whether a figure comes from the residuals of the fit, so that it cannot be used to judge the fit."""
        return bool(self.open_kinds)


def noise_key(kind: Kind) -> str:
    """Return the key under ``metrology`` in a campaign's YAML that states the noise of a kind."""
    return f"sigma_{kind}_{unit_of(kind)[0]}"


def noise_beforehand(campaign: Campaign, rows: Indices) -> NoiseLevel:
    """Return the noise from metadata, or from repeats among some rows; else a first guess, to be fitted."""
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
    """Return commanded drives (n, D), in m and rad, as integers that are equal where the command is the same."""
    return np.round(drives / _SAME_DRIVE).astype(np.int64)


def repeats(campaign: Campaign, rows: Indices) -> list[Indices]:
    """Return the rows with the same commands in one session: groups of two or more.

    Everything that is set must be the same, also sides, loads and travels: their effects are not noise.
    """
    settings = [commands(campaign.drives[rows])]
    for quantity in campaign.robot.condition_columns:
        if quantity.kind in SET and (values := campaign.quantity(quantity.name)) is not None:
            largest = np.abs(np.nan_to_num(values)).max(initial=0.0) if quantity.kind == "mass" else 0.0
            settings.append(_levels(values[rows], max(_SAME_LOAD * largest, _SAME_DRIVE))[:, None])
    return alike(campaign, rows, np.hstack(settings))


def alike(campaign: Campaign, rows: Indices, keys: NDArray[np.int64]) -> list[Indices]:
    """Return those of the rows (k,) with the same session and keys, (k, m): groups of two or more."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for row, key in zip(rows.tolist(), keys.tolist(), strict=True):
        groups.setdefault((campaign.sessions[row], *key), []).append(row)
    return [np.array(members, dtype=np.intp) for members in groups.values() if len(members) > 1]


def _levels(values: FloatArray, apart: float) -> NDArray[np.int64]:
    """Return the level of values (n,) by number; those of one are less than ``apart`` above its least; NaN: -1.

    Levels start at the values themselves: those of a fixed scale would separate readings on both sides of a step.
    """
    found, level, least = np.full(values.size, -1, dtype=np.int64), -1, -np.inf
    for k in np.argsort(values)[: np.isfinite(values).sum()]:
        if values[k] >= least + apart:
            level, least = level + 1, values[k]
        found[k] = level
    return found


def repeat_noise(measured: PoseStack, groups: list[Indices]) -> tuple[Noise | None, Noise | None]:
    """Return the scatter of repeats about their means, of positions and rotations; None below 12 degrees of freedom."""
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
        if freedom >= _FEWEST_DOF and total > freedom * LEAST_NOISE**2  # exact repeats do not show the noise
        else None
        for total, freedom in zip(sums, dof, strict=True)
    ]
    return found[0], found[1]


def noise_ratio(residual: FloatArray, freedom: FloatArray, fewest: float = 1.0) -> float:
    """Return the noise that residuals (m,) show over that in whose units they are; 1 with too few degrees of freedom.

    ``freedom`` (m,) is the expectation of the square of each under noise: n equations with p unknowns have n - p in
    all. More than ``fewest`` determine something; where priors hold the unknowns, each counts by how far the data
    determine it, so that any share of one does.
    """
    dof = max(float(freedom.sum()), _ROUND_OFF)
    return float(np.sqrt(np.square(residual).sum() / dof)) if dof > fewest else 1.0


def p_value(squares: float, dof: float, noise_dof: float) -> float:
    """Return the probability that noise alone gives such a sum of squares over its variance, with so many ``dof``.

    ``noise_dof`` is :attr:`NoiseLevel.dof`.
    """
    if np.isinf(noise_dof):
        return float(scipy.special.chdtrc(dof, squares))
    return float(scipy.special.fdtrc(dof, noise_dof, squares / dof))


def largest_noise(noise: NoiseLevel, components: Indices, tolerated: Iterable[FloatArray]) -> dict[Kind, float]:
    """Return the largest residuals that can pass for noise, in m or rad, of each kind whose noise comes from them.

    They are as large as the effect of all errors within the robot's tolerances together, root mean square. A device
    with more scatter shows none of these, so nobody measures the robot with it: the residuals are then a misfit that
    nothing explains. Smaller ones may still be a poor device. ``tolerated`` has a column (m,) per error: what one
    standard deviation of it changes beyond what the frames absorb, over the noise; ``components`` is the component of
    each of the m equations. Where the frames absorb everything, :data:`LEAST_NOISE` is allowed.
    """
    variance = sum((column**2 for column in tolerated), np.zeros(len(components)))
    seen = {kind: are(kind, components) for kind in noise.open_kinds}
    sizes = {kind: noise[kind].sigma * float(np.sqrt(variance[own].mean())) for kind, own in seen.items() if own.any()}
    return {kind: max(size, LEAST_NOISE) for kind, size in sizes.items()}
