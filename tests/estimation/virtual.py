"""Virtual data with known errors, and an independent regressor by differences of ClosureSolver."""

import functools

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.plan import random_plan
from pouring_robot.estimation.frames.outer import FRAMES, OuterFrames
from pouring_robot.estimation.measurement import MeasurementModel, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.local_parameters import DriveParameter
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import all_parameters
from pouring_robot.robot.tolerances import Tolerances
from tests.support import perturbed, placement_error

SIGMA = 3e-5
OUTER = pin.SE3(pin.exp3(np.array([0.4, -1.1, 2.0])), np.array([1.5, -2.0, 0.7]))
INNER = pin.SE3(pin.exp3(np.array([-0.7, 0.3, 0.9])), np.array([0.11, 0.04, -0.06]))
TRUE_FRAMES = OuterFrames(OUTER, INNER)


def groups_of(drawing, *wanted):
    return drawing.parameters.groups(wanted)


def model_of(drawing, *wanted, model=None, most=None):
    parameters = all_parameters(groups_of(drawing, *wanted))[:most]
    return MeasurementModel(model or RobotModel(), parameters, threads=1)


class Virtual:
    """Rows measured on a robot with known parameter values."""

    def __init__(self, drawing, model, count, seed=0, scale=1.0, sigma=SIGMA):
        random = np.random.default_rng(seed)
        self.model, self.prior = model, model.prior_std(Tolerances.load())
        self.truth = random.normal(size=len(model.parameters)) * self.prior[FRAMES:] * scale
        self.rows = model.at(random_plan(drawing, count, seed + 1).drives)
        zero = Unknowns.zero(TRUE_FRAMES, len(self.truth))
        self.unknowns = zero.at(np.r_[np.zeros(FRAMES), self.truth])
        seen = self.rows.predict(self.unknowns)
        position = seen.position_m + random.normal(size=(count, 3)) * sigma
        turns = random.normal(size=(count, 3)) * sigma
        rotation = np.array([pin.exp3(turn) @ axes for turn, axes in zip(turns, seen.rotation, strict=True)])
        self.measured = MeasuredPoses(position, rotation, sigma, sigma)


def reference_poses(model, parameters, values, drives, start):
    """Close the loops one at a time, without the batch engine: poses of the platform in the fixed platform."""
    errors, offsets = {}, {}
    for parameter, value in zip(parameters, values, strict=True):
        if isinstance(parameter, DriveParameter):
            offsets[parameter.joint] = offsets.get(parameter.joint, 0.0) + value
        else:
            errors[parameter.joint] = errors.get(parameter.joint, np.zeros(6)) + value * np.array(parameter.twist)
    mechanism = perturbed(model.mechanism(), {joint: placement_error(e) for joint, e in errors.items()})
    solver = ClosureSolver(mechanism)
    poses = []
    for row, configuration in zip(drives, start, strict=True):
        names = mechanism.loops.drives
        commanded = {n: float(v) + offsets.get(n, 0.0) for n, v in zip(names, row, strict=True)}
        poses.append(solver.solve(commanded, configuration).pose_base_to_end)
    return poses


def measured_poses(poses, outer, inner):
    """Return what the tracker sees, as homogeneous matrices."""
    return np.array([(outer * pose * inner).homogeneous for pose in poses])


def reference_regressor(drawing, model, parameters, drives, step=1e-4):
    """Return the derivative of position and rotation by frames and parameters: fourth-order central differences."""
    forward = drawing.kinematics.forward
    names = model.definition.loops.drives
    poses = [forward(dict(zip(names, map(float, row), strict=True))) for row in drives]
    start = [drawing.kinematics.configuration(pose) for pose in poses]

    @functools.cache  # frames alone move no robot
    def platform(*values):
        return reference_poses(model, parameters, values, drives, start)

    def seen(values):
        base, tool = (pin.SE3(pin.exp3(part[3:]), np.array(part[:3])) for part in (values[:6], values[6:FRAMES]))
        return measured_poses(platform(*values[FRAMES:].tolist()), OUTER * base, tool * INNER)

    def change(values):
        plus, minus = seen(values), seen(-values)
        turned = plus[:, :3, :3] @ np.swapaxes(minus[:, :3, :3], 1, 2)
        turn = np.array([pin.log3(r) for r in turned])
        return np.concatenate([plus[:, :3, 3] - minus[:, :3, 3], turn], axis=1).ravel()

    columns = []
    for k in range(FRAMES + len(parameters)):
        values = np.zeros(FRAMES + len(parameters))
        values[k] = step
        columns.append((8.0 * change(values) - change(2.0 * values)) / (12.0 * step))
    return np.array(columns).T
