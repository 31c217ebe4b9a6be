"""Mechanisms with idle freedoms, and joints of other kinds: mimic, universal, spherical."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

from pouring_robot.batch import GeneralEngine
from pouring_robot.exceptions import BadInputError, DescriptionError, SingularPoseError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.null_space import Spectrum
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.joint_limits import joint_reach, within_limits
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.mechanism.pinocchio_model import read_mimics
from pouring_robot.mechanism.transfer import closed_chain_transfer
from tests.mechanism.struts import GROUND, STROKE, crank_end, start_of, strut
from tests.support import central_differences, circle_meeting, planar_urdf, relative_error


@pytest.mark.parametrize("spin", [0.0, 1.0, -2.5])
def test_it_closes_at_the_triangles_angle_however_the_rod_is_spun(spin):
    mechanism = strut()
    result = ClosureSolver(mechanism).solve_from(start_of(mechanism, spin))
    x, z = crank_end(STROKE)
    np.testing.assert_allclose(result.pose_base_to_end.translation, [x, 0.0, z], rtol=0, atol=1e-12)
    assert result.idle_joints == ("ball1", "ball2")
    assert (result.rank, result.freedoms) == (6, 2)
    # The minimum-norm step leaves the spin nearly unchanged.
    first = mechanism.shared_model.joints[mechanism.joint_id("ball1")].idx_q
    rotation = pin.Quaternion(result.configuration[first : first + 4]).matrix()
    found = np.arctan2(*(pin.utils.rotate("y", np.arctan2(x - GROUND, z)).T @ rotation)[[1, 0], 0])
    assert found == pytest.approx(spin, abs=0.05)


def test_motion_that_the_drive_determines_is_given_and_the_spin_is_refused():
    mechanism = strut()
    solver = ClosureSolver(mechanism)
    result = solver.solve_from(start_of(mechanism, 0.7))
    transfer = closed_chain_transfer(solver, result, drive_parameters(mechanism))
    slope = central_differences_of(crank_end, STROKE)
    np.testing.assert_allclose(transfer.matrix[[0, 2], 0], slope, rtol=0, atol=1e-9)
    with pytest.raises(SingularPoseError):
        closed_chain_transfer(solver, result, drive_parameters(mechanism), "rod")


@pytest.mark.parametrize("stroke", np.linspace(0.4, 1.0, 13))
def test_a_rod_that_spins_about_an_axis_of_its_ball_is_no_singular_pose(stroke):
    """The effect of that axis on the loop is round-off, of either sign."""
    mechanism = strut()
    (grip,) = mechanism.loops.loops
    point = mechanism.loops.model_copy(update={"loops": (grip.model_copy(update={"type": "3d"}),)})
    solver = ClosureSolver(ClosedChainMechanism(mechanism.urdf, point))
    result = solver.solve({"stroke": stroke}, start_of(mechanism, 0.7))
    transfer = closed_chain_transfer(solver, result, drive_parameters(mechanism))
    slope = central_differences_of(crank_end, stroke)
    np.testing.assert_allclose(transfer.matrix[[0, 2], 0], slope, rtol=0, atol=1e-6)


def test_eigenvalues_are_found_where_many_freedoms_idle():
    """A platform on six legs, each with a ball that turns in its seat: ``np.linalg.eigh`` does not converge there."""
    hessian = np.load(Path(__file__).with_name("idling_legs.npy"))
    spectrum = Spectrum.of(hessian)
    by_another_way = scipy.linalg.eigvalsh(hessian * spectrum.scale[:, None] * spectrum.scale, driver="evr")
    np.testing.assert_allclose(spectrum.values, by_another_way, rtol=0, atol=1e-13)


def test_the_ratio_of_a_spectrum_does_not_depend_on_units():
    """Scaled to a unit diagonal the eigenvalues are 1 ± 1/2; without stiffness the ratio is zero."""
    assert Spectrum.of(np.array([[2.0, 1e3], [1e3, 2e6]])).ratio == pytest.approx(1.0 / 3.0)
    assert Spectrum.of(np.zeros((2, 2))).ratio == 0.0


def test_the_observed_frame_must_be_stated():
    mechanism = strut()
    unsaid = ClosedChainMechanism(mechanism.urdf, mechanism.loops.model_copy(update={"end_frame": None}))
    solver = ClosureSolver(unsaid)
    result = solver.solve_from(start_of(unsaid))
    with pytest.raises(BadInputError, match="no end_frame; say which frame is observed"):
        closed_chain_transfer(solver, result, drive_parameters(unsaid))
    found = closed_chain_transfer(solver, result, drive_parameters(unsaid), "crank_end")
    np.testing.assert_allclose(found.matrix[[0, 2], 0], central_differences_of(crank_end, STROKE), rtol=0, atol=1e-9)


def central_differences_of(function, at, step=1e-4):
    near, far = (function(at + n * step) - function(at - n * step) for n in (1, 2))
    return (8.0 * near - far) / (12.0 * step)


def test_every_placement_matches_differences_of_closures():
    mechanism = strut()
    engine, step = GeneralEngine(mechanism), 1e-4
    closed = engine.close(np.array([[STROKE]]), engine.start_at(start_of(mechanism, 0.7)[None])).require_all()
    matrix = engine.transfer(closed).matrix[0]
    assert set(engine.structure.site_joints) == {"hinge", "ball1", "stroke", "ball2", "hinge_mount"}
    for p in range(len(engine.parameters)):
        errors = np.zeros((4, len(engine.parameters)))
        errors[:, p] = step * np.array([-2.0, -1.0, 1.0, 2.0])
        found = engine.close(np.full((4, 1), STROKE), closed.as_start()[np.zeros(4, dtype=int)], errors).require_all()
        columns = [
            np.r_[found.position[b] - found.position[a], pin.log3(found.rotation[b] @ found.rotation[a].T)]
            for a, b in ((1, 2), (0, 3))
        ]
        expected = (8.0 * columns[0] - columns[1]) / (12.0 * step)
        np.testing.assert_allclose(matrix[:, p], expected, rtol=0, atol=1e-6 * np.abs(matrix).max())


def test_weight_acts_on_the_drive_although_the_rod_spins():
    """The rod carries the crank: its force from the torque about the hinge, and its compression from that force."""
    mechanism, stiffness = strut(), 1e6
    solver = ClosureSolver(mechanism, Loads(gravity=True, drive_stiffness={"stroke": stiffness}))
    result = solver.solve_from(start_of(mechanism, 0.3))
    model = mechanism.copy_model()
    data = model.createData()

    def potential(stroke):
        x, z = crank_end(stroke)
        configuration = mechanism.with_joint_values(pin.neutral(model), {"hinge": np.arctan2(-z, x), "stroke": stroke})
        return pin.computePotentialEnergy(model, data, configuration)

    stretch = result.joint_values["stroke"] - STROKE
    force = -central_differences_of(potential, STROKE + stretch)
    assert abs(force) > 1.0
    assert stretch * stiffness == pytest.approx(force, rel=1e-6)


FOUR_BAR = planar_urdf("pair", [("a", 0.0, [0.3, 0.5]), ("b", 0.9, [0.4, 0.45])])


def with_mimic(text, multiplier=-1.5, offset=0.4):
    """Return a five-bar whose second crank follows the first."""
    tied = f'<mimic joint="a_j1" multiplier="{multiplier}" offset="{offset}"/></joint>'
    head, tail = text.split('<joint name="b_j1"')
    return head + '<joint name="b_j1"' + tail.replace("</joint>", tied, 1)


def tied_five_bar(drives=("a_j1",), **changes):
    keys = {
        "base_frame": "ground",
        "end_frame": "a_tip",
        "drives": drives,
        "loops": ({"name": "tips", "frame_a": "a_tip", "frame_b": "b_tip", "type": "3d"},),
    }
    return ClosedChainMechanism(with_mimic(FOUR_BAR), LoopsFile(**(keys | changes)))


def tied_tip(angle):
    """Return where the couplers meet, in the x-z plane, for the first crank's angle; joints turn about y."""
    cranks = ((0.0, 0.3, angle), (0.9, 0.4, -1.5 * angle + 0.4))
    knees = [np.array([x + r * np.cos(a), -r * np.sin(a)]) for x, r, a in cranks]
    return circle_meeting(knees[0], 0.5, knees[1], 0.45, side=+1)


