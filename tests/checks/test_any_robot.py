"""Checks of robots they were not written for: sound data pass, planted damage is found, real data raise no alarm."""

import dataclasses
import shutil
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.checks.check import check_campaign, examine
from pouring_robot.checks.flags import FlagCode, Severity, wrong_rows
from pouring_robot.checks.stated_noise import _by_weight
from pouring_robot.cli.app import main
from pouring_robot.estimation.frames.fit import fit_frames
from pouring_robot.mechanism.rotations import rotation_matrices, rotation_vectors
from pouring_robot.robot.description.definition import RobotDefinition
from tests.campaign.simulated import codes, damaged
from tests.estimation.virtual import TRUE_FRAMES
from tests.support import gantry_file

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SIGMA = 5e-5
DEG = np.pi / 180.0


class Machine:
    """A robot whose drives are slightly off their commands, seen by a tracker."""

    def __init__(self, path, count=120, seed=2):
        random = np.random.default_rng(seed)
        robot = RobotDefinition.load(path)
        self.drawing = robot.drawing()
        drives, _ = robot.workspace(self.drawing)
        drives = drives[random.permutation(len(drives))[:count]]
        drives = drives + 1e-3 * random.normal(size=drives.shape)  # no round figures
        offset = 1e-4 * random.normal(size=drives.shape[1])
        seen = TRUE_FRAMES.seen(nominal_poses(self.drawing, drives + offset))
        turn = rotation_matrices(SIGMA * random.normal(size=(len(drives), 3))) @ seen.rotation
        self.campaign = Campaign(
            robot=robot,
            path=Path(f"{robot.name}.csv"),
            metadata=CampaignMetadata(robot=robot.name, sigma_position_m=SIGMA, sigma_rotation_rad=SIGMA),
            lines=np.arange(2, len(drives) + 2),
            samples=("",) * len(drives),
            sessions=("1",) * len(drives),
            headings={},
            ignored_columns=(),
            drives=drives,
            position_m=seen.position_m + SIGMA * random.normal(size=(len(drives), 3)),
            rotation_vector_rad=rotation_vectors(turn),
            conditions={"ambient": 20.0 + random.normal(size=len(drives))},
        )


@pytest.fixture(scope="module", params=["arm", "delta", "hexapod", "five_bar"])
def machine(request):
    return Machine(EXAMPLES / "robots" / request.param / "robot.yaml")


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    return Machine(gantry_file(tmp_path_factory.mktemp("gantry")))


def inverse(campaign):
    seen = [pin.SE3(pin.exp3(w), p) for w, p in zip(campaign.rotation_vector_rad, campaign.position_m, strict=True)]
    back = [pose.inverse() for pose in seen]
    return damaged(
        campaign,
        position_m=np.array([pose.translation for pose in back]),
        rotation_vector_rad=np.array([pin.log3(pose.rotation) for pose in back]),
    )


def scaled(campaign, factor):
    return damaged(campaign, drives=campaign.drives * factor)


@pytest.mark.parametrize("full", [True, False])
def test_sound_data_pass(machine, full):
    campaign = machine.campaign if full else damaged(machine.campaign, rotation_vector_rad=None)
    assert check_campaign(campaign, machine.drawing) == []


def test_rotations_that_only_errors_cause_determine_no_unit():
    """A nominal delta platform does not rotate; errors of its rods tilt it, by less in any smaller unit."""
    delta = Machine(EXAMPLES / "robots" / "delta" / "robot.yaml")
    place = delta.campaign.position_m - delta.campaign.position_m.mean(axis=0)
    tip = rotation_matrices(np.cross([0.0, 0.015, 0.02], place))  # 25 mrad per metre
    vectors = rotation_vectors(tip @ rotation_matrices(delta.campaign.rotation_vector_rad))
    assert not codes(check_campaign(damaged(delta.campaign, rotation_vector_rad=vectors), delta.drawing))


@pytest.mark.parametrize("machine", ["arm"], indirect=True)
@pytest.mark.parametrize(("full", "fits"), [(True, 3), (False, 1)])
def test_the_frames_of_sound_data_are_fitted_once_for_each_question(machine, full, fits, monkeypatch):
    """To positions alone, to judge rotations, and to both; without rotations there is one fit."""
    asked = []
    fitted = lambda *given, **how: asked.append(given) or fit_frames(*given, **how)  # noqa: E731
    monkeypatch.setattr("pouring_robot.checks.units_and_axes.fit_frames", fitted)
    campaign = machine.campaign if full else damaged(machine.campaign, rotation_vector_rad=None)
    found = examine(campaign, machine.drawing)
    assert len(asked) == fits
    turns = rotation_matrices(campaign.rotation_vector_rad) if full else None
    poses = nominal_poses(machine.drawing, campaign.drives)
    again = fit_frames(poses, campaign.position_m, turns, campaign.metadata.metres_per_rad)
    np.testing.assert_array_equal(found.fit.position_residual_m, again.position_residual_m)


