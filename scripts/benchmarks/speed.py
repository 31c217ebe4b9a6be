"""Measure how fast the loops close, how often, and how exactly, one pose at a time; and how fast robots are calibrated.

Machines differ and are noisy, so each time is also given as a multiple of a unit of work measured at the same time: one
call of Pinocchio's joint Jacobians with the four loop anchors, which any solver needs at every iteration.

A new benchmark is a function from :class:`Setting` to :class:`Measurement`, added to :data:`BENCHMARKS`.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.progress import track
from rich.table import Table

from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.map_fit import Fit, identify
from pouring_robot.estimation.measurement import MeasurementModel
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.exceptions import NoSolutionError, PouringRobotError
from pouring_robot.io.files import check_writable, write_whole
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.energy import ClosureEnergy
from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import all_parameters
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot, load_robot
from pouring_robot.robot.tolerances import Tolerances
from scripts.studies.calibration import StudyOptions, virtual_campaign

DEFAULT_MODEL = Path(__file__).resolve().parents[2] / "examples" / "actual.yaml"
POSES, QUICK_POSES = 10_000, 500
OFF_M, OFF_RAD = 0.020, 0.050
TARGET_MS = 0.3
UNIT_CALLS = 400
THERMAL_POSES, THERMAL_STUDIES = 50, 5
CALIBRATIONS = 9

Result = TypeVar("Result")


@dataclass(frozen=True)
class Setting:
    """What the benchmarks work on.

    Attributes:
        drawing: the robot without errors.
        actual: the robot as built.
        poses: commanded poses, spread evenly over the workspace box.
        displaced: a start for each of them, 20 mm and 50 mrad away.
    """

    drawing: PouringRobot
    actual: PouringRobot
    poses: tuple[PlatformPose, ...]
    displaced: tuple[PlatformPose, ...]


@dataclass(frozen=True)
class Measurement:
    """Figures of one benchmark; those that do not apply are None.

    Attributes:
        count: calls made.
        median_ms: median time of one call; ``slow_ms``: the time that 95 % of the calls stay below.
        unit_us: median time of the unit of work, measured around the calls.
        failed: calls that raised for want of a solution.
        iterations: mean number of Newton steps, of a calibration the evaluations of all rows; ``most_iterations``: the
            largest.
        worst_m: largest distance of a pose from where it should be; ``worst_rad``: largest angle.
    """

    count: int
    median_ms: float
    slow_ms: float
    unit_us: float
    failed: int = 0
    iterations: float | None = None
    most_iterations: int | None = None
    worst_m: float | None = None
    worst_rad: float | None = None

    @property
    def units(self) -> float:
        """Median time as a multiple of the unit of work."""
        return 1e3 * self.median_ms / self.unit_us


Benchmark = Callable[[Setting], Measurement]


def make_setting(model: Path, count: int, seed: int) -> Setting:
    """Load the robots and draw the poses."""
    drawing, actual = PouringRobot(), load_robot(model)
    random, (lower, upper) = np.random.default_rng(seed), actual.layout.box
    positions = random.uniform(lower[:3], upper[:3], size=(count, 3))
    tilts = random.uniform(lower[3], upper[3], size=count)
    directions = random.normal(size=(count, 3))
    directions *= OFF_M / np.linalg.norm(directions, axis=1, keepdims=True)
    turns = random.choice((-OFF_RAD, OFF_RAD), size=count)
    return Setting(drawing, actual, _poses(positions, tilts), _poses(positions + directions, tilts + turns))


def _poses(positions: FloatArray, tilts: FloatArray) -> tuple[PlatformPose, ...]:
    return tuple(
        PlatformPose((float(x), float(y), float(z)), float(tilt))
        for (x, y, z), tilt in zip(positions, tilts, strict=True)
    )


def unit_times_us(energy: ClosureEnergy, configuration: FloatArray) -> list[float]:
    """Return times of joint Jacobians + loop anchors + their Jacobian in Pinocchio, in µs a call."""
    mechanism = energy.mechanism
    model = mechanism.copy_model()
    data = model.createData()
    anchors, workspaces = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for a, b in mechanism.anchors:
        constraint = pin.ConstraintModel(
            pin.FrameAnchorConstraintModel(model, a.parentJoint, a.placement, b.parentJoint, b.placement)
        )
        anchors.append(constraint)
        workspaces.append(constraint.createData())
    times = []
    for _ in range(UNIT_CALLS):
        start = time.perf_counter_ns()
        pin.computeJointJacobians(model, data, configuration)
        for constraint, workspace in zip(anchors, workspaces, strict=True):
            constraint.calc(model, data, workspace)
        pin.getConstraintsJacobian(model, data, anchors, workspaces)
        times.append((time.perf_counter_ns() - start) * 1e-3)
    return times


class Stopwatch:
    """Times calls one by one, with the unit of work measured before and after them."""

    def __init__(self, solver: ClosureSolver, configuration: FloatArray) -> None:
        """Measure the unit for the first time."""
        self._unit = functools.partial(unit_times_us, solver.energy, configuration)
        self._units = self._unit()
        self._times: list[float] = []

    def time(self, call: Callable[[], Result]) -> Result:
        """Make one timed call."""
        start = time.perf_counter_ns()
        result = call()
        self._times.append((time.perf_counter_ns() - start) * 1e-6)
        return result

    def measurement(self) -> Measurement:
        """Return what was measured."""
        self._units += self._unit()
        median, slow = np.quantile(self._times, (0.5, 0.95))
        return Measurement(len(self._times), float(median), float(slow), float(np.median(self._units)))


def pose_errors(found: pin.SE3, expected: pin.SE3) -> tuple[float, float]:
    """Return distance in m and angle in rad between two poses."""
    angle = np.linalg.norm(pin.log3(found.rotation.T @ expected.rotation))
    return float(np.linalg.norm(found.translation - expected.translation)), float(angle)


def closed(solver: ClosureSolver, drives: dict[str, float], start: FloatArray) -> ClosureResult | None:
    """Return the closed robot, or None where the solver says that there is no solution."""
    try:
        return solver.solve(drives, start)
    except NoSolutionError:
        return None


def closures(
    setting: Setting, solver: ClosureSolver, starts: Sequence[PlatformPose], expected: Sequence[pin.SE3 | None] = ()
) -> Measurement:
    """Close the loops for every pose from the given starts.

    Args:
        setting: robots and poses.
        solver: of the robot without errors, or as built.
        starts: one for each pose.
        expected: where the platform should come out, one for each pose; none: the errors are not measured.
    """
    kinematics = setting.drawing.kinematics
    cases = [(kinematics.inverse(p), kinematics.configuration(s)) for p, s in zip(setting.poses, starts, strict=True)]
    watch = Stopwatch(solver, cases[0][1])
    steps, errors = [], []
    for k, case in enumerate(cases):
        found = watch.time(functools.partial(closed, solver, *case))
        if found is None:
            continue
        steps.append(found.iterations)
        pose = expected[k] if expected else None
        if pose is not None:
            errors.append(pose_errors(found.pose_base_to_end, pose))
    measured = dataclasses.replace(
        watch.measurement(),
        failed=len(cases) - len(steps),
        iterations=float(np.mean(steps)) if steps else None,
        most_iterations=max(steps, default=None),
    )
    return with_errors(measured, errors)


def with_errors(measured: Measurement, errors: Sequence[tuple[float, float]]) -> Measurement:
    """Return the measurement with the largest distance and angle of the errors."""
    if not errors:
        return measured
    worst_m, worst_rad = np.max(errors, axis=0)
    return dataclasses.replace(measured, worst_m=float(worst_m), worst_rad=float(worst_rad))


def drawing_from_nominal(setting: Setting) -> Measurement:
    """Robot of the drawing, started at the closed form; errors against the commanded pose."""
    commanded = [pose.to_se3() for pose in setting.poses]
    return closures(setting, setting.drawing.nominal_solver, setting.poses, commanded)


def drawing_from_afar(setting: Setting) -> Measurement:
    """Robot of the drawing, started 20 mm and 50 mrad off; errors against the commanded pose."""
    commanded = [pose.to_se3() for pose in setting.poses]
    return closures(setting, setting.drawing.nominal_solver, setting.displaced, commanded)


def actual_from_nominal(setting: Setting) -> Measurement:
    """Robot as built, started at the closed form of the drawing."""
    return closures(setting, setting.actual.actual_solver, setting.poses)


def actual_from_afar(setting: Setting) -> Measurement:
    """Robot as built, started 20 mm and 50 mrad off; errors against what the nominal start leads to."""
    kinematics, solver = setting.drawing.kinematics, setting.actual.actual_solver
    expected: list[pin.SE3 | None] = []
    for pose in setting.poses:
        near = closed(solver, kinematics.inverse(pose), kinematics.configuration(pose))
        expected.append(near.pose_base_to_end if near is not None else None)
    return closures(setting, solver, setting.displaced, expected)


def closed_form_round_trip(setting: Setting) -> Measurement:
    """Inverse and forward kinematics of the drawing in closed form; errors against the commanded pose."""
    kinematics = setting.drawing.kinematics
    watch = Stopwatch(setting.drawing.nominal_solver, kinematics.configuration(setting.poses[0]))

    def there_and_back(pose: PlatformPose) -> PlatformPose:
        return kinematics.forward(kinematics.inverse(pose))

    found = [watch.time(functools.partial(there_and_back, pose)) for pose in setting.poses]
    errors = [pose_errors(a.to_se3(), b.to_se3()) for a, b in zip(found, setting.poses, strict=True)]
    return with_errors(watch.measurement(), errors)


def drive_jacobians(setting: Setting) -> Measurement:
    """Drive and passive-joint Jacobians of the robot as built."""
    robot = setting.actual
    locations = [robot.locate(pose) for pose in setting.poses[:QUICK_POSES]]
    watch = Stopwatch(robot.actual_solver, locations[0].actual.configuration)
    drives = drive_parameters(robot.actual_solver.mechanism)
    for location in locations:
        watch.time(functools.partial(closed_chain_transfer, robot.actual_solver, location.actual, drives))
    return watch.measurement()


def calibrations(setting: Setting, wanted: str, parameters: int, poses: int) -> Measurement:
    """Calibrate virtual robots with errors drawn from the tolerances, frames first: what a user waits for a fit.

    Args:
        setting: robots; the poses are drawn anew for each campaign.
        wanted: set of parameters, of which the first ``parameters`` are identified besides the two frames.
        parameters: their number.
        poses: rows of a campaign.
    """
    drawing, tolerances = setting.drawing, Tolerances.load()
    groups = drawing.parameters.groups((wanted,))
    model = MeasurementModel(RobotModel(), all_parameters(groups)[:parameters])
    study = StudyOptions(rows=poses)
    prior, sizes = model.prior_std(tolerances), tolerances.std(model.parameters, model.model.definition)

    def fit(seed: int, watch: Stopwatch | None) -> Fit:
        truth = np.random.default_rng([seed, 3]).normal(size=parameters) * sizes
        campaign = virtual_campaign(drawing, model, truth, study, seed)
        noise = NoiseLevel.stated(study.sigma_position_m, study.sigma_rotation_rad)
        measured = MeasuredPoses.from_campaign(campaign, noise)

        def run() -> Fit:
            rows = model.at(campaign.drives)
            return identify(rows, measured, first_frames(rows, measured), prior)

        return watch.time(run) if watch else run()

    fit(0, None)  # warm-up: compiled kernels are loaded
    watch = Stopwatch(drawing.nominal_solver, drawing.kinematics.configuration(setting.poses[0]))
    taken = [fit(seed, watch).evaluations for seed in range(1, CALIBRATIONS + 1)]
    return dataclasses.replace(watch.measurement(), iterations=float(np.mean(taken)), most_iterations=max(taken))


def calibration_57_by_40(setting: Setting) -> Measurement:
    """57 parameters and both frames from 40 full poses."""
    return calibrations(setting, "geometry", 57, 40)


def calibration_100_by_1000(setting: Setting) -> Measurement:
    """100 parameters and both frames from 1,000 full poses."""
    return calibrations(setting, "all", 100, 1000)


def thermal_steady(setting: Setting) -> Measurement:
    """Steady temperatures of the whole robot, every time at a pose the network has not seen."""
    from pouring_robot.thermal.network.thermal_network import ThermalNetwork

    network = ThermalNetwork(setting.drawing)
    watch = Stopwatch(setting.drawing.nominal_solver, setting.drawing.kinematics.configuration(setting.poses[0]))
    network.steady(setting.poses[0])
    for pose in setting.poses[1 : THERMAL_POSES + 1]:
        watch.time(functools.partial(network.steady, pose))
    return watch.measurement()


def thermal_study(setting: Setting) -> Measurement:
    """The paper's study: temperatures, growth and closure of ten poses at twelve melt temperatures, one call."""
    from pouring_robot.thermal.network.thermal_network import ThermalNetwork
    from scripts.paper.thermal.study import MELTS_DEGC, POSES, draw_poses, error_sets

    watch = Stopwatch(setting.drawing.nominal_solver, setting.drawing.kinematics.configuration(setting.poses[0]))
    for seed in range(THERMAL_STUDIES):
        poses = draw_poses(setting.drawing.layout, POSES, np.random.default_rng(seed))
        # A network of its own each time: nothing is left from the study before.
        network = ThermalNetwork(setting.drawing)
        watch.time(functools.partial(error_sets, network, poses, MELTS_DEGC))
    return watch.measurement()


