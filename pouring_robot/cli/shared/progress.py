"""Bars and lines that say on a terminal's error stream how far a command is; elsewhere nothing is shown."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pouring_robot.cli.shared.options import is_quiet

if TYPE_CHECKING:
    from pouring_robot.io.progress import Progress, Status


def time_left(done: float, total: float | None, elapsed_s: float, since_s: float) -> str:
    """Return how long it may take yet, counted down between steps too; nothing before the first step.

    Args:
        done: steps done.
        total: steps in all; None if they cannot be counted.
        elapsed_s: since the start.
        since_s: since the last step was done.
    """
    if not done or not total or done >= total:
        return ""
    left = max(0, round((elapsed_s - since_s) * (total - done) / done - since_s))
    return f"about {left // 60}:{left % 60:02d} left" if left else "nearly there"


@contextmanager
def stage_bars() -> Iterator[Progress]:
    """Show a bar a stage with the time gone and left, and take them away at the end.

    Yields:
        A function that is told the name of a stage, the number of its steps done and their number in all.
    """
    from rich import progress
    from rich.console import Console
    from rich.text import Text

    class Left(progress.ProgressColumn):
        def render(self, task: progress.Task) -> Text:
            since = time.monotonic() - task.fields["stepped"]
            return Text(time_left(task.completed, task.total, task.elapsed or 0.0, since))

    errors = Console(stderr=True)
    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        Left(),
    )
    hidden = is_quiet() or not errors.is_terminal
    with progress.Progress(*columns, console=errors, transient=True, disable=hidden) as bars:
        tasks: dict[str, progress.TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total, stepped=time.monotonic())
            bars.update(tasks[stage], completed=done, total=total, stepped=time.monotonic())

        yield show


@contextmanager
def status() -> Iterator[Status]:
    """Show in words what is being done, and for how long.

    Yields:
        A function that says what is being done now.
    """
    from rich import progress
    from rich.console import Console

    errors = Console(stderr=True, highlight=False)
    columns = (progress.SpinnerColumn(), progress.TextColumn("{task.description}"), progress.TimeElapsedColumn())
    hidden = is_quiet() or not errors.is_terminal
    with progress.Progress(*columns, console=errors, transient=True, disable=hidden) as bars:
        task = bars.add_task("reading", total=None)
        yield lambda text: bars.update(task, description=text[:100])
