"""Files are written whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Mapping
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
        target = _target(given)
        if target.exists() and not target.is_file():
            target.write_bytes(data)
        else:
            _replace(target, data)
    except OSError as error:
        raise OutputError(given, f"{error.strerror or error}; choose a place you may write to") from error
    return given


def write_together(files: Mapping[Path, bytes | str]) -> list[Path]:
    """Write several files, all or none; folders that are missing are made.

    If one fails, Ctrl-C included, new files and folders are removed and older files are put back as they were.

    Args:
        files: what each file shall hold; written in this order.

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
        for path, content in files.items():
            made += _make_folder(path.parent)
            before[path] = path.read_bytes() if path.is_file() else None
            write_whole(path, content)
    except BaseException as error:
        for path, old in before.items():
            if old is not None:
                write_whole(path, old)
            elif path.is_file():
                path.unlink()
        for folder in reversed(made):
            folder.rmdir()
        if isinstance(error, OSError):
            raise OutputError(path, f"{error.strerror or error}; choose a place you may write to") from error
        raise
    return list(files)


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


def write_folder(folder: Path | str, fill: Callable[[Path], None], last: str = "") -> list[Path]:
    """Write a folder of files: all of them or none.

    Everything is made in a hidden folder beside the target first; a failure, Ctrl-C included, leaves the target as it
    was. Files of an earlier run in it are replaced, others stay.

    Args:
        folder: made if it is not there.
        fill: writes the files into the folder it is given.
        last: name of the file that is put into place last, for others may wait for it.

    Returns:
        The files directly in the folder, as they stand there.

    Raises:
        OutputError: the folder cannot be written to.
    """
    folder = check_folder(folder)
    hidden = folder.absolute().with_name(f".{folder.absolute().name[:80]}.{secrets.token_hex(6)}.part")
    try:
        hidden.mkdir()
        fill(hidden)
        return _move(hidden, folder, last)
    except OSError as error:
        raise OutputError(folder, f"{error.strerror or error}; choose a place you may write to") from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def _move(hidden: Path, folder: Path, last: str) -> list[Path]:
    """Put finished files into place one by one."""
    folder.mkdir(exist_ok=True)
    found = sorted(path.relative_to(hidden) for path in hidden.rglob("*") if path.is_file())
    found.sort(key=lambda path: path.name == last)
    for path in found:
        (folder / path).parent.mkdir(exist_ok=True)
        (hidden / path).replace(folder / path)
    return [folder / path for path in found if path.parent == Path()]
