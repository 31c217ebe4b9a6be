"""The units of the user's edge: errors are shown in mm and mrad, joint values in mm and degrees."""

import math

MM = 1e-3
MRAD = 1e-3
DEG = math.radians(1.0)
_OF_ERRORS = {
    "m": ("mm", MM),
    "rad": ("mrad", MRAD),
    "m/N": ("µm/kN", 1e-9),
    "rad/Nm": ("mrad/kNm", 1e-6),
    "1/K": ("1e-6/K", 1e-6),
}


def shown_in(unit: str) -> tuple[str, float]:
    """Return in what errors and what makes them are shown, and how large that is, in their own unit (SI)."""
    return _OF_ERRORS[unit]


def joint_shown_in(unit: str) -> tuple[str, float]:
    """Return in what joint values of a unit, m or rad, are shown, and how large that is in it."""
    return ("mm", MM) if unit == "m" else ("deg", DEG)
