"""Which directions of the two frames a campaign leaves free: those that it tells, not those that it hardly sees."""

import numpy as np
import pytest

from pouring_robot.diagnosis.rows import LinearRows
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.measurement import FRAME_STD
from pouring_robot.inference.explanations import Nuisance

ROWS = 30


def rows_telling(least):
    """Return rows whose frames are told by singular values of 1e5 but one, and what that one adds, of length 1."""
    rng = np.random.default_rng(1)
    axes, _ = np.linalg.qr(rng.normal(size=(6 * ROWS, FRAMES)))
    directions, _ = np.linalg.qr(rng.normal(size=(FRAMES, FRAMES)))
    told = np.append(np.full(FRAMES - 1, 1e5), least)
    size = 6 * ROWS
    equations = np.repeat(np.arange(ROWS), 6), np.tile(np.arange(6), ROWS), np.ones(size)
    own = np.zeros((size, 0), dtype=bool)
    return LinearRows(np.zeros(size), *equations, (axes * told) @ directions.T, np.zeros(size), own), axes[:, -1]


@pytest.mark.parametrize(("least", "free"), [(0.5 / FRAME_STD, False), (2.0 / FRAME_STD, True), (0.0, False)])
def test_frames_explain_only_along_what_the_rows_tell_of_them(least, free):
    rows, course = rows_telling(least)
    left = Nuisance.of(rows.free).cleared(8.0 * course)
    assert np.linalg.norm(left) == pytest.approx(0.0 if free else 8.0, abs=1e-6)


def test_what_is_told_is_taken_out_whole():
    rows, course = rows_telling(0.5 / FRAME_STD)
    told = rows.frame_columns @ np.random.default_rng(2).normal(size=FRAMES)
    left = Nuisance.of(rows.free).cleared(told)
    assert np.linalg.norm(left - course * (course @ told)) < 1e-9 * np.linalg.norm(told)
