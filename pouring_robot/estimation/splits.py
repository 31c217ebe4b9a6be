"""Whole blocks held out: one for the test, looked at once at the end; the others validate each other in turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.blocks import BlockKind
from pouring_robot.campaign.data import Campaign
from pouring_robot.exceptions import CalibrationError

HoldOut = Literal["auto", "session", "time", "region"]
Rows = NDArray[np.intp]
BLOCKS = 5
_FEWEST_SESSIONS, _FEWEST_TRAIN, _FEWEST_TEST, _FEWEST_FIT = 4, 12, 3, 6


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
            if sum(rows.size for rows in others) >= _FEWEST_FIT:
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
    blocks = [(block.name, block.rows[kept[block.rows]]) for block in campaign.blocks(kind, BLOCKS)]
    blocks = [(name, rows) for name, rows in blocks if rows.size]
    name, test = blocks[-1] if blocks else ("", np.zeros(0, dtype=np.intp))
    folds = tuple(rows for _, rows in blocks[:-1])
    train = sum(rows.size for rows in folds)
    if len(folds) < 2 or train < _FEWEST_TRAIN or test.size < _FEWEST_TEST:
        raise CalibrationError(
            f"held-out blocks by {kind} need {_FEWEST_TRAIN} rows to fit (there are {train}) in two blocks or more "
            f"(there are {len(folds)}), and {_FEWEST_TEST} rows to test (there are {test.size})",
            "measure more poses" + ("" if kind == "region" else ", or choose --hold-out region"),
        )
    return Split(kind, test, name, folds)
