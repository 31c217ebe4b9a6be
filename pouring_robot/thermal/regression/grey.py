r"""Grey relational degree: how closely an error set follows the steps of temperature.

Deng's formula (the paper's equation 10, which was lost), with the two extremes taken over all sets i and steps k:

.. math::
   \xi_i(k) = \frac{\Delta_{\min} + \eta\,\Delta_{\max}}{\Delta_i(k) + \eta\,\Delta_{\max}}, \qquad
   \Delta_i(k) = |y'_k - x'_{ik}|, \qquad \gamma_i = \frac1n \sum_k \xi_i(k)

y' and x' are temperature and error without their units. How the paper took the units away is not said. Here each series
is spread from 0 to 1 (``"range"``), so that neither the unit nor the temperature from which an error is counted changes
the degree; a set that falls with temperature is turned over first, since only the likeness of trends is asked for.
"""

import numpy as np
from numpy.typing import ArrayLike

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.regression.table import ErrorSetError, standardised


def grey_relational_coefficients(
    X: ArrayLike, y: ArrayLike, *, resolution: float = 0.5, scaling: str = "range"
) -> FloatArray:
    """Return ξ of every step of temperature y, (n,), and set, a column of X, shape (n, k), in (0, 1]; η: resolution.

    Scaling "range": spread from 0 to 1; "mean": divided by its mean; "initial": divided by its first number; "none": as
    given (X and y must then share a scale).

    Raises:
        ErrorSetError: a set or the temperature is constant, the mean or first number that divides is 0, or a setting is
            out of its range.
    """
    sets, steps = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
    if sets.ndim != 2 or steps.shape != sets.shape[:1]:
        raise ErrorSetError(f"shapes {sets.shape} and {steps.shape} do not fit; give (n, k) and (n,)")
    if not 0.0 < resolution <= 1.0:
        raise ErrorSetError(f"resolution = {resolution}: give a number above 0, up to 1 (usual: 0.5)")
    trend = standardised("temperature", steps[:, None])
    distances = np.abs(_scaled(steps[:, None], trend, scaling) - _scaled(sets, trend, scaling))
    least, most = distances.min(), distances.max()
    if most == 0.0:
        return np.ones_like(distances)
    return np.asarray((least + resolution * most) / (distances + resolution * most))


def grey_relational_degree(
    X: ArrayLike, y: ArrayLike, *, resolution: float = 0.5, scaling: str = "range"
) -> FloatArray:
    """Return γ of every set, shape (k,): the mean of its coefficients over the steps.

    A score function in scikit-learn's sense: ``SelectKBest(grey_relational_degree, k=2)``. Arguments and errors as in
    :func:`grey_relational_coefficients`.
    """
    return np.asarray(grey_relational_coefficients(X, y, resolution=resolution, scaling=scaling).mean(axis=0))


def _scaled(series: FloatArray, trend: FloatArray, scaling: str) -> FloatArray:
    """Return the columns (n, k) without units; trend is the standardised temperature, (n, 1)."""
    if scaling == "none":
        return series
    if scaling == "range":
        scaled = standardised("error set", series)
        rising = np.where(trend.T @ scaled < 0.0, -1.0, 1.0) * scaled
        return np.asarray((rising - rising.min(axis=0)) / np.ptp(rising, axis=0))
    if scaling not in {"mean", "initial"}:
        raise ErrorSetError(f"scaling '{scaling}' is not known; give 'range', 'mean', 'initial' or 'none'")
    divisors = series.mean(axis=0) if scaling == "mean" else series[0]
    if np.any(np.abs(divisors) <= 1e-12 * np.abs(series).max(axis=0)):
        raise ErrorSetError(f"scaling '{scaling}' would divide by zero; give scaling 'range'")
    return np.asarray(series / divisors)
