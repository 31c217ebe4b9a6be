"""The files beside the store: ``summary.json``, ``ranking.csv``, ``sweep.png`` and ``report.html``."""

import json
from dataclasses import dataclass
from pathlib import Path

from pouring_robot.io.files import write_together
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.tables import csv_text
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.report.plots import png_of
from pouring_robot.sweeps.analysis.findings import SweepFindings
from pouring_robot.sweeps.analysis.indices import sobol_indices
from pouring_robot.sweeps.analysis.page import html_report
from pouring_robot.sweeps.analysis.plots import study_figure
from pouring_robot.sweeps.analysis.summary import summarise
from pouring_robot.sweeps.analysis.tolerances import allocate_tolerances, rank
from pouring_robot.sweeps.store import PAGE, PICTURE, RANKING, SUMMARY, SweepStore


@dataclass(frozen=True, eq=False, repr=False)
class SweepReport(SweepFindings):
    """What a finished sweep says, and how it is written."""

    def save(self) -> tuple[Path, ...]:
        """Write the four files into the sweep's folder and return their paths.

        Raises:
            OutputError: the folder cannot be written to.
        """
        folder = self.store.folder
        text = json.dumps(self.figures(), indent=2, allow_nan=False) + "\n"
        files: dict[Path, str | bytes] = {folder / SUMMARY: text, folder / RANKING: self._ranking_text()}
        files[folder / PICTURE] = png_of(study_figure(self.store, self.summary, self.ranking))
        files[folder / PAGE] = html_report(self, {"all figures": SUMMARY, "the ranking": RANKING})
        return tuple(write_together(files))

    def _ranking_text(self) -> str:
        rows = [parameter.row() for parameter in self.ranking]
        return csv_text(rows[0], (row.values() for row in rows))


@one_blas_thread()
def report(store: SweepStore, progress: Progress = say_nothing) -> SweepReport:
    """Reduce, rank and allocate, as the sweep file asks.

    Raises:
        SweepStoreError: the sweep is not finished, or its store is damaged.
        NoSolutionError: no tolerances keep the requirement.
    """
    plan = store.plan
    summary = summarise(store, progress)
    indices = sobol_indices(store, progress) if plan.config.study == "sobol" else None
    allocation = allocate_tolerances(plan, progress=progress) if plan.config.allocation else None
    return SweepReport(store, summary, rank(plan, summary, indices), indices, allocation)
