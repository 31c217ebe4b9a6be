r"""Identification: the most probable unknowns given the measurements and the tolerances (MAP).

Minimised is

.. math:: \sum_b \rho(s_b) + \sum_k (x_k / \sigma_k)^2, \quad s_b^2 = \sum_{c \in b} (r_c / \sigma_c)^2

where a block b is what was measured of a kind in one row: one slip spoils all three coordinates. The robust loss is
quadratic up to the bound that 99 % of sound blocks keep, widened while the median block is larger than noise makes it
(far from the answer, or where the model lacks something). Where it is searched from:
:mod:`pouring_robot.estimation.first_frames`; how: :mod:`pouring_robot.estimation.levenberg_marquardt`; which unknowns
the measurements cannot tell: :mod:`pouring_robot.estimation.identifiability`.
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
from pouring_robot.io.given import Options, whole
from pouring_robot.mechanism.arrays import FloatArray, Indices, finite
from pouring_robot.robot.model import RobotModel

_NOISE_ROUNDS, _NOISE_SETTLED = 12, 0.01
"""Of n equations the noise is known to 1 / sqrt(2 n): closer than 1 % only of more than 5000. Rounds are cheap, as each
begins where the one before ended, so that even a noise that creeps settles."""


def campaign_and_model(
    campaign: Campaign | Path | str, model: RobotModel | Path | str | None
) -> tuple[Campaign, RobotModel]:
    """Return a campaign, read if need be, and the robot it is compared with: by default the drawing of its own.

    Raises:
        BadInputError: they are of two robots, or something else.
        CampaignError, DescriptionError: a file of theirs is wrong.
    """
    if model is None and isinstance(campaign, Campaign) and campaign.robot.name != RobotModel().definition.name:
        model = RobotModel.for_robot(campaign.robot)
    model = RobotModel.of(model)
    return Campaign.of(campaign, model.definition), model


def seen_from_one_place(campaign: Campaign, model: RobotModel) -> Campaign:
    """Return a campaign seen from one place in all sessions, by the present robot; raises as :func:`in_one_frame`."""
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
    curvature: bool = False  # whether the covariance has second derivatives in it; about a prediction a parameter more

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.max_evaluations, 1, "evaluations of a fit are a number of them, from 1 on")
        said = f"the step that ends a fit is longer than 0, in standard deviations, not {self.step_tolerance}"
        if finite(self.step_tolerance, (), said) <= 0.0:
            raise BadInputError(said)


@dataclass(frozen=True, eq=False)
class Fit:
    """What was found."""

    unknowns: Unknowns  # the most probable values
    covariance: FloatArray  # of all unknowns given data and tolerances, shape (12 + P, 12 + P), in m and rad
    prior_std: FloatArray  # shape (12 + P,), in m and rad
    equations: WhitenedEquations  # whitened residuals and Jacobian at the answer
    weights: FloatArray  # of each equation by the robust loss, shape (m,)
    shares: FloatArray  # of each, what noise makes of its squared weighted residual on average, shape (m,)
    evaluations: int  # how many times all rows were predicted in the search
    second_evaluations: int  # how many times they were to measure second derivatives
    last_step: float  # length of the step not taken any more, in standard deviations of the answer
    converged: bool  # whether that is below the tolerance; else the search ended at its limit
    noise: NoiseLevel = field(default_factory=lambda: NoiseLevel({}))  # what tells it; nothing: it is stated
    stretches: tuple[Indices, ...] = ()  # rows of the fit that were measured one after the other, by index

    @property
    def std(self) -> FloatArray:
        """Standard deviations of all unknowns, shape (12 + P,), in m and rad."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def learnt(self) -> FloatArray:
        """Share of each unknown's prior variance that the data take away under the noise as given, (12 + P,)."""
        return np.asarray(1.0 - np.diagonal(self.covariance) / self.prior_std**2)

    @functools.cached_property
    def leverage(self) -> FloatArray:
        """Share of each equation that the fit used up, shape (m,): diagonal of the hat matrix."""
        rows = self.equations.derivatives
        return np.asarray(((rows @ self.covariance) * rows).sum(axis=1) * self.weights)

    @property
    def left_over(self) -> tuple[FloatArray, FloatArray]:
        """Weighted residuals over their noise, (m,), and of each how much is left for the noise, (m,)."""
        return self.weights * self.equations.residual, self.shares - self.leverage

    def dof(self) -> float:
        """Return the equations left over for the noise."""
        return float(self.left_over[1].sum())

    def chi_square(self) -> float:
        """Return the sum of squared weighted residuals over their noise."""
        return float(np.square(self.left_over[0]).sum())

    def noise_ratio(self) -> float:
        """Return the noise that the residuals show over the one assumed."""
        return noise_ratio(*self.left_over)

    @property
    def inflation(self) -> float:
        """By how much residuals exceed the noise where that is no accident, or 1: as large it counts in deviations."""
        larger = self.noise_ratio()
        if larger <= 1.0:  # as with nothing left over
            return 1.0
        chance = self.noise.lack_of_fit_p(self.chi_square(), self.dof(), float(self.shares.mean()))
        return larger if chance < FALSE_ALARMS else 1.0

    @property
    def interval_dof(self) -> float:
        """Degrees of freedom that tell the standard deviations: those of the noise, unless residuals enlarge them."""
        return self.noise.dof if self.inflation == 1.0 else math.inf

    @property
    def inflated_covariance(self) -> FloatArray:
        """Covariance of all unknowns under the inflated noise, (12 + P, 12 + P), in m and rad.

        What data tell, C^-1 - P^-1, counts by the inflation less; the tolerances P hold as before.
        """
        more, share = self.inflation**2 - 1.0, self.covariance / self._scale
        return np.asarray(self._scale * (1.0 + more) * np.linalg.solve(np.eye(len(share)) + more * share, share))

    @property
    def scattered_covariance(self) -> FloatArray:
        """The same by how far stretches of rows scatter the answer, see :mod:`~.jackknife`."""
        equations, root = self.equations, np.sqrt(self.weights)
        rows, left = root[:, None] * equations.derivatives * self.prior_std, root * equations.residual
        blocks = [own for stretch in self.stretches if (own := np.isin(equations.rows, stretch)).any()]
        parts, place = ((rows[block], left[block]) for block in blocks), self.unknowns.values / self.prior_std
        return np.asarray(self._scale * jackknife_covariance(parts, place, dof=self.interval_dof))

    @functools.cached_property
    def covariances(self) -> tuple[FloatArray, ...]:
        """Those of which users are told what :func:`~.intervals.largest_std` takes from them.

        Where more may be left than noise, stretches of rows are asked, too: what a model lacks hangs together in them.
        """
        unsure = self.noise.from_residuals or self.inflation > 1.0
        asked = unsure and len(self.stretches) > 1
        return (self.inflated_covariance, self.scattered_covariance) if asked else (self.inflated_covariance,)

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
    """Find the most probable unknowns of what was measured of rows; prior means are 0.

    The frames of ``start`` are near the answer (see :mod:`~.first_frames`); ``prior_std`` are those of all unknowns,
    shape (12 + P,), in m and rad.

    Raises:
        CalibrationError: too few rows can be used, or the search ends far from an answer.
        BadInputError: a shape does not fit.
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
    """Return the noise, what is unknown of it taken from what a fit with it leaves over, until both agree within 1 %.

    Where they do not before the rounds end, it is not ``settled``. Raises as :func:`identify`.
    """
    for _ in range(_NOISE_ROUNDS):
        fit = identify(rows, measured.with_noise(noise), start, prior_std, options)
        noise, assumed = noise.from_left_over(noise.open_kinds, fit.equations.components, *fit.left_over), noise
        if noise.apart(assumed) < _NOISE_SETTLED:
            return noise
        start = fit.unknowns
    return replace(noise, settled=False)
