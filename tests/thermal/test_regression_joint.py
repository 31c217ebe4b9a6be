"""Sensitive sets, the joint model's formulas, and the contest against single sets."""

import pickle
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import check_estimator

from pouring_robot.exceptions import TableError
from pouring_robot.thermal.regression.joint_model import WEIGHTINGS, JointRegression, PrincipalComponentRegression
from pouring_robot.thermal.regression.methods import fit_lines, judge, left_out
from pouring_robot.thermal.regression.sensitive_sets import (
    SensitiveSetSelector,
    grey_relational_degree,
    variance_inflation_factors,
)
from pouring_robot.thermal.regression.table import ErrorSetError, ErrorTable
from pouring_robot.thermal.regression.thermal_model import ErrorLine, Positions, ResidualStatistics
from scripts.paper.thermal.regression import TableDesign, compare, count_beaten, draw_table, report_beaten
from tests.support import round_off


@pytest.fixture
def table():
    return draw_table(np.random.default_rng(11), replace(TableDesign(), first_group=(1, 1))).table


def fitted(table, weighting="coefficients", **settings):
    return JointRegression(weighting, **settings).fit(table.temperature_column, table.errors)


# --- sensitive sets -------------------------------------------------------------------------------


def test_groups_and_choice(table):
    selector = SensitiveSetSelector().fit(table.frame(), table.temperatures_K)
    assert selector.groups_ == [[0], list(range(1, 10))]
    degrees = grey_relational_degree(table.errors, table.temperatures_K)
    factors = [variance_inflation_factors(table.errors[:, [0, i]])[-1] if i else np.inf for i in range(10)]
    np.testing.assert_allclose(selector.vif_[1:], factors[1:], rtol=1e-10)
    passed = [i for i in range(1, 10) if factors[i] < 10.0]
    assert selector.sensitive_.tolist() == [0, max(passed, key=lambda i: degrees[i])]
    assert selector.guard_held_.all()
    assert list(selector.get_feature_names_out()) == [table.names[i] for i in selector.sensitive_]
    selector.set_output(transform="pandas")
    assert selector.transform(table.frame()).shape == (12, 2)


def test_where_no_set_passes_the_guard_the_degree_decides():
    y = np.linspace(0.0, 1.0, 9)
    first, second = y + 0.6 * np.sin(7.0 * y), y + 0.5 * np.cos(9.0 * y)
    X = np.column_stack([first, first + 1e-3 * y, second, second + 0.01 * np.cos(9.0 * y)])
    usual, strict = SensitiveSetSelector().fit(X, y), SensitiveSetSelector(vif_limit=1.0001).fit(X, y)
    assert usual.groups_ == strict.groups_ == [[0, 1], [2, 3]]
    assert usual.guard_held_.tolist() == [True, True] and strict.guard_held_.tolist() == [True, False]
    degrees = grey_relational_degree(X, y)
    assert strict.sensitive_[1] == max([2, 3], key=lambda i: degrees[i])


def test_the_smallest_group_chooses_first(table):
    turned = SensitiveSetSelector().fit(table.errors[:, ::-1], table.temperatures_K)
    straight = SensitiveSetSelector().fit(table.errors, table.temperatures_K)
    assert turned.groups_ == [[9], list(range(9))]
    assert (9 - turned.sensitive_).tolist() == straight.sensitive_.tolist()


def test_the_guard_decides_where_it_can():
    y = np.linspace(0.0, 1.0, 12)
    random = np.random.default_rng(0)
    X = y[:, None] + np.array([0.10, 0.02, 0.15, 0.15]) * random.normal(size=(12, 4))
    selector = SensitiveSetSelector(lambda_cut=0.0).fit(X, y)
    assert len(selector.groups_) == 1
    split = SensitiveSetSelector(2).fit(X, y)
    limit = np.sort(split.vif_[split.groups_[1]])[:2].mean()
    held = SensitiveSetSelector(2, vif_limit=limit).fit(X, y)
    assert held.guard_held_.all() and held.vif_[held.sensitive_[1]] == split.vif_[split.groups_[1]].min()


