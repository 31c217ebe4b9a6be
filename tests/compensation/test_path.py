"""Whole paths at once: the same drives as pose by pose, cold to rounding, warm up to a leg's difference in length."""

import numpy as np
import pytest

from pouring_robot.compensation.path import compensate_path
from pouring_robot.compensation.pose import compensate
from pouring_robot.exceptions import BadInputError, UnreachablePoseError
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureOptions
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location import OUT_OF_REACH
from pouring_robot.robot.model import DriveOffset
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, WarmPath, locate_path
from pouring_robot.thermal.network.thermal_network import ThermalNetwork
from tests.support import BOX_LOWER, BOX_UPPER, crooked_model

WANTED = np.random.default_rng(31).uniform(BOX_LOWER, BOX_UPPER, (4, 4))


@pytest.fixture(scope="module")
def robot():
    """A robot with tilted axes, displaced centres and a drive beyond its command."""
    model = crooked_model(seed=8, axis_mrad=0.5)
    return PouringRobot(model.model_copy(update={"drive_offsets": {"leg3_s3": DriveOffset(offset_mm=-0.4)}}))


def one_by_one(heated, frame):
    """Return the results of the search pose by pose."""
    return [compensate(heated, PlatformPose(tuple(row[:3].tolist()), float(row[3])), frame) for row in WANTED]


@pytest.mark.parametrize("frame", ["moving_platform", "ladle_lip"])
def test_a_cold_path_equals_the_search_pose_by_pose(robot, frame):
    heated = HeatedRobot(robot)
    path, singly = compensate_path(heated, WANTED, frame), one_by_one(heated, frame)
    assert set(path.status) == {"closed"}
    np.testing.assert_allclose(path.drives, [list(one.drives.values()) for one in singly], rtol=0, atol=1e-11)
    np.testing.assert_allclose(path.before_m, [one.before.distance_m for one in singly], rtol=0, atol=1e-11)
    np.testing.assert_allclose(path.roll_yaw_rad, [one.uncontrolled_rad for one in singly], rtol=0, atol=1e-11)
    assert np.abs(path.left).max() < 1e-9


def test_a_warm_path_differs_by_the_expansion_of_a_legs_difference_in_length(robot):
    """A kelvin, 12 µm in a metre of steel, for a few millimetres of leg: see ``expansion.warm_pouring_robot``."""
    heated = HeatedRobot(robot, HeatSection())
    path, singly = compensate_path(heated, WANTED), one_by_one(heated, None)
    drives = np.array([list(one.drives.values()) for one in singly])
    moved = np.abs(drives - compensate_path(HeatedRobot(robot), WANTED).drives).max()
    assert moved > 1e-3  # heat moves the drives by millimetres
    assert np.abs(path.drives - drives).max() < 1.2e-5


def test_a_path_uses_the_given_thermal_network(robot):
    """Without radiation hardly any heat reaches the legs."""
    network = ThermalNetwork(robot, radiation=False)
    heated = HeatedRobot(robot, HeatSection(), network)
    path, singly = compensate_path(heated, WANTED), one_by_one(heated, None)
    np.testing.assert_allclose(path.drives, [list(one.drives.values()) for one in singly], rtol=0, atol=1e-6)
    assert np.abs(path.drives - compensate_path(HeatedRobot(robot, HeatSection()), WANTED).drives).max() > 1e-3


def test_with_given_temperatures_heat_is_exact(robot):
    """Measured temperatures replace computed ones: nothing is sampled."""
    measured = {"leg1": 210.0, "leg2": 190.0, "leg3": 260.0, "leg4": 240.0, "platform": 320.0, "fixed_platform": 60.0}
    heated = HeatedRobot(robot, HeatSection(measured_degC=measured))
    path, singly = compensate_path(heated, WANTED), one_by_one(heated, None)
    np.testing.assert_allclose(path.drives, [list(one.drives.values()) for one in singly], rtol=0, atol=1e-10)


def test_a_warm_path_is_located_as_pose_by_pose(robot):
    heated = HeatedRobot(robot, HeatSection())
    found, closed = locate_path(heated, WANTED)
    for k, row in enumerate(WANTED):
        one = heated.locate(PlatformPose(tuple(row[:3].tolist()), float(row[3]))).location
        for frame in ("moving_platform", "ladle_lip"):
            error = found.error_position.sel(frame=frame).values[k]
            # It is weak sideways: a kelvin between two legs, 12 µm in a metre, makes ten times as much there.
            assert np.abs(error - one.difference(frame).translation_m).max() < 1e-4
    cold, _ = locate_path(HeatedRobot(robot), WANTED)
    np.testing.assert_array_equal(cold.error_position, robot.locate(WANTED).error_position)
    assert closed.closed.all()


