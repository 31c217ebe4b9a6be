"""Figures by which a diagnosis is judged in blind trials: rates with Wilson intervals, medians with their intervals."""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import quantile_test
from statsmodels.stats.proportion import proportion_confint

from pouring_robot.estimation.intervals import Z95
from tests.diagnosis.trial import STRONG, Trial
from tests.rig import LIBRARY

_ALIKE = 1e-3
_GAP = 1.5
"""Times the noise that a held-out gap must be for its closed share to say something."""


@dataclass(frozen=True)
class Figure:
    """One figure of the table.

    Attributes:
        name: what is counted.
        value: rate or median; NaN without a case.
        low: end of its 95 % interval.
        high: the other end.
        counts: behind it, in words.
        least: what it must reach; NaN where nothing is asked.
        aim: what it should reach.
        up: whether more is better.
        most: of a range, its upper end.
    """

    name: str
    value: float
    low: float
    high: float
    counts: str
    least: float = math.nan
    aim: float = math.nan
    up: bool = True
    most: float = math.nan

    @property
    def short(self) -> bool:
        """Whether it falls short of what it must reach; above a range only where chance does not explain it."""
        if not (math.isfinite(self.value) and math.isfinite(self.least)):
            return False
        beyond = math.isfinite(self.most) and self.low > self.most
        return beyond or (self.value < self.least if self.up else self.value > self.least)

    def cells(self) -> tuple[str, ...]:
        """Return it as cells of a table."""
        sign = "" if math.isfinite(self.most) else (">= " if self.up else "<= ")
        least = f"{sign}{_text(self.least)}" + (f" to {_text(self.most)}" if math.isfinite(self.most) else "")
        asked = least if math.isfinite(self.least) else "-"
        verdict = "short" if self.short else ("no case" if not math.isfinite(self.value) else "")
        interval = f"{_text(self.low)} to {_text(self.high)}" if math.isfinite(self.low) else "-"
        aim = _text(self.aim) if math.isfinite(self.aim) else "-"
        return (self.name, self.counts, _text(self.value), interval, asked, aim, verdict)


HEADINGS = ("figure", "cases", "value", "95 % interval", "at least", "aim", "")


def _text(value: float) -> str:
    return "-" if not math.isfinite(value) else f"{value:.3g}"


def rate(
    name: str, trials: Sequence[Trial], good: Callable[[Trial], bool], least: float = math.nan, aim: float = math.nan
) -> Figure:
    """Return the share of trials for which something holds."""
    count = sum(good(t) for t in trials)
    return _rate(name, count, len(trials), least, aim)


def _rate(
    name: str, count: int, total: int, least: float, aim: float, up: bool = True, most: float = math.nan
) -> Figure:
    if not total:
        return Figure(name, math.nan, math.nan, math.nan, "0", least, aim, up, most)
    low, high = proportion_confint(count, total, alpha=0.05, method="wilson")
    return Figure(name, count / total, float(low), float(high), f"{count} of {total}", least, aim, up, most)


def median(
    name: str, values: Sequence[float], least: float = math.nan, aim: float = math.nan, up: bool = True
) -> Figure:
    """Return the median with the interval that order statistics give."""
    known = np.array([v for v in values if math.isfinite(v)])
    if not known.size:
        return Figure(name, math.nan, math.nan, math.nan, "0", least, aim, up)
    interval = quantile_test(known, p=0.5).confidence_interval()
    return Figure(
        name, float(np.median(known)), float(interval.low), float(interval.high), f"{known.size}", least, aim, up
    )


