"""``pouring-robot campaign plan``: which poses to measure, and how well the robot will then be known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.tables import print_table
from pouring_robot.exceptions import BadInputError

_COMPARED, _SHOWN = 25, 25


def plan(
    *,
    out: Annotated[Path, options.writes("--out", "Plan to write; 'campaign simulate' reads it.", metavar="FILE.csv")],
    poses: Annotated[int, options.opt("--poses", "How many poses.", metavar="N")] = 30,
    parameters: Annotated[
        list[str] | None,
        options.opt(
            "--parameters",
            "What to determine: a set (geometry, centres, axes, dh, all), a group, a name or pattern such as "
            "'leg?_s1.t?'; may be repeated. Default: drives and U-joint centres as far as they can be told apart.",
            metavar="PATTERN",
        ),
    ] = None,
    criterion: Annotated[str, options.opt("--criterion", "What the plan is best in.", metavar="D|O1..O5")] = "D",
    which: bundles.Which,
    sigma_mm: Annotated[float, options.opt("--sigma-mm", "Noise of a measured coordinate.")] = 0.05,
    sigma_mrad: Annotated[float, options.opt("--sigma-mrad", "Noise of a rotation component.")] = 0.05,
    position_only: Annotated[bool, options.opt("--position-only", "No rotations will be measured.")] = False,
    target_mm: Annotated[
        tuple[float, float, float],
        options.opt("--target-mm", "About where the target sits on the moving platform.", metavar="X Y Z"),
    ] = (0.0, 0.0, 0.0),
    priors: Annotated[bool, options.opt("--priors", "Tolerances count as known beforehand.")] = False,
    tolerances: options.TolerancesFile = None,
    both_sides: Annotated[
        int, options.opt("--both-sides", "Visit K of the poses from both sides: finds backlash.", metavar="K")
    ] = 0,
    loads: Annotated[
        tuple[float, float] | None,
        options.opt("--loads", "Melt in kg to choose from: finds how the drives yield.", metavar="A B"),
    ] = None,
    temperatures: Annotated[
        tuple[float, float] | None,
        options.opt("--temperatures", "Leg temperatures in °C: finds how the legs grow.", metavar="A B"),
    ] = None,
    reduce: Annotated[
        bool, options.opt("--reduce", "Leave out parameters that measurements cannot tell from others.")
    ] = False,
    candidates: Annotated[int, options.opt("--candidates", "About how many poses to choose from.")] = 2000,
    starts: Annotated[int, options.opt("--starts", "How many random plans the search starts from.")] = 4,
    seed: Annotated[int, options.opt("--seed", "Seed of everything random.")] = 0,
    png: options.PngFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Choose the poses that determine parameters best, and say how well, before a single measurement."""
    from pouring_robot.design.compare import compare_with_random
    from pouring_robot.design.planning import Planner
    from pouring_robot.design.plots import plot
    from pouring_robot.design.request import PlanRequest
    from pouring_robot.estimation.noise_level import NoiseLevel
    from pouring_robot.io.files import write_together
    from pouring_robot.robot.tolerances import Tolerances

    if tolerances is not None and not priors:
        raise BadInputError("--tolerances says how sure the priors are; give --priors too")
    present = which.built()
    request = PlanRequest(
        poses=poses,
        parameters=tuple(parameters or ()),
        criterion=criterion.upper(),  # type: ignore[arg-type]  # checked by the request
        noise=NoiseLevel.stated(sigma_mm * 1e-3, None if position_only else sigma_mrad * 1e-3),
        target_m=(target_mm[0] * 1e-3, target_mm[1] * 1e-3, target_mm[2] * 1e-3),
        priors=(Tolerances.load(tolerances) if tolerances else Tolerances.of(present.model.definition))
        if priors
        else None,
        both_sides=both_sides,
        loads_kg=tuple(loads or ()),
        leg_degC=tuple(temperatures or ()),
        reduce=reduce,
        candidates=candidates,
        starts=starts,
        seed=seed,
    )
    planner = Planner(present, request)
    with progress.stage_bars() as show:
        found = planner.plan(show)
    comparison = compare_with_random(planner, found, _COMPARED, seed)
    written = write_together({out: found.csv()} | ({png: plot(found)} if png else {}))
    figures = found.figures() | {"random_plans": comparison.figures()}
    if as_json:
        return options.print_figures(figures, written)
    _print_expected(figures, present.model.definition.tool_words[1].removeprefix("the "))
    options.print_written(written)


def _print_expected(figures: dict[str, Any], tip: str) -> None:
    ladle, compared = figures["ladle"], figures["random_plans"]
    sides = ", ".join(f"{axis} {value:.3f}" for axis, value in ladle["rms_by_axis_mm"].items())
    at = " ".join(f"{name} {value:.1f}" for name, value in ladle["worst_at"].items())
    options.say(
        f"{tip}, seen by the tracker: known to {ladle['rms_mm']:.4f} mm and {ladle['rms_mrad']:.4f} mrad RMS "
        f"over the workspace ({sides} mm), {ladle['worst_mm']:.4f} mm at worst, at {at}",
        style="bold",
        soft_wrap=True,
    )
    options.say(
        f"random plans of as many poses: {compared['median_rms_mm']:.4f} mm and {compared['median_rms_mrad']:.4f} mrad "
        f"(median of {compared['count']}); this one has {compared['ratio_mm']:.0%} of that",
        soft_wrap=True,
    )
    indices = ", ".join(f"{name} {value:.4g}" for name, value in figures["indices"].items())
    options.say(f"observability (per mm, mrad; larger is better): {indices}")
    rows = [[p["name"], f"{p['std']:.4g}", p["unit"]] for p in figures["parameters"]]
    title, head = "expected standard deviation", ("parameter", "std", "unit")
    print_table(head, rows, title=title, wrap=True, most=_SHOWN, beyond="more (--json has all)")
    if figures["left_out"]:
        left = figures["left_out"]
        named = ", ".join(left[:8]) + (f" and {len(left) - 8} more (--json has all)" if len(left) > 8 else "")
        options.say(f"left out, because those above show the same: {named}")
