"""The first frames: those of the truth, with or without gross errors."""

import numpy as np
import pytest

from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.exceptions import FrameFitError
from tests.estimation.virtual import SIGMA, Virtual, model_of


@pytest.mark.parametrize("spoilt", [0, 6])
def test_both_frames_come_back(drawing, spoilt):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 40, scale=1e-6)
    position = virtual.measured.position_m.copy()
    position[:spoilt] += 0.5
    measured = MeasuredPoses(position, virtual.measured.rotation, SIGMA, SIGMA)
    start = first_frames(virtual.rows, measured)
    seen = virtual.rows.predict(start)
    np.testing.assert_allclose(seen.position_m[spoilt:], virtual.measured.position_m[spoilt:], atol=8.0 * SIGMA)
    np.testing.assert_array_equal(start.values, 0.0)
    assert start.values.size == 16


def test_too_few_rows(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 2)
    with pytest.raises(FrameFitError):
        first_frames(virtual.rows, virtual.measured)


def test_rotations_alone_determine_no_positions(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 40)
    turned = MeasuredPoses(np.full((40, 3), np.nan), virtual.measured.rotation, SIGMA, SIGMA)
    with pytest.raises(FrameFitError, match="there are 0"):
        first_frames(virtual.rows, turned)


def test_a_few_positions_are_enough_with_rotations(drawing):
    virtual = Virtual(drawing, model_of(drawing, "drives"), 40, scale=1e-6)
    position = virtual.measured.position_m.copy()
    position[3:] = np.nan
    start = first_frames(virtual.rows, MeasuredPoses(position, virtual.measured.rotation, SIGMA, SIGMA))
    seen = virtual.rows.predict(start).position_m
    np.testing.assert_allclose(seen, virtual.measured.position_m, atol=8.0 * SIGMA)
