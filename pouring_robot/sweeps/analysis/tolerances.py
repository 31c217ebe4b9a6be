r"""From the results of a sweep to tolerances: which ones matter, and the loosest that keep the requirement.

To first order the displacement at pose p is d = G_p e, so its covariance is linear in the squares u_g of the factors
by which group g of tolerances is loosened:

.. math:: \Sigma_p(u) = \sum_g u_g A_{pg}, \qquad A_{pg} = G_{pg} C_g G_{pg}^T

with C_g the covariance of the group's errors as in the sweep file. Loosest means the largest product of the factors,
each group weighted with its number of parameters:

.. math:: \max_u \sum_g n_g \log u_g \quad\text{s.t.}\quad w^T \Sigma_p(u)\, w \le (R / k)^2
          \quad \text{for every pose } p \text{ and direction } w

This is a concave problem with infinitely many linear constraints, solved by cutting planes: at the poses that violate
the requirement most, the direction of largest scatter becomes a constraint; the relaxed problem is a geometric program
in log u. k is the two-sided normal quantile of the required share. Finally R is lowered until the required share of
robots has a *distance* (of three coordinates, not one) within the requirement at the worst pose: this scales all
factors by the same amount except those that the cap still limits.
NoSolutionError is raised where cutting planes do not converge, or the robot does not close at a pose.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.optimize
import scipy.special
from numpy.typing import NDArray

from pouring_robot.batch import BatchCommand, CompiledEngine
from pouring_robot.exceptions import NoSolutionError
from pouring_robot.io.figures import without_nan
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.units import MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.mechanism.closure.status import CLOSED
from pouring_robot.mechanism.rotations import moved_point
from pouring_robot.sweeps.analysis.sobol import SobolIndices
from pouring_robot.sweeps.analysis.summary import Summary
from pouring_robot.sweeps.config import Allocation
from pouring_robot.sweeps.plan import SweepPlan
from pouring_robot.sweeps.store import AXES

_CUTS_A_ROUND = 8
_ROUNDS = 200
_TIGHT = 1e-7  # relative violation that counts as none
_SCALED = 1e-4  # relative change by which all factors, also those at the cap, are finally scaled
_ROUND_OFF = 1e-9  # relative to the displacement by the strongest error
_DIRECTIONS = 64
VERIFIED_POSES = 64
_CLOSURES_AT_ONCE, _POSES_AT_ONCE = 20_000, 1000


@dataclass(frozen=True, eq=False)
class AllocatedFactors:
    """Factors on the groups' tolerances."""

    factors: FloatArray  # how many times looser (above 1) or tighter than given, shape (groups,)
    capped: BoolArray  # whether the cap, not the requirement, limits the factor, shape (groups,)
    quantile_m: FloatArray  # at every pose, the distance that the required share of robots keeps, shape (poses,)
    poses: tuple[int, ...]  # indices of the poses that limit the factors, the worst first


def group_covariances(
    transfer: FloatArray, std: FloatArray, shared: FloatArray, parts: Sequence[int], groups: Sequence[int]
) -> FloatArray:
    """Return the covariance of the displacement that each group alone causes, shape (poses, groups, 3, 3), in m².

    ``transfer`` is G, shape (poses, 3, parameters), in m per unit. For each parameter, ``std`` is the standard
    deviation, ``shared`` the root of its correlation with others of its part, (parameters,) each, ``parts`` and
    ``groups`` the numbers of its part and group; correlated parameters are in one group.
    """
    part_of, group_of = np.asarray(parts), np.asarray(groups)
    errors = np.where(part_of[:, None] == part_of, np.outer(std * shared, std * shared), 0.0)
    np.fill_diagonal(errors, std**2)
    found = []
    for g in range(max(groups) + 1):
        columns = np.flatnonzero(group_of == g)
        part = transfer[:, :, columns]
        found.append(part @ errors[np.ix_(columns, columns)] @ part.transpose(0, 2, 1))
    return np.stack(found, axis=1)


