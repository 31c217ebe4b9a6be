"""``pouring-robot examples``: copies the examples of the package to a folder where one can work with them."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from pouring_robot.cli.shared import options
from pouring_robot.cli.shared.bundles import group_of
from pouring_robot.io.files import copy_folder


def copy(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; it must not be there yet.")],
) -> None:
    """Copy the examples into a new folder: model files, robots, campaigns, sweeps, a plug-in."""
    from pouring_robot.robot.export.shipped_files import examples_path

    files = copy_folder(examples_path(), folder)
    options.say(f"copied {len(files)} files to {folder}")
    model = shlex.quote(str(folder / "actual.yaml"))
    options.say(f"try: pouring-robot pose --at-mm -100 20 -600 --tilt-deg 17 --model {model}", soft_wrap=True)


examples = group_of("The examples that come with the package.", [copy])
