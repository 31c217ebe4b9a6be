"""The last net: what nobody foresaw becomes one line, with the details in a file that can be sent with a report."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path

from pouring_robot import __version__

EXIT_CODE = 70
"""An error of the program itself, as ``sysexits.h`` counts it."""


def caught(error: BaseException, arguments: Sequence[str]) -> str:
    """Return the line for an error that nobody foresaw, and write what is known of it into a file.

    Args:
        error: what was raised.
        arguments: of the command line.
    """
    if isinstance(error, MemoryError):
        what = "there is not enough memory for this; ask for fewer rows, samples or poses at a time"
    else:
        what = f"a fault of the program itself: {type(error).__name__}: {str(error)[:200]}"
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "pouring_robot" in Path(frame.filename).parts] or frames
    where = f" ({Path(ours[-1].filename).name}, line {ours[-1].lineno})" if ours else ""
    return f"{what}{where}; {_kept(_details(error, arguments))}"


def _details(error: BaseException, arguments: Sequence[str]) -> str:
    """Return versions, command and traceback; nothing of the environment, which may hold secrets."""
    command = shlex.join(["pouring-robot", *arguments])
    versions = f"pouring_robot {__version__}, Python {platform.python_version()}, {platform.platform()}"
    return f"{versions}\n{command}\n\n{''.join(traceback.format_exception(error))}"


def _kept(details: str) -> str:
    """Write the details into a file of the user's own and return what to do with them."""
    try:
        handle, name = tempfile.mkstemp(prefix="pouring-robot-fault-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(details)
    except OSError:  # no place to write to: then they are said after all
        print(details, file=sys.stderr)
        return "please report it with the lines above"
    return f"please report it with the file {name}, which tells the command and where it stopped"
