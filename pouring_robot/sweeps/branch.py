"""One chain alone, its joints held: the platform pose that the paper's Section 4 studies, for arrays of errors."""

import numpy as np

from pouring_robot.batch import StarStructure
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.dh.chain import inverse
from pouring_robot.sweeps.parameters import homogeneous


def open_branch_poses(
    structure: StarStructure, chain: int, joints: FloatArray, placement_errors: FloatArray, drive_errors: FloatArray
) -> FloatArray:
    """Return where one chain alone puts the moving platform, for every robot at every pose.

    Args:
        structure: the mechanism.
        chain: index of the chain.
        joints: its joint values, shape (poses, joints), in m and rad.
        placement_errors: of its sites, the seat last, shape (robots, joints + 1, 6), in m and rad.
        drive_errors: what its joints stand beside their values, shape (robots, joints).

    Returns:
        Pose of the end frame in the base frame, shape (robots, poses, 4, 4).
    """
    star, names = structure.star, structure.joint_names[chain]
    displaced = [_turned(structure, chain, k, placement_errors[:, k]) for k in range(len(names) + 1)]
    pose = np.eye(4)
    for k in range(len(names)):
        values = joints[None, :, k] + drive_errors[:, None, k]
        fixed = _matrix(star.placements[chain, k]) @ displaced[k]
        pose = pose @ fixed[:, None] @ _motion(values, revolute=bool(star.revolute[chain, k]))
    seat = _matrix(star.placements[chain, -1]) @ displaced[-1]
    return np.asarray(pose @ _matrix(star.placements[chain, -2]) @ inverse(seat)[:, None])


def _matrix(row: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = row[:9].reshape(3, 3), row[9:]
    return matrix


def _turned(structure: StarStructure, chain: int, site: int, errors: FloatArray) -> FloatArray:
    """Return displacements (n, 6) of a site as matrices, in the axes of the structure, whose joints move along z."""
    joint_count = structure.star.revolute.shape[1]
    per_chain = joint_count + 1
    at = site if site < len(structure.joint_names[chain]) else joint_count
    axes = structure.star.site_axes[chain * per_chain + at].reshape(3, 3)
    return homogeneous(np.concatenate([errors[:, :3] @ axes, errors[:, 3:] @ axes], axis=1))


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
