"""Instruments: closed forms of their readings, central differences, frames from single coordinates and distances."""

import dataclasses
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from pouring_robot.batch import engine_for
from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.calibration.summary import notes_of, warnings_of
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.effects.conditions import conditions_of
from pouring_robot.effects.nominal_rows import nominal_rows
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.estimation.kinds import KINDS, component_name, kind_of
from pouring_robot.estimation.map_fit import FitOptions, identify
from pouring_robot.estimation.measurement import MeasurementModel, Unknowns
from pouring_robot.estimation.noise import NoiseLevel, noise_beforehand
from pouring_robot.estimation.residuals import MeasuredPoses, whiten
from pouring_robot.exceptions import CampaignError, FrameFitError
from pouring_robot.mechanism.local_parameters import DriveParameter
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.model import RobotModel

ARM = Path(__file__).parents[2] / "examples/machines/ur10/robot.yaml"
TRACKER = OuterFrames(
    pin.SE3(Rotation.from_rotvec([0.4, -0.2, 2.1]).as_matrix(), np.array([1.7, -2.3, 0.4])),
    pin.SE3(np.eye(3), np.array([0.05, -0.02, 0.11])),
)
NOISE = NoiseLevel.stated(1e-4, 1e-4)
STEP = 1e-6
MADE = CampaignMetadata(robot="ur10")


@pytest.fixture(scope="module")
def model():
    return MeasurementModel(RobotModel(robot=str(ARM)), (DriveParameter("elbow_joint", "rad"),))


@pytest.fixture(scope="module")
def drives():
    return np.random.default_rng(5).uniform(-1.5, 1.5, (24, 6)) + np.array([0.0, -1.5, 1.0, 0.0, 0.5, 0.0])


@pytest.fixture(scope="module")
def places(model, drives):
    """Positions of the target in the base, by Pinocchio alone."""
    pinocchio = pin.buildModelFromUrdf(str(ARM.with_name("ur10.urdf")))
    data, seen = pinocchio.createData(), []
    for row in drives:
        pin.framesForwardKinematics(pinocchio, data, row)
        seen.append((data.oMf[pinocchio.getFrameId("tool0")] * TRACKER.T_end_target).translation.copy())
    return np.array(seen)


def campaign_of(drives, **measured):
    n = len(drives)
    return Campaign(
        path=Path("made.csv"),
        lines=np.arange(n) + 2,
        samples=tuple(f"p{k}" for k in range(n)),
        sessions=("1",) * n,
        headings={},
        ignored_columns=(),
        drives=drives,
        **({"robot": RobotDefinition.load(ARM), "metadata": MADE, "position_m": np.full((n, 3), np.nan)} | measured),
    )


def tracked(places):
    return places @ TRACKER.T_tracker_base.rotation.T + TRACKER.T_tracker_base.translation


def test_components_have_kinds_and_names():
    assert [KINDS[k] for k in kind_of(np.arange(9))] == ["position"] * 3 + ["rotation"] * 3 + ["distance"] + [
        "closure"
    ] * 2
    assert [component_name(k) for k in (0, 5, 6, 7, 8)] == ["x", "rz", "distance", "closure", "closure_2"]


def test_distances_are_those_between_positions(model, drives, places):
    starts = ("", *("p0" if k % 2 else "" for k in range(1, len(drives))))
    seen = tracked(places)
    fixed = np.array([not name for name in starts])
    length = np.where(fixed, np.linalg.norm(seen, axis=1), np.linalg.norm(places - places[0], axis=1))
    campaign = campaign_of(drives, distance_m=length[:, None] + 1e-3, distance_from=starts)
    measured = MeasuredPoses.from_campaign(campaign, NOISE)
    found = measured.residual(model.at(drives).predict(Unknowns.zero(TRACKER, 1)))
    np.testing.assert_allclose(found[:, 6], 1e-3, atol=1e-12)
    assert np.isnan(found[:, :6]).all()
    assert found.shape[1] == 7


def test_derivatives_of_coordinates_and_distances(model, drives, places):
    position = np.where(np.random.default_rng(1).random((24, 3)) < 0.4, tracked(places), np.nan)
    starts = tuple("p3" if k % 3 == 1 else "" for k in range(24))
    campaign = campaign_of(drives, position_m=position, distance_m=np.full((24, 1), 2.0), distance_from=starts)
    measured, rows = MeasuredPoses.from_campaign(campaign, NOISE), model.at(drives)
    start = Unknowns.zero(TRACKER, 1)
    values = np.full(13, 0.02)
    equations = whiten(measured, rows.linearise(start.at(values)))
    assert np.isfinite(equations.residual).all()
    for k in range(13):
        step = STEP * np.eye(13)[k]
        ends = [whiten(measured, rows.predict(start.at(values + s * step))).residual for s in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * STEP)
        np.testing.assert_allclose(equations.jacobian[:, k], slope, atol=2e-5 * max(1.0, np.abs(slope).max()))


