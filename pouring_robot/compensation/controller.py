"""Compensation without this package: polynomials over the workspace, and a C header that a controller compiles.

What compensation adds to the drives of the drawing's inverse kinematics is a smooth function of the wanted pose. It is
interpolated in the Chebyshev points of the workspace box (Trefethen, Approximation Theory and Approximation Practice,
2013), and what that leaves is measured on poses that took no part.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from pouring_robot.compensation.path import PathSearch
from pouring_robot.exceptions import NoSolutionError
from pouring_robot.mechanism.arrays import FloatArray, lock_fields
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.report.result import Result
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot
from pouring_robot.thermal.expansion.warm_path import Show, strains_along

if TYPE_CHECKING:
    import pandas as pd

POINTS = (5, 5, 7, 8)
"""Chebyshev points along x, y, z and the tilt."""
CHECKED, _SEED = 1000, 41
_HEADER = Path(__file__).with_name("controller.h.j2")


@dataclass(frozen=True, eq=False, repr=False)
class Controller(Result):
    """Polynomials that give drives for wanted poses, and how far off they are.

    Attributes:
        frame: whose position is brought to where it is wanted.
        lower, upper: corners of the box of wanted poses: x, y, z in m, tilt in rad, shape (4,) each.
        coefficients: of Chebyshev polynomials over the box, for what is added to each drive, shape (4, *POINTS).
        fixed_centres_m, moving_centres_m: of the drawing's inverse kinematics, shape (4, 3) each.
        drive_error: largest difference to the drives that the package finds, in m and rad, shape (4,).
        place_error_m: largest distance of the frame from where it is wanted.
        tilt_error_rad: largest difference of the tilt.
        checked: how many random poses the errors are of.
    """

    frame: str
    lower: FloatArray
    upper: FloatArray
    coefficients: FloatArray
    fixed_centres_m: FloatArray
    moving_centres_m: FloatArray
    drive_error: FloatArray
    place_error_m: float
    tilt_error_rad: float
    checked: int

    def __post_init__(self) -> None:
        """Lock the arrays."""
        lock_fields(self, "lower", "upper", "coefficients", "fixed_centres_m", "moving_centres_m", "drive_error")

    @property
    def headline(self) -> str:
        """How near it comes to what the package finds."""
        legs, tilt = self.drive_error[:3].max() / MM, self.drive_error[3] / MRAD
        return (
            f"on {self.checked} random poses within {legs:.1e} mm and {tilt:.1e} mrad of the package's drives; "
            f"'{self.frame}' comes within {self.place_error_m / MM:.1e} mm and {self.tilt_error_rad / MRAD:.1e} mrad"
        )

    def to_frame(self) -> pd.DataFrame:
        """Return the largest difference of each drive."""
        import pandas as pd

        units = ("mm", "mm", "mm", "mrad")
        errors = self.drive_error / np.array([MM, MM, MM, MRAD])
        return pd.DataFrame({"drive": [f"q{k}" for k in range(1, 5)], "unit": units, "largest_error": errors})

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


def make_controller(heated: HeatedRobot, frame: str | None = None, show: Show | None = None) -> Controller:
    """Return polynomials for the robot as built and as warm as it is, over the workspace box.

    Args:
        heated: the robot as built and how warm it is; without loads.
        frame: the frame whose position shall be right; by default the moving platform.
        show: told of progress: stage, done, of how many.

    Raises:
        BadInputError: the robot carries loads.
        NoSolutionError: somewhere in the box there are no drive values.
    """
    kinematics, (lower, upper) = heated.robot.kinematics, heated.robot.layout.box
    nodes = [chebyshev.chebpts1(count) for count in POINTS]
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 4)
    random = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (CHECKED, 4))
    poses = lower + (upper - lower) * (np.concatenate([grid, random]) + 1.0) / 2.0
    search = PathSearch(heated, poses, frame, strains_along(heated, poses, show=show))
    found = search.run(limits=False)
    if not np.isfinite(found.drives).all():
        raise NoSolutionError(f"a controller needs an answer everywhere in the workspace box: {found.headline}")
    added = (found.drives - kinematics.commands(poses).drives)[: len(grid)].reshape(*POINTS, 4)
    for axis, points in enumerate(nodes):
        inverse = np.linalg.inv(chebyshev.chebvander(points, len(points) - 1))
        added = np.moveaxis(np.tensordot(inverse, added, axes=(1, axis)), 0, axis)
    zero = np.zeros(4)
    coefficients, centres = np.moveaxis(added, -1, 0), (kinematics.fixed_centres_m, kinematics.moving_centres_m)
    made = Controller(search.frame, lower, upper, coefficients, *centres, zero, 0.0, 0.0, 0)
    drives = made.drives(kinematics, poses)
    off, left = np.abs(drives - found.drives)[len(grid) :], search.left_with(drives)[len(grid) :]
    place, tilt = float(np.linalg.norm(left[:, :3], axis=1).max()), float(np.abs(left[:, 3]).max())
    return Controller(search.frame, lower, upper, coefficients, *centres, off.max(axis=0), place, tilt, CHECKED)
