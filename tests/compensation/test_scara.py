"""A SCARA whose forearm is 8 mm longer than drawn, against its closed form: at limits, and stretched out."""

import csv
import dataclasses
import itertools
import math

import numpy as np
import pytest

from pouring_robot.cli.app import main
from pouring_robot.compensation.drives import bring_to
from pouring_robot.compensation.pose import compensate_drives, drive_notes
from pouring_robot.exceptions import UnreachablePoseError
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.inverse import InverseSolution, Target
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
    """Return x, y, z (m) and the yaw (rad) of the tool in closed form."""
    one, two, slide, four = drives
    yaw = one + two - four  # the quill hangs upside down
    arm = UPPER * np.exp(1j * one) + (FOREARM + longer) * np.exp(1j * (one + two)) + HAND * np.exp(1j * yaw)
    return np.array([arm.real, arm.imag, TOP - slide, yaw])


@pytest.mark.parametrize("bent", [3.0, 10.0, 20.0])
@pytest.mark.parametrize("slide", [0.0, STROKE])
def test_a_drive_on_its_limit_stays_there(files, bent, slide):
    """Its own correction is round-off, of either sign; the command is within the limits."""
    wanted = np.array([0.0, math.radians(bent), slide, 0.0])
    found = compensate_drives(robot := built(files), robot.location_at(wanted))
    assert 0.0 <= found.drives["j3"] <= STROKE
    assert found.drives["j3"] == pytest.approx(slide, abs=1e-9)
    assert tool(found.drives.values(), LONGER) == pytest.approx(tool(wanted), abs=1e-9)
    robot.location_at(list(found.drives.values()))  # refuses drives beyond limits


def test_a_true_excess_over_a_limit_is_refused_and_readable(files):
    robot = built(files, lower=2.1e-6)
    wanted = robot.location_at([0.0, 0.3, STROKE, 0.0])
    compensate_drives(robot, robot.location_at([0.0, 0.3, STROKE / 2, 0.0]))
    why = r"'j3' would stand at 200\.0021 mm, 0\.0021 mm beyond its limits 0\.0000 to 200\.0000 mm$"
    with pytest.raises(UnreachablePoseError, match=why) as refused:
        compensate_drives(robot, wanted)
    assert refused.value.excess == pytest.approx(2.1e-6, abs=1e-9)


@pytest.mark.parametrize("slide", [0.0, 0.1])
def test_stretched_out_it_bends_its_elbow(files, slide):
    """Newton's method does not move there. The law of cosines gives the elbow's angle; both signs are equally near."""
    wanted = np.array([0.2, 0.0, slide, -0.1])
    robot = built(files)
    found = compensate_drives(robot, robot.location_at(wanted))
    reach, forearm = UPPER + FOREARM, FOREARM + LONGER
    bent = math.pi - math.acos((UPPER**2 + forearm**2 - reach**2) / (2 * UPPER * forearm))
    assert abs(found.drives["j2"]) == pytest.approx(bent, abs=1e-7)
    assert tool(found.drives.values(), LONGER) == pytest.approx(tool(wanted), abs=1e-9)
    assert found.status == "reached + singular"
    assert found.before.distance_m == pytest.approx(LONGER, abs=1e-12)


def test_beyond_its_reach_it_keeps_its_drives_and_reports_it(files, tmp_path, capsys):
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
    assert "as (nearly) singular with nothing better found: 1 of 2 poses; their drives are kept" in said
    with (tmp_path / "out.csv").open() as stream:
        assert [row["status"] for row in csv.DictReader(stream)] == ["reached", "kept + singular"]
    assert list(robot.read_commands(tmp_path / "out.csv").values())[1] == pytest.approx([0.2, 0.0, 0.1, 0.0], abs=1e-12)


def test_a_rotation_that_no_drive_corrects_is_reported(files):
    """With a leaning quill the tool is positioned, stretched out as elsewhere; its lean stays, as no drive turns it."""
    place = JointPlacement(translation_mm=(8.0, 0.0, 0.0), rotation_mrad=(0.5, 0.2, 0.0))
    model = RobotModel.for_robot(files / "robot.yaml").model_copy(update={"joint_placements": {"j3": place}})
    robot = Robot(model)
    found = [compensate_drives(robot, robot.location_at([0.2, bent, 0.1, 0.0])) for bent in (0.0, 0.7)]
    for one, singular in zip(found, (" + singular", ""), strict=True):
        assert one.left.distance_m < 1e-9
        assert one.left.angle_rad == pytest.approx(math.hypot(0.5e-3, 0.2e-3), rel=1e-3)
        assert one.status == f"nearest{singular}"


@pytest.mark.parametrize("bent", [0.0, 1e-7, 1e-6, 1e-4, 0.01])
def test_just_beyond_its_reach_it_keeps_its_drives_near_the_stretched_pose_too(files, bent):
    """80 um short: the pose is singular, nearly so, or Newton's method oscillates about a target out of reach."""
    robot = built(files, longer=-8e-5)
    found = compensate_drives(robot, wanted := robot.location_at([0.2, bent, 0.1, 0.0]))
    assert found.status == "kept + singular"
    assert found.drives == wanted.drives
    assert drive_notes([found]) == [
        "not compensated, as (nearly) singular with nothing better found: 1 of 1 poses; their drives are kept"
    ]


