"""Closed forms of the nominal mechanism: check values of the design, round trips, limits and branches."""

import math

import numpy as np
import pytest

from pouring_robot.exceptions import BadInputError, NoSolutionError, PouringRobotError, UnreachablePoseError
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.joint_limits import JointReach, joint_reach
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from tests.support import BOX_LOWER, BOX_UPPER, displacement, perturbed, pose_gap, random_poses

# U-joint centres in m.
CENTRES = {
    "paper": ((0.340, 0.374), (0.1825, 0.330)),
    "wide": ((0.187, 0.340), (0.165, 0.1825)),
}
SIGNS = np.array([[-1, 1], [-1, -1], [1, 1], [1, -1]])


@pytest.fixture(scope="module", params=["paper", "wide"])
def layout(request):
    mechanism = RobotModel(layout=request.param).definition.mechanism()
    return request.param, FourUPUKinematics(mechanism)


def test_check_values_of_the_design(drawing):
    drives = drawing.kinematics.inverse(PlatformPose((-0.100, 0.020, -0.600), 0.3))
    assert list(drives) == ["leg1_s3", "leg2_s3", "leg3_s3", "leg4_s5"]
    lengths_mm = [drives[f"leg{i}_s3"] * 1e3 for i in (1, 2, 3)]
    assert lengths_mm == pytest.approx([550.5232, 553.7110, 706.2394], abs=5e-5)
    assert drives["leg4_s5"] == pytest.approx(-0.0858709, abs=5e-8)
    values = drawing.kinematics.joint_values(PlatformPose((-0.100, 0.020, -0.600), 0.3))
    assert values["leg4_s3"] * 1e3 == pytest.approx(708.727, abs=5e-4)


def test_centres_are_those_of_the_layout(layout):
    name, kinematics = layout
    fixed, moving = CENTRES[name]
    assert kinematics.fixed_centres_m == pytest.approx(np.column_stack([SIGNS * fixed, np.zeros(4)]), abs=1e-15)
    assert kinematics.moving_centres_m == pytest.approx(np.column_stack([SIGNS * moving, np.zeros(4)]), abs=1e-15)


def test_inverse_is_the_geometry_of_the_legs(layout):
    """Lengths by distance of the centres, angles by the direction cosines of the leg."""
    name, kinematics = layout
    fixed, moving = (np.column_stack([SIGNS * half, np.zeros(4)]) for half in CENTRES[name])
    for pose in random_poses(200, seed=50):
        rotation = pose.to_se3().rotation
        legs = np.array(pose.position_m) + moving @ rotation.T - fixed
        values = kinematics.joint_values(pose)
        for i, leg in enumerate(legs, start=1):
            s1, s2, s3, s4, s5 = (values[f"leg{i}_s{j}"] for j in range(1, 6))
            assert s3 == pytest.approx(np.linalg.norm(leg), abs=1e-14)
            # The leg is its length along -z, rotated by S2 about x and then by S1 about y.
            turned = [-math.sin(s1) * math.cos(s2), math.sin(s2), -math.cos(s1) * math.cos(s2)]
            assert turned == pytest.approx(leg / s3, abs=1e-14)
            assert s4 == -s2
            assert s1 + s5 == pytest.approx(pose.tilt_rad, abs=1e-14)


def test_chain_joints_take_arrays(layout):
    _, kinematics = layout
    poses = random_poses(12, seed=51)
    positions = np.array([pose.position_m for pose in poses]).reshape(3, 4, 3)
    tilts = np.array([pose.tilt_rad for pose in poses]).reshape(3, 4)
    together = kinematics.chain_joints(positions, tilts)
    assert together.shape == (3, 4, 4, 5)
    for k, pose in enumerate(poses):
        alone = kinematics.joint_values(pose)
        at = np.unravel_index(k, (3, 4))
        assert together[at][:, 2].tolist() == [alone[f"leg{i}_s3"] for i in (1, 2, 3, 4)]
        assert together[at][:, 4].tolist() == [alone[f"leg{i}_s5"] for i in (1, 2, 3, 4)]


