"""Contents of a page: its blocks, its commands with their output, and whether that is what they print."""

import re
import runpy
import shlex
import warnings
from pathlib import Path
from unittest.mock import patch

from pouring_robot.cli.app import main


def fences(page: Path, *kinds: str) -> list[tuple[str, str]]:
    """Return kind and text of the page's blocks of some kinds, in order."""
    found = re.findall(r"^```(\w+)\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [(kind, text) for kind, text in found if kind in kinds]


def commands(text: str) -> list[tuple[str, str]]:
    """Return every command of a console block with the output that is shown for it."""
    found = []
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, _, output = part.partition("\n")
        found.append((re.sub(r"\s+# .*$", "", command), output))
    return found


def squeezed(text: str) -> str:
    """Return a text with every run of white space as one blank."""
    return " ".join(text.split())


def assert_shown(shown: str, printed: str) -> None:
    """Check that what is shown was printed, in order; a line of dots stands for anything."""
    rest = squeezed(printed)
    for run in re.split(r"^\.\.\.$", shown, flags=re.MULTILINE):
        wanted = squeezed(run)
        assert wanted in rest, f"not printed: {wanted}\nbut: {rest}"
        rest = rest[rest.index(wanted) + len(wanted) :]


def what_it_prints(command, capfd):
    """Run a command of a page, which must end well, and return what it says."""
    program, *arguments = shlex.split(command)
    capfd.readouterr()
    if program == "pouring-robot":
        assert main(arguments) == 0, command
    else:
        assert (Path(program).name, arguments[0]) == ("python", "-m"), command
        with patch("sys.argv", arguments[1:]), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # other tests may have loaded that module
            runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
    return capfd.readouterr().out
