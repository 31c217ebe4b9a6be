"""Where the platform of many robots stands at many poses: every robot at every pose, with a status each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.batch import STATUS_NAMES as BATCH_STATUS_NAMES
from pouring_robot.batch import BatchCommand, StarStructure, engine_for
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.robot.dh.chain import inverse
from pouring_robot.sweeps.parameters import homogeneous

ByteArray = NDArray[np.uint8]

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


class OpenBranch:
    """The chain that holds a robot's errors, alone, its joints held where the nominal robot has them.

    The platform pose that the paper's Section 4 studies, for arrays of errors.
    """

    def __init__(self, mechanism: ClosedChainMechanism) -> None:
        self._structure = StarStructure.from_mechanism(mechanism)
        names = self._structure.joint_names
        self._drives = [
            next((chain, joints.index(drive)) for chain, joints in enumerate(names) if drive in joints)
            for drive in mechanism.loops.drives
        ]

    def platforms(self, commands: BatchCommand, placement_errors: FloatArray, drive_errors: FloatArray) -> Platforms:
        """Return where the chains put the platform at the commanded poses, in m and rad.

        Placement errors are of the joints that the error map names, (robots, joints, 6), drive errors (robots, drives).
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
            rows, held = own == chain, commands.start.joints[:, chain]
            matrices[rows] = self._poses(chain, held, errors[rows, chain], beside[rows, chain])
        none = np.zeros(matrices.shape[:2])
        return Platforms(matrices[..., :3, 3], matrices[..., :3, :3], none, none, none.astype(np.uint8))

    def _poses(
        self, chain: int, joints: FloatArray, placement_errors: FloatArray, drive_errors: FloatArray
    ) -> FloatArray:
        """Return the platforms of one chain, (robots, poses, 4, 4).

        Joints are (poses, joints); errors of its sites, the seat last, (robots, joints + 1, 6), and what its joints
        stand beside their values, (robots, joints).
        """
        star, sites = self._structure.star, self._structure.star.revolute.shape[1] + 1
        names = self._structure.joint_names[chain]

        def displaced(site: int) -> FloatArray:
            """Return a site's displaced placement, (robots, 4, 4); joints of the structure move along z."""
            axes = star.site_axes[chain * sites + (site if site >= 0 else sites - 1)].reshape(3, 3)
            turned = placement_errors[:, site if site >= 0 else len(names)].reshape(-1, 2, 3) @ axes
            return np.asarray(_matrix(star.placements[chain, site]) @ homogeneous(turned.reshape(-1, 6)))

        pose = np.eye(4)
        for k in range(len(names)):
            motion = _motion(joints[None, :, k] + drive_errors[:, None, k], revolute=bool(star.revolute[chain, k]))
            pose = pose @ displaced(k)[:, None] @ motion
        return np.asarray(pose @ _matrix(star.placements[chain, -2]) @ inverse(displaced(-1))[:, None])


def _matrix(row: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = row[:9].reshape(3, 3), row[9:]
    return matrix


def _motion(values: FloatArray, *, revolute: bool) -> FloatArray:
    """Return the motion about or along z for joint values of any shape; adds two axes of 4."""
    matrix = np.zeros((*values.shape, 4, 4))
    matrix[..., range(4), range(4)] = 1.0
    if revolute:
        cosine, sine = np.cos(values), np.sin(values)
        matrix[..., 0, 0], matrix[..., 1, 1] = cosine, cosine
        matrix[..., 0, 1], matrix[..., 1, 0] = -sine, sine
    else:
        matrix[..., 2, 3] = values
    return matrix


class ClosedChains:
    """The robot with all its chains, closed by its engine; ``joints`` are those that placement errors displace."""

    def __init__(self, mechanism: ClosedChainMechanism, joints: Sequence[str], threads: int | None = None) -> None:
        self.engine = engine_for(mechanism, threads)
        self._sites = [self.engine.structure.site(joint) for joint in joints]

    def platforms(self, commands: BatchCommand, placement_errors: FloatArray, drive_errors: FloatArray) -> Platforms:
        """Return where the closed chains put the platform; arguments as :meth:`OpenBranch.platforms`."""
        shape = len(placement_errors), len(commands)
        robot, pose = (index.ravel() for index in np.indices(shape))
        errors = np.zeros((shape[0], self.engine.structure.site_count, 6))
        errors[:, self._sites] = placement_errors
        flat = errors.reshape(shape[0], -1)
        of_all = flat[0] if shape[0] == 1 else flat[robot]
        closed = self.engine.close(commands.drives[pose] + drive_errors[robot], commands.start[pose], of_all)
        loops = closed.residual.shape[1]  # none of a serial arm
        gaps = np.linalg.norm(closed.residual.reshape(*shape, loops, 2, 3), axis=-1).max(axis=2, initial=0.0)
        position, rotation = closed.position.reshape(*shape, 3), closed.rotation.reshape(*shape, 3, 3)
        return Platforms(position, rotation, gaps[..., 0], gaps[..., 1], closed.status.reshape(shape))
