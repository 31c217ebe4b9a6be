"""Gaussian processes in the equations of one problem: each given a hypothesis, and several at once.

All inner products are formed once: of each process with the nuisance parameters and the hypothesis, and of two
processes with each other when both are in a sum. Nothing here knows the robot. A process passes through these steps:

- :class:`~.processes.Process`: what moves by which condition, at several length scales;
- :class:`ProjectedProcess`: one length scale in one problem, nuisance parameters projected out;
- :class:`ConditionedProcess`: the same, conditional on a hypothesis;
- :class:`FittedProcess`: at its best length scale, given the others of a :class:`ProcessSum`;
- :class:`~.discrepancy.Summand`: with its share of what the sum explains.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Self

import numpy as np
import scipy.linalg

from pouring_robot.inference.evidence import ConditionalGram, Gram, bayes_factor, log_mean_exp
from pouring_robot.inference.gaussian_processes.processes import Channel, Part, Process, between
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.mechanism.arrays import FloatArray

_AT_HAND = 2**26
"""Memory for inner products of channels, in bytes: processes that share a channel are next to each other."""


@dataclass(frozen=True, eq=False)
class ProjectedProcess:
    """A process at one length scale in one problem."""

    process: Process
    length: str  # the length scale in words
    absorbed: FloatArray  # inner products of its columns with the axes of the nuisance parameters, (f, k)
    inner: FloatArray  # of its columns with each other, nuisance parameters projected out, (k, k)
    projected: FloatArray  # of its columns with the residual, (k,)
    shared: FloatArray  # of the columns of a hypothesis with its own, (q, k)
    factor: float = 1.0  # noise over the noise that whitened its parts

    @property
    def parts(self) -> tuple[Part, ...]:
        """Its channels, each with the course along which it moves."""
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
    def of(cls, process: Process, length: str, against: Callable[[Channel], FloatArray], free: int) -> ProjectedProcess:
        """Return the process with nuisance parameters projected out.

        ``against`` gives the inner products of a channel, (n, q), with the ``free`` axes of the nuisance parameters,
        then with the residual and the columns of the hypothesis, both orthogonal to those axes.
        """
        parts = process.lengths[length]
        values = np.vstack([part.course.T @ against(part.channel) for part in parts]).T
        absorbed = values[:free]
        inner = between(parts, parts) - absorbed.T @ absorbed
        return cls(process, length, absorbed, inner, values[free], values[free + 1 :])

    def under(self, factor: float) -> ProjectedProcess:
        """Return the same for a noise that is ``factor`` times as large."""
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
class ConditionedProcess:
    """A process at one length scale, conditional on a hypothesis."""

    base: ProjectedProcess  # before conditioning
    coordinates: FloatArray  # the part of its columns that the hypothesis explains, in coordinates of that, (q, k)
    inner: FloatArray  # inner products of its columns, conditional on the hypothesis, (k, k)
    projected: FloatArray  # of these with the residual, (k,)

    @classmethod
    def of(cls, base: ProjectedProcess, everything: ConditionalGram) -> ConditionedProcess:
        """Return a process conditional on all columns of a hypothesis."""
        explained = everything.coordinates(base.shared)
        projected = base.projected - explained.T @ everything.residual_coordinates
        return cls(base, explained, base.inner - explained.T @ explained, projected)


@dataclass(frozen=True, eq=False)
class FittedProcess:
    """A process at its best length scale, conditional on a hypothesis and the other processes of a sum."""

    evidence: float  # averaged over its length scales, in nats
    conditioned: ConditionedProcess  # at the best of them, conditional on the hypothesis alone
    amplitude: float  # the most probable one
    inner: FloatArray  # inner products of its columns, conditional on all others, (k, k)
    projected: FloatArray  # of its columns with the residual, (k,)

    @property
    def process(self) -> Process:
        """What moves by which condition."""
        return self.conditioned.base.process

    @property
    def name(self) -> str:
        """Its name, unique among the processes of a campaign."""
        return self.process.name

    @property
    def squared(self) -> float:
        """Squared length of what it explains, in noise variances."""
        scaled, projected = self.amplitude**2 * self.inner, self.amplitude * self.projected
        scaled.flat[:: len(scaled) + 1] += 1.0
        mean = scipy.linalg.lapack.dposv(scaled, projected, lower=1)[1]
        return max(float(mean @ (projected - mean)), 0.0)


class ProjectedProcesses:
    """The processes of one problem, conditional on a hypothesis."""

    def __init__(self, hypothesis: Hypothesis, every: Iterable[Sequence[ProjectedProcess]]) -> None:
        self.hypothesis = hypothesis
        self._every = {lengths[0].process.name: lengths for lengths in every}
        self._known: dict[tuple[ConditionedProcess, ConditionedProcess], FloatArray] = {}
        self._less: dict[tuple[int, ...], Self] = {}

    @classmethod
    def of(cls, hypothesis: Hypothesis, processes: Iterable[Process]) -> Self:
        """Return processes at every length scale, conditional on a hypothesis."""
        nuisance = hypothesis.problem.nuisance
        values = np.column_stack([nuisance.axes, hypothesis.problem.residual, hypothesis.columns])
        kept = max(1, _AT_HAND // values.nbytes)
        against = lru_cache(kept)(lambda channel: channel.against(values))
        every = (
            [ProjectedProcess.of(process, length, against, nuisance.dof) for length in process.lengths]
            for process in processes
        )
        return cls(hypothesis, every)

    def __len__(self) -> int:
        return len(self._every)

    def without(self, indices: Sequence[int]) -> Self:
        """Return the same for the hypothesis without some of its items, such as those of a cause."""
        entry = tuple(indices)
        if entry not in self._less:
            fewer = self.hypothesis.without(indices)
            places = self.hypothesis.everything.places.tolist()
            own = np.array([places.index(k) for k in fewer.everything.places.tolist()], dtype=np.intp)
            every = ([replace(one, shared=one.shared[own]) for one in lengths] for lengths in self._every.values())
            self._less[entry] = type(self)(fewer, every)
        return self._less[entry]

    def over(self, times: FloatArray) -> Self:
        """Return the same where the noise of each equation is multiplied by its own factor, (m,)."""
        over = cache(lambda channel: channel.over(times))  # processes share channels
        return self.of(
            self.hypothesis.over(times), (own[0].process.with_channels(over) for own in self._every.values())
        )

    def under(self, factor: float) -> Self:
        """Return the same for all noise times a factor: valid for evidences, not for what processes explain."""
        every = ([one.under(factor) for one in lengths] for lengths in self._every.values())
        return type(self)(self.hypothesis.under(factor), every)

    def only(self, name: str) -> Self:
        """Return the same with one process only, by name."""
        return type(self)(self.hypothesis, [self._every[name]])

    @cached_property
    def conditioned(self) -> dict[str, list[ConditionedProcess]]:
        """Each process conditional on the hypothesis, by name, at each length scale."""
        everything = self.hypothesis.everything
        return {
            name: [ConditionedProcess.of(one, everything) for one in lengths] for name, lengths in self._every.items()
        }

    @cached_property
    def alone(self) -> list[FittedProcess]:
        """Each process fitted alone, given the hypothesis."""
        return list(ProcessSum(self).all())

    def shared(self, one: ConditionedProcess, other: ConditionedProcess) -> FloatArray:
        """Return the inner products of two processes, conditional on nuisance parameters and hypothesis, (k, l)."""
        if (other, one) in self._known:
            return self._known[other, one].T
        if (one, other) not in self._known:
            first, second = one.base, other.base
            whole = between(first.parts, second.parts) / (first.factor * second.factor)
            self._known[one, other] = whole - first.absorbed.T @ second.absorbed - one.coordinates.T @ other.coordinates
        return self._known[one, other]


class ProcessSum:
    """Several processes at once, given a hypothesis."""

    def __init__(self, processes: ProjectedProcesses, members: Sequence[FittedProcess] = ()) -> None:
        self.processes, self.members = processes, tuple(members)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its members."""
        return tuple(one.name for one in self.members)

    def others(self, one: FittedProcess) -> ProcessSum:
        """Return the sum without one member."""
        return ProcessSum(self.processes, [other for other in self.members if other is not one])

    def fitted(self, name: str) -> FittedProcess:
        """Return a process at its best length scale, given the members."""
        lengths = self.processes.conditioned[name]
        products = [self.products(one) for one in lengths]
        factors = [bayes_factor(*one) for one in products]
        evidences = np.array([factor.evidence for factor in factors])
        best, mean = int(np.argmax(evidences)), float(log_mean_exp(evidences))
        return FittedProcess(mean, lengths[best], factors[best].scale.main, *products[best])

    def all(self, but: Iterable[str] = ()) -> Iterator[FittedProcess]:
        """Yield each process, except those named, fitted given the members."""
        without = {*but}
        for name in self.processes.conditioned:
            if name not in without:
                yield self.fitted(name)

    def products(self, one: ConditionedProcess) -> tuple[FloatArray, FloatArray]:
        """Return a process's inner products, (k, k) and with the residual (k,), conditional on the members."""
        shared = [
            np.zeros((0, len(one.projected))),
            *(self.processes.shared(other.conditioned, one) for other in self.members),
        ]
        return self.conditional.conditioned(np.vstack(shared), one.inner, one.projected)

    def columns_of(self, one: FittedProcess) -> slice:
        """Return which of all columns belong to one member."""
        first = sum(len(other.projected) for other in self.members[: self.members.index(one)])
        return slice(first, first + len(one.projected))

    @cached_property
    def conditional(self) -> ConditionalGram:
        """Inner products conditional on hypothesis and members; the members' columns are its groups."""
        everything = self.processes.hypothesis.everything
        blocks = [
            [
                one.conditioned.inner if other is one else self.processes.shared(one.conditioned, other.conditioned)
                for other in self.members
            ]
            for one in self.members
        ]
        projected = np.concatenate([np.zeros(0), *(one.conditioned.projected for one in self.members)])
        weights = np.concatenate([np.zeros(0), *(np.full(len(one.projected), one.amplitude) for one in self.members)])
        inner = np.block(blocks) if blocks else np.zeros((0, 0))
        gram = Gram(inner, projected, everything.squared, everything.log_determinant)
        return ConditionalGram(gram, np.arange(len(projected)), weights)

    def explained(self, means: FloatArray, columns: FloatArray) -> FloatArray:
        """Return what members and hypothesis explain, (m,), at the members' standardised coefficients, (k,).

        ``columns`` are those of the hypothesis, (m, q).
        """
        everything, explained = self.processes.hypothesis.everything, np.zeros(len(columns))
        left = everything.residual_coordinates
        for one in self.members:
            values = one.amplitude * means[self.columns_of(one)]
            explained += sum(one.conditioned.base.pieces(values), np.zeros(len(columns)))
            left = left - one.conditioned.coordinates @ values
        return np.asarray(explained + columns @ (everything.weights * everything.coefficients_at(left)))
