"""What conditions do, in short plain sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from pouring_robot.diagnosis.where.selection import Found, Selection
from pouring_robot.diagnosis.where.terms import POSE, Channel, FreeResiduals, Term
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.pouring.names import DRIVE_SYMBOLS, DRIVE_WORDS

_MONOTONE = 0.8
_MINOR = 0.25
_EXCLUDED = 0.4
_QUIET_P = 0.02
_WORTH_SAYING = ("load", "time", "melt temperature", "hall temperature", "platform temperature", "truss travel")
_DRIVES = dict(zip(DRIVE_SYMBOLS, DRIVE_WORDS, strict=True))


def size_text(size: float, turning: bool) -> str:
    """Return a size in m or rad as mm or mrad, two figures."""
    value = size / (MRAD if turning else MM)
    digits = 3 if abs(value) < 0.1 else 2 if abs(value) < 1.0 else 1
    return f"{value:.{digits}f} {'mrad' if turning else 'mm'}"


@dataclass(frozen=True, eq=False)
class Said:
    """A sentence on one condition.

    Attributes:
        text: the sentence.
        channel: where the condition does most.
        size: what it does there, in m or rad.
    """

    text: str
    channel: Channel
    size: float


@dataclass(frozen=True, eq=False)
class _Part:
    term: Term
    size: float
    values: FloatArray
    weight: float


def condition_sentence(
    data: FreeResiduals,
    selection: Selection,
    terms: Sequence[Term],
    found: Found,
    *,
    first: bool,
) -> Said:
    """Return what a condition does, largest part first.

    Args:
        data: the residuals.
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
    kept = list(largest.values())
    text = _sentence(found.condition, kept)
    if found.rivals:
        text += f", or with what went along with it: {', '.join(found.rivals)}"
    elif first:
        quiet = _quiet(selection, terms, parts[0])
        text += f", not with {_listed(quiet, 'or')}" if quiet else ""
    return Said(text + ".", parts[0].term.channel, parts[0].size)


def _part(found: Found, term: Term, coefficients: FloatArray, row: NDArray[np.intp]) -> _Part:
    """Return what a term does: the span of the middle 95 % of rows, or the root mean square where it goes by pose.

    Where a condition went along with others found before, its own course is badly known: then what counts is the
    part of the residual that it explains beside them.
    """
    values = term.course @ coefficients
    channel = term.channel
    squares = np.bincount(row, channel.column**2, len(values))
    along = channel.by_row @ found.part
    if term.by_pose:
        size = float(np.sqrt((along**2 / np.maximum(squares, 1e-300)).sum() / channel.weight))
    else:
        seen = along / np.maximum(squares, 1e-300)
        values = seen if _span(seen) < _span(values) else values
        size = _span(values)
    return _Part(term, size, values, float((along**2 / np.maximum(squares, 1e-300)).sum()))


def _span(values: FloatArray) -> float:
    low, high = np.quantile(values, [0.025, 0.975])
    return float(high - low)


def _sentence(condition: str, parts: Sequence[_Part]) -> str:
    main = parts[0]
    sizes = _listed([_named(part) for part in parts], "and")
    if condition == POSE:
        return f"Depends on the pose: {sizes}"
    if condition == "session":
        return f"Differs between sessions: {sizes}"
    kind, _, drive = condition.partition(" of ")
    where = _DRIVES.get(drive, "")
    if kind == "side":
        return f"Depends on the side from which {where} came: {sizes} between rising and falling"
    if kind == "turn":
        return f"Repeats with every turn of the screw of {where}: {sizes}"
    if kind in ("length", "angle"):
        return f"Depends on the {kind} of {where}: {sizes}"
    course = _direction(main)
    span = ""
    if main.term.by_pose:
        return f"Changes with {condition}, and by how much depends on the pose: {sizes}"
    if main.term.values is not None:
        low, high = np.quantile(main.term.values, [0.025, 0.975])
        span = f" from {low:.3g} to {high:.3g} {main.term.unit}".rstrip()
    return f"{course} with {condition}: {sizes}{span}"


def _named(part: _Part) -> str:
    channel = part.term.channel
    size = size_text(part.size, channel.turning) + (" rms" if part.term.by_pose else "")
    return f"{_DRIVES.get(channel.name, channel.name)} by {size}"


def _direction(part: _Part) -> str:
    """Return whether a part grows, falls or neither."""
    if part.term.values is None or np.ptp(part.values) == 0.0:
        return "Changes"
    rank = float(scipy.stats.spearmanr(part.term.values, part.values).statistic)
    return "Grows" if abs(rank) > _MONOTONE else "Goes up and down"


def _quiet(selection: Selection, terms: Sequence[Term], main: _Part) -> list[str]:
    """Return conditions of which the data exclude that they do a fair part of what the main one does.

    Beside everything found, the line of the condition in the same component has an estimate and a standard error;
    excluded is what lies beyond two of them.
    """
    found = []
    for name in _WORTH_SAYING:
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
