"""Arguments that a user passes from Python."""

import numpy as np
import pytest

from pouring_robot import (
    BadInputError,
    ClosedChainMechanism,
    ClosureSolver,
    DiagnosisOptions,
    JointPlacement,
    PoseDifference,
    RobotModel,
    SweepConfig,
    Target,
    Tolerances,
    load_loops,
    package_path,
)
from pouring_robot.io.argument_checks import whole


@pytest.mark.parametrize("value", [2, np.int64(2), np.uint8(2)])
def test_whole_numbers_are_those_of_numpy_too(value):
    assert type(whole(value, 0, "a count is whole")) is int


@pytest.mark.parametrize("value", [-1, 4, 2.0, True, np.True_, np.float64(2.0), "2", None])
def test_others_are_no_whole_numbers_between_bounds(value):
    with pytest.raises(BadInputError, match="a count is whole, not "):
        whole(value, 0, "a count is whole", 3)


def test_options_of_a_diagnosis_take_numbers_of_numpy():
    options = DiagnosisOptions(false_names=np.float32(0.5), next_count=np.int64(3))
    assert type(options.false_names) is float
    for wrong, said in (
        ({"false_names": 1.0}, "a share between 0 and 1"),
        ({"false_names": np.nan}, "a share between 0 and 1"),
        ({"false_names": "0.05"}, "false_names of DiagnosisOptions must be a number, not '0.05'"),
        ({"next_count": True}, "next_count of DiagnosisOptions must be a whole number, not True"),
    ):
        with pytest.raises(BadInputError, match=said):
            DiagnosisOptions(**wrong)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (lambda robot: RobotModel.load(None), "a file is named by its path, not a NoneType"),
        (lambda robot: RobotModel.for_robot(3), "a file is named by its path, not a int"),
        (lambda robot: robot.model.save(None), "a file is named by its path"),
        (lambda robot: SweepConfig.load({}), "a file is named by its path"),
        (lambda robot: Tolerances.load(0.1), "a file is named by its path"),
        (lambda robot: load_loops(b"loops.yaml"), "a file is named by its path"),
        (lambda robot: robot.read_commands([[0.0] * 4]), "a file is named by its path"),
        (lambda robot: robot.built_as("model.yaml"), "a robot is built as a RobotModel says"),
        (lambda robot: robot.command_at([0.0, 0.0, -0.6]), "a command is x, y, z in m and the tilt in rad"),
        (lambda robot: JointPlacement.from_se3(np.eye(4)), "a displacement is a pinocchio.SE3, not a ndarray"),
        (lambda robot: PoseDifference.between(np.eye(4), np.eye(4)), "a pose is a pinocchio.SE3"),
        (lambda robot: Target(np.zeros(3), []), "rotation"),
        (lambda robot: ClosedChainMechanism(package_path() / "a.urdf", robot.model.definition.loops), "text of a URDF"),
        (lambda robot: ClosedChainMechanism("<robot/>", package_path()), "a LoopsFile, such as load_loops reads"),
        (ClosureSolver, "what is closed is a ClosedChainMechanism, not a PouringRobot"),
        (lambda robot: robot.actual_solver.solve({}, "x"), "a configuration of this robot has shape"),
    ],
)
def test_what_is_of_a_wrong_kind_is_told_in_a_line(as_built, asked, said):
    with pytest.raises(BadInputError) as told:
        asked(as_built)
    assert said in str(told.value) and "\n" not in str(told.value)


def test_numbers_of_a_command_may_be_a_list(as_built):
    assert as_built.command_at([-0.1, 0, -0.6, 0.3]).position_m == (-0.1, 0.0, -0.6)
