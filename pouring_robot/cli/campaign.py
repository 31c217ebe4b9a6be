"""``pouring-robot campaign``: choose what to measure, check what was measured, measure a virtual robot."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import Pair, Point, opt, reads, writes, writes_csv
from pouring_robot.cli.shared.tables import print_table
from pouring_robot.exceptions import BadInputError, some
from pouring_robot.io.files import CSV_SUFFIXES, check_ending
from pouring_robot.io.units import MM, MRAD
from pouring_robot.io.usual_noise import SIGMA_MM, SIGMA_MRAD

_COMPARED, _SHOWN, _NAMED, _SESSIONS = 25, 25, 8, 12
_ORIGIN = (0.0, 0.0, 0.0)
_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}
Frame = tuple[float, float, float, float, float, float]


def plan(
    *,
    out: Annotated[Path, writes_csv("Plan to write; 'campaign simulate' reads it.")],
    poses: Annotated[int, opt("Number of poses.", metavar="N")] = 30,
    parameters: Annotated[
        list[str] | None,
        opt(
            "What to determine: a set (geometry, centres, axes, dh, all), a group, a name or pattern such as "
            "'leg?_s1.t?'; may be repeated. Default: drives and U-joint centres as far as they can be separated.",
            metavar="PATTERN",
        ),
    ] = None,
    criterion: Annotated[str, opt("Optimality criterion.", metavar="D|O1..O5")] = "D",
    which: bundles.RobotOptions,
    sigma_mm: Annotated[float, opt("Noise of a measured coordinate (standard deviation).")] = SIGMA_MM,
    sigma_mrad: Annotated[float | None, opt(f"Noise of a rotation component (default: {SIGMA_MRAD}).")] = None,
    position_only: Annotated[bool, opt("No rotations will be measured.", "--position-only")] = False,
    target_mm: Annotated[
        Point, opt("Approximate place of the target on the moving platform.", metavar="X Y Z")
    ] = _ORIGIN,
    priors: Annotated[bool, opt("Use the tolerances as prior knowledge.", "--priors")] = False,
    tolerances: options.TolerancesFile = None,
    both_sides: Annotated[int, opt("Visit K of the poses from both sides, to find backlash.", metavar="K")] = 0,
    loads: Annotated[
        Pair, opt("Payloads (melt) in kg to choose from, to find how the drives yield.", metavar="A B")
    ] = None,
    temperatures: Annotated[
        Pair, opt("Temperatures of sliding drives in °C to choose from, to find how they grow.", metavar="A B")
    ] = None,
    reduce: Annotated[bool, opt("Leave out parameters known better by their tolerances.", "--reduce")] = False,
    candidates: Annotated[int, opt("Approximate number of candidate poses.")] = 2000,
    starts: Annotated[int, opt("Number of random plans that the search starts from.")] = 4,
    seed: Annotated[int, opt("Seed of everything random.")] = 0,
    png: options.PngFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Choose the poses that determine the parameters best, and predict how well."""
    from pouring_robot.design.planning import Planner, compare_with_random
    from pouring_robot.design.request import PlanRequest
    from pouring_robot.design.result import plot
    from pouring_robot.estimation.noise import NoiseLevel
    from pouring_robot.robot.tolerances import Tolerances

    check_ending(out, CSV_SUFFIXES)
    if tolerances is not None and not priors:
        raise BadInputError("--tolerances is used with --priors only; give --priors too")
    if position_only and sigma_mrad is not None:
        raise BadInputError("give --sigma-mrad or --position-only, not both: without rotations they have no noise")
    sigma_rad = None if position_only else MRAD * (SIGMA_MRAD if sigma_mrad is None else sigma_mrad)
    present = which.built()
    request = PlanRequest(
        poses=poses,
        parameters=tuple(parameters or ()),
        criterion=criterion.upper(),  # type: ignore[arg-type]  # checked by the request
        noise=NoiseLevel.stated(sigma_mm * MM, sigma_rad),
        target_m=(target_mm[0] * MM, target_mm[1] * MM, target_mm[2] * MM),
        priors=Tolerances.load(tolerances or present.model.definition.tolerances_file) if priors else None,
        both_sides=both_sides,
        loads_kg=tuple(loads or ()),
        drive_degC=tuple(temperatures or ()),
        reduce=reduce,
        candidates=candidates,
        starts=starts,
        seed=seed,
    )
    planner = Planner(present, request)
    with progress.stage_bars() as show:
        found = planner.plan(show)
    comparison = compare_with_random(planner, found, _COMPARED, seed)
    written = options.write_all({out: found.csv()} | ({png: plot(found)} if png else {}))
    figures = found.figures() | {"random_plans": comparison.figures()}
    if as_json:
        return options.print_figures(figures, written)
    _print_expected(figures, present.model.definition.tool_words[1].removeprefix("the "))
    options.print_written(written)


