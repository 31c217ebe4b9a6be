"""What can be measured of a row: how far each instrument reads from the prediction, how that moves, how noisy it is.

============  =======================================  =========================  ==================================
kind          columns of a campaign                    components                 noise in the YAML
============  =======================================  =========================  ==================================
position      ``x y z``, each where it was measured    x, y, z in m               ``sigma_position_mm``
rotation      ``rx ry rz``, all three                  rx, ry, rz in rad          ``sigma_rotation_mrad``
distance      ``distance``, ``distance_from``          distance in m              ``sigma_distance_mm``
closure       none: drives that are redundant          closure, … in m            ``sigma_closure_mm``
============  =======================================  =========================  ==================================

A distance is that of the target from the origin of the device's frame, which is unknown like all of that frame, or from
its place in the row that ``distance_from`` names. A closure is what redundant drives disagree by
(:mod:`pouring_robot.mechanism.closure.redundancy`); it should be zero. Another instrument is another class here, its
columns in :mod:`pouring_robot.campaign.columns`, and its noise in :mod:`pouring_robot.campaign.metadata`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from pouring_robot.estimation.measurement import Prediction
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.units import MM, shown_in
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.mechanism.rotations import inverse_right_jacobians, rotation_vectors

Kind = Literal["position", "rotation", "distance", "closure"]
KINDS: tuple[Kind, ...] = ("position", "rotation", "distance", "closure")
LENGTHS: tuple[Kind, ...] = ("position", "distance", "closure")
_FIRST = (0, 3, 6, 7)
_COMPONENTS = ("x", "y", "z", "rx", "ry", "rz", "distance", "closure")
Source = Literal["stated", "repeats", "residuals", "none"]
LEAST_NOISE = 1e-6
"""In m or rad: what is left over of exact data is less, and as noise would make of rounding an error of the robot. No
device that robots are measured with reads better."""


def kind_of(components: Indices) -> Indices:
    """Return the place in :data:`KINDS` of components, same shape."""
    return np.asarray(np.searchsorted(_FIRST, components, side="right") - 1, dtype=np.intp)


def kinds_of(components: Indices) -> tuple[Kind, ...]:
    """Return which kinds components are of, each once."""
    return tuple(KINDS[place] for place in np.unique(kind_of(components)).tolist())


def are(kind: Kind, components: Indices) -> BoolArray:
    """Return which components are of a kind, same shape."""
    return np.asarray(kind_of(components) == KINDS.index(kind), dtype=np.bool_)


def component_name(component: int) -> str:
    """Return what a component is called: ``x``, ``rz``, ``distance``, ``closure``, ``closure_2``."""
    last = len(_COMPONENTS) - 1
    return _COMPONENTS[component] if component <= last else f"{_COMPONENTS[last]}_{component - last + 1}"


@dataclass(frozen=True, eq=False)
class Instrument(ABC):
    """What one kind of instrument read in n rows: arrays of n rows each, what was measured first."""

    kind: ClassVar[Kind]  # what it measures
    sigma: float  # standard deviation of a component, in m or rad

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma) and self.sigma > 0.0):
            raise BadInputError(f"the noise of a {self.kind} must be a positive number, not {self.sigma}")

    @property
    @abstractmethod
    def known(self) -> BoolArray:
        """Which components were measured, (n, k)."""

    @abstractmethod
    def difference(self, prediction: Prediction) -> FloatArray:
        """Return measured minus predicted, (n, k), in m or rad; NaN where either is missing."""

    @abstractmethod
    def jacobian(self, prediction: Prediction, difference: FloatArray) -> FloatArray:
        """Return the derivative of :meth:`difference` by the unknowns, (n, k, 12 + P)."""

    def stretched(self, prediction: Prediction) -> FloatArray:
        """Return how the reading grows with the device's scale, (n, k), in m or rad per one; by default not at all."""
        return np.zeros(self.known.shape)

    def where(self, kept: BoolArray) -> Self:
        """Return the same with the other rows not measured; ``kept`` is a mask (n,)."""
        name, values = next(iter(self._arrays().items()))
        mask = kept.reshape(-1, *[1] * (values.ndim - 1))
        changed: dict[str, Any] = {name: values & mask if values.dtype == bool else np.where(mask, values, np.nan)}
        return replace(self, **changed)

    def __getitem__(self, rows: Indices | BoolArray) -> Self:
        """Return some rows, by index or mask."""
        return replace(self, **{name: values[rows] for name, values in self._arrays().items()})

    def _arrays(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "sigma"}


