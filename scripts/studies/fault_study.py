"""A writing command, stopped or disturbed in a separate process, and the files it leaves: for the study of faults."""

from __future__ import annotations

import contextlib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pouring_robot.robot.export.shipped_files import examples_path
from scripts.studies.fault_child import start_warm

ROOT = Path(__file__).resolve().parents[2]
LONGEST_S = 300.0
NOBODY = 65534
_STARTS_S = 0.05  # before it a signal meets no Python yet
_LISTENING = re.compile(r"cli/__init__\.py\", line \d+, in main")
RESUMED = "results.zarr"  # of a sweep: grows chunk by chunk, and is gone on with


@dataclass(frozen=True)
class Command:
    """A command that writes: its arguments (``{given}``: inputs, ``{name}``: outputs), and how it is run again."""

    name: str
    arguments: str
    again: str = "--overwrite"

    def line(self, given: Path, name: str, *more: str) -> list[str]:
        """Return the arguments for outputs of a name."""
        words = [word.format(given=given, name=name) for word in self.arguments.split()]
        return [*words, *(word for word in more if word)]


POSE = "--at-mm -100 20 -600 --tilt-deg 17 --model {given}/actual.yaml"
COMMANDS = tuple(
    Command(*row)
    for row in (
        ("pose", f"pose {POSE} --html {{name}}.html --joints {{name}}.json"),
        ("path", "path {given}/poses.csv --model {given}/actual.yaml --html {name}.html --out {name}.csv"),
        ("thermal", "thermal --at-mm -100 20 -600 --melt-degC 1650 --csv {name}.csv --report {name}.html"),
        ("compensate", "compensate {given}/poses.csv --model {given}/actual.yaml --out {name}.csv"),
        ("header", "compensate --model {given}/actual.yaml --header {name}.h"),
        ("sensitivity", "sensitivity --poses 50 --out {name}"),
        ("regress", "regress {given}/errors.csv --axis x --out {name}.yaml --report {name}.html"),
        ("export", "export --out {name} --model {given}/actual.yaml"),
        ("robot new", "robot new --yes --out {name}"),
        ("robot init", "robot init {given}/ur10.urdf --out {name}.yaml"),
        ("examples copy", "examples copy {name}", ""),
        ("campaign plan", "campaign plan --poses 10 --candidates 100 --starts 1 --out {name}.csv --png {name}.png"),
        (
            "campaign simulate",
            "campaign simulate --random 40 --model {given}/actual.yaml --out {name}.csv --truth {name}.json",
        ),
        ("campaign check", "campaign check {given}/campaign.csv --png {name}.png"),
        ("sweep", "sweep {given}/sweep.yaml --out {name}", "--resume"),
        ("calibrate", "calibrate {given}/campaign.csv --out {name}"),
        ("diagnose", "diagnose {given}/campaign.csv --out {name}"),
    )
)
ERRORS = "melt_degC,P1_mm,P2_mm,P3_mm\n" + "".join(
    f"{t},{t / 900},{t / 800},{t / 850}\n" for t in range(900, 1701, 100)
)


@dataclass
class Ended:
    """How a run ended, and what lies in its folder then."""

    code: int
    error: str
    left: dict[str, bytes]

    @property
    def temporary(self) -> list[str]:
        """Files that only a stopped run leaves."""
        return [name for name in self.left if _is_temporary(name)]

    @property
    def files(self) -> dict[str, bytes]:
        """Files that are results."""
        return {name: content for name, content in self.left.items() if not _is_temporary(name)}

    def one_line(self) -> bool:
        """Return whether it ended with one line that says why."""
        lines = [line for line in self.error.splitlines() if not line.startswith("note: ")]
        return len(lines) == 1 and lines[0].startswith("pouring-robot: ")


def _is_temporary(name: str) -> bool:
    return any(part.endswith((".part", ".partial")) for part in Path(name).parts)


@dataclass
class Tally:
    """What came of the trials of a row."""

    said: Counter[str] = field(default_factory=Counter)
    lines: Counter[str] = field(default_factory=Counter)
    faults: int = 0

    def count(self, wrong: str) -> None:
        """Count a fault, if there is one, and print it."""
        if wrong:
            self.faults += 1
            print(" ".join(wrong.split())[:2000], file=sys.stderr, flush=True)


