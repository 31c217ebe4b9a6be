r"""Identification: the most probable unknowns given the measurements and the tolerances (MAP).

Minimised is

.. math:: \sum_b \rho(s_b) + \sum_k (x_k / \sigma_k)^2, \quad s_b^2 = \sum_{c \in b} (r_c / \sigma_c)^2

where a block b is the position or the rotation of one row: one slip spoils all three coordinates. The robust loss is
quadratic up to the bound that 99 % of sound blocks keep, widened while the median block is larger than noise makes it
(far from the answer, or where the model lacks something). How it is searched:
:mod:`pouring_robot.estimation.levenberg_marquardt`.
"""

import functools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import scipy.special
from scipy.spatial.transform import Rotation

from pouring_robot.batch import BatchClosure
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.fit_priors import FRAME_STD
from pouring_robot.estimation.frames.fit import fit_frames
from pouring_robot.estimation.frames.outer import FRAMES, OuterFrames
from pouring_robot.estimation.frames.sessions import in_one_frame
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES
from pouring_robot.estimation.kinds import are
from pouring_robot.estimation.levenberg_marquardt import Search
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Prediction, Unknowns
from pouring_robot.estimation.noise import NoiseLevel, scatter
from pouring_robot.estimation.residuals import MeasuredPoses, WhitenedEquations, whiten
from pouring_robot.estimation.robust import Loss, noise_shares
from pouring_robot.exceptions import BadInputError, FrameFitError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel

_STEPS, _SETTLED, _LEAST_DAMPING, _MOST_DAMPING = 60, 1e-9, 1e-9, 1e6
_SURE = 1e-3  # chance at which residuals count as larger than the noise
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
    """Return a campaign whose sessions all measure from one place, by the present robot; see ``in_one_frame``.

    Raises:
        CampaignError: a session has too few whole positions to tell where it measured from.
    """
    if not campaign.metadata.own_frames:
        return campaign
    closure = MeasurementModel(model, ()).at(campaign.drives).present()
    return in_one_frame(campaign, PoseStack(closure.position, closure.rotation))


def first_frames(rows: ModelledRows, measured: MeasuredPoses) -> Unknowns:
    """Return where to start: both outer frames fitted robustly to the present robot, all parameters zero.

    Where too few rows have a complete position, single coordinates and distances serve; without any, there are no
    frames, and they stay at one. Raises FrameFitError if something was measured of places, but of too few rows.
    """
    closure = rows.present()
    poses = PoseStack(closure.position, closure.rotation)
    whole = int((poses.complete & np.isfinite(measured.position_m).all(axis=1)).sum())
    if whole < FEWEST_FOR_FRAMES and not measured.framed:
        frames = OuterFrames(pin.SE3.Identity(), pin.SE3.Identity())
    elif whole < FEWEST_FOR_FRAMES:
        frames = _searched_frames(measured, closure)
    else:
        scale = measured.sigma_position_m / measured.sigma_rotation_rad
        frames = fit_frames(poses, measured.position_m, measured.rotation, scale).frames
    return Unknowns.zero(frames, len(rows.model.parameters) + len(rows.model.sessions))


