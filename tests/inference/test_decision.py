"""What a diagnosis names: both sides of each rule, on problems whose answer has a closed form or is obvious.

In most problems the effects are orthogonal: an effect that moves one row only changes a standard normal variable there
into a normal one of variance 1 + s², whatever happens in the other rows.
"""

import math
from dataclasses import FrozenInstanceError, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import hadamard
from scipy.optimize import brentq
from scipy.special import expit, logit, logsumexp
from scipy.stats import norm

from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.alternatives import instead_of_workmanship, rivals
from pouring_robot.inference.decision import (
    Cause,
    Judgement,
    _above,
    _cause,
    judge,
    without_minor,
    workmanship_causes,
)
from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.gaussian_processes.discrepancy import Challenge, Structure
from pouring_robot.inference.gaussian_processes.processes import Process
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.larger_noise import LargerNoise
from pouring_robot.inference.priors import LOG_SCALES, WORKMANSHIP_LEVELS
from pouring_robot.inference.problem import Explanation, Workmanship
from pouring_robot.inference.thresholds import Thresholds
from tests.inference.problems import ROWS, explanation, log_density, problem

AXES = np.eye(ROWS)
SCALES = np.exp(LOG_SCALES)
SURE = 20.0
HELD = 1.0 - Thresholds().false_names
"""Probability that what is at work is something that the library holds."""
"""Amplitude of an effect that is beyond doubt, in noise standard deviations."""
EITHER_SIDE = ((1.0 - 1e-6, True), (1.0 + 1e-6, False))


def axis(*places):
    return AXES[:, list(places)]


def tilted(first, second, share):
    """Return a column of length 1 with a given component along one axis and the rest along another."""
    return share * axis(first) + np.sqrt(1.0 - share**2) * axis(second)


def residual(amplitudes):
    return sum((a * AXES[k] for k, a in amplitudes.items()), np.zeros(ROWS))


def by_scale(amplitude):
    return norm.logpdf(amplitude, scale=np.sqrt(1.0 + SCALES**2)) - norm.logpdf(amplitude)


def worth(amplitude):
    """Return the log evidence of an effect that moves one row by that amplitude."""
    return float(logsumexp(by_scale(amplitude)) - np.log(len(SCALES)))


def share(amplitude):
    """Return the most probable part of that effect: its conditional mean."""
    variance = SCALES[int(np.argmax(by_scale(amplitude)))] ** 2
    return amplitude * variance / (1.0 + variance)


def amplitude_worth(evidence):
    return brentq(lambda a: worth(a) - evidence, 0.0, 1000.0, xtol=1e-12)


def fitted(amplitudes, items, count=1, workmanship=()):
    """Return the settled hypothesis of the first explanations of a problem."""
    built = problem(residual(amplitudes), items, workmanship)
    start = Hypothesis(built, built.explanations[:count], (Scale(1.0),) * count, (0,) * len(workmanship))
    return start.settled()


class Left:
    """A stub of what processes find in the residual."""

    def __init__(self, structures=(), challenges=None, tried=1, noise=(), under=None, rest=(), leads=None, instead=()):
        self._structures, self._challenges, self._tried = list(structures), challenges or {}, tried
        self._leads, self._instead = leads or {}, instead
        self._rest = [SimpleNamespace(part=np.full(ROWS, part)) for part in rest]
        self._noise, self._under = noise, under
        self.asked = []

    def __len__(self):
        return self._tried

    def structures(self):
        return self._structures

    def challenge(self, indices):
        return self._challenges.get(indices, Challenge(process(""), -np.inf))

    def lead(self, indices, least_evidence):
        self.asked.append((indices, least_evidence))
        return self._leads.get(indices, np.inf)

    def without(self, indices):
        self.asked.append(indices)
        return Left(rest=self._instead)

    def larger_noise(self, kind):
        return self._noise

    def over(self, times):
        under = self._under[float(times.max())]
        under.hypothesis = self.hypothesis.over(times)
        return under

    def only(self, name):
        assert self._structures[0].process.name == name
        return self

    def sum(self, least_evidence, most):
        self.asked.append((least_evidence, most))
        return self._rest


def process(by="time"):
    return Process("place", by, {})


def structure(evidence, size, by="time"):
    return Structure(process(by), "", 1.0, evidence, size)


def cause(effect="a", evidence=100.0, size=1.0, alternatives=()):
    return Cause(effect, "plain", (0,), alternatives, 1.0, evidence, size)


@pytest.mark.parametrize("tried", [1, 7, 200])
def test_the_evidence_asked_for_keeps_the_rate_of_false_answers(tried):
    """Of so many candidates tried, a log evidence L has a chance of at most e^-L each: the rate is kept (Markov)."""
    assert tried * np.exp(-Thresholds().evidence_of_one_in(tried)) == pytest.approx(0.01)
    assert tried * np.exp(-Thresholds(false_names=0.2).evidence_of_one_in(tried)) == pytest.approx(0.2)


def test_nothing_tried_asks_for_as_much_as_one():
    assert Thresholds().evidence_of_one_in(0) == Thresholds().evidence_of_one_in(1)


@pytest.mark.parametrize("rate", [0.0, 1.0, 2.0, math.nan, "1 %"])
def test_a_rate_of_false_names_that_is_no_share_is_refused(rate):
    with pytest.raises(BadInputError, match="a share between 0 and 1"):
        Thresholds(false_names=rate)


