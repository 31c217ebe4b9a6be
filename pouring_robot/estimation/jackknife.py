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


def jackknife_covariance(
    blocks: Iterable[tuple[FloatArray, FloatArray]],
    place: FloatArray,
    precision: FloatArray | float = 1.0,
    dof: float = math.inf,
) -> FloatArray:
    """Return the covariance of an answer at ``place``, (k,), by how far blocks of equations scatter it, (k, k).

    Of each block its derivatives, (m, k), and what is left there, (m,); both are over the noise and weighted. Without
    one of them the answer is a step of Gauss and Newton away. The prior of each unknown has a mean of zero and the
    inverse of ``precision``, (k,) or all alike, as variance: priors are no data and in no block, and hold as before,
    so that of the normal matrix A it is A^-1 (M + precision) A^-1, M of the gradient of the data. What blocks scatter
    counts as much more as Student's t of so few is wider than that of ``dof``, for intervals that are made
    with these; one block alone tells of the priors only.
    """
    inner, pull = zip(*((own.T @ own, own.T @ left) for own, left in blocks), strict=True)
    held, moved = np.eye(place.size) * precision, []
    for k in range(len(inner)):
        told, pulled = (sum((*part[:k], *part[k + 1 :])) for part in (inner, pull))
        moved.append(-_solved(held + told, held @ place + pulled))
    apart = np.array(moved) - np.mean(moved, axis=0)
    # One block alone scatters nothing, and of how many deviations that makes an interval nothing is known.
    wider = deviations95(len(moved) - 1.0) / deviations95(dof) if len(moved) > 1 else 0.0
    by_priors = _solved(held + sum(inner), np.sqrt(held))
    return np.asarray(wider**2 * (len(moved) - 1) / len(moved) * apart.T @ apart + by_priors @ by_priors.T)


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution for a positive definite matrix (k, k), in units in which its diagonal is one.

    Of unknowns in units far apart SciPy would warn, though that costs no digits (van der Sluis, Numer. Math. 14, 1969).
    """
    scale = 1.0 / np.sqrt(matrix.diagonal())
    solution = scipy.linalg.solve(scale[:, None] * matrix * scale, (scale * right.T).T, assume_a="pos")
    return np.asarray((scale * solution.T).T)
