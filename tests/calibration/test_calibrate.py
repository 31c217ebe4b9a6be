"""The whole way from a campaign to a calibrated robot."""

import dataclasses
import pickle
import re

import numpy as np
import pinocchio as pin
import pytest
import scipy.optimize

from pouring_robot.calibration.calibrate import CalibrationOptions, _under_effects, calibrate
from pouring_robot.calibration.report import ladle_line
from pouring_robot.calibration.summary import warnings_of
from pouring_robot.campaign.plan import random_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.checks.flags import FlagCode
from pouring_robot.effects.robots_under_conditions import robots_under
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.map_fit import FitOptions
from pouring_robot.estimation.measurement import MeasurementModel, Unknowns
from pouring_robot.estimation.noise import LEAST_NOISE
from pouring_robot.estimation.splits import split
from pouring_robot.exceptions import CalibrationError, CampaignError
from pouring_robot.robot.effect_stack import EffectEntry, ParameterEntry
from pouring_robot.robot.inverse import Target
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot, robot_of
from pouring_robot.robot.robot import Robot
from tests.campaign.simulated import SIGMA_M, SIGMA_RAD, damaged, measure
from tests.effects.bench import EFFECTS, Bench
from tests.robot.test_definition import ROBOTS
from tests.support import ACTUAL, LEARNED, gantry_file


@pytest.fixture(scope="module")
def bench():
    """Seventy rows in three sessions under known conditions."""
    return Bench()


def test_the_gap_closes_to_the_noise(found):
    before, after = (found.misfit(found.split.test, after=a) for a in (False, True))
    assert before.rms_mm > 5.0 * after.rms_mm
    assert after.rms_mm < 1.5 * SIGMA_M * 1e3
    assert found.changed
    assert found.noise["position"].source == "repeats"
    assert found.calibrated.joint_placements
    assert found.std.shape == (len(found.base.names),) == (len(found.unknown_units),)
    np.testing.assert_allclose(np.diagonal(found.correlation), 1.0)


def test_a_calibration_can_be_passed_to_another_process(found):
    again = pickle.loads(pickle.dumps(found))
    assert again.headline == found.headline and again.calibrated == found.calibrated


def test_a_sound_robot_stays_as_it_is(unchanged):
    assert not unchanged.changed
    assert unchanged.calibrated == unchanged.present
    np.testing.assert_allclose(unchanged.before, unchanged.after, atol=2e-6)


def test_effects_of_the_model_are_applied_and_not_fitted_again():
    """A drive's zero is off while a known drive yields: the zero is found, and the compliance is no geometric error."""
    taught = RobotModel.load(LEARNED)
    robot = robot_of(taught.displaced({}, {"leg1_s3": 1e-3}))
    plan = random_plan(robot, 60, 1)
    standing = robots_under(robot, plan.poses, plan.given(taught.definition))
    campaign = simulate_campaign(robot, plan, robots=standing).campaign
    wrong = damaged(campaign, position_m=lambda p: p.__setitem__(5, p[5] + 2e-2))
    found = calibrate(wrong, taught, CalibrationOptions(parameters=("drives",)))
    assert found.calibrated.effects == taught.effects
    off = found.base.names.index("drive.leg1_s3")
    assert abs(found.fit.unknowns.values[off] - 1e-3) < 3.0 * found.std[off]
    assert found.inflation == 1.0
    assert found.misfit(found.split.test, after=True).rms_mm < 1.3 * SIGMA_M * 1e3
    # A row that is left out deflects as the others do, this one by 0.6 mrad.
    assert found.left_out.tolist() == [5]
    np.testing.assert_allclose(found.after[5], [2e-2] * 3 + [0.0] * 3, atol=5.0 * max(SIGMA_M, SIGMA_RAD))
    with pytest.raises(CalibrationError, match="'tilt_drive_compliance' needs payload_kg, and the camp") as problem:
        calibrate(dataclasses.replace(campaign, conditions={}), taught)
    assert str(problem.value).startswith(f"{campaign.path}: the model's effect")