@pytest.mark.parametrize("full", [True, False])
def test_all_outliers_and_no_sound_row_are_found(machine, full):
    campaign = machine.campaign if full else damaged(machine.campaign, rotation_vector_rad=None)
    position = np.array(campaign.position_m)
    position[[3, 50, 77]] += 0.01
    flags = check_campaign(damaged(campaign, position_m=position), machine.drawing)
    assert wrong_rows(flags).tolist() == [3, 50, 77]


def test_duplicates_of_rows_of_a_short_campaign_are_not_taken_for_a_step():
    """So few rows determine a constant only, which duplicates would have, too; but they command no motion."""
    arm = Machine(EXAMPLES / "robots" / "arm" / "robot.yaml", count=32)
    twice = arm.campaign.subset(np.repeat(np.arange(32), 2))
    with warnings.catch_warnings(action="error"):
        assert codes(check_campaign(twice, arm.drawing)) == {"repeated_rows"}


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("count", [16, 24, 40])
def test_up_to_a_third_of_the_rows_may_hold_another_row_s_measurement(machine, count, full):
    campaign = machine.campaign
    scattered = np.sort(np.random.default_rng(0).permutation(len(campaign))[:count])
    for wrong in (scattered, np.arange(50, 50 + count)):
        rows = np.arange(len(campaign))
        rows[wrong] = np.roll(wrong, 1)
        turns = campaign.rotation_vector_rad[rows] if full else None
        others = damaged(campaign, position_m=campaign.position_m[rows], rotation_vector_rad=turns)
        flags = check_campaign(others, machine.drawing)
        assert codes(flags) <= {FlagCode.OUTLIER, FlagCode.UNREACHABLE_POSE}
        found = wrong_rows(flags)
        assert set(found) <= set(wrong) and found.size >= 0.9 * count  # a neighbour may be near


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("off_m", [3e-3, 0.2])
def test_a_gross_error_in_a_direction_that_no_drive_moves_is_found(full, off_m):
    flat = Machine(EXAMPLES / "robots" / "five_bar" / "robot.yaml")
    position = flat.campaign.position_m.copy()
    position[17] += off_m * TRUE_FRAMES.T_tracker_base.rotation[:, 2]
    turns = flat.campaign.rotation_vector_rad if full else None
    flags = check_campaign(damaged(flat.campaign, position_m=position, rotation_vector_rad=turns), flat.drawing)
    assert wrong_rows(flags).tolist() == [17]


@pytest.mark.parametrize("right", [0.5, 0.54])
def test_rows_that_are_wrong_from_the_middle_on_do_not_hide_each_other(gantry, right):
    """From there on each row has the measurement of the row before it."""
    rows = np.arange(len(gantry.campaign))
    late = np.where(rows < right * len(rows), rows, rows - 1)
    turns = gantry.campaign.rotation_vector_rad[late]
    moved = damaged(gantry.campaign, position_m=gantry.campaign.position_m[late], rotation_vector_rad=turns)
    assert "no_agreement" in codes(check_campaign(moved, gantry.drawing))


@pytest.mark.parametrize("column", [0, 1, 2])
def test_a_stuck_column_is_no_jump(machine, column):
    position = np.array(machine.campaign.position_m)
    far = np.abs(position[60:76, column] - position[60, column]) > 0.05 * np.ptp(position[:, column])
    position[60:76, column] = position[60, column]
    flags = check_campaign(damaged(machine.campaign, position_m=position), machine.drawing)
    assert FlagCode.STUCK_COLUMN in codes(flags) and FlagCode.MEASUREMENT_JUMP not in codes(flags)
    assert set(60 + np.flatnonzero(far)) <= set(wrong_rows(flags)) <= set(range(60, 76))


@pytest.mark.parametrize(("scatter_rad", "severity"), [(0.12, Severity.WARNING), (0.5, Severity.ERROR)])
def test_a_wrist_that_is_degrees_off_but_follows_its_commands_is_not_refused(scatter_rad, severity):
    """The wrist of a cable-driven surgical robot was off by 7 deg in a range of 60 deg to either side."""
    arm, random = Machine(EXAMPLES / "robots" / "arm" / "robot.yaml"), np.random.default_rng(4)
    turned = rotation_matrices(scatter_rad * random.normal(size=(120, 3)))
    seen = rotation_vectors(turned @ rotation_matrices(arm.campaign.rotation_vector_rad))
    found = examine(damaged(arm.campaign, rotation_vector_rad=seen), arm.drawing)
    assert [flag.severity for flag in found.flags if flag.code == FlagCode.NO_AGREEMENT] == [severity]
    assert (found.comparison.rotation_vector_rad is not None) == (severity is Severity.WARNING)


