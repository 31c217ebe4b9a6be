"""Whole blocks of rows to hold out of a fit: by session, by time, by region of the workspace.

Neighbouring rows share their errors, so random rows held out would flatter a fit; whole blocks do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pouring_robot.mechanism.arrays import FloatArray

BlockKind = Literal["session", "time", "region"]
Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Block:
    """Rows that belong together.

    Attributes:
        kind: how they belong together.
        name: says which block it is.
        rows: indices of the rows, ascending, read-only.
    """

    kind: BlockKind
    name: str
    rows: Rows


def _block(kind: BlockKind, name: str, rows: Rows) -> Block:
    ordered = np.sort(rows)
    ordered.flags.writeable = False
    return Block(kind, name, ordered)


def session_blocks(rows: Rows, sessions: Sequence[str]) -> tuple[Block, ...]:
    """Return one block a session, in order of appearance; ``sessions`` has one entry for every row of the campaign."""
    members: dict[str, list[int]] = {}
    for row in rows:
        members.setdefault(sessions[row], []).append(int(row))
    return tuple(
        _block("session", f"session {name}", np.array(chosen, dtype=np.intp)) for name, chosen in members.items()
    )


def time_blocks(rows: Rows, time_s: FloatArray | None, count: int) -> tuple[Block, ...]:
    """Return stretches of nearly equal row count in order of time, (n,) in s; rows without time keep their place."""
    if rows.size == 0:
        return ()
    times = np.arange(rows.max() + 1, dtype=float) if time_s is None or np.isnan(time_s[rows]).any() else time_s
    ordered = rows[np.argsort(times[rows], kind="stable")]
    parts = np.array_split(ordered, min(count, ordered.size))
    return tuple(_block("time", f"stretch {i} of {len(parts)}", part) for i, part in enumerate(parts, start=1))


def region_blocks(rows: Rows, drives: FloatArray, count: int) -> tuple[Block, ...]:
    """Return neighbours in drive space by halving the widest block again and again.

    Args:
        rows: rows to part.
        drives: (n, 4) in m and rad; each is scaled by its spread over the rows.
        count: number of blocks wanted.
    """
    if rows.size == 0:
        return ()
    spread = drives[rows].std(axis=0)
    scaled = drives / np.where(spread > 0.0, spread, 1.0)
    done: list[Rows] = []
    open_blocks = [rows]
    while open_blocks and len(done) + len(open_blocks) < count:
        largest = max(range(len(open_blocks)), key=lambda i: open_blocks[i].size)
        block = open_blocks.pop(largest)
        halves = _halve(block, scaled)
        if halves is None:
            done.append(block)
        else:
            open_blocks.extend(halves)
    blocks = sorted([*done, *open_blocks], key=lambda block: int(block.min()))
    return tuple(_block("region", f"region {i} of {len(blocks)}", block) for i, block in enumerate(blocks, start=1))


def _halve(rows: Rows, scaled: FloatArray) -> tuple[Rows, Rows] | None:
    """Split at the median of the widest drive; equal values stay together. None: all rows are the same pose."""
    for axis in np.argsort(-np.ptp(scaled[rows], axis=0), kind="stable"):
        values = scaled[rows, axis]
        # Repeats of a pose are commanded alike up to the file's last digit.
        steps = np.unique(np.round(values, 6))
        if steps.size < 2:
            return None
        cuts = 0.5 * (steps[1:] + steps[:-1])
        below = np.array([(values < cut).sum() for cut in cuts])
        cut = cuts[int(np.argmin(np.abs(below - 0.5 * rows.size)))]
        return rows[values < cut], rows[values >= cut]
    return None
