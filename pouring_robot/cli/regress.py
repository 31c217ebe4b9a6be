"""``pouring-robot regress``: the paper's joint regression on a table of thermal errors, judged on sets left out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pouring_robot.cli.shared import options
from pouring_robot.cli.shared.tables import plain_table

if TYPE_CHECKING:
    from rich.console import Console

    from pouring_robot.thermal.regression.report import AxisRegression

TableFile = Annotated[
    Path,
    typer.Argument(
        metavar="TABLE.csv",
        callback=options.there,
        help="A row a temperature: melt_degC, then a column a pose: P1_mm …, or P1_x_mm P1_y_mm …",
    ),
]
PosesFile = Annotated[
    Path | None,
    typer.Option(
        "--poses",
        metavar="FILE.csv",
        callback=options.there,
        help="Where: columns set, x_mm y_mm z_mm (or drives of any robot).",
    ),
]
Method = Annotated[
    Literal["none", "paper", "components", "mean", "pose"] | None,
    typer.Option("--method", help="What goes into the file (default: what leaves least of sets left out)."),
]
Similarity = Literal["absolute", "shifted"]


def regress(
    table: TableFile,
    poses: PosesFile = None,
    axis: Annotated[Literal["x", "y", "z"] | None, typer.Option("--axis", help="Direction of P1_mm ….")] = None,
    method: Method = None,
    groups: Annotated[int, typer.Option(min=1, help="Groups that the clustering cuts.")] = 2,
    cut: Annotated[float | None, typer.Option("--lambda", metavar="L", help="Cut there instead.")] = None,
    similarity: Annotated[
        Similarity, typer.Option("--similarity", help="Whether sets of opposite sign are alike (absolute) or not.")
    ] = "absolute",
    out: Annotated[
        Path | None, options.output("--out", metavar="FILE.yaml", help="Write a thermal-model file.")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Group error sets, pick sensitive ones, and predict the error from the melt's temperature as the paper does.

    Every method is judged on sets that were left out one at a time, beside no compensation and a line that depends on
    the pose. The file is for --thermal-model of pose and compensate.
    """
    from pouring_robot.thermal.regression.report import by_axis, read_positions
    from pouring_robot.thermal.regression.report import regress as regressed
    from pouring_robot.thermal.regression.table import ErrorTable

    errors = ErrorTable.read_csv(table)
    names = next(iter(by_axis(errors, axis or "").values())).names
    positions = read_positions(poses, names) if poses is not None else None
    selector = {"n_clusters": groups, "lambda_cut": cut, "similarity": similarity}
    found = regressed(errors, positions, axis=axis or "", method=method, **selector)
    written = [found.model().save(out)] if out is not None else []
    if as_json:
        options.print_figures(found.figures(), written)
        return
    console = options.console()
    console.print(found.headline, style="bold", markup=False)
    for direction, one in found.axes.items():
        _print_axis(console, direction, one)
    options.print_notes(console, _warnings(found.axes))
    options.print_written(console, written)


def _print_axis(console: Console, direction: str, one: AxisRegression) -> None:
    selector, names = one.model.selector_, one.table.names
    low, high = selector.clustering_.lambda_range_
    parts = "  ".join("{" + " ".join(names[i] for i in group) + "}" for group in selector.groups_)
    console.print(f"direction {direction}" if direction else "errors", style="bold")
    options.print_indented(console, f"groups {parts} for λ above {low:.5f}, up to {high:.5f}")
    rows = [
        (name, f"{degree:.4f}", f"{vif:.4g}", "chosen" if name in one.sensitive else "")
        for name, degree, vif in zip(names, selector.grey_degrees_, selector.vif_, strict=True)
    ]
    console.print(plain_table(("set", "grey degree", "VIF", ""), rows, (0, 3)))
    regression = one.model.component_regression_
    values = ", ".join(f"{value:.4f}" for value in regression.eigenvalues_)
    options.print_indented(console, f"eigenvalues {values}; the first carries {regression.cumulative_[0]:.2%}")
    for formula in one.formulas():
        options.print_indented(console, formula)
    figures_of = []
    for method, left in one.unseen.items():
        figures = (one.fitted[method].rms, left.rms, left.mean, left.spread)
        mark = "in the file" if method == one.method else ""
        figures_of.append((one.words(method), *(f"{value * 1e3:.4f}" for value in figures), mark))
    head = (f"what is left, {one.unit}", "fitted rms", "left-out rms", "mean", "spread", "")
    console.print(plain_table(head, figures_of, (0, 5)))


def _warnings(axes: dict[str, AxisRegression]) -> list[str]:
    """Say where the regression does not help, and where the paper's would not."""
    notes = []
    for direction, one in axes.items():
        where = f"direction {direction}: " if direction else ""
        if not one.helps:
            left, before = (one.unseen[name].rms * 1e3 for name in (one.method, "none"))
            notes.append(
                f"{where}no method helps: of sets left out '{one.method}' leaves {left:.3f} of {before:.3f} "
                f"{one.unit}. "
                "Poses err in opposite directions or too differently for one line; give --poses, or do not compensate"
            )
        elif one.unseen["paper"].rms > 0.9 * one.unseen["none"].rms:
            notes.append(f"{where}the paper's P_end does not help here: poses err in opposite directions")
        vif = one.model.selector_.vif_[one.model.selector_.sensitive_[-1]]
        if not one.model.selector_.guard_held_.all():
            notes.append(f"{where}no set of the last group is free of collinearity (VIF {vif:.4g}); components bear it")
    return notes