def hidden(false_names):
    """Return the distance d at which N(d/2, d) exceeds the evidence asked for with a probability of 0.8."""
    asked = -np.log(false_names)
    return brentq(lambda d: norm.sf(asked, loc=d / 2.0, scale=np.sqrt(d)) - 0.8, 1e-6, 1e3, xtol=1e-12)


@pytest.mark.parametrize("false_names", [0.01, 0.3, 1.0 - 1e-9])
def test_hidden_is_the_distance_detected_four_times_in_five(false_names):
    assert Thresholds(false_names=false_names).hidden == pytest.approx(hidden(false_names), rel=1e-9)


def test_thresholds_causes_and_judgements_are_immutable():
    for made, name in ((Thresholds(), "alternative"), (cause(), "size"), (Judgement("no_gap", (), (), ()), "tried")):
        with pytest.raises(FrozenInstanceError):
            setattr(made, name, 2)


def test_structure_counts_above_its_evidence_and_size():
    least = np.log(30 / 0.01)
    found = [structure(*f) for f in ((least, 9.0), (least + 1e-9, 0.3), (least + 1e-9, 0.3 + 1e-9), (99.0, 0.1))]
    judged = Judgement("unknown", (), tuple(found), (), tried=30)
    assert judged.structure_evidence == pytest.approx(least)
    assert judged.clear_structures == (found[2],)


def test_structure_small_against_a_cause_is_part_of_that_causes_form():
    causes = (cause(size=2.0), cause("b", size=20.0))
    found = (structure(99.0, 0.99), structure(99.0, 1.01))
    assert Judgement("named", causes, found, ()).clear_structures == found[1:]
    assert Judgement("named", causes[:1], found, ()).clear_structures == found


@pytest.mark.parametrize(("kind", "verdict"), [("a", "unknown"), ("b", "named")])
def test_errors_of_joints_have_no_form_that_structure_could_be(kind, verdict):
    """Structure a fortieth of a cause is a detail of its form, unless the cause is of workmanship's kind."""
    hypothesis = fitted({0: SURE}, [explanation("a", axis(0))], workmanship=(usual(kind, axis(*BLOCK)),))
    left = Left([structure(99.0, hypothesis.squared_size(0) ** 0.5 / ROWS**0.5 / 40.0)])
    limits = Thresholds(structure_size=0.0)
    assert judge(hypothesis, left, limits).verdict == verdict


def test_without_a_cause_structure_has_no_share_to_reach():
    limits = Thresholds(structure_share=1.0)
    found = (structure(99.0, 0.4),)
    assert Judgement("unknown", (), found, (), thresholds=limits).clear_structures == found


def test_a_cause_is_beaten_by_more_than_the_evidence_asked_for():
    least = Thresholds().evidence_of_one_in(5)
    causes = (cause("a"), cause("b"), cause("c"))
    challenges = tuple(Challenge(process(), margin) for margin in (least, least + 1e-9, -3.0))
    judged = Judgement("named", causes, (), challenges, tried=5)
    assert judged.challenged == tuple(zip(causes, challenges, strict=True))
    assert judged.beaten == {"b": challenges[1]}


def test_a_sure_cause_alone():
    found = _cause(fitted({3: SURE}, [explanation("a", axis(3), "bent")]), "a", Thresholds())
    assert (found.effect, found.form, found.indices, found.alternatives) == ("a", "bent", (0,), ())
    assert found.evidence == pytest.approx(worth(SURE))
    assert found.probability == pytest.approx(HELD)
    assert found.size == pytest.approx(share(SURE) / np.sqrt(ROWS))


def test_with_one_equation_the_size_is_the_part_itself():
    built = problem(np.array([SURE]), [explanation("a", np.ones((1, 1)))])
    hypothesis = Hypothesis(built, built.explanations, (Scale(1.0),), ()).settled()
    assert _cause(hypothesis, "a", Thresholds()).size == pytest.approx(share(SURE))


def test_identical_effects_are_a_group_with_equal_chances():
    twins = [explanation(name, axis(0)) for name in "abc"]
    for count in (2, 3):
        found = _cause(fitted({0: SURE}, twins[:count]), "a", Thresholds())
        assert found.alternatives == tuple("bc"[: count - 1])
        assert found.probability == pytest.approx(HELD / count)
    assert judge(fitted({0: SURE}, twins), Left()).verdict == "group"


def test_a_doubtful_cause_shares_its_chance_with_chance_and_with_others():
    """Bayes: probability that it is at work, one of four as likely as nothing, times that of it among the others."""
    amplitude = amplitude_worth(3.0)
    items = [explanation(name, axis(k)) for k, name in enumerate("abcd")]
    found = _cause(fitted({0: amplitude, 1: 0.5, 2: 0.5, 3: 0.5}, items), "a", Thresholds())
    own, other = np.exp(3.0), np.exp(worth(0.5))
    assert found.probability == pytest.approx(HELD * own / (own + 4.0) * own / (own + 3.0 * other))
    assert found.evidence == pytest.approx(3.0)
    assert found.alternatives == ("b", "c", "d")  # every part is smaller than the hidden distance


