"""The last word on a calibration: rows held out choose nothing, but they may refuse the whole.

Groups are chosen on training blocks. What only looks like geometry (a drift, a worn screw, a shift between sessions)
can be copied well there and lead astray elsewhere; the held-out block is where that shows. A refusal is a single yes
or no to what was chosen without it, so there is nothing to overfit; the robot then stays as it was.
"""

from dataclasses import dataclass

import numpy as np

from pouring_robot.calibration.metrics import Misfit
from pouring_robot.estimation.instruments import KINDS, kind_of
from pouring_robot.mechanism.arrays import FloatArray

_STANDARD_ERRORS = 2.0
_NEGLIGIBLE = 0.01  # of the noise's variance: half a per cent of the noise, which nobody sees


@dataclass(frozen=True)
class Refusal:
    """The groups that were chosen and refused, and the misfit of the held-out rows without and with them."""

    groups: tuple[str, ...]
    before: Misfit
    after: Misfit


def row_scores(residual: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return each row's mean squared residual over its noise, of each kind of instrument; NaN: unmeasured.

    Args:
        residual: measured minus predicted, shape (n, K), in m and rad; NaN where missing.
        sigma: noise of the components, shape (K,), in m and rad.

    Returns:
        Shape (n, kinds), in the order of :data:`~pouring_robot.estimation.instruments.KINDS`.
    """
    squared = (residual / sigma) ** 2
    of_kind = kind_of(np.arange(len(sigma))) == np.arange(len(KINDS))[:, None]
    share = of_kind.T.astype(float)
    count = np.isfinite(squared) @ share
    return np.where(count > 0.0, np.nan_to_num(squared) @ share / np.maximum(count, 1.0), np.nan)


def mean_and_error(values: FloatArray) -> tuple[float, float]:
    """Return the mean of the finite values and its standard error; zeros if there are none."""
    known = values[np.isfinite(values)]
    return (float(known.mean()), float(known.std() / np.sqrt(known.size))) if known.size else (0.0, 0.0)


def harmless(before: FloatArray, after: FloatArray, standard_errors: float) -> bool:
    """Return whether no kind of measurement comes out worse, by the scores of rows (n, kinds) before and after.

    Each may by so many standard errors of the difference row by row, as less is chance, or by a hundredth of the
    noise's variance, as less is nothing: what hardly moves the rotations at all may move those of every row the same
    way, so that the standard error of next to nothing is smaller still.
    """
    harm = [mean_and_error(column) for column in (after - before).T]
    return all(mean <= max(standard_errors * error, _NEGLIGIBLE) for mean, error in harm)


def acceptable(before: FloatArray, after: FloatArray) -> bool:
    """Return whether held-out rows bear a calibration, by their scores (n, kinds) without and with it.

    They do unless all kinds of measurement together come out worse, or one of them does by more than two standard
    errors; see :func:`harmless`.
    """
    together = sum(mean_and_error(column)[0] for column in (after - before).T)
    return together <= 0.0 and harmless(before, after, _STANDARD_ERRORS)
