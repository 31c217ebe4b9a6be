"""``pouring-robot calibrate``: measured data in, calibrated robot out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import opt, results_folder
from pouring_robot.cli.shared.tables import print_blocks, print_lines

if TYPE_CHECKING:
    from pouring_robot.calibration.calibrate import Calibration


def calibrate(
    campaign: options.CampaignFile,
    out: Annotated[Path, results_folder("calibrated.yaml", "calibration.json", "report.html", what="URDF with meshes")],
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
    parameters: Annotated[
        list[str] | None,
        opt(
            "What to identify: geometry (default), centres, axes, all, dh, a group, or a pattern such as 'leg1_s1.*'; "
            "may be given more than once. Each group is kept only where it helps held-out rows.",
            metavar="SET",
        ),
    ] = None,
    tolerances: options.TolerancesFile = None,
    hold_out: options.HoldOutBy = "auto",
    loss: Annotated[Literal["huber", "soft_l1", "linear"], opt("Loss function, which weights gross errors.")] = "huber",
    keep_all: Annotated[bool, opt("Keep all parameters, whether or not they help.", "--keep-all")] = False,
    as_json: options.AsJson = False,
) -> None:
    """Identify the robot as built from a measurement campaign, and write its model file, URDF and report."""
    from pouring_robot.calibration.calibrate import CalibrationOptions
    from pouring_robot.calibration.calibrate import calibrate as run
    from pouring_robot.calibration.summary import calibration_metrics
    from pouring_robot.campaign.data import Campaign
    from pouring_robot.estimation.map_fit import FitOptions
    from pouring_robot.robot.description.urdf import urdf_files
    from pouring_robot.robot.pouring_robot import robot_of
    from pouring_robot.robot.tolerances import Tolerances

    present = bundles.RobotOptions(model, robot).read()
    data = Campaign.read(campaign, present.definition)
    chosen = CalibrationOptions(
        parameters=tuple(parameters or ("geometry",)),
        tolerances=Tolerances.load(tolerances) if tolerances else None,
        hold_out=hold_out,
        choose=not keep_all,
        fit=FitOptions(loss=loss),
    )
    # Conflicts with its URDF, its meshes and files that are read are refused before the fit, not after it.
    robot_of(present).location_in_the_middle()
    tree = urdf_files(present.urdf(), out, present.definition.files_beside())
    options.refuse_inputs(tree)
    with progress.stage_bars() as show:
        found = run(data, present, chosen, show)
        show("writing", 0, 0)
        written = found.save(out, overwrite=options.OVERWRITE.get())
    if as_json:
        return options.print_figures(calibration_metrics(found), written)
    _print(found, out)
    options.print_written(written)


def _print(found: Calibration, out: Path) -> None:
    from dataclasses import replace

    from pouring_robot.calibration import report
    from pouring_robot.calibration.summary import next_measurements, notes_of, warnings_of

    options.say(found.headline, style="bold")
    for line in warnings_of(found):
        options.say(f"warning: {line}", style="yellow")
    options.say(report.split_line(found))
    print_blocks([report.gap_table(found)])
    options.say(report.performance_line(found))
    options.say(report.ladle_line(found))
    combinations = report.combination_table(found, report.WIDTH)
    if combinations.rows:
        first = replace(combinations, rows=combinations.rows[: report.SHOWN])
        print_blocks([report.effect_table(found), first])
        if len(combinations.rows) > report.SHOWN:
            options.say(f"{len(combinations.rows) - report.SHOWN} more in the report, and each parameter by itself")
    options.print_notes(notes_of(found))
    options.say("next:")
    print_lines(next_measurements(found, out))
