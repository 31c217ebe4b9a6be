"""The search of a diagnosis: settled hypotheses, the gap, standard deviations, and steps of the linearisation."""

import contextlib
import importlib
from dataclasses import replace

import numpy as np
import pytest

from pouring_robot.diagnosis import conclusions
from pouring_robot.diagnosis.diagnoser import Diagnoser
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.estimation.intervals import Z95, deviations95
from pouring_robot.exceptions import DiagnosisError
from pouring_robot.inference.hypotheses import Hypothesis
from tests.diagnosis.hidden import NOTHING, campaign


def test_a_hypothesis_settled_with_its_own_forms_is_settled_with_the_whole_library(hot):
    found = hot.hypothesis
    assert found.problem.known > {*found.effects}
    again = found.settled()
    assert (again.scales, again.levels) == (found.scales, found.levels)


def test_the_gap_is_that_of_the_given_model_at_any_step_of_the_search(hot):
    diagnoser = hot.diagnoser
    rest = diagnoser.problem_at(diagnoser.at_rest())
    assert hot.hypothesis.problem.given_squared == pytest.approx(rest.gram.squared, rel=1e-9)
    assert hot.hypothesis.problem.gram.squared != pytest.approx(rest.gram.squared, rel=1e-9)


def test_where_something_is_unknown_standard_deviations_come_from_leaving_out_stretches_of_time(excluded):
    """As in least squares without each stretch and with free frames: rows of equations, and one row per prior."""
    diagnoser, state, hypothesis = excluded.final
    assert excluded.verdict == "unknown" and excluded.effects
    free, weights = hypothesis.problem.nuisance.axes, np.concatenate(hypothesis.weights())
    columns, row = np.hstack([free, hypothesis.columns * weights]), state.fitted_rows.row
    priors = np.eye(columns.shape[1])[free.shape[1] :]
    answers = []
    for stretch in np.array_split(np.flatnonzero(diagnoser.fitted), 5):
        kept = ~np.isin(row, stretch)
        seen = np.concatenate([hypothesis.problem.residual[kept], np.zeros(len(priors))])
        answers.append(np.linalg.lstsq(np.vstack([columns[kept], priors]), seen, rcond=None)[0][free.shape[1] :])
    covariance = hypothesis.coefficients()[1]
    scattered = 0.8 * np.square(answers - np.mean(answers, axis=0)).sum(axis=0) * (deviations95(4.0) / Z95) ** 2
    expected = np.sqrt(np.maximum(scattered + np.square(covariance).sum(axis=1), np.diag(covariance)))
    told = [one for _, own in excluded.parameters for one in own]
    units = [one.parameter.prior_std for one in told]
    np.testing.assert_allclose([one.std for one in told], expected * weights * units, rtol=1e-4)
    assert (expected > 1.5 * np.sqrt(np.diag(covariance))).any()


def test_forms_of_one_parameter_are_summed_with_their_covariance(hot):
    """Forms that act alike on a parameter are fully correlated: two have twice the deviation of one, and not 1.41."""
    effect = next(one for one in hot.effects if one.cause.indices)
    first = effect.cause.indices[0]
    parameters = dict(hot.parameters)[hot.hypothesis.items[first].key]
    alone, shared = (
        replace(effect, cause=replace(effect.cause, indices=count * (first,)), parameters=count * parameters)
        for count in (1, 2)
    )
    for (name, once), (same, both) in zip(*(hot.parameters_of(one) for one in (alone, shared)), strict=True):
        assert (same, both.value) == (name, 2.0 * once.value)
        assert both.std == pytest.approx(2.0 * once.std)


def test_a_step_that_cannot_be_put_into_the_robot_counts_as_nonlinear(hot, monkeypatch):
    """The state does not move. That is no final answer: other causes are tried, and the same step is not repeated."""
    put_in, refused = Diagnoser._put_in, []

    def tried(self, parameters, *given):
        if parameters:
            refused.append(parameters)
            raise DiagnosisError("no pose closes", "measure others")
        return put_in(self, parameters, *given)

    monkeypatch.setattr(Diagnoser, "_put_in", tried)
    found = hot.diagnoser._followed(lambda at: hot.hypothesis.on(hot.diagnoser.problem_at(at)))
    assert found.bent == np.inf
    assert found.state.parameters == ()
    assert len(refused) == 12  # halvings of a step before a search, and at the end


def test_parameters_no_longer_found_fade_as_far_as_a_halved_step_goes(hot, monkeypatch):
    """Dropped at once, half a step would lead back to the drawing; of two values of one parameter each is halved."""
    put_in, asked = Diagnoser._put_in, []

    def tried(self, parameters, values, frames):
        asked.append((parameters, values))
        if len(asked) == 1:
            raise DiagnosisError("no pose closes", "measure others")
        return put_in(self, parameters, values, frames)

    diagnoser, after = hot.diagnoser, hot.after
    twice, shares = 2 * after.parameters, np.concatenate([0.75 * after.values, 0.25 * after.values])
    there = diagnoser._state(twice, shares, after.frames)
    nothing = Hypothesis.nothing(diagnoser.problem_at(there)).with_levels_of(())
    monkeypatch.setattr(Diagnoser, "_put_in", tried)
    new, _ = diagnoser._advanced(there, nothing)
    assert asked[0][0] == ()  # after a whole step no parameter is left
    halves = {one: (0.375 * value, 0.125 * value) for one, value in zip(after.parameters, after.values, strict=True)}
    assert {one: pytest.approx(values) for one, values in halves.items()} == new.by_parameter


def test_of_steps_that_lead_too_far_no_derivatives_are_computed(hot, monkeypatch):
    """Derivatives take as long as closing the loops, and only those of the step that is taken are needed."""
    put_in, linearised, tried, used = Diagnoser._put_in, CampaignRows.linearised, [], []

    def worse(self, *given):
        there = put_in(self, *given)
        tried.append(there)
        if len(tried) == 3:
            return there
        return replace(there, alone=replace(there.alone, residual=there.alone.residual + 1e3))

    diagnoser = hot.diagnoser
    here = diagnoser.at_rest()
    found = hot.hypothesis.on(diagnoser.problem_at(here))
    monkeypatch.setattr(Diagnoser, "_put_in", worse)
    monkeypatch.setattr(CampaignRows, "linearised", lambda rows, there: used.append(there) or linearised(rows, there))
    new, _ = diagnoser._advanced(here, found)
    assert len(tried) == 3 and used == tried[2:]
    np.testing.assert_array_equal(new.every_row.residual, tried[2].alone.residual)


@pytest.mark.parametrize("copied", [False, True])
def test_disagreements_are_computed_in_parallel_with_the_search_or_on_request(tmp_path, monkeypatch, copied):
    module, here = importlib.import_module("pouring_robot.diagnosis.diagnose"), []
    monkeypatch.setattr(conclusions, "where_of", lambda diagnoser: here.append(diagnoser) or "here")
    monkeypatch.setattr(module, "forked", lambda work: contextlib.nullcontext((lambda: "there") if copied else work))
    found = module.diagnose(campaign(tmp_path, NOTHING, rows=12))
    assert not here
    assert found.where == found.where == ("there" if copied else "here")
    assert here == [found.diagnoser] * (not copied)