def tied_start(mechanism, angle):
    x, z = tied_tip(angle)
    values = {"a_j1": angle, "b_j1": -1.5 * angle + 0.4}
    for name, foot, length in (("a", 0.0, 0.3), ("b", 0.9, 0.4)):
        crank = values[f"{name}_j1"]
        values[f"{name}_j2"] = np.arctan2(-z - length * np.sin(crank), x - foot - length * np.cos(crank)) - crank
    return mechanism.with_joint_values(mechanism.neutral_configuration(), values)


def test_a_joint_that_mimics_a_drive_moves_with_it():
    mechanism, angle = tied_five_bar(), -1.2
    solver = ClosureSolver(mechanism)
    start = tied_start(mechanism, angle)
    result = solver.solve({"a_j1": angle + 0.1}, start)
    x, z = tied_tip(angle + 0.1)
    np.testing.assert_allclose(result.pose_base_to_end.translation, [x, 0.0, z], rtol=0, atol=1e-12)
    assert result.joint_values["b_j1"] == pytest.approx(-1.5 * (angle + 0.1) + 0.4, abs=1e-15)
    assert result.freedoms == 1
    matrix = closed_chain_transfer(solver, result, drive_parameters(mechanism)).matrix
    np.testing.assert_allclose(matrix[[0, 2], 0], central_differences_of(tied_tip, angle + 0.1), rtol=0, atol=1e-9)


