"""Conditions: missing, filled in and assumed values; and effects where conditions hardly vary."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pouring_robot.effects.condition_facts import axis_over
from pouring_robot.effects.conditions import complete_conditions
from tests.effects.bench import EFFECTS, METADATA, REFERENCE_DEGC, ROBOT

LOADS = {"leg_compliance", "tilt_drive_compliance", "truss_deflection"}
UNTESTABLE = {
    "approach": {"drive_backlash"},
    "payload": LOADS,
    "truss_travel": {"truss_deflection"},
    "leg2": {"leg_thermal_expansion"},
    "platform": {"platform_thermal_expansion"},
    "melt": set(),
    "ambient": set(),
    "time": set(),
}
"""Effects that need each column of a campaign."""
FIELDS = {"approach": "approach", "payload": "weight_n", "truss_travel": "truss_travel_m"}
UNSAID = {
    "screw_pitch_m": {"drive_cyclic"},
    "truss_span_m": {"truss_deflection"},
    "ladle_tare_kg": LOADS,
    "ladle_centre_of_mass_m": LOADS,
    "reference_temperature_degC": set(),
}
"""Effects that need each entry of the metadata."""


def untestable(conditions):
    """Return the effects that conditions do not allow; check that all others work and give only finite numbers."""
    lacking = {effect.id for effect in EFFECTS.values() if effect.missing(conditions)}
    for effect in EFFECTS.values():
        if effect.id not in lacking:
            check_forms(effect, conditions)
    return lacking


def check_forms(effect, conditions):
    forms = effect.forms(conditions)
    assert forms
    for form in forms:
        for parameter in form.parameters:
            for change in parameter.changes.values():
                assert np.shape(change) == (len(conditions),)
                assert np.isfinite(change).all(), (effect.id, form.name, parameter.name)


def test_with_everything_there_every_effect_can_be_tested(bench):
    assert untestable(bench.rows.conditions) == set()
    assert bench.rows.conditions.filled == bench.rows.conditions.assumed == ()
    assert bench.rows.conditions.time_known


@pytest.mark.parametrize(("column", "expected"), UNTESTABLE.items())
def test_absent_column(bench, column, expected):
    assert untestable(bench.without(column)) == expected


def test_unmeasured_loads_of_drives_are_not_taken_for_zero(bench):
    """The legs' loads are measured, the tilt drive's is not, and no load is stated; then one leg's is missing, too."""
    force = np.full(bench.campaign.drives.shape, np.nan)
    for drives, known in ((3, {"leg_compliance"}), (2, set())):
        force[:, :3] = np.nan
        force[:, :drives] = 1e3
        campaign = dataclasses.replace(bench.campaign.with_conditions(payload=None), force=force)
        assert untestable(bench.rows_of(campaign).conditions) == UNTESTABLE["payload"] - known


@pytest.mark.parametrize(("entry", "expected"), UNSAID.items())
def test_an_entry_that_is_missing(bench, entry, expected):
    campaign = dataclasses.replace(bench.campaign, metadata=METADATA.model_copy(update={entry: None}))
    assert untestable(bench.rows_of(campaign).conditions) == expected


def test_sides_of_approach_count_where_they_are_known(bench):
    """One empty column of several does not affect the others; if all are empty the condition is absent."""
    values = np.array(bench.campaign.approach)
    for empty, expected in (([2], set()), ([0, 1, 2, 3], UNTESTABLE["approach"])):
        values[:, empty] = np.nan
        campaign = dataclasses.replace(bench.campaign, approach=np.array(values))
        assert untestable(bench.rows_of(campaign).conditions) == expected


def test_missing_names_the_condition(bench):
    assert EFFECTS["truss_deflection"].missing(bench.without("truss_travel")) == ("truss_travel_m",)
    assert EFFECTS["truss_deflection"].missing(bench.without("payload")) == ("weight_n",)


