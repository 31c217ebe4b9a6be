"""Effects of heat against the independent machine, and what biased and slow thermometers add."""

import numpy as np
import pytest

from tests.effects.bench import CHANNELS, EFFECTS
from tests.rig.true_values import true_values

TEXTBOOK = [("leg_thermal_expansion", "own_temperature"), ("platform_thermal_expansion", "even")]


@pytest.mark.parametrize(("effect", "form"), TEXTBOOK)
def test_columns_span_those_of_the_textbook(bench, effect, form):
    ours, theirs = bench.columns(effect, form, main=True), bench.textbook(effect)
    assert ours.shape[1] == theirs.shape[1] == 1
    assert bench.outside(theirs, ours) <= 1e-8
    assert bench.outside(ours, theirs) <= 1e-8


@pytest.mark.parametrize(("effect", "form"), TEXTBOOK)
def test_expansion_has_the_stated_meaning(bench, effect, form):
    errors = bench.errors(effect, "a")
    values = true_values(effect, "a", 1.0, bench.scene, errors)
    assert values == {"expansion": (10.0, "1e-6/K")}
    assert bench.form(effect, form).parameters[0].unit == "1e-6/K"
    assert bench.apart(bench.motion(errors), bench.valued(effect, form, {"expansion": 10.0})) <= 1e-6


@pytest.mark.parametrize(
    ("effect", "rig", "form", "most"),
    [
        ("leg_thermal_expansion", "c", "own_temperature", 1e-6),  # barrel and rod: in the form
        ("platform_thermal_expansion", "b", "even", 1e-6),  # less along x: in the form
        ("leg_thermal_expansion", "b", "own_temperature", 0.01),  # another time constant and share than the form's
        ("platform_thermal_expansion", "c", "even", 0.02),  # another time constant
    ],
)
def test_other_forms_of_the_rig(bench, effect, rig, form, most):
    assert bench.outside(bench.motion(bench.errors(effect, rig)), bench.columns(effect, form)) <= most


def test_legs_grow_by_length_and_temperature(bench):
    """Closed form: 1e-6/K times length times rise."""
    given = bench.rows.conditions
    main = bench.form("leg_thermal_expansion", "own_temperature").parameters[0]
    for k in range(3):
        expected = 1e-6 * given.lengths_m[:, k] * (bench.campaign.conditions[f"leg{k + 1}"] - 20.0)
        assert np.allclose(main.changes[CHANNELS[k]], expected, rtol=1e-12)
    assert len(main.changes) == 3, "leg 4 is passive"


def test_a_biased_thermometer_can_be_corrected(bench):
    """A leg's thermometer reads 5 K too much: its bias parameter restores the true column."""
    from dataclasses import replace

    given = bench.rows.conditions
    wrong = replace(given, rises={**given.rises, "leg2": given.rises["leg2"] + 5.0})
    true = bench.form("leg_thermal_expansion", "own_temperature").parameters[0].changes[CHANNELS[1]]
    found = {p.name: p for p in EFFECTS["leg_thermal_expansion"].form("own_temperature", wrong).parameters}
    mended = found["expansion"].changes[CHANNELS[1]] - 5.0 * found["l2_thermometer_bias"].changes[CHANNELS[1]]
    assert np.allclose(mended, true, rtol=1e-12, atol=1e-18)


def test_without_a_platform_thermometer_legs_can_still_be_tested(bench):
    form = EFFECTS["leg_thermal_expansion"].form("own_temperature", bench.without("platform"))
    names = {p.name for p in form.parameters}
    assert "platform_share" not in names
    assert {"expansion", "other_length", "lag_600_s", "l3_thermometer_gain"} <= names
