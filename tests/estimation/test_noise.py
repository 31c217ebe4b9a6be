"""Noise: stated, from repeats, or from the residuals of a fit."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest, kstest

from pouring_robot.calibration.findings import Movement
from pouring_robot.estimation import map_fit
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.map_fit import identify, settled_noise
from pouring_robot.estimation.noise import (
    LEAST_NOISE,
    Noise,
    NoiseLevel,
    noise_beforehand,
    noise_ratio,
    p_value,
    repeat_noise,
    repeats,
)
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.exceptions import BadInputError
from tests.campaign.simulated import SIGMA_M, SIGMA_RAD, damaged
from tests.estimation.virtual import SIGMA, Virtual, model_of


def test_repeats_are_rows_with_the_same_command_from_the_same_side(repeated):
    groups = repeats(repeated, np.arange(len(repeated)))
    assert [len(group) for group in groups] == [6, 6, 6, 6]
    assert groups[1].tolist() == list(range(20, 26))
    turned = damaged(repeated, approach=lambda a: a.__setitem__((20, 1), -1.0))
    assert [len(group) for group in repeats(turned, np.arange(len(turned)))] == [6, 5, 6, 6]
    other = damaged(repeated, sessions=("2", *repeated.sessions[1:]))
    assert [len(group) for group in repeats(other, np.arange(len(other)))] == [5, 6, 6, 6]


def test_rows_under_different_conditions_are_no_repeats(repeated):
    """A load's effect on a pose is no noise; an empty cell is no known load."""
    loaded = np.where(np.arange(len(repeated)) == 20, 400.0, 0.0)
    loaded[21] = np.nan
    campaign = dataclasses.replace(repeated, conditions={**repeated.conditions, "payload": loaded})
    assert [len(group) for group in repeats(campaign, np.arange(len(campaign)))] == [6, 4, 6, 6]


def test_weighed_loads_are_equal_within_a_hundredth(repeated):
    weighed = 400.0 + np.random.default_rng(7).uniform(-1.0, 1.0, len(repeated))
    campaign = dataclasses.replace(repeated, conditions={**repeated.conditions, "payload": weighed})
    assert [len(group) for group in repeats(campaign, np.arange(len(campaign)))] == [6, 6, 6, 6]


@pytest.mark.parametrize("load", [400.0, 402.5, 492.5])
def test_whether_loads_are_equal_does_not_depend_on_a_grid(repeated, load):
    """They differ by a quarter of a hundredth, also about half-way between multiples of a hundredth of the largest."""
    weighed = np.where(np.arange(len(repeated)) % 2, load - 0.6, load + 0.6)
    weighed[np.concatenate(repeats(repeated, np.arange(len(repeated))))[-1]] = 500.0
    campaign = dataclasses.replace(repeated, conditions={**repeated.conditions, "payload": weighed})
    assert [len(group) for group in repeats(campaign, np.arange(len(campaign)))] == [6, 6, 6, 5]


def test_noise_from_repeats(repeated):
    noise = noise_beforehand(repeated, np.arange(len(repeated)))
    assert noise["position"].source == noise["rotation"].source == "repeats"
    # Twenty differences of three coordinates: 1 / sqrt(2 * 60) is nine per cent.
    assert noise.position_m == pytest.approx(SIGMA_M, rel=0.3)
    assert noise.rotation_rad == pytest.approx(SIGMA_RAD, rel=0.3)
    assert not noise.from_residuals
    assert noise["position"].dof == noise["rotation"].dof == noise.dof == 60


def test_repeat_noise_by_hand():
    position = np.zeros((13, 3))
    position[:, 0] = np.tile([1.0, -1.0], 7)[:13]
    measured = MeasuredPoses(position, np.full((13, 3, 3), np.nan), 1.0, 1.0)
    found, turned = repeat_noise(measured, [np.arange(13)])
    expected = np.sqrt(((position[:, 0] - position[:, 0].mean()) ** 2).sum() / 36)
    assert (found.sigma, found.dof) == (pytest.approx(expected), 36)
    assert turned is None
    assert repeat_noise(measured, [np.arange(4)]) == (None, None)  # nine differences are too few


@pytest.mark.parametrize("noise_dof", [12.0, 60.0, np.inf])
def test_p_values_are_uniform_under_the_null(noise_dof):
    random, known = np.random.default_rng(3), np.isfinite(noise_dof)
    variance = random.chisquare(noise_dof if known else 1.0, 4000) / noise_dof if known else np.ones(4000)
    chances = [p_value(squares, 150.0, noise_dof) for squares in random.chisquare(150, 4000) / variance]
    assert kstest(chances, "uniform").pvalue > 1e-3


