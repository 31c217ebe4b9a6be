"""A regression in headings, tables and lines, for the terminal and for a page."""

from pathlib import Path

from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Table, html_page
from pouring_robot.report.plots import ASH, COLOURS, new_figure, svg_of, tell, tidy
from pouring_robot.thermal.regression.methods import HELPS_BELOW, NONE, PAPER, POSE
from pouring_robot.thermal.regression.report import AxisRegression, RegressionReport


def html_report(found: RegressionReport) -> str:
    """Return the report as one page without any outside file."""
    source = Path(found.source)
    plot = Plot("What each method leaves of sets left out (RMS), direction by direction", svg_of(_figure(found)))
    title = f"Regression of {source.name}"
    return html_page(title, title, [Paragraph(found.headline, "headline"), plot, *blocks(found)], data=[source])


def blocks(found: RegressionReport) -> list[Block]:
    """Return groups, degrees, formulas and what each method leaves of every direction, then what to beware of."""
    parts = [block for direction, one in found.axes.items() for block in _axis(direction, one)]
    return [*parts, *(Paragraph(f"note: {note}") for note in _warnings(found.axes))]


def _axis(direction: str, one: AxisRegression) -> list[Block]:
    selector, names, regression = one.model.selector_, one.table.names, one.model.component_regression_
    low, high = selector.clustering_.lambda_range_
    parts = "  ".join("{" + " ".join(names[i] for i in group) + "}" for group in selector.groups_)
    degrees = [
        (name, f"{degree:.4f}", f"{vif:.4g}", "chosen" if name in one.sensitive else "")
        for name, degree, vif in zip(names, selector.grey_degrees_, selector.vif_, strict=True)
    ]
    values = ", ".join(f"{value:.4f}" for value in regression.eigenvalues_)
    left = []
    for method, remains in one.unseen.items():
        figures = (one.fitted[method].rms, remains.rms, remains.mean, remains.spread)
        mark = "in the file" if method == one.method else ""
        left.append((one.words(method), *(f"{value * 1e3:.4f}" for value in figures), mark))
    return [
        Heading(f"direction {direction}" if direction else "errors"),
        Lines([f"groups {parts} for λ above {low:.5f}, up to {high:.5f}"]),
        Table(("set", "grey degree", "VIF", ""), degrees),
        Lines([f"eigenvalues {values}; the first carries {regression.cumulative_[0]:.2%}", *one.formulas()]),
        Table((f"what is left, {one.unit}", "fitted rms", "left-out rms", "mean", "spread", ""), left),
    ]


def _figure(found: RegressionReport) -> object:
    figure = new_figure(10.0, 2.4 * len(found.axes))
    panels = figure.subplots(len(found.axes), 1, squeeze=False)[:, 0]
    for panel, (direction, one) in zip(panels, found.axes.items(), strict=True):
        words = [one.words(method) for method in one.unseen]
        values = [left.rms * 1e3 for left in one.unseen.values()]
        colours = [COLOURS[0] if method == one.method else ASH for method in one.unseen]
        for bar, word, value in zip(panel.barh(words, values, color=colours), words, values, strict=True):
            tell(bar, [f"{word}: {value:.4f} {one.unit}"])
        panel.invert_yaxis()
        panel.set(title=direction or "error", xlabel=f"{one.unit}; blue: in the file")
        tidy(panel)
    return figure


def _warnings(axes: dict[str, AxisRegression]) -> list[str]:
    """Say where the regression does not help, and where the paper's would not."""
    notes = []
    for direction, one in axes.items():
        where = f"direction {direction}: " if direction else ""
        if not one.helps:
            left, before = (one.unseen[name].rms * 1e3 for name in (one.method, NONE))
            notes.append(
                f"{where}no method helps: of sets left out '{one.method}' leaves {left:.3f} of {before:.3f} "
                f"{one.unit}. Poses err in opposite directions or too differently for one line; "
                + ("do not compensate" if POSE in one.unseen else "give --poses, or do not compensate")
            )
        elif one.unseen[PAPER].rms > HELPS_BELOW * one.unseen[NONE].rms:
            notes.append(f"{where}the paper's P_end does not help here: poses err in opposite directions")
        vif = one.model.selector_.vif_[one.model.selector_.sensitive_[-1]]
        if not one.model.selector_.guard_held_.all():
            notes.append(f"{where}no set of the last group is free of collinearity (VIF {vif:.4g}); components bear it")
    return notes
