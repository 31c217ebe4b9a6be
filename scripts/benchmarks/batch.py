"""Measure the batch engine against the one-at-a-time solver, the arithmetic floor, and itself as work grows.

Everything is measured in one run on one machine, so ratios are transferable where absolute times are not. The floor is
the least arithmetic the method needs, at the rate of a compiled loop of independent multiply-adds on this machine; it
is an estimate for comparison, not a bound.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

from pouring_robot.batch import BatchCommand, BatchStart, CompiledEngine, SiteErrors
from pouring_robot.exceptions import ClosureError
from pouring_robot.io.files import check_writable, write_whole
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.robot.description.urdf import perturb_urdf
from pouring_robot.robot.dh.table import DHTable
from pouring_robot.robot.pouring_robot import PouringRobot

OFF_M, OFF_RAD = 0.020, 0.050
REPEATS = 3
# Robots closed one at a time for comparison: building one takes some milliseconds.
SINGLE_SAMPLES = 300
WANTED_RATIO, WANTED_G_S = 50.0, 0.2
# Multiply-adds counted by hand. A step of the closure, four chains: six placements (27 + 9 for the rotation and the
# origin), log and wrench (75), columns (75), elimination of four joints (220) each, and the platform's 6 x 6 (90).
STEP_MULTIPLY_ADDS = 4 * (6 * 36 + 75 + 75 + 220) + 90
# A column of G: its world twist (27) and the 6 x 6 of its chain (36).
COLUMN_MULTIPLY_ADDS = 27 + 36


@numba.njit(fastmath=True)
def _multiply_adds(rounds: int) -> float:
    a, b, c, d, e, f, g, h = 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7
    for _ in range(rounds):
        a, b, c, d = a * 0.999 + 1e-3, b * 0.999 + 1e-3, c * 0.999 + 1e-3, d * 0.999 + 1e-3
        e, f, g, h = e * 0.999 + 1e-3, f * 0.999 + 1e-3, g * 0.999 + 1e-3, h * 0.999 + 1e-3
    return a + b + c + d + e + f + g + h


def best_time_s(call: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the shortest of a few timings: what disturbs a machine only ever adds."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def multiply_add_s() -> float:
    """Return the time of one multiply-add among eight independent ones on this processor, in s."""
    rounds = 2_000_000
    _multiply_adds(10)
    return best_time_s(lambda: _multiply_adds(rounds)) / (8 * rounds)


def draw_command(robot: PouringRobot, count: int, seed: int) -> tuple[BatchCommand, BatchStart]:
    """Return commands spread over the workspace box, and starts 20 mm and 50 mrad off."""
    random, kinematics, (lower, upper) = np.random.default_rng(seed), robot.kinematics, robot.layout.box
    position = random.uniform(lower[:3], upper[:3], (count, 3))
    tilt = random.uniform(lower[3], upper[3], count)
    aside = random.normal(size=(count, 3))
    aside *= OFF_M / np.linalg.norm(aside, axis=1, keepdims=True)
    turned = tilt + random.choice((-OFF_RAD, OFF_RAD), count)
    command = kinematics.commands(np.column_stack([position, tilt]))
    return command, kinematics.commands(np.column_stack([position + aside, turned])).start


def robot_of_sample(engine: CompiledEngine, errors: FloatArray) -> ClosedChainMechanism:
    """Return the mechanism that holds the placement errors of one sample, shape (sites * 6,), in its URDF."""
    mechanism = engine.structure.mechanism
    if not errors.any():
        return mechanism
    sites = zip(engine.structure.site_joints, errors.reshape(-1, 6), strict=True)
    placements = {name: pin.SE3(pin.exp3(error[3:]), error[:3]) for name, error in sites}
    return ClosedChainMechanism(perturb_urdf(mechanism.urdf, placements), mechanism.loops)


def one_at_a_time_s(
    engine: CompiledEngine, command: BatchCommand, start: BatchStart, errors: Callable[[int], FloatArray], count: int
) -> tuple[float, int]:
    """Return the median time of one closure of the first samples, one at a time, in s, and how many did not close.

    Each sample is a robot of its own, with its own solver, closed from the same start as in the batch. Building the
    robot is not counted; neither is a first closure that warms its workspace.
    """
    times, failed = [], 0
    for k in range(min(count, len(command))):
        mechanism = robot_of_sample(engine, errors(k))
        solver = ClosureSolver(mechanism)
        joints = {f"leg{i + 1}_s{j + 1}": float(start.joints[k, i, j]) for i in range(4) for j in range(5)}
        begin_at = mechanism.with_joint_values(mechanism.neutral_configuration(), joints)
        drives = dict(zip(mechanism.loops.drives, command.drives[k].tolist(), strict=True))
        try:
            solver.solve(drives, begin_at)
            begin = time.perf_counter()
            solver.solve(drives, begin_at)
            times.append(time.perf_counter() - begin)
        except ClosureError:
            failed += 1
    return float(np.median(times)), failed


def closure_rows(robot: PouringRobot, unit_s: float, count: int, seed: int) -> list[dict[str, Any]]:
    """Measure closures with growing errors on one thread and on all, and one at a time with the same errors."""
    mechanism = robot.nominal_solver.mechanism
    command, away = draw_command(robot, count, seed)
    random = np.random.default_rng(seed + 1)
    sites = len(CompiledEngine(mechanism).parameters) // 6

    def all_errors(length_m: float, angle_rad: float) -> FloatArray:
        scale = np.tile(np.repeat([length_m, angle_rad], 3), sites)
        return np.asarray(random.uniform(-1.0, 1.0, (count, 6 * sites)) * scale)

    site, component = np.divmod(np.arange(count) % (6 * sites), 6)
    values = np.where(component < 3, 2e-4, 4e-3)
    one = SiteErrors.one_each(site, values[:, None] * np.eye(6)[component])
    every, units = all_errors(2e-4, 1e-3), np.eye(6 * sites)
    cases: list[tuple[str, BatchStart, SiteErrors | FloatArray | None, Callable[[int], FloatArray]]] = [
        ("none, from 20 mm and 50 mrad off", away, None, lambda k: np.zeros(6 * sites)),
        ("one of 0.2 mm or 4 mrad a sample", command.start, one, lambda k: values[k] * units[k % len(units)]),
        ("all 144 within 0.2 mm and 1 mrad", command.start, every, lambda k: every[k]),
    ]
    rows = []
    for name, start, errors, errors_of in cases:
        single_s, open_ones = one_at_a_time_s(CompiledEngine(mechanism, 1), command, start, errors_of, SINGLE_SAMPLES)
        row: dict[str, Any] = {"errors": name, "samples": count}
        row |= {"single_us": 1e6 * single_s, "single_failed": open_ones}
        for label, threads in (("one_thread", 1), ("all_threads", None)):
            engine = CompiledEngine(mechanism, threads)
            engine.close(command.drives[:2], start[slice(0, 2)])
            result = engine.close(command.drives, start, errors)
            spent = best_time_s(lambda e=engine, s=start, x=errors: e.close(command.drives, s, x)) / count  # type: ignore[misc]
            row[label] = {"us": 1e6 * spent, "ratio": single_s / spent, "threads": engine.threads}
            row |= {"failed": int((result.status != 0).sum()), "steps": float(result.iterations.mean())}
        row["floor_us"] = 1e6 * unit_s * STEP_MULTIPLY_ADDS * row["steps"]
        rows.append(row)
    return rows


def transfer_figures(robot: PouringRobot, unit_s: float, count: int, seed: int) -> dict[str, float]:
    """Measure G for all DH parameters on one core."""
    command, _ = draw_command(robot, count, seed)
    engine = CompiledEngine(robot.nominal_solver.mechanism, threads=1)
    parameters = [parameter.local for parameter in DHTable.from_mechanism(robot.nominal_solver.mechanism).parameters]
    closed = engine.close(command.drives, command.start)
    engine.transfer(closed, parameters)
    spent = best_time_s(lambda: engine.transfer(closed, parameters))
    floor = unit_s * COLUMN_MULTIPLY_ADDS * count * len(parameters)
    return {"poses": count, "parameters": len(parameters), "seconds": spent, "floor_s": floor}


def growth_rows(robot: PouringRobot, sizes: Sequence[int], chunk: int, seed: int) -> list[dict[str, float]]:
    """Measure one closure as work grows, chunk by chunk, and the memory the process has ever held."""
    engine = CompiledEngine(robot.nominal_solver.mechanism)
    rows = []
    for size in sizes:
        begin = time.perf_counter()
        for first in range(0, size, chunk):
            command, away = draw_command(robot, min(chunk, size - first), seed + first)
            engine.close(command.drives, away).require_all()
        spent = time.perf_counter() - begin
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        rows.append({"samples": size, "us_a_sample": 1e6 * spent / size, "peak_mb": peak})
    return rows


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the figures as tables with their targets."""
    table = Table(box=None, pad_edge=False, title="closures in batches", title_justify="left")
    for heading in ("errors", "steps", "failed", "one at a time µs", "µs, 1 thread", "×", "µs, all", "×", "floor µs"):
        table.add_column(heading, justify="left" if heading == "errors" else "right")
    for row in figures["closures"]:
        one, all_ = row["one_thread"], row["all_threads"]
        single = f"{row['single_us']:.0f}"
        times = (f"{one['us']:.2f}", f"{one['ratio']:.0f}", f"{all_['us']:.2f}", f"{all_['ratio']:.0f}")
        counts = (f"{row['steps']:.1f}", str(row["failed"]))
        table.add_row(row["errors"], *counts, single, *times, f"{row['floor_us']:.2f}")
    console.print(table)
    failed = sum(row["single_failed"] for row in figures["closures"])
    console.print(
        f"one at a time: the median of {SINGLE_SAMPLES} of the same robots a row, each with a solver of its own; "
        f"{failed} did not close"
    )
    ratio = figures["closures"][0]["all_threads"]["ratio"]
    console.print(f"ratio {ratio:.0f}: {'meets' if ratio >= WANTED_RATIO else 'MISSES'} the wanted {WANTED_RATIO:.0f}")
    g = figures["transfer"]
    verdict = "meets" if g["seconds"] <= WANTED_G_S else "MISSES"
    console.print(
        f"G of {g['poses']} poses x {g['parameters']} parameters on one core: {g['seconds']:.3f} s "
        f"({verdict} the wanted {WANTED_G_S} s; floor {g['floor_s']:.3f} s)"
    )
    growth = Table(box=None, pad_edge=False, title="as work grows, all threads, drawing included", title_justify="left")
    for heading in ("samples", "µs a sample", "peak MB"):
        growth.add_column(heading, justify="right")
    for row in figures["growth"]:
        growth.add_row(f"{row['samples']:,}", f"{row['us_a_sample']:.2f}", f"{row['peak_mb']:.0f}")
    console.print(growth)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer samples")
    parser.add_argument("--seed", type=int, default=2022, help="of the random poses and errors")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    options = parser.parse_args(arguments)
    if options.json:
        check_writable(options.json)
    robot = PouringRobot()
    count, largest = (2_000, 10_000) if options.quick else (50_000, 1_000_000)
    sizes = [size for size in (1_000, 10_000, 100_000, 1_000_000) if size <= largest]
    unit_s = multiply_add_s()
    figures: dict[str, Any] = {
        "seed": options.seed,
        "multiply_add_ns": 1e9 * unit_s,
        "closures": closure_rows(robot, unit_s, count, options.seed),
        "transfer": transfer_figures(robot, unit_s, min(count, 10_000), options.seed),
        "growth": growth_rows(robot, sizes, 50_000, options.seed),
    }
    show(Console(width=None if sys.stdout.isatty() else 120), figures)
    if options.json:
        write_whole(options.json, json.dumps(figures, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
