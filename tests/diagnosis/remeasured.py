"""A machine of the rig that is measured twice: first in poor conditions, then as the diagnosis suggests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.data import Campaign as MeasuredCampaign
from pouring_robot.diagnosis.suggest.next_measurements import SuggestedMeasurement
from tests.rig import Campaign, write_case
from tests.rig.campaign import cells_of, frames_of, settings_of
from tests.rig.conditions import CENTRE_OF_MASS, GRAVITY, TARE_KG, Scene, plan
from tests.rig.effects import FORMS
from tests.rig.machine import Errors, close, drives_of
from tests.rig.metrology import Tracker, basis, rms, without
from tests.rig.rotations import from_vector, product, to_vector, turn

SIGMA_M, SIGMA_RAD = 5e-5, 6e-5
LARGEST = {"tilt_encoder_eccentricity": 40.0}
"""Size beyond which an effect is not credible; 3 of its units where none is given."""


class Machine:
    """A machine with one effect of a given size in units of the noise, measured in a way that hides which one it is."""

    def __init__(self, effect: str, form: str, trap: str, ratio: float = 5.0, rows: int = 80, seed: int = 3) -> None:
        self.effect, self.form, self.seed, self.largest = effect, form, seed, LARGEST.get(effect, 3.0)
        rng = np.random.default_rng([seed, 1])
        self.scene = plan(rng, rows, 1, trap)
        self.tracker = Tracker(*frames_of(rng, False), SIGMA_M, SIGMA_RAD)
        self.size = self._size(ratio)

    def errors(self, scene: Scene, size: float) -> Errors:
        """The machine is the same every time: its form draws from the same seed."""
        return FORMS[self.effect][self.form](scene, np.random.default_rng([self.seed, 2])) * size

    def _size(self, ratio: float) -> float:
        faultless = self.tracker.see(self.scene, Errors.none(len(self.scene)))
        frames, size = basis(self.tracker.frames(faultless)), 1.0
        for _ in range(6):
            seen = self.tracker.see(self.scene, self.errors(self.scene, size))
            left = without(self.tracker.whiten(*self.tracker.difference(seen, faultless)), frames)
            size = min(size * ratio / rms(left), self.largest)
        return size

    def measured(self, folder: Path, scene: Scene | None = None) -> MeasuredCampaign:
        """Write and read the campaign of a scene."""
        scene = scene or self.scene
        rng = np.random.default_rng([self.seed, 3, len(scene)])
        position, quaternion = self.tracker.see(scene, self.errors(scene, self.size))
        position = position + rng.normal(0.0, SIGMA_M, position.shape)
        quaternion = product(from_vector(rng.normal(0.0, SIGMA_RAD, position.shape)), quaternion)
        cells = cells_of(scene, position, to_vector(quaternion), [], rng)
        write_case(folder, Campaign(cells, settings_of(SIGMA_M, SIGMA_RAD), {}))
        return MeasuredCampaign.read(folder / "campaign.csv")

    def with_more(self, suggestions: Sequence[SuggestedMeasurement]) -> Scene:
        """Return the scene followed by the suggested measurements."""
        old = self.scene
        pose = np.array([(*m.pose.translation, pin.log3(m.pose.rotation)[1]) for m in suggestions])
        given = {name: np.array([m.conditions[name] for m in suggestions]) for name in suggestions[0].conditions}
        approach = np.column_stack([given[f"approach_q{k}"] for k in (1, 2, 3, 4)])
        legs, theta = drives_of(pose[:, :3], pose[:, 3])
        leg = np.column_stack([given[f"leg{k}_degC"] for k in (1, 2, 3, 4)])
        new = {
            "position": pose[:, :3],
            "tilt": pose[:, 3],
            "drives": np.column_stack([np.round(legs[:, :3], 8), np.round(theta, 8)]),
            "legs": legs,
            "time_s": old.time_s[-1] + 3600.0 * np.array([m.hours_later for m in suggestions]),
            "session": np.ones(len(pose)),
            "approach": approach,
            "payload_kg": given["payload_kg"],
            "travel_m": given["truss_travel_m"],
            "melt": given["melt_degC"],
            "ambient": given["ambient_degC"],
            "leg_temperature": leg,
            "plate_temperature": given["platform_degC"],
            "thermometers": np.column_stack([leg, given["platform_degC"]]),
        }
        kept: dict[str, Any] = {
            f.name: np.concatenate([getattr(old, f.name), new[f.name]]) for f in fields(Scene) if f.name in new
        }
        return _settled(replace(old, **kept))


def _settled(scene: Scene) -> Scene:
    """Return a scene whose poses and forces agree with its drives and loads."""
    near = (scene.position, scene.tilt)
    poses = close(scene.drives[:, :3], scene.drives[:, 3], Errors.none(len(scene)), near)
    force = (TARE_KG + scene.payload_kg) * GRAVITY
    arm = turn(poses.quaternion, CENTRE_OF_MASS)
    rise = poses.by_drive[:, 2] + arm[:, 1, None] * poses.by_drive[:, 3] - arm[:, 0, None] * poses.by_drive[:, 4]
    return replace(scene, poses=poses, pull=-force[:, None] * rise[:, :3], moment=-force * rise[:, 3])
