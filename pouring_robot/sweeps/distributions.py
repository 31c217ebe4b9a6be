"""How errors of a sweep are distributed: the sizes that say it, and the error that belongs to a normal deviate."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.special

from pouring_robot.mechanism.arrays import FloatArray

NORMAL_TOLERANCE_SIGMAS = 3.0
"""The tolerance that belongs to an untruncated normal distribution, in standard deviations."""


@dataclass(frozen=True)
class Margin:
    """Distribution of one error about zero, in its own unit."""

    # largest error (half width, or where a normal is cut off); of an untruncated normal, three standard deviations
    tolerance: float
    std: float  # standard deviation, after truncation
    from_deviates: Callable[[FloatArray], FloatArray]  # errors for standard normal deviates of any shape


def _uniform(half_width: float) -> Margin:
    return Margin(half_width, half_width / np.sqrt(3.0), functools.partial(_evenly, half_width))


def _normal(std: float) -> Margin:
    return Margin(NORMAL_TOLERANCE_SIGMAS * std, std, functools.partial(np.multiply, std))


def _truncated(std: float, limit: float) -> Margin:
    cut = limit / std
    inside = scipy.special.erf(cut / np.sqrt(2.0))
    # The second moment within the cut over the share within it: of positive terms, so that a short cut loses no digits.
    variance = scipy.special.gammainc(1.5, 0.5 * cut**2) / inside
    return Margin(limit, std * float(np.sqrt(variance)), functools.partial(_within, std, inside))


def _evenly(half_width: float, deviates: FloatArray) -> FloatArray:
    return np.asarray(half_width * scipy.special.erf(deviates / np.sqrt(2.0)))


def _within(std: float, inside: float, deviates: FloatArray) -> FloatArray:
    # erf keeps small deviates exact, where 1 - ndtr would round them.
    return np.asarray(std * np.sqrt(2.0) * scipy.special.erfinv(_evenly(inside, deviates)))


DISTRIBUTIONS: dict[str, tuple[tuple[str, ...], Callable[..., Margin]]] = {
    "uniform": (("half_width",), _uniform),
    "normal": (("std",), _normal),
    "truncated_normal": (("std", "limit"), _truncated),
}
"""What each is made of: its sizes, first how wide it is, which it needs in the unit of every parameter."""