def elsewhere(campaign, rows, shift_m, turn_rad):
    """Return a campaign in which the tracker had another position in some rows."""
    position, turned = np.array(campaign.position_m), rotation_matrices(np.array(campaign.rotation_vector_rad))
    back = pin.exp3(np.array(turn_rad))
    position[rows] = position[rows] @ back.T + shift_m
    turned[rows] = back @ turned[rows]
    return damaged(campaign, position_m=position, rotation_vector_rad=rotation_vectors(turned))


@pytest.mark.parametrize("turn", [0.0, 0.01, 0.3])
@pytest.mark.parametrize("first", [90, 105])
def test_a_tracker_that_was_moved_far_makes_no_outliers(machine, first, turn):
    moved = elsewhere(machine.campaign, np.arange(first, 120), [0.1, -0.2, 0.3], [turn, 0.0, turn])
    position = np.array(moved.position_m)
    position[[20, 110]] += 0.5
    flags = check_campaign(damaged(moved, position_m=position), machine.drawing)
    assert FlagCode.MEASUREMENT_JUMP in codes(flags)
    assert set(wrong_rows(flags)) <= {20, 110}


def test_a_tracker_that_was_moved_twice_makes_no_outliers(machine):
    moved = elsewhere(machine.campaign, np.arange(80, 100), [0.02, 0.01, 0.0], [0.0] * 3)
    moved = elsewhere(moved, np.arange(100, 120), [-0.02, 0.01, 0.01], [0.0] * 3)
    assert codes(check_campaign(moved, machine.drawing)) == {FlagCode.MEASUREMENT_JUMP}


@pytest.mark.parametrize("full", [True, False])
def test_an_error_that_grows_over_half_of_the_workspace_makes_no_outliers(machine, full):
    """The other half is as exact as the noise."""
    position = np.array(machine.campaign.position_m)
    x = (position[:, :1] - position[:, :1].mean()) / position[:, :1].std()
    bent = position + 2e-3 * np.maximum(x, 0.0) ** 2 * [1.0, -1.0, 0.5]
    turns = machine.campaign.rotation_vector_rad if full else None
    flags = check_campaign(damaged(machine.campaign, position_m=bent, rotation_vector_rad=turns), machine.drawing)
    assert wrong_rows(flags).size == 0


def test_bending_with_the_position_is_not_reported_as_noise(machine):
    """Bent guides, skew to the tracker: a product of two coordinates that shows in all components."""
    position = np.array(machine.campaign.position_m)
    x = (position - position.mean(axis=0)) / position.std(axis=0)
    position += 12.0 * SIGMA * (x[:, :1] * x[:, 1:2])
    found = codes(
        check_campaign(damaged(machine.campaign, position_m=position, rotation_vector_rad=None), machine.drawing)
    )
    assert "noise_too_small" not in found


@pytest.mark.parametrize("machine", ["arm", "hexapod"], indirect=True)
def test_an_error_that_depends_on_a_drives_own_position_is_not_reported_as_noise(machine):
    """A wrong gear ratio, an eccentric encoder, or a screw with an error once per turn, in one drive."""
    campaign, drives = machine.campaign, machine.campaign.drives
    turn = 0.01 if campaign.robot.drives[0].unit == "m" else 2.0 * np.pi
    metadata = campaign.metadata.model_copy(update={"screw_pitch_m": 0.01})
    for k in range(drives.shape[1]):
        for off in (1e-3 * drives[:, k], 3e-4 * np.sin(2.0 * np.pi * drives[:, k] / turn)):
            # The robot was at these drives; the table holds them less the drive's error.
            told = damaged(campaign, drives=drives - off[:, None] * np.eye(drives.shape[1])[k], metadata=metadata)
            assert "noise_too_small" not in codes(check_campaign(told, machine.drawing))


@pytest.mark.parametrize("machine", ["arm"], indirect=True)
def test_thermal_expansion_of_links_is_not_reported_as_noise(machine):
    """Upper arm and forearm of aluminium; their directions are computed by hand."""
    campaign, random = machine.campaign, np.random.default_rng(0)
    turn, upper, fore = campaign.drives[:, 0], campaign.drives[:, 1], campaign.drives[:, 1:3].sum(axis=1)
    along = np.array(
        [
            [0.60 * np.cos(turn) * np.sin(upper), 0.60 * np.sin(turn) * np.sin(upper), 0.60 * np.cos(upper)],
            [0.62 * np.cos(turn) * np.cos(fore), 0.62 * np.sin(turn) * np.cos(fore), -0.62 * np.sin(fore)],
        ]
    )
    warm = dict(zip(("upper_arm", "elbow"), 25.0 + 12.0 * random.normal(size=(2, len(campaign))), strict=True))
    grown = sum(23e-6 * (rise - 20.0) * own for rise, own in zip(warm.values(), along, strict=True))
    position = campaign.position_m + grown.T @ TRUE_FRAMES.T_tracker_base.rotation.T
    hot = damaged(campaign, position_m=position, rotation_vector_rad=None, conditions=campaign.conditions | warm)
    assert "noise_too_small" not in codes(check_campaign(hot, machine.drawing))
    without = damaged(hot, conditions=campaign.conditions)
    assert "noise_too_small" in codes(check_campaign(without, machine.drawing))