@pytest.mark.parametrize("column", [name for name in UNTESTABLE if name != "time"])
def test_single_missing_cells_are_filled_from_their_neighbours_in_time(bench, column):
    """Inside by linear interpolation in time; before the first value by that value; and it is reported."""
    if column == "approach":
        values = np.array(bench.campaign.approach)
        values[[0, 20]] = np.nan
        rows = bench.rows_of(dataclasses.replace(bench.campaign, approach=values))
        assert rows.conditions.filled == ("approach_q1", "approach_q2", "approach_q3", "approach_q4")
    else:
        values = np.array(bench.campaign.quantity(column))
        values[[0, 20]] = np.nan
        rows = bench.rows_of(bench.campaign.with_conditions(**{column: values}))
        assert rows.conditions.filled == (bench.campaign.heading(column),)
    field = FIELDS.get(column, f"{column}_rise_k")
    found, full = rows.conditions.value(field), bench.rows.conditions.value(field)
    assert untestable(rows.conditions) == set()
    kept = np.delete(np.arange(len(rows)), [0, 20])
    assert np.array_equal(found[kept], full[kept])
    time = bench.campaign.time_s
    share = (time[20] - time[19]) / (time[21] - time[19])
    between = full[19] + share * (full[21] - full[19])
    if column == "approach":
        between = np.where(between >= 0.0, 1.0, -1.0)
    assert found[20] == pytest.approx(between, rel=1e-12)
    assert found[0] == pytest.approx(full[1], rel=1e-12)


def test_without_times_the_row_number_stands_for_the_time(bench):
    given = bench.without("time")
    assert not given.time_known
    assert axis_over(["time_s"], given).label == "row"
    assert np.array_equal(given.time_s, np.arange(len(bench.rows)))
    assert given.elapsed[0] == 0.0
    assert given.elapsed[-1] == 1.0


def test_an_assumed_reference_temperature_is_reported(bench):
    metadata = METADATA.model_copy(update={"reference_temperature_degC": None})
    given = bench.rows_of(dataclasses.replace(bench.campaign, metadata=metadata)).conditions
    assert given.assumed == ("reference temperature 20 °C",)
    assert REFERENCE_DEGC == 20.0
    assert np.array_equal(given.value("leg_rise_k"), bench.rows.conditions.value("leg_rise_k"))


def test_rows_by_the_drawing(bench):
    """Pose, lengths and tilt are those of the independent machine, whatever the tracker saw."""
    given, scene = bench.rows.conditions, bench.scene
    assert given.position_m == pytest.approx(scene.position, abs=1e-6)
    assert given.tilt_rad == pytest.approx(scene.tilt, abs=1e-6)
    assert given.lengths_m == pytest.approx(scene.legs[:, :3], abs=1e-6)
    assert given.swing_rad[:, :3] == pytest.approx(scene.poses.passive[:, :3, 0], abs=1e-9)
    assert np.isnan(given.swing_rad[:, 3]).all(), "the tilt drive does not slide"


def test_sessions_are_numbered_in_order_of_appearance(bench):
    names = ("night",) * 30 + ("day",) * 40
    given = bench.rows_of(dataclasses.replace(bench.campaign, sessions=names)).conditions
    assert np.array_equal(given.session, [0] * 30 + [1] * 40)


def test_errors_of_the_model_do_not_change_the_conditions(bench):
    """The answer must not change the conditions it was found with."""
    from pouring_robot.robot.model import RobotModel
    from tests.support import ACTUAL

    amended = bench.rows_of(bench.campaign, RobotModel.load(ACTUAL)).conditions
    for field in ("position_m", "lengths_m", "drive_force"):
        assert getattr(amended, field) == pytest.approx(getattr(bench.rows.conditions, field), rel=1e-9)


def test_a_lagged_quantity_approaches_a_step_exponentially():
    """Closed form, rows out of order: 1 − exp(−t / τ) after the step."""
    time = np.array([300.0, 0.0, 1000.0, 40.0, 1e-9, 90.0])
    given = dataclasses.replace(complete_conditions(ROBOT, 6), time_s=time)
    found = given.behind((time > 0.0).astype(float), 250.0)
    assert found == pytest.approx(1.0 - np.exp(-time / 250.0), rel=1e-12, abs=1e-11)


