"""Work in a forked copy of this process, on another core; the copy has all data of this process.

Where forking is not safe, because other threads run here or the platform cannot tell, the work is done in this process,
when its result is requested.
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
    """Do some work in parallel with a ``with`` block; a copy that is still running ends with the block.

    Its result must be picklable. Work that fails in the copy, or hangs, is repeated here, where it says why.

    Yields:
        A function that waits for the result and returns it.
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
    """Return whether no other thread runs here, of Python or of a library, whose locks a copy would inherit."""
    try:
        return len(list(Path("/proc/self/task").iterdir())) == 1
    except OSError:  # no Linux
        return False


def _do(work: Callable[[], Found], theirs: Connection) -> None:
    """Do the work in the copy, which ends with its parent process, and silently at a Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(Exception):  # raised where the work is repeated
        theirs.send(work())


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
