"""The faults with the ids of the contract, each in the physical forms that the literature gives.

Sources: ISO 230-1 (joint axes), ISO 230-2 (lead, cyclic error, reversal), ISO 230-3 (heat); JIS B 1192 (e2π); Slocum,
Precision Machine Design, 1992 (lead, backlash, heat); Altintas et al., CIRP Annals 60, 2011 (wind-up, friction); Mayr
et al., CIRP Annals 61, 2012 (lags); Johnson, Contact Mechanics (F^2/3); Merlet, Parallel Robots (joints, legs);
harmonic-drive catalogues (K1, K2); Roark (beams); Terzaghi (settling); Edlén 1966, Ciddor 1996 (refractive index).

A form is a function (rng, scene) -> {field of Parts: law(scene, state)}; a law gives what size 1 adds. Each form has
the size beyond which a machine shop would not consider it plausible.
"""

import numpy as np

from tests.examiner.machine import GRAVITY, HOME_B
from tests.examiner.rig import Fault

MM = MRAD = 1e-3
SHORTEST = 0.284  # m, of a leg
ALPHA = 1.15e-5  # 1/K, steel


def draw(rng, scene, effect, forms):
    """Return the fault of one of an effect's forms, and its largest believable size."""
    name, most, form = forms[rng.integers(len(forms))]
    return Fault(effect, name, acting(form(rng, scene))), most


def acting(laws):
    """Return the act that adds a dose of each law to its field."""

    def act(parts, scene, state, size):
        for part, law in laws.items():
            setattr(parts, part, getattr(parts, part) + size * law(scene, state))

    return act


def fixed(value):
    """Return the law of what is the same in all rows."""
    value = np.asarray(value)
    return lambda s, _: np.broadcast_to(value, (len(s.time), *value.shape))


def sign(rng):
    """Return +1 or -1."""
    return rng.choice([-1.0, 1.0])


def phase(rng, *shape):
    """Return phases, rad."""
    return rng.uniform(0, 2 * np.pi, shape)


def shares(rng, count):
    """Return whom it hits: one of them, each differently, or all alike (count,)."""
    one, alike = np.eye(count)[rng.integers(count)], np.ones(count)
    return [one * sign(rng), rng.normal(size=count), alike * sign(rng)][rng.integers(3)]


def some(rng, fields, where, vector):
    """Return {one of the fields: the law of a vector at one entry (or entries) of four}."""
    out = np.zeros((4, len(vector)))
    out[where] = vector
    return {str(rng.choice(fields)): fixed(out)}


# Drives.


def lead(rng, home=0.0, bow=0.0):
    """Return a lead error that counts from a home position and may bow along the screw."""
    share = 1e-3 * shares(rng, 3)
    return {"length": lambda s, _: share * (s.drives[:, :3] - home) * (1 + bow * (s.drives[:, :3] - SHORTEST) / 0.8)}


def wave(rng, second=0.0, bend=0.0):
    """Return an error periodic with the pitch, with a second harmonic or growing towards the screw's end."""
    share, shift = MM * shares(rng, 3), phase(rng, 2, 3)

    def law(s, _):
        turns = 2 * np.pi * s.drives[:, :3] / s.pitch
        return share * (1 + bend * s.drives[:, :3]) * (np.sin(turns + shift[0]) + second * np.sin(2 * turns + shift[1]))

    return {"length": law}


def flank(approach, load, friction):
    """Return the flank (±1) a free play rests on: dragged behind by friction, or pressed there by a larger load."""
    return np.where(np.abs(load) > friction, np.sign(load), -approach)


def play(rng, friction=np.inf):
    """Return free play of the nuts."""
    width = MM * np.abs(shares(rng, 3))
    return {"length": lambda s, state: width / 2 * flank(s.approach[:, :3], state.axial, friction)}


def windup(rng):
    """Return elastic lag behind a friction that grows with the load."""
    width, preload = MM * np.abs(shares(rng, 3)), rng.uniform(1000, 4000)
    drag = lambda force: (preload + np.abs(force)) / (preload + 1500)  # noqa: E731
    return {"length": lambda s, state: -width / 2 * s.approach[:, :3] * drag(state.axial)}


def gear_play(rng, friction):
    """Return free play of the tilt drive."""
    return {"tilt": lambda s, state: MRAD / 2 * flank(s.approach[:, 3], state.moment, friction)}


def disc(rng, second=0.0):
    """Return the error of an encoder disc off its centre, wobbling by a second harmonic."""
    shift = phase(rng, 2)
    return {
        "tilt": lambda s, _: MRAD * (np.sin(s.drives[:, 3] + shift[0]) + second * np.sin(2 * s.drives[:, 3] + shift[1]))
    }


