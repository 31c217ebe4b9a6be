"""What is drawn of locations: robots with enlarged errors, a step for each, and the arrows."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.view.nominal_and_actual import exaggeration_for, pose_scene
from pouring_robot.viewer import solids
from tests.support import ROOT, random_poses


def _ladle(scene, step, group):
    """Return the pose of the ladle's body in a scene."""
    (body,) = [s for s in solids(scene, step) if s.group == group and s.name == "ladle_0"]
    return body.pose_world_to_solid


@pytest.mark.parametrize("factor", [0.5, 1.0, 20.0, 300.0])
def test_the_ladle_is_drawn_at_nominal_plus_factor_times_the_difference(as_built, very_crooked, factor):
    for robot in (as_built, very_crooked):
        locations = [robot.locate(pose) for pose in random_poses(3, seed=80)]
        scene, plain = pose_scene(locations, factor), pose_scene(locations, 1.0)
        for step, location in enumerate(locations):
            # Any point fixed on the body: its visual, placed by forward kinematics of either closure.
            nominal, actual = (_ladle(plain, step, group) for group in ("nominal", "actual"))
            drawn = _ladle(scene, step, "actual")
            turn = pin.log3(actual[:3, :3] @ nominal[:3, :3].T)
            assert drawn[:3, :3] == pytest.approx(pin.exp3(factor * turn) @ nominal[:3, :3], abs=1e-9)
            assert turn == pytest.approx(location.difference().rotation_rad, abs=1e-9)  # the base does not rotate
            body = location.actual.mechanism.shared_model.frames[
                location.actual.mechanism.frame_id("ladle")
            ].parentJoint
            before, after = scene.robots[0].reference[step, body], scene.robots[0].bodies[step, body]
            shift = factor * (after - before)[:3, 3]
            moved = np.eye(4)
            moved[:3, :3], moved[:3, 3] = pin.exp3(factor * turn) @ before[:3, :3], before[:3, 3] + shift
            assert drawn == pytest.approx(moved @ np.linalg.inv(before) @ nominal, abs=1e-9)


def test_factor_one_is_the_actual_robot(very_crooked):
    for pose in random_poses(3, seed=81):
        location = very_crooked.locate(pose)
        ladle, nominal = (_ladle(pose_scene([location], 1.0), 0, group) for group in ("actual", "nominal"))
        frames = [one.pose("universe", "ladle").homogeneous for one in (location.actual, location.nominal)]
        assert np.linalg.inv(frames[0]) @ ladle == pytest.approx(np.linalg.inv(frames[1]) @ nominal, abs=1e-12)


def test_a_scene_has_a_step_and_an_arrow_for_each_pose_and_begins_with_the_worst(as_built):
    locations = [as_built.locate(pose) for pose in random_poses(4, seed=83)]
    errors = [location.difference("ladle_lip").distance_m for location in locations]
    scene = pose_scene(locations, 10.0)
    assert scene.exaggeration == 10.0
    assert scene.first == int(np.argmax(errors))
    assert [robot.name for robot in scene.robots] == ["actual", "nominal"]
    assert 0.0 < scene.robots[1].opacity < 1.0 == scene.robots[0].opacity
    one, every = scene.arrows
    for step, (location, error) in enumerate(zip(locations, errors, strict=True)):
        lip = location.nominal.pose("universe", "ladle_lip").translation
        assert one.starts_m[step, 0] == pytest.approx(lip, abs=1e-12)
        assert every.starts_m[0, step] == pytest.approx(lip, abs=1e-12)
        actual = location.actual.pose("universe", "ladle_lip").translation
        assert one.vectors_m[step, 0] == pytest.approx(actual - lip, abs=1e-12)
        x, y, z, tilt = location.commanded.to_mm_deg()
        assert f"pose {step + 1}: x {x:.0f}, y {y:.0f}, z {z:.0f} mm, tilt {tilt:.1f}°" == scene.steps[step].label
        assert scene.curves[0].values[step] == pytest.approx(error * 1e3)


def test_one_pose_has_no_time_bar(as_built):
    location = as_built.locate(PlatformPose((-0.1, 0.0, -0.6), 0.2))
    scene = pose_scene([location])
    assert (len(scene.steps), len(scene.arrows), scene.curves) == (1, 1, ())
    assert location.title in scene.title


def test_automatic_factor_is_round_and_never_reduces(as_built, drawing):
    pose = PlatformPose((-0.1, 0.0, -0.6), 0.2)
    factor = pose_scene([as_built.locate(pose)]).exaggeration
    assert factor in {step * 10**power for step in (1, 2, 5) for power in range(4)}
    error = as_built.locate(pose).difference("ladle_lip").distance_m
    assert 0.05 < factor * error <= 0.2
    assert pose_scene([drawing.locate(pose)]).exaggeration == exaggeration_for(0.0) == 1000.0


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf"), 1001.0])
def test_bad_factors(as_built, factor):
    location = as_built.locate(PlatformPose((-0.1, 0.0, -0.6), 0.2))
    with pytest.raises(BadInputError, match="exaggeration"):
        pose_scene([location], factor)


def test_no_pose_no_scene():
    with pytest.raises(BadInputError, match="no pose"):
        pose_scene([])


def test_a_robot_without_visuals_is_drawn_as_lines_between_its_joints():
    """An empty picture would look like a fault. Two lines are upper arm, with its offset, and forearm."""
    robot = Robot(RobotModel.for_robot(ROOT / "examples" / "machines" / "ur10" / "robot.yaml"))
    location = robot.location_at(np.radians([10.0, -80.0, 70.0, 10.0, 20.0, 30.0]))
    scene = pose_scene([location])
    assert [one.label for one in scene.robots] == [
        "as built: lines between its joints, as its URDF has no visuals",
        "as commanded: lines between its joints, as its URDF has no visuals",
    ]
    lines = [item for item in scene.robots[0].visual.geometryObjects if isinstance(item.geometry, coal.Capsule)]
    lengths = [2.0 * item.geometry.halfLength for item in lines]
    for length in (np.hypot(0.612, 0.1719), 0.5723):
        assert min(abs(length - one) for one in lengths) < 1e-4
    model = location.actual.mechanism.shared_model
    for item in lines:  # each starts in its joint and ends in a joint or frame that this carries
        half = item.placement.rotation[:, 2] * item.geometry.halfLength
        np.testing.assert_allclose(item.placement.translation - half, 0.0, atol=1e-9)
        carried = [
            model.jointPlacements[k].translation
            for k in range(1, model.njoints)
            if model.parents[k] == item.parentJoint
        ]
        carried += [one.placement.translation for one in model.frames if one.parentJoint == item.parentJoint]
        assert min(np.linalg.norm(one - item.placement.translation - half) for one in carried) < 1e-9
