"""What to measure next: exposures that tell most about an effect that is undecided."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray

from .data import FocusRows
from .findings import Findings
from .model import constants, forms
from .unknown_noise import Key

_WIDE_UM = 1e6
"""Standard deviation of what is known of a parameter beforehand: nothing."""
_DRAWS, _SEED = 200, 5


@dataclass(frozen=True, eq=False)
class Plan:
    """Proposed exposures.

    Attributes:
        rows: the proposal, in the order chosen; their focus is NaN.
        nats: expected information about the effect's parameters.
        ordinary_nats: the same of as many exposures under conditions drawn from those of the rows, mean of draws.
        now: standard deviation of what the effect does between the extreme candidates, in µm, with the rows at hand.
        then: with the proposal measured.
        ordinary: with ordinary exposures instead, mean of the draws.
    """

    rows: FocusRows
    nats: float
    ordinary_nats: float
    now: float
    then: float
    ordinary: float


def with_conditions(rows: FocusRows, count: int, **given: FloatArray | float) -> FocusRows:
    """Return ``count`` rows to come, a day after the last, at the medians of all conditions not given; focus NaN."""
    table = {f.name: np.full(count, np.median(getattr(rows, f.name))) for f in fields(rows)}
    table |= {"focus_um": np.full(count, np.nan), "date": np.full(count, 99991231.0), "instrument": np.zeros(count)}
    table |= {name: np.broadcast_to(np.asarray(value, dtype=float), count) for name, value in given.items()}
    return FocusRows(**table)


def propose(found: Findings, key: Key, candidates: FocusRows, count: int, *, night_std_um: float) -> Plan:
    """Return the candidates, repeated where that is worth it, that tell most about an effect (greedy, D-optimal).

    Args:
        found: the diagnosis.
        key: the effect's form.
        candidates: what can be measured, the extremes first and last.
        count: how many exposures.
        night_std_um: standard deviation of an offset that all proposed exposures share: that of a night that is off.
    """
    columns = _columns(found, key, candidates)
    width = found.forms[key].columns.shape[1]
    start = len(found.rows)
    change = columns[-1, :width] - columns[start, :width]
    precision = columns[:start].T @ columns[:start] / found.noise_um**2 + np.eye(columns.shape[1]) / _WIDE_UM**2
    precision[-1, -1] = 1.0 / max(night_std_um, 1e-3) ** 2
    signs = columns[start:].copy()
    signs[:, -1] = 1.0
    chosen: list[int] = []
    grown = precision
    for _ in range(count):
        trials = [grown + np.outer(row, row) / found.noise_um**2 for row in signs]
        best = int(np.argmin([_log_det(trial, width) for trial in trials]))
        chosen.append(best)
        grown = trials[best]
    rng = np.random.default_rng(_SEED)
    ordinary = columns[:start].copy()
    ordinary[:, -1] = 1.0
    at_random = []
    for _ in range(_DRAWS):
        drawn = ordinary[rng.integers(start, size=count)]
        drawn[:, _night_places(found, key)] = 0.0
        at_random.append(precision + drawn.T @ drawn / found.noise_um**2)
    now = _log_det(precision, width)
    return Plan(
        candidates.only(np.array(chosen)),
        0.5 * (now - _log_det(grown, width)),
        0.5 * (now - float(np.mean([_log_det(p, width) for p in at_random]))),
        _std(precision, change),
        _std(grown, change),
        float(np.mean([_std(p, change) for p in at_random])),
    )


def _night_places(found: Findings, key: Key) -> list[int]:
    """Return which columns are offsets of past nights: a night to come has none of them."""
    place, places = found.forms[key].columns.shape[1], []
    for other in found.keys:
        if other in found.nights:
            places.append(place)
        place += found.forms[other].columns.shape[1]
    return places


def _columns(found: Findings, key: Key, candidates: FocusRows) -> FloatArray:
    """Return the columns of effect, what was found, constants and the common offset, for rows and candidates."""
    whole = FocusRows(
        **{
            f.name: np.concatenate([getattr(found.rows, f.name), getattr(candidates, f.name)])
            for f in fields(found.rows)
        }
    )
    known = forms(whole)
    parts = [known[k].columns for k in (key, *found.keys)]
    return np.hstack([*parts, constants(whole), np.zeros((len(whole), 1))])


def _log_det(precision: FloatArray, width: int) -> float:
    return float(np.linalg.slogdet(np.linalg.inv(precision)[:width, :width])[1])


def _std(precision: FloatArray, change: FloatArray) -> float:
    known = np.linalg.inv(precision)[: len(change), : len(change)]
    return float(np.sqrt(change @ known @ change))
