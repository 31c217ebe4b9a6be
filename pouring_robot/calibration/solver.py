r"""Identification: the most probable unknowns given the measurements and the tolerances (MAP).

Minimised is

.. math:: \sum_b \rho(s_b) + \sum_k (x_k / \sigma_k)^2, \quad s_b^2 = \sum_{c \in b} (r_c / \sigma_c)^2

where a block b is the position or the rotation of one row: one slip spoils all three coordinates. The robust loss is
quadratic up to the bound that 99 % of sound blocks keep. Levenberg-Marquardt on iteratively reweighted equations, with
the analytic Jacobian; every variable is counted in its prior's standard deviation, so the prior is the unit matrix.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg
import scipy.stats
from numpy.typing import NDArray

from pouring_robot.calibration.measurement import FRAMES, ModelledRows, Prediction, Unknowns
from pouring_robot.calibration.residuals import MeasuredPoses, WhitenedEquations, whiten
from pouring_robot.exceptions import BadInputError, CalibrationError
from pouring_robot.mechanism import FloatArray

Loss = Literal["huber", "soft_l1", "linear"]
_SOUND_SHARE = 0.99
_FEWEST_ROWS = 6
# From which step length on (standard deviations of the answer) steps are lengthened, and by how much at most.
_LATE, _LONGEST_STRIDE = 10.0, 5.0
# After so many evaluations without an answer second derivatives are measured, and again after as many more.
_PATIENCE = 10
# Along combinations that the data hold this much firmer than the tolerances, second derivatives do not count.
_FIRM = 100.0
_NUDGE, _LEAST_CURVATURE = 0.02, 0.1
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-6, 1e-9, 1e8


@dataclass(frozen=True)
class FitOptions:
    """How to search.

    Attributes:
        loss: ``huber``, ``soft_l1`` or ``linear`` (no robustness).
        max_evaluations: how many times all rows may be predicted.
        step_tolerance: the search ends when a step is shorter than this in standard deviations of the answer.
    """

    loss: Loss = "huber"
    max_evaluations: int = 30
    step_tolerance: float = 0.01


@dataclass(frozen=True, eq=False)
class Fit:
    """What was found.

    Attributes:
        unknowns: the most probable values.
        covariance: of all unknowns given data and tolerances, shape (12 + P, 12 + P), in m and rad.
        prior_std: shape (12 + P,), in m and rad.
        equations: whitened residuals and Jacobian at the answer.
        weights: of each equation by the robust loss, shape (m,).
        prediction: of all rows at the answer.
        evaluations: how many times all rows were predicted in the search.
        second_evaluations: how many times they were to measure second derivatives; 0 where the search did without.
        cost: the minimum.
        failed: rows that were measured but do not close; they took no part.
    """

    unknowns: Unknowns
    covariance: FloatArray
    prior_std: FloatArray
    equations: WhitenedEquations
    weights: FloatArray
    prediction: Prediction
    evaluations: int
    second_evaluations: int
    cost: float
    failed: NDArray[np.intp]

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
        if self.equations.jacobian is None:
            raise BadInputError("a fit holds its Jacobian")
        rows = self.equations.jacobian
        return np.asarray(((rows @ self.covariance) * rows).sum(axis=1) * self.weights)

    def freedom(self, rotation: bool | None = None) -> float:
        """Return the equations left over for the noise: all, or those of positions or rotations only."""
        chosen = self._chosen(rotation)
        return float((self.weights - self.leverage)[chosen].sum())

    def chi_square(self, rotation: bool | None = None) -> float:
        """Return the weighted sum of squared whitened residuals: of all, or of positions or rotations only."""
        chosen = self._chosen(rotation)
        return float((self.weights * self.equations.residual**2)[chosen].sum())

    def _chosen(self, rotation: bool | None) -> NDArray[np.bool_]:
        if rotation is None:
            return np.ones(len(self.weights), dtype=bool)
        return np.asarray((self.equations.components >= 3) == rotation)


@functools.cache
def _bound(components: int) -> float:
    return float(np.sqrt(scipy.stats.chi2.ppf(_SOUND_SHARE, components)))


def _blocks(equations: WhitenedEquations) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.intp]]:
    """Return the block of each equation, and of each block its squared size and number of components."""
    blocks = 2 * equations.rows + (equations.components >= 3)
    length = int(blocks.max()) + 1 if blocks.size else 0
    squared = np.bincount(blocks, equations.residual**2, minlength=length).astype(np.float64)
    return blocks, squared, np.bincount(blocks, minlength=length)


def scatter(equations: WhitenedEquations) -> float:
    """Return the median size of the blocks over what noise makes it, at least 1."""
    _, squared, counts = _blocks(equations)
    median = np.array([scipy.stats.chi2.ppf(0.5, k) if k else 1.0 for k in range(4)])
    kept = counts > 0
    return max(1.0, float(np.sqrt(np.median(squared[kept] / median[counts[kept]])))) if kept.any() else 1.0


def robust_terms(equations: WhitenedEquations, loss: Loss, widened: float = 1.0) -> tuple[float, FloatArray]:
    """Return the summed loss, and the weight of each equation, shape (m,).

    Args:
        equations: of a prediction.
        loss: which one.
        widened: factor on the bound up to which the loss is quadratic.

    Raises:
        BadInputError: there is no such loss.
    """
    blocks, squared, counts = _blocks(equations)
    length = counts.size
    bound = widened * np.array([_bound(k) if k else 1.0 for k in range(4)])[counts]
    size = np.sqrt(squared)
    if loss == "linear":
        cost, weight = squared, np.ones(length)
    elif loss == "huber":
        cost = np.where(size <= bound, squared, 2.0 * bound * size - bound**2)
        weight = bound / np.maximum(size, bound)
    elif loss == "soft_l1":
        root = np.sqrt(1.0 + squared / bound**2)
        cost, weight = 2.0 * bound**2 * (root - 1.0), 1.0 / root
    else:
        raise BadInputError(f"there is no loss '{loss}'; use huber, soft_l1 or linear")
    return float(cost.sum()), weight[blocks]


class _Search:
    """Levenberg-Marquardt; the state is the best point so far, in the normal equations of prior-scaled variables."""

    def __init__(
        self, rows: ModelledRows, measured: MeasuredPoses, start: Unknowns, prior_std: FloatArray, loss: Loss
    ) -> None:
        self.rows, self.measured, self.prior_std, self.loss = rows, measured, prior_std, loss
        self.evaluations = 0
        prediction = self._predict(start)
        equations = whiten(measured, prediction)
        self.failed = equations.failed
        used = np.unique(equations.rows).size
        if equations.rows.size <= FRAMES or used < _FEWEST_ROWS:
            raise CalibrationError(
                f"only {used} of {len(rows)} rows can be used ({self.failed.size} do not close)",
                "measure more poses, or check drive values and model file",
            )
        self.second: FloatArray = np.zeros((start.values.size, start.values.size))
        self.second_evaluations = 0
        self._take(start, prediction)

    def _predict(self, unknowns: Unknowns) -> Prediction:
        self.evaluations += 1
        return self.rows.predict(unknowns)

    def _cost(self, unknowns: Unknowns, equations: WhitenedEquations) -> float:
        cost, _ = robust_terms(equations, self.loss, self.widened)
        return cost + float(((unknowns.values / self.prior_std) ** 2).sum())

    def _take(self, unknowns: Unknowns, prediction: Prediction) -> None:
        self.unknowns = unknowns
        self.prediction = self.rows.differentiate(unknowns, prediction)
        self.equations = whiten(self.measured, self.prediction)
        if self.equations.jacobian is None:
            raise BadInputError("a linearised prediction holds its Jacobian")
        self.widened = scatter(self.equations)
        self.cost = self._cost(unknowns, self.equations)
        _, self.weights = robust_terms(self.equations, self.loss, self.widened)
        weighted = np.sqrt(self.weights)[:, None] * self.equations.jacobian * self.prior_std
        place = unknowns.values / self.prior_std
        self.hessian = weighted.T @ weighted + np.eye(place.size)
        self.scaled = self.equations.jacobian * self.prior_std
        self.gradient = weighted.T @ (np.sqrt(self.weights) * self.equations.residual) + place

    def step(self, damping: float) -> FloatArray:
        """Return the damped step in standard deviations of the prior."""
        # Columns differ by decades (frames against axes), so damping goes with their lengths.
        hessian = self.hessian + self.second
        factor = scipy.linalg.cho_factor(hessian + damping * np.diag(np.diagonal(hessian)))
        return np.asarray(-scipy.linalg.cho_solve(factor, self.gradient))

    def try_step(self, step: FloatArray) -> bool:
        """Go a step if that lowers the cost; widen the bound by what is left there."""
        unknowns = self.unknowns.at(self.unknowns.values + self.prior_std * step)
        prediction = self._predict(unknowns)
        equations = whiten(self.measured, prediction)
        if not set(equations.failed.tolist()) <= set(self.failed.tolist()):
            return False  # the step bends the robot so far that rows which closed do not
        if not self._cost(unknowns, equations) <= self.cost * (1.0 + 1e-10):
            return False
        self._take(unknowns, prediction)
        return True

    def length(self, step: FloatArray) -> float:
        """Return a step's length in standard deviations of the answer, as the scatter of the rows has them."""
        return float(np.sqrt(max(float(step @ self.hessian @ step), 0.0))) / self.widened

    def measure_second(self) -> None:
        """Measure the second derivatives Σ r ∂²r that Gauss-Newton leaves out, where they count.

        Errors that act by their products bend the valley of the cost; along combinations that tolerances alone hold
        (weak axes of the Hessian) that is as much as the Hessian itself. There the Jacobian is taken a nudge aside.
        """
        firmness, axes = np.linalg.eigh(self.hessian)
        weak = firmness < _FIRM
        axes, firmness = axes[:, weak], firmness[weak]
        pull = self.weights * self.equations.residual
        change = np.zeros_like(axes)
        for k, axis in enumerate(axes.T):
            nudge = _NUDGE / float(np.abs(axis).max())
            aside = self.unknowns.at(self.unknowns.values + nudge * self.prior_std * axis)
            jacobian = whiten(self.measured, self.rows.linearise(aside)).jacobian
            self.second_evaluations += 1
            if jacobian is not None and jacobian.shape == self.scaled.shape:
                change[:, k] = (jacobian * self.prior_std - self.scaled).T @ pull / nudge
        block = axes.T @ change
        curvature, turn = np.linalg.eigh(np.diag(firmness) + 0.5 * (block + block.T))
        curvature = np.maximum(np.abs(curvature), _LEAST_CURVATURE)  # a saddle is left along it, not sought
        axes_of = axes @ turn
        self.second = (axes_of * curvature) @ axes_of.T - (axes * firmness) @ axes.T

    def stride(self, step: FloatArray, last: FloatArray, stride: float) -> float:
        """Return by how much to lengthen a step.

        Gauss-Newton leaves out second derivatives, so that near the answer steps shrink by a steady ratio r. Were all
        of one direction, a step longer by 1 / (1 - r) would end there (Aitken).
        """
        size = float(last @ self.hessian @ last)
        if size == 0.0 or self.length(step) > _LATE:
            return 1.0
        ratio = float(step @ self.hessian @ last) / size
        return float(np.clip(stride / max(1.0 - ratio, 1e-3), 0.5, _LONGEST_STRIDE))

    def covariance(self) -> FloatArray:
        """Return the covariance of all unknowns, in m and rad."""
        factor = scipy.linalg.cho_factor(self.hessian + self.second)
        inverse = scipy.linalg.cho_solve(factor, np.eye(len(self.gradient)))
        return np.asarray(self.prior_std[:, None] * 0.5 * (inverse + inverse.T) * self.prior_std)


