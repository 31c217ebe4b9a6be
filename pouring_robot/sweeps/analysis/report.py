"""The files beside the store: ``summary.json``, ``ranking.csv`` and ``sweep.png``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pouring_robot.io.files import write_together
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.tables import csv_text
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.report.result import Result
from pouring_robot.sweeps.analysis.indices import SobolIndices, sobol_indices
from pouring_robot.sweeps.analysis.plots import picture
from pouring_robot.sweeps.analysis.summary import Summary, summarise
from pouring_robot.sweeps.analysis.tolerances import AllocatedTolerances, RankedParameter, allocate_tolerances, rank
from pouring_robot.sweeps.store import PICTURE, RANKING, SUMMARY, SweepStore, open_results

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class SweepReport(Result):
    """What a finished sweep says.

    Attributes:
        store: where the numbers are.
        summary: of all samples.
        ranking: the parameters, the one that matters most first.
        indices: Sobol indices, of a ``sobol`` study.
        allocation: the loosest tolerances, if the sweep file asks for them.
    """

    store: SweepStore
    summary: Summary
    ranking: Sequence[RankedParameter]
    indices: SobolIndices | None
    allocation: AllocatedTolerances | None

    @property
    def headline(self) -> str:
        """How far the ladle is off, which share is within the requirement, and the error that matters most."""
        figures = self.summary.figures()
        return (
            f"{figures['frame']} is off by at most {figures['largest_mm']:.3f} mm at {figures['poses']} poses, "
            f"{figures['share_within']:.2%} within {figures['accuracy_mm']:g} mm; {self.ranking[0].name} matters most"
        )

    def to_frame(self) -> pd.DataFrame:
        """Return the ranking, one row a parameter; the unit of its tolerance stands in its row."""
        import pandas as pd

        return pd.DataFrame([parameter.row() for parameter in self.ranking])

    def to_dataset(self) -> xr.Dataset:
        """Return the numbers: displacement and rotation of every robot at every pose, in m and rad, read when used.

        Raises:
            SweepStoreError: the results are damaged or gone.
        """
        return open_results(self.store.folder)

    def figures(self) -> dict[str, Any]:
        """Return all figures for JSON; mm and mrad."""
        config = self.store.plan.config
        return {
            "study": config.study,
            "kind": config.kind,
            **self.store.plan.model.named,
            "content_hash": self.store.plan.content_hash,
            "version": self.store.plan.content["version"],
            "seed": config.seed,
            "summary": self.summary.figures(),
            "sobol_base_samples_dropped": self.indices.dropped if self.indices else None,
            "ranking": [parameter.row() for parameter in self.ranking],
            "allocation": self.allocation.figures() if self.allocation else None,
        }

    def save(self) -> tuple[Path, ...]:
        """Write the three files into the sweep's folder and return their paths.

        Raises:
            OutputError: the folder cannot be written to.
        """
        folder = self.store.folder
        text = json.dumps(self.figures(), indent=2, allow_nan=False) + "\n"
        files: dict[Path, str | bytes] = {folder / SUMMARY: text, folder / RANKING: self._ranking_text()}
        files[folder / PICTURE] = picture(self.store, self.summary, self.ranking)
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
