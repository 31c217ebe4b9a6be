r"""What is left: one discrepancy, a sum of random functions of the conditions. Descriptions, not causes.

A :class:`~.processes.Process` is a Gaussian process: something unknown moves a place along channels of the prediction,
by a function of a condition. How large it is and how fast it varies is integrated over, so that a condition that
nothing depends on is found irrelevant (automatic relevance determination: MacKay, Bayesian nonlinear modelling, 1994;
sums: Duvenaud, Nickisch & Rasmussen, Additive Gaussian processes, 2011). Which there are of a campaign:
``diagnosis/discrepancy_processes.py``; their kernels: :mod:`~.gp_kernels`; several at work together:
:mod:`~.together`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from pouring_robot.inference.evidence import largest_scale, log_mean, most_evidence
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.larger_noise import LargerNoise, OtherNoise
from pouring_robot.inference.priors import LEFT_TO_NOISE
from pouring_robot.inference.processes import Process
from pouring_robot.inference.thresholds import LITTLE_NATS
from pouring_robot.inference.together import Found, Seen, SeenProcesses, Together
from pouring_robot.io.forked import forked
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, rms


@dataclass(frozen=True, eq=False)
class Structure:
    """What a process finds in what is left."""

    process: Process  # the process
    length: str  # at which length scale it fits best, in words
    amplitude: float  # the most probable one, over what is usual
    evidence: float  # log evidence for it beside what it was tried beside, in nats
    size: float  # root mean square of what it explains, in noise standard deviations


@dataclass(frozen=True, eq=False)
class Summand(Structure):
    """One of several processes at work together, with its own share of what they do."""

    part: FloatArray  # what it explains, whitened, shape (m,)
    # what would be left over without it, (m,), as far as the others and the hypothesis would not take it up: of two
    # that undo each other in part, or that do alike, far less than what each makes
    missed: FloatArray
    movement: FloatArray  # by how much each of its parts moves in each row, (n, parts), in m and rad
    std: FloatArray  # standard deviation of that, (n, parts)


@dataclass(frozen=True)
class Challenge:
    """A process that explains better than a cause in its place."""

    process: Process  # the process
    margin: float  # by how much its log evidence is larger, in nats; negative where the cause explains better
    length: str = ""  # at which length scale it fits best, in words


_NOTHING = Process("", "", {})
_ANY_SCALE = 1e3
"""Over the widest one: what a process of that amplitude explains is as by least squares, however large the noise is."""
_MOST_TOGETHER = 6
"""So many processes may be what is unknown beside a cause or in its place: more than data of one campaign have told."""


class Discrepancy(SeenProcesses):
    """What processes find beside a hypothesis, and in the place of its causes; all inner products are formed once."""

    def __init__(self, hypothesis: Hypothesis, every: Iterable[Sequence[Seen]]) -> None:
        super().__init__(hypothesis, every)
        # By what each of them must be worth: sums that were grown so far, and what grows the next.
        self._sums: dict[float, tuple[list[Together], Iterator[Together]]] = {}

    def challenge(self, indices: Sequence[int]) -> Challenge:
        """Return the process that would explain best in the place of a cause, by indices of the items that make it.

        A cause that is the right one beats processes, which are less specific. Where a process is clearly better, the
        cause is only the nearest neighbour of what is at work.
        """
        effects = {self.hypothesis.items[k].effect for k in indices}
        others = [found for found in self.without(indices).alone if not effects & found.process.same_as]
        if not others:
            return Challenge(_NOTHING, -np.inf)
        best = max(others, key=lambda found: found.evidence)
        return Challenge(best.process, best.evidence - self.hypothesis.worth(indices), best.left.seen.length)

    def larger_noise(self, kind: Indices) -> list[LargerNoise]:
        """Return in which ways the noise may be larger beside the hypothesis, most evident first.

        That is of all equations alike or of those of one kind alone, by their labels (m,), each way as likely.
        """
        kinds = np.unique(kind).tolist()
        alone = {one: self._other_noise(kind == one) for one in kinds} if len(kinds) > 1 else {}
        ways = {None: self._other_noise(), **alone}
        found = [other.larger(one, -float(np.log(len(ways)))) for one, other in ways.items()]
        return sorted(found, key=lambda larger: -larger.evidence)

    def left_to_noise(self, most: float = 1.0) -> tuple[float, float]:
        """Return which share of what is left over is noise if a process is at work, and the log evidence for that.

        The most probable share, beside the process that then explains best; in nats, averaged over shares, against
        noise alone at its most probable. The noise is to be what the hypothesis leaves over. It is 1, without evidence,
        where by least squares no process leaves less than a share that is the most to be asked for.
        """
        lefts = (one for lengths in self.left.values() for one in lengths)
        explained = (2.0 * most_evidence(_ANY_SCALE**2 * one.inner, _ANY_SCALE * one.projected) for one in lefts)
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
        return float(np.exp(finer.x)), float(log_mean(densities)) - float(noise_alone.max())

    def _other_noise(self, some: BoolArray | None = None) -> OtherNoise:
        """Return how likely another noise of some equations is, (m,), by default of all."""
        problem, (every, own) = self.hypothesis.problem, (self.hypothesis.seen(), self.hypothesis.seen(some))
        return OtherNoise(every, own, problem.nuisance.dof, len(problem.residual) if some is None else int(some.sum()))

    def structures(self, least_evidence: float = LITTLE_NATS) -> list[Structure]:
        """Return what single processes, worth so many nats, find beside the hypothesis, most evident first."""
        found = sorted((f for f in self.alone if f.evidence >= least_evidence), key=lambda one: -one.evidence)
        count = len(self.hypothesis.problem.residual)
        return [
            Structure(f.process, f.left.seen.length, f.amplitude, f.evidence, float(np.sqrt(f.squared / count)))
            for f in found
        ]

    def sum(self, least_evidence: float, most: int) -> list[Summand]:
        """Return the processes, so many at most, whose sum explains what is left, largest first.

        They are added one by one, and left out again where they are not worth so many nats beside the others.
        """
        return sorted(self._summands(self._chosen(least_evidence, most)), key=lambda summand: -summand.size)

    def lead(self, indices: Sequence[int], least_evidence: float) -> float:
        """Return by how much a cause explains better than processes in its place, in nats, beside what is unknown.

        That is a sum of processes, each worth so many nats, searched for with the cause and without it. Or it is the
        first sum, and in the cause's place any one process more, however little that is worth. Those that say the same
        as the cause count, too: a constant error may be the mean of what is unknown.
        """
        rest = self.without(indices)
        with forked(lambda: rest._together(rest._names(least_evidence))) as elsewhere:
            names = self._names(least_evidence)
            own = self.hypothesis.worth(indices) + self._together(names)
            lead = own - elsewhere()
        if not 0.0 < lead < 2.0 * least_evidence:  # one more that the search for a sum left out is worth no more
            return lead
        more, instead = self._more(names), rest._more(names)
        # Of what a process explains beside the cause, too, its place takes nothing.
        taken = max((evidence - max(more[name], 0.0) for name, evidence in instead.items()), default=0.0)
        return min(lead, own - rest._together(names) - max(taken, 0.0))

    def _names(self, least_evidence: float) -> tuple[str, ...]:
        return self._chosen(least_evidence, _MOST_TOGETHER).names

    def _refound(self, names: Iterable[str]) -> Together:
        """Return processes by name, each as it is beside those before it."""
        together = Together(self)
        for name in names:
            together = Together(self, [*together.found, together.worth(name)])
        return together

    def _together(self, names: Iterable[str]) -> float:
        """Return what processes are worth together, in nats."""
        return sum(one.evidence for one in self._refound(names).found)

    def _more(self, names: tuple[str, ...]) -> dict[str, float]:
        """Return what each other process is worth beside some, in nats."""
        return {found.name: found.evidence for found in self._refound(names).all(but=names)}

    def _chosen(self, least_evidence: float, most: int) -> Together:
        if least_evidence not in self._sums:
            self._sums[least_evidence] = [], self._growing(least_evidence)
        known, more = self._sums[least_evidence]
        while not known or len(known[-1].found) < most:
            one = next(more, None)
            if one is None:
                break
            known.append(one)
        return next((one for one in known if len(one.found) >= most), known[-1])

    def _growing(self, least_evidence: float) -> Iterator[Together]:
        """Yield sums of more and more processes, from none on."""
        chosen, tried = Together(self), {one.name: one for one in self.alone}
        yield chosen
        while best := _best(tried, chosen, least_evidence):
            chosen = _settled(Together(self, [*chosen.found, best]), least_evidence)
            yield chosen
            if best.name not in chosen.names:
                break

    def rivals(self, summand: Summand, beside: Sequence[Summand], apart: float = LITTLE_NATS) -> tuple[str, ...]:
        """Return the conditions that would explain as much, but for some nats, in the place of a summand, best first.

        The summand and those beside it are what :meth:`sum` found.
        """
        others, taken = self._again(beside), {one.process.name for one in (summand, *beside)}
        found = [f for f in others.all(but=taken) if f.evidence > summand.evidence - apart]
        return tuple(f.process.by for f in sorted(found, key=lambda f: -f.evidence))

    def bounds(self, beside: Sequence[Summand]) -> dict[str, float]:
        """Return of every other process, by name, what its movement is below with a probability of 97.5 %.

        Root mean squares over the rows, in m or rad, beside what :meth:`sum` found.
        """
        chosen, taken = self._again(beside), {summand.process.name for summand in beside}
        bounds = dict[str, float]()
        for name, lengths in self.left.items():
            if name not in taken:
                sizes = [max(part.rms for part in one.seen.parts) for one in lengths]
                largest = [largest_scale(*chosen.products(one)) for one in lengths]
                bounds[name] = max(size * scale for size, scale in zip(sizes, largest, strict=True))
        return bounds

    def _summands(self, together: Together) -> Iterator[Summand]:
        """Yield processes, each with its share of what they do together."""
        means, covariances = together.beside.coefficients()
        problem, columns = self.hypothesis.problem, self.hypothesis.columns
        whole = together.explained(means, columns)
        for one in together.found:
            own, seen = together.own(one), one.left.seen
            mean, covariance = one.amplitude * means[own], one.amplitude**2 * covariances[own, own]
            places = [*zip(seen.parts, seen.spans, strict=True)]
            movement = np.column_stack([part.course @ mean[place] for part, place in places])
            std = np.column_stack([np.sqrt(part.variances(covariance[place, place])) for part, place in places])
            part = problem.nuisance.cleared(sum(seen.pieces(mean), np.zeros(len(columns))))
            worth = together.others(one).worth(one.name).evidence
            missed = problem.nuisance.cleared(whole - together.explained(together.beside.means_without(own), columns))
            yield Summand(one.process, seen.length, one.amplitude, worth, rms(part), part, missed, movement, std)

    def _again(self, summands: Sequence[Summand]) -> Together:
        """Return what summands were made from."""
        found = [(s, next(one for one in self.left[s.process.name] if one.seen.length == s.length)) for s in summands]
        return Together(self, [Found(s.evidence, o, s.amplitude, o.inner, o.projected) for s, o in found])


def _best(tried: dict[str, Found], chosen: Together, least_evidence: float) -> Found | None:
    """Return the process that is worth most beside the chosen ones, if it is worth enough.

    What a process is worth hardly grows as others are added, so that most need not be looked at again (lazy greedy
    choice: Minoux, Accelerated greedy algorithms, 1978). Some is: before nothing more is said to be there, all are.
    ``tried`` has all by name, as they were when last looked at, and is brought up to date in place.
    """
    left = {name: one for name, one in tried.items() if name not in chosen.names}
    stale = set(left) if chosen.found else set()
    while left:
        best = max(left, key=lambda name: left[name].evidence)
        enough = left[best].evidence >= least_evidence
        if enough and best not in stale:
            return left[best]
        if not stale:
            break
        for name in [best] if enough else sorted(stale):
            left[name] = tried[name] = chosen.worth(name)
            stale.discard(name)
    return None


def _settled(together: Together, least_evidence: float) -> Together:
    """Return the same, each with the amplitude and length it has beside the others, without what is not missed."""
    for one in together.found:
        others = together.others(one)
        again = others.worth(one.name)
        if again.evidence < least_evidence:
            together = others
        elif (again.left, again.amplitude) != (one.left, one.amplitude):
            together = Together(together.seen, [again if other is one else other for other in together.found])
    return together
