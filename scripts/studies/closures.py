"""Close the pouring robot with large random errors, many times: how often it closes, is refused, or is ambiguous.

    python scripts/studies/closures.py --count 1000000 --times 10 --singly 500

Every joint of the drawing is displaced uniformly within a multiple of the paper's 0.2 mm and 4 mrad, along and about
every axis; commands are spread over the workspace. The solvers apply large errors in steps, so that of several assembly
modes they find the one continuous with the drawing's. Here each sample is also closed directly from the drawing's pose,
which shows how many have another mode nearby, and with errors applied in twenty steps. Samples for which these differ,
and those refused because their mode ends, are followed in two thousand steps, which decide: a mode that ends in a fold
approaches its end as the square root of the remaining distance, no step more than 1 + sqrt(2) times the one before, and
then jumps. Some samples are also closed one at a time by the solver for single poses, including those refused because
their mode ends. Prints a Markdown table; exit code 1 if an answer is wrong or the two solvers differ.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.batch import BatchStart, engine_for
from pouring_robot.exceptions import ClosureError
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.assembly_mode import jumps
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.closure.status import STATUS_NAMES
from pouring_robot.robot.pouring_robot import PouringRobot

PAPER_MM, PAPER_MRAD = 0.2, 4.0
STEPS, FINEST = 20, 2000
BLOCK = 20_000
ALIKE_M = 1e-8
MODE_ENDS = "assembly mode ends"


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
        straight = ClosureOptions(most_steps=1)
        self.straight = engine_for(self.robot.nominal_solver.mechanism, options=straight)
        however_open = replace(straight, max_gap_m=np.inf, max_gap_rad=np.inf)
        self.open = engine_for(self.robot.nominal_solver.mechanism, options=however_open)
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

    def followed(
        self, drives: FloatArray, start: BatchStart, errors: FloatArray, steps: int
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return positions, (n, 3) in m, after errors have grown in so many steps, and whether a step jumped, (n,)."""
        jumped, before = np.zeros(len(drives), dtype=bool), np.full(len(drives), np.inf)
        for step in range(steps + 1):
            closed = self.open.close(drives, start, errors * (step / steps))
            moved = np.linalg.norm(closed.position - start.position, axis=1)
            if step:
                jumped |= (closed.status != 0) | jumps(moved, before)
                before = np.where(closed.status == 0, moved, before)
            start = start.replaced(np.arange(len(start)), closed)
        return start.position, jumped

    def closed_singly(self, drives: FloatArray, errors: FloatArray) -> FloatArray:
        """Return the pose that the solver of single poses finds, (3,) in m; it raises what that raises."""
        joints = self.engine.structure.site_joints
        placed = {
            joint: pin.SE3(pin.exp3(row[3:]), row[:3])
            for joint, row in zip(joints, errors.reshape(-1, 6), strict=True)
            if joint
        }
        mechanism = self.robot.nominal_solver.mechanism.displaced(placed)
        closed = ClosureSolver(mechanism).solve_from(self.robot.drawing.configuration_at(drives))
        position: FloatArray = closed.pose_base_to_end.translation
        return position

    def singly(self, drives: FloatArray, errors: FloatArray) -> FloatArray | str:
        """Return the pose that the solver of single poses finds, (3,) in m, or the status of its refusal."""
        try:
            return self.closed_singly(drives, errors)
        except ClosureError as error:
            return error.status


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
        apart = np.linalg.norm(closed.position - straight.position, axis=1)
        told["closed, where straight from the drawing another mode is found"] += int((apart > ALIKE_M).sum())
        largest = max(largest, float(np.nanmax(apart, initial=0.0)))
        slowly, _ = study.followed(drives, begin, errors, STEPS)
        ends = closed.status == STATUS_NAMES.index(MODE_ENDS)
        doubtful = np.flatnonzero(ends | (np.linalg.norm(closed.position - slowly, axis=1) > ALIKE_M))
        finest, jumped = study.followed(drives[doubtful], begin[doubtful], errors[doubtful], FINEST)
        alike, ends = np.linalg.norm(closed.position[doubtful] - finest, axis=1) < ALIKE_M, ends[doubtful]
        told[f"closed, but not so in {STEPS} steps; as in {FINEST}"] += int((alike & ~ends).sum())
        told[f"WRONG: closed, but not so in {FINEST} steps"] += int((~alike & ~ends).sum())
        told[f"mode ends, and jumps in {FINEST} steps"] += int((ends & jumped).sum())
        told[f"mode ends, but not in {FINEST} steps"] += int((ends & ~jumped).sum())
        left = max(given.singly - sum(single.values()), 0)
        for k in (*range(min(left, len(drives))), *(doubtful if done == 0 else ())):
            one, name = study.singly(drives[k], errors[k]), STATUS_NAMES[closed.status[k]]
            if isinstance(one, str):
                same = one == name
                single[f"refused by both: {one}" if same else f"DIFFERENT: {one} singly, {name} in the batch"] += 1
            else:
                same = bool(np.linalg.norm(one - closed.position[k]) < ALIKE_M)
                single["the same pose" if same else f"DIFFERENT: closed singly, {name} in the batch"] += 1
        done += len(drives)
    seconds = time.process_time() - start
    print(f"| {done} closures, errors of {given.times:g} times the paper's ({seconds:.0f} s of processor) | number |")
    print("|---|---|")
    for name, number in told.items():
        print(f"| {name} | {number} |")
    print(f"| largest distance of two modes | {largest * 1e3:.3g} mm |")
    for name, number in single.items():
        print(f"| of {sum(single.values())} one at a time: {name} | {number} |")
    return int(any(number for name, number in (told + single).items() if name.startswith(("WRONG", "DIFFERENT"))))


if __name__ == "__main__":
    sys.exit(main())
