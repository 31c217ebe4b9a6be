"""Stop every writing command at random moments, or obstruct its output, and check the files it leaves.

    python -m scripts.studies.faults moments --count 200 --seed 1
    python -m scripts.studies.faults places

``moments``: SIGKILL and SIGINT, alternately; half of them at a moment of the command's time, of which half count from
the start of Python, and half just before one of the operations that create, rename or remove files. Files must be
complete or absent, an interrupt ends with one line and exit code 130, and the same command, run again, ends with the
same bytes as one that was never stopped.
``places``: full disks, folders without write permission, no home, strange names, locales, clocks, two runs at once.
Each command must succeed, or end with one line and exit code 2 or 3. Both print a Markdown table and the failures; exit
code 1 if there are any. Needs permission to mount disks and to become another user.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from scripts.studies.fault_places import PLACES, places
from scripts.studies.fault_study import COMMANDS, Study, moments


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["moments", "places"])
    parser.add_argument("--count", type=int, default=12, help="moments for each command (default 12)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--command", action="append", help="of these commands only")
    parser.add_argument("--place", action="append", choices=PLACES, help="there only")
    parser.add_argument("--lines", action="store_true", help="print what was said, too")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # started in the background, all would ignore it
    commands = [command for command in COMMANDS if command.name in (given.command or command.name)]
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        study = Study(Path(folder))
        if given.what == "moments":
            heads = ("done before", "nothing", "some of its files", "all")
            print("| command | operations | moments | done before | left nothing | some of its files | all | faults |")
            print("|---|---|---|---|---|---|---|---|")
            for command, tally in moments(study, commands, given.count, given.seed):
                row = (command.name, study.undisturbed(command)[2], given.count, *(tally.said[head] for head in heads))
                print("| " + " | ".join(map(str, (*row, tally.faults))) + " |", flush=True)
                faults += tally.faults
        else:
            print("| fault | commands | right | one line | faults |\n|---|---|---|---|---|")
            for name, tally in places(study, commands, given.place or list(PLACES)):
                row = (name, len(commands), tally.said["right"], tally.said["one line"], tally.faults)
                print("| " + " | ".join(map(str, row)) + " |", flush=True)
                faults += tally.faults
                for line, count in tally.lines.items() if given.lines else ():
                    print(f"{count} × {line}")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