def _print_expected(figures: dict[str, Any], tip: str) -> None:
    ladle, compared = figures["ladle"], figures["random_plans"]
    sides = ", ".join(f"{axis} {value:.3f}" for axis, value in ladle["rms_by_axis_mm"].items())
    at = " ".join(f"{name} {value:z.1f}" for name, value in ladle["worst_at"].items())
    options.say(
        f"{tip}, seen by the tracker: standard deviation {ladle['rms_mm']:.4f} mm and {ladle['rms_mrad']:.4f} mrad RMS "
        f"over the workspace ({sides} mm), {ladle['worst_mm']:.4f} mm at worst, at {at}",
        style="bold",
    )
    if compared["undetermined"]:
        count = f"{compared['undetermined']} of {compared['count']}"
        options.say(f"{count} random plans of as many poses cannot determine the parameters")
    if compared["median_rms_mm"] is not None:
        median = f"{compared['median_rms_mm']:.4f} mm and {compared['median_rms_mrad']:.4f} mrad"
        options.say(
            f"random plans of as many poses: {median} (median of {compared['count']}); this one has "
            f"{compared['ratio_mm']:.0%} of that"
        )
    indices = ", ".join(f"{name} {value:.4g}" for name, value in figures["indices"].items())
    options.say(f"observability (per mm, mrad; larger is better): {indices}")
    rows = [[p["name"], f"{p['std']:.4g}", p["unit"]] for p in figures["parameters"]]
    title, head = "expected standard deviation", ("parameter", "std", "unit")
    print_table(head, rows, title=title, most=_SHOWN, beyond="more (--json has all)")
    if left := figures["left_out"]:
        beyond = " (--json has all)" if len(left) > _NAMED else ""
        options.say(
            f"left out, since the poses determine them less well than their tolerances do: {some(left, _NAMED)}{beyond}"
        )


def check(
    *,
    file: options.CampaignFile,
    which: bundles.RobotOptions,
    as_json: options.AsJson = False,
    png: options.PngFile = None,
) -> None:
    """List what a campaign holds and what is wrong with its data, before any fit; exit code 2 if there is an error."""
    from pouring_robot.campaign.data import Campaign
    from pouring_robot.checks.check import campaign_metrics, examine
    from pouring_robot.checks.flags import refuse_errors
    from pouring_robot.checks.plots import write_picture
    from pouring_robot.robot.pouring.definition import PouringDefinition
    from pouring_robot.robot.pouring.layout import load_layout

    definition = which.read().definition
    campaign = Campaign.read(file, definition)
    found = examine(campaign, definition.drawing())
    figures = campaign_metrics(campaign, found)
    box = None  # for other robots
    if isinstance(definition, PouringDefinition):
        box = load_layout(definition.layout, definition.layouts_file)
    written = [write_picture(campaign, found, box, png)] if png else []
    if as_json:
        options.print_figures(figures, written)
    else:
        _print_summary(figures)
        options.print_written(written)
    refuse_errors(campaign, found.flags)


def _print_summary(figures: dict[str, Any]) -> None:
    sessions = some([f"{name} ({rows})" for name, rows in figures["sessions"].items()], _SESSIONS)
    options.say(
        f"{figures['file']}: {figures['rows']} rows of {figures['seen']}, {figures['usable_rows']} usable, "
        f"{figures['distinct_poses']} distinct poses"
    )
    options.say(f"sessions (rows): {sessions}")
    rows = []
    for name, values in figures["ranges"].items():
        if not name.startswith("approach"):
            digits = 4 if values["unit"] == "rad" else 2
            ends = (f"{values[end]:z.{digits}f}" for end in ("least", "largest"))
            rows.append((name, values["unit"].replace("degC", "°C"), *ends, str(values["missing"] or "")))
    print_table(("column", "unit", "least", "largest", "missing"), rows, (0, 1))
    for line in _lines(figures):
        options.say(line)
    if not figures["flags"]:
        options.say("checks: nothing found")
    for flag in figures["flags"]:
        severity = flag["severity"]
        options.say(f"{severity}: {flag['message']}", style=_STYLES[severity])
        options.print_indented(f"→ {flag['mend']}", 4)


