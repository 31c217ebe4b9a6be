"""Damage every kind of input file at random, and check that it is read, or refused in one line.

    python scripts/studies/fuzz_files.py --count 100000 --seed 1 --kind model --kind urdf

An input is a valid file with one to four damages: pieces cut, duplicated or exchanged, numbers and words replaced by
harmful ones, bytes changed. Each batch is read in a separate process, so that a crash of a library is detected, too. An
input that is neither read nor refused in one line, or takes over 10 s or over 2 GB, is kept (``--keep FOLDER``) and
counted as a fault; exit code 1 if there is any. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import importlib.util
import io
import mmap
import os
import random
import re
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import random_plan, read_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.exceptions import PouringRobotError
from pouring_robot.mechanism.loops_file import load_loops
from pouring_robot.robot.command_table import read_command_lines, read_pose_lines
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.first_file import first_robot_file
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.description.xacro_to_urdf import run_xacro
from pouring_robot.robot.export.shipped_files import examples_path
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.layout import load_layout
from pouring_robot.robot.pouring.stiffness import load_stiffness
from pouring_robot.robot.pouring.thermal_properties import load_thermal_properties
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.tolerances import Tolerances
from pouring_robot.sweeps.config import SweepConfig
from pouring_robot.thermal.network.history import read_shift
from pouring_robot.thermal.regression.table import ErrorTable
from pouring_robot.thermal.regression.thermal_model import ThermalModel

BATCH = 500
LONGEST_S = 10.0
MOST_MEMORY = 2 << 30
NASTY = (
    *(
        "",
        "0",
        "-0",
        "-1",
        "1e308",
        "-1e308",
        "1e-320",
        "nan",
        "inf",
        "-.inf",
        ".nan",
        "9" * 30,
        "1_0",
        "0x1F",
        "1e999",
    ),
    *(
        "null",
        "true",
        "[]",
        "{}",
        "[[1]]",
        "{a: 1}",
        "'",
        '"',
        "\\",
        "\0",
        "\ufeff",
        "\u202e",
        "é",
        "\U0001f525",
        "\udcff",
    ),
    *(
        ":",
        ": ",
        "- ",
        "#",
        "&a ",
        "*a",
        "<<: *a",
        "!!python/object:os.system",
        "---\n",
        "\t",
        "\r",
        "\n",
        "%",
        "|",
        ">",
    ),
    *("<", ">", "</", "/>", "<!--", "<![CDATA[", "&amp;", "&x;", "<robot>", "${1/0}", "${", "$(", "${[0]*9}", "]]>"),
    *("../", "/dev/null", "/", "a" * 300, ",", ";", "1,5", "-1e-9", "6.28", "360", "2024-01-01", "12:30:45", "yes"),
)
_WORD = re.compile(r"[A-Za-z_][\w.]*|[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
SHIFT = "time_min,melt_degC,ambient_degC\n0,1500,20\n30,1600,22\n60,1700,25\n"
POSES = "x_mm,y_mm,z_mm,tilt_deg\n" + "-100,20,-600,17\n-60,-10,-500,5\n" * 3
ARM_COMMANDS = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n" + "10,20,30,5,80,0\n" * 4
ERRORS = "melt_degC,P1_mm,P2_mm,P3_mm\n" + "".join(
    f"{t},{t / 900},{t / 800},{t / 850}\n" for t in range(900, 1701, 100)
)
PLAN = "x_mm,y_mm,z_mm,tilt_deg,payload_kg\n" + "-100,0,-600,10,300\n" * 5
THERMAL_MODEL = """format: pouring_robot/thermal_model/1
source: table.csv
temperature_degC: 20.0
melt_degC: [900.0, 1700.0]
inputs: [x]
centre: [0.1]
axes:
  x: {method: line, coefficients: [[0.1, 0.2], [0.3, 0.1]]}
