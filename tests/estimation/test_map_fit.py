"""Identification: the truth is found, gross errors do not matter, failures are reported, and it is fast."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from pouring_robot.campaign.data import Campaign
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.levenberg_marquardt import Search
from pouring_robot.estimation.map_fit import FitOptions, campaign_and_model, identify
from pouring_robot.estimation.measurement import Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses, whiten
from pouring_robot.estimation.robust import robust_terms, typical_size
from pouring_robot.exceptions import BadInputError, CalibrationError
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.model import RobotModel
from tests.estimation.virtual import SIGMA, TRUE_FRAMES, Virtual, model_of
from tests.examples.campaigns import write
from tests.examples.machines import MACHINES
from tests.support import ROOT


def fitted(virtual, options=None, measured=None):
    measured = measured or virtual.measured
    start = first_frames(virtual.rows, measured)
    return identify(virtual.rows, measured, start, virtual.prior, options)


def test_drive_offsets_are_found_within_their_intervals(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 60)
    fit = fitted(virtual)
    assert fit.converged
    error = (fit.unknowns.parameters - virtual.truth) / fit.std[FRAMES:]
    assert np.abs(error).max() < 4.0
    assert fit.learnt[FRAMES:].min() > 0.999
    assert fit.chi_square() / fit.dof() == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("wanted", ["geometry", "dh"])
def test_residuals_are_as_small_as_the_noise(drawing, wanted):
    virtual = Virtual(drawing, model_of(drawing, wanted), 120, seed=3)
    fit = fitted(virtual)
    assert fit.chi_square() / fit.dof() == pytest.approx(1.0, abs=0.2)
    assert virtual.rows.predict(fit.unknowns).closed.all()


def test_exact_data_give_exact_predictions(drawing):
    virtual = Virtual(drawing, model_of(drawing, "centres"), 60, sigma=1e-9)
    fit = fitted(virtual)
    difference = virtual.measured.residual(virtual.rows.predict(fit.unknowns))
    assert np.abs(difference).max() < 2e-8


def test_positions_alone_suffice(drawing):
    virtual = Virtual(drawing, model_of(drawing, "centres"), 80)
    blind = MeasuredPoses(virtual.measured.position_m, np.full((80, 3, 3), np.nan), SIGMA, 1.0)
    fit = fitted(virtual, measured=blind)
    assert fit.chi_square() / fit.dof() == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("loss", ["huber", "soft_l1"])
def test_outliers_move_a_robust_fit_no_further_than_their_influence(drawing, loss):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 80)
    position = virtual.measured.position_m.copy()
    position[::16] += 0.02
    spoilt = MeasuredPoses(position, virtual.measured.rotation, SIGMA, SIGMA)
    sound = fitted(virtual)
    robust, plain = (fitted(virtual, FitOptions(loss=name), spoilt) for name in (loss, "linear"))
    shift, plain_shift = (np.abs(fit.unknowns.parameters - sound.unknowns.parameters) for fit in (robust, plain))
    # A block's pull is bounded by what 99 % of sound blocks keep; in the sound fit it was given by its own residual.
    equations = sound.equations
    furthest = np.zeros_like(shift)
    for row in range(0, 80, 16):
        block = (equations.rows == row) & (equations.components < 3)
        pull = np.sqrt(scipy.stats.chi2.ppf(0.99, 3)) * typical_size(robust.equations)
        pull += np.linalg.norm(equations.residual[block])
        furthest += pull * np.linalg.norm((sound.covariance @ equations.jacobian[block].T)[FRAMES:], axis=1)
    assert (shift < 1.1 * furthest).all()  # to first order; a tenth for the rest
    assert (shift < 2.0 * sound.std[FRAMES:]).all()
    assert (plain_shift > 10.0 * furthest).all()
    # Five outliers of 400 times the noise in 480 equations: they count with their bounds, about a hundredth each.
    assert robust.noise_ratio() == pytest.approx(1.0, abs=0.12)
    assert plain.noise_ratio() > 20.0


def test_losses_agree_on_small_residuals(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 20)
    equations = whiten(virtual.measured, virtual.rows.predict(virtual.unknowns))
    linear, weights = robust_terms(equations, "linear")
    assert linear == pytest.approx(float((equations.residual**2).sum()))
    assert (weights == 1.0).all()
    for loss in ("huber", "soft_l1"):
        cost, weights = robust_terms(equations, loss)
        assert 0.7 * linear < cost <= linear
        assert weights.max() <= 1.0
    assert typical_size(equations) < 1.5
    with pytest.raises(BadInputError, match="there is no loss"):
        robust_terms(equations, "cauchy")


def test_covariance_is_the_scatter_of_repeated_fits(drawing):
    model = model_of(drawing, "drives")
    virtual = Virtual(drawing, model, 40)
    seen = virtual.rows.predict(virtual.unknowns)
    found = []
    for seed in range(60):
        noise = np.random.default_rng(seed).normal(size=(40, 3)) * SIGMA
        measured = MeasuredPoses(seen.position_m + noise, np.full((40, 3, 3), np.nan), SIGMA, 1.0)
        start = Unknowns.zero(TRUE_FRAMES, 4)
        fit = identify(virtual.rows, measured, start, virtual.prior)
        found.append(fit.unknowns.parameters)
    ratio = np.std(found, axis=0) / fit.std[FRAMES:]
    assert ((ratio > 0.7) & (ratio < 1.35)).all()


def test_too_few_rows_and_wrong_priors_are_refused(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 8)
    start = Unknowns.zero(TRUE_FRAMES, 4)
    with pytest.raises(CalibrationError, match="only 4 of 4 rows"):
        identify(virtual.rows[np.arange(4)], virtual.measured[np.arange(4)], start, virtual.prior)
    for prior in (virtual.prior[1:], np.zeros(16), np.full(16, np.nan)):
        with pytest.raises(BadInputError, match="positive standard deviations"):
            identify(virtual.rows, virtual.measured, start, prior)


def test_rows_that_do_not_close_are_left_out_and_named(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 30)
    drives = virtual.rows.drives.copy()
    drives[[3, 9], 0] = 4.0
    rows = virtual.model.at(drives)
    start = first_frames(rows, virtual.measured)
    fit = identify(rows, virtual.measured, start, virtual.prior)
    assert fit.equations.failed.tolist() == [3, 9]
    assert fit.chi_square() / fit.dof() == pytest.approx(1.0, abs=0.4)


def test_a_search_that_is_cut_short_gives_no_answer(drawing):
    virtual = Virtual(drawing, model_of(drawing, "geometry"), 60)
    with pytest.raises(CalibrationError, match="does not converge in 2 evaluations"):
        fitted(virtual, FitOptions(max_evaluations=2))


def test_a_search_with_a_far_too_small_noise_reports_it(drawing):
    virtual = Virtual(drawing, model_of(drawing, "geometry"), 60)
    sharp = replace(virtual.measured, sigma_position_m=1e-9, sigma_rotation_rad=1e-9)
    start = first_frames(virtual.rows, virtual.measured)
    with pytest.raises(CalibrationError, match="times the noise: state a noise that the model can reach"):
        identify(virtual.rows, sharp, start, virtual.prior, FitOptions(max_evaluations=2))


@pytest.mark.parametrize(("count", "wanted", "most"), [(40, "geometry", 57), (300, "all", 100)])
def test_few_evaluations_suffice(drawing, count, wanted, most):
    for seed in range(3):
        virtual = Virtual(drawing, model_of(drawing, wanted, most=most), count, seed=seed)
        assert len(virtual.truth) == most
        assert fitted(virtual).evaluations <= 30


def test_the_search_converges_in_a_curved_valley(drawing):
    """Errors of three tolerances, few poses: products of errors, which Gauss-Newton neglects, matter."""
    virtual = Virtual(drawing, model_of(drawing, "geometry"), 30, seed=2, scale=3.0)
    fit = fitted(virtual, FitOptions(max_evaluations=100))
    assert fit.converged
    # No neighbour along any unknown is more probable.
    search = Search(virtual.rows, virtual.measured, fit.unknowns, virtual.prior, "huber")
    least = search.cost
    for k in range(FRAMES, len(fit.unknowns.values), 9):
        for sign in (-0.5, 0.5):
            step = np.zeros_like(fit.std)
            step[k] = sign * fit.std[k] / virtual.prior[k]
            assert not search.try_step(step) or least - search.cost < 0.01


def test_a_campaign_is_compared_with_the_drawing_of_its_own_robot(tmp_path):
    """A table names its robot; only the other robot's file defines it."""
    write(tmp_path, MACHINES["arm"], 1)
    arm = RobotDefinition.load(ROOT / "examples" / "robots" / "arm" / "robot.yaml")
    campaign, model = campaign_and_model(Campaign.read(tmp_path / "campaign.csv", arm), None)
    assert campaign.robot.name == model.definition.name == "arm"
    with pytest.raises(BadInputError, match="the campaign is one of arm, the model one of pouring_robot"):
        campaign_and_model(campaign, RobotModel())
    with pytest.raises(BadInputError, match="--robot"):
        campaign_and_model(tmp_path / "campaign.csv", None)
