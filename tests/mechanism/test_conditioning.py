"""Drive Jacobians of the closed mechanism: against closed forms and against repeated closures."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError, SingularPoseError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.conditioning import dexterity
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.pouring.kinematics import TASK_ROWS
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from tests.support import circle_meeting, closure_condition, planar_urdf, random_poses, relative_error, round_off

STEP = 1e-4
LOADS = Loads(
    gravity=True,
    payload_kg=300.0,
    payload_centre_m=(0.05, 0.0, -0.3),
    drive_stiffness={"leg1_s3": 3e7, "leg4_s5": 1e6},
)


def by_drives(solver, result):
    """Return G with respect to the drives only: the Jacobians of the platform and of all joints."""
    return closed_chain_transfer(solver, result, drive_parameters(solver.mechanism))


def by_closing_again(solver, result, drives):
    """Return platform and joint Jacobians by fourth-order central differences of whole closures."""
    model = solver.energy.model
    base_pose = result.pose_base_to_end
    platform, joints = [], []
    for name in drives:

        def ends(change, name=name):
            found = solver.solve(drives | {name: drives[name] + change}, result.configuration)
            pose = found.pose_base_to_end
            twist = np.concatenate([pose.translation, pin.log3(pose.rotation @ base_pose.rotation.T)])
            return twist, pin.difference(model, result.configuration, found.configuration)

        samples = [ends(n * STEP) for n in (1, -1, 2, -2)]
        for store, part in ((platform, 0), (joints, 1)):
            near, far = samples[0][part] - samples[1][part], samples[2][part] - samples[3][part]
            store.append((8 * near - far) / (12 * STEP))
    return np.stack(platform, axis=-1), np.stack(joints, axis=-1)


@pytest.fixture(params=["drawing", "as built", "4 mrad", "loaded"])
def solver(request, drawing, as_built, very_crooked):
    if request.param == "loaded":
        return ClosureSolver(very_crooked.model.mechanism(), LOADS)
    robots = {"drawing": drawing, "as built": as_built, "4 mrad": very_crooked}
    return robots[request.param].actual_solver


def test_platform_and_passive_joints_against_central_differences(drawing, solver):
    for pose in random_poses(3, seed=40):
        drives = drawing.kinematics.inverse(pose)
        result = solver.solve(drives, drawing.kinematics.configuration(pose))
        found = by_drives(solver, result)
        platform, joints = by_closing_again(solver, result, drives)
        # A compliant drive moves less than commanded; rows of the floating platform joint belong to the tree.
        assert relative_error(found.matrix, platform) < 1e-6
        assert relative_error(found.joints, joints) < 1e-6
        with pytest.raises(ValueError, match="read-only"):
            found.matrix[0] = 0.0


def test_nominal_platform_against_the_closed_form_of_the_inverse(drawing):
    """Rows of the inverse: unit vectors of the legs and their moments; the last, of theta46 = r - atan2(-dx, -dz)."""
    fixed = np.array([[-0.34, 0.374, 0], [-0.34, -0.374, 0], [0.34, 0.374, 0], [0.34, -0.374, 0]])
    moving = np.array([[-0.1825, 0.33, 0], [-0.1825, -0.33, 0], [0.1825, 0.33, 0], [0.1825, -0.33, 0]])
    for pose in random_poses(10, seed=41):
        r = pose.tilt_rad
        turned = moving @ np.array([[np.cos(r), 0, -np.sin(r)], [0, 1, 0], [np.sin(r), 0, np.cos(r)]])
        legs = np.array(pose.position_m) + turned - fixed
        by_tilt = np.stack([turned[:, 2], np.zeros(4), -turned[:, 0]], axis=-1)  # y axis × rotated vector
        inverse = np.zeros((4, 4))
        for k in range(3):
            along = legs[k] / np.linalg.norm(legs[k])
            inverse[k] = [*along, along @ by_tilt[k]]
        x, z = legs[3, 0], legs[3, 2]
        psi_by_xz = np.array([z, -x]) / (x**2 + z**2)  # of atan2(-x, -z)
        inverse[3] = [-psi_by_xz[0], 0.0, -psi_by_xz[1], 1.0 - psi_by_xz @ by_tilt[3, [0, 2]]]
        location = drawing.locate(pose)
        found = by_drives(drawing.actual_solver, location.actual).matrix
        condition, size = closure_condition(drawing.nominal_solver, location.nominal)
        lost = round_off(condition, np.abs(found).max(), terms=size)
        assert lost < 1e-6
        assert found[list(TASK_ROWS)] == pytest.approx(np.linalg.inv(inverse), rel=0, abs=lost)
        # The nominal platform neither rolls nor yaws.
        assert found[[3, 5]] == pytest.approx(np.zeros((2, 4)), abs=lost)


def test_five_bar_against_the_closed_form():
    """Tip of two cranks: legs a2 and b2 keep their lengths, which gives its velocity."""
    (la, lb), (ka, kb), ground = (0.4, 0.45), (0.6, 0.55), 0.5
    urdf = planar_urdf("five_bar", [("a", 0.0, [la, ka]), ("b", ground, [lb, kb])])
    loops = LoopsFile(
        drives=("a_j1", "b_j1"),
        end_frame="a_tip",
        loops=({"name": "tips", "frame_a": "a_tip", "frame_b": "b_tip", "type": "3d"},),
    )
    mechanism = ClosedChainMechanism(urdf, loops)
    solver = ClosureSolver(mechanism)
    drives = {"a_j1": -2.0, "b_j1": -1.0}
    start = mechanism.with_joint_values(mechanism.neutral_configuration(), {"a_j2": 1.2, "b_j2": -1.2} | drives)
    result = solver.solve(drives, start)
    knees = np.array(
        [
            [la * np.cos(2.0), la * np.sin(2.0)],
            [ground + lb * np.cos(1.0), lb * np.sin(1.0)],
        ]
    )
    tip = circle_meeting(knees[0], ka, knees[1], kb, side=+1)
    assert result.pose_base_to_end.translation == pytest.approx([tip[0], 0.0, tip[1]], abs=1e-10)
    legs = tip - knees
    knee_velocity = np.array([[-knees[0, 1], knees[0, 0]], [-knees[1, 1], knees[1, 0] - ground]])
    # About y, a positive angle turns x towards -z.
    expected = np.linalg.solve(legs, np.diag(-np.sum(legs * knee_velocity, axis=1)))
    found = by_drives(solver, result).matrix
    assert found[[0, 2]] == pytest.approx(expected, abs=1e-9)
    assert (result.rank, result.freedoms) == (2, 2)


def test_four_leg_drives_are_singular_everywhere(drawing):
    """Each pair of legs lies in one plane, and a planar four-bar keeps one freedom."""
    loops = drawing.model.definition.loops.model_copy(update={"drives": tuple(f"leg{i}_s3" for i in (1, 2, 3, 4))})
    solver = ClosureSolver(ClosedChainMechanism(drawing.model.definition.urdf(), loops))
    for pose in random_poses(5, seed=42):
        start = drawing.kinematics.configuration(pose)
        result = solver.solve({}, start)
        with pytest.raises(SingularPoseError, match="singular") as caught:
            by_drives(solver, result)
        assert abs(caught.value.ratio) < 1e-12
        assert caught.value.exit_code == 3


def test_dexterity_of_known_jacobians():
    platform = np.zeros((6, 4))
    platform[list(TASK_ROWS), range(4)] = (2.0, 4.0, 1.0, 0.5)
    serial = dexterity(platform, (True, True, True, False), 0.4, TASK_ROWS)
    # The tilt row is scaled up and the angular drive's column down by the length, so 0.5 stays.
    assert (serial.condition, serial.singularity) == (pytest.approx(8.0), "parallel")
    assert serial.distance == pytest.approx(0.25)
    # Without loops no freedom can be gained, however near its inverse is.
    tree = dexterity(platform, (True, True, True, False), 0.4, TASK_ROWS, closed=False)
    assert (tree.condition, tree.singularity, tree.distance) == (serial.condition, "serial", pytest.approx(0.5))
    platform[4, 3] = 0.1
    nearer = dexterity(platform, (True, True, True, False), 0.4, TASK_ROWS)
    assert (nearer.singularity, nearer.distance) == ("serial", pytest.approx(0.1))
    platform[4, 3] = 0.0
    lost = dexterity(platform, (True, True, True, False), 0.4, TASK_ROWS)
    assert (lost.condition, lost.distance) == (np.inf, 0.0)


def test_dexterity_does_not_depend_on_the_unit_of_length(drawing):
    location = drawing.locate(PlatformPose((-0.1, 0.01, -0.6), 0.2))
    found = by_drives(drawing.actual_solver, location.actual).matrix
    prismatic = (True, True, True, False)
    in_m = dexterity(found, prismatic, 0.4, TASK_ROWS)
    # The same in mm: linear rows and angular columns change, and so does the characteristic length.
    platform = found.copy()
    platform[:3] *= 1e3
    platform[:, :3] /= 1e3
    in_mm = dexterity(platform, prismatic, 400.0, TASK_ROWS)
    assert in_mm.condition == pytest.approx(in_m.condition, rel=1e-9)
    assert in_mm.distance == pytest.approx(in_m.distance, rel=1e-9)


def test_without_end_frame_there_is_no_platform(drawing):
    loops = drawing.model.definition.loops.model_copy(update={"end_frame": None})
    solver = ClosureSolver(ClosedChainMechanism(drawing.model.definition.urdf(), loops))
    (pose,) = random_poses(1, seed=43)
    result = solver.solve(drawing.kinematics.inverse(pose), drawing.kinematics.configuration(pose))
    with pytest.raises(BadInputError, match="end_frame"):
        by_drives(solver, result)
