"""Progress bars of a command on a terminal's error stream; elsewhere nothing is shown."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from pouring_robot.cli.shared.options import QUIET
from pouring_robot.io.interrupt import stop_if_heard

if TYPE_CHECKING:
    from pouring_robot.io.progress import Progress

_BESIDE = len("━━━━ 10/10 0:00:00 about 0:00 left") + len(" ^C^C")
_TICK_S = 0.25


def time_left(done: float, total: float | None, elapsed_s: float, since_s: float) -> str:
    """Return the estimated remaining time, which also counts down between steps; nothing before the first step.

    ``total`` is None if steps cannot be counted; ``since_s`` is the time since the last step was done.
    """
    if not done or not total or done >= total:
        return ""
    left = max(0, round((elapsed_s - since_s) * (total - done) / done - since_s))
    return f"about {left // 60}:{left % 60:02d} left" if left else "nearly there"


@contextmanager
def stage_bars() -> Iterator[Progress]:
    """Show a bar per stage with elapsed and remaining time, and remove them at the end.

    Yields the function to call at each step; times also advance between steps.
    """
    from rich import progress
    from rich.console import Console
    from rich.constrain import Constrain
    from rich.table import Column
    from rich.text import Text

    class Errors(Console):
        def show_cursor(self, show: bool = True) -> bool:  # left as it is: a process that is killed, or stopped by
            return False  # Ctrl-Z, could not show it again

    class Bars(progress.Progress):
        def get_renderable(self) -> Constrain:  # leaves room for the terminal's own ^C in the line that is cleared
            return Constrain(super().get_renderable(), errors.width - len("^C^C"))

    class Left(progress.ProgressColumn):
        def render(self, task: progress.Task) -> Text:
            since, first = time.monotonic() - task.fields["stepped"], task.fields["first"]
            total = None if task.total is None else task.total - first
            return Text(time_left(task.completed - first, total, task.elapsed or 0.0, since))

    class Steps(progress.MofNCompleteColumn):
        def render(self, task: progress.Task) -> Text:
            return super().render(task) if task.total else Text()

    errors, whole = Errors(stderr=True), Column(no_wrap=True)
    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        Steps(table_column=whole),
        progress.TimeElapsedColumn(table_column=whole),
        Left(table_column=whole),
    )
    hidden = QUIET.get() or not errors.is_interactive  # a pipe, or TERM=dumb, whose cursor cannot move
    here = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    bars = Bars(*columns, console=errors, transient=True, disable=hidden, auto_refresh=not here)
    drawing = threading.Lock()
    with bars, _ticking(bars.refresh, drawing) if here and not hidden else nullcontext():
        tasks: dict[str, progress.TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            stop_if_heard()
            with drawing:
                for known in bars.tasks:
                    bars.update(known.id, visible=known.finished)
                if stage not in tasks:
                    label, now = stage[: max(errors.width - _BESIDE, 10)], time.monotonic()
                    # Steps of an earlier run, in a resumed sweep, took none of its time.
                    tasks[stage] = bars.add_task(label, total=total or None, stepped=now, first=done)
                bars.update(tasks[stage], completed=done, total=total or None, stepped=time.monotonic(), visible=True)

        yield show


@contextmanager
def _ticking(act: Callable[[], None], busy: threading.Lock) -> Iterator[None]:
    """Act repeatedly, by a signal: next to a thread that did so, work could not be forked to another core.

    Nothing is done while ``busy``: a terminal may be slow (Ctrl-S), and signals arrive while it is being written to.
    """

    def tick(*_: object) -> None:
        if busy.acquire(blocking=False):
            try:
                act()
            finally:
                busy.release()

    before = signal.signal(signal.SIGALRM, tick)
    signal.setitimer(signal.ITIMER_REAL, _TICK_S, _TICK_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
