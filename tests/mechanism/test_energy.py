"""Exact derivatives of the closure energy against central differences, at closed and at open configurations."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError, UnknownFrameError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import (
    ClosureEnergy,
    Loads,
    bracket_form,
    log_wrench_derivative,
    motion_cross,
)
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.mechanism.loops_file import LoopsFile
from tests.support import central_differences, planar_urdf, random_poses, relative_error

FIVE_BAR = planar_urdf("five_bar", [("a", 0.0, [0.4, 0.6]), ("b", 0.5, [0.45, 0.55])])
LOADS = Loads(
    gravity=True,
    payload_kg=420.0,
    payload_frame="ladle",
    payload_centre_m=(0.03, -0.02, -0.15),
    drive_stiffness={"leg1_s3": 3e7, "leg3_s3": 4e7, "leg4_s5": 2e5},
)


def five_bar(*kinds):
    """Return a five-bar whose tips meet, with its first links connected by a second, three-dimensional loop."""
    loops = [{"name": "tips", "frame_a": "a_tip", "frame_b": "b_tip", "type": kinds[0]}]
    if len(kinds) > 1:
        loops.append({"name": "tie", "frame_a": "a_l1", "frame_b": "b_l2", "type": kinds[1]})
    return ClosedChainMechanism(FIVE_BAR, LoopsFile(drives=("a_j1", "b_j1"), loops=tuple(loops)))


@pytest.fixture(params=["closed", "crooked", "loaded", "3d", "6d and 3d"])
def case(request, drawing, very_crooked):
    """An energy and a configuration: exactly closed, open by 4 mrad, or arbitrary."""
    (pose,) = random_poses(1, seed=30)
    if request.param == "closed":
        return ClosureEnergy(drawing.nominal_solver.mechanism), drawing.kinematics.configuration(pose)
    if request.param in ("crooked", "loaded"):
        loads = LOADS if request.param == "loaded" else Loads()
        mechanism = very_crooked.actual_solver.mechanism
        return ClosureEnergy(mechanism, loads), very_crooked.locate(pose).actual.configuration
    mechanism = five_bar("3d") if request.param == "3d" else five_bar("6d", "3d")
    configuration = mechanism.with_joint_values(
        mechanism.neutral_configuration(), {"a_j1": -1.9, "a_j2": 0.9, "b_j1": -1.1, "b_j2": -0.8}
    )
    return ClosureEnergy(mechanism), configuration


@pytest.fixture(params=[0.0, 0.05, 0.3], ids=lambda size: f"{size} m and rad away")
def away(request, case):
    """The case's configuration, moved at random in every joint: loops open by as much and more."""
    energy, configuration = case
    random = np.random.default_rng(31)
    step = random.uniform(-request.param, request.param, energy.model.nv)
    return energy, pin.integrate(energy.model, configuration, step), configuration


def test_residual_jacobian(away):
    energy, configuration, commanded = away

    def residual(q):
        return energy.evaluate(q, commanded).residual

    expected = central_differences(residual, energy.model, configuration, step=1e-4)
    assert relative_error(energy.evaluate(configuration, commanded).jacobian, expected) < 1e-8


def test_residual_is_the_pose_of_frame_b_in_frame_a(away):
    energy, configuration, commanded = away
    model = energy.mechanism.copy_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration)
    state = energy.evaluate(configuration, commanded)
    for loop, residual in zip(energy.mechanism.loops.loops, state.residual, strict=True):
        a, b = (data.oMf[model.getFrameId(name)] for name in (loop.frame_a, loop.frame_b))
        pose = a.inverse() * b
        is_3d = loop.type == "3d"
        expected = np.concatenate([pose.translation, np.zeros(3)]) if is_3d else pin.log6(pose).vector
        assert residual == pytest.approx(expected, abs=1e-13)