def test_a_joint_that_mimics_a_passive_one_is_found_with_it():
    """The elbow is driven instead of the crank: the crank and the joint that follows it are found by the closure."""
    mechanism, angle = tied_five_bar(drives=("a_j2",)), -1.2
    solver = ClosureSolver(mechanism)
    start = tied_start(mechanism, angle)
    elbow = mechanism.joint_values(tied_start(mechanism, angle + 0.05))["a_j2"]
    result = solver.solve({"a_j2": elbow}, start)
    assert result.joint_values["a_j1"] == pytest.approx(angle + 0.05, abs=1e-12)
    x, z = tied_tip(angle + 0.05)
    np.testing.assert_allclose(result.pose_base_to_end.translation, [x, 0.0, z], rtol=0, atol=1e-12)
    matrix = closed_chain_transfer(solver, result, drive_parameters(mechanism)).matrix

    def elbow_of(a):
        return mechanism.joint_values(tied_start(mechanism, a))["a_j2"]

    slope = central_differences_of(tied_tip, angle + 0.05) / central_differences_of(elbow_of, angle + 0.05)
    np.testing.assert_allclose(matrix[[0, 2], 0], slope, rtol=0, atol=1e-9 * np.abs(slope).max())


def test_a_joint_that_follows_a_locked_one_has_no_limits_for_one_command_and_for_many():
    """No drive can move it from where it is, even beyond its own limits."""
    loops = LoopsFile(base_frame="ground", end_frame="a_tip", drives=("a_j2",), locked_joints=("a_j1", "b_j2"))
    mechanism = ClosedChainMechanism(with_mimic(FOUR_BAR, offset=4.0), loops)
    values = mechanism.joint_values(mechanism.with_mimics(mechanism.neutral_configuration(), {"a_j1": 0.0}))
    assert values["b_j1"] == 4.0 > mechanism.joint_limits()["b_j1"][1]
    assert [reach.joint for reach in joint_reach(mechanism, values)] == ["a_j2"]
    assert within_limits(mechanism, {name: np.array([value, value]) for name, value in values.items()}).all()


