"""The coverage study: its arrays, its seeds, and its treatment of failed runs."""

from dataclasses import replace

import numpy as np
import pytest

from pouring_robot.exceptions import CalibrationError
from scripts.studies.calibration import StudyOptions, coverage_study

SMALL = StudyOptions(runs=12, rows=60, parameters=("drives",), seed=1)


def test_intervals_hold_the_truth_about_as_often_as_stated():
    result = coverage_study(SMALL)
    assert result.covered.shape == (12, 4)
    assert 0.8 <= result.coverage <= 1.0  # 48 intervals; the full study is scripts/studies/calibration.py
    assert result.held_out == pytest.approx(1.0, abs=0.15)
    # Twelve rows of six are held out in each of twelve runs: the standard error of their mean is two per cent.
    expected = result.figures()["held_out_expected"]
    assert 1.0 < expected < 1.1
    assert result.held_out == pytest.approx(expected, abs=0.08)
    assert result.figures()["before_over_noise"] > 3.0
    assert not result.failed
    np.testing.assert_array_equal(coverage_study(replace(SMALL, runs=2)).covered, result.covered[:2])


def test_runs_that_fail_are_counted(monkeypatch):
    def fail(*_):
        raise CalibrationError("no", "way")

    monkeypatch.setattr("scripts.studies.calibration.identify", fail)
    with pytest.raises(CalibrationError, match="no run of the study has an answer"):
        coverage_study(SMALL)
