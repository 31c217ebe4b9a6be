"""The command line in one process that is disturbed; the process is new, or a fork of a warm one.

    python -m scripts.studies.fault_child FOLDER AT WHAT pose --at-mm -100 20 -600

A warm process has the package loaded, which is most of the time of a short command.
"""

from __future__ import annotations

import multiprocessing
import os
import pkgutil
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pouring_robot

_FORKS = multiprocessing.get_context("forkserver")
_LOADED = [
    __name__,
    *(f"pouring_robot.{folder.name}" for folder in pkgutil.iter_modules(pouring_robot.__path__) if folder.ispkg),
    "pouring_robot.cli.app",
    "matplotlib.pyplot",
    "plotly.graph_objects",
    "zarr",
]


def run(place: str, at: int, what: str, arguments: Sequence[str], told: Path | None = None) -> int:
    """Run a command; return its exit code.

    Args:
        place: folder whose files count: what makes, renames or removes one is an operation.
        at: number of the operation just before which something happens; 0: none.
        what: a signal's name; ``full``: the disk is, from then on; ``clock``: time goes back, all the while.
        arguments: of the command.
        told: file that the number of operations is written to.
    """
    seen = 0

    def below(path: object) -> bool:
        return isinstance(path, (str, os.PathLike)) and str(Path(os.fsdecode(path)).absolute()).startswith(place)

    def hook(event: str, given: tuple[Any, ...]) -> None:
        nonlocal seen
        if event == "open":
            path, _, flags = given
            touched = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) and below(path)
        else:
            touched = event in ("os.rename", "os.mkdir", "os.remove", "os.rmdir") and below(given[0])
        if not touched:
            return
        seen += 1
        if seen == at and what.startswith("SIG"):
            os.kill(os.getpid(), getattr(signal, what))
        elif at and seen >= at and what == "full" and event in ("open", "os.mkdir"):
            raise OSError(28, "No space left on device", given[0])

    sys.addaudithook(hook)
    if what == "clock":
        start, real = time.time(), time.monotonic
        time.time = lambda: start - 3600.0 * real()
    sys.argv = ["pouring-robot", *arguments]
    from pouring_robot.cli import main

    code = main()
    if told:
        told.write_text(str(seen), encoding="ascii")
    return code


def start_warm(variables: Mapping[str, str], said: Path, *given: Any) -> BaseProcess:
    """Start :func:`run` in a fork that is warm; what it says on standard error goes to a file."""
    _FORKS.set_forkserver_preload(_LOADED)
    process = _FORKS.Process(target=_warm, args=(dict(variables), str(said), *given))
    process.start()
    return process


def _warm(variables: Mapping[str, str], said: str, place: str, *given: Any) -> None:
    os.environ.clear()
    os.environ.update(variables)
    for stream, path in ((2, said), (1, os.devnull), (0, os.devnull)):
        opened = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        os.dup2(opened, stream)
        os.close(opened)
    sys.stdout, sys.stderr = (open(stream, "w", encoding="utf-8", closefd=False) for stream in (1, 2))  # noqa: SIM115
    os.chdir(place)
    sys.exit(run(place, *given))


if __name__ == "__main__":
    sys.exit(run(sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4:]))
