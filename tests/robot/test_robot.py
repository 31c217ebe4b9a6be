"""Any robot, located by its drives: against Pinocchio and central differences; a status where there is no pose."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.robot.model import DriveOffset, JointPlacement, RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot
from tests.support import ROOT, relative_error

ROBOTS = ROOT / "examples" / "robots"
NAMES = ("arm", "delta", "five_bar", "hexapod")


@pytest.fixture(scope="module", params=NAMES)
def crooked(request):
    """Return a robot of the examples with joints displaced and a drive off."""
    model = RobotModel.for_robot(ROBOTS / request.param / "robot.yaml")
    drive = model.definition.drives[0]
    joints = list(dict.fromkeys(p.local.joint for p in Robot(model).parameters.parameters.values()))[:3]
    placements = {
        joint: JointPlacement(translation_mm=(0.2, -0.1, 0.15), rotation_mrad=(0.0, 0.0, 0.3)) for joint in joints
    }
    offset = DriveOffset(offset_mm=0.3) if drive.unit == "m" else DriveOffset(offset_mrad=0.4)
    return Robot(model.model_copy(update={"joint_placements": placements, "drive_offsets": {drive.joint: offset}}))


def commands(robot, count, seed):
    definition = robot.model.definition
    spread = np.array([0.02 if drive.unit == "m" else 0.1 for drive in definition.drives])
    random = np.random.default_rng(seed)
    return definition.home_drives + spread * random.uniform(-1.0, 1.0, (count, len(definition.drives)))


def test_many_commands_equal_one_by_one(crooked):
    drives = commands(crooked, 6, seed=1)
    found = crooked.locate_drives(drives)
    loops = crooked.model.definition.loops
    assert (found.status == "closed").all()
    for k, one in enumerate(drives):
        location = crooked.location_at(one)
        for result, name in ((location.nominal, "nominal"), (location.actual, "actual")):
            pose = result.pose(loops.base_frame, loops.working_frame)
            seen = found[f"{name}_position"].sel(frame=loops.working_frame).values[k]
            np.testing.assert_allclose(seen, pose.translation, rtol=0, atol=1e-9)
    assert np.abs(found.error_position.values).max() > 5e-5


def test_transfer_is_the_derivative_of_the_closed_robot(crooked):
    """With respect to every drive: central differences of the closed pose, as an independent method."""
    drives, frame = commands(crooked, 1, seed=2)[0], crooked.model.definition.loops.working_frame
    base = crooked.model.definition.loops.base_frame
    here = crooked.location_at(drives).actual.pose(base, frame)
    found = crooked.transfer(drives, "drives")
    step = 1e-5
    for k in range(len(drives)):
        moved = step * np.eye(len(drives))[k]
        plus, minus = (crooked.location_at(drives + sign * moved).actual.pose(base, frame) for sign in (1.0, -1.0))
        shift = (plus.translation - minus.translation) / (2 * step)
        turn = pin.log3(plus.rotation @ minus.rotation.T) / (2 * step)
        assert relative_error(found.values[:, k], np.concatenate([shift, turn])) < 1e-6
    assert np.isfinite(here.homogeneous).all()


def test_transfer_accepts_the_commands_of_the_robot():
    """A target of the delta and a pose of the pouring robot, against the corresponding drives."""
    delta, pouring = Robot.load(ROBOTS / "delta" / "robot.yaml"), PouringRobot()
    for robot, command in (
        (delta, delta.pose_command(np.array([0.05, 0.02, -0.6]), None)),
        (pouring, PlatformPose.from_mm_deg(-100, 20, -600, 17)),
    ):
        at_drives = robot.transfer(robot.drives_of(command), "drives")
        np.testing.assert_allclose(robot.transfer(command, "drives"), at_drives, rtol=0, atol=1e-9)


def test_commands_without_a_pose_are_reported():
    """One leg of the hexapod five metres longer than the others."""
    robot = Robot.load(ROBOTS / "hexapod" / "robot.yaml")
    home = robot.model.definition.home_drives
    apart = home + 5.0 * np.eye(6)[0]
    found = robot.locate_drives([home, apart])
    assert found.status.values.tolist() == ["closed", "out of reach"]
    assert np.isnan(found.actual_position.values[1]).all()
    with pytest.raises(NoSolutionError, match="no pose of the drawing"):
        robot.location_at(apart)


def test_only_the_pouring_robot_has_heat_and_the_right_call_is_named():
    robot = Robot.load(ROBOTS / "arm" / "robot.yaml")
    with pytest.raises(BadInputError, match=r"this is a Robot; .* compensate_drives\(robot, "):
        HeatedRobot(robot, None)
    with pytest.raises(BadInputError, match="heat is the HeatSection of a model"):
        HeatedRobot(PouringRobot(), "hot")


@pytest.mark.parametrize("drives", [[1.0, 2.0], [[1.0, np.nan, 0.0]], [["a", 1, 2]], [[1.0, 2.0]]])
def test_other_arrays_are_refused(drives):
    robot = Robot.load(ROBOTS / "delta" / "robot.yaml")
    with pytest.raises((BadInputError, ValueError)):
        robot.locate_drives(drives)


def test_commands_are_copied():
    robot = Robot.load(ROBOTS / "delta" / "robot.yaml")
    drives = np.array([robot.model.definition.home_drives])
    found = robot.locate_drives(drives)
    drives[:] = 7.0
    assert (found.commanded_drives.values != 7.0).all()
    assert found.commanded_drives.attrs == {"units": "m or rad, see 'unit'"}
    assert robot.locate_drives([]).sizes["pose"] == 0


def test_drives_by_name_must_be_complete(crooked):
    names = crooked.drawing.mechanism.loops.drives
    told = dict.fromkeys(names, 0.25)
    offset = np.array(list(crooked.actual_drives(told).values())) - 0.25
    first = 3e-4 if crooked.model.definition.drives[0].unit == "m" else 4e-4
    np.testing.assert_allclose(offset, first * np.eye(len(names))[0], atol=1e-15)
    del told[names[-1]]
    with pytest.raises(BadInputError, match=f"the value of drive '{names[-1]}' is missing"):
        crooked.actual_drives(told)
    with pytest.raises(BadInputError, match="'elbow' is not a drive"):
        crooked.actual_drives({**told, "elbow": 0.0})


def test_a_payload_hangs_where_the_robot_file_says():
    """The force on each leg of the hexapod is the load, 0.1 m above the table, times its rise: virtual work."""
    robot, stiffness, payload_kg = Robot.load(ROBOTS / "hexapod" / "robot.yaml"), 1e9, 100.0
    legs = robot.drawing.mechanism.loops.drives
    drives = np.array(robot.model.definition.home_drives) + 0.02 * np.array([1, -1, 2, 0, 1, -2])

    def stretch(**payload):
        loads = Loads(gravity=True, drive_stiffness=dict.fromkeys(legs, stiffness), **payload)
        joints = Robot(robot.model, loads).location_at(drives).actual.joint_values
        return np.array([joints[leg] for leg in legs]) - drives

    def height(change):
        return robot.location_at(drives + change).actual.pose("base", "load_centre").translation[2]

    rises = [(height(step) - height(-step)) / 2e-5 for step in 1e-5 * np.eye(6)]
    found = stretch(payload_kg=payload_kg) - stretch()
    np.testing.assert_allclose(found, -payload_kg * 9.80665 / stiffness * np.array(rises), rtol=1e-3, atol=1e-11)


def test_axes_that_meet_in_a_point_may_miss_it(tmp_path):
    """A spherical wrist's drawing has no length; errors of its placements were refused, as beyond a tenth of 0 mm."""
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="{3}"/></joint>'
    links = "".join(f'<link name="{name}"/>' for name in ("base", "ring", "tool"))
    joints = joint.format("pan", "base", "ring", "0 0 1") + joint.format("tilt", "ring", "tool", "0 1 0")
    joints = joints.replace("</joint>", '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>')
    (tmp_path / "wrist.urdf").write_text(f'<robot name="wrist">{links}{joints}</robot>', encoding="utf-8")
    text = "format: pouring_robot/robot/1\nname: wrist\nurdf: wrist.urdf\nbase_frame: base\nend_frame: tool\n"
    (tmp_path / "robot.yaml").write_text(f"{text}drives: [{{joint: pan}}, {{joint: tilt}}]\n", encoding="utf-8")
    text = "format: pouring_robot/model/1\nrobot: robot.yaml\njoint_placements: {tilt: {translation_mm: [0.3, 0, 0]}}\n"
    (tmp_path / "model.yaml").write_text(text, encoding="utf-8")
    found = Robot.load(tmp_path / "model.yaml").locate_drives([[0.5, 0.2]])
    place = 0.3e-3 * np.array([np.cos(0.5), np.sin(0.5), 0.0])  # the tilt's axis moves with the pan
    np.testing.assert_allclose(found.actual_position.values[0, 0], place, rtol=0, atol=1e-15)
