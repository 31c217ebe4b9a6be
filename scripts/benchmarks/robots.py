"""Measure the batch engines on robots of any topology: closures per second, and G of many poses.

    python scripts/benchmarks/robots.py examples/robots/*/robot.yaml

Each robot is moved from its home to random drive values between its limits, then closed again from 0.01 (m or rad)
away, with errors in every placement. Prints a Markdown table; figures hold for the machine and load of the run.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pouring_robot.batch import GeneralEngine, HomotopyStarts, engine_for
from pouring_robot.exceptions import PouringRobotError
from pouring_robot.mechanism.local_parameters import LocalParameter, drive_parameters
from pouring_robot.robot.description.definition import RobotDefinition

OFF, ERROR_M, ERROR_RAD = 0.01, 2e-4, 1e-3
_HEADINGS = ("robot", "engine", "poses", "starts/s", "closures/s", "closed", "parameters", "G of 10,000 poses, s")


def best_s(call: Callable[[], object], repeats: int = 3) -> float:
    """Return the shortest of a few timings: what disturbs a machine only ever adds."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return min(times)


def row(path: Path, poses: int, threads: int | None, seed: int) -> tuple[str, ...]:
    """Measure one robot file.

    Raises:
        PouringRobotError: the file is wrong, or the robot does not close at its home.
    """
    definition = RobotDefinition.load(path)
    mechanism, random = definition.mechanism(), np.random.default_rng(seed)
    engine = engine_for(mechanism, threads)
    if isinstance(engine, GeneralEngine):
        poses = min(poses, 200)
    limits = mechanism.joint_limits()
    lower, upper = np.transpose([limits.get(name, (-np.pi, np.pi)) for name in mechanism.loops.drives])
    drives = random.uniform(lower, upper, (poses, lower.size))
    homotopy = HomotopyStarts(engine, definition.file.home)
    start = homotopy.starts(drives)
    reached = np.flatnonzero(np.isfinite(start.position[:, 0]))
    drives, start = drives[reached], start[reached]
    used = np.array([bool(name) for name in engine.structure.site_joints])
    errors = random.uniform(-1.0, 1.0, (len(drives), used.size, 6)) * ([ERROR_M] * 3 + [ERROR_RAD] * 3)
    errors = (errors * used[:, None]).reshape(len(drives), -1)
    moved = drives + random.uniform(-OFF, OFF, drives.shape)
    closed = engine.close(moved, start, errors)
    parameters: list[LocalParameter] = [*engine.parameters, *drive_parameters(mechanism)]
    engine.transfer(closed, parameters, errors)
    follow_s = best_s(lambda: homotopy.starts(drives), 1) / len(drives)
    close_s = best_s(lambda: engine.close(moved, start, errors)) / len(drives)
    transfer_s = best_s(lambda: engine.transfer(closed, parameters, errors)) / len(drives)
    return (
        definition.name,
        type(engine).__name__,
        str(len(drives)),
        f"{1.0 / follow_s:,.0f}",
        f"{1.0 / close_s:,.0f}",
        f"{closed.closed.mean():.2%}",
        str(len(parameters)),
        f"{1e4 * transfer_s:.4f}",
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code: 1 where a robot could not be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+", help="robot files")
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--threads", type=int, help="by default one a core")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    print(f"| {' | '.join(_HEADINGS)} |\n|{'---|' * len(_HEADINGS)}")
    failed = False
    for path in given.files:
        try:
            print(f"| {' | '.join(row(path, given.poses, given.threads, given.seed))} |", flush=True)
        except PouringRobotError as problem:
            failed = True
            print(f"{path}: {problem}", file=sys.stderr)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
