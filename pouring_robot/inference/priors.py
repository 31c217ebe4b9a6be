"""Priors: what is probable before any data (in a table: docs/inference.md, "What is chosen").

Three do not concern hypotheses and are defined elsewhere: the usual size of each parameter of an effect, in its unit,
is its ``prior_std`` (:mod:`pouring_robot.effects.families`); the usual amplitude and length scales of something unknown
are in :mod:`pouring_robot.diagnosis.discrepancy_processes`; the priors of parameters in fits are the tolerances of
:mod:`pouring_robot.robot.tolerances`, with those of frames in
:meth:`pouring_robot.estimation.measurement.MeasurementModel.prior_std`.
"""

from collections.abc import Sequence

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray

LOG_SCALES: FloatArray = np.linspace(np.log(1e-2), np.log(1e1), 28)
"""Equally probable scales over which evidence is averaged: from a hundredth to ten times an effect's usual size
(docs/inference.md, "Two scales an effect"; likewise :data:`SHAPINGS`)."""
SHAPINGS: FloatArray = np.geomspace(0.03, 1.0, 4)
"""How much shaping parameters may add to the prediction, relative to what they shape (root mean squares)."""
NOISE_FACTORS: FloatArray = np.geomspace(1.01, 1e3, 200)
"""Equally probable factors by which the noise may exceed the stated one, where something is unknown."""
LEFT_TO_NOISE: FloatArray = np.geomspace(1e-3, 1.0, 10)
"""Equally probable shares of noise in the residual, where no noise is stated and something unknown is at work."""

WORKMANSHIP_LEVELS = (0.0, *(2.0**-k for k in range(9, 2, -1)))
"""Levels of workmanship, as shares of the standard deviation of an unmeasured part: none, or a 512th to an eighth.

For parts of 0.3 to 1 m, ISO 286 grades IT3 to IT11, ground to coarsely milled, are tolerances of 8 to 560 um, some four
standard deviations wide. Larger ones are an effect (docs/inference.md, "Workmanship is a variance component")."""
LIKELY_LEVEL, LEVEL_SPREAD = 4, 1.0
"""Index of the most probable level, a 64th (IT7), and its standard deviation in factors of two: nineteen of twenty
machines lie between IT3 and IT10. Level 0, no visible workmanship, is as probable as the most probable one."""


def coarsest_level(most: float) -> int:
    """Return the index of the first level that is no finer than a known upper limit of workmanship."""
    return int(np.searchsorted(WORKMANSHIP_LEVELS, most).clip(max=len(WORKMANSHIP_LEVELS) - 1))


def log_prior_of_levels(levels: Sequence[int], coarsest: Sequence[int]) -> float:
    """Return the log prior of levels by index, one for each kind of workmanship, up to a constant, in nats.

    A machine is made with one care, so all its kinds count as one; ``coarsest`` are the largest level of each.
    """
    known = zip(levels, coarsest, strict=True)
    steps = [(level - min(LIKELY_LEVEL, most)) / LEVEL_SPREAD for level, most in known if level]
    return -0.5 * float(np.square(steps).sum()) / max(len(levels), 1)


def log_priors_of_forms(effects: Sequence[str]) -> dict[str, float]:
    """Return the log prior of one form of each effect, given the effect, in nats: its forms are equally probable.

    ``effects`` has the effect's id for each form.
    """
    return {effect: -float(np.log(effects.count(effect))) for effect in effects}


def log_prior_odds(effects: int) -> float:
    """Return the log prior odds of one of n effects against noise: each is as likely as noise is to look like any."""
    return -float(np.log(effects))
