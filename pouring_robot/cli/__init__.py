"""The command line: one file per subcommand; ``app`` combines them and turns errors into one line."""

import gc
import io
import os
import sys
from pathlib import Path

from pouring_robot.exceptions import ExitCode
from pouring_robot.io import interrupt

OBJECTS_BETWEEN_COLLECTIONS = 10_000
"""With Python's default of 700 the garbage collector scans all loaded objects several times: 7 % of a diagnosis."""


def main() -> int:
    """Run the ``pouring-robot`` command of this process and return its exit code; Ctrl-C is handled from here on."""
    try:
        interrupt.listen()
        gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
        for name in ("stdout", "stderr"):
            if getattr(sys, name) is None:  # closed by the calling process
                setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - for as long as the process lives
        # Characters that the terminal's character set lacks are escaped instead of causing an error.
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")
        from pouring_robot.cli import app

        code = app.main()
        interrupt.listen_no_more(code)
        if code == 0:
            interrupt.stop_if_heard()
    except KeyboardInterrupt:  # while the program was loading, or after a library has caught it
        print("pouring-robot: stopped", file=sys.stderr)
        return ExitCode.STOPPED
    return code
