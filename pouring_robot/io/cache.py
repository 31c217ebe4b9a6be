"""Cache on disk of what takes long to make: rendered descriptions, compiled kernels.

The folder may be missing, full, read-only or shared by processes that run at once: then an entry is made anew, and
nobody ever reads half of one. It may be deleted at any time.
"""

import contextlib
import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path

import platformdirs

from pouring_robot.exceptions import OutputError
from pouring_robot.io.files import write_whole

CACHE_VARIABLE = "POURING_ROBOT_CACHE"
"""Environment variable that names another cache folder."""


def cache_folder() -> Path | None:
    """Return the cache folder, which need not exist; None for a user without a home."""
    folder = Path(os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_dir("pouring_robot", appauthor=False))
    return folder if folder.is_absolute() or CACHE_VARIABLE in os.environ else None


def content_key(parts: Iterable[str | bytes]) -> str:
    """Return a file name for something that depends on these texts, in this order, and on nothing else."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "big") + data)
    return digest.hexdigest()[:40]


def kept_text(name: str, make: Callable[[], str]) -> str:
    """Return a text from the cache, or make and store it; errors of ``make`` are passed on, and nothing is stored.

    ``name`` is a file below the cache folder, which holds the text's hash above the text; it must contain a
    :func:`content_key` of all that the text depends on.
    """
    folder = cache_folder()
    if folder is None:
        return make()
    path = folder / name
    with contextlib.suppress(OSError, UnicodeDecodeError):
        key, _, text = path.read_bytes().decode().partition("\n")
        if key == content_key([text]):  # whole, and as it was written
            return text
    text = make()
    with contextlib.suppress(OSError, OutputError):  # read-only or full: the next run makes it again
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, f"{content_key([text])}\n{text}")
    return text
