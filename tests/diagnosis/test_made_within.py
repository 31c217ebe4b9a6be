"""A machine whose joints are known to be accurate: a cause that coarse workmanship would hide is found."""

import numpy as np
import pytest

from pouring_robot import DiagnosisOptions, diagnose
from pouring_robot.diagnosis.report.export import diagnosis_metrics
from pouring_robot.diagnosis.report.sentences import next_lines
from scripts.benchmarks.blind_trials import Job, run
from tests.examiner import cases


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A bearing block turned by 0.36 mrad, where joints are 0.026 mm off, and the tilt drive has play."""
    seed, number, out = 64, 68, tmp_path_factory.mktemp("made")
    case = cases.make(seed, number, *cases.plan(120, seed)[number])
    cases.write(case, out / "case", np.random.default_rng([seed, number, 10**6]))
    return out


def test_an_unknown_accuracy_of_joints_is_asked_for_and_a_known_one_is_used(folder):
    campaign = folder / "case" / "campaign.csv"
    found = diagnose(campaign, options=DiagnosisOptions(next_count=0))
    assert [e.cause.effect for e in found.effects] == ["drive_backlash"]
    assert any("--made-within" in line for line in next_lines(found))
    known = diagnose(campaign, options=DiagnosisOptions(next_count=0, made_within_mm=0.026))
    assert {e.cause.effect for e in known.effects} == {"drive_backlash", "joint_axis_tilt"}
    assert not any("--made-within" in line for line in next_lines(known))
    figures = [diagnosis_metrics(one, "model.yaml")["thresholds"]["made_within"] for one in (found, known)]
    assert figures == [None, 0.026]


def test_trials_pass_the_accuracy_of_joints_to_the_diagnosis(folder):
    (trial,) = run(Job("told", folder / "case", told=True))
    assert trial.exact, trial.line()
