"""Conditions that hold everything an effect may need: to list what the library offers."""

from dataclasses import replace

import numpy as np

from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.robot.description.definition import RobotDefinition


def bare_conditions(robot: RobotDefinition, rows: int = 3) -> Conditions:
    """Return plausible conditions of a few rows in one session that hold nothing but drives and measured poses."""
    one, course = np.ones(rows), np.linspace(0.0, 1.0, rows)
    middle = np.array([0.55 if drive.unit == "m" else 0.0 for drive in robot.drives])
    return Conditions(
        robot=robot,
        drives=middle + 0.1 * course[:, None],
        position_m=np.column_stack([-0.1 * one, 0.02 * course, -0.6 - 0.1 * course]),
        rotation=np.tile(np.eye(3), (rows, 1, 1)),
        session=np.zeros(rows, dtype=np.intp),
        time_s=3600.0 * course,
        time_known=True,
        swing_rad=0.1 * np.ones((rows, len(middle))),
    )


def complete_conditions(robot: RobotDefinition, rows: int = 3) -> Conditions:
    """Return the same with nothing missing but several sessions; figures of no machine."""
    bare = bare_conditions(robot, rows)
    joints = robot.drawing().engine.structure.placed_joints
    members = [member for kind in causes_of(robot).thermometers if kind.expected for member in kind.members]
    return replace(
        bare,
        approach=np.ones_like(bare.drives),
        weight_n=np.full(rows, 5000.0),
        drive_force=np.full_like(bare.drives, 1000.0),
        joint_moments={f"{joint}.r{axis}": np.full(rows, 500.0) for joint in joints for axis in "xyz"},
        slides_m=dict.fromkeys(joints, np.linspace(0.0, 0.5, rows)),
        rises=dict.fromkeys(members, np.full(rows, 50.0)),
        travels=dict.fromkeys(robot.travels, np.linspace(0.0, 3.0, rows)),
        screw_pitch_m=0.01,
        truss_span_m=6.0,
    )
