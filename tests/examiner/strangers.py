"""Effects that are in nobody's library: for them the correct answer is "unknown".

From reports of the trade: cable-drag torque (Siciliano, Handbook of Robotics, ch. 6), bolted joints that slip once
(Bickford), sloshing (Ibrahim), rail joints and local wear (ISO 230-1, annexes), sensors that miss the heat (Mayr et al.
2012), trackers on warm tripods (ASME B89.4.19, annexes), beating pumps, homing that does not repeat.
A tracker that only sinks with time is not among them: relative to the machine it is `base_drift`.
"""

import numpy as np

from tests.examiner.faults import MM, phase, sign
from tests.examiner.machine import HOME_B


def after(s, share):
    """Return 1 for rows after that share of the rows (n,)."""
    return (np.arange(len(s.time)) >= share * len(s.time)).astype(float)


def one(leg, vectors, legs=4):
    """Return (n, legs, …) with vectors (n, …) at one leg."""
    out = np.zeros((len(vectors), legs, *np.shape(vectors)[1:]))
    out[:, leg] = vectors
    return out


def x_pinched_cable(rng, scene):
    """Taut beyond a pose."""
    way, k, side = rng.normal(size=3), rng.choice([0, 2, 3]), sign(rng)
    onset = np.quantile(side * scene.pose[:, k], rng.uniform(0.2, 0.6))
    pull = lambda s: np.maximum(side * s.pose[:, k] - onset, 0) / np.ptp(s.pose[:, k])  # noqa: E731
    return {"torque": lambda s, _: 1e3 * pull(s)[:, None] * way}


def x_bolt_slip(rng, scene):
    """Slips once."""
    part, leg, way, when = rng.choice(["A", "B"]), rng.integers(4), MM * rng.normal(size=3), rng.uniform(0.25, 0.75)
    return {part: lambda s, _: one(leg, after(s, when)[:, None] * way)}


def x_platform_stretch(rng, scene):
    """With the payload squared."""
    spread = np.array([rng.uniform(-1, 1), 1.0, 0.0]) * MM / 0.33
    return {"B": lambda s, _: (s.payload / 300)[:, None, None] ** 2 * spread * HOME_B}


def x_warm_tripod(rng, scene):
    """Leans with the sun through the gates."""
    way, period = np.append(rng.normal(size=3), rng.normal(size=3) / 4) * MM, rng.uniform(0.2, 0.45)
    bright = lambda s: np.maximum(np.sin(2 * np.pi * s.time / (period * np.ptp(s.time))), 0) ** 0.7  # noqa: E731
    return {"base": lambda s, _: s.lagged(bright(s), 900.0)[:, None] * way}


def x_pump_beat(rng, scene):
    """A slow beat of two pumps."""
    way, period, shift = np.append(rng.normal(size=3), np.zeros(3)) * MM, rng.uniform(400, 2400), phase(rng)
    return {"base": lambda s, _: np.sin(2 * np.pi * s.time / period + shift)[:, None] * way}


def x_hidden_heat(rng, scene):
    """A furnace door warms one leg beside its sensor."""
    leg, period, open_ = rng.integers(3), rng.uniform(2000, 6000), rng.uniform(0.2, 0.6)
    door = lambda s: ((s.time % period) < open_ * period).astype(float)  # noqa: E731
    return {"length": lambda s, _: one(leg, MM * s.drives[:, leg] * s.lagged(door(s), 600.0), 3)}


def x_sloshing(rng, scene):
    """The melt gathers on one side, most when half full."""
    side = sign(rng)

    def law(s, _):
        fill = s.payload / max(s.payload.max(), 1.0)
        gathered = 1e3 * side * fill * (1 - fill) * np.sin(2.5 * s.pose[:, 3])
        return np.column_stack([gathered, np.zeros_like(fill), 0.3 * gathered])

    return {"torque": law}


def x_screw_dent(rng, scene):
    """Worn at one length."""
    leg, wide = rng.integers(3), rng.uniform(0.012, 0.04)
    spot = np.quantile(scene.drives[:, leg], rng.uniform(0.2, 0.8))
    return {"length": lambda s, _: one(leg, MM * np.exp(-0.5 * ((s.drives[:, leg] - spot) / wide) ** 2), 3)}


def x_rail_joint(rng, scene):
    """A wheel drops into a gap."""
    spot, wide = rng.choice(scene.travel), rng.uniform(0.05, 0.15) * scene.span
    way = np.append(rng.normal(size=3) * 0.3 - [0, 0, 1], rng.normal(size=3) * 0.5) * MM
    return {"base": lambda s, _: (np.abs(s.travel - spot) < wide)[:, None] * way}


def x_rehoming(rng, scene):
    """References that move from session to session."""
    jump = MM * rng.normal(size=(4, 4)) * [1, 1, 1, 1.5]
    return {"length": lambda s, _: jump[s.session, :3], "tilt": lambda s, _: jump[s.session, 3]}


def x_bowed_leg(rng, scene):
    """One-sided radiation while melt is in the ladle."""
    leg, way = rng.integers(4), MM * np.append(rng.normal(size=2), 0.0)
    return {"foot": lambda s, _: one(leg, (s.lagged(s.melt, 1200.0)[:, None] / 1500) ** 4 * way)}


def x_crosstalk(rng, scene):
    """One encoder hears another."""
    leg, other = rng.permutation(3)[:2]
    period = rng.uniform(0.12, 0.3)
    return {"length": lambda s, _: one(leg, MM * np.sin(2 * np.pi * s.drives[:, other] / period), 3)}


ALL = (
    x_pinched_cable,
    x_bolt_slip,
    x_platform_stretch,
    x_warm_tripod,
    x_pump_beat,
    x_hidden_heat,
    x_sloshing,
    x_screw_dent,
    x_rail_joint,
    x_rehoming,
    x_bowed_leg,
    x_crosstalk,
)
# The cable and the melt pull on a machine that is stiffer than a real one: no bound on their torques.
FORMS = {
    f.__name__: [(f.__doc__.rstrip(".").lower(), np.inf if f in {x_pinched_cable, x_sloshing} else 5, f)] for f in ALL
}
