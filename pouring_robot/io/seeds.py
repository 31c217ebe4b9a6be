"""One seed of the user's, with an independent stream of random numbers for each use of it.

A sweep draws by spawn keys of its seed (:mod:`pouring_robot.sweeps.draws`, :mod:`pouring_robot.sweeps.plan`), but its
Sobol sequences and indices, and sensitivity (:mod:`pouring_robot.sensitivity.analysis`), draw by the seed alone. Fixed
seeds are for draws that must give the same answer for the same input, whatever the user's seed.
"""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np

SENSITIVITY_SEED = 2022
"""Of the poses that sensitivity evaluates, by default."""
CHANCE_SEED = 0
"""Of the evidence that chance alone reaches in a campaign (:func:`pouring_robot.inference.thresholds.chance_level`)."""
FRAMES_SEED = 20260722
"""Of the sets of rows that a fit of the frames starts from (:mod:`pouring_robot.estimation.frames.starts`)."""
CLIMBS_SEED = 41
"""Of the places where the largest error of a path is sought (:mod:`pouring_robot.compensation.path`)."""
RAYS_SEED = 7
"""Of the rays of a picture that determine how open a place is, and how lit (:mod:`pouring_robot.viewer.raycast`)."""


class Stream(enum.IntEnum):
    """Uses of random numbers; the number of a stream seeds its draws, so that a change of it changes results."""

    PLAN = 1  # poses of a random plan
    SIMULATION = 2  # frames and noise of a virtual tracker
    EXCHANGE = 3  # first plans of the exchange algorithm
    VISITS = 4  # conditions of a random plan
    DRIVES = 5  # of candidates between rows of a campaign
    CANDIDATES = 7  # conditions of measurements that may follow a campaign
    RANDOM_SETS = 11  # of candidates, to compare a choice with


def generator(seed: int, stream: Stream) -> np.random.Generator:
    """Return the generator of one stream of a seed, a whole number from 0 on."""
    import numpy as np  # here, as the command line asks for seeds before it loads anything

    return np.random.default_rng([seed, int(stream)])


def spawned(seed: int, drawn: Literal["errors", "poses"], block: int = 0) -> np.random.Generator:
    """Return the generator of one block of a sweep's draws; its errors and its poses may have the same seed."""
    import numpy as np

    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(("errors", "poses").index(drawn), block)))
