"""What a user gives from Python."""

import numpy as np
import pytest

from pouring_robot import BadInputError, DiagnosisOptions
from pouring_robot.io.given import whole


@pytest.mark.parametrize("value", [2, np.int64(2), np.uint8(2)])
def test_whole_numbers_are_those_of_numpy_too(value):
    assert type(whole(value, 0, "a count is whole")) is int


@pytest.mark.parametrize("value", [-1, 4, 2.0, True, np.True_, np.float64(2.0), "2", None])
def test_others_are_no_whole_numbers_between_bounds(value):
    with pytest.raises(BadInputError, match="a count is whole, not "):
        whole(value, 0, "a count is whole", 3)


def test_options_of_a_diagnosis_take_numbers_of_numpy():
    options = DiagnosisOptions(false_names=np.float32(0.5), next_count=np.int64(3))
    assert type(options.false_names) is float
    for wrong in ({"false_names": 1.0}, {"false_names": "0.05"}, {"false_names": np.nan}, {"next_count": True}):
        with pytest.raises(BadInputError, match=r"a share between 0 and 1|a whole number from 0 on"):
            DiagnosisOptions(**wrong)
