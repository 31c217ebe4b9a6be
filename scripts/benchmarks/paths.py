"""Measure how many poses of a path are compensated and located per second, cold and warm.

    python -m scripts.benchmarks.paths                # a straight way through the workspace, and poses at random
    python -m scripts.benchmarks.paths --poses 100

Processor seconds are those of all threads: the cost of a pose regardless of other load on the machine.
"""

from __future__ import annotations

import argparse
import functools
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pouring_robot.compensation.path import compensate_path
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.pouring_robot import load_robot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, locate_path

MODEL = Path(__file__).resolve().parents[2] / "examples" / "actual.yaml"
COLD_FOR_ONE_WARM = 50


def cpu_s() -> float:
    """Return the processor seconds this process has used."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def measured(call: Callable[[FloatArray], object], poses: FloatArray) -> tuple[float, float]:
    """Return poses a second and poses a processor second, everything compiled before."""
    call(poses[:4])
    began, used = time.perf_counter(), cpu_s()
    call(poses)
    return len(poses) / (time.perf_counter() - began), len(poses) / (cpu_s() - used)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=400, help="warm ones; cold ones are fifty times as many")
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    robot = load_robot(MODEL)
    lower, upper = robot.layout.box
    print("| what | robot | poses | poses a second | poses a processor second |\n|---|---|---|---|---|")
    for name, heat in (("cold", None), ("melt at 1700 °C", HeatSection(melt_degC=1700.0))):
        heated, count = HeatedRobot(robot, heat), given.poses * (COLD_FOR_ONE_WARM if heat is None else 1)
        calls: dict[str, Callable[[FloatArray], object]] = {
            "compensate": functools.partial(compensate_path, heated, threads=given.threads),
            "path": functools.partial(locate_path, heated, threads=given.threads),
        }
        along = lower + (upper - lower) * np.linspace(0.05, 0.95, count)[:, None]
        anywhere = np.random.default_rng(1).uniform(lower, upper, (count, 4))
        for what, call in calls.items():
            for where, poses in (("along a line", along), ("anywhere", anywhere)):
                a_second, a_cpu_second = measured(call, poses)
                print(f"| {what}, {where} | {name} | {count:,} | {a_second:,.0f} | {a_cpu_second:,.0f} |", flush=True)


if __name__ == "__main__":
    main()
