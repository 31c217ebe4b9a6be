"""What a sweep found, in one pass over its chunks: memory for one chunk, and a few numbers a robot and a pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pouring_robot.batch.structure import BoolArray
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.location_figures import without_nan
from pouring_robot.sweeps.evaluation import NOT_DONE, STATUS_NAMES
from pouring_robot.sweeps.plan import SweepPlan
from pouring_robot.sweeps.store import AXES, SweepStore

SHARES = (0.5, 0.95, 0.9973)
# Distances are counted in bins a thousandth wide, from a picometre to ten metres; quantiles are as sharp as that.
_SMALLEST_M, _LARGEST_M, _BIN = 1e-12, 10.0, 1e-3


class Distances:
    """Counts distances in narrow bins, for quantiles of more numbers than fit into memory."""

    def __init__(self) -> None:
        count = int(np.ceil(np.log(_LARGEST_M / _SMALLEST_M) / np.log1p(_BIN)))
        self.edges_m = _SMALLEST_M * (1.0 + _BIN) ** np.arange(count + 1)
        self.counts = np.zeros(count + 2, dtype=np.int64)

    def add(self, distances_m: FloatArray) -> None:
        """Count distances of any shape, in m."""
        places = np.searchsorted(self.edges_m, distances_m.ravel(), side="right")
        self.counts += np.bincount(places, minlength=self.counts.size)

    def quantile(self, share: float) -> float:
        """Return the distance in m that this share does not exceed, to a thousandth; NaN without any."""
        total = int(self.counts.sum())
        if not total:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self.counts), share * total))
        return 0.0 if place == 0 else float(self.edges_m[min(place, self.edges_m.size - 1)])


class Moments:
    """Sums over the good samples of each of n rows (a parameter, a robot or a pose).

    Attributes:
        count, within: number of samples, and of those within the requirement, shape (n,) each.
        largest_m, sum_m, largest_rad: largest distance, sum of distances, largest rotation, shape (n,) each.
        squares_m2: sum of squared displacements by axis, shape (n, 3).
    """

    def __init__(self, rows: int) -> None:
        self.count, self.largest_m, self.sum_m, self.largest_rad, self.within = np.zeros((5, rows))
        self.squares_m2 = np.zeros((rows, 3))

    def add(self, rows: slice, part: _Part, axis: int) -> None:
        """Add a chunk's samples; ``axis`` is the one that is summed over."""
        self.count[rows] += part.good.sum(axis=axis)
        self.sum_m[rows] += part.distance_m.sum(axis=axis)
        self.squares_m2[rows] += (part.displacement_m**2).sum(axis=axis)
        self.within[rows] += part.within.sum(axis=axis)
        self.largest_m[rows] = np.maximum(self.largest_m[rows], part.distance_m.max(axis=axis))
        self.largest_rad[rows] = np.maximum(self.largest_rad[rows], part.angle_rad.max(axis=axis))

    @property
    def mean_m(self) -> FloatArray:
        """Mean distance, shape (n,); NaN without samples."""
        return self.sum_m / np.where(self.count, self.count, np.nan)

    @property
    def rms_m(self) -> FloatArray:
        """Root mean square of the displacement by axis, shape (n, 3); NaN without samples."""
        return np.asarray(np.sqrt(self.squares_m2 / np.where(self.count, self.count, np.nan)[:, None]))


@dataclass(frozen=True, eq=False)
class _Part:
    """A chunk as the sums take it: zeros where there is no solution."""

    displacement_m: FloatArray
    distance_m: FloatArray
    angle_rad: FloatArray
    good: BoolArray
    within: BoolArray


@dataclass(eq=False)
class Summary:
    """What a sweep found at its first frame."""

    frame: str
    accuracy_m: float  # required
    status: dict[str, int]  # number of samples by status name
    by_sample: Moments  # sums over the poses for each robot (one_at_a_time: for each parameter)
    by_pose: Moments  # sums over the robots for each pose
    distances: Distances  # all distances
    largest_gap_m: float = 0.0  # largest distance left open in a loop; ``largest_gap_rad``: largest angle
    largest_gap_rad: float = 0.0

    @property
    def failed(self) -> int:
        """Number of samples without a solution."""
        return sum(count for name, count in self.status.items() if name != STATUS_NAMES[0])

    @property
    def share_within(self) -> float:
        """Share of all samples within the requirement; those without a solution are not within."""
        return float(self.by_pose.within.sum()) / sum(self.status.values())

    def figures(self) -> dict[str, Any]:
        """Return the figures for people and JSON: mm, mrad."""
        rms = np.sqrt(np.nansum(self.by_pose.squares_m2, axis=0) / max(1.0, self.by_pose.count.sum()))
        worst = int(np.argmax(self.by_pose.largest_m))
        largest = float(self.by_pose.largest_m[worst])
        poses, robots = len(self.by_pose.count), len(self.by_sample.count)
        quantiles = {str(share): min(self.distances.quantile(share), largest) / MM for share in SHARES}
        return {
            "frame": self.frame,
            "robots": robots,
            "poses": poses,
            "status": self.status,
            "largest_mm": largest / MM,
            "largest_mrad": float(self.by_pose.largest_rad.max()) / MRAD,
            "rms_mm": {axis: float(value) / MM for axis, value in zip(AXES, rms, strict=True)},
            "quantiles_mm": without_nan(quantiles),
            "accuracy_mm": self.accuracy_m / MM,
            "share_within": self.share_within,
            "share_of_robots_within_everywhere": float((self.by_sample.within == poses).sum()) / robots,
            "worst_pose": worst,
            "largest_gap_mm": self.largest_gap_m / MM,
            "largest_gap_mrad": self.largest_gap_rad / MRAD,
        }


def summarise(store: SweepStore, progress: Progress = say_nothing) -> Summary:
    """Read all chunks of a finished sweep once.

    Raises:
        SweepStoreError: a chunk is damaged or not done.
    """
    plan = store.plan
    counts = np.zeros(NOT_DONE + 1, dtype=np.int64)
    by_sample, by_pose = Moments(plan.draws.count), Moments(len(plan.poses))
    summary = Summary(plan.config.frames[0], plan.accuracy_m, {}, by_sample, by_pose, Distances())
    for done, chunk in enumerate(plan.chunks(), start=1):
        status = store.read("status", chunk)
        counts += np.bincount(status.ravel(), minlength=counts.size)
        part = _part(plan, status, store.read("displacement", chunk)[:, :, 0], store.read("rotation", chunk))
        summary.by_sample.add(slice(*chunk.samples), part, 1)
        summary.by_pose.add(slice(*chunk.poses), part, 0)
        summary.distances.add(part.distance_m[status == 0])
        for name in ("gap_m", "gap_rad"):
            largest = np.where(status == 0, store.read(name, chunk), 0.0).max()
            setattr(summary, f"largest_{name}", max(getattr(summary, f"largest_{name}"), float(largest)))
        progress("summary", done, plan.chunk_grid[0] * plan.chunk_grid[1])
    summary.status = {STATUS_NAMES.get(k, str(k)): int(n) for k, n in enumerate(counts) if n}
    return summary


def _part(plan: SweepPlan, status: Any, displacement: FloatArray, rotation: FloatArray) -> _Part:
    good = status == 0
    moved = np.where(good[..., None], displacement, 0.0)
    distance = np.linalg.norm(moved, axis=-1)
    angle = np.linalg.norm(np.where(good[..., None], rotation, 0.0), axis=-1)
    return _Part(moved, distance, angle, good, good & (distance <= plan.accuracy_m))