@dataclass(frozen=True, eq=False)
class Places(Instrument):
    """Coordinates of the target's origin, (n, 3), in m, tracker axes; NaN where missing."""

    position_m: FloatArray
    kind: ClassVar[Kind] = "position"

    @property
    def known(self) -> BoolArray:
        """Each coordinate by itself."""
        return np.asarray(np.isfinite(self.position_m))

    def difference(self, prediction: Prediction) -> FloatArray:
        """Of each coordinate."""
        return np.asarray(self.position_m - prediction.position_m)

    def jacobian(self, prediction: Prediction, difference: FloatArray) -> FloatArray:
        """As the position moves."""
        return -prediction.derivatives[:, :3]

    def stretched(self, prediction: Prediction) -> FloatArray:
        """About the tracker's own origin."""
        return prediction.position_m


@dataclass(frozen=True, eq=False)
class Turns(Instrument):
    """Axes of the target, (n, 3, 3), seen by the tracker; NaN where missing."""

    rotation: FloatArray
    kind: ClassVar[Kind] = "rotation"

    @property
    def known(self) -> BoolArray:
        """A rotation counts only with all three components."""
        turned = np.asarray(np.isfinite(self.rotation).all(axis=(1, 2)))
        return np.repeat(turned[:, None], 3, axis=1)

    def difference(self, prediction: Prediction) -> FloatArray:
        """As rotation vector that turns the predicted axes into the measured ones, in tracker axes."""
        return rotation_vectors(self.rotation @ np.swapaxes(prediction.rotation, 1, 2))

    def jacobian(self, prediction: Prediction, difference: FloatArray) -> FloatArray:
        """As log(R_measured (exp(d) R_predicted)ᵀ) = log(exp(r) exp(-d))."""
        return np.asarray(-inverse_right_jacobians(difference) @ prediction.derivatives[:, 3:])


@dataclass(frozen=True, eq=False)
class Distances(Instrument):
    """Distances of the target from a fixed point, the device's origin, or from where it was in another row."""

    distance_m: FloatArray  # (n,), in m; NaN where missing
    row: Indices  # number of the row in its campaign, (n,)
    start: Indices  # that it is measured from, (n,); -1 for the fixed point, -2 where that row is left out
    kind: ClassVar[Kind] = "distance"

    @property
    def known(self) -> BoolArray:
        """Where there is a distance whose start is among these rows."""
        there = (self.start == -1) | np.isin(self.start, self.row)
        return np.asarray((np.isfinite(self.distance_m) & there)[:, None])

    def _lines(self, prediction: Prediction) -> tuple[FloatArray, Indices]:
        """Return the vector to the target, (n, 3), and the place of the row it starts from, (n,); -1: a fixed point."""
        order = np.argsort(self.row)
        at = order[np.searchsorted(self.row[order], self.start).clip(max=len(order) - 1)]
        at = np.where(self.start < 0, -1, at)
        origin = np.where((at < 0)[:, None], 0.0, prediction.position_m[at])
        return prediction.position_m - origin, at

    def difference(self, prediction: Prediction) -> FloatArray:
        """Of lengths."""
        line, _ = self._lines(prediction)
        return np.where(self.known, (self.distance_m - np.linalg.norm(line, axis=1))[:, None], np.nan)

    def jacobian(self, prediction: Prediction, difference: FloatArray) -> FloatArray:
        """As both ends move along the line between them."""
        line, at = self._lines(prediction)
        moved = prediction.derivatives[:, :3]
        moved = moved - np.where((at < 0)[:, None, None], 0.0, moved[at])
        along = line / np.maximum(np.linalg.norm(line, axis=1), np.finfo(float).tiny)[:, None]
        return np.asarray(-np.einsum("nc,ncp->np", along, moved)[:, None])

    def stretched(self, prediction: Prediction) -> FloatArray:
        """In proportion."""
        line, _ = self._lines(prediction)
        return np.asarray(np.linalg.norm(line, axis=1)[:, None])


