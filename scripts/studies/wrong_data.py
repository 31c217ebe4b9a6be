"""How often the checks of a campaign reject sound data, and how often they name a planted mistake.

    python scripts/studies/wrong_data.py --sound 500 --planted 20 --folder ../campaigns

Campaigns are drawn from robots as built (the drawing, the example model, robots with axes off by 0.5 mrad), with and
without rotations, of 40 to 160 rows; those in a folder, each with ``campaign.csv``, are assumed to be sound, too.
Prints a Markdown table; exit code 1 if checks report more than a gross error in sound data.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.progress import track
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import random_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.checks.check import check_campaign
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.drawing import Drawing
from pouring_robot.robot.export.shipped_files import examples_path
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot

Mistake = tuple[str, Callable[[Campaign], Campaign]]
USUAL = {"outlier", "measurement_jump"}
"""Findings about single rows and small steps, which sound data of a crooked robot may give rise to."""


def _positions(factors: Sequence[float]) -> Callable[[Campaign], Campaign]:
    return lambda c: dataclasses.replace(c, position_m=c.position_m * np.array(factors))


def _condition(name: str, change: Callable[[FloatArray], FloatArray]) -> Callable[[Campaign], Campaign]:
    return lambda c: c.with_conditions(**{name: change(np.array(c.conditions[name]))})


def _turns(change: Callable[[FloatArray], FloatArray]) -> Callable[[Campaign], Campaign]:
    def changed(c: Campaign) -> Campaign:
        vectors = c.rotation_vector_rad
        return c if vectors is None else dataclasses.replace(c, rotation_vector_rad=change(np.array(vectors)))

    return changed


def _quieter(c: Campaign) -> Campaign:
    told = c.metadata
    less = {key: getattr(told, key) and getattr(told, key) / 10.0 for key in ("sigma_position_m", "sigma_rotation_rad")}
    return dataclasses.replace(c, metadata=told.model_copy(update=less))


def _rounded(c: Campaign) -> Campaign:
    return dataclasses.replace(c, drives=np.column_stack([np.round(c.drives[:, :3], 3), c.drives[:, 3]]))


def _exchanged(c: Campaign) -> Campaign:
    return c.with_conditions(leg2=c.conditions["ambient"], ambient=c.conditions["leg2"])


MISTAKES: dict[str, Mistake] = {
    "one column in metres": ("position_unit", _positions((1.0, 1e-3, 1.0))),
    "inches": ("position_unit", _positions((1 / 25.4,) * 3)),
    "rotation of the opposite sign": ("rotation_inverted", _turns(lambda v: -v)),
    "Euler angles": ("euler_angles", _turns(lambda v: Rotation.from_rotvec(v).as_euler("xyz"))),
    "truss_travel in mm": ("condition_unit", _condition("truss_travel", lambda v: v * 1e3)),
    "payload in tonnes": ("condition_unit", _condition("payload", lambda v: v / 1e3)),
    "time in minutes": ("condition_unit", _condition("time", lambda v: v / 60.0)),
    "shuffled time": ("time_shuffled", _condition("time", lambda v: np.random.default_rng(0).permutation(v))),
    "hall in °F": ("condition_unit", _condition("ambient", lambda v: v * 1.8 + 32.0)),
    "hall in K": ("condition_unit", _condition("ambient", lambda v: v + 273.15)),
    "one part in °F": ("condition_unit", _condition("leg2", lambda v: v * 1.8 + 32.0)),
    "one part in K": ("condition_unit", _condition("leg2", lambda v: v + 273.15)),
    "part and hall exchanged": ("conditions_exchanged", _exchanged),
    "a thermometer that never moves": ("stuck_column", _condition("leg2", lambda v: np.full(len(v), v.mean()))),
    "every row twice": ("repeated_rows", lambda c: c.subset(np.repeat(np.arange(len(c)), 2))),
    "noise ten times too small": ("noise_too_small", _quieter),
    "drives rounded to 1 mm": ("rounded_drives", _rounded),
}


@functools.cache
def _robots() -> list[PouringRobot]:
    models = [RobotModel(), RobotModel.load(examples_path() / "actual.yaml"), *map(_crooked, range(3))]
    return [PouringRobot(model) for model in models]


def sound(seed: int) -> tuple[Campaign, Drawing]:
    """Return a sound campaign of one of several robots, and what closes its drawing."""
    robot = _robots()[seed % len(_robots())]
    plan = random_plan(robot, 40 + 30 * (seed % 5), 1000 + seed)
    noise = MeasurementOptions(5e-5, None if seed % 3 == 0 else 5e-5, seed=seed)
    return simulate_campaign(robot, plan, noise).campaign, robot.kinematics


def _crooked(seed: int) -> RobotModel:
    random = np.random.default_rng(seed)

    def drawn() -> JointPlacement:
        shift, turn = (tuple(random.normal(size=3).tolist()) for _ in range(2))
        return JointPlacement(translation_mm=shift, rotation_mrad=tuple(0.5 * value for value in turn))

    return RobotModel(joint_placements={f"leg{leg}_s{s}": drawn() for leg in (1, 2, 3, 4) for s in (1, 2, 4, 5)})


def measured(folder: Path) -> Iterator[tuple[Campaign, Drawing]]:
    """Yield the campaigns of a folder."""
    drawing = PouringRobot().kinematics
    for path in sorted(folder.glob("*/campaign.csv")):
        yield Campaign.read(path), drawing


def found(campaign: Campaign, drawing: Drawing) -> set[str]:
    """Return the codes of what is said of a campaign."""
    return {str(flag.code) for flag in check_campaign(campaign, drawing)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sound", type=int, default=50, help="sound campaigns (default 50)")
    parser.add_argument("--planted", type=int, default=5, help="campaigns with each mistake (default 5)")
    parser.add_argument("--folder", type=Path, help="further campaigns that are sound")
    given = parser.parse_args(arguments)
    print("| campaigns | number | said of them |")
    print("|---|---|---|")
    accused = False
    sets = {"drawn": map(sound, range(given.sound)), "given": measured(given.folder) if given.folder else iter(())}
    for name, drawn in sets.items():
        said: Counter[str] = Counter()
        number = 0
        for campaign, drawing in track(drawn, name, total=given.sound, transient=True, disable=not sys.stderr.isatty()):
            said.update(found(campaign, drawing))
            number += 1
        if number:
            accused = accused or bool(said.keys() - USUAL)
            print(
                f"| sound, {name} | {number} | {', '.join(f'{v} × {k}' for k, v in said.items()) or 'nothing'} |",
                flush=True,
            )
    for name, (code, plant) in MISTAKES.items():
        told = number = 0
        others: Counter[str] = Counter()
        for campaign, drawing in map(sound, range(given.planted)):
            if campaign.full_pose or code not in ("rotation_inverted", "euler_angles"):
                codes = found(plant(campaign), drawing)
                told, number = told + (code in codes), number + 1
                others.update(codes - {code})
        also = f"; also {', '.join(f'{v} × {k}' for k, v in others.items())}" if others else ""
        print(f"| {name} | {number} | {told} × {code}{also} |", flush=True)
    return 1 if accused else 0


if __name__ == "__main__":
    sys.exit(main())
