"""The rig: a machine with its manufacturing errors, its faults and the instrument that measures it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.examiner.conditions import Scene
from tests.examiner.machine import DOWN, LEGS, Parts, Springs, State, along, drawing, settle, start, turn, unit

Act = Callable[[Parts, Scene, State, float], None]


@dataclass
class Fault:
    """One cause: `act` changes the parts in place for a size; size 1 is a usual one."""

    effect: str
    form: str
    act: Act
    size: float = 1.0
    notes: dict[str, Any] = field(default_factory=dict)


@dataclass
class Sight:
    """What a perfect instrument sees of the target: positions (n, 3), m, and rotations (n, 3, 3) in its frame."""

    x: np.ndarray
    R: np.ndarray


class Rig:
    """A machine as built, in its hall, with a tracker somewhere and a target on the platform."""

    def __init__(self, rng, scene, workmanship):
        """Build it: workmanship scales joint centres of 0.015 mm and axes of 0.01 mrad (standard deviations).

        Jig boring holds 5…20 µm on centres (ISO 286 IT5 of a 0.4 m frame: 25 µm) and axes to 3 µm in 300 mm
        (Slocum, Precision Machine Design, ch. 7).
        """
        self.scene, self.rng = scene, rng
        self.faults: list[Fault] = []
        spreads = (
            rng.normal,
            lambda size: rng.uniform(-(3**0.5), 3**0.5, size),
            lambda size: rng.standard_t(4, size) / 2**0.5,
        )
        deviate = spreads[rng.integers(3)]
        self.centres = [15e-6 * workmanship * deviate(size=(LEGS, 3)) for _ in range(3)]
        self.axes = [1e-5 * workmanship * deviate(size=(LEGS, 3)) for _ in range(5)]
        self.springs = Springs(cross=1e10 * rng.uniform(0.03, 0.09) ** 2)
        far = rng.random() < 0.5
        self.tracker = turn(np.array([0, 0, rng.uniform(-2, 2)]) * far + 0.02 * rng.normal(size=3))
        self.stand = rng.uniform([2, -3, -1.5], [6, 3, 0.5]) * far + 0.002 * rng.normal(size=3)
        self.target = turn(0.01 * rng.normal(size=3) + far * 0.3 * rng.normal(size=3))
        self.seat = 0.002 * rng.normal(size=3) + far * rng.uniform(-0.3, 0.3, size=3)

    def built(self) -> Parts:
        """Return the parts as built, cold and unloaded."""
        parts = drawing(self.scene.drives)
        a, b, foot = self.centres
        parts.A += a
        parts.B += b
        parts.foot += foot * [1, 1, 0]
        for name, error in zip(("S1", "S2", "S4", "S5"), self.axes[:4], strict=True):
            axis = getattr(parts, name)
            setattr(parts, name, unit(axis + np.cross(error, axis)))
        parts.cross += self.axes[4][:, :2]
        return parts

    def rest(self, faults=None, weight=True) -> tuple[Parts, State]:
        """Return parts and bodies at rest under load and faults: laws that hang on forces are met by repetition."""
        scene = self.scene
        faults = self.faults if faults is None else faults
        state = settle(self.built(), start(scene.pose), self.springs)
        before = np.inf
        for turn_ in range(12):
            parts = self.built()
            if weight:
                pull = scene.weight[:, None] * DOWN
                parts.force += pull
                parts.torque += np.cross(along(state.R, scene.com), pull)
            for fault in faults:
                fault.act(parts, scene, state, fault.size)
            after = settle(parts, state, self.springs)
            change = np.abs(after.p - state.p).max()
            state = after
            if change < 1e-8 or (
                turn_ > 5 and change > 0.5 * before
            ):  # a flank that flips between sides stays where it is
                break
            before = change
        return parts, state

    def see(self, faults=None, weight=True) -> Sight:
        """Return what a perfect instrument sees of the machine at rest."""
        parts, state = self.rest(faults, weight)
        base = turn(parts.base[:, 3:])
        p = along(base, state.p + along(state.R, self.seat + parts.mark)) + parts.base[:, :3]
        x = (self.stand + along(self.tracker, p)) * (1 + parts.scale)[:, None]
        return Sight(x, self.tracker @ base @ state.R @ self.target)

    def stiffen(self, judge):
        """Make the springs so stiff that weight alone shows little beside the noise; return how much, in its units."""
        bare = judge.ratio(self.see(faults=[], weight=False), self.see(faults=[]))
        little = np.exp(self.rng.uniform(np.log(0.03), np.log(0.25)))
        self.springs = self.springs.stiffer(max(bare / little, 1.0))
        return min(bare, little)
