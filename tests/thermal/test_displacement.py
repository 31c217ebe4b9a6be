"""How far every part moves: rigid motion, growth and weight against closed forms."""

import numpy as np
import pytest

from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.loaded import stiffness_at, under_weight
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.thermal.expansion.displacement import DisplacementField
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot

POSE = PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 10.0)
PARTS = ("fixed_platform", *LEGS, "platform", "ladle")


@pytest.fixture(scope="module")
def state(drawing):
    return HeatedRobot(drawing, HeatSection(melt_degC=1700.0)).locate(POSE)


def test_ends_of_legs_are_the_grown_joints(drawing, state):
    field, expansion = DisplacementField.of(state), state.robot.expansion
    names = np.array(field.parts)
    assert tuple(dict.fromkeys(field.parts)) == PARTS
    pose = state.result.pose_base_to_end
    for k, leg in enumerate(LEGS):
        rows = np.flatnonzero(names == leg)
        upper, lower = drawing.kinematics.fixed_centres_m[k], drawing.kinematics.moving_centres_m[k]
        assert field.points_m[rows[0]] == pytest.approx(upper)
        assert field.moved_m[rows[0]] == pytest.approx(expansion.fixed_platform_strain * upper)
        foot = pose.act(lower * (1.0 + expansion.platform_strain))
        assert field.points_m[rows[-1]] + field.moved_m[rows[-1]] == pytest.approx(foot, abs=1e-12)
        if k == 3:
            continue  # passive: it takes whatever length the others leave it
        cold = np.linalg.norm(field.points_m[rows[-1]] - field.points_m[rows[0]])
        warm = np.linalg.norm(foot - upper * (1.0 + expansion.fixed_platform_strain))
        assert warm / cold - 1.0 == pytest.approx(expansion.leg_strain[k], abs=1e-6)


def test_a_hotter_ladle_adds_its_own_growth(state):
    cool, hot = DisplacementField.of(state), DisplacementField.of(state, 500.0)
    ladle = np.array(cool.parts) == "ladle"
    assert np.array_equal(cool.moved_m[~ladle], hot.moved_m[~ladle])
    rim = np.flatnonzero(ladle)[:16]
    more = hot.moved_m[rim] - cool.moved_m[rim]
    shell = state.field.shell_degC
    # Opposite points of the rim part by α ΔT times the diameter.
    spread = np.linalg.norm(more[0] - more[8])
    assert spread == pytest.approx(1.2e-5 * (500.0 - shell) * 0.7, rel=1e-3)
    assert hot.largest_m > cool.largest_m > cool.mean_m
    from_o = DisplacementField.of(state, 500.0, ladle_from_o=True)
    assert from_o.largest_m > hot.largest_m


def test_weight_alone_and_both(drawing, state):
    loaded = under_weight(drawing, stiffness_at(drawing, POSE, 500.0), 500.0)
    weight, both = (DisplacementField.of(HeatedRobot(loaded, heat).locate(POSE)) for heat in (None, HeatSection()))
    fixed = np.array(weight.parts) == "fixed_platform"
    assert np.abs(weight.moved_m[fixed]).max() == 0.0 and np.abs(both.moved_m[fixed]).max() > 0.0
    heat = DisplacementField.of(state)
    missed = np.linalg.norm(both.moved_m - weight.moved_m - heat.moved_m, axis=1).max()
    assert missed < 0.15 * both.largest_m
    assert set(both.by_part) == set(PARTS) and len(both.to_frame()) == len(both.parts)
