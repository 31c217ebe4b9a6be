"""What a diagnosis chooses from, for any model that predicts rows: nothing here knows the robot."""

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
"""What an effect's form is called in files where it is workmanship."""
_RANK = 1e-10
Value = TypeVar("Value")


def once(known: dict[Hashable, Any], what: Hashable, work: Callable[[], Value]) -> Value:
    """Return what is worked out once, and known from then on."""
    if what not in known:
        known[what] = work()
    found: Value = known[what]
    return found


@dataclass(frozen=True, eq=False)
class Nuisance:
    """What always free unknowns (frames, constants) can explain: taken out of everything before it is compared."""

    axes: FloatArray  # orthonormal, of the span of their columns, shape (m, f)

    @classmethod
    def of(cls, columns: FloatArray) -> Nuisance:
        """Return the span of columns (m, k) of any scales, without axes that rounding alone makes."""
        size = np.linalg.norm(columns, axis=0)
        axes, values, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
        return cls(axes[:, values > _RANK * values.max(initial=0.0)])

    @property
    def dof(self) -> int:
        """Degrees of freedom f that it takes up."""
        return int(self.axes.shape[1])

    def cleared(self, values: FloatArray) -> FloatArray:
        """Return vectors (m,) or (m, k) without what the nuisance parameters explain."""
        return np.asarray(values - self.axes @ (self.axes.T @ values))

    def clear(self, columns: Columns) -> Columns:
        """Return columns (m, k) without it, few equations in memory, of many when they are asked for."""
        some = list(chunks(len(self.axes)))
        if len(some) < 2:
            return self.cleared(columns[:])
        absorbed = np.zeros((self.dof, columns.shape[1]))
        for block in some:
            absorbed += self.axes[block].T @ columns[block]
        return _Cleared(columns, self, absorbed)


@dataclass(frozen=True, eq=False)
class _Cleared:
    """Columns without what nuisance parameters explain."""

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
    """Columns over a noise that is so many times as large in each equation, (m,)."""

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
    # whether it may be named. What is no cause is there to be fitted and to explain, such as joints that the load turns
    cause: bool = True
    # a constant of which the form is one value; "" for one that may be at work beside any of its effect
    one_of: str = ""
    bounds: FloatArray | None = None  # least and largest coefficient that nature allows, (k, 2); None: any is possible
    series: bool = False  # whether its parameters are terms of a series, enough of which add up to any course

    @functools.cached_property
    def key(self) -> tuple[str, str]:
        """Effect and form."""
        return self.effect, self.form


@dataclass(frozen=True, eq=False)
class Workmanship:
    """Small errors of one kind that every machine has: fitted beside all explanations, named where none explains."""

    effect: str  # id of the effect that the same errors are called when they are all there is
    columns: Columns  # shape (m, k), times the size of a part that nobody has measured
    most: float = math.inf  # known to be no larger than this, as a standard deviation of the coefficients

    @property
    def key(self) -> tuple[str, str]:
        """Effect and the form that workmanship is called by."""
        return self.effect, WORKMANSHIP_FORM


@dataclass(frozen=True, eq=False)
class Problem:
    """Residuals and all that may explain them, both without what the always free unknowns explain."""

    residual: FloatArray  # shape (m,): measured minus predicted over the noise
    nuisance: Nuisance  # what free unknowns explain
    workmanship: tuple[Workmanship, ...]  # its kinds
    explanations: tuple[Explanation, ...]  # forms of effects
    # squared size of the gap of the given model, in noise variances; where something was put in and, to first order,
    # given back, the residual is another
    given_squared: float = math.inf

    @classmethod
    def build(
        cls,
        residual: FloatArray,
        free: FloatArray,
        workmanship: Iterable[Workmanship],
        explanations: Iterable[Explanation],
    ) -> Problem:
        """Return the problem of a residual (m,) beside free unknowns, fitted and never named, by columns (m, f)."""
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
        """Log probability of a form of each effect, given the effect, in nats."""
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
        """Return which columns of :attr:`gram` are those of an explanation or of a kind of workmanship."""
        return self._places[item.key]

    def shown(self, item: Explanation) -> bool:
        """Return whether the equations show an explanation at all."""
        return bool(self.gram.columns.diagonal()[self.places(item)].any())

    @functools.cached_property
    def shaping_units(self) -> dict[tuple[str, str], float]:
        """Unit of each explanation's shaping scale, by its key; see :func:`~.evidence.shaping_unit`."""
        every = [(item, self.places(item)) for item in self.explanations]
        return {item.key: shaping_unit(self.gram.columns[at[:, None], at], item.main) for item, at in every}

    @functools.cached_property
    def worked_out(self) -> dict[Hashable, Any]:
        """What hypotheses worked out once for all that share it."""
        return {}

    def of(self, kept: BoolArray) -> Problem:
        """Return the problem of some equations alone, by a mask (m,)."""
        workmanship = [replace(b, columns=b.columns[kept]) for b in self.workmanship]
        found = [replace(e, columns=e.columns[kept]) for e in self.explanations]
        return Problem.build(self.residual[kept], self.nuisance.axes[kept], workmanship, found)

    def over(self, times: FloatArray) -> Problem:
        """Return the problem where the noise of each equation is so many times as large, (m,)."""
        workmanship = [replace(b, columns=_Over(b.columns, times)) for b in self.workmanship]
        found = [replace(e, columns=_Over(e.columns, times)) for e in self.explanations]
        problem = Problem.build(self.residual / times, self.nuisance.axes / times[:, None], workmanship, found)
        return replace(problem, given_squared=self.given_squared)  # at most

    def under(self, factor: float) -> Problem:
        """Return the problem where all noise is so many times as large: its gram and residual, not its columns."""
        problem = replace(self, residual=self.residual / factor, given_squared=self.given_squared / factor**2)
        vars(problem)["gram"] = self.gram.under(factor)
        return problem

    def and_also(self, items: Sequence[Explanation]) -> Problem:
        """Return the problem with more explanations."""
        return replace(self, explanations=(*self.explanations, *items))
