"""Drive values for a whole path at once: Newton over all poses, with the compiled engine.

For single poses (:func:`~pouring_robot.compensation.pose.compensate`) temperatures are computed again where the ladle
then is, until that changes nothing. A compensated ladle is where it is wanted, except for roll and yaw, so here they
are computed there, once (:mod:`pouring_robot.thermal.expansion.warm_pouring_robot`).

For compensation without this package there are polynomials over the workspace, in a C header that a controller
compiles. What compensation adds to the drives of the drawing's inverse kinematics is a smooth function of the wanted
pose. It is interpolated at the n Chebyshev points of each axis of the workspace box, the zeros of the polynomial T_n
(Trefethen, Approximation Theory and Approximation Practice, 2013, chapter 4). The error is, axis by axis, T_n times a
function that changes little between two zeros. So it is largest where all |T_n| are 1 at once: on the grid of their
n + 1 extrema, among them the corners, edges and faces of the box, where the terms of the axes also combine with all
signs. There it is measured. Where kinks due to heat go beyond T_n, as where a bar rises over the ladle's rim, a search
climbs from there to the maxima of the error; the largest, rounded up, is stated.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from pouring_robot import __version__
from pouring_robot.batch.records import BatchClosure
from pouring_robot.compensation.pose import LOCKED, MOST_STEPS, least_commanded
from pouring_robot.exceptions import NoSolutionError
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.seeds import CLIMBS_SEED
from pouring_robot.io.units import DEG, MM, MRAD
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, ReadOnly, grid
from pouring_robot.mechanism.closure.status import CLOSED, SINGULAR, STATUS_NAMES
from pouring_robot.mechanism.joint_limits import within_limits
from pouring_robot.mechanism.rotations import moved_point, rotation_vectors, tilt_rates, tilts
from pouring_robot.report.page import templates
from pouring_robot.report.result import Result
from pouring_robot.robot.inverse import REACHED, limited, settled
from pouring_robot.robot.location import OUT_OF_REACH, as_poses
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.names import DRIVE_COLUMNS
from pouring_robot.robot.pouring.platform_pose import POSE_COLUMNS
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, WarmPath, strains_along

NOT_FOUND = "not found"
POINTS = (5, 5, 7, 8)
"""Chebyshev points along x, y, z and the tilt."""
_CLIMBERS, _TRIES, _CLIMBS = 8, 8, 4


@dataclass(frozen=True, eq=False, repr=False)
class CompensatedPath(ReadOnly, Result):
    """What to command along a path, and its results; arrays are read-only, NaN where there is no answer."""

    frame: str  # the frame whose position is brought to where it is wanted
    wanted: FloatArray  # x, y, z in m and the tilt in rad, shape (n, 4)
    drives: FloatArray  # values to command, in m and rad, shape (n, 4)
    before_m: FloatArray  # error of the frame without compensation, at the same temperatures, shape (n,)
    left: FloatArray  # remaining error of x, y, z of the frame (m) and of the tilt (rad), shape (n, 4)
    roll_yaw_rad: FloatArray  # the rotations that cannot be commanded, about x and z, shape (n, 2)
    strain: FloatArray  # growth per length of legs 1 to 4, moving and fixed platform, shape (n, 6)
    status: NDArray[np.str_]  # ``closed``, or why there is no answer, shape (n,)

    @property
    def answered(self) -> BoolArray:
        """Which poses have an answer, shape (n,)."""
        return np.asarray(self.status == STATUS_NAMES[CLOSED])

    @property
    def headline(self) -> str:
        """How many poses, and how far off the frame was and is."""
        found = self.answered
        if not found.any():
            return f"no drive values for any of {len(found)} poses: {self.status[0] if len(found) else 'there is none'}"
        before, left = self.before_m[found].max(), np.linalg.norm(self.left[found, :3], axis=1).max()
        return (
            f"{found.sum()} of {len(found)} poses: '{self.frame}' is at most {before / MM:.3f} mm off without "
            f"compensation{', as warm,' if self.strain.any() else ','} {left / MM:.1e} mm with it"
        )

    def _table(self) -> Any:
        scales = np.array([MM, MM, MM, DEG])
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

    Poses are x, y, z in m and the tilt in rad, shape (n, 4), best along a path: each starts from its neighbour.
    ``frame``: whose position shall be right; by default the moving platform. ``threads`` share the temperatures.

    Raises:
        BadInputError: the poses have another shape, the robot carries loads, or is not given as a HeatedRobot.
        UnknownFrameError: there is no such frame.
        ThermalSolutionError: no temperatures are found.
    """
    expect(heated, HeatedRobot, "a path takes a HeatedRobot, such as HeatedRobot(robot) of a cold robot")
    wanted = as_poses(poses)
    return PathSearch(heated, wanted, frame, strains_along(heated, wanted, threads, show)).run()


