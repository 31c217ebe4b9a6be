"""The jackknife over blocks against fits by statsmodels and by the solver without them, and against many draws."""

from dataclasses import replace

import numpy as np
import pytest
import statsmodels.api as sm
from statsmodels.stats.outliers_influence import OLSInfluence

from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.intervals import Z95, deviations95, largest_std
from pouring_robot.estimation.jackknife import jackknife_covariance
from pouring_robot.estimation.map_fit import FitOptions, identify
from pouring_robot.estimation.noise import Noise, NoiseLevel
from tests.estimation.virtual import SIGMA, Virtual, model_of


def parts(columns, left, count=5):
    """Return equations by blocks of consecutive rows."""
    return zip(np.array_split(columns, count), np.array_split(left, count), strict=True)


def test_with_one_row_a_block_it_is_the_jackknife_of_least_squares():
    """That of statsmodels, whose influence measures give the parameters without each row; there is no prior."""
    random = np.random.default_rng(1)
    columns, seen = random.normal(size=(30, 4)), random.standard_t(4, 30)
    fit = sm.OLS(seen, columns).fit()
    without = OLSInfluence(fit).params_not_obsi
    expected = 29.0 / 30.0 * sum(np.outer(d, d) for d in without - without.mean(axis=0))
    found = jackknife_covariance(parts(columns, columns @ fit.params - seen, 30), fit.params, 0.0)
    np.testing.assert_allclose(found, (deviations95(29.0) / Z95) ** 2 * expected, rtol=1e-9)


def test_priors_count_as_no_data():
    """A parameter that no row shows keeps its prior, however much the rows scatter."""
    random = np.random.default_rng(2)
    columns = np.column_stack([10.0 * random.normal(size=20), np.zeros(20)])
    residual = random.normal(size=20)
    residual -= columns[:, 0] * (columns[:, 0] @ residual) / (columns[:, 0] @ columns[:, 0])
    found = jackknife_covariance(parts(columns, residual), np.zeros(2))
    assert found[0, 0] > 0.0
    np.testing.assert_array_equal(found[1], [0.0, 1.0])


def test_a_single_block_has_no_scatter():
    """Its distance from itself is zero, not unknown: the covariance that remains is that of the priors."""
    columns = np.random.default_rng(3).normal(size=(20, 2))
    prior = np.array([1.0, 0.5])
    inverse = np.linalg.inv(np.diag(prior) + columns.T @ columns)
    found = jackknife_covariance([(columns, columns[:, 0])], np.zeros(2), prior)
    np.testing.assert_allclose(found, inverse @ np.diag(prior) @ inverse, rtol=1e-9)


@pytest.mark.filterwarnings("error")
def test_the_result_scales_with_the_units():
    """A metre and a nanometre: eighteen digits between the squares, without loss of precision or a warning."""
    random = np.random.default_rng(4)
    columns, residual, unit = random.normal(size=(40, 3)), random.normal(size=40), np.array([1.0, 1e-9, 1e9])
    one = jackknife_covariance(parts(columns, residual), np.ones(3))
    other = jackknife_covariance(parts(columns * unit, residual), 1.0 / unit, unit**2)
    np.testing.assert_allclose(other * np.outer(unit, unit), one, rtol=1e-9)


@pytest.fixture(scope="module")
def wandering(drawing):
    """Sixty rows whose drives drift by ten times the noise from row to row, and the fit of their zeros."""
    virtual = Virtual(drawing, model_of(drawing, "drives"), 60, seed=4)
    off = virtual.rows.predict(virtual.unknowns).position_m
    virtual.measured = replace(
        virtual.measured, position_m=off + 10.0 * SIGMA * np.sin(np.arange(60) / 8.0)[:, None] * [1.0, 0.5, -1.0]
    )
    stretches = tuple(np.array_split(np.arange(60), 5))
    start = first_frames(virtual.rows, virtual.measured)
    fit = identify(virtual.rows, virtual.measured, start, virtual.prior, FitOptions(loss="linear"))
    return virtual, replace(fit, stretches=stretches)


def test_one_step_equals_the_whole_fit_without_a_block(wandering):
    virtual, fit = wandering
    assert fit.inflation > 2.0
    left = [np.setdiff1d(np.arange(60), stretch) for stretch in fit.stretches]
    others = (
        identify(virtual.rows[rows], virtual.measured[rows], fit.unknowns, virtual.prior, FitOptions(loss="linear"))
        for rows in left
    )
    apart = np.array([other.unknowns.values for other in others])
    scatter = np.sqrt(0.8 * np.square(apart - apart.mean(axis=0)).sum(axis=0)) * deviations95(4.0) / Z95
    by_tolerances = np.square(fit.covariance / virtual.prior).sum(axis=1)
    found = np.sqrt(np.diagonal(fit.scattered_covariance))
    np.testing.assert_allclose(found[FRAMES:], np.sqrt(scatter**2 + by_tolerances)[FRAMES:], rtol=0.02)


def test_blocks_are_used_where_the_residual_may_exceed_the_noise(wandering):
    _, fit = wandering
    every = np.eye(len(fit.prior_std))
    told = largest_std(every, fit.covariances)
    assert len(fit.covariances) == 2
    assert (told >= np.sqrt(np.diagonal(fit.inflated_covariance))).all()
    assert (told > 1.5 * np.sqrt(np.diagonal(fit.inflated_covariance))).any()
    assert len(replace(fit, stretches=()).covariances) == 1
    unmeasured = np.array([99])
    one_told = replace(fit, stretches=(np.arange(60), unmeasured))
    np.testing.assert_array_equal(largest_std(every, one_told.covariances), largest_std(every, fit.covariances[:1]))
    sound = replace(fit, equations=replace(fit.equations, residual=0.01 * fit.equations.residual))
    assert len(sound.covariances) == 1
    assert len(replace(sound, noise=NoiseLevel({"position": Noise(source="residuals")})).covariances) == 2


@pytest.mark.parametrize("rows", [60, 300])
def test_many_campaigns_of_a_model_that_lacks_an_effect(rows):
    """A path of two drives whose errors have a wave that the model lacks: against the fit to very many such rows.

    Nominal 95 % intervals from a noise as large as the residual hold less than 80 %.
    """
    random = np.random.default_rng(rows)

    def walk(count):
        corners = random.uniform(-1.0, 1.0, (12, 2))
        along = np.linspace(0.0, 10.999, count)
        first, share = along.astype(int), (along % 1.0)[:, None]
        drives = (1.0 - share) * corners[first] + share * corners[first + 1]
        columns = 10.0 * np.column_stack([np.ones(count), drives, drives.prod(axis=1)])
        return columns, 5.0 * np.sin(3.0 * drives).sum(axis=1) + random.normal(size=count)

    columns, seen = (np.concatenate(part) for part in zip(*(walk(rows) for _ in range(2000)), strict=True))
    truth = np.linalg.lstsq(columns, seen, rcond=None)[0]
    held, held_before = [], []
    for _ in range(400):
        columns, seen = walk(rows)
        inverse = np.linalg.inv(columns.T @ columns + np.eye(4))
        found = inverse @ columns.T @ seen
        residual = columns @ found - seen
        scattered = np.diagonal(jackknife_covariance(parts(columns, residual), found))
        held.append(np.abs(found - truth) <= Z95 * np.sqrt(scattered))
        noise = residual @ residual / (rows - 4)
        held_before.append(np.abs(found - truth) <= Z95 * np.sqrt(noise * np.diagonal(inverse)))
    assert 0.93 < np.mean(held) < 0.99
    assert np.mean(held_before) < 0.8
