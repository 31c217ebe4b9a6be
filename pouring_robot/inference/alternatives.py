"""Which effects explain as well as a cause, so that data do not tell them apart. Nothing here knows the robot."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

from scipy.special import softmax

from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.priors import log_prior_odds
from pouring_robot.inference.search import credible
from pouring_robot.inference.thresholds import Thresholds

_CLOSE = 12.0
"""How far behind in evidence (nats), the least that they may be, alternatives are no more."""


def alternatives(
    hypothesis: Hypothesis, indices: Sequence[int], margins: Mapping[str, float], thresholds: Thresholds
) -> tuple[str, ...]:
    """Return the effects, by name, that may be at work in the place of some items as far as the data tell.

    Those that are as likely, by their ``margins`` as of :func:`rivals`, and those that leave no more than is hidden.
    """
    shares = zip(margins, softmax([0.0, *margins.values()])[1:], strict=True)
    likely = {rival for rival, share in shares if share > thresholds.false_names}
    squared, choices = hypothesis.squared_size(*indices), hypothesis.rivals
    forms = [item for item in hypothesis.problem.explanations if item.effect in choices]
    alike = [item for item in forms if squared - hypothesis.explained_by(item, indices) < thresholds.hidden]
    # Terms of a series add up to any course, but only if each of many is as large as that takes: no tie.
    fewest = functools.partial(hypothesis.evidence_of_fewest, indices, thresholds.hidden)
    same = {e.effect for e in alike if not e.series or fewest(e) > fewest() - _CLOSE}
    return tuple(sorted(likely | same))


def rivals(hypothesis: Hypothesis, indices: Sequence[int], thresholds: Thresholds) -> dict[str, float]:
    """Return by how much close effects in the place of some items change the log evidence, best form of each, in nats.

    A form counts only as long as it is the effect it is called: where the best one is bent, the next is tried.
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
    """Return the effects that explain as well what workmanship does, most of it by themselves.

    With the log evidence of each, and that it is as seldom as noise looks like any effect, where every machine has some
    workmanship.
    """
    workmanship = [kind.effect for kind in hypothesis.problem.workmanship]
    bare, own = hypothesis.with_levels_of(()), hypothesis.workmanship_part(kind)
    likely = hypothesis.log_evidence - thresholds.evidence_of_one_in(1)
    found, seldom = dict[str, float](), log_prior_odds(len(hypothesis.problem.known))
    for effect, (worth, item) in bare.best_forms(hypothesis.rivals - {*workmanship}).items():
        if worth.evidence > 0.0:
            other = bare.with_item(item, worth.scale)
            index = len(other.items) - 1
            if other.log_evidence > likely and 4.0 * other.squared_size(index) > own @ own:
                found[effect] = other.log_evidence + seldom
    return found
