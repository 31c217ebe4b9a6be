r"""Evidence: how much better data are explained if the coefficients of a group of columns may differ from zero.

Whitened residuals r are Gaussian with covariance :math:`C = I + \sum_k \Phi_k W_k^2 \Phi_k^T`: the coefficients of each
group k of columns are independent, with standard deviations :math:`W_k`. All that is needed of C are inner products
of columns and residual through its inverse. They follow from the Gram matrix of the columns by a Schur complement
(:class:`Gram`, :class:`ConditionalGram`), so that the cost does not depend on the number of rows once that is formed.

A group of columns has two unknown scales: one of all its coefficients, and one more of those that only shape the
others. Its log evidence against its absence has a closed form at each pair of scales (d, p: squared singular values of
the group's columns, whitened by C, and squared projections of the residual):

.. math:: \tfrac12 \sum_i \frac{p_i s^2 d_i}{1 + s^2 d_i} - \ln(1 + s^2 d_i)

and is averaged over both, evenly in their logarithm, so that a group pays for columns it does not need
(Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006, ch. 5; MacKay, Neural Computation 4, 1992).
That is its Bayes factor (:func:`bayes_factor`). Bayes factors give the evidence of several groups at work together
(:func:`joint_evidence`), by which hypotheses are compared.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
import scipy.linalg
import scipy.optimize

from pouring_robot.inference.priors import LOG_SCALES, SHAPINGS
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

_NEGLIGIBLE = 1e-10
_SMALL = 100
_BLOCK = 32
"""Number of columns that LAPACK reduces at a time."""
_EQUATIONS = 4096
"""Number processed at a time: all columns of a large campaign would not fit into memory."""


class Columns(Protocol):
    """Columns (m, k): a NumPy array, or an object that computes the columns of some equations on request."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Equations and columns, (m, k)."""

    def __getitem__(self, some: slice | BoolArray, /) -> FloatArray:
        """Return the columns of some equations, (some, k)."""


def chunks(equations: int) -> Iterator[slice]:
    """Yield slices of equations that are processed together."""
    for first in range(0, equations, _EQUATIONS):
        yield slice(first, first + _EQUATIONS)


class Scale(NamedTuple):
    """Standard deviations of a group's coefficients over their usual ones."""

    main: float  # of all of them
    shaping: float = 1.0  # additional factor of those that only shape the others

    def weights(self, main: BoolArray) -> FloatArray:
        """Return the factor of each coefficient, (k,); ``main`` (k,) is false for those that only shape the others."""
        return self.main * np.where(main, 1.0, self.shaping)


@dataclass(frozen=True)
class BayesFactor:
    """Log Bayes factor of a group of columns."""

    evidence: float  # log evidence against leaving it out, averaged over scales, in nats
    scale: Scale  # the most probable scales
    peak: float  # log evidence at those


@dataclass(frozen=True, eq=False)
class Gram:
    """Inner products of columns and residual through the inverse of a covariance, all in memory."""

    columns: FloatArray  # of the columns, (K, K)
    projected: FloatArray  # of the columns with the residual, (K,)
    squared: float  # of the residual with itself
    log_determinant: float = 0.0  # of the covariance

    @classmethod
    def of(cls, groups: Sequence[Columns], residual: FloatArray) -> Gram:
        """Return those of groups of columns, (m, k) each, and residual (m,) with unit noise as the only covariance."""
        count = sum(columns.shape[1] for columns in groups)
        inner, projected = np.zeros((count, count)), np.zeros(count)
        for some in chunks(len(residual)) if groups else ():
            stacked = np.hstack([columns[some] for columns in groups])
            inner += stacked.T @ stacked
            projected += stacked.T @ residual[some]
        return cls(inner, projected, float(residual @ residual))

    def inner(self, some: Indices, others: Indices) -> FloatArray:
        """Return those of some columns (a,) with others (b,), shape (a, b)."""
        return self.columns.take(some, 0).take(others, 1)

    def scaled(self, weights: FloatArray) -> Gram:
        """Return the same with columns multiplied by weights (K,)."""
        return replace(self, columns=self.columns * weights * weights[:, None], projected=self.projected * weights)

    def under(self, factor: float) -> Gram:
        """Return the same with the noise multiplied by a factor."""
        variance = factor**2
        return Gram(self.columns / variance, self.projected / variance, self.squared / variance)


