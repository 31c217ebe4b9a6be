"""Conditions of a campaign: poses, times, sides, loads and temperatures, and the readings of the thermometers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .machine import Errors, Poses, close, drives_of
from .rotations import Array, turn

BOX = np.array([[-0.150, -0.050], [-0.050, 0.050], [-0.825, -0.425], [-0.4884, 1.08155]])
"""Workspace of x, y, z [m] and tilt [rad]."""
SPAN_M, PITCH_M, TARE_KG, REFERENCE_DEGC = 6.0, 0.010, 180.0, 20.0
CENTRE_OF_MASS = np.array([0.050, 0.0, -0.280])
"""Of the filled ladle, in the moving platform's frame [m]."""
GRAVITY = 9.81

TRAPS = ("constant_temperature", "one_side", "tilt_held", "slow_travel")
"""Ways to measure that make effects coincide."""


@dataclass
class Scene:
    """A campaign before anything goes wrong; arrays hold one row a pose. SI units and °C.

    Attributes:
        position, tilt: commanded pose (n, 3) [m], (n,) [rad].
        drives: commanded leg lengths 1…3 and θ46 (n, 4) [m, rad].
        legs: length of all four legs (n, 4) [m].
        time_s, session, approach, payload_kg, travel_m, melt, ambient: conditions (n,); ``approach`` (n, 4).
        leg_temperature, plate_temperature: true ones (n, 4), (n,) [°C].
        thermometers: what is read of them, legs then platform (n, 5) [°C].
        poses: of the faultless machine, with ∂pose/∂drive and, if asked for, ∂pose/∂(local errors).
        pull: tension in legs 1…3 (n, 3) [N]; leg 4 carries none.
        moment: of the ladle on θ46 (n,) [Nm].
    """

    position: Array
    tilt: Array
    drives: Array
    legs: Array
    time_s: Array
    session: Array
    approach: Array
    payload_kg: Array
    travel_m: Array
    melt: Array
    ambient: Array
    leg_temperature: Array
    plate_temperature: Array
    thermometers: Array
    poses: Poses
    pull: Array
    moment: Array

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.tilt)

    @property
    def weight(self) -> Array:
        """Return the weight of the ladle and its melt [N]."""
        return np.asarray((TARE_KG + self.payload_kg) * GRAVITY)

    @property
    def when(self) -> Array:
        """Return the time through the campaign, 0 to 1."""
        return np.asarray((self.time_s - self.time_s[0]) / max(float(np.ptp(self.time_s)), 1.0))


