"""From the best hypothesis to what may be said: verdict, alternatives, probabilities. Nothing here knows the robot.

Where no model can hold what was found, ``diagnosis/diagnose.py`` overrules it (:meth:`Judgement.disbelieved`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.special import expit, softmax

from pouring_robot.inference.alternatives import alternatives, instead_of_workmanship, rivals
from pouring_robot.inference.gaussian_processes.discrepancy import Challenge, Discrepancy, Structure, Summand
from pouring_robot.inference.gaussian_processes.processes import Process
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.larger_noise import LargerNoise
from pouring_robot.inference.priors import log_prior_odds
from pouring_robot.inference.problem import WORKMANSHIP_FORM
from pouring_robot.inference.thresholds import DEFAULT_THRESHOLDS, Thresholds
from pouring_robot.mechanism.arrays import FloatArray, Indices, rms

Varied = Callable[[str], Iterable[Process]]
"""Gives the processes by which the size of an effect at work may vary, by its id."""
Verdict = Literal["no_gap", "named", "group", "unknown"]
_MOST_PARTS = 3


@dataclass(frozen=True)
class Cause:
    """A named effect."""

    effect: str  # its id
    form: str  # in which form it fits best
    # of its items in the hypothesis, several where it takes several forms; none for workmanship that stands alone
    indices: tuple[int, ...]
    alternatives: tuple[str, ...]  # effects that these data cannot distinguish from it
    probability: float  # that it is at work rather than an alternative, chance or something that the library lacks
    evidence: float  # log evidence of the hypothesis with it against the best one without it, in nats
    # root mean square of its part in the predictions, free unknowns projected out, in noise standard deviations
    size: float
    exact: bool = False  # whether its form covers all that is physically possible, as placements of rigid joints do
    margins: Mapping[str, float] = field(default_factory=dict)  # of its close rivals, as :func:`~.alternatives.rivals`

    def keys(self, hypothesis: Hypothesis) -> list[tuple[str, str]]:
        """Return effect and form of each of its items, or of the workmanship that it is."""
        return [hypothesis.items[k].key for k in self.indices] or [(self.effect, WORKMANSHIP_FORM)]


@dataclass(frozen=True)
class Judgement:
    """What may be said."""

    verdict: Verdict  # no_gap, named, group or unknown
    causes: tuple[Cause, ...]  # named effects, in the order they were added
    structures: tuple[Structure, ...]  # structure left in the residual, most evident first
    # for each cause that the search found, the process that would explain best in its place
    challenges: tuple[Challenge, ...]
    reasons: tuple[str, ...] = ()  # why the verdict is what it is, one line each
    tried: int = 1  # number of processes tried
    thresholds: Thresholds = DEFAULT_THRESHOLDS  # by which it was judged
    minor: tuple[str, ...] = ()  # effects at work only with others, if at all, that add too little to be causes
    remainder: tuple[Summand, ...] = ()  # processes whose sum describes the residual, largest first
    larger_noise: LargerNoise | None = None  # as which the residual scatters from row to row; None where it does not
    # effects that may be a part of something unknown: a process in their place would explain nearly as well
    doubtful: tuple[str, ...] = ()
    # root mean square of all that is unknown, in noise standard deviations, including what doubtful effects absorb
    unknown_size: float = 0.0

    @property
    def scatters(self) -> bool:
        """Whether the residual scatters from row to row, as a larger noise would."""
        return self.larger_noise is not None

    @property
    def names(self) -> bool:
        """Whether causes are named, alone or as groups."""
        return self.verdict in {"named", "group"}

    @property
    def clear_structures(self) -> tuple[Structure, ...]:
        """Structures that count, most evident first."""
        limits = self.thresholds
        largest = max((cause.size for cause in self.causes if not cause.exact), default=0.0)
        least = max(limits.structure_size, limits.structure_share * largest)
        return tuple(s for s in self.structures if s.evidence > self.structure_evidence and s.size > least)

    @property
    def structure_evidence(self) -> float:
        """Log evidence that structure, or a process against a cause, needs, in nats."""
        return self.thresholds.evidence_of_one_in(self.tried)

    @property
    def challenged(self) -> tuple[tuple[Cause, Challenge], ...]:
        """Causes against which processes were tried, each with the best one."""
        return tuple(zip(self.causes, self.challenges, strict=False))

    @property
    def beaten(self) -> dict[str, Challenge]:
        """Effects in whose place a process explains better, with that process: something is unknown."""
        return {c.effect: found for c, found in self.challenged if found.margin > self.structure_evidence}

    def disbelieved(self, why: str, gap: float) -> Judgement:
        """Return the same with all causes in doubt, as something is wrong with all: the whole gap is unknown."""
        reasons = (why, *(line for line in self.reasons if line != why))
        doubtful = tuple(cause.effect for cause in self.causes)
        return replace(self, verdict="unknown", reasons=reasons, doubtful=doubtful, unknown_size=gap)


def judge(
    hypothesis: Hypothesis,
    discrepancy: Discrepancy,
    thresholds: Thresholds = DEFAULT_THRESHOLDS,
    *,
    kind: Indices | None = None,
    larger_noise: LargerNoise | None = None,
    noise_known: bool = True,
    unexplained: str = "",
    varied: Varied = lambda effect: (),
) -> Judgement:
    """Return what may be said of a hypothesis of the whole problem.

    Args:
        hypothesis: the best one.
        discrepancy: what processes find given it.
        thresholds: of evidence and size.
        kind: labels (m,) of the kind of measurement of each equation, each kind with its own noise; by default all one.
        larger_noise: under which the hypothesis is the best one, where the residual under the stated noise scatters so.
        noise_known: whether the residual may be a larger noise: not where the noise is estimated from the residual, or
            where a larger noise was rejected.
        unexplained: why something is unknown whatever is found here; "" if nothing is.
        varied: how the size of each effect at work may vary; by default it does not.
    """

    @functools.cache
    def rest() -> tuple[Summand, ...]:
        """Return the processes whose sum explains the residual, computed only where needed."""
        return tuple(discrepancy.sum(thresholds.evidence_of_one_in(len(discrepancy)), _MOST_PARTS))

    causes, minor = _causes(hypothesis, thresholds, varied, rest)
    challenges = tuple(discrepancy.challenge(cause.indices) for cause in causes)
    structures, tried = tuple(discrepancy.structures()), len(discrepancy)
    found = Judgement(
        "unknown", causes, structures, challenges, (), tried, thresholds, minor, larger_noise=larger_noise
    )
    given = discrepancy
    if noise_known and not found.scatters and (found.clear_structures or found.beaten):
        one = np.zeros(len(hypothesis.problem.residual), dtype=np.intp)
        found, given = _as_noise(discrepancy, found, one if kind is None else kind)
    reasons = ([unexplained] if unexplained else []) + _reasons(hypothesis, found)
    if reasons:
        # Where something is unknown, each cause must have evidence that it is no part of that.
        least, limit = thresholds.evidence_of_one_in(1), found.structure_evidence
        doubtful = (cause.effect for cause, _ in found.challenged if given.lead(cause.indices, limit) < least)
        found = replace(found, doubtful=tuple(doubtful))
    causes = found.causes
    if not causes and (found.scatters or not reasons):
        small = workmanship_causes(given.hypothesis if found.scatters else hypothesis, thresholds)
        causes = tuple(cause for cause in small if cause.effect in hypothesis.problem.known)
        reasons += [
            f"workmanship of the kind {c.effect} is present, but excluded from being named"
            for c in small
            if c not in causes
        ]
    verdict = _verdict(causes, reasons)
    if verdict == "unknown" and not found.scatters:
        size = min(_unknown_size(discrepancy, found, rest), hypothesis.problem.given_size)  # others cancel any excess
        found = replace(found, remainder=rest() if found.clear_structures else (), unknown_size=size)
    return replace(found, verdict=verdict, causes=causes, reasons=tuple(reasons))


def _causes(
    hypothesis: Hypothesis, thresholds: Thresholds, varied: Varied, rest: Callable[[], Sequence[Summand]]
) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Return the causes among the effects of a hypothesis, and the effects that are none.

    ``rest`` gives the processes whose sum explains the residual.
    """
    effects = [e for e in hypothesis.effects if any(hypothesis.items[k].cause for k in hypothesis.of_effect(e))]
    independent = _independent(hypothesis, effects, varied, thresholds)
    large = [_cause(hypothesis, effect, thresholds) for effect in independent]
    adds = [_added(hypothesis, cause.indices) for cause in large]
    faint = min(adds, default=0.0) < thresholds.minor_share * max(adds, default=0.0)
    remainder = rms(np.sum([one.part for one in rest()], axis=0)) if faint else 0.0
    causes = tuple(_above(large, adds, remainder, thresholds))
    at_work = {cause.effect for cause in causes}
    return causes, tuple(effect for effect in effects if effect not in at_work)


