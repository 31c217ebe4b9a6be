"""Displaced centres and tilted axes of U joints against the independent machine."""

import numpy as np
import pytest

from pouring_robot.robot.pouring.names import CHAINS as LEGS
from tests.rig.machine import Errors
from tests.rig.metrology import without


def test_centres_span_what_the_textbook_says(bench):
    ours, theirs = bench.columns("joint_centre_offset", "all"), bench.textbook("joint_centre_offset")
    assert bench.outside(theirs, ours) <= 1e-8
    assert bench.outside(ours, theirs) <= 1e-8


@pytest.mark.parametrize("side", ["s1", "seat_mount"])
@pytest.mark.parametrize("leg", LEGS)
def test_a_centre_is_displaced_in_millimetres_along_the_axes_of_its_platform(bench, leg, side):
    """The rig moves the same centre by the same amount; nothing is fitted but the frames."""
    way = np.array([0.3, -0.8, 0.5])
    errors = Errors.none(len(bench.scene))
    (errors.upper if side == "s1" else errors.lower)[:, leg - 1] = 1e-3 * way
    joint = f"leg{leg}_{side}"
    values = {f"{joint}.t{axis}": value for axis, value in zip("xyz", way.tolist(), strict=True)}
    found = bench.valued("joint_centre_offset", f"{joint}_alone", values)
    assert bench.apart(bench.motion(errors), found) <= 1e-7


@pytest.mark.parametrize(
    ("effect", "rig", "form"),
    [
        ("joint_centre_offset", "a", "all"),
        ("joint_centre_offset", "b", "moving_platform"),
        ("joint_centre_offset", "c", "all"),
        ("joint_axis_tilt", "a", "all"),
        ("joint_axis_tilt", "b", "all"),
        ("joint_axis_tilt", "c", "bores"),
        ("joint_axis_tilt", "c", "all"),
    ],
)
def test_forms_of_the_rig_are_within_a_form(bench, effect, rig, form):
    assert bench.outside(bench.motion(bench.errors(effect, rig)), bench.columns(effect, form)) <= 1e-6


@pytest.mark.parametrize("joint", [1, 2, 4, 5])
@pytest.mark.parametrize("leg", LEGS)
def test_an_axis_is_tilted_in_milliradians_and_the_next_joint_stays(bench, leg, joint):
    """The rig turns this axis alone; nothing is fitted but the frames."""
    parameters = bench.form("joint_axis_tilt", "all").parameters
    for p in parameters:
        if not p.name.startswith(f"leg{leg}_s{joint}."):
            continue
        errors = Errors.none(len(bench.scene))
        errors.tilt[:, leg - 1, joint - 1, "xyz".index(p.name[-1])] = 1e-3
        assert bench.apart(bench.motion(errors), bench.valued("joint_axis_tilt", "all", {p.name: 1.0})) <= 1e-7


@pytest.mark.parametrize("leg", LEGS)
def test_a_twisted_leg_is_the_same_wherever_the_twist_is(bench, leg):
    """A rotation of a leg's lower end about its axis relative to the upper one may be in the barrel or in the rod."""
    (twist,) = (p for p in bench.form("joint_axis_tilt", "twisted_legs").parameters if p.name == f"leg{leg}_twist")
    barrel = 1e-3 * bench.rows.channel(f"leg{leg}_s3.rz", bench.linear)
    rod = bench.rows.column(twist, bench.linear) / twist.prior_std
    assert np.abs(rod - barrel).max() <= 1e-9 * np.abs(rod).max()


@pytest.mark.parametrize(("form", "joint", "axis"), [
    ("fixed_platform", "s1", "z"), ("fixed_platform", "s1", "y"), ("moving_platform", "seat_mount", "x"),
])  # fmt: skip
def test_all_centres_of_a_platform_together_are_absorbed_by_a_frame(bench, form, joint, axis):
    """A platform whose centres are all shifted alike is displaced as a whole; no measurement shows that."""
    values = {f"leg{leg}_{joint}.t{axis}": 1.0 for leg in LEGS}
    together = bench.valued("joint_centre_offset", form, values)
    alone = bench.valued("joint_centre_offset", form, dict([next(iter(values.items()))]))
    assert np.linalg.norm(without(together, bench.frames)) <= 1e-7 * np.linalg.norm(together)
    assert np.linalg.norm(without(alone, bench.frames)) > 1e-2 * np.linalg.norm(alone)
