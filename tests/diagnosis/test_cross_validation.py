"""Blocks held out in turn for a line through points: against fits by hand; the standard error against the scatter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pouring_robot.diagnosis.cross_validation import few, held_out_in_turn
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.rows import LinearRows
from pouring_robot.inference.problem import Explanation, Problem
from pouring_robot.inference.thresholds import DEFAULT_THRESHOLDS
from tests.diagnosis.hidden import distances_of_an_arm

ROWS, SIGMA, SLOPE = 30, 1e-3, 40.0
BLOCKS = np.array_split(np.arange(ROWS), 5)
COURSE = np.random.default_rng(0).uniform(-1.0, 1.0, ROWS)


def turned(residual, free):
    """Return the result for one coordinate per row, in units of the noise, that may depend on the course."""
    rows, no = np.arange(ROWS), np.zeros(ROWS)
    jacobian = np.zeros((ROWS, 12))
    jacobian[:, : free.shape[1]] = free / SIGMA
    none = np.zeros((ROWS, 0))
    linear = LinearRows(
        residual, rows, 0 * rows, no + SIGMA, jacobian, jacobian, no, own=none.astype(bool), start=rows, by_start=none
    )
    state = SimpleNamespace(every_row=linear)
    item = Explanation("slope", "line", COURSE[:, None], np.array([True]))
    diagnoser = SimpleNamespace(
        problem_at=lambda *_, **__: Problem.build(residual, linear.free, [], [item]),
        thresholds=DEFAULT_THRESHOLDS,
        rows=Rows(),
    )
    return held_out_in_turn(diagnoser, state, state, BLOCKS, frozenset({"slope"}))


class Rows:
    measured = SimpleNamespace(sigma=np.full(6, SIGMA))

    def __len__(self):
        return ROWS


def drawn(seed):
    return 3.0 + SLOPE * COURSE + np.random.default_rng(seed).normal(size=ROWS)


def test_held_out_error_is_that_of_fits_without_each_block():
    values = drawn(1)
    found = turned(values, np.ones((ROWS, 1)))
    left = np.zeros(ROWS)
    for rows in BLOCKS:
        others = np.setdiff1d(np.arange(ROWS), rows)
        slope, start = np.polyfit(COURSE[others], values[others], 1)
        left[rows] = values[rows] - start - slope * COURSE[rows]
    assert (found.blocks, found.agreed, found.found) == (5, 5, {"slope": 5})
    # The search's prior on the slope is wide, but not flat.
    assert found.gap.position("after") == pytest.approx(SIGMA * np.sqrt((left**2).mean()), rel=0.01)
    before = [values[rows] - np.delete(values, rows).mean() for rows in BLOCKS]
    assert found.gap.position("before") == pytest.approx(SIGMA * np.sqrt((np.concatenate(before) ** 2).mean()))


def test_its_standard_error_is_the_scatter_from_campaign_to_campaign():
    found = [turned(drawn(seed), np.ones((ROWS, 1))) for seed in range(100)]
    scatter = np.std([one.gap.position("after") for one in found])
    assert np.sqrt(np.mean([one.error_m**2 for one in found])) == pytest.approx(scatter, rel=0.35)


def test_blocks_that_alone_determine_the_frames_are_not_predicted():
    alone = np.zeros((ROWS, 2))
    alone[BLOCKS[2], 0] = 1.0
    values = drawn(2)
    found = turned(values, alone)
    assert (found.blocks, found.found) == (4, {"slope": 4})
    others = np.concatenate([BLOCKS[k] for k in (0, 1, 3, 4)])
    assert found.gap.position("before") == pytest.approx(SIGMA * np.sqrt((values[others] ** 2).mean()))
    everywhere = np.zeros((ROWS, 4))
    for k in range(4):
        everywhere[BLOCKS[k], k] = 1.0
    assert turned(values, everywhere) is None


@pytest.mark.parametrize(("held_out", "expected"), [(0, False), (6, True), (49, True), (50, False)])
def test_few_rows_determine_an_error_to_worse_than_a_tenth(held_out, expected):
    """The RMS of m values has a relative standard deviation of 1 / sqrt(2 m)."""
    fitted = np.arange(100) >= held_out
    linear = SimpleNamespace(row=np.arange(100))
    assert few(linear, fitted) == expected
    assert not expected or 1.0 / np.sqrt(2.0 * held_out) > 0.1


def test_what_predicts_no_row_is_not_named(tmp_path):
    """Forty distances of an arm, off by up to 1 mm as no joint makes it: waves of all joints absorb any of them."""
    data = distances_of_an_arm(tmp_path, "null")
    first, second = data.drives[:, 0], data.drives[:, 1]
    off = 1e-3 * np.sin(3.0 * first) * np.sin(3.0 * second)
    found = diagnose(replace(data, distance_m=data.distance_m + off[:, None]).subset(np.arange(40)))
    assert found.verdict == "unknown"
    assert "blocks held out in turn keep more than half of their gap" in found.headline


@pytest.mark.parametrize(
    ("before", "after", "kept"),
    # squares less one: 3.93 and 1.62, 12.8 and 7.9; 1.48 times the noise may be noise; worse than before
    [(2.22, 1.62, False), (3.72, 2.98, True), (1.56, 1.48, False), (2.0, 2.5, True)],
)
def test_half_of_the_gap_is_of_squares_less_the_noise(before, after, kept):
    one = np.ones(3)
    assert Gap(9, before * one, after * one, one, np.full(3, 9)).kept is kept