def test_repeats_are_excluded_from_the_misfit_that_their_noise_judges():
    """Every second row is a repeat, which shows nothing of a gap half as large as the noise."""
    random, chances, found = np.random.default_rng(6), [], []
    for _ in range(4000):
        pure, beyond = random.chisquare(60.0), random.chisquare(60.0)
        noise = NoiseLevel({"position": Noise(1.0, "repeats", 60.0)})
        chances.append(noise.lack_of_fit_p((pure + beyond) / (pure / 60.0), 120.0))
        found.append(noise.lack_of_fit_p((pure + 1.5 * beyond) / (pure / 60.0), 120.0) < 0.01)
    assert kstest(chances, "uniform").pvalue > 1e-3
    assert np.mean(found) > 0.15  # 0.03 if repeats counted on both sides


def test_repeats_are_weighted_by_the_share_of_squares_that_a_robust_loss_keeps():
    """Nine of ten equations are repeats, and 3 % of every square are not counted."""
    random, chances = np.random.default_rng(8), []
    for _ in range(4000):
        pure, beyond = random.chisquare(540.0), random.chisquare(60.0)
        noise = NoiseLevel({"position": Noise(1.0, "repeats", 540.0)})
        chances.append(noise.lack_of_fit_p(0.97 * (pure + beyond) / (pure / 540.0), 0.97 * 600.0, 0.97))
    assert kstest(chances, "uniform").statistic < 0.05  # 0.3 if the repeats were subtracted whole
    assert NoiseLevel({"position": Noise(1.0, "repeats", 540.0)}).lack_of_fit_p(2e3, 540.0 + 1e-13) == 1.0


def test_residuals_estimate_the_noise_unless_the_lack_of_fit_test_rejects():
    """With sound campaigns: repeats with 12 degrees of freedom among 150 equations, chi-square both."""
    random, told, left = np.random.default_rng(5), [], []
    for _ in range(4000):
        pure, lack = random.chisquare(12.0), random.chisquare(138.0)
        few = NoiseLevel({"position": Noise(float(np.sqrt(pure / 12.0)), "repeats", 12.0)})
        rest = NoiseLevel({"position": Noise(float(np.sqrt((pure + lack) / 150.0)))})
        found = few.pooled_with(rest, {"position": 150.0}, 0.05)["position"]
        told.append(found.dof == 150.0)
        left.append(found.sigma if told[-1] else 1.0)
    assert binomtest(sum(told), len(told), 0.95).pvalue > 1e-3
    assert np.std(left) == pytest.approx(1.0 / np.sqrt(2.0 * 150.0), rel=0.1)


@pytest.mark.parametrize("readings", [5, 9])
def test_intervals_have_their_coverage_where_readings_of_one_pose_give_the_noise(readings):
    random, held = np.random.default_rng(4), []
    for _ in range(4000):
        seen = MeasuredPoses(random.normal(size=(readings, 3)), np.full((readings, 3, 3), np.nan), 1.0, 1.0)
        noise = repeat_noise(seen, [np.arange(readings)])[0]
        held.append(not Movement("x", "mm", 0.2 * random.normal(), 0.2 * noise.sigma, 1.0, dof=noise.dof).moved)
    assert binomtest(sum(held), len(held), 0.95).pvalue > 1e-3  # with normal quantiles 92.7 and 94.1 %


def test_exact_repeats_give_no_noise():
    rounded = np.random.default_rng(1).normal(size=(13, 3)) * 0.5 * LEAST_NOISE
    measured = MeasuredPoses(1.0 + rounded, Rotation.from_rotvec(rounded).as_matrix(), 1.0, 1.0)
    assert repeat_noise(measured, [np.arange(13)]) == (None, None)


def test_a_stated_noise_comes_first_and_residuals_last(clean, positions):
    stated = noise_beforehand(clean.campaign, np.arange(60))
    assert (stated.position_m, stated["position"].source) == (SIGMA_M, "stated")
    assert stated.dof == np.inf
    metadata = clean.campaign.metadata.model_copy(update={"sigma_position_m": None, "sigma_rotation_rad": None})
    blank = dataclasses.replace(clean.campaign, metadata=metadata)
    assert noise_beforehand(blank, np.arange(60)).from_residuals
    assert noise_beforehand(positions.campaign, np.arange(60))["rotation"].source == "none"


