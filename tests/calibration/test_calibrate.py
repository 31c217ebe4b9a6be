"""The whole way from a campaign to a calibrated robot."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.calibration.measurement import FRAMES
from pouring_robot.campaign import FlagCode
from pouring_robot.exceptions import CampaignError
from tests.campaign.simulated import SIGMA_M, damaged, measure


def test_the_gap_closes_to_the_noise(found):
    before, after = (found.misfit(found.split.test, after=a) for a in (False, True))
    assert before.rms_mm > 5.0 * after.rms_mm
    assert after.rms_mm < 1.5 * SIGMA_M * 1e3
    assert found.changed
    assert found.noise.position_source == "repeats"
    assert found.calibrated.joint_placements
    assert found.std.shape == (len(found.unknown_names),) == (len(found.unknown_units),)
    np.testing.assert_allclose(np.diagonal(found.correlation), 1.0)


def test_a_sound_robot_stays_as_it_is(unchanged):
    assert not unchanged.changed
    assert unchanged.calibrated == unchanged.present
    np.testing.assert_allclose(unchanged.before, unchanged.after, atol=2e-6)


def test_the_test_block_is_not_looked_at(real):
    options = CalibrationOptions(parameters=("drives", "fixed_centres"))
    first = calibrate(real.campaign, None, options)
    rows = first.split.test
    moved = damaged(real.campaign, position_m=lambda p: p.__setitem__(rows, p[rows] + 1e-2))
    second = calibrate(moved, None, options)
    np.testing.assert_array_equal(first.fit.unknowns.values, second.fit.unknowns.values)
    assert first.selection.steps == second.selection.steps
    assert second.misfit(rows, after=True).rms_mm > first.misfit(rows, after=True).rms_mm


def test_outliers_are_left_out_and_nothing_else(as_built):
    virtual = measure(as_built, count=80, seed=7, outliers=3)
    found = calibrate(virtual.campaign, None, CalibrationOptions(parameters=("centres",), choose=False))
    np.testing.assert_array_equal(found.left_out, np.sort(virtual.outlier_rows))
    assert {flag.code for flag in found.flags} >= {FlagCode.OUTLIER}
    assert not set(found.left_out.tolist()) & {*found.split.train.tolist(), *found.split.test.tolist()}


def test_an_effect_that_is_not_geometry_widens_the_intervals(real):
    time = np.arange(len(real.campaign))
    drifting = damaged(real.campaign, position_m=lambda p: p + 1e-3 * np.sin(time / 3.0)[:, None])
    found = calibrate(drifting, None, CalibrationOptions(parameters=("drives",), choose=False))
    assert found.inflation > 2.0
    np.testing.assert_allclose(found.std, found.fit.std * found.inflation)


def test_positions_only(as_built):
    campaign = measure(as_built, count=80, seed=8, sigma_rotation_rad=None).campaign
    found = calibrate(campaign, None, CalibrationOptions(parameters=("centres",)))
    assert found.misfit(found.split.test, after=True).rms_mm < found.misfit(found.split.test, after=False).rms_mm
    assert np.isnan(found.misfit(found.split.test, after=True).rms_mrad)
    assert found.noise.rotation_source == "none"


def test_wrong_units_are_refused_before_any_fit(clean):
    wrong = damaged(clean.campaign, position_m=lambda p: p * 1e3)
    with pytest.raises(CampaignError, match=r"mm|unit|metre"):
        calibrate(wrong)


def test_keeping_all_keeps_all(clean):
    options = CalibrationOptions(parameters=("drives", "fixed_centres"), choose=False)
    found = calibrate(clean.campaign, None, options)
    assert [group.name for group in found.selection.groups] == ["drives", "fixed_centres"]
    # A robot that is as drawn: nothing is found that intervals do not allow.
    score = np.abs(found.fit.unknowns.values[FRAMES:]) / found.std[FRAMES:]
    assert (score < 1.96).mean() > 0.8
    assert dataclasses.is_dataclass(found)
