"""What a sensitivity study is asked for."""

from dataclasses import dataclass

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.poses import MM, MRAD

Range = tuple[float, float]


@dataclass(frozen=True)
class Request:
    """What to study.

    Raises:
        BadInputError: a number is out of its range.
    """

    poses: int = 10_000  # how many; of a robot without a workspace box at most so many, those that close
    seed: int = 2022  # of their drawing from the workspace box; drive values of other robots are spread evenly
    length_m: float = 0.2 * MM  # size of an error; the default is the paper's, here and below
    angle_rad: float = 4.0 * MRAD
    # limits of x, y, z (m) and tilt (rad) in place of the workspace's; the pouring robot only
    box: tuple[Range | None, Range | None, Range | None, Range | None] = (None, None, None, None)
    # sets, groups, names or patterns; by default the DH table, or all places, axes and drives
    parameters: tuple[str, ...] = ()
    frame: str | None = None  # whose displacement counts; by default the end frame
    limit_m: float = MM  # errors that pass it in a coordinate are those to control
    nothing_m: float = 1e-3 * MM  # below it an error counts as without influence
    nothing_rad: float = 1e-5

    def __post_init__(self) -> None:
        if self.poses < 2 or self.seed < 0:
            raise BadInputError(f"give two poses or more and a seed from 0 on, not {self.poses} and {self.seed}")
        if not (0.0 < self.length_m < 0.1 and 0.0 < self.angle_rad < 0.5 and self.limit_m > 0.0):
            raise BadInputError("errors and limit must be positive, errors below 100 mm and 500 mrad")
        for limits in self.box:
            if limits is not None and not limits[0] <= limits[1]:
                raise BadInputError(f"a range must run upwards, not from {limits[0]:g} to {limits[1]:g}")