@pytest.mark.parametrize(("factor", "named"), [(0.98, False), (1.02, True)])
def test_an_alternative_is_as_likely_as_the_rate_of_false_names(factor, named, monkeypatch):
    monkeypatch.setattr(Thresholds, "hidden", 0.0)
    probability = factor * Thresholds().false_names
    nearly = amplitude_worth(worth(SURE) + logit(probability))
    items = [explanation("a", axis(0)), explanation("b", tilted(0, 1, nearly / SURE))]
    found = _cause(fitted({0: SURE}, items), "a", Thresholds())
    assert found.alternatives == (("b",) if named else ())
    assert found.probability == pytest.approx(HELD * (1.0 - probability))


@pytest.mark.parametrize(("factor", "named"), [(0.99, True), (1.01, False)])
def test_an_effect_that_leaves_no_more_than_is_hidden_explains_as_well(factor, named):
    # A column of length 1 explains all but a share 1 / (1 + s²) of what it points to, where s is the widest scale.
    left = 1.0 - (1.0 - factor * hidden(0.01) / share(SURE) ** 2) * (1.0 + SCALES[-1] ** -2)
    items = [explanation("a", axis(0)), explanation("b", tilted(0, 1, np.sqrt(1.0 - left)))]
    found = _cause(fitted({0: SURE}, items), "a", Thresholds())
    assert found.alternatives == (("b",) if named else ())


@pytest.mark.parametrize(("count", "series", "named"), [(2, True, True), (8, True, False), (8, False, True)])
def test_a_series_that_needs_many_terms_to_add_up_to_a_cause_does_not_explain_as_well(count, series, named):
    """Each of n orthogonal terms of amplitude a/√n costs ½ (1 + ln(a²/n)) at its best scale: 3 nats more, and 16."""
    several = axis(*range(count)) @ hadamard(count) / np.sqrt(count)
    items = [explanation("a", axis(0)), replace(explanation("b", several), series=series)]
    found = _cause(fitted({0: SURE}, items), "a", Thresholds())
    assert found.alternatives == (("b",) if named else ())


def test_a_series_of_which_one_term_is_the_cause_explains_as_well():
    """With all terms at one scale it is no rival, but no data distinguish that one term from the cause."""
    terms = axis(*range(30)) + 0.1 * axis(0)
    items = [explanation("a", axis(0)), explanation("b", terms, series=True)]
    found = _cause(fitted({0: SURE}, items), "a", Thresholds())
    assert found.margins == {} and found.alternatives == ("b",)


def test_only_main_parameters_of_effects_that_may_be_named_explain_as_well():
    """No shape does, nor an identical effect that is no cause, nor a direction left by rounding of two columns."""
    items = [
        explanation("a", axis(0)),
        Explanation("shaped", "plain", axis(1, 0), np.array([True, False])),
        explanation("fitted", axis(0), cause=False),
        explanation("double", np.hstack([axis(1), axis(1) + 1e-12 * axis(0)])),
    ]
    found = _cause(fitted({0: SURE, 1: 0.5}, items), "a", Thresholds())
    assert found.alternatives == ()


def test_an_effect_in_two_forms_is_named_with_the_larger_form():
    items = [explanation("a", axis(0), "small"), explanation("b", axis(1)), explanation("a", axis(2), "large")]
    found = _cause(fitted({0: 9.0, 1: SURE, 2: 12.0}, items, 3), "a", Thresholds())
    assert (found.form, found.indices) == ("large", (0, 2))
    assert found.size == pytest.approx(np.hypot(share(9.0), share(12.0)) / np.sqrt(ROWS))
    assert found.evidence == pytest.approx(worth(9.0) + worth(12.0) - 2.0 * np.log(2.0))


@pytest.mark.parametrize(("behind", "tried"), [(11.9, True), (12.1, False)])
def test_rivals_are_tried_as_long_as_they_are_close(behind, tried):
    nearly = amplitude_worth(worth(SURE) - behind)
    items = [explanation("a", axis(0)), explanation("b", tilted(0, 1, nearly / SURE))]
    expected = {"b": pytest.approx(-behind)} if tried else {}
    assert rivals(fitted({0: SURE}, items), (0,), Thresholds()) == expected


def test_a_rival_counts_with_its_best_form():
    nearly = amplitude_worth(worth(SURE) - 1.0)
    forms = [explanation("b", tilted(0, 1, nearly / SURE), "worse"), explanation("b", axis(0), "better")]
    for order in (forms, forms[::-1]):
        found = rivals(fitted({0: SURE}, [explanation("a", axis(0)), *order]), (0,), Thresholds())
        assert found == {"b": pytest.approx(-np.log(2.0))}


@pytest.mark.parametrize("beside", [0, 1, 2])
def test_a_bent_form_is_no_rival_whatever_else_is_bent(beside):
    """The best form is all shape, so the next one counts, however many other effects of the hypothesis are bent."""
    nearly = amplitude_worth(worth(SURE) - 4.0)
    bent = np.array([True, False])
    others = [Explanation(f"c{k}", "plain", axis(10 + k, 20 + k), bent) for k in range(beside)]
    forms = [
        Explanation("b", "bent", axis(1, 0), bent),
        explanation("b", tilted(0, 2, nearly / SURE), "straight"),
        Explanation("d", "bent", axis(1, 0), bent),
    ]
    amplitudes = {0: SURE, 1: 0.1} | {20 + k: 8.0 for k in range(beside)} | {10 + k: 0.1 for k in range(beside)}
    hypothesis = fitted(amplitudes, [*others, explanation("a", axis(0)), *forms], beside + 1)
    without = hypothesis.without((beside,))
    evidences = {item.key: found.evidence for found, item in without.contenders({"b"})}
    assert evidences["b", "bent"] > evidences["b", "straight"]  # otherwise nothing would be refused
    assert rivals(hypothesis, (beside,), Thresholds()) == {"b": pytest.approx(-4.0 - np.log(2.0), abs=1e-6)}


