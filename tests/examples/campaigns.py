"""Write virtual campaigns: ``python -m tests.examples.campaigns ROBOT --seed S --effect E OUT``.

For all robots or effects, or several of each, every one has a separate folder in OUT.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tests.examples.effects import EFFECTS, LARGEST, REFERENCE_DEGC, Hidden, Scene, effects_of, id_of
from tests.examples.five_bar import Array
from tests.examples.machines import MACHINES, SCREW_PITCH, Machine

NULL, EVERY = "null", "all"
ROBOTS = Path(__file__).resolve().parents[2] / "examples" / "robots"
RATIOS = (2.0, 12.0)
"""How many times the noise an effect shows, once the free frames are taken out."""


@dataclass(frozen=True)
class Tracker:
    """The instrument, where it stands and how well it sees.

    Attributes:
        T_tracker_base: position (m) and rotation of the robot in its frame.
        T_end_target: likewise of the target on the measured body.
        sigma: noise of a coordinate (m) and of a component of the rotation vector (rad).
    """

    T_tracker_base: tuple[Array, Rotation]
    T_end_target: tuple[Array, Rotation]
    sigma: tuple[float, float]

    def see(self, machine: Machine, scene: Scene, hidden: Hidden) -> tuple[Array, Rotation]:
        """Return places (n, 3) and rotations of the target in the tracker's frame, without noise."""
        position, rotation = machine.forward(scene.drives + hidden.drive, **hidden.geometry)
        moved = np.zeros((len(position), 6)) + hidden.base
        on_base, mounted = Rotation.from_rotvec(moved[:, 3:]), self.T_end_target
        turns = on_base * Rotation.from_matrix(rotation)
        place = moved[:, :3] + on_base.apply(position) + turns.apply(mounted[0])
        stand = self.T_tracker_base
        return (1.0 + hidden.scale) * (stand[0] + stand[1].apply(place)), stand[1] * turns * mounted[1]

    def beyond_frames(self, seen: tuple[Array, Rotation], plain: tuple[Array, Rotation]) -> tuple[float, float]:
        """Return by how much two sights differ, RMS: in noise, with the best frames; in m a coordinate, as they are."""
        shift, turn = seen[0] - plain[0], (seen[1] * plain[1].inv()).as_rotvec()
        rows, axes = len(shift), plain[1].as_matrix()
        columns = np.zeros(
            (rows, 2, 3, 12)
        )  # of the robot's place (as a twist in the tracker's frame), of the target's
        columns[:, 0, :, :3] = np.eye(3)
        columns[:, 0, :, 3:6] = -_cross(plain[0] - plain[0].mean(axis=0))
        columns[:, 1, :, 3:6] = np.eye(3)
        columns[:, 0, :, 6:9] = columns[:, 1, :, 9:] = axes
        weights = 1.0 / np.array(self.sigma)
        wanted = (np.stack([shift, turn], axis=1) * weights[:, None]).ravel()
        frames = (columns * weights[:, None, None]).reshape(-1, 12)
        left = wanted - frames @ np.linalg.lstsq(frames, wanted, rcond=1e-10)[0]
        return float(np.sqrt(np.mean(left**2))), float(np.sqrt(np.mean(shift**2)))


def _cross(vectors: Array) -> Array:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def plan(machine: Machine, random: np.random.Generator, sessions: int) -> Scene:
    """Return a scene: random poses, both sides approached, one day or more, parts that warm up and cool down."""
    rows = int(random.integers(110, 170))
    session = 1 + (np.arange(rows) * sessions) // rows
    time = np.cumsum(random.uniform(40.0, 90.0, size=rows)) + (session - 1) * 72_000.0
    hours = time / 3600.0
    ambient = random.uniform(19.0, 24.0) + 1.5 * np.sin(2.0 * np.pi * hours / 24.0 + random.uniform(0.0, 6.0))
    waves = [np.sin(2.0 * np.pi * hours / random.uniform(0.7, 2.5) + random.uniform(0.0, 6.0)) for _ in machine.links]
    warmth = ambient[:, None] + random.uniform(5.0, 15.0, size=len(waves)) * (1.2 + np.stack(waves, axis=1))
    digits = 8 if machine.unit == "m" else 9
    return Scene(
        drives=np.round(machine.targets(random, rows), digits),
        approach=random.choice([-1.0, 1.0], size=(rows, len(machine.columns))),
        session=session.astype(float),
        time=time,
        ambient=ambient,
        warmth=warmth,
        payload=random.choice(machine.payloads or (0.0,), size=rows),
    )


def stand(random: np.random.Generator) -> Tracker:
    """Return a tracker somewhere in the hall, and a target in any attitude a hand's breadth off."""
    base = random.uniform(-4.0, 4.0, size=3), Rotation.random(random_state=random)
    target = random.uniform(-0.15, 0.15, size=3), Rotation.random(random_state=random)
    sigma = float(random.choice([2e-5, 5e-5, 1e-4]))
    return Tracker(base, target, (sigma, float(random.choice([3e-5, 6e-5, 1e-4]))))


def sized(
    hidden: Hidden, ratio: float, largest: float, machine: Machine, scene: Scene, tracker: Tracker
) -> tuple[Hidden, dict[str, Any]]:
    """Return an effect that shows as much above the noise as wanted, at most the largest, and the truth of it."""
    plain, size = tracker.see(machine, scene, Hidden()), 1e-5
    for _ in range(3):  # nearly linear
        shown, _ = tracker.beyond_frames(tracker.see(machine, scene, hidden.times(size)), plain)
        size = min(largest, size * ratio / shown)
    shown, moved = tracker.beyond_frames(tracker.see(machine, scene, hidden.times(size)), plain)
    return hidden.times(size), {
        "size": size,
        "ratio_to_noise": shown,
        "rms_mm": 1e3 * moved,
        "parameters": hidden.times(size).told,
    }


