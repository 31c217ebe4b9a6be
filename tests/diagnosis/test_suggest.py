"""What to measure next: the value of a set against closed forms; measuring it does distinguish the effects."""

import dataclasses
import functools
import json

import numpy as np
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import read_plan
from pouring_robot.diagnosis.diagnose import DiagnosisOptions, diagnose
from pouring_robot.diagnosis.diagnoser import Diagnoser
from pouring_robot.diagnosis.library import Library
from pouring_robot.diagnosis.report.sentences import next_lines
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.diagnosis.suggest.candidates import PredictedMeasurements, candidates
from pouring_robot.diagnosis.suggest.next_measurements import (
    RANDOM_SETS,
    SuggestedMeasurement,
    Suggestion,
    separating_words,
    suggest_measurements,
    untestable_words,
)
from pouring_robot.effects.available import chosen_effects
from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.discrimination import Prediction, choose, divergence, expected, total
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from tests.diagnosis.hidden import campaign
from tests.diagnosis.remeasured import Machine
from tests.examples.campaigns import write
from tests.examples.machines import MACHINES
from tests.rig import Wanted
from tests.support import ROOT

DELTA = ROOT / "examples" / "robots" / "delta" / "robot.yaml"
TRAPS = {
    "one_side": ("drive_backlash", "both sides"),
    "constant_temperature": ("leg_thermal_expansion", "two temperatures of the legs"),
    "tilt_held": ("tilt_encoder_eccentricity", "whole range"),
    "slow_travel": ("truss_deflection", "ends and in the middle of the rails"),
}


def prediction(random, size, spread=1.0):
    columns = random.normal(size=(size, 4)) * spread
    return Prediction(random.normal(size=size), columns @ columns.T + np.eye(size))


def test_variation_within_a_turn_of_the_screw_is_distinguished_at_its_own_scale(tmp_path):
    """The scale is the one at which it was found: the longest one would explain next to nothing."""
    turning = campaign(tmp_path, (Wanted("drive_cyclic", 5.0, "a"),), rows=60)
    found = diagnose(turning, None, DiagnosisOptions(exclude="drive_cyclic"))
    (described,) = {s.process.words for s in found.judgement.structures[:1]}
    assert described.endswith("depending on own length")
    assert described in {name for s in found.suggestion.separations for name in (s.first, s.second)}


def test_a_robot_commanded_by_drives_gets_suggestions_in_drives(tmp_path):
    """In words and in a plan that can be run: a position alone does not determine the posture of an arm."""
    robot = Robot.load(DELTA)
    drives = np.array([0.3, -0.2, 0.1])
    pose = robot.location_at(drives).nominal.pose_base_to_end
    names = ("drive_backlash", "drive_scale")
    one = SuggestedMeasurement(robot.model.definition, pose, drives, {"approach_q1": 1.0}, 2.0, 1, names, 3.0)
    (tmp_path / "next.csv").write_text(Suggestion((one,), (), 3.0).plan_text(), encoding="utf-8")
    np.testing.assert_allclose(read_plan(tmp_path / "next.csv", robot).drives, [drives], rtol=0, atol=1e-8)
    assert one.words.startswith("q1 17.19°, q2 -11.46°, q3 5.73°, at x ") and one.words.endswith(", approached q1 +")
    sides = {f"approach_{drive.column}": side for drive, side in zip(one.robot.drives, (1.0, -1.0, 1.0), strict=True)}
    assert dataclasses.replace(one, conditions=sides).words.endswith(", approached +-+")


def test_expected_evidence_between_two_means_is_half_the_squared_distance():
    random = np.random.default_rng(1)
    first = prediction(random, 6)
    second = Prediction(first.mean + np.arange(6.0), first.covariance)
    distance = np.arange(6.0) @ np.linalg.solve(first.covariance, np.arange(6.0))
    assert divergence(first, second) == pytest.approx(0.5 * distance, rel=1e-12)
    assert divergence(first, first) == pytest.approx(0.0, abs=1e-12)


