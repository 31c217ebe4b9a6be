"""Pictures of a diagnosis: the gap, residuals over conditions, what each effect does, the evidence, the remainder."""

import textwrap
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.diagnoser import State
from pouring_robot.diagnosis.gap import Gap, in_base, table_of
from pouring_robot.diagnosis.learned_shape import Shape, shape_of
from pouring_robot.effects.base import Effect
from pouring_robot.effects.condition_facts import axis_over
from pouring_robot.effects.conditions import RISE, Conditions
from pouring_robot.estimation.intervals import deviations95
from pouring_robot.estimation.kinds import KINDS, are, component_name, component_shown_in
from pouring_robot.inference.decision import Cause
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, evenly_spaced
from pouring_robot.report.plots import AFTER, BEFORE, COLOURS, GREY, HELD_OUT, new_figure, own_look, svg_of, tell

_MOST_EFFECTS, _FEW_VALUES = 4, 6
_MOST_ROWS = 1000  # more points would show no more and slow the page down
_NARROW = 4.0
_TITLE_LETTERS = 120  # longer lines would not fit into the picture


@own_look()
def plots(diagnosis: Conclusions) -> list[tuple[str, str]]:
    """Return titles and SVG, most important first."""
    words = diagnosis.rows.conditions.causes.words
    count, shown = len(diagnosis.rows), int(_shown(diagnosis).sum())
    some = f"; {shown} of {count} rows drawn" if shown < count else ""
    held = "no row held out" if diagnosis.fitted.all() else "held-out rows ringed"
    measured = diagnosis.rows.measured.known[:, :6].any()  # otherwise there are no axes
    axes, own = (f"{whose}'s axes; " if measured else "" for whose in ("tracker", words.base))
    drawn = [
        (f"The gap of each component, before and after (RMS, {axes}logarithmic)", _gap(diagnosis)),
        (f"Residuals over conditions, before and after ({own}{held}{some})", _residuals(diagnosis)),
    ]
    if diagnosis.firm:
        drawn.append((f"What each effect does at the {words.tip}, in these poses{some}", _signatures(diagnosis)))
    if diagnosis.hypothesis.items:
        drawn.append(("Evidence: step by step, and with each effect replaced by another", _evidence(diagnosis)))
    drawn.append((f"What is left after the best known effects, relative to the noise{some}", _discrepancy(diagnosis)))
    return drawn


def _shown(diagnosis: Conclusions) -> BoolArray:
    """Return which rows are drawn, shape (n,): all, or an even selection of many."""
    count = len(diagnosis.rows)
    return np.isin(np.arange(count), evenly_spaced(count, _MOST_ROWS))


def _gap(diagnosis: Conclusions) -> str:
    gaps = diagnosis.gaps
    known = np.flatnonzero(np.any([np.isfinite(gap.before) for gap in gaps.values()], axis=0))
    parts = (known[(known >= low) & (known < high)] for low, high in ((0, 3), (3, 6), (6, known[-1] + 1)))
    panels = [part for part in parts if part.size]
    figure = new_figure(9.0, 3.0)
    for part, axes in zip(panels, np.atleast_1d(figure.subplots(1, len(panels))), strict=True):
        _gap_panel(axes, gaps, part, amended=not diagnosis.refused)
    figure.legend(*axes.get_legend_handles_labels(), ncols=4, loc="outside upper center", fontsize=8)
    return svg_of(figure)


