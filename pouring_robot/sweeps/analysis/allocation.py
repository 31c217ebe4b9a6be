r"""Tolerance allocation: the loosest set of tolerances that keeps the required accuracy.

To first order the displacement at pose p is d = G_p e, so its covariance is linear in the squares u_g of the factors
by which group g of tolerances is loosened:

.. math:: \Sigma_p(u) = \sum_g u_g A_{pg}, \qquad A_{pg} = G_{pg} C_g G_{pg}^T

with C_g the covariance of the group's errors as the sweep file has them. Loosest means largest product of the factors,
each group weighted with its number of parameters:

.. math:: \max_u \sum_g n_g \log u_g \quad\text{s.t.}\quad w^T \Sigma_p(u)\, w \le (R / k)^2
          \quad \text{for every pose } p \text{ and direction } w

A concave problem with linear constraints, infinitely many of them, solved by cutting planes: the direction in which a
pose scatters most, at the poses that violate the requirement most, becomes a constraint; the relaxed problem is a
geometric program in log u. k is the two-sided normal quantile of the wanted share. In the end all factors are scaled
alike until the share of the robots whose *distance* (three coordinates, not one) is within R is met at the worst pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
import scipy.special

from pouring_robot.batch.structure import BoolArray
from pouring_robot.exceptions import NoSolutionError
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray

_CUTS_A_ROUND = 8
_ROUNDS = 200
_TIGHT = 1e-7  # relative violation that counts as none
_DIRECTIONS = 64


@dataclass(frozen=True, eq=False)
class AllocatedFactors:
    """Factors on the groups' tolerances."""

    factors: FloatArray  # how many times looser (above 1) or tighter than given, shape (groups,)
    capped: BoolArray  # whether the cap holds the factor, not the requirement, shape (groups,)
    quantile_m: FloatArray  # at every pose, the distance that the wanted share of robots keeps, shape (poses,)
    poses: tuple[int, ...]  # indices of the poses that hold the factors, the worst first


def group_covariances(
    transfer: FloatArray, std: FloatArray, shared: FloatArray, parts: Sequence[int], groups: Sequence[int]
) -> FloatArray:
    """Return the covariance of the displacement that each group alone causes.

    Args:
        transfer: G, shape (poses, 3, parameters), m per unit.
        std: standard deviation of each parameter, shape (parameters,).
        shared: root of the correlation of each parameter with others of its part, shape (parameters,).
        parts: number of the part of each parameter.
        groups: number of the group of each parameter; correlated parameters share one.

    Returns:
        Shape (poses, groups, 3, 3), in m².
    """
    scaled = transfer * std
    own = scaled * np.sqrt(1.0 - shared**2)
    part_of, group_of = np.asarray(parts), np.asarray(groups)
    result = np.zeros((len(transfer), max(groups) + 1, 3, 3))
    for g in range(result.shape[1]):
        columns = group_of == g
        result[:, g] += np.einsum("pik,pjk->pij", own[:, :, columns], own[:, :, columns])
        for part in np.unique(part_of[columns]):
            common = scaled[:, :, columns & (part_of == part)] @ shared[columns & (part_of == part)]
            result[:, g] += np.einsum("pi,pj->pij", common, common)
    return result


def allocate(
    covariances: FloatArray,
    weights: FloatArray,
    requirement_m: float,
    share: float,
    cap: float,
    progress: Progress = say_nothing,
) -> AllocatedFactors:
    """Return the loosest factors.

    Covariances are of each group alone, shape (poses, groups, 3, 3), in m², weights the number of parameters of each
    group; a share of the robots must keep the requirement at every pose; the cap is the largest factor.

    Raises:
        NoSolutionError: the cutting planes do not settle.
    """
    allowed = (requirement_m / scipy.special.ndtri(0.5 + 0.5 * share)) ** 2
    relative = covariances / allowed
    squares = _cutting_planes(relative, weights, cap**2, progress)
    total = np.einsum("g,pgij->pij", squares, covariances)
    quantiles = distance_quantiles(total, share)
    scale = min(1.0, requirement_m / float(quantiles.max()))
    held = np.argsort(-quantiles, kind="stable")
    tight = [int(p) for p in held[:_CUTS_A_ROUND] if quantiles[p] > 0.99 * quantiles.max()]
    return AllocatedFactors(scale * np.sqrt(squares), squares > 0.999 * cap**2, scale * quantiles, tuple(tight))


