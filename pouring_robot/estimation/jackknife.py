r"""How far an estimate scatters where residuals are not only noise: it is found again without each block of rows.

The residuals that a missing effect leaves are correlated from row to row, so n rows determine less than n rows with
noise of the same size. The delete-a-group jackknife (Efron, *The jackknife, the bootstrap and other resampling plans*,
1982) measures this by whole blocks of rows: it is the cluster-robust covariance CV3J of econometrics, the sandwich of
Huber and White with each block's leverage taken out, with as many degrees of freedom as there are blocks, less one
(Cameron & Miller, *A practitioner's guide to cluster-robust inference*, J. Human Resources 50, 2015; MacKinnon, Nielsen
& Webb, *Cluster-robust inference: a guide to empirical practice*, J. Econometrics 232, 2023).
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
    """Return the covariance, (k, k), of an estimate at ``place``, (k,), from its scatter over blocks of equations.

    Each block has its derivatives, (m, k), and residuals, (m,), both divided by the noise and weighted. The estimate
    without a block is one Gauss-Newton step away. The prior of each unknown has mean zero and variance one over
    ``precision``, (k,) or all alike: priors are not data, are in no block, and hold as before, so that with the normal
    matrix A the covariance is A^-1 (M + precision) A^-1, M being that of the gradient of the data. The scatter of the
    blocks is enlarged by the ratio of Student's t for so few blocks to that for ``dof``, with which intervals are made;
    with one block alone only the priors contribute.
    """
    inner, pull = zip(*((own.T @ own, own.T @ residual) for own, residual in blocks), strict=True)
    held, moved = np.eye(place.size) * precision, []
    for k in range(len(inner)):
        others, pulled = (sum((*part[:k], *part[k + 1 :])) for part in (inner, pull))
        moved.append(-_solved(held + others, held @ place + pulled))
    apart = np.array(moved) - np.mean(moved, axis=0)
    # One block alone has no scatter, and no number of deviations to make an interval of it.
    wider = deviations95(len(moved) - 1.0) / deviations95(dof) if len(moved) > 1 else 0.0
    by_priors = _solved(held + sum(inner), np.sqrt(held))
    return np.asarray(wider**2 * (len(moved) - 1) / len(moved) * apart.T @ apart + by_priors @ by_priors.T)


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution for a positive definite matrix (k, k), in units in which its diagonal is one.

    For unknowns of very different units SciPy would warn, though no digits are lost (van der Sluis, Numer. Math. 14,
    1969).
    """
    scale = 1.0 / np.sqrt(matrix.diagonal())
    solution = scipy.linalg.solve(scale[:, None] * matrix * scale, (scale * right.T).T, assume_a="pos")
    return np.asarray((scale * solution.T).T)
