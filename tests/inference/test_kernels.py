"""Kernels: columns whose outer product is the kernel that defines them."""

import numpy as np
import pytest

from pouring_robot.inference.gaussian_processes.kernels import cycling, separate, smooth, standardised, wandering


def kernel(columns):
    return columns @ columns.T


def of_mean_one(matrix):
    return matrix / np.trace(matrix) * len(matrix)


def test_smooth_is_a_squared_exponential(rng):
    values = rng.normal(size=50)
    expected = np.exp(-0.5 * ((values[:, None] - values) / 0.7) ** 2)
    # Directions below a thousandth of the largest are left out: the trace of the rest is what is missing of 1.
    np.testing.assert_allclose(kernel(smooth(values, 0.7)), expected, atol=0.03)


def test_smooth_in_several_dimensions_has_a_length_for_each(rng):
    values = rng.normal(size=(50, 2))
    apart = (values[:, None] - values[None]) / np.array([1.0, 3.0])
    expected = np.exp(-0.5 * (apart**2).sum(axis=-1))
    np.testing.assert_allclose(kernel(smooth(values, [1.0, 3.0])), expected, atol=0.03)


def test_wandering_is_a_walk_without_its_mean(rng):
    """Against simulated random walks at the given places."""
    place = np.sort(rng.uniform(0.0, 5.0, size=30))
    steps = rng.normal(size=(20000, 30)) * np.sqrt(np.diff(place, prepend=place[0]))
    walks = np.cumsum(steps, axis=1)
    walks -= walks.mean(axis=1, keepdims=True)
    expected = of_mean_one(walks.T @ walks)
    np.testing.assert_allclose(kernel(wandering(place)), expected, atol=0.12)


def test_wandering_is_the_centred_minimum_of_two_times():
    place = np.array([0.0, 0.2, 0.2, 0.7, 1.0])
    centre = np.eye(5) - 1.0 / 5.0
    expected = of_mean_one(centre @ np.minimum(place[:, None], place) @ centre)
    np.testing.assert_allclose(kernel(wandering(3.0 + 60.0 * place)), expected, atol=1e-9)


def test_any_periodic_wave_is_covered_by_those_tried(rng):
    """For the wave farthest from all that are tried a hundredth of the square remains, and its period is found."""
    values = np.sort(rng.uniform(0.0, 60.0, 200))
    waves = cycling(values)
    assert {columns.shape for columns in waves.values()} == {(200, 4)}
    spread, left = np.ptp(values), {}
    for periods, columns in waves.items():
        wave = np.sin(2.0 * np.pi * values / (spread / 7.25) + 1.0)
        left[periods] = np.linalg.lstsq(columns, wave, rcond=None)[1].item() / (wave @ wave)
    least, most = min(left, key=left.get)
    assert least * (1.0 - 1e-9) <= spread / 7.25 <= most * (1.0 + 1e-9)
    assert min(left.values()) < 0.012


def test_too_few_rows_have_no_wave():
    assert not cycling(np.arange(8.0))
    assert not cycling(np.full(60, 3.0))
    assert len(cycling(np.arange(10.0))) == 1


def test_no_wave_is_tried_of_which_rows_cover_too_little_of_a_period():
    """One hour on each of four days: any wave could explain what differs between the days."""
    hours = np.concatenate([24.0 * day + np.linspace(0.0, 1.0, 30) for day in range(4)])
    assert all(most <= 4.0 for _, most in cycling(hours))
    spread_out = np.concatenate([24.0 * day + np.linspace(0.0, 9.0, 30) for day in range(4)])
    assert any(least < 24.0 < most for least, most in cycling(spread_out))  # nine hours cover enough of a day


def test_expected_square_is_one(rng):
    values = rng.normal(size=60)
    for columns in (
        *cycling(values).values(),
        smooth(values, 0.3),
        smooth(values, 5.0),
        smooth(values, 0.1, most=7),
        wandering(values),
        separate(np.arange(60) // 7),
    ):
        assert (columns**2).sum() / 60 == pytest.approx(1.0)


def test_no_more_columns_than_asked_for_and_the_most_probable_first(rng):
    values = rng.normal(size=60)
    columns = smooth(values, 0.05, most=9)
    assert columns.shape == (60, 9)
    sizes = (columns**2).sum(axis=0)
    assert np.all(np.diff(sizes) <= 1e-12)


def test_a_condition_that_never_changes_gives_no_drift(rng):
    assert (wandering(np.full(20, 4.0)) ** 2).sum() == 0.0
    np.testing.assert_array_equal(standardised(np.full(20, 4.0)), np.zeros(20))
    columns = smooth(np.full(20, 4.0), 1.0)
    np.testing.assert_allclose(kernel(columns), np.ones((20, 20)), atol=1e-12)


def test_standardised_columns(rng):
    values = standardised(np.column_stack([rng.normal(3.0, 7.0, size=40), np.ones(40)]))
    assert values.mean(axis=0) == pytest.approx(0.0, abs=1e-14)
    assert values.std(axis=0) == pytest.approx([1.0, 0.0])


def test_separate_labels():
    np.testing.assert_array_equal(separate(np.array([7, 3, 7])), [[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    rows = separate(np.array([[1, 2], [2, 1], [1, 2], [1, 1]]))
    assert rows.shape == (4, 3)
    np.testing.assert_array_equal(kernel(rows), [[1, 0, 1, 0], [0, 1, 0, 0], [1, 0, 1, 0], [0, 0, 0, 1]])