def test_nominal_configuration_is_closed(layout):
    _, kinematics = layout
    solver = ClosureSolver(kinematics.mechanism)
    for pose in random_poses(50, seed=52):
        configuration = kinematics.configuration(pose)
        assert np.abs(solver.energy.evaluate(configuration, configuration).residual).max() < 1e-14
        found = solver.solve({}, configuration)
        assert pose_gap(found.pose_base_to_end, pose.to_se3()) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_forward_returns_the_pose(layout):
    _, kinematics = layout
    for pose in random_poses(2_000, seed=53):
        found = kinematics.forward(kinematics.inverse(pose), near=pose)
        assert found.position_m == pytest.approx(pose.position_m, abs=1e-10)
        assert found.tilt_rad == pytest.approx(pose.tilt_rad, abs=1e-10)


def test_forward_without_a_start_takes_the_assembly_mode_of_the_workspace(drawing):
    poses = random_poses(2_000, seed=54)
    corners = np.array(np.meshgrid(*zip(BOX_LOWER, BOX_UPPER, strict=True))).reshape(4, -1).T
    poses += [PlatformPose(tuple(corner[:3].tolist()), float(corner[3])) for corner in corners]
    for pose in poses:
        found = drawing.kinematics.forward(drawing.kinematics.inverse(pose))
        assert found.position_m == pytest.approx(pose.position_m, abs=1e-9)


def test_near_chooses_the_branch(drawing):
    kinematics = drawing.kinematics
    pose = PlatformPose((-0.1, 0.02, -0.6), 0.3)
    drives = kinematics.inverse(pose)
    there = kinematics.forward(drives, near=pose)
    other = kinematics.forward(drives, near=PlatformPose((0.5, 0.02, 0.3), 0.3 + math.pi))
    assert there.position_m == pytest.approx(pose.position_m, abs=1e-12)
    assert np.linalg.norm(np.subtract(other.position_m, pose.position_m)) > 0.1
    # The other assembly mode has the same drives: both are solutions.
    values = kinematics.joint_values(other)
    assert [values[name] for name in list(drives)[:3]] == pytest.approx(list(drives.values())[:3], abs=1e-12)
    assert math.remainder(values["leg4_s5"] - drives["leg4_s5"], 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
    # The choice does not depend on full turns of the tilt.
    turned = kinematics.forward(drives, near=PlatformPose(pose.position_m, pose.tilt_rad + 2 * math.pi))
    assert turned == there


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"leg1_s3": 0.9, "leg2_s3": 0.3}, "sideways"),
        ({"leg1_s3": 0.3, "leg2_s3": 0.3, "leg3_s3": 1.1}, "cannot meet"),
        ({"leg3_s3": 0.01}, "sideways"),
    ],
)
def test_forward_without_solution(drawing, changes, words):
    drives = drawing.kinematics.inverse(PlatformPose((-0.1, 0.0, -0.6), 0.0))
    with pytest.raises(NoSolutionError, match=words) as caught:
        drawing.kinematics.forward(drives | changes)
    assert caught.value.exit_code == 3
    assert "mm" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_forward_refuses_values_that_are_no_numbers(drawing, value):
    drives = drawing.kinematics.inverse(PlatformPose((-0.1, 0.0, -0.6), 0.0))
    for name in drives:
        with pytest.raises(PouringRobotError):
            drawing.kinematics.forward(drives | {name: value})


def test_forward_needs_one_value_for_each_drive(drawing):
    drives = drawing.kinematics.inverse(PlatformPose((-0.1, 0.0, -0.6), 0.0))
    for forward in (drawing.kinematics.forward, drawing.forward):
        for name in drives:
            fewer = {drive: value for drive, value in drives.items() if drive != name}
            with pytest.raises(BadInputError, match=f"'{name}' is missing; give all of leg1_s3, leg2_s3"):
                forward(fewer)
        with pytest.raises(BadInputError, match="'leg2_s33' is not a drive; did you mean 'leg2_s3'"):
            forward(drives | {"leg2_s33": 0.5})
        with pytest.raises(BadInputError, match="are a mapping by the names of their joints, not a list"):
            forward(list(drives.values()))
    with pytest.raises(BadInputError, match="is missing"):
        drawing.forward({}, near=PlatformPose((-0.1, 0.0, -0.6), 0.0))