# Heat and loads.


def hot(rod=0.0, running=1.0, tau=None):
    """Return the growth of legs of a fixed length and a running share, as warm as the sensor says or behind it."""

    def law(s, _):
        warm = (s.lagged(s.legs[:, :3], tau) if tau else s.legs[:, :3]) - s.cold
        return ALPHA * (rod + running * s.drives[:, :3]) * warm

    return {"length": law}


def growing(rng, factors=(1, 1, 1), centre=(0, 0, 0), tau=None):
    """Return the growth of the moving platform from a centre, by axis, the target on it included."""
    spread, mark = ALPHA * np.asarray(factors), rng.uniform(-0.2, 0.2, 3) - centre
    warm = lambda s: (s.lagged(s.platform, tau) if tau else s.platform) - s.cold  # noqa: E731
    return {
        "B": lambda s, _: warm(s)[:, None, None] * spread * (HOME_B - centre),
        "mark": lambda s, _: warm(s)[:, None] * spread * mark,
    }


def bent(force, power=1.0):
    """Return a deformation with the sign of a force (or moment) and a power of it."""
    return np.sign(force) * np.abs(force) ** power


def hardening(rng):
    """Return a gear that is softer below a knee."""
    knee, rest = rng.uniform(100, 400), rng.uniform(0.35, 0.7)
    low = lambda m: np.clip(m, -knee, knee)  # noqa: E731
    return {"tilt": lambda _, state: MRAD * (low(state.moment) + rest * (state.moment - low(state.moment))) / 500}


def rods(soft=1.0):
    """Return rods that stretch with length and tension, some softer than others."""
    return {"length": lambda s, state: MM * soft * s.drives[:, :3] / 0.7 * state.axial / 5000}


def rails(rng, built_in=False, uneven=0.0):
    """Return what rails on two supports, or built in, do under trolley and ladle where the truss stands.

    Unlike rails roll the bridge over their gauge of 3 m.
    """
    trolley = rng.uniform(300, 1500)

    def law(s, _):
        a, load = s.travel / s.span, MM * (GRAVITY * trolley + s.weight) / 20000
        sag = 64 * (a * (1 - a)) ** 3 if built_in else 16 * (a * (1 - a)) ** 2
        slope = (96 * (a * (1 - a)) ** 2 if built_in else 16 * a * (1 - a)) * (1 - 2 * a) / s.span
        none = np.zeros_like(a)
        return np.column_stack([none, none, -load * sag, -load * slope, uneven * load * sag / 3.0, none])

    return {"base": law}


def creeping(rng, shape):
    """Return a drift along one direction, tilting as well, with a shape in time from 0 to 1."""
    way = np.append(rng.normal(size=3), rng.normal(size=3) / 2.0) * MM
    return {"base": lambda s, _: (shape((s.time - s.time[0]) / np.ptp(s.time)) / shape(1.0))[:, None] * way}


def settling(rng):
    """Return the shape of a foundation that comes to rest."""
    tau = rng.uniform(0.2, 1.0)
    return lambda u: 1 - np.exp(-u / tau)


def logarithmic(rng):
    """Return the shape of slow creep."""
    tau = rng.uniform(0.03, 0.3)
    return lambda u: np.log1p(u / tau)


def around(rng):
    """Return an axis's small turn across it, (3,)."""
    angle = phase(rng)
    return MRAD * np.array([np.cos(angle), 0, np.sin(angle)])