def allocate(
    covariances: FloatArray,
    weights: FloatArray,
    requirement_m: float,
    share: float,
    cap: float,
    progress: Progress = say_nothing,
) -> AllocatedFactors:
    """Return the loosest factors.

    Covariances are those of each group alone, shape (poses, groups, 3, 3), in m²; weights are the number of parameters
    of each group; ``share`` of the robots must keep the requirement at every pose; ``cap`` is the largest factor.
    """
    along, scale = requirement_m / scipy.special.ndtri(0.5 + 0.5 * share), 1.0
    for _ in range(_ROUNDS):
        along *= scale
        squares = _cutting_planes(covariances / along**2, weights, cap**2, progress)
        quantiles = distance_quantiles(np.einsum("g,pgij->pij", squares, covariances), share)
        scale = min(1.0, requirement_m / float(quantiles.max()))
        if scale > 1.0 - _SCALED or not _capped(squares, cap).any():
            break
    held = np.argsort(-quantiles, kind="stable")
    tight = [int(p) for p in held[:_CUTS_A_ROUND] if quantiles[p] > 0.99 * quantiles.max()]
    return AllocatedFactors(scale * np.sqrt(squares), _capped(squares, cap), scale * quantiles, tuple(tight))


def _capped(squares: FloatArray, cap: float) -> BoolArray:
    return np.asarray(squares > 0.999 * cap**2)


def _cutting_planes(relative: FloatArray, weights: FloatArray, cap: float, progress: Progress) -> FloatArray:
    """Return squares u that maximise the weighted sum of log u with every eigenvalue of Σ u A at most one."""
    groups = relative.shape[1]
    squares = np.full(groups, cap)
    cuts = np.zeros((0, groups))
    for rounds in range(1, _ROUNDS + 1):
        values, vectors = np.linalg.eigh(np.einsum("g,pgij->pij", squares, relative))
        violation = values[:, -1] - 1.0
        worst = np.argsort(-violation, kind="stable")[:_CUTS_A_ROUND]
        worst = worst[violation[worst] > _TIGHT]
        progress("allocation", rounds, rounds + int(worst.size > 0))
        if not worst.size:
            return squares
        directions = vectors[worst, :, -1]
        new = np.einsum("pgij,pi,pj->pg", relative[worst], directions, directions)
        # Constraints with a large margin are unlikely to bind again, and return if they do.
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
    """Return the distance that a normally distributed displacement does not exceed with a probability.

    The direction of the standard normal deviates is integrated over the sphere; along one direction the distance has a
    chi distribution with three degrees of freedom. Covariances are (n, 3, 3), in m², distances (n,), in m.
    """
    variances = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    cosines, weights = np.polynomial.legendre.leggauss(_DIRECTIONS)
    turns = (np.arange(_DIRECTIONS) + 0.5) * np.pi / _DIRECTIONS
    flat = 1.0 - cosines**2
    first, second = (np.outer(flat, part**2).ravel() for part in (np.cos(turns), np.sin(turns)))
    squares = np.stack([first, second, np.repeat(cosines**2, _DIRECTIONS)])
    weight = np.repeat(weights / (2.0 * _DIRECTIONS), _DIRECTIONS)
    result = np.zeros(len(variances))
    for k, variance in enumerate(variances):
        if variance[-1] > 0.0:
            result[k] = _quantile(np.sqrt((variance / variance[-1]) @ squares), weight, share) * np.sqrt(variance[-1])
    return result


def _quantile(stretch: FloatArray, weight: FloatArray, share: float) -> float:
    """Return the quantile of |z| · stretch, z standard normal in three dimensions, stretch by direction."""

    def excess(distance: float) -> float:
        # The chi distribution with three degrees of freedom.
        return float(weight @ scipy.special.gammainc(1.5, 0.5 * (distance / stretch) ** 2)) - share

    low, high = scipy.special.ndtri(0.5 + 0.5 * share), np.sqrt(2.0 * scipy.special.gammaincinv(1.5, share))
    return float(scipy.optimize.brentq(excess, 0.9 * low, 1.01 * high, xtol=1e-10))


@dataclass(frozen=True)
class RankedParameter:
    """How much one tolerance matters at the first frame."""

    name: str
    unit: str  # mm or mrad
    part: str
    tolerance: float  # largest error, in that unit
    # ranking criterion: the largest displacement in mm (one_at_a_time), the share of the scatter (monte_carlo), the
    # total index (sobol); infinite where the robot closes at no pose
    weight: float
    figures: dict[str, Any]  # all measures by name

    def row(self) -> dict[str, Any]:
        """Return the row of the ranking's table; ``unit`` is the unit of the tolerance."""
        return {"name": self.name, "part": self.part, "tolerance": self.tolerance, "unit": self.unit} | self.figures


