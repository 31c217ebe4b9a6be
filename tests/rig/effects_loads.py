"""Errors by heat, weight, time and the metrology. Form ``a`` is the textbook's; the others are as plausible."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .conditions import GRAVITY, REFERENCE_DEGC, SPAN_M, Scene
from .effects_drives import MM, MRAD, drives, spread
from .machine import LOWER, Errors
from .rotations import Array

FULL_LOAD_N = 6500.0


def behind(scene: Scene, temperature: Array, lag_s: float) -> Array:
    """Return a temperature that follows another one with a time constant; both (n,) or (n, k)."""
    out = temperature.copy()
    for k in range(1, len(scene)):
        keep = np.exp(-(scene.time_s[k] - scene.time_s[k - 1]) / lag_s)
        out[k] = temperature[k] + (out[k - 1] - temperature[k]) * keep
    return out


def _stretched(scene: Scene, stretch_mm: Array) -> Errors:
    return drives(scene, np.column_stack([stretch_mm[:, :3], np.zeros(len(scene))]))


def leg_heat(scene: Scene, _: np.random.Generator) -> Errors:
    """Every leg grows as a whole with its own temperature."""
    return _stretched(scene, 1e-2 * scene.legs * (scene.leg_temperature - REFERENCE_DEGC))


def leg_heat_core(scene: Scene, _: np.random.Generator) -> Errors:
    """What grows is the core: it lags behind the skin by minutes and feels the platform at its end."""
    mean = 0.85 * scene.leg_temperature + 0.15 * scene.plate_temperature[:, None]
    return _stretched(scene, 1e-2 * scene.legs * (behind(scene, mean, 500.0) - REFERENCE_DEGC))


def leg_heat_barrel(scene: Scene, _: np.random.Generator) -> Errors:
    """A barrel of 300 mm is as warm as measured, the rod that comes out of it four fifths so."""
    effective = 0.300 + 0.8 * (scene.legs - 0.300)
    return _stretched(scene, 1e-2 * effective * (scene.leg_temperature - REFERENCE_DEGC))


def _plate(scene: Scene, share: Array, temperature: Array) -> Errors:
    out = Errors.none(len(scene))
    out.lower[:] = 1e-5 * (temperature - REFERENCE_DEGC)[:, None, None] * share * LOWER
    return out


def plate_heat(scene: Scene, _: np.random.Generator) -> Errors:
    """The moving platform grows evenly about its origin."""
    return _plate(scene, np.ones(3), scene.plate_temperature)


def plate_heat_uneven(scene: Scene, _: np.random.Generator) -> Errors:
    """Its middle is insulated: along x it grows a fifth less than along y."""
    return _plate(scene, np.array([0.8, 1.0, 1.0]), scene.plate_temperature)


def plate_heat_late(scene: Scene, _: np.random.Generator) -> Errors:
    """A thick plate: its core lags behind the thermometer on its skin."""
    return _plate(scene, np.ones(3), behind(scene, scene.plate_temperature, 600.0))


def leg_spring(scene: Scene, _: np.random.Generator) -> Errors:
    """Legs are rods: they stretch with pull and length."""
    return _stretched(scene, scene.pull / 5000.0 * scene.legs[:, :3] / 0.6)


def leg_spring_nut(scene: Scene, _: np.random.Generator) -> Errors:
    """What yields are the nut and its bearings: the stretch goes with the pull, whatever the length."""
    return _stretched(scene, scene.pull / 5000.0)


def leg_spring_contact(scene: Scene, _: np.random.Generator) -> Errors:
    """Balls in the nut and the joints: the stretch hardens, to the power two thirds, whatever the length."""
    return _stretched(scene, np.sign(scene.pull) * (np.abs(scene.pull) / 5000.0) ** (2.0 / 3.0))


def tilt_spring(scene: Scene, _: np.random.Generator) -> Errors:
    """θ46 yields in proportion to the moment."""
    return drives(scene, np.outer(scene.moment / 2000.0, [0.0, 0.0, 0.0, 1.0]))


def tilt_spring_stiffening(scene: Scene, _: np.random.Generator) -> Errors:
    """A gear that winds up and then bears on more teeth."""
    return drives(scene, np.outer(1.2 * np.tanh(scene.moment / 2400.0), [0.0, 0.0, 0.0, 1.0]))


def _sunk(scene: Scene, line: Callable[[Array], Array], load: Array, slope: float, torsion: float) -> Errors:
    """Return the truss's deflection: sunk by ``line``, rolled by its slope, and by as much as it sank."""
    out = Errors.none(len(scene))
    top = float(line(np.linspace(0.0, SPAN_M, 101)).max())
    sink = line(scene.travel_m) / top * load / FULL_LOAD_N * MM
    fall = (line(scene.travel_m + 1e-4) - line(scene.travel_m - 1e-4)) / 2e-4 / top * load / FULL_LOAD_N * MM
    out.base[:, 2] = -sink
    out.base[:, 3] = slope * fall + torsion * sink
    return out


def truss(scene: Scene, rng: np.random.Generator) -> Errors:
    """A beam on two posts sinks where the load stands; the carriage leans with the slope of that."""
    side = float(rng.choice([-1.0, 1.0]))
    return _sunk(scene, lambda x: x**2 * (SPAN_M - x) ** 2, scene.weight, side, 0.0)


def truss_even(scene: Scene, rng: np.random.Generator) -> Errors:
    """The deflection line x(L − x)(L² + xL − x²) of an evenly loaded beam, scaled by the load, and its slope."""
    side = float(rng.choice([-1.0, 1.0]))
    return _sunk(scene, lambda x: x * (SPAN_M - x) * (SPAN_M**2 + x * SPAN_M - x**2), scene.weight, side, 0.0)


def truss_sine(scene: Scene, rng: np.random.Generator) -> Errors:
    """Half a sine; the beam is also wrung as it sinks, and 300 kg of carriage hang there whatever is in the ladle."""
    load = scene.weight + 300.0 * GRAVITY
    return _sunk(scene, lambda x: np.asarray(np.sin(np.pi * x / SPAN_M)), load, 0.5, float(0.5 * spread(rng, 1)[0]))


def _crept(scene: Scene, course: Array, rng: np.random.Generator) -> Errors:
    out = Errors.none(len(scene))
    way = np.concatenate([spread(rng, 3) * MM, 0.4 * spread(rng, 3) * MRAD])
    out.base[:] = np.outer(course, way)
    return out


def creep(scene: Scene, rng: np.random.Generator) -> Errors:
    """The fixed platform creeps at a steady rate."""
    return _crept(scene, scene.when, rng)


def creep_settling(scene: Scene, rng: np.random.Generator) -> Errors:
    """It settles: quickly at first, then hardly any more."""
    return _crept(scene, 1.0 - np.exp(-scene.when / 0.6), rng)


def creep_log(scene: Scene, rng: np.random.Generator) -> Errors:
    """Concrete: it goes with the logarithm of time."""
    return _crept(scene, np.log1p(4.0 * scene.when) / np.log(5.0), rng)


def ruler(scene: Scene, rng: np.random.Generator) -> Errors:
    """The device's scale is wrong."""
    out = Errors.none(len(scene))
    out.scale[:] = 20e-6 * rng.choice([-1.0, 1.0])
    return out


def ruler_air(scene: Scene, rng: np.random.Generator) -> Errors:
    """The scale is wrong and changes by a hundredth of that for each kelvin of the air."""
    out = Errors.none(len(scene))
    out.scale[:] = 20e-6 * rng.choice([-1.0, 1.0]) * (1.0 + 0.01 * (scene.ambient - REFERENCE_DEGC))
    return out