def plan(rng: np.random.Generator, rows: int, sessions: int, trap: str | None = None, local: bool = False) -> Scene:
    """Return a campaign of so many rows, of which the last third repeats the first poses."""
    if trap is not None and trap not in TRAPS:
        raise ValueError(f"no trap {trap!r}; there are {', '.join(TRAPS)}")
    fresh = rows - rows // 3
    pose = rng.uniform(BOX[:, 0], BOX[:, 1], size=(fresh, 4))
    if trap == "tilt_held":
        pose = _held(rng, fresh)
    pose = np.concatenate([pose, pose[: rows - fresh]])
    position, tilt = pose[:, :3], pose[:, 3]
    legs, theta = drives_of(position, tilt)
    # A controller commands in steps: hundredths of a micrometre and of a microradian.
    drives = np.column_stack([np.round(legs[:, :3], 8), np.round(theta, 8)])

    time = np.cumsum(rng.uniform(60.0, 95.0, rows))
    session = np.ones(rows)
    for k, cut in enumerate(np.sort(rng.permutation(np.arange(1, 10))[: sessions - 1]) * rows // 10):
        session[cut:] = k + 2
        time[cut:] += rng.uniform(1800.0, 7200.0)
    approach = np.where(rng.random((rows, 4)) < 0.5, -1.0, 1.0)
    travel = rng.uniform(0.0, SPAN_M, rows)
    payload = _payload(rng, rows)
    if trap == "one_side":
        approach[:] = 1.0
    if trap == "slow_travel":
        # Near mid-span, where the truss's slope goes evenly with the way.
        travel = 0.5 * SPAN_M + rng.uniform(-0.05, 0.05) + 0.2 * ((time - time[0]) / np.ptp(time) - 0.5)
        payload[:] = np.round(rng.uniform(200.0, 500.0), 1)

    melt, ambient = _melt(rng, rows), _ambient(rng, time)
    gain = rng.uniform(0.05, 0.16, 5)
    lag = rng.uniform(900.0, 4500.0, 5)
    warm = _warm(time, ambient[:, None] + gain * (melt - ambient)[:, None], lag, rng.uniform(0.15, 0.9))
    if trap == "constant_temperature":
        melt, ambient = np.full(rows, 1600.0), np.full(rows, 21.0)
        warm = np.full((rows, 5), rng.uniform(120.0, 180.0))
    bias = rng.normal(0.0, 1.5, 5) + (rng.random(5) < 0.04) * rng.choice([-12.0, 12.0], 5)
    read = warm * (1.0 + rng.normal(0.0, 0.01, 5)) + bias + rng.normal(0.0, 0.4, (rows, 5))
    if trap == "constant_temperature":
        read = warm + rng.normal(0.0, 0.4, (rows, 5))

    poses = close(drives[:, :3], drives[:, 3], Errors.none(rows), (position, tilt), local=local)
    force = (TARE_KG + payload) * GRAVITY
    arm = turn(poses.quaternion, CENTRE_OF_MASS)
    # Virtual work: the height of the centre of mass per unit of each drive.
    rise = poses.by_drive[:, 2] + arm[:, 1, None] * poses.by_drive[:, 3] - arm[:, 0, None] * poses.by_drive[:, 4]
    return Scene(
        position=position,
        tilt=tilt,
        drives=drives,
        legs=legs,
        time_s=time,
        session=session,
        approach=approach,
        payload_kg=payload,
        travel_m=travel,
        melt=melt,
        ambient=ambient,
        leg_temperature=warm[:, :4],
        plate_temperature=warm[:, 4],
        thermometers=read,
        poses=poses,
        pull=-force[:, None] * rise[:, :3],
        moment=-force * rise[:, 3],
    )


def _held(rng: np.random.Generator, rows: int) -> Array:
    """Return poses that share one θ46, by bisection on the tilt."""
    held = rng.uniform(-0.3, 0.1)
    found: list[Array] = []
    while len(found) < rows:
        position = rng.uniform(BOX[:3, 0], BOX[:3, 1], size=(rows, 3))
        low, high = np.full(rows, BOX[3, 0]), np.full(rows, BOX[3, 1])
        inside = (drives_of(position, low)[1] < held) & (drives_of(position, high)[1] > held)
        for _ in range(60):
            middle = 0.5 * (low + high)
            above = drives_of(position, middle)[1] > held
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        found += list(np.column_stack([position, 0.5 * (low + high)])[inside])
    return np.array(found[:rows])


def _payload(rng: np.random.Generator, rows: int) -> Array:
    """Return the melt in the ladle: poured out bit by bit, then filled again [kg]."""
    out: Array = np.zeros(rows)
    level, step = rng.uniform(490.0, 510.0), rng.uniform(15.0, 35.0)
    for k in range(rows):
        out[k] = level + rng.normal(0.0, 3.0)
        level -= step * rng.uniform(0.5, 1.5)
        if level < 140.0:
            level, step = rng.uniform(490.0, 510.0), rng.uniform(15.0, 35.0)
    return np.round(out, 1)


def _melt(rng: np.random.Generator, rows: int) -> Array:
    """Return the melt's temperature: a hot ladle and a nearly cold one by turns [°C]."""
    hot, cold = np.round([rng.uniform(1400.0, 1700.0), rng.uniform(360.0, 420.0)], 1)
    block, first = int(rng.integers(28, 50)), int(rng.integers(2))
    return np.asarray(np.where((np.arange(rows) // block + first) % 2 == 0, hot, cold))


def _ambient(rng: np.random.Generator, time: Array) -> Array:
    """Return the hall's temperature over a part of a day [°C]."""
    slow = np.sin(2.0 * np.pi * (time / rng.uniform(18e3, 36e3) + rng.random()))
    return np.asarray(20.0 + rng.uniform(4.0, 6.5) * slow)


def _warm(time: Array, target: Array, lag: Array, ahead: float) -> Array:
    """Return first-order answers to ``target`` (n, k), time constants ``lag`` (k,), begun part of the way."""
    out = np.empty_like(target)
    state = REFERENCE_DEGC + ahead * (target[0] - REFERENCE_DEGC)
    for k in range(len(time)):
        gap = time[k] - time[k - 1] if k else time[0]
        state = target[k] + (state - target[k]) * np.exp(-gap / lag)
        out[k] = state
    return out
