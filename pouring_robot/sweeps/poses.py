"""What a sweep commands: a grid, draws, or a list, all within the robot's reach."""

import numpy as np

from pouring_robot.batch import BatchCommand
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.command import command_box
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drawing import Drawing
from pouring_robot.robot.pose_table import read_command_lines, read_poses
from pouring_robot.robot.pouring.definition import PouringDefinition
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.layout import Layout, load_layout
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.sweeps.config import Box, RandomBox, SweepConfig

_MOST_ROUNDS = 20


def sweep_commands(config: SweepConfig, robot: RobotDefinition, drawing: Drawing) -> BatchCommand:
    """Return the commands of a sweep, with their drive values and the drawing's closed poses.

    Raises:
        TableError: the file of poses is wrong.
        UnreachablePoseError: a joint would pass its limits at one of the poses.
    """
    if isinstance(robot, PouringDefinition) and isinstance(drawing, FourUPUKinematics):
        commands = drawing.commands(_wanted(config, load_layout(robot.layout, robot.layouts_file)))
        beyond = ~drawing.within_limits(commands.start.joints)
        if beyond.any():
            x, y, z, tilt = (float(value) for value in commands.poses[int(np.argmax(beyond))])
            drawing.inverse(PlatformPose((x, y, z), tilt))  # raises, and names the joint
        return commands
    return _driven(config, robot, drawing)


def _driven(config: SweepConfig, robot: RobotDefinition, drawing: Drawing) -> BatchCommand:
    """Return drive values of a file, or drawn evenly between the drives' limits where the robot closes."""
    choice = config.poses
    if choice.grid is not None or (choice.random is not None and choice.random.box != Box()):
        raise config.problem("grid and box are of the pouring robot; give random: {count, seed}, or a file of drives")
    if choice.random is None:
        listed = read_command_lines(config.beside(str(choice.file)), robot)
        if not all(isinstance(command, np.ndarray) for command in listed.values()):
            raise config.problem("poses.file: give a column for each drive")
        drives = np.array(list(listed.values()))
        start = drawing.starts(drives)
        lost = ~(np.isfinite(start.position).all(axis=1) & drawing.in_reach(start))
        if lost.any():
            line = list(listed)[int(np.argmax(lost))]
            raise config.problem(f"poses.file: line {line}: the robot does not close there, or beyond a joint's limits")
        return BatchCommand(drives, drives, start)
    generator, count = _generator(choice.random), choice.random.count
    box = command_box(robot.command_axes(drawing.mechanism))
    found = np.empty((0, box[0].size))
    for _ in range(_MOST_ROUNDS):
        drawn = generator.uniform(*box, size=(count, box[0].size))
        start = drawing.starts(drawn)
        found = np.concatenate([found, drawn[np.isfinite(start.position).all(axis=1) & drawing.in_reach(start)]])
        if len(found) >= count:
            return BatchCommand(found[:count], found[:count], drawing.starts(found[:count]))
    raise config.problem("hardly any drive values close within the joint limits; give poses.file")


def _wanted(config: SweepConfig, layout: Layout) -> FloatArray:
    """Return x, y, z in m and the tilt in rad, shape (n, 4)."""
    grid, random = config.poses.grid, config.poses.random
    if grid is not None:
        limits, counts = _limits(grid.box, layout), (grid.x, grid.y, grid.z, grid.tilt)
        axes = [
            np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])
            for low, high, count in zip(*limits, counts, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    if random is not None:
        lower, upper = _limits(random.box, layout)
        return _generator(random).uniform(lower, upper, size=(random.count, 4))
    listed = read_poses(config.beside(str(config.poses.file)))
    return np.array([(*pose.position_m, pose.tilt_rad) for pose in listed])


def _generator(random: RandomBox) -> np.random.Generator:
    # A spawn key of its own keeps poses and errors apart when both carry the same seed.
    return np.random.default_rng(np.random.SeedSequence(random.seed, spawn_key=(1, 0)))


def _limits(box: Box, layout: Layout) -> FloatArray:
    """Return lower and upper limits of x, y, z and tilt, shape (2, 4), in m and rad."""
    limits = np.array(layout.box)
    for k, pair in enumerate(box.limits_si()):
        if pair is not None:
            limits[:, k] = pair
    return limits