def sized(small, large):
    """Return the hypothesis of a large and a small effect of known amplitudes, on different axes."""
    return fitted({0: large, 1: small}, [explanation("large", axis(0)), explanation("small", axis(1))], 2)


def effects(judged):
    return tuple(c.effect for c in judged.causes)


@pytest.mark.parametrize(("evidence", "named"), [(24.5, False), (25.5, True)])
def test_a_minor_effect_is_named_beyond_doubt(evidence, named):
    judged = judge(sized(amplitude_worth(evidence), 200.0), Left())
    assert effects(judged) == (("large", "small") if named else ("large",))
    assert (judged.verdict, judged.minor) == ("named", () if named else ("small",))


@pytest.mark.parametrize(("part", "named"), [(0.119, False), (0.121, True)])
def test_an_effect_is_minor_below_its_share(part, named):
    large = brentq(lambda a: share(a) - share(6.0) / part, 20.0, 200.0)
    assert worth(6.0) < 25.0
    assert effects(judge(sized(6.0, large), Left())) == (("large", "small") if named else ("large",))


@pytest.mark.parametrize(
    ("large", "ahead", "named"), [(100.0, 4.7, True), (100.0, 4.5, False), (400.0, 25.5, True), (400.0, 24.5, False)]
)
def test_what_a_larger_cause_of_varying_size_explains_as_well_is_no_cause(large, ahead, named):
    """The lead must reach what the accepted rate asks for (ln 100), or 25 nats where the effect is minor."""
    varying = tilted(1, 2, amplitude_worth(worth(SURE) - ahead) / SURE)
    judged = judge(
        sized(SURE, large),
        Left(),
        varied=lambda effect: [Process.of_columns("size", "time", varying)] if effect == "large" else [],
    )
    assert (effects(judged), judged.minor) == ((("large", "small"), ()) if named else (("large",), ("small",)))


def test_which_of_two_causes_is_larger_does_not_depend_on_which_was_found_first():
    found = fitted({0: 100.0, 1: SURE}, [explanation("small", axis(1)), explanation("large", axis(0))], 2)
    judged = judge(found, Left(), varied=lambda effect: [Process.of_columns(effect, "time", axis(1))])
    assert (effects(judged), judged.minor) == (("large",), ("small",))


def test_a_small_cause_of_varying_size_does_not_replace_a_larger_one():
    judged = judge(sized(SURE, 100.0), Left(), varied=lambda effect: [Process.of_columns(effect, "time", axis(0))])
    assert effects(judged) == ("large", "small")


def test_a_doubtful_effect_alone_is_compared_only_with_itself():
    assert effects(judge(fitted({0: 4.0}, [explanation("a", axis(0))]), Left())) == ("a",)