def _verdict(causes: Sequence[Cause], reasons: Sequence[str]) -> Verdict:
    if reasons:
        return "unknown"
    if not causes:
        return "no_gap"
    return "group" if any(cause.alternatives for cause in causes) else "named"


def _unknown_size(discrepancy: Discrepancy, found: Judgement, rest: Callable[[], Sequence[Summand]]) -> float:
    """Return the size of what is unknown, in noise standard deviations: of processes that explain it together.

    Doubtful causes absorb a part of it, so the processes are fitted without them.
    """
    doubtful = [k for cause in found.causes if cause.effect in found.doubtful for k in cause.indices]
    together = discrepancy.without(doubtful).sum(found.structure_evidence, _MOST_PARTS) if doubtful else rest()
    return rms(np.sum([one.part for one in together], axis=0))


def _as_noise(discrepancy: Discrepancy, found: Judgement, kind: Indices) -> tuple[Judgement, Discrepancy]:
    """Return the judgement under a larger noise, and its discrepancy, if no process is clear under that noise.

    Causes without enough evidence under that noise are dropped. Of several ways in which the noise may be larger, the
    most evident one that does this is taken. Without any, both are returned unchanged.
    """
    for larger in discrepancy.larger_noise(kind):
        if larger.evidence <= found.structure_evidence:
            break
        times = np.where((kind == larger.kind) | (larger.kind is None), larger.factor, 1.0)
        if (under := _nothing_clear(discrepancy, times, found)) is None:
            continue
        least = found.thresholds.evidence_of_one_in(1)
        causes = tuple(cause for cause in found.causes if under.hypothesis.worth(cause.indices) > least)
        minor = (*found.minor, *(cause.effect for cause in found.causes if cause not in causes))
        challenges, structures = tuple(under.challenge(cause.indices) for cause in causes), tuple(under.structures())
        judged = replace(found, causes=causes, structures=structures, challenges=challenges, minor=minor)
        return replace(judged, larger_noise=larger), under
    return found, discrepancy


