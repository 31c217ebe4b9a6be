"""Stiffness from parts against textbook figures, and the robot under weight against statics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import g

from pouring_robot.exceptions import DescriptionError
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring.stiffness import Measured, PartStiffness, load_stiffness
from pouring_robot.robot.pouring_under_weight import stiffness_at, under_weight

POSE = PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 10.0)


def stiffer(stiffness, part, factor):
    """Return the same with one part stiffer by a factor."""
    return replace(stiffness, **{part: getattr(stiffness, part) * factor})


def sag(robot, stiffness, payload_kg):
    closed = under_weight(robot, stiffness, payload_kg).forward(robot.kinematics.inverse(POSE), near=POSE)
    return np.array(closed.pose_base_to_end.translation) - np.array(POSE.position_m)


def test_parts_by_hand(drawing):
    stiffness = PartStiffness.of(drawing.layout, np.full(4, 0.62), 1700.0)
    # A steel bar of 46 mm and 0.5 m; a square bar of 24 mm on supports 140 mm apart; 46 mm of shaft, 0.5 m.
    assert stiffness.shares["spindle"] == pytest.approx(0.5 / (2.06e11 * np.pi * 0.023**2))
    assert stiffness.shares["gimbal"] == pytest.approx(0.14**3 / (48 * 2.06e11 * 0.024**4 / 12))
    assert stiffness.leg_torsion == pytest.approx(7.9e10 * np.pi * 0.023**4 / 2 / 0.5)
    along = ("spindle", "housing", "nut", "thrust bearing")
    assert stiffness.leg_axial == pytest.approx(1.0 / sum(stiffness.shares[name] for name in along))
    # Gearbox and leg 4, whose moment of 1 at the lower joint falls to 0 at the upper one: ∫ (1 - s/L)² ds / (E I).
    along_leg = (np.arange(62_000) + 0.5) * 1e-5
    inertia = np.where(along_leg < 0.5, 0.023**4, 0.048**4 - 0.028**4) * np.pi / 4
    bends = np.sum((1.0 - along_leg / 0.62) ** 2 / inertia) * 1e-5 / 2.06e11
    assert 1.0 / stiffness.tilt_drive == pytest.approx(1.0 / 3.0e5 + bends, rel=1e-4)
    # Palmgren: twice the load, 2^0.9 times the deflection.
    twice = PartStiffness.of(drawing.layout, np.full(4, 0.62), 3400.0)
    assert twice.shares["bearings"] == pytest.approx(stiffness.shares["bearings"] * 2.0**-0.1)


def test_measured_figures_replace_computed_ones(drawing, tmp_path):
    measured = Measured(leg_axial=1e8, joint=2e8, leg_torsion=3e4, tilt_drive=4e5)
    properties = load_stiffness().model_copy(update={"measured": measured})
    found = PartStiffness.of(drawing.layout, np.full(4, 0.6), 1700.0, properties)
    assert (found.joint, found.tilt_drive) == (2e8, 4e5)
    assert np.all(found.leg_axial == 1e8) and np.all(found.leg_torsion == 3e4)
    (tmp_path / "stiffness.yaml").write_text("steel: {}\n", encoding="utf-8")
    with pytest.raises(DescriptionError, match="youngs_modulus"):
        load_stiffness(tmp_path / "stiffness.yaml")


def test_rigid_parts_do_not_sag(drawing):
    stiffness = stiffness_at(drawing, POSE, 500.0)
    rigid = stiffness
    for part in ("leg_axial", "joint", "leg_torsion", "tilt_drive"):
        rigid = stiffer(rigid, part, 1e5)
    assert np.linalg.norm(sag(drawing, rigid, 500.0)) < 1e-5
    assert np.linalg.norm(sag(drawing, stiffness, 500.0)) > 1e-3


def test_a_leg_drive_deflects_under_its_force(drawing):
    """All but the leg drives is rigid, under the melt alone: Castigliano gives deflection and force of each drive."""
    soft = stiffness_at(drawing, POSE, 500.0)
    for part in ("joint", "leg_torsion", "tilt_drive"):
        soft = stiffer(soft, part, 1e5)
    rigid = stiffer(soft, "leg_axial", 1e5)
    moved = [sag(drawing, parts, payload)[2] for parts in (soft, rigid) for payload in (500.0, 0.0)]
    by_melt = (moved[0] - moved[1]) - (moved[2] - moved[3])
    drives = [f"drive.leg{i}_s3" for i in (1, 2, 3)]
    at_melt = drawing.transfer(POSE, drives, "ladle").to_numpy()
    at_o = drawing.transfer(POSE, drives, "moving_platform").to_numpy()
    turn = drawing.locate(POSE).nominal.pose("fixed_platform", "ladle").rotation
    lever = turn @ np.array([0.0, 0.0, -0.5 * drawing.layout.ladle.height.metres])
    rise = at_melt[2] + np.cross(at_melt[3:].T, lever)[:, 2]  # of the melt's centre, by drive
    force = -500.0 * g * rise
    assert by_melt == pytest.approx(float(at_o[2] @ (force / soft.leg_axial[:3])), rel=0.05)


def test_the_given_robot_is_unchanged(drawing):
    before = drawing.actual_solver
    loaded = under_weight(drawing, stiffness_at(drawing, POSE, 0.0), 0.0)
    assert drawing.actual_solver is before and loaded.actual_solver is not before
    assert replace(stiffness_at(drawing, POSE, 0.0), joint=1.0).joint == 1.0
