"""Whole blocks held out: one for the test, looked at once at the end; the others validate each other in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.data import Campaign
from pouring_robot.estimation.frames import FEWEST_ROWS
from pouring_robot.exceptions import BadInputError, CalibrationError
from pouring_robot.mechanism.arrays import FloatArray

BlockKind = Literal["session", "time", "region"]
HoldOut = Literal["auto", "session", "time", "region"]
Rows = NDArray[np.intp]
BLOCKS = 5
WORSE = 1.02
"""A held-out error this many times that before is worse; less is chance."""
_FEWEST_SESSIONS, _FEWEST_TRAIN, _FEWEST_TEST = 4, 12, 3


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


@dataclass(frozen=True, eq=False)
class Split:
    """Which rows serve for what.

    Attributes:
        kind: how rows belong together.
        test: rows of the test block: no fit and no choice of groups sees them; they may refuse the whole.
        test_name: the block's name.
        folds: blocks of the other rows; each validates what the others are fitted to.
    """

    kind: BlockKind
    test: Rows
    test_name: str
    folds: tuple[Rows, ...]

    @property
    def train(self) -> Rows:
        """All rows but the test block, ascending."""
        return np.sort(np.concatenate(self.folds))

    @property
    def validations(self) -> tuple[tuple[Rows, Rows], ...]:
        """Rows to fit and rows to judge that fit by, in turn.

        Regions: each fold by all others. Sessions and stretches of time: each by those before it, as the test block
        is; what drifts would otherwise be interpolated here and extrapolated there.
        """
        pairs = []
        for k, fold in enumerate(self.folds):
            others = self.folds[:k] if self.kind != "region" else (*self.folds[:k], *self.folds[k + 1 :])
            if sum(rows.size for rows in others) >= FEWEST_ROWS:
                pairs.append((np.sort(np.concatenate(others)), fold))
        return tuple(pairs)


def split(campaign: Campaign, left_out: Rows, hold_out: HoldOut = "auto") -> Split:
    """Split a campaign; what was measured plays no part in it.

    The test block is the last one: the last session or stretch of time, or the region whose first row comes last.

    Args:
        campaign: the data.
        left_out: rows that no fit should use, such as outliers.
        hold_out: kind of block; ``auto``: sessions where there are four or more, else regions of the workspace.

    Raises:
        CalibrationError: there are too few rows.
    """
    kind: BlockKind
    if hold_out == "auto":
        kind = "session" if len(set(campaign.sessions)) >= _FEWEST_SESSIONS else "region"
    else:
        kind = hold_out
    kept = ~np.isin(np.arange(len(campaign)), left_out)
    parts = [(block.name, block.rows[kept[block.rows]]) for block in blocks(campaign, kind)]
    parts = [(name, rows) for name, rows in parts if rows.size]
    name, test = parts[-1] if parts else ("", np.zeros(0, dtype=np.intp))
    folds = tuple(rows for _, rows in parts[:-1])
    train = sum(rows.size for rows in folds)
    if len(folds) < 2 or train < _FEWEST_TRAIN or test.size < _FEWEST_TEST:
        raise CalibrationError(
            f"held-out blocks by {kind} need {_FEWEST_TRAIN} rows to fit (there are {train}) in two blocks or more "
            f"(there are {len(folds)}), and {_FEWEST_TEST} rows to test (there are {test.size})",
            "measure more poses" + ("" if kind == "region" else ", or choose --hold-out region"),
        )
    return Split(kind, test, name, folds)


# --- blocks ---------------------------------------------------------------------------------------------------------


def blocks(campaign: Campaign, kind: BlockKind, count: int = BLOCKS) -> tuple[Block, ...]:
    """Return whole blocks of rows: every usable row is in exactly one.

    Neighbouring rows share their errors, so random rows held out would flatter a fit; whole blocks do not.

    Args:
        campaign: the data.
        kind: ``session`` (one block a session), ``time`` (stretches of equal length in order of time; of rows
            where no time is known) or ``region`` (neighbours in drive space; repeats of a pose stay together).
        count: number of blocks by time or region; less come where the rows do not allow as many.

    Raises:
        BadInputError: the kind is unknown or the count below 2.
    """
    if count < 2:
        raise BadInputError(f"a split needs at least 2 blocks, not {count}")
    rows = np.flatnonzero(campaign.usable)
    if kind == "session":
        return _session_blocks(rows, campaign.sessions)
    if kind == "time":
        return _time_blocks(rows, campaign.time_s, count)
    if kind == "region":
        return _region_blocks(rows, campaign.drives, count)
    raise BadInputError(f"blocks are by session, time or region, not by '{kind}'")


def _block(kind: BlockKind, name: str, rows: Rows) -> Block:
    ordered = np.sort(rows)
    ordered.flags.writeable = False
    return Block(kind, name, ordered)


def _session_blocks(rows: Rows, sessions: Sequence[str]) -> tuple[Block, ...]:
    """Return one block a session, in order of appearance; ``sessions`` has one entry for every row of the campaign."""
    own = np.array(sessions)[rows]
    return tuple(_block("session", f"session {name}", rows[own == name]) for name in dict.fromkeys(own.tolist()))


def _time_blocks(rows: Rows, time_s: FloatArray | None, count: int) -> tuple[Block, ...]:
    """Return stretches of nearly equal row count in order of time, (n,) in s; rows without time keep their place."""
    if rows.size == 0:
        return ()
    times = np.arange(rows.max() + 1, dtype=float) if time_s is None or np.isnan(time_s[rows]).any() else time_s
    ordered = rows[np.argsort(times[rows], kind="stable")]
    parts = np.array_split(ordered, min(count, ordered.size))
    return tuple(_block("time", f"stretch {i} of {len(parts)}", part) for i, part in enumerate(parts, start=1))


def _region_blocks(rows: Rows, drives: FloatArray, count: int) -> tuple[Block, ...]:
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
