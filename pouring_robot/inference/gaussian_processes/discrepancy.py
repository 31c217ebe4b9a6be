r"""The discrepancy: a sum of random functions of the conditions. It describes the residual, it names no cause.

A :class:`~.processes.Process` is a Gaussian process: something unknown moves a place along channels of the prediction,
as a function of a condition. Amplitude and length scale are integrated over, so that a condition on which nothing
depends is found irrelevant (automatic relevance determination: MacKay, Bayesian nonlinear modelling, 1994; sums:
Duvenaud, Nickisch & Rasmussen, Additive Gaussian processes, 2011). ``diagnosis/discrepancy_processes.py`` lists the
processes of a campaign, :mod:`~.kernels` holds their kernels, :mod:`~.process_sum` fits several at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from pouring_robot.inference.evidence import evidence_bound, largest_scale, log_mean_exp
from pouring_robot.inference.gaussian_processes.process_sum import (
    FittedProcess,
    ProcessSum,
    ProjectedProcess,
    ProjectedProcesses,
)
from pouring_robot.inference.gaussian_processes.processes import Process
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.larger_noise import LargerNoise, OtherNoise
from pouring_robot.inference.priors import LEFT_TO_NOISE
from pouring_robot.inference.thresholds import LITTLE_NATS
from pouring_robot.io.background_process import forked
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, rms


@dataclass(frozen=True, eq=False)
class Structure:
    """Structure that one process finds in the residual."""

    process: Process
    length: str  # the length scale that fits best, in words
    amplitude: float  # the most probable one, over the usual one
    evidence: float  # log evidence for it, conditional on the hypothesis and on other processes, if any, in nats
    size: float  # root mean square of what it explains, in noise standard deviations


@dataclass(frozen=True, eq=False)
class Summand(Structure):
    """One of several processes at once, with its own share of what they explain."""

    part: FloatArray  # what it explains, whitened, shape (m,)
    # what would be left without it, (m,), once the others and the hypothesis are refitted: far less than ``part`` where
    # two processes cancel in part, or do much the same
    missed: FloatArray
    movement: FloatArray  # how far each of its parts moves in each row, (n, parts), in m and rad
    std: FloatArray  # standard deviation of that, (n, parts)


@dataclass(frozen=True)
class Challenge:
    """A process that explains better than a cause in its place."""

    process: Process
    margin: float  # its log evidence minus the cause's, in nats
    length: str = ""  # the length scale that fits best, in words


_NOTHING = Process("", "", {})
_ANY_SCALE = 1e3
"""Amplitude over the widest prior one: a process of that amplitude explains as much as least squares would."""
_MOST_TOGETHER = 6
"""Most processes that may stand for what is unknown: more than the data of one campaign have ever supported."""


class Discrepancy(ProjectedProcesses):
    """What processes find given a hypothesis, and in place of its causes."""

    def __init__(self, hypothesis: Hypothesis, every: Iterable[Sequence[ProjectedProcess]]) -> None:
        super().__init__(hypothesis, every)
        # By the evidence that each process must bring: the sums found so far, and the iterator that finds the next.
        self._sums: dict[float, tuple[list[ProcessSum], Iterator[ProcessSum]]] = {}

    def challenge(self, indices: Sequence[int]) -> Challenge:
        """Return the process that explains best in place of a cause, given by the indices of its items.

        The right cause beats every process, as processes are less specific. Where a process is clearly better, the
        cause is only the nearest neighbour of what is at work.
        """
        effects = {self.hypothesis.items[k].effect for k in indices}
        others = [found for found in self.without(indices).alone if not effects & found.process.same_as]
        if not others:
            return Challenge(_NOTHING, -np.inf)
        best = max(others, key=lambda found: found.evidence)
        return Challenge(best.process, best.evidence - self.hypothesis.worth(indices), best.conditioned.base.length)

    def larger_noise(self, kind: Indices) -> list[LargerNoise]:
        """Return the ways in which the noise may be larger than stated, given the hypothesis, most evident first.

        By one factor for all equations, or for those of one kind, by their labels (m,); each way is equally likely.
        """
        kinds = np.unique(kind).tolist()
        alone = {one: self._other_noise(kind == one) for one in kinds} if len(kinds) > 1 else {}
        ways = {None: self._other_noise(), **alone}
        found = [other.larger(one, -float(np.log(len(ways)))) for one, other in ways.items()]
        return sorted(found, key=lambda larger: -larger.evidence)

    def left_to_noise(self, most: float = 1.0) -> tuple[float, float]:
        """Return the most probable noise as a share of the residual if a process is at work, and the log evidence.

        The evidence is averaged over shares, with the process that explains best at each, against noise alone at its
        most probable level, in nats. The problem must be whitened by the residual's own level. The result is 1, without
        evidence, where even by least squares no process brings the residual below the share ``most``.
        """
        lefts = (one for lengths in self.conditioned.values() for one in lengths)
        explained = (2.0 * evidence_bound(_ANY_SCALE**2 * one.inner, _ANY_SCALE * one.projected) for one in lefts)
        if max(explained) < (1.0 - most**2) * self.hypothesis.everything.squared:
            return 1.0, -np.inf
        best = [max(self.under(share).alone, key=lambda found: found.evidence) for share in LEFT_TO_NOISE]
        other = self._other_noise()
        noise_alone = other.likelier(LEFT_TO_NOISE)
        densities = noise_alone + [found.evidence for found in best]
        likely = int(np.argmax(densities))
        one, ends = self.only(best[likely].name), LEFT_TO_NOISE[[max(likely - 1, 0), min(likely + 1, len(best) - 1)]]

        def against(log_share: float) -> float:
            share = float(np.exp(log_share))
            return -float(other.likelier(np.array([share]))[0]) - one.under(share).alone[0].evidence

        finer = scipy.optimize.minimize_scalar(against, bounds=np.log(ends), method="bounded")
        return float(np.exp(finer.x)), float(log_mean_exp(densities)) - float(noise_alone.max())

    def _other_noise(self, some: BoolArray | None = None) -> OtherNoise:
        """Return the likelihood of another noise level of some equations, (m,), by default of all."""
        problem, (every, own) = self.hypothesis.problem, (self.hypothesis.seen(), self.hypothesis.seen(some))
        return OtherNoise(every, own, problem.nuisance.dof, len(problem.residual) if some is None else int(some.sum()))

    def structures(self, least_evidence: float = LITTLE_NATS) -> list[Structure]:
        """Return what single processes find given the hypothesis, of ``least_evidence`` or more, most evident first."""
        found = sorted((f for f in self.alone if f.evidence >= least_evidence), key=lambda one: -one.evidence)
        count = len(self.hypothesis.problem.residual)
        return [
            Structure(f.process, f.conditioned.base.length, f.amplitude, f.evidence, float(np.sqrt(f.squared / count)))
            for f in found
        ]

    def sum(self, least_evidence: float, most: int) -> list[Summand]:
        """Return the processes, at most ``most``, whose sum explains the residual, largest first.

        They are added one by one, and dropped again where the others leave them less than ``least_evidence`` nats.
        """
        return sorted(self._summands(self._chosen(least_evidence, most)), key=lambda summand: -summand.size)

    def lead(self, indices: Sequence[int], least_evidence: float) -> float:
        """Return by how many nats a cause explains better than processes in its place, given what is unknown.

        What is unknown is a sum of processes with ``least_evidence`` nats each, searched for with the cause and without
        it. The alternative without the cause may also be the first of these sums with any one process more, however
        small its evidence. Processes that describe the same as the cause count here, too: a constant error may be the
        mean of something unknown.
        """
        rest = self.without(indices)
        with forked(lambda: rest._together(rest._names(least_evidence))) as elsewhere:
            names = self._names(least_evidence)
            own = self.hypothesis.worth(indices) + self._together(names)
            lead = own - elsewhere()
        if not 0.0 < lead < 2.0 * least_evidence:  # one more that the search left out has less than this
            return lead
        more, instead = self._more(names), rest._more(names)
        # What a process also explains together with the cause does not replace the cause.
        taken = max((evidence - max(more[name], 0.0) for name, evidence in instead.items()), default=0.0)
        return min(lead, own - rest._together(names) - max(taken, 0.0))

    def _names(self, least_evidence: float) -> tuple[str, ...]:
        return self._chosen(least_evidence, _MOST_TOGETHER).names

    def _refitted(self, names: Iterable[str]) -> ProcessSum:
        """Return processes by name, each fitted given those before it."""
        together = ProcessSum(self)
        for name in names:
            together = ProcessSum(self, [*together.members, together.fitted(name)])
        return together

    def _together(self, names: Iterable[str]) -> float:
        """Return the log evidence of processes together, in nats."""
        return sum(one.evidence for one in self._refitted(names).members)

    def _more(self, names: tuple[str, ...]) -> dict[str, float]:
        """Return the log evidence of each other process given those named, in nats."""
        return {found.name: found.evidence for found in self._refitted(names).all(but=names)}

    def _chosen(self, least_evidence: float, most: int) -> ProcessSum:
        if least_evidence not in self._sums:
            self._sums[least_evidence] = [], self._growing(least_evidence)
        known, more = self._sums[least_evidence]
        while not known or len(known[-1].members) < most:
            one = next(more, None)
            if one is None:
                break
            known.append(one)
        return next((one for one in known if len(one.members) >= most), known[-1])

    def _growing(self, least_evidence: float) -> Iterator[ProcessSum]:
        """Yield sums with one process added each time, for which others may drop out, beginning with none."""
        chosen, tried = ProcessSum(self), {one.name: one for one in self.alone}
        yield chosen
        while best := _best(tried, chosen, least_evidence):
            chosen = _settled(ProcessSum(self, [*chosen.members, best]), least_evidence)
            yield chosen
            if best.name not in chosen.names:
                break

    def rivals(self, summand: Summand, beside: Sequence[Summand], apart: float = LITTLE_NATS) -> tuple[str, ...]:
        """Return the conditions that explain as much, within ``apart`` nats, in place of a summand, best first.

        The summand and the others (``beside``) are results of :meth:`sum`.
        """
        others, taken = self._again(beside), {one.process.name for one in (summand, *beside)}
        found = [f for f in others.all(but=taken) if f.evidence > summand.evidence - apart]
        return tuple(f.process.by for f in sorted(found, key=lambda f: -f.evidence))

    def bounds(self, beside: Sequence[Summand]) -> dict[str, float]:
        """Return an upper bound of every other process's movement, by name, with a probability of 97.5 %.

        Root mean squares over the rows, in m or rad, conditional on the result of :meth:`sum`.
        """
        chosen, taken = self._again(beside), {summand.process.name for summand in beside}
        bounds = dict[str, float]()
        for name, lengths in self.conditioned.items():
            if name not in taken:
                sizes = [max(part.rms for part in one.base.parts) for one in lengths]
                largest = [largest_scale(*chosen.products(one)) for one in lengths]
                bounds[name] = max(size * scale for size, scale in zip(sizes, largest, strict=True))
        return bounds

    def _summands(self, together: ProcessSum) -> Iterator[Summand]:
        """Yield each process with its share of what all explain."""
        means, covariances = together.conditional.coefficients()
        problem, columns = self.hypothesis.problem, self.hypothesis.columns
        whole = together.explained(means, columns)
        for one in together.members:
            own, base = together.columns_of(one), one.conditioned.base
            mean, covariance = one.amplitude * means[own], one.amplitude**2 * covariances[own, own]
            places = [*zip(base.parts, base.spans, strict=True)]
            movement = np.column_stack([part.course @ mean[place] for part, place in places])
            std = np.column_stack([np.sqrt(part.variances(covariance[place, place])) for part, place in places])
            part = problem.nuisance.cleared(sum(base.pieces(mean), np.zeros(len(columns))))
            worth = together.others(one).fitted(one.name).evidence
            missed = problem.nuisance.cleared(
                whole - together.explained(together.conditional.means_without(own), columns)
            )
            yield Summand(one.process, base.length, one.amplitude, worth, rms(part), part, missed, movement, std)

    def _again(self, summands: Sequence[Summand]) -> ProcessSum:
        """Return the sum from which summands were made."""
        found = [
            (s, next(one for one in self.conditioned[s.process.name] if one.base.length == s.length)) for s in summands
        ]
        return ProcessSum(self, [FittedProcess(s.evidence, o, s.amplitude, o.inner, o.projected) for s, o in found])


def _best(tried: dict[str, FittedProcess], chosen: ProcessSum, least_evidence: float) -> FittedProcess | None:
    """Return the process with the most evidence given the chosen ones, if that is enough; None otherwise.

    The evidence of a process hardly ever grows as others are added, so that most need not be evaluated again (lazy
    greedy choice: Minoux, Accelerated greedy algorithms, 1978). As it may, all are before None is returned. ``tried``
    holds every process as last evaluated, by name, and is updated in place.
    """
    left = {name: one for name, one in tried.items() if name not in chosen.names}
    stale = set(left) if chosen.members else set()
    while left:
        best = max(left, key=lambda name: left[name].evidence)
        enough = left[best].evidence >= least_evidence
        if enough and best not in stale:
            return left[best]
        if not stale:
            break
        for name in [best] if enough else sorted(stale):
            left[name] = tried[name] = chosen.fitted(name)
            stale.discard(name)
    return None


def _settled(together: ProcessSum, least_evidence: float) -> ProcessSum:
    """Return the sum with each process refitted given the others, without those that lost their evidence."""
    for one in together.members:
        others = together.others(one)
        again = others.fitted(one.name)
        if again.evidence < least_evidence:
            together = others
        elif (again.conditioned, again.amplitude) != (one.conditioned, one.amplitude):
            together = ProcessSum(together.processes, [again if other is one else other for other in together.members])
    return together
