"""Consistent temperatures and pose: convergence of the iteration, shares, and what comes from the model."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pouring_robot.compensation.pose import compensate
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.units import shown_in
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import DriveOffset, RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.view.bench import with_errors
from pouring_robot.thermal.expansion.leg_growth import ThermalExpansion
from pouring_robot.thermal.expansion.warm_pouring_robot import SETTLED_M, HeatedRobot, WarmRobot, drawing_of
from tests.support import random_poses

POSE = PlatformPose((-0.100, 0.020, -0.600), 0.3)
COLD = ThermalExpansion((0.0, 0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def heated(as_built):
    return HeatedRobot(as_built, HeatSection())


def test_temperatures_are_those_of_where_the_ladle_is(heated):
    for pose in random_poses(4, seed=4):
        state = heated.locate(pose)
        assert state.unsettled_m < SETTLED_M
        again = heated.network.steady(state.result)
        assert again.leg_degC == pytest.approx(state.field.leg_degC, abs=1e-5)
        # The drawing's place is millimetres away: its temperatures are others.
        there = heated.network.steady(pose)
        assert np.abs(there.leg_degC - state.field.leg_degC).max() > 1e-3


def test_the_warm_location_is_one_closure_of_everything(heated, as_built):
    found = heated.locate(POSE)
    once = WarmRobot(as_built, found.robot.expansion, POSE).solve().pose_base_to_end
    assert PoseDifference.between(found.location.actual.pose_base_to_end, once).distance_m < 1e-12
    assert found.location.nominal.pose_base_to_end.translation == pytest.approx(POSE.position_m, abs=1e-12)


def test_threads_share_a_network(heated):
    """More poses than it keeps."""
    poses = random_poses(48, seed=11)
    alone = [heated.network.steady(pose).temperatures_K for pose in poses]
    with ThreadPoolExecutor(4) as pool:
        shared = list(pool.map(lambda pose: heated.network.steady(pose).temperatures_K, reversed(poses)))
    np.testing.assert_array_equal(shared, alone[::-1])


def test_shares(heated, as_built):
    found = heated.locate(POSE)
    for frame, shares in heated.shares(found, ("moving_platform", "ladle_lip")).items():
        cold = as_built.locate(POSE).difference(frame)
        assert shares.geometry.translation_m == pytest.approx(cold.translation_m, abs=1e-12)
        assert shares.together.translation_m == pytest.approx(found.location.difference(frame).translation_m)
        whole = shares.geometry.translation_m + shares.heat.translation_m + shares.remainder.translation_m
        assert whole == pytest.approx(shares.together.translation_m, abs=1e-15)
        assert 1e-7 < np.linalg.norm(shares.remainder.translation_m) < 0.05 * shares.together.distance_m
    assert list(heated.shares(found, "ladle_lip")) == ["ladle_lip"]


def test_warm_robots_and_what_is_found_with_them_go_to_other_processes(heated):
    found = compensate(heated, POSE)
    robot, again = pickle.loads(pickle.dumps((heated, found)))
    assert again.drives == found.drives and again.state.field.leg_degC.tolist() == found.state.field.leg_degC.tolist()
    assert compensate(robot, POSE).drives == pytest.approx(found.drives, abs=1e-12)
    assert robot.network.properties == heated.network.properties
    assert robot.robot.layout == heated.robot.layout
    assert repr(heated).startswith("<HeatedRobot: layout paper, melt_degC=None ") and "\n" not in repr(heated)
    assert repr(found.state).startswith("<WarmState: ladle_lip is ") and "\n" not in repr(found.state)
    with pytest.raises(BadInputError, match="the growth of the parts is a ThermalExpansion, not a float"):
        WarmRobot(heated.robot, 1e-3, POSE)
    assert repr(HeatedRobot(heated.robot)) == "<HeatedRobot: layout paper, cold>"


def test_without_heat_it_is_the_robot_as_built(as_built):
    found = HeatedRobot(as_built).locate(POSE)
    cold = as_built.locate(POSE).actual.pose_base_to_end
    assert PoseDifference.between(found.location.actual.pose_base_to_end, cold).distance_m < 1e-12
    assert (found.field, found.turns) == (None, 1)


def test_drive_offsets_of_the_model_count(drawing):
    """An offset and a warm leg: length = (commanded + offset) (1 + strain), against the drawing at those lengths."""
    model = RobotModel(drive_offsets={"leg1_s3": DriveOffset(offset_mm=2.0), "leg4_s5": DriveOffset(offset_mrad=3.0)})
    strain = 1.2e-3
    warm = ThermalExpansion((strain, strain, strain, 0.0))
    found = WarmRobot(PouringRobot(model), warm, POSE).solve().pose_base_to_end
    drives = drawing.kinematics.inverse(POSE)
    lengths = {name: (drives[name] + 0.002 * (name == "leg1_s3")) * (1.0 + strain) for name in drives if "s3" in name}
    expected = drawing.kinematics.forward(lengths | {"leg4_s5": drives["leg4_s5"] + 0.003}, near=POSE)
    assert found.translation == pytest.approx(expected.position_m, abs=1e-12)
    assert PlatformPose.from_se3(found).tilt_rad == pytest.approx(expected.tilt_rad, abs=1e-12)
    alone = WarmRobot(drawing_of(PouringRobot(model)), warm, POSE).solve().pose_base_to_end
    assert np.abs(alone.translation - found.translation).max() > 1e-4


def test_a_long_time_is_steady_and_a_short_one_is_not(as_built):
    steady, hour, week = (
        HeatedRobot(as_built, HeatSection(after_min=minutes)).locate(POSE).field
        for minutes in (None, 60.0, 7.0 * 24.0 * 60.0)
    )
    assert week.leg_degC == pytest.approx(steady.leg_degC, abs=1e-2)
    assert np.all(hour.leg_degC < steady.leg_degC - 5.0)


def test_measured_temperatures_and_properties_of_the_model_count(as_built):
    plain = HeatedRobot(as_built, HeatSection()).locate(POSE)
    measured = HeatedRobot(as_built, HeatSection(measured_degC={"leg3": 20.0})).locate(POSE)
    assert measured.robot.expansion.leg_strain[2] == 0.0
    assert measured.robot.expansion.leg_strain[0] > 1e-3
    dull = HeatedRobot(as_built, HeatSection(properties={"steel": {"emissivity": 0.2}})).locate(POSE)
    assert np.all(dull.field.leg_degC < plain.field.leg_degC - 30.0)


def test_a_warm_robot_at_no_expansion_is_cold(as_built):
    warm = WarmRobot(as_built, COLD, POSE).locate(POSE)
    assert warm.difference().translation_m == pytest.approx(as_built.locate(POSE).difference().translation_m, abs=1e-12)


def test_many_poses_of_a_warm_robot_are_as_warm_as_one(as_built):
    """One is closed by Newton from the drawing's pose, many are closed together: legs grow in both."""
    warm, poses = (
        WarmRobot(as_built, ThermalExpansion((1e-3, 2e-3, 3e-3, 4e-3)), POSE),
        [POSE, *random_poses(2, seed=5)],
    )
    tip = warm.actual_solver.mechanism.loops.working_frame
    many = warm.locate(poses).sel(frame=tip)
    for pose, one in zip(poses, many.transpose("pose", ...).error_position.values, strict=True):
        alone = warm.locate(pose).difference().translation_m
        assert one == pytest.approx(alone, abs=1e-9)
        assert np.linalg.norm(one - as_built.locate(pose).difference().translation_m) > 1e-4


