"""Plots of a sweep: what matters most, how far the tool is off, and where in the workspace."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.report.plots import new_figure, tell, tidy
from pouring_robot.sweeps.analysis.summary import Summary
from pouring_robot.sweeps.analysis.tolerances import RankedParameter
from pouring_robot.sweeps.plan import SweepPlan
from pouring_robot.sweeps.store import SweepStore

_SHOWN, _SLICES = 20, 3
_POINTS = 2000  # of each box at most: the picture shows no more


def study_figure(store: SweepStore, summary: Summary, ranking: Sequence[RankedParameter]) -> Any:
    """Draw box plots of the errors that matter most, or their shares and how far the tool is off."""
    figure = new_figure(9.0, 6.0)
    shown = ranking[:_SHOWN]
    config = store.plan.config
    if config.study == "one_at_a_time":
        axes = figure.subplots()
        boxes = [_distances_mm(store, parameter.name) for parameter in shown]
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
    figure.suptitle(f"{config.study.replace('_', ' ')}, {config.kind.replace('_', ' ')}")
    return figure


def map_of(plan: SweepPlan, summary: Summary) -> Any:
    """Draw how far the tool is off over x and z, in slices of y: RMS over the robots, the largest of a place."""
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
        at = (", ".join(f"{axis} {v:.0f}" for axis, v in zip("xyz", place[i], strict=True)) for i in chosen)
        tell(drawn, [f"pose {i + 1}: {words} mm: {off[i]:.3f} mm" for i, words in zip(chosen, at, strict=True)])
        panel.set(title=f"{near}y = {slices[k]:.0f} mm", xlabel="x [mm]")
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
    axes.grid(alpha=0.3)
    axes.legend()


def _distances_mm(store: SweepStore, name: str) -> FloatArray:
    """Return the distances of one parameter of a one-at-a-time study, evenly thinned out."""
    plan = store.plan
    row = plan.names.index(name)
    block, inside = divmod(row, plan.sample_block)
    step = -(-len(plan.poses) // _POINTS)
    parts = [store.read("displacement", plan.chunk((block, j)))[inside, ::step, 0] for j in range(plan.chunk_grid[1])]
    distances = np.linalg.norm(np.concatenate(parts), axis=-1) / MM
    return np.asarray(distances[np.isfinite(distances)])
