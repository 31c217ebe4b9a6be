"""Sessions with separate frames: the Jacobian by differences, and calibrations as good as from one place."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.campaign.metadata import PER_SESSION
from pouring_robot.campaign.plan import random_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.checks.check import check_campaign
from pouring_robot.checks.flags import FlagCode, Severity
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.estimation.frames.sessions import session_parameters
from pouring_robot.estimation.map_fit import seen_from_one_place
from pouring_robot.estimation.measurement import MeasurementModel, Unknowns
from pouring_robot.exceptions import CalibrationError, CampaignError
from pouring_robot.mechanism.rotations import rotation_matrices, rotation_vectors
from pouring_robot.robot.model import DriveOffset, RobotModel
from pouring_robot.robot.pouring_robot import robot_of
from tests.support import ROOT

MODELS = {
    "arm": RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml").model_copy(
        update={"drive_offsets": {"joint2": DriveOffset(offset_mrad=2.0), "joint5": DriveOffset(offset_mrad=-1.5)}}
    ),
    "pouring": RobotModel(
        drive_offsets={"leg1_s3": DriveOffset(offset_mm=0.8), "leg4_s5": DriveOffset(offset_mrad=1.2)}
    ),
}


def bare(model):
    return model.model_copy(update={"drive_offsets": {}, "joint_placements": {}})


def pose(random, reach_m):
    turn = random.normal(size=3)
    return pin.SE3(
        pin.exp3(turn / np.linalg.norm(turn) * random.uniform(0.1, 3.0)), random.uniform(-reach_m, reach_m, 3)
    )


def moved(campaign, seed, names=("a", "b", "c")):
    """Return the same poses as seen by a tracker that is set up elsewhere in each of three sessions."""
    random, count = np.random.default_rng(seed), len(campaign)
    sessions = tuple(names[k * len(names) // count] for k in range(count))
    position, rotation = np.array(campaign.position_m), rotation_matrices(campaign.rotation_vector_rad)
    for name in names:
        place, rows = pose(random, 4.0), np.flatnonzero([own == name for own in sessions])
        position[rows] = position[rows] @ place.rotation.T + place.translation
        rotation[rows] = place.rotation @ rotation[rows]
    metadata = campaign.metadata.model_copy(update={"frames": PER_SESSION})
    changed = {"position_m": position, "rotation_vector_rad": rotation_vectors(rotation), "sessions": sessions}
    return dataclasses.replace(campaign, metadata=metadata, **changed)


def measured(name, count, seed):
    robot = robot_of(MODELS[name])
    options = MeasurementOptions(3e-5, 3e-5, seed=seed)
    return simulate_campaign(robot, random_plan(robot, count, seed), options).campaign


@pytest.mark.parametrize("name", MODELS)
def test_the_jacobian_is_the_derivative(name):
    """By frames, drives and all sessions, away from zero, against central differences of the prediction."""
    campaign = moved(measured(name, 9, 1), 1)
    model, random = bare(MODELS[name]), np.random.default_rng(2)
    drives = robot_of(model).parameters.drives
    measurement = MeasurementModel(model, drives, sessions=session_parameters(campaign))
    rows = measurement.at(campaign.drives, sessions=campaign.sessions)
    start = OuterFrames(pose(random, 2.0), pose(random, 0.1))
    zero = Unknowns.zero(start, len(measurement.names) - 12)
    here = zero.at(random.uniform(-0.02, 0.02, zero.values.size))
    found, step = rows.linearise(here).jacobian, 1e-5
    for k in range(zero.values.size):
        aside = step * np.eye(zero.values.size)[k]
        plus, minus = (rows.predict(here.at(here.values + sign * aside)) for sign in (1.0, -1.0))
        column = plus.difference(minus) / (2.0 * step)
        # Differences err by step² times the third derivative, which is at most a few metres.
        np.testing.assert_allclose(found[:, :, k], column, rtol=0, atol=3e-8)
    assert set(np.unique(rows.session)) == {-1, 0, 1}


@pytest.mark.parametrize("name", MODELS)
def test_calibration_is_as_good_as_from_one_place(name):
    """Held-out errors are as small, and the drive offset is found within its interval."""
    one = measured(name, 60, 3)
    options = CalibrationOptions(parameters=("drives",))
    found = [calibrate(campaign, bare(MODELS[name]), options) for campaign in (one, moved(one, 3))]
    alone, apart = (np.nanstd(fit.after[fit.split.test][:, :3]) for fit in found)
    assert apart < 1.25 * alone
    truth = MODELS[name].drive_offset_values()
    table = found[1].to_frame().set_index("parameter")
    for drive, value in truth.items():
        line = table.loc[f"drive.{drive}"]
        assert abs(line["value"] - 1e3 * value) < 4.0 * line["std"]
    # Six unknowns per session cost something, never less than nothing.
    before = found[0].to_frame().set_index("parameter")
    assert (table["std"] > 0.99 * before["std"].reindex(table.index)).all()


@pytest.mark.parametrize("names", ["abcdefg", "abcdefghij"])
def test_a_session_in_one_block_only_adds_nothing_to_the_scatter(names):
    """Its frame would be undetermined: with more sessions than blocks the tool's uncertainty was 0.75, not 0.03 mm."""
    campaign = moved(measured("arm", 120, 3), 3, tuple(names))
    silent = campaign.metadata.model_copy(update={"sigma_position_m": None, "sigma_rotation_rad": None})
    options = CalibrationOptions(parameters=("drives",), choose=False)
    told = [
        calibrate(dataclasses.replace(campaign, metadata=metadata), bare(MODELS["arm"]), options).ladle.std_m.max()
        for metadata in (campaign.metadata, silent)
    ]
    assert told[0] <= told[1] < 3.0 * told[0]


