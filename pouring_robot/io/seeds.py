"""One seed of the user's, a stream of random numbers for each use of it: what one draws moves no other's."""

import enum

import numpy as np


class Stream(enum.IntEnum):
    """Who draws; the number is part of what is drawn, so that a change of it changes results."""

    PLAN = 1  # poses of a random plan
    SIMULATION = 2  # frames and noise of a virtual tracker
    EXCHANGE = 3  # first plans of the exchange algorithm
    VISITS = 4  # conditions of a random plan
    DRIVES = 5  # of candidates between rows of a campaign
    CANDIDATES = 7  # conditions of measurements that may follow a campaign
    RANDOM_SETS = 11  # of candidates, to compare a choice with


def generator(seed: int, stream: Stream) -> np.random.Generator:
    """Return the generator of one stream of a seed, a whole number from 0 on."""
    return np.random.default_rng([seed, int(stream)])
