"""The search: its Hessian with second derivatives is the true one, and it works with exact data."""

import numpy as np
import pytest

from pouring_robot.estimation.levenberg_marquardt import Search
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.residuals import whiten
from pouring_robot.estimation.robust import robust_terms
from pouring_robot.exceptions import CalibrationError
from tests.estimation.virtual import SIGMA, Virtual, model_of


@pytest.fixture(scope="module")
def at_the_answer(drawing):
    virtual = Virtual(drawing, model_of(drawing, "geometry"), 30, seed=6)
    search = Search(virtual.rows, virtual.measured, virtual.unknowns, virtual.prior, "linear")
    search.run(1e-3, 100)
    return virtual, search


def cost_at(virtual, search, step):
    unknowns = search.unknowns.at(search.unknowns.values + virtual.prior * step)
    cost, _ = robust_terms(whiten(virtual.measured, virtual.rows.predict(unknowns)), "linear")
    return cost + float(((unknowns.values / virtual.prior) ** 2).sum())


def test_the_gradient_vanishes_at_the_answer_and_is_the_slope_elsewhere(at_the_answer):
    virtual, search = at_the_answer
    assert search.length(search.step(0.0)) < 1e-3
    aside = search.unknowns.at(search.unknowns.values + 1e-4 * virtual.prior)
    other = Search(virtual.rows, virtual.measured, aside, virtual.prior, "linear")
    for k in (0, 5, 20, 60, 99):
        step = np.zeros(len(virtual.prior))
        step[k] = 1e-6
        slope = (cost_at(virtual, other, step) - cost_at(virtual, other, -step)) / 2e-6
        assert slope == pytest.approx(2.0 * other.gradient[k], rel=1e-3, abs=1e-2)


def test_second_derivatives_make_the_hessian_exact_along_weakly_determined_combinations(at_the_answer):
    virtual, search = at_the_answer
    _, singular, right = np.linalg.svd(search.triangle)
    covariance = search.covariance(curved=True) / np.outer(virtual.prior, virtual.prior)
    hessian = np.linalg.inv(covariance)
    for axis in right[singular**2 < 50.0][::9]:
        curvature = (
            cost_at(virtual, search, 0.02 * axis) + cost_at(virtual, search, -0.02 * axis) - 2.0 * search.cost
        ) / (2.0 * 0.02**2)
        assert axis @ hessian @ axis == pytest.approx(curvature, rel=0.05, abs=0.05)


@pytest.mark.parametrize("sigma", [1e-5, 1e-9, 1e-12])
def test_covariance_is_valid_however_exact_the_data(drawing, sigma):
    virtual = Virtual(drawing, model_of(drawing, "centres"), 30, sigma=SIGMA)
    measured = virtual.measured.with_noise(NoiseLevel.stated(sigma, sigma))
    search = Search(virtual.rows, measured, virtual.unknowns, virtual.prior, "linear")
    share = np.linalg.eigvalsh(search.covariance() / np.outer(virtual.prior, virtual.prior))
    assert share.min() > -1e-12
    assert share.max() < 1.0 + 1e-6  # data cannot reduce what is known
    assert np.isfinite(search.step(0.0)).all()


def test_at_its_limit_a_search_near_the_answer_reports_its_distance_and_a_far_one_fails(at_the_answer):
    """One evaluation is spent before any step."""
    virtual, search = at_the_answer
    near, far = (
        Search(
            virtual.rows, virtual.measured, search.unknowns.at(share * search.unknowns.values), virtual.prior, "linear"
        )
        for share in (1.0, 0.0)
    )
    assert near.run(1e-9, 1) == near.length(near.step(0.0)) > 1e-9
    with pytest.raises(CalibrationError, match="does not converge in 1 evaluations"):
        far.run(1e-9, 1)


def test_too_few_rows(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 5)
    with pytest.raises(CalibrationError, match="only 5 of 5 rows"):
        Search(virtual.rows, virtual.measured, virtual.unknowns, virtual.prior, "huber")