@pytest.mark.parametrize(("over", "within"), [(-8e-10, 0.0), (STROKE + 8e-10, STROKE)])
def test_drives_that_are_kept_are_within_the_limits(files, over, within):
    robot = built(files, longer=-LONGER)
    found = compensate_drives(robot, robot.location_at([0.2, 0.0, over, 0.0]))
    assert found.kept
    assert found.drives == {"j1": 0.2, "j2": 0.0, "j3": within, "j4": 0.0}


@pytest.mark.parametrize(("bent", "status"), [(0.0, "reached + singular"), (1e-5, "reached"), (1e-2, "reached")])
def test_drives_that_go_far_are_reported_at_singular_and_other_poses(files, bent, status):
    robot = built(files)
    locations = [robot.location_at([0.2, angle, 0.1, 0.0]) for angle in (bent, math.pi / 2)]
    found = [compensate_drives(robot, one) for one in locations]
    far = math.degrees(abs(found[0].drives["j2"] - bent))
    assert [one.status for one in found] == [status, "reached"]
    assert 17.0 < far < 20.0
    (note,) = drive_notes(found)
    assert note.startswith(f"compensated drives are far from the given ones: 1 of 2 poses, by up to j2 {far:.5f} deg; ")


def test_a_position_that_compensation_makes_worse_is_reported(files):
    """No case is known: whatever Newton's method ends with, nobody is to command it without a warning."""
    robot = built(files)
    found = compensate_drives(robot, robot.location_at([0.2, 0.7, 0.1, 0.0]))
    found = dataclasses.replace(found, before=found.left, left=PoseDifference(np.array([2e-3, 0.0, 0.0]), np.zeros(3)))
    assert found.status == "nearest + position worse"
    assert drive_notes([found])[-1] == (
        "position further off with compensation than without: 1 of 1 poses, by up to 2 mm; "
        "command the uncompensated drives there"
    )


def searched(files, monkeypatch, stood, *beside):
    """Return what is found where Newton's method ends so, from the stretched pose and from beside it, in turn.

    Each end: the way of j1 (rad), the errors of position (m) and attitude (rad), and whether it settled. Without
    compensation the errors are 8 mm and 1 mrad.
    """
    place = JointPlacement(translation_mm=(8.0, 0.0, 0.0), rotation_mrad=(0.0, 0.0, 1.0))
    model = RobotModel.for_robot(files / "robot.yaml").model_copy(update={"joint_placements": {"j3": place}})
    robot = Robot(model)
    wanted = robot.location_at([0.2, 0.0, 0.1, 0.0])
    here = np.array(list(wanted.drives.values()))

    # The first is the drawing, which is where it is.
    ends = itertools.chain([(0.0, 0.0, 0.0, True), stood], itertools.cycle(beside))

    def bring(*_, **__):
        way, place_m, angle_rad, settled = next(ends)
        left = np.array([place_m, 0.0, 0.0, 0.0, angle_rad, 0.0])
        return InverseSolution(here + np.array([way, 0.0, 0.0, 0.0]), wanted.actual, left, (2, 1), settled)

    monkeypatch.setattr("pouring_robot.compensation.drives.bring", bring)
    nominal = wanted.poses("tool")[0]
    found, singular = bring_to(robot, wanted, Target(nominal.translation, nominal.rotation, "tool"))
    assert singular
    return found and (float(found.drives[0] - 0.2), found.place_m, found.angle_rad)


NOWHERE = (0.0, 0.0, 0.0, False)


@pytest.mark.parametrize(
    ("stood", "beside", "found"),
    [
        # of two with the right position the one with the right attitude, though it is farther; else the nearer one
        (NOWHERE, [(0.1, 0.0, 5e-4, True), (0.2, 0.0, 0.0, True)], (0.2, 0.0, 0.0)),
        (NOWHERE, [(0.2, 0.0, 1e-10, True), (0.1, 0.0, 9e-10, True)], (0.1, 0.0, 9e-10)),
        # the position comes first
        (NOWHERE, [(0.1, 1e-3, 0.0, True), (0.2, 0.0, 3e-3, True)], (0.2, 0.0, 3e-3)),
        # no nearer than without compensation, or not settled: kept
        (NOWHERE, [(0.1, 9e-3, 2e-3, True)], None),
        (NOWHERE, [(0.1, 9e-3, 0.0, True)], None),
        (NOWHERE, [NOWHERE], None),
        # where Newton's method did not move: if that is nearer, and the attitude is no worse for it
        ((0.0, 2e-3, 1e-3, True), [(0.1, 3e-3, 0.0, True)], (0.0, 2e-3, 1e-3)),
        ((0.0, 0.0, 5e-4, True), [(0.1, 0.0, 6e-4, True)], (0.0, 0.0, 5e-4)),
        ((0.0, 2e-3, 2e-3, True), [NOWHERE], None),
        ((0.0, 0.0, 2e-3, True), [(0.1, 0.0, 0.0, True)], (0.1, 0.0, 0.0)),
    ],
)
def test_which_of_the_solutions_found_is_chosen(files, monkeypatch, stood, beside, found):
    assert searched(files, monkeypatch, stood, *beside) == (found and pytest.approx(found, abs=1e-12))