def test_a_row_without_readings_is_usable_as_the_start_of_distances(model, drives, places):
    """A diagnosis left it out, and with it every distance from there."""
    length = np.linalg.norm(places - places[0], axis=1)[:, None]
    length[0], length[5] = np.nan, np.nan
    campaign = campaign_of(drives, distance_m=length, distance_from=("", *("p0",) * 23))
    assert np.flatnonzero(~campaign.usable).tolist() == [5]


def test_a_distance_counts_only_with_the_row_it_starts_from(model, drives, places):
    length = np.linalg.norm(places - places[0], axis=1)[:, None]
    campaign = campaign_of(drives, distance_m=length, distance_from=("", *("p0",) * 23))
    kept = np.arange(2, 24)
    measured = MeasuredPoses.from_campaign(campaign, NOISE)
    for part in (measured[kept], MeasuredPoses.from_campaign(campaign.subset(kept), NOISE)):
        assert not part.known.any()
    with_start = measured[np.array([5, 0, 9])]
    assert with_start.known[:, 6].tolist() == [True, True, True]


def test_a_subset_of_rows_keeps_the_row_where_its_distances_start(model, drives, places):
    """All start in one place, as with a ball bar: whichever block holds that row, the others can be predicted."""
    length = np.linalg.norm(places - places[20], axis=1)[:, None]
    campaign = campaign_of(drives, distance_m=length, distance_from=tuple("p20" if k != 20 else "" for k in range(24)))
    measured, part = MeasuredPoses.from_campaign(campaign, NOISE), np.array([3, 5, 8])
    used, seen = measured.among(part)
    assert used.tolist() == [3, 5, 8, 20] and seen.known.any(axis=1).tolist() == [True, True, True, False]
    frames = Unknowns.zero(TRACKER, 1)
    np.testing.assert_allclose(seen.residual(model.at(drives[used]).predict(frames))[:3, 6], 0.0, atol=1e-12)
    assert measured.among(np.arange(24))[0].tolist() == list(range(24))


def test_groups_are_chosen_by_distances_from_one_row():
    """That row is in one of the blocks; without it the other rows were neither fitted nor judged."""
    rng = np.random.default_rng(3)
    many = rng.uniform(-1.5, 1.5, (90, 6)) + np.array([0.0, -1.5, 1.0, 0.0, 0.5, 0.0])
    robot = RobotModel(robot=str(ARM))
    off = MeasurementModel(robot, (DriveParameter("elbow_joint", "rad"),))
    there = off.at(many).predict(Unknowns(TRACKER, np.append(np.zeros(12), 2e-3))).position_m
    length = np.linalg.norm(there - there[0], axis=1) + rng.normal(0.0, 1e-4, 90)
    length[0] = np.nan
    metadata = MADE.model_copy(update={"sigma_distance_m": 1e-4})
    campaign = campaign_of(many, distance_m=length[:, None], distance_from=("", *("p0",) * 89), metadata=metadata)
    found = calibrate(campaign, robot, CalibrationOptions(("drives",)))
    line = found.to_frame().set_index("parameter").loc["drive.elbow_joint"]
    assert line["std"] < 0.1 and abs(line["value"] - 2.0) < 4.0 * line["std"]
    # The report calls them distances.
    worse = dataclasses.replace(found, before=found.after, after=found.before)
    assert any(line.startswith("worse on held-out rows: distance ") for line in warnings_of(worse))
    assert any("change none of the measured distances" in line for line in notes_of(found))


@pytest.mark.parametrize("seen", ["one coordinate a row", "height only", "distance"])
def test_frames_come_from_whatever_was_measured(model, drives, places, seen):
    position, given = tracked(places), {}
    if seen == "one coordinate a row":
        given["position_m"] = np.where(np.arange(24)[:, None] % 3 == np.arange(3), position, np.nan)
    elif seen == "height only":
        given["position_m"] = np.where(np.arange(3) == 2, position, np.nan)
    else:
        given["distance_m"] = np.linalg.norm(position, axis=1)[:, None]
    measured = MeasuredPoses.from_campaign(campaign_of(drives, **given), NOISE)
    rows = model.at(drives)
    left = measured.residual(rows.predict(first_frames(rows, measured)))
    assert np.abs(left[np.isfinite(left)]).max() < 1e-6


