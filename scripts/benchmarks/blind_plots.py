"""Pictures of blind trials: how well stated probabilities are calibrated, and from which size on effects are named."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.report.plots import COLOURS, DARK_GREY, new_figure, png_of, tidy
from scripts.benchmarks.blind_metrics import Share, power, reliability
from tests.diagnosis.trial import Trial

_LEAST = 1e-3
"""The least chance of being wrong that the reliability diagram shows; no false name at all is drawn there, too."""


def draw(sets: Sequence[tuple[str, Sequence[Trial]]], path: Path) -> None:
    """Draw the reliability diagram and the power curve of each set of trials, with its name, as a PNG."""
    figure = new_figure(10.0, 4.4)
    stated, sizes = figure.subplots(1, 2)
    for (name, found), colour, shift in zip(sets, COLOURS, np.geomspace(0.95, 1.05, len(sets)), strict=False):
        _draw_reliability(stated, reliability([t for t in found if not t.excluded]), name, colour, shift)
        _draw_power(sizes, power(found), name, colour, shift)
    stated.plot([_LEAST, 1], [_LEAST, 1], color=DARK_GREY, linestyle="--", linewidth=1, label="as stated")
    stated.set(xscale="log", yscale="log", xlim=(1, 0.5 * _LEAST), ylim=(1, 0.5 * _LEAST))
    stated.set(xlabel="stated chance that the name is false", ylabel="share of false names, 95 % interval")
    for axis in (stated.xaxis, stated.yaxis):
        axis.set_major_formatter("{x:g}")
    sizes.set(xscale="log", ylim=(0, 1.03), xlabel="size of a single effect over the noise (both RMS)")
    sizes.set(ylabel="named, alone or in a group, 95 % interval")
    sizes.set_xticks([1, 2, 3, 5, 10], ["1", "2", "3", "5", "10"])
    sizes.minorticks_off()
    for panel in (stated, sizes):
        tidy(panel)
        panel.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    path.write_bytes(png_of(figure))


def _draw_reliability(panel: Any, shares: Sequence[Share], name: str, colour: str, shift: float) -> None:
    """Draw shares of names that do not stand over what was stated of them."""
    there = [s for s in shares if s.total]
    x = [max(1 - s.mean, _LEAST) * shift for s in there]
    right = _with_ends(there)
    _draw_shares(panel, x, (1.0 - right[:, [0, 2, 1]]).clip(_LEAST, 1), name, colour, joined=False)


def _draw_power(panel: Any, shares: Sequence[Share], name: str, colour: str, shift: float) -> None:
    """Draw the share of single effects named over the middle of each range of sizes."""
    there = [s for s in shares if s.total]
    x = [s.mean * shift for s in there]
    _draw_shares(panel, x, _with_ends(there), name, colour, joined=True)


def _with_ends(shares: Sequence[Share]) -> np.ndarray:
    """Return each share with both ends of its interval, (n, 3)."""
    figures = [s.figure for s in shares]
    return np.array([[f.value, f.low, f.high] for f in figures]).reshape(-1, 3)


def _draw_shares(panel: Any, x: Sequence[float], y: np.ndarray, name: str, colour: str, *, joined: bool) -> None:
    """Draw values, low and high ends (n, 3) with their intervals."""
    bars = np.abs(y[:, 1:] - y[:, :1]).T
    line = "-" if joined else "none"
    panel.errorbar(x, y[:, 0], yerr=bars, fmt="o", linestyle=line, color=colour, capsize=2, markersize=4, label=name)