def _nothing_clear(discrepancy: Discrepancy, times: FloatArray, found: Judgement) -> Discrepancy | None:
    """Return the discrepancy with each equation's noise multiplied by a factor, (m,); None if a process is clear."""

    def under(given: Discrepancy) -> Discrepancy | None:
        over = given.over(times)
        return None if any(one.evidence > found.structure_evidence for one in over.structures()) else over

    # The clearest process mostly stays clear, so that no other need be tried.
    first = (discrepancy.only(one.process.name) for one in found.structures[:1])
    return None if any(under(one) is None for one in first) else under(discrepancy)


def without_minor(hypothesis: Hypothesis, judged: Judgement, effects: Collection[str]) -> tuple[Hypothesis, Judgement]:
    """Return a hypothesis without some minor effects, settled, and the judgement adapted to it."""
    dropped = {k for effect in effects for k in hypothesis.of_effect(effect)}
    places = {k: new for new, k in enumerate(k for k in range(len(hypothesis.items)) if k not in dropped)}
    causes = [replace(cause, indices=tuple(places[k] for k in cause.indices)) for cause in judged.causes]
    return hypothesis.without_items(dropped), replace(judged, causes=tuple(causes))


def _above(causes: Sequence[Cause], adds: Sequence[float], remainder: float, thresholds: Thresholds) -> list[Cause]:
    """Return the causes without small ones that add less than what processes explain, in noise standard deviations.

    On a real machine no cause has exactly the library's form. Many effects explain a little of the difference, with
    many rows beyond doubt, but none is its cause.
    """
    least = min(remainder, thresholds.minor_share * max(adds, default=0.0))
    return [cause for cause, added in zip(causes, adds, strict=True) if added >= least]


