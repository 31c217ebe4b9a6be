"""The command: reads the folder, prints the diagnosis."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence

from pouring_robot.exceptions import PouringRobotError

from .data import FIRST_FILE, SECOND_FILE, read_first, read_second
from .report import as_text, report


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the diagnosis of a folder; return 0, 2 for bad input, 3 where the rows do not allow an answer."""
    parser = argparse.ArgumentParser(
        prog="telescope_focus", description="Diagnose the focus of the Mayall 4 m telescope with the diagnosis core."
    )
    parser.add_argument("folder", metavar="DIR", help=f"folder that holds {FIRST_FILE} and {SECOND_FILE}")
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(arguments)
    try:
        result = report(read_first(given.folder), read_second(given.folder))
        text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False) if given.json else as_text(result)
        print(text)
        sys.stdout.flush()
    except PouringRobotError as error:
        print(f"telescope_focus: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        # The reader, such as `head`, has gone, or the disk is full; keep Python from saying so again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return 0
        print(f"telescope_focus: cannot write: {error}", file=sys.stderr)
        return 2
    return 0
