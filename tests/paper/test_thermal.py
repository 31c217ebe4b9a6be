"""The study of the paper's section 5: its figures against the library, its rules, its page."""

import dataclasses
import re

import numpy as np
import pytest

from pouring_robot.robot.pouring.platform_pose import PlatformPose
from scripts.paper.__main__ import app
from scripts.paper.thermal import plots
from scripts.paper.thermal.claims import judge_all
from scripts.paper.thermal.report import ThermalReport
from scripts.paper.thermal.study import MELTS_DEGC, POSES, TILT_RAD, draw_poses, run_thermal_study
from tests.support import BOX_LOWER, BOX_UPPER, ROOT


@pytest.fixture(scope="module")
def study():
    """A small one: fewer poses left out and fewer all over the workspace."""
    steps = []
    found = run_thermal_study("paper", 2022, 0, lambda *step: steps.append(step), left_out=10, box_poses=20)
    assert steps == [("heating the robot", k, 3) for k in range(4)]
    return found


@pytest.fixture(scope="module")
def report(study):
    return ThermalReport.of(study)


def verdicts(study):
    return {claim.key: claim.verdict for claim in judge_all(study)}


def test_poses_are_the_papers(drawing):
    poses = draw_poses(drawing.layout, 50, np.random.default_rng(0))
    places = np.array([pose.position_m for pose in poses])
    assert np.all(places >= BOX_LOWER[:3]) and np.all(places <= BOX_UPPER[:3])
    assert {pose.tilt_rad for pose in poses} == {TILT_RAD} == {np.radians(10.0)}
    assert poses == draw_poses(drawing.layout, 50, np.random.default_rng(0))


def test_error_sets_are_where_the_warm_drawing_is(study, drawing):
    from pouring_robot.thermal.expansion.leg_growth import ThermalExpansion
    from pouring_robot.thermal.expansion.warm_pouring_robot import WarmRobot
    from pouring_robot.thermal.network.thermal_network import ThermalNetwork

    network = ThermalNetwork(drawing)
    assert study.moved.shape == (12, POSES, 3)
    for j, k in ((0, 3), (11, 7)):
        pose = study.poses[k]
        warm = WarmRobot(drawing, ThermalExpansion.from_field(network.steady(pose, MELTS_DEGC[j])), pose).solve()
        away = PlatformPose.from_se3(warm.pose_base_to_end).position_m
        assert study.moved[j, k] == pytest.approx(np.subtract(away, pose.position_m), abs=1e-12)
    assert study.tables["Y"].errors == pytest.approx(study.moved[:, :, 1])


def test_magnitudes_of_the_paper(study):
    said = verdicts(study)
    for key in (
        "cold_chains",
        "cool_edge",
        "mostly_300",
        "near_500",
        "mean_3_mm",
        "one_direction",
        "linear",
        "collinearity",
    ):
        assert said[key] == "reproduced", key
    # What falls short is said so: these are known, and nothing is tuned to hide them.
    for key in ("guard", "first_component", "figures_11_and_12", "unseen_poses", "by_components", "other_axes"):
        assert said[key] == "differs", key


def test_the_shell_is_cooler_than_a_flat_walls(study):
    (edge,) = (claim for claim in judge_all(study) if claim.key == "cool_edge")
    assert edge.figures["flat_degC"] == pytest.approx((0.055 * 1700 + 12.5 * 0.04 * 20) / (0.055 + 12.5 * 0.04))
    assert edge.figures["shell_degC"] < edge.figures["flat_degC"] and "would be at 186 °C" in edge.why


def in_the_box(study, **figures):
    return {"box": [dataclasses.replace(pose, **figures) for pose in study.box]}


