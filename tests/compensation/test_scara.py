"""A SCARA whose forearm is 8 mm longer than drawn, against its closed form: on limits, and stretched out."""

import csv
import math

import numpy as np
import pytest

from pouring_robot.cli.app import main
from pouring_robot.compensation.pose import compensate_drives, drive_notes
from pouring_robot.exceptions import UnreachablePoseError
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.robot import Robot

UPPER, FOREARM, HAND, LONGER, TOP, STROKE = 0.325, 0.275, 0.04, 0.008, 0.2, 0.2
URDF = f"""<robot name="scara"><link name="base"/><link name="upper"/><link name="forearm"/><link name="quill"/>
<link name="hand"/><link name="tool"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 {TOP}"/><axis xyz="0 0 1"/>
<limit lower="-2.3" upper="2.3" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="upper"/><child link="forearm"/><origin xyz="{UPPER} 0 0"/>
<axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" effort="1" velocity="1"/></joint>
<joint name="j3" type="prismatic"><parent link="forearm"/><child link="quill"/>
<origin xyz="{FOREARM} 0 0" rpy="{math.pi!r} 0 0"/><axis xyz="0 0 1"/>
<limit lower="0" upper="{STROKE}" effort="1" velocity="1"/></joint>
<joint name="j4" type="revolute"><parent link="quill"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="-3.1" upper="3.1" effort="1" velocity="1"/></joint>
<joint name="mount" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="{HAND} 0 0"/></joint></robot>"""
ROBOT = """format: pouring_robot/robot/1
name: scara
urdf: scara.urdf
base_frame: base
end_frame: tool
drives: [{joint: j1}, {joint: j2}, {joint: j3}, {joint: j4}]
"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "scara.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(ROBOT)
    return tmp_path


def built(files, *, longer=LONGER, lower=0.0):
    """Return the robot with its forearm longer and its quill lower than drawn, in m."""
    place = JointPlacement(translation_mm=(1e3 * longer, 0.0, -1e3 * lower))
    model = RobotModel.for_robot(files / "robot.yaml")
    return Robot(model.model_copy(update={"joint_placements": {"j3": place}}))


def tool(drives, longer=0.0):
    """Return x, y, z (m) and the yaw (rad) of the tool: the closed form."""
    one, two, slide, four = drives
    yaw = one + two - four  # the quill hangs upside down
    arm = UPPER * np.exp(1j * one) + (FOREARM + longer) * np.exp(1j * (one + two)) + HAND * np.exp(1j * yaw)
    return np.array([arm.real, arm.imag, TOP - slide, yaw])


@pytest.mark.parametrize("bent", [3.0, 10.0, 20.0])
@pytest.mark.parametrize("slide", [0.0, STROKE])
def test_a_drive_on_its_limit_stays_there(files, bent, slide):
    """Its own correction is round-off, to whichever side; what is commanded is within the limits."""
    wanted = np.array([0.0, math.radians(bent), slide, 0.0])
    found = compensate_drives(robot := built(files), robot.location_at(wanted))
    assert 0.0 <= found.drives["j3"] <= STROKE
    assert found.drives["j3"] == pytest.approx(slide, abs=1e-9)
    assert tool(found.drives.values(), LONGER) == pytest.approx(tool(wanted), abs=1e-9)
    robot.location_at(list(found.drives.values()))  # refuses what stands beyond limits


def test_what_is_really_beyond_a_limit_is_refused_and_readable(files):
    robot = built(files, lower=2.1e-6)
    wanted = robot.location_at([0.0, 0.3, STROKE, 0.0])
    compensate_drives(robot, robot.location_at([0.0, 0.3, STROKE / 2, 0.0]))
    why = r"'j3' would stand at 200\.0021 mm, 0\.0021 mm beyond its limits 0\.0000 to 200\.0000 mm$"
    with pytest.raises(UnreachablePoseError, match=why) as refused:
        compensate_drives(robot, wanted)
    assert refused.value.excess == pytest.approx(2.1e-6, abs=1e-9)


@pytest.mark.parametrize("slide", [0.0, 0.1])
def test_stretched_out_it_bends_its_elbow(files, slide):
    """Newton stands still there. The law of cosines says how far the elbow bends; both sides are as near."""
    wanted = np.array([0.2, 0.0, slide, -0.1])
    robot = built(files)
    found = compensate_drives(robot, robot.location_at(wanted))
    reach, forearm = UPPER + FOREARM, FOREARM + LONGER
    bent = math.pi - math.acos((UPPER**2 + forearm**2 - reach**2) / (2 * UPPER * forearm))
    assert abs(found.drives["j2"]) == pytest.approx(bent, abs=1e-7)
    assert tool(found.drives.values(), LONGER) == pytest.approx(tool(wanted), abs=1e-9)
    assert found.status == "reached + singular"
    assert found.before.distance_m == pytest.approx(LONGER, abs=1e-12)


def test_beyond_its_reach_it_stays_and_says_so(files, tmp_path, capsys):
    """The forearm is too short for the stretched pose; the line before is compensated, and the table is read again."""
    robot = built(files, longer=-LONGER)
    found = compensate_drives(robot, stretched := robot.location_at([0.2, 0.0, 0.1, 0.0]))
    assert found.kept and found.status == "kept + singular"
    assert found.drives == stretched.drives
    assert found.left.distance_m == found.before.distance_m == pytest.approx(LONGER, abs=1e-12)
    assert "not compensated" in found.headline
    robot.model.save(tmp_path / "model.yaml")
    (tmp_path / "path.csv").write_text("j1_rad,j2_rad,j3_m,j4_rad\n0.2,0.6,0.1,0\n0.2,0,0.1,0\n")
    asked = ["compensate", str(tmp_path / "path.csv"), "--model", str(tmp_path / "model.yaml")]
    assert main([*asked, "--out", str(tmp_path / "out.csv")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "singular, and nothing better found: 1 of 2 poses, not compensated, their drives kept as given" in said
    with (tmp_path / "out.csv").open() as stream:
        assert [row["status"] for row in csv.DictReader(stream)] == ["reached", "kept + singular"]
    assert list(robot.read_commands(tmp_path / "out.csv").values())[1] == pytest.approx([0.2, 0.0, 0.1, 0.0], abs=1e-12)


def test_what_no_drive_turns_back_is_said(files):
    """A quill that leans: the tool is placed, stretched out as elsewhere; its lean, which no drive turns, is left."""
    place = JointPlacement(translation_mm=(8.0, 0.0, 0.0), rotation_mrad=(0.5, 0.2, 0.0))
    model = RobotModel.for_robot(files / "robot.yaml").model_copy(update={"joint_placements": {"j3": place}})
    robot = Robot(model)
    found = [compensate_drives(robot, robot.location_at([0.2, bent, 0.1, 0.0])) for bent in (0.0, 0.7)]
    for one, singular in zip(found, (" + singular", ""), strict=True):
        assert one.left.distance_m < 1e-9
        assert one.left.angle_rad == pytest.approx(math.hypot(0.5e-3, 0.2e-3), rel=1e-3)
        assert one.status == f"nearest{singular}"
    (note,) = drive_notes(found)
    assert note.startswith("singular (stretched out, or axes on one line): 1 of 2 poses; ")
