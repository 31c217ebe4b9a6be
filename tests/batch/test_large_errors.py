"""Errors of ten times the paper's, where the mechanism has several assembly modes: both solvers find the drawing's."""

from __future__ import annotations

import numpy as np
import pytest

from scripts.studies.closures import ALIKE_M, Study


@pytest.fixture(scope="module")
def study() -> Study:
    """Return a study of 40 mrad and 2 mm."""
    return Study(times=10.0, seed=1)


def test_the_mode_that_is_found_is_the_one_that_grows_out_of_the_drawing(study: Study) -> None:
    drives, start, errors = study.draw(2000)
    found, straight = (engine.close(drives, start, errors) for engine in (study.engine, study.straight))
    slowly = study.grown(drives, start, errors)
    there = (found.status == 0) & (slowly.status == 0)

    def others(closed: np.ndarray) -> int:
        return int((np.linalg.norm(closed - slowly.position, axis=1)[there] > ALIKE_M).sum())

    assert others(straight.position) > 20  # there is something to find
    assert others(found.position) <= 2  # where the mode ends in a fold nothing continues it
    np.testing.assert_array_equal(found.status, slowly.status)


def test_one_at_a_time_is_as_all_at_once(study: Study) -> None:
    drives, start, errors = study.draw(60)
    found, straight = (engine.close(drives, start, errors) for engine in (study.engine, study.straight))
    assert (np.linalg.norm(found.position - straight.position, axis=1) > ALIKE_M).any()
    for k, position in enumerate(found.position):
        one = study.singly(drives[k], errors[k])
        if found.status[k] == 0:
            assert not isinstance(one, str)
            np.testing.assert_allclose(one, position, atol=ALIKE_M)
        else:
            assert isinstance(one, str)


def test_a_sample_is_the_same_in_any_company(study: Study) -> None:
    drives, start, errors = study.draw(50)
    errors[::2] *= 0.1  # these need no steps
    found = study.engine.close(drives, start, errors)
    for k in (0, 1, 2, 7):
        alone = study.engine.close(drives[k : k + 1], start[k : k + 1], errors[k : k + 1])
        np.testing.assert_array_equal(alone.position[0], found.position[k])
        assert alone.iterations[0] == found.iterations[k]
