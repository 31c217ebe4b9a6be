"""Situations in which a command cannot write normally: full disks, strange names, clocks, two runs at once, etc."""

from __future__ import annotations

import contextlib
import random
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from scripts.studies.fault_study import NOBODY, Command, Ended, Study, Tally, differences, is_resumed, snapshot

Place = Callable[[Study, Command], tuple[Ended, Ended]]
"""Runs a command somewhere else; returns how it ends there, and undisturbed."""


@contextlib.contextmanager
def small_disk(size: str = "64k", options: str = "") -> Iterator[Path]:
    """Mount a small disk of its own, where this is permitted."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True)
        try:
            place.chmod(0o777)
            if options:
                subprocess.run(["mount", "-o", f"remount,{options}", folder], check=True)
            yield place
        finally:
            subprocess.run(["umount", folder], check=True)


def in_place(**how: object) -> Place:
    """Return a place that is a way to run the command in its own folder."""

    def run(study: Study, command: Command) -> tuple[Ended, Ended]:
        sound = study.undisturbed(command)[0]
        study.clear()
        return study.run(command.line(study.given, "a"), **how), sound  # type: ignore[arg-type]

    return run


def named(name: str) -> Place:
    """Return a place where outputs bear a name."""

    def run(study: Study, command: Command) -> tuple[Ended, Ended]:
        sound = study.undisturbed(command)[0]
        study.clear()
        ended = study.run(command.line(study.given, name))
        renamed = {
            other.replace(name, "a"): content.replace(name.encode(), b"a") for other, content in ended.left.items()
        }
        return Ended(ended.code, ended.error, renamed), sound

    return run


def full_at_operation(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Let the disk be full from one operation on."""
    sound, _, operations = study.undisturbed(command)
    study.clear()
    at = random.Random(command.name).randint(1, operations)
    return study.run(command.line(study.given, "a"), at=at, what="full"), sound


def on_small_disk(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Run it on a disk that holds half of its files."""
    sound = study.undisturbed(command)[0]
    half = sum(len(content) // 4096 + 1 for content in sound.left.values()) * 2
    with small_disk(f"{half}k") as disk:
        return study.run(command.line(study.given, "a"), place=disk), sound


def on_read_only_disk(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Run it on a disk that may only be read."""
    sound = study.undisturbed(command)[0]
    with small_disk(options="ro") as disk:
        return study.run(command.line(study.given, "a"), place=disk), sound


def with_full_cache(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Keep rendered descriptions and kernels on a disk of four kB."""
    with small_disk("4k") as disk:
        return in_place(environment={"POURING_ROBOT_CACHE": str(disk)})(study, command)


def with_read_only_home(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Have a home, with the cache in it, that may only be read."""
    with small_disk(options="ro") as disk:
        return in_place(environment={"HOME": str(disk), "XDG_CACHE_HOME": None})(study, command)


def as_nobody(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Run it as a user who has no home and may write neither to the installation nor to the cache."""
    sound = study.undisturbed(command)[0]
    study.clear()
    study.folder.chmod(0o777)
    user = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
    away: dict[str, str | None] = {"HOME": None, "XDG_CACHE_HOME": None, "USER": None, "LOGNAME": None}
    return study.run(command.line(study.given, "a"), prefix=user, environment=away), sound


def two_at_once(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Start a command twice in one folder; the one that ends worse counts."""
    sound = study.undisturbed(command)[0]
    study.clear()
    with ThreadPoolExecutor() as pool:
        ended = list(pool.map(lambda _: study.run(command.line(study.given, "a")), range(2)))
    after = snapshot(study.folder)
    if after != sound.left:
        return Ended(-1, f"together they leave {differences(after, sound.left)}", after), sound
    worse = max(ended, key=lambda one: one.code)
    return Ended(worse.code, worse.error, after), sound


def printing_to_full_disk(study: Study, command: Command) -> tuple[Ended, Ended]:
    """Print to a disk that is full."""
    sound = study.undisturbed(command)[0]
    study.clear()
    return study.run(command.line(study.given, "a"), out=Path("/dev/full")), sound


PLACES: dict[str, Place] = {
    "disk full from a random operation on": full_at_operation,
    "disk with room for half of the files": on_small_disk,
    "no file may pass 4 kB": in_place(prefix=["sh", "-c", 'ulimit -f 8; exec "$@"', "sh"]),
    "folder that may only be read": on_read_only_disk,
    "home that may only be read": with_read_only_home,
    "cache on a full disk": with_full_cache,
    "cache that is a file": in_place(environment={"POURING_ROBOT_CACHE": "/dev/null"}),
    "a user with nothing: no home, installation read-only": as_nobody,
    "two runs at once": two_at_once,
    "locale C": in_place(environment={"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}),
    "output in ASCII": in_place(environment={"PYTHONIOENCODING": "ascii"}),
    "output closed": in_place(prefix=["sh", "-c", 'exec "$@" >&-', "sh"]),
    "output to a full disk": printing_to_full_disk,
    "a clock that runs backwards": in_place(what="clock"),
    "names with spaces": named("a b  c"),
    "names in Unicode": named("Kelle-\u00e9\u4e2d\U0001f525\u202e"),
    "names of 255 bytes": named("\U0001f525" * 62),
    "names with a leading dash": named("-Kelle"),
    "names with markup": named("[red]<script>alert(1)"),
}


def place_fault(ended: Ended, sound: Ended) -> str:
    """Return what is wrong with how a command ends somewhere else."""
    half = [name for name, content in ended.files.items() if sound.files.get(name) != content and not is_resumed(name)]
    if ended.temporary:
        return f"left {', '.join(ended.temporary)}"
    if ended.code == 0:
        return "" if ended.files == sound.files else differences(ended.files, sound.files)
    if half:
        return f"{half[0]} is neither whole nor absent"
    if ended.code in (2, 3) and ended.one_line():
        return ""
    return f"exit code {ended.code}: {ended.error}"


def places(study: Study, commands: Sequence[Command], wanted: Sequence[str]) -> Iterator[tuple[str, Tally]]:
    """Run each command in each place."""
    for name in wanted:
        tally = Tally()
        for command in commands:
            ended, sound = PLACES[name](study, command)
            wrong = place_fault(ended, sound)
            if wrong:
                tally.count(f"{name}, {command.name}: {wrong}")
            else:
                tally.said["right" if ended.code == 0 else "one line"] += 1
                if ended.code:
                    tally.lines[ended.error.strip()] += 1
        yield name, tally
