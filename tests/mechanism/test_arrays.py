"""Even choices of many rows."""

import numpy as np
import pytest

from pouring_robot.mechanism.arrays import evenly


@pytest.mark.parametrize("count", [0, 1, 2, 7, 100, 101, 12345])
@pytest.mark.parametrize("most", [1, 2, 7, 100])
def test_all_or_as_many_as_asked_evenly_spread(count, most):
    chosen = evenly(count, most)
    assert len(chosen) == min(count, most)
    if count <= most:
        np.testing.assert_array_equal(chosen, np.arange(count))
    elif most > 1:
        assert chosen[0] == 0 and chosen[-1] == count - 1
        assert np.ptp(np.diff(chosen)) <= 1