def test_rows_with_unknown_load_are_left_out_where_the_model_depends_on_it():
    """The load is random for each pose, so neighbours say nothing of it; their mean was taken for the load."""
    taught = RobotModel.load(LEARNED)
    robot, options = robot_of(taught), CalibrationOptions(parameters=("drives",), choose=False)
    plan, payload = random_plan(robot, 40, 1), np.random.default_rng(1).uniform(0.0, 500.0, 40)
    standing = robots_under(robot, plan.poses, plan.given(taught.definition) | {"payload_kg": payload})
    campaign = simulate_campaign(robot, plan, robots=standing).campaign
    payload[[7, 20]] = np.nan
    campaign = campaign.with_conditions(payload=payload)
    found = calibrate(campaign, taught, options)
    assert found.left_out.tolist() == [7, 20]
    where = ", ".join(map(str, campaign.lines[[7, 20]]))
    said = "left out, as effects of the model depend on payload_kg and other rows do not determine it: lines"
    assert found.not_learned == (f"{said} {where}",)
    assert not calibrate(campaign, RobotModel(), options).left_out.size


@pytest.mark.parametrize("effect", ["base_drift", "metrology_scale", "drive_backlash", "platform_thermal_expansion"])
def test_rows_with_effects_agree_with_those_of_a_diagnosis(bench, effect):
    """They act on the base, on the device's scale, on drives and on placements."""
    form, built = EFFECTS[effect].forms(bench.rows.conditions)[0], RobotModel.load(ACTUAL)
    values = {p.name: ParameterEntry(value=0.1 * p.prior_std, unit=p.unit) for p in form.parameters}
    model = built.model_copy(update={"effects": [EffectEntry(effect=effect, form=form.name, parameters=values)]})
    rows, _ = _under_effects(MeasurementModel(model, ()).at(bench.campaign.drives), bench.campaign)
    seen = rows.predict(Unknowns.zero(bench.true_frames, 0))
    expected, without = (
        known.predicted(known.unchanged(), bench.true_frames)
        for known in (bench.rows_of(bench.campaign, one) for one in (model, built))
    )
    np.testing.assert_allclose(seen.position_m, expected.position_m, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(seen.rotation, expected.rotation, rtol=0.0, atol=1e-12)
    assert np.abs(seen.position_m - without.position_m).max() > 1e-6


def test_effects_not_learned_at_the_angles_of_some_rows_are_reported(clean):
    """The tilt encoder's errors, learned within 0.1 rad of a turn, in poses that tilt by 1.5 rad."""
    seen = RobotModel.load(LEARNED).learned["campaign"].model_copy(update={"seen_rad": {"leg4_s5": [(0.0, 0.1)]}})
    wave = {"theta46_sine_1": ParameterEntry(value=0.1, unit="mrad")}
    effect = EffectEntry(effect="tilt_encoder_eccentricity", form="turns", learned="campaign", parameters=wave)
    model = RobotModel(effects=[effect], learned={"campaign": seen})
    (told,) = calibrate(clean.campaign, model, CalibrationOptions(parameters=("drives",), choose=False)).not_learned
    assert re.fullmatch(
        r"tilt_encoder_eccentricity of .* was not learned at the angles of \d+ of 60 rows: taken as zero there", told
    )


def test_a_robot_of_slides_that_meet_in_a_point_is_calibrated(tmp_path):
    """Its size is its travel: the distances between its joints are zero, so any error was too large for it."""
    drawing = Robot.load(gantry_file(tmp_path)).model
    assert drawing.definition.reach_m == pytest.approx(2.1 + 1.5 + 0.8)
    robot = Robot(drawing.displaced({"y_slide": pin.SE3(pin.exp3(np.array([0.0, 0.0, 5e-3])), np.zeros(3))}, {}))
    found = calibrate(measure(robot).campaign, drawing, CalibrationOptions(parameters=("y_slide.r?",)))
    assert found.calibrated.joint_placements["y_slide"].rotation_mrad[2] == pytest.approx(5.0, abs=0.5)


def test_the_choice_does_not_use_the_test_block(real):
    options = CalibrationOptions(parameters=("drives", "fixed_centres"))
    first = calibrate(real.campaign, None, options)
    rows = first.split.test
    moved = damaged(real.campaign, position_m=lambda p: p.__setitem__(rows, p[rows] + 1e-2))
    second = calibrate(moved, None, options)
    assert first.selection.steps == second.selection.steps
    assert second.misfit(rows, after=True).rms_mm > first.misfit(rows, after=True).rms_mm
    kept = [tuple(group.name for group in found.selection.groups) for found in (first, second)]
    refused = [found.refused.groups if found.refused else () for found in (first, second)]
    assert kept[0] + refused[0] == kept[1] + refused[1] != ()
    every = dataclasses.replace(options, choose=False)
    one, other = (calibrate(campaign, None, every) for campaign in (real.campaign, moved))
    fitted = one.split.train
    np.testing.assert_array_equal(one.after[fitted], other.after[fitted])  # errors are of the fit without that block


def test_the_calibrated_robot_is_the_fit_to_all_rows():
    """Against least squares by SciPy over all rows of an arm, by Pinocchio's forward kinematics of its URDF."""
    robot = Robot.load(ROBOTS / "arm" / "robot.yaml")
    actual = robot.built_as(robot.model.displaced({}, {"joint2": 2e-4, "joint4": -1e-3}))
    campaign = measure(actual, count=40, seed=3).campaign
    options = CalibrationOptions(("drives",), choose=False, fit=FitOptions(loss="linear", step_tolerance=1e-4))
    found = calibrate(campaign, None, options)
    assert found.split.test.size >= 5
    model = pin.buildModelFromXML(robot.model.definition.urdf())
    data, flange = model.createData(), model.getFrameId("flange")

    def residual(x):
        T_tracker_base, T_end_target = (pin.exp6(x[k : k + 6]) for k in (0, 6))
        rows = []
        for k, drives in enumerate(campaign.drives):
            pin.framesForwardKinematics(model, data, drives + x[12:])
            seen = at[0] * T_tracker_base * data.oMf[flange] * T_end_target * at[1]
            turn = pin.log3(pin.exp3(campaign.rotation_vector_rad[k]).T @ seen.rotation)
            rows += [(seen.translation - campaign.position_m[k]) / SIGMA_M, turn / SIGMA_RAD]
        return np.concatenate([*rows, x[12:] / prior])

    prior, frames = found.fit.prior_std[FRAMES:], found.fit.unknowns.frames
    at = frames.T_tracker_base, frames.T_end_target
    solved = scipy.optimize.least_squares(residual, np.zeros(18), x_scale="jac", xtol=1e-12)
    std = np.sqrt(np.diag(np.linalg.inv(solved.jac.T @ solved.jac)))[12:]
    np.testing.assert_allclose(found.std[FRAMES:], std, rtol=1e-2)
    np.testing.assert_allclose((found.fit.unknowns.values[FRAMES:] - solved.x[12:]) / std, 0.0, atol=1e-2)


@pytest.mark.parametrize("drive_errors", [{}, {"leg1_s3": 4e-3}], ids=["drawing", "longer"])
def test_exact_data_are_calibrated_with_the_least_noise(drive_errors, drawing):
    robot = drawing.built_as(drawing.model.displaced({}, drive_errors))
    exact = measure(robot, seed=4, sigma_position_m=0.0, sigma_rotation_rad=0.0)
    found = calibrate(exact.campaign, None, CalibrationOptions(parameters=("drives",)))
    assert found.changed == bool(drive_errors)
    assert found.noise.position_m == found.noise.rotation_rad == LEAST_NOISE
    assert any("stands for it: state it (sigma_position_mm" in line for line in warnings_of(found))
    assert found.misfit(found.split.test, after=True).rms_mm < 0.02


def test_outliers_and_nothing_else_are_left_out(as_built):
    virtual = measure(as_built, count=80, seed=7, outliers=3)
    found = calibrate(virtual.campaign, None, CalibrationOptions(parameters=("centres",), choose=False))
    np.testing.assert_array_equal(found.left_out, np.sort(virtual.outlier_rows))
    assert {flag.code for flag in found.flags} >= {FlagCode.OUTLIER}
    assert not set(found.left_out.tolist()) & {*found.split.train.tolist(), *found.split.test.tolist()}


def test_an_effect_that_is_not_geometry_widens_the_intervals(real):
    """At least to those of a noise as large as the residual; the tolerances keep their weight in it."""
    time = np.arange(len(real.campaign))
    drifting = damaged(real.campaign, position_m=lambda p: p + 1e-3 * np.sin(time / 3.0)[:, None])
    found = calibrate(drifting, None, CalibrationOptions(parameters=("drives", "axes"), choose=False))
    assert found.inflation > 2.0
    # Linear least squares of the equations with one row for each tolerance; columns in units of the tolerances.
    told = np.sqrt(found.fit.weights)[:, None] * found.fit.equations.derivatives / found.inflation
    rows = np.vstack([told * found.fit.prior_std, np.eye(len(found.std))])
    inverse = np.linalg.inv(np.linalg.qr(rows, mode="r"))
    as_noise = np.sqrt(np.diagonal(found.fit.inflated_covariance))
    np.testing.assert_allclose(as_noise, found.fit.prior_std * np.linalg.norm(inverse, axis=1), rtol=0.05)
    assert (as_noise <= found.fit.prior_std * (1.0 + 1e-9)).all()
    assert (found.std >= as_noise).all() and (found.std > 1.2 * as_noise).any()
    lengths = np.linalg.norm(inverse, axis=1)
    np.testing.assert_allclose(found.correlation, inverse @ inverse.T / np.outer(lengths, lengths), atol=0.1)
    lines = found.to_frame()
    np.testing.assert_allclose(lines["learnt"], 1.0 - (lines["std"] / lines["prior_std"]) ** 2, atol=1e-12)
    assert (lines["verdict"][lines["std"] > 0.8 * lines["prior_std"]] == "held by its tolerance").all()


def test_blocks_of_the_jackknife_are_those_of_the_fitted_rows(clean):
    """Five consecutive ones of all rows; without a misfit over a stated noise none is used."""
    time = np.arange(len(clean.campaign))
    drifting = damaged(clean.campaign, position_m=lambda p: p + 1e-3 * np.sin(time / 3.0)[:, None])
    unstated = drifting.metadata.model_copy(update={"sigma_position_m": None, "sigma_rotation_rad": None})
    options = CalibrationOptions(parameters=("drives",), choose=False)
    for campaign in (drifting, dataclasses.replace(drifting, metadata=unstated)):
        found = calibrate(campaign, None, options)
        rows = found.fit.stretches
        assert len(rows) == 5 and max(map(len, rows)) - min(map(len, rows)) <= 1
        np.testing.assert_array_equal(np.concatenate(rows), np.arange(len(campaign)))
        assert len(found.fit.covariances) == 2
    assert len(calibrate(clean.campaign, None, options).fit.covariances) == 1


def test_a_stated_noise_that_is_too_large_is_reported(clean):
    wide = clean.campaign.metadata.model_copy(update={"sigma_rotation_rad": 5.0 * SIGMA_RAD})
    found = calibrate(damaged(clean.campaign, metadata=wide), None, CalibrationOptions(("drives",), choose=False))
    said = [line for line in warnings_of(found) if "errors below the stated noise go unseen" in line]
    assert len(said) == 1 and "sigma_rotation_mrad" in said[0]


def test_residuals_over_a_noise_of_few_repeats_are_no_gap(drawing):
    """Five readings of one pose scatter by 0.6 of the noise, as they do in one of thirty campaigns."""
    campaign = measure(drawing, seed=4, sigma_rotation_rad=None).campaign.subset(np.array([0] * 4 + [*range(60)]))
    metadata = campaign.metadata.model_copy(update={"sigma_position_m": None})
    apart = np.pad(0.6 * SIGMA_M * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) / np.sqrt(2.5), (0, 59))
    few = damaged(campaign, metadata=metadata, position_m=lambda p: p + apart[:, None])
    found = calibrate(few, None, CalibrationOptions(parameters=("drives",), choose=False))
    assert found.noise.dof == 12 and found.noise.position_m == pytest.approx(0.6 * SIGMA_M)
    assert found.fit.noise_ratio() > 1.4
    assert found.inflation == 1.0
    drifting = damaged(few, position_m=lambda p: p + 1e-3 * np.sin(np.arange(-4, 60).clip(0) / 3.0)[:, None])
    assert calibrate(drifting, None, CalibrationOptions(parameters=("drives",), choose=False)).inflation > 2.0


