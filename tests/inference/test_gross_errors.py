"""Which rows are gross errors: few, or scattered ones."""

import numpy as np
import pytest
from scipy.stats import binom

from pouring_robot.inference.gross_errors import HALF, RowResiduals, _together, gross_error_in_few_rows, gross_errors
from pouring_robot.inference.search import search
from pouring_robot.inference.thresholds import DEFAULT_THRESHOLDS
from tests.inference.problems import library, planted, problem

COUNT, COMPONENTS, OFF = 120, 6, 20.0


def of_all(left):
    """Return the residuals of all rows in one fit."""
    return [RowResiduals(left.ravel(), np.repeat(np.arange(COUNT), COMPONENTS), np.ones(COUNT, dtype=bool))]


def found(wrong, places, rng, *, gone=0, noise=1.0, off=OFF):
    """Return the rows that are left out, given rows of noise of which some are off."""
    left = noise * rng.normal(size=(COUNT, COMPONENTS))
    left[wrong, 0] = off
    return gross_errors([of_all(left)], gone, places).tolist()


@pytest.fixture
def places(rng):
    """Return random poses, and the order of the rows."""
    return rng.uniform(size=(COUNT, 3)), np.arange(COUNT, dtype=float)[:, None]


def test_up_to_a_tenth_of_scattered_rows_are_left_out(rng, places):
    scattered = np.arange(5, COUNT, 11)  # 11 rows
    assert found(scattered, places, rng) == scattered.tolist()
    assert found(np.arange(5, COUNT, 8), places, rng) == [], "more than a tenth"
    assert found(scattered, places, rng, gone=2) == [], "with those that are left out already"


@pytest.mark.parametrize(
    ("noise", "off", "wrong"), [(0.2, 6.0, []), (0.2, 7.0, [7]), (3.0, 15.0, []), (3.0, 30.0, [7])]
)
def test_rows_are_judged_by_the_noise_or_the_90_percent_quantile_where_that_is_larger(places, rng, noise, off, wrong):
    """Other residuals may be smaller than the noise, as in few rows, or larger, as with something unknown."""
    assert found([7], places, rng, noise=noise, off=off) == wrong


def test_an_unknown_error_of_the_held_out_region_does_not_accuse_fitted_rows(rng, places):
    """A fit of all rows follows it and leaves a larger residual in a fitted row than a fit of the others does."""
    held_out, rows = np.arange(COUNT) >= 90, np.repeat(np.arange(COUNT), COMPONENTS)
    fit_of_all, alone = rng.normal(size=(2, COUNT, COMPONENTS))
    fit_of_all[held_out] *= 8.0
    fit_of_all[7, 1], alone[7, 1] = 5.0 * OFF, 0.2 * OFF  # the one that counts is that of the fit without held-out rows
    fit_of_all[100, 2] = 2.0 * OFF
    fitted = rows < 90
    seen = [
        RowResiduals(alone.ravel()[fitted], rows[fitted], ~held_out),
        RowResiduals(fit_of_all.ravel(), rows, held_out),
    ]
    assert gross_errors([seen], 0, places).tolist() == []
    fit_of_all[held_out] /= 8.0
    fit_of_all[100, 2] = 2.0 * OFF
    assert gross_errors([seen], 0, places).tolist() == [100]
    seen[0].left[7 * COMPONENTS + 1] = OFF
    assert gross_errors([seen], 0, places).tolist() == [7, 100]


def test_neighbouring_rows_are_no_gross_errors_unless_they_are_few(rng, places):
    poses, order = places
    near = np.sort(np.argsort(np.linalg.norm(poses - poses[0], axis=1))[:9])
    for together in (near, np.arange(40, 49)):
        assert found(together, (poses, order), rng) == []
        assert found(together[:4], (poses, order), rng) == together[:4].tolist()


def test_a_few_hidden_in_the_tails_of_causes_not_found_stand_out_of_the_better_half(places):
    """In a fifth of the rows causes do much more."""
    left = np.tile([3.0, -3.0], (COUNT, COMPONENTS // 2))
    left[::5] *= 3.5
    left[[7, 61], 1] = 21.0
    assert gross_errors([of_all(left)], 0, places).size == 0
    assert gross_errors([of_all(left)], 0, places, HALF).tolist() == [7, 61]


def test_the_probability_that_rows_lie_together_by_chance_is_binomial():
    """The gaps grow, so each row's nearest neighbour is the one before it."""
    growing, wrong = 1.1 ** np.arange(50)[:, None], np.array([3, 4, 20, 31])
    assert _together(wrong, growing) == pytest.approx(binom.sf(0, 4, 3 / 49), rel=1e-12)
    assert _together(np.array([3, 20, 31]), growing) == 1.0


@pytest.mark.parametrize("which", [0, 1])
def test_the_nearest_neighbour_of_a_row_is_another_row_where_poses_are_repeated(which):
    """Each pose is read twice and one reading is wrong: its nearest neighbour is the other one, which is right."""
    repeated = np.repeat(np.arange(20.0), 2)[:, None]
    assert _together(np.arange(which, 40, 2), repeated) == 1.0


def test_a_row_that_pulls_the_fit_is_looked_for_where_none_stands_out(rng, places):
    """Rows that lie together in one set of residuals must not hide a single row in the other."""
    left, deleted = rng.normal(size=(2, COUNT, COMPONENTS))
    deleted[40:49, 2] += OFF

    def found():
        return gross_errors((of_all(left), of_all(deleted)), 0, places).tolist()

    assert found() == []
    left[7, 0] += OFF
    assert found() == [7]
    left[7, 0], deleted[40:49, 2] = 0.0, 0.0
    deleted[30, 1] = -OFF
    assert found() == [30]


FEW_ROWS, FEW_COMPONENTS = 9, 3


@pytest.mark.parametrize("wrong", [(), (4,), (2, 7), (1, 4, 7)])
@pytest.mark.parametrize("at_work", [False, True])
def test_in_few_rows_a_wrong_one_that_effects_absorb_is_found_with_or_without_a_cause(rng, wrong, at_work):
    """Eight effects of up to four parameters fit nearly anything in nine rows; of several wrong rows none is named."""
    rows = np.repeat(np.arange(FEW_ROWS), FEW_COMPONENTS)
    items = library(rng, rows.size)
    residual = planted(rng, [items[2]], [8.0]) if at_work else rng.normal(size=rows.size)
    for row in wrong:
        residual[rows == row] += 150.0 * np.array([0.6, -0.64, 0.48])
    asked = problem(residual, items, free=rng.normal(size=(rows.size, 6)))
    if len(wrong) == 1:
        assert {item.effect for item in search(asked).items} - {items[2].effect}, "something else is found for it"
    found = gross_error_in_few_rows(asked, rows, DEFAULT_THRESHOLDS)
    assert found.tolist() == (list(wrong) if len(wrong) == 1 else [])
