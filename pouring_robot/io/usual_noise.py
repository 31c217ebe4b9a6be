"""The noise that plans and virtual measurements count with where nothing is said of it."""

SIGMA = 5e-5
"""Standard deviation of a measured coordinate, in m, and of a rotation component, in rad."""
SIGMA_MM = SIGMA_MRAD = 1e3 * SIGMA
