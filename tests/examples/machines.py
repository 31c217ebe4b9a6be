"""The four machines behind one interface: their commands, their motion, and which parts can have errors or be warm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tests.examples import arm, delta, five_bar, hexapod
from tests.examples.five_bar import Array

SCREW_PITCH = 0.010
"""Of the hexapod's legs, in m."""


@dataclass(frozen=True)
class Link:
    """A part with a thermometer: which number of the geometry grows, and how long the part is (m).

    Attributes:
        argument: of ``forward``, an array of that shape.
        shape: of the array.
        index: of the number in it.
        length: of the part.
    """

    argument: str
    shape: tuple[int, ...]
    index: tuple[int, ...]
    length: float


@dataclass(frozen=True)
class Machine:
    """One machine.

    Attributes:
        name: of the robot.
        columns: of its drives, without unit.
        unit: of its drives, inside.
        end: the body that is measured.
        targets: drive values of random poses, shape (n, drives).
        forward: position (n, 3) and rotation (n, 3, 3) of that body, for drive values and changes of the geometry.
        centres: arguments of ``forward`` that displace joint centres (m), with their shapes.
        tilts: likewise those that tilt joint axes (rad).
        links: parts with a thermometer, by the name of the URDF's link.
        payloads: masses (kg) that it carries in turn; none for one that gravity does not move.
        weight: force or torque of gravity on each drive, (n, drives), for drive values and payload (n,).
        moments: likewise across the axis of each joint of an open chain, (n, drives, 3).
    """

    name: str
    columns: tuple[str, ...]
    unit: Literal["m", "rad"]
    end: str
    targets: Callable[[np.random.Generator, int], Array]
    forward: Callable[..., tuple[Array, Array]]
    centres: Mapping[str, tuple[int, ...]]
    tilts: Mapping[str, tuple[int, ...]]
    links: Mapping[str, Link]
    payloads: tuple[float, ...] = ()
    weight: Callable[[Array, Array], Array] | None = None
    moments: Callable[[Array, Array], Array] | None = None


def _numbered(name: str, argument: str, lengths: Array) -> dict[str, Link]:
    return {
        name.format(k + 1): Link(argument, (len(lengths),), (k,), float(length)) for k, length in enumerate(lengths)
    }


def _sided(name: str, lengths: Array) -> dict[str, Link]:
    return {f"{side}_{name}": Link(name, (2,), (k,), float(lengths[k])) for k, side in enumerate(("left", "right"))}


MACHINES = {
    machine.name: machine
    for machine in (
        Machine(
            "five_bar",
            ("left", "right"),
            "rad",
            "tool",
            five_bar.targets,
            five_bar.forward,
            {"base": (2, 2), "crank": (2,), "coupler": (2,)},
            {},
            _sided("crank", five_bar.CRANK) | _sided("coupler", five_bar.COUPLER),
        ),
        Machine(
            "delta",
            ("q1", "q2", "q3"),
            "rad",
            "platform",
            delta.targets,
            delta.forward,
            {"base": (3, 3), "platform": (3, 3), "upper": (3,), "fore": (3,)},
            {},
            _numbered("arm{}_upper", "upper", delta.UPPER) | _numbered("arm{}_fore", "fore", delta.FORE),
            (0.0, 1.0, 3.0),
            delta.weight,
        ),
        Machine(
            "hexapod",
            tuple(f"l{k}" for k in range(1, 7)),
            "m",
            "table",
            hexapod.targets,
            hexapod.forward,
            {"base": (6, 3), "table": (6, 3)},
            {},
            _numbered("leg{}_barrel", "leg", hexapod.LENGTH),
            (0.0, 60.0, 150.0),
            hexapod.weight,
        ),
        Machine(
            "arm",
            tuple(f"q{k}" for k in range(1, 7)),
            "rad",
            "flange",
            arm.targets,
            arm.forward,
            {"origin": (6, 3)},
            {"tilt": (6, 3)},
            {
                "upper_arm": Link("origin", (6, 3), (2, 2), arm.UPPER),
                "elbow": Link("origin", (6, 3), (3, 0), arm.FORE / 2),
                "forearm": Link("origin", (6, 3), (4, 0), arm.FORE / 2),
            },
            (0.0, 5.0, 10.0),
            arm.weight,
            arm.moments,
        ),
    )
}