def test_gradient(away):
    energy, configuration, commanded = away

    def height(q):
        return np.array(energy.evaluate(q, commanded).energy)

    expected = central_differences(height, energy.model, configuration, step=1e-4)
    state = energy.evaluate(configuration, commanded)
    # At the minimum itself the gradient is a small difference of large parts, which give the scale.
    parts = np.abs(state.jacobian.reshape(-1, energy.model.nv)).T @ np.abs(state.wrench.ravel())
    assert np.abs(state.gradient - expected).max() < 1e-6 * max(np.abs(expected).max(), parts.max(), 1.0)


def test_hessian(away):
    energy, configuration, commanded = away

    def gradient(q):
        return energy.evaluate(q, commanded).gradient

    difference = central_differences(gradient, energy.model, configuration, step=1e-4)
    expected = 0.5 * (difference + difference.T)
    found = energy.hessian(energy.evaluate(configuration, commanded))
    assert relative_error(found, expected) < 1e-6
    # Stiff entries must not hide wrong soft ones: compare the curvature beyond J^T K J separately, too.
    stiff = energy.gauss_newton_hessian(energy.evaluate(configuration, commanded))
    extra = expected - stiff
    if np.abs(extra).max() > 1e-5 * np.abs(expected).max():
        assert relative_error(found - stiff, extra) < 1e-4


def test_payload_is_a_weight_at_its_position(drawing):
    """The potential of the payload, by hand: m g times the height of its centre."""
    mechanism = drawing.nominal_solver.mechanism
    (pose,) = random_poses(1, seed=32)
    location = drawing.locate(pose)
    configuration = location.nominal.configuration
    place = (0.03, -0.02, -0.15)
    energies = [
        ClosureEnergy(mechanism, Loads(gravity=True, payload_kg=kg, payload_frame="ladle", payload_centre_m=place))
        for kg in (0.0, 420.0)
    ]
    added = np.diff([energy.evaluate(configuration, configuration).energy for energy in energies]).item()
    height = location.nominal.pose("universe", "ladle").act(np.array(place))[2]
    assert added == pytest.approx(420.0 * GRAVITY_M_S2 * height, rel=1e-10)
    # The mechanism itself, which others share, is unchanged.
    masses = [sum(i.mass for i in mechanism.copy_model().inertias), sum(i.mass for i in energies[0].model.inertias)]
    assert masses[0] == masses[1]


def test_drive_springs_pull_towards_the_command(drawing):
    mechanism = drawing.nominal_solver.mechanism
    energy = ClosureEnergy(mechanism, Loads(drive_stiffness={"leg2_s3": 5e6}))
    (pose,) = random_poses(1, seed=33)
    commanded = drawing.kinematics.configuration(pose)
    values = mechanism.joint_values(commanded)
    rigid = ClosureEnergy(mechanism)
    pulled = mechanism.with_joint_values(commanded, {"leg2_s3": values["leg2_s3"] + 0.002})
    added = energy.evaluate(pulled, commanded).energy - rigid.evaluate(pulled, commanded).energy
    assert added == pytest.approx(0.5 * 5e6 * 0.002**2, rel=1e-9)


def log_jacobian(twist):
    """Return Jlog6 as the inverse of exp's right Jacobian, sum of (-ad)^n / (n + 1)!; no branch for small angles."""
    bracket, term, total = pin.Motion(twist).action, np.eye(6), np.eye(6)
    for n in range(1, 20):
        term = term @ -bracket / (n + 1)
        total = total + term
    return np.linalg.inv(total)


@pytest.mark.parametrize("size", [1e-4, 0.05, 0.3])
def test_log_wrench_derivative(size):
    random = np.random.default_rng(34)
    for _ in range(20):
        pose = pin.exp6(pin.Motion(random.uniform(-size, size, 6)))
        # K e with any stiffness, constant while only Jlog changes.
        load = random.uniform(-1.0, 1.0, 6)
        columns = []
        for direction in np.eye(6):

            def torque(amount, pose=pose, load=load, direction=direction):
                return log_jacobian(pin.log6(pose * pin.exp6(pin.Motion(amount * direction))).vector).T @ load

            near, far = (torque(h) - torque(-h) for h in (3e-3, 6e-3))
            columns.append((8.0 * near - far) / (12.0 * 3e-3))
        residual, jlog = pin.log6(pose).vector[None], log_jacobian(pin.log6(pose).vector)[None]
        found = log_wrench_derivative(residual, load[None], jlog)[0]
        assert relative_error(found, np.stack(columns, axis=-1)) < 1e-6


