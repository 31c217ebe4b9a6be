"""A crank held by a rod between two ball joints, S-P-S: its angle is that of a triangle, and the rod spins freely."""

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.loops_file import LoopsFile
from tests.support import circle_meeting

CRANK, GROUND, STROKE = 0.5, 0.8, 0.6


def joint(name, parent, child, kind, xyz="0 0 0", axis="0 1 0"):
    limit = '<limit lower="-3" upper="3" effort="1" velocity="1"/>' if kind in {"revolute", "prismatic"} else ""
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def strut():
    """Return the mechanism: a crank about y at the origin, a rod of driven length from (GROUND, 0, 0) to its end."""
    mass = (
        '<inertial><origin xyz="0.2 0 0.01"/><mass value="2"/>'
        '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    urdf = '<robot name="strut"><link name="base"/>' + "".join(
        [
            joint("hinge", "base", "crank", "revolute").replace('"crank"/>', f'"crank">{mass}</link>', 1),
            joint("hinge_mount", "crank", "crank_end", "fixed", f"{CRANK} 0 0"),
            joint("ball1", "base", "rod", "continuous", f"{GROUND} 0 0"),
            joint("stroke", "rod", "piston", "prismatic", axis="0 0 1"),
            joint("ball2", "piston", "knob", "continuous"),
        ]
    )
    loops = LoopsFile(
        base_frame="base",
        end_frame="crank_end",
        drives=("stroke",),
        joint_types={"ball1": "spherical", "ball2": "spherical"},
        loops=({"name": "grip", "frame_a": "knob", "frame_b": "crank_end"},),
    )
    return ClosedChainMechanism(urdf + "</robot>", loops)


def crank_end(stroke):
    return circle_meeting((0.0, 0.0), CRANK, (GROUND, 0.0), stroke, side=+1)


def start_of(mechanism, spin=0.0):
    """Return a start near the closed pose: the rod spun about its own axis."""
    x, z = crank_end(STROKE)
    values = {"hinge": np.arctan2(-z, x) + 0.05, "stroke": STROKE}
    configuration = mechanism.with_joint_values(mechanism.neutral_configuration(), values)
    lean = pin.utils.rotate("y", np.arctan2(x - GROUND, z) - 0.04) @ pin.utils.rotate("z", spin)
    for name, turn in (("ball1", lean), ("ball2", lean.T @ pin.utils.rotate("y", values["hinge"]))):
        first = mechanism.shared_model.joints[mechanism.joint_id(name)].idx_q
        configuration[first : first + 4] = pin.Quaternion(turn).coeffs()
    return configuration


def strut_star():
    """Return the same with balls of three hinges each and a separate body for the crank: a star of two chains."""
    parts = [
        joint("hinge", "base", "arm", "revolute"),
        joint("hinge_tip", "arm", "arm_end", "fixed", f"{CRANK} 0 0"),
        joint("ball1_y", "base", "b1", "continuous", f"{GROUND} 0 0"),
        joint("ball1_x", "b1", "b2", "continuous", axis="1 0 0"),
        joint("ball1_z", "b2", "rod", "continuous", axis="0 0 1"),
        joint("stroke", "rod", "piston", "prismatic", axis="0 0 1"),
        joint("ball2_y", "piston", "b3", "continuous"),
        joint("ball2_x", "b3", "b4", "continuous", axis="1 0 0"),
        joint("ball2_z", "b4", "knob", "continuous", axis="0 0 1"),
        joint("mount", "knob", "crank", "fixed"),
        joint("arm_seat", "crank", "arm_side", "fixed"),
        joint("rod_seat", "crank", "rod_side", "fixed"),
    ]
    loops = LoopsFile(
        base_frame="base",
        end_frame="crank",
        cut_joints=("mount",),
        drives=("stroke",),
        loops=(
            {"name": "arm", "frame_a": "arm_end", "frame_b": "arm_side"},
            {"name": "rod", "frame_a": "knob", "frame_b": "rod_side"},
        ),
    )
    return ClosedChainMechanism(f'<robot name="strut"><link name="base"/>{"".join(parts)}</robot>', loops)
