"""The figures: complete, finite, in JSON; warnings when there is something to warn of."""

import json

import pytest

from pouring_robot.calibration.summary import calibration_figures, next_measurements, noise_floor, warnings_of


def swapped(calibration, **changes):
    """Return a calibration with attributes replaced."""
    other = object.__new__(type(calibration))
    other.__dict__.update(calibration.__dict__ | changes)
    return other


def test_figures_are_json_and_agree_with_the_calibration(found):
    figures = json.loads(json.dumps(calibration_figures(found), allow_nan=False))
    assert figures["gap"]["held_out"]["after"]["rms_mm"] == pytest.approx(
        found.misfit(found.split.test, after=True).rms_mm
    )
    assert figures["gap"]["held_out"]["floor"] == pytest.approx(noise_floor(found))
    assert len(figures["parameters"]) == len(figures["correlation"]["names"])
    assert figures["base_parameters"]["rank"] == found.base.rank
    assert figures["noise"]["position_source"] == "repeats"
    assert figures["iso_9283"]["poses"] == 4


def test_unchanged_figures(unchanged):
    figures = json.loads(json.dumps(calibration_figures(unchanged), allow_nan=False))
    assert figures["status"] == "unchanged"
    assert figures["parameters"] == []
    # The y of target and tracker cannot be told apart, but nothing was changed along it.
    assert figures["warnings"] == ["no parameter helped rows that were held out, so the model is unchanged"]
    assert figures["iso_9283"] is None


def test_warnings(found):
    assert any("rank deficient" in line for line in warnings_of(found))
    assert "rank_deficient" in calibration_figures(found)
    worse = swapped(found, before=found.after, after=found.before)
    assert any("do not use this model" in line for line in warnings_of(worse))
    assert not any("do not use" in line for line in warnings_of(found))
    assert any("3.00 times the noise" in line for line in warnings_of(swapped(found, inflation=3.0)))


def test_what_to_measure_next(found, unchanged):
    lines = next_measurements(found)
    assert any("campaign plan --out next.csv --priors" in line for line in lines)
    assert any("known least at x" in line for line in lines)
    assert not any("measured three times" in line for line in lines)
    assert any("measured three times" in line for line in next_measurements(unchanged))
