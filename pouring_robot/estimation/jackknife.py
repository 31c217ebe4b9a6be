r"""How far an answer scatters where what is left is no noise: found again without each block of rows in turn.

What an effect that the model lacks leaves over hangs together from row to row, so that n rows tell less than n of a
noise as large. The delete-a-group jackknife (Efron, *The jackknife, the bootstrap and other resampling plans*, 1982)
asks the rows themselves, whole blocks of them: it is the cluster-robust covariance CV3J of econometrics, the sandwich
of Huber and White with each block's leverage taken out, known to as many degrees of freedom as there are blocks, less
one (Cameron & Miller, *A practitioner's guide to cluster-robust inference*, J. Human Resources 50, 2015; MacKinnon,
Nielsen & Webb, *Cluster-robust inference: a guide to empirical practice*, J. Econometrics 232, 2023).
"""

import math
from collections.abc import Iterable

import numpy as np
import scipy.linalg

from pouring_robot.estimation.intervals import deviations95
from pouring_robot.mechanism.arrays import FloatArray

KNOWN = 0.1
"""Share of the information in a direction that other rows must tell: with less, what they leave open there has ten
times the variance that all rows leave."""


def jackknife_covariance(
    blocks: Iterable[tuple[FloatArray, FloatArray]],
    place: FloatArray,
    prior: FloatArray | float = 1.0,
    freedoms: float = math.inf,
) -> FloatArray:
    """Return the covariance of an answer at ``place``, (k,), by how far blocks of equations scatter it, (k, k).

    Of each block its derivatives, (m, k), and what is left there, (m,); both are over the noise and weighted. Without
    one of them the answer is a step of Gauss and Newton away, where the others tell as much as :data:`KNOWN`. The prior
    of each unknown has a mean of zero and the inverse of ``prior``, (k,) or all alike, as variance: priors are no data
    and in no block, and hold as before, so that of the normal matrix A it is A^-1 (M + prior) A^-1, M of the gradient
    of the data. What blocks scatter counts as much more as Student's t of so few is wider than that of ``freedoms``,
    for intervals that are made with these; one block alone tells of the priors only.
    """
    inner, pull = zip(*((own.T @ own, own.T @ left) for own, left in blocks), strict=True)
    held, data = np.eye(place.size) * prior, sum(inner)
    whole, gradient = held + data, held @ place + sum(pull)
    found = [_without(whole, own, gradient - pulled) for own, pulled in zip(inner, pull, strict=True)]
    moved, alone = np.array([step for step, _ in found]), np.hstack([axes for _, axes in found])
    apart = moved - moved.mean(axis=0)
    scattered = (len(moved) - 1) / len(moved) * apart.T @ apart
    several = np.trace(scipy.linalg.solve(whole, data, assume_a="pos")) - alone.shape[1]
    if alone.size and several > 1.0:
        scattered += np.trace(scattered @ whole) / several * alone @ alone.T
    # One block alone scatters nothing, and of how many deviations that makes an interval nothing is known.
    wider = deviations95(len(moved) - 1.0) / deviations95(freedoms) if len(moved) > 1 else 0.0
    by_priors = scipy.linalg.solve(whole, np.sqrt(held), assume_a="pos")
    return np.asarray(wider**2 * scattered + by_priors @ by_priors.T)


def _without(whole: FloatArray, own: FloatArray, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the step to the answer without a block, (k,), and directions that it alone tells, (k, a), W-orthonormal.

    From the normal matrix W of all and the block's own, (k, k) each, and the gradient without it, (k,).
    """
    share, axes = scipy.linalg.eigh(whole - own, whole)
    told = share >= KNOWN
    return -axes[:, told] @ ((gradient @ axes[:, told]) / share[told]), axes[:, ~told]