def _gap_panel(axes: Any, gaps: dict[str, Gap], part: Indices, *, amended: bool) -> None:
    (unit, si), places = component_shown_in(int(part[0])), np.arange(part.size)
    for shift, (name, gap) in zip((0.14, -0.14), gaps.items(), strict=False):
        before, after, floor = gap.before[part] / si, gap.after[part] / si, gap.floor[part] / si
        place = places + (shift if len(gaps) > 1 else 0.0)
        filled, words = name == "held_out", name.replace("_", " ").replace("train", "fitted")
        axes.hlines(place, after, before, color=GREY, linewidth=1.0)
        shown = ((before, BEFORE, "before"), (after, AFTER, "after")) if amended else ((before, BEFORE, "before"),)
        for values, colour, label in shown:
            face = colour if filled or len(gaps) == 1 else "white"
            (dots,) = axes.plot(values, place, "o", color=colour, markerfacecolor=face, label=f"{label}, {words}")
            tell(dots, [f"{label}, {words}: {value:.4f} {unit}" for value in values if np.isfinite(value)])
        if name == next(iter(gaps)):
            axes.vlines(floor, places - 0.35, places + 0.35, color="black", linestyle="--", label="noise")
    axes.set_xscale("log")
    axes.set_yticks(places, [component_name(k) for k in part.tolist()])
    axes.set_ylim(part.size - 0.5, -0.5)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    low, high = axes.get_xlim()
    labelled = "25" if high > _NARROW * low else "23456789"
    axes.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in labelled else "")
    axes.tick_params(axis="x", which="both", labelsize=8)
    axes.set_xlabel(f"RMS [{unit}]")
    axes.grid(axis="x", which="both", alpha=0.2)


def _residuals(diagnosis: Conclusions) -> str:
    given = diagnosis.rows.conditions
    drawn = residual_axes(given, diagnosis.diagnoser.library.effects.values())
    shown = [axis for axis in (axis_over((name,), given) for name in drawn) if not axis.of_rows]
    shown = shown or [axis_over((), given)]
    kinds = [("before", BEFORE, diagnosis.before), ("after", AFTER, diagnosis.after)][: 1 if diagnosis.refused else 2]
    tables = [_residual_table(diagnosis, state) for *_, state in kinds]
    width, height = max(1.75 * len(shown), 5.0), 5.6
    figure = new_figure(width, height)
    figure.set_layout_engine(None)  # the layout of so many panels takes longer than drawing them
    room = {"left": 0.7 / width, "right": 1.0 - 0.1 / width, "bottom": 0.5 / height, "top": 1.0 - 0.4 / height}
    measured = np.flatnonzero(np.isfinite(tables[0]).any(axis=0))
    lengths = measured[measured < 3] if (measured < 3).any() else measured[measured >= 6]
    shared: dict[str, Any] = {"sharex": "col", "sharey": "row", "gridspec_kw": room | {"wspace": 0.1, "hspace": 0.1}}
    grid = figure.subplots(len(lengths), len(shown), squeeze=False, **shared)
    for k, row in zip(lengths.tolist(), grid, strict=True):
        for axis, axes in zip(shown, row, strict=True):
            for table, (label, colour, _) in zip(tables, kinds, strict=True):
                values = table[:, k] / MM
                (dots,) = axes.plot(axis.values, values, ".", color=colour, markersize=3, label=label)
                tell(dots, _row_words(diagnosis, values, label, np.isfinite(axis.values)))
            held = ~diagnosis.fitted
            if held.any():
                words = f"held out, {kinds[-1][0]}"
                ring = {"color": HELD_OUT, "markersize": 5, "markerfacecolor": "none", "markeredgewidth": 0.6}
                axes.plot(axis.values[held], tables[-1][held, k] / MM, "o", label=words, **ring)
            axes.axhline(0.0, color="black", linewidth=0.5)
            axes.grid(alpha=0.2)
            axes.tick_params(labelsize=7)
            axes.locator_params(nbins=4)
        row[0].set_ylabel(f"{component_name(k)} [mm]")
    figure.align_ylabels()
    for axis, axes in zip(shown, grid[-1], strict=True):
        axes.set_xlabel(axis.label, fontsize=7)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), ncols=3, loc="upper right", fontsize=8)
    return svg_of(figure)


def _row_words(diagnosis: Conclusions, values: FloatArray, label: str, drawn: BoolArray) -> list[str]:
    """Return labels for the points of the rows that are drawn."""
    named = zip(diagnosis.rows.campaign.lines, values, drawn, strict=True)
    return [f"line {line}: {value:+z.3f} mm {label}" for line, value, there in named if there and np.isfinite(value)]


