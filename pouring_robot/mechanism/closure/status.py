"""How a closure ended: the codes that batch engines and their kernels write of samples, and what each is called."""

CLOSED, NOT_CONVERGED, GAP_TOO_LARGE, NOT_FINITE, SINGULAR, MODE_ENDS = range(6)
STATUS_NAMES = ("closed", "not converged", "left open too far", "not finite", "singular", "assembly mode ends")
"""Names by code; only transfer matrices can be singular. Where the assembly mode of the drawing ends in a fold before
errors are whole, which no kernel says, no pose is continuous with it, and none is given."""
