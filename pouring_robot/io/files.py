"""Reads texts, and writes files whole or not at all."""

import errno
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pouring_robot.exceptions import DescriptionError, OutputError
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.interrupt import stop_if_heard

CSV_SUFFIXES = (".csv",)
PARQUET_SUFFIXES = (".parquet", ".pq")
EXCEL_SUFFIXES = (".xlsx", ".xlsm", ".xls", ".ods")


def read_text(path: Path) -> str:
    """Return the text of a file; raises DescriptionError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        reason = problem.strerror if isinstance(problem, OSError) else "it is not UTF-8 text; save it as UTF-8"
        raise DescriptionError(path, f"cannot be read: {reason}") from problem


def write_whole(path: Path | str, content: bytes | str, *, overwrite: bool = True) -> Path:
    """Write a file, text as UTF-8, so that nobody ever sees half of it, and return its path.

    The content goes to a hidden file in the target's folder (a symbolic link is followed), which then takes the
    target's name in one step. If anything fails, also by a Ctrl-C that a library has swallowed, the hidden file is
    removed and an older target stays. A pipe or a device (``/dev/stdout``) is written directly.

    Raises:
        OutputError: the folder does not exist or is not writable, the target is a folder, or it exists and
            ``overwrite`` is not set.
    """
    stop_if_heard()
    refuse_present([Path(path)], overwrite=overwrite)
    return _put(Path(path), content)


def refuse_present(paths: Iterable[Path], *, overwrite: bool) -> None:
    """Refuse to replace files, as OutputError, unless ``overwrite`` is set."""
    for path in paths:
        if path.is_file() and not overwrite:
            raise OutputError(path, "it exists already; choose another name, or use --overwrite (overwrite=True)")


def _put(given: Path, content: bytes | str) -> Path:
    with _as_output_error(given):
        target = _target(given)
        if _is_stream(target):
            target.write_bytes(_bytes(content))
        else:
            with _hidden(target, content) as hidden:
                hidden.replace(target)
    return given


def write_together(
    files: Mapping[Path, bytes | str], *, overwrite: bool = True, earlier: Iterable[Path] = ()
) -> list[Path]:
    """Write several files, all or none, and return them in order; missing folders are made.

    Files of an ``earlier`` result that this one does not write are removed with those that are replaced.

    All are written under hidden names before the first is put in its place. Files of a missing folder appear with it,
    in one step, so that even a killed process leaves all or none of them. If anything fails, Ctrl-C included, new files
    are removed and older ones restored. A process that is killed while it puts files into an existing folder leaves
    some of them, each whole. Pipes and devices come last.

    Raises:
        OutputError: a folder cannot be made or has appeared meanwhile, or as :func:`write_whole`.
    """
    stale = [path for path in earlier if path not in files and path.is_file()]
    refuse_present([*files, *stale], overwrite=overwrite)
    hidden: dict[Path, Path] = {}  # by the file or folder that it is to become
    before: dict[Path, bytes] = {}
    with ExitStack() as stack:
        for path, content in files.items():
            with _as_output_error(path):
                folder = _missing_folder(path)
                if folder is None:
                    if not _is_stream(target := _target(path)):
                        hidden[path] = stack.enter_context(_hidden(target, content))
                    continue
                own = folder.resolve()  # however it is spelled
                if own not in hidden:
                    hidden[own] = hidden_name(own)
                    stack.callback(shutil.rmtree, hidden[own], ignore_errors=True)
                place = hidden[own] / path.absolute().relative_to(folder)
                place.parent.mkdir(parents=True, exist_ok=True)
                _write_through(place, content)
        stop_if_heard()
        try:
            for place, whole in hidden.items():
                with _as_output_error(place):
                    if whole.is_dir() and place.exists():
                        raise OutputError(place, "another run has created it meanwhile; choose another name")
                    if place.is_file():
                        before[place] = place.read_bytes()
                    whole.replace(_target(place))
            for path in stale:
                with _as_output_error(path):
                    before[path] = path.read_bytes()
                    path.unlink()
            for path in files:
                if _is_stream(path):
                    _put(path, files[path])
        except BaseException:
            for place, content in before.items():
                _put(place, content)
            for place, whole in hidden.items():
                if place not in before and not whole.exists():
                    with suppress(FileNotFoundError):  # somebody has taken it away already
                        place.resolve().rename(whole)
            raise
    return list(files)


def _missing_folder(path: Path) -> Path | None:
    """Return the topmost missing folder above a file, if there is one and the path does not lead out of it."""
    missing = [place for place in path.absolute().parents if not place.exists() and not place.is_symlink()]
    return missing[-1] if missing and ".." not in path.absolute().relative_to(missing[-1]).parts else None


def copy_folder(source: Path, folder: Path) -> list[Path]:
    """Copy the files of a folder into a new one, all or none, and return them; Python's compiled files are left out.

    Raises:
        OutputError: the folder exists already, or cannot be made.
    """
    if folder.exists():
        raise OutputError(folder, "it exists already; choose another name")
    files = [path for path in sorted(source.rglob("*")) if path.is_file() and "__pycache__" not in path.parts]
    return write_together({folder / path.relative_to(source): path.read_bytes() for path in files})


@contextmanager
def _as_output_error(path: Path) -> Iterator[None]:
    """Turn an error of the system into an OutputError that names the path."""
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        mend = "free some space there, or choose another place" if full else "choose a place you may write to"
        raise OutputError(path, f"{error.strerror or error}; {mend}") from error


@contextmanager
def _hidden(target: Path, content: bytes | str) -> Iterator[Path]:
    """Write content to a hidden file beside a target, with the target's mode if it exists; remove it in the end."""
    hidden = hidden_name(target)
    try:
        _write_through(hidden, content)
        if target.exists():
            hidden.chmod(target.stat().st_mode & 0o7777)
        yield hidden
    finally:
        hidden.unlink(missing_ok=True)


