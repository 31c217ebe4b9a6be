"""Which explanations the data require: forward steps, exchange of forms and effects, backward steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.problem import Problem
from pouring_robot.inference.thresholds import DEFAULT_THRESHOLDS, Thresholds

_BRANCHES = 3
"""Number of effects that are tried in full at every step."""
_BRANCH_BEHIND = 30.0
"""How far behind, in nats, a candidate may be before it is settled: further behind, it does not catch up."""
_WORTH_TRYING = 0.6
"""Least log evidence of another branch before it is settled, as a share of the best one's."""
_MOST_REFUSED = 8
_BEYOND_DOUBT = 200.0
"""Log evidence beyond which workmanship never replaces an item, in nats."""


def search(
    problem: Problem, thresholds: Thresholds = DEFAULT_THRESHOLDS, start: Hypothesis | None = None
) -> Hypothesis:
    """Return the hypothesis with the best evidence that steps of one explanation reach.

    On the way an effect may take the shape of something not found yet. If at the end it is still mostly its shaping
    parameters (see :func:`credible`), the search continues without it. It begins at ``start``, by default with nothing.
    """
    current = _found(start.settled() if start else Hypothesis.nothing(problem), thresholds)
    for _ in range(_MOST_REFUSED):
        wrong = [k for k, item in enumerate(current.items) if item.cause and not credible(current, k, thresholds)]
        # Put into the robot, causes that cancel each other may grow without limit.
        wrong = wrong or cancelled(current, problem.given_squared, thresholds)
        if not wrong:
            break
        worst = min(wrong, key=current.main_share)
        refused, rest = {current.items[worst].key}, current.without_items(wrong)
        if impossible(current, worst, thresholds):  # bar all its forms that are no more credible in its place
            forms = (item for item in problem.explanations if item.effect == current.items[worst].effect)
            refused |= {item.key for item in forms if not credible(rest.with_item(item), len(rest.items), thresholds)}
        current = _found(replace(rest, barred=rest.barred | refused), thresholds)
    return current


def _found(start: Hypothesis, thresholds: Thresholds) -> Hypothesis:
    return _divided(_ascended(start, thresholds), thresholds)


def _ascended(current: Hypothesis, thresholds: Thresholds) -> Hypothesis:
    """Add explanations as long as each has enough evidence."""
    while len(current.items) < thresholds.most_effects:
        tried = sorted(_forward(current, thresholds), key=lambda h: -h.log_evidence)[:_BRANCHES]
        # A branch that is this far behind at first does not catch up when its items are reconsidered.
        close = [h for h in tried if h.log_evidence > tried[0].log_evidence - _BRANCH_BEHIND]
        close = [backward(reconsidered(h), thresholds) for h in close]
        close = [h for h in close if not cancelled(h, h.problem.gram.squared, thresholds)]
        best = max(close, key=lambda h: h.log_evidence, default=current)
        if best.log_evidence < current.log_evidence + thresholds.least_evidence:
            break
        current = best
    return backward(current, thresholds)


def _divided(current: Hypothesis, thresholds: Thresholds) -> Hypothesis:
    """Return the hypothesis with single parameters of an effect in place of many, where that is better.

    Steps of one explanation do not lead from all lengths of an arm, with an overall scale, to the two that are wrong.
    """
    for effect in current.effects:
        rest = current.without_items(current.of_effect(effect))
        while len(rest.items) < thresholds.most_effects:
            single = (item for item in rest.choices if item.effect == effect and item.columns.shape[1] == 1)
            worth, item = next(rest.ranked(single), (None, None))
            if worth is None or item is None or worth.evidence < thresholds.least_evidence:
                break
            rest = rest.with_item(item, worth.scale)
        # Further behind, it does not catch up when its items are reconsidered.
        if rest.log_evidence > current.log_evidence - _BRANCH_BEHIND and rest.of_effect(effect):
            rest = backward(reconsidered(rest), thresholds)
            better = rest.log_evidence > current.log_evidence + 1e-6
            if better and not cancelled(rest, rest.problem.gram.squared, thresholds):
                current = rest
    return current


def cancelled(hypothesis: Hypothesis, gap_squared: float, thresholds: Thresholds) -> list[int]:
    """Return the indices of causes whose parts are so much larger than a gap that others cancel them."""
    most = thresholds.most_cancelled**2 * gap_squared
    return [k for k, item in enumerate(hypothesis.items) if item.cause and hypothesis.squared_size(k) > most]


def credible(hypothesis: Hypothesis, index: int, thresholds: Thresholds) -> bool:
    """Return whether an item is the effect it is named after, and not mostly its shaping parameters."""
    return hypothesis.main_share(index) >= thresholds.least_main_share


