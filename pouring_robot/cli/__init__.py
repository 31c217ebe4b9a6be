"""The command line: one file a subcommand; ``app`` puts them together and turns errors into one line."""

from __future__ import annotations

import _thread
import io
import os
import signal
import sys
from pathlib import Path
from typing import Any


def main() -> int:
    """Run the ``pouring-robot`` command of this process and return its exit code; Ctrl-C is heard from here on."""
    sys.unraisablehook = _heard_again
    try:
        if sys.stdout is None:  # closed by whoever started it
            sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115 - for as long as the process lives
        # What a terminal's character set lacks is spelt out rather than a fault.
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")
        from pouring_robot.cli import app

        code = app.main()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done
    except KeyboardInterrupt:  # while the program was being loaded
        print("pouring-robot: stopped", file=sys.stderr)
        return 130
    return code


def _heard_again(lost: Any) -> None:
    """Raise a Ctrl-C again that came where nothing can be raised, such as in the callback of a library."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _thread.interrupt_main()
    else:
        sys.__unraisablehook__(lost)
