"""Open branch against closed chain. PNG, in memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from pouring_robot.io.units import MM
from pouring_robot.report.plots import ASH, BRICK, STEEL, new_figure, png_of, tidy
from pouring_robot.sensitivity.samples import AXES
from scripts.paper.geometry.comparison import axis_rows
from scripts.paper.geometry.study import GeometryStudy

_SMALL = {"fontsize": 9}
_NOTE = {"color": ASH, "fontsize": 8, "ha": "center"}


def open_against_closed(study: GeometryStudy, title: str) -> bytes:
    """Draw mean absolute coordinates of chain 1's errors, open branch against closed chain, with ratios; PNG."""
    opened, closed = study.open_branch.of_chain(1), study.closed_chain.of_chain(1)
    figure = new_figure(10.0, 6.6)
    panels = figure.subplots(1, 3, sharey=True, sharex=True)
    rows = np.arange(len(opened.labels))[::-1]
    floor, required_mm = 1e-3, study.layout.workspace.accuracy.metres / MM
    for a, (panel, axis, ratio) in enumerate(zip(panels, AXES, axis_rows(study), strict=False)):
        before, after = (np.maximum(errors.mean_m[:, a] / MM, floor) for errors in (opened, closed))
        panel.hlines(rows, before, after, color="#cccccc", linewidth=1.4)
        panel.plot(before, rows, "o", color=STEEL, markersize=5, label="open branch", fillstyle="none")
        panel.plot(after, rows, "o", color=BRICK, markersize=5, label="closed chain")
        panel.axvline(required_mm, color=ASH, linewidth=0.9, linestyle="--")
        panel.set_xscale("log")
        panel.set_xlim(0.8 * floor, 60.0)
        panel.set_xticks([1e-3, 1e-2, 1e-1, 1.0, 10.0], ["≤0.001", "0.01", "0.1", "1", "10"])
        panel.set_title(f"|Δ{axis}|   (rms of all errors × {ratio.ratio:.2g})", fontsize=11)
        panel.set_xlabel("mean over poses, mm")
        panel.set_yticks(rows, opened.labels, **_SMALL)
        tidy(panel)
        panel.text(required_mm, rows[0] + 0.6, f"{required_mm:g} mm required", **_NOTE)
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=9, frameon=False
    )
    figure.suptitle(title, fontsize=11)
    return png_of(figure)


def mark(figure: Any, place_m: float) -> None:
    """Mark a place in X, both signs, in a figure of distributions."""
    panel = figure.axes[0]
    (low, high), top = panel.get_xlim(), panel.get_ylim()[1]
    for place in (-place_m / MM, place_m / MM):
        if low < place < high:
            panel.axvline(place, color=BRICK, linewidth=0.9, linestyle="--")
            label = f" {'−' if place < 0.0 else '+'}{abs(place):.4f}"
            panel.text(place, top - 0.25, label, color=BRICK, ha="left", fontsize=8)
