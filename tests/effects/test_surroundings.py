"""A creeping base and a wrong scale against the independent machine."""

import numpy as np
import pytest

from tests.effects.bench import EFFECTS
from tests.rig.metrology import without
from tests.rig.true_values import true_values

TEXTBOOK = [("base_drift", "steady"), ("metrology_scale", "constant")]


@pytest.mark.parametrize(("effect", "form"), TEXTBOOK)
def test_columns_span_those_of_the_textbook(bench, effect, form):
    ours, theirs = bench.columns(effect, form, main=True), bench.textbook(effect)
    if effect == "metrology_scale":
        # The rig's textbook scales the platform's origin; its device and the library scale what is seen: the target.
        theirs = bench.motion(bench.errors(effect, "a"))[:, None]
    assert bench.outside(theirs, ours) <= 1e-7
    assert bench.outside(ours, theirs) <= 1e-7


@pytest.mark.parametrize(("effect", "form"), TEXTBOOK)
def test_values_have_the_stated_meaning(bench, effect, form):
    """A drift's value is how far the platform creeps in the whole campaign; a scale's are millionths."""
    errors = bench.errors(effect, "a")
    values = true_values(effect, "a", 1.0, bench.scene, errors)
    units = {p.name: p.unit for p in bench.form(effect, form).parameters}
    assert {name: unit for name, (_, unit) in values.items()} == {name: units[name] for name in values}
    found = bench.valued(effect, form, {name: value for name, (value, _) in values.items()})
    assert bench.apart(bench.motion(errors), found) <= 1e-6


@pytest.mark.parametrize(("rig", "form"), [("b", "settling_0.6"), ("c", "logarithmic")])
def test_forms_of_the_rig_are_within_a_form(bench, rig, form):
    assert bench.outside(bench.motion(bench.errors("base_drift", rig)), bench.columns("base_drift", form)) <= 1e-6


@pytest.mark.parametrize("form", ["steady", "settling_0.15", "settling_0.3", "logarithmic"])
def test_main_courses_have_the_same_size(bench, form):
    """From beginning to end about 1 mm or 1 mrad for a value of one, whatever the course."""
    for p in bench.form("base_drift", form).parameters[:6]:
        ((channel, change),) = p.changes.items()
        assert channel == f"base.{p.name}"
        assert np.ptp(change) == pytest.approx(1e-3, rel=0.2)


def test_a_scale_by_air_needs_the_air_temperature(bench):
    """Without a hall thermometer the scale is constant."""
    form = EFFECTS["metrology_scale"].form("constant", bench.without("ambient"))
    assert [p.name for p in form.parameters] == ["scale"]
    assert [p.name for p in bench.form("metrology_scale", "constant").parameters] == ["scale", "scale_by_air"]


def test_scale_leaves_rotations_alone(bench):
    column = bench.columns("metrology_scale", "constant", main=True).reshape(-1, 6)
    assert not column[:, 3:].any()
    assert column[:, :3].any()
    spread = np.linalg.norm(column - column.mean(axis=0))  # the part common to all rows is in the frames
    assert np.linalg.norm(without(column.reshape(-1), bench.frames)) > 0.1 * spread