"""


@dataclass(frozen=True)
class Kind:
    """A kind of file: its name on disk, a sound one, what lies beside it, and what reads it."""

    name: str
    sound: bytes
    read: Callable[[Path], object]
    beside: dict[str, bytes] = field(default_factory=dict)


@dataclass
class Tally:
    """What came of the damaged files of a kind; faults by what they were."""

    read: int = 0
    refused: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    slowest_s: float = 0.0
    memory_mb: float = 0.0


def kinds() -> dict[str, Kind]:
    """Return all kinds by name."""
    examples, config = examples_path(), description_folder() / "config"
    ur10, arm = examples / "machines" / "ur10", examples / "robots" / "arm"
    robot = PouringRobot()
    arm_definition = RobotDefinition.load(arm / "robot.yaml")
    tables = _campaigns(robot)
    ur10_files = {name: (ur10 / name).read_bytes() for name in ("robot.yaml", "ur10.urdf")}
    shapes = {"shapes.xacro": (examples / "robots" / "shapes.xacro").read_bytes()}
    xacro_file = (arm / "arm.urdf.xacro").read_bytes().replace(b"../shapes", b"shapes")
    found = {
        "model": Kind("m.yaml", (examples / "actual.yaml").read_bytes(), RobotModel.load),
        "sweep": Kind("s.yaml", (examples / "sweep.yaml").read_bytes(), SweepConfig.load),
        "layouts": Kind("l.yaml", (config / "layouts.yaml").read_bytes(), lambda path: load_layout("paper", path)),
        "loops": Kind("o.yaml", (config / "loops.yaml").read_bytes(), load_loops),
        "stiffness": Kind("k.yaml", (config / "stiffness.yaml").read_bytes(), load_stiffness),
        "tolerances": Kind("t.yaml", (config / "tolerances.yaml").read_bytes(), Tolerances.load),
        "thermal properties": Kind("h.yaml", (config / "thermal.yaml").read_bytes(), load_thermal_properties),
        "thermal model": Kind("g.yaml", THERMAL_MODEL.encode(), ThermalModel.load),
        "robot": Kind("robot.yaml", ur10_files["robot.yaml"], _mechanism, {"ur10.urdf": ur10_files["ur10.urdf"]}),
        "urdf": Kind("ur10.urdf", ur10_files["ur10.urdf"], _urdf, {"robot.yaml": ur10_files["robot.yaml"]}),
        "xacro": Kind("a.xacro", xacro_file, lambda path: run_xacro(path, {}), shapes),
        "poses": Kind("p.csv", POSES.encode(), read_pose_lines),
        "commands": Kind("q.csv", ARM_COMMANDS.encode(), lambda path: read_command_lines(path, arm_definition)),
        "plan": Kind("n.csv", PLAN.encode(), lambda path: read_plan(path, robot)),
        "shift": Kind("f.csv", SHIFT.encode(), read_shift),
        "errors": Kind("e.csv", ERRORS.encode(), ErrorTable.read_csv),
    }
    for suffix in sorted(tables.keys() - {".yaml"}):
        name = "campaign" if suffix == ".csv" else f"campaign {suffix[1:]}"
        found[name] = Kind(f"c{suffix}", tables[suffix], Campaign.read, {"c.yaml": tables[".yaml"]})
    found["campaign yaml"] = Kind("c.yaml", tables[".yaml"], _beside_csv, {"c.csv": tables[".csv"]})
    return found


def _campaigns(robot: PouringRobot) -> dict[str, bytes]:
    """Return a sound campaign as bytes, by suffix."""
    options = MeasurementOptions(sigma_position_m=5e-5, sigma_rotation_rad=5e-5, seed=1)
    campaign = simulate_campaign(robot, random_plan(robot, 12, 1), options).campaign
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".csv", ".parquet"):
            campaign.save(Path(folder) / f"c{suffix}", overwrite=True)
        if importlib.util.find_spec("openpyxl"):  # Excel files are read where it is installed
            campaign.to_frame().to_excel(Path(folder) / "c.xlsx", index=False)
        return {path.suffix: path.read_bytes() for path in Path(folder).iterdir()}


def _mechanism(path: Path) -> object:
    return RobotDefinition.load(path).mechanism()


def _urdf(path: Path) -> object:
    first_robot_file(path, path.parent)
    return _mechanism(path.with_name("robot.yaml"))


def _beside_csv(path: Path) -> object:
    return Campaign.read(path.with_suffix(".csv"))


def damaged(sound: bytes, random_: random.Random) -> bytes:
    """Return a file with one to four damages."""
    content = sound
    for _ in range(random_.choice((1, 1, 1, 2, 3, 4))):
        content = random_.choice(_DAMAGES)(content, random_)
    return content


def _nasty(random_: random.Random) -> bytes:
    return random_.choice(NASTY).encode("utf-8", errors="surrogateescape")


def _word(content: bytes, random_: random.Random) -> bytes:
    """Replace a word or number by a nasty one, or by another of the file."""
    text = content.decode("latin-1")
    words = list(_WORD.finditer(text))
    if not words:
        return content + _nasty(random_)
    word = random_.choice(words)
    other = random_.choice(words).group().encode("latin-1") if random_.random() < 0.4 else _nasty(random_)
    return content[: word.start()] + other + content[word.end() :]


def _lines(content: bytes, random_: random.Random) -> bytes:
    """Delete, double or exchange lines, or change how far one is indented."""
    lines = content.split(b"\n")
    a, b = random_.randrange(len(lines)), random_.randrange(len(lines))
    what = random_.randrange(4)
    if what == 0:
        del lines[a]
    elif what == 1:
        lines.insert(b, lines[a])
    elif what == 2:
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines[a] = b" " * random_.randrange(9) + lines[a].lstrip()
    return b"\n".join(lines)


def _piece(content: bytes, random_: random.Random) -> bytes:
    """Cut a piece out, double it, or put a nasty one in its place."""
    a = random_.randrange(len(content) + 1)
    b = min(len(content), a + random_.choice((0, 1, 2, 5, 20, 200)))
    c = random_.randrange(len(content) + 1)
    put = random_.choice((b"", content[a:b] * 2, content[c : c + b - a], _nasty(random_), random_.randbytes(3)))
    return content[:a] + put + content[b:]


def _end(content: bytes, random_: random.Random) -> bytes:
    return content[: random_.randrange(len(content) + 1)]


_DAMAGES = (_word, _word, _word, _lines, _piece, _piece, _end)


class _TooLong(BaseException):
    pass


def outcome(read: Callable[[Path], object], path: Path) -> str:
    """Return ``read``, ``refused``, or what is wrong."""
    try:
        read(path)
    except PouringRobotError as error:
        said = str(error)
        return "refused" if said and len(said) < 2000 else f"refused in {said!r:.200}"
    except _TooLong:
        return "over 10 s"
    except MemoryError:
        return "over 2 GB"
    except RecursionError as error:
        return f"RecursionError: {error}"
    except Exception as error:
        place = error.__traceback__
        while place is not None and place.tb_next is not None:
            place = place.tb_next
        line = "" if place is None else f" ({Path(place.tb_frame.f_code.co_filename).name}:{place.tb_lineno})"
        return f"{type(error).__name__}: {str(error)[:120]}{line}"
    return "read"


def fuzz(kind: Kind, seed: int, count: int, keep: Path | None = None) -> Tally:
    """Read ``count`` damaged files and tell what came of them."""
    tally, start = Tally(), time.perf_counter()
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as place:
        folder = Path(place) / "own"
        folder.mkdir()
        for name, content in {**kind.beside, kind.name: kind.sound}.items():
            (folder / name).write_bytes(content)
        kind.read(folder / kind.name)
        first = 0
        while first < count:
            first = _batch(kind, folder, (seed, first, min(first + BATCH, count)), tally, keep)
    tally.seconds = time.perf_counter() - start
    return tally


def _batch(kind: Kind, folder: Path, rows: tuple[int, int, int], tally: Tally, keep: Path | None) -> int:
    """Read some files in a process of its own and return the number of the first that was not read."""
    seed, _, last = rows
    shared = mmap.mmap(-1, 16)  # the number of the file in work, and since when
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _read_batch(kind, folder, rows, shared, writer)
    os.close(writer)
    with os.fdopen(reader, "rb", buffering=0) as said:
        os.set_blocking(said.fileno(), False)
        text, status = b"", None
        while status is None:
            finished, found = os.waitpid(child, os.WNOHANG)
            text += said.read() or b""
            number, since = struct.unpack("qd", shared[:16])
            if finished:
                status = found
            elif since and time.monotonic() - since > 2.0 * LONGEST_S:
                os.kill(child, signal.SIGKILL)
                _, status = os.waitpid(child, 0)
            else:
                time.sleep(0.02)
        text += said.read() or b""
    for line in text.decode("utf-8", errors="replace").splitlines():
        index, seconds, memory, what = line.split("\t", 3)
        tally.slowest_s = max(tally.slowest_s, float(seconds))
        tally.memory_mb = max(tally.memory_mb, float(memory))
        _count(tally, what, kind, seed, int(index), keep)
    if status == 0:
        return last
    number, _ = struct.unpack("qd", shared[:16])
    name = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit {status}"
    _count(tally, "over 10 s" if name == "SIGKILL" else f"the process died: {name}", kind, seed, number, keep)
    return int(number) + 1


def _count(tally: Tally, what: str, kind: Kind, seed: int, index: int, keep: Path | None) -> None:
    if what == "read":
        tally.read += 1
    elif what == "refused":
        tally.refused += 1
    else:
        tally.faults[what] += 1
        if keep is not None and tally.faults[what] <= 3:
            place = keep / f"{seed}-{index}-{kind.name}"
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir(parents=True)
            (place / kind.name).write_bytes(file_of(kind, seed, index))
            (place / "what.txt").write_text(what + "\n", encoding="utf-8", errors="replace")


def file_of(kind: Kind, seed: int, index: int) -> bytes:
    """Return the damaged file of a number."""
    random_ = random.Random(f"{kind.name} {seed} {index}")
    if not kind.name.endswith(".xlsx") or random_.random() < 0.1:
        return damaged(kind.sound, random_)
    with zipfile.ZipFile(io.BytesIO(kind.sound)) as book:  # damage what is packed in it; a damaged packing tells little
        parts = {name: book.read(name) for name in book.namelist()}
    name = random_.choice([*sorted(parts), *["xl/worksheets/sheet1.xml"] * len(parts)])
    parts[name] = damaged(parts[name], random_)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as book:
        for name, content in parts.items():
            book.writestr(name, content)
    return packed.getvalue()


def _read_batch(kind: Kind, folder: Path, rows: tuple[int, int, int], shared: mmap.mmap, writer: int) -> None:
    """Read files in the child, tell of each on a line, and leave."""

    def stop(*_: Any) -> None:
        raise _TooLong

    seed, first, last = rows
    signal.signal(signal.SIGALRM, stop)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = pages * mmap.PAGESIZE + MOST_MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries complain there on their own
    os.dup2(2, 1)
    with os.fdopen(writer, "w", encoding="utf-8", errors="replace") as said:
        for index in range(first, last):
            shared[:16] = struct.pack("qd", index, time.monotonic())
            path = folder / kind.name
            path.write_bytes(file_of(kind, seed, index))
            signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
            start = time.perf_counter()
            what = outcome(kind.read, path)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            left = sorted(entry.name for entry in folder.iterdir() if entry.name not in kind.beside)
            if left != [kind.name]:
                what = f"left files behind: {left}"
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            said.write(f"{index}\t{time.perf_counter() - start:.3f}\t{memory:.0f}\t{' '.join(what.split())}\n")
            said.flush()
    os._exit(0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000, help="files of each kind (default 1000)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", action="append", help="of these kinds only")
    parser.add_argument("--keep", type=Path, help="folder for the files that led to faults")
    given = parser.parse_args(arguments)
    known = kinds()
    unknown = set(given.kind or ()) - known.keys()
    if unknown:
        parser.error(f"unknown kind {', '.join(unknown)}; known: {', '.join(known)}")
    print("| file | damaged | read | refused in one line | faults | slowest s | memory MB |")
    print("|---|---|---|---|---|---|---|")
    faults: Counter[str] = Counter()
    for name in given.kind or known:
        tally = fuzz(known[name], given.seed, given.count, given.keep)
        row = (name, given.count, tally.read, tally.refused, sum(tally.faults.values()))
        print("| " + " | ".join(map(str, row)), f"| {tally.slowest_s:.2f} | {tally.memory_mb:.0f} |", flush=True)
        faults.update({f"{name}: {what}": count for what, count in tally.faults.items()})
    for what, count in faults.most_common():
        print(f"{count} × {what}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
