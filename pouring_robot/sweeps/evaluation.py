"""Where the platform of many robots stands at many poses: every robot at every pose, with a status each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.batch import STATUS_NAMES as BATCH_STATUS_NAMES
from pouring_robot.batch import BatchCommand, StarStructure, engine_for
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.sweeps.branch import open_branch_poses

ByteArray = NDArray[np.uint8]

NOT_DONE = 255
STATUS_NAMES = dict(enumerate(("ok", *BATCH_STATUS_NAMES[1:]))) | {NOT_DONE: "not done"}


@dataclass(frozen=True, eq=False)
class Platforms:
    """Where the moving platform of every robot (first axis) stands at every pose (second axis).

    Attributes:
        position_m: in the fixed platform, shape (robots, poses, 3); NaN where the status is not 0, here and below.
        rotation: shape (robots, poses, 3, 3).
        gap_m: largest distance left open in a loop, shape (robots, poses); ``gap_rad``: largest angle.
        status: shape (robots, poses), see :data:`STATUS_NAMES`.
    """

    position_m: FloatArray
    rotation: FloatArray
    gap_m: FloatArray
    gap_rad: FloatArray
    status: ByteArray


class OpenBranch:
    """The chain that holds a robot's errors, alone, its joints held where the nominal robot has them.

    Args:
        mechanism: the robot of the drawing.
    """

    def __init__(self, mechanism: ClosedChainMechanism) -> None:
        self._structure = StarStructure.from_mechanism(mechanism)
        names = self._structure.joint_names
        self._drives = [
            next((chain, joints.index(drive)) for chain, joints in enumerate(names) if drive in joints)
            for drive in mechanism.loops.drives
        ]

    def platforms(self, commands: BatchCommand, placement_errors: FloatArray, drive_errors: FloatArray) -> Platforms:
        """Return where the chains put the platform.

        Args:
            commands: the poses.
            placement_errors: of the joints that the error map names, shape (robots, joints, 6), in m and rad.
            drive_errors: shape (robots, drives), in m and rad.
        """
        chains, joints = self._structure.star.revolute.shape
        errors = placement_errors.reshape(len(placement_errors), chains, joints + 1, 6)
        beside = np.zeros((len(errors), chains, joints))
        for drive, place in enumerate(self._drives):
            beside[:, *place] = drive_errors[:, drive]
        # Errors of one robot lie in one chain; a robot without errors is the same in any.
        own = np.argmax(errors.any(axis=(2, 3)) | beside.any(axis=2), axis=1)
        matrices = np.empty((len(errors), len(commands), 4, 4))
        for chain in np.unique(own).tolist():
            rows = own == chain
            matrices[rows] = open_branch_poses(
                self._structure, chain, commands.start.joints[:, chain], errors[rows, chain], beside[rows, chain]
            )
        none = np.zeros(matrices.shape[:2])
        return Platforms(matrices[..., :3, 3], matrices[..., :3, :3], none, none, none.astype(np.uint8))


class ClosedChains:
    """The robot with all its chains, closed by its engine.

    Args:
        mechanism: the robot.
        joints: names of the joints that placement errors displace, in their order.
        threads: that share the work; None for all there are.
    """

    def __init__(self, mechanism: ClosedChainMechanism, joints: Sequence[str], threads: int | None = None) -> None:
        """Read the mechanism; kernels are compiled at first use."""
        self.engine = engine_for(mechanism, threads)
        self._sites = [self.engine.structure.site(joint) for joint in joints]

    def platforms(self, commands: BatchCommand, placement_errors: FloatArray, drive_errors: FloatArray) -> Platforms:
        """Return where the closed chains put the platform; arguments as :meth:`OpenBranch.platforms`."""
        shape = len(placement_errors), len(commands)
        robot, pose = (index.ravel() for index in np.indices(shape))
        errors = np.zeros((shape[0], self.engine.structure.site_count, 6))
        errors[:, self._sites] = placement_errors
        flat = errors.reshape(shape[0], -1)
        closed = self.engine.close(
            commands.drives[pose] + drive_errors[robot],
            commands.start[pose],
            flat[0] if shape[0] == 1 else flat[robot],
        )
        loops = closed.residual.shape[1]  # none of a serial arm
        gaps = np.linalg.norm(closed.residual.reshape(*shape, loops, 2, 3), axis=-1).max(axis=2, initial=0.0)
        return Platforms(
            closed.position.reshape(*shape, 3),
            closed.rotation.reshape(*shape, 3, 3),
            gaps[..., 0],
            gaps[..., 1],
            closed.status.reshape(shape),
        )