class PathSearch:
    """Newton over all poses at once, on the robot as built with thermal growth of its parts.

    Arguments and errors are those of :func:`compensate_path`; ``strain`` is that of :func:`strains_along`.
    """

    def __init__(self, heated: HeatedRobot, wanted: FloatArray, frame: str | None, strain: FloatArray) -> None:
        self.warm = WarmPath(heated, wanted, strain)
        self.kinematics, actual = heated.robot.kinematics, heated.robot.actual_solver.mechanism
        self.wanted, self.start = wanted, self.warm.command.start
        self.frame = frame or str(actual.loops.end_frame)
        self.on_end = actual.placement_on_end(self.frame).translation
        nominal = self.kinematics.mechanism.placement_on_end(self.frame).translation
        self.target = self.start.position + self.start.rotation @ nominal

    def run(self, *, limits: bool = True) -> CompensatedPath:
        """Step until every pose is reached or no longer gets nearer.

        ``limits``: whether poses in which a joint is, or a drive is commanded, beyond its limits have no answer.
        """
        drives, start = self.warm.command.drives, self.start
        best = np.full(len(drives), np.inf)
        closed = self.warm.close(drives, start)
        left = before = self.left(closed)
        for _ in range(MOST_STEPS):
            size = np.abs(left).max(axis=1)
            going = closed.closed & ~settled(size, best)
            if not going.any():
                break
            best = np.minimum(best, np.where(np.isfinite(size), size, np.inf))
            step = limited(self._step(closed, left), self.kinematics.mechanism)
            drives = np.where(going[:, None], drives - step, drives)
            start = start.replaced(np.arange(len(drives)), closed)
            closed = self.warm.close(drives, start)
            left = self.left(closed)
        with np.errstate(invalid="ignore"):
            met = np.abs(left).max(axis=1) < REACHED
            driven = dict(zip(self.kinematics.mechanism.loops.drives, drives.T, strict=True))
            within = self.kinematics.in_reach(closed.as_start()) & within_limits(self.kinematics.mechanism, driven)
        reached = closed.closed & met
        status = np.array(STATUS_NAMES)[closed.status].astype(object)
        status[closed.closed & ~met] = NOT_FOUND
        status[~np.isfinite(drives).all(axis=1)] = STATUS_NAMES[SINGULAR]
        # A pose beyond the limits may also not close or not be reached: the limit can be mended, so it is stated.
        status[np.where(reached, ~within & limits, ~self.kinematics.in_reach(self.start))] = OUT_OF_REACH
        found = (status == STATUS_NAMES[CLOSED])[:, None]
        turned = rotation_vectors(closed.rotation, since=self.start.rotation)[:, [0, 2]]
        drives, before, left, turned = (np.where(found, values, np.nan) for values in (drives, before, left, turned))
        before_m, strain = np.linalg.norm(before[:, :3], axis=1), self.warm.strain
        return CompensatedPath(self.frame, self.wanted, drives, before_m, left, turned, strain, status.astype(str))

    def left(self, closed: BatchClosure) -> FloatArray:
        """Return how far x, y, z of the frame (m) and the tilt (rad) are off, shape (n, 4)."""
        place = closed.position + closed.rotation @ self.on_end
        return np.column_stack([place - self.target, tilts(closed.rotation) - self.wanted[:, 3]])

    def _step(self, closed: BatchClosure, left: FloatArray) -> FloatArray:
        """Return what to subtract from the drives, (n, 4); NaN where they do not command all that is wanted."""
        moved = self.warm.drives_to_end(closed)
        place = moved_point(moved, closed.rotation @ self.on_end)
        matrix = np.concatenate([place, tilt_rates(closed.rotation, moved[:, 3:])[:, None]], axis=1)
        good = np.isfinite(matrix).all(axis=(1, 2))
        good[good] = least_commanded(matrix[good]) > LOCKED
        step = np.full(left.shape, np.nan)
        step[good] = np.linalg.solve(matrix[good], left[good][:, :, None])[:, :, 0]
        return step


