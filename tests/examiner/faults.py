"""Faults of drives, joints and instruments, with the ids of the contract, in the forms that the literature gives.

Sources: ISO 230-1 (joint axes), ISO 230-2 (lead, cyclic error, reversal), JIS B 1192 (e2π); Slocum, Precision Machine
Design, 1992 (lead, backlash); Altintas et al., CIRP Annals 60, 2011 (drives: wind-up, friction); Merlet, Parallel
Robots (joints, legs); ASME B89.4.19, Edlén 1966, Ciddor 1996 (laser trackers, refractive index).

A form is a function (rng, scene) -> {field of Parts: law(scene, state)}; a law gives what size 1 adds. `most` is the
size beyond which a machine shop would not believe it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.examiner.rig import Fault

FORMS: dict[str, list[tuple[str, float, Callable[..., dict[str, Any]]]]] = {}
MM = MRAD = 1e-3
SHORTEST = 0.284


def form(effect, name, most):
    """Register a form of an effect, with its largest believable size."""

    def register(function):
        FORMS.setdefault(effect, []).append((name, most, function))
        return function

    return register


def draw(rng, scene, effect):
    """Return the fault of a form drawn at random, and its largest believable size."""
    forms = FORMS[effect]
    name, most, function = forms[rng.integers(len(forms))]
    laws = function(rng, scene)

    def act(parts, scene, state, size):
        for part, law in laws.items():
            setattr(parts, part, getattr(parts, part) + size * law(scene, state))

    return Fault(effect, name, act), most


def shares(rng, count):
    """Return whom it hits: one of them, each differently, or all alike (count,)."""
    style = rng.integers(3)
    if style == 0:
        return np.eye(count)[rng.integers(count)] * rng.choice([-1, 1])
    return rng.normal(size=count) if style == 1 else np.full(count, rng.choice([-1.0, 1.0]))


def fixed(value):
    """Return the law of what is the same in all rows."""
    value = np.asarray(value)
    return lambda scene, state: np.broadcast_to(value, (len(scene.time), *value.shape))


def quarter(rng):
    """Return a phase, rad."""
    return rng.uniform(0, 2 * np.pi)


@form("drive_zero_offset", "one home switch", 8)
def _(rng, scene):
    return {"length": fixed(MM * np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]))}


@form("drive_zero_offset", "all references", 8)
def _(rng, scene):
    return {"length": fixed(MM * rng.normal(size=3)), "tilt": fixed(2 * MRAD * rng.normal())}


@form("drive_zero_offset", "tilt encoder put on turned", 20)
def _(rng, scene):
    return {"tilt": fixed(MRAD * rng.choice([-1, 1]))}


@form("drive_scale", "lead", 5)
def _(rng, scene):
    share = 1e-3 * shares(rng, 3)
    return {"length": lambda s, _: share * s.drives[:, :3]}


@form("drive_scale", "lead from the home position", 5)
def _(rng, scene):
    share, home = 1e-3 * shares(rng, 3), rng.choice([SHORTEST, 0.6, 1.07])
    return {"length": lambda s, _: share * (s.drives[:, :3] - home)}


@form("drive_scale", "lead that bows along the screw", 5)
def _(rng, scene):
    share, bow = 1e-3 * shares(rng, 3), rng.uniform(-0.3, 0.3)
    return {"length": lambda s, _: share * s.drives[:, :3] * (1 + bow * (s.drives[:, :3] - SHORTEST) / 0.8)}


@form("drive_cyclic", "eccentric screw", 1)
def _(rng, scene):
    share, phase = MM * shares(rng, 3), rng.uniform(0, 2 * np.pi, 3)
    return {"length": lambda s, _: share * np.sin(2 * np.pi * s.drives[:, :3] / s.pitch + phase)}


@form("drive_cyclic", "eccentric screw and a coupling's second harmonic", 1)
def _(rng, scene):
    share, phase, more = MM * shares(rng, 3), rng.uniform(0, 2 * np.pi, (2, 3)), rng.uniform(0.2, 0.5)
    return {
        "length": lambda s, _: (
            share
            * sum(
                a * np.sin(2 * np.pi * k * s.drives[:, :3] / s.pitch + phase[k - 1]) for k, a in ((1, 1.0), (2, more))
            )
        )
    }


@form("drive_cyclic", "bent screw, worse towards its end", 1)
def _(rng, scene):
    share, phase = MM * shares(rng, 3), rng.uniform(0, 2 * np.pi, 3)
    return {
        "length": lambda s, _: share * (0.4 + s.drives[:, :3]) * np.sin(2 * np.pi * s.drives[:, :3] / s.pitch + phase)
    }


def flank(approach, load, friction):
    """Return the flank (±1) a free play rests on: dragged behind by friction, or pressed there by a larger load."""
    return np.where(np.abs(load) > friction, np.sign(load), -approach)


@form("drive_backlash", "free play held by friction", 2)
def _(rng, scene):
    width = MM * np.abs(shares(rng, 3))
    return {"length": lambda s, state: width / 2 * flank(s.approach[:, :3], state.axial, np.inf)}


@form("drive_backlash", "free play that larger loads close", 2)
def _(rng, scene):
    width, friction = MM * np.abs(shares(rng, 3)), rng.uniform(1000, 2500)
    return {"length": lambda s, state: width / 2 * flank(s.approach[:, :3], state.axial, friction)}


@form("drive_backlash", "wind-up against friction that grows with load", 2)
def _(rng, scene):
    width, preload = MM * np.abs(shares(rng, 3)), rng.uniform(1000, 4000)
    drag = lambda f: (preload + np.abs(f)) / (preload + 1500)  # noqa: E731
    return {"length": lambda s, state: -width / 2 * s.approach[:, :3] * drag(state.axial)}


@form("drive_backlash", "gear play of the tilt drive", 6)
def _(rng, scene):
    friction = rng.choice([np.inf, rng.uniform(200, 600)])
    return {"tilt": lambda s, state: MRAD / 2 * flank(s.approach[:, 3], state.moment, friction)}


def hit(legs, vectors):
    """Return (4, 3) with vectors at some legs."""
    out = np.zeros((4, 3))
    out[legs] = vectors
    return fixed(out)


@form("joint_centre_offset", "one centre bored off", 5)
def _(rng, scene):
    v = rng.normal(size=3)
    return {rng.choice(["A", "B"]): hit([rng.integers(4)], MM * v / np.linalg.norm(v))}


@form("joint_centre_offset", "a pair bored in one setting", 5)
def _(rng, scene):
    pair = [(0, 1), (2, 3), (0, 2), (1, 3)][rng.integers(4)]
    return {rng.choice(["A", "B"]): hit(list(pair), MM * rng.normal(size=3))}


@form("joint_centre_offset", "all centres of a coarse class", 3)
def _(rng, scene):
    return {"A": fixed(MM * rng.normal(size=(4, 3))), "B": fixed(MM * rng.normal(size=(4, 3)))}


@form("joint_axis_tilt", "one bearing block", 5)
def _(rng, scene):
    angle = quarter(rng)
    return {rng.choice(["S1", "S5"]): hit([rng.integers(4)], MRAD * np.array([np.cos(angle), 0, np.sin(angle)]))}


@form("joint_axis_tilt", "twisted yokes of one leg", 5)
def _(rng, scene):
    return {"S4": hit([rng.integers(4)], MRAD * np.array([0, rng.choice([-1, 1]), 0]))}


@form("joint_axis_tilt", "a cross that is not square", 5)
def _(rng, scene):
    out = np.zeros((4, 2))
    out[rng.integers(4), rng.integers(2)] = MRAD * rng.choice([-1, 1])
    return {"cross": fixed(out)}


@form("joint_axis_tilt", "all axes of a coarse class", 3)
def _(rng, scene):
    return {name: fixed(MRAD * rng.normal(size=(4, 3)) * [1, 0, 1]) for name in ("S1", "S5")}


@form("tilt_encoder_eccentricity", "eccentric disc", 15)
def _(rng, scene):
    phase = quarter(rng)
    return {"tilt": lambda s, _: MRAD * np.sin(s.drives[:, 3] + phase)}


@form("tilt_encoder_eccentricity", "eccentric and wobbling disc", 15)
def _(rng, scene):
    phase, second, share = quarter(rng), quarter(rng), rng.uniform(0.2, 0.5)
    return {"tilt": lambda s, _: MRAD * (np.sin(s.drives[:, 3] + phase) + share * np.sin(2 * s.drives[:, 3] + second))}


@form("metrology_scale", "a wrong scale bar", 20)
def _(rng, scene):
    return {"scale": fixed(np.array(1e-4 * rng.choice([-1, 1])))}


@form("metrology_scale", "refractive index of the hall's air", 25)
def _(rng, scene):
    return {"scale": lambda s, _: 0.95e-6 * (s.ambient - s.cold)}
