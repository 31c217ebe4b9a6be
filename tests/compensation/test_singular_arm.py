"""An arm of seven joints on a rail, all at zero: stretched out, all its axes in two directions. Its own kinematics.

The drives command three freedoms there and six nearby, so the missing ones are found from nearby poses only.
"""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.compensation.pose import compensate_drives, drive_notes
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.robot import Robot

RISES = (0.3, 0.34, 0.2, 0.2, 0.2, 0.19, 0.08)
AXES = (*("0 0 1", "0 1 0") * 3, "0 0 1")
TOOL = np.array([0.02, 0.03, 0.12])
LONGER = np.array([-0.00005, -0.00003, 0.0016])
NAMES = [f"a{k}" for k in range(1, 8)]


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    joints = [("rail", "prismatic", "1 0 0", "0 0 0.4", 3.0)]
    turns = zip(NAMES, AXES, RISES, strict=True)
    joints += [(name, "revolute", axis, f"0 0 {rise}", 2.8) for name, axis, rise in turns]
    links, text = ["base", "carriage", *(f"l{k}" for k in range(1, 8))], ""
    for (name, kind, axis, at, most), parent, child in zip(joints, links, links[1:], strict=False):
        text += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        )
        text += f'<axis xyz="{axis}"/><limit lower="-{most}" upper="{most}" effort="1" velocity="1"/></joint>'
    x, y, z = TOOL
    text += (
        f'<joint name="mount" type="fixed"><parent link="l7"/><child link="tool"/><origin xyz="{x} {y} {z}"/></joint>'
    )
    bodies = "".join(f'<link name="{name}"/>' for name in [*links, "tool"])
    (folder / "arm.urdf").write_text(f'<robot name="arm">{bodies}{text}</robot>')
    drives = ", ".join(f"{{joint: {name}}}" for name in ["rail", *NAMES])
    (folder / "robot.yaml").write_text(
        "format: pouring_robot/robot/1\nname: arm\nurdf: arm.urdf\nbase_frame: base\nend_frame: tool\n"
        f"drives: [{drives}]\n"
    )
    placement = JointPlacement(translation_mm=tuple((1e3 * LONGER).tolist()), rotation_mrad=(0.05, -0.15, 0.0))
    model = RobotModel.for_robot(folder / "robot.yaml")
    return Robot(model.model_copy(update={"joint_placements": {"a3": placement}}))


def tool(drives, *, built):
    """Return the rotation (3, 3) and the position (3,), in m, of the tool, as drawn or as built."""
    rail, *angles = drives
    rotation, place = np.eye(3), np.array([rail, 0.0, 0.4])
    for name, angle, axis, rise in zip(NAMES, angles, AXES, RISES, strict=True):
        place = place + rotation @ np.array([0.0, 0.0, rise])
        if built and name == "a3":
            place, rotation = place + rotation @ LONGER, rotation @ pin.exp3(np.array([5e-5, -1.5e-4, 0.0]))
        rotation = rotation @ pin.exp3(angle * np.array([float(part) for part in axis.split()]))
    return rotation, place + rotation @ TOOL


def missing(drives, wanted):
    """Return the errors of position (m) and attitude (rad) of the arm as built against the wanted pose as drawn."""
    (turned, at), (rotation, place) = tool(drives, built=True), tool(wanted, built=False)
    return np.linalg.norm(at - place), np.linalg.norm(pin.log3(turned @ rotation.T))


@pytest.mark.parametrize(
    "bent", [(0.0,) * 7, (0.3, 0.0, 0.0, 0.0, -0.2, 0.0, 0.5), (0.0, 2e-5, 0.0, 0.0, 0.0, 0.0, 0.0)]
)
def test_a_target_within_reach_is_met(arm, bent):
    wanted = np.array([1.5, *bent])
    found = compensate_drives(arm, arm.location_at(wanted))
    drives = np.array(list(found.drives.values()))
    assert max(missing(wanted, wanted)) > 1e-3
    assert max(missing(drives, wanted)) < 1e-9
    assert found.status == "reached + singular"
    # Nearby: to be 1.6 mm shorter it bends by some degrees, and the rail makes up for some centimetres.
    assert np.degrees(np.abs(drives[1:] - wanted[1:])).max() < 12.0
    assert abs(drives[0] - wanted[0]) < 0.1


def test_at_regular_poses_there_is_no_such_search(arm):
    wanted = np.array([1.5, 0.2, 0.4, -0.3, 0.9, 0.2, 0.7, -0.4])
    found = compensate_drives(arm, arm.location_at(wanted))
    assert max(missing(list(found.drives.values()), wanted)) < 1e-9
    assert found.status == "reached"


def test_the_drive_that_goes_farthest_is_reported_for_each_unit(arm):
    """Over all poses, in mm and degrees."""
    wanted = [[1.5, bent, 0.0, 0.0, 0.0, -bent, 0.0, 0.0] for bent in (0.0, 0.3)]
    found = [compensate_drives(arm, arm.location_at(drives)) for drives in wanted]
    ways = np.array([[abs(one.drives[name] - one.wanted.drives[name]) for name in one.drives] for one in found])
    slide, turn = ways[:, 0].max(), ways[:, 1:].max()
    name = NAMES[int(ways[:, 1:].max(axis=0).argmax())]
    (note,) = drive_notes(found)
    assert f"2 of 2 poses, by up to {name} {np.degrees(turn):.5f} deg and rail {1e3 * slide:.4f} mm; " in note
