"""Do 95 % intervals hold where the model lacks an effect? Many campaigns of one machine, each fitted without it.

    python scripts/studies/missing_effect.py --robot examples/robots/arm/robot.yaml --campaigns 100

An effect is added to the drives of a robot with errors drawn from its tolerances, and every campaign is fitted with
geometry alone. The reference is the fit to very many rows generated in the same way, as no model without the effect
contains the truth. Reported is how often intervals for the target's position, all over the workspace, contain it: those
from a noise as large as the residuals, and those that calibration states.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pouring_robot.calibration.metrics import workspace_rows
from pouring_robot.campaign.plan import random_plan
from pouring_robot.estimation.changes import RowChanges
from pouring_robot.estimation.frames.outer import FRAMES, OuterFrames
from pouring_robot.estimation.intervals import Z95, largest_std
from pouring_robot.estimation.map_fit import Fit, FitOptions, identify
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.estimation.splits import BLOCKS
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import rotation_matrices
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue, all_parameters
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.tolerances import Tolerances

_SIGMA = 5e-5  # m and rad
_FRAMES = OuterFrames(
    pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.8])), np.array([2.0, 0.5, 0.3])),
    pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.1])), np.array([0.1, 0.05, 0.15])),
)
_MANY = 25  # campaigns in the fit that the others are compared with
_CORNER = 8  # rows from one corner of a path to the next


def _by_pose(drives: FloatArray, random: np.random.Generator) -> FloatArray:
    """Each drive errs with its own value, one and a half waves over its travel; the same in each campaign."""
    return np.asarray(np.sin(9.0 * drives / np.ptp(drives, axis=0)))


def _by_time(drives: FloatArray, random: np.random.Generator) -> FloatArray:
    """Zeros of the drives wander and come back within an eighth of a campaign; otherwise in each."""
    keep = np.exp(-8.0 / len(drives))
    off = random.normal(size=drives.shape)
    for k in range(1, len(off)):
        off[k] = keep * off[k - 1] + np.sqrt(1.0 - keep**2) * off[k]
    return off


def _by_side(drives: FloatArray, random: np.random.Generator) -> FloatArray:
    """Free play: each drive stands on the side that it came from."""
    return np.sign(np.diff(drives, axis=0, prepend=drives[:1]))


def _by_chance(drives: FloatArray, random: np.random.Generator) -> FloatArray:
    """Each drive stands elsewhere in every row: a larger noise."""
    return random.normal(size=drives.shape)


Effect = Callable[[FloatArray, np.random.Generator], FloatArray]
_EFFECTS: dict[str, Effect] = {"pose": _by_pose, "time": _by_time, "side": _by_side, "chance": _by_chance}


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot with errors, as its campaigns are drawn from it."""

    robot: Robot
    model: MeasurementModel
    truth: FloatArray  # parameter values, (P,)
    effect: Effect
    size: float  # of the effect, in m or rad a drive
    path: bool  # whether poses follow a path; otherwise each is drawn anew

    def drives(self, count: int, random: np.random.Generator) -> FloatArray:
        """Return commanded drives, (count, D)."""
        corners = random_plan(self.robot, count // _CORNER + 2 if self.path else count, int(random.integers(2**31)))
        if not self.path:
            return corners.drives
        along = np.arange(count) / _CORNER
        steps = np.arange(len(corners))
        return np.column_stack([np.interp(along, steps, own) for own in corners.drives.T])

    def campaign(self, count: int, random: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return drives, positions and rotations that were measured; rows that do not close are left out."""
        drives = self.drives(count, random)
        rows, unknowns = self.model.at(drives), Unknowns.zero(_FRAMES, len(self.truth))
        nothing = RowChanges.of({}, self.model.engine.structure, count)
        changed = rows.with_changes(replace(nothing, drives=self.size * self.effect(drives, random)))
        seen = changed.predict(unknowns.at(np.r_[unknowns.values[:FRAMES], self.truth]))
        noise = _SIGMA * random.normal(size=(2, count, 3))
        turned = rotation_matrices(noise[1]) @ seen.rotation
        return drives[seen.closed], (seen.position_m + noise[0])[seen.closed], turned[seen.closed]

    def fit(self, drives: FloatArray, position: FloatArray, rotation: FloatArray) -> Fit:
        """Fit geometry."""
        measured, prior = MeasuredPoses(position, rotation, _SIGMA, _SIGMA), self._prior
        start = Unknowns.zero(_FRAMES, len(self.truth))
        fit = identify(self.model.at(drives), measured, start, prior, FitOptions(max_evaluations=400))
        return replace(fit, stretches=tuple(np.array_split(np.arange(len(drives)), BLOCKS)))

    @property
    def _prior(self) -> FloatArray:
        return self.model.prior_std(Tolerances.of(self.robot.model.definition))


def coverage(machine: Machine, workspace: ModelledRows, rows: int, campaigns: int, seed: int) -> tuple[float, ...]:
    """Return how often both intervals hold, how wide they are (median, m), and how many times the noise is left."""
    random = np.random.default_rng(seed)
    every = zip(*(machine.campaign(rows, random) for _ in range(_MANY)), strict=True)
    nearest = workspace.predict(machine.fit(*(np.concatenate(part) for part in every)).unknowns).position_m
    found = []
    for _ in range(campaigns):
        fit = machine.fit(*machine.campaign(rows, random))
        seen = workspace.linearise(fit.unknowns)
        wrong = np.abs(seen.position_m - nearest)
        widths = [Z95 * largest_std(seen.derivatives[:, :3], some) for some in (fit.covariances[:1], fit.covariances)]
        held = [float(np.mean((wrong <= width)[seen.closed])) for width in widths]
        found.append([*held, *(float(np.nanmedian(width)) for width in widths), fit.inflation])
    return tuple(np.mean(found, axis=0).tolist())


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each effect and order of poses; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", help="robot file; by default the pouring robot")
    parser.add_argument("--campaigns", type=int, default=100)
    parser.add_argument("--rows", type=int, default=120, help="poses of each campaign")
    parser.add_argument("--size", type=float, default=0.3, help="of the effect, mm or mrad a drive")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    robot = Robot.load(given.robot) if given.robot else Robot(RobotModel())
    definition = robot.model.definition
    groups = ParameterCatalogue(definition).groups(("geometry",))
    model = MeasurementModel(robot.model, all_parameters(groups))
    spread = Tolerances.of(definition).std(model.parameters, definition)
    truth = spread * np.random.default_rng(given.seed).normal(size=len(spread))
    print("effect by  poses   times noise  held as noise, %  mm      held as told, %  mm")
    for name, effect in _EFFECTS.items():
        for path in (False, True):
            machine = Machine(robot, model, truth, effect, 1e-3 * given.size, path)
            before, told, narrow, wide, left = coverage(
                machine, workspace_rows(model), given.rows, given.campaigns, given.seed
            )
            print(
                f"{name:9s}  {'path' if path else 'drawn':6s}  {left:11.1f}  {100 * before:16.1f}  {1e3 * narrow:.3f}"
                f"  {100 * told:15.1f}  {1e3 * wide:.3f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
