"""Commands read from a table with units in its column names: poses, or drive values of any robot."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pouring_robot.exceptions import TableError
from pouring_robot.io.quantity_columns import Quantity, read_quantities, whole_column
from pouring_robot.io.tables import read_table
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import rotation_matrices
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.inverse import Target
from pouring_robot.robot.pouring.platform_pose import PLATFORM_POSE, POSE_COLUMNS, PlatformPose


def read_poses(path: Path | str) -> list[PlatformPose]:
    """Read commanded poses in the file's order; raises the errors of :func:`read_pose_lines`."""
    return list(read_pose_lines(path).values())


def read_pose_lines(
    path: Path | str, beside: Iterable[str] = (), drives: Iterable[Quantity] = ()
) -> dict[int, PlatformPose]:
    """Read commanded poses, by line number, from the columns of :data:`PLATFORM_POSE`.

    The columns ``beside``, and ``sample``, which plans have, are allowed and ignored. Raises TableError where the file
    cannot be read, has another column, such as one of ``drives``, or lacks one, or where a cell is not a finite number.
    """
    wanted = ", ".join(POSE_COLUMNS)
    table = read_table(path, wanted)
    driven = {heading for drive in drives for heading in drive.headings}.intersection(table.headings)
    if driven:
        said = f"'{min(driven)}' is the column of a drive, as in a campaign, whose positions are measured"
        raise table.heading_fault(f"{said}; this takes poses of the platform, in the columns {wanted}")
    table.refuse_others([*(heading for quantity in PLATFORM_POSE for heading in quantity.headings), "sample", *beside])
    columns = [whole_column(table, quantity)[1].tolist() for quantity in PLATFORM_POSE]
    if not len(table):
        raise TableError(path, "holds no pose below its header line")
    poses = map(PlatformPose.of_values, zip(*columns, strict=True))
    return dict(zip(table.lines.tolist(), poses, strict=True))


def read_command_lines(path: Path | str, robot: RobotDefinition) -> dict[int, FloatArray | Target]:
    """Return drive values (drives,), in m and rad, or targets, by line number.

    The table has a column for each drive, or x, y, z and optionally rx, ry, rz. Raises TableError where the file cannot
    be read, a heading is misspelt, columns of both kinds are present, or a value is missing.
    """
    places = tuple(Quantity(name, "length", part_of="a position") for name in "xyz")
    turns = tuple(Quantity(f"r{name}", "angle", part_of="a rotation vector") for name in "xyz")
    drives = robot.drive_columns
    headings = read_table(path, drives[0].canonical).headings
    posed, driven = (any(one in q.headings for one in headings for q in kind) for kind in (places, drives))
    if posed and driven:
        both = "drives and positions both give the command, and positions may be measured ones"
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
