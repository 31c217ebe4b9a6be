"""What is drawn of a location: the exaggerated robot and the arrows."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.scene import automatic_exaggeration, enlarged_pose, exaggerated_configuration, pose_scene
from tests.support import pose_gap, random_poses


def frame_pose(mechanism, configuration, frame, base="fixed_platform"):
    model = mechanism.copy_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.asarray(configuration))
    return data.oMf[model.getFrameId(base)].actInv(data.oMf[model.getFrameId(frame)])


@pytest.mark.parametrize("factor", [0.5, 1.0, 20.0, 300.0])
def test_the_platform_stands_at_nominal_plus_factor_times_the_difference(as_built, very_crooked, factor):
    for robot in (as_built, very_crooked):
        for pose in random_poses(3, seed=80):
            location = robot.locate(pose)
            drawn = frame_pose(
                location.actual.mechanism, exaggerated_configuration(location, factor), "moving_platform"
            )
            nominal, actual = location.poses("moving_platform")
            translation = nominal.translation + factor * (actual.translation - nominal.translation)
            turn = pin.exp3(factor * pin.log3(actual.rotation @ nominal.rotation.T)) @ nominal.rotation
            assert pose_gap(drawn, pin.SE3(turn, translation)) == pytest.approx([0.0, 0.0], abs=1e-9)


def test_factor_one_is_the_actual_robot(very_crooked):
    for pose in random_poses(5, seed=81):
        location = very_crooked.locate(pose)
        configuration = exaggerated_configuration(location, 1.0)
        drawn = frame_pose(location.actual.mechanism, configuration, "moving_platform")
        assert pose_gap(drawn, location.actual.pose_base_to_end) == pytest.approx([0.0, 0.0], abs=1e-12)
        assert configuration == pytest.approx(location.actual.configuration, abs=1e-9)


def test_truss_travel_does_not_spoil_it(as_built):
    (pose,) = random_poses(1, seed=82)
    location = as_built.locate(pose)
    solver = as_built.actual_solver
    travels = {"truss_travel": 5.0, "trolley_travel": 0.7}
    moved = [
        s.solve({}, s.mechanism.with_joint_values(result.configuration, travels))
        for s, result in ((as_built.nominal_solver, location.nominal), (solver, location.actual))
    ]
    elsewhere = dataclasses.replace(location, nominal=moved[0], actual=moved[1])
    here = frame_pose(solver.mechanism, exaggerated_configuration(location, 50.0), "moving_platform")
    there = frame_pose(solver.mechanism, exaggerated_configuration(elsewhere, 50.0), "moving_platform")
    assert pose_gap(here, there) == pytest.approx([0.0, 0.0], abs=1e-9)


def test_enlarged_pose_by_hand():
    nominal = pin.SE3(pin.utils.rotate("y", 0.3), np.array([1.0, 2.0, 3.0]))
    difference = PoseDifference(np.array([0.001, 0.0, -0.002]), np.array([0.0, 0.0, 0.01]))
    drawn = enlarged_pose(nominal, difference, 100.0)
    assert drawn.translation == pytest.approx([1.1, 2.0, 2.8], abs=1e-14)
    assert drawn.rotation == pytest.approx(pin.utils.rotate("z", 1.0) @ nominal.rotation, abs=1e-14)


def test_scene_shows_the_worst_pose_and_an_arrow_each(as_built):
    locations = [as_built.locate(pose) for pose in random_poses(4, seed=83)]
    errors = [location.difference("ladle_lip").distance_m for location in locations]
    worst = locations[int(np.argmax(errors))]
    scene = pose_scene(locations, 10.0)
    assert scene.exaggeration == 10.0
    assert [robot.name for robot in scene.robots] == ["actual", "nominal"]
    assert 0.0 < scene.robots[1].opacity < 1.0 == scene.robots[0].opacity
    assert scene.robots[1].configuration.tolist() == worst.nominal.configuration.tolist()
    assert len(scene.arrows) == 4
    as_drawn, mechanism = worst.nominal.mechanism, worst.actual.mechanism
    for location, arrow, error in zip(locations, scene.arrows, errors, strict=True):
        nominal = frame_pose(as_drawn, location.nominal.configuration, "ladle_lip", base="universe")
        drawn = frame_pose(mechanism, exaggerated_configuration(location, 10.0), "ladle_lip", base="universe")
        assert arrow.start_m == pytest.approx(nominal.translation, abs=1e-12)
        assert arrow.end_m == pytest.approx(drawn.translation, abs=1e-9)
        assert arrow.label == f"{error * 1e3:.2f} mm"
    x, y, z, tilt = worst.commanded.to_mm_deg()
    assert f"x {x:.0f}, y {y:.0f}, z {z:.0f} mm, tilt {tilt:.1f}°" in scene.title


def test_automatic_factor_is_round_and_never_reduces(as_built, drawing):
    pose = PlatformPose((-0.1, 0.0, -0.6), 0.2)
    factor = automatic_exaggeration([as_built.locate(pose)])
    assert factor in {step * 10**power for step in (1, 2, 5) for power in range(4)}
    error = as_built.locate(pose).difference("ladle_lip").distance_m
    assert 0.05 < factor * error <= 0.2
    assert automatic_exaggeration([drawing.locate(pose)]) == 1000.0


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf"), 1001.0])
def test_bad_factors(as_built, factor):
    location = as_built.locate(PlatformPose((-0.1, 0.0, -0.6), 0.2))
    with pytest.raises(BadInputError, match="exaggeration"):
        pose_scene([location], factor)


def test_no_pose_no_scene():
    with pytest.raises(BadInputError, match="no pose"):
        pose_scene([])