def test_exact_data_leave_the_least_noise_and_that_is_reported(drawing, clean, monkeypatch):
    """Twelve refits that each find less noise would be eleven too many."""
    virtual = Virtual(drawing, model_of(drawing, "drives"), 60)
    seen = virtual.rows.predict(virtual.unknowns)
    exact = MeasuredPoses(seen.position_m, seen.rotation, 1.0, 1.0)
    open_noise = NoiseLevel({"position": Noise(source="residuals"), "rotation": Noise(source="residuals")})
    start = first_frames(virtual.rows, virtual.measured)
    fits = []
    monkeypatch.setattr(map_fit, "identify", lambda *given: fits.append(identify(*given)) or fits[-1])
    noise = settled_noise(virtual.rows, exact, start, virtual.prior, open_noise)
    assert noise.position_m == noise.rotation_rad == LEAST_NOISE
    assert sum(fit.evaluations for fit in fits) <= 12
    (doubt,) = noise.doubts
    assert "0.001 mm or mrad stands for it" in doubt
    assert "(sigma_position_mm, sigma_rotation_mrad in the YAML)" in doubt
    assert NoiseLevel.stated(LEAST_NOISE, LEAST_NOISE).doubts == []


@pytest.mark.parametrize("size", ["0.05 mm", "5e-5", -1e-5, 0.0, 1.1, float("nan"), [1e-5]])
def test_a_noise_is_stated_as_a_size_in_m_and_rad(size):
    with pytest.raises(BadInputError, match=r"^the noise of a position must be above 0 and at most 1 m, not "):
        NoiseLevel.stated(size, None)
    with pytest.raises(BadInputError, match=r"^the noise of a rotation must be above 0 and at most 1 rad, not "):
        NoiseLevel.stated(1e-5, size)


def test_noise_from_residuals_is_the_true_one(drawing, clean):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 60)
    metadata = clean.campaign.metadata.model_copy(update={"sigma_position_m": None, "sigma_rotation_rad": None})
    unknown = noise_beforehand(dataclasses.replace(clean.campaign, metadata=metadata), np.arange(60))
    start = first_frames(virtual.rows, virtual.measured)
    noise = settled_noise(virtual.rows, virtual.measured, start, virtual.prior, unknown)
    fit = identify(virtual.rows, virtual.measured.with_noise(noise), start, virtual.prior)
    assert noise.position_m == pytest.approx(SIGMA, rel=0.15)
    assert noise.rotation_rad == pytest.approx(SIGMA, rel=0.15)
    assert fit.chi_square() / fit.dof() == pytest.approx(1.0, abs=0.05)


def test_too_few_degrees_of_freedom_give_no_noise_and_rounding_is_none():
    """Nine tenths of an equation; and equations that unknowns fit exactly up to round-off, of either sign."""
    assert noise_ratio(np.full(3, 5.0), np.full(3, 0.3)) == 1.0
    assert noise_ratio(np.full(3, 5.0), np.full(3, 0.4)) == pytest.approx(np.sqrt(75.0 / 1.2))
    for left in (1e-16, -1e-16):
        assert noise_ratio(np.full(3, 1e-12), np.array([left, 0.0, 0.0]), fewest=0.0) < 1e-6


@pytest.mark.parametrize(("share", "count", "said"), [(0.45, 300, True), (0.55, 300, False), (0.45, 1, False)])
def test_a_stated_noise_more_than_twice_too_large_is_reported(share, count, said):
    """With three values chance leaves as little in one of ten campaigns."""
    component = np.repeat([0, 1, 2, 3, 4, 5], count)
    residual = np.full(len(component), share)
    stated = NoiseLevel.stated(1e-4, 2e-4)
    lines = stated.too_large(component, residual, np.ones(len(residual)))
    assert len(lines) == (2 if said else 0)
    if said:
        assert "stated for each coordinate is 2.2 times the residuals, 0.045 mm" in lines[0]
        assert "stated for each rotation is 2.2 times the residuals, 0.09 mrad" in lines[1]
    left_over = NoiseLevel({"position": Noise(1e-4, "residuals"), "rotation": Noise(2e-4, "repeats", 60.0)})
    assert not left_over.too_large(component, residual, np.ones(len(residual)))