def figures(trials: Sequence[Trial]) -> list[Figure]:
    """Return every figure: those that are asked first in each block, stricter and looser readings after them."""
    plain = [t for t in trials if not t.excluded]
    by: dict[str, list[Trial]] = defaultdict(list)
    for t in plain:
        by[t.kind].append(t)
    strong = [t for t in by["single"] if t.ratios[0] >= STRONG]
    weak = [t for t in by["single"] if 1.0 <= t.ratios[0] < STRONG]
    faint = [t for t in by["single"] if t.ratios[0] < 1.0]
    pairs, hardly = [t for t in by["pair"] if t.shows], [t for t in by["pair"] if not t.shows]
    outside, confounded = by["outside"], by["confounded"]
    excluded = [t for t in trials if t.excluded]
    gaps = [t for t in (*strong, *pairs) if t.gap[0] > _GAP * t.gap[2]]
    sizes = [t.unknown_size / t.ratios[0] for t in (*outside, *excluded) if t.unknown_size > 0.0]
    alarms = sum(not _silent(t) for t in by["null"])
    estimates = [e for t in plain if t.exact for e in t.estimates]
    worse = [t for t in by["null"] if t.worse > _ALIKE and not t.named]
    return [
        _rate("null: false alarm", alarms, len(by["null"]), 0.02, 0.0, up=False),
        rate("single >= 3x: named, nothing false besides", strong, lambda t: t.exact, 0.95, 0.99),
        rate("  of these, verdict 'named' (no alternatives)", strong, lambda t: t.exact and t.verdict == "named"),
        rate("single 1-3x: named or in its group", weak, lambda t: t.in_group, 0.80, 0.90),
        rate("  of these, named itself", weak, lambda t: t.exact),
        rate("single < 1x: named or in its group", faint, lambda t: t.in_group),
        rate("pairs: both named, nothing false besides", pairs, lambda t: t.exact, 0.85, 0.95),
        rate("  of these, both >= 3x", [t for t in pairs if min(t.ratios) >= STRONG], lambda t: t.exact),
        rate("  looser: each named or in its group", pairs, lambda t: t.in_group),
        rate("pairs, one below the noise: both named", hardly, lambda t: t.exact),
        rate("outside: unknown", outside, lambda t: t.verdict == "unknown", 0.90, 0.98),
        rate("--exclude the truth: unknown", excluded, lambda t: t.verdict == "unknown", 0.85, 0.95),
        rate("  a wrong neighbour named", excluded, lambda t: t.verdict in {"named", "group"}),
        median("what is unknown: size said over true, median", sizes),
        _rate("  within a half and twice", sum(0.5 <= s <= 2.0 for s in sizes), len(sizes), math.nan, math.nan),
        rate("confounded: a group that holds the truth", confounded, lambda t: t.grouped, 0.95, 1.0),
        rate("  looser: named or grouped, of what explains as well", confounded, lambda t: t.acceptable),
        median("held-out share closed, median", [t.closed for t in gaps], 0.95, 0.99),
        median("held-out after / floor, median", [t.gap[1] / t.gap[2] for t in gaps], 1.1, 1.03, up=False),
        median("  of the rotation", [t.turn_gap[1] / t.turn_gap[2] for t in gaps], up=False),
        _rate("null: held-out worse than before by 0.1 %", len(worse), len(by["null"]), 0.0, 0.0, up=False),
        _rate("95 % intervals cover", sum(abs(e.z) < Z95 for e in estimates), len(estimates), 0.90, 0.95, most=0.98),
        median("seconds for 200 rows, median", _seconds(trials), 20.0, 5.0, up=False),
        _slowest(_seconds(trials)),
    ]


def _seconds(trials: Sequence[Trial]) -> list[float]:
    """Return the time of every diagnosis, in proportion to the rows, for 200 of them."""
    return [t.seconds * 200.0 / t.rows for t in trials if t.rows]


def _slowest(seconds: Sequence[float]) -> Figure:
    return Figure("  of the slowest", max(seconds, default=math.nan), math.nan, math.nan, f"{len(seconds)}", up=False)