def hidden_name(target: Path) -> Path:
    """Return a hidden name beside a target for a file that is not complete yet."""
    # Not `tempfile`: its files are private to their owner, and a result should follow the user's umask. A name may have
    # 255 bytes, and a letter four.
    return target.with_name(f".{target.name[:50]}.{secrets.token_hex(6)}.part")


def _write_through(path: Path, content: bytes | str) -> None:
    """Write a new file and flush it to the disk."""
    with path.open("xb") as stream:
        stream.write(_bytes(content))
        stream.flush()
        os.fsync(stream.fileno())


def _bytes(content: bytes | str) -> bytes:
    return content.encode("utf-8") if isinstance(content, str) else content


def _target(given: Path) -> Path:
    """Return the file that a path refers to, symbolic links followed; raises OutputError if it cannot be written."""
    if given.is_dir():
        raise OutputError(given, "it is a folder; give a file name")
    if _is_stream(given):  # a pipe without a name, as /dev/stdout may be, resolves to nothing
        return given
    target = given.resolve()
    _require_folder(given.parent, given)
    return target


def _is_stream(target: Path) -> bool:
    """Return whether a writable path is a pipe or a device, which cannot be written whole."""
    return target.exists() and not target.is_file()


def _require_folder(place: Path, given: Path) -> None:
    if file := next((path for path in (place, *place.parents) if path.is_file()), None):
        raise OutputError(given, f"{file} is a file; give a folder")
    if not place.is_dir():
        raise OutputError(given, f"the folder {place} does not exist; create it first")


def _require_access(place: Path, given: Path) -> None:
    if not os.access(place, os.W_OK):
        raise OutputError(given, "permission denied; choose a place you may write to")


def check_writable(path: Path | str) -> None:
    """Check before hours of work, without touching it, that a file can be written; raises as `write_whole`."""
    given = Path(path)
    with _as_output_error(given):
        target = _target(given)
        _require_access(target if _is_stream(target) else target.parent, given)


def check_outputs(paths: Sequence[Path], *, overwrite: bool = True) -> None:
    """Check before the work that several files can be written.

    Raises:
        OutputError: one cannot be written, exists and ``overwrite`` is not set, or two are the same.
    """
    for path in paths:
        check_writable(path)
        refuse_present([path], overwrite=overwrite)
    if len({path.resolve() for path in paths}) < len(paths):
        raise OutputError(paths[-1], "two outputs have the same file name; give each its own")


def check_ending(path: Path, endings: Sequence[str]) -> None:
    """Refuse a file name with the ending of a format that is not written; pipes and devices may have any.

    Raises:
        OutputError: the name has none of the endings (in lower case, with their point); says which there are.
    """
    if path.suffix.lower() not in endings and (path.is_file() or not path.exists()):
        other = f"as {path.suffix}" if path.suffix else "without an ending"
        raise OutputError(path, f"it is written as {' or '.join(endings)}, not {other}; give it such an ending")


def check_folder(folder: Path | str) -> Path:
    """Check before the work that results can be put into a folder, which need not exist yet; return its path.

    Raises:
        BadInputError: it is not a path.
        OutputError: they cannot.
    """
    expect(folder, Path | str, "a folder for results is a path")
    folder = Path(folder)
    with _as_output_error(folder):
        if folder.exists() and not folder.is_dir():
            raise OutputError(folder, "it is a file; give a folder")
        place = folder if folder.exists() else folder.absolute().parent
        _require_folder(place, folder)
        _require_access(place, folder)
    return folder
