"""Whole blocks held out: one for the test, which no choice uses; the others validate each other in turn.

A calibration chooses groups of parameters by the others (``calibration/selection.py``) and is refused where the test
block is predicted worse; a diagnosis reports how well what it found by the others predicts the test block, and, where
that is small, each block from all others, also from later ones (``diagnosis/cross_validation.py``).

If a block alone determines a direction of the outer frames, the other rows cannot predict it: if only its poses have
the tool upside down, the others leave target and base open against each other along the vertical. Such a block is not
held out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.estimation.frames.fit import RESOLUTION
from pouring_robot.estimation.frames.outer import FRAMES, OuterFrames
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES
from pouring_robot.estimation.noise import commands
from pouring_robot.exceptions import BadInputError, CalibrationError
from pouring_robot.mechanism.arrays import FloatArray, Indices

BlockKind = Literal["session", "time", "region"]
HoldOut = Literal["auto", "session", "time", "region"]
BLOCKS = 5
_KNOWN = 0.1
"""Share of the information on the frames that the others must have in every direction for a prediction: with less,
their variance there would be more than ten times that of all rows."""
_FEWEST_SESSIONS, _FEWEST_TRAIN, _FEWEST_TEST = 4, 12, 3


@dataclass(frozen=True, eq=False)
class Split:
    """Which rows are used for what."""

    kind: BlockKind  # how rows are grouped
    test: Indices  # rows of the test block: no choice uses them; they may refuse a calibration as a whole
    test_name: str  # the block's name
    folds: tuple[Indices, ...]  # blocks of the other rows; each may validate fits to others
    # information of each fold on the outer frames: inner products of columns, (k, k)
    frame_information: tuple[FloatArray, ...]

    @property
    def train(self) -> Indices:
        """All rows but the test block, ascending."""
        return np.sort(np.concatenate(self.folds))

    @property
    def rows(self) -> Indices:
        """All rows, the test block included, ascending."""
        return np.union1d(self.train, self.test)

    @property
    def validations(self) -> tuple[tuple[Indices, Indices], ...]:
        """Rows to fit and rows to validate that fit, in turn.

        Regions: each fold from all others. Sessions and stretches of time: each from those before it, like the test
        block; a drift would otherwise be interpolated here and extrapolated there.
        """
        pairs = []
        for k, fold in enumerate(self.folds):
            others = [j for j in range(len(self.folds)) if j < k or (self.kind == "region" and j > k)]
            rows = np.concatenate([np.zeros(0, dtype=np.intp), *(self.folds[j] for j in others)])
            if rows.size >= FEWEST_FOR_FRAMES and frames_determined(
                [self.frame_information[j] for j in others], self.frame_information[k]
            ):
                pairs.append((np.sort(rows), fold))
        return tuple(pairs)


def split(campaign: Campaign, left_out: Indices, hold_out: HoldOut = "auto") -> Split:
    """Split a campaign without the rows that no fit should use.

    Which components were measured matters, never their values. The test block is the last session or stretch of time;
    of regions, it is the one whose first row comes last among those that are large enough and that the other rows can
    predict. By default (``auto``) blocks are sessions if there are four or more, the last large enough, else regions.

    Raises:
        CalibrationError: there are too few rows, or the last block (of regions: every one) alone determines where
            tracker and target are.
    """
    own_frames = campaign.metadata.own_frames
    if own_frames and hold_out in ("session", "time"):
        problem = f"sessions have frames of their own, which a block held out by {hold_out} would not know"
        raise CalibrationError(problem, "choose --hold-out region")
    kinds: tuple[BlockKind, ...] = (hold_out,) if hold_out != "auto" else ("region",)
    if hold_out == "auto" and len(set(campaign.sessions)) >= _FEWEST_SESSIONS and not own_frames:
        kinds = ("session", "region")
    frames = _frame_columns(campaign)
    for kind in kinds:
        parts = list(blocks(campaign, kind, left_out).items())
        sizes = [rows.size for _, rows in parts]
        last, train = sum(sizes[-1:]), sum(sizes[:-1])
        shown = [_inner_products(frames[rows]) for _, rows in parts]
        from_last = reversed(range(len(parts)) if kind == "region" else range(len(parts))[-1:])
        large = [k for k in from_last if sizes[k] >= _FEWEST_TEST and sum(sizes) - sizes[k] >= _FEWEST_TRAIN]
        for k in large if len(parts) > 2 else ():
            others = [j for j in range(len(parts)) if j != k]
            if frames_determined([shown[j] for j in others], shown[k]):
                folds, theirs = zip(*((parts[j][1], shown[j]) for j in others), strict=True)
                return Split(kind, parts[k][1], parts[k][0], folds, theirs)
    other = "" if kind == "region" else ", or choose --hold-out region"
    if len(parts) < 3 or not large:
        raise CalibrationError(
            f"held-out blocks by {kind} need {_FEWEST_TRAIN} rows to fit (there are {train}) in two blocks or more "
            f"(there are {max(len(parts) - 1, 0)}), and {_FEWEST_TEST} rows to test (there are {last})",
            f"measure more poses{other}",
        )
    raise CalibrationError(
        f"{'no block' if kind == 'region' else 'no last block'} by {kind} can be held out, as it alone determines "
        "where tracker and target are relative to each other",
        f"measure each attitude of the target in several places{other}",
    )


def frames_determined(frame_information: Sequence[FloatArray], asked: FloatArray) -> bool:
    """Return whether some blocks determine the frames well enough to predict another, by their information, (k, k).

    In every direction they must have the share :data:`_KNOWN` of the information of all together.
    """
    known = np.sum(frame_information, axis=0)
    both = known + asked
    sizes = np.sqrt(np.maximum(np.diag(both), 1e-300))  # metres and radians
    squared, axes = np.linalg.eigh(both / sizes / sizes[:, None])
    kept = squared > RESOLUTION**2 * squared.max(initial=0.0)
    axes = axes[:, kept] / np.sqrt(squared[kept])
    share = axes.T @ (known / sizes / sizes[:, None]) @ axes
    return bool(np.linalg.eigvalsh(share).min(initial=1.0) >= _KNOWN)


def _inner_products(columns: FloatArray) -> FloatArray:
    flat = columns.reshape(-1, columns.shape[2])
    return np.asarray(flat.T @ flat)


def blocks(campaign: Campaign, kind: BlockKind, left_out: Indices | Sequence[int] = ()) -> dict[str, Indices]:
    """Return whole blocks of rows, ascending, by name: every usable row that is not left out is in exactly one.

    Neighbouring rows share their errors, so holding out random rows would flatter a fit; whole blocks do not. They are
    sessions, up to :data:`BLOCKS` stretches of equal length in time order (row order where no time is known), or as
    many regions (neighbours in drive space; repeats of a pose stay together). Raises BadInputError if the kind is
    unknown.
    """
    rows = np.setdiff1d(np.flatnonzero(campaign.usable), left_out)
    if kind == "session":
        own = np.array(campaign.sessions)[rows]
        return {f"session {name}": rows[own == name] for name in dict.fromkeys(own.tolist())}
    if kind not in ("time", "region"):
        raise BadInputError(f"blocks are by session, time or region, not by '{kind}'")
    if rows.size == 0:
        return {}
    word, parts = ("stretch", _stretches) if kind == "time" else ("region", _regions)
    found = parts(rows, campaign)
    return {f"{word} {i} of {len(found)}": np.sort(part) for i, part in enumerate(found, start=1)}


def _frame_columns(campaign: Campaign) -> FloatArray:
    """Return the derivatives of what was measured by the frames, (n, 6, 12), or (n, 6, 6 + 6 s) for s sessions.

    By the drawing, in the base's axes, with the target at the origin of its body: which rows determine which frame
    depends on the poses alone.
    """
    poses = nominal_poses(campaign.robot.drawing(), campaign.drives)
    known = np.hstack([campaign.position_measured, campaign.rotation_measured]) & poses.complete[:, None]
    columns = OuterFrames(pin.SE3.Identity(), pin.SE3.Identity()).jacobian(poses)
    columns = np.where(known[:, :, None], columns, 0.0)
    if not campaign.metadata.own_frames:
        return columns
    sessions = np.unique(campaign.sessions, return_inverse=True)[1]
    own = np.eye(sessions.max() + 1)[sessions]
    base = np.einsum("nck,ns->ncsk", columns[:, :, : FRAMES // 2], own)
    return np.concatenate([base.reshape(*columns.shape[:2], -1), columns[:, :, FRAMES // 2 :]], axis=2)


def _stretches(rows: Indices, campaign: Campaign) -> list[Indices]:
    """Return stretches of nearly equal row count in time order; where a time is missing, in row order."""
    time = campaign.time_s
    if time is not None and not np.isnan(time[rows]).any():
        rows = rows[np.argsort(time[rows], kind="stable")]
    return np.array_split(rows, min(BLOCKS, rows.size))


def _regions(rows: Indices, campaign: Campaign) -> list[Indices]:
    """Return neighbours in drive space (each drive over its spread), by repeatedly halving the largest block."""
    values = np.zeros(campaign.drives.shape, dtype=np.int64)  # in other rows a drive may not be known
    values[rows] = commands(campaign.drives[rows])  # repeats of a pose are not separated
    spread = np.maximum(values[rows].std(axis=0), np.finfo(float).tiny)
    whole, divisible = list[Indices](), [rows]
    while divisible and len(whole) + len(divisible) < BLOCKS:
        block = divisible.pop(int(np.argmax([part.size for part in divisible])))
        halves = _halve(block, values, spread)
        if halves is None:
            whole.append(block)
        else:
            divisible.extend(halves)
    return sorted([*whole, *divisible], key=lambda block: int(block.min()))


def _halve(rows: Indices, commanded: Indices, spread: FloatArray) -> tuple[Indices, Indices] | None:
    """Split at the median of the drive with the widest range; equal values stay together. None: all are one pose."""
    values = commanded[rows, np.argmax(np.ptp(commanded[rows], axis=0) / spread)]
    steps, counts = np.unique(values, return_counts=True)
    if steps.size < 2:
        return None
    cut = steps[1:][np.argmin(np.abs(np.cumsum(counts)[:-1] - 0.5 * rows.size))]
    return rows[values < cut], rows[values >= cut]
