"""Shared tools of tests: random poses and models, central differences, small foreign mechanisms."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.robot.description.urdf import perturb_urdf
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.pouring.layout import render_urdf
from pouring_robot.robot.pouring.platform_pose import PlatformPose

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "tests" / "data"
# Measured data and blind campaigns that are not part of the repository; CI has them beside the clone.
SHARED = ROOT.parent / "shared"
ACTUAL = ROOT / "examples" / "actual.yaml"
LEARNED = ROOT / "examples" / "learned.yaml"
CHAINS = (1, 2, 3, 4)

# The workspace box, written down a second time on purpose.
BOX_LOWER = np.array([-0.150, -0.050, -0.825, -0.4884])
BOX_UPPER = np.array([-0.050, 0.050, -0.425, 1.08155])


def gantry_file(folder, lead=None):
    """Write the robot file of three slides at right angles, of different strokes, and its URDF; return its path.

    With a lead, in m a turn, they are driven by nuts on screws.
    """
    joints, links = "", '<link name="base"/>'
    for parent, child, axis, stroke in (
        ("base", "x", "1 0 0", 2.1),
        ("x", "y", "0 1 0", 1.5),
        ("y", "z", "0 0 1", 0.8),
    ):
        links += f'<link name="{child}"/>'
        joints += f'<joint name="{child}_slide" type="prismatic"><parent link="{parent}"/><child link="{child}"/>'
        joints += f'<axis xyz="{axis}"/><limit lower="0" upper="{stroke}" effort="1" velocity="1"/>'
        if lead is not None:
            links += f'<link name="{child}_nut"/>'
            joints += f'<mimic joint="{child}_turn" multiplier="{lead / (2.0 * np.pi)!r}"/></joint>'
            joints += f'<joint name="{child}_turn" type="revolute"><parent link="{parent}"/><child link="{child}_nut"/>'
            turns = 2.0 * np.pi * stroke / lead
            joints += f'<axis xyz="{axis}"/><limit lower="0" upper="{turns!r}" effort="1" velocity="1"/>'
        joints += "</joint>"
    (folder / "gantry.urdf").write_text(f'<robot name="gantry">{links}{joints}</robot>', encoding="utf-8")
    text = "format: pouring_robot/robot/1\nname: gantry\nurdf: gantry.urdf\nbase_frame: base\nend_frame: z\n"
    drives = ", ".join(f"{{joint: {axis}_{'turn' if lead else 'slide'}}}" for axis in "xyz")
    (folder / "robot.yaml").write_text(f"{text}drives: [{drives}]\n", encoding="utf-8")
    return folder / "robot.yaml"


def random_poses(count, seed):
    """Return poses spread evenly over the workspace box."""
    numbers = np.random.default_rng(seed).uniform(BOX_LOWER, BOX_UPPER, size=(count, 4))
    return [PlatformPose(tuple(row[:3].tolist()), float(row[3])) for row in numbers]


def displaced(pose, random, distance_m=0.020, angle_rad=0.050):
    """Return a pose that far away in a random direction, tilted more or less by the angle."""
    direction = random.normal(size=3)
    direction *= distance_m / np.linalg.norm(direction)
    sign = random.choice((-1.0, 1.0))
    return PlatformPose(tuple((np.array(pose.position_m) + direction).tolist()), pose.tilt_rad + sign * angle_rad)


def crooked_model(seed, axis_mrad, centre_mm=0.5, layout="paper"):
    """Return a robot whose joint axes and centres are all off by normal deviates of the given spread."""
    random = np.random.default_rng(seed)

    def draw(translation, rotation):
        t, r = (np.round(random.normal(size=3) * spread, 4) + 0.0 for spread in (translation, rotation))
        return JointPlacement(translation_mm=tuple(t.tolist()), rotation_mrad=tuple(r.tolist()))

    placements = {}
    for leg in CHAINS:
        placements[f"leg{leg}_s1"] = draw(centre_mm, axis_mrad)
        placements[f"leg{leg}_s2"] = draw(0.0, axis_mrad)
        placements[f"leg{leg}_s4"] = draw(0.0, axis_mrad)
        placements[f"leg{leg}_seat_mount"] = draw(centre_mm, axis_mrad)
    return RobotModel(layout=layout, joint_placements=placements)


def carried_by(model, chain_order):
    """Return nominal and actual mechanism of a model with its platform on another chain in the tree."""
    nominal = render_urdf(model.layout, chain_order=chain_order)
    texts = nominal, perturb_urdf(nominal, model.displacements())
    return tuple(ClosedChainMechanism(text, model.definition.loops) for text in texts)


def placement_error(numbers):
    """Return six numbers (m, rad) as the error of a placement: its pose in the nominal one."""
    return displacement(numbers[:3], numbers[3:])


def displacement(translation_m=(0.0, 0.0, 0.0), rotation_rad=(0.0, 0.0, 0.0)):
    """Return a shift (m) and a rotation vector (rad) as the pose of a displaced placement in the nominal one."""
    return pin.SE3(pin.exp3(np.array(rotation_rad, dtype=float)), np.array(translation_m, dtype=float))


def perturbed(mechanism, placements):
    """Return a mechanism whose URDF holds errors: how joints are displaced, as poses, by name."""
    return ClosedChainMechanism(perturb_urdf(mechanism.urdf, placements), mechanism.loops)


def oracle_cases():
    """Return the 60 closed poses of the independent energy formulation."""
    return json.loads((DATA / "closure_oracle.json").read_text(encoding="utf-8"))


def central_differences(function, model, configuration, step=1e-6):
    """Return the derivative of ``function(configuration)`` by joint twists, one column each, fourth order."""
    columns = []
    for k in range(model.nv):
        direction = np.zeros(model.nv)
        direction[k] = step
        near, far = (
            function(pin.integrate(model, configuration, n * direction))
            - function(pin.integrate(model, configuration, -n * direction))
            for n in (1, 2)
        )
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)


def relative_error(found, expected):
    """Return the largest deviation as a share of the largest expected number."""
    return float(np.abs(np.asarray(found) - expected).max() / np.abs(expected).max())


def unbalanced(balance):
    """Return what a steady state leaves unbalanced, as a share of the heat that passes through."""
    return abs(balance.stored_W) / (sum(map(abs, vars(balance).values())) / 2.0)


def round_off(condition=1.0, scale=1.0, terms=1):
    """Return how far a right computation may be off by rounding alone, whatever the order of its sums.

    A machine's kernels of linear algebra add in their own order, so that last digits differ between machines. A
    backward stable computation (sums, products, QR, SVD, Cholesky) gives the exact answer to data that are off by a
    share of at most about ``terms`` ε, ε = 2.2e-16 (Higham, Accuracy and Stability of Numerical Algorithms, 2002,
    equation 3.5 and theorems 10.3 and 19.4); the condition number says how much of that share arrives in the answer.

    Args:
        condition: relative change of the answer over that of the data, at worst.
        scale: size of the answer, or of the largest number that cancels in it.
        terms: steps in a row: length of a sum; rows times columns of a decomposed matrix.
    """
    return terms * np.finfo(float).eps * condition * scale


def closure_condition(solver, result):
    """Return condition number and size of what G is solved with: the energy's Hessian, scaled to a unit diagonal."""
    energy = solver.energy
    hessian = energy.hessian(energy.evaluate(result.configuration, result.commanded))
    block = energy.basis.T @ hessian @ energy.basis
    scale = 1.0 / np.sqrt(np.diagonal(block))
    return np.linalg.cond(block * scale[:, None] * scale), len(block)


