"""Where the platform of many robots stands at many poses: every robot at every pose, with a status each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.batch import STATUS_NAMES as BATCH_STATUS_NAMES
from pouring_robot.batch import BatchCommand, CompiledEngine, Engine
from pouring_robot.batch.structure import ByteArray, IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray

NOT_DONE = 255
STATUS_NAMES = dict(enumerate(("ok", *BATCH_STATUS_NAMES[1:]))) | {NOT_DONE: "not done"}


@dataclass(frozen=True, eq=False)
class Platforms:
    """Where the moving platform of every robot (first axis) stands at every pose (second axis)."""

    # in the fixed platform, shape (robots, poses, 3); NaN where the status is not 0, here and below
    position_m: FloatArray
    rotation: FloatArray  # shape (robots, poses, 3, 3)
    gap_m: FloatArray  # largest distance left open in a loop, shape (robots, poses)
    gap_rad: FloatArray  # largest angle
    status: ByteArray  # shape (robots, poses), see :data:`STATUS_NAMES`


def platforms(
    engine: Engine,
    commands: BatchCommand,
    joints: Sequence[str],
    placement_errors: FloatArray,
    drive_errors: FloatArray,
    *,
    open_branch: bool,
) -> Platforms:
    """Return where robots with errors, closed by an engine, put the platform at commanded poses, in m and rad.

    Placement errors, (robots, joints, 6), displace ``joints``; drive errors are (robots, drives). An ``open_branch`` is
    the chain alone that holds a robot's errors, its joints held where the nominal robot has them: what the paper's
    Section 4 studies.
    """
    shape = len(placement_errors), len(commands)
    robot, pose = (index.ravel() for index in np.indices(shape))
    errors = np.zeros((shape[0], engine.structure.site_count, 6))
    errors[:, [engine.structure.site(joint) for joint in joints]] = placement_errors
    flat = errors.reshape(shape[0], -1)
    of_all = flat[0] if shape[0] == 1 else flat[robot]
    drives, start = commands.drives[pose] + drive_errors[robot], commands.start[pose]
    if open_branch:
        assert isinstance(engine, CompiledEngine)  # only a star has a DH table of its chains
        chain = _own_chains(engine.structure.star, flat, drive_errors)
        closed = engine.carry(chain[robot], drives, start, of_all)
    else:
        closed = engine.close(drives, start, of_all)
    loops = closed.residual.shape[1]  # none of a serial arm
    gaps = np.linalg.norm(closed.residual.reshape(*shape, loops, 2, 3), axis=-1).max(axis=2, initial=0.0)
    position, rotation = closed.position.reshape(*shape, 3), closed.rotation.reshape(*shape, 3, 3)
    return Platforms(position, rotation, gaps[..., 0], gaps[..., 1], closed.status.reshape(shape))


def _own_chains(star: Star, errors: FloatArray, drive_errors: FloatArray) -> IntArray:
    """Return the chain in which each robot's errors lie, (robots,); a robot without errors is the same in any."""
    own = np.array(errors.reshape(len(errors), len(star.revolute), -1).any(axis=2))
    for drive, chain in enumerate(star.drives[:, 0]):
        own[:, chain] |= drive_errors[:, drive] != 0.0
    return np.asarray(own.argmax(axis=1))