def rank(plan: SweepPlan, summary: Summary, indices: SobolIndices | None = None) -> list[RankedParameter]:
    """Return the parameters of a finished sweep, the one that matters most first."""
    by, columns = _measures(plan, summary, indices)
    ranked = []
    for k, (p, margin) in enumerate(zip(plan.parameters, plan.draws.margins, strict=True)):
        unit, factor = shown_in(p.unit)
        figures = without_nan({name: values[k].item() for name, values in columns.items()})
        weight = math.inf if figures[by] is None else figures[by]
        ranked.append(RankedParameter(p.name, unit, p.part, margin.tolerance / factor, weight, figures))
    return sorted(ranked, key=lambda r: -r.weight)


def _measures(
    plan: SweepPlan, summary: Summary, indices: SobolIndices | None
) -> tuple[str, dict[str, NDArray[np.generic]]]:
    """Return the ranking criterion, and all measures by name, (parameters,) each."""

    def main_axis(strength: FloatArray) -> NDArray[np.str_]:
        moved = np.nan_to_num(strength)
        known = ~np.isnan(strength).any(axis=1) & moved.any(axis=1)
        return np.where(known, np.array(AXES)[moved.argmax(axis=1)], "")

    if plan.config.study == "one_at_a_time":
        rows = summary.by_sample
        largest_m, largest_rad = rows.largest
        return "largest_mm", {
            "largest_mm": largest_m / MM,
            "mean_mm": rows.mean_m / MM,
            "rms_mm": np.linalg.norm(rows.rms_m, axis=1) / MM,
            "largest_mrad": largest_rad / MRAD,
            "main_axis": main_axis(rows.rms_m),
            "failed": len(plan.poses) - rows.count.astype(int),
        }
    if indices is not None:
        return "total", {
            "first_order": indices.first,
            "first_order_ci95": indices.first_confidence,
            "total": indices.total,
            "total_ci95": indices.total_confidence,
            "main_axis": main_axis(indices.first_m2),
        }
    # First-order variances: mean, over the poses where the robot closes, of each error's own variance, uncorrelated.
    std, poses = np.array([margin.std for margin in plan.draws.margins]), plan.closing
    squares = np.zeros((3, len(std)))
    for matrices in _matrices(plan, poses):
        squares += ((matrices[:, :3] * std) ** 2).sum(axis=0) / len(poses)
    squares[:, squares.sum(axis=0) < _ROUND_OFF**2 * squares.sum(axis=0).max()] = 0.0
    variance = squares.sum(axis=0)
    share = variance / max(variance.sum(), np.finfo(float).tiny)
    figures = {"share_of_scatter": share, "rms_mm": np.sqrt(variance) / MM, "main_axis": main_axis(squares.T)}
    return "share_of_scatter", figures


@dataclass(frozen=True, eq=False)
class AllocatedTolerances:
    """The loosest tolerances, and their verification with robots drawn from them."""

    wanted: Allocation  # required share of robots at each pose, and other settings
    requirement_m: float  # largest permitted distance
    names: tuple[str, ...]  # of the parameters
    units: tuple[str, ...]  # of their printed tolerances, mm or mrad
    tolerance: FloatArray  # largest error of each, in m or rad, shape (parameters,)
    factor: FloatArray  # new over given tolerance; capped: whether the cap limits it, shape (parameters,) each
    capped: BoolArray
    worst_poses: tuple[int, ...]  # indices of the poses that limit the tolerances
    predicted_m: float  # at the worst pose, the distance that the required share keeps, to first order
    poses: int  # number of poses, the hardest ones, at which the drawn robots were closed
    share_within: float  # of the robots at those poses; ``share_at_worst_pose`` where fewest were within
    share_at_worst_pose: float
    failed: int  # robots at poses without a solution; they do not count as within

    def figures(self) -> dict[str, Any]:
        """Return the figures for people and JSON: mm, mrad (both are thousandths)."""
        rows = [
            {
                "parameter": name,
                "tolerance_mm_or_mrad": 1e3 * float(t),
                "unit": u,
                "factor": float(f),
                "at_cap": bool(c),
            }
            for name, u, t, f, c in zip(self.names, self.units, self.tolerance, self.factor, self.capped, strict=True)
        ]
        return {
            "requirement_mm": self.requirement_m / MM,
            "wanted_share": self.wanted.share,
            "predicted_mm_at_worst_pose": self.predicted_m / MM,
            "verified": {
                "robots": self.wanted.machines,
                "poses": self.poses,
                "share_within": self.share_within,
                "share_at_worst_pose": self.share_at_worst_pose,
                "failed": self.failed,
            },
            "worst_poses": list(self.worst_poses),
            "tolerances": rows,
        }


