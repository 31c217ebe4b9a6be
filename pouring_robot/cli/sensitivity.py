"""``pouring-robot sensitivity``: the effect of each geometric error alone, and which axes to control."""

from pathlib import Path
from typing import Annotated

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import Pair, opt, results_folder
from pouring_robot.cli.shared.tables import print_table
from pouring_robot.exceptions import counted
from pouring_robot.io.seeds import SENSITIVITY_SEED
from pouring_robot.io.units import DEG, MM, MRAD

_SHOWN, _PARTS_SHOWN = 25, 6


def sensitivity(
    *,
    which: bundles.RobotOptions,
    poses: Annotated[int, opt("Number of random poses in the workspace.", min=2, max=200_000)] = 10_000,
    seed: Annotated[int, opt("Seed of the random poses.", min=0)] = SENSITIVITY_SEED,
    length_mm: Annotated[float, opt("Size of every length error.")] = 0.2,
    angle_mrad: Annotated[float, opt("Size of every angle error.")] = 4.0,
    limit_mm: Annotated[float, opt("Errors that move the frame further are to be controlled.")] = 1.0,
    x_mm: Annotated[Pair, opt("Range of x.", metavar="LOW HIGH")] = None,
    y_mm: Annotated[Pair, opt("Range of y.", metavar="LOW HIGH")] = None,
    z_mm: Annotated[Pair, opt("Range of z.", metavar="LOW HIGH")] = None,
    tilt_deg: Annotated[Pair, opt("Range of the tilt.", metavar="LOW HIGH")] = None,
    parameters: Annotated[list[str] | None, opt("Set, group, name or pattern; repeatable.", metavar="NAME")] = None,
    frame: Annotated[str | None, opt("Frame whose displacement counts.", metavar="NAME")] = None,
    out: Annotated[
        Path | None, results_folder("sensitivity.csv", "sensitivity.json", "report.html", what="pictures")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Compute what each geometric error does on its own, in the closed robot and in the paper's open branch.

    Of a model file only the layout or robot is used. Errors act to first order; the error of that is printed.
    """
    from pouring_robot.sensitivity import report
    from pouring_robot.sensitivity.analysis import left_out, study

    limits = zip((x_mm, y_mm, z_mm, tilt_deg), (MM, MM, MM, DEG), strict=True)
    request = report.Request(
        poses=poses,
        seed=seed,
        length_m=length_mm * MM,
        angle_rad=angle_mrad * MRAD,
        box=tuple(pair and (pair[0] * unit, pair[1] * unit) for pair, unit in limits),  # type: ignore[arg-type]  # four
        parameters=tuple(parameters or ()),
        frame=frame,
        limit_m=limit_mm * MM,
    )
    model = which.read()
    if ignored := left_out(model, "this command", str(which.model)):
        options.note(ignored)
    with progress.stage_bars() as show:
        found = study(model, request, show)
        written = found.save(out, overwrite=options.OVERWRITE.get()) if out is not None else []
    if as_json:
        return options.print_figures(found.figures(), written)
    options.say(found.headline, style="bold")
    table = report.errors_table(found)
    title = "each error alone" + (": closed robot, and the open branch of eq. 5" if len(found.samples) > 1 else "")
    print_table(table.head, table.rows, (0, 1, 6), title=title, most=_SHOWN, beyond="weaker ones (--out DIR, --json)")
    controls = report.control_lines(found)
    for line in controls[:_PARTS_SHOWN]:
        options.print_indented(line)
    if len(controls) > _PARTS_SHOWN:
        options.print_indented(f"… and {counted(len(controls) - _PARTS_SHOWN, 'more part')} (--out DIR, --json)")
    options.say(report.missed_line(found))
    options.print_written(written)
