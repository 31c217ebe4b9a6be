"""Options that calls of the library and commands share: what is refused, and that their defaults are the same."""

import inspect
import typing

import numpy as np
import pytest

from pouring_robot import BadInputError, CalibrationOptions, DiagnosisOptions, FitOptions, calibrate, diagnose
from pouring_robot.campaign.simulate import MeasurementOptions
from pouring_robot.cli.calibrate import calibrate as calibrate_command
from pouring_robot.cli.campaign import plan, simulate
from pouring_robot.cli.diagnose import diagnose as diagnose_command
from pouring_robot.cli.export import export
from pouring_robot.cli.sensitivity import sensitivity
from pouring_robot.design.request import PlanRequest
from pouring_robot.estimation.robust import Loss
from pouring_robot.estimation.splits import HoldOut
from pouring_robot.robot.export.folder import Format
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue
from pouring_robot.sensitivity.report import Request


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (DiagnosisOptions, {"false_names": "a"}),
        (DiagnosisOptions, {"false_names": 1.0}),
        (DiagnosisOptions, {"next_count": -3}),
        (DiagnosisOptions, {"next_count": 76}),
        (DiagnosisOptions, {"hold_out": 1}),
        (DiagnosisOptions, {"exclude": 1}),
        (DiagnosisOptions, {"made_within_mm": 0.0}),
        (DiagnosisOptions, {"made_within_mm": float("nan")}),
        (DiagnosisOptions, {"made_within_mm": float("inf")}),
        (DiagnosisOptions, {"made_within_mm": "fine"}),
        (CalibrationOptions, {"tolerances": "tolerances.yaml"}),
        (CalibrationOptions, {"fit": {"loss": "linear"}}),
        (CalibrationOptions, {"choose": "no"}),
        (CalibrationOptions, {"hold_out": "hall"}),
        (CalibrationOptions, {"threads": "two"}),
        (CalibrationOptions, {"parameters": 3}),
        (FitOptions, {"curvature": "yes"}),
        (FitOptions, {"loss": "hubber"}),
        (FitOptions, {"max_evaluations": 0}),
        (FitOptions, {"max_evaluations": "many"}),
        (FitOptions, {"step_tolerance": float("nan")}),
        (FitOptions, {"step_tolerance": -1.0}),
        (PlanRequest, {"reduce": "no"}),
        (MeasurementOptions, {"pose_platform_to_target": np.eye(4)}),
        (Request, {"frame": 1}),
    ],
)
def test_meaningless_values_are_refused(kind, given):
    with pytest.raises(BadInputError):
        kind(**given)


def test_a_refused_value_is_reported_with_the_allowed_ones():
    with pytest.raises(
        BadInputError, match=r"^loss of FitOptions must be 'huber' or 'soft_l1' or 'linear', not 'hubber'$"
    ):
        FitOptions(loss="hubber")
    with pytest.raises(BadInputError, match=r"^choose of CalibrationOptions must be True or False, not 'no'$"):
        CalibrationOptions(choose="no")
    with pytest.raises(
        BadInputError, match=r"^threads of CalibrationOptions must be a whole number or None, not True$"
    ):
        CalibrationOptions(threads=True)
    assert FitOptions(curvature=np.True_, max_evaluations=np.int64(9)).curvature


def of_command(command):
    """Return the defaults of a command's options by name."""
    return {name: one.default for name, one in inspect.signature(command).parameters.items()}


REQUEST = {"length_mm": "length_m", "angle_mrad": "angle_rad", "limit_mm": "limit_m"}
MEASURED = {"noise_mm": "sigma_position_m", "outlier_mm": "outlier_m"}
SAME = [
    (diagnose_command, DiagnosisOptions(), ("false_names", "hold_out", "made_within_mm", "next_count"), {}),
    (calibrate_command, CalibrationOptions(), ("tolerances", "hold_out"), {}),
    (calibrate_command, FitOptions(), ("loss",), {}),
    (sensitivity, Request(), ("poses", "seed", "frame"), REQUEST),
    (plan, PlanRequest(), ("poses", "criterion", "both_sides", "reduce", "candidates", "starts", "seed"), {}),
    (plan, PlanRequest().noise, (), {"sigma_mm": "position_m"}),
    (simulate, MeasurementOptions(), ("seed", "outliers", "lost"), MEASURED),
]


@pytest.mark.parametrize(("command", "options", "names", "thousandths"), SAME)
def test_commands_have_the_defaults_of_the_library(command, options, names, thousandths):
    given = of_command(command)
    assert {name: given[name] for name in names} == {name: getattr(options, name) for name in names}
    for name, own in thousandths.items():
        assert 1e-3 * given[name] == pytest.approx(getattr(options, own), rel=1e-12)


@pytest.mark.parametrize(
    ("command", "option", "names"),
    [
        (calibrate_command, "loss", Loss),
        (calibrate_command, "hold_out", HoldOut),
        (diagnose_command, "hold_out", HoldOut),
        (export, "form", Format),
    ],
)
def test_commands_know_the_names_of_the_library(command, option, names):
    asked = typing.get_type_hints(command)[option]
    assert typing.get_args(asked) == typing.get_args(names)


@pytest.mark.parametrize("work", [calibrate, diagnose])
def test_options_have_the_types_of_their_class(work):
    with pytest.raises(BadInputError, match=r"options of a \w+ are \w+Options, not a dict"):
        work("campaign.csv", options={"exclude": ()})


def test_a_single_text_is_one_name():
    catalogue = ParameterCatalogue(RobotModel().definition)
    assert catalogue.groups("geometry") == catalogue.groups(("geometry",))
