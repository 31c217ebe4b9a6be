"""What a finished sweep says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pouring_robot.report.result import Result
from pouring_robot.sweeps.analysis.indices import SobolIndices
from pouring_robot.sweeps.analysis.summary import Summary
from pouring_robot.sweeps.analysis.tolerances import AllocatedTolerances, RankedParameter
from pouring_robot.sweeps.store import SweepStore, open_results

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class SweepFindings(Result):
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
