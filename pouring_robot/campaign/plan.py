"""Pose plans: what to command, and under which conditions; from a CSV file or at random."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.exceptions import BadInputError, CampaignError, NoSolutionError, counted
from pouring_robot.io.argument_checks import expect, whole
from pouring_robot.io.quantity_columns import Quantity, read_quantities
from pouring_robot.io.seeds import Stream, generator
from pouring_robot.io.temperatures import AMBIENT_DEGC
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.command import command_box
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import LOADED, Command, Robot

_SECONDS_A_POSE = 75.0
_MOST_POSES = 100_000
_POUR_CYCLE = 25  # poses from one filling of the ladle to the next


@dataclass(frozen=True, eq=False)
class PosePlan:
    """Commands and conditions of each of n poses."""

    poses: tuple[Command, ...]  # poses of the pouring robot's platform, drive values of another robot
    drives: FloatArray  # the drives commanded for them, (n, drives), in m and rad
    samples: tuple[str, ...]  # their names; "" where none
    sessions: tuple[str, ...]
    # values (n,) of each planned condition, by quantity name, in m, kg, s and °C
    conditions: dict[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.poses)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {counted(len(self), 'pose')}, {', '.join(self.conditions) or 'no conditions'}>"

    @property
    def rows(self) -> FloatArray:
        """The commands as numbers, (n, k), in m and rad."""
        return np.array([p.values if isinstance(p, PlatformPose) else p for p in self.poses])

    def given(self, robot: RobotDefinition) -> dict[str, FloatArray | tuple[str, ...]]:
        """Return the conditions by heading in internal units, and the sessions where there are several."""
        numbers = {q.canonical: self.conditions.get(q.name) for q in robot.condition_columns}
        sessions = {"session": self.sessions} if len(set(self.sessions)) > 1 else {}
        return {heading: values for heading, values in numbers.items() if values is not None} | sessions


def read_plan(path: Path | str, robot: Robot) -> PosePlan:
    """Read a plan: what to command, and any of a campaign's condition columns, units on their names.

    Without approach columns the approaches follow from the order of the poses.

    Raises:
        CampaignError: the file is wrong, or the robot cannot take a pose; names file, line and column.
        BadInputError: there is no robot.
    """
    expect(robot, Robot, LOADED)
    definition = robot.model.definition
    axes = robot.command_axes
    wanted = [axis.quantity for axis in axes]
    known = (Quantity("sample", "label"), *wanted, *definition.condition_columns)
    example = ", ".join(axis.heading for axis in axes)
    table = read_quantities(path, known, example, CampaignError)
    values = np.stack([a.values(table.numbers[a.quantity.name]) for a in axes], axis=-1)
    if not np.isfinite(values).all():
        row, column = (int(k[0]) for k in np.nonzero(~np.isfinite(values)))
        names = ", ".join(quantity.name for quantity in wanted)
        raise table.fault(f"the value is missing; a plan needs {names} for every pose", row, wanted[column].name)
    commands = robot.drawing.commands(values)
    for row in np.flatnonzero(~robot.drawing.in_reach(commands.start)).tolist():
        try:
            robot.location_of(robot.command_at(values[row]))
        except NoSolutionError as error:
            raise table.fault(str(error), row) from error
    conditions = {name: v for name, v in table.numbers.items() if name not in {quantity.name for quantity in wanted}}
    for name in columns.approach_names(definition):
        sides = conditions.get(name, np.empty(0))
        wrong = np.flatnonzero(np.isfinite(sides) & (np.abs(sides) != 1.0))
        if wrong.size:
            raise table.fault(f"an approach is +1 or -1, not {sides[wrong[0]]:g}", int(wrong[0]), name)
    samples = table.labels.get("sample", tuple(str(i) for i in range(len(values))))
    return plan_of(robot, values, commands.drives, samples, columns.sessions_of(table), conditions)


def plan_of(
    robot: Robot,
    commands: FloatArray,
    drives: FloatArray,
    samples: tuple[str, ...],
    sessions: tuple[str, ...],
    conditions: dict[str, FloatArray],
) -> PosePlan:
    """Return a plan of commands (n, k) and their drives (n, drives), in m and rad.

    Approaches that are not among the conditions follow from the order.
    """
    poses = tuple(robot.command_at(row) for row in commands)
    return PosePlan(poses, drives, samples, sessions, approaches(robot.model.definition, drives) | conditions)


def refuse_redundant(robot: Robot) -> None:
    """Raise BadInputError for a robot whose drives cannot be commanded one by one."""
    if robot.model.definition.loops.redundant_drives:
        raise BadInputError(
            f"{robot.model.definition.name} has redundant drives, and commands chosen independently would "
            "contradict each other by far more than errors do; use a copy of its robot file without redundant_drives, "
            "with as many drives as freedoms"
        )


def random_plan(robot: Robot, count: int, seed: int) -> PosePlan:
    """Return commands drawn uniformly among reachable poses, with the conditions of a plausible day.

    They are drawn from the workspace box, or between the drives' limits. Conditions (parts that warm up; for the
    pouring robot also a load that decreases from pour to pour, and a truss at random places on its rails) are drawn,
    too, so that every effect in a model that depends on them shows.

    Raises:
        BadInputError: there is no robot, its drives are redundant, the count is not between 1 and 100,000, the seed is
            negative, or hardly any pose is in reach.
    """
    expect(robot, Robot, LOADED)
    refuse_redundant(robot)
    count = whole(count, 1, f"a plan has 1 to {_MOST_POSES} poses", _MOST_POSES)
    seed = whole(seed, 0, "the seed of a plan is a whole number from 0 on")
    random, (lower, upper) = generator(seed, Stream.PLAN), command_box(robot.command_axes)
    poses: list[Command] = []
    drives: list[FloatArray] = []
    for _ in range(50 * count):
        values = random.uniform(lower, upper)
        found = robot.drawing.commands(values[None])
        if robot.drawing.in_reach(found.start).all():
            drives.append(found.drives[0])
            poses.append(robot.command_at(values))
        if len(poses) == count:
            break
    if len(poses) < count:
        raise BadInputError("hardly any pose of the workspace is within the joint limits; check the layout or the URDF")
    commanded = np.array(drives)
    conditions = approaches(robot.model.definition, commanded) | _random_conditions(robot, count, random)
    return PosePlan(tuple(poses), commanded, tuple(str(i) for i in range(count)), ("1",) * count, conditions)


def approaches(robot: RobotDefinition, drives: FloatArray) -> dict[str, FloatArray]:
    """Return the side that each drive comes from, (n,) by the column's name: by the row before; in the first, +1."""
    sides = zip(robot.drives, columns.from_the_row_before(drives).T, strict=True)
    return {drive.approach_column: np.where(np.isnan(side), 1.0, drive.side(side)) for drive, side in sides}


