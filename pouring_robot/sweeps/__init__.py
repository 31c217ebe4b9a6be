"""Tolerance studies: one-at-a-time sensitivities, Monte Carlo, Sobol indices, and the loosest tolerances.

``sweep("sweep.yaml", "results")`` computes chunk by chunk, goes on after a kill with ``resume=True``, and returns what
was found: ``.headline``, ``.ranking``, ``.to_dataset().displacement``, ``.save()``. A sweep file to start from:
examples/sweep.yaml. ``SweepPlan.load("sweep.yaml")`` checks everything and computes nothing.
"""

from pouring_robot.sweeps.analysis.allocation import allocate, group_covariances
from pouring_robot.sweeps.analysis.report import SweepReport, report
from pouring_robot.sweeps.analysis.tolerances import AllocatedTolerances, RankedParameter, allocate_tolerances, rank
from pouring_robot.sweeps.config import Allocation, ErrorEntry, Grid, Poses, RandomBox, SweepConfig
from pouring_robot.sweeps.plan import SweepPlan
from pouring_robot.sweeps.runner import run_sweep, sweep
from pouring_robot.sweeps.store import SweepStore, open_results

__all__ = [
    "AllocatedTolerances",
    "Allocation",
    "ErrorEntry",
    "Grid",
    "Poses",
    "RandomBox",
    "RankedParameter",
    "SweepConfig",
    "SweepPlan",
    "SweepReport",
    "SweepStore",
    "allocate",
    "allocate_tolerances",
    "group_covariances",
    "open_results",
    "rank",
    "report",
    "run_sweep",
    "sweep",
]
