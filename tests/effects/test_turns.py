"""Harmonics of a joint's angle learned from another campaign: applied at its angles, faded out beyond them."""

import numpy as np
import pytest

from pouring_robot import RobotUnderConditions
from pouring_robot.effects.conditions import arcs_of
from pouring_robot.robot.effect_stack import EffectEntry, LearnedCampaign, ParameterEntry
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import robot_of
from tests.support import ROOT

ARM = RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml")
JOINT, *_ = ARM.definition.drives
TURN = 2.0 * np.pi
SHORTEST = TURN / 30  # thirty orders are searched
SINE = 1e-3
GAP = np.radians(15.0)


def apart(angles, others):
    """Return the distance of each angle (n,) from the nearest of the others, around the turn."""
    return np.abs((angles[:, None] - others + np.pi) % TURN - np.pi).min(axis=1)


def seen_by(model, angles):
    """Return what joint 1 adds to its command at angles (n,), and the notes."""
    under = RobotUnderConditions(robot_of(model), {})
    commands = np.zeros((len(angles), len(ARM.definition.drives)))
    commands[:, 0] = angles
    robots = under.robots(commands)
    offsets = [robot.model.drive_offset_values().get(JOINT.joint, 0.0) for robot in robots]
    return np.array(offsets), under.notes


def taught(seen_rad, order=1, form="turns"):
    """Return the arm with one wave of joint 1, learned at angles that lie in arcs."""
    learned = LearnedCampaign(
        seen_rad=seen_rad, sessions={"1": 9}, mean_span_m=[0.0] * 6, reference_temperature_degC=20.0
    )
    wave = {f"{JOINT.symbol}_sine_{order}": ParameterEntry(value=SINE / 1e-3, unit="mrad")}
    entry = EffectEntry(effect="joint_periodic", form=form, learned="then", parameters=wave)
    return ARM.model_copy(update={"effects": [entry], "learned": {"then": learned}})


@pytest.mark.parametrize("count", [1, 2, 30, 300, 3000])
def test_arcs_hold_every_angle_and_no_point_far_from_one(rng, count):
    angles = rng.uniform(-3.0 * TURN, 3.0 * TURN, count)
    arcs = arcs_of(angles)
    after = (angles[:, None] - np.array(arcs)[:, 0] + 1e-9) % TURN
    assert (after <= np.ptp(arcs, axis=1) + 2e-9).any(axis=1).all()
    points = np.concatenate([np.linspace(first, last, 1000) for first, last in arcs])
    assert apart(points, angles).max() <= GAP / 2.0 + 1e-12
    between = np.sort(angles % TURN)
    gaps = np.diff(between, append=between[0] + TURN) > GAP
    assert len(arcs) == max(gaps.sum(), 1)


def test_angles_over_a_whole_turn_are_one_arc():
    assert arcs_of(np.radians(np.arange(0.0, 360.0, 0.9))) == [(0.0, TURN)]


def test_in_a_gap_within_an_arc_a_random_walk_is_predicted_to_an_eighth_of_its_variance():
    """By the joint normal density of a closed walk's values at both ends and in the middle, its orders summed."""
    orders = np.arange(1.0, 20000.0)
    ways = np.array([[0.0, GAP, GAP / 2.0], [GAP, 0.0, GAP / 2.0], [GAP / 2.0, GAP / 2.0, 0.0]])
    shared = (np.cos(ways[..., None] * orders) / orders**2).sum(axis=-1)
    left = shared[2, 2] - shared[2, :2] @ np.linalg.solve(shared[:2, :2], shared[:2, 2])
    assert 0.11 < left / shared[2, 2] < 0.125


def test_a_wave_learned_at_random_angles_is_applied_whole_between_them(rng):
    angles = rng.uniform(-2.9, 2.9, 200)
    offsets, notes = seen_by(taught({JOINT.joint: arcs_of(rng.uniform(-3.0, 3.0, 150))}), angles)
    np.testing.assert_allclose(offsets, SINE * np.sin(angles), rtol=0.0, atol=1e-12)
    assert notes == ()


