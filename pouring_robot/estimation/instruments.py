"""What can be measured in a row: how far each instrument's reading is from the prediction, its derivatives and noise.

============  =======================================  =========================  ==================================
kind          columns of a campaign                    components                 noise in the YAML
============  =======================================  =========================  ==================================
position      ``x y z``, each where it was measured    x, y, z in m               ``sigma_position_mm``
rotation      ``rx ry rz``, all three                  rx, ry, rz in rad          ``sigma_rotation_mrad``
distance      ``distance``, ``distance_from``          distance in m              ``sigma_distance_mm``
closure       none: drives that are redundant          closure, … in m            ``sigma_closure_mm``
============  =======================================  =========================  ==================================

A distance is that of the target from the origin of the device's frame, which is unknown like all of that frame, or from
the target's position in the row that ``distance_from`` names. A closure is what redundant drives disagree by
(:mod:`pouring_robot.mechanism.closure.redundancy`); it should be zero. Another instrument is another class here, its
columns in :mod:`pouring_robot.campaign.columns`, and its noise in :mod:`pouring_robot.campaign.metadata`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.estimation.kinds import Kind
from pouring_robot.estimation.measurement import Prediction
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.mechanism.rotations import inverse_right_jacobians, rotation_vectors


@dataclass(frozen=True, eq=False)
class Starts:
    """Derivatives of n readings by the rows they start from alone."""

    row: Indices  # which row that is, by its place in the prediction, (n,); -1: none
    jacobian: FloatArray  # derivative of the predicted reading by the unknowns there, (n, 12 + P)
    stretched: FloatArray  # derivative by the device's scale there, (n,), in m per one


@dataclass(frozen=True, eq=False)
class Instrument(ABC):
    """The readings of one kind of instrument in n rows: arrays of n rows each, what was measured first."""

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
    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Return the derivative of :meth:`difference` by the unknowns, (n, k, 12 + P)."""

    def stretched(self, prediction: Prediction) -> FloatArray:
        """Return the derivative of the reading by the device's scale, (n, k), in m or rad per one; by default zero."""
        return np.zeros(self.known.shape)

    def starts(self, prediction: Prediction) -> Starts | None:
        """Return the derivatives by rows that readings start from, besides their own; by default there are none."""
        return None

    def where(self, kept: BoolArray) -> Self:
        """Return the same with the other rows as not measured; ``kept`` is a mask (n,)."""
        name, values = next(iter(self._arrays().items()))
        mask = kept.reshape(-1, *[1] * (values.ndim - 1))
        changed: dict[str, Any] = {name: values & mask if values.dtype == bool else np.where(mask, values, np.nan)}
        return replace(self, **changed)

    def __getitem__(self, rows: Indices | BoolArray) -> Self:
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

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Minus that of the position."""
        return -prediction.derivatives[:, :3]

    def stretched(self, prediction: Prediction) -> FloatArray:
        """About the tracker's own origin."""
        return prediction.position_m


@dataclass(frozen=True, eq=False)
class Orientations(Instrument):
    """Axes of the target, (n, 3, 3), seen by the tracker; NaN where missing."""

    rotation: FloatArray
    kind: ClassVar[Kind] = "rotation"

    @property
    def known(self) -> BoolArray:
        """A rotation counts only with all three components."""
        turned = np.asarray(np.isfinite(self.rotation).all(axis=(1, 2)))
        return np.repeat(turned[:, None], 3, axis=1)

    def difference(self, prediction: Prediction) -> FloatArray:
        """As the rotation vector that turns the predicted axes into the measured ones, in tracker axes."""
        return rotation_vectors(self.rotation, since=prediction.rotation)

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """As log(R_measured (exp(d) R_predicted)ᵀ) = log(exp(r) exp(-d))."""
        return np.asarray(-inverse_right_jacobians(self.difference(prediction)) @ prediction.derivatives[:, 3:])


