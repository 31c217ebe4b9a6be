"""How single errors move a robot over many poses: sizes, directions, the shapes of their distributions, pictures."""

from __future__ import annotations

import functools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Literal, Self, TypeVar

import numpy as np

from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.report.plots import ASH, BRICK, STEEL, new_figure, own_look, tidy
from pouring_robot.robot.dh.table import DHParameter
from pouring_robot.robot.parameter_catalogue import Parameter

AXES = "XYZ"
ChainKind = Literal["open branch", "closed chain"]
NOTHING_M = 1e-9
"""Less than this is round-off: the error moves nothing."""
_BIN_M = 0.005 * MM  # width of the bins of which the fullest is found; the paper's 1.3175 mm is a centre
_BAND = 0.02  # values within this share of the fullest bin's centre count as piled up there

P = TypeVar("P", Parameter, DHParameter)


@dataclass(frozen=True, eq=False)
class ErrorSamples(Generic[P]):
    """How each error alone moves one frame of the robot, in the axes of its base."""

    kind: ChainKind
    parameters: tuple[P, ...]  # the errors, P of them
    translation_m: FloatArray  # shape (P, n, 3)
    rotation_rad: FloatArray  # rotation vectors, shape (P, n, 3)

    def subset(self, wanted: Collection[P]) -> Self:
        """Return the samples of some of the parameters, in the order they have here."""
        places = [k for k, parameter in enumerate(self.parameters) if parameter in wanted]
        chosen = tuple(self.parameters[k] for k in places)
        moves, turns = self.translation_m[places], self.rotation_rad[places]
        return replace(self, parameters=chosen, translation_m=moves, rotation_rad=turns)

    def moves(self, label: str) -> FloatArray:
        """Return the translations of the error with this one of the :attr:`labels`, shape (n, 3), in m."""
        return np.asarray(self.translation_m[self.labels.index(label)])

    def main_axis(self, label: str | int) -> str:
        """Return the axis that one error, by label or index, changes most on average; ``none`` if it moves nothing."""
        means = self.mean_m[label if isinstance(label, int) else self.labels.index(label)]
        return AXES[int(means.argmax())] if means.max() > NOTHING_M else "none"

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the parameters; short ones, without the chain, where all belong to one chain."""
        one_chain = len({parameter.chain for parameter in self.parameters}) == 1
        return tuple(short_label(parameter) if one_chain else parameter.name for parameter in self.parameters)

    @functools.cached_property
    def peak_m(self) -> FloatArray:
        """Largest absolute coordinate over the poses, shape (P, 3), in m."""
        return np.asarray(np.abs(self.translation_m).max(axis=1))

    @functools.cached_property
    def mean_m(self) -> FloatArray:
        """Mean absolute coordinate over the poses, shape (P, 3), in m."""
        return np.asarray(np.abs(self.translation_m).mean(axis=1))

    @functools.cached_property
    def distance_m(self) -> FloatArray:
        """Length of the translation, shape (P, n), in m."""
        return np.asarray(np.linalg.norm(self.translation_m, axis=-1))

    @functools.cached_property
    def angle_rad(self) -> FloatArray:
        """Angle of the rotation, shape (P, n), in rad."""
        return np.asarray(np.linalg.norm(self.rotation_rad, axis=-1))


def short_label(parameter: Parameter | DHParameter) -> str:
    """Return the name of a DH parameter without its chain (``α56``, ``a6o``, ``θ1``), other names as they are."""
    symbol, _, place = parameter.name.partition(f"_e{parameter.chain}_")
    return {"alpha": "α", "theta": "θ"}.get(symbol, symbol) + place


def peak(values: FloatArray) -> tuple[float, float, float]:
    """Return the centre of the fullest bin, the share of values within 2 % of it, and that over the uniform share."""
    bins, counts = np.unique(np.floor(values / _BIN_M), return_counts=True)  # near a singular pose they are far apart
    centre = (float(bins[counts.argmax()]) + 0.5) * _BIN_M
    band = max(_BAND * abs(centre), 0.5 * _BIN_M)
    share = float(np.mean(np.abs(values - centre) < band))
    return centre, share, share / (2.0 * band / max(float(np.ptp(values)), 2.0 * band))


def uniform_gap(values: FloatArray) -> float:
    """Return how far the middle 90 % of values are from uniform: largest difference of distribution functions."""
    low, high = np.quantile(values, [0.05, 0.95])
    middle = np.sort(values[(values >= low) & (values <= high)])
    if high - low < 1e-12:
        return 1.0
    return float(np.abs((middle - low) / (high - low) - np.linspace(0.0, 1.0, len(middle))).max(initial=0.0))


def median_place(values: FloatArray) -> float:
    """Return where the median of the absolute values lies between their least (0) and largest (1)."""
    absolute = np.abs(values)
    span = float(np.ptp(absolute))
    return float((np.median(absolute) - absolute.min()) / span) if span > 0.0 else 0.5


@own_look()
def box_plots(large: ErrorSamples[P], title: str, limit_m: float = MM) -> Any:
    """Draw absolute coordinates of errors, such as those beyond a limit, over the poses, as the paper's Fig. 4."""
    figure = new_figure(10.0, 3.9)
    panels = figure.subplots(1, 3, sharey=True)
    values = np.abs(large.translation_m) / MM
    top = 1.08 * float(values.max(initial=1.0))
    looks: dict[str, Any] = {f"{part}props": {"color": STEEL} for part in ("whisker", "cap")}
    looks |= {"boxprops": {"facecolor": "#c9dbe8", "edgecolor": STEEL}}
    looks |= {"medianprops": {"color": BRICK, "linewidth": 1.6}}
    for a, (panel, axis) in enumerate(zip(panels, AXES, strict=True)):
        panel.boxplot([row[:, a] for row in values], whis=(0, 100), widths=0.6, patch_artist=True, **looks)
        panel.axhline(limit_m / MM, color=ASH, linewidth=0.9, linestyle="--")
        upright = len(large.labels) > 9 or max(map(len, large.labels), default=0) > 4
        panel.set_xticks(range(1, len(large.labels) + 1), large.labels, rotation=90 * upright)
        panel.set_title(f"|Δ{axis}|", fontsize=11)
        panel.set_ylim(0.0, top)
        tidy(panel)
    panels[0].set_ylabel("position error, mm")
    figure.suptitle(title, fontsize=11)
    return figure


@own_look()
def distributions(errors: ErrorSamples[P], labels: Sequence[str], title: str) -> Any:
    """Draw distributions of errors, by label from top to bottom, over the poses, axis by axis: the paper's Fig. 5."""
    from matplotlib.ticker import MaxNLocator

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
        panel.set_title(f"Δ{axis}", fontsize=11)
        panel.set_xlabel("mm")
        panel.set_xlim(low, high)
        panel.xaxis.set_major_locator(MaxNLocator(5))
        panel.set_ylim(-0.15, len(labels) + 0.3)
        panel.set_yticks(range(len(labels)), list(reversed(labels)))
        tidy(panel)
        panel.grid(visible=False)
    panels[0].set_ylabel("error; share of poses, each scaled to its own height")
    figure.suptitle(title, fontsize=11)
    return figure
