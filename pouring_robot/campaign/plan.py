"""Pose plans: which poses to command, under which conditions; from a CSV file or at random."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.exceptions import BadInputError, CampaignError, NoSolutionError
from pouring_robot.io.quantities import read_quantities
from pouring_robot.io.temperatures import REFERENCE_DEGC
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.robot import PouringRobot

_SECONDS_A_POSE = 75.0
_MOST_POSES = 100_000
_POUR_CYCLE = 25  # poses from one filling of the ladle to the next


@dataclass(frozen=True, eq=False)
class PosePlan:
    """Poses to command and what is known of each.

    Attributes:
        poses: n poses of the moving platform in the fixed platform.
        drives: (n, 4) drive values the controller commands for them, in m and rad.
        samples: n names; "" where none.
        sessions: n sessions.
        conditions: values (n,) of each condition that is planned, by quantity name, in m, kg, s and °C.
    """

    poses: tuple[PlatformPose, ...]
    drives: FloatArray
    samples: tuple[str, ...]
    sessions: tuple[str, ...]
    conditions: dict[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.poses)


def read_plan(path: Path | str, robot: PouringRobot) -> PosePlan:
    """Read a pose plan: columns x, y, z, tilt, and any of a campaign's condition columns, units on their names.

    Without approach columns the approaches follow from the order of the poses.

    Raises:
        CampaignError: the file is wrong, or the robot cannot take a pose; names file, line and column.
    """
    table = read_quantities(
        path, columns.plan_columns(robot.model.definition), "x_mm, y_mm, z_mm, tilt_deg", CampaignError
    )
    place = np.column_stack([table.numbers[name] for name in (*columns.POSITION, "tilt")])
    poses, drives = [], []
    for row, (x, y, z, tilt) in enumerate(place.tolist()):
        if not np.isfinite(place[row]).all():
            name = (*columns.POSITION, "tilt")[int(np.argmin(np.isfinite(place[row])))]
            raise table.fault("the value is missing; a plan needs x, y, z and tilt of every pose", row, name)
        pose = PlatformPose((x, y, z), tilt)
        try:
            commanded = robot.kinematics.inverse(pose)
        except NoSolutionError as error:
            raise table.fault(str(error), row) from error
        poses.append(pose)
        drives.append(list(commanded.values()))
    conditions = {name: values for name, values in table.numbers.items() if name not in (*columns.POSITION, "tilt")}
    for name in columns.approach_names(robot.model.definition):
        values = conditions.get(name, np.empty(0))
        wrong = np.flatnonzero(np.isfinite(values) & (np.abs(values) != 1.0))
        if wrong.size:
            raise table.fault(f"an approach is +1 or -1, not {values[wrong[0]]:g}", int(wrong[0]), name)
    commanded_drives = np.array(drives)
    samples = table.labels.get("sample", tuple(str(i) for i in range(len(poses))))
    return PosePlan(
        tuple(poses),
        commanded_drives,
        samples,
        columns.sessions_of(table),
        _approaches(robot, commanded_drives) | conditions,
    )


def random_plan(robot: PouringRobot, count: int, seed: int) -> PosePlan:
    """Return poses drawn evenly from the workspace box, where the robot can go, with a plausible day's conditions.

    Conditions (load falling from pour to pour, truss somewhere on its rails, parts warming up) are drawn too,
    so that whatever in a model depends on them shows.

    Raises:
        BadInputError: the count is not between 1 and 100,000, or hardly any pose of the box is within reach.
    """
    if not 1 <= count <= _MOST_POSES:
        raise BadInputError(f"a plan has 1 to {_MOST_POSES} poses, not {count}")
    random, layout = np.random.default_rng([seed, 1]), robot.layout
    poses: list[PlatformPose] = []
    drives: list[list[float]] = []
    for _ in range(50 * count):
        x, y, z, tilt = random.uniform(*layout.box).tolist()
        pose = PlatformPose((x, y, z), tilt)
        try:
            drives.append(list(robot.kinematics.inverse(pose).values()))
        except NoSolutionError:
            continue
        poses.append(pose)
        if len(poses) == count:
            break
    if len(poses) < count:
        raise BadInputError("hardly any pose of the workspace box is within the joint limits; check the layout")
    commanded = np.array(drives)
    conditions = _approaches(robot, commanded) | _random_conditions(robot, count, random)
    return PosePlan(tuple(poses), commanded, tuple(str(i) for i in range(count)), ("1",) * count, conditions)


def _approaches(robot: PouringRobot, drives: FloatArray) -> dict[str, FloatArray]:
    """Return +1 where a drive rose to its value from the pose before, -1 where it fell; the first rose."""
    steps = np.diff(drives, axis=0, prepend=drives[:1] - 1.0)
    names = columns.approach_names(robot.model.definition)
    return {name: np.where(steps[:, k] >= 0.0, 1.0, -1.0) for k, name in enumerate(names)}


def _random_conditions(robot: PouringRobot, count: int, random: np.random.Generator) -> dict[str, FloatArray]:
    ladle, numbers = robot.layout.ladle, np.arange(count)
    time = np.round(np.cumsum(random.uniform(0.8, 1.2, count) * _SECONDS_A_POSE), 1)
    filled = 1.0 - (numbers % _POUR_CYCLE) / _POUR_CYCLE
    conditions = {
        "time": time,
        "payload": np.round(ladle.payload_kg * filled, 1),
        "truss_travel": np.round(random.uniform(0.0, robot.layout.truss_span_m, count), 4),
        "melt": np.full(count, round(float(random.uniform(1400.0, 1700.0)), 1)),
        "ambient": np.round(REFERENCE_DEGC + 4.0 * np.sin(time / 9000.0) + random.normal(0.0, 0.1, count), 2),
    }
    for name in (part for part in robot.model.definition.thermometers if part not in conditions):
        # A part warms towards its own temperature within an hour, and its sensor is read to 0.01 K.
        warm, lag = random.uniform(40.0, 160.0), random.uniform(1800.0, 5400.0)
        course = 20.0 + warm * (1.0 - np.exp(-time / lag)) + random.normal(0.0, 0.3, count)
        conditions[name] = np.round(course, 2)
    return conditions