@pytest.mark.parametrize("rounds", [1, 12])
def test_an_unstated_noise_settles_or_is_reported_not_to(clean, monkeypatch, rounds):
    monkeypatch.setattr("pouring_robot.estimation.map_fit._NOISE_ROUNDS", rounds)
    metadata = clean.campaign.metadata.model_copy(update={"sigma_position_m": None})
    found = calibrate(damaged(clean.campaign, metadata=metadata), None, CalibrationOptions(("drives",), choose=False))
    still = "its estimate had not settled when the fits ended: state it (sigma_position_mm in the YAML)"
    assert [line.endswith(still) for line in warnings_of(found) if "cannot judge the fit" in line] == [rounds == 1]


def test_positions_only(as_built):
    campaign = measure(as_built, count=80, seed=8, sigma_rotation_rad=None).campaign
    found = calibrate(campaign, None, CalibrationOptions(parameters=("centres",)))
    assert found.misfit(found.split.test, after=True).rms_mm < found.misfit(found.split.test, after=False).rms_mm
    assert np.isnan(found.misfit(found.split.test, after=True).rms_mrad)
    assert found.noise["rotation"].source == "none"


def test_wrong_units_are_refused_before_any_fit(clean):
    wrong = damaged(clean.campaign, position_m=lambda p: p * 1e3)
    with pytest.raises(CampaignError, match=r"mm|unit|metre"):
        calibrate(wrong)


