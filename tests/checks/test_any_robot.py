"""Checks of robots that nobody wrote them for: sound data pass, planted damage is named, real data stay unaccused."""

import dataclasses
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.checks.check import check_campaign, examine
from pouring_robot.checks.flags import FlagCode, outlier_rows
from pouring_robot.cli.app import main
from pouring_robot.mechanism.rotations import rotation_matrices, rotation_vectors
from pouring_robot.robot.description.definition import RobotDefinition
from tests.campaign.simulated import codes, damaged
from tests.estimation.virtual import TRUE_FRAMES
from tests.support import gantry_file

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SIGMA = 5e-5
DEG = np.pi / 180.0


class Machine:
    """A robot whose drives stand a little beside their commands, seen by a tracker."""

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


@pytest.mark.parametrize("full", [True, False])
def test_outliers_are_found_and_no_sound_row(machine, full):
    campaign = machine.campaign if full else damaged(machine.campaign, rotation_vector_rad=None)
    position = np.array(campaign.position_m)
    position[[3, 50, 77]] += 0.01
    flags = check_campaign(damaged(campaign, position_m=position), machine.drawing)
    assert outlier_rows(flags).tolist() == [3, 50, 77]


def test_what_bends_with_the_place_is_no_noise(machine):
    """Guides that bow, skew to the tracker: a product of two coordinates that shows in all components."""
    position = np.array(machine.campaign.position_m)
    x = (position - position.mean(axis=0)) / position.std(axis=0)
    position += 12.0 * SIGMA * (x[:, :1] * x[:, 1:2])
    found = codes(
        check_campaign(damaged(machine.campaign, position_m=position, rotation_vector_rad=None), machine.drawing)
    )
    assert "noise_too_small" not in found


@pytest.mark.parametrize("machine", ["arm", "hexapod"], indirect=True)
def test_what_goes_by_a_drive_s_own_place_is_no_noise(machine):
    """A gear that turns too far, an encoder off centre, or a screw that errs with every turn, in one drive."""
    campaign, drives = machine.campaign, machine.campaign.drives
    turn = 0.01 if campaign.robot.drives[0].unit == "m" else 2.0 * np.pi
    metadata = campaign.metadata.model_copy(update={"screw_pitch_m": 0.01})
    for k in range(drives.shape[1]):
        for off in (1e-3 * drives[:, k], 3e-4 * np.sin(2.0 * np.pi * drives[:, k] / turn)):
            # The robot went to the table's commands, of which the table tells what the drive's error leaves.
            told = damaged(campaign, drives=drives - off[:, None] * np.eye(drives.shape[1])[k], metadata=metadata)
            assert "noise_too_small" not in codes(check_campaign(told, machine.drawing))


def test_a_tracker_that_stands_elsewhere_in_each_session_is_no_noise(machine):
    sessions = np.arange(len(machine.campaign)) // 20
    moved = 8.0 * SIGMA * np.random.default_rng(0).normal(size=(sessions[-1] + 1, 3))
    position = machine.campaign.position_m + moved[sessions]
    how = {"position_m": position, "rotation_vector_rad": None}
    campaign = damaged(machine.campaign, sessions=[str(session) for session in sessions], **how)
    assert "noise_too_small" not in codes(check_campaign(campaign, machine.drawing))
    without = damaged(campaign, sessions=["1"] * len(campaign))
    assert "noise_too_small" in codes(check_campaign(without, machine.drawing))


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
        # Of what only shifts, the inverse is the mirror image; so is that of three arms with two exchanged.
        assert codes(flags) <= {"frames_swapped", "drives_exchanged", "mirrored_axes"}
        assert "seem to be inverse" in flags[0].message
        assert "as well possible" in flags[0].message
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
def test_turning_drives_that_count_from_another_zero(machine, turn):
    """As of two tables of links that put the zero of a joint a quarter turn apart."""
    robot, at = machine.campaign.robot, 1
    counted = damaged(
        machine.campaign, drives=machine.campaign.drives - np.radians(turn) * np.eye(len(robot.drives))[at]
    )
    (flag,) = check_campaign(counted, machine.drawing)
    assert flag.code == "drive_zero"
    assert f"at {turn}° (zero: {np.radians(turn):.6g})" in flag.message


