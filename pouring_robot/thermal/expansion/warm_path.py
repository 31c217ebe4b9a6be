"""The robot as built along a path of poses, warm, all poses at once.

Temperatures are taken once a pose where the ladle is wanted, or twice: where it is commanded, poses near each other
sharing theirs, then where it is. Those of one pose start those of the next. One by one (``heated_robot``) they are
taken anew where the ladle is until that moves nothing. What this leaves out: legs are taken as long as the drawing's at
that place, millimetres off, which is about a kelvin.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pouring_robot.batch.samples import BatchClosure, BatchStart
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import drive_parameters
from pouring_robot.robot.location import as_poses
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.thermal.expansion.growth import ThermalExpansion
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot

if TYPE_CHECKING:
    import xarray as xr

_NO_LEG = (0.0, 0.0, 0.0, 0.0)
# Over as many metres and radians a leg's growth changes by 10 µm, which puts the ladle by a tenth of a millimetre where
# it is weak; legs there are warmer or colder by a thirtieth of a kelvin, which moves the lip by less than 10 µm.
_STANDS_IN = 0.005


def strains_along(heated: HeatedRobot, poses: FloatArray, threads: int = 2, show: Progress = say_nothing) -> FloatArray:
    """Return how much the parts have grown at poses that are held, (n, 6): legs, moving and fixed platform."""
    strain = np.zeros((len(poses), 6))
    if heated.heat is None or not len(poses):
        return strain
    done = [0]

    def take(rows: NDArray[np.intp]) -> None:
        own = HeatedRobot(heated.robot, heated.heat)  # networks keep poses, so each thread has its own
        field = None
        for row in rows:
            x, y, z, tilt = poses[row].tolist()
            field = own.field(PlatformPose((x, y, z), tilt), field)
            grown = own.expansion(field)
            strain[row] = *grown.leg_strain, grown.platform_strain, grown.fixed_platform_strain
            done[0] += 1
            show("temperatures", done[0], len(poses))

    pieces = np.array_split(np.arange(len(poses)), min(threads, len(poses)))
    with one_blas_thread(), ThreadPoolExecutor(len(pieces)) as pool:
        list(pool.map(take, pieces))
    return strain


class WarmPath:
    """Closes the robot as built, without loads, its parts grown pose by pose.

    Poses, commanded or wanted, are (n, 4), in m and rad; ``strain`` is their growth as :func:`strains_along` gives it.
    """

    def __init__(self, heated: HeatedRobot, poses: FloatArray, strain: FloatArray) -> None:
        robot = heated.robot
        self.strain, self.engine = strain, robot.engine()
        self.errors = self._displaced(heated) if strain.any() else None
        drives = robot.actual_solver.mechanism.loops.drives
        self.offsets = np.array(list(robot.actual_drives(dict.fromkeys(drives, 0.0)).values()))
        growing = [f"{leg}_s3" for leg in LEGS]
        legs = [growing.index(name) if name in growing else -1 for name in drives]
        self.growth = np.stack([1.0 + strain[:, k] if k >= 0 else np.ones(len(strain)) for k in legs], axis=1)
        self.command = robot.kinematics.commands(poses)

    def _displaced(self, heated: HeatedRobot) -> FloatArray:
        """Return what heat displaces of the joints as built, (n, sites * 6): H E = E (E⁻¹ H E), H a shift.

        The growth of a leg that is not driven changes nothing but the value of its own joint.
        """
        structure, built = self.engine.structure, heated.robot.model.placement_errors()
        errors = np.zeros((len(self.strain), structure.site_count, 6))
        for k, part in ((4, ThermalExpansion(_NO_LEG, 1.0, 0.0)), (5, ThermalExpansion(_NO_LEG, 0.0, 1.0))):
            for joint, shift in part.placements(heated.robot.kinematics).items():
                if np.any(shift.translation_m):
                    turned = built[joint].to_se3().rotation if joint in built else np.eye(3)
                    way = turned.T @ np.array(shift.translation_m)
                    errors[:, structure.site(joint), :3] += self.strain[:, k, None] * way
        return errors.reshape(len(errors), structure.site_count * 6)

    def close(self, drives: FloatArray, start: BatchStart) -> BatchClosure:
        """Return the closed robot for commanded drives (n, 4), in m and rad: offset, then grown with the leg."""
        return self.engine.close((drives + self.offsets) * self.growth, start, self.errors)

    def drives_to_end(self, closed: BatchClosure) -> FloatArray:
        """Return how the end frame follows commanded drives, (n, 6, 4): its origin (m), its rotation vector (rad)."""
        drives = drive_parameters(self.engine.structure.mechanism)
        return np.asarray(self.engine.transfer(closed, drives, self.errors).matrix * self.growth[:, None, :])


def locate_path(
    heated: HeatedRobot, poses: ArrayLike, threads: int = 2, show: Progress = say_nothing
) -> tuple[xr.Dataset, BatchClosure]:
    """Return where the ladle should be and where it is, warm, for many commanded poses, and the closures as built.

    Poses are x, y, z in m and the tilt in rad, shape (n, 4), best along a path; the dataset is as
    :meth:`PouringRobot.locate` gives for many. ``threads`` share the temperatures.

    Raises:
        BadInputError: the poses have another shape, or the robot carries loads.
        ThermalSolutionError: no temperatures are found.
    """
    commanded = place = as_poses(poses)
    if heated.heat is not None and len(commanded):  # millimetres beside the command shadows fall otherwise
        rows, row_of = np.unique(_stand_ins(commanded), return_inverse=True)
        warm = WarmPath(heated, commanded, strains_along(heated, commanded[rows], threads, show)[row_of])
        closed = warm.close(warm.command.drives, warm.command.start)
        tilt = np.arctan2(closed.rotation[:, 0, 2], closed.rotation[:, 2, 2])
        found = np.column_stack([closed.position, tilt])
        place = np.where(np.isfinite(found), found, commanded)
    warm = WarmPath(heated, commanded, strains_along(heated, place, threads, show))
    closed = warm.close(warm.command.drives, warm.command.start)
    return heated.robot.path_dataset(warm.command, closed), closed


def _stand_ins(poses: FloatArray) -> NDArray[np.intp]:
    """Return for each pose the one before it whose growth says well enough where it stands, or itself, (n,)."""
    chosen, last = np.arange(len(poses)), 0
    for row in range(1, len(poses)):
        if np.abs(poses[row] - poses[last]).max() < _STANDS_IN:
            chosen[row] = last
        else:
            last = row
    return chosen