def test_another_tracker_position_in_each_session_is_not_reported_as_noise(machine):
    sessions = np.arange(len(machine.campaign)) // 20
    moved = 8.0 * SIGMA * np.random.default_rng(0).normal(size=(sessions[-1] + 1, 3))
    position = machine.campaign.position_m + moved[sessions]
    how = {"position_m": position, "rotation_vector_rad": None}
    campaign = damaged(machine.campaign, sessions=[str(session) for session in sessions], **how)
    assert "noise_too_small" not in codes(check_campaign(campaign, machine.drawing))
    without = damaged(campaign, sessions=["1"] * len(campaign))
    assert "noise_too_small" in codes(check_campaign(without, machine.drawing))


@pytest.mark.parametrize("machine", ["arm", "delta", "hexapod"], indirect=True)
@pytest.mark.parametrize(
    ("factor", "wrong"),
    [(1.0, ""), (1e-3, "metres under a heading in milli"), (1e3, "millimetres under"), (1.0 / 25.4, "inches under")],
)
def test_the_unit_of_distances_is_found_from_how_far_drives_move_the_target(machine, factor, wrong):
    """The tracker's own origin is the fixed point; the positions give the target's distance from it."""
    away = np.linalg.norm(machine.campaign.position_m, axis=1)[:, None]
    wire = damaged(machine.campaign, position_m=np.nan * machine.campaign.position_m, rotation_vector_rad=None)
    told = check_campaign(damaged(wire, distance_m=factor * away), machine.drawing)
    found = [flag.message for flag in told if flag.code is FlagCode.DISTANCE_UNIT]
    assert len(found) == bool(wrong) and all(wrong in message for message in found)


@pytest.mark.parametrize("machine", ["arm", "delta", "hexapod"], indirect=True)
@pytest.mark.parametrize("short_mm", [300.0, -300.0, 0.0])
def test_a_draw_wire_with_an_offset_is_found(machine, short_mm):
    """It hangs at the tracker's own origin; a device with an error of a thousandth of its reading has no offset."""
    away = np.linalg.norm(machine.campaign.position_m, axis=1)[:, None]
    read = away - 1e-3 * short_mm if short_mm else 1.001 * away
    wire = damaged(machine.campaign, position_m=np.nan * machine.campaign.position_m, rotation_vector_rad=None)
    told = check_campaign(damaged(wire, distance_m=read), machine.drawing)
    found = [flag.metrics["short_mm"] for flag in told if flag.code is FlagCode.DISTANCE_ZERO]
    assert found == pytest.approx([short_mm] if short_mm else [], rel=0.02)
    assert FlagCode.DISTANCE_UNIT not in codes(told)


@pytest.mark.parametrize("machine", ["arm"], indirect=True)
def test_distances_of_zero_are_reported(machine):
    """As of a draw wire that was set to zero in the first pose."""
    length = np.linalg.norm(machine.campaign.position_m, axis=1)[:, None]
    wire = damaged(machine.campaign, position_m=np.nan * machine.campaign.position_m, rotation_vector_rad=None)
    assert "no_length" not in codes(check_campaign(damaged(wire, distance_m=length), machine.drawing))
    (flag,) = (
        flag
        for flag in check_campaign(damaged(wire, distance_m=np.abs(length - length[0])), machine.drawing)
        if flag.code is FlagCode.NO_LENGTH
    )
    assert flag.rows == (0,) and "line 2" in flag.message


DAMAGES = {
    "position_unit": lambda c: damaged(c, position_m=c.position_m * 1000.0),
    "frames_swapped": inverse,
    "measurement_jump": lambda c: damaged(
        c, position_m=c.position_m + np.where(np.arange(len(c)) >= 60, 0.003, 0.0)[:, None]
    ),
    "rotation_unit": lambda c: damaged(c, rotation_vector_rad=c.rotation_vector_rad / DEG),
    "drive_reversed": lambda c: damaged(c, drives=c.drives * np.where(np.arange(c.drives.shape[1]) == 1, -1.0, 1.0)),
}


