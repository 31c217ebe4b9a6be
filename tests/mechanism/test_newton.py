"""The search: as many steps as the theory of Newton's method predicts, to the minimum from near and from far."""

import numpy as np
import pytest

from pouring_robot.exceptions import ClosureError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import ClosureEnergy, Loads
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.closure.status import settles
from pouring_robot.mechanism.loops_file import LoopsFile
from tests.mechanism.struts import joint
from tests.support import displaced, random_poses

ARM = 0.5
STIFFNESS = 1e8
WIDE = {"max_gap_m": np.inf}
LOADED = Loads(gravity=True, payload_kg=400.0, drive_stiffness={"leg1_s3": 2e7, "leg4_s5": 1e6})


def pointer():
    """Return a crank about y that reaches for a pin on a driven slide along x, which it may not reach.

    With the crank's length r and the pin's distance d: E = k (d² + r² - 2 d r cos θ) / 2, a minimum at θ = 0.
    """
    parts = [
        joint("hinge", "base", "crank", "revolute"),
        joint("tip_mount", "crank", "tip", "fixed", f"{ARM} 0 0"),
        joint("way", "base", "pin", "prismatic", axis="1 0 0"),
    ]
    loops = LoopsFile(
        base_frame="base",
        end_frame="tip",
        drives=("way",),
        loops=({"name": "grip", "frame_a": "tip", "frame_b": "pin", "type": "3d"},),
    )
    return ClosedChainMechanism(f'<robot name="pointer"><link name="base"/>{"".join(parts)}</robot>', loops)


def point(distance, angle, **options):
    mechanism = pointer()
    start = mechanism.with_joint_values(mechanism.neutral_configuration(), {"hinge": angle})
    return ClosureSolver(mechanism, options=ClosureOptions(**(WIDE | options))).solve({"way": distance}, start)


def steps_of_newton(distance, angle):
    """Return the number of steps for the angle alone: one of Gauss-Newton, then of Newton, down to round-off."""
    angle -= ARM / distance * np.sin(angle)
    for steps in range(1, 100):
        if abs(angle) < 1e-15:
            return steps
        angle -= np.tan(angle)
    raise AssertionError("a start from which Newton's method does not converge")


@pytest.mark.parametrize("angle", [1e-3, 0.05, -0.3])
@pytest.mark.parametrize("distance", [0.3, 0.45, 0.8, 1.2])
def test_a_pin_out_of_reach_is_pointed_at_in_the_number_of_newton_steps(distance, angle):
    """Gauss-Newton alone would leave 1 - r / d of the angle per step; Newton cubes it."""
    found = point(distance, angle)
    gap = abs(distance - ARM)
    assert found.joint_values["hinge"] == pytest.approx(0.0, abs=1e-14)
    assert found.gap_m == pytest.approx(gap, rel=1e-12)
    assert found.energy == pytest.approx(0.5 * STIFFNESS * gap**2, rel=1e-12)
    assert found.iterations <= steps_of_newton(distance, angle) + 1  # one more, which shows convergence


@pytest.mark.parametrize("angle", [3.1, 2.0, -2.5])
@pytest.mark.parametrize("distance", [0.1, 0.45, 0.8])
def test_from_behind_it_goes_to_the_minimum_and_not_to_the_maximum(distance, angle):
    found = point(distance, angle)
    assert np.cos(found.joint_values["hinge"]) == pytest.approx(1.0, abs=1e-12)
    assert found.gap_m == pytest.approx(abs(distance - ARM), rel=1e-12)


def test_a_search_that_is_stopped_reports_the_best_state():
    """With the pin of one loop the energy is a function of the gap, which no further step can increase."""
    start = np.sqrt(0.8**2 + ARM**2 - 2 * 0.8 * ARM * np.cos(2.5))
    needed = point(0.8, 2.5).iterations
    gaps = [start]
    for most in range(1, needed):
        with pytest.raises(ClosureError, match=f"do not settle after {most} iterations") as stopped:
            point(0.8, 2.5, max_iterations=most)
        assert (stopped.value.iterations, stopped.value.worst_loop) == (most, "grip")
        gaps.append(stopped.value.gap_m)
    assert point(0.8, 2.5, max_iterations=needed).iterations == needed
    assert (np.diff(gaps) <= 1e-15).all()
    assert gaps[-1] == pytest.approx(0.3, rel=1e-9)


def remainder(solver, result):
    """Return the distance of the minimum from a result (m or rad), by the exact Hessian, and its lowest eigenvalue."""
    energy = solver.energy
    state = energy.evaluate(result.configuration, result.commanded)
    hessian = energy.basis.T @ energy.hessian(state) @ energy.basis
    step = np.linalg.solve(hessian, energy.basis.T @ state.gradient)
    return np.abs(step).max(), np.linalg.eigvalsh(hessian)[0]


