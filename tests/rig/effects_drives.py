"""Errors of drives and joints. Form ``a`` is the textbook's; the others are as plausible but of another shape.

A form returns the errors at size one; sizes are in the units of :data:`tests.rig.effects.UNITS`.
"""

from __future__ import annotations

import numpy as np

from .conditions import PITCH_M, Scene
from .machine import AXES, Errors
from .rotations import Array

MM = 1e-3
MRAD = 1e-3


def spread(rng: np.random.Generator, *size: int) -> Array:
    """Return factors of either sign, none of them near zero."""
    return np.asarray(rng.uniform(0.4, 1.0, size) * rng.choice([-1.0, 1.0], size))


def drives(scene: Scene, values: Array) -> Errors:
    """Return errors of l1, l2, l3 [mm] and θ46 [mrad] as given in ``values``, (4,) or (n, 4)."""
    out = Errors.none(len(scene))
    values = np.broadcast_to(values, (len(scene), 4))
    out.length[:, :3] = values[:, :3] * MM
    out.theta[:] = values[:, 3] * MRAD
    return out


def zero_offset(scene: Scene, rng: np.random.Generator) -> Errors:
    """All four zeros are off."""
    return drives(scene, spread(rng, 4))


def zero_offset_one(scene: Scene, rng: np.random.Generator) -> Errors:
    """One encoder lost count; the others are right."""
    return drives(scene, np.eye(4)[rng.integers(4)] * spread(rng, 4))


def zero_offset_homing(scene: Scene, rng: np.random.Generator) -> Errors:
    """Zeros are off, and each session's homing scatters by a hundredth of that."""
    homing = 0.01 * rng.normal(size=(int(scene.session.max()), 4))
    return drives(scene, spread(rng, 4) + homing[scene.session.astype(int) - 1])


def scale(scene: Scene, rng: np.random.Generator) -> Errors:
    """Lead error: in proportion to the length."""
    return drives(scene, np.column_stack([scene.legs[:, :3] * spread(rng, 3), np.zeros(len(scene))]))


def scale_progressive(scene: Scene, rng: np.random.Generator) -> Errors:
    """Lead error that grows along the screw, counted from its home at 400 mm."""
    stroke = scene.legs[:, :3] - 0.400
    return drives(scene, np.column_stack([(stroke + 0.25 * stroke**2 / 0.5) * spread(rng, 3), np.zeros(len(scene))]))


def cyclic(scene: Scene, rng: np.random.Generator, second: float = 0.0) -> Errors:
    """Once a turn of the screw."""
    turns = 2.0 * np.pi * scene.drives[:, :3] / PITCH_M
    phase, other = rng.uniform(0.0, 2.0 * np.pi, (2, 3))
    wave = np.abs(spread(rng, 3)) * (np.sin(turns + phase) + second * np.sin(2.0 * turns + other))
    return drives(scene, np.column_stack([wave, np.zeros(len(scene))]))


def cyclic_two(scene: Scene, rng: np.random.Generator) -> Errors:
    """Once and twice a turn: a bent screw in a tilted nut."""
    return cyclic(scene, rng, second=0.25)


def backlash(scene: Scene, rng: np.random.Generator) -> Errors:
    """Each drive lags by half its lost motion."""
    return drives(scene, -0.5 * scene.approach * np.abs(spread(rng, 4)))


def backlash_loaded(scene: Scene, rng: np.random.Generator) -> Errors:
    """The load takes up part of the play: a leg that pulls hard loses less motion."""
    pull = np.column_stack([np.abs(scene.pull), np.abs(scene.moment)])
    return drives(scene, -0.5 * scene.approach * np.abs(spread(rng, 4)) / (1.0 + 0.5 * pull / pull.mean(axis=0)))


def backlash_one_sided(scene: Scene, rng: np.random.Generator) -> Errors:
    """Falling drives are right, rising ones stop short; the tilt drive is without play."""
    return drives(scene, -np.abs(spread(rng, 4)) * (scene.approach > 0) * np.array([1.0, 1.0, 1.0, 0.0]))


def centres(scene: Scene, rng: np.random.Generator) -> Errors:
    """All U-joint centres are off."""
    out = Errors.none(len(scene))
    out.upper[:] = rng.normal(size=(4, 3)) * MM
    out.lower[:] = rng.normal(size=(4, 3)) * MM
    return out


def centres_moving(scene: Scene, rng: np.random.Generator) -> Errors:
    """The moving platform was drilled with a skewed jig: its centres are off, in plane more than across."""
    out = Errors.none(len(scene))
    out.lower[:] = rng.normal(size=(4, 3)) * np.array([1.0, 1.0, 0.3]) * MM
    return out


def centres_one(scene: Scene, rng: np.random.Generator) -> Errors:
    """One bearing seat is off, on either platform."""
    out = Errors.none(len(scene))
    side = out.upper if rng.random() < 0.5 else out.lower
    side[:, rng.integers(4)] = spread(rng, 3) * MM
    return out


def tilts(scene: Scene, rng: np.random.Generator) -> Errors:
    """All revolute axes are tilted."""
    out = Errors.none(len(scene))
    across = 1.0 - np.abs(AXES)
    out.tilt[:] = rng.normal(size=(4, 5, 3)) * across * MRAD
    out.tilt[:, :, 2] = 0.0
    return out


def tilts_yokes(scene: Scene, rng: np.random.Generator) -> Errors:
    """The legs are twisted: each lower yoke is turned about its leg against the upper one."""
    out = Errors.none(len(scene))
    out.tilt[:, :, 3, 2] = spread(rng, 4) * MRAD
    return out


def tilts_bores(scene: Scene, rng: np.random.Generator) -> Errors:
    """Each platform's two bores of a side were bored in one pass: their axes are tilted together, in pairs."""
    out = Errors.none(len(scene))
    for pair in ((0, 1), (2, 3)):
        for axis in (0, 4):
            out.tilt[:, pair, axis] = spread(rng, 3) * np.array([1.0, 0.0, 1.0]) * MRAD
    return out


def eccentricity(scene: Scene, rng: np.random.Generator, second: float = 0.0) -> Errors:
    """The encoder disc of θ46 sits off centre."""
    phase, other = rng.uniform(0.0, 2.0 * np.pi, 2)
    theta = scene.drives[:, 3]
    wave = np.sin(theta + phase) + second * np.sin(2.0 * theta + other)
    return drives(scene, np.column_stack([np.zeros((len(scene), 3)), wave]))


def eccentricity_oval(scene: Scene, rng: np.random.Generator) -> Errors:
    """Off centre and oval: once and twice a turn."""
    return eccentricity(scene, rng, second=0.25)
