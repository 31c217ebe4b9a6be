"""A hypothesis: which explanations are at work, at which scales, beside how much workmanship."""

from __future__ import annotations

import functools
import heapq
import itertools
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg

from pouring_robot.inference.evidence import (
    BayesFactor,
    ConditionalGram,
    Gram,
    Scale,
    bayes_factor,
    chunks,
    evidence_bound,
    evidence_bound_within,
    evidence_of_fewest,
    joint_evidence,
)
from pouring_robot.inference.priors import LIKELY_LEVEL, WORKMANSHIP_LEVELS, coarsest_level, log_prior_of_levels
from pouring_robot.inference.problem import Explanation, Problem, Value, Workmanship, once
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

_SWEEPS = 3
_ALONE = 2e-3
"""Least of one minus the leverage: of less, 0.3 of the noise (a form that is not quite right) would look like 6.5."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Explanations with their scales, and a level of every kind of workmanship."""

    problem: Problem  # what is to be explained
    items: tuple[Explanation, ...]  # the explanations, in the order they were added
    scales: tuple[Scale, ...]  # one an item
    levels: tuple[int, ...]  # index into :data:`~.priors.WORKMANSHIP_LEVELS` for each kind of workmanship
    barred: frozenset[tuple[str, str]] = frozenset()  # forms that are not to be added

    @classmethod
    def nothing(cls, problem: Problem) -> Hypothesis:
        """Return the hypothesis that the model lacks nothing but, perhaps, workmanship."""
        return cls(problem, (), (), (0,) * len(problem.workmanship)).settled()

    @property
    def keys(self) -> frozenset[tuple[str, str]]:
        """Effects and forms at work."""
        return frozenset(item.key for item in self.items)

    @property
    def choices(self) -> list[Explanation]:
        """What could be added; of forms that are values of one constant only one."""
        taken, settled = self.keys | self.barred, {(item.effect, item.one_of) for item in self.items if item.one_of}
        free = [item for item in self.problem.explanations if item.key not in taken]
        return [item for item in free if (item.effect, item.one_of) not in settled]

    @property
    def effects(self) -> tuple[str, ...]:
        """Ids of the effects at work, each once, in the order they were added."""
        return tuple(dict.fromkeys(item.effect for item in self.items))

    @property
    def rivals(self) -> frozenset[str]:
        """Ids of the effects that may be named and are not at work."""
        return self.problem.known - {*self.effects}

    def of_effect(self, effect: str) -> tuple[int, ...]:
        """Return which items are forms of an effect."""
        return tuple(k for k, item in enumerate(self.items) if item.effect == effect)

    @property
    def _coarsest(self) -> tuple[int, ...]:
        """The largest level of each kind of workmanship: the one that what is known of it does not exceed."""
        kinds = self.problem.workmanship
        return once(self.problem.worked_out, "coarsest", lambda: tuple(coarsest_level(kind.most) for kind in kinds))

    @property
    def unnamed(self) -> list[int]:
        """Indices of the items that are never named, as what the load makes of soft joints."""
        return [k for k, item in enumerate(self.items) if not item.cause]

    @property
    def coarsely_made(self) -> bool:
        """Whether workmanship of some kind is larger than the likely one."""
        return any(level > LIKELY_LEVEL for level in self.levels)

    def workmanship(self) -> list[tuple[Indices, FloatArray]]:
        """Return places and weights of workmanship."""
        kinds = zip(self.problem.workmanship, self.levels, strict=True)
        found = [(self.problem.places(kind), level) for kind, level in kinds if level]
        return [(places, np.full(len(places), WORKMANSHIP_LEVELS[level])) for places, level in found]

    @property
    def _item_groups(self) -> list[tuple[Indices, FloatArray]]:
        scaled = zip(self.items, self.scales, strict=True)
        return [(self.problem.places(item), scale.weights(item.main)) for item, scale in scaled]

    @functools.cached_property
    def _groups(self) -> list[tuple[Indices, FloatArray]]:
        """Places and weights of everything fitted: workmanship, then items."""
        return [*self.workmanship(), *self._item_groups]

    def weights(self) -> list[FloatArray]:
        """Return the standard deviations of the coefficients of everything fitted, over the usual ones, by group."""
        return [weights for _, weights in self._groups]

    @property
    def fitted(self) -> list[Workmanship | Explanation]:
        """Everything fitted, by group: kinds of workmanship, then items."""
        kinds = zip(self.problem.workmanship, self.levels, strict=True)
        return [*(kind for kind, level in kinds if level), *self.items]

    @property
    def columns(self) -> FloatArray:
        """Columns of everything fitted, as :attr:`everything` orders them, (m, k)."""
        return np.hstack([np.zeros((len(self.problem.residual), 0)), *(own.columns[:] for own in self.fitted)])

    def seen(self, some: BoolArray | None = None) -> Gram:
        """Return inner products of free columns, those of everything fitted, and residual, in some equations (m,).

        The latter are as large as they usually are. By default they are of all equations, at hand.
        """
        problem, places, free = self.problem, self.everything.places, self.problem.nuisance.dof
        if some is None:
            inner = scipy.linalg.block_diag(np.eye(free), problem.gram.inner(places, places))
            found = Gram(inner, np.append(np.zeros(free), problem.gram.projected[places]), problem.gram.squared)
        else:
            every = (problem.nuisance.axes, *(own.columns for own in self.fitted))
            found = Gram.of([columns[some] for columns in every], problem.residual[some])
        return found.scaled(np.append(np.ones(free), self.everything.weights))

    def on(self, problem: Problem) -> Hypothesis:
        """Return the same on another problem of the same explanations."""
        known = {item.key: item for item in problem.explanations}
        return replace(self, problem=problem, items=tuple(known[item.key] for item in self.items))

    def under(self, factor: float) -> Hypothesis:
        """Return the same where all noise is so many times as large: what it is worth, not what it does."""
        return replace(self, problem=self.problem.under(factor))

    def over(self, times: FloatArray) -> Hypothesis:
        """Return the same where the noise of each equation is so many times as large, (m,)."""
        return self.on(self.problem.over(times))

    @functools.cached_property
    def everything(self) -> ConditionalGram:
        """What is to be seen beside everything fitted."""
        return ConditionalGram.groups(self.problem.gram, self._groups)

    @property
    def _beside_workmanship(self) -> ConditionalGram:
        """What is to be seen beside workmanship: factored once for all hypotheses with as much of it."""
        known, asked = self.problem.worked_out, ("workmanship", self.levels)
        return once(known, asked, lambda: ConditionalGram.groups(self.problem.gram, self.workmanship()))

    def _inner(self, one: Explanation, other: Explanation) -> FloatArray:
        """Return the inner products of the columns of two explanations beside workmanship: asked for again and again.

        Of a pair (k, l), as both may be tried beside many others.
        """
        known, places = self.problem.worked_out, self.problem.places
        pair = self.levels, one.key, other.key
        return once(known, pair, lambda: self._beside_workmanship.inner(places(one), places(other)))

    @functools.cached_property
    def _beside_items(self) -> ConditionalGram:
        """:attr:`everything`, faster."""
        return ConditionalGram.groups(self._beside_workmanship, self._item_groups)

    @functools.cached_property
    def log_evidence(self) -> float:
        """Log evidence, up to a constant of the problem, in nats; forms are as likely as each other."""
        factors = [self.item_bayes_factor(k) for k in range(len(self.items))]
        priors = [self.problem.log_priors[item.effect] for item in self.items]
        return joint_evidence(self._log_posterior, factors, priors)

    @property
    def _log_posterior(self) -> float:
        prior = log_prior_of_levels(self.levels, self._coarsest)
        return self.once("likelihood", lambda: self._beside_items.log_likelihood) + prior

    def item_bayes_factor(self, index: int) -> BayesFactor:
        """Return what an item is worth beside the others."""
        return self.without((index,)).candidate_bayes_factor(self.items[index])

    def candidate_bayes_factor(self, item: Explanation) -> BayesFactor:
        """Return what one more explanation would be worth, given its form."""
        return self.once(item.key, lambda: bayes_factor(*self._seen_of(item)))

    def ranked(self, items: Iterable[Explanation]) -> Iterator[tuple[BayesFactor, Explanation]]:
        """Yield what each of some explanations would be worth, if it were added, best first.

        Only as many are weighed as are asked for: the others can be worth no more than what they explain at most.
        """
        queue: list[tuple[float, int, BayesFactor | None, Explanation]] = []
        for number, item in enumerate(items):
            known: BayesFactor | None = self._known.get(item.key)
            bound = known.evidence if known else self._most_evidence(item)
            queue.append((-bound, number, known, item))
        heapq.heapify(queue)
        while queue:
            _, number, found, item = heapq.heappop(queue)
            if found is None:
                found = self.candidate_bayes_factor(item)
                heapq.heappush(queue, (-found.evidence, number, found, item))
            else:
                yield found, item

    def _most_evidence(self, item: Explanation) -> float:
        return self.once(("most", item.key), lambda: evidence_bound(*self._seen_of(item)))

    def _seen_of(self, item: Explanation) -> tuple[FloatArray, FloatArray, BoolArray, float]:
        """Return what the worth of one more explanation follows from."""
        shared = [np.zeros((0, len(item.main))), *(self._inner(other, item) for other in self.items)]
        projected = self._beside_workmanship.projected[self.problem.places(item)]
        seen = self._beside_items.conditioned(np.vstack(shared), self._inner(item, item), projected)
        return *seen, item.main, self.problem.shaping_units[item.key]

    @functools.cached_property
    def _known(self) -> dict[Hashable, Any]:
        """What was worked out for this hypothesis, or for one of the same items in another order."""
        fitted = frozenset((item.key, scale) for item, scale in zip(self.items, self.scales, strict=True))
        known: dict[Hashable, Any] = self.problem.worked_out.setdefault(("fitted", fitted, self.levels), {})
        return known

    def once(self, what: Hashable, work: Callable[[], Value]) -> Value:
        """Return what is worked out once for this hypothesis and those that :attr:`_known` holds for equal."""
        return once(self._known, what, work)

    def worth(self, indices: Collection[int]) -> float:
        """Return the log evidence for some items together, everything else held, in nats."""
        return self.log_evidence - self.without(indices).log_evidence

    def contenders(self, effects: Collection[str]) -> list[tuple[BayesFactor, Explanation]]:
        """Return what every form of some effects would be worth, if it were added, best first."""
        forms = [item for item in self.problem.explanations if item.effect in effects]
        return sorted(((self.candidate_bayes_factor(item), item) for item in forms), key=lambda w: -w[0].evidence)

    def best_forms(self, effects: Collection[str]) -> dict[str, tuple[BayesFactor, Explanation]]:
        """Return of each effect the form that would be worth most, if it were added, best first."""
        found: dict[str, tuple[BayesFactor, Explanation]] = {}
        for worth, item in self.contenders(effects):
            found.setdefault(item.effect, (worth, item))
        return found

    def beside(self, item: Explanation, scale: Scale) -> Hypothesis:
        """Return the hypothesis with one more explanation, all else held."""
        return replace(self, items=(*self.items, item), scales=(*self.scales, scale))

    def without(self, indices: Collection[int]) -> Hypothesis:
        """Return the hypothesis with some explanations less, all else held."""
        keep = [k for k in range(len(self.items)) if k not in indices]
        items, scales = tuple(self.items[k] for k in keep), tuple(self.scales[k] for k in keep)
        return replace(self, items=items, scales=scales)

    def with_item(self, item: Explanation, scale: Scale | None = None) -> Hypothesis:
        """Return the hypothesis with one more explanation, settled; from its most probable scale if none is given."""
        return self.beside(item, scale or self.candidate_bayes_factor(item).scale).settled()

    def without_items(self, indices: Collection[int]) -> Hypothesis:
        """Return the hypothesis with some explanations less, settled."""
        return self.without(indices).settled()

    def with_replaced(self, index: int, item: Explanation, scale: Scale) -> Hypothesis:
        """Return the hypothesis with another explanation in the place of one, its scales settled, not its levels."""
        items = (*self.items[:index], item, *self.items[index + 1 :])
        scales = (*self.scales[:index], scale, *self.scales[index + 1 :])
        return replace(self, items=items, scales=scales)._with_settled_scales()

    def with_levels_of(self, kinds: Collection[int]) -> Hypothesis:
        """Return the hypothesis with no workmanship but some kinds at their most probable level, all else unchanged."""
        best = replace(self, levels=(0,) * len(self.levels))
        for kind in kinds:
            choices = [
                replace(best, levels=(*best.levels[:kind], level, *best.levels[kind + 1 :]))
                for level in range(self._coarsest[kind] + 1)
            ]
            best = max(choices, key=lambda h: h.log_evidence)
        return best

    def settled(self) -> Hypothesis:
        """Return the same explanations at their most probable scales and levels of workmanship, found one by one."""
        current = self._with_settled_scales()
        best = current._with_settled_levels()
        return best if best.levels == current.levels else best._with_settled_scales()

    def _with_settled_levels(self) -> Hypothesis:
        """Move levels of workmanship step by step, scales held, as long as that helps."""
        best, improved = self, True
        while improved:
            improved = False
            for levels in _neighbours(best.levels, self._coarsest):
                other = replace(best, levels=levels)
                if other._log_posterior > best._log_posterior + 1e-9:
                    best, improved = other, True
        return best

    def _with_settled_scales(self) -> Hypothesis:
        current = self
        for _ in range(_SWEEPS):
            before = current.scales
            for k in range(len(current.items)):
                found = current.item_bayes_factor(k).scale
                if found != current.scales[k]:
                    current = replace(current, scales=(*current.scales[:k], found, *current.scales[k + 1 :]))
            if len(current.items) < 2 or before == current.scales:
                break
        return current

    def coefficients(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance of the coefficients of everything fitted, in prior standard deviations."""
        return self.everything.coefficients()

    @property
    def spans(self) -> list[slice]:
        """Where the coefficients of each group stand among those of everything fitted."""
        ends = itertools.accumulate((len(own) for own in self.weights()), initial=0)
        return [slice(*pair) for pair in itertools.pairwise(ends)]

    @functools.cached_property
    def values(self) -> list[FloatArray]:
        """Coefficients of everything fitted, over the usual ones, by group."""
        means = self.coefficients()[0]
        return [own * means[span] for own, span in zip(self.weights(), self.spans, strict=True)]

    @functools.cached_property
    def _parts(self) -> list[FloatArray]:
        """What each group adds to the prediction, whitened, (m,) each."""
        return [own.columns[:] @ values for own, values in zip(self.fitted, self.values, strict=True)]

    @property
    def remainder(self) -> FloatArray:
        """What is left of the residual, (m,)."""
        return np.asarray(self.problem.residual - sum(self._parts, np.zeros(len(self.problem.residual))))

    @functools.cached_property
    def freedom(self) -> FloatArray:
        """What noise leaves on average of the square of each equation's residual, (m,): one minus its leverage."""
        leverage, spread = np.square(self.problem.nuisance.axes).sum(axis=1), self.coefficients()[1]
        for some in chunks(len(leverage)):
            own = [one.columns[some] * weights for one, weights in zip(self.fitted, self.weights(), strict=True)]
            columns = np.hstack([np.zeros((len(leverage[some]), 0)), *own])
            leverage[some] += (columns @ spread * columns).sum(axis=1)
        return np.asarray(1.0 - leverage)

    @property
    def studentised_residual(self) -> FloatArray:
        """What each equation's residual would be if it took no part, see :func:`studentised_residual`, (m,)."""
        return studentised_residual(self.remainder, self.freedom)

    @property
    def leave_one_out_residual(self) -> FloatArray:
        """By how much the others foretell each equation wrongly, in units of the noise, (m,); by the same leverage."""
        return np.asarray(self.remainder / self.freedom.clip(min=_ALONE))

    def part(self, index: int) -> FloatArray:
        """Return what an item adds to the prediction, free unknowns taken out, whitened, shape (m,)."""
        return self._parts[len(self._parts) - len(self.items) + index]

    def workmanship_part(self, index: int) -> FloatArray:
        """Return what a kind of workmanship that is fitted adds to the prediction, as :meth:`part`, shape (m,)."""
        return self._parts[sum(level > 0 for level in self.levels[:index])]

    def _together(self, indices: Iterable[int]) -> tuple[Indices, FloatArray]:
        """Return places and values of the coefficients of some items."""
        first, indices = len(self.values) - len(self.items), list(indices)
        places = [self.problem.places(self.items[k]) for k in indices]
        return np.concatenate(places), np.concatenate([self.values[first + k] for k in indices])

    @property
    def workmanship_squared_size(self) -> float:
        """Sum of squares of what all kinds of workmanship add to the prediction together, in noise variances."""
        parts = self._parts[: len(self._parts) - len(self.items)]
        together = sum(parts, np.zeros(len(self.problem.residual)))
        return float(together @ together)

    def squared_size(self, *indices: int) -> float:
        """Return the sum of squares of the part of an item, or of some together, in noise variances."""
        places, values = self._together(indices)
        return float(values @ self.problem.gram.columns[np.ix_(places, places)] @ values)

    def explained_by(self, item: Explanation, indices: Iterable[int], limits: FloatArray | None = None) -> float:
        """Return how much of :meth:`squared_size` of some items the main parameters of an explanation could make.

        At the widest scale: what the free unknowns all but take up would need sizes that no machine has. ``limits``
        (k, 2), if given, are the least and largest of their coefficients.
        """
        places, values = self._together(indices)
        main, columns = self.problem.places(item)[item.main], self.problem.gram.columns
        inner, projected = columns[np.ix_(main, main)], columns[np.ix_(main, places)] @ values
        return 2.0 * (
            evidence_bound(inner, projected) if limits is None else evidence_bound_within(inner, projected, limits)
        )

    def evidence_of_fewest(self, indices: Iterable[int], left: float, item: Explanation | None = None) -> float:
        """Return the log evidence, for the part of some items, of the fewest parameters that leave no more of it.

        In nats; of the main ones of an explanation, or of their own. Each counts as if nothing else were of its effect.
        """
        places, values = self._together(indices)
        own, columns = places if item is None else self.problem.places(item)[item.main], self.problem.gram.columns
        projected, explained = columns[np.ix_(own, places)] @ values, self.squared_size(*indices) - left
        return evidence_of_fewest(columns[np.ix_(own, own)], projected, explained)

    def main_share(self, index: int, *, bounded: bool = True) -> float:
        """Return how much of an item's part its main parameters alone could make, as a share of its sum of squares.

        If ``bounded`` within what nature allows: rods that would have to shrink when they are warm make nothing.
        """
        item, total = self.items[index], self.squared_size(index)
        limits = item.bounds[item.main] if bounded and item.bounds is not None else None
        if not total > 0.0 or (item.main.all() and limits is None):
            return 1.0
        return self.explained_by(item, (index,), limits) / total


def studentised_residual(left: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return what each equation's residual would be if it took no part, over its standard deviation, (m,).

    What is left, over its noise, over the root of one minus the equation's leverage, both (m,) (Cook & Weisberg,
    Residuals and influence in regression, 1982, ch. 2): who draws the answer to himself is seen all the same.
    """
    return np.asarray(left / np.sqrt(freedom.clip(min=_ALONE)))


@functools.cache
def _neighbours(levels: tuple[int, ...], coarsest: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return the levels a step away, all together or one alone, none, and the likely ones; none above the coarsest.

    A machine is made with one care: its kinds of errors are at most a step apart, a factor of two.
    """
    if not levels:
        return []
    most = np.array(coarsest)
    alike = [np.zeros(len(levels), dtype=int), np.minimum(LIKELY_LEVEL, most)]
    moves = np.unique(np.vstack([np.ones((1, len(levels)), dtype=int), np.eye(len(levels), dtype=int)]), axis=0)
    found = [*alike, *(np.array(levels) + sign * move for move in moves for sign in (-1, 1))]
    return [tuple(new.tolist()) for new in found if new.min() >= 0 and (new <= most).all() and np.ptp(new) <= 1]