class Study:
    """Runs commands in a folder of its own.

    Args:
        place: an empty folder.
    """

    def __init__(self, place: Path) -> None:
        """Write the inputs."""
        self.place, self.given, self.folder = place, place / "given", place / "work"
        place.chmod(0o755)
        self.given.mkdir()
        self.sound: dict[tuple[str, str], tuple[Ended, dict[bool, float], int]] = {}
        examples = examples_path()
        for path in (examples / "actual.yaml", examples / "poses.csv", examples / "machines" / "ur10" / "ur10.urdf"):
            shutil.copy(path, self.given)
        sweep = (examples / "sweep.yaml").read_text(encoding="utf-8")
        sweep = sweep.replace("{x: 2, y: 3, z: 3, tilt: 3}", "{x: 2, z: 2}").replace(
            "samples: 500", "samples: 100\nchunk: 30"
        )
        (self.given / "sweep.yaml").write_text(sweep, encoding="utf-8")
        (self.given / "errors.csv").write_text(ERRORS, encoding="utf-8")
        made = f"campaign simulate --random 40 --model {self.given}/actual.yaml --out {self.given}/campaign.csv"
        code = self.run(made.split()).code
        if code:
            raise SystemExit(f"the campaign cannot be made: exit code {code}")

    def run(
        self,
        arguments: Sequence[str],
        *,
        at: int = 0,
        what: str = "",
        after_s: float | None = None,
        place: Path | None = None,
        environment: Mapping[str, str | None] | None = None,
        prefix: Sequence[str] = (),
        out: Path | None = None,
        warm: bool = False,
    ) -> Ended:
        """Run a command in the folder as it is; something happens at its ``at``-th operation, or after a time.

        Args:
            arguments: of the command.
            at: number of the operation on files; 0: none.
            what: a signal's name, ``full``, or ``clock``.
            after_s: send the signal then instead.
            place: folder it runs in.
            environment: variables that are changed, or taken away.
            prefix: what starts it.
            out: where standard output goes.
            warm: fork a process that has the package loaded, with no other prefix and output.
        """
        folder = place or self.folder
        folder.mkdir(exist_ok=True)
        changed = os.environ | {"PYTHONPATH": str(ROOT), "SOURCE_DATE_EPOCH": "0"} | dict(environment or {})
        variables = {name: value for name, value in changed.items() if value is not None}
        if warm:
            code, error = self._forked(variables, after_s, what, at, arguments, folder)
            return Ended(code, error, snapshot(folder))
        child = ("scripts.studies.fault_child", str(folder), str(at), what) if after_s is None else ("pouring_robot",)
        line = [*prefix, sys.executable, "-m", *child, *arguments]
        with (
            tempfile.TemporaryFile() as said,
            out.open("wb") if out else contextlib.nullcontext(subprocess.DEVNULL) as printed,
        ):
            process = subprocess.Popen(
                line,
                cwd=folder,
                env=variables,
                stdin=subprocess.DEVNULL,
                stdout=printed,
                stderr=said,
                start_new_session=True,
            )
            try:
                if after_s is not None:
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        process.wait(after_s)
                    if process.poll() is None:
                        process.send_signal(getattr(signal, what))
                code = process.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                code = -99
            said.seek(0)
            error = said.read().decode("utf-8", errors="replace")
        return Ended(code, error, snapshot(folder))

    def _forked(
        self,
        variables: dict[str, str],
        after_s: float | None,
        what: str,
        at: int,
        arguments: Sequence[str],
        folder: Path,
    ) -> tuple[int, str]:
        said = self.place / "said"
        said.unlink(missing_ok=True)
        process = start_warm(variables, said, str(folder), at, what, arguments, self.place / "told")
        if after_s is not None:
            while process.is_alive() and not said.exists():  # it is being forked
                time.sleep(1e-3)
            process.join(after_s)
            if process.is_alive() and process.pid:
                os.kill(process.pid, getattr(signal, what))
        process.join(LONGEST_S)
        code = process.exitcode
        process.kill()
        process.join()
        return -99 if code is None else code, said.read_text(encoding="utf-8", errors="replace")

    def clear(self) -> None:
        """Empty the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()

    def undisturbed(self, command: Command, name: str = "a") -> tuple[Ended, dict[bool, float], int]:
        """Return how a command ends that nothing happens to, after how long (s, warm or not), and its operations."""
        if (command.name, name) not in self.sound:
            (ended, cold_s), (again, warm_s) = (self._timed(command, name, warm=warm) for warm in (False, True))
            if ended.code != 0 or ended.temporary or again.left != ended.left:
                problem = f"{ended.error} {ended.temporary} {differences(again.left, ended.left)}"
                raise SystemExit(f"{command.name} is not the same twice, undisturbed: {problem}")
            operations = int((self.place / "told").read_text(encoding="ascii"))
            self.sound[command.name, name] = ended, {False: cold_s, True: warm_s}, operations
        return self.sound[command.name, name]

    def _timed(self, command: Command, name: str, *, warm: bool) -> tuple[Ended, float]:
        self.clear()
        start = time.monotonic()
        return self.run(command.line(self.given, name), warm=warm), time.monotonic() - start

    def stopped(
        self, command: Command, what: str, random_: random.Random, *, in_time: bool, warm: bool = True
    ) -> tuple[str, str]:
        """Stop a command at a random moment; return what it left, and what is wrong."""
        sound, seconds, operations = self.undisturbed(command)
        self.clear()
        line = command.line(self.given, "a")
        if in_time:
            when = f"after {(after := random_.uniform(_STARTS_S, 0.8 * seconds[warm])):.3f} s"
            ended = self.run(line, what=what, after_s=after, warm=warm)
        else:
            when = f"at operation {(at := random_.randint(1, operations))} of {operations}"
            ended = self.run(line, what=what, at=at, warm=True)
        wrong = stop_faults(ended, sound, what)
        whole = {name: content for name, content in ended.files.items() if not is_resumed(name)}
        reports = {name: content for name, content in sound.files.items() if not is_resumed(name)}
        if ended.left:
            again = self.run(command.line(self.given, "a", command.again), warm=True)
            if command.again or not whole:
                if again.code != 0 or again.files != sound.files:
                    wrong.append(
                        f"again: exit code {again.code}, {differences(again.files, sound.files)} {again.error}"
                    )
            elif again.code != 2 or not again.one_line():
                wrong.append(f"again: exit code {again.code}: {again.error}")
        left = (
            "done before"
            if ended.code == 0
            else "nothing"
            if not whole
            else "all"
            if whole.keys() == reports.keys()
            else "some of its files"
        )
        return left, f"{command.name}, {what} {when}: {'; '.join(wrong)}" if wrong else ""


def snapshot(folder: Path) -> dict[str, bytes]:
    """Return the files below a folder, and its empty folders."""
    found: dict[str, bytes] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            found[str(path.relative_to(folder))] = path.read_bytes()
        elif path.is_dir() and not any(path.iterdir()):
            found[f"{path.relative_to(folder)}/"] = b""
    return found


def differences(one: Mapping[str, bytes], other: Mapping[str, bytes]) -> str:
    """Return in which files two folders differ."""
    names = sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
    return f"differs in {', '.join(names[:4])}" if names else "the same files"


def stop_faults(ended: Ended, sound: Ended, what: str) -> list[str]:
    """Return what is wrong with what a stopped command says and leaves."""
    wrong = [
        f"{name} is neither whole nor absent"
        for name, content in ended.files.items()
        if not is_resumed(name) and sound.files.get(name) != content
    ]
    if ended.code == 0:  # it was done before
        return wrong
    if what == "SIGKILL":
        return wrong if ended.code == -signal.SIGKILL else [*wrong, f"exit code {ended.code}: {ended.error}"]
    if ended.error.endswith("\nKeyboardInterrupt\n") and not _LISTENING.search(ended.error) and not ended.left:
        return wrong  # Python itself was still starting
    if ended.code != 130 or not (ended.one_line() and ": stopped" in ended.error):
        wrong.append(f"exit code {ended.code}: {ended.error}")
    left = [name for name in ended.temporary if not is_resumed(name)]
    return [*wrong, f"left {', '.join(left)}"] if left else wrong


def moments(study: Study, commands: Sequence[Command], count: int, seed: int) -> Iterator[tuple[Command, Tally]]:
    """Stop each command so many times."""
    for command in commands:
        tally, random_ = Tally(), random.Random(f"{command.name} {seed}")
        for k in range(count):
            what = ("SIGKILL", "SIGINT")[k % 2]
            left, wrong = study.stopped(command, what, random_, in_time=k % 4 < 2, warm=k % 8 > 1)
            tally.said[left] += 1
            tally.count(wrong)
        yield command, tally


def is_resumed(name: str) -> bool:
    """Return whether a file grows and is gone on with: it may be there in part."""
    return RESUMED in Path(name).parts