def test_mimics_of_mimics_follow_the_first_leader():
    def text(*pairs):
        joints = (
            f'<joint name="{n}" type="revolute"><mimic joint="{m}" multiplier="{k}" offset="{o}"/></joint>'
            for n, m, k, o in pairs
        )
        return f"<robot>{''.join(joints)}</robot>"

    first, second = read_mimics(text(("b", "a", 2, 0.5), ("c", "b", -3, 1)), Path("arm.urdf"))
    assert (first.leader, first.ratio, first.offset) == ("a", 2.0, 0.5)
    assert (second.leader, second.ratio, second.offset) == ("a", -6.0, -0.5)


@pytest.mark.parametrize(
    ("multiplier", "changes", "words"),
    [
        ("-1.5", {"drives": ("a_j1", "b_j1")}, "drive 'b_j1' mimics 'a_j1' in the URDF; drive that one instead"),
        ("much", {}, "multiplier and offset of mimic must be numbers"),
    ],
)
def test_meaningless_mimics_are_refused(multiplier, changes, words):
    loops = tied_five_bar().loops.model_copy(update=changes)
    with pytest.raises(DescriptionError, match=words):
        ClosedChainMechanism(with_mimic(FOUR_BAR, multiplier), loops)


def test_a_ring_of_mimics_is_refused():
    urdf = with_mimic(FOUR_BAR).replace(
        '<joint name="a_j1" type="revolute">', '<joint name="a_j1" type="revolute"><mimic joint="b_j1"/>'
    )
    with pytest.raises(DescriptionError, match="mimics itself"):
        ClosedChainMechanism(urdf, tied_five_bar().loops)


def test_universal_joints_turn_about_two_axes_of_their_placement():
    chain = FOUR_BAR.replace('<origin xyz="0.0 0 0"/>', '<origin xyz="0.0 0 0" rpy="0.2 -0.1 0.3"/>', 1)
    loops = LoopsFile(end_frame="a_tip", drives=("a_j2",), joint_types={"a_j1": "universal_xz", "b_j1": "fixed"})
    mechanism = ClosedChainMechanism(chain, loops)
    assert not mechanism.shared_model.existJointName("b_j1")
    values = {"a_j1_X": 0.4, "a_j1_Z": -0.9}
    configuration = mechanism.with_joint_values(mechanism.neutral_configuration(), values)
    model, data = mechanism.shared_model, mechanism.copy_model().createData()
    pin.framesForwardKinematics(model, data, configuration)
    expected = pin.rpy.rpyToMatrix(0.2, -0.1, 0.3) @ pin.utils.rotate("x", 0.4) @ pin.utils.rotate("z", -0.9)
    np.testing.assert_allclose(data.oMf[mechanism.frame_id("a_l1")].rotation, expected, rtol=0, atol=1e-14)


def test_spherical_joints_keep_masses_limits_and_frames():
    plain = planar_urdf("pair", [("a", 0.0, [0.3, 0.5])])
    loops = {"end_frame": "a_tip", "drives": ("a_j2",)}
    before = ClosedChainMechanism(plain, LoopsFile(**loops))
    after = ClosedChainMechanism(plain, LoopsFile(**loops, joint_types={"a_j1": "spherical"}))
    model = after.shared_model
    assert (model.nq, model.nv) == (5, 4)
    assert after.joint_limits()["a_j2"] == pytest.approx((-3.2, 3.2))
    for limit in ("upperEffortLimit", "velocityLimit"):  # effort sizes the expected compliance, velocity the pauses
        said, kept = (getattr(m, limit)[m.idx_vs[m.getJointId("a_j2")]] for m in (before.shared_model, model))
        assert kept == said
    assert [f.name for f in model.frames] == [f.name for f in before.shared_model.frames]
    assert after.frame_paths == before.frame_paths
    masses = [[i.mass for i in m.inertias] for m in (before.shared_model, model)]
    assert masses[0] == masses[1]
    energy = ClosureSolver(after, Loads(gravity=True)).energy
    configuration = pin.randomConfiguration(model, -np.ones(5), np.ones(5))

    def value(q):
        return np.array(energy.evaluate(q, q).energy)

    numeric = central_differences(value, model, configuration, step=1e-4)
    assert relative_error(energy.evaluate(configuration, configuration).gradient, numeric) < 1e-8
