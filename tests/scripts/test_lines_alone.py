"""The Hangprinter by plain least squares, and the package's closure of the same drawing."""

import numpy as np
import pytest

import pouring_robot
from pouring_robot.checks.check import examine
from scripts.studies.lines_alone import SAMPLES, disagreement, fitted, size_mm, splits, strokes


def test_the_drawing_disagrees_as_the_package_says():
    """Its URDF gives anchors to a tenth of a millimetre."""
    model = pouring_robot.RobotModel(robot=str(SAMPLES.parent / "robot.yaml"))
    campaign = pouring_robot.Campaign.of(SAMPLES, model.definition)
    report = examine(campaign, model.definition.drawing())
    assert 1e3 * report.disagreement_m == pytest.approx(size_mm(disagreement(strokes(), np.zeros(0))), abs=0.1)


@pytest.mark.parametrize("name", splits(44))
def test_anchors_alone_are_not_enough_and_build_up_is(name):
    """What the docs say of both."""
    stroke, out = strokes(), splits(44)[name]
    anchors, all_of_it = fitted(stroke[~out], 6), fitted(stroke[~out], 14)
    assert 2.0 < size_mm(disagreement(stroke[~out], anchors)) < 2.85
    assert 0.4 < size_mm(disagreement(stroke[out], all_of_it)) < 1.6
