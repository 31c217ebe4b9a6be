"""From the numbers of a sweep to tolerances: which ones matter, and the loosest that keep the requirement."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pouring_robot.batch.structure import BoolArray
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.sweeps.analysis.allocation import AllocatedFactors, allocate, group_covariances
from pouring_robot.sweeps.analysis.indices import SobolIndices
from pouring_robot.sweeps.analysis.linear import transfer_matrices
from pouring_robot.sweeps.analysis.summary import Summary
from pouring_robot.sweeps.config import Allocation
from pouring_robot.sweeps.plan import SweepPlan
from pouring_robot.sweeps.store import AXES

VERIFIED_POSES = 64
_CLOSURES_AT_ONCE, _POSES_AT_ONCE = 20_000, 1000


@dataclass(frozen=True)
class RankedParameter:
    """How much one tolerance matters at the first frame.

    Attributes:
        name, unit, part: of the parameter; ``unit`` is mm or mrad.
        tolerance: largest error, in that unit.
        weight: what the ranking goes by: the largest displacement in mm (one_at_a_time), the share of the scatter
            (monte_carlo), the total index (sobol).
        figures: all measures by name.
    """

    name: str
    unit: str
    part: str
    tolerance: float
    weight: float
    figures: dict[str, Any]

    def row(self) -> dict[str, Any]:
        """Return what stands in the ranking's table; its heading ``unit`` is that of the tolerance."""
        return {"name": self.name, "part": self.part, "tolerance": self.tolerance, "unit": self.unit} | self.figures


def rank(plan: SweepPlan, summary: Summary, indices: SobolIndices | None = None) -> list[RankedParameter]:
    """Return the parameters of a finished sweep, the one that matters most first."""
    if plan.config.study == "one_at_a_time":
        measured = _alone(plan, summary)
    elif indices is not None:
        measured = _by_indices(indices)
    else:
        measured = _by_scatter(plan)
    ranked = []
    for p, margin, (weight, figures) in zip(plan.parameters, plan.draws.margins, measured, strict=True):
        unit, factor = ("mm", MM) if p.unit == "m" else ("mrad", MRAD)
        ranked.append(RankedParameter(p.name, unit, p.part, margin.tolerance / factor, weight, figures))
    return sorted(ranked, key=lambda r: -r.weight)


def _alone(plan: SweepPlan, summary: Summary) -> list[tuple[float, dict[str, Any]]]:
    rows = summary.by_sample
    rms, mean = rows.rms_m, rows.mean_m
    return [
        (
            float(rows.largest_m[k]) / MM,
            {
                "largest_mm": float(rows.largest_m[k]) / MM,
                "mean_mm": _number(mean[k] / MM),
                "rms_mm": _number(float(np.linalg.norm(rms[k])) / MM),
                "largest_mrad": float(rows.largest_rad[k]) / MRAD,
                "main_axis": AXES[int(np.argmax(np.nan_to_num(rms[k])))],
                "failed": len(plan.poses) - int(rows.count[k]),
            },
        )
        for k in range(len(plan.parameters))
    ]


def _by_indices(indices: SobolIndices) -> list[tuple[float, dict[str, Any]]]:
    return [
        (
            float(indices.total[k]),
            {
                "first_order": float(indices.first[k]),
                "first_order_ci95": float(indices.first_confidence[k]),
                "total": float(indices.total[k]),
                "total_ci95": float(indices.total_confidence[k]),
                "main_axis": AXES[int(np.argmax(indices.first_by_axis[k] * indices.variance_m2))],
            },
        )
        for k in range(len(indices.names))
    ]


def _by_scatter(plan: SweepPlan) -> list[tuple[float, dict[str, Any]]]:
    """Rank by first-order variances: mean over the poses of each error's own, correlation aside."""
    std = np.array([margin.std for margin in plan.draws.margins])
    squares = np.zeros((3, len(std)))
    for matrices in _matrices(plan):
        squares += ((matrices[:, :3] * std) ** 2).sum(axis=0)
    squares /= len(plan.poses)
    total = max(squares.sum(), np.finfo(float).tiny)
    return [
        (
            float(squares[:, k].sum() / total),
            {
                "share_of_scatter": float(squares[:, k].sum() / total),
                "rms_mm": float(np.sqrt(squares[:, k].sum())) / MM,
                "main_axis": AXES[int(np.argmax(squares[:, k]))],
            },
        )
        for k in range(len(std))
    ]