@pytest.mark.parametrize(
    ("changes", "key", "verdict"),
    [
        (
            lambda s: {"box": [dataclasses.replace(p, hot_largest_m=8.5e-3) for p in s.box]},
            "largest_9_mm",
            "reproduced",
        ),
        (lambda s: {"box": [dataclasses.replace(p, hot_largest_m=7e-3) for p in s.box]}, "largest_9_mm", "differs"),
        (lambda s: {"box": [dataclasses.replace(p, hot_mean_m=2e-3) for p in s.box]}, "mean_of_parts", "differs"),
        (lambda s: {"conduction": s.radiation}, "cold_chains", "differs"),
        (lambda s: {"radiation": s.conduction}, "mostly_300", "differs"),
        (lambda s: {"radiation": s.conduction}, "near_500", "differs"),
        (lambda s: {"moved": s.moved * 2.0}, "mean_3_mm", "differs"),
        (lambda s: {"moved": s.moved * np.where(np.arange(POSES) % 2, -1.0, 1.0)[:, None]}, "one_direction", "differs"),
        (lambda s: {"moved": np.abs(s.moved) ** 3}, "linear", "differs"),
        (
            lambda s: {"moved": s.moved + 0.3e-3 * np.random.default_rng(0).normal(size=s.moved.shape)},
            "collinearity",
            "differs",
        ),
    ],
)
def test_other_figures_get_other_verdicts(study, changes, key, verdict):
    assert verdicts(dataclasses.replace(study, **changes(study)))[key] == verdict


def test_unseen_poses_against_plain_lines(study):
    table, judged = study.tables["X"], study.judged["X"]
    found, temperature = study.unseen("X"), table.temperatures_K
    for number, name in enumerate(study.sensitive("X"), start=1):
        line = np.polynomial.Polynomial.fit(temperature, table.errors[:, table.names.index(name)], 1)
        left = judged.errors - line(temperature)[:, None]
        single = found[f"single {number}"]
        assert (single.mean, single.spread) == pytest.approx((left.mean(), left.std(ddof=1)), rel=1e-9)
    whole = np.polynomial.Polynomial.fit(temperature, table.errors.mean(axis=1), 1)
    left = judged.errors - whole(temperature)[:, None]
    assert (found["mean"].mean, found["mean"].rms) == pytest.approx((left.mean(), np.sqrt(np.mean(left**2))), rel=1e-9)


def test_only_the_pose_helps_in_y(study):
    """Left and right err in opposite directions: no line of temperature helps, one that knows the pose does."""
    found = study.unseen("Y")
    assert min(found[name].rms for name in ("paper", "components", "mean")) > 0.9 * found["none"].rms
    assert found["pose"].rms < 0.2 * found["none"].rms


def test_the_ladles_growth_adds_to_what_o_moves(study):
    for pose in study.box:
        assert pose.o_m < pose.largest_m < pose.hung_largest_m < pose.hall_largest_m
        assert pose.mean_m < pose.largest_m and pose.hot_mean_m < pose.hot_largest_m


def test_everything_is_written_and_says_the_same(report, tmp_path):
    written = report.write(tmp_path / "out")
    names = {path.name for path in written}
    assert {f"paper_fig{n}.png" for n in range(6, 13)} <= names
    assert {"claims.csv", "claims.json", "paper_thermal.md", "error_sets.csv", "poses.csv"} <= names
    page = (tmp_path / "out" / "paper_thermal.md").read_text(encoding="utf-8")
    assert report.text() in page and "reproduce_paper.py thermal`" in page
    assert all(path.stat().st_size > 200 for path in written)
    assert max(map(len, report.text().splitlines())) <= 120


def test_the_same_study_gives_the_same_pictures(report, study):
    assert plots.errors_over_temperature(study) == report.figures["paper_fig9.png"]


def test_the_page_in_docs_is_complete():
    page = (ROOT / "docs" / "paper_thermal.md").read_text(encoding="utf-8")
    pictures = re.findall(r"\]\((paper_fig\d+\.png)\)", page)
    assert len(pictures) == 7
    assert all((ROOT / "docs" / name).stat().st_size > 1000 for name in pictures)
    assert "18 claims" in page


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--layout", "round"], "unknown layout 'round'"),
        (["--seed", "-1"], "--seed"),
        (["--out", "/proc/x"], "/proc/x"),
    ],
)
def test_the_script_refuses_in_one_line(arguments, says, capsys):
    with pytest.raises(SystemExit) as ended:
        app(["thermal", *arguments], prog_name="reproduce_paper.py")
    error = capsys.readouterr().err
    assert ended.value.code == 2
    assert says in error and "Traceback" not in error
