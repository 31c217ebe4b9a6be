"""Processes as the equations of one problem see them: beside a hypothesis, and at work together beside it.

All inner products are formed once: with free unknowns and the hypothesis for every process, with each other for two
that are at work together. Nothing here knows the robot. From step to step a process is

- :class:`~.processes.Process`: what moves by which condition, at several length scales;
- :class:`Seen`: one of these in a problem, free unknowns projected out;
- :class:`Left`: what a hypothesis leaves of that;
- :class:`Found`: at its best length scale, beside others at work (:class:`Together`);
- :class:`~.discrepancy.Summand`: with its share of what all of them do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Self

import numpy as np
import scipy.linalg

from pouring_robot.inference.evidence import Beside, Gram, bayes_factor, log_mean
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.processes import Channel, Part, Process, between
from pouring_robot.mechanism.arrays import FloatArray

_AT_HAND = 2**26
"""Room for channels that were held against everything, in bytes: processes that share them are next to each other."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A process at one length scale in one problem."""

    process: Process  # the process
    length: str  # the scale in words
    absorbed: FloatArray  # inner products of its columns with what free unknowns explain, (f, k)
    inner: FloatArray  # of its columns with each other beside those, (k, k)
    projected: FloatArray  # of its columns with the residual, (k,)
    shared: FloatArray  # of the columns of a hypothesis with its own, (q, k)
    factor: float = 1.0  # how many times as large the noise is as that over which its parts are

    @property
    def parts(self) -> tuple[Part, ...]:
        """What moves along which course."""
        return self.process.lengths[self.length]

    @property
    def spans(self) -> list[slice]:
        """Which of its columns are those of each part."""
        ends = itertools.accumulate((part.course.shape[1] for part in self.parts), initial=0)
        return [slice(*pair) for pair in itertools.pairwise(ends)]

    def pieces(self, values: FloatArray) -> Iterator[FloatArray]:
        """Yield what each part adds to the whitened prediction, (m,), at coefficients (k,)."""
        for part, own in zip(self.parts, self.spans, strict=True):
            yield part.channel.column * (part.channel.rows.T @ (part.course @ values[own]))

    @classmethod
    def of(cls, process: Process, length: str, against: Callable[[Channel], FloatArray], free: int) -> Seen:
        """Return it beside what free unknowns explain.

        A channel is held against values, (n, q): their axes, so many, then the residual and the columns of the
        hypothesis, free of those.
        """
        parts = process.lengths[length]
        values = np.vstack([part.course.T @ against(part.channel) for part in parts]).T
        absorbed = values[:free]
        inner = between(parts, parts) - absorbed.T @ absorbed
        return cls(process, length, absorbed, inner, values[free], values[free + 1 :])

    def under(self, factor: float) -> Seen:
        """Return the same where the noise is so many times as large."""
        inner, projected, shared = (own / factor**2 for own in (self.inner, self.projected, self.shared))
        return replace(
            self,
            absorbed=self.absorbed / factor,
            inner=inner,
            projected=projected,
            shared=shared,
            factor=self.factor * factor,
        )


@dataclass(frozen=True, eq=False)
class Left:
    """What a hypothesis leaves to a process at one length scale."""

    seen: Seen  # the process there
    taken: FloatArray  # what it takes up of its columns, in coordinates of its own (q, k)
    inner: FloatArray  # inner products of its columns with each other beside that, (k, k)
    projected: FloatArray  # of its columns with the residual, (k,)

    @classmethod
    def of(cls, seen: Seen, beside: Beside) -> Left:
        """Return it beside all columns of a hypothesis."""
        taken = beside.taken(seen.shared)
        return cls(seen, taken, seen.inner - taken.T @ taken, seen.projected - taken.T @ beside.pulled)


@dataclass(frozen=True, eq=False)
class Found:
    """A process at its best length scale beside something."""

    evidence: float  # averaged over its length scales, in nats
    left: Left  # it at the best of them
    amplitude: float  # the most probable one
    inner: FloatArray  # inner products of its columns beside that something, (k, k)
    projected: FloatArray  # of its columns with the residual, (k,)

    @property
    def process(self) -> Process:
        """The process itself."""
        return self.left.seen.process

    @property
    def name(self) -> str:
        """What it is known by."""
        return self.process.name

    @property
    def squared(self) -> float:
        """Squared length of what it explains, in noise variances."""
        scaled, pulled = self.amplitude**2 * self.inner, self.amplitude * self.projected
        scaled.flat[:: len(scaled) + 1] += 1.0
        mean = scipy.linalg.lapack.dposv(scaled, pulled, lower=1)[1]
        return max(float(mean @ (pulled - mean)), 0.0)


