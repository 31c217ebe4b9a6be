"""Measurements against the model's predictions: differences, masks for missing cells, whitening by the noise."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.instruments import Distances, Instrument, Orientations, Places, instruments_of
from pouring_robot.estimation.measurement import Differentiated, Prediction
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.robust import Equations
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices


@dataclass(frozen=True, eq=False)
class MeasuredPoses(PoseStack):
    """What was measured in n rows, with its noise: a stack of poses, and the readings of other instruments.

    Poses are those of the target in the tracker frame, NaN where missing; a rotation counts only with all three
    components. Components have the order of :mod:`pouring_robot.estimation.kinds`; there are K of them: six, more with
    distances or redundant drives.
    """

    sigma_position_m: float  # standard deviation of a coordinate, in m
    sigma_rotation_rad: float  # standard deviation of a rotation component about the tracker's axes, in rad
    others: tuple[Instrument, ...] = ()  # distances; where drives are redundant, closures after them

    def __post_init__(self) -> None:
        _ = self.instruments  # an invalid noise is refused at once

    @functools.cached_property
    def instruments(self) -> tuple[Places, Orientations, *tuple[Instrument, ...]]:
        """All instruments, in the order of their components."""
        places, turns = (
            Places(self.sigma_position_m, self.position_m),
            Orientations(self.sigma_rotation_rad, self.rotation),
        )
        return (places, turns, *self.others)

    @classmethod
    def from_campaign(cls, campaign: Campaign, noise: NoiseLevel) -> MeasuredPoses:
        """Return the measured columns of a campaign; rows without all drives count as not measured."""
        places, turns, *others = instruments_of(campaign)
        return cls(places.position_m, turns.rotation, 1.0, 1.0, tuple(others)).with_noise(noise)

    def __getitem__(self, rows: Indices | BoolArray) -> MeasuredPoses:
        others = tuple(instrument[rows] for instrument in self.others)
        return replace(self, position_m=self.position_m[rows], rotation=self.rotation[rows], others=others)

    def among(self, rows: Indices) -> tuple[Indices, MeasuredPoses]:
        """Return rows by index and what was measured there; rows their distances start from follow, as not measured."""
        starts = [own.start[rows] for own in self.others if isinstance(own, Distances)]
        every = np.concatenate([rows, np.setdiff1d(np.concatenate([rows, *starts]), [*rows, -1, -2])])
        return every, self.without(every[len(rows) :])[every]

    def with_noise(self, noise: NoiseLevel) -> MeasuredPoses:
        """Return the same with another noise level."""
        others = tuple(replace(instrument, sigma=noise[instrument.kind].sigma) for instrument in self.others)
        return replace(self, sigma_position_m=noise.position_m, sigma_rotation_rad=noise.rotation_rad, others=others)

    def without(self, rows: Indices) -> MeasuredPoses:
        """Return the same with some rows as not measured."""
        kept = ~np.isin(np.arange(len(self)), rows)
        places, turns, *others = self.instruments
        position, rotation = places.where(kept).position_m, turns.where(kept).rotation
        return replace(self, position_m=position, rotation=rotation, others=tuple(i.where(kept) for i in others))

    @property
    def framed(self) -> bool:
        """Whether anything was measured from outside, so that there are outer frames at all."""
        return bool(any(i.known.any() for i in self.instruments if i.kind != "closure"))

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the components of a row, shape (K,), in m and rad."""
        return np.repeat([i.sigma for i in self.instruments], [i.known.shape[1] for i in self.instruments])

    @property
    def known(self) -> BoolArray:
        """Which components were measured, shape (n, K)."""
        return np.concatenate([instrument.known for instrument in self.instruments], axis=1)

    def stretched(self, prediction: Prediction) -> FloatArray:
        """Return the derivatives of the readings by the device's scale, (n, K)."""
        return np.concatenate([instrument.stretched(prediction) for instrument in self.instruments], axis=1)

    def residual(self, prediction: Prediction) -> FloatArray:
        """Return measured minus predicted, (n, K), in m and rad; NaN where either is missing."""
        return np.concatenate([instrument.difference(prediction) for instrument in self.instruments], axis=1)


@dataclass(frozen=True, eq=False)
class WhitenedEquations(Equations, Differentiated):
    """Measured minus predicted over its noise, missing components left out."""

    jacobian: FloatArray | None  # its derivative by the unknowns, shape (m, 12 + P); None where it was not requested
    failed: Indices  # rows that were measured but have no prediction


def whiten(measured: MeasuredPoses, prediction: Prediction) -> WhitenedEquations:
    """Return a fit's equations: each measured component of rows that close; a Jacobian if the prediction has one."""
    residual, known = measured.residual(prediction), measured.known
    kept = known & prediction.closed[:, None] & np.isfinite(residual)
    rows, components = np.nonzero(kept)
    jacobian = None
    if prediction.jacobian is not None:
        whole = np.concatenate([instrument.jacobian(prediction) for instrument in measured.instruments], axis=1)
        jacobian = whole.reshape(-1, whole.shape[2]) if kept.all() else whole[kept]
        jacobian /= measured.sigma[components][:, None]
    failed = np.flatnonzero(known.any(axis=1) & ~prediction.closed)
    return WhitenedEquations(residual[kept] / measured.sigma[components], rows, components, jacobian, failed)


def regressor(prediction: Prediction, sigma: FloatArray, known: BoolArray | None = None) -> FloatArray:
    """Return the whitened Jacobian of the predicted measurement, shape (m, 12 + P), by which planning chooses poses.

    ``sigma`` has the standard deviations of the six components, (6,), in m and rad; ``known`` states which are
    measured, (n, 6), by default all. Raises BadInputError for a prediction without a Jacobian.
    """
    kept = np.broadcast_to(prediction.closed[:, None], prediction.derivatives.shape[:2])
    kept = kept if known is None else kept & known
    return np.asarray((prediction.derivatives / sigma[:, None])[kept])
