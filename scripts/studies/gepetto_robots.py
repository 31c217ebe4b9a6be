"""Close the example robots of another project, and compare G with differences of closures.

    git clone https://github.com/Gepetto/example-parallel-robots
    python -m scripts.studies.gepetto_robots example-parallel-robots/robots
    python -m scripts.studies.gepetto_robots example-parallel-robots/robots --toolbox toolbox-parallel-robots

Each folder with a ``robot.yaml`` and a URDF is one robot. It is closed from its neutral pose; drives are released where
it cannot close with them at zero. Then its drives step to 40 random targets up to 0.2 rad (or 0.2 m) away, reachable or
not, each closed from there. The observed frame is, of those that the drives determine, the one with the most joints
before it. Prints a Markdown table; a robot that fails has its reason in one line. With --toolbox, the first of the same
targets are also closed by that project's own closure.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.batch import engine_for
from pouring_robot.batch.interface import Engine
from pouring_robot.batch.records import BatchClosure
from pouring_robot.batch.starts import closed_home
from pouring_robot.exceptions import PouringRobotError, SingularPoseError
from pouring_robot.io.files import read_text
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.loops_file import load_loops
from pouring_robot.mechanism.transfer import closed_chain_transfer
from scripts.studies.gepetto_toolbox import ToolboxFindings, close_with, load_toolbox

TARGETS, REACH, CLOSED, STEP = 40, 0.2, 1e-9, 3e-6
# Targets that the toolbox closes as well, and what it may leave open: its search is set to end at 1e-6.
BESIDE, TOOLBOX_CLOSED = 10, 1e-6
_TOOLBOX_HEADINGS = ("toolbox closed to 1e-6", "toolbox leaves open, median", "toolbox ms")
_HEADINGS = (
    "robot",
    "loops",
    "drives",
    "closed",
    "left open, m or rad",
    "idle joints",
    "frame",
    "G against differences",
    "ms",
)


@dataclass(frozen=True)
class Findings:
    """What was found of one robot.

    Attributes:
        loops: their number; ``drives``: theirs.
        closed: targets that close to 1e-9 m and rad.
        residual: largest component left open at any target, in m or rad.
        idle: joints that idle at the neutral pose.
        frame: the observed one.
        difference: largest deviation of its G from central differences over the largest of them.
        seconds: of one closure, on average.
        other: what the toolbox found.
    """

    loops: int
    drives: int
    closed: int
    residual: float
    idle: int
    frame: str
    difference: float
    seconds: float
    other: ToolboxFindings | None

    def cells(self) -> tuple[str, ...]:
        """Return the table's row without the robot's name."""
        counts = (
            str(self.loops),
            str(self.drives),
            f"{self.closed} of {TARGETS}",
            f"{self.residual:.1e}",
            str(self.idle),
        )
        own = *counts, self.frame, f"{self.difference:.1e}", f"{1e3 * self.seconds:.1f}"
        if self.other is None:
            return own
        found = self.other
        return *own, f"{found.closed} of {found.targets}", f"{found.residual:.1e}", f"{1e3 * found.seconds:.0f}"


def read_mechanism(folder: Path) -> ClosedChainMechanism:
    """Return the robot of a folder.

    Raises:
        PouringRobotError: a file is missing or wrong.
    """
    path = folder / "robot.yaml"
    return ClosedChainMechanism(read_text(next(folder.glob("*.urdf"), folder / "robot.urdf")), load_loops(path), path)


def observed_frame(solver: ClosureSolver, result: ClosureResult) -> str:
    """Return the frame with the most joints before it that the drives determine."""
    paths, drive = solver.mechanism.frame_paths, drive_parameters(solver.mechanism)[:1]
    for name in sorted(paths, key=lambda name: -len(paths[name])):
        try:
            closed_chain_transfer(solver, result, drive, name)
        except SingularPoseError:
            continue
        return name
    raise AssertionError("the universe stands still")


def differences(engine: Engine, home: BatchClosure, drives: FloatArray) -> FloatArray:
    """Return the derivative of the pose by all placements, then drives, by central differences; (6, columns)."""
    count = len(engine.parameters)
    size = 6 * engine.structure.site_count
    columns = []
    for p in range(count + drives.size):
        errors, moved = np.zeros((4, size)), np.tile(drives, (4, 1))
        (errors[:, p] if p < count else moved[:, p - count])[:] += STEP * np.array([-2.0, -1.0, 1.0, 2.0])
        found = engine.close(moved, home.as_start()[np.zeros(4, dtype=np.int64)], errors)
        pairs = [
            np.r_[found.position[b] - found.position[a], pin.log3(found.rotation[b] @ found.rotation[a].T)]
            for a, b in ((1, 2), (0, 3))
        ]
        columns.append((8.0 * pairs[0] - pairs[1]) / (12.0 * STEP))
    return np.stack(columns, axis=1)


def study(mechanism: ClosedChainMechanism, seed: int, toolbox: Any = None) -> Findings:
    """Close one robot and compare its G, and its closures with those of the toolbox, if there is one.

    Raises:
        ClosureError: it does not close from its neutral pose.
    """
    solver = ClosureSolver(mechanism)
    result = closed_home(mechanism, {})
    loops = mechanism.loops.model_copy(update={"end_frame": observed_frame(solver, result)})
    engine = engine_for(ClosedChainMechanism(mechanism.urdf, loops))
    count = len(mechanism.loops.drives)
    at_home = np.array([mechanism.joint_values(result.configuration)[name] for name in mechanism.loops.drives])
    targets = at_home + np.random.default_rng(seed).uniform(-REACH, REACH, (TARGETS, count))
    start = engine.start_at(result.configuration[None])
    began = time.perf_counter()
    closed = engine.close(targets, start[np.zeros(TARGETS, dtype=np.int64)])
    spent = (time.perf_counter() - began) / TARGETS
    home = engine.close(at_home[None], start)
    transfer = engine.transfer(home, [*engine.parameters, *drive_parameters(mechanism)])
    expected = differences(engine, home, at_home)
    difference = float(np.abs(transfer.matrix[0] - expected).max() / np.abs(expected).max())
    residual = np.abs(closed.residual[closed.closed]).max(axis=(1, 2))
    return Findings(
        loops=len(mechanism.anchors),
        drives=count,
        closed=int((residual < CLOSED).sum()),
        residual=float(residual.max(initial=0.0)),
        idle=len(result.idle_joints),
        frame=str(loops.end_frame),
        difference=difference,
        seconds=spent,
        other=toolbox and close_with(toolbox, mechanism, targets[:BESIDE], TOOLBOX_CLOSED),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return the exit code: 1 where no robot could be read."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds a folder for each robot")
    parser.add_argument("--seed", type=int, default=1, help="of the targets")
    parser.add_argument("--toolbox", type=Path, help="clone of Gepetto's toolbox-parallel-robots, to run beside")
    given = parser.parse_args(arguments)
    toolbox = load_toolbox(given.toolbox) if given.toolbox else None
    headings = (*_HEADINGS, *_TOOLBOX_HEADINGS) if toolbox else _HEADINGS
    print(f"| {' | '.join(headings)} |\n|{'---|' * len(headings)}")
    read = 0
    for path in sorted(given.folder.rglob("robot.yaml")):
        name = path.parent.relative_to(given.folder)
        try:
            cells = study(read_mechanism(path.parent), given.seed, toolbox).cells()
            read += 1
        except PouringRobotError as problem:
            cells = (str(problem), *[""] * (len(headings) - 2))
        print(f"| {' | '.join((str(name), *cells))} |", flush=True)
    return 0 if read else 1


if __name__ == "__main__":
    sys.exit(main())
