r"""Identification: the most probable unknowns given the measurements and the tolerances (MAP).

Minimised is

.. math:: \sum_b \rho(s_b) + \sum_k (x_k / \sigma_k)^2, \quad s_b^2 = \sum_{c \in b} (r_c / \sigma_c)^2

where a block b is what was measured of one kind in one row: one slip spoils all three coordinates. The robust loss is
quadratic up to the bound within which 99 % of sound blocks lie; it is widened while the median block is larger than
noise makes it (far from the answer, or where the model lacks something). The search starts from
:mod:`pouring_robot.estimation.first_frames`; its method is :mod:`pouring_robot.estimation.levenberg_marquardt`; which
unknowns the measurements cannot determine is found by :mod:`pouring_robot.estimation.identifiability`.
"""

import functools
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames.sessions import in_one_frame
from pouring_robot.estimation.jackknife import jackknife_covariance
from pouring_robot.estimation.levenberg_marquardt import Search
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.noise import FALSE_ALARMS, NoiseLevel, noise_ratio
from pouring_robot.estimation.residuals import MeasuredPoses, WhitenedEquations
from pouring_robot.estimation.robust import Loss, noise_shares
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.argument_checks import Options, whole
from pouring_robot.mechanism.arrays import FloatArray, Indices, finite
from pouring_robot.robot.model import RobotModel

_NOISE_ROUNDS, _NOISE_SETTLED = 12, 0.01
"""From n equations the noise is known to 1 / sqrt(2 n): better than 1 % only from more than 5000. Rounds are cheap, as
each begins where the last one ended, so that even a slowly converging noise settles."""


def campaign_and_model(
    campaign: Campaign | Path | str, model: RobotModel | Path | str | None
) -> tuple[Campaign, RobotModel]:
    """Return a campaign, read if need be, and the robot it is compared with: by default the drawing of its robot.

    Raises:
        BadInputError: they are of two different robots, or of the wrong type.
        CampaignError, DescriptionError: a file of theirs is wrong.
    """
    if model is None and isinstance(campaign, Campaign) and campaign.robot.name != RobotModel().definition.name:
        model = RobotModel.for_robot(campaign.robot)
    model = RobotModel.of(model)
    return Campaign.of(campaign, model.definition), model


def seen_from_one_place(campaign: Campaign, model: RobotModel) -> Campaign:
    """Return a campaign with all sessions in one frame, by the present robot; raises as :func:`in_one_frame`."""
    if not campaign.metadata.own_frames:
        return campaign
    closure = MeasurementModel(model, ()).at(campaign.drives).present()
    return in_one_frame(campaign, PoseStack(closure.position, closure.rotation))


