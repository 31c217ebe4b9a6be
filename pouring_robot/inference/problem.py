"""The explanations from which a diagnosis chooses, for any model that predicts rows. Nothing here knows the robot."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.evidence import Columns, Gram, chunks, shaping_unit
from pouring_robot.inference.priors import log_priors_of_forms
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

WORKMANSHIP_FORM = "background"
"""Name, in files, of an effect's form that is workmanship."""
_RANK = 1e-10
Value = TypeVar("Value")


def memoised(known: dict[Hashable, Any], what: Hashable, work: Callable[[], Value]) -> Value:
    """Return a value that is computed once and then remembered."""
    if what not in known:
        known[what] = work()
    found: Value = known[what]
    return found


@dataclass(frozen=True, eq=False)
class Nuisance:
    """What always free unknowns (frames, constants) can explain: projected out of everything before comparison."""

    axes: FloatArray  # orthonormal axes of the span of their columns, shape (m, f)

    @classmethod
    def of(cls, columns: FloatArray) -> Nuisance:
        """Return the span of columns (m, k) of any scales, without axes that are rounding errors only."""
        size = np.linalg.norm(columns, axis=0)
        axes, values, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
        return cls(axes[:, values > _RANK * values.max(initial=0.0)])

    @property
    def dof(self) -> int:
        """Number of degrees of freedom f."""
        return int(self.axes.shape[1])

    def cleared(self, values: FloatArray) -> FloatArray:
        """Return vectors (m,) or (m, k) with the nuisance parameters projected out."""
        return np.asarray(values - self.axes @ (self.axes.T @ values))

    def clear(self, columns: Columns) -> Columns:
        """Return columns (m, k) with it projected out: in memory for few equations, on request for many."""
        some = list(chunks(len(self.axes)))
        if len(some) < 2:
            return self.cleared(columns[:])
        absorbed = np.zeros((self.dof, columns.shape[1]))
        for block in some:
            absorbed += self.axes[block].T @ columns[block]
        return _Cleared(columns, self, absorbed)


@dataclass(frozen=True, eq=False)
class _Cleared:
    """Columns with nuisance parameters projected out."""

    given: Columns
    nuisance: Nuisance
    absorbed: FloatArray  # their inner products with its axes, (f, k)

    @property
    def shape(self) -> tuple[int, ...]:
        return self.given.shape

    def __getitem__(self, some: slice | BoolArray) -> FloatArray:
        return np.asarray(self.given[some] - self.nuisance.axes[some] @ self.absorbed)


@dataclass(frozen=True, eq=False)
class _Over:
    """Columns whitened by a noise that is larger by a factor for each equation, (m,)."""

    given: Columns
    times: FloatArray

    @property
    def shape(self) -> tuple[int, ...]:
        return self.given.shape

    def __getitem__(self, some: slice | BoolArray) -> FloatArray:
        return np.asarray(self.given[some] / self.times[some, None])


@dataclass(frozen=True, eq=False)
class Explanation:
    """One form of one effect: the columns it can add to the prediction."""

    effect: str  # id of the effect; several explanations are forms of the same one
    form: str  # which form; together with the effect it names the explanation
    columns: Columns  # shape (m, k): whitened signature of each parameter times the parameter's usual size
    main: BoolArray  # shape (k,): parameters that make the effect; the others only shape it and do not stand alone
    # whether it may be named. Others are only fitted, and explain, such as the turning of joints under load
    cause: bool = True
    # a constant of which the form is one value; "" for a form that may be at work with any other of its effect
    one_of: str = ""
    bounds: FloatArray | None = None  # physically possible range of the coefficients, (k, 2); None: unbounded
    series: bool = False  # whether its parameters are terms of a series, enough of which add up to any curve

    @functools.cached_property
    def key(self) -> tuple[str, str]:
        """Effect and form."""
        return self.effect, self.form


@dataclass(frozen=True, eq=False)
class Workmanship:
    """Small errors of one kind that every machine has: fitted with all explanations, named where none explains."""

    effect: str  # id of the effect by which the same errors are named if nothing else is found
    columns: Columns  # shape (m, k), times the usual error of an unmeasured part
    most: float = math.inf  # known upper limit of the coefficients' standard deviation

    @property
    def key(self) -> tuple[str, str]:
        """Effect, and the form that stands for workmanship."""
        return self.effect, WORKMANSHIP_FORM