def test_expected_evidence_is_the_mean_log_evidence_of_draws():
    random = np.random.default_rng(2)
    right, other = prediction(random, 3), prediction(random, 3)
    drawn = random.multivariate_normal(right.mean, right.covariance, 200_000)

    def log_density(p):
        apart = drawn - p.mean
        return -0.5 * ((apart @ np.linalg.inv(p.covariance) * apart).sum(axis=1) + np.linalg.slogdet(p.covariance)[1])

    assert divergence(right, other) == pytest.approx((log_density(right) - log_density(other)).mean(), rel=0.02)


def test_gains_of_single_measurements_sum_to_the_expected_evidence_of_the_set():
    random = np.random.default_rng(3)
    predictions = [prediction(random, 60, 3.0) for _ in range(3)]
    pairs = [(0, 1), (0, 2)]
    found = choose(predictions, pairs, 3, 7)
    assert len(set(found.chosen.tolist())) == 7
    together = expected(predictions, pairs, 3, found.chosen)
    np.testing.assert_allclose(found.gains.sum(axis=0), together, rtol=1e-9)


def test_an_indistinguishable_pair_does_not_hide_the_others():
    random = np.random.default_rng(5)
    first, other = prediction(random, 30), prediction(random, 30, 3.0)
    alone = choose([first, other], [(0, 1)], 3, 5)
    beside = choose([first, other, first], [(0, 1), (0, 2)], 3, 5)
    assert beside.chosen.tolist() == alone.chosen.tolist()
    assert total(np.array([[3.0, 3.0], [8.0, 0.0]])).tolist() == pytest.approx([3.0, 2.0])


def test_first_choice_is_the_best_single_measurement():
    random = np.random.default_rng(4)
    predictions = [prediction(random, 60) for _ in range(3)]
    pairs = [(0, 1), (0, 2), (1, 2)]
    found = choose(predictions, pairs, 3, 1)
    worth = [total(expected(predictions, pairs, 3, np.array([k]))) for k in range(20)]
    assert found.chosen[0] == int(np.argmax(worth))


@pytest.fixture(scope="module")
def trapped(tmp_path_factory):
    """Return the machine of a trap and the diagnosis of its measurements, which is made once."""

    @functools.cache
    def of(trap):
        machine = Machine(TRAPS[trap][0], "a", trap)
        return machine, diagnose(machine.measured(tmp_path_factory.mktemp(trap)))

    return of


@pytest.mark.parametrize("trap", TRAPS)
def test_measuring_what_is_suggested_distinguishes_confounded_effects(trap, trapped, tmp_path):
    effect, words = TRAPS[trap]
    machine, before = trapped(trap)
    assert before.judgement.verdict == "group"
    cause = before.judgement.causes[0]
    assert effect in {cause.effect, *cause.alternatives}

    found = suggest_measurements(before)
    assert 1 <= len(found.measurements) <= 10
    assert any(words in s.how for s in found.separations)
    assert len(found.random_nats) == RANDOM_SETS
    assert found.expected_nats > 3.0
    assert found.expected_nats > np.median(found.random_nats)

    again = machine.measured(tmp_path / "after", machine.with_more(found.measurements))
    worth = [worth_alone(measured, before.noise) for measured in (before.campaign, again)]
    for rival in {cause.effect, *cause.alternatives} - {effect}:
        ahead = [best(effect) - best(rival) for best in worth]
        assert ahead[1] > ahead[0] + 3.0
    after = diagnose(again)
    assert [c.effect for c in after.judgement.causes] == [effect]
    assert set(after.judgement.causes[0].alternatives) < {cause.effect, *cause.alternatives}


@pytest.mark.parametrize("trap", ["constant_temperature", "tilt_held"])
def test_few_informative_rows_are_no_gross_errors(trap, trapped, tmp_path):
    """They are far from all that the others predict; but no other row was measured as they are."""
    effect, _ = TRAPS[trap]
    machine, before = trapped(trap)
    suggested = suggest_measurements(before, count=4)
    after = diagnose(machine.measured(tmp_path / "after", machine.with_more(suggested.measurements)))
    assert after.left_out.size == 0
    assert [(c.effect, c.alternatives) for c in after.judgement.causes] == [(effect, ())]


