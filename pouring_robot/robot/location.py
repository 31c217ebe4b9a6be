"""Where the ladle should be and where it is: for one command with all details, for many as a dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.io.units import MM, MRAD, joint_shown
from pouring_robot.mechanism.arrays import FloatArray, ReadOnly, finite
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureResult
from pouring_robot.mechanism.closure.status import CLOSED, STATUS_NAMES
from pouring_robot.mechanism.joint_limits import JointReach
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.mechanism.rotations import rotation_vectors
from pouring_robot.report.result import Result
from pouring_robot.robot.pouring.platform_pose import PlatformPose

if TYPE_CHECKING:
    import xarray as xr


OUT_OF_REACH = "out of reach"


@dataclass(frozen=True, eq=False, repr=False)
class Location(Result):
    """Nominal and actual pose of any robot for one command. Locations compare by identity."""

    drives: dict[str, float]  # commanded drive values, in m and rad
    nominal: ClosureResult  # closed nominal robot
    # closed robot as built at the same command; its drives are at the command plus their offsets
    actual: ClosureResult
    reach: tuple[JointReach, ...]  # every joint of the drawing that has limits, the one nearest to a limit first

    @property
    def loops(self) -> LoopsFile:
        """The mechanism's loops file, which names base, end and tool frames."""
        return self.nominal.mechanism.loops

    def poses(self, frame: str) -> tuple[pin.SE3, pin.SE3]:
        """Return nominal and actual pose of a frame in the base; raises UnknownFrameError where there is none."""
        base = self.loops.base_frame
        return self.nominal.pose(base, frame), self.actual.pose(base, frame)

    def difference(self, frame: str | None = None) -> PoseDifference:
        """Return actual minus nominal pose of a frame (default: the working frame), in the axes of the base."""
        return PoseDifference.between(*self.poses(frame or self.loops.working_frame))

    @property
    def command(self) -> str:
        """The commanded drive values, in mm and degrees."""
        return ", ".join(drive_words(self.nominal.mechanism, self.drives))

    @property
    def title(self) -> str:
        """The same for a picture."""
        return self.command

    @property
    def headline(self) -> str:
        """By how much the working frame is off, and for which command."""
        off = self.difference()
        return (
            f"{self.loops.working_frame} is {off.distance_m / MM:.3f} mm and {off.angle_rad / MRAD:.3f} mrad off "
            f"at {self.command}"
        )

    def _table(self) -> Any:
        """One row per frame: nominal and actual position in mm, error in mm and mrad."""
        rows = []
        for frame in self.loops.reported_frames:
            nominal, actual = self.poses(frame)
            shift, turn = self.difference(frame).to_mm_mrad()
            parts = {"nominal_{}_mm": nominal.translation / MM, "actual_{}_mm": actual.translation / MM}
            parts |= {"error_{}_mm": shift, "error_r{}_mrad": turn}
            figures = {name.format(axis): part[k] for name, part in parts.items() for k, axis in enumerate("xyz")}
            rows.append({"frame": frame, **figures})
        return rows


@dataclass(frozen=True, eq=False, repr=False)
class LadleLocation(ReadOnly, Location):
    """Nominal and actual pose of the pouring robot's ladle for one commanded pose. Arrays are read-only."""

    commanded: PlatformPose  # the pose the controller was asked for
    outside_workspace_m: FloatArray  # by how far the position leaves the workspace box, per axis, in m; zero inside
    outside_workspace_rad: float  # by how far the tilt leaves it, in rad

    @property
    def in_workspace(self) -> bool:
        """Whether the commanded pose lies in the workspace box."""
        return not self.outside_workspace_m.any() and self.outside_workspace_rad == 0.0

    @property
    def command(self) -> str:
        """The commanded pose, in mm and degrees."""
        x, y, z, tilt = self.commanded.to_mm_deg()
        return f"{x:g}, {y:g}, {z:g} mm, {tilt:g} deg"

    @property
    def title(self) -> str:
        """The same for a picture."""
        x, y, z, tilt = self.commanded.to_mm_deg()
        return f"x {x:z.0f}, y {y:z.0f}, z {z:z.0f} mm, tilt {tilt:z.1f}°"


def drive_words(mechanism: ClosedChainMechanism, drives: Mapping[str, float]) -> list[str]:
    """Return drive values (m, rad) by name in mm and degrees, as in the JSON output."""
    shown = {name: joint_shown(value, mechanism.unit_of(name)) for name, value in drives.items()}
    return [f"{name} {figure:.{4 if unit == 'mm' else 5}f} {unit}" for name, (figure, unit) in shown.items()]


def error_dataset(
    loops: LoopsFile, status: NDArray[np.str_], nominal: FloatArray, actual: FloatArray, coordinates: Mapping[str, Any]
) -> xr.Dataset:
    """Return nominal and actual poses, (n, frames, 3, 4) each, as a dataset with their differences.

    A pose whose ``status`` is not closed becomes NaN; ``coordinates`` are the commands.
    """
    import xarray as xr

    found = (status == STATUS_NAMES[CLOSED])[:, None, None, None]
    nominal, actual = np.where(found, nominal, np.nan), np.where(found, actual, np.nan)
    dims = ("pose", "frame", "axis")
    variables = {
        "nominal_position": (dims, nominal[..., 3], {"units": "m"}),
        "actual_position": (dims, actual[..., 3], {"units": "m"}),
        "error_position": (dims, actual[..., 3] - nominal[..., 3], {"units": "m"}),
        "nominal_rotation": (dims, rotation_vectors(nominal[..., :3]), {"units": "rad"}),
        "actual_rotation": (dims, rotation_vectors(actual[..., :3]), {"units": "rad"}),
        "error_rotation": (dims, rotation_vectors(actual[..., :3], since=nominal[..., :3]), {"units": "rad"}),
        "status": ("pose", status, {"comment": f"'{STATUS_NAMES[CLOSED]}', or why the pose is NaN"}),
    }
    comment = (
        f"poses in {loops.base_frame}; rotations are rotation vectors in its axes; errors are actual minus nominal"
    )
    labels = {"frame": list(loops.reported_frames), "axis": list("xyz"), **coordinates}
    return xr.Dataset(variables, labels, {"comment": comment})


def as_poses(poses: Any) -> FloatArray:
    """Return poses (n, 4): x, y, z in m, tilt in rad; raises BadInputError for other shapes and NaN."""
    demand = "poses must be finite numbers of the shape (n, 4): x, y, z in m and the tilt in rad"
    if isinstance(poses, Sequence) or getattr(poses, "dtype", None) == np.dtype(object):
        poses = [pose.values if isinstance(pose, PlatformPose) else pose for pose in poses]
    return finite(poses, (None, 4), demand)


def frames_of(mechanism: ClosedChainMechanism, position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return the reported frames, all fixed to the end body, shape (n, frames, 3, 4), from the end frame's pose."""
    frames = mechanism.loops.reported_frames
    T_end_frame = np.array([mechanism.placement_on_end(frame).homogeneous for frame in frames])
    T_base_end = np.concatenate([rotation, position[:, :, None]], axis=2)
    return np.asarray(T_base_end[:, None] @ T_end_frame)
