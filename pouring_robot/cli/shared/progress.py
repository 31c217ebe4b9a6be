"""Bars and lines that say on a terminal's error stream how far a command is; elsewhere nothing is shown."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pouring_robot.io.progress import Progress, Status


@contextmanager
def stage_bars() -> Iterator[Progress]:
    """Show a bar a stage with the time gone and left, and take them away at the end.

    Yields:
        A function that is told the name of a stage, the number of its steps done and their number in all.
    """
    from rich import progress
    from rich.console import Console

    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TextColumn("gone,"),
        progress.TimeRemainingColumn(),
        progress.TextColumn("left"),
    )
    errors = Console(stderr=True)
    with progress.Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bars:
        tasks: dict[str, progress.TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield show


@contextmanager
def status() -> Iterator[Status]:
    """Show in words what is being done.

    Yields:
        A function that says what is being done now.
    """
    if not sys.stderr.isatty():
        yield lambda text: None
        return
    from rich.console import Console

    with Console(stderr=True, highlight=False).status("reading") as shown:
        yield lambda text: shown.update(text[:100])