def residual_axes(given: Conditions, effects: Iterable[Effect]) -> list[str]:
    """Return the names of the conditions over which residuals are drawn: time, load, travels, heat and pose."""
    driving = dict.fromkeys(name for effect in effects for name in (*effect.needs, effect.driver))
    rises = [name for name in driving if name.endswith(RISE)]
    pose = "height_m" if given.tilt_rad is None else "tilt_rad"
    return ["time_s", "weight_n", *(f"{name}_m" for name in given.travels), *rises, pose]


def _residual_table(diagnosis: Conclusions, state: State) -> FloatArray:
    table = table_of(state.every_row, state.every_row.residual, len(diagnosis.rows))
    table[~_shown(diagnosis)] = np.nan
    turned = in_base(table, state.frames.T_tracker_base.rotation)
    # If no row has all three coordinates they cannot be rotated from the tracker's axes.
    return table if np.isnan(turned[:, :3]).all() else turned


def _signatures(diagnosis: Conclusions) -> str:
    shown = diagnosis.firm[:_MOST_EFFECTS]
    given, known = diagnosis.rows.conditions, diagnosis.diagnoser.library.effects
    figure = new_figure(9.5, 0.3 + 2.6 * len(shown))
    for effect, panel in zip(shown, figure.subfigures(len(shown), 1, squeeze=False).flat, strict=True):
        shape = shape_of(diagnosis, effect)
        sides = list(panel.subplots(1, 1 if shape is None else 2, squeeze=False).flat)
        axes = sides[0]
        name = effect.cause.effect
        moved = np.where(_shown(diagnosis)[:, None], diagnosis.moved[name] / MM, np.nan)
        axis = known[name].axis(given)
        for k, colour in enumerate(COLOURS[:3]):
            (dots,) = axes.plot(axis.values, moved[:, k], ".", color=colour, markersize=5, label="xyz"[k])
            tell(dots, _row_words(diagnosis, moved[:, k], f"in {'xyz'[k]}", np.isfinite(axis.values)))
        axes.axhline(0.0, color="black", linewidth=0.5)
        axes.set(xlabel=axis.label, ylabel=f"{given.causes.words.tip.split()[-1]} displacement [mm]")
        if shape is not None:
            _shape_panel(sides[1], shape, deviations95(diagnosis.noise.dof))
        panel.suptitle(textwrap.fill(f"{name}: {effect.story}", _TITLE_LETTERS), fontsize=9)
        for side in sides:
            if np.unique(axis.values).size <= _FEW_VALUES:
                side.set_xticks(np.unique(axis.values))
            side.grid(alpha=0.2)
            side.legend(fontsize=8, loc="best")
    return svg_of(figure)


def _shape_panel(axes: Any, shape: Shape, deviations: float) -> None:
    """Draw an effect's learned shape, plus and minus some standard deviations (95 %), and the textbook's."""
    order = np.argsort(shape.axis.values, kind="stable")
    order = order[evenly_spaced(order.size, _MOST_ROWS)]
    over, learned = shape.axis.values[order], shape.learned[order]
    error = deviations * shape.std[order]
    axes.errorbar(over, learned, error, fmt="none", ecolor=AFTER, alpha=0.25, linewidth=2.0, label="95 %")
    axes.plot(over, learned, ".", color=AFTER, markersize=4, label="as learned")
    axes.plot(over, shape.textbook[order], ".", color=GREY, markersize=3, label="main parameters alone")
    axes.set(xlabel=shape.axis.label, ylabel=f"{shape.channel} [{shape.unit}]")