@pytest.mark.parametrize("code", DAMAGES)
def test_planted_damage_is_named_and_nothing_else(machine, code):
    delta = machine.campaign.robot.name == "delta"
    flags = check_campaign(DAMAGES[code](machine.campaign), machine.drawing)
    if delta and code == "frames_swapped":
        # For pure translations the inverse is the mirror image; so is an exchange of two of three arms.
        assert codes(flags) <= {"frames_swapped", "drives_exchanged", "mirrored_axes"}
        assert "seem to be inverse" in flags[0].message
        assert "equally possible" in flags[0].message
    else:
        assert codes(flags) == {code}


def test_units_of_all_drives(machine):
    robot = machine.campaign.robot
    angles = np.array([drive.unit == "rad" for drive in robot.drives])
    for factor in (np.where(angles, 1.0 / DEG, 1000.0), np.where(angles, DEG, 1e-3)):
        flags = check_campaign(scaled(machine.campaign, factor), machine.drawing)
        assert codes(flags) == {"drive_unit"}
        named = {name for flag in flags for name in flag.columns}
        assert named == {machine.campaign.heading(drive.column) for drive in robot.drives}


@pytest.mark.parametrize("machine", ["arm", "delta", "five_bar"], indirect=True)
@pytest.mark.parametrize("turn", [-90, 180, -180])
def test_revolute_drives_with_another_zero_are_found(machine, turn):
    """As of two link tables with zeros of a joint a quarter turn apart."""
    robot, at = machine.campaign.robot, 1
    counted = damaged(
        machine.campaign, drives=machine.campaign.drives - np.radians(turn) * np.eye(len(robot.drives))[at]
    )
    (flag,) = check_campaign(counted, machine.drawing)
    assert flag.code == "drive_zero"
    assert f"at {turn}° (zero: {np.radians(turn):.6g})" in flag.message


@pytest.mark.parametrize("machine", ["arm"], indirect=True)
@pytest.mark.parametrize("full", [True, False])
def test_an_elbow_whose_angle_is_absolute_is_found(machine, full):
    """As for the third joint of Fanuc arms, or one driven by rods: the forearm's direction, not the elbow's angle."""
    counted = damaged(machine.campaign, drives=machine.campaign.drives + machine.campaign.drives[:, 1:2] * np.eye(6)[2])
    counted = counted if full else damaged(counted, rotation_vector_rad=None)
    flag, *beside = check_campaign(counted, machine.drawing)
    assert (flag.code, flag.columns) == ("drive_absolute", ("q3_rad",))
    assert flag.message.endswith("the joint itself turns by 'q3' minus 'q2'")
    assert not beside  # with that joint known, its values are not out of reach


@pytest.mark.parametrize("machine", ["arm"], indirect=True)
def test_an_encoder_that_wraps_is_found(machine):
    """A joint that counts from 0° to 360° is a turn beyond its limits in half of the rows."""
    wound = (
        np.where(machine.campaign.drives[:, 1:2] < 0.0, 2.0 * np.pi, 0.0)
        * np.eye(len(machine.campaign.robot.drives))[1]
    )
    (flag,) = check_campaign(damaged(machine.campaign, drives=machine.campaign.drives + wound), machine.drawing)
    assert flag.code == "unreachable_drives"
    assert flag.columns == (machine.campaign.heading(machine.campaign.robot.drives[1].column),)
    assert "is whole turns beyond the limits of the joint" in flag.message


@pytest.mark.parametrize("machine", ["arm"], indirect=True)
def test_drives_beyond_their_limits_are_reported_with_the_excess(machine):
    """A real arm was 36 deg beyond the wrist limit in its URDF."""
    far = np.array(machine.campaign.drives)
    far[[4, 9], 2] = machine.drawing.mechanism.joint_limits()["joint3"][1] + np.array([0.1, 0.2])
    flag, *_ = check_campaign(damaged(machine.campaign, drives=far), machine.drawing)
    assert (flag.code, flag.columns) == ("unreachable_drives", ("q3_rad",))
    assert flag.message.endswith("lines 6, 11 (beyond the joint limits: 'q3_rad' by up to 11.5 deg)")
    assert "correct the limits in the URDF" in flag.remedy


@pytest.mark.parametrize("turned", [False, True])
def test_a_slide_that_counts_from_its_other_end_is_reported_as_that(gantry, turned):
    """For a gantry each of its slides makes the same mirror image, as do the device's axes, which are named last."""
    limits, drives = gantry.drawing.mechanism.joint_limits(), gantry.campaign.robot.drives
    low, high = limits[drives[1].joint]
    counted = damaged(gantry.campaign, drives=lambda v: np.column_stack([v[:, 0], low + high - v[:, 1], v[:, 2]]))
    counted = counted if turned else dataclasses.replace(counted, rotation_vector_rad=None)
    (flag,) = check_campaign(counted, gantry.drawing)
    assert flag.code is FlagCode.DRIVE_REVERSED
    for drive in drives:
        zero = sum(limits[drive.joint])
        told = (
            f"'{counted.heading(drive.column)}' seems to be counted from the other end of the slide (a negative ratio"
        )
        assert f"{told}, zero: {zero:g})" in flag.message
    assert flag.message.index("left-handed") > flag.message.rindex("slide (")