def _searched_frames(measured: MeasuredPoses, closure: BatchClosure) -> OuterFrames:
    """Return the frames that fit best to whatever was measured of places: coordinates, distances, a few positions.

    Least squares from many starts, of the present robot: the 24 ways of laying axes along axes, each shifted so that
    what coordinates there are agree on average; for distances, to all sides of the device at the mean distance. Frames
    that the data leave open stay near their start.
    """
    seen = measured.known[:, : FRAMES // 2 + 1]
    told = seen.any(axis=1) & closure.closed
    places = told & seen[:, ~are("rotation", np.arange(seen.shape[1]))].any(axis=1)
    if told.sum() < FEWEST_FOR_FRAMES or not places.any():
        raise FrameFitError(int(places.sum()), FEWEST_FOR_FRAMES)
    found = [_refined(measured, closure, start) for start in _starts(measured, closure)]
    return min(found, key=lambda one: one[0])[1]


def _starts(measured: MeasuredPoses, closure: BatchClosure) -> list[OuterFrames]:
    places = np.nanmean(closure.position, axis=0)
    known = np.isfinite(measured.position_m)
    seen = np.where(known, measured.position_m, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    sides = np.zeros((1, 3))
    if not known.any():
        residual = measured.residual(Prediction.of(closure, OuterFrames(pin.SE3.Identity(), pin.SE3.Identity())))
        away = np.nanmean(residual[:, FRAMES // 2] + np.linalg.norm(closure.position, axis=1))
        sides = away * np.concatenate([np.eye(3), -np.eye(3)])
    turns = Rotation.create_group("O").as_matrix()
    return [
        OuterFrames(pin.SE3(turn, seen + side - turn @ places), pin.SE3.Identity()) for turn in turns for side in sides
    ]


def _refined(measured: MeasuredPoses, closure: BatchClosure, frames: OuterFrames) -> tuple[float, OuterFrames]:
    """Run Levenberg-Marquardt; return the sum of squares and the frames."""
    equations, damping = _equations(measured, closure, frames), 1e-3
    cost = float(equations.residual @ equations.residual)
    for _ in range(_STEPS):
        jacobian = equations.derivatives
        normal = jacobian.T @ jacobian
        # Also of directions of which nothing is told, where round-off would choose the step.
        hold = (damping * np.trace(normal) / FRAMES + FRAME_STD**-2) * np.eye(FRAMES)
        step: FloatArray = -np.linalg.solve(normal + hold, jacobian.T @ equations.residual)
        moved = frames.moved(step)
        trial = _equations(measured, closure, moved)
        better = float(trial.residual @ trial.residual)
        if better < cost:
            frames, equations, cost, damping = moved, trial, better, max(0.1 * damping, _LEAST_DAMPING)
        else:
            damping *= 10.0
        if np.abs(step).max() < _SETTLED or damping > _MOST_DAMPING:
            break
    return cost, frames


def _equations(measured: MeasuredPoses, closure: BatchClosure, frames: OuterFrames) -> WhitenedEquations:
    seen, gap = Prediction.of(closure, frames), closure.disagreement
    redundant = np.zeros((*gap.shape, FRAMES)) if gap.size else None
    return whiten(measured, replace(seen, jacobian=frames.jacobian(seen.poses), disagreement=redundant))


@dataclass(frozen=True)
class FitOptions:
    """How to search."""

    loss: Loss = "huber"  # ``huber``, ``soft_l1`` or ``linear`` (no robustness)
    max_evaluations: int = 200  # how many times all rows may be predicted
    step_tolerance: float = 0.03  # the search ends when a step is shorter, in standard deviations of the answer
    curvature: bool = False  # whether the covariance has second derivatives in it; about a prediction a parameter more


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

    @property
    def std(self) -> FloatArray:
        """Standard deviations of all unknowns, shape (12 + P,), in m and rad."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def learnt(self) -> FloatArray:
        """Share of each unknown's prior variance that the data took away, shape (12 + P,), 0 to 1."""
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

    def freedom(self) -> float:
        """Return the equations left over for the noise."""
        return float(self.left_over[1].sum())

    def chi_square(self) -> float:
        """Return the sum of squared weighted residuals over their noise."""
        return float(np.square(self.left_over[0]).sum())

    def scatter(self) -> float:
        """Return the noise that the residuals show over the one assumed."""
        return scatter(*self.left_over)

    @property
    def inflation(self) -> float:
        """Factor on all standard deviations: by how much residuals exceed the noise where that is no accident, or 1."""
        freedom = self.freedom()
        accident = freedom <= 1.0 or scipy.special.chdtrc(freedom, self.chi_square()) >= _SURE
        return 1.0 if accident else self.scatter()


def identify(
    rows: ModelledRows,
    measured: MeasuredPoses,
    start: Unknowns,
    prior_std: FloatArray,
    options: FitOptions | None = None,
) -> Fit:
    """Find the most probable unknowns of what was measured of rows; prior means are 0.

    The frames of ``start`` are near the answer (see :func:`first_frames`); ``prior_std`` are those of all unknowns,
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


def noise_left_over(
    rows: ModelledRows,
    measured: MeasuredPoses,
    start: Unknowns,
    prior_std: FloatArray,
    noise: NoiseLevel,
    options: FitOptions | None = None,
) -> NoiseLevel:
    """Return the noise, what is unknown of it taken from what a fit with it leaves over, until both agree within 1 %.

    Raises as :func:`identify`.
    """
    for _ in range(_NOISE_ROUNDS):
        fit = identify(rows, measured.with_noise(noise), start, prior_std, options)
        noise, assumed = noise.left_over(noise.open_kinds, fit.equations.components, *fit.left_over), noise
        if noise.apart(assumed) < _NOISE_SETTLED:
            break
        start = fit.unknowns
    return noise