class ConditionalGram:
    """Inner products conditional on groups of columns: a Schur complement.

    ``places`` (k,) are those of the groups' columns, ``weights`` (k,) the standard deviations of their coefficients.
    """

    def __init__(self, products: Gram | ConditionalGram, places: Indices, weights: FloatArray) -> None:
        self._products, self.places, self.weights = products, places, weights
        inner = products.inner(places, places)
        inner *= weights
        inner *= weights[:, None]
        inner.flat[:: len(places) + 1] += 1.0
        self._factor = _factor(inner)
        self.residual_coordinates = self._solved(weights * products.projected[places])
        self.squared: float = products.squared - float(self.residual_coordinates @ self.residual_coordinates)
        self.log_determinant: float = products.log_determinant + 2.0 * float(np.log(self._factor.diagonal()).sum())

    @classmethod
    def groups(cls, products: Gram | ConditionalGram, groups: Sequence[tuple[Indices, FloatArray]]) -> ConditionalGram:
        """Return inner products conditional on groups of columns, each with its places and weights."""
        places = np.concatenate([np.zeros(0, dtype=np.intp), *(where for where, _ in groups)])
        return cls(products, places, np.concatenate([np.zeros(0), *(weights for _, weights in groups)]))

    def _solved(self, values: FloatArray, *, transposed: bool = True) -> FloatArray:
        if not len(self.weights):
            return values
        # Called millions of times for small systems, so the LAPACK routine itself, without checks of its arguments.
        solution: FloatArray = scipy.linalg.lapack.dtrtrs(self._factor, values, lower=0, trans=transposed)[0]
        return solution

    @property
    def log_likelihood(self) -> float:
        """Log density of the residual, in nats, up to a constant of the number of rows."""
        return -0.5 * (self.squared + self.log_determinant)

    def conditioned(
        self, shared: FloatArray, inner: FloatArray, projected: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return conditional inner products of other columns with each other, (a, a), and with the residual, (a,).

        From the unconditional ones: with the groups' columns, (k, a), each other, (a, a), and the residual, (a,).
        """
        explained = self.coordinates(shared)
        return inner - explained.T @ explained, projected - explained.T @ self.residual_coordinates

    def coordinates(self, shared: FloatArray) -> FloatArray:
        """Return the part of columns that the groups explain, (k, a), from inner products with the groups', (k, a).

        In orthonormal coordinates; :attr:`residual_coordinates` holds the residual in the same.
        """
        return self._solved(self.weights[:, None] * shared)

    def coefficients_at(self, coordinates: FloatArray) -> FloatArray:
        """Return the groups' standardised coefficients, (k,), for coordinates (k,)."""
        return self._solved(coordinates, transposed=False)

    @functools.cached_property
    def _every(self) -> FloatArray:
        """All columns in the same coordinates, (K, k)."""
        every = np.arange(len(self._products.projected), dtype=np.intp)
        return self.coordinates(self._products.inner(self.places, every)).T

    @functools.cached_property
    def projected(self) -> FloatArray:
        """Inner products of all columns with the residual, (K,)."""
        return self._products.projected - self._every @ self.residual_coordinates

    def inner(self, some: Indices, others: Indices) -> FloatArray:
        """Return the inner products of some columns (a,) with others (b,), shape (a, b)."""
        return np.asarray(
            self._products.inner(some, others) - self._every.take(some, 0) @ self._every.take(others, 0).T
        )

    def coefficients(self) -> tuple[FloatArray, FloatArray]:
        """Return mean (k,) and covariance (k, k) of the groups' standardised coefficients."""
        return self.coefficients_at(self.residual_coordinates), self._covariance

    @functools.cached_property
    def _covariance(self) -> FloatArray:
        if not len(self.weights):
            return np.zeros((0, 0))
        upper = np.triu(scipy.linalg.lapack.dpotri(self._factor, lower=0)[0])
        return np.asarray(upper + np.triu(upper, 1).T)

    def means_without(self, own: slice) -> FloatArray:
        """Return the mean coefficients (k,) without some of the groups' columns (a,); these are zero."""
        means, covariance = self.coefficients()
        gone = scipy.linalg.solve(covariance[own, own], means[own], assume_a="pos")
        return np.asarray(means - covariance[:, own] @ gone)


def _factor(matrix: FloatArray) -> FloatArray:
    """Return the upper triangular U with U^T U = a positive definite matrix (k, k), which is overwritten."""
    if not len(matrix):
        return matrix
    factor, failed = scipy.linalg.lapack.dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)
    if failed:
        raise np.linalg.LinAlgError("inner products of columns are not finite, or no inner products")
    return np.asarray(factor)


def shaping_unit(columns: FloatArray, main: BoolArray) -> float:
    """Return the factor of shaping coefficients at which they contribute as much to the prediction as the others.

    Columns that are rounding errors only, because what they depend on does not vary, shape nothing. ``columns`` are
    inner products of a group's columns, (k, k), and ``main`` is false for shaping columns, (k,).
    """
    sizes = np.diag(columns)
    whole, shaping = float(sizes[main].sum()), float(sizes[~main].sum())
    return float(np.sqrt(whole / shaping)) if shaping > _NEGLIGIBLE * whole else 1.0