def test_frames_stay_at_their_start_where_nothing_determines_them():
    """A delta does not rotate: distances between its poses are the same wherever it and the target are."""
    model = RobotModel(robot=str(ARM.parents[2] / "robots" / "delta" / "robot.yaml"))
    drives = np.random.default_rng(2).uniform(-0.3, 0.6, (24, 3))
    rows = MeasurementModel(model, ()).at(drives)
    place = rows.present().position
    length = np.linalg.norm(place - np.roll(place, 1, axis=0), axis=1)[:, None] + 1e-3
    start = tuple(f"p{(k - 1) % 24}" for k in range(24))
    campaign = campaign_of(drives, robot=model.definition, distance_m=length, distance_from=start)
    frames = first_frames(rows, MeasuredPoses.from_campaign(campaign, NOISE)).frames
    assert np.abs(frames.T_end_target.translation).max() < 0.1
    assert np.abs(frames.T_tracker_base.translation).max() < 2.0


@pytest.mark.parametrize("seen", ["single coordinates", "distances from a point", "distances between poses"])
def test_a_zero_is_found_without_measured_poses(model, drives, places, seen):
    """The elbow is 5 mrad beyond its command; the measurements of that move the frames, too, and fit exactly."""
    commanded = drives - [0.0, 0.0, 5e-3, 0.0, 0.0, 0.0]
    position, given = tracked(places), {}
    if seen == "single coordinates":
        given["position_m"] = np.where(np.arange(24)[:, None] % 3 == np.arange(3), position, np.nan)
    elif seen == "distances from a point":
        given["distance_m"] = np.linalg.norm(position, axis=1)[:, None]
    else:
        given["distance_m"] = np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1)[:, None]
        given["distance_from"] = tuple(f"p{(k - 1) % 24}" for k in range(24))
    measured, rows = MeasuredPoses.from_campaign(campaign_of(commanded, **given), NOISE), model.at(commanded)
    prior = np.array([*np.full(12, 0.5), 0.1])
    fit = identify(rows, measured, first_frames(rows, measured), prior, FitOptions(step_tolerance=1e-3))
    assert fit.unknowns.parameters[0] == pytest.approx(5e-3, abs=4.0 * fit.std[12] + 1e-5)
    assert fit.std[12] < 2e-3
    assert np.abs(fit.equations.residual).max() < 0.1


def test_too_few_values_are_refused(model, drives):
    few = np.where(np.arange(24) < 5, 1.0, np.nan)[:, None]
    measured = MeasuredPoses.from_campaign(campaign_of(drives, distance_m=few), NOISE)
    with pytest.raises(FrameFitError):
        first_frames(model.at(drives), measured)


def test_noise_of_each_kind_is_stated_or_unknown(drives):
    campaign = campaign_of(drives, distance_m=np.ones((24, 1)))
    assert noise_beforehand(campaign, np.arange(24)).open_kinds == ("distance",)
    stated = dataclasses.replace(campaign, metadata=MADE.model_copy(update={"sigma_distance_m": 2e-4}))
    found = noise_beforehand(stated, np.arange(24))
    assert (found.open_kinds, found["distance"].sigma, found.length_kind) == ((), 2e-4, "distance")


def test_columns_of_distances_and_forces(tmp_path, drives):
    joints = [drive.column for drive in RobotDefinition.load(ARM).drives]
    head = ["sample", *(f"{j}_rad" for j in joints), "distance_mm", "distance_from", "force_elbow_joint_Nm"]
    lines = [",".join(head)]
    for k, row in enumerate(drives[:8]):
        lines.append(",".join([f"p{k}", *map(str, row), str(100.0 + k), "p0" if k else "", str(5.0 + k)]))
    table = tmp_path / "wire.csv"
    table.write_text("\n".join(lines) + "\n")
    table.with_suffix(".yaml").write_text("robot: ur10\nmetrology: {sigma_distance_mm: 0.2}\n")
    campaign = Campaign.read(table, RobotDefinition.load(ARM))
    assert campaign.usable.all()
    assert campaign.seen == "distances"
    assert campaign.distance_start.tolist() == [-1, *[0] * 7]
    engine = engine_for(campaign.robot.mechanism())
    closure = engine.close(campaign.drives, campaign.robot.drawing().starts(campaign.drives))
    nominal = nominal_rows(campaign.robot, engine, closure)
    force = conditions_of(campaign, nominal).drive_force
    np.testing.assert_allclose(force[:, 2], 5.0 + np.arange(8))
    np.testing.assert_allclose(force[:, 1], nominal.own_force[:, 1])
    again = Campaign.read(campaign.save(tmp_path / "again.csv")[0], campaign.robot)
    np.testing.assert_allclose(again.distance_m, campaign.distance_m, atol=1e-9)
    assert again.distance_from == campaign.distance_from
    table.write_text("\n".join([lines[0], lines[1], lines[2].replace(",p0,", ",p9,")]) + "\n")
    with pytest.raises(CampaignError, match="must be the sample of one other row, not 'p9'") as caught:
        Campaign.read(table, campaign.robot)
    assert (caught.value.line, caught.value.column) == (3, "distance_from")
