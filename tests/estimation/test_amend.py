"""The amended model file is the robot the fit describes."""

import numpy as np
import pytest

from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.measurement import Unknowns
from pouring_robot.exceptions import CalibrationError
from pouring_robot.robot.model import RobotModel
from tests.estimation.virtual import TRUE_FRAMES, Virtual, model_of
from tests.support import ACTUAL


@pytest.mark.parametrize("present", [RobotModel(), RobotModel.load(ACTUAL)], ids=["drawing", "actual"])
def test_the_amended_model_predicts_what_the_parameters_do(drawing, present):
    model = model_of(drawing, "geometry", model=present)
    virtual = Virtual(drawing, model, 6)
    expected = virtual.rows.predict(virtual.unknowns)
    amended = model_of(drawing, "drives", model=model.amended(virtual.truth))
    seen = amended.at(virtual.rows.drives).predict(Unknowns.zero(TRUE_FRAMES, 4))
    np.testing.assert_allclose(seen.position_m, expected.position_m, atol=1e-11)
    np.testing.assert_allclose(seen.rotation, expected.rotation, atol=1e-11)


def test_no_change_is_no_change(drawing):
    present = RobotModel.load(ACTUAL)
    model = model_of(drawing, "geometry", model=present)
    assert model.amended(np.zeros(len(model.parameters))) == present


@pytest.mark.parametrize(
    ("which", "words"),
    [(0, "'leg1_s3': 3000 mm is too large for a drive offset"), (8, "too large for a placement error")],
)
def test_parameters_that_make_no_valid_robot_are_refused(drawing, which, words):
    model = model_of(drawing, "centres")
    values = np.zeros(len(model.parameters))
    values[which] = 3.0
    with pytest.raises(CalibrationError, match=words):
        model.amended(values)
    assert model.names[FRAMES] == "drive.leg1_s3"
