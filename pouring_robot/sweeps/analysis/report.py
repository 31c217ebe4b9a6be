"""Report of a finished sweep: its figures, lines, tables and plots, and the files next to the store."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pouring_robot.io.figures import json_text
from pouring_robot.io.files import write_together
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.tables import rows_csv
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.status import CLOSED
from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Table, html_page
from pouring_robot.report.plots import new_figure, own_look, png_of, svg_of, tell, tidy
from pouring_robot.report.result import Result
from pouring_robot.sweeps.analysis.sobol import SobolIndices, sobol_indices
from pouring_robot.sweeps.analysis.summary import Summary, summarise
from pouring_robot.sweeps.analysis.tolerances import AllocatedTolerances, RankedParameter, allocate_tolerances, rank
from pouring_robot.sweeps.config import SweepConfig
from pouring_robot.sweeps.plan import SweepPlan
from pouring_robot.sweeps.store import PAGE, PICTURE, RANKING, STATUS_NAMES, SUMMARY, SweepStore, open_results

_SHOWN, _SLICES = 20, 3
_POINTS = 2000  # of each box plot at most: the picture shows no more


@dataclass(frozen=True, eq=False, repr=False)
class SweepReport(Result):
    """Results of a finished sweep."""

    store: SweepStore  # the stored numbers
    summary: Summary  # of all samples
    ranking: Sequence[RankedParameter]  # the parameters, the one that matters most first
    indices: SobolIndices | None  # Sobol indices of a ``sobol`` study
    allocation: AllocatedTolerances | None  # the loosest tolerances, if the sweep file requests them

    @property
    def headline(self) -> str:
        """Error of the ladle, share within the requirement, and the parameter that matters most."""
        summary, figures = self.summary, self.summary.figures()
        if not summary.closed:
            return _first_line(self)
        of = f", in the {summary.closed} of {summary.samples} cases that closed" if summary.failed else ""
        return (
            f"{figures['frame']} is {self.store.plan.off} by at most {figures['largest_mm']:.3f} mm at "
            f"{figures['poses']} poses{of}, "
            f"{share_text(figures['share_within'])} within {figures['accuracy_mm']:g} mm; "
            f"{self.ranking[0].name} matters most"
        )

    def _table(self) -> Any:
        """The ranking, one row per parameter; the row contains the unit of its tolerance."""
        return [parameter.row() for parameter in self.ranking]

    def to_dataset(self) -> xr.Dataset:
        """Return displacement and rotation of every robot at every pose, in m and rad, read from disk when used.

        Raises:
            SweepStoreError: the results are damaged or missing.
        """
        return open_results(self.store.folder)

    def figures(self) -> dict[str, Any]:
        """Return all figures for JSON; mm and mrad."""
        plan, own = self.store.plan, self.store.plan.own_error_m
        return {
            "study": plan.config.study,
            "kind": plan.config.kind,
            **plan.model.named,
            "content_hash": plan.content_hash,
            "version": plan.content["version"],
            "seed": plan.config.seed,
            **({"own_error_mm": None if own is None else own / MM} if plan.config.model is not None else {}),
            "summary": self.summary.figures(),
            "sobol_base_samples_dropped": self.indices.dropped if self.indices else None,
            "ranking": self._table(),
            "allocation": self.allocation.figures() if self.allocation else None,
        }

    def save(self) -> tuple[Path, ...]:
        """Write summary, ranking, picture and page into the sweep's folder and return their paths."""
        study = study_figure(self)
        files: dict[str, str | bytes] = {
            SUMMARY: json_text(self.figures()),
            RANKING: rows_csv(self._table()),
            PICTURE: png_of(study),
            PAGE: html_report(self, study, {"all figures": SUMMARY, "the ranking": RANKING}),
        }
        return tuple(write_together({self.store.folder / name: content for name, content in files.items()}))


@one_blas_thread()
def report(store: SweepStore, progress: Progress = say_nothing) -> SweepReport:
    """Summarise, rank and allocate, as the sweep file requests.

    An unfinished sweep raises SweepStoreError; NoSolutionError is raised if no tolerances keep the requirement.
    """
    plan = store.plan
    summary = summarise(store, progress)
    indices = sobol_indices(store, progress) if plan.config.study == "sobol" else None
    allocation = allocate_tolerances(plan, progress=progress) if plan.config.allocation else None
    return SweepReport(store, summary, rank(plan, summary, indices), indices, allocation)


