"""Evenly spaced choices from many rows, and numbers that a user gives."""

import numpy as np
import pandas as pd
import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import evenly_spaced, finite


@pytest.mark.parametrize("count", [0, 1, 2, 7, 100, 101, 12345])
@pytest.mark.parametrize("most", [1, 2, 7, 100])
def test_all_or_as_many_as_asked_for_evenly_spread(count, most):
    chosen = evenly_spaced(count, most)
    assert len(chosen) == min(count, most)
    if count <= most:
        np.testing.assert_array_equal(chosen, np.arange(count))
    elif most > 1:
        assert chosen[0] == 0 and chosen[-1] == count - 1
        assert np.ptp(np.diff(chosen)) <= 1


def test_numbers_are_copied_and_an_empty_list_is_no_rows():
    given = np.ones((2, 3))
    taken = finite(given, (None, 3), "three numbers")
    given[:] = 0.0
    assert (taken == 1.0).all()
    assert finite([], (None, 3), "three numbers").shape == (0, 3)


@pytest.mark.parametrize(
    "values",
    [
        pd.DataFrame({"x_mm": [1.0], "y_mm": [2.0], "z_mm": [3.0]}),
        np.ma.array([[1.0, 2.0, 3.0]], mask=[[0, 1, 0]]),
        np.empty((0, 2)),
        np.array([[1.0, 2.0, 3.0 + 1.0j]]),
        [[np.complex128(1.0)] * 3],
        np.array([[np.complex128(1.0)] * 3], dtype=object),
        np.array([["2026-01-01"] * 3], dtype="M8[s]"),
        np.zeros((1, 3), dtype=[("x_mm", float)]),
        [[object()] * 3],
    ],
)
def test_values_that_are_more_than_numbers_are_not_accepted_silently(values):
    with pytest.raises(BadInputError, match="three numbers"):
        finite(values, (None, 3), "three numbers")
