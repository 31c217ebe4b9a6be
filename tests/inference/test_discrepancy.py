"""Structure in what is left: found where it was planted, not on noise."""

import numpy as np
import pytest

from pouring_robot.inference.courses import separate, smooth, standardised, wandering
from pouring_robot.inference.discrepancy import Description, challenge, structures
from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.explanations import Problem
from pouring_robot.inference.hypotheses import Hypothesis
from tests.inference.problems import explanation, log_density, problem

ROWS = 80
TIME = np.arange(ROWS, dtype=float)


@pytest.fixture
def described(rng):
    load = rng.normal(size=ROWS)
    labels = np.arange(ROWS) % 4
    courses = {"time": wandering(TIME), "load": smooth(standardised(load), 1.0), "session": separate(labels)}
    return load, [Description("place", by, course) for by, course in courses.items()]


CONSTANT = np.ones((ROWS, 1))


def nothing(residual, items=(), free=CONSTANT):
    """Return the empty hypothesis beside a free constant: drift is zero on average, so a mean is nobody's."""
    return Hypothesis.nothing(problem(residual, items, free=free))


def test_a_step_in_time_and_a_curve_over_load_are_told_apart(described, rng):
    load, descriptions = described
    step = rng.normal(size=ROWS) + 3.0 * (TIME > 33)
    curve = rng.normal(size=ROWS) + 2.0 * np.cos(2.0 * load)
    for residual, by in ((step, "time"), (curve, "load")):
        found = structures(nothing(residual), descriptions)
        assert found[0].description.name == f"place by {by}"
        assert found[0].evidence > 10.0
        assert [s.evidence for s in found] == sorted((s.evidence for s in found), reverse=True)


def test_noise_has_no_structure():
    alarms = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        residual = rng.normal(size=ROWS)
        descriptions = [Description("place", "time", wandering(TIME)), Description("place", "x", smooth(TIME, 10.0))]
        alarms += bool(structures(nothing(residual), descriptions))
    assert alarms <= 5  # Markov: at most 2 exp(-3) of 50, which is 5


def test_the_part_is_the_conditional_mean(described, rng):
    """Of a Gaussian process with the description's covariance, beside what the hypothesis fits."""
    _, descriptions = described
    item = explanation("a", rng.normal(size=(ROWS, 2)))
    residual = rng.normal(size=ROWS) + 3.0 * (TIME > 33) + 2.0 * item.columns[:, 0]
    built = problem(residual, [item])
    hypothesis = Hypothesis(built, (item,), (Scale(2.0),), ())
    found = next(s for s in structures(hypothesis, descriptions) if s.description.by == "time")
    others = np.eye(ROWS) + 4.0 * item.columns @ item.columns.T
    evidence, scales = [], np.exp(np.linspace(-3.0, 3.0, 61))
    for scale in scales:
        columns = scale * found.description.columns
        evidence.append(log_density(residual, 2.0 * item.columns, columns))
    assert (
        found.evidence > np.log(np.mean(np.exp(np.array(evidence) - log_density(residual, 2.0 * item.columns)))) - 3.0
    )
    fits = []
    for scale in scales:
        own = scale**2 * found.description.columns @ found.description.columns.T
        fits.append(np.abs(own @ np.linalg.solve(others + own, residual) - found.part).max())
    assert min(fits) < 0.1
    assert found.size == pytest.approx(np.sqrt(found.part @ np.linalg.solve(others, found.part) / ROWS), rel=1e-9)


def test_what_free_unknowns_absorb_is_no_structure(described, rng):
    _, descriptions = described
    step = (TIME >= 40).astype(float)[:, None]
    residual = rng.normal(size=ROWS) + 10.0 * step[:, 0]
    assert structures(nothing(residual), descriptions)[0].description.by == "time"
    free = np.hstack([CONSTANT, step])
    assert structures(nothing(residual, free=free), descriptions) == []


def test_what_the_hypothesis_explains_is_no_structure(described, rng):
    load, descriptions = described
    item = explanation("linear", load[:, None])
    residual = rng.normal(size=ROWS) + 4.0 * load
    assert structures(nothing(residual), descriptions)[0].description.by == "load"
    fitted = Hypothesis(problem(residual, [item]), (item,), (Scale(4.0),), ())
    assert structures(fitted, descriptions) == []


def test_evidence_wanted_is_the_evidence_kept(described, rng):
    _, descriptions = described
    residual = rng.normal(size=ROWS) + 3.0 * (TIME > 33)
    everything = structures(nothing(residual), descriptions, -np.inf)
    assert len(everything) == 3
    bound = everything[1].evidence
    assert len(structures(nothing(residual), descriptions, bound + 1e-9)) == 1


def test_a_right_cause_beats_descriptions_and_a_wrong_one_does_not(described, rng):
    load, descriptions = described
    cause = explanation("linear", load[:, None])
    right = rng.normal(size=ROWS) + 3.0 * load
    wrong = rng.normal(size=ROWS) + 3.0 * np.cos(2.0 * load) + load
    margins = []
    for residual in (right, wrong):
        built: Problem = problem(residual, [cause])
        hypothesis = Hypothesis(built, (cause,), (Scale(1.0),), ()).settled()
        margins.append(challenge(hypothesis, (0,), descriptions))
    assert margins[0].margin < 0.0
    assert margins[1].margin > 5.0
    assert margins[1].description == "place by load"
