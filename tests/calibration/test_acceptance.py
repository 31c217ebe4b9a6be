"""The verdict of held-out rows: what they refuse, and what they accept as chance."""

import numpy as np
import pytest
from scipy.special import ndtr

from pouring_robot.calibration.selection import acceptable, chance_margin, harmless, mean_and_error, row_scores

SIGMA = np.array([2.0, 2.0, 2.0, 0.5, 0.5, 0.5])


def scores(position, rotation):
    return np.column_stack([position, rotation])


def test_scores_are_mean_squares_over_the_noise():
    residual = np.array([[2.0, 4.0, 6.0, 0.5, 0.0, 1.0], [2.0, np.nan, np.nan, np.nan, np.nan, np.nan]])
    found = row_scores(residual, SIGMA)
    np.testing.assert_allclose(found, [[14.0 / 3.0, 5.0 / 3.0, np.nan, np.nan], [1.0, np.nan, np.nan, np.nan]])
    assert mean_and_error(np.array([1.0, 3.0, np.nan])) == pytest.approx((2.0, 1.0))
    assert mean_and_error(np.array([3.0])) == (3.0, np.inf)
    assert mean_and_error(np.full(3, np.nan)) == (0.0, 0.0)


@pytest.mark.parametrize("rows", [2, 3, 12])
def test_with_few_rows_no_more_is_refused_by_chance(rows):
    """A normal variable exceeds two standard deviations in 2.3 %; with three rows it was 12 %."""
    found = np.random.default_rng(rows).normal(size=(4000, rows))
    beyond = np.mean([mean_and_error(row)[0] > chance_margin(row, 2.0) for row in found])
    assert beyond == pytest.approx(ndtr(-2.0), abs=4.0 * np.sqrt(ndtr(-2.0) / 4000))
    assert chance_margin(np.array([3.0]), 2.0) == np.inf
    assert chance_margin(np.full(3, np.nan), 2.0) == 0.0


def test_a_row_that_the_calibrated_robot_cannot_take_is_worse():
    before, after = scores(np.full(20, 9.0), np.full(20, 4.0)), scores(np.full(20, 1.0), np.full(20, 1.0))
    after[3] = np.nan
    assert not acceptable(before, after)
    assert acceptable(np.where(np.isnan(after), np.nan, before), after)


def test_better_passes_and_worse_does_not():
    before, after = scores(np.full(20, 9.0), np.full(20, 4.0)), scores(np.full(20, 1.0), np.full(20, 1.0))
    assert acceptable(before, after)
    assert acceptable(before, before)
    assert not acceptable(after, before)


def test_a_gain_of_one_kind_does_not_outweigh_a_loss_of_the_other():
    rng = np.random.default_rng(1)
    before = scores(9.0 + rng.normal(size=40), 1.0 + 0.1 * rng.normal(size=40))
    spoilt = before + np.column_stack([np.full(40, -6.0), 0.5 + 0.1 * rng.normal(size=40)])
    assert not acceptable(before, spoilt)
    assert not acceptable(before[:, ::-1], spoilt[:, ::-1])


def test_chance_does_not_count():
    # Rotations scatter by 1 from row to row and rise by 0.1 on average, with a standard error of 0.16.
    change = np.tile([1.1, -0.9], 20)
    before = scores(np.full(40, 9.0), np.full(40, 2.0))
    after = before + np.column_stack([np.full(40, -6.0), change])
    assert acceptable(before, after)
    # The same without any gain in positions is worse as a whole.
    assert not acceptable(before, before + np.column_stack([np.zeros(40), change]))


def test_positions_alone():
    before = scores(np.full(20, 9.0), np.full(20, np.nan))
    assert acceptable(before, before - 3.0)
    assert not acceptable(before, before + 3.0)


def test_a_negligible_loss_does_no_harm_however_consistent():
    # A delta's zeros hardly change its rotations: by 1e-4 of the noise's variance in every row.
    before = scores(np.full(40, 9.0), np.full(40, 1.0))
    even = np.column_stack([np.full(40, -8.0), np.full(40, 1e-4)])
    assert harmless(before, before + even, 1.0)
    assert acceptable(before, before + even)
    assert not harmless(before, before + 1e3 * even, 1.0)