def _independent(hypothesis: Hypothesis, effects: Sequence[str], varied: Varied, thresholds: Thresholds) -> list[str]:
    """Return the effects that do more than correct the form of a larger one.

    A larger effect whose size varies with some condition explains such a correction as well. A small effect must do
    clearly more. That all conditions of all larger ones are tried favours these: no more evidence is required.
    """
    items = {effect: hypothesis.of_effect(effect) for effect in effects}
    squared = {effect: hypothesis.squared_size(*indices) for effect, indices in items.items()}
    varying = functools.cache(lambda effect: Discrepancy.of(hypothesis, varied(effect)))
    kept: list[str] = []
    for effect in sorted(effects, key=lambda effect: -squared[effect]):
        lead = min((-varying(larger).challenge(items[effect]).margin for larger in kept), default=np.inf)
        least = thresholds.evidence_of_one_in(1)
        if squared[effect] <= thresholds.minor_share**2 * max(squared.values()):
            lead, least = min(lead, _evidence(hypothesis, items[effect])), thresholds.minor_evidence
        if lead > least:
            kept.append(effect)
    return [effect for effect in effects if effect in kept]


def _added(hypothesis: Hypothesis, indices: Sequence[int]) -> float:
    """Return by how much the absence of items would raise the residual, all else held, in noise standard deviations.

    The square root of twice their log evidence per equation.
    """
    return float(np.sqrt(2.0 * max(hypothesis.worth(indices), 0.0) / len(hypothesis.problem.residual)))


def _reasons(hypothesis: Hypothesis, found: Judgement) -> list[str]:
    reasons = ["the residuals scatter from row to row, like a larger noise"] if found.scatters else []
    reasons += [
        f"the residuals depend on something that no effect explains: {clear.process.words} "
        f"({clear.size:.2f} times the noise, log evidence {clear.evidence:.0f})"
        for clear in found.clear_structures[:1]
    ]
    reasons += [
        f"'{better.process.words}' explains the data better than {effect}, by {better.margin:.0f} nats"
        for effect, better in found.beaten.items()
    ]
    loose = hypothesis.unnamed
    if not found.causes and loose and _worth_saying(hypothesis, loose, found.thresholds):
        reasons.append("the gap looks like soft joints that yield under the load, and nothing else is found")
    return reasons


def _worth_saying(hypothesis: Hypothesis, loose: Sequence[int], thresholds: Thresholds) -> bool:
    """Return whether items that are no causes exceed the noise, and are no minor part compared with workmanship.

    What is smaller than the noise need not be found.
    """
    size = len(hypothesis.problem.residual)
    if hypothesis.squared_size(*loose) < size:
        return False
    workmanship = max(hypothesis.log_evidence - hypothesis.with_levels_of(()).log_evidence, 0.0)
    return _added(hypothesis, loose) >= thresholds.minor_share * float(np.sqrt(2.0 * workmanship / size))


