"""The paper's Fig. 4 and Fig. 5 from our robot, and open branch against closed chain. PNG, in memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import MaxNLocator

from pouring_robot.mechanism.poses import MM
from pouring_robot.report.plots import ASH, BRICK, STEEL, new_figure, png_of, tidy
from scripts.paper.geometry.comparison import axis_rows
from scripts.paper.geometry.study import AXES, NOTHING_M, PILE_M, ErrorSamples, GeometryStudy

_SMALL = {"fontsize": 9}
_NOTE = {"color": ASH, "fontsize": 8, "ha": "center"}


def box_plots(errors: ErrorSamples, title: str) -> bytes:
    """Draw the paper's Fig. 4: absolute coordinates of one chain's errors that pass 1 mm; PNG."""
    large = errors.reaching(MM)
    figure = new_figure(10.0, 3.9)
    panels = figure.subplots(1, 3, sharey=True)
    values = np.abs(large.translation_m) / MM
    top = 1.08 * float(values.max(initial=1.0))
    for a, (panel, axis) in enumerate(zip(panels, AXES, strict=True)):
        panel.boxplot(
            [row[:, a] for row in values],
            whis=(0, 100),
            widths=0.6,
            patch_artist=True,
            boxprops={"facecolor": "#c9dbe8", "edgecolor": STEEL},
            medianprops={"color": BRICK, "linewidth": 1.6},
            whiskerprops={"color": STEEL},
            capprops={"color": STEEL},
        )
        panel.axhline(1.0, color=ASH, linewidth=0.9, linestyle="--")
        panel.set_xticks(range(1, len(large.labels) + 1), large.labels, rotation=90 * (len(large.labels) > 9))
        panel.set_title(f"|Δ{axis}|", fontsize=11)
        panel.set_ylim(0.0, top)
        tidy(panel)
    panels[0].set_ylabel("position error of o, mm")
    figure.suptitle(title, fontsize=11)
    return png_of(figure)


def distributions(errors: ErrorSamples, labels: Sequence[str], title: str) -> bytes:
    """Draw the paper's Fig. 5: how the most sensitive errors of one chain spread, axis by axis; PNG."""
    figure = new_figure(10.0, 5.2)
    panels = figure.subplots(1, 3, sharey=True)
    for a, (panel, axis) in enumerate(zip(panels, AXES, strict=True)):
        signed = np.stack([errors.moves(label)[:, a] for label in labels]) / MM
        low, high = min(float(signed.min()), 0.0) - 0.15, max(float(signed.max()), 0.0) + 0.15
        bins = np.linspace(low, high, 121)
        for row, values in enumerate(signed):
            base = len(labels) - 1 - row
            panel.axhline(base, color="#dddddd", linewidth=0.6)
            if np.abs(values).max() < NOTHING_M / MM:
                panel.plot([0.0], [base], "o", color=ASH, markersize=3.5)
                panel.annotate("always 0", (0.0, base), (0, 5), textcoords="offset points", ha="center", fontsize=7.5)
                continue
            density = np.histogram(values, bins)[0] / len(values)
            heights = 0.85 * density / density.max()
            panel.stairs(base + heights, bins, baseline=base, fill=True, color=STEEL, alpha=0.35)
            panel.stairs(base + heights, bins, baseline=base, color=STEEL, linewidth=0.9)
        if axis == "X":
            for place in (-PILE_M / MM, PILE_M / MM):
                if low < place < high:
                    panel.axvline(place, color=BRICK, linewidth=0.9, linestyle="--")
                    label = f" {'−' if place < 0.0 else '+'}{abs(place):.4f}"
                    panel.text(place, len(labels) + 0.05, label, color=BRICK, ha="left", fontsize=8)
        panel.set_title(f"Δ{axis}", fontsize=11)
        panel.set_xlabel("mm")
        panel.set_xlim(low, high)
        panel.xaxis.set_major_locator(MaxNLocator(5))
        panel.set_ylim(-0.15, len(labels) + 0.3)
        panel.set_yticks(range(len(labels)), list(reversed(labels)))
        tidy(panel)
        panel.grid(visible=False)
    panels[0].set_ylabel("error; share of poses, each to its own height")
    figure.suptitle(title, fontsize=11)
    return png_of(figure)


def open_against_closed(study: GeometryStudy, title: str) -> bytes:
    """Draw mean absolute coordinates of chain 1's errors, open branch against closed chain, with ratios; PNG."""
    opened, closed = study.open_branch.of_chain(1), study.closed_chain.of_chain(1)
    figure = new_figure(10.0, 6.6)
    panels = figure.subplots(1, 3, sharey=True, sharex=True)
    rows = np.arange(len(opened.labels))[::-1]
    floor = 1e-3
    for a, (panel, axis, ratio) in enumerate(zip(panels, AXES, axis_rows(study), strict=False)):
        before, after = (np.maximum(errors.mean_m[:, a] / MM, floor) for errors in (opened, closed))
        panel.hlines(rows, before, after, color="#cccccc", linewidth=1.4)
        panel.plot(before, rows, "o", color=STEEL, markersize=5, label="open branch", fillstyle="none")
        panel.plot(after, rows, "o", color=BRICK, markersize=5, label="closed chain")
        panel.axvline(study.layout.accuracy_m / MM, color=ASH, linewidth=0.9, linestyle="--")
        panel.set_xscale("log")
        panel.set_xlim(0.8 * floor, 60.0)
        panel.set_xticks([1e-3, 1e-2, 1e-1, 1.0, 10.0], ["≤0.001", "0.01", "0.1", "1", "10"])
        panel.set_title(f"|Δ{axis}|   (rms of all errors × {ratio.ratio:.2g})", fontsize=11)
        panel.set_xlabel("mean over poses, mm")
        panel.set_yticks(rows, opened.labels, **_SMALL)
        tidy(panel)
        panel.text(
            study.layout.accuracy_m / MM, rows[0] + 0.6, f"{study.layout.accuracy_m / MM:g} mm required", **_NOTE
        )
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=9, frameon=False
    )
    figure.suptitle(title, fontsize=11)
    return png_of(figure)