def compensation(setting: Setting) -> Measurement:
    """Drive values for the robot as built at 1700 °C; errors of the four freedoms against the wanted pose."""
    from pouring_robot.compensation.pose import compensate
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot

    heated = HeatedRobot(setting.actual, HeatSection(melt_degC=1700.0))
    watch = Stopwatch(setting.drawing.nominal_solver, setting.drawing.kinematics.configuration(setting.poses[0]))
    compensate(heated, setting.poses[0])
    found = [watch.time(functools.partial(compensate, heated, pose)) for pose in setting.poses[1 : THERMAL_POSES + 1]]
    errors = [(one.left.distance_m, abs(one.left_tilt_rad)) for one in found]
    steps = [one.steps for one in found]
    measured = dataclasses.replace(watch.measurement(), iterations=float(np.mean(steps)), most_iterations=max(steps))
    return with_errors(measured, errors)


BENCHMARKS: dict[str, Benchmark] = {
    "drawing-from-nominal": drawing_from_nominal,
    "drawing-from-afar": drawing_from_afar,
    "actual-from-nominal": actual_from_nominal,
    "actual-from-afar": actual_from_afar,
    "closed-form-round-trip": closed_form_round_trip,
    "drive-jacobians": drive_jacobians,
    "calibrate-57-from-40": calibration_57_by_40,
    "calibrate-100-from-1000": calibration_100_by_1000,
    "thermal-steady": thermal_steady,
    "thermal-study-10x12": thermal_study,
    "compensate-1700": compensation,
}
CLOSURES = ("drawing-from-nominal", "drawing-from-afar", "actual-from-nominal", "actual-from-afar")
TARGETS_MS: dict[str, float] = {
    **dict.fromkeys(CLOSURES, TARGET_MS),
    "calibrate-57-from-40": 200.0,
    "calibrate-100-from-1000": 3000.0,
    "thermal-steady": 20.0,
    "thermal-study-10x12": 3000.0,
}
"""What the median time of a call must not exceed."""
MOST_EVALUATIONS = {"calibrate-57-from-40": 30}
"""How many times a calibration may predict all rows."""


