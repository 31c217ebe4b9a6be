"""Files are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from pouring_robot.exceptions import OutputError


def write_whole(path: Path | str, content: bytes | str) -> Path:
    """Write a file so that nobody ever sees half of it.

    The content goes to a hidden file beside the target, which then takes the target's name in one step.
    If anything fails on the way, Ctrl-C included, the hidden file is removed and an older target stays.
    A pipe or a device (``/dev/stdout``) has no "whole" and is written straight.

    Args:
        path: the file to write; a symbolic link is followed. Its folder must exist.
        content: bytes, or text that is written as UTF-8.

    Returns:
        The path that was given.

    Raises:
        OutputError: the folder does not exist, may not be written to, or the target is a folder.
    """
    given = Path(path)
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        target = given.resolve()
        if target.is_dir():
            raise OutputError(given, "it is a folder; give a file name")
        if not target.parent.is_dir():
            raise OutputError(given, f"the folder {given.parent} does not exist; make it first")
        if target.exists() and not target.is_file():
            target.write_bytes(data)
        else:
            _replace(target, data)
    except OSError as error:
        raise OutputError(given, f"{error.strerror or error}; choose a place you may write to") from error
    return given


def _replace(target: Path, data: bytes) -> None:
    """Write beside the target and put the result in its place; keep the mode of a file that was there."""
    # Not `tempfile`: its files are private to their owner, and a result should follow the user's umask.
    hidden = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}.part")
    try:
        with hidden.open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        if target.exists():
            hidden.chmod(target.stat().st_mode & 0o7777)
        hidden.replace(target)
    finally:
        hidden.unlink(missing_ok=True)


def check_writable(path: Path | str) -> None:
    """Find out, without touching it, whether a file can be written: before hours of work, not after.

    Raises:
        OutputError: as :func:`write_whole` would.
    """
    given = Path(path)
    try:
        target = given.resolve()
        if target.is_dir():
            raise OutputError(given, "it is a folder; give a file name")
        if not target.parent.is_dir():
            raise OutputError(given, f"the folder {given.parent} does not exist; make it first")
        place = target if target.exists() and not target.is_file() else target.parent
        if not os.access(place, os.W_OK):
            raise OutputError(given, "permission denied; choose a place you may write to")
    except OSError as error:
        raise OutputError(given, f"{error.strerror or error}; choose a place you may write to") from error
