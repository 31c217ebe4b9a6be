"""Sobol indices against the closed form of a linear model."""

import numpy as np
import pytest

from pouring_robot.exceptions import NoSolutionError
from pouring_robot.sweeps import ErrorEntry, run_sweep
from pouring_robot.sweeps.analysis import sobol
from pouring_robot.sweeps.analysis.report import report, summary_lines
from pouring_robot.sweeps.analysis.tolerances import transfer_matrices

FAILING_NOW_AND_THEN_MRAD = 120.0


def test_first_order_indices_are_the_shares_of_the_variance(make_plan, tmp_path):
    # Small errors: the ladle moves linearly, so the index of error j is its g²σ² over the sum of all.
    names = ("alpha_e1_12", "theta_e2_0", "a_e3_56", "leg4_s1.ty", "drive.leg1_s3")
    entry = ErrorEntry(parameters=names, half_width_mm=0.02, half_width_mrad=0.02)
    plan = make_plan(study="sobol", samples=1024, errors=[entry], poses={"grid": {"y": 2, "tilt": 2}}, chunk=5000)
    outcome = report(run_sweep(plan, tmp_path / "out"))
    std = np.array([margin.std for margin in plan.draws.margins])
    variances = ((transfer_matrices(plan, plan.poses)[:, :3] * std) ** 2).sum(axis=(0, 1))
    expected = variances / variances.sum()
    assert np.abs(outcome.indices.first - expected).max() < 0.01
    assert np.abs(outcome.indices.total - expected).max() < 0.01
    assert outcome.ranking[0].name == plan.names[int(np.argmax(expected))]
    assert (outcome.indices.first_confidence > 0).all() and outcome.indices.dropped == 0


def test_base_samples_without_a_solution_are_left_out_and_counted(make_plan, tmp_path):
    entry = ErrorEntry(parameters=("leg?_s2.r?",), half_width_mrad=FAILING_NOW_AND_THEN_MRAD)
    plan = make_plan(study="sobol", samples=32, errors=[entry], poses={"grid": {"y": 3, "tilt": 3}}, chunk=5000)
    outcome = report(run_sweep(plan, tmp_path / "out"))
    failed = (outcome.to_dataset().status.values != 0).reshape(32, -1, 9).any(axis=1)  # of each base sample, by pose
    assert outcome.indices.dropped == failed.any(axis=1).sum() > failed.sum(axis=0).max() > 0
    (line,) = (line for line in summary_lines(outcome) if "base samples" in line)
    assert line.endswith(f"{outcome.indices.dropped} base samples have no solution at some pose and are left out there")
    assert np.isfinite(outcome.indices.total).all()


def test_no_indices_without_a_solution(make_plan, tmp_path):
    entry = ErrorEntry(parameters=("leg?_s?.r?",), half_width_mrad=900.0)
    plan = make_plan(study="sobol", samples=2, errors=[entry], poses={"grid": {}})
    with pytest.raises(NoSolutionError, match="of 2 base samples 2 have no solution"):
        report(run_sweep(plan, tmp_path / "out"))


def test_one_base_sample_that_is_left_has_no_indices(make_plan, tmp_path, monkeypatch):
    """Its indices would be of any size, 4.3 and more, and their interval none, all draws being the same."""
    plan = make_plan(study="sobol", samples=2, errors=[ErrorEntry(parameters=("drive.leg?_s3",), half_width_mm=0.1)])
    store = run_sweep(plan, tmp_path / "out")
    lost = [outputs.copy() for outputs in sobol._outputs(store)]
    for outputs in lost:
        outputs[-1] = np.nan
    monkeypatch.setattr(sobol, "_outputs", lambda store: iter(lost))
    with pytest.raises(NoSolutionError, match="of 2 base samples 1 have no solution, and fewer than two others do"):
        report(store)