def summary_lines(found: SweepReport) -> list[str]:
    """Return lines on the tool's error, the share within the requirement, and samples without a solution."""
    plan, figures = found.store.plan, found.summary.figures()
    lines = [
        _first_line(found),
        f"within {figures['accuracy_mm']:g} mm: {share_text(figures['share_within'])} of all, "
        f"{share_text(figures['share_of_robots_within_everywhere'])} of the {_robots(plan)} at every pose",
    ]
    if plan.config.model is not None:
        own = "closes at none of these poses without further errors either"
        if plan.own_error_m is not None:
            own = f"also has an error of its own, up to {plan.own_error_m / MM:.3f} mm at these poses"
        lines.append(f"note: the robot of {plan.config.model} {own}")
    if found.summary.failed:
        others = ((name, count) for name, count in figures["status"].items() if name != STATUS_NAMES[CLOSED])
        failed = ", ".join(f"{count} {name}" for name, count in others)
        lines.append(f"note: cases without a solution, kept with their status: {failed}")
    if found.indices and found.indices.dropped:
        lines.append(f"note: {found.indices.dropped} base samples have no solution at some pose and are left out there")
    return lines


def _first_line(found: SweepReport) -> str:
    """Return a line on the tool's error where robots closed, or that none did."""
    plan, summary, figures = found.store.plan, found.summary, found.summary.figures()
    study = f"{figures['robots']} {_robots(plan)} at {figures['poses']} poses"
    if not summary.closed:
        unknown = f"how far {summary.frame} is {plan.off} is not known"
        return f"{study}: none of the {summary.samples} cases closes, so {unknown}; make the errors smaller"
    quantiles = ", ".join(f"{v:.3f} mm in {100 * float(k):g} %" for k, v in figures["quantiles_mm"].items())
    of = "them, never by more than"
    if summary.failed:
        of = f"the {summary.closed} of {summary.samples} cases that closed, there by no more than"
    largest = f"{figures['largest_mm']:.3f} mm and {figures['largest_mrad']:.3f} mrad"
    return f"{study}: {summary.frame} is {plan.off} by up to {quantiles} of {of} {largest}"


def share_text(share: float) -> str:
    """Return a share in percent; 100 % is printed only if it is exact."""
    return f"{share if share == 1.0 else min(share, 0.9999):.2%}"


def _robots(plan: SweepPlan) -> str:
    return "errors alone" if plan.config.study == "one_at_a_time" else "robots"


def ranking_table(found: SweepReport) -> Table:
    """Return the tolerances, the one that matters most first."""
    head = [name.replace("_", " ") for name in ("parameter", "part", "tolerance", *found.ranking[0].figures)]
    rows = []
    for p in found.ranking:
        cells = (f"{v:.4g}" if isinstance(v, float) else "" if v is None else str(v) for v in p.figures.values())
        rows.append([p.name, p.part, f"{p.tolerance:.4g} {p.unit}", *cells])
    return Table(head, rows)


def allocation_line(found: AllocatedTolerances) -> str:
    """Return a line on the accuracy that the loosest tolerances keep."""
    figures = found.figures()
    checked = figures["verified"]
    return (
        f"loosest tolerances that keep {figures['requirement_mm']:g} mm for {figures['wanted_share']:.2%} of the "
        f"robots at every pose; exact closures of {checked['robots']} of them at the {checked['poses']} hardest poses: "
        f"{share_text(checked['share_within'])} within, {share_text(checked['share_at_worst_pose'])} at the worst pose"
    )


def allocation_table(found: AllocatedTolerances) -> Table:
    """Return the loosest tolerances, the tightest first; those that hardly matter are at the cap."""
    rows = [
        (
            row["parameter"],
            f"{row['tolerance_mm_or_mrad']:.4g}",
            row["unit"],
            f"{row['factor']:.3f}",
            "at the cap" * row["at_cap"],
        )
        for row in sorted(found.figures()["tolerances"], key=lambda row: float(row["factor"]))
    ]
    return Table(("parameter", "tolerance", "unit", "times the given one", ""), rows)


def html_report(found: SweepReport, study: Any, links: Mapping[str, str]) -> str:
    """Return the report, with the picture of :func:`study_figure`, as one page without external files."""
    plan, frame = found.store.plan, found.summary.frame
    config = plan.config
    over = f"RMS over the {_robots(plan)}"
    where = f"How far {frame} is {plan.off}, {over}: slices of the workspace, the worst orientation there"
    blocks: list[Block] = [
        Paragraph(found.headline, "headline"),
        Lines(summary_lines(found)),
        Paragraph(f"{_study(config)}; seed {config.seed}; content of the sweep {plan.content_hash}"),
        Plot(f"What matters, and how far {frame} is {plan.off}", svg_of(study)),
        Heading("Where in the workspace"),
        Plot(where, svg_of(map_of(plan, found.summary))),
    ]
    if found.allocation:
        blocks += [Heading("The loosest tolerances that will do"), Paragraph(allocation_line(found.allocation))]
        blocks.append(allocation_table(found.allocation))
    blocks += [Heading(f"The tolerances that matter most ({frame})"), ranking_table(found)]
    title = f"Sweep in {found.store.folder.name}"
    return html_page(title, blocks, links=links, data=[config.source] if config.source else [])