def _cause(hypothesis: Hypothesis, effect: str, thresholds: Thresholds) -> Cause:
    """Return an effect at work as a cause with its alternatives."""
    indices = hypothesis.of_effect(effect)
    main = max(indices, key=hypothesis.squared_size)
    evidence = _evidence(hypothesis, indices)
    margins = rivals(hypothesis, indices, thresholds)
    probability = _probability(hypothesis, evidence, thresholds) * float(softmax([0.0, *margins.values()])[0])
    size = float(np.sqrt(hypothesis.squared_size(*indices) / len(hypothesis.problem.residual)))
    # Errors of joints have all forms that workmanship has: each position and axis is a parameter of its own.
    exact = effect in {kind.effect for kind in hypothesis.problem.workmanship}
    form, others = hypothesis.items[main].form, alternatives(hypothesis, indices, margins, thresholds)
    return Cause(effect, form, indices, others, probability, evidence, size, exact, margins)


def _evidence(hypothesis: Hypothesis, indices: Sequence[int]) -> float:
    """Return the log evidence for items against the best hypothesis without them, in nats."""
    return hypothesis.log_evidence - hypothesis.without_items(indices).log_evidence


def _probability(hypothesis: Hypothesis, evidence: float, thresholds: Thresholds) -> float:
    """Return the probability that a part with a log evidence of E nats is neither noise nor of something unknown.

    It is (1 − RATE) / (1 + n exp(−E)) with n effects in the library. The data of one campaign cannot show whether what
    looks like an effect is one outside the library: the accepted rate of false names is the probability of that.
    """
    odds = evidence + log_prior_odds(len(hypothesis.problem.known))
    return (1.0 - thresholds.false_names) * float(expit(odds))


def workmanship_causes(hypothesis: Hypothesis, thresholds: Thresholds) -> list[Cause]:
    """Return kinds of workmanship as causes, where nothing else is found and the data require them.

    Mostly one kind explains as well as all; then it is named alone, with the others that do so as alternatives.
    """
    kinds = [k for k, level in enumerate(hypothesis.levels) if level]
    without = hypothesis.with_levels_of(()).log_evidence
    least = thresholds.evidence_of_one_in(len(kinds))
    if hypothesis.log_evidence - without < least:
        return []
    alone = {k: hypothesis.with_levels_of((k,)) for k in kinds}
    best = max(kinds, key=lambda k: alone[k].log_evidence)
    if alone[best].log_evidence < hypothesis.log_evidence - least:
        # Several kinds are needed: the one that contributes most is named, the others are usual workmanship.
        kind = max(kinds, key=lambda k: float(np.square(hypothesis.workmanship_part(k)).sum()))
        rest = hypothesis.with_levels_of([j for j in kinds if j != kind]).log_evidence
        return [_small(hypothesis, kind, rest, instead_of_workmanship(hypothesis, kind, thresholds), thresholds)]
    likely = alone[best].log_evidence - thresholds.evidence_of_one_in(1)
    names = {k: hypothesis.problem.workmanship[k].effect for k in kinds if k != best}
    close = {name: alone[k].log_evidence for k, name in names.items() if alone[k].log_evidence > likely}
    return [
        _small(alone[best], best, without, close | instead_of_workmanship(hypothesis, best, thresholds), thresholds)
    ]


def _small(
    hypothesis: Hypothesis, kind: int, without: float, others: dict[str, float], thresholds: Thresholds
) -> Cause:
    """Return a kind of workmanship as a cause; ``others`` are the log evidences of what explains as well."""
    evidence = hypothesis.log_evidence - without
    size = rms(hypothesis.workmanship_part(kind))
    share = softmax([hypothesis.log_evidence, *others.values()])[0]
    probability = _probability(hypothesis, evidence, thresholds) * float(share)
    effect = hypothesis.problem.workmanship[kind].effect
    return Cause(effect, WORKMANSHIP_FORM, (), tuple(sorted(others)), probability, evidence, size)
