"""``pouring-robot campaign``: look at measured data before a fit, and measure a virtual robot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pouring_robot.cli import campaign_plan
from pouring_robot.cli.shared import options
from pouring_robot.exceptions import BadInputError

app = typer.Typer(
    help="Measurement campaigns: check the data, or measure a virtual robot.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("plan")(campaign_plan.plan)
_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}

CampaignFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="CSV or Parquet table; the YAML of the same stem lies beside it.")
]
Frame = tuple[float, float, float, float, float, float]


@app.command("check")
def check(
    file: CampaignFile,
    model: options.ModelFile = None,
    layout: options.LayoutName = None,
    as_json: options.AsJson = False,
    png: options.PngFile = None,
) -> None:
    """Say what is in a campaign and what is wrong with its data, before any fit."""
    from pouring_robot.campaign.reader import read_campaign
    from pouring_robot.checks.check import examine
    from pouring_robot.checks.plots import write_picture
    from pouring_robot.checks.summary import campaign_figures

    options.refuse_unwritable(png)
    campaign = read_campaign(file)
    robot = options.robot_of(model, layout)
    found = examine(campaign, robot)
    figures = campaign_figures(campaign, found)
    written = [write_picture(campaign, found, robot.layout, png)] if png else []
    if as_json:
        options.print_json(figures | {"written": [str(path) for path in written]})
        return
    console = options.console()
    _print_summary(console, figures)
    for path in written:
        console.print(f"wrote {path}", markup=False)


def _print_summary(console: Console, figures: dict[str, Any]) -> None:
    kind = "full poses" if figures["full_pose"] else "positions"
    sessions = ", ".join(f"{name} ({rows})" for name, rows in list(figures["sessions"].items())[:12])
    console.print(
        f"{figures['file']}: {figures['rows']} rows of {kind}, {figures['usable_rows']} usable, "
        f"{figures['distinct_poses']} distinct poses",
        markup=False,
    )
    console.print(f"sessions (rows): {sessions}", markup=False)
    console.print(_range_table(figures["ranges"]))
    missing = figures["missing_conditions"]
    if missing:
        console.print(f"not recorded, so what depends on it cannot be tested: {', '.join(missing)}", markup=False)
    misfit = figures["misfit"]
    if misfit is not None:
        console.print(_misfit_line(misfit), markup=False)
    if not figures["flags"]:
        console.print("checks: nothing found")
    for flag in figures["flags"]:
        severity = flag["severity"]
        text = escape(f"{severity}: {flag['message']}")
        console.print(f"[{_STYLES[severity]}]{text}[/]")
        console.print(f"    → {flag['mend']}", markup=False)


def _range_table(ranges: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    for name in ("column", "unit", "least", "largest", "missing"):
        table.add_column(name, justify="left" if name in ("column", "unit") else "right")
    for name, values in ranges.items():
        if name.startswith("approach"):
            continue
        digits = 4 if values["unit"] == "rad" else 2
        ends = ["–" if values[end] is None else f"{values[end]:.{digits}f}" for end in ("least", "largest")]
        unit = values["unit"].replace("degC", "°C")
        table.add_row(name, unit, *ends, str(values["missing"]) if values["missing"] else "")
    return table


def _misfit_line(misfit: dict[str, Any]) -> str:
    parts = []
    for what, unit in (("position", "mm"), ("rotation", "mrad")):
        value, noise = misfit[f"{what}_{unit}"], misfit[f"{what}_noise_{unit}"]
        if value is not None:
            parts.append(f"{value:.3g} {unit}" + (f" (noise {noise:.3g})" if noise else ""))
    return f"against the nominal robot, the two unknown frames fitted: {', '.join(parts)} a component, robust"


@app.command("simulate")
def simulate(
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Table to write, .csv or .parquet; YAML beside.")],
    plan: Annotated[
        Path | None,
        typer.Option("--plan", metavar="FILE", help="Poses: x, y, z, tilt with units, and any condition columns."),
    ] = None,
    random: Annotated[int | None, typer.Option("--random", metavar="N", help="N poses spread over the box.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")] = 0,
    model: options.ModelFile = None,
    layout: options.LayoutName = None,
    noise_mm: Annotated[float, typer.Option("--noise-mm", help="Noise of a coordinate.")] = 0.05,
    noise_mrad: Annotated[float, typer.Option("--noise-mrad", help="Noise of a rotation component.")] = 0.05,
    position_only: Annotated[bool, typer.Option("--position-only", help="Measure no rotations.")] = False,
    outliers: Annotated[int, typer.Option("--outliers", min=0, metavar="N", help="Rows with a gross error.")] = 0,
    outlier_mm: Annotated[float, typer.Option("--outlier-mm", help="Size of a gross error.")] = 5.0,
    lost: Annotated[float, typer.Option("--lost", metavar="SHARE", help="Share of measured cells left empty.")] = 0.0,
    tracker_frame: Annotated[
        Frame | None,
        typer.Option(
            metavar="X Y Z RX RY RZ", help="Fixed platform seen from the tracker: mm, rotation vector in degrees."
        ),
    ] = None,
    target_frame: Annotated[
        Frame | None,
        typer.Option(
            metavar="X Y Z RX RY RZ", help="Target seen from the moving platform: mm, rotation vector in degrees."
        ),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="FILE", help="Write what was hidden (frames, outliers) as JSON.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that are there.")] = False,
) -> None:
    """Measure a robot as built without having it: a campaign with noise, outliers and unknown frames."""
    from pouring_robot.campaign.plan import random_plan, read_plan
    from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
    from pouring_robot.campaign.writer import campaign_contents, refuse_existing, write_all

    if (plan is None) == (random is None):
        raise BadInputError("give the poses by --plan FILE or by --random N, one of the two")
    outputs = [out, out.with_suffix(".yaml"), *([truth] if truth else [])]
    refuse_existing(outputs, overwrite=overwrite)
    robot = options.robot_of(model, layout)
    poses = read_plan(plan, robot) if plan is not None else random_plan(robot, random or 0, seed)
    settings = MeasurementOptions(
        sigma_position_m=noise_mm * 1e-3,
        sigma_rotation_rad=None if position_only else noise_mrad * 1e-3,
        outliers=outliers,
        outlier_m=outlier_mm * 1e-3,
        lost=lost,
        pose_tracker_to_fixed_platform=_frame(tracker_frame),
        pose_platform_to_target=_frame(target_frame),
        seed=seed,
    )
    with options.progress_bars() as progress:
        measured = simulate_campaign(robot, poses, settings, path=out, progress=progress)
    files = campaign_contents(measured.campaign, out)
    if truth:
        files[truth] = measured.truth_text(model).encode()
    write_all(files, overwrite=overwrite)
    for path in files:
        options.console().print(f"wrote {path}", markup=False)


def _frame(figures: Frame | None) -> Any:
    import pinocchio as pin

    if figures is None:
        return None
    if not all(math.isfinite(value) for value in figures):
        raise BadInputError("a frame has six finite figures: x y z in mm and a rotation vector in degrees")
    return pin.SE3(pin.exp3(np.radians(figures[3:])), np.array(figures[:3]) * 1e-3)
