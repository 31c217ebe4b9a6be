"""Pinocchio's model of a URDF, and what its parser says of one that it does not take."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pinocchio as pin

from pouring_robot.exceptions import DescriptionError

# The parser writes to the process's standard error, of which there is one.
_lock = threading.Lock()


def parsed(urdf: str, source: Path) -> pin.Model:
    """Return the model of a URDF text.

    Args:
        urdf: the text.
        source: whose URDF it is, for what is said of it.

    Raises:
        DescriptionError: Pinocchio cannot build it; says why in its parser's words.
    """
    words: list[str] = []
    try:
        with _heard(words):
            model = pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as problem:
        why = "; ".join([line.removeprefix("Error:").strip() for line in words] or [str(problem)])
        raise DescriptionError(f"URDF of {source}", f"Pinocchio cannot build it: {why}") from problem
    for line in words:  # it took the URDF, but not without a word
        print(line, file=sys.stderr)
    return model


@contextlib.contextmanager
def _heard(words: list[str]) -> Iterator[None]:
    """Collect the lines that a library writes to standard error meanwhile."""
    with _lock, tempfile.TemporaryFile() as heard:
        sys.stderr.flush()
        saved = os.dup(2)
        os.dup2(heard.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            heard.seek(0)
            words += [line for line in heard.read().decode(errors="replace").splitlines() if line.strip()]