@pytest.mark.parametrize("machine", ["arm"], indirect=True)
def test_an_encoder_that_wraps_is_told(machine):
    """A joint that is counted from 0° to 360° stands a turn beyond its limits in half of the rows."""
    wound = (
        np.where(machine.campaign.drives[:, 1:2] < 0.0, 2.0 * np.pi, 0.0)
        * np.eye(len(machine.campaign.robot.drives))[1]
    )
    (flag,) = check_campaign(damaged(machine.campaign, drives=machine.campaign.drives + wound), machine.drawing)
    assert flag.code == "unreachable_drives"
    assert flag.columns == (machine.campaign.heading(machine.campaign.robot.drives[1].column),)
    assert "stands whole turns beyond the limits of the joint" in flag.message


def test_of_equal_mistakes_none_takes_drives_beyond_their_limits(gantry):
    """Of three slides at right angles any exchange or sign is a change of frames; where they can go tells."""
    exchanged = damaged(gantry.campaign, drives=gantry.campaign.drives[:, [1, 0, 2]])
    flags = check_campaign(exchanged, gantry.drawing)
    assert flags[0].code == "drives_exchanged"
    assert flags[0].columns == ("x_slide_m", "y_slide_m")
    assert "as well possible" not in flags[0].message


def test_exchanged_drives_of_many(machine):
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
        # The mirror image of a plane is the plane seen from behind; turns are then the other way.
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
    """A campaign of an arm that bends under its own weight."""
    folder, file = tmp_path_factory.mktemp("sagging"), EXAMPLES / "robots" / "arm" / "robot.yaml"
    model, table = folder / "sagging.yaml", folder / "c.csv"
    model.write_text(SAGGING.format(robot=file))
    assert main(["campaign", "simulate", "--random", "160", "--model", str(model), "--out", str(table), "-q"]) == 0
    return Campaign.read(table, RobotDefinition.load(file))


@pytest.mark.parametrize(("stated_mm", "too_small"), [(0.05, False), (0.015, True)])
def test_sag_under_its_own_weight_is_no_noise(sagging, stated_mm, too_small):
    sigmas = {"sigma_position_m": 1e-3 * stated_mm, "sigma_rotation_rad": 1e-3 * stated_mm}
    campaign = dataclasses.replace(sagging, metadata=sagging.metadata.model_copy(update=sigmas))
    flags = check_campaign(campaign, sagging.robot.drawing())
    assert (FlagCode.NOISE_TOO_SMALL in {flag.code for flag in flags}) == too_small


@pytest.fixture(scope="module")
def ur10():
    robot = RobotDefinition.load(EXAMPLES / "machines" / "ur10" / "robot.yaml")
    return robot, robot.drawing()


@pytest.mark.parametrize("series", ["a", "c"])
def test_a_real_arm_is_not_accused(ur10, series):
    robot, drawing = ur10
    campaign = Campaign.read(EXAMPLES / "machines" / "ur10" / f"series_{series}.csv", robot)
    found = examine(campaign, drawing)
    assert codes(found.flags) <= {"ignored_columns", "no_temperatures", "no_noise_level"}
    if series == "c":
        # Frames alone leave 0.99 mm rms of the distance, by an independent fit.
        distance = np.linalg.norm(found.fit.position_residual_m, axis=1)
        assert np.sqrt(np.mean(distance**2)) == pytest.approx(0.99e-3, abs=0.02e-3)


def test_wrong_rows_among_real_ones_are_found(ur10):
    robot, drawing = ur10
    campaign = Campaign.read(EXAMPLES / "machines" / "ur10" / "series_c.csv", robot)
    position = np.array(campaign.position_m)
    wrong = np.random.default_rng(1).permutation(len(campaign))[:20]
    position[wrong] += 0.004
    flags = check_campaign(dataclasses.replace(campaign, position_m=position), drawing)
    assert outlier_rows(flags).tolist() == sorted(wrong.tolist())