def test_a_slide_whose_motor_already_counts_backwards_is_told_to_count_forwards(tmp_path):
    path = gantry_file(tmp_path)  # its middle slide has 1.5 m of stroke
    path.write_text(path.read_text().replace("joint: y_slide", "joint: y_slide, mm_per_turn: -20"))
    gantry = Machine(path)
    counted = damaged(gantry.campaign, drives=lambda v: v * [1.0, -1.0, 1.0] + [0.0, 1.5, 0.0])
    flag, *_ = check_campaign(counted, gantry.drawing)
    assert "counted from the other end of the slide (a positive mm_per_turn, zero: 1.5)" in flag.message
    assert "negative" not in flag.remedy


def test_of_equivalent_mistakes_none_takes_drives_beyond_their_limits(gantry):
    """For three slides at right angles any exchange or sign is a change of frames; their limits decide."""
    exchanged = damaged(gantry.campaign, drives=gantry.campaign.drives[:, [1, 0, 2]])
    flags = check_campaign(exchanged, gantry.drawing)
    assert flags[0].code == "drives_exchanged"
    assert flags[0].columns == ("x_slide_m", "y_slide_m")
    assert "equally possible" not in flags[0].message


@pytest.fixture(scope="module")
def geared(tmp_path_factory):
    """The arm with motors that do not count from the drawing's zero, some through a gear."""
    folder = shutil.copytree(EXAMPLES / "robots", tmp_path_factory.mktemp("geared") / "robots") / "arm"
    text = (folder / "robot.yaml").read_text()
    for joint, more in ((2, "zero: 0.9"), (3, "zero: -0.7, ratio: -0.5"), (5, "zero: 1.2, ratio: 0.5")):
        text = text.replace(f"column: q{joint}}}", f"column: q{joint}, {more}}}")
    (folder / "robot.yaml").write_text(text)
    return Machine(folder / "robot.yaml")


GEARS = np.array([0.0, 0.9, -0.7, 0.0, 1.2, 0.0]), np.array([1.0, 1.0, -0.5, 1.0, 0.5, 1.0])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda c: c * [1, -1, 1, 1, 1, 1], "column 'q2_rad' seems to be counted the other way"),
        (lambda c: c * [1, 1, DEG, 1, 1, 1], "column 'q3_rad' seems to hold radians under a heading in degrees"),
        (lambda c: c * DEG, "seem to hold radians under a heading in degrees"),
        (lambda c: c[:, [0, 1, 4, 3, 2, 5]], "'q3_rad' holds q5, 'q5_rad' holds q3"),
    ],
)
def test_mistakes_are_of_commands_which_have_a_zero_and_a_ratio(geared, spoil, said):
    zeros, ratios = GEARS
    values = zeros + ratios * spoil((geared.campaign.drives - zeros) / ratios)
    assert not check_campaign(geared.campaign, geared.drawing)
    flags = check_campaign(damaged(geared.campaign, drives=values), geared.drawing)
    assert said in flags[0].message and len(flags) == 1


def test_commands_that_were_rounded_are_found_and_their_effect_counts_the_gear(geared):
    zeros, ratios = GEARS
    rounded = np.round((geared.campaign.drives - zeros) / ratios / (0.1 * DEG)) * 0.1 * DEG
    (flag,) = check_campaign(damaged(geared.campaign, drives=zeros + ratios * rounded), geared.drawing)
    assert flag.code is FlagCode.ROUNDED_DRIVES
    assert flag.columns == tuple(f"q{k}_rad" for k in range(1, 7)) and "rounded to 0.1 deg" in flag.message
    # A tenth of a degree of a motor whose joint moves half as far is a twentieth of one without a gear.
    plain = Machine(EXAMPLES / "robots" / "arm" / "robot.yaml")
    effects = []
    for machine, zero, ratio, step in ((geared, -0.7, -0.5, 0.1), (plain, 0.0, 1.0, 0.05)):
        values = np.array(machine.campaign.drives)
        values[:, 2] = zero + ratio * np.round((values[:, 2] - zero) / ratio / (step * DEG)) * step * DEG
        (flag,) = check_campaign(damaged(machine.campaign, drives=values), machine.drawing)
        assert flag.message.startswith(f"'q3_rad' rounded to {step} deg: ")
        effects.append(flag.message.split(" times the stated noise")[0].split()[-1])
    assert effects[0] == effects[1]


