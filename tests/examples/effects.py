"""Effects that may be hidden in a campaign: each for a size of one, in SI units, linear in its size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests.examples.five_bar import Array
from tests.examples.machines import SCREW_PITCH, Machine

REFERENCE_DEGC = 20.0


@dataclass(frozen=True)
class Scene:
    """What was done, row by row.

    Attributes:
        drives: commanded, in m or rad, shape (n, drives).
        approach: +1 where the drive was rising when it stopped, else -1, shape (n, drives).
        session: number of the session, shape (n,).
        time: in s, shape (n,).
        ambient: in °C, shape (n,).
        warmth: temperature of each part with a thermometer, in °C, shape (n, parts).
        payload: in kg, shape (n,).
    """

    drives: Array
    approach: Array
    session: Array
    time: Array
    ambient: Array
    warmth: Array
    payload: Array


@dataclass(frozen=True)
class Hidden:
    """How a machine is off.

    Attributes:
        drive: what its drives do more than commanded, in m or rad, shape (drives,) or (n, drives).
        geometry: changes of the geometry by argument of the machine's ``forward``.
        base: by how much the base stands elsewhere: shift (m) and rotation vector (rad) in base axes, (n, 6).
        scale: by which share the instrument shows lengths too long.
        told: what the truth says of it: values with their SI units.
    """

    drive: Array | float = 0.0
    geometry: dict[str, Array] = field(default_factory=dict)
    base: Array | float = 0.0
    scale: float = 0.0
    told: dict[str, float] = field(default_factory=dict)

    def times(self, size: float) -> Hidden:
        """Return it that many times as large."""
        return replace(
            self,
            drive=self.drive * size,
            geometry={name: value * size for name, value in self.geometry.items()},
            base=self.base * size,
            scale=self.scale * size,
            told={name: value * size for name, value in self.told.items()},
        )


Effect = Callable[[Machine, Scene, np.random.Generator], Hidden]


def _per_drive(machine: Machine, name: str, values: Array) -> dict[str, float]:
    return {f"{name}_{column}": float(value) for column, value in zip(machine.columns, values, strict=True)}


def zero_offset(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Each drive's zero is off."""
    values = random.normal(size=len(machine.columns))
    return Hidden(drive=values, told=_per_drive(machine, machine.unit, values))