class SeenProcesses:
    """Processes in one problem, beside a hypothesis."""

    def __init__(self, hypothesis: Hypothesis, every: Iterable[Sequence[Seen]]) -> None:
        self.hypothesis = hypothesis
        self._every = {lengths[0].process.name: lengths for lengths in every}
        self._known: dict[tuple[Left, Left], FloatArray] = {}
        self._less: dict[tuple[int, ...], Self] = {}

    @classmethod
    def of(cls, hypothesis: Hypothesis, processes: Iterable[Process]) -> Self:
        """Return them at every length scale."""
        nuisance = hypothesis.problem.nuisance
        values = np.column_stack([nuisance.axes, hypothesis.problem.residual, hypothesis.columns])
        kept = max(1, _AT_HAND // values.nbytes)
        against = lru_cache(kept)(lambda channel: channel.against(values))
        every = (
            [Seen.of(process, length, against, nuisance.dof) for length in process.lengths] for process in processes
        )
        return cls(hypothesis, every)

    def __len__(self) -> int:
        return len(self._every)

    def without(self, indices: Sequence[int]) -> Self:
        """Return the same beside the hypothesis without some of its items, a cause's."""
        asked = tuple(indices)
        if asked not in self._less:
            fewer = self.hypothesis.without(indices)
            places = self.hypothesis.everything.places.tolist()
            own = np.array([places.index(k) for k in fewer.everything.places.tolist()], dtype=np.intp)
            every = ([replace(one, shared=one.shared[own]) for one in lengths] for lengths in self._every.values())
            self._less[asked] = type(self)(fewer, every)
        return self._less[asked]

    def over(self, times: FloatArray) -> Self:
        """Return the same where the noise of each equation is so many times as large, (m,)."""
        over = cache(lambda channel: channel.over(times))  # processes share channels
        return self.of(
            self.hypothesis.over(times), (own[0].process.with_channels(over) for own in self._every.values())
        )

    def under(self, factor: float) -> Self:
        """Return the same where all noise is so many times as large: what processes are worth, not what they do."""
        every = ([one.under(factor) for one in lengths] for lengths in self._every.values())
        return type(self)(self.hypothesis.under(factor), every)

    def only(self, name: str) -> Self:
        """Return one process alone, by name."""
        return type(self)(self.hypothesis, [self._every[name]])

    @cached_property
    def left(self) -> dict[str, list[Left]]:
        """What the hypothesis leaves to each process, by name, at each length scale."""
        everything = self.hypothesis.everything
        return {name: [Left.of(one, everything) for one in lengths] for name, lengths in self._every.items()}

    @cached_property
    def alone(self) -> list[Found]:
        """Each process beside the hypothesis alone."""
        return list(Together(self).all())

    def shared(self, one: Left, other: Left) -> FloatArray:
        """Return the inner products of two processes beside free unknowns and the hypothesis, (k, l)."""
        if (other, one) in self._known:
            return self._known[other, one].T
        if (one, other) not in self._known:
            first, second = one.seen, other.seen
            whole = between(first.parts, second.parts) / (first.factor * second.factor)
            self._known[one, other] = whole - first.absorbed.T @ second.absorbed - one.taken.T @ other.taken
        return self._known[one, other]


class Together:
    """Processes at work together, beside a hypothesis."""

    def __init__(self, seen: SeenProcesses, found: Sequence[Found] = ()) -> None:
        self.seen, self.found = seen, tuple(found)

    @property
    def names(self) -> tuple[str, ...]:
        """By which they are known."""
        return tuple(one.name for one in self.found)

    def others(self, one: Found) -> Together:
        """Return them without one."""
        return Together(self.seen, [other for other in self.found if other is not one])

    def worth(self, name: str) -> Found:
        """Return a process, at its best length scale, beside these."""
        lengths = self.seen.left[name]
        products = [self.products(one) for one in lengths]
        worths = [bayes_factor(*one) for one in products]
        evidences = np.array([worth.evidence for worth in worths])
        best, mean = int(np.argmax(evidences)), float(log_mean(evidences))
        return Found(mean, lengths[best], worths[best].scale.main, *products[best])

    def all(self, but: Iterable[str] = ()) -> Iterator[Found]:
        """Yield each process but some beside these."""
        without = {*but}
        for name in self.seen.left:
            if name not in without:
                yield self.worth(name)

    def products(self, one: Left) -> tuple[FloatArray, FloatArray]:
        """Return the inner products of a process's columns with each other, (k, k), and the residual, beside these."""
        shared = [np.zeros((0, len(one.projected))), *(self.seen.shared(other.left, one) for other in self.found)]
        return self.beside.outside(np.vstack(shared), one.inner, one.projected)

    def own(self, one: Found) -> slice:
        """Return which columns of all are those of one."""
        first = sum(len(other.projected) for other in self.found[: self.found.index(one)])
        return slice(first, first + len(one.projected))

    @cached_property
    def beside(self) -> Beside:
        """What is to be seen beside the hypothesis and these; their columns are its groups."""
        everything = self.seen.hypothesis.everything
        blocks = [
            [one.left.inner if other is one else self.seen.shared(one.left, other.left) for other in self.found]
            for one in self.found
        ]
        projected = np.concatenate([np.zeros(0), *(one.left.projected for one in self.found)])
        weights = np.concatenate([np.zeros(0), *(np.full(len(one.projected), one.amplitude) for one in self.found)])
        inner = np.block(blocks) if blocks else np.zeros((0, 0))
        gram = Gram(inner, projected, everything.squared, everything.log_determinant)
        return Beside(gram, np.arange(len(projected)), weights)

    def explained(self, means: FloatArray, columns: FloatArray) -> FloatArray:
        """Return what they and the hypothesis explain, (m,), at coefficients of theirs over standard deviations, (k,).

        ``columns`` are those of the hypothesis, (m, q).
        """
        everything, explained = self.seen.hypothesis.everything, np.zeros(len(columns))
        pulled = everything.pulled
        for one in self.found:
            values = one.amplitude * means[self.own(one)]
            explained += sum(one.left.seen.pieces(values), np.zeros(len(columns)))
            pulled = pulled - one.left.taken @ values
        return np.asarray(explained + columns @ (everything.weights * everything.back(pulled)))