def test_brackets_agree_with_pinocchio():
    random = np.random.default_rng(35)
    x, y, wrench = random.normal(size=(3, 6))
    expected = pin.Motion(x).cross(pin.Motion(y)).vector
    assert motion_cross(x) @ y == pytest.approx(expected, abs=1e-14)
    assert x @ bracket_form(wrench) @ y == pytest.approx(wrench @ expected, abs=1e-13)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"payload_kg": -1.0}, "payload"),
        ({"payload_kg": np.nan}, "payload"),
        ({"payload_kg": np.inf}, "payload"),
        ({"drive_stiffness": {"leg1_s3": 0.0}}, "leg1_s3"),
        ({"drive_stiffness": {"leg1_s3": np.nan}}, "leg1_s3"),
        ({"drive_stiffness": {"leg1_s3": np.inf}}, "leg1_s3"),
        ({"gravity": True, "payload_kg": 1.0, "payload_centre_m": (0.0, np.nan, 0.0)}, "centre"),
        ({"gravity": True, "payload_kg": 1.0, "payload_centre_m": (0.0, 0.0)}, "centre"),
        ({"gravity": (0.0, 0.0, 9.81)}, "True or False: whether weight acts, along -z of the world, not a tuple"),
        ({"gravity": True, "payload_kg": "much"}, "payload"),
        ({"drive_stiffness": 1e6}, "a mapping by their joints, not a float"),
        ({"drive_stiffness": {"leg1_s3": "stiff"}}, "leg1_s3"),
    ],
)
def test_loads_without_physical_meaning_are_refused(arguments, words):
    with pytest.raises(BadInputError, match=words):
        Loads(**arguments)


def test_loads_keep_the_values_given(drawing):
    soft, centre = {"leg1_s3": 1e6}, [0.0, 0.0, 0.1]
    loads = Loads(gravity=True, payload_kg=1, payload_centre_m=centre, drive_stiffness=soft)
    soft["leg1_s3"] = centre[2] = 1.0
    assert loads == Loads(True, 1.0, None, (0.0, 0.0, 0.1), {"leg1_s3": 1e6})


def test_other_types_of_loads_or_options_are_refused(drawing):
    with pytest.raises(BadInputError, match="loads are Loads, not a bool"):
        ClosureSolver(drawing.nominal_solver.mechanism, True)
    with pytest.raises(BadInputError, match="options of a closure are ClosureOptions, not a dict"):
        ClosureSolver(drawing.nominal_solver.mechanism, options={"max_gap_m": 0.1})


@pytest.mark.parametrize("given", [{"max_gap_m": np.nan}, {"max_iterations": "many"}, {"refinements": ()}])
def test_options_of_a_closure_are_numbers(given):
    """A largest gap of NaN was accepted: whatever stayed open counted as closed."""
    with pytest.raises(BadInputError, match="of a closure is a number from 0 on, not"):
        ClosureOptions(**given)


def test_loads_on_absent_parts_are_refused(drawing):
    mechanism = drawing.nominal_solver.mechanism
    with pytest.raises(BadInputError, match="'leg4_s3' is not a drive"):
        ClosureEnergy(mechanism, Loads(drive_stiffness={"leg4_s3": 1e6}))
    with pytest.raises(UnknownFrameError, match="did you mean 'ladle'"):
        ClosureEnergy(mechanism, Loads(gravity=True, payload_kg=1.0, payload_frame="laddle"))
