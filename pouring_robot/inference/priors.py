"""Priors: what is held for likely before the data are looked at (in a table: docs/inference.md, "What is chosen").

Three are not of hypotheses and stand elsewhere: how large each parameter of an effect usually is, in its unit, is its
``prior_std`` (:mod:`pouring_robot.effects.families`); how large something unknown is, and how fast it varies, stands in
:mod:`pouring_robot.diagnosis.discrepancy_processes`; what fits know of parameters and frames, in
:meth:`pouring_robot.estimation.measurement.MeasurementModel.prior_std`.
"""

from collections.abc import Sequence

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray

LOG_SCALES: FloatArray = np.linspace(np.log(1e-2), np.log(1e1), 28)
"""Scales that evidence is averaged over, each as likely: from a hundredth to ten times what an effect's own units call
usual (docs/inference.md, "Two scales an effect"; likewise :data:`SHAPINGS`)."""
SHAPINGS: FloatArray = np.geomspace(0.03, 1.0, 4)
"""How much of the prediction what shapes an effect may make, against what it shapes (root mean squares): never more."""
NOISE_FACTORS: FloatArray = np.geomspace(1.01, 1e3, 200)
"""How many times as large as it is said to be the noise may be, where something is unknown; each is as likely."""
LEFT_TO_NOISE: FloatArray = np.geomspace(1e-3, 1.0, 10)
"""Which share of what is left over may be noise where nobody states it and something unknown is at work; as likely."""

WORKMANSHIP_LEVELS = (0.0, *(2.0**-k for k in range(9, 2, -1)))
"""How large workmanship may be, over the errors of a part that nobody has measured: none, or a 512th to an eighth.

Of parts of 0.3 to 1 m, ISO 286 grades IT3 to IT11, ground to coarsely milled, are tolerances of 8 to 560 um, some four
standard deviations wide. Larger ones are an effect (docs/inference.md, "Workmanship is a variance component")."""
LIKELY_LEVEL, LEVEL_SPREAD = 4, 1.0
"""The likely one by index, a 64th (IT7), and its standard deviation in steps of two: nineteen of twenty machines lie
between IT3 and IT10. None that shows is as likely as the likely one."""


def coarsest_level(most: float) -> int:
    """Return the index of the first level that is no finer than what workmanship is known not to exceed."""
    return int(np.searchsorted(WORKMANSHIP_LEVELS, most).clip(max=len(WORKMANSHIP_LEVELS) - 1))


def log_prior_of_levels(levels: Sequence[int], coarsest: Sequence[int]) -> float:
    """Return the log probability of levels by index, one a kind of workmanship, up to a constant, in nats.

    A machine is made with one care, so that its kinds count as one; ``coarsest`` are the largest that each may have.
    """
    known = zip(levels, coarsest, strict=True)
    steps = [(level - min(LIKELY_LEVEL, most)) / LEVEL_SPREAD for level, most in known if level]
    return -0.5 * float(np.square(steps).sum()) / max(len(levels), 1)


def log_priors_of_forms(effects: Sequence[str]) -> dict[str, float]:
    """Return the log probability of a form of each effect, given the effect, in nats: all its forms are as likely.

    ``effects`` has the id of the effect of each form.
    """
    return {effect: -float(np.log(effects.count(effect))) for effect in effects}


def log_prior_odds(effects: int) -> float:
    """Return the log odds of one of so many effects against noise: each is as likely as noise is to look like any."""
    return -float(np.log(effects))