def allocate_tolerances(
    plan: SweepPlan, wanted: Allocation | None = None, progress: Progress = say_nothing
) -> AllocatedTolerances:
    """Find the loosest tolerances that keep the required accuracy, and verify them by exact closures.

    The sweep's distributions keep their shape; their tolerances are scaled. ``wanted``: by default that of the sweep
    file.
    """
    wanted, draws = wanted or plan.config.allocation or Allocation(), plan.draws
    groups = plan.groups(wanted.by)
    std = np.array([margin.std for margin in draws.margins])
    parts = (group_covariances(g[:, :3], std, draws.shared, draws.parts, groups) for g in _matrices(plan, plan.poses))
    weights = np.bincount(groups).astype(float)
    covariances = np.concatenate(list(parts))
    found = allocate(covariances, weights, plan.accuracy_m, wanted.share, wanted.loosest_factor, progress)
    return _verified(plan, wanted, found, groups, progress)


def transfer_matrices(plan: SweepPlan, poses: BatchCommand) -> FloatArray:
    """Return G for the plan's kind and parameters at its first frame, without the errors of the sweep.

    Shape (poses, 6, parameters): displacement of the frame's origin in m, rotation vector in rad, in the axes of the
    fixed platform, per m or rad. Raises BatchClosureError where the robot does not close at a pose.
    """
    engine, rotation = plan.engine, poses.start.rotation
    wanted = [parameter.local for parameter in plan.parameters]
    if plan.config.kind == "open_branch":
        assert isinstance(engine, CompiledEngine)  # only a star has a DH table of its chains
        found = engine.transfer_open_branch(poses.start.joints, wanted)
    else:
        closed = engine.close(plan.model.actual_drive_values(poses.drives), poses.start).require_all()
        found, rotation = engine.transfer(closed, wanted), closed.rotation
    # The engine observes the end frame; the frame's origin moves with it.
    place = moved_point(found.matrix, rotation @ plan.tool_offsets_m[0])
    return np.concatenate([place, found.matrix[:, 3:]], axis=1)


def _matrices(plan: SweepPlan, poses: BatchCommand) -> Iterator[FloatArray]:
    """Yield G at poses, in blocks."""
    for first in range(0, len(poses), _POSES_AT_ONCE):
        yield transfer_matrices(plan, poses[first : first + _POSES_AT_ONCE])


def _verified(
    plan: SweepPlan, wanted: Allocation, found: AllocatedFactors, groups: Sequence[int], progress: Progress
) -> AllocatedTolerances:
    """Draw robots with the new tolerances and close them at the hardest poses."""
    factor = found.factors[list(groups)]
    hardest = np.sort(np.argsort(-found.quantile_m, kind="stable")[:VERIFIED_POSES])
    robots = replace(plan.draws, study="monte_carlo", count=wanted.machines)
    step = _CLOSURES_AT_ONCE // len(hardest)
    within, failed = np.zeros(len(hardest)), 0
    for first in range(0, wanted.machines, step):
        values = robots.values(first, min(first + step, wanted.machines)) * factor
        moved = plan.moved(values, plan.poses[hardest])
        distance = np.linalg.norm(moved.displacement[:, :, 0], axis=-1)
        within += plan.within(moved.status, distance).sum(axis=0)
        failed += int((moved.status != CLOSED).sum())
        progress("verification", first + len(values), wanted.machines)
    tolerance = np.array([margin.tolerance for margin in plan.draws.margins]) * factor
    capped, worst, predicted = found.capped[list(groups)], found.poses, float(found.quantile_m.max())
    accuracy, names, poses = plan.accuracy_m, plan.names, len(hardest)
    units = tuple(shown_in(p.unit)[0] for p in plan.parameters)
    mean, least = (float(one) / wanted.machines for one in (within.mean(), within.min()))
    return AllocatedTolerances(
        wanted, accuracy, names, units, tolerance, factor, capped, worst, predicted, poses, mean, least, failed
    )
