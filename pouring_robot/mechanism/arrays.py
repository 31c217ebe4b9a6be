"""Read-only arrays, checks of numbers, grids, runs and choices of rows, RMS, robust deviation."""

import copyreg
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pouring_robot.exceptions import BadInputError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Indices = NDArray[np.intp]
Number = TypeVar("Number", bound=np.generic)
_MAD_TO_SIGMA = 1.4826  # of normal values: one over their quantile of three quarters


def as_columns(found: FloatArray) -> FloatArray:
    """Return Pinocchio's twists as columns, (6, n): it returns a single one as a vector."""
    return np.asarray(np.reshape(found, (6, -1)))


def evenly_spaced(count: int, most: int) -> NDArray[np.intp]:
    """Return indices, ascending, that represent ``count`` items: all, or ``most`` of more, evenly spaced.

    The first item is included, and the last where two or more are returned.
    """
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


def runs(same: BoolArray, shortest: int) -> Iterator[Indices]:
    """Yield the rows of every run of ``shortest`` or more in which each step ``same[i]`` (row i to i+1) is set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    for start, end in edges.reshape(-1, 2):
        if end - start + 1 >= shortest:
            yield np.arange(start, end + 1)


def grid(*axes: ArrayLike) -> FloatArray:
    """Return all combinations of values along k axes, shape (n, k), the last axis fastest."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def real(values: Any) -> FloatArray:
    """Return a copy of real numbers as an array; TypeError or ValueError where numpy would drop information.

    That is an imaginary part, the origin of a time, or the names of fields.
    """
    given = np.asarray(values)
    if given.dtype.kind in "cmMV" or (given.dtype.kind == "O" and np.iscomplexobj(given.tolist())):
        raise TypeError
    return np.array(values, dtype=float)


def numbers(values: Any, shape: tuple[int | None, ...], demand: str) -> FloatArray:
    """Return a copy of numbers that a user gives as an array of a shape, or raise BadInputError(demand).

    None in the shape is any count; an empty list is a table without rows. Labels and masks would be ignored, so tables
    with named columns and masked values are refused.
    """
    if hasattr(values, "columns"):
        raise BadInputError(f"{demand}; a table's headings are not read: convert its columns and give to_numpy()")
    try:
        array = real(values)
    except (TypeError, ValueError):
        raise BadInputError(demand) from None
    if array.shape == (0,) and None in shape:
        array = array.reshape([size or 0 for size in shape])
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    if not fits or np.ma.is_masked(values):
        raise BadInputError(demand)
    return array


def finite(values: Any, shape: tuple[int | None, ...], demand: str) -> FloatArray:
    """Return :func:`numbers`, all of which must be finite."""
    array = numbers(values, shape, demand)
    if not np.isfinite(array).all():
        raise BadInputError(demand)
    return array


def rms(values: FloatArray) -> float:
    """Return the root mean square of the finite values; NaN if there are none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if known.size else float("nan")


def robust_sigma(values: FloatArray) -> float:
    """Return the standard deviation of zero-mean values by their median size, NaN left out; 0 without values."""
    kept = np.abs(values[np.isfinite(values)])
    if not kept.size:
        return 0.0
    middle = [(kept.size - 1) // 2, kept.size // 2]
    kept.partition(middle)  # np.median, which thousands of fits of a few rows would mostly wait for
    return float(_MAD_TO_SIGMA * kept[middle].mean())


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """Return the array itself, locked against writing."""
    array.flags.writeable = False
    return array


def locked(content: Mapping[Any, Any]) -> MappingProxyType[Any, Any]:
    """Return a mapping of the same content that cannot be written to."""
    return MappingProxyType(dict(content))


# Python itself neither pickles nor copies what results, which go from process to process, hold.
copyreg.pickle(MappingProxyType, lambda proxy: (locked, (dict(proxy),)))


def lock_arrays(result: Any) -> None:
    """Replace all arrays of a dataclass by read-only views; the arrays given stay writable for their owner."""
    for name, value in vars(result).items():
        if isinstance(value, np.ndarray):
            object.__setattr__(result, name, read_only(value.view()))


class ReadOnly:
    """Base of dataclasses whose arrays are locked when they are made."""

    def __post_init__(self) -> None:
        lock_arrays(self)
