"""Tolerance studies: one-at-a-time sensitivities, Monte Carlo, Sobol indices, and the loosest tolerances.

``sweep("sweep.yaml", "results")`` computes chunk by chunk, goes on after a kill with ``resume=True``, and returns what
was found: ``.headline``, ``.ranking``, ``.to_dataset().displacement``, ``.save()``. A sweep file to start from:
examples/sweep.yaml. ``SweepPlan.load("sweep.yaml")`` checks everything and computes nothing.
"""

from pouring_robot.sweeps.analysis.report import SweepReport as SweepReport
from pouring_robot.sweeps.analysis.report import report as report
from pouring_robot.sweeps.analysis.tolerances import AllocatedTolerances as AllocatedTolerances
from pouring_robot.sweeps.analysis.tolerances import RankedParameter as RankedParameter
from pouring_robot.sweeps.analysis.tolerances import allocate as allocate
from pouring_robot.sweeps.analysis.tolerances import allocate_tolerances as allocate_tolerances
from pouring_robot.sweeps.analysis.tolerances import group_covariances as group_covariances
from pouring_robot.sweeps.analysis.tolerances import rank as rank
from pouring_robot.sweeps.config import Allocation as Allocation
from pouring_robot.sweeps.config import ErrorEntry as ErrorEntry
from pouring_robot.sweeps.config import Grid as Grid
from pouring_robot.sweeps.config import Poses as Poses
from pouring_robot.sweeps.config import RandomBox as RandomBox
from pouring_robot.sweeps.config import SweepConfig as SweepConfig
from pouring_robot.sweeps.plan import SweepPlan as SweepPlan
from pouring_robot.sweeps.runner import run_sweep as run_sweep
from pouring_robot.sweeps.runner import sweep as sweep
from pouring_robot.sweeps.store import SweepStore as SweepStore
from pouring_robot.sweeps.store import open_results as open_results
