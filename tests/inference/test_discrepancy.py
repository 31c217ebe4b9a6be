"""Structure in residuals: found where it was planted, not in noise; sums of processes against dense algebra."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from pouring_robot.inference.decision import judge
from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.gaussian_processes.discrepancy import Discrepancy
from pouring_robot.inference.gaussian_processes.kernels import row_by_row, separate, smooth, standardised, wandering
from pouring_robot.inference.gaussian_processes.processes import CHANCE, Channel, Part, Process, columns_of, sums_of
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.priors import LEFT_TO_NOISE, LOG_SCALES, NOISE_FACTORS
from pouring_robot.inference.problem import Problem
from tests.inference.problems import explanation, problem

ROWS = 80
TIME = np.arange(ROWS, dtype=float)


@pytest.fixture
def described(rng):
    load = rng.normal(size=ROWS)
    labels = np.arange(ROWS) % 4
    courses = {"time": wandering(TIME), "load": smooth(standardised(load), 1.0), "session": separate(labels)}
    return load, [Process.of_columns("place", by, course) for by, course in courses.items()]


CONSTANT = np.ones((ROWS, 1))


def nothing(residual, items=(), free=CONSTANT):
    """Return the empty hypothesis with a free constant: drift is zero on average, so no process explains a mean."""
    return Hypothesis.nothing(problem(residual, items, free=free))


def test_a_step_in_time_and_a_curve_over_load_are_distinguished(described, rng):
    load, descriptions = described
    step = rng.normal(size=ROWS) + 3.0 * (TIME > 33)
    curve = rng.normal(size=ROWS) + 2.0 * np.cos(2.0 * load)
    for residual, by in ((step, "time"), (curve, "load")):
        found = Discrepancy.of(nothing(residual), descriptions).structures()
        assert found[0].process.name == f"place by {by}"
        assert found[0].evidence > 10.0
        assert [s.evidence for s in found] == sorted((s.evidence for s in found), reverse=True)


def test_noise_has_no_structure():
    alarms = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        residual = rng.normal(size=ROWS)
        descriptions = [
            Process.of_columns("place", "time", wandering(TIME)),
            Process.of_columns("place", "x", smooth(TIME, 10.0)),
        ]
        alarms += bool(Discrepancy.of(nothing(residual), descriptions).structures())
    assert alarms <= 5  # Markov: at most 2 exp(-3) of 50, which is 5


def covariance_of(summand):
    """Return the covariance (m, m) that a process at its amplitude adds to the whitened residual."""
    columns = summand.amplitude * columns_of(summand.process.lengths[summand.length])
    return columns @ columns.T


def test_the_sum_is_that_of_gaussian_processes(described, rng):
    """Each share is the conditional mean given the hypothesis and the other shares, from dense covariances."""
    load, descriptions = described
    item = explanation("a", rng.normal(size=(ROWS, 2)))
    residual = rng.normal(size=ROWS) + 3.0 * (TIME > 33) + 2.0 * np.cos(2.0 * load) + 2.0 * item.columns[:, 0]
    hypothesis = Hypothesis(problem(residual, [item]), (item,), (Scale(2.0),), ())
    found = Discrepancy.of(hypothesis, descriptions).sum(5.0, 3)
    assert {summand.process.by for summand in found} == {"time", "load"}
    noise = np.eye(ROWS) + 4.0 * item.columns @ item.columns.T
    total = noise + sum(covariance_of(summand) for summand in found)
    for summand in found:
        own = covariance_of(summand)
        np.testing.assert_allclose(summand.part, own @ np.linalg.solve(total, residual), atol=1e-8)
        left, left_without = (np.linalg.solve(covariance, residual) for covariance in (total, total - own))
        np.testing.assert_allclose(summand.missed, left_without - left, atol=1e-8)
        spread = np.diag(own - own @ np.linalg.solve(total, own))
        np.testing.assert_allclose(summand.std[:, 0], np.sqrt(np.maximum(spread, 0.0)), atol=1e-6)
        assert summand.size == pytest.approx(np.sqrt((summand.part**2).mean()))
        rest = multivariate_normal(np.zeros(ROWS), total - own).logpdf(residual)
        peak = multivariate_normal(np.zeros(ROWS), total).logpdf(residual) - rest
        assert peak - 4.0 < summand.evidence <= peak + 1e-6  # averaged over 28 amplitudes: at most ln 28 = 3.3 less


def test_columns_from_channels_and_courses_equal_columns_written_out(rng):
    """Channels times courses, with several equations per row, against the same columns written out."""
    row = np.repeat(np.arange(40), 3)
    sums, by = sums_of(row, 40), rng.normal(size=40)
    channels = [Channel(name, rng.normal(size=120), sums) for name in "ab"]
    course, chance = smooth(standardised(by), 1.0), row_by_row(40, 40)
    processes = [
        Process("end", "x", {"": tuple(Part(c, course) for c in channels)}),
        Process("end", "chance", {"": tuple(Part(c, chance) for c in channels)}),
    ]
    free = rng.normal(size=(120, 4))
    residual = 2.0 * channels[0].column * np.cos(2.0 * by)[row] + rng.normal(size=120)
    written = [Process.of_columns("end", p.by, columns_of(p.lengths[""])) for p in processes]
    one, other = (
        Discrepancy.of(Hypothesis.nothing(problem(residual, (), free=free)), kind).sum(-np.inf, 2)
        for kind in (processes, written)
    )
    for first, second in zip(one, other, strict=True):
        assert (first.process.by, first.amplitude) == (second.process.by, second.amplitude)
        assert first.evidence == pytest.approx(second.evidence, rel=1e-9, abs=1e-9)
        np.testing.assert_allclose(first.part, second.part, atol=1e-9)


def test_a_condition_that_went_along_is_a_rival_and_one_that_did_not_is_bounded(described, rng):
    load, descriptions = described
    twin = Process.of_columns("place", "twin", smooth(standardised(load + 0.01 * rng.normal(size=ROWS)), 1.0))
    discrepancy = Discrepancy.of(nothing(rng.normal(size=ROWS) + 2.0 * np.cos(2.0 * load)), [*descriptions, twin])
    found = discrepancy.sum(5.0, 3)
    assert len(found) == 1
    assert {found[0].process.by, *discrepancy.rivals(found[0], ())} == {"load", "twin"}
    bounds = discrepancy.bounds(found)
    assert bounds["place by time"] < 0.5 * np.sqrt((found[0].movement ** 2).mean())
    assert found[0].process.name not in bounds


def test_what_free_unknowns_absorb_is_no_structure(described, rng):
    _, descriptions = described
    step = (TIME >= 40).astype(float)[:, None]
    residual = rng.normal(size=ROWS) + 10.0 * step[:, 0]
    assert Discrepancy.of(nothing(residual), descriptions).structures()[0].process.by == "time"
    free = np.hstack([CONSTANT, step])
    assert Discrepancy.of(nothing(residual, free=free), descriptions).structures() == []


def test_what_the_hypothesis_explains_is_no_structure(described, rng):
    load, descriptions = described
    item = explanation("linear", load[:, None])
    residual = rng.normal(size=ROWS) + 4.0 * load
    assert Discrepancy.of(nothing(residual), descriptions).structures()[0].process.by == "load"
    fitted = Hypothesis(problem(residual, [item]), (item,), (Scale(4.0),), ())
    assert Discrepancy.of(fitted, descriptions).structures() == []


def test_only_structures_above_the_asked_evidence_are_kept(described, rng):
    _, descriptions = described
    residual = rng.normal(size=ROWS) + 3.0 * (TIME > 33)
    everything = Discrepancy.of(nothing(residual), descriptions).structures(-np.inf)
    assert len(everything) == 3
    bound = everything[1].evidence
    assert len(Discrepancy.of(nothing(residual), descriptions).structures(bound + 1e-9)) == 1
    assert Discrepancy.of(nothing(residual), descriptions).sum(everything[0].evidence + 1e-9, 3) == []


def test_a_right_cause_beats_descriptions_and_a_wrong_one_does_not(described, rng):
    load, descriptions = described
    cause = explanation("linear", load[:, None])
    right = rng.normal(size=ROWS) + 3.0 * load
    wrong = rng.normal(size=ROWS) + 3.0 * np.cos(2.0 * load) + load
    margins = []
    for residual in (right, wrong):
        built: Problem = problem(residual, [cause])
        hypothesis = Hypothesis(built, (cause,), (Scale(1.0),), ()).settled()
        margins.append(Discrepancy.of(hypothesis, descriptions).challenge((0,)))
    assert margins[0].margin < 0.0
    assert margins[1].margin > 5.0
    assert margins[1].process.name == "place by load"


def leading(residual, columns, processes, least=3.0):
    """Return the lead of a cause with such columns, its evidence, and the names of the processes in the sum."""
    item = explanation("cause", columns - columns.mean(axis=0))  # what the free constant leaves of them
    hypothesis = Hypothesis(problem(residual, [item], free=CONSTANT), (item,), (Scale(1.0),), ()).settled()
    seen = Discrepancy.of(hypothesis, processes)
    return seen.lead((0,), least), hypothesis.worth((0,)), {s.process.name for s in seen.sum(least, 2)}


def test_where_something_is_unknown_a_cause_leads_by_what_no_description_explains(described, rng):
    """A cause with a course of its own leads although descriptions explain a part; one that they copy does not.

    A description in place of the copied one has the same evidence except for its prior. That holds for a small cause,
    too, which would not be described where something else is unknown.
    """
    load, descriptions = described
    own, course = rng.normal(size=ROWS), columns_of(descriptions[1].lengths[""])
    residual = rng.normal(size=ROWS) + 3.0 * np.cos(3.0 * TIME / ROWS) + 2.0 * own + 2.0 * load
    lead, worth, names = leading(residual, own[:, None], descriptions)
    assert names == {"place by time", "place by load"} and worth > lead > 30.0
    lead, worth, names = leading(residual, course, descriptions)
    assert names == {"place by time"} and worth > 30.0 and lead < np.log(100.0)
    lead, small, _ = leading(residual, course, descriptions, least=worth + 10.0)
    assert small == worth and lead < np.log(100.0)


def test_a_cause_is_not_charged_for_what_is_unknown_elsewhere():
    """Four structures that share no row with it or each other do not lessen its lead, clear or not."""
    axes = np.eye(ROWS)
    processes = [Process.of_columns("place", str(k), axes[:, [k]]) for k in range(4)]
    residual = 20.0 * axes[:, :4].sum(axis=1) + 20.0 * axes[:, 10]
    item = explanation("cause", axes[:, [10]])
    hypothesis = Hypothesis(problem(residual, [item]), (item,), (Scale(1.0),), ()).settled()
    for least in (3.0, np.inf):
        lead = Discrepancy.of(hypothesis, processes).lead((0,), least)
        assert lead == pytest.approx(hypothesis.worth((0,)), rel=1e-6)


def test_two_descriptions_in_place_of_a_cause_count_with_the_evidence_of_both():
    both = np.eye(ROWS)[:, [0, 1]]
    processes = [Process.of_columns("place", str(k), both[:, [k]]) for k in (0, 1)]
    item = explanation("cause", both.sum(axis=1, keepdims=True) / np.sqrt(2.0))
    hypothesis = Hypothesis(problem(20.0 * item.columns[:, 0], [item]), (item,), (Scale(1.0),), ()).settled()
    seen = Discrepancy.of(hypothesis, processes)
    instead = sum(one.evidence for one in seen.without((0,)).structures())
    lead = hypothesis.worth((0,)) - instead
    assert 0.0 < lead < 10.0 and seen.lead((0,), 5.0) == pytest.approx(lead)


def test_a_process_that_others_explain_together_is_dropped_again():
    """A process on two rows is found first; it is not needed once two more, each with one of these rows, are in."""
    axes = np.eye(ROWS)
    courses = {"both": axes[:, [0, 1]], "first": axes[:, [0, 2]], "second": axes[:, [1, 3]]}
    processes = [Process.of_columns("place", by, course) for by, course in courses.items()]
    seen = Discrepancy.of(Hypothesis.nothing(problem(axes[:, :4] @ [30.0, 30.0, 20.0, 15.0], ())), processes)
    assert [one.process.by for one in seen.sum(3.0, 1)] == ["both"]
    assert [one.process.by for one in seen.sum(3.0, 3)] == ["first", "second"]


def test_the_largest_part_comes_first_and_not_the_most_evident():
    """Forty rows of 3 noise standard deviations, each with its own coefficient, cost more than one row of 16."""
    axes = np.eye(ROWS)
    courses = {"one": axes[:, [0]], "many": axes[:, 1:41]}
    processes = [Process.of_columns("place", by, course) for by, course in courses.items()]
    residual = axes[:, :41] @ [16.0, *[3.0] * 40]
    seen = Discrepancy.of(Hypothesis.nothing(problem(residual, ())), processes)
    assert [one.process.by for one in seen.structures()] == ["one", "many"]
    assert [one.process.by for one in seen.sum(3.0, 2)] == ["many", "one"]


def test_the_evidence_of_a_larger_noise_is_a_ratio_of_densities_given_free_unknowns(rng):
    """The density is that of the coordinates orthogonal to the free constant."""
    cause = explanation("linear", rng.normal(size=(ROWS, 2)))
    residual = 1.5 * rng.normal(size=ROWS) + cause.columns @ [2.0, -1.0] + 7.0
    built = problem(residual, [cause], free=CONSTANT)
    hypothesis = Hypothesis(built, built.explanations, (Scale(0.5),), ())
    across = np.linalg.qr(CONSTANT, mode="complete")[0][:, 1:].T
    covariance = 0.25 * across @ cause.columns @ cause.columns.T @ across.T
    factors = np.geomspace(1.01, 1e3, 2000)
    density = [
        multivariate_normal(cov=f**2 * np.eye(ROWS - 1) + covariance).logpdf(across @ residual) for f in (1.0, *factors)
    ]
    (found,) = Discrepancy.of(hypothesis, []).larger_noise(np.full(ROWS, 3))
    assert found.kind is None
    assert found.evidence == pytest.approx(logsumexp(density[1:]) - np.log(len(factors)) - density[0], abs=0.02)
    assert found.factor == pytest.approx(factors[int(np.argmax(density[1:]))], rel=0.05)


def test_the_evidence_of_a_larger_noise_of_one_kind_is_a_ratio_of_densities_too(rng):
    """With two kinds there are three equally likely cases: either kind alone, or both alike."""
    cause, kind = explanation("linear", rng.normal(size=(ROWS, 2))), np.arange(ROWS) % 4 // 3 + 5
    residual = rng.normal(size=ROWS) * np.where(kind == 6, 4.0, 1.2) + cause.columns @ [2.0, -1.0] + 7.0
    built = problem(residual, [cause], free=CONSTANT)
    hypothesis = Hypothesis(built, built.explanations, (Scale(0.5),), ())
    across = np.linalg.qr(CONSTANT, mode="complete")[0][:, 1:].T
    covariance = 0.25 * across @ cause.columns @ cause.columns.T @ across.T

    def density(some, factor):
        noise = across * np.where(some, factor, 1.0) ** 2 @ across.T
        return multivariate_normal(cov=noise + covariance).logpdf(across @ residual)

    every = np.ones(ROWS, dtype=bool)
    found = {one.kind: one for one in Discrepancy.of(hypothesis, []).larger_noise(kind)}
    for label, some in {None: every, 5: kind == 5, 6: kind == 6}.items():
        densities = np.array([density(some, factor) for factor in NOISE_FACTORS])
        expected = logsumexp(densities) - np.log(len(NOISE_FACTORS)) - density(every, 1.0) - np.log(3.0)
        assert found[label].evidence == pytest.approx(expected, rel=1e-9)
        assert found[label].factor == NOISE_FACTORS[np.argmax(densities)]
    assert next(iter(found)) == 6
    assert [one.evidence for one in found.values()] == sorted((one.evidence for one in found.values()), reverse=True)


def test_the_evidence_of_the_noise_share_is_a_ratio_of_densities_given_a_process(rng):
    """The residual is a slow wave with a noise share of a fifth; the evidence averages over scales of the wave."""
    cause = explanation("linear", rng.normal(size=(ROWS, 2)))
    course = smooth(TIME, 10.0)
    residual = np.sin(TIME / 7.0) * np.sqrt(2.0) * np.sqrt(0.96) + 0.2 * rng.normal(size=ROWS)
    built = problem(residual, [cause], free=CONSTANT)
    hypothesis = Hypothesis(built, built.explanations, (Scale(0.5),), ())
    across = np.linalg.qr(CONSTANT, mode="complete")[0][:, 1:].T
    fitted, moved = (across @ columns @ columns.T @ across.T for columns in (0.5 * cause.columns, course))
    scales = np.exp(LOG_SCALES)

    def densities(share, scales):
        unit = share**2 * np.eye(ROWS - 1) + fitted
        return [multivariate_normal(cov=unit + s**2 * moved).logpdf(across @ residual) for s in scales]

    averaged = np.array([logsumexp(densities(share, scales)) for share in LEFT_TO_NOISE]) - np.log(len(scales))
    alone = max(densities(share, [0.0])[0] for share in LEFT_TO_NOISE)
    processes = [
        Process.of_columns("place", "time", course),
        Process.of_columns("place", "load", rng.normal(size=(ROWS, 3))),
    ]
    share, evidence = Discrepancy.of(hypothesis, processes).left_to_noise()
    assert evidence == pytest.approx(logsumexp(averaged) - np.log(len(averaged)) - alone, rel=1e-6)
    finely = np.geomspace(0.5 * share, 2.0 * share, 41)
    best = finely[np.argmax([logsumexp(densities(one, scales)) for one in finely])]
    assert share == pytest.approx(best, rel=0.04)
    assert share == pytest.approx(0.2, rel=0.3)


def test_a_process_that_explains_too_little_is_not_considered(rng):
    """Of 79 degrees of freedom a slow wave leaves the share that least squares give; below that share all is noise."""
    course = smooth(TIME, 10.0)
    residual = 0.8 * np.sin(TIME / 7.0) + 0.6 * rng.normal(size=ROWS)
    seen = Discrepancy.of(nothing(residual), [Process.of_columns("place", "time", course)])
    beside = np.hstack([CONSTANT, course])
    least = np.linalg.norm(residual - beside @ np.linalg.lstsq(beside, residual, rcond=1e-9)[0])
    share = least / np.linalg.norm(residual - residual.mean())
    assert seen.left_to_noise(1.01 * share) == seen.left_to_noise()
    assert seen.left_to_noise(0.99 * share) == (1.0, -np.inf)


def test_white_noise_is_all_left_to_noise():
    """Markov: of fifty campaigns at most half a one reaches the evidence asked for."""
    alarms = 0
    for seed in range(50):
        residual = np.random.default_rng(seed).normal(size=ROWS)
        processes = [Process.of_columns("place", str(k), smooth(TIME, 2.0**k, most=70)) for k in range(5)]
        alarms += Discrepancy.of(nothing(residual), processes).left_to_noise()[1] > np.log(5 / 0.01)
    assert alarms <= 1


@pytest.mark.parametrize("times", [3.0, np.full(ROWS, 3.0), np.where(TIME % 3 < 1, 5.0, 1.0)], ids=["", "all", "some"])
def test_results_under_a_larger_noise_equal_those_with_that_noise_stated(described, rng, times):
    """The residual and columns divided by that noise, against a problem built anew with that noise stated."""
    load, descriptions = described
    cause = explanation("linear", load[:, None])
    residual = 3.0 * (rng.normal(size=ROWS) + 2.0 * load + np.cos(3.0 * load))
    found = []
    for stated in (np.ones((ROWS, 1)), np.broadcast_to(times, ROWS)[:, None]):
        item = explanation("linear", cause.columns / stated)
        processes = [
            Process.of_columns(one.where, one.by, columns_of(one.lengths[""]) / stated) for one in descriptions
        ]
        built = problem(residual / stated[:, 0], [item], free=CONSTANT / stated)
        hypothesis = Hypothesis(built, built.explanations, (Scale(1.0),), ())
        found.append(Discrepancy.of(hypothesis, processes))
    as_told, anew = found
    under = as_told.under(times) if isinstance(times, float) else as_told.over(times)
    assert under.hypothesis.worth((0,)) == pytest.approx(anew.hypothesis.worth((0,)), rel=1e-9)
    assert under.challenge((0,)).margin == pytest.approx(anew.challenge((0,)).margin, rel=1e-9)
    assert under.lead((0,), 1.0) == pytest.approx(anew.lead((0,), 1.0), abs=1e-9 * anew.hypothesis.worth((0,)))
    structures = [[(s.process.name, s.size) for s in one.structures(-99.0)] for one in (under, anew)]
    assert dict(structures[0]) == pytest.approx(dict(structures[1]), rel=1e-9)


def test_two_conditions_are_not_taken_for_a_larger_noise(described, rng):
    """For each alone the other's part looks like a larger noise; both are still detected under it."""
    load, descriptions = described
    residual = rng.normal(size=ROWS) + 3.0 * np.cos(2.0 * load) + 3.0 * np.sin(TIME / 9.0)
    seen, one_kind = Discrepancy.of(nothing(residual), descriptions), np.zeros(ROWS)
    (larger,) = seen.larger_noise(one_kind)
    assert larger.evidence > 50.0
    assert seen.under(larger.factor).structures()[0].evidence > 10.0
    white = Discrepancy.of(nothing(3.0 * rng.normal(size=ROWS)), descriptions)
    (larger,) = white.larger_noise(one_kind)
    assert (larger.evidence > 50.0, larger.factor) == (True, pytest.approx(3.0, rel=0.3))
    assert not white.under(larger.factor).structures()