def _evidence(diagnosis: Conclusions) -> str:
    hypothesis = diagnosis.hypothesis
    causes = [cause for cause in diagnosis.judgement.causes if cause.indices][:_MOST_EFFECTS]
    steps = evidence_steps(hypothesis)
    figure = new_figure(9.5, 1.2 + 0.3 * len(steps) + 3.1 * ((len(causes) + 1) // 2))
    heights = [1.0 + 0.3 * len(steps), *[3.1] * ((len(causes) + 1) // 2)]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    axes = figure.add_subplot(grid[0, :])
    _bars(axes, steps, AFTER, 8, margin=0.1)
    axes.set_xlabel("log evidence over workmanship alone [nats]", fontsize=8)
    for k, cause in enumerate(causes):
        _rival_panel(figure.add_subplot(grid[1 + k // 2, k % 2]), hypothesis, cause)
    return svg_of(figure)


def _bars(axes: Any, named: list[tuple[str, float]], colour: Any, size: float, margin: float) -> None:
    """Draw named values as bars from the top, each with its figure, in a font size."""
    places = range(len(named))
    axes.barh(places, [value for _, value in named], color=colour)
    axes.set_yticks(places, [name for name, _ in named], fontsize=size)
    axes.invert_yaxis()
    for k, (_, value) in enumerate(named):
        axes.annotate(f" {value:.0f}", (max(value, 0.0), k), va="center", fontsize=size)
    axes.margins(x=margin)


def _rival_panel(axes: Any, hypothesis: Hypothesis, cause: Cause) -> None:
    rivals = sorted(rival_margins(hypothesis, cause).items(), key=lambda item: item[1])
    colours = [BEFORE if name in cause.alternatives else GREY for name, _ in rivals]
    _bars(axes, rivals, colours, 7, margin=0.15)
    axes.tick_params(axis="x", labelsize=7)
    axes.set_title(f"instead of {cause.effect}", fontsize=9)
    orange = "; orange: cannot be distinguished" if BEFORE in colours else ""
    axes.set_xlabel(f"log evidence lost [nats]{orange}", fontsize=7)


def evidence_steps(hypothesis: Hypothesis) -> list[tuple[str, float]]:
    """Return the log evidence over that without explanations, as these are added in the order they were found."""
    current = replace(hypothesis, items=(), scales=()).settled()
    start, steps = current.log_evidence, []
    for item, scale in zip(hypothesis.items, hypothesis.scales, strict=True):
        current = current.with_item(item, scale)
        steps.append((f"+ {item.effect} ({item.form.replace('_', ' ')})", current.log_evidence - start))
    return steps


def rival_margins(hypothesis: Hypothesis, cause: Cause) -> dict[str, float]:
    """Return by how much log evidence drops with another effect in place of a cause, best form of each, in nats.

    Close rivals are as they were judged; others as they are before settling, with all else held.
    """
    own, best = hypothesis.worth(cause.indices), hypothesis.without(cause.indices).best_forms(hypothesis.rivals)
    judged = {effect: -margin for effect, margin in cause.margins.items()}
    return {effect: own - worth.evidence for effect, (worth, _) in best.items()} | judged


def _discrepancy(diagnosis: Conclusions) -> str:
    linear = diagnosis.before.every_row if diagnosis.refused else diagnosis.after.every_row
    figure = new_figure(9.5, 3.6)
    left, right = figure.subplots(1, 2, width_ratios=(2.0, 1.0))
    given = diagnosis.rows.conditions
    place = np.argsort(np.argsort(given.time_s, kind="stable"))
    shown = _shown(diagnosis)
    for kind, colour in zip(KINDS, (AFTER, HELD_OUT, *COLOURS), strict=False):
        chosen = are(kind, linear.component) & shown[linear.row]
        if chosen.any():
            left.plot(place[linear.row[chosen]], linear.residual[chosen], ".", color=colour, markersize=3, label=kind)
    if diagnosis.remainder:
        first = diagnosis.remainder[0]
        values = first.missed[:, first.worst] / diagnosis.rows.measured.sigma[first.worst]
        words = first.structure.process.words
        left.plot(place[shown], values[shown], "x", color=BEFORE, markersize=4, label=f"{first.component}: {words}")
    left.axhspan(-2.0, 2.0, color=GREY, alpha=0.2, linewidth=0)
    left.set(xlabel=f"rows in order of {'time' if given.time_known else 'the file'}", ylabel="residual / noise")
    left.legend(fontsize=8, loc="best")
    values = np.sort(linear.residual)
    expected = ndtri((np.arange(values.size) + 0.5) / values.size)
    drawn = evenly_spaced(values.size, _MOST_ROWS)
    right.plot(expected[drawn], values[drawn], ".", color=AFTER, markersize=3)
    right.plot(expected, expected, color="black", linewidth=0.7)
    right.set(xlabel="expected of noise", ylabel="residual / noise, sorted")
    for axes in (left, right):
        axes.grid(alpha=0.2)
    return svg_of(figure)