def test_forward_needs_legs_in_common_planes(drawing):
    displaced_joint = {"leg2_s1": displacement((0.01, 0.0, 0.0))}
    kinematics = FourUPUKinematics(perturbed(drawing.nominal_solver.mechanism, displaced_joint))
    drives = drawing.kinematics.inverse(PlatformPose((-0.1, 0.0, -0.6), 0.0))
    with pytest.raises(NoSolutionError, match="common planes"):
        kinematics.forward(drives)


# --- limits -----------------------------------------------------------------------------------------


def test_the_whole_box_is_within_the_limits(layout):
    name, kinematics = layout
    edges = [np.linspace(low, high, 7) for low, high in zip(BOX_LOWER, BOX_UPPER, strict=True)]
    for x, y, z, tilt in np.array(np.meshgrid(*edges)).reshape(4, -1).T:
        worst = joint_reach(kinematics.mechanism, kinematics.joint_values(PlatformPose((x, y, z), tilt)))[0]
        assert worst.margin >= 0.0, name


@pytest.mark.parametrize(
    ("pose", "joint", "excess"),
    [
        # Straight down at tilt 0, y 0: leg length by Pythagoras over the half-width differences, limit 1100 mm.
        (((0.0, 0.0, -1.3), 0.0), "leg", math.sqrt(1.3**2 + 0.1575**2 + 0.044**2) - 1.1),
        (((0.0, 0.0, -0.15), 0.0), "leg", 0.26 - math.sqrt(0.15**2 + 0.1575**2 + 0.044**2)),
        # Sideways: S2 = asin(dy / l), the wider pair of legs 0.3 m off.
        (((0.0, 0.3, -0.4), 0.0), "leg", math.asin(0.344 / math.sqrt(0.4**2 + 0.1575**2 + 0.344**2)) - 0.40),
    ],
)
def test_unreachable_pose_names_joint_and_excess(drawing, pose, joint, excess):
    with pytest.raises(UnreachablePoseError) as caught:
        drawing.kinematics.inverse(PlatformPose(*pose))
    error = caught.value
    assert error.joint.startswith(joint)
    assert error.excess == pytest.approx(excess, abs=1e-12)
    prismatic = error.joint.endswith("s3")
    shown = f"{excess * 1e3:.2f} mm" if prismatic else f"{math.degrees(excess):.2f} deg"
    assert f"'{error.joint}'" in str(error)
    assert f"{shown} beyond" in str(error)
    assert "\n" not in str(error)
    assert error.exit_code == 3


def test_reach_is_sorted_by_share_of_the_range(drawing):
    values = drawing.kinematics.joint_values(PlatformPose((-0.1, 0.02, -0.6), 0.3))
    reach = joint_reach(drawing.kinematics.mechanism, values)
    assert len(reach) == 20
    shares = [min(r.value - r.lower, r.upper - r.value) / (r.upper - r.lower) for r in reach]
    assert shares == sorted(shares)
    assert [r.relative_margin for r in reach] == pytest.approx(shares, abs=1e-15)
    assert JointReach("j", "m", 1.2, 0.0, 1.0).margin == pytest.approx(-0.2)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "position",
    [
        (0.1825 - 0.34, 0.374 - 0.33, 0.0),  # the lower centre of leg 1 in its upper one: a leg of length zero
        (0.0, 0.0, 0.0),  # all legs level
        (0.0, 0.0, 0.5),  # above the fixed platform
        (1e200, 0.0, -0.6),  # squares overflow
    ],
)
def test_absurd_poses_are_unreachable_and_nothing_else(drawing, position):
    with pytest.raises(UnreachablePoseError) as caught:
        drawing.kinematics.inverse(PlatformPose(position, 0.0))
    assert not math.isnan(caught.value.excess)