@dataclass(frozen=True)
class FitOptions(Options):
    """How to search; figures out of range raise BadInputError."""

    loss: Loss = "huber"  # ``huber``, ``soft_l1`` or ``linear`` (no robustness)
    max_evaluations: int = 200  # how many times all rows may be predicted
    step_tolerance: float = 0.03  # the search ends when a step is shorter, in standard deviations of the answer
    curvature: bool = False  # whether the covariance has second derivatives; costs about a prediction per parameter

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.max_evaluations, 1, "evaluations of a fit are a number of them, from 1 on")
        said = f"the step that ends a fit is longer than 0, in standard deviations, not {self.step_tolerance}"
        if finite(self.step_tolerance, (), said) <= 0.0:
            raise BadInputError(said)


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of a fit."""

    unknowns: Unknowns  # the most probable values
    covariance: FloatArray  # of all unknowns given data and tolerances, shape (12 + P, 12 + P), in m and rad
    prior_std: FloatArray  # shape (12 + P,), in m and rad
    equations: WhitenedEquations  # whitened residuals and Jacobian at the answer
    weights: FloatArray  # of each equation by the robust loss, shape (m,)
    shares: FloatArray  # expectation of each squared weighted residual under noise alone, shape (m,)
    evaluations: int  # how many times all rows were predicted in the search
    second_evaluations: int  # how many times they were, to measure second derivatives
    last_step: float  # length of the next step, not taken, in standard deviations of the answer
    converged: bool  # whether that is below the tolerance; else the search ended at its limit
    noise: NoiseLevel = field(default_factory=lambda: NoiseLevel({}))  # with its sources; empty: it is stated
    stretches: tuple[Indices, ...] = ()  # rows of the fit that were measured one after the other, by index

    @property
    def std(self) -> FloatArray:
        """Standard deviations of all unknowns, shape (12 + P,), in m and rad."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def learnt(self) -> FloatArray:
        """Share of each unknown's prior variance that the data remove under the noise as given, (12 + P,)."""
        return np.asarray(1.0 - np.diagonal(self.covariance) / self.prior_std**2)

    @functools.cached_property
    def leverage(self) -> FloatArray:
        """Leverage of each equation, the share that the fit used up, shape (m,): diagonal of the hat matrix."""
        rows = self.equations.derivatives
        return np.asarray(((rows @ self.covariance) * rows).sum(axis=1) * self.weights)

    @property
    def left_over(self) -> tuple[FloatArray, FloatArray]:
        """Weighted residuals over their noise, (m,), and the share of each that is left for the noise, (m,)."""
        return self.weights * self.equations.residual, self.shares - self.leverage

    def dof(self) -> float:
        """Return the degrees of freedom left for the noise."""
        return float(self.left_over[1].sum())

    def chi_square(self) -> float:
        """Return the sum of squared weighted residuals over their noise."""
        return float(np.square(self.left_over[0]).sum())

    def noise_ratio(self) -> float:
        """Return the ratio of the noise that the residuals show to the one assumed."""
        return noise_ratio(*self.left_over)

    @property
    def inflation(self) -> float:
        """Ratio of residuals to noise where that is not chance, else 1; the noise counts as so many times larger."""
        larger = self.noise_ratio()
        if larger <= 1.0:  # as with no degree of freedom
            return 1.0
        chance = self.noise.lack_of_fit_p(self.chi_square(), self.dof(), float(self.shares.mean()))
        return larger if chance < FALSE_ALARMS else 1.0

    @property
    def interval_dof(self) -> float:
        """Degrees of freedom of the standard deviations: those of the noise; infinite where residuals enlarge it."""
        return self.noise.dof if self.inflation == 1.0 else math.inf

    @property
    def inflated_covariance(self) -> FloatArray:
        """Covariance of all unknowns under the inflated noise, (12 + P, 12 + P), in m and rad.

        The information of the data, C^-1 - P^-1, is divided by the inflation squared; the tolerances P hold as before.
        """
        more, share = self.inflation**2 - 1.0, self.covariance / self._scale
        return np.asarray(self._scale * (1.0 + more) * np.linalg.solve(np.eye(len(share)) + more * share, share))

    @property
    def scattered_covariance(self) -> FloatArray:
        """The same from the scatter of the answer over stretches of rows, see :mod:`~.jackknife`."""
        equations, root = self.equations, np.sqrt(self.weights)
        rows, residual = root[:, None] * equations.derivatives * self.prior_std, root * equations.residual
        blocks = [own for stretch in self.stretches if (own := np.isin(equations.rows, stretch)).any()]
        parts, place = ((rows[block], residual[block]) for block in blocks), self.unknowns.values / self.prior_std
        return np.asarray(self._scale * jackknife_covariance(parts, place, dof=self.interval_dof))

    @functools.cached_property
    def covariances(self) -> tuple[FloatArray, ...]:
        """The covariances from which :func:`~.intervals.largest_std` takes the reported standard deviations.

        Where residuals may be more than noise, stretches of rows count, too: in them what a model lacks is correlated.
        """
        unsure = self.noise.from_residuals or self.inflation > 1.0
        scattered = unsure and len(self.stretches) > 1
        return (self.inflated_covariance, self.scattered_covariance) if scattered else (self.inflated_covariance,)

    @property
    def _scale(self) -> FloatArray:
        return np.outer(self.prior_std, self.prior_std)


def identify(
    rows: ModelledRows,
    measured: MeasuredPoses,
    start: Unknowns,
    prior_std: FloatArray,
    options: FitOptions | None = None,
) -> Fit:
    """Return the most probable unknowns given what was measured in rows; prior means are 0.

    The frames of ``start`` are near the answer (see :mod:`~.first_frames`); ``prior_std`` are those of all unknowns,
    shape (12 + P,), in m and rad.

    Raises:
        CalibrationError: too few rows can be used, or the search ends far from an answer.
        BadInputError: a shape does not match.
    """
    options = options or FitOptions()
    if prior_std.shape != start.values.shape or not (np.isfinite(prior_std) & (prior_std > 0.0)).all():
        raise BadInputError(f"the prior needs {start.values.size} positive standard deviations")
    search = Search(rows, measured, start, prior_std, options.loss)
    last_step = search.run(options.step_tolerance, options.max_evaluations)
    return Fit(
        search.unknowns,
        search.covariance(curved=options.curvature),
        prior_std,
        search.equations,
        search.weights,
        noise_shares(search.equations, options.loss),
        search.evaluations,
        search.second_evaluations,
        last_step,
        last_step < options.step_tolerance,
    )


def settled_noise(
    rows: ModelledRows,
    measured: MeasuredPoses,
    start: Unknowns,
    prior_std: FloatArray,
    noise: NoiseLevel,
    options: FitOptions | None = None,
) -> NoiseLevel:
    """Return the noise, its unknown kinds from the residuals of a fit with it, repeated until both agree within 1 %.

    Where they do not agree before the rounds end, it is not ``settled``. Raises as :func:`identify`.
    """
    for _ in range(_NOISE_ROUNDS):
        fit = identify(rows, measured.with_noise(noise), start, prior_std, options)
        noise, assumed = noise.from_left_over(noise.open_kinds, fit.equations.components, *fit.left_over), noise
        if noise.apart(assumed) < _NOISE_SETTLED:
            return noise
        start = fit.unknowns
    return replace(noise, settled=False)