def scale(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Each drive travels too far by a share of the command."""
    values = random.normal(size=len(machine.columns))
    return Hidden(drive=values * scene.drives, told=_per_drive(machine, "share", values))


def periodic(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Each drive errs with its own value: a joint in orders 1 to 9 of a turn, a screw with its pitch and half of it."""
    turns = 1.0 if machine.unit == "rad" else 2.0 * np.pi / SCREW_PITCH
    orders = np.array([1, 2, 4, 9]) if machine.unit == "rad" else np.array([1, 2])
    sizes = random.uniform(0.5, 1.0, size=(len(orders), len(machine.columns))) / np.sqrt(orders)[:, None]
    phases = random.uniform(0.0, 2.0 * np.pi, size=sizes.shape)
    waves = sizes * np.sin(orders[:, None] * turns * scene.drives[:, None, :] + phases)
    told = {
        f"order{o}_{c}": float(v)
        for o, row in zip(orders, sizes, strict=True)
        for c, v in zip(machine.columns, row, strict=True)
    }
    return Hidden(drive=waves.sum(axis=1), told=told)


def lost_motion(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Each drive stays behind by half its play, on the side it comes from."""
    halves = random.uniform(0.3, 1.0, size=len(machine.columns))
    return Hidden(drive=-halves * scene.approach, told=_per_drive(machine, machine.unit, 2.0 * halves))


def placement(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Joint centres stand elsewhere, arms are of other lengths, and axes of an arm are tilted: 1 m by 1 rad."""
    geometry = {name: random.normal(size=shape) for name, shape in (*machine.centres.items(), *machine.tilts.items())}
    return Hidden(geometry=geometry, told={"m": 1.0})


def compliance(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Each drive yields to the weight it carries: by the size where it carries as much as drives do on average."""
    if machine.weight is None:
        raise ValueError(f"gravity does not move the {machine.name}")
    force = machine.weight(scene.drives, scene.payload)
    softness = random.uniform(0.6, 1.4, size=len(machine.columns)) / np.sqrt(np.mean(force**2))
    return Hidden(drive=softness * force, told=_per_drive(machine, f"{machine.unit}_per_N", softness))


def soft_joints(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Each joint tilts across its axis with the moment that weight puts there: by the size at the mean of all."""
    if machine.moments is None:
        raise ValueError(f"the chains of the {machine.name} are closed")
    across = machine.moments(scene.drives, scene.payload)
    softness = random.uniform(0.6, 1.4, size=across.shape[1:]) / np.sqrt(np.mean(across**2))
    told = {f"rad_per_Nm_{c}": float(s.mean()) for c, s in zip(machine.columns, softness, strict=True)}
    return Hidden(geometry={"tilt": softness * across}, told=told)


def session_offset(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """The tracker is set up anew each session, and nobody says so: the base seems to stand elsewhere."""
    twists = np.stack([_twist(random) for _ in range(int(scene.session.max()))])
    twists[0] = 0.0
    return Hidden(base=twists[scene.session.astype(int) - 1], told={"m": 1.0, "rad": 0.3})


def _twist(random: np.random.Generator) -> Array:
    twist = random.normal(size=6)
    return np.asarray(twist * np.repeat([1.0 / np.linalg.norm(twist[:3]), 0.3 / np.linalg.norm(twist[3:])], 3))


def base_drift(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """The base creeps with time, evenly or ever more slowly."""
    hours = (scene.time - scene.time[0]) / 3600.0
    course = hours / hours[-1] if random.random() < 0.5 else 1.0 - np.exp(-3.0 * hours / hours[-1])
    return Hidden(base=course[:, None] * _twist(random), told={"m_in_all": 1.0, "rad_in_all": 0.3})


def metrology_scale(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """The instrument's metre is wrong."""
    sign = float(random.choice([-1.0, 1.0]))
    return Hidden(scale=sign, told={"share": sign})


def thermal(machine: Machine, scene: Scene, random: np.random.Generator) -> Hidden:
    """Links grow with the temperature of their own thermometer, all with one coefficient."""
    geometry: dict[str, Array] = {}
    for k, link in enumerate(machine.links.values()):
        growth = geometry.setdefault(link.argument, np.zeros((len(scene.time), *link.shape)))
        number: Any = (..., *link.index)
        growth[number] += link.length * (scene.warmth[:, k] - REFERENCE_DEGC)
    return Hidden(geometry=geometry, told={"per_K": 1.0})


EFFECTS: dict[str, Effect] = {
    "zero_offset": zero_offset,
    "scale": scale,
    "periodic": periodic,
    "lost_motion": lost_motion,
    "placement": placement,
    "base_drift": base_drift,
    "metrology_scale": metrology_scale,
    "thermal": thermal,
    "compliance": compliance,
    "soft_joints": soft_joints,
    "session_offset": session_offset,
}
"""What can be hidden, by name."""

IDS = {
    "zero_offset": "drive_zero_offset",
    "scale": "drive_scale",
    "lost_motion": "drive_backlash",
    "placement": "joint_placement",
    "thermal": "link_thermal_expansion",
    "compliance": "drive_compliance",
    "soft_joints": "joint_compliance",
}
"""What a diagnosis calls those that it calls otherwise."""

LARGEST = {
    "zero_offset": 1e-2,
    "scale": 5e-3,
    "periodic": 2e-3,
    "lost_motion": 1e-3,
    "placement": 2e-3,
    "base_drift": 3e-3,
    "metrology_scale": 1e-3,
    "thermal": 2.6e-5,
    "compliance": 2e-3,
    "soft_joints": 2e-3,
    "session_offset": 3e-3,
}
"""Sizes beyond which no machine is let out of the workshop, in m, rad, as a share, or a K."""


def id_of(effect: str, machine: Machine) -> str:
    """Return what a diagnosis calls an effect."""
    periodic = "joint_periodic" if machine.unit == "rad" else "drive_periodic"
    return periodic if effect == "periodic" else IDS.get(effect, effect)


def effects_of(machine: Machine) -> tuple[str, ...]:
    """Return the effects that make sense for a machine: what gravity moves yields.

    What it does to the joints of closed chains hangs on how stiff all are.
    """
    without = {"compliance"} if machine.weight is None else set()
    without |= {"soft_joints"} if machine.moments is None else set()
    return tuple(name for name in EFFECTS if name not in without)