def test_far_setups_are_brought_together_despite_outliers():
    """The largest session stays; the others are brought to it within the noise and the robot's errors."""
    campaign = measured("arm", 60, 4)
    position = np.array(campaign.position_m)
    position[50] += 0.05
    spoilt = moved(dataclasses.replace(campaign, position_m=position), 4)
    together = seen_from_one_place(spoilt, MODELS["arm"])
    largest = np.array(spoilt.sessions) == "a"
    np.testing.assert_array_equal(together.position_m[largest], spoilt.position_m[largest])
    # The tracker of the first session, against that of the campaign from which all were moved.
    place = np.linalg.lstsq(np.c_[position[largest], np.ones(20)], spoilt.position_m[largest], rcond=None)[0]
    wanted = np.c_[position, np.ones(60)] @ place
    assert np.abs(together.position_m - wanted).max() < 3e-4


def test_the_check_suggests_the_missing_entry_of_the_file():
    campaign = moved(measured("arm", 60, 6), 6)
    told = dataclasses.replace(campaign, metadata=campaign.metadata.model_copy(update={"frames": "one"}))
    drawing = MODELS["arm"].definition.drawing()
    (error,) = (flag for flag in check_campaign(told, drawing) if flag.severity != Severity.NOTE)
    assert error.code == FlagCode.APART_SESSIONS
    assert "frames: per session" in error.remedy
    assert not [flag for flag in check_campaign(campaign, drawing) if flag.severity != Severity.NOTE]


def test_data_without_noise_do_not_look_like_a_remounted_target():
    robot = robot_of(bare(MODELS["arm"]))
    options = MeasurementOptions(1e-12, 1e-12, seed=3)
    campaign = moved(simulate_campaign(robot, random_plan(robot, 90, 3), options).campaign, 3)
    codes = {flag.code for flag in check_campaign(campaign, robot.model.definition.drawing())}
    assert FlagCode.TARGET_MOVED not in codes


@pytest.mark.parametrize(("name", "frames"), [("arm", "one"), ("pouring", "one"), ("arm", PER_SESSION)])
def test_a_remounted_target_is_detected_between_sessions(name, frames):
    """From the middle on it sits elsewhere, which no position of the tracker explains."""
    campaign = measured(name, 90, 6)
    drawing, later = MODELS[name].definition.drawing(), np.arange(90) >= 45
    metadata = campaign.metadata.model_copy(update={"frames": frames})
    sessions = tuple("b" if anew else "a" for anew in later)

    def told(shift_m, turn_rad):
        position, rotation = np.array(campaign.position_m), rotation_matrices(campaign.rotation_vector_rad)
        position[later] += rotation[later] @ shift_m
        rotation[later] = rotation[later] @ pin.exp3(np.array([0.0, 0.0, turn_rad]))
        changed = {"position_m": position, "rotation_vector_rad": rotation_vectors(rotation), "sessions": sessions}
        found = check_campaign(dataclasses.replace(campaign, metadata=metadata, **changed), drawing)
        return {flag.severity for flag in found if flag.code is FlagCode.TARGET_MOVED}

    assert not told(np.zeros(3), 0.0)
    assert told(np.array([0.022, 0.022, 0.0]), 0.0) == {Severity.WARNING}
    assert told(np.array([0.0, 0.06, 0.0]), 0.7) == {Severity.ERROR}  # nothing fits with it


