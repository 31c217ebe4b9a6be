"""The columns of a campaign: which there are and what they measure. Their names end in the unit.

The robot determines which drives, travels and thermometers there are. Internally, values are in m, rad, kg and s, and
temperatures in °C, as the names of the fields say.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.exceptions import CampaignError
from pouring_robot.io.quantity_columns import Quantity, QuantityTable, read_quantities
from pouring_robot.io.tables import Table
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.robot.description import robot_file
from pouring_robot.robot.description.definition import RobotDefinition

POSITION, ROTATION = robot_file.POSITION, robot_file.ROTATION
DISTANCE, DISTANCE_FROM = robot_file.DISTANCE
MEASURED, AMBIENT = robot_file.MEASURED, robot_file.AMBIENT
SET = ("mass", "length", "sign")
"""Kinds of conditions that are set row by row: loads, travels and sides; the others are measured."""
_STANDS, _LEAST_STEP = 1e-4, 1e-6
"""Share of a drive's range in a campaign, and m or rad; a smaller difference is jitter, and the drive stood still."""


def drive_names(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the names of the drives in a campaign."""
    return tuple(drive.column for drive in robot.drives)


def approach_names(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the columns that say from which side a drive came: +1 rising, -1 falling."""
    return tuple(drive.approach_column for drive in robot.drives)


def force_names(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the columns of the drives' forces: tension, or the moment along the motion, is positive."""
    return tuple(drive.force_column for drive in robot.drives)


def condition_headings(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the headings that columns of conditions may have."""
    return tuple(heading for quantity in robot.condition_columns for heading in quantity.headings)


def numeric_conditions(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the conditions that are one number a row: neither names nor sides of approach."""
    return tuple(q.name for q in robot.condition_columns if q.kind not in ("label", "sign", "force", "moment"))


def campaign_columns(robot: RobotDefinition) -> tuple[Quantity, ...]:
    """Return the columns of a campaign file; measured are positions, poses, distances, or redundant drives."""
    session, time, *others = robot.condition_columns
    placed = not robot.loops.redundant_drives
    return (
        Quantity("sample", "label"),
        session,
        time,
        *robot.drive_columns,
        *others,
        *(Quantity(name, "length", required=placed, unless=DISTANCE) for name in POSITION),
        *(Quantity(name, "angle", part_of="a rotation vector") for name in ROTATION),
        Quantity(DISTANCE, "length"),
        Quantity(DISTANCE_FROM, "label"),
    )


def read_columns(table: Table | Path, robot: RobotDefinition) -> QuantityTable:
    """Return the columns of a campaign's table, read if need be; raises CampaignError where they are wrong."""
    quantities = campaign_columns(robot)
    example = next(quantity for quantity in quantities if quantity.required).headings[-1]
    return read_quantities(table, quantities, example, CampaignError)


def array_names(robot: RobotDefinition) -> dict[str, tuple[str, ...]]:
    """Return the quantities in the columns of each array (n, k) of a campaign, by the name of its field."""
    return {
        "drives": drive_names(robot),
        "approach": approach_names(robot),
        "position_m": POSITION,
        "rotation_vector_rad": ROTATION,
        "distance_m": (DISTANCE,),
        "force": force_names(robot),
    }


def sessions_of(table: QuantityTable) -> tuple[str, ...]:
    """Return the session of each row, all "1" without a column; raises CampaignError where a cell of it is empty."""
    sessions = table.labels.get("session", ("1",) * len(table))
    if "" in sessions:
        problem = "the session is missing; name one in every row, or leave the column out"
        raise table.fault(problem, sessions.index(""), "session")
    return sessions


def runs_in_time(time_s: FloatArray, sessions: Sequence[object]) -> list[Indices]:
    """Return the rows by index in the order of time, in one run or in one a session.

    Given are time and session of each row, (n,). Where the order of time would mix sessions that follow each other in
    the table, each has a clock that was restarted.
    """
    order, names = np.argsort(time_s, kind="stable"), np.array(sessions)
    if np.count_nonzero(names[1:] != names[:-1]) >= np.count_nonzero(names[order][1:] != names[order][:-1]):
        return [order]
    return [order[names[order] == name] for name in dict.fromkeys(sessions)]


def from_the_row_before(
    drives: FloatArray, time_s: FloatArray | None = None, sessions: Sequence[str] | None = None
) -> FloatArray:
    """Return +1 where a drive rose to its value from the one before it in time, -1 where it fell, (n, drives).

    A drive that stood still keeps its side. NaN where the side is unknown: in the first row, also of a session, and
    after a row without a value. Without all times (n,), rows are in the order of measurement.
    """
    order: Indices = np.arange(len(drives))
    if time_s is not None and np.isfinite(time_s).all():
        order = np.concatenate(runs_in_time(time_s, sessions or ("",) * len(drives)))
    spread = np.nanmax(drives, axis=0, initial=-np.inf) - np.nanmin(drives, axis=0, initial=np.inf)
    still, sides = np.maximum(_STANDS * spread, _LEAST_STEP), np.full(drives.shape, np.nan)
    stood = side = np.full(drives.shape[1], np.nan)
    for number, row in enumerate(order):
        if sessions is not None and number and sessions[row] != sessions[order[number - 1]]:
            stood = side = np.full(drives.shape[1], np.nan)
        step = drives[row] - stood  # from where it last stopped, so that creep adds up
        moved = ~(np.abs(step) <= still)
        side = np.where(moved, np.sign(step), side)
        stood = np.where(moved, drives[row], stood)
        sides[row] = side
    return sides


def arrays_from(quantities: Mapping[str, FloatArray], robot: RobotDefinition) -> dict[str, Any]:
    """Return drives, approach, measurement and conditions of a campaign from its columns, (n,) each by quantity name.

    Absent drives and positions become NaN; other arrays are left out where all their columns are absent or empty.
    """
    known = {name for name, values in quantities.items() if np.isfinite(values).any()}
    absent = np.full(next(iter(quantities.values())).size, np.nan)
    arrays: dict[str, Any] = {
        array: np.stack([quantities.get(name, absent) for name in names], axis=-1)
        for array, names in array_names(robot).items()
        if array == "position_m" or not known.isdisjoint(names)
    }
    conditions = {name: quantities[name] for name in numeric_conditions(robot) if name in quantities}
    if "approach" in arrays:
        both = zip(robot.drives, arrays["approach"].T, strict=True)
        arrays["approach"] = np.column_stack([drive.side(sides) for drive, sides in both])
    return arrays | {"drives": robot.drive_values(quantities), "conditions": conditions}
