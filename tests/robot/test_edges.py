"""At extreme numbers the answer is right or a typed error; never a NaN and never a traceback."""

import numpy as np
import pytest
from scipy.optimize import brentq

from pouring_robot.exceptions import ClosureError, NoSolutionError, UnreachablePoseError
from pouring_robot.io.units import MRAD
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring.stiffness import Measured, load_stiffness
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.pouring_under_weight import stiffness_at, under_weight
from tests.support import CHAINS

POSE = PlatformPose.from_mm_deg(-100, 20, -600, 17)
JOINTS = [f"leg{i}_{joint}" for i in CHAINS for joint in ("s1", "s2", "s3", "s4", "s5", "seat_mount")]


def with_errors(size_mm, size_mrad, seed):
    """Return a robot with an error of that size in and about every axis of every joint, with random signs."""
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), (len(JOINTS), 2, 3))
    placed = {
        joint: JointPlacement(
            translation_mm=tuple((size_mm * t).tolist()), rotation_mrad=tuple((size_mrad * r).tolist())
        )
        for joint, (t, r) in zip(JOINTS, signs, strict=True)
    }
    return PouringRobot(RobotModel(joint_placements=placed))


def off_m(location):
    return location.difference("ladle_lip").distance_m


@pytest.mark.parametrize(
    ("at_mm", "tilt_deg"),
    [
        ((0, 0, 0), 0),  # all joint centres in one plane: every leg lies in it
        ((0, 0, -1e-6), 0),
        ((-100, 20, 600), 17),
        ((-100, 20, -600), 180),
        ((0, 0, -1e9), 0),
        ((1e300, 0, -600), 0),
    ],
)
def test_singular_and_far_poses_are_out_of_reach(as_built, at_mm, tilt_deg):
    pose = PlatformPose.from_mm_deg(*at_mm, tilt_deg)
    for asked in (as_built.locate, lambda one: as_built.transfer(one, "centres")):
        with pytest.raises(UnreachablePoseError, match="out of reach"):
            asked(pose)


def test_a_drive_at_its_limit_closes_and_one_beyond_it_does_not(drawing):
    """Upwards in the middle, until two legs are at their minimum, to a hundredth of a micrometre."""
    shortest = 0.26

    def at(height):
        return PlatformPose((-0.1, 0.0, height), 0.0)

    height = brentq(lambda z: drawing.kinematics.joint_values(at(z))["leg1_s3"] - shortest, -0.45, -0.20)
    assert off_m(drawing.locate(at(height - 1e-8))) < 1e-9
    with pytest.raises(UnreachablePoseError, match=r"'leg1_s3'.*limits"):
        drawing.locate(at(height + 1e-8))


@pytest.mark.parametrize("size_mrad", [0.0, 1e-9, 1e-6])
def test_zero_and_tiny_errors_move_nothing(size_mrad):
    """At most by 24 joints, each rotated about three axes, with levers and ratios of some metres, and by round-off."""
    assert off_m(with_errors(0.0, size_mrad, 0).locate(POSE)) <= 1e-12 + 24 * 3 * 10.0 * size_mrad * MRAD


@pytest.mark.parametrize("seed", range(4))
def test_50_mrad_everywhere_gives_the_same_one_at_a_time_and_in_an_array(seed):
    """Most do not close; those that do agree to a nanometre."""
    robot = with_errors(2.5, 50.0, seed)
    located = robot.locate([POSE])
    try:
        alone = robot.locate(POSE).difference("ladle_lip").translation_m
    except NoSolutionError:
        assert located.status.item() in ("out of reach", "left open too far")
        assert np.isnan(located.error_position).all()
        return
    assert located.status.item() == "closed"
    np.testing.assert_allclose(located.error_position.sel(frame="ladle_lip").values[0], alone, rtol=0.0, atol=1e-9)


def held_by(stiffness):
    given = Measured(leg_axial=stiffness, joint=stiffness, leg_torsion=stiffness, tilt_drive=stiffness)
    return load_stiffness().model_copy(update={"measured": given})


@pytest.mark.parametrize("stiffness", [1e-300, 1e-30, 1e-6, 1.0, 1e3])
def test_parts_too_soft_to_carry_the_ladle_do_not_close(as_built, stiffness):
    loaded = under_weight(as_built, stiffness_at(as_built, POSE, 500.0, held_by(stiffness)), 500.0)
    with pytest.raises(ClosureError, match="do not close"):
        loaded.locate(POSE)


def test_deflection_is_inverse_to_stiffness_and_zero_for_rigid_parts(as_built):
    """As stiffness grows by a factor, the deflection by weight shrinks by it, down to nothing."""
    rigid = under_weight(as_built, stiffness_at(as_built, POSE, 500.0, held_by(1e300)), 500.0).locate(POSE)
    added = []
    for stiffness in (1e8, 1e9, 1e10, 1e16, 1e20):
        loaded = under_weight(as_built, stiffness_at(as_built, POSE, 500.0, held_by(stiffness)), 500.0)
        lip = loaded.locate(POSE).difference("ladle_lip").translation_m
        added.append(float(np.linalg.norm(lip - rigid.difference("ladle_lip").translation_m)))
    assert added[0] > 1e-5
    assert added[1] / added[0] == pytest.approx(0.1, rel=0.05)
    assert added[2] / added[1] == pytest.approx(0.1, rel=0.05)
    assert max(added[3:]) < 1e-9


@pytest.mark.parametrize("payload_kg", [1e6, 1e30, 1e300])
def test_an_absurd_payload_is_refused_however_heavy(as_built, payload_kg):
    with pytest.raises(ClosureError, match="do not close"):
        under_weight(as_built, stiffness_at(as_built, POSE, payload_kg), payload_kg).locate(POSE)
