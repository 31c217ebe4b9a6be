"""When Newton's steps have converged, and how a closure ended: the codes that batch engines and their kernels write."""

CLOSED, NOT_CONVERGED, GAP_TOO_LARGE, NOT_FINITE, SINGULAR, MODE_ENDS = range(6)
STATUS_NAMES = ("closed", "not converged", "left open too far", "not finite", "singular", "assembly mode ends")
"""Names by code; only transfer matrices can be singular. Where the drawing's assembly mode ends in a fold before errors
have full size, a status that no kernel sets, no pose is continuous with it, and none is returned."""
STAYS = 0.01
"""Where a step leaves a larger share of the energy, the residual remains: from there its curvature counts."""


def settles(length: float, previous: float, before: float, left_over: float, round_off: float) -> tuple[float, bool]:
    """Return this step's share of the ``previous`` one (0: none), and whether the remaining error is small enough.

    A step (m or rad) measures the error before it, and the error after it is smaller by the ratio of steps. The worse
    of two shares, with the one ``before``, counts: Newton may correct stiff and soft directions in turns. Steps may be
    exactly zero.
    """
    share = length / (previous or length or 1.0)
    return share, length * max(share, before) < left_over or (share > 0.5 and length < round_off)
