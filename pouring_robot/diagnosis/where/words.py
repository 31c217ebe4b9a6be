"""What conditions do, in short plain sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from pouring_robot.diagnosis.where.finding import CONDITION, Finding, size_text
from pouring_robot.diagnosis.where.selection import Found, Selection
from pouring_robot.diagnosis.where.terms import POSE, FreeResiduals, Term
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.facts import facts_of, numbers
from pouring_robot.mechanism.arrays import FloatArray

_MONOTONE = 0.8
_MINOR = 0.25
_EXCLUDED = 0.4
_QUIET_P = 0.02


@dataclass(frozen=True, eq=False)
class _Part:
    term: Term
    size: float
    values: FloatArray
    weight: float


def condition_finding(
    data: FreeResiduals,
    given: Conditions,
    selection: Selection,
    terms: Sequence[Term],
    found: Found,
    *,
    first: bool,
) -> Finding:
    """Return what a condition does, largest part first.

    Args:
        data: the residuals.
        given: the conditions.
        selection: all that was found.
        terms: of the whole family.
        found: the condition.
        first: whether it explains most; then it is also said what the disagreement does not depend on.
    """
    parts = [
        _part(found, terms[k], values, data.row) for k, values in zip(found.terms, found.coefficients, strict=True)
    ]
    parts.sort(key=lambda part: -part.weight)
    largest: dict[str, _Part] = {}
    for part in parts:
        if part.weight > _MINOR**2 * parts[0].weight:
            largest.setdefault(part.term.channel.name, part)
    words = {drive.symbol: drive.words for drive in given.robot.drives}
    text = _sentence(found.condition, list(largest.values()), words)
    if found.rivals:
        text += f", or with what went along with it: {', '.join(found.rivals)}"
    elif first:
        quiet = _quiet(given, selection, terms, parts[0])
        text += f", not with {_listed(quiet, 'or')}" if quiet else ""
    return Finding(
        CONDITION,
        f"{text}.",
        parts[0].size,
        min(2.0 * min(found.p_values), 1.0),
        parts[0].term.channel.name,
        parts[0].term.channel.turning,
        found.condition,
        found.rivals,
        found.share,
    )


def _part(found: Found, term: Term, coefficients: FloatArray, row: NDArray[np.intp]) -> _Part:
    """Return what a term does: the span of the middle 95 % of rows, or the root mean square where it goes by pose.

    Where a condition went along with others found before, its own course is badly known: then what counts is the
    part of the residual that it explains beside them.
    """
    values = term.course @ coefficients
    channel = term.channel
    squares = np.maximum(np.bincount(row, channel.column**2, len(values)), 1e-300)
    along = channel.by_row @ found.part
    weight = float((along**2 / squares).sum())
    if term.by_pose:
        return _Part(term, float(np.sqrt(weight / channel.weight)), values, weight)
    values = min(values, along / squares, key=_span)
    return _Part(term, _span(values), values, weight)


def _span(values: FloatArray) -> float:
    low, high = np.quantile(values, [0.025, 0.975])
    return float(high - low)


def _sentence(condition: str, parts: Sequence[_Part], words: Mapping[str, str]) -> str:
    main = parts[0]
    sizes = _listed([_named(part) for part in parts], "and")
    if condition == POSE:
        return f"Depends on the pose: {sizes}"
    if condition == "session":
        return f"Differs between sessions: {sizes}"
    kind, _, drive = condition.partition(" of ")
    where = words.get(drive, "")
    if where and kind == "side":
        return f"Depends on the side from which {where} came: {sizes} between rising and falling"
    if where and kind == "turn":
        return f"Repeats with every turn of the screw of {where}: {sizes}"
    if where and kind in ("length", "angle"):
        return f"Depends on the {kind} of {where}: {sizes}"
    if main.term.by_pose:
        return f"Changes with {condition}, and by how much depends on the pose: {sizes}"
    course, span = "Changes", ""
    if main.term.values is not None:
        low, high = np.quantile(main.term.values, [0.025, 0.975])
        span = f" from {low:.3g} to {high:.3g} {main.term.unit}".rstrip()
        if np.ptp(main.values) > 0.0:
            rank = float(scipy.stats.spearmanr(main.term.values, main.values).statistic)
            course = "Grows" if abs(rank) > _MONOTONE else "Goes up and down"
    return f"{course} with {condition}: {sizes}{span}"


def _named(part: _Part) -> str:
    channel = part.term.channel
    size = size_text(part.size, channel.turning) + (" rms" if part.term.by_pose else "")
    return f"{channel.words} by {size}"


def _quiet(given: Conditions, selection: Selection, terms: Sequence[Term], main: _Part) -> list[str]:
    """Return conditions of which the data exclude that they do a fair part of what the main one does.

    Beside everything found, the line of the condition in the same component has an estimate and a standard error;
    excluded is what lies beyond two of them.
    """
    load, *rises = numbers(given)
    travels = (f"{travel}_m" for travel in given.robot.travels)
    found = []
    for name in (facts_of(n, given.robot).word for n in (load, "time_s", *rises, *travels)):
        if name in {item.condition for item in selection.found}:
            continue
        places = [k for k, term in enumerate(terms) if term.condition == name]
        if not places or min(selection.p_values[places]) < _QUIET_P / len(places):
            continue
        bound = [selection.bounds[k] for k in places if terms[k].channel is main.term.channel]
        if not bound:
            bound = [selection.bounds[k] for k in places if not terms[k].channel.turning]
        if bound and max(bound) < _EXCLUDED * main.size:
            found.append(name)
    return found


def _listed(words: Sequence[str], last: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else ""