def failures(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials that do not do what the row of their kind counts."""
    return [t for t in trials if not _right(t)]


def _silent(t: Trial) -> bool:
    """Return whether nothing is named of a machine that lacks nothing, or only errors of workmanship that it has."""
    return t.verdict == "no_gap" or (t.verdict != "unknown" and bool(t.named) and t.named <= {*t.accept})


def _right(t: Trial) -> bool:
    if t.refused:
        return False
    if t.excluded or t.kind == "outside":
        return t.verdict == "unknown"
    if t.kind == "null":
        return _silent(t) and not (t.worse > _ALIKE and not t.named)
    if t.kind == "confounded":
        return t.grouped
    return t.in_group if t.kind == "single" and t.ratios[0] < STRONG else t.exact


def coverage(trials: Sequence[Trial]) -> list[tuple[str, ...]]:
    """Return for each parameter how many intervals cover, and the RMS error in standard deviations."""
    found: dict[tuple[str, str], list[float]] = defaultdict(list)
    for t in trials:
        if t.exact and not t.excluded:
            for e in t.estimates:
                found[e.effect, e.parameter].append(e.z)
    return [
        (effect, name, f"{sum(abs(z) < Z95 for z in zs)} of {len(zs)}", f"{np.sqrt(np.mean(np.square(zs))):.2f}")
        for (effect, name), zs in sorted(found.items())
    ]


_STATED = (0.0, 0.5, 0.9, 0.95, 0.98, 1.0)
_SIZES = (0.0, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, math.inf)


@dataclass(frozen=True)
class Share:
    """How many of the trials whose figure lies in a range did well.

    Attributes:
        low_end: of the range.
        high_end: the other.
        mean: of the figures of the range: arithmetic of probabilities, geometric of sizes; NaN without a trial.
        good: how many did well.
        total: of how many.
    """

    low_end: float
    high_end: float
    mean: float
    good: int
    total: int

    @property
    def figure(self) -> Figure:
        """The share with its interval."""
        return _rate(f"{self.low_end:g} to {self.high_end:g}", self.good, self.total, math.nan, math.nan)

    def cells(self) -> tuple[str, ...]:
        """Return it as cells of a table."""
        name, counts, *share = self.figure.cells()[:4]
        return (name, counts, f"{self.mean:.4g}" if self.total else "-", *share)


def reliability(trials: Sequence[Trial]) -> list[Share]:
    """Return how often a name stands that is stated with a probability, by ranges of it."""
    said = [(s.probability, t.stands(s)) for t in trials if t.verdict in {"named", "group"} for s in t.said]
    shares = []
    for low, high in itertools.pairwise(_STATED):
        there = [(chance, true) for chance, true in said if low < chance <= high]
        mean = float(np.mean([chance for chance, _ in there])) if there else math.nan
        shares.append(Share(low, high, mean, sum(true for _, true in there), len(there)))
    return shares


def power(trials: Sequence[Trial]) -> list[Share]:
    """Return how often the effect of a single one is named, alone or in its group, by its size over the noise."""
    single = [t for t in trials if t.kind == "single" and not t.excluded]
    shares = []
    for low, high in itertools.pairwise(_SIZES):
        there = [t for t in single if low <= t.ratios[0] < high]
        mean = math.exp(np.mean([math.log(t.ratios[0]) for t in there])) if there else math.nan
        shares.append(Share(low, high, mean, sum(t.in_group for t in there), len(there)))
    return shares


def confusion(trials: Sequence[Trial]) -> tuple[list[str], dict[str, Counter[str]]]:
    """Return columns, and for each true effect what was said of it.

    A trial counts once for each effect at work: under its own id where it is named, under ``unknown``, ``nothing``
    (no effect named) or ``missed`` (others named) where not; every false effect counts in its column, too.
    """
    matrix: dict[str, Counter[str]] = defaultdict(Counter)
    for t in trials:
        if t.excluded or not (t.shows or t.kind == "null"):
            continue
        for truth in t.hidden or ("(null)",):
            matrix[truth].update(_said_of(t, truth))
    columns = [*LIBRARY, "unknown", "nothing", "missed"]
    order = [*LIBRARY, *sorted(k for k in matrix if k not in LIBRARY)]
    return columns, {truth: matrix[truth] for truth in order if truth in matrix}


def _said_of(t: Trial, truth: str) -> list[str]:
    if t.verdict not in {"named", "group"}:
        return ["nothing" if t.verdict == "no_gap" else "unknown"]
    false = sorted(t.named - set(t.hidden))
    return false + ([truth] if truth in t.named else ["missed"])
