"""When Newton's steps have settled, and how a closure ended: the codes that batch engines and their kernels write."""

CLOSED, NOT_CONVERGED, GAP_TOO_LARGE, NOT_FINITE, SINGULAR, MODE_ENDS = range(6)
STATUS_NAMES = ("closed", "not converged", "left open too far", "not finite", "singular", "assembly mode ends")
"""Names by code; only transfer matrices can be singular. Where the assembly mode of the drawing ends in a fold before
errors are whole, which no kernel says, no pose is continuous with it, and none is given."""
STAYS = 0.01
"""Energy of which a step leaves a larger share is there to stay: from there the residual's curvature counts."""


def settles(length: float, previous: float, before: float, left_over: float, round_off: float) -> tuple[float, bool]:
    """Return which share of the ``previous`` step (0: none) this one is, and whether what it leaves is small enough.

    A step (m or rad) measures the error before it and leaves less by as much as steps shrink. The worse of two shares,
    with the one ``before``, counts: Newton may set stiff and soft directions right in turns. Steps may be exactly zero.
    """
    share = length / (previous or length or 1.0)
    return share, length * max(share, before) < left_over or (share > 0.5 and length < round_off)