def test_values_in_another_unit_are_told_in_the_unit_of_their_column(geared):
    zeros, ratios = GEARS
    wrong = (geared.campaign.drives - zeros) / ratios / np.where(np.arange(6) == 2, DEG, 1.0)
    flag, *_ = check_campaign(damaged(geared.campaign, drives=zeros + ratios * wrong), geared.drawing)
    assert f"would be {np.median(np.abs(wrong[:, 2])):g} rad (median)" in flag.message


def test_two_exchanged_drives_of_many(machine):
    drives = machine.campaign.robot.drives
    if len(drives) < 6:
        pytest.skip("all orders of few drives are tried; those of the pouring robot are tested")
    order = [0, 3, 2, 1, 4, 5]
    (flag,) = check_campaign(damaged(machine.campaign, drives=machine.campaign.drives[:, order]), machine.drawing)
    assert flag.code == "drives_exchanged"
    assert set(flag.columns) == {machine.campaign.heading(drives[k].column) for k in (1, 3)}


@pytest.mark.parametrize("full", [True, False])
def test_mirrored_axes(machine, full):
    mirrored = damaged(machine.campaign, position_m=machine.campaign.position_m * [1, -1, 1])
    mirrored = mirrored if full else damaged(mirrored, rotation_vector_rad=None)
    flags = check_campaign(mirrored, machine.drawing)
    if machine.campaign.robot.name == "five_bar":
        # The mirror image of a plane is the plane seen from behind; rotations are then reversed.
        assert [flag.code for flag in flags] == ["mirrored_axes"] * full
    else:
        (flag,) = flags
        assert flag.code in ("mirrored_axes", "frames_swapped", "drives_exchanged")
        assert "left-handed" in flag.message


SAGGING = """format: pouring_robot/model/1
robot: {robot}
effects:
  - effect: drive_compliance
    form: spring
    learned: by_hand
    parameters: {{q2_yield: {{value: 1.5, unit: mrad at 100 Nm}}}}
learned: {{by_hand: {{sessions: {{"1": 1}}, mean_span_m: [0, 0, 0, 0, 0, 0], reference_temperature_degC: 20}}}}
"""


@pytest.fixture(scope="module")
def sagging(tmp_path_factory):
    """A campaign of an arm that deflects under its own weight."""
    folder, file = tmp_path_factory.mktemp("sagging"), EXAMPLES / "robots" / "arm" / "robot.yaml"
    model, table = folder / "sagging.yaml", folder / "c.csv"
    model.write_text(SAGGING.format(robot=file))
    assert main(["campaign", "simulate", "--random", "160", "--model", str(model), "--out", str(table), "-q"]) == 0
    return Campaign.read(table, RobotDefinition.load(file))


@pytest.mark.parametrize(("stated_mm", "too_small"), [(0.05, False), (0.015, True)])
def test_sag_under_its_own_weight_is_not_reported_as_noise(sagging, stated_mm, too_small):
    sigmas = {"sigma_position_m": 1e-3 * stated_mm, "sigma_rotation_rad": 1e-3 * stated_mm}
    campaign = dataclasses.replace(sagging, metadata=sagging.metadata.model_copy(update=sigmas))
    flags = check_campaign(campaign, sagging.robot.drawing())
    assert (FlagCode.NOISE_TOO_SMALL in {flag.code for flag in flags}) == too_small


@pytest.fixture(scope="module")
def ur10():
    robot = RobotDefinition.load(EXAMPLES / "machines" / "ur10" / "robot.yaml")
    return robot, robot.drawing()


@pytest.mark.parametrize("series", ["a", "c"])
def test_a_real_arm_raises_no_alarm(ur10, series):
    robot, drawing = ur10
    campaign = Campaign.read(EXAMPLES / "machines" / "ur10" / f"series_{series}.csv", robot)
    found = examine(campaign, drawing)
    assert codes(found.flags) <= {"ignored_columns", "no_temperatures", "no_noise_level"}
    if series == "c":
        # The frames alone leave a distance of 0.99 mm rms, by an independent fit.
        distance = np.linalg.norm(found.fit.position_residual_m, axis=1)
        assert np.sqrt(np.mean(distance**2)) == pytest.approx(0.99e-3, abs=0.02e-3)


def test_wrong_rows_among_real_ones_are_found(ur10):
    robot, drawing = ur10
    campaign = Campaign.read(EXAMPLES / "machines" / "ur10" / "series_c.csv", robot)
    position = np.array(campaign.position_m)
    wrong = np.random.default_rng(1).permutation(len(campaign))[:20]
    position[wrong] += 0.004
    flags = check_campaign(dataclasses.replace(campaign, position_m=position), drawing)
    assert wrong_rows(flags).tolist() == sorted(wrong.tolist())


