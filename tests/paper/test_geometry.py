"""The paper's section 4: verdicts that follow from the study, and a study that follows from plain formulas."""

import csv
import dataclasses
import importlib.util
import io
import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

from pouring_robot.exceptions import BadInputError, OutputError, UnknownLayoutError
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.robot.dh.chain import A, D, dh_chain, dh_transform
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.sensitivity.samples import AXES
from scripts.paper.geometry import shape_claims as shapes
from scripts.paper.geometry import size_claims as sizes
from scripts.paper.geometry.closure import rotation_vectors
from scripts.paper.geometry.comparison import axis_rows
from scripts.paper.geometry.report import GeometryReport
from scripts.paper.geometry.study import error_size, run_study
from tests.support import perturbed

POSES, SEED = 400, 5
SCRIPT = Path(__file__).parents[2] / "scripts" / "reproduce_paper.py"
OPEN_DIFFERS = {"negligible_attitude", "eight_omitted", "concentrated", "pile_theta1"}
WIDE_DIFFERS = {"seven_in_chain", "near_upper", "both_signs"}
CANNOT = {"table_3_cells"}


@pytest.fixture(scope="module")
def paper():
    return GeometryReport.of(run_study("paper", POSES, SEED))


@pytest.fixture(scope="module")
def wide():
    return GeometryReport.of(run_study("wide", POSES, SEED))


def keys(judged, verdict):
    return {claim.key for claim in judged if claim.verdict == verdict}


def test_verdicts_of_the_papers_layout(paper):
    assert keys(paper.table, "differs") == {"eight_or_nine"}
    assert keys(paper.opened, "differs") == OPEN_DIFFERS
    assert keys(paper.table + paper.opened, "cannot be checked") == CANNOT
    assert len(paper.table + paper.opened) == 26


def test_another_layout_gets_other_verdicts(wide):
    assert keys(wide.table, "differs") == {"eight_or_nine"}
    assert keys(wide.opened, "differs") == OPEN_DIFFERS | WIDE_DIFFERS


def test_the_closed_chain_contradicts_nearly_everything(paper):
    assert keys(paper.closed, "reproduced") == {"main_y"}
    assert paper.lesson.without_effect == ("θ1", "d3", "a34", "a45", "d5")
    assert paper.lesson.over_10mm[0] == 0
    assert paper.lesson.over_10mm[1] > 20


def test_open_branches_understate_y_above_all(paper):
    x, y, z = paper.lesson.ratios
    assert 10.0 < y < 20.0
    assert x < 1.0
    assert z < 1.0
    assert [row.ratio for row in axis_rows(paper.study)[:3]] == [x, y, z]


def test_seven_errors_are_those_that_plain_geometry_gives(paper):
    """α01 turns about X at O, θ1 about Y and α12 about Z at the U-joint centre, α56 about the foot's z at B."""
    study = paper.study
    errors = study.open_branch.of_chain(1)
    position, centre = study.command.start.position, study.layout.fixed_centres.metres[0]
    for label, axis, point in (("α01", 0, np.zeros(3)), ("θ1", 1, centre), ("α12", 2, np.array(centre))):
        arm = position - point
        expected = arm @ pin.exp3(0.004 * np.eye(3)[axis]).T - arm
        found = errors.moves(label)
        sign = np.sign((expected * found).sum())
        np.testing.assert_allclose(found, arm @ pin.exp3(sign * 0.004 * np.eye(3)[axis]).T - arm, atol=1e-12)
    arm = np.linalg.norm(study.layout.moving_centres.metres[0][:2])
    assert errors.distance_m[errors.labels.index("α56")].max() <= 2.0 * np.sin(0.002) * arm + 1e-12


def test_length_errors_move_by_their_size_and_angles_turn_by_theirs(paper):
    errors = paper.study.open_branch
    np.testing.assert_allclose(errors.of_unit("m").distance_m, 2e-4, atol=1e-13)
    np.testing.assert_allclose(errors.of_unit("rad").angle_rad, 4e-3, atol=1e-13)


