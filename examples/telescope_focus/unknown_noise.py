r"""The core's evidence where nobody says how large the noise is: it is integrated over.

The core takes residuals over the noise. For a noise σ the density of the data is the core's evidence times
:math:`\sigma^{-(n - f)}` (n rows, f free constants). Every hypothesis is weighed by that over a grid of σ, spread
evenly in its logarithm; what varies from one exposure to the next without following anything then counts as noise.
A search of a robot's campaign, of seconds, is run at one noise at a time, until that is what it leaves over
(:mod:`pouring_robot.diagnosis.search_and_noise`); here a search takes milliseconds, so that every noise can be asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.gaussian_processes.discrepancy import Discrepancy
from pouring_robot.inference.gaussian_processes.processes import Process
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.problem import Problem
from pouring_robot.inference.search import search
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.mechanism.arrays import FloatArray

Key = tuple[str, str]
Keys = tuple[Key, ...]


@dataclass(frozen=True, eq=False)
class Weighed:
    """A hypothesis over the grid of noises.

    Attributes:
        at: the hypothesis at each noise.
        log_density: shape (g,): log density of the data at each noise, in nats, up to a constant of the problem.
    """

    at: tuple[Hypothesis, ...]
    log_density: FloatArray

    @property
    def log_evidence(self) -> float:
        """Log evidence with the noise integrated over, in nats."""
        return float(logsumexp(self.log_density) - np.log(self.log_density.size))

    @property
    def weights(self) -> FloatArray:
        """How probable each noise is, shape (g,)."""
        return np.asarray(np.exp(self.log_density - logsumexp(self.log_density)))


class UnknownNoise:
    """A family of problems, one for each noise of a grid.

    Args:
        problem: as it is where the noise is one of the units that ``noises`` are in.
        noises: shape (g,), evenly spread in their logarithm.
        thresholds: what an explanation must be worth.
        price: nats that an explanation costs beyond the threshold, because it was picked from many of its kind.
        every: the search is run at every so-manieth noise; what it finds is weighed at all.
    """

    def __init__(
        self,
        problem: Problem,
        noises: FloatArray,
        thresholds: Thresholds,
        price: Callable[[Key], float] = lambda key: 0.0,
        every: int = 3,
    ) -> None:
        """Build the problems."""
        self.noises, self.thresholds, self._price, self._every = noises, thresholds, price, every
        self.problem, self.problems = problem, [problem.under(noise) for noise in noises.tolist()]
        self.degrees = len(problem.residual) - problem.nuisance.dof
        self._known: dict[frozenset[Key], Weighed] = {}

    def weighed(self, keys: Iterable[Key]) -> Weighed:
        """Return the hypothesis of some explanations at every noise; order does not matter."""
        chosen = tuple(sorted(keys))
        name = frozenset(chosen)
        if name not in self._known:
            at = tuple(_hypothesis(problem, chosen) for problem in self.problems)
            density = np.array([h.log_evidence for h in at]) - self.degrees * np.log(self.noises)
            # Of columns that the constants absorb the core says no number: they are worth nothing.
            self._known[name] = Weighed(at, np.where(np.isnan(density), -np.inf, density))
        return self._known[name]

    def best(self) -> Keys:
        """Return what the data ask for: the best that the searches find, one form an effect, largest first.

        With the noise integrated over, too, every explanation must be worth the search's threshold and its price.
        """
        found = {
            frozenset(item.key for item in search(p, self.thresholds).items) for p in self.problems[:: self._every]
        }
        found |= {keys - {key} for keys in found for key in keys} | {frozenset()}
        found = {keys for keys in found if len({effect for effect, _ in keys}) == len(keys)}  # one form of each effect
        while True:
            best = max(found, key=self._worth)
            smaller = {best - {key} for key in best} - found
            if not smaller:
                break
            found |= smaller
        weighed = self.weighed(best)
        at = weighed.at[int(np.argmax(weighed.log_density))]
        sizes = {item.key: at.squared_size(k) for k, item in enumerate(at.items)}
        return tuple(sorted(sizes, key=lambda key: -sizes[key]))

    def _worth(self, keys: frozenset[Key]) -> float:
        paid = sum(self.thresholds.least_evidence + self._price(key) for key in keys)
        return self.weighed(keys).log_evidence - paid

    def noise(self, keys: Keys) -> tuple[float, float]:
        """Return mean and standard deviation of the noise under a hypothesis."""
        weights = self.weighed(keys).weights
        mean = float(weights @ self.noises)
        return mean, float(np.sqrt(weights @ (self.noises - mean) ** 2))

    def coefficients(self, keys: Keys, key: Key) -> tuple[FloatArray, FloatArray]:
        """Return mean (k,) and covariance (k, k) of an explanation's coefficients, in usual sizes."""
        weighed = self.weighed(keys)
        means, covariances = zip(*(_own(h, key) for h in weighed.at), strict=True)
        stacked = np.array(means)
        mean = weighed.weights @ stacked
        spread = np.einsum("g,gi,gj->ij", weighed.weights, stacked - mean, stacked - mean)
        return mean, np.asarray(spread + np.tensordot(weighed.weights, np.array(covariances), axes=1))

    def structures(self, keys: Keys, described: list[Process]) -> list[tuple[str, float]]:
        """Return each description's name and its log evidence in the remainder, most evident first."""
        weighed = self.weighed(keys)
        beside = (Discrepancy.of(hypothesis.on(self.problem), described) for hypothesis in weighed.at)
        under = (found.under(noise) for found, noise in zip(beside, self.noises.tolist(), strict=True))
        table = np.array([[one.evidence for one in found.alone] for found in under]).T
        values = logsumexp(weighed.log_density + table, axis=1) - logsumexp(weighed.log_density)
        ranked = sorted(zip(described, values.tolist(), strict=True), key=lambda pair: -pair[1])
        return [(d.name, value) for d, value in ranked]


def _hypothesis(problem: Problem, keys: Keys) -> Hypothesis:
    known = {item.key: item for item in problem.explanations}
    bare = Hypothesis.nothing(problem)
    return Hypothesis(problem, tuple(known[key] for key in keys), (Scale(1.0),) * len(keys), bare.levels).settled()


def _own(hypothesis: Hypothesis, key: Key) -> tuple[FloatArray, FloatArray]:
    place = [item.key for item in hypothesis.items].index(key)
    own, weights = hypothesis.spans[place], hypothesis.weights()[place]
    return hypothesis.values[place], np.outer(weights, weights) * hypothesis.coefficients()[1][own, own]
