"""Levenberg-Marquardt for curved valleys, on iteratively reweighted equations with the analytic Jacobian.

Each variable is divided by its prior's standard deviation, so the prior is the unit matrix. Axis errors interact, and
an error without a first-order effect on the pose may have one of second order: along combinations that the data
determine weakly the cost is a curved valley, where plain Gauss-Newton converges slowly. Three things help, in this
order: a correction that leads a step back to the valley's floor, lengthening of steps by the ratio in which the last
ones shrank, and damping in the metric of the tolerances (which shortens steps along the valley and leaves the others).
Second derivatives are measured at the solution, for its covariance; measured on the way they cost more than the steps
they saved: calibrations of the pouring robot and of the hexapod took 1.5 and 4 times as long.

scipy.optimize.least_squares needs 7 to 17 evaluations for 57 parameters from 40 poses (six robots, to 1e-6 of the cost)
where this needs 4 to 14 (nine robots), and its losses judge coordinates, not rows.
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg

from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES
from pouring_robot.estimation.measurement import ModelledRows, Prediction, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses, WhitenedEquations, whiten
from pouring_robot.estimation.robust import Loss, robust_terms, typical_size
from pouring_robot.exceptions import CalibrationError
from pouring_robot.mechanism.arrays import FloatArray

# Steps shorter than this (standard deviations of the answer) are lengthened, and by how much at most.
_LATE, _LONGEST_STRIDE = 10.0, 5.0
_AS_EXPECTED = 0.25  # share of the expected gain below which a step has left the valley
# Along combinations that the data hold this much more firmly than the tolerances, second derivatives do not count.
_FIRM = 100.0
# A search that ends at its limit is usable if its last step is no longer than this (standard deviations).
_USABLE = 1.0
# With residuals this many times the noise, the stated noise is one that no model of the robot reaches.
_FAR_OFF = 10.0
_NUDGE, _LEAST_CURVATURE = 0.02, 0.3
# Damping is in units of the priors: 1 holds a step as firmly as the tolerances do.
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1.0, 0.1, 1e16
_HARDER, _SOFTER = 4.0, 0.2


class Trial(NamedTuple):
    """A point that was tried, the weights of its equations, and its cost."""

    unknowns: Unknowns
    prediction: Prediction
    equations: WhitenedEquations
    weights: FloatArray
    cost: float


class Search:
    """A search whose state is the best point so far, as normal equations of prior-scaled variables.

    It begins at ``start``; ``prior_std`` are those of all unknowns, (12 + P,), in m and rad. Raises CalibrationError if
    too few rows can be used.
    """

    def __init__(
        self, rows: ModelledRows, measured: MeasuredPoses, start: Unknowns, prior_std: FloatArray, loss: Loss
    ) -> None:
        self.rows, self.measured, self.prior_std, self.loss = rows, measured, prior_std, loss
        self.evaluations = 0
        prediction = self._predict(start)
        equations = whiten(measured, prediction)
        used = np.unique(equations.rows).size
        if equations.rows.size <= FRAMES or used < FEWEST_FOR_FRAMES:
            raise CalibrationError(
                f"only {used} of {len(rows)} rows can be used ({equations.failed.size} do not close)",
                "measure more poses, or check drive values and model file",
            )
        self.second_evaluations = 0
        self._take(start, prediction)

    def run(self, tolerance: float, most_evaluations: int) -> float:
        """Search, and return the length of the next step, which is not taken, in standard deviations of the answer.

        The search ends when a step is shorter than ``tolerance``, or all rows were predicted ``most_evaluations``
        times; raises CalibrationError if that is far from an answer.
        """
        damping = 0.0  # the problem is nearly linear: Gauss-Newton until a step fails
        stride, last = 1.0, np.zeros_like(self.gradient)
        while True:
            step = self.step(damping)
            stride = self.stride(step, last, stride) if damping == 0.0 else 1.0
            length = self.length(step)
            if length < tolerance and damping == 0.0:
                return length
            if self.evaluations >= most_evaluations or damping > _MOST_DAMPING:
                if length <= _USABLE:
                    return length
                searched = f"{self.evaluations} evaluations (last step {length:.1e} standard deviations)"
                raise CalibrationError(f"the fit does not converge in {searched}", self._mend())
            if self.try_step(stride * step):
                last = step
                damping = damping * _SOFTER if damping > _LEAST_DAMPING else 0.0
            elif length < tolerance:
                return length  # what remains is round-off of the closure
            elif stride != 1.0:
                stride, last = 1.0, np.zeros_like(step)
            else:
                damping = max(damping * _HARDER, _FIRST_DAMPING)

    def _mend(self) -> str:
        """Return what to do about a search that does not converge."""
        if self.widened > _FAR_OFF:
            return (
                f"residuals are {self.widened:.0f} times the noise: state a noise that the model can reach "
                "(sigma_position_mm, sigma_rotation_mrad … under metrology in the campaign's YAML), or diagnose first "
                "what the model lacks"
            )
        return "check the campaign with `pouring-robot campaign check`, or identify fewer parameters"

    def _predict(self, unknowns: Unknowns) -> Prediction:
        self.evaluations += 1
        return self.rows.predict(unknowns)

    def _judged(self, unknowns: Unknowns, equations: WhitenedEquations) -> tuple[FloatArray, float]:
        cost, weights = robust_terms(equations, self.loss, self.widened)
        return weights, cost + float(((unknowns.values / self.prior_std) ** 2).sum())

    def _take(self, unknowns: Unknowns, prediction: Prediction) -> None:
        self.unknowns = unknowns
        self.equations = whiten(self.measured, self.rows.differentiate(unknowns, prediction))
        self.widened = typical_size(self.equations)
        self.weights, self.cost = self._judged(unknowns, self.equations)
        self.scaled = self.equations.derivatives * self.prior_std
        weighted = np.sqrt(self.weights)[:, None] * self.scaled
        place = unknowns.values / self.prior_std
        self.gradient = weighted.T @ (np.sqrt(self.weights) * self.equations.residual) + place
        # The Hessian is its square. By QR, as in squares the prior's 1 would be lost in the round-off of exact data.
        self.triangle = _triangle(weighted, np.eye(place.size))

    def step(self, damping: float) -> FloatArray:
        """Return the damped step in standard deviations of the prior."""
        factor = self.triangle
        if damping > 0.0:
            # Products of errors bend the valley, so steps must be short in the metric of the tolerances, where weakly
            # determined combinations move far; well determined ones are hardly damped.
            factor = _triangle(factor, np.sqrt(damping) * np.eye(len(factor)))
        return -_solve(factor, self.gradient)

    def try_step(self, step: FloatArray) -> bool:
        """Take a step if that lowers the cost; the loss's bound is then widened by the residuals there.

        The valley of the cost is curved where products of errors have an effect. Where a step leaves it, a second one
        with the same Jacobian leads back to its floor (second-order correction), and both together are the step.
        """
        trial = self._trial(step)
        if trial is not None and trial.cost > self.cost - _AS_EXPECTED * self.length(step) ** 2:
            slope = self.scaled.T @ (trial.weights * trial.equations.residual) + trial.unknowns.values / self.prior_std
            better = self._trial(step - _solve(self.triangle, slope))
            trial = better if better is not None and better.cost < trial.cost else trial
        if trial is None or not trial.cost <= self.cost * (1.0 + 1e-10):
            return False
        self._take(trial.unknowns, trial.prediction)
        return True

    def _trial(self, step: FloatArray) -> Trial | None:
        """Return the point that a step leads to; None where it is so far that rows no longer close."""
        unknowns = self.unknowns.at(self.unknowns.values + self.prior_std * step)
        prediction = self._predict(unknowns)
        equations = whiten(self.measured, prediction)
        if equations.rows.size < self.weights.size:
            return None
        return Trial(unknowns, prediction, equations, *self._judged(unknowns, equations))

    def length(self, step: FloatArray) -> float:
        """Return a step's length in standard deviations of the answer, by the scatter of the rows."""
        return float(np.linalg.norm(self.triangle @ step)) / self.widened

    def _curved(self) -> FloatArray:
        """Return the upper triangle with the second derivatives Σ r ∂²r that Gauss-Newton omits, where they matter.

        Products of errors bend the valley of the cost; along combinations that tolerances alone hold (weak axes of the
        Hessian) this is as much as the Hessian itself. There the Jacobian is evaluated again at a small distance.
        """
        _, singular, right = np.linalg.svd(self.triangle)
        weak = singular**2 < _FIRM
        axes, firmness = right[weak].T, singular[weak] ** 2
        pull = self.weights * self.equations.residual
        change = np.zeros_like(axes)
        for k, axis in enumerate(axes.T):
            nudge = _NUDGE / float(np.abs(axis).max())
            aside = self.unknowns.at(self.unknowns.values + nudge * self.prior_std * axis)
            jacobian = whiten(self.measured, self.rows.linearise(aside)).derivatives
            self.second_evaluations += 1
            if jacobian.shape == self.scaled.shape:
                change[:, k] = (jacobian * self.prior_std - self.scaled).T @ pull / nudge
        block = axes.T @ change
        curvature, turn = np.linalg.eigh(np.diag(firmness) + 0.5 * (block + block.T))
        curvature = np.maximum(np.abs(curvature), _LEAST_CURVATURE)  # a covariance needs them all positive
        principal = axes @ turn
        firm = self.triangle - (self.triangle @ axes) @ axes.T
        return _triangle(firm, (principal * np.sqrt(curvature)).T)

    def stride(self, step: FloatArray, last: FloatArray, stride: float) -> float:
        """Return the factor by which to lengthen a step.

        Gauss-Newton omits second derivatives, so near the answer steps shrink by a constant ratio r. If all had the
        same direction, a step longer by 1 / (1 - r) would end there (Aitken).
        """
        before, now = self.triangle @ last, self.triangle @ step
        size = float(before @ before)
        if size == 0.0 or self.length(step) > _LATE:
            return 1.0
        ratio = float(now @ before) / size
        return float(np.clip(stride / max(1.0 - ratio, 1e-3), 0.5, _LONGEST_STRIDE))

    def covariance(self, *, curved: bool = False) -> FloatArray:
        """Return the covariance of all unknowns, in m and rad; ``curved`` with second derivatives measured here."""
        factor = self._curved() if curved else self.triangle
        inverse = scipy.linalg.solve_triangular(factor, np.eye(len(self.gradient)))
        return np.asarray(self.prior_std[:, None] * (inverse @ inverse.T) * self.prior_std)


def _triangle(upper: FloatArray, lower: FloatArray) -> FloatArray:
    """Return the upper triangle whose square is the sum of two matrices' squares (A.T @ A)."""
    (triangle,) = scipy.linalg.qr(np.vstack([upper, lower]), mode="r", overwrite_a=True, check_finite=False)
    return np.asarray(triangle)[: upper.shape[1]]


def _solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Solve factor.T @ factor @ x = right."""
    return np.asarray(scipy.linalg.cho_solve((factor, False), right))
