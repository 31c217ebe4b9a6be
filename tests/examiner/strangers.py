"""Effects that are in nobody's library: for them the right answer is "unknown".

From reports of the trade: cable-drag torque (Siciliano, Handbook of Robotics, ch. 6), bolted joints that slip once
(Bickford), sloshing (Ibrahim), rail joints and local wear (ISO 230-1, annexes), sensors that miss the heat (Mayr et al.
2012), trackers on warm tripods (ASME B89.4.19, annexes), beating pumps, homing that does not repeat.
A tracker that only sinks with time is not among them: seen from the machine it is `base_drift`.
"""

import numpy as np

from tests.examiner.faults import FORMS, MM, form, quarter

STRANGER = "x_"


def outside():
    """Return the names of the strangers."""
    return sorted(name for name in FORMS if name.startswith(STRANGER))


def after(s, share):
    """Return 1 for rows after that share of the rows (n,)."""
    return (np.arange(len(s.time)) >= share * len(s.time)).astype(float)


def one(leg, vectors, legs=4):
    """Return (n, legs, …) with vectors (n, …) at one leg."""
    out = np.zeros((len(vectors), legs, *np.shape(vectors)[1:]))
    out[:, leg] = vectors
    return out


@form("x_pinched_cable", "taut beyond a pose", np.inf)
def _(rng, scene):
    way, k, sign = rng.normal(size=3), rng.choice([0, 2, 3]), rng.choice([-1, 1])
    onset = np.quantile(sign * scene.pose[:, k], rng.uniform(0.2, 0.6))
    pull = lambda s: np.maximum(sign * s.pose[:, k] - onset, 0) / np.ptp(s.pose[:, k])  # noqa: E731
    return {"torque": lambda s, _: 1e3 * pull(s)[:, None] * way}


@form("x_bolt_slip", "slips once", 3)
def _(rng, scene):
    part, leg, way, when = rng.choice(["A", "B"]), rng.integers(4), MM * rng.normal(size=3), rng.uniform(0.25, 0.75)
    return {part: lambda s, _: one(leg, after(s, when)[:, None] * way)}


@form("x_platform_stretch", "with the payload squared", 5)
def _(rng, scene):
    spread = np.array([rng.uniform(-1, 1), 1.0, 0.0]) * MM / 0.33
    spots = np.array([[-0.18, 0.33, 0], [-0.18, -0.33, 0], [0.18, 0.33, 0], [0.18, -0.33, 0]])
    return {"B": lambda s, _: (s.payload / 300)[:, None, None] ** 2 * spread * spots}


@form("x_warm_tripod", "leans with the sun through the gates", 5)
def _(rng, scene):
    way, period = np.append(rng.normal(size=3), rng.normal(size=3) / 4) * MM, rng.uniform(0.2, 0.45)
    bright = lambda s: np.maximum(np.sin(2 * np.pi * s.time / (period * np.ptp(s.time))), 0) ** 0.7  # noqa: E731
    return {"base": lambda s, _: s.lagged(bright(s), 900.0)[:, None] * way}


@form("x_pump_beat", "a slow beat of two pumps", 3)
def _(rng, scene):
    way, period, phase = np.append(rng.normal(size=3), np.zeros(3)) * MM, rng.uniform(400, 2400), quarter(rng)
    return {"base": lambda s, _: np.sin(2 * np.pi * s.time / period + phase)[:, None] * way}


@form("x_hidden_heat", "a furnace door warms one leg beside its sensor", 3)
def _(rng, scene):
    leg, period, open_ = rng.integers(3), rng.uniform(2000, 6000), rng.uniform(0.2, 0.6)
    door = lambda s: ((s.time % period) < open_ * period).astype(float)  # noqa: E731
    return {"length": lambda s, _: one(leg, MM * s.drives[:, leg] * s.lagged(door(s), 600.0), 3)}


@form("x_sloshing", "the melt gathers on one side, most when half full", np.inf)
def _(rng, scene):
    side = rng.choice([-1, 1])

    def law(s, _):
        fill = s.payload / max(s.payload.max(), 1.0)
        gathered = 1e3 * side * fill * (1 - fill) * np.sin(2.5 * s.pose[:, 3])
        return np.column_stack([gathered, np.zeros_like(fill), 0.3 * gathered])

    return {"torque": law}


@form("x_screw_dent", "worn at one length", 3)
def _(rng, scene):
    leg, wide = rng.integers(3), rng.uniform(0.012, 0.04)
    spot = np.quantile(scene.drives[:, leg], rng.uniform(0.2, 0.8))
    return {"length": lambda s, _: one(leg, MM * np.exp(-0.5 * ((s.drives[:, leg] - spot) / wide) ** 2), 3)}


@form("x_rail_joint", "a wheel drops into a gap", 5)
def _(rng, scene):
    spot, wide = rng.choice(scene.travel), rng.uniform(0.05, 0.15) * scene.span
    way = np.append(rng.normal(size=3) * 0.3 - [0, 0, 1], rng.normal(size=3) * 0.5) * MM
    return {"base": lambda s, _: (np.abs(s.travel - spot) < wide)[:, None] * way}


@form("x_rehoming", "references that move from session to session", 5)
def _(rng, scene):
    jump = MM * rng.normal(size=(4, 4)) * [1, 1, 1, 1.5]
    return {"length": lambda s, _: jump[s.session, :3], "tilt": lambda s, _: jump[s.session, 3]}


@form("x_bowed_leg", "one-sided radiation while melt is in the ladle", 5)
def _(rng, scene):
    leg, way = rng.integers(4), MM * np.append(rng.normal(size=2), 0.0)
    return {"foot": lambda s, _: one(leg, (s.lagged(s.melt, 1200.0)[:, None] / 1500) ** 4 * way)}


@form("x_crosstalk", "one encoder hears another", 3)
def _(rng, scene):
    leg, other = rng.permutation(3)[:2]
    between = lambda s: np.sin(2 * np.pi * s.drives[:, other] / rng_period)  # noqa: E731
    rng_period = rng.uniform(0.12, 0.3)
    return {"length": lambda s, _: one(leg, MM * between(s), 3)}
