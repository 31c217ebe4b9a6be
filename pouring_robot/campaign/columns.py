"""The columns of a campaign: which there are and what they measure. Units ride on their names.

Inside, values are in m, rad, kg and s, and temperatures in °C, as the names of the fields say.
"""

from __future__ import annotations

from pouring_robot.io.quantities import Quantity, QuantityTable
from pouring_robot.robot.pouring.names import DRIVE_COLUMNS, LEGS

DRIVES = DRIVE_COLUMNS
LENGTH_DRIVES = DRIVES[:3]
APPROACHES = tuple(f"approach_{drive}" for drive in DRIVES)
PARTS = (*LEGS, "platform")
"""Parts of the robot with a thermometer."""
TEMPERATURES = ("melt", "ambient", *PARTS)
POSITION = ("x", "y", "z")
ROTATION = ("rx", "ry", "rz")

CONDITIONS = (
    Quantity("session", "label"),
    Quantity("time", "time"),
    *(Quantity(name, "sign") for name in APPROACHES),
    Quantity("payload", "mass"),
    Quantity("truss_travel", "length"),
    *(Quantity(name, "temperature") for name in TEMPERATURES),
)
"""What may be known of a pose besides drives and measurement; every one is optional."""

CAMPAIGN = (
    Quantity("sample", "label"),
    *CONDITIONS[:2],
    *(Quantity(name, "length", required=True) for name in LENGTH_DRIVES),
    Quantity(DRIVES[3], "angle", required=True),
    *CONDITIONS[2:],
    *(Quantity(name, "length", required=True) for name in POSITION),
    *(Quantity(name, "angle", part_of="a rotation vector") for name in ROTATION),
)
"""Columns of a campaign file."""

PLAN = (
    Quantity("sample", "label"),
    *(Quantity(name, "length", required=True) for name in POSITION),
    Quantity("tilt", "angle", required=True),
    *CONDITIONS,
)
"""Columns of a pose plan: the poses to command, and optional conditions."""


def sessions_of(table: QuantityTable) -> tuple[str, ...]:
    """Return the session of each row; all "1" without a column.

    Raises:
        CampaignError: a cell of the column is empty.
    """
    sessions = table.labels.get("session", ("1",) * len(table))
    if "" in sessions:
        problem = "the session is missing; name one in every row, or leave the column out"
        raise table.fault(problem, sessions.index(""), "session")
    return sessions