def pose_gap(first, second):
    """Return distance (m) and angle (rad) between two poses."""
    angle = np.linalg.norm(pin.log3(first.rotation.T @ second.rotation))
    return float(np.linalg.norm(first.translation - second.translation)), float(angle)


def planar_urdf(name, chains):
    """Return a URDF of planar open chains: revolute joints about y, links along x.

    Args:
        name: of the robot.
        chains: for each chain its name, the x of its ground joint and the lengths of its links, in m. Link ``n``
            turns in joint ``<chain>_j<n>``; the fixed link ``<chain>_tip`` ends the chain.
    """
    parts = [f'<robot name="{name}"><link name="ground"/>']
    inertial = (
        '<inertial><origin xyz="{x} 0 0"/><mass value="1.5"/>'
        '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    for chain, ground_x, lengths in chains:
        parent, offset = "ground", ground_x
        for number, length in enumerate(lengths, start=1):
            child = f"{chain}_l{number}"
            parts.append(f'<link name="{child}">{inertial.format(x=length / 2)}</link>')
            parts.append(
                f'<joint name="{chain}_j{number}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
                f'<origin xyz="{offset} 0 0"/><axis xyz="0 1 0"/>'
                '<limit lower="-3.2" upper="3.2" effort="1" velocity="1"/></joint>'
            )
            parent, offset = child, length
        parts.append(
            f'<link name="{chain}_tip"/><joint name="{chain}_tip_mount" type="fixed"><parent link="{parent}"/>'
            f'<child link="{chain}_tip"/><origin xyz="{offset} 0 0"/></joint>'
        )
    return "".join(parts) + "</robot>"


def platform_star(chains, drives, **changes):
    """Return a planar platform on chains of revolute joints, each (name, ground x, link lengths, seat x)."""
    urdf = planar_urdf("star", [chain[:3] for chain in chains]).removesuffix("</robot>")
    first = chains[0][0]
    parts = [
        f'<link name="platform"/><joint name="platform_mount" type="fixed"><parent link="{first}_tip"/>',
        '<child link="platform"/></joint>',
    ]
    for name, _, _, seat_x in chains:
        parts.append(
            f'<link name="{name}_seat"/><joint name="{name}_seat_mount" type="fixed"><parent link="platform"/>'
            f'<child link="{name}_seat"/><origin xyz="{seat_x} 0 0"/></joint>'
        )
    loops = {
        "base_frame": "ground",
        "end_frame": "platform",
        "cut_joints": ("platform_mount",),
        "drives": drives,
        "loops": [{"name": name, "frame_a": f"{name}_tip", "frame_b": f"{name}_seat"} for name, *_ in chains],
    }
    return ClosedChainMechanism(urdf + "".join(parts) + "</robot>", LoopsFile(**(loops | changes)))


def circle_meeting(centre_a, radius_a, centre_b, radius_b, side):
    """Return the point of the x-z plane at the given distances from two centres, on the given side (+1, -1)."""
    across = np.subtract(centre_b, centre_a)
    distance = np.hypot(*across)
    along = (distance**2 + radius_a**2 - radius_b**2) / (2 * distance)
    height = np.sqrt(radius_a**2 - along**2)
    normal = np.array([-across[1], across[0]]) / distance
    return np.asarray(centre_a) + along * across / distance + side * height * normal


ARM_JOINTS = ("waist", "shoulder", "elbow", "roll", "pitch", "flange_turn")


def arm_urdf():
    """Return a URDF of a six-axis arm on a rail: skew axes, masses off them, a wrist that turns without end."""
    parts = ['<robot name="arm"><link name="hall"/><link name="foot">']
    inertial = (
        '<inertial><origin xyz="0.02 -0.03 0.1"/><mass value="{m}"/>'
        '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    parts.append(
        inertial.format(m=30) + '</link><joint name="rail" type="prismatic"><parent link="hall"/><child link="foot"/>'
        '<origin xyz="0.1 0.2 0" rpy="0 0 0.3"/><axis xyz="1 0 0"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
    )
    places = (
        ("waist", "revolute", "0 0 0.1", "0 0 0.2", "0 0 1", 12),
        ("shoulder", "revolute", "0.15 0.02 0.3", "0.01 0 0", "0 1 0", 10),
        ("elbow", "revolute", "0 -0.1 0.6", "0 0.02 0.1", "0 1 0", 8),
        ("roll", "continuous", "0.1 0 0.3", "0 1.5 0", "0 0 1", 4),
        ("pitch", "revolute", "0 0 0.35", "0.3 0 0", "0 0.6 -0.8", 2),
        ("flange_turn", "continuous", "0.03 0 0.1", "0 0 0.4", "1 0 0", 1),
    )
    parent = "foot"
    for name, kind, xyz, rpy, axis, mass in places:
        parts.append(
            f'<link name="{name}_link">{inertial.format(m=mass)}</link><joint name="{name}" type="{kind}">'
            f'<parent link="{parent}"/><child link="{name}_link"/><origin xyz="{xyz}" rpy="{rpy}"/>'
            f'<axis xyz="{axis}"/><limit lower="-3.1" upper="3.1" effort="1" velocity="1"/></joint>'
        )
        parent = f"{name}_link"
    parts.append(
        f'<link name="flange"/><joint name="flange_mount" type="fixed"><parent link="{parent}"/><child link="flange"/>'
        '<origin xyz="0 0.02 0.09" rpy="0.1 -0.2 0.5"/></joint></robot>'
    )
    return "".join(parts)


def arm(**changes):
    """Return that arm as a mechanism without loops; changes go into its loops file."""
    keys = {"base_frame": "foot", "end_frame": "flange", "drives": ARM_JOINTS, "locked_joints": ("rail",)}
    return ClosedChainMechanism(arm_urdf(), LoopsFile(**(keys | changes)))