@pytest.mark.parametrize("name", ["alpha_e1_01", "theta_e2_o", "d_e3_4", "theta_e4_6", "a_e4_6o"])
def test_closed_chain_equals_the_one_at_a_time_solver(paper, name):
    study = paper.study
    nominal = RobotModel().definition.mechanism()
    kinematics = FourUPUKinematics(nominal)
    parameter = study.table[name]
    moved = study.table.placement_errors({name: error_size(parameter)})
    solver = ClosureSolver(perturbed(nominal, moved))
    row = study.closed_chain.parameters.index(parameter)
    for k in (0, 7, 40):
        pose = PlatformPose(tuple(study.command.start.position[k]), float(study.command.poses[k, 3]))
        actual = solver.solve_from(kinematics.configuration(pose)).pose("fixed_platform", "moving_platform")
        expected = actual.translation - study.command.start.position[k]
        np.testing.assert_allclose(study.closed_chain.translation_m[row, k], expected, atol=1e-10)
        turn = pin.log3(actual.rotation @ pose.to_se3().rotation.T)
        np.testing.assert_allclose(study.closed_chain.rotation_rad[row, k], turn, atol=1e-10)


def test_first_order_meets_the_exact_closure_to_second_order(paper):
    miss, moved = paper.lesson.first_order
    assert miss < 0.05 * moved
    assert paper.lesson.first_order_tenth < 0.012 * miss


def test_rotation_vectors_are_the_logarithm():
    vectors = np.random.default_rng(3).normal(size=(20, 3)) * 0.2
    vectors[0] = 0.0
    turned = np.stack([pin.exp3(vector) for vector in vectors])
    np.testing.assert_allclose(rotation_vectors(turned), vectors, atol=1e-13)


@pytest.mark.parametrize(
    ("judge", "change"),
    [
        (sizes.only_angles, lambda e: e.translation_m * np.array([[[6.0 * (p.unit == "m")]] for p in e.parameters])),
        (sizes.seven_in_chain, lambda e: 0.5 * e.translation_m),
        (sizes.length_size, lambda e: 10.0 * e.translation_m),
        (sizes.negligible_position, lambda e: e.translation_m + 1e-4),
        (sizes.table_3, lambda e: 0.0 * e.translation_m),
        (shapes.main_x, lambda e: e.translation_m[:, :, ::-1]),
        (shapes.main_y, lambda e: e.translation_m[:, :, [1, 0, 2]]),
        (shapes.alike, lambda e: e.translation_m * np.array([[[1.0 + (p.symbol == "theta")]] for p in e.parameters])),
        (shapes.uniform, lambda e: e.translation_m - e.translation_m.mean(axis=1, keepdims=True)),
        (shapes.both_signs, lambda e: 1.1 * e.translation_m),
        (
            shapes.both_signs,
            lambda e: np.abs(e.translation_m) * np.array([[[1.0 - 2.0 * (p.symbol == "alpha")]] for p in e.parameters]),
        ),
        (shapes.pile_tight, lambda e: 10.0 * (e.translation_m - e.translation_m.mean(axis=1, keepdims=True))),
        (
            shapes.narrow,
            lambda e: e.translation_m * np.array([[[3.0 if "12" in p.name else 1.0]] for p in e.parameters]),
        ),
        (shapes.near_upper, lambda e: 1e-2 - np.abs(e.translation_m)),
    ],
)
def test_verdicts_turn_when_the_study_says_otherwise(paper, judge, change):
    errors = paper.study.open_branch.of_chain(1)
    assert judge(paper.study, errors).verdict == "reproduced"
    assert judge(paper.study, dataclasses.replace(errors, translation_m=change(errors))).verdict == "differs"


def test_concentration_can_be_reproduced(paper):
    errors = paper.study.open_branch.of_chain(1)
    swapped = dataclasses.replace(errors, translation_m=errors.translation_m[:, :, [0, 2, 1]])
    assert shapes.concentrated(paper.study, errors).verdict == "differs"
    assert shapes.concentrated(paper.study, swapped).verdict == "reproduced"


