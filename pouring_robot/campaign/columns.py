"""The columns of a campaign: which there are and what they measure. Units ride on their names.

Inside, values are in m, rad, kg and s, and temperatures in °C, as the names of the fields say.
"""

from __future__ import annotations

from pouring_robot.io.quantities import Quantity

LENGTH_DRIVES = ("q1", "q2", "q3")
DRIVES = (*LENGTH_DRIVES, "q4")
APPROACHES = tuple(f"approach_{drive}" for drive in DRIVES)
LEGS = ("leg1", "leg2", "leg3", "leg4")
TEMPERATURES = ("melt", "ambient", *LEGS, "platform")
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
    Quantity("q4", "angle", required=True),
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
