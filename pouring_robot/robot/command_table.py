"""Commands from a table, whose column names carry the units: poses, or drive values of any robot."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pouring_robot.exceptions import TableError
from pouring_robot.io.quantities import Quantity, read_quantities
from pouring_robot.io.tables import Table, read_table
from pouring_robot.io.units import to_inner
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import rotation_matrices
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.inverse import Target
from pouring_robot.robot.pouring.platform_pose import PlatformPose

_UNITS = {"x": ("mm", "m"), "y": ("mm", "m"), "z": ("mm", "m"), "tilt": ("deg", "rad", "mrad")}


def read_poses(path: Path | str) -> list[PlatformPose]:
    """Read commanded poses in the file's order; raises as :func:`read_pose_lines`."""
    return list(read_pose_lines(path).values())


def read_pose_lines(path: Path | str, beside: Iterable[str] = ()) -> dict[int, PlatformPose]:
    """Read commanded poses by line: columns x, y, z (``_mm`` or ``_m``) and tilt (``_deg``, ``_rad`` or ``_mrad``).

    Columns ``sample``, which plans have, and ``beside`` may stand there and are left out. Raises TableError where the
    file cannot be read, another column stands in it or one is missing, or a cell is no finite number.
    """
    table = read_table(path, "x_mm, y_mm, z_mm, tilt_deg")
    table.refuse_others([*(f"{name}_{unit}" for name, units in _UNITS.items() for unit in units), "sample", *beside])
    columns = [_column(table, name) for name in _UNITS]
    if not len(table):
        raise TableError(path, "holds no pose below its header line")
    poses = (PlatformPose((x, y, z), tilt) for x, y, z, tilt in zip(*(c.tolist() for c in columns), strict=True))
    return dict(zip(table.lines.tolist(), poses, strict=True))


def _column(table: Table, name: str) -> FloatArray:
    """Return the values of x, y, z (m) or tilt (rad), (n,)."""
    headings = [f"{name}_{unit}" for unit in _UNITS[name]]
    found = [heading for heading in table.headings if heading in headings]
    if len(found) != 1:
        problem = "stands twice" if found else "is missing"
        raise table.heading_fault(f"the column for {name} ({' or '.join(headings)}) {problem}")
    return to_inner(table.numbers(table.headings.index(found[0])), found[0].removeprefix(f"{name}_"))


def read_command_lines(path: Path | str, robot: RobotDefinition) -> dict[int, FloatArray | Target]:
    """Return drives (drives,), in m and rad, or targets, by line: a column a drive, or x, y, z and maybe rx, ry, rz.

    Raises TableError where the file cannot be read, a heading is misspelt, both kinds are there, or a value is missing.
    """
    places = tuple(Quantity(name, "length", part_of="a position") for name in "xyz")
    turns = tuple(Quantity(f"r{name}", "angle", part_of="a rotation vector") for name in "xyz")
    drives = robot.drive_columns
    headings = read_table(path, drives[0].canonical).headings
    posed, driven = (any(one in q.headings for one in headings for q in kind) for kind in (places, drives))
    if posed and driven:
        both = "drives and places both say where the robot is sent, and places may be a tracker's"
        raise TableError(path, f"{both}; keep the columns of one kind")
    columns = (*places, *turns) if posed else drives
    table = read_quantities(path, columns, columns[0].canonical)
    for quantity in (q for q in columns if q.name in table.numbers):
        missing = np.flatnonzero(~np.isfinite(table.numbers[quantity.name]))
        if missing.size:
            raise table.fault("the value is missing; a command has them all", int(missing[0]), quantity.name)
    lines = table.table.lines.tolist()
    if not posed:
        return dict(zip(lines, robot.drive_values(table.numbers), strict=True))
    position = np.stack([table.numbers[q.name] for q in places], axis=-1)
    if turns[0].name not in table.numbers:
        return {line: Target(place) for line, place in zip(lines, position, strict=True)}
    rotation = rotation_matrices(np.stack([table.numbers[q.name] for q in turns], axis=-1))
    return {line: Target(p, turned) for line, p, turned in zip(lines, position, rotation, strict=True)}
