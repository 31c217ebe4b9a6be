"""The ``pouring-robot`` command: its subcommands, and how errors reach the user.

Exit codes: 0 done, 2 bad input, 3 no solution. An error is one line on standard error; a traceback never reaches
a user of a sound installation.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from pouring_robot import __version__
from pouring_robot.exceptions import PouringRobotError

# Where each subcommand stands, in the order of the help page. A module is imported when its command is asked for.
_COMMANDS = {
    "pose": "pose:pose",
    "path": "path:path",
    "robots": "robots:robots",
    "view": "view:view",
    "export": "export:export",
    "sweep": "sweep:sweep",
    "calibrate": "calibrate:calibrate",
    "diagnose": "diagnose:diagnose",
    "effects": "diagnose:effects",
    "thermal": "thermal:thermal",
    "compensate": "compensate:compensate",
    "campaign": "campaign:app",
}


class _Subcommands(TyperGroup):
    """The subcommands, each imported on demand."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        names: dict[str, Any] = dict.fromkeys(_COMMANDS)
        self.commands = names

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in _COMMANDS:
            return None
        module, _, attribute = _COMMANDS[cmd_name].partition(":")
        found = getattr(importlib.import_module(f"pouring_robot.cli.{module}"), attribute)
        if isinstance(found, typer.Typer):
            return typer.main.get_group(found)
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(cmd_name)(found)
        return typer.main.get_command(alone)


app = typer.Typer(
    name="pouring-robot",
    help="Says where the ladle of a hybrid truss pouring robot really is.",
    cls=_Subcommands,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
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
    print("pouring-robot: " + " ".join(message.split()), file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code (0 done, 2 bad input, 3 no solution)."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        outcome = app(args=given or ["--help"], prog_name="pouring-robot", standalone_mode=False)
        sys.stdout.flush()
        return outcome if isinstance(outcome, int) else 0
    except PouringRobotError as error:
        _complain(str(error))
        return error.exit_code
    except typer.TyperException as error:  # every complaint about arguments
        # Typer passes on words of the library that checks values.
        problem = error.format_message().replace("Value error, ", "").rstrip(".")
        _complain(f"{problem}; see pouring-robot --help")
        return 2
    except (typer.Abort, KeyboardInterrupt):
        _complain("stopped")
        return 130
    except BrokenPipeError:
        # The reader (such as `head`) has gone: say nothing, and keep Python from saying it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        _complain(f"cannot read or write: {error}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2


if __name__ == "__main__":
    raise SystemExit(main())
