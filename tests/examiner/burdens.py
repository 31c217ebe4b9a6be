"""Faults of heat, loads and time, with the ids of the contract, in the forms that the literature gives.

Sources: ISO 230-3, Mayr et al., CIRP Annals 61, 2012, Slocum 1992 (heat of screws and frames, lags); Johnson, Contact
Mechanics (F^2/3); Merlet, Parallel Robots (legs); harmonic-drive catalogues (stiffness K1, K2); Roark (beams);
Terzaghi (settling of foundations).
"""

import numpy as np

from tests.examiner.faults import FORMS, MM, MRAD, form
from tests.examiner.machine import HOME_B

__all__ = ["FORMS"]  # complete once this room is imported
ALPHA = 1.15e-5


@form("leg_thermal_expansion", "all of the leg", 1.5)
def _(rng, scene):
    return {"length": lambda s, _: ALPHA * s.drives[:, :3] * (s.legs[:, :3] - s.cold)}


@form("leg_thermal_expansion", "the screw from its bearing to the nut", 2)
def _(rng, scene):
    free = rng.uniform(0.05, 0.25)
    return {"length": lambda s, _: ALPHA * (s.drives[:, :3] - free) * (s.legs[:, :3] - s.cold)}


@form("leg_thermal_expansion", "a core that lags behind the sensor", 1.5)
def _(rng, scene):
    tau = rng.uniform(600, 3600)
    return {"length": lambda s, _: ALPHA * s.drives[:, :3] * (s.lagged(s.legs[:, :3], tau) - s.cold)}


@form("leg_thermal_expansion", "a rod of its own length", 2)
def _(rng, scene):
    rod = rng.uniform(0.3, 0.9)
    return {"length": lambda s, _: ALPHA * rod * (s.legs[:, :3] - s.cold)}


def growing(rng, factors, centre=(0, 0, 0), tau=None):
    """Return the growth of the moving platform from a centre, by axis, the target on it included."""
    spread = ALPHA * np.asarray(factors)
    mark = rng.uniform(-0.2, 0.2, 3)

    def warm(s):
        return (s.lagged(s.platform, tau) if tau else s.platform) - s.cold

    return {
        "B": lambda s, _: warm(s)[:, None, None] * spread * (HOME_B - centre),
        "mark": lambda s, _: warm(s)[:, None] * spread * (mark - centre),
    }


@form("platform_thermal_expansion", "even", 2)
def _(rng, scene):
    return growing(rng, [1, 1, 1])


@form("platform_thermal_expansion", "from a dowel", 2)
def _(rng, scene):
    return growing(rng, [1, 1, 1], rng.uniform(-1, 1, 3) * [0.18, 0.33, 0])


@form("platform_thermal_expansion", "even, behind the sensor", 2)
def _(rng, scene):
    return growing(rng, [1, 1, 1], tau=rng.uniform(600, 3600))


@form("platform_thermal_expansion", "stiff ribs along one side", 2)
def _(rng, scene):
    return growing(rng, rng.permutation([1.0, rng.uniform(0.5, 0.8), 1.0]) * [1, 1, 1])


@form("leg_compliance", "rods", 3)
def _(rng, scene):
    return {"length": lambda s, state: MM * s.drives[:, :3] / 0.7 * state.axial / 5000}


@form("leg_compliance", "nuts and bearings", 3)
def _(rng, scene):
    return {"length": lambda s, state: MM * state.axial / 5000}


@form("leg_compliance", "point contacts after Hertz", 3)
def _(rng, scene):
    return {"length": lambda s, state: MM * np.sign(state.axial) * (np.abs(state.axial) / 5000) ** (2 / 3)}


@form("leg_compliance", "rods, one leg softest", 3)
def _(rng, scene):
    soft = np.where(np.arange(3) == rng.integers(3), 1.0, rng.uniform(0.1, 0.4))
    return {"length": lambda s, state: MM * soft * s.drives[:, :3] / 0.7 * state.axial / 5000}


@form("tilt_drive_compliance", "a shaft", 20)
def _(rng, scene):
    return {"tilt": lambda s, state: MRAD * state.moment / 500}


@form("tilt_drive_compliance", "gears that harden", 20)
def _(rng, scene):
    knee, rest = rng.uniform(100, 400), rng.uniform(0.35, 0.7)
    bent = lambda m: np.clip(m, -knee, knee) + rest * (m - np.clip(m, -knee, knee))  # noqa: E731
    return {"tilt": lambda s, state: MRAD * bent(state.moment) / 500}


@form("tilt_drive_compliance", "teeth after Hertz", 20)
def _(rng, scene):
    return {"tilt": lambda s, state: MRAD * np.sign(state.moment) * (np.abs(state.moment) / 500) ** (2 / 3)}


def rails(sag, slope, trolley, uneven=0.0):
    """Return what rails do under trolley and ladle: sag and slope (per m) as functions of the share of the span; Roark.

    One rail softer than the other rolls the bridge over its gauge of 3 m.
    """

    def law(s, _):
        a, load = s.travel / s.span, (9.80665 * trolley + s.weight) / 20000
        out = np.zeros((len(a), 6))
        out[:, 2] = -MM * load * sag(a)
        out[:, 3] = -MM * load * slope(a) / s.span
        out[:, 4] = uneven * MM * load * sag(a) / 3.0
        return out

    return {"base": law}


@form("truss_deflection", "rails on two supports", 15)
def _(rng, scene):
    return rails(lambda a: 16 * (a * (1 - a)) ** 2, lambda a: 16 * a * (1 - a) * (1 - 2 * a), rng.uniform(300, 1500))


@form("truss_deflection", "rails built in at both ends", 15)
def _(rng, scene):
    ends = lambda a: 96 * (a * (1 - a)) ** 2 * (1 - 2 * a)  # noqa: E731
    return rails(lambda a: 64 * (a * (1 - a)) ** 3, ends, rng.uniform(300, 1500))


@form("truss_deflection", "rails of unlike stiffness", 15)
def _(rng, scene):
    uneven = rng.uniform(0.2, 0.8) * rng.choice([-1, 1])
    sag, slope = (lambda a: 16 * (a * (1 - a)) ** 2), (lambda a: 16 * a * (1 - a) * (1 - 2 * a))
    return rails(sag, slope, rng.uniform(300, 1500), uneven)


def creeping(rng, shape):
    """Return a drift along one direction, tilting as well, with a shape in time from 0 to about 1."""
    way = np.append(rng.normal(size=3), rng.normal(size=3) / 2.0) * MM
    return {"base": lambda s, _: shape((s.time - s.time[0]) / np.ptp(s.time))[:, None] * way}


@form("base_drift", "steady", 5)
def _(rng, scene):
    return creeping(rng, lambda u: u)


@form("base_drift", "settling exponentially", 5)
def _(rng, scene):
    tau = rng.uniform(0.2, 1.0)
    return creeping(rng, lambda u: (1 - np.exp(-u / tau)) / (1 - np.exp(-1 / tau)))


@form("base_drift", "creeping logarithmically", 5)
def _(rng, scene):
    tau = rng.uniform(0.03, 0.3)
    return creeping(rng, lambda u: np.log1p(u / tau) / np.log1p(1 / tau))
