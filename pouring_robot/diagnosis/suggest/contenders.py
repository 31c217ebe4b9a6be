"""Explanations that survive a diagnosis, and the closest others: what the next measurements should distinguish."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pouring_robot.diagnosis.discrepancy_processes import CYCLES
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.suggest.candidates import PredictedMeasurements
from pouring_robot.inference.decision import Cause
from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.gaussian_processes.discrepancy import Challenge, Structure
from pouring_robot.inference.gaussian_processes.processes import CHANCE
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.problem import Explanation

MOST_RIVALS = 3
NOTHING = "nothing"


@dataclass(frozen=True, eq=False)
class Contender:
    """An explanation of the campaign."""

    name: str  # of what explains: an effect's id, or a description in words
    hypothesis: Hypothesis  # the whole hypothesis
    log_evidence: float  # its own, in nats, up to a constant of the campaign

    @classmethod
    def of(cls, name: str, hypothesis: Hypothesis) -> Self:
        """Return a hypothesis as a contender."""
        return cls(name, hypothesis, hypothesis.log_evidence)


Contest = tuple[list[Contender], list[tuple[int, int]]]
"""Explanations to be distinguished, the best first, and the pairs to distinguish, by index."""


def contest(diagnosis: Findings, prospect: PredictedMeasurements) -> Contest:
    """Return the explanations to be distinguished.

    The members of a group, a named effect and the next best ones, or the best descriptions of something unknown; where
    there is no gap, the effects that could best hide.
    """
    best = diagnosis.hypothesis.on(prospect.problem).settled()
    causes, verdict = diagnosis.judgement.causes, diagnosis.judgement.verdict
    if verdict == "unknown":
        return _against_first(_descriptions(diagnosis, prospect, best))
    effects, given = diagnosis.diagnoser.library.effects, diagnosis.rows.conditions
    # No measurement shows an effect that can never move this robot.
    idle = {name for name, effect in effects.items() if not effect.missing(given) and not effect.can_occur(given)}
    if not causes:
        return _against_first([Contender.of(NOTHING, best), *_hidden(best, prospect, idle)])
    found = []
    for cause in sorted(causes, key=lambda c: c.probability):
        wanted = cause.alternatives if verdict == "group" else None
        if wanted != ():
            found.append((Contender.of(cause.effect, best), _rivals(best, cause, wanted, idle)))
    contenders = [first for first, _ in found]
    pairs = []
    room = max(1, MOST_RIVALS // len(found))
    for k, (_, rivals) in enumerate(found):
        for rival in rivals[: MOST_RIVALS if k == 0 and verdict == "group" else room]:
            pairs.append((k, len(contenders)))
            contenders.append(rival)
    return contenders, pairs


def _against_first(found: list[Contender]) -> Contest:
    return found, [(0, k) for k in range(1, len(found))]


def _less(hypothesis: Hypothesis, cause: Cause) -> Hypothesis:
    """Return the hypothesis without a cause, with all else unchanged."""
    rest = hypothesis.without(hypothesis.of_effect(cause.effect))
    if cause.indices:
        return rest
    pairs = zip(rest.levels, rest.problem.workmanship, strict=True)
    return replace(rest, levels=tuple(0 if b.effect == cause.effect else level for level, b in pairs))


def _rivals(best: Hypothesis, cause: Cause, wanted: Collection[str] | None, idle: Collection[str]) -> list[Contender]:
    """Return other effects in place of a cause, best first: the wanted ones or, by default, the next best."""
    rest, effects = _less(best, cause), best.rivals - {cause.effect, *idle}
    forms = list(rest.best_forms(effects if wanted is None else effects & {*wanted}).values())[:MOST_RIVALS]
    found = [Contender.of(item.effect, rest.with_item(item, worth.scale)) for worth, item in forms]
    return sorted(found, key=lambda c: -c.log_evidence)


def _descriptions(diagnosis: Findings, prospect: PredictedMeasurements, best: Hypothesis) -> list[Contender]:
    """Return the descriptions that best explain what no effect does; with fewer than two, also the best hypothesis."""
    judgement = diagnosis.judgement
    named: list[tuple[Structure | Challenge, Hypothesis]] = [(found, best) for found in judgement.structures]
    named += [(better, _less(best, cause)) for cause, better in judgement.challenged if better.margin > 0.0]
    # No pose distinguishes independent errors in every row, or waves in time.
    named = [(one, rest) for one, rest in named[: 2 * MOST_RIVALS] if one.process.by not in (CHANCE, CYCLES)]
    items = prospect.explanations({(one.process.name, one.length) for one, _ in named})
    found: dict[str, Contender] = {}
    for one, rest in named:
        name, item = one.process.words, items.get((one.process.name, one.length))
        if item and name not in found:
            wider = replace(rest, problem=rest.problem.and_also((item,)))
            worth = wider.candidate_bayes_factor(item)
            found[name] = Contender(name, wider.beside(item, worth.scale), wider.log_evidence + worth.evidence)
    ordered = sorted(found.values(), key=lambda c: -c.log_evidence)[: MOST_RIVALS + 1]
    return ordered if len(ordered) > 1 else [*ordered, Contender.of(" and ".join(best.effects) or NOTHING, best)]


def _hidden(best: Hypothesis, prospect: PredictedMeasurements, idle: Collection[str]) -> list[Contender]:
    """Return the effects that would show least if they had their usual size: those tested worst."""
    seen: dict[str, tuple[float, Explanation]] = {}
    for item in prospect.problem.explanations:
        if not item.cause or item.effect in seen or item.effect in idle:
            continue  # the usual form of an effect comes first
        places = best.problem.places(item)
        inner = best.everything.inner(places, places)
        worth = 0.5 * float(np.linalg.slogdet(np.eye(len(inner)) + inner)[1])
        seen[item.effect] = (worth, item)
    least = sorted(seen.values(), key=lambda entry: entry[0])[:MOST_RIVALS]
    return [Contender.of(item.effect, best.beside(item, Scale(1.0))) for _, item in least]
