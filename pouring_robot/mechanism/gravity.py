"""Gravity, the same in the whole package."""

GRAVITY_M_S2 = 9.80665
"""Standard gravity; Pinocchio's own default is 9.81."""
GRAVITY = (0.0, 0.0, -GRAVITY_M_S2)
"""The acceleration, in m/s², in the axes of a URDF's root link."""