def _lines(figures: dict[str, Any]) -> Iterator[str]:
    """Yield lines on what is not recorded, how far the nominal robot is off, and what data do not determine."""
    if missing := figures["missing_conditions"]:
        yield f"not recorded, so effects that depend on it cannot be tested: {', '.join(missing)}"
    undone = f", with {'; '.join(figures['undone'])}" if figures["undone"] else ""
    if misfit := figures["misfit"]:
        parts = []
        for what, unit in (("position", "mm"), ("rotation", "mrad")):
            value, noise = misfit[f"{what}_{unit}"], misfit[f"{what}_noise_{unit}"]
            if value is not None:
                parts.append(f"{value:.3g} {unit}" + (f" (noise {noise:.3g})" if noise else ""))
        fitted = f"both unknown frames fitted{undone}"
        yield f"misfit of the nominal robot, {fitted}: {', '.join(parts)} per component (robust)"
    disagree = figures["redundant_drives_disagree_mm"]
    if disagree is not None:
        yield f"redundant drives of the nominal robot{undone} disagree by {disagree:.3g} mm (RMS)"
    undetermined = figures["untold_of_the_frames"]  # held at zero, and costs nothing
    turns = [direction for direction in undetermined if next(iter(direction)).startswith("tool.r")]
    if misfit and misfit["rotation_mrad"] is None and len(turns) == 3:
        yield "positions alone do not determine the orientation of the target on the tool, and need not"
        undetermined = [direction for direction in undetermined if direction not in turns]
    if undetermined:
        texts = (" ".join(f"{share:+.3g} {name}" for name, share in direction.items()) for direction in undetermined)
        open_ = "; ".join(text.removeprefix("+") for text in texts)
        frames = "base: robot seen from the device; tool: target on the robot"
        yield f"not determined by these poses, and not needed for them: {open_} ({frames})"


def _seen(what: str) -> Any:
    return opt(f"{what}: mm, rotation vector in degrees.", metavar="X Y Z RX RY RZ")


def simulate(
    *,
    out: Annotated[Path, writes("Table to write, .csv or .parquet; the YAML goes beside it.")],
    plan: Annotated[Path | None, reads("Poses as 'path' reads them, and any condition columns.")] = None,
    random: Annotated[int | None, opt("N random poses in the workspace.", metavar="N")] = None,
    seed: Annotated[int, opt("Seed of everything random.", min=0)] = 0,
    which: bundles.RobotOptions,
    under: bundles.ConditionOptions,
    noise_mm: Annotated[float, opt("Noise of a coordinate.")] = SIGMA_MM,
    noise_mrad: Annotated[float | None, opt(f"Noise of a rotation component (default: {SIGMA_MRAD}).")] = None,
    position_only: Annotated[bool, opt("Measure no rotations.", "--position-only")] = False,
    outliers: Annotated[int, opt("Rows with a gross error.", metavar="N", min=0)] = 0,
    outlier_mm: Annotated[float, opt("Size of a gross error.")] = 5.0,
    lost: Annotated[float, opt("Share of measured cells left empty, 0 to 0.9.", metavar="SHARE")] = 0.0,
    tracker_frame: Annotated[Frame | None, _seen("Fixed platform seen from the tracker")] = None,
    target_frame: Annotated[Frame | None, _seen("Target seen from the moving platform")] = None,
    truth: Annotated[Path | None, writes("Write the true values (frames, gross errors) as JSON.")] = None,
) -> None:
    """Simulate measurements of a robot as built: a campaign with noise, gross errors and unknown frames."""
    from pouring_robot.campaign.metadata import check_table_name
    from pouring_robot.campaign.plan import random_plan, read_plan
    from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign

    if (plan is None) == (random is None):
        raise BadInputError("give the poses either by --plan FILE or by --random N")
    if position_only and noise_mrad is not None:
        raise BadInputError("give --noise-mrad or --position-only, not both: without rotations they have no noise")
    check_table_name(out)
    options.refuse_targets([out, out.with_suffix(".yaml"), *([truth] if truth else [])])
    present = which.built(under=True)
    poses = read_plan(plan, present) if plan is not None else random_plan(present, random or 0, seed)
    standing = under.of(present, poses.given(present.model.definition))
    robots, scale = (None, 0.0) if standing is None else standing.seen(poses.drives)
    settings = MeasurementOptions(
        sigma_position_m=noise_mm * MM,
        sigma_rotation_rad=None if position_only else MRAD * (SIGMA_MRAD if noise_mrad is None else noise_mrad),
        outliers=outliers,
        outlier_m=outlier_mm * MM,
        lost=lost,
        pose_tracker_to_fixed_platform=_frame(tracker_frame),
        pose_platform_to_target=_frame(target_frame),
        seed=seed,
    )
    with progress.stage_bars() as show:
        measured = simulate_campaign(present, poses, settings, path=out, robots=robots, scale=scale, progress=show)
    files = measured.campaign.contents(out)
    if truth:
        files[truth] = measured.truth_text(which.model).encode()
    options.write_all(files)
    options.print_notes(standing.notes if standing else ())
    options.print_written(files)


def _frame(figures: Frame | None) -> Any:
    import numpy as np
    import pinocchio as pin

    if figures is None:
        return None
    if not all(math.isfinite(value) for value in figures):
        raise BadInputError("a frame needs six finite numbers: x y z in mm and a rotation vector in degrees")
    return pin.SE3(pin.exp3(np.radians(figures[3:])), np.array(figures[:3]) * MM)


campaign = bundles.group_of(
    "Measurement campaigns: choose what to measure, check the data, or simulate measurements.",
    [plan, check, simulate],
)