@dataclass(frozen=True, eq=False)
class Distances(Instrument):
    """Distances of the target from a fixed point, the device's origin, or from where it was in another row."""

    distance_m: FloatArray  # (n,), in m; NaN where missing
    row: Indices  # number of the row in its campaign, (n,)
    start: Indices  # number of the row it is measured from, (n,); -1 for the fixed point, -2 where it is left out
    kind: ClassVar[Kind] = "distance"

    @property
    def known(self) -> BoolArray:
        """Where there is a distance whose start is among these rows."""
        there = (self.start == -1) | np.isin(self.start, self.row)
        return np.asarray((np.isfinite(self.distance_m) & there)[:, None])

    def _lines(self, prediction: Prediction) -> tuple[FloatArray, Indices]:
        """Return the vector to the target, (n, 3), and the index of the row it starts from, (n,); -1: a fixed point."""
        order = np.argsort(self.row)
        at = order[np.searchsorted(self.row[order], self.start).clip(max=len(order) - 1)]
        at = np.where(self.start < 0, -1, at)
        origin = np.where((at < 0)[:, None], 0.0, prediction.position_m[at])
        return prediction.position_m - origin, at

    def difference(self, prediction: Prediction) -> FloatArray:
        """Of lengths."""
        line, _ = self._lines(prediction)
        return np.where(self.known, (self.distance_m - np.linalg.norm(line, axis=1))[:, None], np.nan)

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """As both ends move along the line between them."""
        line, at = self._lines(prediction)
        moved = prediction.derivatives[:, :3]
        moved = moved - np.where((at < 0)[:, None, None], 0.0, moved[at])
        return np.asarray(-np.einsum("nc,ncp->np", _unit(line), moved)[:, None])

    def starts(self, prediction: Prediction) -> Starts | None:
        """Of the positions that distances between rows start from."""
        line, at = self._lines(prediction)
        if (at < 0).all():
            return None
        back = np.where((at < 0)[:, None], 0.0, -_unit(line))
        jacobian = np.einsum("nc,ncp->np", back, prediction.derivatives[at, :3])
        return Starts(at, jacobian, (back * prediction.position_m[at]).sum(axis=1))

    def stretched(self, prediction: Prediction) -> FloatArray:
        """In proportion."""
        line, _ = self._lines(prediction)
        return np.asarray(np.linalg.norm(line, axis=1)[:, None])


def _unit(lines: FloatArray) -> FloatArray:
    return np.asarray(lines / np.maximum(np.linalg.norm(lines, axis=1), np.finfo(float).tiny)[:, None])


@dataclass(frozen=True, eq=False)
class Closures(Instrument):
    """What redundant drives disagree by, (n, r): measured as zero in rows where all of them are known."""

    whole: BoolArray  # which rows these are, in each of the r directions, (n, r)
    kind: ClassVar[Kind] = "closure"

    @property
    def known(self) -> BoolArray:
        """Rows with all drives."""
        return self.whole

    def difference(self, prediction: Prediction) -> FloatArray:
        """Zero minus the disagreement."""
        return np.where(self.whole, -prediction.closure.disagreement, np.nan)

    def jacobian(self, prediction: Prediction) -> FloatArray:
        """Minus that of the disagreement, which does not depend on the frames."""
        if prediction.disagreement is None:
            raise BadInputError("the prediction's engine knows nothing of redundant drives")
        return -prediction.disagreement


def instruments_of(campaign: Campaign) -> tuple[Places, Orientations, *tuple[Instrument, ...]]:
    """Return what was measured in a campaign, in the order of components, each with a provisional noise of 1 m or rad.

    Rows without all drives count as not measured.
    """
    usable, seen, others = campaign.usable, campaign.measured_poses, list[Instrument]()
    seen.position_m[~usable], seen.rotation[~usable] = np.nan, np.nan
    redundant, distance = campaign.redundant_drives, campaign.distance_m
    if redundant or distance is not None:
        length = np.full(len(campaign), np.nan) if distance is None else np.where(usable, distance[:, 0], np.nan)
        # Each component has its own column: that of the distance stays empty where there are closures alone.
        others.append(Distances(1.0, length, np.arange(len(campaign)), campaign.distance_start))
    if redundant:
        others.append(Closures(1.0, np.repeat(usable[:, None], redundant, axis=1)))
    return (Places(1.0, seen.position_m), Orientations(1.0, seen.rotation), *others)
