"""The ``pouring-robot`` command: its subcommands, and how errors reach the user.

It ends with an :class:`~pouring_robot.exceptions.ExitCode`. An error is one line on standard error; a traceback never
reaches a user.
"""

import importlib
import itertools
import os
import platform
import shlex
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from pouring_robot import __version__
from pouring_robot.cli.shared.bundles import HELP_PAGE, group_of
from pouring_robot.exceptions import ExitCode, PouringRobotError, StoppedError
from pouring_robot.io.interrupt import heard
from pouring_robot.io.threads import one_blas_thread_from_the_start

# Subcommands in the order of use, as on the help page, with their modules, which are imported on demand.
_MODULES = {path.rpartition(".")[2]: path for path in (
    "examples", "robots", "robot", "poses.pose", "poses.path", "poses.view", "campaign", "diagnose", "effects",
    "calibrate", "poses.compensate", "sensitivity", "sweep", "poses.thermal", "regress", "export",
)}  # fmt: skip

EXTRAS = {
    "dask": "distributed",
    "distributed": "distributed",
    "embreex": "viewer",
    "pyarrow": "parquet",
    "sklearn": "regression",
    "statsmodels": "regression",
}
"""The extra of this package that installs a module which a plain installation lacks."""


class _Subcommands(TyperGroup):
    """The subcommands, each imported on demand."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        names: dict[str, Any] = dict.fromkeys(_MODULES)
        self.commands = names

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in _MODULES:
            return None
        found = getattr(importlib.import_module(f"pouring_robot.cli.{_MODULES[cmd_name]}"), cmd_name)
        if isinstance(found, typer.Typer):
            return typer.main.get_group(found)
        return typer.main.get_command(group_of("", [found]))


app = typer.Typer(
    name="pouring-robot",
    help="Says where the ladle of a hybrid truss pouring robot really is.",
    cls=_Subcommands,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=HELP_PAGE,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"pouring-robot {__version__}")
        raise typer.Exit


@app.callback()
def _before_any_command(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


def _complain(message: str) -> None:
    """Print a problem in a line, and whether the working folder has been deleted, a frequent cause of others."""
    try:
        Path.cwd()
    except OSError:
        message += "; the current folder no longer exists: change into another"
    _to_stderr("pouring-robot: " + " ".join(message.split()))


def _to_stderr(text: str) -> None:
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:  # full disk, or no reader: the exit code still tells it, unless Python tries again at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    one_blas_thread_from_the_start()
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        return _run(given)
    except Exception as error:
        if heard():
            _complain("stopped")
            return ExitCode.STOPPED
        if _of_a_package(error):
            return ExitCode.BAD_INPUT
        _complain(_caught(error, given))
        return ExitCode.FAULT


def _run(given: list[str]) -> int:
    try:
        outcome = app(args=given or ["--help"], prog_name="pouring-robot", standalone_mode=False)
        sys.stdout.flush()
        if outcome == ExitCode.STOPPED:  # Typer's outcome after Ctrl-C
            raise StoppedError("stopped")
        return outcome if isinstance(outcome, int) else ExitCode.DONE
    except PouringRobotError as error:
        _complain(str(error))
        return error.exit_code
    except typer.TyperException as error:  # any error in arguments
        # Typer passes on the message of the library that checks values, but not the value.
        problem = error.format_message().replace("Value error, ", "").rstrip(".")
        refused = [repr(one["input"]) for one in getattr(error.__cause__, "errors", list)()[:1]]
        problem += "".join(f" (it is {given})" for given in refused if given not in problem)
        # Where an option lacks values, Typer does not name the command.
        words = ["pouring-robot", *itertools.takewhile(lambda word: not word.startswith("-"), given)]
        asked = getattr(getattr(error, "ctx", None), "command_path", " ".join(words))
        _complain(f"{problem}; see {asked} --help")
        return ExitCode.BAD_INPUT
    except ModuleNotFoundError as error:
        module = str(error.name).partition(".")[0]
        if module not in EXTRAS:
            raise
        _complain(f"this needs {module}, which is not installed: pip install 'pouring_robot[{EXTRAS[module]}]'")
        return ExitCode.BAD_INPUT
    except (typer.Abort, KeyboardInterrupt):
        _complain("stopped")
        return ExitCode.STOPPED
    except (BrokenPipeError, SystemExit) as error:
        if _of_a_package(error):
            return ExitCode.BAD_INPUT
        # The reader (such as `head`) has gone; then Click and Rich raise SystemExit, which nothing else here does. This
        # is no failure: print nothing, and prevent Python from reporting it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitCode.DONE
    except OSError as error:
        _complain(f"cannot read or write: {error}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitCode.BAD_INPUT


def _of_a_package(error: BaseException) -> bool:
    """Print in a line which effect of another package failed, if one did; return whether it was one."""
    if "pouring_robot.effects.available" not in sys.modules:  # no command has loaded any
        return False
    from pouring_robot.effects.available import failed_effect

    if failed := failed_effect(error):
        why = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")
        _complain(f"{failed} fails: {why}; correct it, or leave it out by --exclude")
    return bool(failed)


def _caught(error: BaseException, arguments: Sequence[str]) -> str:
    """Return the line for an unexpected error, and write its details into a file."""
    if isinstance(error, MemoryError):
        what = "there is not enough memory for this; ask for fewer rows, samples or poses at a time"
    else:
        what = f"a fault of the program itself: {type(error).__name__}: {str(error)[:200]}"
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "pouring_robot" in Path(frame.filename).parts] or frames
    where = f" ({Path(ours[-1].filename).name}, line {ours[-1].lineno})" if ours else ""
    # Versions, command and traceback; not the environment, which may contain secrets.
    command = shlex.join(["pouring-robot", *arguments])
    versions = f"pouring_robot {__version__}, Python {platform.python_version()}, {platform.platform()}"
    details = f"{versions}\n{command}\n\n{''.join(traceback.format_exception(error))}"
    try:
        handle, name = tempfile.mkstemp(prefix="pouring-robot-fault-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(details)
        kept = f"please report it with the file {name}, which holds the command and where it stopped"
    except OSError:  # nowhere to write: then they are printed
        _to_stderr(details)
        kept = "please report it with the lines above"
    return f"{what}{where}; {kept}"