PAIRS = [[0, 1], [2, 3], [0, 2], [1, 3]]
FORMS = {
    "drive_zero_offset": [
        ("one home switch", 8, lambda r, s: {"length": fixed(MM * np.eye(3)[r.integers(3)] * sign(r))}),
        ("all references", 8, lambda r, s: {"length": fixed(MM * r.normal(size=3)), "tilt": fixed(2e-3 * r.normal())}),
        ("tilt encoder put on turned", 20, lambda r, s: {"tilt": fixed(MRAD * sign(r))}),
    ],
    "drive_scale": [
        ("lead", 5, lambda r, s: lead(r)),
        ("lead from the home position", 5, lambda r, s: lead(r, home=r.choice([SHORTEST, 0.6, 1.07]))),
        ("lead that bows along the screw", 5, lambda r, s: lead(r, bow=r.uniform(-0.3, 0.3))),
    ],
    "drive_cyclic": [
        ("eccentric screw", 1, lambda r, s: wave(r)),
        ("eccentric screw, a coupling's second harmonic", 1, lambda r, s: wave(r, second=r.uniform(0.2, 0.5))),
        ("bent screw, worse towards its end", 1, lambda r, s: wave(r, bend=2.0)),
    ],
    "drive_backlash": [
        ("free play held by friction", 2, lambda r, s: play(r)),
        ("free play that larger loads close", 2, lambda r, s: play(r, friction=r.uniform(1000, 2500))),
        ("wind-up against friction that grows with load", 2, lambda r, s: windup(r)),
        ("gear play of the tilt drive", 6, lambda r, s: gear_play(r, r.choice([np.inf, r.uniform(200, 600)]))),
    ],
    "joint_centre_offset": [
        ("one centre bored off", 5, lambda r, s: some(r, ["A", "B"], r.integers(4), MM * r.normal(size=3))),
        ("a pair bored in one setting", 5, lambda r, s: some(r, ["A", "B"], r.choice(PAIRS), MM * r.normal(size=3))),
        ("all centres of a coarse class", 3, lambda r, s: {k: fixed(MM * r.normal(size=(4, 3))) for k in "AB"}),
    ],
    "joint_axis_tilt": [
        ("one bearing block", 5, lambda r, s: some(r, ["S1", "S5"], r.integers(4), around(r))),
        ("twisted yokes of one leg", 5, lambda r, s: some(r, ["S4"], r.integers(4), MRAD * np.array([0, sign(r), 0]))),
        ("a cross not square", 5, lambda r, s: some(r, ["cross"], r.integers(4), MRAD * np.eye(2)[r.integers(2)])),
        ("all axes of a coarse class", 3, lambda r, s: {k: fixed([around(r) for _ in range(4)]) for k in ("S1", "S5")}),
    ],
    "leg_thermal_expansion": [
        ("all of the leg", 1.5, lambda r, s: hot()),
        ("the screw from its bearing to the nut", 2, lambda r, s: hot(rod=-r.uniform(0.05, 0.25))),
        ("a core that lags behind the sensor", 1.5, lambda r, s: hot(tau=r.uniform(600, 3600))),
        ("a rod of its own length", 2, lambda r, s: hot(rod=r.uniform(0.3, 0.9), running=0.0)),
    ],
    "platform_thermal_expansion": [
        ("even", 2, lambda r, s: growing(r)),
        ("from a dowel", 2, lambda r, s: growing(r, centre=r.uniform(-1, 1, 3) * [0.18, 0.33, 0])),
        ("even, behind the sensor", 2, lambda r, s: growing(r, tau=r.uniform(600, 3600))),
        ("stiff ribs along one side", 2, lambda r, s: growing(r, r.permutation([1.0, r.uniform(0.5, 0.8), 1.0]))),
    ],
    "leg_compliance": [
        ("rods", 3, lambda r, s: rods()),
        ("nuts and bearings", 3, lambda r, s: {"length": lambda s, state: MM * state.axial / 5000}),
        (
            "point contacts after Hertz",
            3,
            lambda r, s: {"length": lambda s, state: MM * bent(state.axial / 5000, 2 / 3)},
        ),
        ("rods, one leg softest", 3, lambda r, s: rods(r.permutation([1.0, *r.uniform(0.1, 0.4, 2)]))),
    ],
    "tilt_drive_compliance": [
        ("a shaft", 20, lambda r, s: {"tilt": lambda s, state: MRAD * state.moment / 500}),
        ("gears that harden", 20, lambda r, s: hardening(r)),
        ("teeth after Hertz", 20, lambda r, s: {"tilt": lambda s, state: MRAD * bent(state.moment / 500, 2 / 3)}),
    ],
    "truss_deflection": [
        ("rails on two supports", 15, lambda r, s: rails(r)),
        ("rails built in at both ends", 15, lambda r, s: rails(r, built_in=True)),
        ("rails of unlike stiffness", 15, lambda r, s: rails(r, uneven=r.uniform(0.2, 0.8) * sign(r))),
    ],
    "base_drift": [
        ("steady", 5, lambda r, s: creeping(r, lambda u: u)),
        ("settling exponentially", 5, lambda r, s: creeping(r, settling(r))),
        ("creeping logarithmically", 5, lambda r, s: creeping(r, logarithmic(r))),
    ],
    "tilt_encoder_eccentricity": [
        ("eccentric disc", 15, lambda r, s: disc(r)),
        ("eccentric and wobbling disc", 15, lambda r, s: disc(r, second=r.uniform(0.2, 0.5))),
    ],
    "metrology_scale": [
        ("a wrong scale bar", 20, lambda r, s: {"scale": fixed(1e-4 * sign(r))}),
        ("refractive index of the air", 25, lambda r, s: {"scale": lambda s, _: 0.95e-6 * (s.ambient - s.cold)}),
    ],
}
