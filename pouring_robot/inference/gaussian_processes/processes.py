"""Random functions of conditions: what moves, as which function, and inner products that rarely form columns.

A column of a process is a channel of each equation times a function ("course") of each row. All inner products are sums
over rows, so that their cost is linear in the rows. Columns are formed only where an equation has several rows, such as
a distance between two. Nothing here knows the robot.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from pouring_robot.mechanism.arrays import FloatArray

CHANCE, CONSTANT = "row, by chance", "a constant"
"""The condition of a process that differs independently from row to row."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Change of the whitened prediction by one m or rad in every row."""

    name: str  # of what moves, in words
    column: FloatArray  # shape (m,)
    # row of each equation, or the share of each row in it, as a matrix (n, m) that sums equations by row
    rows: scipy.sparse.csr_array
    turning: bool = False  # whether its unit is rad

    @functools.cached_property
    def shared(self) -> bool:
        """Whether some equations have several rows."""
        return bool(self.rows.nnz > len(self.column))

    @functools.cached_property
    def _weighted(self) -> scipy.sparse.csr_array:
        sums = self.rows
        return scipy.sparse.csr_array((sums.data * self.column[sums.indices], sums.indices, sums.indptr), sums.shape)

    def over(self, times: FloatArray) -> Channel:
        """Return the same with the noise of each equation multiplied by its own factor, (m,)."""
        return replace(self, column=self.column / times)

    def against(self, values: FloatArray) -> FloatArray:
        """Return the inner products with values (m, q), row by row: shape (n, q)."""
        return np.asarray(self._weighted @ values)


def sums_of(row: NDArray[np.intp], count: int) -> scipy.sparse.csr_array:
    """Return the matrix that sums equations (m,) by row, for ``count`` rows."""
    places = (row, np.arange(len(row)))
    return scipy.sparse.csr_array((np.ones(len(row)), places), shape=(count, len(row)))


@dataclass(frozen=True, eq=False)
class Part:
    """One channel that follows one course."""

    channel: Channel  # what moves
    # (n, k), dense or sparse: with independent coefficients of standard deviation 1, the usual movement in m or rad
    course: Any

    @property
    def rms(self) -> float:
        """Usual size of the movement, root mean square over the rows, in m or rad."""
        return float(np.sqrt((self.course**2).sum() / self.course.shape[0]))

    def variances(self, covariance: FloatArray) -> FloatArray:
        """Return the variances of its movement in each row, (n,), for a covariance (k, k) of the coefficients."""
        if scipy.sparse.issparse(self.course):
            return np.asarray(self.course**2 @ np.diag(covariance))  # each column is one row's own error
        spread = np.einsum("nk,kl,nl->n", self.course, covariance, self.course, optimize=True)
        return np.asarray(np.maximum(spread, 0.0))


@dataclass(frozen=True, eq=False)
class Process:
    """A random function by which something unknown moves a place."""

    where: str  # what is moved, in words: ``readings``, ``drives`` …
    by: str  # what it depends on, in words
    lengths: dict[str, tuple[Part, ...]]  # its parts for each length scale, by the scale in words
    # effects that are as general and describe the same: it is no alternative to them
    same_as: frozenset[str] = frozenset()

    @classmethod
    def of_columns(cls, where: str, by: str, columns: FloatArray) -> Process:
        """Return the process of columns (m, k), each equation a row of its own."""
        count = len(columns)
        every = Channel(where, np.ones(count), sums_of(np.arange(count), count))
        return cls(where, by, {"": (Part(every, columns),)})

    def with_channels(self, channel: Callable[[Channel], Channel]) -> Process:
        """Return the same with each channel replaced."""
        lengths = {
            words: tuple(replace(part, channel=channel(part.channel)) for part in parts)
            for words, parts in self.lengths.items()
        }
        return replace(self, lengths=lengths)

    @property
    def name(self) -> str:
        """Its name: what moves, and by which condition."""
        return f"{self.where} by {self.by}"

    @property
    def words(self) -> str:
        """What moves and by which condition, as in reports."""
        if self.by == CONSTANT:
            return f"constant error of {self.where}"
        return f"{self.where}, different in every row" if self.by == CHANCE else f"{self.where} depending on {self.by}"

    @property
    def seen(self) -> bool:
        """Whether the measurements can show it at all."""
        return any(part.channel.column.any() and part.rms > 0.0 for part in next(iter(self.lengths.values())))


def columns_of(parts: Sequence[Part]) -> FloatArray:
    """Return the whitened columns of parts, shape (m, k)."""
    found = [part.channel.column[:, None] * (part.channel.rows.T @ _dense(part.course)) for part in parts]
    return np.hstack(found)


def _dense(course: Any) -> FloatArray:
    return np.asarray(course.toarray() if scipy.sparse.issparse(course) else course)


def between(one: Sequence[Part], other: Sequence[Part]) -> FloatArray:
    """Return the inner products of two sets of columns, (k, l)."""
    if any(part.channel.shared for part in (*one, *other)):
        return np.asarray(columns_of(one).T @ columns_of(other))
    columns = np.column_stack([second.channel.column for second in other])
    return np.vstack([_blocks(first, other, first.channel.against(columns)) for first in one])


def _blocks(first: Part, other: Sequence[Part], weights: FloatArray) -> FloatArray:
    """Return the inner products of a part's columns with those of others; weights (n, parts) are their channels'."""
    pairs = zip(other, weights.T[:, :, None], strict=True)
    return np.hstack([_dense(first.course.T @ (second.course * weight)) for second, weight in pairs])