@pytest.mark.parametrize(("factor", "named"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("noise_known", [True, False])
def test_a_small_cause_that_adds_less_than_the_unexplained_rest_is_minor(factor, named, noise_known):
    """Without it the mean square of the residual would rise by twice its log evidence per equation.

    The unexplained rest is what the processes explain together, whether the noise is known or not.
    """
    hypothesis, left = sized(amplitude_worth(30.0), 200.0), factor * np.sqrt(2.0 * 30.0 / ROWS)
    judged = judge(hypothesis, Left(rest=(0.7 * left, 0.3 * left)), noise_known=noise_known)
    assert effects(judged) == (("large", "small") if named else ("large",))
    assert judged.minor == (() if named else ("small",))
    assert judge(hypothesis, Left(), noise_known=noise_known).minor == ()


def test_causes_keep_their_items_when_minor_ones_are_left_out():
    items = [explanation(name, axis(k)) for k, name in enumerate(("small", "large", "other"))]
    found = fitted({0: 6.0, 1: 200.0, 2: 150.0}, items, 3)
    judged = judge(found, Left(), Thresholds(minor_share=0.5, minor_evidence=1e6))
    assert (effects(judged), judged.minor) == (("large", "other"), ("small",))
    fewer, same = without_minor(found, judged, judged.minor)
    assert fewer.effects == ("large", "other")
    for cause in same.causes:
        assert [fewer.items[k].effect for k in cause.indices] == [cause.effect]
    assert [cause.effect for cause, _ in same.challenged] == ["large", "other"]


def test_what_adds_as_much_as_the_rest_stays_and_what_adds_nothing_goes():
    large, just, none = cause("large"), cause("just"), cause("none")
    assert _above([large, just, none], [60.0, 2.0, 0.0], 2.0, Thresholds()) == [large, just]
    assert _above([large, just], [60.0, 2.0], 2.0 + 1e-9, Thresholds()) == [large]
    assert _above([large, none], [60.0, 0.0], 1e-3, Thresholds()) == [large]
    assert _above([], [], 1.0, Thresholds()) == []


def test_a_cause_need_not_add_more_than_a_share_of_what_the_largest_adds():
    """The share is 0.12."""
    both = [cause("large"), cause("small")]
    for added, kept in ((1.19, 1), (1.21, 2)):
        assert len(_above(both, [10.0, added], 99.0, Thresholds())) == kept


def test_a_cause_that_small_errors_could_replace_counts_with_all_that_it_explains():
    """Without it coarser workmanship would explain as well. That makes its evidence small, but it is no minor cause."""
    items = [explanation("large", axis(0)), explanation("coarse", axis(1))]
    built = problem(residual({0: 12.0, 1: 9.0}), items, [usual("small", axis(1))])
    found = Hypothesis(built, built.explanations, (Scale(10.0), Scale(8.0)), (0,))
    assert found.without((1,)).settled().levels > (0,)
    judged = judge(found, Left(), Thresholds(minor_share=0.5, minor_evidence=0.0), noise_known=False)
    assert judged.causes[1].evidence < 0.1 * judged.causes[0].evidence
    assert effects(judged) == ("large", "coarse")


def test_nothing_found_is_no_gap():
    judged = judge(Hypothesis.nothing(problem(residual({0: 1.0}), [explanation("a", axis(0))])), Left(tried=4))
    assert judged == Judgement("no_gap", (), (), (), (), 4)


def test_clear_structure_makes_the_verdict_unknown_and_is_described():
    found = [structure(50.4, 0.456, "load"), structure(40.0, 0.4), structure(1.0, 3.0)]
    left = Left(found, tried=6, rest=(0.4,))
    limits = Thresholds(false_names=0.02)
    judged = judge(fitted({0: 20.0}, [explanation("a", axis(0))]), left, limits)
    assert judged.verdict == "unknown"
    assert effects(judged) == ("a",)
    assert len(judged.reasons) == 1
    assert "place depending on load (0.46 times the noise, log evidence 50)" in judged.reasons[0]
    assert judged.structures == tuple(found)
    assert [one.part[0] for one in judged.remainder] == [0.4]
    least = pytest.approx(np.log(6 / 0.02))
    assert left.asked == [((0,), least), (least, 3)]
    assert (judged.tried, judged.thresholds) == (6, limits)


def told_as(noise, under, hypothesis, **given):
    """Judge one clear structure with a larger noise of all rows, under which the processes find what is given."""
    larger = LargerNoise(None, *noise)
    left = Left([structure(50.0, 0.5)], noise=[larger], under={larger.factor: under}, rest=(0.5,))
    left.hypothesis = hypothesis
    return judge(hypothesis, left, **given)


def test_structure_that_vanishes_under_a_larger_noise_is_judged_as_scatter():
    least, alone = Thresholds().evidence_of_one_in(1), fitted({0: SURE}, [explanation("a", axis(0))])
    for evidence, left, told in ((9.0, 4.0, True), (9.0, least + 1e-9, False), (least, 4.0, False)):
        judged = told_as((2.0, evidence), Left([structure(left, 0.1)]), alone)
        assert (judged.verdict, judged.scatters) == ("unknown", told)
        assert [s.evidence for s in judged.clear_structures] == ([] if told else [50.0])
        assert ("like a larger noise" in judged.reasons[0], bool(judged.remainder)) == (told, not told)
    assert not told_as((2.0, 9.0), Left(), alone, noise_known=False).scatters


def test_a_larger_noise_is_considered_only_where_something_is_unknown():
    """A stated noise that is slightly too small hides no cause and is no cause itself."""
    judged = judge(fitted({0: SURE}, [explanation("a", axis(0))]), Left(noise=[LargerNoise(None, 1.2, 500.0)]))
    assert (judged.verdict, judged.scatters) == ("named", False)


def test_of_several_larger_noises_the_most_evident_that_hides_all_structure_is_chosen():
    """Of three, structure stays under the first and vanishes under the second; the third has too little evidence."""
    alone, kind = fitted({0: SURE}, [explanation("a", axis(0))]), np.arange(ROWS) % 2
    ways = [LargerNoise(1, 5.0, 80.0), LargerNoise(None, 4.0, 70.0), LargerNoise(0, 2.0, 1.0)]
    under = {5.0: Left([structure(30.0, 0.4)]), 4.0: Left(), 2.0: Left()}
    for given, told in ((ways, ways[1]), (ways[::2], None), (ways[1:], ways[1])):
        left = Left([structure(50.0, 0.5)], noise=given, under=under, rest=(0.5,))
        left.hypothesis = alone
        judged = judge(alone, left, kind=kind)
        assert (judged.verdict, judged.larger_noise) == ("unknown", told)


def test_a_search_repeated_under_a_larger_noise_ends_in_unknown():
    """However well the residual is explained there: the noise is not as stated."""
    larger = LargerNoise(0, 5.0, 80.0)
    judged = judge(fitted({0: SURE}, [explanation("a", axis(0))]), Left(), larger_noise=larger)
    assert (judged.verdict, judged.larger_noise, effects(judged)) == ("unknown", larger, ("a",))
    assert "like a larger noise" in judged.reasons[0]
    assert judged.doubtful == ()


def test_a_cause_must_be_one_under_the_larger_noise_too():
    """With three times the noise, amplitudes 20 and 8 become 6.7 and 2.7: 18 nats, and hardly one."""
    hypothesis = sized(8.0, SURE)
    judged = told_as((3.0, 99.0), Left(challenges={(0,): Challenge(process(), 9.0)}), hypothesis)
    assert worth(SURE / 3.0) > Thresholds().evidence_of_one_in(1) > worth(8.0 / 3.0)
    assert (effects(judged), judged.minor) == (("large",), ("small",))
    assert [*judged.beaten] == ["large"]


def test_unclear_structure_is_not_described():
    judged = judge(fitted({0: SURE}, [explanation("a", axis(0))]), Left([structure(1.0, 3.0)], rest=(3.0,)))
    assert (judged.verdict, judged.remainder, judged.reasons) == ("named", (), ())


def test_a_cause_that_a_process_beats_is_only_the_nearest_explanation():
    worse, better = Challenge(process(), -4.0), Challenge(process("load"), 30.4)
    judged = judge(sized(SURE, SURE), Left(challenges={(1,): better, (0,): worse}, tried=3))
    assert judged.verdict == "unknown"
    assert judged.challenges == (worse, better)
    assert judged.beaten == {"small": better}
    assert len(judged.reasons) == 1
    assert judged.reasons[0] == "'place depending on load' explains the data better than small, by 30 nats"


def test_where_something_is_unknown_a_cause_must_lead_the_description_that_could_replace_it():
    """By a factor of a hundred at the usual rate, whatever beats it alone; not asked where nothing is unknown."""
    least = Thresholds().evidence_of_one_in(1)
    for lead, doubtful in ((least - 1e-9, ("large",)), (least, ())):
        judged = judge(sized(SURE, SURE), Left([structure(50.0, 99.0)], rest=(0.5,), leads={(0,): lead}))
        assert (judged.verdict, judged.doubtful) == ("unknown", doubtful)
    beaten = {"challenges": {(1,): Challenge(process(), 30.0)}}
    for lead, doubtful in ((-30.0, ("small",)), (30.0, ())):
        judged = judge(sized(SURE, SURE), Left(**beaten, leads={(1,): lead}))
        assert (judged.doubtful, [*judged.beaten]) == (doubtful, ["small"])
    known = judge(sized(SURE, SURE), Left(leads={(0,): 0.0}))
    assert (known.verdict, known.doubtful) == ("named", ())
    under = Left(leads={(0,): 0.0})
    assert told_as((3.0, 99.0), under, sized(SURE, SURE)).doubtful == ("large",)


@pytest.mark.parametrize(("doubtful", "size"), [(True, 3.0), (False, 0.7)])
def test_what_a_doubtful_cause_explains_counts_as_unknown(doubtful, size):
    """The processes are fitted together with the sure causes only; the unknown is never larger than the gap."""
    leads = {(1,): -1.0} if doubtful else {}
    left = Left([structure(50.0, 99.0)], rest=(0.5, 0.2), instead=(4.0, -1.0), leads=leads)
    for gap, told in ((np.inf, size), (0.6, 0.6)):
        hypothesis = sized(SURE, SURE)
        problem = replace(hypothesis.problem, given_squared=gap**2 * ROWS)
        judged = judge(replace(hypothesis, problem=problem), left)
        assert judged.unknown_size == pytest.approx(told)
        assert ([1] in left.asked) == doubtful
    assert judge(sized(SURE, SURE), Left()).unknown_size == 0.0


def test_no_cause_of_a_disbelieved_judgement_is_sure():
    judged = judge(sized(SURE, SURE), Left())
    assert (judged.verdict, judged.doubtful) == ("named", ())
    for _ in range(2):  # the reason is given once, however often it is called
        judged = judged.disbelieved("too large", 7.0)
        assert (judged.verdict, judged.reasons, {*judged.doubtful}) == ("unknown", ("too large",), {"large", "small"})
        assert judged.unknown_size == 7.0  # the whole gap


def test_effects_fitted_to_reveal_small_errors_are_no_cause():
    fit = explanation("fitted", axis(0), cause=False)
    alone = judge(fitted({0: SURE}, [fit]), Left())
    assert (alone.verdict, alone.causes, len(alone.reasons)) == ("unknown", (), 1)
    assert "soft joints" in alone.reasons[0]
    for share, verdict in ((0.9, "no_gap"), (1.1, "unknown")):  # in units of the noise
        hypothesis = fitted({0: share * np.sqrt(len(axis(0)))}, [fit])
        assert hypothesis.worth((0,)) > 5.0
        assert judge(hypothesis, Left()).verdict == verdict
    beside = judge(fitted({0: SURE, 1: SURE}, [fit, explanation("a", axis(1))], 2), Left())
    assert (beside.verdict, effects(beside), beside.reasons) == ("named", ("a",), ())


BLOCK = range(10, 18)
OTHER = range(30, 38)
TYPICAL = WORKMANSHIP_LEVELS.index(1 / 64)


def usual(effect, columns):
    """Return workmanship whose columns have unit coefficients at the typical level, 1/64."""
    return Workmanship(effect, 64.0 * columns)


def told(values, workmanship, levels):
    """Return the log density given workmanship; a level's prior is normal about the typical one, in steps of two."""
    groups = [WORKMANSHIP_LEVELS[n] * b.columns for n, b in zip(levels, workmanship, strict=True) if n]
    prior = sum(norm.logpdf(n, TYPICAL, 1.0) - norm.logpdf(TYPICAL, TYPICAL, 1.0) for n in levels if n)
    return log_density(values, *groups) + prior / len(levels)


def best_told(values, workmanship, kind):
    """Return the log density with one kind alone at its best level."""
    zero = [0] * len(workmanship)
    choices = [[*zero[:kind], n, *zero[kind + 1 :]] for n in range(len(WORKMANSHIP_LEVELS))]
    return max(told(values, workmanship, levels) for levels in choices)


def spread(size, block=BLOCK):
    return dict.fromkeys(block, size)


def at_levels(amplitudes, workmanship, levels, items=()):
    return Hypothesis(problem(residual(amplitudes), items, workmanship), (), (), levels)


def test_small_errors_that_the_data_ask_for_are_a_cause():
    workmanship = (usual("small", axis(*BLOCK)),)
    known = [explanation("small", axis(40, 41)), explanation("b", axis(42)), explanation("c", axis(43))]
    hypothesis = at_levels(spread(1.5), workmanship, (TYPICAL,), known)
    values = residual(spread(1.5))
    best = max(range(len(WORKMANSHIP_LEVELS)), key=lambda n: told(values, workmanship, (n,)))
    assert best == TYPICAL
    evidence = told(values, workmanship, (TYPICAL,)) - told(values, workmanship, (0,))
    for factor, silent in EITHER_SIDE:
        asked = factor * np.exp(-evidence)
        found = workmanship_causes(hypothesis, Thresholds(false_names=asked))
        assert (found == []) == silent
    assert [(c.effect, c.form, c.indices, c.alternatives) for c in found] == [("small", "background", (), ())]
    assert found[0].evidence == pytest.approx(evidence)
    assert found[0].probability == pytest.approx((1.0 - asked) * np.exp(evidence) / (np.exp(evidence) + 3.0))
    assert found[0].size == pytest.approx(0.5 * 1.5 * np.sqrt(8 / ROWS))


def test_no_small_errors_are_no_cause():
    workmanship = (usual("small", axis(*BLOCK)),)
    assert workmanship_causes(at_levels(spread(3.0), workmanship, (0,)), Thresholds(false_names=1.0 - 1e-9)) == []
    assert workmanship_causes(at_levels({}, (), ()), Thresholds()) == []


def test_what_load_makes_of_workmanship_is_reported_unless_it_is_a_minor_part_of_it():
    small, fit = usual("small", axis(*BLOCK)), explanation("fitted", axis(0), cause=False)
    values = spread(6.0) | {0: SURE}
    built = problem(residual(values), [fit, explanation("small", axis(40))], (small,))
    found = Hypothesis(built, built.explanations[:1], (Scale(1.0),), (TYPICAL,)).settled()
    alone = residual(spread(6.0))
    makes = told(alone, (small,), found.levels) - told(alone, (small,), (0,))
    part = np.sqrt(worth(SURE) / makes)
    for factor, unknown in ((1.0 - 1e-3, True), (1.0 + 1e-3, False)):
        judged = judge(found, Left(), Thresholds(minor_share=factor * part))
        assert (judged.verdict == "unknown") == unknown


def test_with_two_kinds_of_workmanship_twice_the_odds_are_asked_for():
    workmanship = (usual("one", axis(*BLOCK)), usual("other", axis(*OTHER)))
    amplitudes = spread(2.2) | spread(2.2, OTHER)
    hypothesis = at_levels(amplitudes, workmanship, (4, 4), [explanation("one", axis(40))])
    values = residual(amplitudes)
    evidence = told(values, workmanship, (4, 4)) - told(values, workmanship, (0, 0))
    for factor, silent in EITHER_SIDE:
        found = workmanship_causes(hypothesis, Thresholds(false_names=factor * 2.0 * np.exp(-evidence)))
        assert (found == []) == silent


def test_where_two_kinds_are_needed_the_one_that_explains_most_is_named_with_its_own_evidence():
    workmanship = (usual("one", axis(*BLOCK)), usual("other", axis(*OTHER)))
    amplitudes = spread(2.9) | spread(3.1, OTHER)
    hypothesis = at_levels(amplitudes, workmanship, (5, 5), [explanation("one", axis(40))])
    found = workmanship_causes(hypothesis, Thresholds())
    values = residual(amplitudes)
    assert [(c.effect, c.alternatives) for c in found] == [("other", ())]
    assert found[0].evidence == pytest.approx(told(values, workmanship, (5, 5)) - told(values, workmanship, (5, 0)))
    assert found[0].size == pytest.approx(0.8 * 3.1 * np.sqrt(8 / ROWS))


def test_one_kind_is_enough_if_the_other_adds_less_than_is_asked_for():
    workmanship = (usual("one", axis(*BLOCK)), usual("other", axis(*OTHER)))
    amplitudes = spread(2.8) | spread(2.0, OTHER)
    hypothesis = at_levels(amplitudes, workmanship, (5, 4), [explanation("one", axis(40))])
    values = residual(amplitudes)
    alone = best_told(values, workmanship, 0)
    lacking, none = told(values, workmanship, (5, 4)) - alone, told(values, workmanship, (0, 0))
    assert lacking > 1.0
    for factor, enough in EITHER_SIDE:
        limits = Thresholds(false_names=factor * 2.0 * np.exp(-lacking))
        found = workmanship_causes(hypothesis, limits)
        assert [c.effect for c in found] == ["one"]
        expected = alone - none if enough else alone + lacking - best_told(values, workmanship, 1)
        assert found[0].evidence == pytest.approx(expected)


def overlapping():
    """Return three kinds of which two explain nearly the same, the first a little better."""
    nearly = np.hstack([tilted(k, k + 20, 0.95) for k in BLOCK])
    return usual("one", axis(*BLOCK)), usual("other", nearly), usual("third", axis(*OTHER))


def test_kinds_that_explain_as_well_are_alternatives():
    workmanship, amplitudes = overlapping(), spread(2.4)
    hypothesis = at_levels(amplitudes, workmanship, (4, 4, 1), [explanation("one", axis(40))])
    values = residual(amplitudes)
    ratio = np.exp(best_told(values, workmanship, 1) - best_told(values, workmanship, 0))
    assert 0.05 < ratio < 1.0
    for factor, likely in EITHER_SIDE:
        limits = Thresholds(false_names=factor * ratio)
        found = workmanship_causes(hypothesis, limits)
        assert [(c.effect, c.alternatives) for c in found] == [("one", ("other",) if likely else ())]
        share = 1.0 / (1.0 + ratio) if likely else 1.0
        assert found[0].probability == pytest.approx((1.0 - limits.false_names) * share, abs=0.01)


def test_identical_kinds_have_equal_chances():
    same = [usual(name, axis(*BLOCK)) for name in ("one", "two", "three")]
    hypothesis = at_levels(spread(3.0), same, (3, 3, 3), [explanation("one", axis(40))])
    found = workmanship_causes(hypothesis, Thresholds())
    assert {found[0].effect, *found[0].alternatives} == {"one", "two", "three"}
    assert [*found[0].alternatives] == sorted(found[0].alternatives)
    assert found[0].probability == pytest.approx(HELD / 3.0, abs=1e-3)


def averaged(values, columns):
    """Return the log density of an effect, averaged over its scales."""
    return float(logsumexp([log_density(values, s * columns) for s in SCALES]) - np.log(len(SCALES)))


def test_an_effect_that_explains_as_well_as_small_errors_is_an_alternative():
    workmanship = (usual("small", axis(*BLOCK)),)
    items = [explanation("small", axis(*BLOCK)), explanation("twin", axis(*BLOCK)), explanation("far", axis(40))]
    hypothesis, values = at_levels(spread(2.0), workmanship, (4,), items), residual(spread(2.0))
    ratio = np.exp(averaged(values, axis(*BLOCK)) - told(values, workmanship, (4,)))
    for factor, likely in EITHER_SIDE:
        limits = Thresholds(false_names=factor * ratio)
        assert [*instead_of_workmanship(hypothesis, 0, limits)] == (["twin"] if likely else [])
        found = workmanship_causes(hypothesis, limits)
        assert [(c.effect, c.alternatives) for c in found] == [("small", ("twin",) if likely else ())]
        odds = np.exp(averaged(values, axis(*BLOCK)) - best_told(values, workmanship, 0)) / 3.0  # one of three effects
        share = 1.0 / (1.0 + odds) if likely else 1.0
        chance = (1.0 - limits.false_names) * expit(found[0].evidence - np.log(3.0))
        assert found[0].probability == pytest.approx(chance * share)
    assert judge(hypothesis, Left()).verdict == "group"


@pytest.mark.parametrize(("factor", "found"), [(0.97, ()), (1.03, ("b",))])
def test_an_alternative_to_small_errors_explains_at_least_half_of_what_they_do(factor, found):
    """That is a quarter of the sum of squares; together with small errors any size would have some evidence."""
    part = 0.5 * 1.9
    amplitude = brentq(lambda a: share(a) ** 2 - 0.25 * factor**2 * 8.0 * part**2, 1.5, 9.0)
    items = [explanation("b", axis(40))]
    hypothesis = at_levels(spread(1.9) | {40: amplitude}, (usual("small", axis(*BLOCK)),), (4,), items)
    assert (*instead_of_workmanship(hypothesis, 0, Thresholds()),) == found


@pytest.mark.parametrize(("evidence", "found"), [(-0.1, ()), (0.1, ("b",)), (0.9, ("b",))])
def test_an_alternative_to_small_errors_has_positive_evidence(evidence, found):
    amplitude = amplitude_worth(evidence)
    items = [explanation("b", axis(40))]
    hypothesis = at_levels(spread(0.3) | {40: amplitude}, (usual("small", axis(*BLOCK)),), (4,), items)
    assert (*instead_of_workmanship(hypothesis, 0, Thresholds()),) == found


def test_small_errors_are_named_where_the_library_allows_it():
    workmanship = (usual("small", axis(*BLOCK)),)
    values = residual(spread(3.0))
    known = explanation("small", axis(40))
    named = judge(Hypothesis.nothing(problem(values, [known], workmanship)), Left())
    assert (named.verdict, effects(named), named.reasons) == ("named", ("small",), ())
    assert named.beaten == {}
    barred = judge(Hypothesis.nothing(problem(values, [replace(known, effect="b")], workmanship)), Left())
    assert (barred.verdict, barred.causes) == ("unknown", ())
    assert barred.reasons == ("workmanship of the kind small is present, but excluded from being named",)


def test_small_errors_are_not_named_where_there_is_another_cause_or_a_reason_for_unknown():
    workmanship = (usual("small", axis(*BLOCK)),)
    items = [explanation("a", axis(0)), explanation("small", axis(40))]
    beside = judge(fitted(spread(3.0) | {0: 30.0}, items, 1, workmanship), Left())
    assert (beside.verdict, effects(beside)) == ("named", ("a",))
    left = Left([structure(50.0, 1.0)])
    unknown = judge(Hypothesis.nothing(problem(residual(spread(3.0)), items, workmanship)), left)
    assert (unknown.verdict, unknown.causes, len(unknown.reasons)) == ("unknown", (), 1)
