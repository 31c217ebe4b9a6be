"""Histories of a campaign's conditions: commands, times, sides of approach, temperatures, loads."""

from dataclasses import dataclass

import numpy as np

from tests.examiner.machine import BOX, GRAVITY, drives_of

WORN = 0.04  # share of the workspace's edges that a plan keeps away from


@dataclass
class Scene:
    """What was commanded and what the sensors say, one row a static pose. SI units and °C."""

    time: np.ndarray  # (n,) s
    session: np.ndarray  # (n,) 1, 2, 3
    pose: np.ndarray  # (n, 4) nominal x, y, z (m), tilt (rad)
    drives: np.ndarray  # (n, 4) commanded
    approach: np.ndarray  # (n, 4) +1 rising, -1 falling
    payload: np.ndarray  # (n,) kg of melt
    travel: np.ndarray  # (n,) m along the rails
    melt: np.ndarray
    ambient: np.ndarray
    legs: np.ndarray  # (n, 4)
    platform: np.ndarray
    sigma: float  # of a measured coordinate, m
    sigma_turn: float | None  # of a component of the rotation vector, rad; None: positions only
    stated: bool  # whether the campaign says its noise
    pitch: float
    span: float
    tare: float
    com: np.ndarray  # (3,) of ladle and melt, in the moving platform
    cold: float  # °C at which the drawing holds

    def lagged(self, value, tau):
        """Return a temperature (n,) or (n, k) behind a first-order lag of tau seconds, at rest in the first row."""
        out = np.array(value, dtype=float)
        for i in range(1, len(out)):
            keep = np.exp(-(self.time[i] - self.time[i - 1]) / tau)
            out[i] = keep * out[i - 1] + (1 - keep) * value[i]
        return out

    @property
    def weight(self):
        """Return the weight of ladle and melt (n,), N."""
        return GRAVITY * (self.tare + self.payload)