def test_scikit_learns_checks():
    check_estimator(SensitiveSetSelector(), on_skip=None)


def test_bad_limit(table):
    with pytest.raises(ErrorSetError, match="vif_limit = 1"):
        SensitiveSetSelector(vif_limit=1.0).fit(table.errors, table.temperatures_K)


# --- formulas of the joint model ------------------------------------------------------------------


def lines_of_sets(model, column):
    """Return P_g^PCR, the sensitive sets from temperature and the other sets' lines, (n, 1) to (n, g)."""
    return column * model.set_coef_ + model.set_intercept_


@pytest.mark.parametrize("weighting", ["coefficients", "components"])
def test_the_papers_recipe_step_by_step(table, weighting):
    model = fitted(table, weighting)
    i, j = model.selector_.sensitive_
    T, P1, P8 = table.temperatures_K, table.errors[:, i], table.errors[:, j]
    equation_21 = PrincipalComponentRegression().fit(np.column_stack([P1, P8]), T)
    (c1, c8), c0 = equation_21.coef_, equation_21.intercept_
    line1, line8 = (np.polynomial.Polynomial.fit(T, P, 1)(T) for P in (P1, P8))
    P1_pcr, P8_pcr = (T - c0 - c8 * line8) / c1, (T - c0 - c1 * line1) / c8
    w1, w8 = (abs(c1), abs(c8)) if weighting == "coefficients" else (0.5, 0.5)
    expected = (w1 * P1_pcr + w8 * P8_pcr) / (w1 + w8)
    column = table.temperature_column
    singles, sensitive = column * model.single_coef_ + model.single_intercept_, lines_of_sets(model, column)
    np.testing.assert_allclose(singles, np.column_stack([line1, line8]), rtol=1e-10)
    np.testing.assert_allclose(sensitive, np.column_stack([P1_pcr, P8_pcr]), rtol=1e-9)
    np.testing.assert_allclose(model.predict(column), expected, rtol=1e-9)
    # The slope as the module's text has it.
    r1, r8, r = np.corrcoef(P1, T)[0, 1], np.corrcoef(P8, T)[0, 1], np.corrcoef(P1, P8)[0, 1]
    beta = (r1 + r8) / (2 + 2 * r)
    np.testing.assert_allclose(equation_21.standardised_coef_, beta, rtol=1e-10)
    assert model.set_coef_[1] == pytest.approx((1 / beta - r1) * P8.std() / T.std(), rel=1e-9)


def test_sensitive_sets_weighed_by_their_groups_are_the_mean_line(table):
    model, line = fitted(table), fit_lines(table)["mean"]
    column, groups = table.temperature_column, model.selector_.groups_
    mean_line = LinearRegression().fit(column, table.errors.mean(axis=1))
    found = line.predict(table.temperatures_K)[:, 0]
    np.testing.assert_allclose(found, mean_line.predict(column), rtol=1e-10)
    # As the text of the methods has it, through P_g^PCR.
    expected = np.zeros(len(column))
    for g, group in enumerate(groups):
        pcr, mean_set = lines_of_sets(model, column)[:, g], table.errors[:, group].mean(axis=1)
        scale = LinearRegression().fit(column, mean_set).coef_[0] / LinearRegression().fit(column, pcr).coef_[0]
        expected += len(group) / 10 * (mean_set.mean() + scale * (pcr - pcr.mean()))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_exact_lines_come_back(weighting):
    T = np.linspace(900.0, 1900.0, 6)[:, None]
    noiseless = 1e-6 * (T - 300.0)
    model = JointRegression(weighting).fit(T, np.hstack([noiseless, noiseless, noiseless]))
    np.testing.assert_allclose(model.predict(T), noiseless[:, 0], rtol=1e-9)
    assert model.score(T, noiseless) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_units_do_not_matter(table, weighting):
    celsius = table.temperature_column - 273.15
    metres, millimetres = fitted(table, weighting), JointRegression(weighting).fit(celsius, 1e3 * table.errors)
    np.testing.assert_allclose(millimetres.predict(celsius), 1e3 * metres.predict(table.temperature_column), rtol=1e-9)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_more_groups_and_one_set(table, weighting):
    model = fitted(table, weighting, selector=SensitiveSetSelector(n_clusters=3), explained=1.0)
    assert model.weights_.shape == model.set_coef_.shape == (3,)
    assert model.weights_.sum() == pytest.approx(1.0)
    one = JointRegression(weighting).fit(table.temperature_column, table.errors[:, 4])
    assert one.predict(table.temperature_column).shape == (12,)


