"""Arrays that are handed out and must not change under their reader's hands, even choices of many rows, their RMS."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Number = TypeVar("Number", bound=np.generic)


def evenly(count: int, most: int) -> NDArray[np.intp]:
    """Return which of so many things stand for all, ascending: every one, or ``most`` of more, evenly spread.

    The first is among them, and the last where there are two.
    """
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


def rms(values: FloatArray) -> float:
    """Return the root mean square of those values that are known; NaN where none is."""
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if known.size else float("nan")


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """Return the array itself, locked against writing."""
    array.flags.writeable = False
    return array


def lock_fields(result: Any, *names: str) -> None:
    """Put read-only views in place of the named arrays of a frozen dataclass; call it from ``__post_init__``.

    The arrays that were given stay writable for their owner.
    """
    for name in names:
        object.__setattr__(result, name, read_only(getattr(result, name).view()))
