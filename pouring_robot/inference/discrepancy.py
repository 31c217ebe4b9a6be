r"""What is left: one discrepancy, a sum of random functions of the conditions. Descriptions, not causes.

A :class:`~.processes.Process` is a Gaussian process: something unknown moves a place along channels of the prediction,
by a function of a condition. How large it is and how fast it varies is integrated over, so that a condition that
nothing depends on is found irrelevant (automatic relevance determination: MacKay, Bayesian nonlinear modelling, 1994;
sums: Duvenaud, Nickisch & Rasmussen, Additive Gaussian processes, 2011).

Nothing here knows the robot.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy.linalg
from scipy.special import logsumexp

from pouring_robot.inference.evidence import Beside, Gram, bayes_factor, largest_scale
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.processes import Channel, Part, Process, between
from pouring_robot.mechanism.arrays import FloatArray


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


_NOTHING = Process("", "", {})
_AT_HAND = 2**26
"""Room for channels that were held against everything, in bytes: processes that share them are next to each other."""
_MOST_TOGETHER = 6
"""So many processes may be what is unknown beside a cause or in its place: more than data of one campaign have told."""
_FACTORS = np.geomspace(1.01, 1e3, 200)
"""How many times as large the noise may be."""


@dataclass(frozen=True, eq=False)
class _Seen:
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
        return self.process.lengths[self.length]

    @classmethod
    def of(cls, process: Process, length: str, against: Callable[[Channel], FloatArray], free: int) -> _Seen:
        """Return it beside what free unknowns explain.

        A channel is held against values, (n, q): their axes, so many, then the residual and the columns of the
        hypothesis, free of those.
        """
        parts = process.lengths[length]
        values = np.vstack([part.course.T @ against(part.channel) for part in parts]).T
        absorbed = values[:free]
        inner = between(parts, parts) - absorbed.T @ absorbed
        return cls(process, length, absorbed, inner, values[free], values[free + 1 :])

    def under(self, factor: float) -> _Seen:
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
class _Left:
    """What a hypothesis leaves to a process at one length scale."""

    seen: _Seen  # the process there
    taken: FloatArray  # what it takes up of its columns, in coordinates of its own (q, k)
    inner: FloatArray  # inner products of its columns with each other beside that, (k, k)
    projected: FloatArray  # of its columns with the residual, (k,)

    @classmethod
    def of(cls, seen: _Seen, beside: Beside) -> _Left:
        """Return it beside all columns of a hypothesis."""
        taken = beside.taken(seen.shared)
        return cls(seen, taken, seen.inner - taken.T @ taken, seen.projected - taken.T @ beside.pulled)


@dataclass(frozen=True, eq=False)
class _Found:
    """A process at its best length scale beside something."""

    evidence: float  # averaged over its length scales, in nats
    left: _Left  # it at the best of them
    amplitude: float  # the most probable one
    inner: FloatArray  # inner products of its columns beside that something, (k, k)
    projected: FloatArray  # of its columns with the residual, (k,)

    @property
    def seen(self) -> _Seen:
        return self.left.seen

    @property
    def name(self) -> str:
        return self.seen.process.name

    @property
    def squared(self) -> float:
        """Squared length of what it explains, in noise variances."""
        scaled = self.amplitude**2 * self.inner
        mean = scipy.linalg.solve(scaled + np.eye(len(scaled)), self.amplitude * self.projected, assume_a="pos")
        return max(float(mean @ scaled @ mean), 0.0)


class Discrepancy:
    """What processes find beside a hypothesis, and in the place of its causes; all inner products are formed once."""

    def __init__(self, hypothesis: Hypothesis, processes: Iterable[Process]) -> None:
        self.hypothesis = hypothesis
        places, nuisance = hypothesis.everything.places, hypothesis.problem.nuisance
        self._own = dict(zip(places.tolist(), range(len(places)), strict=True))
        values = np.column_stack([nuisance.axes, hypothesis.problem.residual, hypothesis.columns])
        kept = max(1, _AT_HAND // max(values.nbytes, 1))
        against = lru_cache(kept)(lambda channel: channel.against(values))
        self._seen = {
            process.name: [_Seen.of(process, length, against, nuisance.dof) for length in process.lengths]
            for process in processes
        }
        self._known: dict[tuple[_Left, _Left], FloatArray] = {}
        self._less: dict[tuple[int, ...], Discrepancy] = {}
        self._sums: dict[tuple[float, int], list[_Found]] = {}

    def __len__(self) -> int:
        return len(self._seen)

    def without(self, indices: Sequence[int]) -> Discrepancy:
        """Return the same beside the hypothesis without a cause, by indices of the items that make it."""
        if tuple(indices) not in self._less:
            again = self._beside_another(self.hypothesis.without(indices))
            places = again.hypothesis.everything.places.tolist()
            own = np.array([self._own[k] for k in places], dtype=np.intp)
            again._own = dict(zip(places, range(len(places)), strict=True))
            again._seen = {
                name: [replace(one, shared=one.shared[own]) for one in lengths] for name, lengths in self._seen.items()
            }
            self._less[tuple(indices)] = again
        return self._less[tuple(indices)]

    def _beside_another(self, hypothesis: Hypothesis) -> Discrepancy:
        again = copy.copy(self)
        again.hypothesis, again._known, again._less, again._sums = hypothesis, {}, {}, {}
        for worked_out in ("_left", "_alone"):
            vars(again).pop(worked_out, None)
        return again

    def challenge(self, indices: Sequence[int]) -> Challenge:
        """Return the process that would explain best in the place of a cause, by indices of the items that make it.

        A cause that is the right one beats processes, which are less specific. Where a process is clearly better, the
        cause is only the nearest neighbour of what is at work.
        """
        effects = {self.hypothesis.items[k].effect for k in indices}
        others = [found for found in self.without(indices)._alone if not effects & found.seen.process.same_as]
        if not others:
            return Challenge(_NOTHING, -np.inf)
        best = max(others, key=lambda found: found.evidence)
        return Challenge(best.seen.process, best.evidence - self.hypothesis.worth(indices))

    def noise(self) -> tuple[float, float]:
        """Return how many times as large the noise would be, and the log evidence for that in nats.

        At its most probable, beside the hypothesis; against the noise as it is said to be, averaged over factors.
        """
        problem, fitted = self.hypothesis.problem, self.hypothesis.everything
        equations = len(problem.residual) - problem.nuisance.dof
        weights = np.concatenate([np.zeros(0), *self.hypothesis.weights()])
        densities = np.empty(len(_FACTORS))
        for k, factor in enumerate(_FACTORS):  # coefficients that are so many times smaller, over the noise
            seen = Beside(problem.gram, fitted.places, weights / factor)
            densities[k] = -0.5 * (seen.squared / factor**2 + seen.log_determinant) - equations * np.log(factor)
        evidence = float(logsumexp(densities)) - np.log(len(densities)) - fitted.log_likelihood
        return float(_FACTORS[np.argmax(densities)]), float(evidence)

    def under(self, factor: float) -> Discrepancy:
        """Return the same where the noise is so many times as large: what processes are worth, not what they do."""
        again = self._beside_another(self.hypothesis.under(factor))
        again._seen = {name: [one.under(factor) for one in lengths] for name, lengths in self._seen.items()}
        return again

    def structures(self, least_evidence: float = 3.0) -> list[Structure]:
        """Return what single processes, worth so many nats, find beside the hypothesis, most evident first."""
        found = sorted((one for one in self._alone if one.evidence >= least_evidence), key=lambda one: -one.evidence)
        count = len(self.hypothesis.problem.residual)
        return [
            Structure(f.seen.process, f.seen.length, f.amplitude, f.evidence, float(np.sqrt(f.squared / count)))
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
        names, rest = self._names(least_evidence), self.without(indices)
        own = self.hypothesis.worth(indices) + self._together(names)
        lead = own - rest._together(rest._names(least_evidence))
        if not 0.0 < lead < 2.0 * least_evidence:  # one more that the search for a sum left out is worth no more
            return lead
        more, instead = self._more(names), rest._more(names)
        # Of what a process explains beside the cause, too, its place takes nothing.
        taken = max((evidence - max(more[name], 0.0) for name, evidence in instead.items()), default=0.0)
        return min(lead, own - rest._together(names) - max(taken, 0.0))

    def _names(self, least_evidence: float) -> tuple[str, ...]:
        return tuple(one.name for one in self._chosen(least_evidence, _MOST_TOGETHER))

    def _refound(self, names: Iterable[str]) -> list[_Found]:
        """Return processes by name, each beside those before it."""
        found: list[_Found] = []
        for name in names:
            found.append(self._found(self._left[name], self._beside(found), found))
        return found

    def _together(self, names: Iterable[str]) -> float:
        """Return what processes are worth together, in nats."""
        return sum(one.evidence for one in self._refound(names))

    def _more(self, names: tuple[str, ...]) -> dict[str, float]:
        """Return what each other process is worth beside some, in nats."""
        found = self._refound(names)
        beside, others = self._beside(found), {name: one for name, one in self._left.items() if name not in names}
        return {name: self._found(one, beside, found).evidence for name, one in others.items()}

    def _chosen(self, least_evidence: float, most: int) -> list[_Found]:
        if (least_evidence, most) not in self._sums:
            self._sums[least_evidence, most] = self._greedy(least_evidence, most)
        return self._sums[least_evidence, most]

    def _greedy(self, least_evidence: float, most: int) -> list[_Found]:
        chosen: list[_Found] = []
        tried = {one.name: one for one in self._alone}
        while len(chosen) < most:
            best = self._best(tried, chosen, least_evidence)
            if best is None:
                break
            chosen = self._settled([*chosen, best], least_evidence)
            if best.name not in {one.name for one in chosen}:
                break
        return chosen

    def _best(self, tried: dict[str, _Found], chosen: Sequence[_Found], least_evidence: float) -> _Found | None:
        """Return the process that is worth most beside the chosen ones, if it is worth enough.

        What a process is worth hardly grows as others are added, so that most need not be looked at again (lazy greedy
        choice: Minoux, Accelerated greedy algorithms, 1978). Some is: before nothing more is said to be there, all are.
        ``tried`` has all by name, as they were when last looked at, and is brought up to date in place.
        """
        beside, taken = self._beside(chosen), {one.name for one in chosen}
        left = {name: one for name, one in tried.items() if name not in taken}
        stale = set(left) if chosen else set()
        while left:
            best = max(left, key=lambda name: left[name].evidence)
            enough = left[best].evidence >= least_evidence
            if enough and best not in stale:
                return left[best]
            if not stale:
                break
            for name in [best] if enough else sorted(stale):
                left[name] = tried[name] = self._found(self._left[name], beside, chosen)
                stale.discard(name)
        return None

    def _settled(self, chosen: Sequence[_Found], least_evidence: float) -> list[_Found]:
        """Return the same, each with the amplitude and length it has beside the others, without what is not missed."""
        settled = list(chosen)
        for one in chosen if len(chosen) > 1 else ():
            others = [other for other in settled if other.name != one.name]
            again = self._found(self._left[one.name], self._beside(others), others)
            settled = [again if other.name == one.name else other for other in settled]
            if again.evidence < least_evidence:
                settled = others
        return settled

    def rivals(self, summand: Summand, beside: Sequence[Summand], apart: float = 3.0) -> tuple[str, ...]:
        """Return the conditions that would explain as much, but for some nats, in the place of a summand, best first.

        The summand and those beside it are what :meth:`sum` found.
        """
        others, taken = self._again(beside), {one.process.name for one in (summand, *beside)}
        least = summand.evidence - apart
        found = [f for f in self._tried(self._beside(others), others) if f.evidence > least and f.name not in taken]
        return tuple(f.seen.process.by for f in sorted(found, key=lambda f: -f.evidence))

    def bounds(self, beside: Sequence[Summand]) -> dict[str, float]:
        """Return of every other process, by name, what its movement is below with a probability of 97.5 %.

        Root mean squares over the rows, in m or rad, beside what :meth:`sum` found.
        """
        chosen, taken = self._again(beside), {summand.process.name for summand in beside}
        place, bounds = self._beside(chosen), {}
        for name, lengths in self._left.items():
            if name not in taken:
                sizes = [max(part.rms for part in one.seen.parts) for one in lengths]
                largest = [largest_scale(*self._outside(place, chosen, one)) for one in lengths]
                bounds[name] = max(size * scale for size, scale in zip(sizes, largest, strict=True))
        return bounds

    @cached_property
    def _left(self) -> dict[str, list[_Left]]:
        """Processes by name at each length scale."""
        everything = self.hypothesis.everything
        return {name: [_Left.of(one, everything) for one in lengths] for name, lengths in self._seen.items()}

    @cached_property
    def _alone(self) -> list[_Found]:
        return list(self._tried(self._beside(())))

    def _tried(self, beside: Beside, chosen: Sequence[_Found] = ()) -> Iterator[_Found]:
        """Yield each process beside chosen ones."""
        for lengths in self._left.values():
            yield self._found(lengths, beside, chosen)

    def _found(self, lengths: Sequence[_Left], beside: Beside, chosen: Sequence[_Found]) -> _Found:
        """Return one process, at all its length scales, beside the same."""
        products = [self._outside(beside, chosen, one) for one in lengths]
        worths = [bayes_factor(*one) for one in products]
        evidences = np.array([worth.evidence for worth in worths])
        best, mean = int(np.argmax(evidences)), float(np.logaddexp.reduce(evidences) - np.log(len(worths)))
        return _Found(mean, lengths[best], worths[best].scale.main, *products[best])

    def _outside(self, beside: Beside, chosen: Sequence[_Found], one: _Left) -> tuple[FloatArray, FloatArray]:
        shared = [np.zeros((0, len(one.projected))), *(self._shared(other.left, one) for other in chosen)]
        return beside.outside(np.vstack(shared), one.inner, one.projected)

    def _shared(self, one: _Left, other: _Left) -> FloatArray:
        """Return the inner products of two processes beside free unknowns and the hypothesis, (k, l)."""
        if (other, one) in self._known:
            return self._known[other, one].T
        if (one, other) not in self._known:
            first, second = one.seen, other.seen
            whole = between(first.parts, second.parts) / (first.factor * second.factor)
            self._known[one, other] = whole - first.absorbed.T @ second.absorbed - one.taken.T @ other.taken
        return self._known[one, other]

    def _beside(self, chosen: Sequence[_Found]) -> Beside:
        """Return what is to be seen beside the hypothesis and chosen processes; its groups are these."""
        everything = self.hypothesis.everything
        blocks = [
            [one.left.inner if other is one else self._shared(one.left, other.left) for other in chosen]
            for one in chosen
        ]
        projected = np.concatenate([np.zeros(0), *(one.left.projected for one in chosen)])
        weights = np.concatenate([np.zeros(0), *(np.full(len(one.projected), one.amplitude) for one in chosen)])
        inner = np.block(blocks) if blocks else np.zeros((0, 0))
        gram = Gram(inner, projected, everything.squared, everything.log_determinant)
        return Beside(gram, np.arange(len(projected)), weights)

    def _summands(self, chosen: Sequence[_Found]) -> Iterator[Summand]:
        """Yield the chosen processes, each with its share of what they do together."""
        if not chosen:
            return
        means, covariances = self._beside(chosen).coefficients()
        problem, first, columns = self.hypothesis.problem, 0, self.hypothesis.columns
        whole = self._explained(chosen, means, columns)
        for one in chosen:
            own = slice(first, first := first + len(one.seen.projected))
            mean, covariance = one.amplitude * means[own], one.amplitude**2 * covariances[own, own]
            movement, std, part, at = [], [], np.zeros(len(problem.residual)), 0
            for piece in one.seen.parts:
                place = slice(at, at := at + piece.course.shape[1])
                movement.append(piece.course @ mean[place])
                std.append(np.sqrt(piece.variances(covariance[place, place])))
                part += piece.channel.column * (piece.channel.rows.T @ movement[-1])
            part = problem.nuisance.cleared(part)
            size = float(np.sqrt((part @ part) / len(part)))
            others = [other for other in chosen if other is not one]
            beside = self._beside(others)
            worth = bayes_factor(*self._outside(beside, others, one.left)).evidence
            missed = problem.nuisance.cleared(whole - self._explained(others, beside.coefficients()[0], columns))
            facts = one.seen.process, one.seen.length, one.amplitude, worth
            yield Summand(*facts, size, part, missed, np.column_stack(movement), np.column_stack(std))

    def _explained(self, chosen: Sequence[_Found], means: FloatArray, columns: FloatArray) -> FloatArray:
        """Return what the hypothesis and chosen processes explain together, (m,), by coefficients of these, (k,).

        ``columns`` are those of the hypothesis, (m, q).
        """
        everything, at, explained = self.hypothesis.everything, 0, np.zeros(len(columns))
        pulled = everything.pulled
        for one in chosen:
            values = one.amplitude * means[at : at + len(one.projected)]
            pulled = pulled - one.left.taken @ values
            for piece in one.seen.parts:
                own = one.amplitude * means[at : (at := at + piece.course.shape[1])]
                explained += piece.channel.column * (piece.channel.rows.T @ (piece.course @ own))
        return explained + columns @ (
            np.concatenate([np.zeros(0), *self.hypothesis.weights()]) * everything.back(pulled)
        )

    def _again(self, summands: Sequence[Summand]) -> list[_Found]:
        """Return what summands were made from."""
        found = [(s, next(one for one in self._left[s.process.name] if one.seen.length == s.length)) for s in summands]
        return [_Found(s.evidence, one, s.amplitude, one.inner, one.projected) for s, one in found]
