"""Errors are one line, and pass unchanged out of another process."""

import copy
import pickle

import numpy as np
import pytest

from pouring_robot import BadInputError
from pouring_robot.exceptions import PathPoseError, TableError, TooLargeError, UnreachablePoseError

REACH = UnreachablePoseError("leg1_s3", 1.2, 0.3, 1.1, "m")
ERRORS = [
    TableError("a.csv", "is wrong", 3, "x_mm"),
    TooLargeError("a joint is off by 7 m"),  # made of its own line it would say twice what to check
    PathPoseError("a.csv", 3, REACH),
]


@pytest.mark.parametrize("again", [lambda error: pickle.loads(pickle.dumps(error)), copy.copy, copy.deepcopy])
@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_is_pickled_and_copied_whole(error, again):
    found = again(error)
    assert (type(found), str(found), repr(vars(found))) == (type(error), str(error), repr(vars(error)))


def test_an_error_is_one_line_whatever_it_tells():
    assert str(BadInputError(f"three numbers, not {np.eye(2)}")) == "three numbers, not [[1. 0.]  [0. 1.]]"