@pytest.mark.parametrize("zero", [0.0, 273.15])
@pytest.mark.parametrize("parts", [("slides",), ("base", "slides")])
def test_kelvin_is_detected_without_a_hall_temperature(gantry, zero, parts):
    """Parts begin as cold as a hall; in kelvin all of them would be at 290 °C."""
    warm = 18.0 + np.linspace(0.0, 20.0, len(gantry.campaign))
    readings = {name: zero + 0.5 * k + warm for k, name in enumerate(parts)}
    flags = check_campaign(gantry.campaign.with_conditions(ambient=None, **readings), gantry.drawing)
    told = [(FlagCode.CONDITION_UNIT, (f"{parts[0]}_degC",))] if zero else []
    assert [(flag.code, flag.columns) for flag in flags] == told


def test_a_payload_hangs_where_the_robot_file_says(machine):
    """As in a diagnosis: the centre of mass of a ladle counts only for the robot that has one."""
    rows, campaign = np.arange(5), machine.campaign
    metadata = campaign.metadata.model_copy(update={"ladle_centre_of_mass_m": (0.3, 0.2, -0.5)})
    stated = damaged(campaign, metadata=metadata)
    first, second = (list(_by_weight(one, machine.drawing, one.drives[rows], rows)) for one in (campaign, stated))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(("poses", "told"), [(4, False), (15, True)])
def test_a_step_needs_ten_poses_on_either_side_however_often_each_was_read(poses, told):
    """Each pose of a real arm was read three times; the last few, with equal errors, counted as a moved tracker."""
    once, random = Machine(EXAMPLES / "robots" / "arm" / "robot.yaml", count=90).campaign, np.random.default_rng(5)
    shift = np.where(np.arange(90) >= 90 - poses, 6e-4, 0.0)[:, None]
    place = np.repeat(once.position_m + shift, 3, axis=0) + 1e-6 * random.normal(size=(270, 3))
    thrice = dataclasses.replace(once.subset(np.repeat(np.arange(90), 3)), position_m=place, lines=np.arange(2, 272))
    assert ("measurement_jump" in codes(check_campaign(thrice))) == told


@pytest.mark.parametrize(("digit_mm", "copied", "told"), [(1e-3, 0, False), (1e-6, 0, False), (1e-6, 5, True)])
def test_equal_readings_of_few_digits_are_no_duplicates(digit_mm, copied, told):
    """A tracker with 1 um of noise whose program writes whole micrometres, each pose read three times."""
    once, random = Machine(EXAMPLES / "robots" / "arm" / "robot.yaml", count=90).campaign, np.random.default_rng(5)
    place = np.repeat(once.position_m, 3, axis=0) + 1e-6 * random.normal(size=(270, 3))
    place = np.round(place / (1e-3 * digit_mm)) * (1e-3 * digit_mm)
    place[1 : 3 * copied : 3] = place[: 3 * copied : 3]
    thrice = once.subset(np.repeat(np.arange(90), 3))
    seen = dataclasses.replace(thrice, position_m=place, rotation_vector_rad=None, lines=np.arange(2, 272))
    metadata = CampaignMetadata(robot=once.robot.name)
    assert ("repeated_rows" in codes(check_campaign(dataclasses.replace(seen, metadata=metadata)))) == told


@pytest.mark.parametrize(("beside", "grave"), [(False, False), (True, True)])
def test_a_touched_plane_is_no_stuck_column(machine, beside, grave):
    """A probe on a print bed: z is 0 in all rows and nothing else is measured; with other coordinates it is stuck."""
    touched = np.full_like(machine.campaign.position_m, np.nan)
    touched[:, 2] = 0.0
    touched[:, 0] = machine.campaign.position_m[:, 0] if beside else np.nan
    found = check_campaign(dataclasses.replace(machine.campaign, position_m=touched, rotation_vector_rad=None))
    (hung,) = (flag for flag in found if flag.code == FlagCode.STUCK_COLUMN)
    assert (hung.severity == Severity.ERROR) == grave
    assert ("plane" in hung.remedy) != grave


def test_with_few_positions_a_wrong_unit_of_drives_is_named_too():
    """One place and single coordinates of eight poses: they show that a unit is wrong, not which."""
    folder = EXAMPLES / "machines" / "hangprinter"
    campaign = Campaign.read(folder / "with_camera.csv", RobotDefinition.load(folder / "robot.yaml"))
    assert not codes(check_campaign(campaign)) & {"position_unit", "drive_unit"}
    radians = "columns 'line_a_deg', 'line_b_deg', 'line_c_deg', 'line_d_deg' seem to hold radians under a heading"
    for changes, said in (
        ({"drives": lambda d: d * DEG}, radians),
        ({"position_m": lambda p: p / 25.4}, "the measured positions seem to hold inches under a heading in milli"),
    ):
        messages = [flag.message for flag in check_campaign(damaged(campaign, **changes)) if "unit" in flag.code]
        assert len(messages) == 1 and messages[0].startswith(said) and "equally" not in messages[0]
