"""Close the pouring robot with large random errors, many times: how often it closes, is refused, or is ambiguous.

    python scripts/studies/closures.py --count 1000000 --times 10 --singly 500

Every joint of the drawing is displaced evenly within the paper's 0.2 mm and 4 mrad, so many times, along and about
every axis; commands are spread over the workspace. Large errors grow in steps inside the solvers, so that of several
assembly modes the one is found that grows out of the drawing's. Here each sample is also closed straight from the
drawing's pose, which shows how many have another mode nearby, and with errors that grow twice as slowly, which shows
whether the steps are small enough. Some are closed one at a time too, by the solver of single poses. Prints a Markdown
table; exit code 1 if the two solvers differ.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence

import numpy as np

from pouring_robot.batch import BatchClosure, BatchStart, engine_for
from pouring_robot.batch.samples import STATUS_NAMES
from pouring_robot.exceptions import ClosureError, SingularPoseError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.poses import MM, MRAD, PlacementError
from pouring_robot.robot.robot import PouringRobot

PAPER_MM, PAPER_MRAD = 0.2, 4.0
STEPS = 20
BLOCK = 20_000
ALIKE_M = 1e-8


class Study:
    """Draws samples and closes them.

    Args:
        times: how many times the paper's errors.
        seed: of the draws.
    """

    def __init__(self, times: float, seed: int) -> None:
        """Make the engine of the drawing."""
        self.robot = PouringRobot()
        self.engine = engine_for(self.robot.nominal_solver.mechanism)
        self.straight = engine_for(self.robot.nominal_solver.mechanism, options=ClosureOptions(most_steps=1))
        sites = self.engine.structure.site_count
        self.widths = np.tile([PAPER_MM * MM] * 3 + [PAPER_MRAD * MRAD] * 3, sites) * times
        self.random = np.random.default_rng(seed)
        box = np.array([[axis.lower, axis.upper] for axis in self.robot.command_axes])
        self.lower, self.upper = box.T

    def draw(self, count: int) -> tuple[FloatArray, BatchStart, FloatArray]:
        """Return drives, closed poses of the drawing and errors of samples."""
        commands = self.robot.drawing.commands(self.random.uniform(self.lower, self.upper, (count, self.lower.size)))
        reached = np.flatnonzero(np.isfinite(commands.start.position).all(axis=1))
        errors = self.random.uniform(-self.widths, self.widths, (reached.size, self.widths.size))
        return commands.drives[reached], commands.start[reached], errors

    def grown(self, drives: FloatArray, start: BatchStart, errors: FloatArray) -> BatchClosure:
        """Return the closures that are continuous with the drawing: errors grow in steps."""
        for step in range(1, STEPS):
            closed = self.straight.close(drives, start, errors * (step / STEPS))
            start = start.replaced(np.arange(len(start)), closed)
        return self.straight.close(drives, start, errors)

    def singly(self, drives: FloatArray, errors: FloatArray) -> FloatArray | str:
        """Return the pose that the solver of single poses finds, (3,) in m, or why it finds none."""
        joints = self.engine.structure.site_joints
        placed = {
            joint: PlacementError(tuple(row[:3].tolist()), tuple(row[3:].tolist())).to_se3()
            for joint, row in zip(joints, errors.reshape(-1, 6), strict=True)
            if joint
        }
        mechanism = self.robot.nominal_solver.mechanism.displaced(placed)
        configuration = self.robot.drawing.configuration_at(drives)
        try:
            found = ClosureSolver(mechanism).solve_from(configuration)
        except (ClosureError, SingularPoseError) as error:
            return str(error).split(":")[1].split(" after")[0].strip()
        position: FloatArray = found.pose_base_to_end.translation
        return position


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000, help="closures (default 20000)")
    parser.add_argument("--times", type=float, default=10.0, help="times the paper's errors (default 10)")
    parser.add_argument("--singly", type=int, default=100, help="of them closed one at a time (default 100)")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    study, told, single = Study(given.times, given.seed), Counter[str](), Counter[str]()
    start, done, largest = time.process_time(), 0, 0.0
    while done < given.count:
        drives, begin, errors = study.draw(min(BLOCK, given.count - done))
        closed, straight = (engine.close(drives, begin, errors) for engine in (study.engine, study.straight))
        for status in np.unique(closed.status).tolist():
            told[f"refused: {STATUS_NAMES[status]}" if status else "closed"] += int((closed.status == status).sum())
        for name, other in (("straight", straight), ("grown twice as slowly", study.grown(drives, begin, errors))):
            apart = np.linalg.norm(closed.position - other.position, axis=1)
            both = (closed.status == 0) & (other.status == 0)
            told[f"another mode {name}"] += int((apart[both] > ALIKE_M).sum())
            told[f"closed, but not {name}"] += int(((closed.status == 0) & (other.status != 0)).sum())
            told[f"refused, but closed {name}"] += int(((closed.status != 0) & (other.status == 0)).sum())
            largest = max(largest, float(apart[both].max(initial=0.0)))
        for k in range(min(given.singly - sum(single.values()), len(drives))):
            one = study.singly(drives[k], errors[k])
            if isinstance(one, str):
                single[
                    f"{'refused in both' if closed.status[k] else 'refused singly, closed in the batch'} ({one})"
                ] += 1
            elif closed.status[k] != 0:
                single["closed singly, refused in the batch"] += 1
            else:
                alike = np.linalg.norm(one - closed.position[k]) < ALIKE_M
                single["the same" if alike else "another mode"] += 1
        done += len(drives)
    seconds = time.process_time() - start
    print(f"| {done} closures, errors of {given.times:g} times the paper's ({seconds:.0f} s of processor) | number |")
    print("|---|---|")
    for name, number in told.items():
        print(f"| {name} | {number} |")
    print(f"| largest distance of two modes | {largest * 1e3:.3g} mm |")
    for name, number in single.items():
        print(f"| of {sum(single.values())} one at a time: {name} | {number} |")
    agreed = sum(number for name, number in single.items() if name == "the same" or name.startswith("refused in both"))
    return int(agreed < sum(single.values()))


if __name__ == "__main__":
    sys.exit(main())
