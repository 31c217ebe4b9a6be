"""Which effects explain as well as a cause, so that data cannot distinguish them. Nothing here knows the robot."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

from scipy.special import softmax

from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.priors import log_prior_odds
from pouring_robot.inference.search import credible
from pouring_robot.inference.thresholds import Thresholds

_CLOSE = 12.0
"""How far behind in log evidence (nats), before anything is settled again, an effect may be as an alternative."""


def alternatives(
    hypothesis: Hypothesis, indices: Sequence[int], margins: Mapping[str, float], thresholds: Thresholds
) -> tuple[str, ...]:
    """Return the effects, by name, that may be at work in place of some items according to the data.

    Those that are probable enough, by their ``margins`` as of :func:`rivals`, and those that leave no more of the
    items' part unexplained than stays hidden in data like these.
    """
    shares = zip(margins, softmax([0.0, *margins.values()])[1:], strict=True)
    likely = {rival for rival, share in shares if share > thresholds.false_names}
    squared, choices = hypothesis.squared_size(*indices), hypothesis.rivals
    forms = [item for item in hypothesis.problem.explanations if item.effect in choices]
    alike = [item for item in forms if squared - hypothesis.explained_by(item, indices) < thresholds.hidden]
    # Terms of a series add up to any curve, but only if many of them are large: that is no alternative.
    fewest = functools.partial(hypothesis.evidence_of_fewest, indices, thresholds.hidden)
    same = {e.effect for e in alike if not e.series or fewest(e) > fewest() - _CLOSE}
    return tuple(sorted(likely | same))


def rivals(hypothesis: Hypothesis, indices: Sequence[int], thresholds: Thresholds) -> dict[str, float]:
    """Return by how much close effects in place of some items change the log evidence, best form of each, in nats.

    A form counts only if it is credible: where the best one is mostly shaping parameters, the next is tried.
    """
    own, bare, rest = hypothesis.worth(indices), hypothesis.without(indices), hypothesis.without_items(indices)
    found: dict[str, float] = {}
    for worth, item in bare.contenders(hypothesis.rivals):
        if worth.evidence > own - _CLOSE and item.effect not in found:
            other = rest.with_item(item, worth.scale)
            if credible(other, len(other.items) - 1, thresholds):
                found[item.effect] = other.log_evidence - hypothesis.log_evidence
    return found


def instead_of_workmanship(hypothesis: Hypothesis, kind: int, thresholds: Thresholds) -> dict[str, float]:
    """Return the effects that explain as well what workmanship does, most of it by themselves, with log evidences.

    These include the prior odds of an effect, which is as rare as noise that looks like any, whereas every machine has
    some workmanship.
    """
    workmanship = [kind.effect for kind in hypothesis.problem.workmanship]
    bare, own = hypothesis.with_levels_of(()), hypothesis.workmanship_part(kind)
    likely = hypothesis.log_evidence - thresholds.evidence_of_one_in(1)
    found, prior_odds = dict[str, float](), log_prior_odds(len(hypothesis.problem.known))
    for effect, (worth, item) in bare.best_forms(hypothesis.rivals - {*workmanship}).items():
        if worth.evidence > 0.0:
            other = bare.with_item(item, worth.scale)
            index = len(other.items) - 1
            if other.log_evidence > likely and 4.0 * other.squared_size(index) > own @ own:
                found[effect] = other.log_evidence + prior_odds
    return found