@pytest.mark.parametrize(("loads", "most"), [(Loads(), 15), (LOADED, 30)], ids=["left open", "loaded"])
def test_the_result_is_a_minimum_to_round_off_in_few_steps_from_far(crooked, loads, most):
    random = np.random.default_rng(31)
    solver = ClosureSolver(crooked.actual_solver.mechanism, loads, ClosureOptions(most_steps=1))
    for pose in random_poses(40, seed=31):
        start = crooked.kinematics.configuration(displaced(pose, random))
        result = solver.solve(crooked.kinematics.inverse(pose), start)
        left, lowest = remainder(solver, result)
        assert left < 1e-12
        assert lowest > 0.0
        assert result.iterations <= most


def test_earlier_closures_do_not_affect_a_result(crooked):
    """A solver keeps factorisations from step to step, not from closure to closure."""
    mechanism = crooked.actual_solver.mechanism
    poses = [(crooked.kinematics.inverse(p), crooked.kinematics.configuration(p)) for p in random_poses(6, 32)]
    used = ClosureSolver(mechanism)
    for pose in poses:
        found, fresh = used.solve(*pose), ClosureSolver(mechanism).solve(*pose)
        assert found.iterations == fresh.iterations
        np.testing.assert_array_equal(found.configuration, fresh.configuration)


@pytest.fixture
def hessians(monkeypatch):
    """Count the Hessians that are formed, by kind: they are the cost of a step."""
    formed = {"hessian": 0, "gauss_newton_hessian": 0}

    def counted(name, original):
        def form(energy, state):
            formed[name] += 1
            return original(energy, state)

        return form

    for name in formed:
        monkeypatch.setattr(ClosureEnergy, name, counted(name, getattr(ClosureEnergy, name)))
    return formed


def test_loops_that_close_need_no_curvature_of_residuals(drawing, hessians):
    """Their wrenches vanish; a start that is closed already needs no second step."""
    random = np.random.default_rng(33)
    for pose in random_poses(20, seed=33):
        drives = drawing.kinematics.inverse(pose)
        found = drawing.nominal_solver.solve(
            drives, drawing.kinematics.configuration(displaced(pose, random, 1e-4, 1e-4))
        )
        # Newton's method squares errors: from 1e-4 to 1e-8 to 1e-16, and one step to confirm.
        assert found.iterations <= 3
        assert drawing.nominal_solver.solve(drives, found.configuration).iterations == 1
    assert hessians["hessian"] == 0
    strict = ClosureSolver(drawing.nominal_solver.mechanism, options=ClosureOptions(closed_below=0.0))
    strict.solve(drives, found.configuration)
    assert hessians["hessian"] > 0


def test_near_the_minimum_steps_share_a_hessian(crooked, hessians):
    steps = 0
    for pose in random_poses(20, seed=34):
        found = crooked.actual_solver.solve(crooked.kinematics.inverse(pose), crooked.kinematics.configuration(pose))
        steps += found.iterations
    assert sum(hessians.values()) <= steps - 10


@pytest.mark.parametrize("spring", [1e2, 1e4, 1e6])
def test_round_off_in_a_soft_direction_is_not_chased(drawing, spring):
    """The loops' round-off, ε times a metre times their stiffness, moves a soft drive by far more than ε."""
    solver = ClosureSolver(drawing.nominal_solver.mechanism, Loads(drive_stiffness={"leg1_s3": spring}))
    noise = 10 * np.finfo(float).eps * STIFFNESS / spring
    for pose in random_poses(20, seed=35):
        drives = drawing.kinematics.inverse(pose)
        found = solver.solve(drives, drawing.kinematics.configuration(pose))
        assert found.joint_values["leg1_s3"] == pytest.approx(drives["leg1_s3"], abs=noise + 1e-12)
        assert found.iterations <= 6


def test_steps_that_no_longer_shrink_are_taken_for_round_off(crooked):
    """With a tolerance of zero they end the search, with the same result; if they may not, nothing ends it."""
    (pose,) = random_poses(1, seed=36)
    place = crooked.kinematics.inverse(pose), crooked.kinematics.configuration(pose)
    mechanism = crooked.actual_solver.mechanism
    found = crooked.actual_solver.solve(*place)
    strict = ClosureSolver(mechanism, options=ClosureOptions(left_over=0.0)).solve(*place)
    np.testing.assert_allclose(strict.configuration, found.configuration, rtol=0, atol=1e-13)
    assert found.iterations <= strict.iterations <= found.iterations + 5
    with pytest.raises(ClosureError, match="do not settle after 240 iterations"):
        ClosureSolver(mechanism, options=ClosureOptions(left_over=0.0, round_off=0.0)).solve(*place)


@pytest.mark.parametrize(("length", "previous", "ends"), [(9e-10, 1e-9, True), (9e-8, 9e-10, False), (0.0, 0.0, True)])
def test_a_step_that_grows_out_of_round_off_does_not_end_the_search(length, previous, ends):
    options = ClosureOptions()
    assert settles(length, previous, 1.0, options.left_over, options.round_off)[1] == ends
