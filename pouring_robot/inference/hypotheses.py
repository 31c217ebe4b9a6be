"""A hypothesis: which explanations are at work, at which scales, and how much workmanship there is."""

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
from pouring_robot.inference.problem import Explanation, Problem, Value, Workmanship, memoised
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

_SWEEPS = 3
_ALONE = 2e-3
"""Lower limit of one minus the leverage: below it, 0.3 of the noise, from an inexact form, would look like 6.5."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Explanations with their scales, and a level of every kind of workmanship."""

    problem: Problem  # the data to be explained
    items: tuple[Explanation, ...]  # the explanations, in the order they were added
    scales: tuple[Scale, ...]  # one for each item
    levels: tuple[int, ...]  # index into :data:`~.priors.WORKMANSHIP_LEVELS` for each kind of workmanship
    barred: frozenset[tuple[str, str]] = frozenset()  # forms that must not be added

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
        """What could be added; of forms that are values of one constant, only one at a time."""
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
        """Return the indices of the items that are forms of an effect."""
        return tuple(k for k, item in enumerate(self.items) if item.effect == effect)

    @property
    def _coarsest(self) -> tuple[int, ...]:
        """The largest level of each kind of workmanship, according to its known upper limit."""
        kinds = self.problem.workmanship
        return memoised(self.problem.worked_out, "coarsest", lambda: tuple(coarsest_level(kind.most) for kind in kinds))

    @property
    def unnamed(self) -> list[int]:
        """Indices of the items that are never named, such as the deflection of compliant joints under load."""
        return [k for k, item in enumerate(self.items) if not item.cause]

    @property
    def coarsely_made(self) -> bool:
        """Whether workmanship of some kind exceeds the most probable level."""
        return any(level > LIKELY_LEVEL for level in self.levels)

    def workmanship(self) -> list[tuple[Indices, FloatArray]]:
        """Return column indices and weights of workmanship."""
        kinds = zip(self.problem.workmanship, self.levels, strict=True)
        found = [(self.problem.places(kind), level) for kind, level in kinds if level]
        return [(places, np.full(len(places), WORKMANSHIP_LEVELS[level])) for places, level in found]

    @property
    def _item_groups(self) -> list[tuple[Indices, FloatArray]]:
        scaled = zip(self.items, self.scales, strict=True)
        return [(self.problem.places(item), scale.weights(item.main)) for item, scale in scaled]

    @functools.cached_property
    def _groups(self) -> list[tuple[Indices, FloatArray]]:
        """Column indices and weights of everything fitted: workmanship, then items."""
        return [*self.workmanship(), *self._item_groups]

    def weights(self) -> list[FloatArray]:
        """Return the prior standard deviations of all fitted coefficients, over the usual ones, by group."""
        return [weights for _, weights in self._groups]

    @property
    def fitted(self) -> list[Workmanship | Explanation]:
        """Everything fitted, by group: kinds of workmanship, then items."""
        kinds = zip(self.problem.workmanship, self.levels, strict=True)
        return [*(kind for kind, level in kinds if level), *self.items]

    @property
    def columns(self) -> FloatArray:
        """Columns of everything fitted, in the order of :attr:`everything`, (m, k)."""
        return np.hstack([np.zeros((len(self.problem.residual), 0)), *(own.columns[:] for own in self.fitted)])

    def seen(self, some: BoolArray | None = None) -> Gram:
        """Return inner products of free columns, those of everything fitted, and residual, over some equations (m,).

        Fitted columns are scaled by their prior standard deviations. By default over all equations, from memory.
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
        """Return the same for another problem with the same explanations."""
        known = {item.key: item for item in problem.explanations}
        return replace(self, problem=problem, items=tuple(known[item.key] for item in self.items))

    def under(self, factor: float) -> Hypothesis:
        """Return the same with all noise multiplied by a factor: valid for evidence, not for what it predicts."""
        return replace(self, problem=self.problem.under(factor))

    def over(self, times: FloatArray) -> Hypothesis:
        """Return the same with the noise of each equation multiplied by its own factor, (m,)."""
        return self.on(self.problem.over(times))

    @functools.cached_property
    def everything(self) -> ConditionalGram:
        """Inner products conditional on everything fitted."""
        return ConditionalGram.groups(self.problem.gram, self._groups)

    @property
    def _given_workmanship(self) -> ConditionalGram:
        """Inner products conditional on workmanship: factored once for all hypotheses with the same levels."""
        known, entry = self.problem.worked_out, ("workmanship", self.levels)
        return memoised(known, entry, lambda: ConditionalGram.groups(self.problem.gram, self.workmanship()))

    def _inner(self, one: Explanation, other: Explanation) -> FloatArray:
        """Return the inner products of the columns of two explanations, (k, l), conditional on workmanship.

        Remembered by pair, as both may be tried together with many others.
        """
        known, places = self.problem.worked_out, self.problem.places
        pair = self.levels, one.key, other.key
        return memoised(known, pair, lambda: self._given_workmanship.inner(places(one), places(other)))

    @functools.cached_property
    def _given_items(self) -> ConditionalGram:
        """The same as :attr:`everything`, faster."""
        return ConditionalGram.groups(self._given_workmanship, self._item_groups)

    @functools.cached_property
    def log_evidence(self) -> float:
        """Log evidence, up to a constant of the problem, in nats; an effect's forms are equally probable."""
        factors = [self.item_bayes_factor(k) for k in range(len(self.items))]
        priors = [self.problem.log_priors[item.effect] for item in self.items]
        return joint_evidence(self._log_posterior, factors, priors)

    @property
    def _log_posterior(self) -> float:
        prior = log_prior_of_levels(self.levels, self._coarsest)
        return self.memoised("likelihood", lambda: self._given_items.log_likelihood) + prior

    def item_bayes_factor(self, index: int) -> BayesFactor:
        """Return the Bayes factor of an item given the others."""
        return self.without((index,)).candidate_bayes_factor(self.items[index])

    def candidate_bayes_factor(self, item: Explanation) -> BayesFactor:
        """Return the Bayes factor that one more explanation would have, given its form."""
        return self.memoised(item.key, lambda: bayes_factor(*self._candidate(item)))

    def ranked(self, items: Iterable[Explanation]) -> Iterator[tuple[BayesFactor, Explanation]]:
        """Yield the Bayes factor that each of some explanations would have if it were added, best first.

        Only as many are evaluated as are needed: an upper bound shows that the others cannot be better.
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
        return self.memoised(("most", item.key), lambda: evidence_bound(*self._candidate(item)))

    def _candidate(self, item: Explanation) -> tuple[FloatArray, FloatArray, BoolArray, float]:
        """Return the arguments of :func:`bayes_factor` for one more explanation."""
        shared = [np.zeros((0, len(item.main))), *(self._inner(other, item) for other in self.items)]
        projected = self._given_workmanship.projected[self.problem.places(item)]
        conditioned = self._given_items.conditioned(np.vstack(shared), self._inner(item, item), projected)
        return *conditioned, item.main, self.problem.shaping_units[item.key]

    @functools.cached_property
    def _known(self) -> dict[Hashable, Any]:
        """Cached results of this hypothesis, or of one with the same items in another order."""
        fitted = frozenset((item.key, scale) for item, scale in zip(self.items, self.scales, strict=True))
        known: dict[Hashable, Any] = self.problem.worked_out.setdefault(("fitted", fitted, self.levels), {})
        return known

    def memoised(self, what: Hashable, work: Callable[[], Value]) -> Value:
        """Return a value that is computed once for this hypothesis and those that share its :attr:`_known`."""
        return memoised(self._known, what, work)

    def worth(self, indices: Collection[int]) -> float:
        """Return the log evidence for some items together, with everything else held, in nats."""
        return self.log_evidence - self.without(indices).log_evidence

    def contenders(self, effects: Collection[str]) -> list[tuple[BayesFactor, Explanation]]:
        """Return the Bayes factor that every form of some effects would have if it were added, best first."""
        forms = [item for item in self.problem.explanations if item.effect in effects]
        return sorted(((self.candidate_bayes_factor(item), item) for item in forms), key=lambda w: -w[0].evidence)

    def best_forms(self, effects: Collection[str]) -> dict[str, tuple[BayesFactor, Explanation]]:
        """Return for each effect the form with the largest Bayes factor if it were added, best effect first."""
        found: dict[str, tuple[BayesFactor, Explanation]] = {}
        for worth, item in self.contenders(effects):
            found.setdefault(item.effect, (worth, item))
        return found

    def beside(self, item: Explanation, scale: Scale) -> Hypothesis:
        """Return the hypothesis with one more explanation, with all else held."""
        return replace(self, items=(*self.items, item), scales=(*self.scales, scale))

    def without(self, indices: Collection[int]) -> Hypothesis:
        """Return the hypothesis without some explanations, with all else held."""
        keep = [k for k in range(len(self.items)) if k not in indices]
        items, scales = tuple(self.items[k] for k in keep), tuple(self.scales[k] for k in keep)
        return replace(self, items=items, scales=scales)

    def with_item(self, item: Explanation, scale: Scale | None = None) -> Hypothesis:
        """Return the hypothesis with one more explanation, settled; from its most probable scale if none is given."""
        return self.beside(item, scale or self.candidate_bayes_factor(item).scale).settled()

    def without_items(self, indices: Collection[int]) -> Hypothesis:
        """Return the hypothesis without some explanations, settled."""
        return self.without(indices).settled()

    def with_replaced(self, index: int, item: Explanation, scale: Scale) -> Hypothesis:
        """Return the hypothesis with one explanation replaced by another, its scales settled, not its levels."""
        items = (*self.items[:index], item, *self.items[index + 1 :])
        scales = (*self.scales[:index], scale, *self.scales[index + 1 :])
        return replace(self, items=items, scales=scales)._with_settled_scales()

    def with_levels_of(self, kinds: Collection[int]) -> Hypothesis:
        """Return the hypothesis with only some kinds of workmanship, at their most probable level, all else held."""
        best = replace(self, levels=(0,) * len(self.levels))
        for kind in kinds:
            choices = [
                replace(best, levels=(*best.levels[:kind], level, *best.levels[kind + 1 :]))
                for level in range(self._coarsest[kind] + 1)
            ]
            best = max(choices, key=lambda h: h.log_evidence)
        return best

    def settled(self) -> Hypothesis:
        """Return the same explanations at their most probable scales and workmanship levels, optimised one by one."""
        current = self._with_settled_scales()
        best = current._with_settled_levels()
        return best if best.levels == current.levels else best._with_settled_scales()

    def _with_settled_levels(self) -> Hypothesis:
        """Move levels of workmanship step by step, with scales held, as long as the posterior increases."""
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
        """Return mean and covariance of all fitted coefficients, in prior standard deviations."""
        return self.everything.coefficients()

    @property
    def spans(self) -> list[slice]:
        """Slices of each group's coefficients among those of everything fitted."""
        ends = itertools.accumulate((len(own) for own in self.weights()), initial=0)
        return [slice(*pair) for pair in itertools.pairwise(ends)]

    @functools.cached_property
    def values(self) -> list[FloatArray]:
        """All fitted coefficients, over the usual ones, by group."""
        means = self.coefficients()[0]
        return [own * means[span] for own, span in zip(self.weights(), self.spans, strict=True)]

    @functools.cached_property
    def _parts(self) -> list[FloatArray]:
        """Each group's part of the prediction, whitened, (m,) each."""
        return [own.columns[:] @ values for own, values in zip(self.fitted, self.values, strict=True)]

    @property
    def remainder(self) -> FloatArray:
        """Residual after the fit, (m,)."""
        return np.asarray(self.problem.residual - sum(self._parts, np.zeros(len(self.problem.residual))))

    @functools.cached_property
    def freedom(self) -> FloatArray:
        """Expected square of each equation's residual from noise alone, (m,): one minus its leverage."""
        leverage, spread = np.square(self.problem.nuisance.axes).sum(axis=1), self.coefficients()[1]
        for some in chunks(len(leverage)):
            own = [one.columns[some] * weights for one, weights in zip(self.fitted, self.weights(), strict=True)]
            columns = np.hstack([np.zeros((len(leverage[some]), 0)), *own])
            leverage[some] += (columns @ spread * columns).sum(axis=1)
        return np.asarray(1.0 - leverage)

    @property
    def studentised_residual(self) -> FloatArray:
        """Deletion residual of each equation over its standard deviation, see :func:`studentised_residual`, (m,)."""
        return studentised_residual(self.remainder, self.freedom)

    @property
    def leave_one_out_residual(self) -> FloatArray:
        """Error of each equation's prediction from the others, in units of the noise, (m,); by the same leverage."""
        return np.asarray(self.remainder / self.freedom.clip(min=_ALONE))

    def part(self, index: int) -> FloatArray:
        """Return an item's part of the prediction, with free unknowns projected out, whitened, shape (m,)."""
        return self._parts[len(self._parts) - len(self.items) + index]

    def workmanship_part(self, index: int) -> FloatArray:
        """Return the part of the prediction of a fitted kind of workmanship, as :meth:`part`, shape (m,)."""
        return self._parts[sum(level > 0 for level in self.levels[:index])]

    def _together(self, indices: Iterable[int]) -> tuple[Indices, FloatArray]:
        """Return column indices and values of the coefficients of some items."""
        first, indices = len(self.values) - len(self.items), list(indices)
        places = [self.problem.places(self.items[k]) for k in indices]
        return np.concatenate(places), np.concatenate([self.values[first + k] for k in indices])

    @property
    def workmanship_squared_size(self) -> float:
        """Sum of squares of what all kinds of workmanship together add to the prediction, in noise variances."""
        parts = self._parts[: len(self._parts) - len(self.items)]
        together = sum(parts, np.zeros(len(self.problem.residual)))
        return float(together @ together)

    def squared_size(self, *indices: int) -> float:
        """Return the sum of squares of the part of an item, or of several together, in noise variances."""
        places, values = self._together(indices)
        return float(values @ self.problem.gram.columns[np.ix_(places, places)] @ values)

    def explained_by(self, item: Explanation, indices: Iterable[int], limits: FloatArray | None = None) -> float:
        """Return how much of some items' :meth:`squared_size` the main parameters of an explanation could explain.

        At the widest scale: parts that the free unknowns nearly absorb would need sizes that no machine has. ``limits``
        (k, 2), if given, are the least and largest of their coefficients.
        """
        places, values = self._together(indices)
        main, columns = self.problem.places(item)[item.main], self.problem.gram.columns
        inner, projected = columns[np.ix_(main, main)], columns[np.ix_(main, places)] @ values
        return 2.0 * (
            evidence_bound(inner, projected) if limits is None else evidence_bound_within(inner, projected, limits)
        )

    def evidence_of_fewest(self, indices: Iterable[int], left: float, item: Explanation | None = None) -> float:
        """Return the log evidence of the fewest parameters that explain the part of some items but for ``left``.

        In nats; among the main ones of an explanation, or their own. Each counts as if it were its whole effect.
        """
        places, values = self._together(indices)
        own, columns = places if item is None else self.problem.places(item)[item.main], self.problem.gram.columns
        projected, explained = columns[np.ix_(own, places)] @ values, self.squared_size(*indices) - left
        return evidence_of_fewest(columns[np.ix_(own, own)], projected, explained)

    def main_share(self, index: int, *, bounded: bool = True) -> float:
        """Return how much of an item's part its main parameters alone could explain, as a share of its sum of squares.

        If ``bounded``, within physical limits: rods that would have to shrink when they are warm explain nothing.
        """
        item, total = self.items[index], self.squared_size(index)
        limits = item.bounds[item.main] if bounded and item.bounds is not None else None
        if not total > 0.0 or (item.main.all() and limits is None):
            return 1.0
        return self.explained_by(item, (index,), limits) / total


def studentised_residual(left: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return each equation's residual from a fit without it, over its standard deviation, (m,).

    This is the residual, over its noise, over the root of one minus the equation's leverage, both (m,) (Cook &
    Weisberg, Residuals and influence in regression, 1982, ch. 2): it also shows equations that pull the fit to them.
    """
    return np.asarray(left / np.sqrt(freedom.clip(min=_ALONE)))


@functools.cache
def _neighbours(levels: tuple[int, ...], coarsest: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return the levels a step away (all together or one alone), zero and the most probable, none above the coarsest.

    A machine is made with one care: its kinds of errors are at most a step apart, a factor of two.
    """
    if not levels:
        return []
    most = np.array(coarsest)
    alike = [np.zeros(len(levels), dtype=int), np.minimum(LIKELY_LEVEL, most)]
    moves = np.unique(np.vstack([np.ones((1, len(levels)), dtype=int), np.eye(len(levels), dtype=int)]), axis=0)
    found = [*alike, *(np.array(levels) + sign * move for move in moves for sign in (-1, 1))]
    return [tuple(new.tolist()) for new in found if new.min() >= 0 and (new <= most).all() and np.ptp(new) <= 1]