def impossible(hypothesis: Hypothesis, index: int, thresholds: Thresholds) -> bool:
    """Return whether an item would be credible but for the physical limits of its parameters."""
    share = hypothesis.main_share(index, bounded=False)
    return share >= thresholds.least_main_share and not credible(hypothesis, index, thresholds)


def impossible_effects(hypothesis: Hypothesis, thresholds: Thresholds) -> tuple[str, ...]:
    """Return the effects that are refused because their parameters would have to exceed physical limits."""
    found = [
        item.effect
        for item in hypothesis.problem.explanations
        if item.key in hypothesis.barred and item.bounds is not None and item.effect not in hypothesis.effects
        if impossible(hypothesis.with_item(item), len(hypothesis.items), thresholds)
    ]
    return tuple(dict.fromkeys(found))


def _forward(current: Hypothesis, thresholds: Thresholds) -> Iterator[Hypothesis]:
    """Yield the hypotheses with one more effect that look best before they are settled.

    Workmanship may have absorbed what an effect does, so effects are tried both with it and without any.
    """
    bases = [current, *([current.with_levels_of(())] if any(current.levels) else [])]
    for base in bases:
        seen: set[str] = set()
        best = 0.0
        for worth, item in base.ranked(base.choices):
            best = best or worth.evidence
            if len(seen) >= _BRANCHES or worth.evidence <= 0.0 or worth.evidence < _WORTH_TRYING * best:
                break
            if item.effect not in seen:
                seen.add(item.effect)
                yield base.with_item(item, worth.scale)


def best_forms(problem: Problem, most: int) -> list[tuple[str, str]]:
    """Return the keys of the effects with the largest Bayes factors alone, each in its best form, best first."""
    nothing, found = Hypothesis.nothing(problem), dict[str, tuple[str, str]]()
    for _, item in nothing.ranked(nothing.choices):
        if item.cause:
            found.setdefault(item.effect, item.key)
        if len(found) == most:
            break
    return list(found.values())


def reconsidered(hypothesis: Hypothesis) -> Hypothesis:
    """Return the hypothesis with items exchanged for better ones, as long as that raises the evidence."""
    for _ in range(3):
        before = hypothesis
        for item in hypothesis.items:
            hypothesis = _exchanged(hypothesis, item.key)
        if hypothesis is before:
            break
    return hypothesis


def _exchanged(hypothesis: Hypothesis, key: tuple[str, str]) -> Hypothesis:
    """Return the hypothesis with one explanation replaced by a better one, if there is any; else itself.

    Branches of the search often reach the same hypothesis, so each exchange is searched for once. Only the changes are
    remembered: a hypothesis refers to its problem, so that the cache would keep both and their columns alive.
    """
    entry = "exchanged", key, hypothesis.barred
    found = hypothesis.memoised(entry, lambda: _better(hypothesis, key))
    return replace(hypothesis, **found) if found else hypothesis


def _better(hypothesis: Hypothesis, key: tuple[str, str]) -> dict[str, Any]:
    """Return the fields that change where a better explanation replaces one; none where none is better.

    Scales and workmanship are settled again: what looks worse at first may then be better, so the best few are tried.
    """
    index = [item.key for item in hypothesis.items].index(key)
    rest = hypothesis.without((index,))
    current = rest.candidate_bayes_factor(hypothesis.items[index])
    tried: set[str] = set()
    for found, item in rest.ranked(choice for choice in rest.choices if choice.key != key):
        if found.evidence < current.evidence - _BRANCH_BEHIND:
            break
        if item.effect in tried or (item.effect == key[0] and found.evidence < current.evidence):
            continue
        other = hypothesis.with_replaced(index, item, found.scale)
        if other.log_evidence > hypothesis.log_evidence - _BRANCH_BEHIND:
            other = other.settled()
        if other.log_evidence > hypothesis.log_evidence + 1e-6:
            return {"items": other.items, "scales": other.scales, "levels": other.levels}
        tried.add(item.effect)
        if len(tried) == _BRANCHES:
            break
    return {}


def backward(hypothesis: Hypothesis, thresholds: Thresholds) -> Hypothesis:
    """Return the hypothesis without the items that have too little evidence."""
    while hypothesis.items:
        doubtful = [k for k in range(len(hypothesis.items)) if hypothesis.item_bayes_factor(k).evidence < _BEYOND_DOUBT]
        shorter = [hypothesis.without_items((k,)) for k in doubtful]
        best = max(shorter, key=lambda h: h.log_evidence, default=None)
        if best is None or best.log_evidence <= hypothesis.log_evidence - thresholds.least_evidence:
            break
        hypothesis = best
    return hypothesis