@dataclass(frozen=True, eq=False)
class Problem:
    """Residuals and all that may explain them, with the always free unknowns projected out of both."""

    residual: FloatArray  # shape (m,): measured minus predicted, divided by the noise
    nuisance: Nuisance  # what free unknowns explain
    workmanship: tuple[Workmanship, ...]  # its kinds
    explanations: tuple[Explanation, ...]  # forms of effects
    # sum of squares of the gap of the given model, in noise variances. The residual differs from that gap where causes
    # were put into the model and added to the residual again to first order
    given_squared: float = math.inf

    @classmethod
    def build(
        cls,
        residual: FloatArray,
        free: FloatArray,
        workmanship: Iterable[Workmanship],
        explanations: Iterable[Explanation],
    ) -> Problem:
        """Return the problem of a residual (m,) and columns (m, f) of free unknowns, which are fitted, never named."""
        nuisance = Nuisance.of(free)
        cleared = tuple(replace(b, columns=nuisance.clear(b.columns)) for b in workmanship)
        found = tuple(replace(e, columns=nuisance.clear(e.columns)) for e in explanations)
        return cls(nuisance.cleared(residual), nuisance, cleared, found)

    @property
    def given_size(self) -> float:
        """Root mean square of the gap of the given model, in noise standard deviations."""
        return math.sqrt(self.given_squared / len(self.residual))

    @functools.cached_property
    def known(self) -> frozenset[str]:
        """Ids of the effects that may be named."""
        return frozenset(item.effect for item in self.explanations if item.cause)

    @functools.cached_property
    def log_priors(self) -> dict[str, float]:
        """Log prior probability of one form of each effect, given the effect, in nats."""
        return log_priors_of_forms([item.effect for item in self.explanations])

    @property
    def _groups(self) -> list[Workmanship | Explanation]:
        return [*self.workmanship, *self.explanations]

    @functools.cached_property
    def gram(self) -> Gram:
        """Inner products of all columns and the residual."""
        return Gram.of([one.columns for one in self._groups], self.residual)

    @functools.cached_property
    def _places(self) -> dict[tuple[str, str], Indices]:
        ends = itertools.pairwise(np.cumsum([0, *(one.columns.shape[1] for one in self._groups)]).tolist())
        found = {one.key: np.arange(*own, dtype=np.intp) for one, own in zip(self._groups, ends, strict=True)}
        if len(found) < len(self._groups):
            keys = [one.key for one in self._groups]
            effect, form = next(key for key in keys if keys.count(key) > 1)
            raise BadInputError(
                f"effect '{effect}' has two forms '{form}'; name each once ('background' is workmanship)"
            )
        return found

    def places(self, item: Explanation | Workmanship) -> Indices:
        """Return the indices in :attr:`gram` of the columns of an explanation or of a kind of workmanship."""
        return self._places[item.key]

    def shown(self, item: Explanation) -> bool:
        """Return whether an explanation affects any equation."""
        return bool(self.gram.columns.diagonal()[self.places(item)].any())

    @functools.cached_property
    def shaping_units(self) -> dict[tuple[str, str], float]:
        """Unit of each explanation's shaping scale, by its key; see :func:`~.evidence.shaping_unit`."""
        every = [(item, self.places(item)) for item in self.explanations]
        return {item.key: shaping_unit(self.gram.columns[at[:, None], at], item.main) for item, at in every}

    @functools.cached_property
    def worked_out(self) -> dict[Hashable, Any]:
        """Cache of results that several hypotheses share."""
        return {}

    def of(self, kept: BoolArray) -> Problem:
        """Return the problem of some equations only, by a mask (m,)."""
        workmanship = [replace(b, columns=b.columns[kept]) for b in self.workmanship]
        found = [replace(e, columns=e.columns[kept]) for e in self.explanations]
        return Problem.build(self.residual[kept], self.nuisance.axes[kept], workmanship, found)

    def over(self, times: FloatArray) -> Problem:
        """Return the problem with the noise of each equation multiplied by its own factor, (m,)."""
        workmanship = [replace(b, columns=_Over(b.columns, times)) for b in self.workmanship]
        found = [replace(e, columns=_Over(e.columns, times)) for e in self.explanations]
        problem = Problem.build(self.residual / times, self.nuisance.axes / times[:, None], workmanship, found)
        return replace(problem, given_squared=self.given_squared)  # an upper bound

    def under(self, factor: float) -> Problem:
        """Return the problem with all noise multiplied by a factor: changes its gram and residual, not its columns."""
        problem = replace(self, residual=self.residual / factor, given_squared=self.given_squared / factor**2)
        vars(problem)["gram"] = self.gram.under(factor)
        return problem

    def and_also(self, items: Sequence[Explanation]) -> Problem:
        """Return the problem with more explanations."""
        return replace(self, explanations=(*self.explanations, *items))