def test_keeping_all_groups_keeps_all(clean):
    options = CalibrationOptions(parameters=("drives", "fixed_centres"), choose=False)
    found = calibrate(clean.campaign, None, options)
    assert [group.name for group in found.selection.groups] == ["drives", "fixed_centres"]
    # The robot has no errors: nothing is found that its interval does not allow.
    score = np.abs(found.fit.unknowns.values[FRAMES:]) / found.std[FRAMES:]
    assert (score < 1.96).mean() > 0.8
    assert dataclasses.is_dataclass(found)


def test_poses_of_one_tilt_leave_open_what_other_poses_would_show(drawing, found):
    plan = random_plan(drawing, 40, 3)
    poses = [PlatformPose(pose.position_m, 0.2) for pose in plan.poses]
    drives = np.array([list(drawing.kinematics.inverse(pose).values()) for pose in poses])
    one_tilt = dataclasses.replace(plan, poses=tuple(poses), drives=drives)
    campaign = simulate_campaign(drawing, one_tilt, MeasurementOptions(SIGMA_M, SIGMA_RAD, seed=3)).campaign
    options = CalibrationOptions(parameters=("drives", "fixed_centres"), choose=False)
    calibration = calibrate(campaign, None, options)
    assert calibration.rank_anywhere > calibration.base.rank
    assert found.rank_anywhere == found.base.rank


