"""Work that a forked copy of this process does beside it, on another core; the copy knows all that this one knows.

Where copying is not safe, because other threads are at work here or the platform cannot tell, the work is done in this
process, when its result is asked for.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeVar

Found = TypeVar("Found")

_PATIENCE_S = 600.0


@contextmanager
def forked(work: Callable[[], Found]) -> Iterator[Callable[[], Found]]:
    """Let some work be done beside what stands in a ``with`` block; a copy that is still at it ends with the block.

    Its result must be fit to be pickled. What fails in the copy, or hangs, is done here again, where it says why.

    Yields:
        What waits for the result and returns it.
    """
    if not can_be_copied():
        yield work
        return
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    copy = context.Process(target=_do, args=(work, theirs), daemon=True)
    copy.start()
    theirs.close()

    def answer() -> Found:
        with suppress(EOFError):  # the copy has ended without an answer
            if ours.poll(_PATIENCE_S):
                found: Found = ours.recv()
                return found
        copy.kill()
        return work()

    try:
        yield answer
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


def _do(work: Callable[[], Found], theirs: Connection) -> None:
    """Do the work as the copy, which ends with the process that it is of, and silently at a Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(Exception):  # it is raised where the work is done again
        theirs.send(work())


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