def test_over_a_night_between_sessions_a_lagged_quantity_has_settled():
    time, values = np.array([0.0, 600.0, 43200.0, 43800.0]), np.array([25.0, 25.0, 0.0, 0.0])
    given = dataclasses.replace(complete_conditions(ROBOT, 4), time_s=time, session=np.array([0, 0, 1, 1]))
    np.testing.assert_allclose(given.behind(values, 2400.0), values, atol=1e-5)


@pytest.mark.parametrize("lag_s", [150.0, 600.0, 2400.0])
def test_a_lagged_quantity_does_not_depend_on_the_sampling_interval(lag_s):
    """A part lags behind one that warms up over an hour, read every ten minutes, against SciPy's integrator."""
    time, skin = np.arange(0.0, 3.0 * 3600.0 + 1.0, 600.0), lambda t: 20.0 * (1.0 - np.exp(-t / 3600.0))
    exact = {"t_eval": time, "rtol": 1e-10, "atol": 1e-10}
    core = solve_ivp(lambda t, y: (skin(t) - y) / lag_s, (0.0, time[-1]), [0.0], **exact).y[0]
    given = dataclasses.replace(complete_conditions(ROBOT, len(time)), time_s=time)
    assert np.abs(given.behind(skin(time), lag_s) - core).max() < 0.05 * np.abs(skin(time) - core).max()


@pytest.mark.parametrize("mixed", [False, True])
def test_a_session_whose_clock_restarts_does_not_affect_the_next(mixed):
    """Under a linear rise T = s (t - τ + τ exp(-t/τ)) in each; where rows of sessions are mixed they share a clock."""
    lag, slopes = 600.0, np.array([3e-3, -1e-3])
    time, session = np.tile(np.arange(0.0, 3600.0, 5.0), 2), np.repeat([0, 1], 720)
    expected = slopes[session] * (time - lag + lag * np.exp(-time / lag))
    order = np.argsort(time, kind="stable") if mixed else np.arange(len(time))
    time, session, expected = time[order], session[order], expected[order]
    given = dataclasses.replace(complete_conditions(ROBOT, 2), drives=np.zeros((1440, 4)), time_s=time, session=session)
    assert (np.abs(given.behind(slopes[session] * time, lag) - expected).max() < 0.02) != mixed


def test_a_lagged_constant_is_constant():
    given = complete_conditions(ROBOT, 4)
    values = np.tile([3.0, -1.0], (4, 1))
    assert np.array_equal(given.behind(values, 100.0), values)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_few_rows_in_one_session(rows):
    assert untestable(complete_conditions(ROBOT, rows)) == set()


def test_constant_conditions():
    """One pose, one load, one temperature, one time: no effect fails."""
    given = complete_conditions(ROBOT, 6)
    one = {
        field.name: np.repeat(getattr(given, field.name)[:1], 6, axis=0)
        for field in dataclasses.fields(given)
        if np.shape(getattr(given, field.name))[:1] == (6,)
    }
    assert {"drives", "time_s", "weight_n"} <= one.keys()
    for name in ("rises", "travels"):
        one[name] = {key: np.full(6, values[0]) for key, values in getattr(given, name).items()}
    assert untestable(dataclasses.replace(given, **one)) == set()


def test_nothing_that_varies_is_zero():
    """No load, no temperature rise, no travel: forces of zero and their powers are still numbers."""
    given = complete_conditions(ROBOT, 4)
    zero = {name: np.zeros_like(getattr(given, name)) for name in ("weight_n", "drive_force")}
    zero |= {name: dict.fromkeys(getattr(given, name), np.zeros(4)) for name in ("rises", "travels")}
    assert untestable(dataclasses.replace(given, **zero)) == set()