def _cutting_planes(relative: FloatArray, weights: FloatArray, cap: float, progress: Progress) -> FloatArray:
    """Return squares u that maximise the weighted sum of log u with every eigenvalue of Σ u A at most one."""
    poses, groups = relative.shape[:2]
    squares = np.full(groups, cap)
    cuts = np.zeros((0, groups))
    for rounds in range(1, _ROUNDS + 1):
        values, vectors = np.linalg.eigh(np.einsum("g,pgij->pij", squares, relative))
        violation = values[:, -1] - 1.0
        worst = np.argsort(-violation, kind="stable")[: min(_CUTS_A_ROUND, poses)]
        worst = worst[violation[worst] > _TIGHT]
        progress("allocation", rounds, rounds + int(worst.size > 0))
        if not worst.size:
            return squares
        directions = vectors[worst, :, -1]
        new = np.einsum("pgij,pi,pj->pg", relative[worst], directions, directions)
        # Cuts that hold with room to spare will not bind again soon, and come back if they do.
        cuts = np.concatenate([cuts[cuts @ squares > 0.5], new])
        squares = _relaxed(cuts, weights, cap, squares)
    raise NoSolutionError(
        f"the tolerance allocation does not settle in {_ROUNDS} rounds; allocate by part or by entry instead"
    )


def _relaxed(cuts: FloatArray, weights: FloatArray, cap: float, start: FloatArray) -> FloatArray:
    """Maximise the weighted sum of log u for ``cuts @ u <= 1`` and ``u <= cap``: a geometric program in y = log u."""
    share = weights / weights.sum()
    first = np.log(start / max(1.0, float((cuts @ start).max())))
    constraint = {
        "type": "ineq",
        "fun": lambda y: -np.log(cuts @ np.exp(y)),
        "jac": lambda y: -(cuts * np.exp(y)) / (cuts @ np.exp(y))[:, None],
    }
    found = scipy.optimize.minimize(
        lambda y: -share @ y,
        first,
        jac=lambda y: -share,
        method="SLSQP",
        bounds=[(None, np.log(cap))] * len(first),
        constraints=[constraint],
        options={"maxiter": 500, "ftol": 1e-12},
    )
    return np.asarray(np.exp(found.x))


def distance_quantiles(covariances: FloatArray, share: float) -> FloatArray:
    """Return the distance that a normal displacement keeps with a probability.

    The direction of the displacement's deviates is integrated over the sphere; along one direction the distance is chi
    distributed with three degrees of freedom. Covariances are (n, 3, 3), in m², distances (n,), in m.
    """
    variances = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    cosines, weights = np.polynomial.legendre.leggauss(_DIRECTIONS)
    turns = (np.arange(_DIRECTIONS) + 0.5) * np.pi / _DIRECTIONS
    flat = 1.0 - cosines**2
    squares = np.stack(
        [
            np.multiply.outer(flat, np.cos(turns) ** 2).ravel(),
            np.multiply.outer(flat, np.sin(turns) ** 2).ravel(),
            np.repeat(cosines**2, _DIRECTIONS),
        ]
    )
    weight = np.repeat(weights / (2.0 * _DIRECTIONS), _DIRECTIONS)
    result = np.zeros(len(variances))
    for k, own in enumerate(variances):
        if own[-1] > 0.0:
            result[k] = _quantile(np.sqrt((own / own[-1]) @ squares), weight, share) * np.sqrt(own[-1])
    return result


def _quantile(stretch: FloatArray, weight: FloatArray, share: float) -> float:
    """Return the quantile of |z| · stretch, z normal in three dimensions, stretch by direction."""
    safe = np.maximum(stretch, 1e-12)

    def excess(distance: float) -> float:
        # The distribution of chi with three degrees of freedom.
        return float(weight @ scipy.special.gammainc(1.5, 0.5 * (distance / safe) ** 2)) - share

    low, high = scipy.special.ndtri(0.5 + 0.5 * share), np.sqrt(2.0 * scipy.special.gammaincinv(1.5, share))
    return float(scipy.optimize.brentq(excess, 0.9 * low, 1.01 * high, xtol=1e-10))