def bayes_factor(
    columns: FloatArray, projected: FloatArray, main: BoolArray | None = None, unit: float = 1.0
) -> BayesFactor:
    """Return the Bayes factor of a group of columns, conditional on everything else.

    Args:
        columns: inner products of its columns through the inverse of the covariance of everything else, (k, k).
        projected: inner products of its columns with the residual, (k,).
        main: false for columns that only shape the others, (k,); by default true for all.
        unit: of shaping; see :func:`shaping_unit`.
    """
    if not len(projected):
        return BayesFactor(0.0, Scale(1.0), 0.0)
    scales, weights = _grid(len(columns), main, unit)
    values = _over_scales(weights, columns, projected)
    shape, best = divmod(int(np.argmax(values)), len(LOG_SCALES))
    peak = float(values[shape, best])
    return BayesFactor(float(log_mean_exp(values)), Scale(float(np.exp(LOG_SCALES[best])), scales[shape].shaping), peak)


def log_mean_exp(values: FloatArray, axis: int | None = None) -> FloatArray:
    """Return the logarithm of the mean of exponentials, of all values or along an axis: averages log evidences."""
    peak = values.max(axis=axis)
    return np.asarray(peak + np.log(np.exp(values - peak).mean(axis=axis)))  # thrice as fast as SciPy for thousands


def joint_evidence(log_posterior: float, factors: Sequence[BayesFactor], log_priors: Sequence[float]) -> float:
    """Return the log evidence of groups of columns at work together, up to a constant of the data, in nats.

    Args:
        log_posterior: at their settled scales: log density of the residual plus the prior of all that is no group.
        factors: Bayes factor of each group given the others. Averaging over its scales, with the others held, changes
            the log evidence by its evidence minus its peak.
        log_priors: log prior probability that each group is at work.
    """
    averaged = sum(factor.evidence - factor.peak for factor in factors)
    return log_posterior + averaged + sum(log_priors)


def evidence_bound(
    columns: FloatArray, projected: FloatArray, main: BoolArray | None = None, unit: float = 1.0
) -> float:
    """Return an upper bound of :func:`bayes_factor`: all that the widest scales explain, without their penalty."""
    widest = float(np.exp(LOG_SCALES[-1]))
    weights = np.full(len(columns), widest) if main is None else np.where(main, 1.0, unit * SHAPINGS.max()) * widest
    inner = weights[:, None] * columns * weights
    inner.flat[:: len(columns) + 1] += 1.0
    pulled = weights * projected
    return 0.5 * float(pulled @ scipy.linalg.lapack.dposv(inner, pulled, lower=1)[1])


def evidence_bound_within(columns: FloatArray, projected: FloatArray, limits: FloatArray) -> float:
    """Return :func:`evidence_bound` for coefficients within limits (k, 2)."""
    inner = columns + np.exp(-2.0 * LOG_SCALES[-1]) * np.eye(len(columns))
    factor = np.linalg.cholesky(inner).T
    pulled = scipy.linalg.solve_triangular(factor, projected, trans="T")
    left = scipy.optimize.lsq_linear(factor, pulled, limits.T).cost
    return 0.5 * float(pulled @ pulled) - float(left)


def evidences(
    columns: FloatArray, projected: FloatArray, main: BoolArray | None = None, unit: float = 1.0
) -> FloatArray:
    """Return :func:`bayes_factor`'s log evidence for many residuals, (d,), from their projections, (k, d), in nats."""
    _, weights = _grid(len(columns), main, unit)
    squared, axes = eigen(weights[:, :, None] * columns * weights[:, None, :])
    kept = squared > _NEGLIGIBLE * squared[:, -1:]  # columns of which only rounding errors remain explain nothing
    projections = axes.swapaxes(1, 2) @ (weights[:, :, None] * projected)
    explained = np.divide(projections**2, squared[:, :, None], out=np.zeros_like(projections), where=kept[:, :, None])
    variance = np.exp(2.0 * LOG_SCALES)[:, None] * np.where(kept, squared, 0.0)[:, None]
    values = 0.5 * ((variance / (1.0 + variance)) @ explained - np.log1p(variance).sum(axis=2)[:, :, None])
    return log_mean_exp(values.reshape(-1, projected.shape[1]), axis=0)