def write(folder: Path, machine: Machine, seed: int, effect: str = NULL, ratio: float | None = None) -> dict[str, Any]:
    """Write ``campaign.csv``, ``campaign.yaml`` and ``truth.json`` into a folder and return the truth.

    Args:
        folder: made if it is not there.
        machine: what is measured.
        seed: all that is drawn follows from it.
        effect: what to hide; ``null`` for nothing.
        ratio: how many times the noise it shows; drawn if not given.
    """
    random = np.random.default_rng([seed, sum(map(ord, machine.name + effect))])
    sessions = int(random.choice([2, 3] if effect == "session_offset" else [1, 1, 2]))
    scene, tracker = plan(machine, random, sessions), stand(random)
    drawn = float(np.exp(random.uniform(*np.log(RATIOS))))
    hidden, effects = Hidden(), []
    if effect != NULL:
        unit = EFFECTS[effect](machine, scene, random)
        hidden, told = sized(unit, ratio or drawn, LARGEST[effect], machine, scene, tracker)
        effects.append({"effect": id_of(effect, machine), **told})
    position, rotation = tracker.see(machine, scene, hidden)
    position = position + random.normal(0.0, tracker.sigma[0], size=position.shape)
    rotation = Rotation.from_rotvec(random.normal(0.0, tracker.sigma[1], size=position.shape)) * rotation
    folder.mkdir(parents=True, exist_ok=True)
    robot = os.path.relpath(ROBOTS / machine.name / "robot.yaml", folder)
    truth = {"robot_file": robot, "kind": "single" if effects else NULL, "effects": effects, "seed": seed}
    with (folder / "campaign.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(_table(machine, scene, position, rotation.as_rotvec()))
    settings = yaml.safe_dump(_settings(machine, tracker), sort_keys=False)
    (folder / "campaign.yaml").write_text(settings, encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return truth


def _table(machine: Machine, scene: Scene, position: Array, vector: Array) -> list[list[str]]:
    unit, factor, digits = ("mm", 1e3, 5) if machine.unit == "m" else ("rad", 1.0, 9)
    parts: list[tuple[list[str], Array, int]] = [
        (["session"], scene.session[:, None], 0),
        (["time_s"], scene.time[:, None], 1),
        ([f"{column}_{unit}" for column in machine.columns], factor * scene.drives, digits),
        ([f"approach_{column}" for column in machine.columns], scene.approach, 0),
        (["payload_kg"] if machine.payloads else [], scene.payload[:, None][:, : bool(machine.payloads)], 1),
        (["ambient_degC"], scene.ambient[:, None], 2),
        ([f"{link}_degC" for link in machine.links], scene.warmth, 2),
        (["x_mm", "y_mm", "z_mm"], 1e3 * position, 5),
        (["rx_rad", "ry_rad", "rz_rad"], vector, 9),
    ]
    head = ["sample", *(name for names, _, _ in parts for name in names)]
    rows = [
        [str(k), *(f"{value:.{digits}f}" for _, values, digits in parts for value in values[k])]
        for k in range(len(position))
    ]
    return [head, *rows]


def _settings(machine: Machine, tracker: Tracker) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "robot": machine.name,
        "description": f"static poses of the {machine.end} seen by a laser tracker",
        "metrology": {
            "target": machine.end,
            "frame": "tracker",
            "sigma_position_mm": 1e3 * tracker.sigma[0],
            "sigma_rotation_rad": tracker.sigma[1],
        },
        "reference_temperature_degC": REFERENCE_DEGC,
    }
    if machine.unit == "m":
        settings["drives"] = {"screw_pitch_mm": 1e3 * SCREW_PITCH}
    return settings


def main(argv: list[str] | None = None) -> None:
    """Write the campaigns that the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m tests.examples.campaigns", description="Write virtual campaigns.")
    parser.add_argument("robot", choices=[*MACHINES, EVERY])
    parser.add_argument("--seed", type=int, default=0, help="all that is drawn follows from it (0)")
    parser.add_argument("--trials", type=int, default=1, help="campaigns of each, from this seed on (1)")
    parser.add_argument("--effect", choices=[NULL, *EFFECTS, EVERY], default=NULL, help="what to hide (null: nothing)")
    parser.add_argument("--ratio", type=float, help="how many times the noise it shows (drawn)")
    parser.add_argument("out", type=Path, help="folder for campaign.csv, campaign.yaml and truth.json, or for theirs")
    options = parser.parse_args(argv)
    machines = MACHINES.values() if options.robot == EVERY else [MACHINES[options.robot]]
    every = [
        (machine, effect, options.seed + k)
        for machine in machines
        for effect in (NULL, *effects_of(machine))
        for k in range(options.trials)
        if options.effect in (effect, EVERY)
    ]
    if not every:
        parser.error(f"{options.robot} has no {options.effect}")
    for machine, effect, seed in every:
        folder = options.out / f"{machine.name}_{effect}_{seed}" if len(every) > 1 else options.out
        truth = write(folder, machine, seed, effect, options.ratio)
        shows = [f"{e['effect']} {e['ratio_to_noise']:.1f} times the noise" for e in truth["effects"]]
        print(f"{folder}: {', '.join(shows) or 'nothing hidden'}")


if __name__ == "__main__":
    main()