def poses(rng, n):
    """Return poses (n, 4): scattered, on vertical strokes, or on shuffled levels of a grid."""
    low, high = (BOX.T + np.array([[1], [-1]]) * WORN * np.ptp(BOX, axis=1)).copy()
    style = rng.choice(["scattered", "strokes", "levels"], p=[0.5, 0.25, 0.25])
    share = rng.uniform(size=(n, 4))
    if style == "strokes":
        length = int(rng.integers(6, 14))
        share = np.repeat(rng.uniform(size=(n // length + 1, 4)), length, axis=0)[:n]
        ramp = np.abs((np.arange(n) / length) % 2 - 1)
        share[:, 2] = np.clip(ramp + 0.02 * rng.normal(size=n), 0, 1)
        share[:, 3] = np.clip(share[:, 3] + 0.15 * rng.normal(size=n), 0, 1)
    elif style == "levels":
        counts = rng.integers(3, 7, size=4)
        share = rng.integers(0, counts, size=(n, 4)) / (counts - 1)
    return low + share * (high - low)


def approaches(rng, drives):
    """Return the sides (n, 4): as the path went, or overshot on purpose for half of the rows."""
    went = np.sign(np.diff(drives, axis=0, prepend=drives[:1] + rng.normal(size=(1, 4))))
    went[went == 0] = 1.0
    if rng.random() < 0.5:
        went *= rng.choice([-1.0, 1.0], size=went.shape)
    return went


def clock(rng, n):
    """Return times (n,), s, and sessions (n,): a pose takes one to two minutes, breaks take hours or a night."""
    sessions = np.sort(rng.integers(0, rng.integers(1, 4), size=n))
    sessions = np.unique(sessions, return_inverse=True)[1]
    pauses = np.append(0.0, np.cumsum(rng.choice([3600.0, 5 * 3600.0, 16 * 3600.0], size=3)))
    return np.cumsum(rng.uniform(45, 110) * rng.uniform(0.7, 1.4, size=n)) + pauses[sessions], sessions + 1


def payloads(rng, n, most):
    """Return melt (n,), kg: weighed levels in blocks, pours that empty the ladle, or levels in any order."""
    style = rng.choice(["blocks", "pours", "mixed"])
    levels = np.linspace(0, most, int(rng.integers(3, 6)))
    if style == "blocks":
        load = np.repeat(rng.permutation(np.tile(levels, 3)), n // (3 * len(levels)) + 1)[:n]
    elif style == "pours":
        load = most * (1 - (np.arange(n) / rng.integers(8, 30)) % 1)
    else:
        load = rng.choice(levels, size=n)
    return np.maximum(load + rng.normal(size=n) * (load > 0), 0.0)


def heat(rng, time, payload, most):
    """Return melt, ambient (n,), legs (n, 4) and platform (n,) in °C: each part follows the melt at its own pace."""
    hall = rng.uniform(14, 26) + rng.uniform(1, 6) * np.sin(2 * np.pi * (time / 86400 + rng.uniform()))
    melt = np.where(payload > 0.1 * most, rng.uniform(1350, 1650), rng.uniform(300, 700))
    if rng.random() < 0.3:  # a cold campaign with weights instead of melt
        melt = hall + rng.uniform(0, 30)
    drive = np.clip(melt, 20, None) / 1500
    shares = np.append(rng.uniform(60, 170) * rng.uniform(0.7, 1.3, size=4), rng.uniform(80, 240))
    taus = np.append(rng.uniform(1500, 7000, size=4), rng.uniform(1200, 6000))
    rise = shares * drive[0] * rng.uniform(0, 0.6)
    out = np.zeros((len(time), 5))
    for i, goal in enumerate(drive[:, None] * shares):
        keep = np.exp(-(time[i] - time[i - 1]) / taus) if i else 1.0
        rise = keep * rise + (1 - keep) * goal
        out[i] = hall[i] + rise
    out += 0.15 * rng.normal(size=out.shape)
    return melt, hall, out[:, :4], out[:, 4]


def travels(rng, n, span):
    """Return truss positions (n,), m: stations held for a while, or a new one for each row."""
    stations = rng.uniform(0.03, 0.97, size=max(4, n // int(rng.integers(5, 25)) + 1)) * span
    held = np.repeat(stations, n // len(stations) + 1)[:n]
    return held if rng.random() < 0.5 else rng.permutation(held) + rng.uniform(-0.02, 0.02, size=n) * span


def draw(rng, fine=False):
    """Return a plausible scene; `fine` keeps to a good instrument."""
    n = int(np.exp(rng.uniform(np.log(45), np.log(300))))
    pose = poses(rng, n)
    tare = float(np.round(rng.uniform(60, 180)))
    most = rng.uniform(120, 500 - tare)
    time, session = clock(rng, n)
    payload, span = payloads(rng, n, most), float(rng.choice([4.5, 6.0, 8.0]))
    melt, hall, legs, platform = heat(rng, time, payload, most)
    drives = drives_of(pose)
    sigma = float(np.exp(rng.uniform(np.log(15e-6), np.log(60e-6 if fine else 250e-6))))
    turned = rng.random() > 0.25
    return Scene(
        time=time, session=session, pose=pose, drives=drives, approach=approaches(rng, drives), payload=payload,
        travel=travels(rng, n, span), melt=melt, ambient=hall, legs=legs, platform=platform, sigma=sigma,
        sigma_turn=float(sigma / rng.uniform(0.3, 1.5)) if turned else None, stated=bool(rng.random() > 0.15),
        pitch=float(rng.choice([5e-3, 10e-3, 16e-3, 20e-3])), span=span, tare=tare,
        com=np.round([rng.uniform(0.02, 0.08), rng.uniform(-0.01, 0.01), rng.uniform(-0.35, -0.2)], 3), cold=20.0,
    )  # fmt: skip
