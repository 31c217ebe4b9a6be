"""The poses of a sweep: a grid, draws from a box, or a list, all within the robot's reach."""

from __future__ import annotations

import numpy as np

from pouring_robot.batch import BatchCommand
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pose_table import read_poses
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.layout import Layout
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.sweeps.config import Box, Grid, Poses, RandomBox, SweepConfig


def sweep_commands(config: SweepConfig, layout: Layout, kinematics: FourUPUKinematics) -> BatchCommand:
    """Return the poses of a sweep, with the drive values that the controller commands there.

    Raises:
        TableError: the file of poses is wrong.
        UnreachablePoseError: a joint would pass its limits at one of the poses.
    """
    commands = kinematics.commands(_wanted(config, config.poses, layout))
    beyond = ~kinematics.within_limits(commands.start.joints)
    if beyond.any():
        x, y, z, tilt = (float(value) for value in commands.poses[int(np.argmax(beyond))])
        kinematics.inverse(PlatformPose((x, y, z), tilt))  # raises, and names the joint
    return commands


def _wanted(config: SweepConfig, choice: Poses, layout: Layout) -> FloatArray:
    """Return x, y, z in m and the tilt in rad, shape (n, 4)."""
    if choice.grid is not None:
        return _grid(choice.grid, _limits(choice.grid.box, layout))
    if choice.random is not None:
        return _drawn(choice.random, _limits(choice.random.box, layout))
    listed = read_poses(config.beside(str(choice.file)))
    return np.array([(*pose.position_m, pose.tilt_rad) for pose in listed])


def _limits(box: Box, layout: Layout) -> FloatArray:
    """Return lower and upper limits of x, y, z and tilt, shape (2, 4), in m and rad."""
    limits = np.array(layout.box)
    for k, pair in enumerate(box.limits_si()):
        if pair is not None:
            limits[:, k] = pair
    return limits


def _grid(grid: Grid, limits: FloatArray) -> FloatArray:
    axes = [
        np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])
        for low, high, count in zip(*limits, (grid.x, grid.y, grid.z, grid.tilt), strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)


def _drawn(random: RandomBox, limits: FloatArray) -> FloatArray:
    # A spawn key of its own keeps poses and errors apart when both carry the same seed.
    generator = np.random.default_rng(np.random.SeedSequence(random.seed, spawn_key=(1, 0)))
    return generator.uniform(limits[0], limits[1], size=(random.count, 4))
