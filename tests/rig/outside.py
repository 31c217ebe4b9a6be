"""Effects that are in nobody's library: the correct answer is that the cause is unknown."""

from __future__ import annotations

import numpy as np

from .conditions import BOX, Scene
from .effects_drives import MM, MRAD, drives, spread
from .machine import Errors
from .rotations import Array


def _unit(scene: Scene) -> Array:
    """Return position and tilt as −1…1 across the workspace, (n, 4)."""
    pose = np.column_stack([scene.position, scene.tilt])
    return np.asarray((pose - BOX.mean(axis=1)) / (0.5 * np.ptp(BOX, axis=1)))


def knock(scene: Scene, rng: np.random.Generator) -> Errors:
    """A crash: from one moment on, one upper joint centre stands elsewhere."""
    out = Errors.none(len(scene))
    out.upper[:, rng.integers(4)] = np.outer(scene.when > rng.uniform(0.35, 0.65), spread(rng, 3)) * MM
    return out


def knock_mended(scene: Scene, rng: np.random.Generator) -> Errors:
    """One lower joint centre is knocked out of place and put back some time later."""
    out = Errors.none(len(scene))
    start = rng.uniform(0.2, 0.4)
    away = (scene.when > start) & (scene.when < start + rng.uniform(0.25, 0.4))
    out.lower[:, rng.integers(4)] = np.outer(away, spread(rng, 3)) * MM
    return out


def refraction(scene: Scene, _: np.random.Generator) -> Errors:
    """Hot air bends the tracker's beam: sights near the melt are lifted, with the square of the depth."""
    out = Errors.none(len(scene))
    depth = 0.5 * (1.0 - _unit(scene)[:, 2])
    out.seen[:, 2] = depth**2 * (scene.melt - scene.ambient) / 1500.0 * MM
    return out


def refraction_plume(scene: Scene, rng: np.random.Generator) -> Errors:
    """A plume stands in one part of the workspace: sights through it are thrown sideways when the melt is hot."""
    out = Errors.none(len(scene))
    u = _unit(scene)[:, :3]
    plume = np.exp(-np.sum((u[:, :2] - rng.uniform(-0.5, 0.5, 2)) ** 2, axis=1) / 0.3)
    out.seen[:, :3] = np.outer(plume * (scene.melt - 300.0) / 1200.0, spread(rng, 3)) * MM
    return out


def tracker_drift(scene: Scene, rng: np.random.Generator) -> Errors:
    """The tracker warms up anew each session: its head turns and comes to rest, further in some sessions."""
    out = Errors.none(len(scene))
    for k in range(1, int(scene.session.max()) + 1):
        here = scene.session == k
        age = scene.time_s[here] - scene.time_s[here][0]
        way = np.concatenate([spread(rng, 3) * MM, spread(rng, 3) * MRAD])
        out.seen[here] = np.outer(np.exp(-age / 1500.0) - 0.5 * np.sin(age / 1900.0), way)
    return out


def tracker_swing(scene: Scene, rng: np.random.Generator) -> Errors:
    """The hall's air conditioning swings the tracker's post to and fro, some twenty-five minutes a cycle."""
    out = Errors.none(len(scene))
    wave = np.sin(2.0 * np.pi * scene.time_s / rng.uniform(1300.0, 1800.0) + rng.uniform(0.0, 6.28))
    out.seen[:] = np.outer(wave, np.concatenate([spread(rng, 3) * MM, 0.3 * spread(rng, 3) * MRAD]))
    return out


def operator(scene: Scene, rng: np.random.Generator) -> Errors:
    """Somebody stands by the machine, each session elsewhere: an error by session and with the square of y."""
    out = Errors.none(len(scene))
    by_session = spread(rng, int(scene.session.max())) * np.resize([1.0, -1.0], int(scene.session.max()))
    bow = by_session[scene.session.astype(int) - 1] * (_unit(scene)[:, 1] ** 2 - 1.0 / 3.0)
    out.seen[:, :3] = np.outer(bow, spread(rng, 3)) * MM
    return out


def stick_slip(scene: Scene, rng: np.random.Generator) -> Errors:
    """The tilt bearing sticks: in each region it stops before or behind where it should, by chance."""
    cell = np.clip(((_unit(scene)[:, [0, 2, 3]] + 1.0) / 2.0 * np.array([2, 3, 4])).astype(int), 0, 3)
    sign = rng.choice([-1.0, 1.0], (4, 4, 4))[tuple(cell.T)]
    return drives(scene, np.outer(sign, [0.0, 0.0, 0.0, 1.0]))


def stick_slip_legs(scene: Scene, rng: np.random.Generator) -> Errors:
    """The nuts of legs 1 and 2 stick by region, the harder the fuller the ladle."""
    cell = np.clip(((_unit(scene)[:, :3] + 1.0) / 2.0 * 3).astype(int), 0, 2)
    sign = rng.choice([-1.0, 1.0], (2, 3, 3, 3))[:, cell[:, 0], cell[:, 1], cell[:, 2]]
    return drives(scene, np.column_stack([*(sign * scene.payload_kg / 300.0), *np.zeros((2, len(scene)))]))


def leg_bending(scene: Scene, rng: np.random.Generator) -> Errors:
    """Slender legs sag by their pose: the chord is wrong by a cubic of the length and a wave of the inclination."""
    stroke = (scene.legs[:, :3] - scene.legs[:, :3].mean(axis=0)) / scene.legs[:, :3].std(axis=0)
    lean = scene.poses.passive[:, :3, 0]
    sag = (stroke**3 - 2.0 * stroke) * np.cos(4.0 * lean) * spread(rng, 3)
    return drives(scene, np.column_stack([sag, np.zeros(len(scene))]))


def belt_ripple(scene: Scene, rng: np.random.Generator) -> Errors:
    """A tooth belt of unknown pitch before the screws: a wave that no data sheet speaks of."""
    wave = np.sin(2.0 * np.pi * scene.drives[:, :3] / rng.uniform(0.033, 0.047) + rng.uniform(0.0, 6.28, 3))
    return drives(scene, np.column_stack([wave * np.abs(spread(rng, 3)), np.zeros(len(scene))]))


def unsettled(scene: Scene, rng: np.random.Generator) -> Errors:
    """Read too early: the carriage still swings, by how far the machine came from the pose before."""
    out = Errors.none(len(scene))
    came = np.diff(_unit(scene), axis=0, prepend=_unit(scene)[:1])
    out.base[:, 3] = came[:, 1] * spread(rng, 1) * MRAD
    out.base[:, 4] = (came[:, 0] + 0.5 * came[:, 3]) * spread(rng, 1) * MRAD
    return out


def rail_joint(scene: Scene, rng: np.random.Generator) -> Errors:
    """Between two rail joints the carriage stands aside and askew."""
    out = Errors.none(len(scene))
    start = rng.uniform(1.0, 3.5)
    there = (scene.travel_m > start) & (scene.travel_m < start + rng.uniform(0.8, 1.5))
    out.base[:] = np.outer(there, np.array([0.3, 1.0, 0.2, 0.3, 0.3, 1.0]) * spread(rng, 6)) * MM
    return out
