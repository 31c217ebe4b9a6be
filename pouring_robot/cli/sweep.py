"""``pouring-robot sweep``: a tolerance study from a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pouring_robot.cli.shared import options, progress
from pouring_robot.cli.shared.tables import plain_table
from pouring_robot.exceptions import BadInputError

if TYPE_CHECKING:
    from rich.console import Console

    from pouring_robot.sweeps import AllocatedTolerances, SweepReport

_SHOWN = 15


def sweep(
    config: Annotated[
        Path, typer.Argument(metavar="CONFIG.yaml", callback=options.there, help="Sweep file; see examples/sweep.yaml.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; made if it is absent.")],
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a sweep that was stopped.")] = False,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=0, help="Processes on this machine (default: this one).")
    ] = 0,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Compute on this Dask cluster instead.")
    ] = None,
    robot: options.RobotFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Find out which tolerances matter, how far the tool is off, and the loosest tolerances that will do."""
    # xarray, Zarr and SciPy take a second to import; only this command pays for it.
    from pouring_robot.sweeps import SweepConfig, SweepPlan
    from pouring_robot.sweeps import sweep as run

    if workers and scheduler:
        raise BadInputError("give --workers or --scheduler, not both: the cluster has workers of its own")
    study = SweepConfig.load(config)
    plan = SweepPlan(study if robot is None else study.with_robot(robot))
    if plan.config.model is not None:
        options.say_left_out(plan.model, plan.config.model)
    done, total = 0, 0
    with progress.stage_bars() as show:

        def count(stage: str, chunks: int, of: int) -> None:
            nonlocal done, total
            if stage == "sweep":
                done, total = chunks, of
            show(stage, chunks, of)

        try:
            outcome = run(plan, out, resume=resume, workers=workers, scheduler=scheduler, progress=count)
        except KeyboardInterrupt as stop:
            kept = f"{done} of {total} chunks are kept in {out}: go on with --resume" if done else "nothing is kept"
            print(f"pouring-robot: stopped; {kept}", file=sys.stderr)
            raise typer.Exit(130) from stop
    written = (outcome.store.path, *outcome.save())
    if as_json:
        options.print_figures(outcome.figures(), written)
        return
    console = options.console()
    _print_summary(console, outcome)
    _print_ranking(console, outcome)
    if outcome.allocation:
        _print_allocation(console, outcome.allocation)
    options.print_written(console, written)


def _print_summary(console: Console, outcome: SweepReport) -> None:
    figures = outcome.summary.figures()
    quantiles = ", ".join(f"{float(k):.2%} {v:.3f}" for k, v in figures["quantiles_mm"].items() if v is not None)
    what = "errors alone" if outcome.store.plan.config.study == "one_at_a_time" else "robots"
    console.print(
        f"{figures['robots']} {what} at {figures['poses']} poses: {figures['frame']} is off by {quantiles} mm "
        f"(shares), at most {figures['largest_mm']:.3f} mm and {figures['largest_mrad']:.3f} mrad",
        soft_wrap=True,
    )
    console.print(
        f"within {figures['accuracy_mm']:g} mm: {figures['share_within']:.2%} of all, "
        f"{figures['share_of_robots_within_everywhere']:.2%} of the {what} at every pose"
    )
    if outcome.summary.failed:
        failed = ", ".join(f"{count} {name}" for name, count in figures["status"].items() if name != "ok")
        console.print(f"note: without a solution, kept with their status: {failed}")
    if outcome.indices and outcome.indices.dropped:
        console.print(f"note: {outcome.indices.dropped} base samples without a solution are left out of the indices")


def _print_ranking(console: Console, outcome: SweepReport) -> None:
    shown = outcome.ranking[:_SHOWN]
    head = [name.replace("_", " ") for name in ("parameter", "part", "tolerance", *shown[0].figures)]
    rows = []
    for p in shown:
        cells = (f"{v:.4g}" if isinstance(v, float) else str(v) for v in p.figures.values())
        rows.append([p.name, p.part, f"{p.tolerance:.4g} {p.unit}", *cells])
    title = f"the tolerances that matter most ({outcome.summary.frame})"
    console.print(plain_table(head, rows, (0, 1), title=title, wrap=True))


def _print_allocation(console: Console, allocation: AllocatedTolerances) -> None:
    figures = allocation.figures()
    checked = figures["verified"]
    console.print(
        f"loosest tolerances that keep {figures['requirement_mm']:g} mm for {figures['wanted_share']:.2%} of the "
        f"robots at every pose; {checked['robots']} of them closed exactly at the {checked['poses']} hardest poses: "
        f"{checked['share_within']:.2%} within, {checked['share_at_worst_pose']:.2%} at the worst pose",
        soft_wrap=True,
    )
    tolerances = sorted(figures["tolerances"], key=lambda row: row["factor"])
    rows = [
        (row["parameter"], f"{row['tolerance_mm_or_mrad']:.4g}", f"{row['factor']:.3f}") for row in tolerances[:_SHOWN]
    ]
    head = ("parameter", "tolerance mm or mrad", "times the given one")
    console.print(plain_table(head, rows, title="tightest first"))
    at_cap = sum(row["at_cap"] for row in tolerances)
    if at_cap:
        console.print(f"note: {at_cap} tolerances hardly matter and stand at the cap; see summary.json for all")
