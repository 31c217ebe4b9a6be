"""A hypothesis: which explanations are at work, at which scale, beside how much of the usual small errors."""

from __future__ import annotations

import functools
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.inference.evidence import BayesFactor, Others, bayes_factor, posterior
from pouring_robot.inference.explanations import Explanation, Problem
from pouring_robot.inference.nuisance import Nuisance
from pouring_robot.mechanism.arrays import FloatArray

BACKGROUND_LEVELS = (0.0, 0.5, 1.0, 2.0)
"""How large usual errors may be against their usual size."""
_SWEEPS = 3
_WIDE = 150
_RANK = 1e-9


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Explanations with their scales, and a level of every background.

    Attributes:
        problem: what is to be explained.
        items: the explanations, in the order they were added.
        scales: one an item.
        levels: index into :data:`BACKGROUND_LEVELS` for each background.
    """

    problem: Problem
    items: tuple[Explanation, ...]
    scales: tuple[float, ...]
    levels: tuple[int, ...]

    @classmethod
    def nothing(cls, problem: Problem) -> Hypothesis:
        """Return the hypothesis that the model lacks nothing but, perhaps, the usual errors."""
        return cls(problem, (), (), (0,) * len(problem.backgrounds)).settled()

    @property
    def keys(self) -> frozenset[tuple[str, str]]:
        """Effects and forms at work."""
        return frozenset(item.key for item in self.items)

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

    def groups(self) -> list[FloatArray]:
        """Return the scaled columns of everything fitted."""
        levels = [BACKGROUND_LEVELS[k] for k in self.levels]
        usual = [level * b.columns for level, b in zip(levels, self.problem.backgrounds, strict=True) if level]
        return [*usual, *(s * item.columns for s, item in zip(self.scales, self.items, strict=True))]

    @functools.cached_property
    def _wide(self) -> int | None:
        """The item with so many columns that it is taken out of the problem first; None where none has.

        None, too, where an item is none of the problem's.
        """
        wide = next((k for k, item in enumerate(self.items) if item.columns.shape[1] > _WIDE), None)
        return wide if wide is not None and self.keys <= self.problem.keys else None

    @functools.cached_property
    def _rest(self) -> Hypothesis:
        """All but the wide item, on the problem beside it."""
        wide = self._wide or 0
        problem = self.problem.beside(self.items[wide], self.scales[wide])
        known = {item.key: item for item in problem.explanations}
        rest = self.without((wide,))
        return replace(rest, problem=problem, items=tuple(known[item.key] for item in rest.items))

    def _there(self, item: Explanation) -> Explanation:
        """Return another explanation on the problem beside the wide item."""
        return next(other for other in self._rest.problem.explanations if other.key == item.key)

    @functools.cached_property
    def everything(self) -> Others:
        """The covariance of everything fitted."""
        return Others(self.groups(), len(self.problem.residual))

    @functools.cached_property
    def _beside(self) -> dict[int, Others]:
        """What is fitted beside an item, as far as it was asked for."""
        return {}

    @functools.cached_property
    def log_evidence(self) -> float:
        """Log evidence, scales averaged, up to a constant of the problem, in nats."""
        return self._log_likelihood - sum(found.peak - found.evidence for found in self._bayes_factors)

    @functools.cached_property
    def _log_likelihood(self) -> float:
        if self._wide is not None:
            return self._rest._log_likelihood
        return -0.5 * (self.misfit() + self.everything.log_determinant)

    @functools.cached_property
    def _bayes_factors(self) -> tuple[BayesFactor, ...]:
        return tuple(self.item_bayes_factor(k) for k in range(len(self.items)))

    def item_bayes_factor(self, index: int, instead: Explanation | None = None) -> BayesFactor:
        """Return what an item is worth beside the others, or what another explanation would be in its place."""
        item = instead or self.items[index]
        others = tuple((i.key, s) for k, (i, s) in enumerate(zip(self.items, self.scales, strict=True)) if k != index)
        key = item.key, others, self.levels
        if key not in self.problem.found:
            self.problem.found[key] = self._item_bayes_factor(index, item)
        found: BayesFactor = self.problem.found[key]
        return found

    def _item_bayes_factor(self, index: int, item: Explanation) -> BayesFactor:
        if self._wide not in (None, index) and item.key in self.problem.keys:
            place = index - int(index > (self._wide or 0))
            return self._rest.item_bayes_factor(place, self._there(item))
        if index not in self._beside:
            self._beside[index] = self.without((index,)).everything
        return bayes_factor(item.columns, self.problem.residual, self._beside[index], item.largest)

    def worth(self, indices: Collection[int]) -> float:
        """Return the log evidence for some items together, everything else held, in nats."""
        return self.log_evidence - self.without(indices).log_evidence

    def candidate_bayes_factor(self, item: Explanation) -> BayesFactor:
        """Return what one more explanation would be worth."""
        if self._wide is not None and item.key in self._rest.problem.keys:
            return self._rest.candidate_bayes_factor(self._there(item))
        return bayes_factor(item.columns, self.problem.residual, self.everything, item.largest)

    def best_forms(self, effects: Collection[str]) -> dict[str, tuple[BayesFactor, Explanation]]:
        """Return of each effect the form that would be worth most, if it were added."""
        found: dict[str, tuple[BayesFactor, Explanation]] = {}
        for item in self.problem.explanations:
            if item.cause and item.effect in effects:
                worth = self.candidate_bayes_factor(item)
                if item.effect not in found or worth.evidence > found[item.effect][0].evidence:
                    found[item.effect] = worth, item
        return found

    def beside(self, item: Explanation, scale: float) -> Hypothesis:
        """Return the hypothesis with one more explanation, all else held."""
        return replace(self, items=(*self.items, item), scales=(*self.scales, scale))

    def without(self, indices: Collection[int]) -> Hypothesis:
        """Return the hypothesis with some explanations less, all else held."""
        keep = [k for k in range(len(self.items)) if k not in indices]
        items, scales = tuple(self.items[k] for k in keep), tuple(self.scales[k] for k in keep)
        return replace(self, items=items, scales=scales)

    def with_item(self, item: Explanation, scale: float) -> Hypothesis:
        """Return the hypothesis with one more explanation, settled."""
        return self.beside(item, scale).settled()

    def without_items(self, indices: Collection[int]) -> Hypothesis:
        """Return the hypothesis with some explanations less, settled."""
        return self.without(indices).settled()

    def with_replaced(self, index: int, item: Explanation, scale: float) -> Hypothesis:
        """Return the hypothesis with another explanation in the place of one, settled."""
        items = (*self.items[:index], item, *self.items[index + 1 :])
        return replace(self, items=items, scales=(*self.scales[:index], scale, *self.scales[index + 1 :])).settled()

    def with_levels_of(self, kinds: Collection[int]) -> Hypothesis:
        """Return the hypothesis with no backgrounds but some at their most probable level, all else unchanged."""
        best = replace(self, levels=(0,) * len(self.levels))
        for kind in kinds:
            choices = [
                replace(best, levels=(*best.levels[:kind], level, *best.levels[kind + 1 :]))
                for level in range(len(BACKGROUND_LEVELS))
            ]
            best = max(choices, key=lambda h: h.log_evidence)
        return best

    def settled(self) -> Hypothesis:
        """Return the same explanations at their most probable scales and background levels, found one by one."""
        current = self._with_settled_scales()
        best = current._with_settled_levels()
        return best if best.levels == current.levels else best._with_settled_scales()

    def _with_settled_levels(self) -> Hypothesis:
        """Move background levels step by step, scales held, as long as that helps."""
        best, improved = self, True
        while improved:
            improved = False
            for k in range(len(best.levels)):
                for level in (best.levels[k] - 1, best.levels[k] + 1):
                    if not 0 <= level < len(BACKGROUND_LEVELS):
                        continue
                    other = replace(best, levels=(*best.levels[:k], level, *best.levels[k + 1 :]))
                    if other._log_likelihood > best._log_likelihood + 1e-9:
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
        """Return mean and covariance of the coefficients of :meth:`groups`, in prior standard deviations."""
        return posterior(self._columns, self.problem.residual)

    @property
    def _columns(self) -> FloatArray:
        return np.hstack([np.zeros((len(self.problem.residual), 0)), *self.groups()])

    @functools.cached_property
    def _pull(self) -> FloatArray:
        return self.everything.solve(self.problem.residual)

    def part(self, index: int) -> FloatArray:
        """Return what an item adds to the prediction, free unknowns taken out, whitened, shape (m,)."""
        columns = self.scales[index] * self.items[index].columns
        return np.asarray(columns @ (columns.T @ self._pull))

    def background_part(self, index: int) -> FloatArray:
        """Return what a background adds to the prediction, free unknowns taken out, whitened, shape (m,)."""
        columns = BACKGROUND_LEVELS[self.levels[index]] * self.problem.backgrounds[index].columns
        return np.asarray(columns @ (columns.T @ self._pull))

    def size(self, index: int) -> float:
        """Return the sum of squares of an item's part, in noise variances."""
        part = self.part(index)
        return float(part @ part)

    def main_share(self, index: int) -> float:
        """Return how much of an item's part its main parameters alone could make, as a share of its sum of squares."""
        item, part = self.items[index], self.part(index)
        total = float(part @ part)
        rest = Nuisance.of(item.columns[:, item.main], _RANK).cleared(part)
        return 1.0 - float(rest @ rest) / total if total > 0.0 else 1.0

    def shape_excess(self, index: int) -> float:
        """Return the largest shaping coefficient over the largest main one, both in their usual sizes.

        Far above 1 the effect would be nearly absent and only what shapes it at work.
        """
        item = self.items[index]
        pull = np.abs(item.columns.T @ self._pull)
        shape, main = pull[~item.main].max(initial=0.0), pull[item.main].max(initial=0.0)
        return float(shape / main) if main > 0.0 else np.inf

    def effective_dof(self) -> float:
        """Return how many coefficients the data determine, each counted by how far."""
        columns = self._columns
        return float(self.everything.inner(columns, columns).trace())

    def misfit(self) -> float:
        """Return the squared length of the residual, measured by everything fitted; m where the hypothesis is true."""
        return float(self.everything.inner(self.problem.residual, self.problem.residual)) + self.problem.constant