@dataclass(frozen=True, eq=False, repr=False)
class Controller(ReadOnly, Result):
    """Polynomials that give drives for wanted poses, and their errors."""

    frame: str  # whose position is brought to where it is wanted
    robot: str  # which robot it is for, in words
    heat: str  # and how warm that is
    lower: FloatArray  # corners of the box of wanted poses: x, y, z in m, tilt in rad, shape (4,)
    upper: FloatArray
    # of Chebyshev polynomials over the box, for what is added to each drive, shape (4, *POINTS)
    coefficients: FloatArray
    fixed_centres_m: FloatArray  # of the drawing's inverse kinematics, shape (4, 3)
    moving_centres_m: FloatArray
    drive_error: FloatArray  # largest difference from the drives that the package finds, in m and rad, shape (4,)
    place_error_m: float  # largest distance of the frame from where it is wanted
    tilt_error_rad: float  # and of the tilt
    # number of poses, those of the largest errors, at which these were measured; they are rounded up to two digits
    checked: int

    @property
    def headline(self) -> str:
        """How near it comes to what the package finds."""
        length, tilt = self.drive_error[:3].max() / MM, self.drive_error[3] / MRAD
        return (
            f"throughout the workspace within {length:.1e} mm and {tilt:.1e} mrad of the package's drives, checked "
            f"at {self.checked} poses; '{self.frame}' comes within {self.place_error_m / MM:.1e} mm and "
            f"{self.tilt_error_rad / MRAD:.1e} mrad"
        )

    def _table(self) -> Any:
        units = ("mm", "mm", "mm", "mrad")
        errors = self.drive_error / np.array([MM, MM, MM, MRAD])
        return {"drive": [f"q{k}" for k in range(1, 5)], "unit": units, "largest_error": errors}

    def drives(self, kinematics: FourUPUKinematics, poses: FloatArray) -> FloatArray:
        """Return the drives for wanted poses in the box, (n, 4): x, y, z in m and the tilt in rad."""
        scaled = 2.0 * (poses - self.lower) / (self.upper - self.lower) - 1.0
        x, y, z, r = (chebyshev.chebvander(scaled[:, k], POINTS[k] - 1) for k in range(4))
        added = np.einsum("dijkl,ni,nj,nk,nl->nd", self.coefficients, x, y, z, r, optimize=True)
        return np.asarray(kinematics.commands(poses).drives + added)

    def header(self) -> str:
        """Return them as a C header: one function, without memory, and without libraries other than math.h."""

        def listed(array: FloatArray) -> str:
            if array.ndim == 1:
                return "{" + ", ".join(repr(float(value)) for value in array) + "}"
            return "{" + ",\n".join(listed(part) for part in array) + "}"

        template = templates("pouring_robot.compensation").get_template("controller.h.j2")
        return template.render(controller=self, points=POINTS, listed=listed, version=__version__)


