"""Summary of a sweep in one pass over its chunks: memory for one chunk, and a few numbers per robot and per pose.

A chunk that is damaged or not done raises SweepStoreError.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pouring_robot.io.figures import without_nan
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.status import CLOSED
from pouring_robot.sweeps.config import WITHIN_IT
from pouring_robot.sweeps.plan import Chunk
from pouring_robot.sweeps.store import AXES, NOT_DONE, STATUS_NAMES, SweepStore

SHARES = (0.5, 0.95, WITHIN_IT)
# Distances are counted in bins a thousandth wide, from a picometre to ten metres; quantiles have this resolution.
_SMALLEST_M, _LARGEST_M, _BIN = 1e-12, 10.0, 1e-3
_OF_THE_CLOSED = ("largest_mm", "largest_mrad", "worst_pose", "largest_gap_mm", "largest_gap_mrad")


class Distances:
    """Histogram of distances with narrow bins, for quantiles of more numbers than fit into memory."""

    def __init__(self) -> None:
        count = int(np.ceil(np.log(_LARGEST_M / _SMALLEST_M) / np.log1p(_BIN)))
        self.edges_m = _SMALLEST_M * (1.0 + _BIN) ** np.arange(count + 1)
        self.counts = np.zeros(count + 2, dtype=np.int64)

    def add(self, distances_m: FloatArray) -> None:
        """Count distances of any shape, in m."""
        places = np.searchsorted(self.edges_m, distances_m.ravel(), side="right")
        self.counts += np.bincount(places, minlength=self.counts.size)

    def quantile(self, share: float) -> float:
        """Return the distance in m that this share does not exceed, to a thousandth; NaN without samples."""
        total = int(self.counts.sum())
        if not total:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self.counts), share * total))
        return 0.0 if place == 0 else float(self.edges_m[min(place, self.edges_m.size - 1)])


class _Part:
    """A chunk prepared for summing: zeros where there is no solution."""

    def __init__(self, store: SweepStore, chunk: Chunk) -> None:
        self.status = store.read("status", chunk)
        self.good = self.status == CLOSED
        self.displacement_m = np.where(self.good[..., None], store.read("displacement", chunk)[:, :, 0], 0.0)
        self.distance_m = np.linalg.norm(self.displacement_m, axis=-1)
        self.angle_rad = np.linalg.norm(np.where(self.good[..., None], store.read("rotation", chunk), 0.0), axis=-1)
        self.within = store.plan.within(self.status, self.distance_m)


class Moments:
    """Sums over the samples with a solution of each of n rows (a parameter, a robot or a pose)."""

    def __init__(self, rows: int) -> None:
        self.count, self.within = np.zeros((2, rows))  # of samples, and of those within the requirement
        self.largest_m, self.sum_m, self.largest_rad = np.zeros((3, rows))  # of distances, and of rotations
        self.squares_m2 = np.zeros((rows, 3))  # sum of squared displacements, by axis

    def add(self, rows: slice, part: _Part, axis: int) -> None:
        """Add a chunk's samples; ``axis`` is summed over."""
        self.count[rows] += part.good.sum(axis=axis)
        self.sum_m[rows] += part.distance_m.sum(axis=axis)
        self.squares_m2[rows] += (part.displacement_m**2).sum(axis=axis)
        self.within[rows] += part.within.sum(axis=axis)
        self.largest_m[rows] = np.maximum(self.largest_m[rows], part.distance_m.max(axis=axis))
        self.largest_rad[rows] = np.maximum(self.largest_rad[rows], part.angle_rad.max(axis=axis))

    @property
    def largest(self) -> FloatArray:
        """Largest distance in m and largest rotation in rad, shape (2, n); NaN without samples."""
        return np.where(self.count, (self.largest_m, self.largest_rad), np.nan)

    @property
    def mean_m(self) -> FloatArray:
        """Mean distance, shape (n,); NaN without samples."""
        return self.sum_m / np.where(self.count, self.count, np.nan)

    @property
    def rms_m(self) -> FloatArray:
        """Root mean square of the displacement by axis, shape (n, 3); NaN without samples."""
        return np.asarray(np.sqrt(self.squares_m2 / np.where(self.count, self.count, np.nan)[:, None]))


