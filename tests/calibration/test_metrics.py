"""Figures by hand: RMS, P95, largest, ISO 9283 accuracy and repeatability."""

import numpy as np
import pytest

from pouring_robot.calibration.metrics import Misfit, pose_performance
from pouring_robot.estimation.residuals import MeasuredPoses


def test_misfit_by_hand():
    difference = np.zeros((3, 6))
    difference[:, 0] = [3e-3, 0.0, 0.0]
    difference[:, 1] = [4e-3, 0.0, 0.0]
    difference[1, 3:] = np.nan
    found = Misfit.of(difference)
    assert found.rows == 3
    assert found.rms_mm == pytest.approx(np.sqrt(25.0 / 9.0))
    assert found.max_mm == pytest.approx(5.0)
    assert found.p95_mm == pytest.approx(np.quantile([5.0, 0.0, 0.0], 0.95))
    assert found.axis_rms_mm == pytest.approx((np.sqrt(3.0), np.sqrt(16.0 / 3.0), 0.0))
    assert found.rms_mrad == 0.0
    assert np.isnan(Misfit.of(np.full((2, 6), np.nan)).rms_mm)


def test_the_largest_error_is_not_only_of_rows_measured_whole():
    difference = np.full((3, 6), np.nan)
    difference[0, :3] = 0.1e-3
    difference[1:, :2] = [[3e-3, 4e-3], [6e-3, 8e-3]]  # two coordinates of the three
    found = Misfit.of(difference)
    assert found.max_mm == pytest.approx(10.0)
    assert found.rms_mm <= found.max_mm


def test_accuracy_and_repeatability_by_hand():
    # Three repeats 1 mm from their mean, which is 2 mm off along x; a pair is too few.
    before = np.zeros((5, 6))
    before[:3, 0] = 2e-3
    before[:3, 1:3] = 1e-3 * np.array([[np.cos(a), np.sin(a)] for a in (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)])
    before[:3, 3] = [1e-3, -1e-3, 0.0]
    after = before.copy()
    after[:3, 0] = 0.5e-3
    measured = MeasuredPoses(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)), 1e-3, 1e-3)
    found = pose_performance(measured, before, after, [np.arange(3), np.array([3, 4])])
    assert (found.poses, found.cycles) == (1, 3)
    assert found.ap_before_mm == pytest.approx(2.0)
    assert found.ap_after_mm == pytest.approx(0.5)
    assert found.rp_mm == pytest.approx(1.0)  # mean distance 1, no scatter of distances
    lengths = np.array([1.0, 1.0, 0.0])
    assert found.rp_mrad == pytest.approx(lengths.mean() + 3.0 * lengths.std(ddof=1))
    assert pose_performance(measured, before, after, [np.array([3, 4])]) is None


def test_a_repeat_without_its_rotation_does_not_hide_the_rotations_of_the_others():
    after = np.zeros((4, 6))
    after[:, 3] = [2e-3, 2e-3, 2e-3, np.nan]
    measured = MeasuredPoses(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)), 1e-3, 1e-3)
    found = pose_performance(measured, 2.0 * after, after, [np.arange(4)])
    assert (found.ap_before_mrad, found.ap_after_mrad, found.rp_mrad) == pytest.approx((4.0, 2.0, 0.0))
    after[:2, 3] = np.nan  # a single one of them is no repeatedly measured pose
    found = pose_performance(measured, after, after, [np.arange(4)])
    assert found.ap_after_mm == 0.0 and np.isnan([found.ap_after_mrad, found.rp_mrad]).all()