@dataclass(frozen=True, eq=False)
class AllocatedTolerances:
    """The loosest tolerances, and how they did when robots were drawn with them.

    Attributes:
        wanted_share: of the robots that shall meet the requirement at each pose.
        requirement_m: largest distance allowed.
        names: of the parameters.
        tolerance: largest error of each, in m or rad, shape (parameters,).
        factor: new over given tolerance, shape (parameters,).
        capped: whether the cap holds it, shape (parameters,).
        worst_poses: indices of the poses that hold the tolerances.
        predicted_m: at the worst pose, the distance that the wanted share keeps, to first order.
        machines: robots drawn; ``poses`` the number of poses, the hardest ones, each of them went to.
        share_within: of the robots at those poses, in all.
        share_at_worst_pose: at the pose where fewest were within.
        failed: robots at poses without a solution; they do not count as within.
    """

    wanted_share: float
    requirement_m: float
    names: tuple[str, ...]
    tolerance: FloatArray
    factor: FloatArray
    capped: BoolArray
    worst_poses: tuple[int, ...]
    predicted_m: float
    machines: int
    poses: int
    share_within: float
    share_at_worst_pose: float
    failed: int

    def figures(self) -> dict[str, Any]:
        """Return the figures for people and JSON: mm, mrad (both are thousandths)."""
        rows = [
            {"parameter": name, "tolerance_mm_or_mrad": 1e3 * float(t), "factor": float(f), "at_cap": bool(c)}
            for name, t, f, c in zip(self.names, self.tolerance, self.factor, self.capped, strict=True)
        ]
        return {
            "requirement_mm": self.requirement_m / MM,
            "wanted_share": self.wanted_share,
            "predicted_mm_at_worst_pose": self.predicted_m / MM,
            "verified": {
                "robots": self.machines,
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

    Args:
        plan: a closed-chain sweep; its distributions keep their shape, its tolerances are scaled.
        wanted: what to keep; by default what the sweep file says.
        progress: told of every step.

    Raises:
        BadInputError: correlated errors would get factors of their own.
        NoSolutionError: the search does not settle.
    """
    wanted = wanted or plan.config.allocation or Allocation()
    groups = plan.groups(wanted.by)
    std = np.array([margin.std for margin in plan.draws.margins])
    covariances = np.concatenate(
        [
            group_covariances(matrices[:, :3], std, plan.draws.shared, plan.draws.parts, groups)
            for matrices in _matrices(plan)
        ]
    )
    weights = np.bincount(groups).astype(float)
    found = allocate(covariances, weights, plan.accuracy_m, wanted.share, wanted.loosest_factor, progress)
    return _verified(plan, wanted, found, groups, progress)


def _matrices(plan: SweepPlan) -> Iterator[FloatArray]:
    """Yield G at the plan's poses, some at a time."""
    for first in range(0, len(plan.poses), _POSES_AT_ONCE):
        yield transfer_matrices(plan, plan.poses[first : first + _POSES_AT_ONCE])


def _verified(
    plan: SweepPlan, wanted: Allocation, found: AllocatedFactors, groups: Sequence[int], progress: Progress
) -> AllocatedTolerances:
    """Draw robots with the new tolerances and close them at the hardest poses."""
    factor = found.factors[list(groups)]
    hardest = np.sort(np.argsort(-found.quantile_m, kind="stable")[:VERIFIED_POSES])
    poses = plan.poses[hardest]
    robots = plan.draws.of_robots(wanted.machines)
    step = max(1, _CLOSURES_AT_ONCE // len(hardest))
    within, failed = np.zeros(len(hardest)), 0
    for first in range(0, wanted.machines, step):
        values = robots.values(first, min(first + step, wanted.machines)) * factor
        displacement, status = plan.displacements(values, poses)
        distance = np.linalg.norm(displacement[:, :, 0], axis=-1)
        within += ((status == 0) & (distance <= plan.accuracy_m)).sum(axis=0)
        failed += int((status != 0).sum())
        progress("verification", first + len(values), wanted.machines)
    given = np.array([margin.tolerance for margin in plan.draws.margins])
    return AllocatedTolerances(
        wanted.share,
        plan.accuracy_m,
        plan.names,
        given * factor,
        factor,
        found.capped[list(groups)],
        found.poses,
        float(found.quantile_m.max()),
        wanted.machines,
        len(hardest),
        float(within.mean()) / wanted.machines,
        float(within.min()) / wanted.machines,
        failed,
    )


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