def test_arcs_of_a_file_that_are_near_each_other_are_merged(rng):
    """Older files separate angles a degree apart: between them the wave is whole, up to gaps of 15 degrees."""
    seen = rng.uniform(-3.0, 3.0, 150)
    angles = rng.uniform(-2.9, 2.9, 200)
    offsets, notes = seen_by(taught({JOINT.joint: [(angle, angle) for angle in seen.tolist()]}), angles)
    np.testing.assert_allclose(offsets, SINE * np.sin(angles), rtol=0.0, atol=1e-12)
    assert notes == ()
    for degrees, share in ((14.9, 1.0), (15.1, 0.0)):
        gap = np.radians(degrees)
        model = taught({JOINT.joint: [(-1.0, 0.5 - gap / 2.0), (0.5 + gap / 2.0, 2.0)]})
        assert seen_by(model, np.array([0.5]))[0] == pytest.approx(share * SINE * np.sin(0.5), abs=1e-12)


def test_a_wave_is_whole_where_it_was_learned_and_fades_over_a_quarter_of_the_shortest_one(rng):
    """Angles that differ by whole turns are equal."""
    seen = np.linspace(-0.4, 1.2, 400)
    angles = rng.uniform(-3.0, 3.0, 60)
    offsets, _ = seen_by(taught({JOINT.joint: arcs_of(seen + rng.choice([-TURN, 0.0, TURN], 400))}), angles)
    beyond = np.maximum(np.maximum(angles - 1.2, -0.4 - angles), 0.0)
    share = np.maximum(1.0 - beyond / (SHORTEST / 4.0), 0.0)
    assert 0 < np.count_nonzero((share > 0.0) & (share < 1.0)) < np.count_nonzero(share == 1.0)
    np.testing.assert_allclose(offsets, SINE * np.sin(angles) * share, rtol=0.0, atol=1e-12)


def test_an_eccentric_disc_is_applied_farther_than_waves_of_every_order(rng):
    """With orders one and two its shortest wave is half a turn: whole in gaps of half that, gone a quarter beyond."""
    angles = rng.uniform(-3.0, 3.0, 60)
    seen = [(-0.8, 0.3), (0.3 + 0.249 * TURN, 2.0)]
    offsets, notes = seen_by(taught({JOINT.joint: seen}, form=f"{JOINT.symbol}_once"), angles)
    beyond = np.maximum(np.maximum(angles - 2.0, -0.8 - angles), 0.0)
    share = np.maximum(1.0 - beyond / (TURN / 8.0), 0.0)
    assert 0 < np.count_nonzero((share > 0.0) & (share < 1.0)) < np.count_nonzero(share == 1.0)
    np.testing.assert_allclose(offsets, SINE * np.sin(angles) * share, rtol=0.0, atol=1e-12)
    assert f"{np.count_nonzero(share == 0.0)} of 60 rows" in "".join(notes)


def test_rows_where_the_wave_is_taken_as_zero_are_reported():
    model = taught({JOINT.joint: [(0.0, 1.0)]})
    offsets, notes = seen_by(model, np.array([0.5, 2.0, 3.0]))
    assert (offsets != 0.0).tolist() == [True, False, False]
    assert notes == (
        f"joint_periodic of {JOINT.words} was not learned at the angles of 2 of 3 rows: taken as zero there",
    )
    assert seen_by(model, np.array([0.5]))[1] == ()
    assert seen_by(model, np.array([2.0]))[1][0].endswith("at the angles of this pose: taken as zero there")


def test_without_arcs_in_the_file_a_wave_is_applied_everywhere():
    angles = np.linspace(-3.0, 3.0, 7)
    offsets, notes = seen_by(taught({}), angles)
    np.testing.assert_allclose(offsets, SINE * np.sin(angles), rtol=0.0, atol=1e-12)
    assert notes == ()