def evidence_of_fewest(columns: FloatArray, projected: FloatArray, explained: float) -> float:
    """Return the log evidence of the fewest columns that explain a sum of squares at the widest scale, in nats.

    Where even all columns do not, it is that of all. Each next column is the one that explains most given those before
    (orthogonal matching pursuit: Pati, Rezaiifar & Krishnaprasad, Asilomar Conference, 1993).
    """
    left, inner = projected, columns + np.exp(-2.0 * LOG_SCALES[-1]) * np.eye(len(columns))
    chosen: list[int] = []
    while explained > 0.0 and len(chosen) < len(columns):
        gains = left**2 / inner.diagonal()
        gains[chosen] = 0.0
        best = int(gains.argmax())
        chosen.append(best)
        explained -= float(gains[best])
        ratios = inner[best] / inner[best, best]
        left, inner = left - ratios * left[best], inner - np.outer(ratios, inner[best])
        inner[chosen, chosen] = 1.0  # only rounding errors remain of them
    return float(evidences(columns[np.ix_(chosen, chosen)], projected[chosen, None])[0]) if chosen else 0.0


def _grid(count: int, main: BoolArray | None, unit: float) -> tuple[list[Scale], FloatArray]:
    """Return shaping scales (p) and the weights of columns at each of them, (p, k)."""
    main = np.ones(count, dtype=bool) if main is None else main
    shapings = np.ones(1) if main.all() else unit * SHAPINGS
    return [Scale(1.0, s) for s in shapings.tolist()], np.where(main, 1.0, shapings[:, None])


def _over_scales(weights: FloatArray, columns: FloatArray, projected: FloatArray) -> FloatArray:
    """Return the log evidence of a group of columns at each scale, (p, s), for several sets of weights, (p, k).

    In axes of which the first is the direction of the projected residual, the inner products are a tridiagonal matrix
    T. The pivots of 1 + s^2 T, from its end, give the determinant, and the last one the element needed (Golub &
    Meurant, Matrices, Moments and Quadrature, 2010, ch. 3). All scales share T, much cheaper than eigenvectors.
    """
    (sets, count), variances = weights.shape, np.exp(2.0 * LOG_SCALES)[:, None]
    diagonal, off_diagonal = np.empty((sets, 1, count)), np.empty((sets, 1, count))
    bordered = np.zeros((sets, count + 1, count + 1))
    np.multiply(weights, projected, out=bordered[:, 0, 1:])
    np.multiply(weights[:, :, None] * columns, weights[:, None], out=bordered[:, 1:, 1:])
    for k, own in enumerate(bordered):
        _, whole, off, _, _ = scipy.linalg.lapack.dsytrd(own.T, lower=1, lwork=_BLOCK * count, overwrite_a=1)
        diagonal[k, 0], off_diagonal[k, 0] = whole[:0:-1], off[::-1]
    steps, squared = variances * off_diagonal, variances[:, 0] * off_diagonal[..., -1] ** 2
    steps[..., -1] = 0.0  # uncouples the blocks of this one matrix: all scales, and a last 1
    pivots = _pivots(np.append(1.0 + variances * diagonal, 1.0), steps.ravel())[:-1].reshape(steps.shape)
    return np.asarray(0.5 * (squared / pivots[..., -1] - np.log(pivots).sum(axis=2)))


def _pivots(diagonal: FloatArray, off_diagonal: FloatArray) -> FloatArray:
    """Return the pivots (k,) of a tridiagonal matrix, at least 1 but for rounding; both arguments are overwritten."""
    first = 0
    while failed := scipy.linalg.lapack.dpttrf(diagonal[first:], off_diagonal[first:], overwrite_d=1, overwrite_e=1)[2]:
        first += failed - 1
        diagonal[first] = 1.0  # lost to rounding: continue from here
    return np.maximum(diagonal, 1.0, out=diagonal)


def eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues and eigenvectors of a symmetric matrix (k, k), or of each of several (p, k, k).

    Divide and conquer (NumPy) is fastest for small matrices. For hundreds of eigenvalues that lie close together some
    kernels of OpenBLAS do not converge in it; relatively robust representations do.
    """
    if matrix.shape[-1] <= _SMALL:
        return np.linalg.eigh(matrix)
    if matrix.ndim > 2:
        found = [eigen(one) for one in matrix]
        return np.array([values for values, _ in found]), np.array([axes for _, axes in found])
    values, axes = scipy.linalg.eigh(matrix, driver="evr", check_finite=False)
    return values, axes


def largest_scale(columns: FloatArray, projected: FloatArray, probability: float = 0.975) -> float:
    """Return the upper bound, at a probability, of the scale of a group's coefficients, as of :func:`bayes_factor`."""
    worth = _over_scales(np.ones((1, len(columns))), columns, projected)[0]
    shares = np.cumsum(np.exp(worth - worth.max()))
    return float(np.exp(LOG_SCALES[np.searchsorted(shares, probability * shares[-1])]))
