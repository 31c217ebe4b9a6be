"""Drive values for a whole path at once: Newton over all poses, which the compiled engine closes.

One by one (:func:`~pouring_robot.compensation.pose.compensate`) temperatures are taken anew where the ladle has come
to, until that moves nothing. A compensated ladle is where it is wanted, but for roll and yaw, so here they are taken
there, once (:mod:`pouring_robot.thermal.expansion.warm_path`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pouring_robot.batch.samples import STATUS_NAMES, BatchClosure
from pouring_robot.compensation.pose import TOLERANCE, tilt_rates
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray, lock_fields
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.mechanism.rotations import rotation_vectors
from pouring_robot.report.result import Result
from pouring_robot.robot.inverse import limited
from pouring_robot.robot.location import OUT_OF_REACH, as_poses
from pouring_robot.robot.pouring.names import DRIVE_COLUMNS
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot
from pouring_robot.thermal.expansion.warm_path import WarmPath, strains_along
from pouring_robot.thermal.network.history import POSE_COLUMNS

NOT_FOUND = "not found"
_MOST_STEPS = 12


@dataclass(frozen=True, eq=False, repr=False)
class CompensatedPath(Result):
    """What to command along a path, and what it leads to; arrays are read-only, NaN where there is no answer."""

    frame: str  # the frame whose position is brought to where it is wanted
    wanted: FloatArray  # x, y, z in m and the tilt in rad, shape (n, 4)
    drives: FloatArray  # values to command, in m and rad, shape (n, 4)
    before_m: FloatArray  # how far off the frame would be without compensation, as warm as it is with it, shape (n,)
    left: FloatArray  # what is left of x, y, z of the frame (m) and of the tilt (rad), shape (n, 4)
    roll_yaw_rad: FloatArray  # the rotations that cannot be commanded, about x and z, shape (n, 2)
    strain: FloatArray  # growth per length of legs 1 to 4, moving and fixed platform, shape (n, 6)
    status: NDArray[np.str_]  # ``closed``, or why there is no answer, shape (n,)

    def __post_init__(self) -> None:
        lock_fields(self, "wanted", "drives", "before_m", "left", "roll_yaw_rad", "strain")

    @property
    def headline(self) -> str:
        """How many poses, and how far off the frame was and is."""
        found = self.status == STATUS_NAMES[0]
        if not found.any():
            return f"no drive values for any of {len(found)} poses: {self.status[0] if len(found) else 'there is none'}"
        before, left = self.before_m[found].max(), np.linalg.norm(self.left[found, :3], axis=1).max()
        return (
            f"{found.sum()} of {len(found)} poses: '{self.frame}' at most {before / MM:.3f} mm off without "
            f"compensation, {left / MM:.1e} mm with it"
        )

    def _table(self) -> Any:
        """One row a pose, with the units on the headings."""
        scales = np.array([MM, MM, MM, math.radians(1.0)])
        *lengths, angle = DRIVE_COLUMNS
        columns = {f"wanted_{name}": self.wanted[:, k] / scales[k] for k, name in enumerate(POSE_COLUMNS)}
        columns |= {f"{name}_mm": self.drives[:, k] / MM for k, name in enumerate(lengths)}
        columns |= {f"{angle}_rad": self.drives[:, 3], "before_mm": self.before_m / MM}
        columns |= {"left_mm": np.linalg.norm(self.left[:, :3], axis=1) / MM, "left_tilt_mrad": self.left[:, 3] / MRAD}
        columns |= {"roll_mrad": self.roll_yaw_rad[:, 0] / MRAD, "yaw_mrad": self.roll_yaw_rad[:, 1] / MRAD}
        return {**columns, "status": self.status}


def compensate_path(
    heated: HeatedRobot, poses: ArrayLike, frame: str | None = None, threads: int = 2, show: Progress = say_nothing
) -> CompensatedPath:
    """Return drive values that bring the actual ladle to many poses.

    Poses are x, y, z in m and the tilt in rad, shape (n, 4), best along a path: neighbours start each other. ``frame``:
    whose position shall be right; by default the moving platform. ``threads`` share the temperatures.

    Raises:
        BadInputError: the poses have another shape, or the robot carries loads.
        UnknownFrameError: there is no such frame.
        ThermalSolutionError: no temperatures are found.
    """
    wanted = as_poses(poses)
    return PathSearch(heated, wanted, frame, strains_along(heated, wanted, threads, show)).run()


class PathSearch:
    """Newton over all poses at once, on the robot as built with its parts grown.

    Arguments and errors as :func:`compensate_path`; ``strain`` as :func:`strains_along` gives it.
    """

    def __init__(self, heated: HeatedRobot, wanted: FloatArray, frame: str | None, strain: FloatArray) -> None:
        self.warm = WarmPath(heated, wanted, strain)
        self.kinematics, actual = heated.robot.kinematics, heated.robot.actual_solver.mechanism
        self.wanted, self.start = wanted, self.warm.command.start
        self.frame = frame or str(actual.loops.end_frame)
        self.on_end = actual.placement_on_end(self.frame).translation
        nominal = self.kinematics.mechanism.placement_on_end(self.frame).translation
        self.target = self.start.position + self.start.rotation @ nominal

    def left_with(self, drives: FloatArray) -> FloatArray:
        """Return how far x, y, z of the frame (m) and the tilt (rad) are off for commanded drives, shape (n, 4)."""
        return self._left(self.warm.close(drives, self.start))

    def run(self, *, limits: bool = True) -> CompensatedPath:
        """Step until every pose is met or no longer gets nearer.

        ``limits``: whether poses in which a joint is beyond its limits have no answer.
        """
        drives, start = self.warm.command.drives.copy(), self.start
        best = np.full(len(drives), np.inf)
        closed = self.warm.close(drives, start)
        left = before = self._left(closed)
        for _ in range(_MOST_STEPS):
            size = np.abs(left).max(axis=1)
            going = closed.closed & (size > TOLERANCE) & ~((size < 100.0 * TOLERANCE) & (size > 0.5 * best))
            if not going.any():
                break
            best = np.minimum(best, np.where(np.isfinite(size), size, np.inf))
            step = limited(self._step(closed, left), self.kinematics.mechanism)
            drives = np.where(going[:, None], drives - step, drives)
            closed = self.warm.close(drives, closed.as_start())
            left = self._left(closed)
        with np.errstate(invalid="ignore"):
            met = np.abs(left).max(axis=1) < 100.0 * TOLERANCE
            reached = self.kinematics.within_limits(closed.joints) | (not limits)
        status = np.array(STATUS_NAMES)[closed.status].astype(object)
        status[closed.closed & ~met] = NOT_FOUND
        status[closed.closed & met & ~reached] = OUT_OF_REACH
        found = (status == STATUS_NAMES[0])[:, None]
        rotation = closed.rotation @ np.swapaxes(self.start.rotation, 1, 2)
        turned = rotation_vectors(np.where(found[:, :, None], rotation, np.eye(3)))
        return CompensatedPath(
            self.frame,
            self.wanted,
            np.where(found, drives, np.nan),
            np.linalg.norm(before[:, :3], axis=1),
            np.where(found, left, np.nan),
            np.where(found, turned[:, [0, 2]], np.nan),
            self.warm.strain,
            status.astype(str),
        )

    def _left(self, closed: BatchClosure) -> FloatArray:
        place = closed.position + closed.rotation @ self.on_end
        tilt = np.arctan2(closed.rotation[:, 0, 2], closed.rotation[:, 2, 2])
        return np.column_stack([place - self.target, tilt - self.wanted[:, 3]])

    def _step(self, closed: BatchClosure, left: FloatArray) -> FloatArray:
        """Return what to take from the drives, (n, 4)."""
        moved, arm = self.warm.drives_to_end(closed), closed.rotation @ self.on_end
        place = moved[:, :3] + np.cross(moved[:, 3:], arm[:, :, None], axis=1)
        matrix = np.concatenate([place, tilt_rates(moved[:, 3:], closed.rotation[:, :, 2])[:, None]], axis=1)
        good = np.isfinite(matrix).all(axis=(1, 2))
        step = np.full(left.shape, np.nan)
        step[good] = np.linalg.solve(matrix[good], left[good][:, :, None])[:, :, 0]
        return step
