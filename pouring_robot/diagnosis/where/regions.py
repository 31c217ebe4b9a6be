"""In which part of the workspace the disagreement is largest: ranks of the rows' misfit, which no scale can upset."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pouring_robot.diagnosis.where.finding import REGION, Finding, size_text
from pouring_robot.diagnosis.where.ranks import larger
from pouring_robot.diagnosis.where.residuals import FreeResiduals
from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray

_FEWEST = 6
_LARGER = 1.3
_HEIGHTS = ("low", "at middle height", "high")
_TILTS = ("tilted back", "half tilted", "tilted far forward")


def regions(data: FreeResiduals, given: Conditions) -> list[Finding]:
    """Return all regions with enough rows, the most significant first.

    Each row counts with its sum of squares over what noise would make after the frames were fitted. The p-value is that
    of a one-sided Mann-Whitney test of a region's rows against the others; 1 if it is not larger by 30 %, too.
    """
    n = len(given)
    expected = np.bincount(data.row, 1.0 - (data.nuisance.axes**2).sum(axis=1), n)
    score = np.bincount(data.row, data.cleared**2, n) / np.maximum(expected, 1e-12)
    positions = ~data.turning
    squares = np.bincount(data.row[positions], ((data.cleared * data.sigma) ** 2)[positions], n)
    counts = np.bincount(data.row[positions], minlength=n)
    seen = expected > 1e-9
    found = []
    for words, inside in _parts(given):
        here, there = inside & seen, ~inside & seen
        if min(here.sum(), there.sum()) < _FEWEST or not (counts[here].any() and counts[there].any()):
            continue
        p_value = larger(score[here], score[there])
        inside_m, outside_m = (float(np.sqrt(squares[part].sum() / counts[part].sum())) for part in (here, there))
        sizes = f"{size_text(inside_m)} rms there, {size_text(outside_m)} elsewhere"
        sentence = f"Largest where the {given.causes.words.moved} is {words}: {sizes}."
        p_value = 1.0 if inside_m < _LARGER * outside_m else p_value
        found.append(Finding(REGION, sentence, inside_m, p_value, condition=words))
    return sorted(found, key=lambda finding: finding.p_value or 0.0)


def _parts(given: Conditions) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    x, y, z = given.position_m.T
    height, tilt = _third(z), None if given.tilt_rad is None else _third(given.tilt_rad)
    for k, high in enumerate(_HEIGHTS):
        if height is not None:
            yield high, height == k
        for j, tilted in enumerate(_TILTS):
            if height is not None and tilt is not None:
                yield f"{high} and {tilted}", (height == k) & (tilt == j)
    if tilt is not None:
        for j, tilted in enumerate(_TILTS):
            yield tilted, tilt == j
    for name, values in (("x", x), ("y", y)):
        if np.ptp(values) > 1e-6:
            yield f"at small {name}", values < np.median(values)
            yield f"at large {name}", values >= np.median(values)


def _third(values: FloatArray) -> NDArray[np.intp] | None:
    """Return 0, 1 or 2 by thirds of the rows; None where the value hardly varies."""
    if np.ptp(values) < 0.02:
        return None
    return np.asarray(np.searchsorted(np.quantile(values, [1.0 / 3.0, 2.0 / 3.0]), values))
