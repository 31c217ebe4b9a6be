"""The noise that plans and virtual measurements assume where none is stated."""

SIGMA = 5e-5
"""Standard deviation of a measured coordinate, in m, and of a rotation component, in rad."""
SIGMA_MM = SIGMA_MRAD = 1e3 * SIGMA
