"""Tolerance studies of other robots: against first order, over processes, and what they refuse."""

import numpy as np
import pytest

from pouring_robot.exceptions import BadInputError, SweepStoreError
from pouring_robot.robot.robot import Robot
from pouring_robot.sweeps import SweepConfig, SweepPlan, sweep
from pouring_robot.sweeps.analysis.tolerances import transfer_matrices
from tests.robot.test_robot import NAMES, ROBOTS

STUDY = """
format: pouring_robot/sweep/1
robot: {robot}
study: {study}
poses: {{random: {{count: 4, seed: 1}}}}
accuracy_mm: 5
"""


def plan_of(tmp_path, name, study, more=""):
    path = tmp_path / "s.yaml"
    path.write_text(STUDY.format(robot=ROBOTS / name / "robot.yaml", study=study) + more, encoding="utf-8")
    return SweepPlan.load(path)


@pytest.mark.parametrize("name", NAMES)
def test_small_errors_alone_do_what_first_order_says(name, tmp_path):
    """Each error at a hundredth of its tolerance, closed exactly, against the columns of G."""
    plan = plan_of(tmp_path, name, "one_at_a_time")
    sizes = 0.01 * np.array([margin.tolerance for margin in plan.draws.margins])
    exact = plan.moved(np.diag(sizes), plan.poses)
    linear = np.einsum("pik,k->kpi", transfer_matrices(plan, plan.poses)[:, :3], sizes)
    assert not exact.status.any()
    # What is left is of second order: 0.15 mrad of a tilt over metres of lever.
    assert np.abs(exact.displacement[:, :, 0] - linear).max() < 2e-3 * np.abs(linear).max()
    assert plan.config.frames[0] == plan.mechanism.loops.working_frame


def test_processes_and_resumed_runs_agree(tmp_path):
    plan = plan_of(tmp_path, "five_bar", "monte_carlo", "samples: 12\nchunk: 10\n")
    with pytest.raises(BadInputError, match="a sweep is a SweepPlan, a SweepConfig or the path of a file, not a None"):
        sweep(None, tmp_path / "none")
    alone = sweep(plan, tmp_path / "a").to_dataset().displacement.values
    shared = sweep(plan, tmp_path / "b", workers=2).to_dataset().displacement.values
    np.testing.assert_array_equal(alone, shared)
    assert np.isfinite(alone).all()


def test_a_locked_joint_that_is_held_elsewhere_makes_another_sweep(tmp_path):
    """Commands and description are the same; the home says where it is held."""
    text = (ROBOTS / "arm" / "robot.yaml").read_text(encoding="utf-8").replace("xacro: ", f"xacro: {ROBOTS}/arm/")
    text = text.replace("  - {joint: joint5, column: q5}\n", "") + "locked_joints: [joint5]\n"
    (study := tmp_path / "s.yaml").write_text(STUDY.format(robot="robot.yaml", study="one_at_a_time"), encoding="utf-8")
    plans = []
    for home in ("1.5", "0.5"):
        (tmp_path / "robot.yaml").write_text(text.replace("1.5707963267948966", home), encoding="utf-8")
        plans.append(SweepPlan.load(study))
    sweep(plans[0], tmp_path / "out")
    with pytest.raises(SweepStoreError, match="results of another sweep"):
        sweep(plans[1], tmp_path / "out", resume=True)


@pytest.mark.parametrize(
    ("poses", "says"),
    [
        ("poses: {grid: {x: 2}}", "grid and box are of the pouring robot"),
        ("poses: {random: {count: 3, box: {x_mm: [0, 1]}}}", "grid and box are of the pouring robot"),
        ("poses: {file: p.csv}", "line 3: the robot does not close there"),
        ("poses: {random: {count: 3}}\nkind: open_branch", "DH table"),
    ],
)
def test_what_is_of_the_pouring_robot_is_refused(tmp_path, poses, says):
    (tmp_path / "p.csv").write_text("left_deg,right_deg\n0,0\n170,-170\n", encoding="utf-8")
    text = STUDY.format(robot=ROBOTS / "five_bar" / "robot.yaml", study="one_at_a_time")
    (tmp_path / "s.yaml").write_text(text.replace("poses: {random: {count: 4, seed: 1}}", poses), encoding="utf-8")
    with pytest.raises(BadInputError, match=says):
        SweepPlan.load(tmp_path / "s.yaml")


def test_redundant_drives_agree_where_a_robot_is_sent(tmp_path):
    """Four lines hold a point: lengths drawn one by one disagree by metres, and no pose has them."""
    robot = Robot.load("examples/machines/hangprinter/robot.yaml")
    text = STUDY.format(robot=robot.model.robot_path, study="one_at_a_time")
    (tmp_path / "s.yaml").write_text(text, encoding="utf-8")
    drives = SweepPlan.load(tmp_path / "s.yaml").poses.drives
    assert (robot.locate_drives(drives).status == "closed").all()
    (tmp_path / "p.csv").write_text(
        "line_a_deg,line_b_deg,line_c_deg,line_d_deg\n0,0,0,0\n9e3,0,0,0\n", encoding="utf-8"
    )
    (tmp_path / "s.yaml").write_text(text.replace("random: {count: 4, seed: 1}", "file: p.csv"), encoding="utf-8")
    with pytest.raises(BadInputError, match="line 3: the robot does not close there"):
        SweepPlan.load(tmp_path / "s.yaml")


def test_an_accuracy_is_needed(tmp_path):
    text = STUDY.format(robot=ROBOTS / "arm" / "robot.yaml", study="one_at_a_time").replace("accuracy_mm: 5\n", "")
    (tmp_path / "s.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(BadInputError, match="accuracy_mm is missing"):
        SweepPlan.load(tmp_path / "s.yaml")


def test_a_sweep_file_that_names_a_layout_is_of_no_other_robot(tmp_path):
    study = SweepConfig.load(ROBOTS.parent / "sweep.yaml")
    with pytest.raises(BadInputError, match="names a layout or a model"):
        study.with_robot(tmp_path / "robot.yaml")
    free = study.model_copy(update={"layout": None})
    assert free.with_robot(str(tmp_path / "robot.yaml")).robot == str(tmp_path / "robot.yaml")
