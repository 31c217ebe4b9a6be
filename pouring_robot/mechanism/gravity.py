"""The magnitude of gravity, the same in the whole package."""

GRAVITY_M_S2 = 9.80665
"""Standard gravity; Pinocchio's own default is 9.81."""
