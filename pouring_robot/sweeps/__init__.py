"""Tolerance studies: one-at-a-time sensitivities, Monte Carlo, Sobol indices, and the loosest tolerances.

``SweepPlan.load("sweep.yaml")`` checks everything and computes nothing; ``run_sweep(plan, "results")`` computes chunk
by chunk and goes on after a kill with ``resume=True``; ``report(store)`` reduces, ranks and allocates; and
``open_results("results").displacement`` holds the numbers as xarray. A sweep file to start from: examples/sweep.yaml.
"""

from __future__ import annotations

from pouring_robot.sweeps.analysis.allocation import allocate, group_covariances
from pouring_robot.sweeps.analysis.report import SweepReport, report
from pouring_robot.sweeps.analysis.tolerances import AllocatedTolerances, RankedParameter, allocate_tolerances, rank
from pouring_robot.sweeps.config import Allocation, ErrorEntry, Grid, Poses, RandomBox, SweepConfig
from pouring_robot.sweeps.plan import SweepPlan
from pouring_robot.sweeps.runner import run_sweep
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
]