def table_of(measurements: dict[str, Measurement]) -> Table:
    """Return the figures for the terminal."""
    table = Table(box=None, pad_edge=False)
    for heading in ("benchmark", "calls", "median ms", "95 % ms", "× unit", "failed", "steps", "worst m", "worst rad"):
        table.add_column(heading, justify="left" if heading == "benchmark" else "right")
    for name, one in measurements.items():
        steps = "" if one.iterations is None else f"{one.iterations:.1f} (≤ {one.most_iterations})"
        worst = ["" if value is None else f"{value:.1e}" for value in (one.worst_m, one.worst_rad)]
        times = (f"{one.median_ms:.3f}", f"{one.slow_ms:.3f}", f"{one.units:.1f}")
        table.add_row(name, str(one.count), *times, str(one.failed), steps, *worst)
    return table


def misses(measurements: dict[str, Measurement]) -> list[str]:
    """Return what stays above its target, one line each."""
    found = []
    for name, one in measurements.items():
        target = TARGETS_MS.get(name)
        if target is not None and one.median_ms > target:
            found.append(f"{name}: median {one.median_ms:.3f} ms is ABOVE the target of {target} ms")
        most = MOST_EVALUATIONS.get(name)
        if most is not None and (one.most_iterations or 0) > most:
            found.append(f"{name}: {one.most_iterations} evaluations are ABOVE the target of {most}")
    return found