def test_scikit_learn_habits(table):
    model, column = (
        JointRegression("components", selector=SensitiveSetSelector(vif_limit=8.0)),
        table.temperature_column,
    )
    assert clone(model).get_params()["selector__vif_limit"] == 8.0
    with pytest.raises(NotFittedError):
        model.predict(column)
    settings = model.get_params()
    assert model.fit(column, table.frame()) is model and model.get_params() == settings
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(column), model.predict(column))
    named = JointRegression().fit(pd.DataFrame(column, columns=["melt_K"]), table.frame())
    assert list(named.feature_names_in_) == ["melt_K"]
    pipeline = make_pipeline("passthrough", JointRegression()).fit(column, table.errors)
    np.testing.assert_array_equal(pipeline.predict(column), fitted(table).predict(column))
    search = GridSearchCV(JointRegression(), {"weighting": list(WEIGHTINGS)}, cv=3).fit(column, table.errors)
    assert search.best_params_["weighting"] in WEIGHTINGS


def test_joint_errors(table):
    column = table.temperature_column
    with pytest.raises(ErrorSetError, match="'best' is not known"):
        JointRegression("best").fit(column, table.errors)
    with pytest.raises(ErrorSetError, match="temperature alone"):
        JointRegression().fit(np.hstack([column, column]), table.errors)
    with pytest.raises(ErrorSetError, match="temperature 0 is constant"):
        JointRegression().fit(np.ones_like(column), table.errors)
    with pytest.raises(ErrorSetError, match="error set 3 is constant"):
        JointRegression().fit(column, np.where(np.arange(10) == 3, 1.0, table.errors))
    with pytest.raises(ValueError, match="NaN"):
        JointRegression().fit(column, np.where(np.arange(10) == 3, np.nan, table.errors))


def test_a_component_that_does_not_hold_a_set():
    T = np.arange(4.0)[:, None]
    a, b = np.array([1.0, -1.0, 1.0, -1.0]), np.array([1.0, 1.0, -1.0, -1.0])
    with pytest.raises(ErrorSetError, match="do not represent error set"):
        JointRegression("coefficients", explained=0.5).fit(T, np.column_stack([a, b]))


# --- the contest ----------------------------------------------------------------------------------


def test_the_generator_is_what_it_says():
    random = np.random.default_rng(0)
    design = TableDesign(shared_m=0.0, noise_m=0.0)
    drawn = draw_table(random, design)
    heat = (drawn.table.temperatures_K - 293.15) / 1680.0
    deflections = drawn.table.errors / heat[:, None]
    assert np.ptp(deflections, axis=0).max() <= round_off(scale=deflections.max(), terms=4)
    flat = deflections[0] < 1.75e-3
    assert 1 <= flat.sum() <= 3 and drawn.left_out.errors.shape == (12, 40)
    assert (drawn.left_out.errors[-1] < 1.75e-3).sum() == 4 * flat.sum()
    share = [fitted(draw_table(random).table).component_regression_.cumulative_[0] for _ in range(100)]
    assert np.mean(share) == pytest.approx(0.97, abs=0.015)  # the paper: 0.9699


def test_spread_is_the_distance_of_slopes():
    # The sentence of the methods' text: spread² grows by s_T² (m − mean slope)² and by nothing else.
    drawn = draw_table(np.random.default_rng(2))
    T, errors = drawn.left_out.temperatures_K, drawn.left_out.errors
    centre = np.polyfit(T, errors.mean(axis=1), 1)
    best = ResidualStatistics.of(errors - np.polyval(centre, T)[:, None]).spread
    for change in (1e-6, -3e-6):
        spread = ResidualStatistics.of(errors - np.polyval(centre + np.array([change, 1.0]), T)[:, None]).spread
        expected = best**2 + change**2 * T.var() * errors.size / (errors.size - 1)
        assert spread**2 == pytest.approx(expected, rel=1e-10)