@dataclass(frozen=True, eq=False)
class Closures(Instrument):
    """What redundant drives disagree by, (n, r): measured as zero in rows where all of them are known."""

    whole: BoolArray  # which rows those are, in each of the r directions, (n, r)
    kind: ClassVar[Kind] = "closure"

    @property
    def known(self) -> BoolArray:
        """Rows with all drives."""
        return self.whole

    def difference(self, prediction: Prediction) -> FloatArray:
        """Nothing minus the disagreement."""
        return np.where(self.whole, -prediction.closure.disagreement, np.nan)

    def jacobian(self, prediction: Prediction, difference: FloatArray) -> FloatArray:
        """As the disagreement changes; the frames have no part in it."""
        if prediction.disagreement is None:
            raise BadInputError("the prediction's engine knows nothing of redundant drives")
        return -prediction.disagreement


@dataclass(frozen=True)
class Noise:
    """The noise of one kind of instrument."""

    sigma: float = 1e-3  # standard deviation of a component, in m or rad
    source: Source = "none"  # where the figure comes from; ``none``: nothing of the kind was measured
    freedoms: float = float("inf")  # of a figure from repeats, infinite for any other: see :attr:`NoiseLevel.freedoms`


def unit_of(kind: Kind) -> tuple[str, float]:
    """Return the unit that a kind is shown in, and how large it is (SI)."""
    return shown_in("rad" if kind == "rotation" else "m")


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of every kind."""

    kinds: Mapping[Kind, Noise]  # a kind that is left out was not measured

    @classmethod
    def stated(cls, position_m: float, rotation_rad: float | None) -> NoiseLevel:
        """Return the noise of a device; None: it measures positions only."""
        rotation = Noise() if rotation_rad is None else Noise(rotation_rad, "stated")
        return cls({"position": Noise(position_m, "stated"), "rotation": rotation})

    def __getitem__(self, kind: Kind) -> Noise:
        """Return the noise of a kind."""
        return self.kinds.get(kind, Noise())

    @property
    def position_m(self) -> float:
        """Standard deviation of a coordinate, in m."""
        return self["position"].sigma

    @property
    def rotation_rad(self) -> float:
        """Standard deviation of a rotation component, in rad."""
        return self["rotation"].sigma

    def times(self, factors: Mapping[Kind, float]) -> NoiseLevel:
        """Return other sizes, none below :data:`LEAST_NOISE`."""
        changed = {k: replace(self[k], sigma=max(self[k].sigma * f, LEAST_NOISE)) for k, f in factors.items()}
        return NoiseLevel({**self.kinds, **changed})

    def apart(self, other: NoiseLevel) -> float:
        """Return by which share of the other the sizes of :attr:`open_kinds` differ at most."""
        return max((abs(self[kind].sigma / other[kind].sigma - 1.0) for kind in self.open_kinds), default=0.0)

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
    def least_words(self) -> str:
        """What stands for the noise where hardly anything is left over, in words; "" where that is not so."""
        exact = [kind for kind in self.open_kinds if self[kind].sigma <= LEAST_NOISE]
        if not exact:
            return ""
        keys = ", ".join(f"sigma_{kind}_{unit_of(kind)[0]}" for kind in exact)
        least = f"{LEAST_NOISE / MM:g} mm or mrad"
        return f"hardly any is left over, so {least} stands for it: state it ({keys} in the YAML)"

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
    def freedoms(self) -> float:
        """Degrees of freedom behind the less well known figure, to judge a sum of squares by; infinite where stated.

        A noise that k repeats gave is itself uncertain, by 1 / sqrt(2 k): a sum of n squared residuals over its square
        follows n F(n, k), not chi-square(n). With fewer than about 100 freedoms chi-square takes chance for a gap.
        """
        return min((noise.freedoms for noise in self.kinds.values()), default=float("inf"))

    @property
    def from_residuals(self) -> bool:
        """Whether a figure is what the fit left over, so that it cannot serve to judge the fit."""
        return bool(self.open_kinds)