def worth_alone(campaign, noise):
    """Return a function for how much better an effect alone explains all rows than nothing does, in nats."""
    rows = CampaignRows(campaign, RobotModel(), noise)
    library = Library.of(rows, chosen_effects())
    diagnoser = Diagnoser(rows, library, np.ones(len(rows), dtype=bool))
    problem = diagnoser.problem_at(diagnoser.at_rest())
    nothing = Hypothesis.nothing(problem)
    return lambda name: max(
        nothing.candidate_bayes_factor(item).evidence for item in problem.explanations if item.effect == name
    )


@pytest.fixture(scope="module")
def confounded(trapped):
    return trapped("one_side")[1]


@pytest.fixture(scope="module")
def four(confounded):
    """What to measure next, with time for four measurements."""
    return suggest_measurements(confounded, count=4, seed=5)


def test_suggestions_can_be_commanded_and_written(confounded, four):
    found = four
    assert len(found.measurements) == 4
    robot = PouringRobot(confounded.model)
    lower, upper = (corner[:3] for corner in robot.layout.box)
    hours = [m.hours_later for m in found.measurements]
    assert hours == sorted(hours) and hours[0] > 0.0
    for row in json.loads(json.dumps([m.figures() for m in found.measurements], allow_nan=False)):
        pose = PlatformPose.from_mm_deg(*(row["pose"][name] for name in ("x_mm", "y_mm", "z_mm", "tilt_deg")))
        assert np.all(np.array(pose.position_m) >= lower) and np.all(np.array(pose.position_m) <= upper)
        commanded = list(robot.kinematics.inverse(pose).values())
        stated = [*(1e-3 * row["drives"][f"q{k}_mm"] for k in (1, 2, 3)), row["drives"]["q4_rad"]]
        np.testing.assert_allclose(stated, commanded, atol=5e-6)
        assert {row["conditions"][f"approach_q{k}"] for k in (1, 2, 3, 4)} <= {-1.0, 1.0}
        assert 0.0 <= row["conditions"]["payload_kg"] <= 500.0
        assert row["expected_nats"] > 0.0
    assert len({m.rank for m in found.measurements}) == 4


def test_a_request_for_no_measurements_gives_no_pairs_either(confounded, four):
    """The pairs were there, each with "no pose tells them apart", though four measurements do."""
    assert four.separations
    none = suggest_measurements(confounded, count=0)
    assert (none.measurements, none.separations, none.failed) == ((), (), "")
    for count in (-1, 1.5, "3"):
        with pytest.raises(
            BadInputError, match="the number of measurements to suggest must be a whole number from 0 on, not"
        ):
            suggest_measurements(confounded, count)


def test_same_seed_same_suggestion(confounded):
    one, other = suggest_measurements(confounded, seed=7), suggest_measurements(confounded, seed=7)
    assert one.figures() == other.figures()
    assert [m.figures() for m in one.measurements] == [m.figures() for m in other.measurements]
    assert one.figures() != suggest_measurements(confounded, seed=8).figures()


@pytest.mark.parametrize(("made", "verdict"), [("nothing", "no_gap"), ("excluded", "unknown"), ("hot", "named")])
def test_every_verdict_has_something_to_distinguish(made, verdict, request):
    diagnosis = request.getfixturevalue(made)
    assert diagnosis.judgement.verdict == verdict
    found = diagnosis.suggestion
    assert found.measurements and found.separations
    assert found.expected_nats > np.median(found.random_nats)
    assert all(s.first != s.second for s in found.separations)


