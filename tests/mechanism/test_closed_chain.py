"""Building a closed-chain mechanism from URDF and loops."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError, DescriptionError, UnknownFrameError, UnknownJointError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.mechanism.loops_file import LoopsFile
from tests.support import planar_urdf, pose_gap, random_poses

FIVE_BAR = planar_urdf("five_bar", [("a", 0.0, [0.4, 0.6]), ("b", 0.5, [0.45, 0.55])])
LOOP = {"name": "tips", "frame_a": "a_tip", "frame_b": "b_tip", "type": "3d"}


def five_bar(**changes):
    return ClosedChainMechanism(FIVE_BAR, LoopsFile(**({"drives": ("a_j1", "b_j1"), "loops": (LOOP,)} | changes)))


def test_columns_of_the_robot(drawing):
    mechanism = drawing.nominal_solver.mechanism
    model = mechanism.copy_model()
    # 2 travels + 20 chain joints + the cut platform joint of 6.
    assert model.nv == 2 + 20 + 6
    drives = [model.getJointId(name) for name in ("leg1_s3", "leg2_s3", "leg3_s3", "leg4_s5")]
    assert mechanism.drive_columns.tolist() == [model.idx_vs[j] for j in drives]
    assert mechanism.passive_columns.size == 16 + 6
    assert mechanism.closing_columns.size == 26
    locked = {model.idx_vs[model.getJointId(name)] for name in ("truss_travel", "trolley_travel")}
    assert not locked & set(mechanism.closing_columns.tolist())


def test_a_frame_on_the_end_body_does_not_depend_on_the_configuration(drawing):
    mechanism = drawing.nominal_solver.mechanism
    model, data = mechanism.copy_model(), mechanism.copy_model().createData()
    step = np.random.default_rng(1).normal(size=model.nv)
    pin.framesForwardKinematics(model, data, pin.integrate(model, pin.neutral(model), step))
    end, lip = (data.oMf[mechanism.frame_id(name)] for name in ("moving_platform", "ladle_lip"))
    assert mechanism.placement_on_end("ladle_lip").isApprox(end.actInv(lip), 1e-12)
    assert model.gravity.linear.tolist() == [0.0, 0.0, -GRAVITY_M_S2]
    with pytest.raises(UnknownFrameError):
        mechanism.placement_on_end("ladle_lips")
    with pytest.raises(BadInputError, match="'fixed_platform' moves against 'moving_platform'; name a frame"):
        mechanism.placement_on_end("fixed_platform")
    with pytest.raises(BadInputError, match="a frame is asked for by its name, not a int"):
        mechanism.placement_on_end(3)
    with pytest.raises(BadInputError, match="a joint is asked for by its name, not a int"):
        mechanism.joint_id(3)
    with pytest.raises(BadInputError, match="values of joints, in m and rad, are a mapping by their names, not a list"):
        mechanism.with_joint_values(mechanism.neutral_configuration(), [0.5, 0.5, 0.5, 0.0])


def test_the_closure_does_not_depend_on_the_cut_when_the_loops_close(drawing):
    """Without the cut the platform stays on chain 1, whose loop is then closed by itself."""
    loops = drawing.model.definition.loops
    uncut = loops.model_copy(update={"cut_joints": (), "loops": loops.loops[1:]})
    solver = ClosureSolver(ClosedChainMechanism(drawing.model.definition.urdf(), uncut))
    for pose in random_poses(5, seed=60):
        values = drawing.kinematics.joint_values(pose)
        start = solver.mechanism.with_joint_values(solver.mechanism.neutral_configuration(), values)
        found = solver.solve(drawing.kinematics.inverse(pose), start)
        assert pose_gap(found.pose_base_to_end, pose.to_se3()) == pytest.approx([0.0, 0.0], abs=1e-10)
        assert found.freedoms == 4


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"loops": (LOOP | {"frame_b": "b_tipp"},)}, "loop 'tips' names the absent frame 'b_tipp'.*'b_tip'"),
        ({"loops": (LOOP | {"frame_a": "nowhere"},)}, "absent frame 'nowhere'"),
        ({"drives": ("a_j1", "b_j11")}, "'b_j11' is not a moving joint.*'b_j1'"),
        ({"drives": ("a_j1", "a_tip_mount")}, "'a_tip_mount' is not a moving joint"),
        ({"locked_joints": ("a_j9",)}, "'a_j9' is not a moving joint"),
        ({"base_frame": "grund"}, "'grund' is not a frame.*'ground'"),
        ({"end_frame": "a_tipp"}, "'a_tipp' is not a frame"),
        ({"tool_frames": ("b_tpi",)}, "'b_tpi' is not a frame"),
        (
            {"end_frame": "a_tip", "tool_frames": ("a_l1",)},
            "joints lie between 'a_tip' and the tool frame 'a_l1'; name frames fixed",
        ),
        ({"cut_joints": ("b_tip_mout",)}, "cut_joints: .*'b_tip_mount'"),
    ],
)
def test_absent_names_are_refused_with_the_nearest_known(changes, words):
    with pytest.raises(DescriptionError, match=words) as caught:
        five_bar(**changes)
    assert str(caught.value).startswith("loops.yaml: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("urdf", ["<robot", "<robot name='r'/>", "", "<other/>"])
def test_broken_urdf(urdf):
    with pytest.raises(DescriptionError, match=r"^URDF") as caught:
        ClosedChainMechanism(urdf, LoopsFile(drives=("a",), loops=(LOOP,)))
    assert "\n" not in str(caught.value)


def test_it_can_be_pickled_and_still_closes(crooked):
    (pose,) = random_poses(1, seed=61)
    location = crooked.locate(pose)
    again = pickle.loads(pickle.dumps(crooked.actual_solver.mechanism))
    assert again.urdf == crooked.actual_solver.mechanism.urdf
    assert again.loops == crooked.actual_solver.mechanism.loops
    found = ClosureSolver(again).solve(location.drives, location.nominal.configuration)
    assert found.configuration == pytest.approx(location.actual.configuration, abs=1e-13)


def test_a_copy_of_the_model_can_be_changed(drawing):
    mechanism = drawing.nominal_solver.mechanism
    before = mechanism.shared_model.jointPlacements[3].translation.copy()
    mechanism.copy_model().jointPlacements[3].translation += 1.0
    assert mechanism.shared_model.jointPlacements[3].translation.tolist() == before.tolist()


def test_joint_values_survive_a_round_trip():
    urdf = FIVE_BAR.replace('name="a_j2" type="revolute"', 'name="a_j2" type="continuous"')
    mechanism = ClosedChainMechanism(urdf, LoopsFile(drives=("a_j1", "b_j1"), loops=(LOOP,)))
    values = {"a_j1": 0.3, "a_j2": -2.5, "b_j1": 1.2, "b_j2": -0.7}
    neutral = mechanism.neutral_configuration()
    kept = neutral.copy()
    configuration = mechanism.with_joint_values(neutral, values)
    assert neutral.tolist() == kept.tolist()
    assert mechanism.joint_values(configuration) == pytest.approx(values, abs=1e-15)
    # A joint without limits is stored as cosine and sine, and has no limits to report.
    assert configuration.size == 5
    assert mechanism.joint_limits() == dict.fromkeys(("a_j1", "b_j1", "b_j2"), (-3.2, 3.2))


def test_limits_that_mean_unlimited_are_no_limits():
    urdf = FIVE_BAR.replace('lower="-3.2" upper="3.2"', 'lower="-1e+16" upper="1e+16"', 1)
    limits = ClosedChainMechanism(urdf, LoopsFile(drives=("a_j1", "b_j1"), loops=(LOOP,))).joint_limits()
    assert {*limits} == {"a_j2", "b_j1", "b_j2"}


def test_bad_joint_values():
    mechanism = five_bar()
    neutral = mechanism.neutral_configuration()
    with pytest.raises(BadInputError, match=r"'a_j1'.*nan"):
        mechanism.with_joint_values(neutral, {"a_j1": np.nan})
    with pytest.raises(UnknownJointError, match="a_j"):
        mechanism.with_joint_values(neutral, {"a_j": 1.0})
    with pytest.raises(UnknownFrameError, match="a_tip"):
        mechanism.frame_id("a_tipp")
