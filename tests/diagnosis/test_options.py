"""Options of a diagnosis and of a calibration."""

import inspect

import pytest

from pouring_robot import BadInputError, CalibrationOptions, DiagnosisOptions, FitOptions, calibrate, diagnose
from pouring_robot.cli.diagnose import diagnose as command
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (DiagnosisOptions, {"false_names": "a"}),
        (DiagnosisOptions, {"false_names": 1.0}),
        (DiagnosisOptions, {"next_count": -3}),
        (DiagnosisOptions, {"made_within": 0.0}),
        (DiagnosisOptions, {"made_within": float("nan")}),
        (DiagnosisOptions, {"made_within": float("inf")}),
        (DiagnosisOptions, {"made_within": "fine"}),
        (CalibrationOptions, {"tolerances": "tolerances.yaml"}),
        (CalibrationOptions, {"fit": {"loss": "linear"}}),
        (FitOptions, {"max_evaluations": 0}),
        (FitOptions, {"max_evaluations": "many"}),
        (FitOptions, {"step_tolerance": float("nan")}),
        (FitOptions, {"step_tolerance": -1.0}),
    ],
)
def test_what_means_nothing_is_refused(kind, given):
    with pytest.raises(BadInputError):
        kind(**given)


def test_the_command_has_the_defaults_of_the_library():
    given = {name: one.default for name, one in inspect.signature(command).parameters.items()}
    options = DiagnosisOptions()
    assert {name: given[name] for name in ("false_names", "hold_out", "made_within", "next_count")} == {
        name: getattr(options, name) for name in ("false_names", "hold_out", "made_within", "next_count")
    }


@pytest.mark.parametrize("work", [calibrate, diagnose])
def test_options_are_of_their_class(work):
    with pytest.raises(BadInputError, match=r"options of a \w+ are \w+Options, not a dict"):
        work("campaign.csv", options={"exclude": ()})


def test_a_text_is_one_name():
    catalogue = ParameterCatalogue(RobotModel().definition)
    assert catalogue.groups("geometry") == catalogue.groups(("geometry",))