def figures_of(measurements: dict[str, Measurement], seed: int) -> str:
    """Return the figures as JSON, with what they were measured on."""
    figures = {
        "machine": {"python": platform.python_version(), "pinocchio": pin.__version__, "cpu": platform.machine()},
        "seed": seed,
        "targets_ms": TARGETS_MS,
        "benchmarks": {
            name: dataclasses.asdict(one) | {"median_in_units": one.units} for name, one in measurements.items()
        },
    }
    return json.dumps(figures, indent=2) + "\n"


def parser() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    known = ", ".join(BENCHMARKS)
    result = argparse.ArgumentParser(
        description="Measure how fast, how often and how exactly the loops close, and how fast robots are calibrated."
    )
    result.add_argument("names", nargs="*", metavar="NAME", help=f"benchmarks to run (default: all): {known}")
    result.add_argument("--quick", action="store_true", help=f"{QUICK_POSES} poses instead of {POSES}")
    result.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    result.add_argument("--model", type=Path, default=DEFAULT_MODEL, metavar="FILE", help="the robot as built")
    result.add_argument("--seed", type=int, default=2022, help="of the random poses")
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmarks and return the exit code: 0, or 2 for bad input."""
    options = parser().parse_args(arguments)
    unknown = [name for name in options.names if name not in BENCHMARKS]
    if unknown:
        parser().error(f"no benchmark '{unknown[0]}'; known: {', '.join(BENCHMARKS)}")
    # As wide as the table needs where there is no terminal.
    console = Console(width=None if sys.stdout.isatty() else 120)
    try:
        if options.json:
            check_writable(options.json)
        setting = make_setting(options.model, QUICK_POSES if options.quick else POSES, options.seed)
        names = options.names or list(BENCHMARKS)
        measurements = {
            name: BENCHMARKS[name](setting) for name in track(names, "measuring", console=console, transient=True)
        }
        console.print(table_of(measurements))
        units = np.median([one.unit_us for one in measurements.values()])
        console.print(f"unit: {units:.2f} µs, joint Jacobians and four anchors in Pinocchio, called from Python")
        for line in misses(measurements):
            console.print(line)
        if options.json:
            console.print(f"wrote {write_whole(options.json, figures_of(measurements, options.seed))}")
    except PouringRobotError as error:
        print(f"benchmark: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