def test_rows_of_one_attitude_determine_such_poses_and_no_others():
    """A Staubli in machining was known to ±800 mm over the workspace, and to hundredths in the poses measured."""
    arm = Robot.load(ROBOTS / "arm/robot.yaml")
    places = np.random.default_rng(5).uniform([0.4, -0.3, 0.5], [0.7, 0.3, 0.8], (40, 3))
    held = arm.location_at(arm.model.definition.home_drives).nominal.pose_base_to_end.rotation
    drives = np.array([arm.drives_to(Target(place, held)).drives for place in places])
    plan = dataclasses.replace(random_plan(arm, 40, 5), poses=tuple(drives), drives=drives)
    options = MeasurementOptions(SIGMA_M, SIGMA_RAD, seed=5)
    found = calibrate(simulate_campaign(arm, plan, options).campaign, None, CalibrationOptions(parameters=("drives",)))
    assert np.median(found.ladle.half_width_m) > 0.01
    assert np.median(found.ladle_measured.half_width_m) < 1e-4
    assert ladle_line(found).endswith(" mm; the noise of a measurement comes on top")
    assert "in the measured poses ±0.0" in ladle_line(found)


@pytest.fixture(scope="module")
def misled(drawing, as_built):
    """A campaign whose last region was measured on a robot with the opposite error, so that the fit misleads there."""
    plan, options = random_plan(drawing, 100, 5), MeasurementOptions(SIGMA_M, SIGMA_RAD, seed=5)
    placements = ({"leg1_s1": JointPlacement(translation_mm=(0.0, 0.3 * sign, 0.0))} for sign in (1.0, -1.0))
    bent = (as_built.model.model_copy(update={"joint_placements": placement}) for placement in placements)
    campaign, other = (simulate_campaign(PouringRobot(model), plan, options).campaign for model in bent)
    test = split(campaign, np.zeros(0, dtype=np.intp), "region").test
    position, rotation = campaign.position_m.copy(), campaign.rotation_vector_rad.copy()
    position[test], rotation[test] = other.position_m[test], other.rotation_vector_rad[test]
    return dataclasses.replace(campaign, position_m=position, rotation_vector_rad=rotation)


def test_held_out_rows_refuse_a_model_that_makes_them_worse(misled):
    options = CalibrationOptions(parameters=("fixed_centres",))
    calibration = calibrate(misled, None, options)
    assert calibration.refused is not None
    assert calibration.refused.groups == ("fixed_centres",)
    assert calibration.refused.after.rms_mm > calibration.refused.before.rms_mm
    assert not calibration.changed
    assert calibration.calibrated.joint_placements == {}
    np.testing.assert_allclose(calibration.after, calibration.before, atol=1e-6)
    assert any("held-out rows refute what was found (fixed_centres)" in line for line in warnings_of(calibration))
    assert calibration.headline.startswith("No geometry found that explains the error")


def test_with_all_groups_kept_the_model_is_kept_with_a_warning(misled):
    calibration = calibrate(misled, None, CalibrationOptions(parameters=("fixed_centres",), choose=False))
    assert calibration.refused is None
    assert calibration.changed
    assert any("do not use this model" in line for line in warnings_of(calibration))
