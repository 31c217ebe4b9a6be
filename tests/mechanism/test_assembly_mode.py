"""Large errors that grow, on a crank between a spring and a magnet: where its mode ends follows in closed form.

A pin at distance d pulls the end of a crank of length r; a lever holds the crank by a torsional stiffness. With the
crank at θ, the lever at -B and the pin turned by an error φ, u = θ - φ solves (Prandtl and Tomlinson's model)

    λ sin u + u + φ + B = 0,   λ = k d r / k_r,

so that φ + B = |u| + λ sin |u|, which grows up to cos u = -1 / λ: there the mode ends, and the crank jumps.
"""

import re

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

from pouring_robot.exceptions import ClosureError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.loops_file import LoopsFile
from tests.mechanism.struts import joint

RATIO, CRANK, LEVER = 2.0, 0.5, 2.0
DISTANCE = RATIO * 1e5 / (1e8 * CRANK)
FOLD = np.arccos(-1.0 / RATIO)
LARGEST = FOLD + RATIO * np.sin(FOLD) - LEVER
"""The error (rad) at which the mode ends."""


def magnet(error, end_frame="tip"):
    parts = [
        joint("hinge", "base", "crank", "revolute"),
        joint("tip_mount", "crank", "tip", "fixed", f"{CRANK} 0 0"),
        joint("lever", "base", "handle", "revolute"),
        joint("ring", "base", "plate", "fixed"),
        joint("pin_mount", "plate", "pin", "fixed", f"{DISTANCE} 0 0"),
    ]
    loops = LoopsFile(
        base_frame="base",
        end_frame=end_frame,
        drives=("lever",),
        redundant_drives=True,  # both loops stay open
        loops=(
            {"name": "spring", "frame_a": "crank", "frame_b": "handle"},
            {"name": "pull", "frame_a": "tip", "frame_b": "pin", "type": "3d"},
        ),
    )
    mechanism = ClosedChainMechanism(f'<robot name="magnet"><link name="base"/>{"".join(parts)}</robot>', loops)
    return mechanism.displaced({"ring": pin.SE3(pin.utils.rotate("y", error), np.zeros(3))})


def close(mechanism, **options):
    solver = ClosureSolver(mechanism, options=ClosureOptions(**options))
    return solver.solve({"lever": -LEVER}, mechanism.neutral_configuration())


def behind(error):
    """Return the lag of the crank behind the pin, in rad, in the mode that grows from zero error."""
    return brentq(lambda u: u + RATIO * np.sin(u) - error - LEVER, 0.0, FOLD, xtol=1e-15)


@pytest.mark.parametrize("end_frame", ["tip", None])
@pytest.mark.parametrize("share", [0.3, 0.8, 0.97])
def test_the_mode_is_followed_up_to_its_end(share, end_frame):
    error = share * LARGEST
    found = close(magnet(error, end_frame))
    off = found.joint_values["hinge"] - (error - behind(error))
    assert np.exp(1j * off) == pytest.approx(1.0, abs=1e-10)  # whole turns do not matter


@pytest.mark.parametrize("most", [240, 8], ids=["it jumps", "or Newton does not settle"])
def test_where_the_mode_ends_it_is_refused_with_the_share_and_all_steps(most):
    whole, steps = 1.2 * LARGEST, 80
    with pytest.raises(ClosureError, match=r"^the loops do not close: the drawing's assembly mode ends at") as refused:
        close(magnet(whole), refinements=(1, 8), max_iterations=most)
    assert refused.value.status == "assembly mode ends"
    told = float(re.search(r"ends at ([\d.]+)% of the errors", str(refused.value))[1]) / 100
    # The well becomes flat at its end, so Newton's method may leave it a few steps earlier, but never later.
    assert LARGEST / whole - 6 / steps < told <= LARGEST / whole
    assert told * steps == pytest.approx(round(told * steps), abs=0.05)
    # The reported gaps are those of the last state in the mode.
    assert refused.value.gap_rad == pytest.approx(LEVER + told * whole - behind(told * whole), abs=2e-3)
    # Every step of growth, coarse and fine, takes at least two Newton steps.
    assert 2 * told * steps < refused.value.iterations < 10 * steps


def test_growth_equals_closing_step_by_step_by_hand():
    """The mechanism without its error is closed first, then with a tenth of it, with two; all Newton steps count."""
    error, at_once = 0.8 * LARGEST, ClosureOptions(most_steps=1)
    configuration, steps = magnet(0.0).neutral_configuration(), 0
    for share in range(11):
        found = ClosureSolver(magnet(error * share / 10), options=at_once).solve({"lever": -LEVER}, configuration)
        configuration, steps = found.configuration, steps + found.iterations
    grown = close(magnet(error))
    np.testing.assert_allclose(grown.configuration, configuration, rtol=0, atol=1e-12)
    assert grown.iterations == steps


def test_growth_that_is_not_smooth_is_refined():
    error = 0.8 * LARGEST
    plain, always = close(magnet(error)), close(magnet(error), smooth_below=0, refinements=(1, 3))
    np.testing.assert_allclose(always.configuration, plain.configuration, rtol=0, atol=1e-12)
    # Thirty steps, plus the first of the ten, which was not smooth.
    assert always.iterations > 2 * plain.iterations
    again = close(magnet(error), smooth_below=1000, refinements=(1, 3))
    assert again.iterations == plain.iterations
