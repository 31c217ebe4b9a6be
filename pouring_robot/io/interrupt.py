"""Ctrl-C is heard wherever it comes, whatever a library makes of it."""

import atexit
import contextlib
import os
import signal
import sys
import threading
from typing import Any

from pouring_robot.exceptions import ExitCode


class _Heard:
    """Whether there was one, and the exit code that the process is to end with then."""

    yes = False
    code: int = ExitCode.STOPPED


def listen() -> None:
    """Listen from now on, unless whoever started this process lets it ignore Ctrl-C."""
    atexit.register(_end)
    sys.unraisablehook = _raise_again
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _hear)


def listen_no_more(code: int) -> None:
    """Let Ctrl-C do nothing: all is done, with an exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Heard.code = code or ExitCode.STOPPED


def heard() -> bool:
    """Return whether there was one: what fails after it fails because of it (pydantic turns it into its own error)."""
    return _Heard.yes


def stop_if_heard() -> None:
    """Raise a Ctrl-C (KeyboardInterrupt) that a library took for itself: what that gave may be less than all."""
    if heard():
        raise KeyboardInterrupt


def _hear(signum: int, frame: Any) -> None:
    _Heard.yes = True
    if logging := sys.modules.get("logging"):
        logging.disable()  # what a library that swallows it logs of it is for nobody
    signal.default_int_handler(signum, frame)


def _raise_again(lost: Any) -> None:
    """Raise a Ctrl-C again that came where nothing can be raised, such as in the callback of a library."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        # Not here, where it would be lost once more.
        threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(lost)


def _end() -> None:
    """After a Ctrl-C, end without taking Python down, as the first called at exit that is therefore the last.

    A library of compiled code that was stopped while it was loading may abort the process when it is taken down, and
    Python itself ends by the signal where it came in code made from text.
    """
    if heard():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):  # closed, or its reader is gone
                stream.flush()
        os._exit(_Heard.code)
