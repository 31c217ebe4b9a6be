r"""Errors drawn at random: distributions, correlation within a part, Saltelli's scheme.

Every error is a monotone function of one standard normal deviate z, so that correlation is the same notion for all
distributions (a Gaussian copula). Errors of one part share a deviate c:

.. math:: z_k = \sqrt{\rho}\, c + \sqrt{1-\rho}\, n_k

Numbers depend on the seed and the sample's index alone: samples are drawn in blocks of fixed size, each with the seed
sequence ``SeedSequence(seed, spawn_key=(0, block))``. Neither chunks nor workers change them.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.special

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.sweeps.config import SweepConfig
from pouring_robot.sweeps.parameters import SweepParameter

BLOCK = 256
NORMAL_TOLERANCE_SIGMAS = 3.0
"""The tolerance that belongs to an untruncated normal distribution, in standard deviations."""


@dataclass(frozen=True)
class Margin:
    """Distribution of one error about zero, in its own unit."""

    # largest error (half width, or where a normal is cut off); of an untruncated normal, three standard deviations
    tolerance: float
    std: float  # standard deviation, after truncation
    scale: float  # half width, or standard deviation before truncation
    cut: float  # truncation in units of ``scale``; infinite for a normal, zero for a uniform distribution

    def from_deviates(self, deviates: FloatArray) -> FloatArray:
        """Return errors for standard normal deviates of any shape."""
        if self.cut == 0.0:
            return np.asarray(self.scale * scipy.special.erf(deviates / np.sqrt(2.0)))
        if np.isinf(self.cut):
            return np.asarray(self.scale * deviates)
        inside = scipy.special.erf(self.cut / np.sqrt(2.0))
        # erf keeps small deviates exact, where 1 - ndtr would round them.
        return np.asarray(
            self.scale * np.sqrt(2.0) * scipy.special.erfinv(inside * scipy.special.erf(deviates / np.sqrt(2.0)))
        )


def _margin(config: SweepConfig, parameter: SweepParameter) -> Margin:
    entry = config.errors[parameter.entry]
    width, std, limit = (entry.size_si(size, parameter.unit) for size in ("half_width", "std", "limit"))
    if width is not None:
        return Margin(width, width / np.sqrt(3.0), width, 0.0)
    assert std is not None  # checked when the parameters were selected
    if limit is None:
        return Margin(NORMAL_TOLERANCE_SIGMAS * std, std, std, np.inf)
    cut = limit / std
    inside = float(scipy.special.erf(cut / np.sqrt(2.0)))
    density = float(np.exp(-0.5 * cut**2) / np.sqrt(2.0 * np.pi))
    return Margin(limit, std * float(np.sqrt(1.0 - 2.0 * cut * density / inside)), std, cut)


@dataclass(frozen=True, eq=False)
class Draws:
    """The errors of all samples, computed where they are needed."""

    study: str
    seed: int
    count: int  # number of samples in all
    margins: tuple[Margin, ...]  # distribution of every parameter
    parts: tuple[int, ...]  # number of the part that each parameter is measured on, shape (parameters,)
    shared: FloatArray  # weight of the part's common deviate, the root of the correlation, shape (parameters,)

    @classmethod
    def of(cls, config: SweepConfig, parameters: Sequence[SweepParameter]) -> Draws:
        """Return the draws of a sweep."""
        names, samples = sorted({p.part for p in parameters}), config.samples or 0
        own = {"one_at_a_time": len(parameters), "monte_carlo": samples, "sobol": samples * (len(parameters) + 2)}
        margins = tuple(_margin(config, p) for p in parameters)
        parts = tuple(names.index(p.part) for p in parameters)
        shared = np.sqrt([config.errors[p.entry].correlation for p in parameters])
        return cls(config.study, config.seed, own[config.study], margins, parts, shared)

    def of_robots(self, count: int) -> Draws:
        """Return as many robots at random with the same distributions, whatever the study."""
        return replace(self, study="monte_carlo", count=count)

    def values(self, first: int, last: int) -> FloatArray:
        """Return the errors of samples ``first`` to ``last`` in m and rad, shape (last - first, parameters)."""
        if self.study == "one_at_a_time":
            return np.diag([m.tolerance for m in self.margins])[first:last]
        deviates = self._saltelli(first, last) if self.study == "sobol" else self._random(first, last)
        return np.stack([m.from_deviates(deviates[:, k]) for k, m in enumerate(self.margins)], axis=1)

    def _random(self, first: int, last: int) -> FloatArray:
        blocks = [self._block(b) for b in range(first // BLOCK, (last - 1) // BLOCK + 1)]
        start = first - first % BLOCK
        return np.concatenate(blocks)[first - start : last - start]

    def _block(self, number: int) -> FloatArray:
        generator = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(0, number)))
        common = generator.standard_normal((BLOCK, max(self.parts) + 1))
        own = generator.standard_normal((BLOCK, len(self.parts)))
        return np.asarray(self.shared * common[:, list(self.parts)] + np.sqrt(1.0 - self.shared**2) * own)

    def _saltelli(self, first: int, last: int) -> FloatArray:
        """Return rows of the matrix that SALib's sampler would build whole: A, A with one column of B each, B."""
        count = len(self.margins)
        base = sobol_points(count, self.count // (count + 2), self.seed)
        point, place = np.divmod(np.arange(first, last), count + 2)
        rows = base[point, :count].copy()
        one = (place >= 1) & (place <= count)
        rows[one, place[one] - 1] = base[point[one], count + place[one] - 1]
        rows[place == count + 1] = base[point[place == count + 1], count:]
        # A scrambled point may be exactly zero, whose deviate would be infinite.
        tiny = 2.0**-54
        return np.asarray(scipy.special.ndtri(np.clip(rows, tiny, 1.0 - tiny)))


@functools.lru_cache(maxsize=4)
def sobol_points(parameters: int, points: int, seed: int) -> FloatArray:
    """Return the Sobol sequence behind Saltelli's scheme, shape (points, 2 · parameters), in 0 to 1."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(d=2 * parameters, scramble=True, seed=seed)
    return np.asarray(sequence.random(points))
