"""The C function, compiled by gcc, against the package on thousands of poses that it was not fitted to."""

import shutil

import numpy as np
import pytest

from pouring_robot.compensation.path import compensate_path, make_controller, rounded_up
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot
from scripts.studies.controller import answers
from scripts.studies.controller import compiled as gcc_made
from tests.support import BOX_LOWER, BOX_UPPER, round_off


@pytest.fixture(scope="module")
def controller(as_built):
    return make_controller(HeatedRobot(as_built))


@pytest.fixture(scope="module")
def compiled(controller, tmp_path_factory):
    """A program that turns poses into drive values with the header."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc here")
    program = gcc_made(controller.header(), tmp_path_factory.mktemp("controller"))
    return lambda poses: answers(program, poses)


def test_on_thousands_of_poses_c_gives_the_packages_drives_to_the_stated_error(controller, compiled, as_built):
    poses = np.concatenate(
        [np.random.default_rng(seed).uniform(BOX_LOWER, BOX_UPPER, (1000, 4)) for seed in (77, 79, 80)]
    )
    # Polynomials err most near the faces: half of the coordinates of another thousand poses lie on one.
    random = np.random.default_rng(81)
    pushed = np.where(random.random((1000, 4)) < 0.5, random.choice([0.0, 1.0], (1000, 4)), random.random((1000, 4)))
    poses = np.concatenate([poses, BOX_LOWER + np.subtract(BOX_UPPER, BOX_LOWER) * pushed])
    answers = compiled(poses)
    path = compensate_path(HeatedRobot(as_built), poses)
    assert not answers[:, 0].any() and set(path.status) == {"closed"}
    off = np.abs(answers[:, 1:] - path.drives).max(axis=0)
    assert (off <= controller.drive_error).all()
    assert (off > 0.5 * controller.drive_error).all()  # and the stated error is no larger than necessary
    assert controller.drive_error.max() < 1e-7 and controller.place_error_m < 1e-6
    ours = controller.drives(as_built.kinematics, poses)
    np.testing.assert_allclose(answers[:, 1:], ours, rtol=0, atol=round_off(scale=1.0, terms=sum((5, 5, 7, 8)) * 10))


def test_the_stated_error_is_rounded_up_to_two_digits():
    assert [rounded_up(value) for value in (0.0, 2.01e-8, 9.91e-3, 0.25)] == pytest.approx([0.0, 2.1e-8, 1e-2, 0.25])


def test_its_drives_bring_the_ladle_there_by_the_solver_of_single_poses(controller, as_built):
    """Closed by :class:`ClosureSolver`, not by the engine that the polynomials were made with."""
    poses = np.random.default_rng(78).uniform(BOX_LOWER, BOX_UPPER, (5, 4))
    for row, drives in zip(poses, controller.drives(as_built.kinematics, poses).tolist(), strict=True):
        pose = PlatformPose(tuple(row[:3].tolist()), float(row[3]))
        named = dict(zip(as_built.nominal_solver.mechanism.loops.drives, drives, strict=True))
        there = as_built.forward(named, near=pose).pose_base_to_end
        assert np.linalg.norm(there.translation - row[:3]) <= controller.place_error_m


def test_outside_the_box_there_is_no_answer(compiled):
    outside = np.array([np.subtract(BOX_LOWER, 0.001), np.add(BOX_UPPER, 0.01), np.full(4, np.nan)])
    answers = compiled(outside)
    assert (answers[:, 0] == 1.0).all() and not answers[:, 1:].any()


def test_a_robot_under_load_is_refused(as_built):
    with pytest.raises(BadInputError, match="under loads"):
        make_controller(HeatedRobot(PouringRobot(as_built.model, Loads(gravity=True))))
