"""Compensation without this package: polynomials over the workspace, and a C header that a controller compiles.

What compensation adds to the drives of the drawing's inverse kinematics is a smooth function of the wanted pose. It is
interpolated in the n Chebyshev points of each axis of the workspace box, the zeros of the polynomial T_n (Trefethen,
Approximation Theory and Approximation Practice, 2013, chapter 4). What that leaves is, axis by axis, T_n times a
function that changes little between two zeros. So it is largest where all |T_n| are 1 at once: on the grid of their
n + 1 extrema, the corners, edges and faces of the box among them, where the terms of the axes also meet with all signs.
There it is measured. Where heat's kinks are more than T_n can say, as where a bar rises over the ladle's rim, the error
climbs on from there to its tops; what is stated is the highest, rounded up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from pouring_robot.compensation.path import PathSearch
from pouring_robot.exceptions import NoSolutionError
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray, lock_fields
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.report.result import Result
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot
from pouring_robot.thermal.expansion.warm_path import strains_along

POINTS = (5, 5, 7, 8)
"""Chebyshev points along x, y, z and the tilt."""
_CLIMBERS, _TRIES, _CLIMBS, _SEED = 8, 8, 4, 41
_HEADER = Path(__file__).with_name("controller.h.j2")


@dataclass(frozen=True, eq=False, repr=False)
class Controller(Result):
    """Polynomials that give drives for wanted poses, and how far off they are."""

    frame: str  # whose position is brought to where it is wanted
    lower: FloatArray  # corners of the box of wanted poses: x, y, z in m, tilt in rad, shape (4,)
    upper: FloatArray
    # of Chebyshev polynomials over the box, for what is added to each drive, shape (4, *POINTS)
    coefficients: FloatArray
    fixed_centres_m: FloatArray  # of the drawing's inverse kinematics, shape (4, 3)
    moving_centres_m: FloatArray
    drive_error: FloatArray  # largest difference to the drives that the package finds, in m and rad, shape (4,)
    place_error_m: float  # largest distance of the frame from where it is wanted
    tilt_error_rad: float  # and of the tilt
    # at how many poses, where they are largest, the errors were measured; they are rounded up to two digits
    checked: int

    def __post_init__(self) -> None:
        lock_fields(self, "lower", "upper", "coefficients", "fixed_centres_m", "moving_centres_m", "drive_error")

    @property
    def headline(self) -> str:
        """How near it comes to what the package finds."""
        legs, tilt = self.drive_error[:3].max() / MM, self.drive_error[3] / MRAD
        return (
            f"all over the workspace within {legs:.1e} mm and {tilt:.1e} mrad of the package's drives, by "
            f"{self.checked} poses; '{self.frame}' comes within {self.place_error_m / MM:.1e} mm and "
            f"{self.tilt_error_rad / MRAD:.1e} mrad"
        )

    def _table(self) -> Any:
        """The largest difference of each drive."""
        units = ("mm", "mm", "mm", "mrad")
        errors = self.drive_error / np.array([MM, MM, MM, MRAD])
        return {"drive": [f"q{k}" for k in range(1, 5)], "unit": units, "largest_error": errors}

    def drives(self, kinematics: FourUPUKinematics, poses: FloatArray) -> FloatArray:
        """Return the drives for wanted poses in the box, (n, 4): x, y, z in m and the tilt in rad."""
        return np.asarray(kinematics.commands(poses).drives + self.added(poses))

    def added(self, poses: FloatArray) -> FloatArray:
        """Return what is added to the drives of the drawing, (n, 4), in m and rad."""
        scaled = 2.0 * (poses - self.lower) / (self.upper - self.lower) - 1.0
        x, y, z, r = (chebyshev.chebvander(scaled[:, k], POINTS[k] - 1) for k in range(4))
        return np.asarray(np.einsum("dijkl,ni,nj,nk,nl->nd", self.coefficients, x, y, z, r, optimize=True))

    def header(self) -> str:
        """Return it as a C header: one function, no memory, no library but math.h."""
        import jinja2

        def listed(array: FloatArray) -> str:
            if array.ndim == 1:
                return "{" + ", ".join(repr(float(value)) for value in array) + "}"
            return "{" + ",\n".join(listed(part) for part in array) + "}"

        template = jinja2.Template(_HEADER.read_text(encoding="utf-8"), keep_trailing_newline=True)
        return str(template.render(controller=self, points=POINTS, listed=listed))


def make_controller(heated: HeatedRobot, frame: str | None = None, show: Progress = say_nothing) -> Controller:
    """Return polynomials for the robot as built and as warm as it is, over the workspace box.

    ``frame``: whose position shall be right; by default the moving platform.

    Raises:
        BadInputError: the robot carries loads.
        NoSolutionError: somewhere in the box there are no drive values.
    """
    kinematics, (lower, upper) = heated.robot.kinematics, heated.robot.layout.box

    def searched(scaled: FloatArray) -> tuple[FloatArray, PathSearch]:
        poses = np.asarray(lower + (upper - lower) * (scaled + 1.0) / 2.0)
        return poses, PathSearch(heated, poses, frame, strains_along(heated, poses, show=show))

    nodes = [chebyshev.chebpts1(count) for count in POINTS]
    poses, search = searched(_grid(nodes))
    added = (_found(search) - kinematics.commands(poses).drives).reshape(*POINTS, 4)
    for axis, points in enumerate(nodes):
        inverse = np.linalg.inv(chebyshev.chebvander(points, len(points) - 1))
        added = np.moveaxis(np.tensordot(inverse, added, axes=(1, axis)), 0, axis)
    coefficients, centres = np.moveaxis(added, -1, 0), (kinematics.fixed_centres_m, kinematics.moving_centres_m)
    made = Controller(search.frame, lower, upper, coefficients, *centres, np.zeros(4), 0.0, 0.0, 0)

    def errors(scaled: FloatArray) -> FloatArray:
        """Return errors of drives, place and tilt, (n, 6), at places in the box from -1 to 1, (n, 4)."""
        poses, search = searched(scaled)
        drives = made.drives(kinematics, poses)
        off, left = drives - _found(search), search.left_with(drives)
        return np.asarray(np.abs(np.column_stack([off, np.linalg.norm(left[:, :3], axis=1), left[:, 3]])))

    largest, checked = _largest(errors, _grid([chebyshev.chebpts2(count + 1) for count in POINTS]))
    *drive_error, place, tilt = (rounded_up(value) for value in largest.tolist())
    return replace(made, drive_error=np.array(drive_error), place_error_m=place, tilt_error_rad=tilt, checked=checked)


def _grid(axes: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4))


def _found(search: PathSearch) -> FloatArray:
    """Return the drives that the package finds, (n, 4)."""
    found = search.run(limits=False)
    if not np.isfinite(found.drives).all():
        raise NoSolutionError(f"a controller needs an answer everywhere in the workspace box: {found.headline}")
    return found.drives


def _largest(errors: Callable[[FloatArray], FloatArray], extrema: FloatArray) -> tuple[FloatArray, int]:
    """Return the largest of each error, (6,), and at how many places of the box they were looked at.

    From the worst extrema of each it climbs: tries places around, goes to the best, looks nearer.
    """
    at_extrema, random = errors(extrema), np.random.default_rng(_SEED)
    columns = np.arange(at_extrema.shape[1])
    worst = np.argsort(at_extrema, axis=0)[-_CLIMBERS:].T  # (6, climbers)
    places, best = extrema[worst], at_extrema[worst, columns[:, None]]
    reach = np.array([np.pi / 2.0 / count for count in POINTS])  # half of the widest way between extrema, about
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
