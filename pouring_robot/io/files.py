"""Files are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
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
    try:
        target = _target(given)
        if target.exists() and not target.is_file():
            target.write_bytes(_bytes(content))
            return given
        with _hidden(target, content) as hidden:
            hidden.replace(target)
    except OSError as error:
        raise OutputError(given, f"{error.strerror or error}; choose a place you may write to") from error
    return given


def write_together(files: Mapping[Path, bytes | str]) -> list[Path]:
    """Write several files, all or none; folders that are missing are made.

    All are written beside their places before the first is put there. If anything fails, Ctrl-C included, new files
    and folders are removed and older files are as they were.

    Args:
        files: what each file shall hold; put in place in this order.

    Returns:
        The files, in order.

    Raises:
        OutputError: a folder cannot be made, or as :func:`write_whole`.
    """
    for path in files:
        if path.parent.is_dir():
            check_writable(path)  # most of what can go wrong is seen before anything is touched
    before: dict[Path, bytes | None] = {}
    made: list[Path] = []
    try:
        with ExitStack() as stack:
            parts = {}
            for path, content in files.items():
                made += _make_folder(path.parent)
                parts[path] = stack.enter_context(_hidden(_target(path), content))
            for path, hidden in parts.items():
                before[path] = path.read_bytes() if path.is_file() else None
                hidden.replace(_target(path))
    except BaseException as error:
        for path, old in before.items():
            if old is not None:
                write_whole(path, old)
            else:
                path.unlink(missing_ok=True)
        for folder in reversed(made):
            folder.rmdir()
        if isinstance(error, OSError):
            raise OutputError(path, f"{error.strerror or error}; choose a place you may write to") from error
        raise
    return list(files)


def copy_folder(source: Path, folder: Path) -> list[Path]:
    """Copy the files of a folder into a new one, all or none; what Python has compiled in it stays.

    Returns:
        The new files.

    Raises:
        OutputError: the folder is there already, or cannot be made.
    """
    if folder.exists():
        raise OutputError(folder, "it is there already; choose another name")
    files = [path for path in sorted(source.rglob("*")) if path.is_file() and "__pycache__" not in path.parts]
    return write_together({folder / path.relative_to(source): path.read_bytes() for path in files})


def _make_folder(folder: Path) -> list[Path]:
    """Make a folder and those above it, and return the new ones from the top; if one cannot be made, make none."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    made: list[Path] = []
    try:
        for place in reversed(missing):
            place.mkdir()
            made.append(place)
    except OSError as error:
        for place in reversed(made):
            place.rmdir()
        raise OutputError(folder, f"{error.strerror or error}; choose a place you may write to") from error
    return made


@contextmanager
def _hidden(target: Path, content: bytes | str) -> Iterator[Path]:
    """Write content beside a target, with the mode of a file that is there; what is left in the end is removed."""
    # Not `tempfile`: its files are private to their owner, and a result should follow the user's umask.
    hidden = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}.part")
    try:
        with hidden.open("xb") as stream:
            stream.write(_bytes(content))
            stream.flush()
            os.fsync(stream.fileno())
        if target.exists():
            hidden.chmod(target.stat().st_mode & 0o7777)
        yield hidden
    finally:
        hidden.unlink(missing_ok=True)


def _bytes(content: bytes | str) -> bytes:
    return content.encode("utf-8") if isinstance(content, str) else content


def _target(given: Path) -> Path:
    """Return the file that a path means, symbolic links followed; it must be none of what cannot be written to."""
    target = given.resolve()
    if target.is_dir():
        raise OutputError(given, "it is a folder; give a file name")
    if not target.parent.is_dir():
        raise OutputError(given, f"the folder {given.parent} does not exist; make it first")
    return target


def check_writable(path: Path | str) -> None:
    """Find out, without touching it, whether a file can be written: before hours of work, not after.

    Raises:
        OutputError: as :func:`write_whole` would.
    """
    given = Path(path)
    try:
        target = _target(given)
        place = target if target.exists() and not target.is_file() else target.parent
        if not os.access(place, os.W_OK):
            raise OutputError(given, "permission denied; choose a place you may write to")
    except OSError as error:
        raise OutputError(given, f"{error.strerror or error}; choose a place you may write to") from error


def check_outputs(paths: Sequence[Path], *, overwrite: bool = True) -> None:
    """Find out before the work whether several files can be written.

    Raises:
        OutputError: one cannot be, is there already and ``overwrite`` is not set, or two are the same.
    """
    for path in paths:
        check_writable(path)
        if path.is_file() and not overwrite:
            raise OutputError(path, "it is there already; choose another name, or say --overwrite")
    if len({path.resolve() for path in paths}) < len(paths):
        raise OutputError(paths[-1], "two outputs have the same file name; give each its own")


def check_folder(folder: Path | str) -> Path:
    """Find out before the work whether results can be put into a folder, which may not be there yet.

    Raises:
        OutputError: they cannot.
    """
    folder = Path(folder)
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(folder, "it is a file; give a folder")
        place = folder if folder.exists() else folder.absolute().parent
        if not place.is_dir():
            raise OutputError(folder, f"the folder {place} does not exist; make it first")
        if not os.access(place, os.W_OK):
            raise OutputError(folder, "permission denied; choose a place you may write to")
    except OSError as error:
        raise OutputError(folder, f"{error.strerror or error}; choose a place you may write to") from error
    return folder