def test_figures_of_one_table(table):
    figures = compare(table)
    assert list(figures) == ["none", "single 1", "single 2", "paper", "components", "mean"]
    assert all(left.spread > 0.0 for left in figures.values())
    for left in figures.values():
        assert left.rms**2 == pytest.approx(left.mean**2 + left.spread**2 * (1 - 1 / 96), rel=1e-12)  # 12 rows, 8 sets


# --- lines that depend on the pose ----------------------------------------------------------------


@pytest.fixture
def mirrored():
    """Errors of opposite sign left and right of the middle, which no line of temperature serves."""
    random = np.random.default_rng(4)
    places = Positions(("x", "y"), ("m", "m"), random.uniform(-0.1, 0.1, size=(12, 2)))
    heat = np.linspace(0.3, 1.0, 9)
    errors = 0.04 * heat[:, None] * places.values[:, 1] + 1e-5 * random.normal(size=(9, 12))
    return ErrorTable(600.0 + 1000.0 * heat, errors, tuple(f"P{i}" for i in range(12))), places


def test_a_line_of_the_pose_is_plain_least_squares(mirrored):
    table, places = mirrored
    line = ErrorLine.of_pose(table, places)
    T, (x, y) = table.temperatures_K[:, None], places.values.T
    columns = [np.broadcast_to(c, table.errors.shape).ravel() for c in (1 + 0 * T, T, x, y, T * x, T * y)]
    rows = np.column_stack(columns)
    fitted_by = rows @ np.linalg.lstsq(rows, table.errors.ravel(), rcond=None)[0]
    np.testing.assert_allclose(line.predict(table.temperatures_K, places.values).ravel(), fitted_by, atol=1e-12)


def test_opposite_errors_need_the_pose(mirrored):
    table, places = mirrored
    found = left_out(table, places)
    assert found["mean"].rms > 0.9 * found["none"].rms  # one line for all helps nobody
    assert found["pose"].rms < 0.02 * found["none"].rms
    # The same by hand for one set.
    others = [i for i in range(12) if i != 5]
    lines = fit_lines(table.without(["P5"]), places.rows(others))
    alone = judge(lines, table.select(["P5"]), places.rows([5]))
    assert alone["pose"].rms < 5e-5


def test_too_few_sets_are_refused(mirrored):
    table, places = mirrored
    with pytest.raises(TableError, match="a line over 2 inputs takes 4 sets or more, not 3"):
        ErrorLine.of_pose(table.select(["P0", "P1", "P2"]), places.rows([0, 1, 2]))
    with pytest.raises(TableError, match=r"too few error sets \(2\) to leave out each in turn; give 3 or more"):
        left_out(table.select(["P0", "P1"]))


# --- contest ----------------------------------------------------------------------------------------


def test_what_is_counted_is_said(capsys):
    counts = report_beaten(6)
    assert capsys.readouterr().out.splitlines() == [str(beaten) for beaten in counts.values()]
    assert "of 6 tables" in str(counts["mean"])


def test_the_joint_model_beats_each_single_regression_and_the_literal_recipe_does_not():
    counts = count_beaten(200)
    assert counts["mean"].fraction >= 0.9 and counts["mean"].interval[0] > 0.8
    assert counts["paper"].interval[1] < 0.9
    assert counts["components"].interval[1] < 0.9
    # No model can do much better: the generator's own mean does not.
    assert counts["oracle"].fraction - counts["mean"].fraction < 0.06


def test_whatever_the_seed():
    wins = sum(count_beaten(15, seed=seed)["mean"].both for seed in range(1, 11))
    assert wins / 150 > 0.9


def test_the_papers_own_way_of_leaving_out():
    counts = count_beaten(60, within=True)
    assert "oracle" not in counts and counts["paper"].fraction < 0.9