def identify(
    rows: ModelledRows,
    measured: MeasuredPoses,
    start: Unknowns,
    prior_std: FloatArray,
    options: FitOptions | None = None,
) -> Fit:
    """Find the most probable unknowns.

    Args:
        rows: what was commanded.
        measured: what was seen.
        start: frames near the answer (see :func:`~pouring_robot.calibration.frames.first_frames`); prior means are 0.
        prior_std: of all unknowns, shape (12 + P,), in m and rad.
        options: loss and limits.

    Raises:
        CalibrationError: too few rows can be used, or the search does not converge.
        BadInputError: a shape does not fit.
    """
    options = options or FitOptions()
    if prior_std.shape != start.values.shape or not (np.isfinite(prior_std) & (prior_std > 0.0)).all():
        raise BadInputError(f"the prior needs {start.values.size} positive standard deviations")
    search = _Search(rows, measured, start, prior_std, options.loss)
    damping = 0.0  # the problem is nearly linear: Gauss-Newton until a step fails
    stride, last, patience = 1.0, np.zeros_like(search.gradient), _PATIENCE
    while True:
        if search.evaluations >= patience and damping == 0.0:
            search.measure_second()
            stride, last, patience = 1.0, np.zeros_like(last), search.evaluations + _PATIENCE
        step = search.step(damping)
        stride = search.stride(step, last, stride) if damping == 0.0 else 1.0
        short = search.length(step) < options.step_tolerance
        if short and damping == 0.0:
            break
        if search.evaluations >= options.max_evaluations or damping > _MOST_DAMPING:
            raise CalibrationError(
                f"the fit does not converge in {search.evaluations} evaluations (last step "
                f"{search.length(step):.1e} standard deviations)",
                "check the campaign with `pouring-robot campaign check`, or identify fewer parameters",
            )
        if search.try_step(stride * step):
            last = step
            damping = damping / 10.0 if damping > _LEAST_DAMPING else 0.0
        elif short:
            break  # what is left is round-off of the closure
        elif stride != 1.0:
            stride, last = 1.0, np.zeros_like(step)
        else:
            damping = max(damping * 10.0, _FIRST_DAMPING)
    return Fit(
        search.unknowns,
        search.covariance(),
        prior_std,
        search.equations,
        search.weights,
        search.prediction,
        search.evaluations,
        search.second_evaluations,
        search.cost,
        search.failed,
    )
