"""Work that a forked copy of this process does beside it, on another core; the copy knows all that this one knows.

Where copying is not safe, because other threads are at work here or the platform cannot tell, the work is done in this
process, when its result is asked for.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

Found = TypeVar("Found")

_PATIENCE_S = 600.0


@contextmanager
def beside(work: Callable[[], Found]) -> Iterator[Callable[[], Found]]:
    """Let some work be done beside what stands in a ``with`` block; a copy that is still at it ends with the block.

    Its result, and what it raises, must be fit to be pickled.

    Yields:
        What waits for the result and returns it. It raises what the work has raised, with the traceback of the copy as
        a note, and ChildProcessError if the copy ends or hangs without an answer.
    """
    if not can_be_copied():
        yield work
        return
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    copy = context.Process(target=_do, args=(work, theirs), daemon=True)
    copy.start()
    theirs.close()
    try:
        yield lambda: _answer(ours)
    finally:
        copy.kill()
        copy.join()
        ours.close()


def can_be_copied() -> bool:
    """Return whether no other thread is at work here, of Python or of a library, whose locks a copy would inherit."""
    try:
        return len(list(Path("/proc/self/task").iterdir())) == 1
    except OSError:  # no Linux
        return False


def _answer(ours: Connection) -> Any:
    try:
        if not ours.poll(_PATIENCE_S):
            raise ChildProcessError(f"what was done beside this process took more than {_PATIENCE_S:.0f} s")
        found, failure = ours.recv()
    except EOFError as error:
        raise ChildProcessError("what was done beside this process ended without a result") from error
    if failure is not None:
        kind, args, state = failure
        again: BaseException = kind.__new__(kind, *args)  # not by its own arguments, which nobody knows any more
        again.__dict__.update(state)
        raise again
    return found


def _do(work: Callable[[], Found], theirs: Connection) -> None:
    """Do the work as the copy, which ends with the process that it is of, and silently at a Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        answer: tuple[Found | None, object] = work(), None
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))
        answer = None, (type(error), error.args, error.__dict__)
    with contextlib.suppress(BrokenPipeError):
        theirs.send(answer)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
