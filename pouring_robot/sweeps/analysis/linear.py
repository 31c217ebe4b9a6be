"""The error-transfer matrix G at the poses of a sweep."""

import numpy as np

from pouring_robot.batch import BatchCommand, CompiledEngine, engine_for
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.sweeps.plan import SweepPlan


def transfer_matrices(plan: SweepPlan, poses: BatchCommand) -> FloatArray:
    """Return G of the plan's kind and parameters at its first frame, without the errors of the sweep.

    Shape (poses, 6, parameters): displacement of the frame's origin in m, rotation vector in rad, in the axes of the
    fixed platform, per m or rad.

    Raises:
        BatchClosureError: the robot does not close at a pose.
    """
    engine = engine_for(plan.mechanism)
    wanted = [parameter.local for parameter in plan.parameters]
    rotation = poses.start.rotation
    if plan.config.kind == "open_branch":
        assert isinstance(engine, CompiledEngine)  # only a star has a DH table of its chains
        found = engine.transfer_open_branch(poses.start.joints, wanted)
    else:
        closed = engine.close(poses.drives, poses.start).require_all()
        found, rotation = engine.transfer(closed, wanted), closed.rotation
    # The engine observes the end frame; the frame's origin is carried round with it.
    lever = rotation @ plan.tool_offsets_m[0]
    matrix = found.matrix.copy()
    matrix[:, :3] += np.cross(found.matrix[:, 3:], lever[:, :, None], axis=1)
    return matrix
