"""Parameters that absorb the errors of dropped ones: an arm whose zeros are taken as exact."""

from dataclasses import replace

import numpy as np
import pytest

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.calibration.summary import notes_of, warnings_of
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.robot.robot import Robot
from tests.calibration.test_outliers import arm_as_built
from tests.campaign.simulated import measure
from tests.robot.test_definition import ROBOTS


@pytest.fixture(scope="module")
def found():
    """The calibration of an arm made to its tolerances, zeros by 5 mrad and directions of axes by 1 mrad."""
    return calibrate(measure(arm_as_built(1), count=80, seed=1).campaign, Robot.load(ROBOTS / "arm/robot.yaml").model)


def test_axes_that_absorb_errors_of_zeros_are_not_called_beyond_their_tolerances(found):
    def told(one):
        return [line for line in warnings_of(one) if "times as large as the tolerances" in line]

    assert any("taken as exact: drives." in line for line in notes_of(found))
    assert not told(found)
    farther = replace(found.fit.unknowns, values=3.0 * found.fit.unknowns.values)
    assert len(told(replace(found, fit=replace(found.fit, unknowns=farther)))) == 1


def test_the_values_that_absorb_dropped_parameters_are_those_of_a_fit_without_them(found):
    """For arms with one zero off by its tolerance and nothing else, calibrated without zeros."""
    drawing = Robot.load(ROBOTS / "arm/robot.yaml").model
    kept = tuple(group.name for group in found.selection.groups)
    options, expected = CalibrationOptions(parameters=kept, choose=False), 0.0
    for drive in drawing.definition.drives:
        arm = Robot(drawing.displaced({}, {drive.joint: 5e-3}))
        lines = calibrate(measure(arm, count=80, seed=1).campaign, drawing, options).to_frame()
        moved = (lines["value"] / lines["prior_std"]).to_numpy()
        expected = expected + np.outer(moved, moved)
    assert np.sqrt(np.diagonal(expected)).max() > 2.0
    of_kept = slice(FRAMES, FRAMES + len(lines))
    moves = found.in_place_of_dropped[of_kept] / found.fit.prior_std[of_kept, None]
    np.testing.assert_allclose(moves @ moves.T, expected, atol=0.3)


def test_the_ladle_is_as_uncertain_as_with_the_dropped_parameters_fitted(found):
    """The arm is measured by position only: the tool's orientation depends on zeros that positions hardly determine.

    With all groups kept the covariance is the inverse of one matrix; with some dropped it is composed of two fits,
    linearised at points that differ by the values of the dropped parameters.
    """
    drawing, seen = found.present, replace(found.campaign, rotation_vector_rad=None)
    one = calibrate(seen, drawing)
    whole = calibrate(seen, drawing, CalibrationOptions(choose=False))
    assert len(one.selection.groups) < len(one.candidates)
    np.testing.assert_allclose(one.ladle.half_width_m, whole.ladle.half_width_m, rtol=0.1)