@pytest.mark.parametrize("times", [1.0, 5.0])
def test_the_kind_with_the_larger_noise_is_found_with_its_size(described, rng, times):
    """Positions and rotations alternate; the noise of the rotations is a multiple of the stated one.

    A process of chance in every row describes that, too. What depends on the load has a cause, which is found as well.
    """
    load, descriptions = described
    kind = np.arange(ROWS) % 2
    cause, tried = explanation("linear", load[:, None]), [*descriptions]
    tried.append(Process.of_columns("place", CHANCE, np.eye(ROWS)))
    residual = rng.normal(size=ROWS) * np.where(kind == 1, times, 1.0) + 6.0 * load
    built = problem(residual, [cause], free=CONSTANT)
    hypothesis = Hypothesis(built, built.explanations, (Scale(1.0),), ()).settled()
    judged = judge(hypothesis, Discrepancy.of(hypothesis, tried), kind=kind)
    assert [one.effect for one in judged.causes] == ["linear"]
    if times > 1.0:
        assert (judged.verdict, judged.larger_noise.kind) == ("unknown", 1)
        # The standard deviation of 40 values is known to a ninth.
        assert judged.larger_noise.factor == pytest.approx(times, rel=0.25)
        assert judged.doubtful == ()
    else:
        assert (judged.verdict, judged.larger_noise) == ("named", None)


def test_a_process_of_chance_is_called_different_in_every_row():
    assert Process("drives", CHANCE, {}).words == "drives, different in every row"
