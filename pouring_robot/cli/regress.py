"""``pouring-robot regress``: the paper's joint regression on a table of thermal errors, with cross-validation."""

from pathlib import Path
from typing import Annotated, Literal

from pouring_robot.cli.shared import options
from pouring_robot.cli.shared.options import argument, opt, reads, writes
from pouring_robot.cli.shared.tables import print_blocks


def regress(
    table: Annotated[
        Path,
        argument(
            "TABLE.csv", "One row per temperature: melt_degC, then one column per pose: P1_mm …, or P1_x_mm P1_y_mm …"
        ),
    ],
    poses: Annotated[
        Path | None,
        reads(
            "Poses of the sets: columns set, x_mm y_mm z_mm tilt_deg (or, for the report, drives of any robot).",
            "FILE.csv",
        ),
    ] = None,
    axis: Annotated[
        Literal["x", "y", "z"] | None, opt("Direction of P1_mm …; of P1_x_mm …, the only one to use.")
    ] = None,
    method: Annotated[
        Literal["none", "paper", "components", "mean", "pose"] | None,
        opt("Method for the file (default: the one with the least error on sets left out)."),
    ] = None,
    groups: Annotated[int, opt("Number of groups of the clustering.", min=1)] = 2,
    cut: Annotated[
        float | None, opt("Threshold of the clustering, instead of --groups.", "--lambda", metavar="L")
    ] = None,
    similarity: Annotated[
        Literal["absolute", "shifted"], opt("Whether sets of opposite sign are alike (absolute) or not.")
    ] = "absolute",
    out: Annotated[Path | None, writes("Write a thermal-model file.", "FILE.yaml")] = None,
    report: options.ReportFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Group error sets, pick sensitive ones, and predict the error from the melt's temperature as the paper does.

    Every method is judged on sets left out one at a time, and compared with no compensation and with a line that
    depends on the pose. The file is for --thermal-model of pose and compensate.
    """
    from pouring_robot.thermal.regression import report as pages
    from pouring_robot.thermal.regression.table import ErrorTable

    errors = ErrorTable.read_csv(table)
    names = next(iter(pages.by_axis(errors, axis or "").values())).names
    positions = pages.read_positions(poses, names) if poses is not None else None
    selector = {"n_clusters": groups, "lambda_cut": cut, "similarity": similarity}
    found = pages.regress(errors, positions, axis=axis or "", method=method, **selector)
    written = [found.model().save(out, overwrite=options.OVERWRITE.get())] if out is not None else []
    if out is not None and found.foreign_inputs:
        options.note(
            f"pose and compensate cannot use {out}: it depends on {', '.join(found.foreign_inputs)}, but they "
            "give only x, y, z (m) and tilt (rad) of the pouring robot; give these in --poses, or leave --poses out"
        )
    written += options.write_all(options.wanted(report, lambda: pages.html_report(found)))
    if as_json:
        return options.print_figures(found.figures(), written)
    options.say(found.headline, style="bold")
    print_blocks(pages.blocks(found))
    options.print_written(written)
