"""Handles Ctrl-C wherever it comes, also where a library swallows it."""

import atexit
import contextlib
import os
import signal
import sys
import threading
from typing import Any

from pouring_robot.exceptions import ExitCode


class _Heard:
    """Whether there was a Ctrl-C, and the exit code that the process ends with in that case."""

    yes = False
    code: int = ExitCode.STOPPED


def listen() -> None:
    """Handle Ctrl-C from now on, unless this process was started with Ctrl-C ignored."""
    atexit.register(_end)
    sys.unraisablehook = _raise_again
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _hear)


def listen_no_more(code: int) -> None:
    """Ignore Ctrl-C from now on: the work is done, with an exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Heard.code = code or ExitCode.STOPPED


def heard() -> bool:
    """Return whether there was a Ctrl-C: later failures are due to it (pydantic turns it into an error of its own)."""
    return _Heard.yes


def stop_if_heard() -> None:
    """Raise a Ctrl-C (KeyboardInterrupt) that a library swallowed: the library's result may be incomplete."""
    if heard():
        raise KeyboardInterrupt


def _hear(signum: int, frame: Any) -> None:
    _Heard.yes = True
    if logging := sys.modules.get("logging"):
        logging.disable()  # no log of it by a library that swallows it
    signal.default_int_handler(signum, frame)


def _raise_again(lost: Any) -> None:
    """Raise a Ctrl-C again that came where it cannot be raised, such as in the callback of a library."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        # Not here, where it would be lost once more.
        threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(lost)


def _end() -> None:
    """After a Ctrl-C, exit without Python's clean-up; registered first, and therefore called last at exit.

    A compiled library that was interrupted while it was loading may abort the process in the clean-up, and Python
    itself ends by the signal where it came in code made from text.
    """
    if heard():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):  # closed, or its reader is gone
                stream.flush()
        os._exit(_Heard.code)