def test_attitude_verdicts_turn(paper):
    errors = paper.study.open_branch.of_chain(1)
    none = dataclasses.replace(errors, rotation_rad=0.0 * errors.rotation_rad)
    assert sizes.attitude_size(paper.study, none).verdict == "differs"
    assert sizes.negligible_attitude(paper.study, none).verdict == "reproduced"


def test_same_seed_same_study(paper):
    again = run_study("paper", POSES, SEED)
    np.testing.assert_array_equal(again.closed_chain.translation_m, paper.study.closed_chain.translation_m)
    other = run_study("paper", 2, SEED + 1)
    assert not np.array_equal(other.command.poses, again.command.poses[:2])


def test_files_hold_every_claim_and_the_seed(paper, tmp_path):
    written = {path.name: path for path in paper.write(tmp_path / "new" / "folder", " --poses 400")}
    record = json.loads(written["claims.json"].read_text("utf-8"))
    assert (record["seed"], record["poses"], record["layout"]) == (SEED, POSES, "paper")
    assert len(record["claims"]) == 45
    rows = list(csv.DictReader(io.StringIO(written["claims.csv"].read_text("utf-8"))))
    assert [row["verdict"] for row in rows] == [claim["verdict"] for claim in record["claims"]]
    assert len(list(csv.DictReader(io.StringIO(written["parameters.csv"].read_text("utf-8"))))) == 100
    page = written["paper_geometry.md"].read_text("utf-8")
    assert paper.text() in page
    assert f"seed {SEED}" in page
    pictures = [path for path in written.values() if path.suffix == ".png"]
    assert len(pictures) == 5
    for path in pictures:
        assert path.name in page
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.stat().st_size < 150_000


def test_printed_text_names_each_claim_once(paper):
    text = " ".join(paper.text().split())
    assert "26 claims: 20 reproduced, 5 differs, 1 cannot be checked" in text
    assert all(line == line.rstrip() for line in paper.text().splitlines())


def test_formula_2_gives_the_place_of_o_without_d_o():
    """The paper's sum over d S and a a of a chain ends with a_6o: d_o, which counts as an error, is 0."""
    mechanism = RobotModel(layout="paper").definition.mechanism()
    for k in range(4):
        chain, frame, place = dh_chain(mechanism, k), np.eye(4), np.zeros(3)
        for j, row in enumerate(chain.nominal):
            place = place + row[A] * frame[:3, 0]
            frame = frame @ dh_transform(row)
            place = place + (row[D] * frame[:3, 2] if j < 7 else 0.0)
        assert place == pytest.approx(frame[:3, 3], abs=1e-12)


def test_bad_input():
    with pytest.raises(UnknownLayoutError):
        run_study("papre", 10, 0)
    with pytest.raises(BadInputError, match="two poses"):
        run_study("paper", 1, 0)


def test_folder_that_cannot_be_made(paper, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        paper.write_docs(tmp_path / "file" / "below")


def test_labels_are_unique_in_a_chain(paper):
    for chain in (1, 2, 3, 4):
        labels = paper.study.open_branch.of_chain(chain).labels
        assert len(labels) == len(set(labels)) == 25
    closed = paper.study.closed_chain.of_chain(1)
    assert closed.main_axis("θ1") == "none" and not closed.along("θ1").any()  # round-off has no distribution
    assert shapes.pile_theta1(paper.study, closed).computed == "moves o nowhere"
    assert paper.study.open_branch.of_chain(1).main_axis("θ1") in AXES


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("reproduce_paper", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_command_prints_and_writes(script, tmp_path):
    result = CliRunner().invoke(script.app, ["geometry", "--poses", "20", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert "claim by claim" in result.output
    assert "--poses 20`" in (tmp_path / "paper_geometry.md").read_text("utf-8")


@pytest.mark.parametrize(
    "arguments", [["--layout", "papre"], ["--poses", "1"], ["--seed", "-1"], ["--out", "/dev/null/folder"]]
)
def test_command_refuses_bad_input_with_exit_code_2(script, arguments, tmp_path):
    result = CliRunner().invoke(script.app, ["geometry", "--out", str(tmp_path), *arguments])
    assert result.exit_code == 2
    assert "Traceback" not in result.output
