"""How single errors spread over the poses: box plots and distributions."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from pouring_robot.mechanism.poses import MM
from pouring_robot.report.plots import ASH, BRICK, STEEL, new_figure, tidy
from pouring_robot.sensitivity.samples import AXES, NOTHING_M, ErrorSamples, P


def box_plots(large: ErrorSamples[P], title: str, limit_m: float = MM) -> Any:
    """Draw absolute coordinates of errors, such as those that pass a limit, over the poses, as the paper's Fig. 4."""
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
        panel.axhline(limit_m / MM, color=ASH, linewidth=0.9, linestyle="--")
        panel.set_xticks(range(1, len(large.labels) + 1), large.labels, rotation=90 * (len(large.labels) > 9))
        panel.set_title(f"|Δ{axis}|", fontsize=11)
        panel.set_ylim(0.0, top)
        tidy(panel)
    panels[0].set_ylabel("position error, mm")
    figure.suptitle(title, fontsize=11)
    return figure


def distributions(errors: ErrorSamples[P], labels: Sequence[str], title: str, mark_m: float | None = None) -> Any:
    """Draw how errors of some labels, from top to bottom, spread over the poses, axis by axis, as the paper's Fig. 5.

    ``mark_m``: a place that is marked in X, both signs.
    """
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
        if axis == "X" and mark_m is not None:
            for place in (-mark_m / MM, mark_m / MM):
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
    return figure
