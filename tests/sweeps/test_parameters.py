"""Names and patterns, and the effect of parameter values on the joints."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue
from pouring_robot.sweeps import ErrorEntry
from pouring_robot.sweeps.draws import ErrorMap
from tests.support import round_off


@pytest.fixture(scope="module")
def catalogue():
    return ParameterCatalogue(RobotModel().definition)


def test_a_pattern_means_the_errors_of_the_machine(catalogue):
    names = [p.name for p in catalogue.match("*_e?_*")]
    assert names == [p.name for p in catalogue.table.selection()]
    assert catalogue.match("d_e1_0")  # what drops out must be named in full
    with pytest.raises(BadInputError, match="no parameter is called 'd_e\\*_0'"):
        catalogue.match("d_e*_0")
    assert [p.name for p in catalogue.match("leg3_s1.r?")] == ["leg3_s1.rx", "leg3_s1.ry", "leg3_s1.rz"]
    assert {p.name: p.unit for p in catalogue.match("drive.*")} == {
        "drive.leg1_s3": "m",
        "drive.leg2_s3": "m",
        "drive.leg3_s3": "m",
        "drive.leg4_s5": "rad",
    }


def test_dh_errors_become_the_same_placements_as_one_at_a_time(catalogue):
    parameters = [catalogue.match(p.name)[0] for p in catalogue.table.parameters]
    values = np.random.default_rng(5).normal(size=(30, len(parameters))) * 3e-3
    found = ErrorMap(catalogue, parameters).placement_errors(values)
    for row, errors in zip(values, found, strict=True):
        expected = catalogue.table.placement_errors({p.name: float(v) for p, v in zip(parameters, row, strict=True)})
        for joint, error in zip(catalogue.table.joints, errors, strict=True):
            assert np.abs(error[:3] - expected[joint].translation).max() < 1e-12
            assert np.abs(error[3:] - pin.log3(expected[joint].rotation)).max() < 1e-12


def test_untouched_joints_stay_exactly(catalogue):
    parameters = catalogue.match("alpha_e2_56")
    errors = ErrorMap(catalogue, parameters).placement_errors(np.array([[1e-3]]))[0]
    touched = catalogue.table.joints.index("leg2_s5")
    assert errors[touched].any() and not np.delete(errors, touched, axis=0).any()


def test_a_placement_error_comes_on_top_of_a_dh_error(catalogue):
    parameters = catalogue.match("theta_e1_0") + catalogue.match("leg1_s1.rx") + catalogue.match("leg1_s1.ty")
    values = np.array([[2e-3, 3e-3, 4e-4]])
    errors = ErrorMap(catalogue, parameters).placement_errors(values)[0, 0]
    first = catalogue.table.placement_errors({"theta_e1_0": 2e-3})["leg1_s1"]
    expected = first * pin.SE3(pin.exp3(np.array([3e-3, 0, 0])), np.array([0, 4e-4, 0]))
    lost = round_off(terms=9)  # entries up to 1, three products of length 3
    assert np.abs(errors[:3] - expected.translation).max() < lost
    assert np.abs(errors[3:] - pin.log3(expected.rotation)).max() < lost


def test_drive_errors_go_to_their_drive(catalogue):
    parameters = catalogue.match("drive.leg4_s5") + catalogue.match("drive.leg2_s3")
    errors = ErrorMap(catalogue, parameters).drive_errors(np.array([[1.0, 2.0]]))
    assert errors.tolist() == [[0.0, 2.0, 0.0, 1.0]]


def test_parts_are_parts_of_the_machine(catalogue):
    assert catalogue.match("alpha_e1_01")[0].part == catalogue.match("theta_e1_2")[0].part == "chain 1 upper U joint"
    assert catalogue.match("leg1_s2.rx")[0].part == "leg1_s2"


def test_a_parameter_given_twice_or_without_a_size_is_refused(make_plan):
    alpha = ErrorEntry(parameters=("alpha_e1_*",), half_width_mrad=1.0)
    with pytest.raises(BadInputError, match=r"'alpha_e1_56' is given twice: here and in errors.0"):
        make_plan(errors=[alpha, ErrorEntry(parameters=("*_e1_56",), half_width_mrad=1.0, half_width_mm=1.0)])
    with pytest.raises(BadInputError, match="'a_e1_01' needs half_width_mm"):
        make_plan(errors=[ErrorEntry(parameters=("a*_e1_01",), half_width_mrad=1.0)])
