"""``pouring-robot sweep``: a tolerance study from a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pouring_robot.cli.shared import options, progress
from pouring_robot.cli.shared.options import argument, opt
from pouring_robot.cli.shared.tables import print_table
from pouring_robot.exceptions import NoSolutionError, StoppedError

if TYPE_CHECKING:
    from pouring_robot.report.page import Table
    from pouring_robot.sweeps.analysis.report import SweepReport

_SHOWN = 15


def sweep(
    config: Annotated[Path, argument("CONFIG.yaml", "Sweep file; see examples/sweep.yaml.")],
    out: Annotated[Path, opt("Folder for the results; created if needed.", metavar="DIR")],
    resume: Annotated[bool, opt("Continue a sweep that was stopped.", "--resume")] = False,
    overwrite: Annotated[bool, opt("Replace an existing sweep.", "--overwrite")] = False,
    workers: Annotated[int, opt("Worker processes on this machine (0: none but this one).", metavar="N", min=0)] = 0,
    scheduler: Annotated[str | None, opt("Compute on this Dask cluster instead.", metavar="ADDRESS")] = None,
    robot: options.RobotFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Find out which tolerances matter, how far the tool is off, and the loosest tolerances that will do."""
    # xarray, Zarr and SciPy take a second to import; only this command needs them.
    from pouring_robot.sweeps import SweepConfig, SweepPlan, report, run_sweep

    study = SweepConfig.load(config)
    plan = SweepPlan(study if robot is None else study.with_robot(robot))
    if name := plan.config.model:
        options.note(*plan.model.cautions(name), *plan.model.left_out("this command", name))
    done, total = 0, 0
    with progress.stage_bars() as show:

        def count(stage: str, chunks: int, of: int) -> None:
            nonlocal done, total
            if stage == "sweep":
                done, total = chunks, of
            show(stage, chunks, of)

        try:
            store = run_sweep(
                plan, out, resume=resume, overwrite=overwrite, workers=workers, scheduler=scheduler, progress=count
            )
            outcome = report(store, count)
        except KeyboardInterrupt as stop:
            kept = f"{done} of {total} chunks are kept in {out}: continue with --resume" if done else "nothing is kept"
            raise StoppedError(f"stopped; {kept}") from stop
    written = (outcome.store.path, *outcome.save())
    if as_json:
        options.print_figures(outcome.figures(), written)
    else:
        _print(outcome, written)
    if not outcome.summary.closed:
        raise NoSolutionError(outcome.headline)


def _print(outcome: SweepReport, written: Sequence[Path]) -> None:
    from pouring_robot.sweeps.analysis import report

    for k, line in enumerate(report.summary_lines(outcome)):
        options.say(line, style="" if k else "bold")
    title = f"the tolerances that matter most ({outcome.summary.frame})"
    _print_first(report.ranking_table(outcome), title)
    if outcome.allocation:
        options.say(report.allocation_line(outcome.allocation))
        _print_first(report.allocation_table(outcome.allocation), "tightest first")
    options.print_written(written)


def _print_first(table: Table, title: str) -> None:
    beyond = "more in the report"
    print_table(table.head, table.rows, table.left, title=title, most=_SHOWN, beyond=beyond)
