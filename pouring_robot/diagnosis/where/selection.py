r"""Which terms the residuals ask for, one beside the other: forward steps, then every condition given all others.

A term of k columns A, acting along one channel, is tested beside the frames and the terms already found (orthonormal
columns U) by

.. math:: F = |P_{A|U}\, r|^2 / (k s^2), \qquad s^2 = \sum_i (a_i \cdot e_i)^2 / E_0 \sum_i (a_i \cdot e_i)^2

e is what is left beside term and U, a_i the channel's part in row i, E_0 the expectation under unit noise. The scale is
the channel's own and each row counts once: what is not understood in one component makes no other one significant, and
rows whose components err together do not count several times. With noise alone F has the F distribution of k and n less
the columns spent. The frames carry a part of every term over into other components; where what is left there is larger
than s, it counts instead. Holm's correction holds for dependent tests; with noise alone nothing is found with
probability 1 - alpha at least, as the first step already tests the whole family.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse
import scipy.special

from pouring_robot.diagnosis.where.terms import FreeResiduals, Term
from pouring_robot.inference.nuisance import Nuisance, basis
from pouring_robot.mechanism.arrays import FloatArray

_RANK = 1e-8
_FEWEST_FREEDOMS = 8
_MOST_CONDITIONS = 8
_RIVALS = 3


@dataclass(frozen=True, eq=False)
class Found:
    """A condition on which the residuals depend, beside all others found.

    Attributes:
        condition: its name.
        terms: places of the terms that carry it.
        p_values: of each term given everything else found, corrected for all tests.
        rivals: conditions that would explain the same in its stead.
        share: of the residual's sum of squares, what it explains beside those found before it.
        part: that part of the residual, (m,).
        coefficients: of its terms beside those found before it, (k,) each, in the channels' units.
    """

    condition: str
    terms: tuple[int, ...]
    p_values: tuple[float, ...]
    rivals: tuple[str, ...]
    share: float = 0.0
    part: FloatArray = field(default_factory=lambda: np.zeros(0))
    coefficients: tuple[FloatArray, ...] = ()


@dataclass(frozen=True, eq=False)
class Selection:
    """What was found.

    Attributes:
        found: largest share first.
        residual: what is left of it, (m,).
        fitted: number of columns fitted, frames included.
        p_values: of all terms beside what was found, not corrected.
        bounds: what the line of each term may at most do between its extremes beside all that was found, in the
            channel's unit: two standard errors beyond the estimate. Infinite where the data cannot say.
    """

    found: tuple[Found, ...]
    residual: FloatArray
    fitted: int
    p_values: FloatArray
    bounds: FloatArray


def select(data: FreeResiduals, terms: Sequence[Term], alpha: float) -> Selection:
    """Return the conditions on which residuals depend.

    Args:
        data: the residuals.
        terms: of all conditions.
        alpha: probability of finding anything where there is nothing but noise.
    """
    tests = _Tests(data, terms)
    chosen: dict[str, tuple[int, ...]] = {}
    while len(chosen) < _MOST_CONDITIONS:
        significant = tests.significant(_flat(chosen.values()), alpha)
        if not significant:
            break
        condition = terms[significant[0]].condition
        more = tuple(k for k in significant if terms[k].kind == terms[significant[0]].kind)
        chosen[condition] = (*chosen.get(condition, ()), *more)
    found = []
    for condition in list(chosen):
        entry = tests.given_others(condition, chosen, alpha)
        if entry is None:
            del chosen[condition]
        else:
            found.append(entry)
    found = sorted(tests.shared_out(found), key=lambda item: -item.share)
    places = _flat(item.terms for item in found)
    final = tests.beside(places)
    return Selection(
        found=tuple(found),
        residual=final.residual,
        fitted=final.axes.shape[1],
        p_values=final.p_values,
        bounds=tests.bounds(final),
    )


def _flat(groups: Iterable[tuple[int, ...]]) -> tuple[int, ...]:
    return tuple(k for group in groups for k in group)


@dataclass(frozen=True, eq=False)
class _State:
    """What is left beside some terms.

    Attributes:
        axes: orthonormal columns of frames and terms fitted, (m, u).
        columns: all terms' columns without those, (m, K).
        residual: the same of the residual, (m,).
        p_values: of every term beside those, (T,).
    """

    axes: FloatArray
    columns: FloatArray
    residual: FloatArray
    p_values: FloatArray


class _Tests:
    """The family of tests of one campaign."""

    def __init__(self, data: FreeResiduals, terms: Sequence[Term]) -> None:
        """Whiten the terms' columns and take out what the frames absorb."""
        self.data, self.terms = data, terms
        parts = [term.channel.column[:, None] * term.course[data.row] for term in terms]
        whole = np.hstack([np.zeros((data.residual.size, 0)), *parts])
        self._norms = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
        self._columns = data.nuisance.cleared(whole / self._norms)
        ends = np.cumsum([0, *(term.course.shape[1] for term in terms)])
        counts = (np.ones(data.row.size), (data.row, np.arange(data.row.size)))
        self._rows = scipy.sparse.csr_array(counts)
        self._places = [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]

    def _of(self, chosen: Sequence[int]) -> list[int]:
        return [j for k in chosen for j in range(self._places[k].start, self._places[k].stop)]

    def beside(self, chosen: Sequence[int], only: Sequence[int] | None = None) -> _State:
        """Return what is left beside terms, and how significant others are there: all, or only some."""
        new = Nuisance(basis(self._columns[:, self._of(chosen)], np.sqrt(_RANK)))
        residual = new.cleared(self.data.cleared)
        tried = sorted(set(range(len(self.terms)) if only is None else only) - set(chosen))
        places = self._of(tried)
        columns = np.zeros_like(self._columns)
        columns[:, places] = new.cleared(self._columns[:, places])
        state = _State(np.hstack([self.data.nuisance.axes, new.axes]), columns, residual, np.ones(0))
        scales: dict[int, tuple[FloatArray, float]] = {}
        p_values = np.ones(len(self.terms))
        for k in tried:
            p_values[k] = self._p_value(state, k, scales)
        return replace(state, p_values=p_values)

    def _p_value(self, state: _State, k: int, known: dict[int, tuple[FloatArray, float]]) -> float:
        channel = self.terms[k].channel
        if id(channel) not in known:
            used = float(((channel.by_row @ state.axes) ** 2).sum())
            known[id(channel)] = channel.by_row @ state.residual, channel.weight - used
        by_row, expected = known[id(channel)]
        columns = state.columns[:, self._places[k]]
        squared, turned = np.linalg.eigh(columns.T @ columns)
        kept = squared > _RANK
        if not kept.any():
            return 1.0
        axes = columns @ (turned[:, kept] / np.sqrt(squared[kept]))
        projected = axes.T @ state.residual
        part = channel.by_row @ axes
        expected -= float((part**2).sum())
        gain, count = float(projected @ projected), projected.size
        freedoms = channel.rows * expected / channel.weight
        if freedoms < _FEWEST_FREEDOMS:
            return self.data.excess(gain, count) if self.data.noise_known else 1.0
        scale = float(((by_row - part @ projected) ** 2).sum()) / expected
        left = state.residual - axes @ projected
        reached = float(((self._rows @ (axes * left[:, None])) ** 2).sum()) / count
        scale = max(scale, reached, 1e-300)
        return float(scipy.special.fdtrc(count, freedoms, gain / count / scale))

    def significant(self, chosen: Sequence[int], alpha: float) -> list[int]:
        """Return the terms that count beside those chosen, most significant first."""
        p_values = self.beside(chosen).p_values
        corrected = holm(p_values)
        return [k for k in np.argsort(p_values, kind="stable").tolist() if corrected[k] < alpha]

    def given_others(self, condition: str, chosen: Mapping[str, tuple[int, ...]], alpha: float) -> Found | None:
        """Return a condition chosen as it stands beside all others; None if they explain what it did."""
        others = _flat(terms for name, terms in chosen.items() if name != condition)
        without = self.beside(others)
        corrected = holm(without.p_values)
        terms = tuple(k for k in chosen[condition] if corrected[k] < alpha)
        if not terms:
            return None
        tried: dict[str, tuple[int, ...]] = {}  # conditions not chosen that count without this one
        for k in np.argsort(corrected, kind="stable").tolist():
            name = self.terms[k].condition
            if corrected[k] < alpha and name not in chosen:
                tried[name] = (*tried.get(name, ()), k)
        rivals = []
        for rival, places in list(tried.items())[:_RIVALS]:
            beside = self.beside((*others, *places), terms).p_values[list(terms)]
            if (len(self.terms) * beside >= alpha).all():
                rivals.append(rival)
        return Found(condition, terms, tuple(float(corrected[k]) for k in terms), tuple(rivals))

    def bounds(self, state: _State) -> FloatArray:
        """Return what the first column of every term may at most do beside a state, see :class:`Selection`."""
        spare = max(state.residual.size - state.axes.shape[1], 1)
        scale = float(np.sqrt(state.residual @ state.residual / spare))
        found = np.full(len(self.terms), np.inf)
        for k, term in enumerate(self.terms):
            place = self._places[k].start
            column = state.columns[:, place]
            size = float(np.linalg.norm(column))
            if size**2 > _RANK:
                largest = abs(float(column @ state.residual)) / size + 2.0 * scale
                found[k] = largest / size / self._norms[place] * float(np.ptp(term.course[:, 0]))
        return found

    def shared_out(self, found: Sequence[Found]) -> list[Found]:
        """Return conditions with what each explains beside those before it, in the order in which they were found.

        So shares never cancel, as those of conditions that go along with each other would if all were fitted at once.
        """
        chosen: tuple[int, ...] = ()
        before = self.data.cleared
        out: list[Found] = []
        for item in found:
            chosen = (*chosen, *item.terms)
            places = self._of(chosen)
            columns = self._columns[:, places]
            values = np.asarray(np.linalg.lstsq(columns, self.data.cleared, rcond=np.sqrt(_RANK))[0], dtype=np.float64)
            left = self.data.cleared - columns @ values
            part, before = before - left, left
            values = values / self._norms[places]
            ends = np.cumsum([0, *(self.terms[k].course.shape[1] for k in chosen)])
            own = range(len(chosen) - len(item.terms), len(chosen))
            coefficients = tuple(np.asarray(values[ends[k] : ends[k + 1]]) for k in own)
            out.append(replace(item, part=part, coefficients=coefficients))
        total = float(self.data.cleared @ self.data.cleared)
        return [replace(item, share=float((item.part**2).sum()) / total) for item in out]


def holm(p_values: FloatArray) -> FloatArray:
    """Return p-values (k,) corrected by Holm's step-down rule, which no dependence between tests upsets.

    The same as statsmodels' ``multipletests``, which collects garbage at every call: most of a diagnosis' time.
    """
    order = np.argsort(p_values, kind="stable")
    stepped = np.maximum.accumulate(p_values[order] * np.arange(p_values.size, 0, -1))
    corrected = np.empty(p_values.size)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected
