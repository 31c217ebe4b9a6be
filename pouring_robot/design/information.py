r"""The information of a plan's rows on parameters: covariance, singular values, which parameters they do not show.

A plan is a stack of whitened rows J (each row one measured coordinate over its noise, each column one unknown). The
first columns are nuisance parameters: the twelve numbers of the two outer frames, which must be fitted but are of no
interest. With M = JᵀJ + diag(inverse_std²), the information on the other parameters θ is the Schur complement

.. math:: S = M_{\theta\theta} - M_{\theta f} M_{ff}^{-1} M_{f\theta}

whose inverse is their covariance. The roots of its eigenvalues, :math:`\sigma_1 \ge \dots \ge \sigma_m`, are the
singular values of J with the frames projected out.
"""

import numpy as np
import scipy.linalg

from pouring_robot.estimation.identifiability import RANK_TOLERANCE
from pouring_robot.mechanism.arrays import FloatArray


def projected_singular_values(rows: FloatArray, nuisance: int, inverse_std: FloatArray | None = None) -> FloatArray:
    """Return the singular values of a plan with the nuisance columns projected out, (p - nuisance,), the largest first.

    Whitened rows (k, p) have the nuisance columns first; ``inverse_std`` is one over the prior standard deviation of
    each unknown, (p,), 0 for none.
    """
    return np.asarray(np.linalg.svd(_triangle(rows, inverse_std)[nuisance:, nuisance:], compute_uv=False))


def covariance(rows: FloatArray, inverse_std: FloatArray | None = None) -> FloatArray:
    """Return the expected covariance of all unknowns of a linear fit, shape (p, p): the inverse of M.

    Whitened rows (k, p) must have full column rank together with the prior; see :func:`projected_singular_values`.
    """
    stack = with_prior(rows, inverse_std)
    size = np.linalg.norm(stack, axis=0)
    # By R, not by JᵀJ: squaring would lose half of the digits where parameters have similar effects.
    inverse = scipy.linalg.solve_triangular(np.linalg.qr(stack / size, mode="r"), np.eye(stack.shape[1]))
    inverse = inverse / size[:, None]
    return np.asarray(inverse @ inverse.T)


def informative_parameters(rows: FloatArray, nuisance: int, sizes: FloatArray) -> list[int]:
    """Return the indices of the parameters about which rows (k, p) tell more than is known beforehand.

    A parameter is kept if a change of its usual size, its tolerance (p - nuisance,), has a larger effect than the noise
    even if the parameters kept before compensate for it: the length of what its column adds to the span of the earlier
    ones (Gram-Schmidt).
    """
    free = _triangle(rows, None)[nuisance:, nuisance:] * sizes
    span, kept = np.zeros((len(free), 0)), list[int]()
    for k in range(free.shape[1]):
        rest = free[:, k]
        for _ in range(2):  # the second time removes round-off
            rest = rest - span @ (span.T @ rest)
        length = float(np.linalg.norm(rest))
        if length > max(1.0, RANK_TOLERANCE * float(np.linalg.norm(free[:, k]))):
            span, kept = np.column_stack([span, rest / length]), [*kept, k]
    return kept


def with_prior(rows: FloatArray, inverse_std: FloatArray | None) -> FloatArray:
    """Return rows with one more for each unknown that has a prior."""
    return rows if inverse_std is None else np.concatenate([rows, np.diag(inverse_std)[inverse_std > 0.0]])


def _triangle(rows: FloatArray, inverse_std: FloatArray | None) -> FloatArray:
    """Return R of a QR factorisation, with at least as many rows as columns."""
    stack = with_prior(rows, inverse_std)
    missing = max(0, stack.shape[1] - len(stack))
    return np.asarray(np.linalg.qr(np.pad(stack, ((0, missing), (0, 0))), mode="r"))
