"""What was measured against what the model predicts: differences, masks for missing cells, whitening by the noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.measurement import BoolArray, Prediction
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import inverse_right_jacobians, rotation_matrices


@dataclass(frozen=True, eq=False)
class MeasuredPoses(PoseStack):
    """What was measured of n rows, with its noise.

    Attributes:
        position_m: shape (n, 3), in m, tracker axes; NaN where missing.
        rotation: measured axes, shape (n, 3, 3); NaN where missing. A rotation counts only with all three components.
        sigma_position_m: standard deviation of a coordinate, in m.
        sigma_rotation_rad: standard deviation of a rotation component about the tracker's axes, in rad.
    """

    sigma_position_m: float
    sigma_rotation_rad: float

    def __post_init__(self) -> None:
        """Refuse noise that cannot be divided by, and shapes that do not fit."""
        n = len(self.position_m)
        if self.position_m.shape != (n, 3) or self.rotation.shape != (n, 3, 3):
            raise BadInputError(
                f"measured poses need position (n, 3) and rotation (n, 3, 3), not {self.position_m.shape} and "
                f"{self.rotation.shape}"
            )
        for name, value in (("position", self.sigma_position_m), ("rotation", self.sigma_rotation_rad)):
            if not (np.isfinite(value) and value > 0.0):
                raise BadInputError(f"the noise of a {name} must be a positive number, not {value}")

    @classmethod
    def from_campaign(cls, campaign: Campaign, sigma_position_m: float, sigma_rotation_rad: float) -> MeasuredPoses:
        """Take the measured columns of a campaign.

        Args:
            campaign: the data; rows without all drives count as not measured.
            sigma_position_m: noise of a coordinate, in m.
            sigma_rotation_rad: noise of a rotation component, in rad; any positive number for positions only.
        """
        position = np.array(campaign.position_m)
        rotation = np.full((len(campaign), 3, 3), np.nan)
        if campaign.rotation_vector_rad is not None:
            rotation = rotation_matrices(campaign.rotation_vector_rad)
        position[~campaign.usable], rotation[~campaign.usable] = np.nan, np.nan
        return cls(position, rotation, sigma_position_m, sigma_rotation_rad)

    def __getitem__(self, rows: NDArray[np.intp] | BoolArray) -> MeasuredPoses:
        """Return some rows, by index or mask."""
        return replace(self, position_m=self.position_m[rows], rotation=self.rotation[rows])

    def with_noise(self, sigma_position_m: float, sigma_rotation_rad: float) -> MeasuredPoses:
        """Return the same with another noise level."""
        return replace(self, sigma_position_m=sigma_position_m, sigma_rotation_rad=sigma_rotation_rad)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of the six components of a row, shape (6,), in m and rad."""
        return np.repeat([self.sigma_position_m, self.sigma_rotation_rad], 3)

    @property
    def known(self) -> BoolArray:
        """Which components were measured, shape (n, 6)."""
        turned = np.asarray(np.isfinite(self.rotation).all(axis=(1, 2)))
        return np.concatenate([np.isfinite(self.position_m), np.repeat(turned[:, None], 3, axis=1)], axis=1)

    def difference_jacobian(self, prediction: Prediction, difference: FloatArray) -> FloatArray:
        """Return the derivative of :meth:`difference` by the unknowns, shape (n, 6, 12 + P).

        Raises:
            BadInputError: the prediction carries no Jacobian.
        """
        if prediction.jacobian is None:
            raise BadInputError("the prediction holds no Jacobian; ask for it with linearise")
        jacobian = -prediction.jacobian
        # log(R_measured (exp(d) R_predicted)ᵀ) = log(exp(r) exp(-d))
        jacobian[:, 3:] = inverse_right_jacobians(difference[:, 3:]) @ jacobian[:, 3:]
        return jacobian


@dataclass(frozen=True, eq=False)
class WhitenedEquations:
    """Residuals over their noise, missing components left out.

    Attributes:
        residual: shape (m,): measured minus predicted over sigma.
        jacobian: its derivative by the unknowns, shape (m, 12 + P); None where it was not asked for.
        rows: row each equation comes from, shape (m,).
        components: component 0 to 5 (x y z rx ry rz) of each equation, shape (m,).
        failed: rows that were measured but have no prediction.
    """

    residual: FloatArray
    jacobian: FloatArray | None
    rows: NDArray[np.intp]
    components: NDArray[np.intp]
    failed: NDArray[np.intp]


def whiten(measured: MeasuredPoses, prediction: Prediction) -> WhitenedEquations:
    """Return the equations of a fit: every measured component of every row that closes.

    The Jacobian is there if the prediction has one.
    """
    difference = measured.difference(prediction)
    known = measured.known
    kept = known & prediction.closed[:, None]
    rows, components = np.nonzero(kept)
    jacobian = None
    if prediction.jacobian is not None:
        jacobian = measured.difference_jacobian(prediction, difference)[kept] / measured.sigma[components][:, None]
    failed = np.flatnonzero(known.any(axis=1) & ~prediction.closed)
    return WhitenedEquations(difference[kept] / measured.sigma[components], jacobian, rows, components, failed)


def regressor(prediction: Prediction, sigma: FloatArray, known: BoolArray | None = None) -> FloatArray:
    """Return the whitened Jacobian of the predicted measurement, shape (m, 12 + P): what planning weighs poses by.

    Args:
        prediction: with its Jacobian.
        sigma: standard deviation of the six components, shape (6,), in m and rad.
        known: which components are measured, shape (n, 6); by default all.

    Raises:
        BadInputError: the prediction carries no Jacobian.
    """
    if prediction.jacobian is None:
        raise BadInputError("the prediction holds no Jacobian; ask for it with linearise")
    kept = np.broadcast_to(prediction.closed[:, None], prediction.jacobian.shape[:2])
    kept = kept if known is None else kept & known
    return np.asarray((prediction.jacobian / sigma[:, None])[kept])