@own_look()
def study_figure(found: SweepReport) -> Any:
    """Draw box plots of the errors that matter most, or their shares and the error of the tool."""
    figure = new_figure(9.0, 6.0)
    shown, summary, config = found.ranking[:_SHOWN], found.summary, found.store.plan.config
    if config.study == "one_at_a_time":
        axes = figure.subplots()
        moved = found.to_dataset().displacement
        boxes = [_distances_mm(moved, parameter.name) for parameter in shown]
        axes.boxplot(boxes, orientation="horizontal", showfliers=False, whis=(0, 100))
        _name_rows(axes, shown)
        axes.set_xlabel(f"displacement of {summary.frame} over the poses, mm; each error alone at its tolerance")
    else:
        left, right = figure.subplots(1, 2)
        for bar, p in zip(left.barh(range(1, len(shown) + 1), [p.weight for p in shown]), shown, strict=True):
            tell(bar, [f"{p.name} ({p.part}): {p.weight:.4g}"])
        _name_rows(left, shown)
        left.set_xlabel("total Sobol index" if config.study == "sobol" else "share of the scatter, first order")
        _cumulative(right, summary)
    figure.suptitle(_study(config))
    return figure


def _study(config: SweepConfig) -> str:
    return f"{config.study}, {config.kind}".replace("_", " ")


@own_look()
def map_of(plan: SweepPlan, summary: Summary) -> Any:
    """Draw the tool's error over x and z, in slices of y: RMS over the robots, the largest at each position."""
    place = plan.poses.start.position / MM
    off = np.linalg.norm(summary.by_pose.rms_m, axis=1) / MM
    values = np.unique(place[:, 1].round(3))
    slices = values if values.size <= _SLICES else np.quantile(place[:, 1], (np.arange(_SLICES) + 0.5) / _SLICES)
    of_slice = np.abs(place[:, 1, None] - slices).argmin(axis=1)
    figure = new_figure(3.1 * len(slices) + 1.2, 3.4)
    panels = figure.subplots(1, len(slices), sharex=True, sharey=True, squeeze=False)[0]
    for k, panel in enumerate(panels):
        chosen = np.flatnonzero((of_slice == k) & np.isfinite(off))
        chosen = chosen[np.argsort(off[chosen], kind="stable")]  # the worst on top
        x, z = place[chosen, 0], place[chosen, 2]
        drawn = panel.scatter(x, z, c=off[chosen], s=90, marker="s", vmin=0.0, vmax=np.nanmax(off, initial=1e-9))
        near = "" if values.size <= _SLICES else "near "
        at = (", ".join(f"{axis} {v:z.0f}" for axis, v in zip("xyz", place[i], strict=True)) for i in chosen)
        tell(drawn, [f"pose {i + 1}: {words} mm: {off[i]:.3f} mm" for i, words in zip(chosen, at, strict=True)])
        panel.set(title=f"{near}y = {slices[k]:z.0f} mm", xlabel="x [mm]")
        panel.margins(0.15)
        tidy(panel)
    panels[0].set_ylabel("z [mm]")
    figure.colorbar(drawn, ax=panels, label="mm")
    return figure


def _name_rows(axes: Any, shown: Sequence[RankedParameter]) -> None:
    axes.set_yticks(range(1, len(shown) + 1), [f"{p.name}  {p.tolerance:.3g} {p.unit}" for p in shown], fontsize=8)
    axes.invert_yaxis()
    axes.grid(axis="x", alpha=0.3)


def _cumulative(axes: Any, summary: Summary) -> None:
    counts = summary.distances.counts[:-1]
    used = counts.nonzero()[0]
    if used.size:
        part = slice(max(0, int(used[0]) - 1), int(used[-1]) + 2)
        axes.plot(summary.distances.edges_m[part] / MM, np.cumsum(counts)[part] / counts.sum())
    axes.axvline(summary.accuracy_m / MM, linestyle="--", color="tab:red", label="required")
    axes.set_xlabel(f"displacement of {summary.frame}, mm")
    axes.set_ylabel("share of robots and poses")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    low, high = axes.get_xlim()
    axes.xaxis.set_minor_formatter("{x:g}" if high < 10.0 * low else "")
    axes.grid(alpha=0.3)
    axes.legend()


def _distances_mm(displacement: xr.DataArray, name: str) -> FloatArray:
    """Return the distances of one parameter of a one-at-a-time study, evenly thinned out."""
    step = -(-displacement.sizes["pose"] // _POINTS)
    distances = np.linalg.norm(displacement.sel(parameter=name)[::step, 0].to_numpy(), axis=-1) / MM
    return np.asarray(distances[np.isfinite(distances)])
