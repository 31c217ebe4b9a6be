"""The command line: one file a subcommand; ``app`` puts them together and turns errors into one line."""

import gc
import io
import os
import sys
from pathlib import Path

from pouring_robot.exceptions import ExitCode
from pouring_robot.io import interrupt

OBJECTS_BETWEEN_COLLECTIONS = 10_000
"""Python's own 700 has a command look through all that it has loaded several times: 7 % of a diagnosis."""


def main() -> int:
    """Run the ``pouring-robot`` command of this process and return its exit code; Ctrl-C is heard from here on."""
    try:
        interrupt.listen()
        gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
        for name in ("stdout", "stderr"):
            if getattr(sys, name) is None:  # closed by whoever started it
                setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - for as long as the process lives
        # What a terminal's character set lacks is spelt out rather than a fault.
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")
        from pouring_robot.cli import app

        code = app.main()
        interrupt.listen_no_more(code)
        if code == 0:
            interrupt.stop_if_heard()
    except KeyboardInterrupt:  # while the program was being loaded, or a library has swallowed it
        print("pouring-robot: stopped", file=sys.stderr)
        return ExitCode.STOPPED
    return code
