"""Errors so large that to first order one cause looks like another: a SCARA elbow with a wrong zero or gear ratio."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pouring_robot import Campaign, RobotModel, diagnose

NOISE = 5e-5  # in m and rad
JOINTS = (  # name, type, origin and axis in the link before
    ("shoulder", "revolute", (0.0, 0.0, 0.4), (0, 0, 1)),
    ("elbow", "revolute", (0.4, 0.0, 0.0), (0, 0, 1)),
    ("quill", "prismatic", (0.35, 0.0, 0.0), (0, 0, -1)),
    ("wrist", "revolute", (0.0, 0.0, -0.05), (0, 0, -1)),
)
LOW, HIGH = np.array([-2.4, -2.2, 0.01, -2.5]), np.array([2.4, 2.2, 0.29, 2.5])


def pose(drives):
    """Return the position of the tool from the base, (3,), and its rotation, in closed form."""
    shoulder, elbow, quill, wrist = drives
    first, both = (Rotation.from_euler("z", angle) for angle in (shoulder, shoulder + elbow))
    place = first.apply([0.4, 0.0, 0.4]) + both.apply([0.35, 0.0, -0.05 - quill])
    return place, both * Rotation.from_euler("z", -wrist)


def written(folder: Path, offset_rad: float = 0.0, ratio: float = 0.0, home_rad: float = 0.0) -> Campaign:
    """Return a campaign of 60 poses of the arm whose elbow is not where its encoder says.

    It has an offset where it was homed, and an error from there in proportion to its travel.
    """
    joints = zip(("base", "arm", "forearm", "spindle"), ("arm", "forearm", "spindle", "tool"), JOINTS, strict=True)
    lines = [
        f'<joint name="{name}" type="{kind}"><parent link="{before}"/><child link="{after}"/>'
        f'<origin xyz="{x} {y} {z}"/><axis xyz="{" ".join(map(str, axis))}"/>'
        '<limit lower="-2.5" upper="2.5" effort="100" velocity="2"/></joint>'
        for before, after, (name, kind, (x, y, z), axis) in joints
    ]
    links = "".join(f'<link name="{name}"/>' for name in ("base", "arm", "forearm", "spindle", "tool"))
    (folder / "scara.urdf").write_text(f'<robot name="scara">{links}{"".join(lines)}</robot>')
    drives = "".join(f"  - {{joint: {name}}}\n" for name, *_ in JOINTS)
    (folder / "scara.yaml").write_text(
        "format: pouring_robot/robot/1\nname: scara\nurdf: scara.urdf\n"
        f"base_frame: base\nend_frame: tool\ndrives:\n{drives}"
    )
    sigma = f"  sigma_position_mm: {1e3 * NOISE}\n  sigma_rotation_rad: {NOISE}\n"
    (folder / "measured.yaml").write_text(f"robot: scara\nmetrology:\n  target: tool\n  frame: tracker\n{sigma}")
    rng = np.random.default_rng(5)
    tracker, target = Rotation.from_rotvec([0.3, -0.2, 1.1]), np.array([0.03, 0.05, -0.08])
    with (folder / "measured.csv").open("w") as file:
        table = csv.writer(file)
        heads = ("shoulder_rad", "elbow_rad", "quill_m", "wrist_rad", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
        table.writerow(heads)
        for command in rng.uniform(LOW, HIGH, (60, 4)):
            off = offset_rad + ratio * (command[1] - home_rad)
            place, turn = pose(command + np.array([0.0, off, 0.0, 0.0]))
            seen = tracker.apply(place + turn.apply(target)) + rng.normal(0.0, NOISE, 3) + [2.0, -1.0, 0.5]
            turned = Rotation.from_rotvec(rng.normal(0.0, NOISE, 3)) * tracker * turn
            table.writerow([*command, *seen, *turned.as_rotvec()])
    return Campaign.read(folder / "measured.csv", RobotModel.for_robot(folder / "scara.yaml").definition)


@pytest.mark.parametrize("offset_deg", [-5.0, 10.0])
def test_a_zero_that_is_degrees_off_is_named_and_what_does_the_same_is_an_alternative(tmp_path, offset_deg):
    """The tool's unknown rotation absorbs all but a shift of the quill, which no other placement along the arm makes.

    With derivatives at the drawing, joints in the wrong place alone were named, 99 % sure.
    """
    campaign = written(tmp_path, offset_rad=np.radians(offset_deg))
    found = diagnose(campaign, RobotModel.for_robot(tmp_path / "scara.yaml"))
    (zero,) = found.effects
    assert found.judgement.verdict == "group"
    assert {zero.cause.effect, *zero.cause.alternatives} >= {"drive_zero_offset.rotations", "joint_placement"}
    assert zero.cause.effect == "drive_zero_offset.rotations"
    assert not {*found.spare} & {*zero.cause.alternatives}  # they are reported as looking alike
    (elbow,) = (one for one in zero.parameters if one.parameter.name.startswith("elbow"))
    assert abs(elbow.value) == pytest.approx(1e3 * np.radians(abs(offset_deg)), abs=5.0 * elbow.std)


@pytest.mark.parametrize(("ratio", "home_rad"), [(-0.003, 0.0), (0.03, -2.2)])
def test_a_wrong_gear_ratio_is_distinguished_from_waves_of_the_joints_turn(tmp_path, ratio, home_rad):
    """Waves can add up to a line over less than a turn, but only many of large amplitude; they were named."""
    campaign = written(tmp_path, ratio=ratio, home_rad=home_rad)
    found = diagnose(campaign, RobotModel.for_robot(tmp_path / "scara.yaml"))
    (cause,) = found.effects
    assert (found.verdict, cause.cause.effect) == ("named", "drive_scale.rotations")
    (elbow,) = (one for one in cause.parameters if one.parameter.name == "elbow_scale")
    assert elbow.value == pytest.approx(1e3 * ratio, abs=4.0 * elbow.std)  # for one draw
    assert elbow.std < 0.02  # mrad/rad
