"""How much a plan is worth: the same number of poses drawn at random, for the same parameters and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign.plan import random_plan
from pouring_robot.design.columns import Conditions
from pouring_robot.design.planning import MeasurementPlan, Planner
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD


@dataclass(frozen=True, eq=False)
class Comparison:
    """Expected standard deviations of the ladle by a plan and by random ones, root mean square over the workspace.

    Attributes:
        planned_m: place of the ladle by the plan, in m; ``random_m``: by each random plan, shape (k,).
        planned_rad: its attitude, in rad; ``random_rad``: by each random plan, shape (k,).
        planned_worst_m: place at the worst pose of the workspace, in m; ``random_worst_m``: by each, shape (k,).
    """

    planned_m: float
    random_m: FloatArray
    planned_rad: float
    random_rad: FloatArray
    planned_worst_m: float
    random_worst_m: FloatArray

    @property
    def ratio(self) -> float:
        """The plan's standard deviation of the ladle's place over the median random plan's."""
        return self.planned_m / float(np.median(self.random_m))

    @property
    def ratio_rad(self) -> float:
        """The same of its attitude."""
        return self.planned_rad / float(np.median(self.random_rad))

    @property
    def ratio_worst(self) -> float:
        """The same of its place at the worst pose."""
        return self.planned_worst_m / float(np.median(self.random_worst_m))

    def figures(self) -> dict[str, float]:
        """Return the figures for JSON, mm and mrad."""
        return {
            "count": len(self.random_m),
            "median_rms_mm": float(np.median(self.random_m)) / MM,
            "median_rms_mrad": float(np.median(self.random_rad)) / MRAD,
            "ratio_mm": self.ratio,
            "ratio_mrad": self.ratio_rad,
        }


def compare_with_random(planner: Planner, plan: MeasurementPlan, count: int = 50, seed: int = 0) -> Comparison:
    """Compare a plan with random ones of as many poses, spread evenly over the workspace box.

    Loads and temperatures are drawn too, evenly from those that the plan may choose; as many poses are visited from
    both sides.

    Args:
        planner: that made the plan.
        plan: the plan.
        count: number of random plans.
        seed: of the first; the others follow.

    Raises:
        BadInputError: the count is not positive.
        UndeterminedError: a random plan does not determine the parameters.
    """
    if count < 1:
        raise BadInputError(f"compare with at least one random plan, not {count}")
    found = []
    for k in range(count):
        poses, conditions = random_visits(planner, seed + k)
        quality = planner.quality(poses, conditions)
        found.append((quality.ladle_rms_m, quality.ladle_rms_rad, quality.ladle_worst_m))
    places, turns, worst = np.array(found).T
    own = plan.quality
    return Comparison(own.ladle_rms_m, places, own.ladle_rms_rad, turns, own.ladle_worst_m, worst)


def random_visits(planner: Planner, seed: int) -> tuple[FloatArray, list[Conditions]]:
    """Return rows of a random plan like the one asked for: poses (rows, 4) in m and rad, and their conditions."""
    request = planner.request
    drawn = random_plan(planner.robot, request.poses, seed)
    random = np.random.default_rng([seed, 4])
    both = set(random.choice(request.poses, request.both_sides, replace=False).tolist())
    poses, conditions = [], []
    for k, pose in enumerate(drawn.poses):
        state = planner.states[int(random.integers(len(planner.states)))]
        for side in (1, -1) if k in both else (1,):
            poses.append((*pose.position_m, pose.tilt_rad))
            conditions.append(Conditions(side, state.payload_kg, state.leg_degC))
    return np.array(poses), conditions
