"""The figures of a closure, for a body that is pulled several ways: its rest and every figure in closed form."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import ClosureError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.loops_file import LoopsFile
from tests.mechanism.struts import joint

AXIS = np.array([2.0, 3.0, 6.0]) / 7.0
STIFFNESS_N_M, STIFFNESS_NM_RAD = 1e8, 1e5


def pulled(*seats, redundant=True):
    """Return a body held by several seats, each on a slide along AXIS and a hinge about it, both driven.

    Slides and rotations about one axis commute, so the energy is a sum of squares, and the body rests at the mean.
    """
    axis = " ".join(map(repr, AXIS.tolist()))
    parts = ['<robot name="pulled"><link name="base"/>', joint("mount", "base", "body", "fixed")]
    for seat in seats:
        parts += [
            joint(f"{seat}_way", "base", f"{seat}_slide", "prismatic", axis=axis),
            joint(f"{seat}_turn", f"{seat}_slide", seat, "revolute", axis=axis),
            joint(f"{seat}_bolt", "body", f"{seat}_hole", "fixed"),
        ]
    loops = LoopsFile(
        base_frame="base",
        end_frame="body",
        cut_joints=("mount",),
        drives=tuple(f"{seat}_{kind}" for seat in seats for kind in ("way", "turn")),
        loops=tuple({"name": seat, "frame_a": seat, "frame_b": f"{seat}_hole"} for seat in seats),
        redundant_drives=redundant,
    )
    return ClosedChainMechanism("".join(parts) + "</robot>", loops)


def pull(mechanism, places, **options):
    """Close the body with seats moved by (m, rad) along AXIS."""
    drives = {f"{seat}_{kind}": v for seat, at in places.items() for kind, v in zip(("way", "turn"), at, strict=True)}
    solver = ClosureSolver(mechanism, options=ClosureOptions(**options))
    return solver.solve(drives, mechanism.neutral_configuration())


def test_a_body_pulled_two_ways_rests_half_way_and_every_figure_follows():
    way, turn = 0.0121, 0.050102
    found = pull(pulled("left", "right", redundant=False), {"right": (way, turn)})
    half = np.r_[way / 2 * AXIS, turn / 2 * AXIS]
    np.testing.assert_allclose(pin.log6(found.pose_base_to_end).vector, half, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.residual, [half, -half], rtol=0, atol=1e-12)
    stiffness = np.repeat([STIFFNESS_N_M, STIFFNESS_NM_RAD], 3)
    np.testing.assert_allclose(found.internal_wrench, [stiffness * half, -stiffness * half], rtol=1e-9)
    force, torque = STIFFNESS_N_M * way / 2, STIFFNESS_NM_RAD * turn / 2
    assert (found.internal_force_n, found.internal_torque_nm) == pytest.approx((force, torque), rel=1e-9)
    assert found.energy == pytest.approx(force * way / 2 + torque * turn / 2, rel=1e-9)
    # Six equations hold the body, two make the seats agree; four drives and the body had ten freedoms.
    assert (found.rank, found.freedoms, found.idle_joints) == (8, 2, ())
    assert found.headline == f"left open 6.05e+03 µm and 25.1 mrad after {found.iterations} iterations"
    table = found.to_frame()
    assert table["loop"].tolist() == ["left", "right"]
    columns = [*(f"{a}_m" for a in "xyz"), *(f"r{a}_rad" for a in "xyz")]
    columns += [*(f"f{a}_N" for a in "xyz"), *(f"t{a}_Nm" for a in "xyz")]
    np.testing.assert_array_equal(table[columns], np.hstack([found.residual, found.internal_wrench]))
    assert list(table) == ["loop", *columns]


@pytest.mark.parametrize(("place", "limit"), [((0.0198, 0.0), 0.0099), ((0.0, 0.198), 0.099)])
def test_parts_fit_up_to_the_allowed_gap(place, limit):
    """By default 10 mm and 0.1 rad; the body between two seats leaves half of their distance open on each side."""
    mechanism, name = pulled("left", "right", redundant=False), "max_gap_m" if place[0] else "max_gap_rad"
    gap = max(place) / 2
    found = pull(mechanism, {"right": place})
    just = found.gap_m if place[0] else found.gap_rad
    assert just == pytest.approx(limit, rel=1e-9)
    assert pull(mechanism, {"right": place}, **{name: just}).iterations == found.iterations
    with pytest.raises(ClosureError, match="the parts do not fit together") as refused:
        pull(mechanism, {"right": place}, **{name: 0.999 * gap})
    error = refused.value
    assert (error.gap_m, error.gap_rad) == pytest.approx((place[0] / 2, place[1] / 2), rel=1e-9, abs=1e-12)
    assert (error.status, error.iterations) == ("left open too far", found.iterations)
    with pytest.raises(ClosureError, match="the parts do not fit together"):
        pull(mechanism, {"right": 1.02 * np.array(place)})
    # Redundant drives may leave any gap open.
    agreed = pull(pulled("left", "right"), {"right": 1.02 * np.array(place)})
    assert max(agreed.gap_m, agreed.gap_rad) == pytest.approx(1.02 * gap, rel=1e-9)


@pytest.mark.parametrize("order", [("p", "q", "r"), ("r", "q", "p"), ("q", "p", "r")])
@pytest.mark.parametrize(("way", "turn", "worst"), [(0.03, 0.15, "q"), (0.03, 0.6, "r"), (-0.03, 0.15, "q")])
def test_the_worst_loop_is_found_with_a_metre_counted_as_ten_radians(order, way, turn, worst):
    """Three seats: one is fixed, one slides, one turns; each is off the mean by two thirds of the motion."""
    mechanism = pulled(*order)
    with pytest.raises(ClosureError) as stopped:
        ClosureSolver(mechanism, options=ClosureOptions(max_iterations=1)).solve(
            {"q_way": way, "r_turn": turn}, mechanism.neutral_configuration()
        )
    error = stopped.value
    assert error.worst_loop == worst
    assert (error.iterations, error.status) == (1, "not converged")
    assert (error.gap_m, error.gap_rad) == pytest.approx((2 / 3 * abs(way), 2 / 3 * turn), rel=1e-6)


def test_a_configuration_known_to_be_closed_is_taken_unchanged():
    mechanism = pulled("left", "right")
    found = pull(mechanism, {"right": (0.012, 0.05)})
    again = ClosureSolver(mechanism).result_at(found.configuration)
    assert again.iterations == 0
    for name in ("configuration", "residual", "internal_wrench", "jacobian"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))


def test_options_and_results_cannot_be_changed():
    options = ClosureOptions()
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.max_gap_m = 1.0
    found = pull(pulled("left", "right"), {})
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.energy = 0.0
    assert found.headline in repr(found)


def test_larger_errors_grow_in_more_steps():
    """One step up to 20 mrad; beyond, one for every 7 mrad, at most ten."""
    steps = ClosureOptions().growth_steps(np.array([0.0, 0.0199, 0.0201, 0.0209, 0.0211, 0.0629, 0.0631, 3.0]))
    assert steps.tolist() == [1, 1, 3, 3, 4, 9, 10, 10]
    assert ClosureOptions(growth_step=0.1, most_steps=3).growth_steps(0.25) == 3
    assert ClosureOptions(growth_step=0.1, most_steps=2).growth_steps(0.25) == 2
    options = ClosureOptions(one_go=0.3, growth_step=0.1)
    assert (options.growth_steps(0.3), options.growth_steps(0.31)) == (1, 4)