def _random_conditions(robot: Robot, count: int, random: np.random.Generator) -> dict[str, FloatArray]:
    time = np.round(np.cumsum(random.uniform(0.8, 1.2, count) * _SECONDS_A_POSE), 1).astype(float)
    conditions = {"time": time}
    if isinstance(robot, PouringRobot):
        filled = 1.0 - (np.arange(count) % _POUR_CYCLE) / _POUR_CYCLE
        conditions |= {
            "payload": np.round(robot.layout.ladle.payload.value * filled, 1),
            "truss_travel": np.round(random.uniform(0.0, robot.layout.truss.span.metres, count), 4),
            "melt": np.full(count, round(float(random.uniform(1400.0, 1700.0)), 1)),
        }
    hall = AMBIENT_DEGC + 4.0 * np.sin(time / 9000.0) + random.normal(0.0, 0.1, count)
    conditions["ambient"] = np.round(hall, 2)
    for name in (part for part in robot.model.definition.expected_thermometers if part not in conditions):
        # A part warms towards its own temperature within an hour, and its sensor is read to 0.01 K.
        warm, lag = random.uniform(40.0, 160.0), random.uniform(1800.0, 5400.0)
        course = AMBIENT_DEGC + warm * (1.0 - np.exp(-time / lag)) + random.normal(0.0, 0.3, count)
        conditions[name] = np.round(course, 2)
    return conditions
