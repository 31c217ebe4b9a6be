"""Selection: groups that help held-out rows are kept, others are not, and the test block is never used."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.calibration.selection import _judge, row_scores, select_groups
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.estimation.splits import split
from pouring_robot.exceptions import CalibrationError
from pouring_robot.robot.tolerances import Tolerances
from tests.estimation.virtual import SIGMA, Virtual, groups_of, model_of


@pytest.fixture(scope="module")
def case(drawing, clean):
    """Drives off by their tolerance and centres without errors, split as the clean campaign is."""
    virtual = Virtual(drawing, model_of(drawing, "drives"), 60, seed=4)
    return virtual, split(clean.campaign, np.zeros(0, dtype=np.intp), "region")


def choose(case, drawing, measured):
    virtual, parts = case
    return select_groups(virtual.rows, measured, parts, groups_of(drawing, "centres"), Tolerances.load())


def test_groups_with_errors_and_no_others_are_kept(case, drawing):
    said = []
    virtual, parts = case
    candidates = groups_of(drawing, "centres")
    chosen = select_groups(
        virtual.rows, virtual.measured, parts, candidates, Tolerances.load(), progress=lambda *step: said.append(step)
    )
    assert [group.name for group in chosen.groups] == ["drives"]
    assert [step.tried for step in chosen.steps if step.accepted] == ["", "drives"]
    assert chosen.steps[0].rms > 5.0
    assert said[:2] == [("choosing group 1", k, len(candidates)) for k in (0, 1)]


def test_the_test_block_plays_no_part(case, drawing):
    virtual, parts = case
    position, rotation = virtual.measured.position_m.copy(), virtual.measured.rotation.copy()
    position[parts.test], rotation[parts.test] = 77.0, np.eye(3)
    spoilt = MeasuredPoses(position, rotation, SIGMA, SIGMA)
    first, second = (choose(case, drawing, measured) for measured in (virtual.measured, spoilt))
    assert first.steps == second.steps
    assert [g.name for g in first.groups] == [g.name for g in second.groups]


def test_an_error_is_raised_where_no_group_could_be_tested(case, drawing):
    """Two blocks of which each alone determines a direction of the frames: neither predicts the other."""
    virtual, parts = case
    first, last = np.array_split(parts.train, 2)
    apart = dataclasses.replace(
        parts, folds=(first, last), frame_information=(np.diag([1.0, 0.0]), np.diag([0.0, 1.0]))
    )
    with pytest.raises(CalibrationError, match="no block of the fitted rows can be predicted"):
        select_groups(virtual.rows, virtual.measured, apart, groups_of(drawing, "centres"), Tolerances.load())


def test_a_row_that_a_group_leaves_unpredicted_speaks_against_it(case, drawing, monkeypatch):
    """As for a distance whose other row a group bends out of reach: its own row closes, but has no prediction."""
    _, parts = case
    folds, judged = len(parts.validations), []

    def scores(residual, sigma):
        found = row_scores(residual, sigma)
        judged.append(len(found))
        found[: len(judged) > folds] = np.nan
        return found

    monkeypatch.setattr("pouring_robot.calibration.selection.row_scores", scores)
    assert choose(case, drawing, case[0].measured).groups == ()


def test_a_group_that_cannot_be_fitted_is_not_kept(case, drawing, monkeypatch):
    def fail(*_):
        raise CalibrationError("no", "way")

    monkeypatch.setattr("pouring_robot.calibration.selection.identify", fail)
    virtual, _ = case
    assert choose(case, drawing, virtual.measured).groups == ()


def test_candidates_come_from_the_catalogue(drawing):
    catalogue = drawing.parameters
    assert [g.name for g in catalogue.groups(("centres",))] == ["drives", "fixed_centres", "moving_centres"]


def test_a_gain_in_positions_does_not_outweigh_a_loss_in_rotations():
    rng = np.random.default_rng(2)
    present = np.column_stack([9.0 + rng.normal(size=60), 1.0 + 0.2 * rng.normal(size=60)])
    scatter = rng.normal(size=60).clip(-0.5, 0.5)
    scatter -= scatter.mean()
    for rise, helps in ((0.02, True), (0.2, False)):  # the standard error of the rise is 0.05
        gain, error, kept = _judge(present, present + np.column_stack([np.full(60, -7.0), rise + scatter]))
        assert gain > 2.0 * error and kept is helps