def make_controller(heated: HeatedRobot, frame: str | None = None, show: Progress = say_nothing) -> Controller:
    """Return polynomials for the robot as built and as warm as it is, over the workspace box.

    ``frame``: whose position shall be right; by default the moving platform. Raises BadInputError for a robot that
    carries loads, NoSolutionError if the box has a place without drive values.
    """
    kinematics, (lower, upper) = heated.robot.kinematics, heated.robot.layout.box

    def searched(scaled: FloatArray) -> tuple[FloatArray, PathSearch]:
        poses = np.asarray(lower + (upper - lower) * (scaled + 1.0) / 2.0)
        return poses, PathSearch(heated, poses, frame, strains_along(heated, poses, show=show))

    nodes = [chebyshev.chebpts1(count) for count in POINTS]
    poses, search = searched(grid(*nodes))
    added = (_found(search) - kinematics.commands(poses).drives).reshape(*POINTS, 4)
    for axis, points in enumerate(nodes):
        inverse = np.linalg.inv(chebyshev.chebvander(points, len(points) - 1))
        added = np.moveaxis(np.tensordot(inverse, added, axes=(1, axis)), 0, axis)
    coefficients, centres = np.moveaxis(added, -1, 0), (kinematics.fixed_centres_m, kinematics.moving_centres_m)
    model = heated.robot.model
    made_for = (
        f"layout {model.layout}, {f'model file {model.file}' if model.file else 'no model file'}",
        heated.summary(),
    )
    made = Controller(search.frame, *made_for, lower, upper, coefficients, *centres, np.zeros(4), 0.0, 0.0, 0)

    def errors(scaled: FloatArray) -> FloatArray:
        """Return errors of drives, position and tilt, (n, 6), at points in the box from -1 to 1, (n, 4)."""
        poses, search = searched(scaled)
        drives = made.drives(kinematics, poses)
        off, left = drives - _found(search), search.left(search.warm.close(drives, search.start))
        return np.asarray(np.abs(np.column_stack([off, np.linalg.norm(left[:, :3], axis=1), left[:, 3]])))

    largest, checked = _largest(errors, grid(*(chebyshev.chebpts2(count + 1) for count in POINTS)))
    *drive_error, place, tilt = (rounded_up(value) for value in largest.tolist())
    return replace(made, drive_error=np.array(drive_error), place_error_m=place, tilt_error_rad=tilt, checked=checked)


def _found(search: PathSearch) -> FloatArray:
    """Return the drives that the package finds, (n, 4)."""
    found = search.run(limits=False)
    if not np.isfinite(found.drives).all():
        raise NoSolutionError(f"a controller needs an answer everywhere in the workspace box: {found.headline}")
    return found.drives


def _largest(errors: Callable[[FloatArray], FloatArray], extrema: FloatArray) -> tuple[FloatArray, int]:
    """Return the largest of each error, (6,), and at how many points of the box they were evaluated.

    From the worst extrema of each it climbs: it tries points around, moves to the best and tries nearer ones.
    """
    at_extrema, random = errors(extrema), np.random.default_rng(CLIMBS_SEED)
    columns = np.arange(at_extrema.shape[1])
    worst = np.argsort(at_extrema, axis=0)[-_CLIMBERS:].T  # (6, climbers)
    places, best = extrema[worst], at_extrema[worst, columns[:, None]]
    reach = np.array([np.pi / 2.0 / count for count in POINTS])  # about half of the widest distance between extrema
    for _ in range(_CLIMBS):
        shifts = reach * random.uniform(-1.0, 1.0, (*places.shape[:2], _TRIES, 4))
        tries = np.concatenate([places[:, :, None], np.clip(places[:, :, None] + shifts, -1.0, 1.0)], axis=2)
        found = errors(tries[:, :, 1:].reshape(-1, 4)).reshape(*places.shape[:2], _TRIES, -1)
        own = np.concatenate([best[:, :, None], found[columns, :, :, columns]], axis=2)
        chosen = own.argmax(axis=2)[:, :, None]
        best = np.take_along_axis(own, chosen, axis=2)[:, :, 0]
        places = np.take_along_axis(tries, chosen[..., None], axis=2)[:, :, 0]
        reach = reach / 2.0
    return best.max(axis=1), len(extrema) + _CLIMBS * worst.size * _TRIES


def rounded_up(value: float) -> float:
    """Return the next larger number of two digits."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit) * unit