def test_a_warm_robot_stays_warm_with_other_errors_and_its_drives_errors_grow(as_built):
    """G of a warm robot against central differences of it with one more error."""
    warm, size = WarmRobot(as_built, ThermalExpansion((1e-3, 2e-3, 3e-3, 4e-3), 5e-3, 6e-3), POSE), 1e-5
    same = warm.built_as(warm.model).locate(POSE).difference()
    assert same.translation_m == pytest.approx(warm.locate(POSE).difference().translation_m, abs=1e-12)
    matrix = warm.transfer(POSE, ("drives", "leg2_s1.tx"))
    for name in matrix.parameter.values.tolist():
        error = warm.parameters.parameters[name]
        ends = [
            warm.built_as(with_errors(warm.model, {error: sign * size / shown_in(error.unit)[1]}))
            .locate(POSE)
            .actual.pose("fixed_platform", "ladle_lip")
            for sign in (-1.0, 1.0)
        ]
        moved = PoseDifference.between(*ends).translation_m / (2.0 * size)
        assert matrix.sel(parameter=name).values[:3] == pytest.approx(moved, abs=2e-5)


def test_a_warm_robot_is_not_warmed_again_nor_taken_for_a_cold_one(as_built):
    warm = WarmRobot(as_built, ThermalExpansion((1e-3, 2e-3, 3e-3, 4e-3)), POSE)
    for ask in (HeatedRobot, lambda robot: compensate(robot, POSE)):
        with pytest.raises(BadInputError, match="warm already: give the robot it was made of"):
            ask(warm)