@dataclass(frozen=True, eq=False)
class Summary:
    """Results of a sweep at its first frame."""

    frame: str
    accuracy_m: float  # required accuracy
    status: dict[str, int]  # number of samples by status name
    by_sample: Moments  # sums over the poses for each robot (one_at_a_time: for each parameter)
    by_pose: Moments  # sums over the robots for each pose
    distances: Distances  # all distances
    largest_gap_m: float  # largest distance left open in a loop; ``largest_gap_rad``: largest angle
    largest_gap_rad: float

    @property
    def failed(self) -> int:
        """Number of samples without a solution."""
        return self.samples - self.closed

    @property
    def samples(self) -> int:
        """Number of samples in all."""
        return sum(self.status.values())

    @property
    def closed(self) -> int:
        """Number of samples with a solution."""
        return self.status.get(STATUS_NAMES[CLOSED], 0)

    def figures(self) -> dict[str, Any]:
        """Return the figures for people and JSON: mm, mrad; unknown values, where no robot closed, are None."""
        rms = np.sqrt(np.nansum(self.by_pose.squares_m2, axis=0) / max(1, self.closed))
        worst = int(np.argmax(self.by_pose.largest_m))
        largest = float(self.by_pose.largest_m[worst])
        poses, robots = len(self.by_pose.count), len(self.by_sample.count)
        quantiles = {str(share): min(self.distances.quantile(share), largest) / MM for share in SHARES}
        figures = {
            "frame": self.frame,
            "robots": robots,
            "poses": poses,
            "status": self.status,
            "largest_mm": largest / MM,
            "largest_mrad": float(self.by_pose.largest_rad.max()) / MRAD,
            "rms_mm": {axis: float(value) / MM for axis, value in zip(AXES, rms, strict=True)},
            "quantiles_mm": without_nan(quantiles),
            "accuracy_mm": self.accuracy_m / MM,
            "share_within": float(self.by_pose.within.sum()) / self.samples,
            "share_of_robots_within_everywhere": float((self.by_sample.within == poses).sum()) / robots,
            "worst_pose": worst,
            "largest_gap_mm": self.largest_gap_m / MM,
            "largest_gap_mrad": self.largest_gap_rad / MRAD,
        }
        return figures if self.closed else figures | dict.fromkeys(_OF_THE_CLOSED) | {"rms_mm": dict.fromkeys(AXES)}


def summarise(store: SweepStore, progress: Progress = say_nothing) -> Summary:
    """Read all chunks of a finished sweep once."""
    plan = store.plan
    counts, gaps = np.zeros(NOT_DONE + 1, dtype=np.int64), np.zeros(2)
    by_sample, by_pose, distances = Moments(plan.draws.count), Moments(len(plan.poses)), Distances()
    for done, chunk in enumerate(plan.chunks(), start=1):
        part = _Part(store, chunk)
        counts += np.bincount(part.status.ravel(), minlength=counts.size)
        by_sample.add(chunk.samples, part, 1)
        by_pose.add(chunk.poses, part, 0)
        distances.add(part.distance_m[part.good])
        open_by = [np.where(part.good, store.read(name, chunk), 0.0).max() for name in ("gap_m", "gap_rad")]
        gaps = np.maximum(gaps, open_by)
        progress("summary", done, plan.chunk_grid[0] * plan.chunk_grid[1])
    status = {STATUS_NAMES.get(k, str(k)): int(n) for k, n in enumerate(counts) if n}
    return Summary(plan.config.frames[0], plan.accuracy_m, status, by_sample, by_pose, distances, *gaps.tolist())
