"""The slow reference: every robot built as URDF, every pose closed by the one-at-a-time solver."""

import numpy as np

from pouring_robot.exceptions import ClosureError
from pouring_robot.mechanism.closure.solver import ClosureSolver
from tests.support import perturbed, placement_error


class OneAtATime:
    """An evaluator for the drawing."""

    def __init__(self, mechanism, joints):
        self.mechanism, self.joints = mechanism, joints

    def solver(self, errors):
        placements = {joint: placement_error(row) for joint, row in zip(self.joints, errors, strict=True) if row.any()}
        return ClosureSolver(perturbed(self.mechanism, placements))

    def platforms(self, poses, placement_errors, drive_errors):
        """Return position, rotation, largest gap in m and rad, and status of every robot at every pose."""
        shape = (len(placement_errors), len(poses))
        position, rotation = np.full((*shape, 3), np.nan), np.full((*shape, 3, 3), np.nan)
        gaps, turns, status = np.full(shape, np.nan), np.full(shape, np.nan), np.ones(shape, np.uint8)
        names = [joint for joint in self.joints if not joint.endswith("mount")]
        for s in range(shape[0]):
            solver = self.solver(placement_errors[s])
            loops = self.mechanism.loops
            neutral = self.mechanism.neutral_configuration()
            for p in range(shape[1]):
                start = solver.mechanism.with_joint_values(
                    neutral, dict(zip(names, poses.start.joints[p].ravel().tolist(), strict=True))
                )
                drives = dict(zip(loops.drives, (poses.drives[p] + drive_errors[s]).tolist(), strict=True))
                try:
                    result = solver.solve(drives, start)
                except ClosureError:
                    continue
                pose = result.pose_base_to_end
                position[s, p], rotation[s, p] = pose.translation, pose.rotation
                gaps[s, p], turns[s, p], status[s, p] = result.gap_m, result.gap_rad, 0
        return position, rotation, gaps, turns, status
