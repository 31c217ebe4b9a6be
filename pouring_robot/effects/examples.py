"""Conditions that hold everything an effect may need: to list what the library offers."""

from dataclasses import replace

import numpy as np

from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.robot_causes import causes_of
from pouring_robot.robot.description.definition import RobotDefinition


def complete_conditions(robot: RobotDefinition, rows: int = 3) -> Conditions:
    """Return plausible conditions of a few rows in one session, nothing else missing; figures of no machine."""
    one = np.ones(rows)
    course = np.linspace(0.0, 1.0, rows)
    count = len(robot.drives)
    middle = np.array([0.55 if drive.unit == "m" else 0.0 for drive in robot.drives])
    members = [member for kind in causes_of(robot).thermometers if kind.expected for member in kind.members]
    return Conditions(
        robot=robot,
        drives=middle + 0.1 * course[:, None],
        position_m=np.column_stack([-0.1 * one, 0.02 * course, -0.6 - 0.1 * course]),
        rotation=np.tile(np.eye(3), (rows, 1, 1)),
        session=np.zeros(rows, dtype=np.intp),
        time_s=3600.0 * course,
        time_known=True,
        swing_rad=0.1 * np.ones((rows, count)),
        approach=np.ones((rows, count)),
        weight_n=5000.0 * one,
        drive_force=1000.0 * np.ones((rows, count)),
        rises=dict.fromkeys(members, 50.0 * one),
        travels=dict.fromkeys(robot.travels, 3.0 * course),
        screw_pitch_m=0.01,
        truss_span_m=6.0,
    )


def bare_conditions(robot: RobotDefinition) -> Conditions:
    """Return the same for a campaign that holds nothing but drives and measured poses."""
    return replace(
        complete_conditions(robot),
        approach=None,
        weight_n=None,
        drive_force=None,
        rises={},
        travels={},
        screw_pitch_m=None,
        truss_span_m=None,
    )
