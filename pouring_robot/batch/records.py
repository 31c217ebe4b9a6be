"""Inputs and outputs of the batch engines: arrays with their meaning."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from pouring_robot.batch.structure import ByteArray, CountArray, IntArray, fixed
from pouring_robot.exceptions import BadInputError, BatchClosureError
from pouring_robot.mechanism.arrays import FloatArray, ReadOnly
from pouring_robot.mechanism.closure.status import CLOSED
from pouring_robot.mechanism.closure.status import STATUS_NAMES as STATUS_NAMES  # noqa: PLC0414 - the room exports it
from pouring_robot.mechanism.local_parameters import LocalParameter


@dataclass(frozen=True, eq=False)
class BatchStart:
    """Starts of closures; values that an engine does not need may be NaN. Wrong shapes raise BadInputError."""

    position: FloatArray  # origin of the end frame in the base frame, in m, shape (n, 3)
    rotation: FloatArray  # axes of the end frame in the base frame, shape (n, 3, 3)
    # the joints as its engine takes them, n first. A star's engine: values by chain, from base to tip, in m and rad,
    # shape (n, chains, joints); the general engine: Pinocchio's configurations, shape (n, nq).
    joints: FloatArray

    def __post_init__(self) -> None:
        for name in ("position", "rotation", "joints"):
            object.__setattr__(self, name, fixed(getattr(self, name)))
        count = len(self.position)
        shapes = (self.position.shape, self.rotation.shape, self.joints.shape[:1])
        if shapes != ((count, 3), (count, 3, 3), (count,)):
            raise BadInputError(
                f"a start needs position (n, 3), rotation (n, 3, 3) and joints (n, ...), not {shapes[0]}, "
                f"{shapes[1]} and {self.joints.shape}"
            )

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, samples: IntArray | slice) -> BatchStart:
        return BatchStart(self.position[samples], self.rotation[samples], self.joints[samples])

    def replaced(self, samples: IntArray, closed: BatchClosure) -> BatchStart:
        """Return the starts with some samples moved to where they closed; those that did not close stay."""
        arrays = self.position.copy(), self.rotation.copy(), self.joints.copy()
        for array, new in zip(arrays, (closed.position, closed.rotation, closed.joints), strict=True):
            array[samples[closed.closed]] = new[closed.closed]
        return BatchStart(*arrays)


@dataclass(frozen=True, eq=False)
class BatchCommand:
    """What the controller commands."""

    # what it is asked for, number by number in m and rad, shape (n, k): x, y, z and the tilt of the pouring robot's
    # platform, drive values of another robot
    poses: FloatArray
    drives: FloatArray  # nominal drive values, m or rad, shape (n, drives)
    start: BatchStart  # the closed nominal robot

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, samples: IntArray | slice) -> BatchCommand:
        return BatchCommand(self.poses[samples], self.drives[samples], self.start[samples])


@dataclass(frozen=True, eq=False)
class SiteErrors:
    """Placement errors of samples; see :meth:`take` and :meth:`one_each`."""

    # translation (m) and rotation vector (rad), shape (n, sites, 6); (n, 1, 6) if each sample displaces one site;
    # (0, sites, 6) for none
    errors: FloatArray
    site: IntArray  # the site each sample displaces, shape (n,), or (0,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "errors", fixed(self.errors))
        object.__setattr__(self, "site", fixed(self.site, np.int64))

    @classmethod
    def one_each(cls, site: IntArray, error: FloatArray) -> SiteErrors:
        """Displace one site a sample (n,) by its error (n, 6), m and rad; raises BadInputError if shapes do not fit."""
        site, error = fixed(site, np.int64), fixed(error)
        if site.ndim != 1 or error.shape != (len(site), 6):
            raise BadInputError(f"one error a sample needs site (n,) and error (n, 6), not {site.shape}, {error.shape}")
        return cls(error[:, None, :], site)

    def __getitem__(self, samples: IntArray) -> SiteErrors:
        if self.site.size:
            return SiteErrors(self.errors[samples], self.site[samples])
        return self if len(self.errors) < 2 else SiteErrors(self.errors[samples], self.site)

    @classmethod
    def take(cls, errors: SiteErrors | FloatArray | None, count: int, sites: int) -> SiteErrors:
        """Return the errors of ``count`` samples as kernels take them; raises BadInputError if they do not fit."""
        nothing = np.zeros(0, dtype=np.int64)
        if errors is None:
            return cls(np.zeros((0, sites, 6)), nothing)
        if isinstance(errors, SiteErrors):
            if len(errors.errors) not in (0, count) or (errors.site.size and errors.errors.shape[1] != 1):
                raise BadInputError(f"there are {count} samples but errors for {len(errors.errors)}")
            if errors.site.size and not (errors.site.min() >= 0 and errors.site.max() < sites):
                raise BadInputError(f"a site must be 0 to {sites - 1}, not {errors.site.min()} to {errors.site.max()}")
            return errors
        array = fixed(errors)
        if array.shape not in ((sites * 6,), (count, sites * 6)):
            raise BadInputError(
                f"errors must have the shape ({sites * 6},) or ({count}, {sites * 6}), not {array.shape}"
            )
        if array.ndim == 1 and not np.all(np.isfinite(array)):
            raise BadInputError("the placement errors common to all samples hold a value that is not a finite number")
        return cls(array.reshape(-1, sites, 6), nothing)


@dataclass(frozen=True, eq=False)
class BatchClosure:
    """Closed poses of many samples; a sample that failed holds NaN and a status that is not 0.

    The engine's results are read-only.
    """

    position: FloatArray  # origin of the end frame in the base frame, in m, shape (n, 3)
    rotation: FloatArray  # axes of the end frame in the base frame, shape (n, 3, 3)
    joints: FloatArray  # the joints as in :class:`BatchStart`
    residual: FloatArray  # what is left open in each loop, log6, in m and rad, shape (n, loops, 6)
    iterations: CountArray  # Newton steps taken, shape (n,)
    status: ByteArray  # codes of :mod:`~pouring_robot.mechanism.closure.status`, shape (n,)
    # what r redundant drives disagree by, in m, shape (n, r)
    disagreement: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def empty(cls, count: int, joints: tuple[int, ...], loops: int, redundant: int = 0) -> BatchClosure:
        """Return arrays for ``count`` samples with joints of that shape and that many loops and redundant drives."""
        shapes = (3,), (3, 3), joints, (loops, 6), (redundant,)
        position, rotation, values, residual, apart = (np.full((count, *shape), np.nan) for shape in shapes)
        iterations, status = np.zeros(count, dtype=np.int32), np.zeros(count, dtype=np.uint8)
        return cls(position, rotation, values, residual, iterations, status, apart)

    def __len__(self) -> int:
        return len(self.position)

    @property
    def closed(self) -> NDArray[np.bool_]:
        """Which samples are closed, shape (n,)."""
        return np.asarray(self.status == CLOSED)

    def put(self, samples: IntArray, others: BatchClosure) -> None:
        """Replace some samples by others."""
        for name in (one.name for one in fields(self)):
            getattr(self, name)[samples] = getattr(others, name)

    def refuse(self, samples: NDArray[np.bool_], status: int) -> None:
        """Remove the poses of some samples, and set their status."""
        for array in (self.position, self.rotation, self.joints, self.residual):
            array[samples] = np.nan
        self.status[samples] = status

    def require_all(self) -> BatchClosure:
        """Return the same if every sample is closed; raises BatchClosureError with the number of failures by status."""
        failed = np.flatnonzero(self.status)
        if failed.size:
            counts = np.bincount(self.status[failed], minlength=len(STATUS_NAMES))
            by_name = {STATUS_NAMES[k]: int(number) for k, number in enumerate(counts) if number}
            raise BatchClosureError(by_name, len(self), int(failed[0]))
        return self

    def as_start(self) -> BatchStart:
        """Return the closed poses as starts of further closures; samples that failed stay NaN."""
        return BatchStart(self.position, self.rotation, self.joints)


@dataclass(frozen=True, eq=False)
class BatchTransfer(ReadOnly):
    """G of many samples, read-only."""

    parameters: tuple[LocalParameter, ...]  # one a column
    # displacement of the end frame's origin (m) and rotation vector (rad), in base axes, per unit of each parameter,
    # shape (n, 6, columns); NaN where the status is not 0
    matrix: FloatArray
    status: ByteArray  # as in :class:`BatchClosure`, (n,); singular where it is closed, its platform not determined
    # derivative of that of :class:`BatchClosure`, shape (n, r, columns); None without redundant drives
    disagreement: FloatArray | None = None


def shaped(array: FloatArray, shape: tuple[int, ...], name: str) -> FloatArray:
    """Return an array in the form the kernels take; raises BadInputError where it has another shape."""
    array = fixed(array)
    if array.shape != shape:
        raise BadInputError(f"{name} must have the shape {shape}, not {array.shape}")
    return array