@pytest.mark.parametrize(
    ("now", "more", "says"),
    [(48.0, 0.9, "no measurement is needed"), (48.0, 3.5, "1 measurement to"), (2.0, 0.9, "1 measurement to")],
)
def test_measurements_that_add_little_to_what_is_known_are_not_listed(hot, monkeypatch, now, more, says):
    """The yardstick is the 3 nats of odds that the line itself names."""
    known = dataclasses.replace(hot.suggestion.separations[0], now_nats=now, expected_nats=more)
    few = dataclasses.replace(
        hot.suggestion, measurements=hot.suggestion.measurements[:1], separations=(known,), expected_nats=more
    )
    monkeypatch.setitem(vars(hot), "suggestion", few)
    (line, *listed) = next_lines(hot)
    assert line.startswith(says) and f" {more}" in line
    assert bool(listed) == says.startswith("1")
    assert f"{now:.0f} nats apart or more, and 1 measurement would" in line or listed


def test_no_weights_are_suggested_where_gravity_cannot_act_on_upright_axes(tmp_path):
    write(tmp_path, MACHINES["five_bar"], seed=3, effect="null")
    model = RobotModel.for_robot(ROOT / "examples" / "robots" / "five_bar" / "robot.yaml")
    found = diagnose(Campaign.read(tmp_path / "campaign.csv", model.definition).subset(np.arange(40)), model)
    hidden = [line for line in next_lines(found) if line.startswith("could be present but hidden: ")]
    assert hidden and not any("drive_compliance" in line or "empty and full" in line for line in hidden)


def test_columns_that_new_rows_do_not_change_share_memory(confounded):
    prospect = PredictedMeasurements(confounded, candidates(confounded.rows.campaign, confounded.model, 10, 0))
    before = {item.key: item.columns for item in confounded.hypothesis.problem.explanations}
    same = {
        item.effect: np.shares_memory(item.columns, before[item.key])
        for item in prospect.problem.explanations
        if item.key in before
    }
    assert same["joint_centre_offset"] and same["joint_axis_tilt"] and same["drive_scale"]
    assert not same["base_drift"]  # its columns depend on the times of all rows, and new rows come hours later


def test_sides_of_approach_are_suggested_for_the_drives_for_which_a_campaign_has_them(confounded):
    campaign = confounded.rows.campaign
    partly = np.where(np.arange(4) == 1, np.ones((len(campaign), 4)), np.nan)
    for sides, told in ((partly, [False, True, False, False]), (None, None)):
        found = candidates(dataclasses.replace(campaign, approach=sides), confounded.model, 10, 0).approach
        assert (found if found is None else np.isfinite(found).all(axis=0).tolist()) == told


def test_no_melt_is_suggested_in_an_empty_ladle(confounded):
    """Parts may still be hot just after it was poured out."""
    asked = candidates(confounded.rows.campaign, confounded.model, 60, 0).conditions
    empty = asked["payload"] == 0.0
    assert empty.any() and not (asked["melt"][empty] > 100.0).any() and (asked["melt"] > 100.0).any()
    assert (asked["leg1"][empty] > 100.0).any()


def test_words_name_what_the_campaign_held_constant(confounded):
    conditions = confounded.rows.conditions
    effects = chosen_effects()
    words = separating_words("drive_zero_offset", "drive_backlash", effects, conditions)
    assert words == "measure the same poses from both sides of every drive"
    assert "hours later" in separating_words("base_drift", "metrology_scale", effects, conditions)
    by_pose = "joint_centre_offset", "joint_axis_tilt"
    assert "workspace" in separating_words(*by_pose, effects, conditions)
    assert separating_words(*by_pose, effects, conditions, tells=False).startswith("no pose distinguishes them")
    assert "hours later" in separating_words("base_drift", "metrology_scale", effects, conditions, tells=False)


def test_a_condition_to_be_recorded_is_named_once():
    lines = untestable_words(
        {"leg_compliance": ("legs_force",), "tilt_drive_compliance": ("tilt_force",)}, RobotModel().definition
    )
    assert len(lines) == 1 and "payload_kg" in lines[0] and "leg_compliance, tilt_drive_compliance" in lines[0]