def test_neighbours_on_a_path_share_only_the_start(robot):
    """Each pose of a dense path is where it is alone, up to the 10 µm of a leg by which its start may be off."""
    heated = HeatedRobot(robot, HeatSection())
    dense = WANTED[0] + np.linspace(0.0, 0.009, 4)[:, None] * [1.0, -1.0, 1.0, 1.0]
    found, _ = locate_path(heated, dense)
    for k in range(len(dense)):
        alone, _ = locate_path(heated, dense[k : k + 1])
        np.testing.assert_allclose(found.error_position[k], alone.error_position[0], rtol=0, atol=1e-5)


def test_poses_without_an_answer_say_why(robot):
    """Also where loops do not close, stay open or close elsewhere: the limits, as pose by pose."""
    far = np.array([[-0.1, 0.0, -0.6, 0.3], [-0.1, 0.0, -1.4, 0.3], [50.0, 0.0, -0.6, 0.0], [0.0, 0.0, 0.0, 0.0]])
    far = np.vstack([far, [-0.1, 0.0, -0.6, 100.0]])
    path = compensate_path(HeatedRobot(robot), far)
    assert path.status.tolist() == ["closed", *[OUT_OF_REACH] * 4]
    for values in (path.drives, path.before_m, path.left):
        assert np.isfinite(values[0]).all() and np.isnan(values[1:]).all()
    assert "1 of 5 poses" in path.headline and list(path.to_frame().status) == list(path.status)


def test_a_direction_that_no_drive_moves_is_reported(robot, monkeypatch):
    """It is at one pose of the path; the others are found."""
    follow = WarmPath.drives_to_end

    def without_the_second_drive(*asked):
        moved = follow(*asked)
        moved[1] *= [1.0, 0.0, 1.0, 1.0]
        return moved

    monkeypatch.setattr(WarmPath, "drives_to_end", without_the_second_drive)
    path = compensate_path(HeatedRobot(robot), WANTED)
    assert path.status.tolist() == ["closed", "singular", "closed", "closed"]
    assert np.isnan(path.drives[1]).all()


def test_loops_that_stay_open_are_reported(robot):
    """Also where the search continues for other poses."""
    most = float(np.median([robot.locate(PlatformPose(tuple(row[:3]), row[3])).actual.gap_rad for row in WANTED]))
    strict = PouringRobot(robot.model, options=ClosureOptions(max_gap_rad=most))
    assert {*compensate_path(HeatedRobot(strict), WANTED).status} == {"closed", "left open too far"}


def test_drives_are_not_commanded_beyond_their_limits(robot):
    """A leg that is 2 mm short of its command reaches all but the last millimetres of its stroke."""
    short = PouringRobot(robot.model.model_copy(update={"drive_offsets": {"leg3_s3": DriveOffset(offset_mm=-2.0)}}))
    _, most = robot.kinematics.mechanism.joint_limits()["leg3_s3"]
    drives = short.drives_of(PlatformPose((-0.1, 0.0, -0.85), 0.0))
    stretched = [*drives[:2], most - 1e-3, drives[3]]
    wanted = short.kinematics.forward(short.kinematics.mechanism.named_drives(np.array(stretched)))
    with pytest.raises(UnreachablePoseError, match="leg3_s3"):
        compensate(short, wanted)
    assert compensate_path(HeatedRobot(short), [wanted]).status.tolist() == [OUT_OF_REACH]


def test_requests_that_no_batch_can_serve_are_refused(robot):
    with pytest.raises(BadInputError, match="shape"):
        compensate_path(HeatedRobot(robot), WANTED[:, :3])
    with pytest.raises(BadInputError, match="threads"):
        compensate_path(HeatedRobot(robot), WANTED, threads=0)
    with pytest.raises(BadInputError, match="under loads"):
        compensate_path(HeatedRobot(PouringRobot(robot.model, Loads(gravity=True))), WANTED)


def test_a_robot_that_is_not_a_heated_one_is_refused(drawing):
    with pytest.raises(BadInputError, match=r"HeatedRobot\(robot\) of a cold robot, not a PouringRobot"):
        compensate_path(drawing, [[0.0, 0.0, -0.6, 0.0]])
