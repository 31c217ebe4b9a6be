"""One picture of a sweep: box plots of the errors that matter most, or their shares and how far the ladle is off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.report.plots import new_figure, png_of
from pouring_robot.sweeps.analysis.summary import Summary
from pouring_robot.sweeps.analysis.tolerances import RankedParameter
from pouring_robot.sweeps.store import SweepStore

_SHOWN = 20
_POINTS = 2000  # of each box at most: the picture shows no more


def picture(store: SweepStore, summary: Summary, ranking: Sequence[RankedParameter]) -> bytes:
    """Return a PNG."""
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
        left.barh(range(1, len(shown) + 1), [parameter.weight for parameter in shown])
        _name_rows(left, shown)
        left.set_xlabel("total Sobol index" if config.study == "sobol" else "share of the scatter, first order")
        _cumulative(right, summary)
    figure.suptitle(f"{config.study.replace('_', ' ')}, {config.kind.replace('_', ' ')}")
    return png_of(figure)


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