def test_sessions_that_cannot_be_located_are_refused():
    campaign = measured("arm", 60, 5)
    few = dataclasses.replace(moved(campaign, 5), sessions=("a",) * 56 + ("b",) * 4)
    with pytest.raises(CampaignError, match="session 'b' has fewer than"):
        seen_from_one_place(few, bare(MODELS["arm"]))
    each = dataclasses.replace(few, sessions=tuple(str(k) for k in range(60)))
    with pytest.raises(CampaignError, match="session '0' has fewer than"):
        seen_from_one_place(each, bare(MODELS["arm"]))
    with pytest.raises(CalibrationError, match="--hold-out region"):
        calibrate(moved(campaign, 5), bare(MODELS["arm"]), CalibrationOptions(("drives",), hold_out="session"))


def test_a_distance_is_from_another_row_of_the_same_session():
    """The device has another position in each session, and so has the point from which other distances are measured."""
    campaign = moved(measured("arm", 60, 5), 5)
    samples, model = tuple(map(str, range(60))), bare(MODELS["arm"])
    line = np.linalg.norm(np.roll(campaign.position_m, -1, axis=0) - campaign.position_m, axis=1)[:, None]
    line[19::20] = np.nan
    within = dataclasses.replace(campaign, samples=samples, distance_m=line, distance_from=(*samples[1:], ""))
    np.testing.assert_array_equal(seen_from_one_place(within, model).distance_m, line)
    line[21] = 1.0
    for start in ("", "3"):
        labels = (*within.distance_from[:21], start, *within.distance_from[22:])
        with pytest.raises(CampaignError, match="where each session has a frame of its own, a distance") as caught:
            seen_from_one_place(dataclasses.replace(within, distance_m=line, distance_from=labels), model)
        assert (caught.value.line, caught.value.column) == (23, within.heading("distance"))


def test_sessions_that_are_apart_are_detected_with_distances_as_well():
    campaign = moved(measured("arm", 60, 6), 6)
    told = {"metadata": campaign.metadata.model_copy(update={"frames": "one", "sigma_distance_m": 5e-5})}
    line = np.linalg.norm(campaign.position_m, axis=1)[:, None]
    flags = check_campaign(dataclasses.replace(campaign, distance_m=line, **told), MODELS["arm"].definition.drawing())
    assert FlagCode.APART_SESSIONS in {flag.code for flag in flags}


@pytest.mark.parametrize("name", MODELS)
def test_a_diagnosis_takes_unknown_tracker_positions_of_sessions_into_account(name):
    """Sessions are aligned with a robot that has errors; the shifts this causes are neither named nor compensated."""
    robot = robot_of(MODELS[name])
    plan, options = random_plan(robot, 36, 5), MeasurementOptions(3e-5, 3e-5, seed=5)
    found = diagnose(moved(simulate_campaign(robot, plan, options).campaign, 5), bare(MODELS[name]))
    assert [effect.cause.effect for effect in found.effects] == ["drive_zero_offset"]
    truth = {f"drive.{drive}": 1e3 * value for drive, value in MODELS[name].drive_offset_values().items()}
    values = {next(iter(p.parameter.changes)): p for _, p in found.parameters_of(found.effects[0])}
    for channel, value in truth.items():
        assert abs(values[channel].value - value) < 4.0 * values[channel].std
    assert found.held_out.position("after") < 1.5 * found.held_out.position("floor")


def test_sessions_with_distances_between_their_rows_only_need_no_frame():
    """Such distances do not depend on the frame; the frame of a session with positions is the campaign's."""
    campaign = moved(measured("arm", 60, 7), 7)
    position, sessions = np.array(campaign.position_m), np.array(campaign.sessions)
    before = np.roll(np.arange(60), 1)
    for told in ((), ("a",)):
        placed = np.isin(sessions, told)
        between = ~placed & (sessions == sessions[before])
        lines = dataclasses.replace(
            campaign,
            samples=tuple(map(str, range(60))),
            position_m=np.where(placed[:, None], position, np.nan),
            rotation_vector_rad=None,
            distance_m=np.where(between, np.linalg.norm(position - position[before], axis=1), np.nan)[:, None],
            distance_from=tuple(str(row) if use else "" for row, use in zip(before, between, strict=True)),
        )
        assert seen_from_one_place(lines, bare(MODELS["arm"])) is lines
        assert session_parameters(lines) == ()
        found = calibrate(lines, bare(MODELS["arm"]), CalibrationOptions(("drives",), choose=False))
        line = found.to_frame().set_index("parameter").loc["drive.joint2"]
        assert line["std"] < 0.1 and abs(line["value"] - 2.0) < 4.0 * line["std"]
    fixed = dataclasses.replace(lines, distance_from=("",) * 60)
    with pytest.raises(CampaignError, match="a distance is from another row of the same session"):
        seen_from_one_place(fixed, bare(MODELS["arm"]))
