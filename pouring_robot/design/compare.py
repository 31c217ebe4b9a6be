"""How much a plan is worth: the same number of poses drawn at random, for the same parameters and noise."""

from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign.plan import random_plan
from pouring_robot.design.columns import Conditions
from pouring_robot.design.planning import Planner
from pouring_robot.design.result import MeasurementPlan
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD


@dataclass(frozen=True, eq=False)
class Comparison:
    """Expected standard deviations of the ladle by a plan, (3,), and by each of k random ones, (k, 3).

    Of its place and of its attitude, root mean square over the workspace, in m and rad, and of its place at the worst
    pose of the workspace, in m.
    """

    planned: FloatArray
    random: FloatArray

    @property
    def median(self) -> FloatArray:
        """Those of the median random plan, shape (3,)."""
        return np.asarray(np.median(self.random, axis=0))

    @property
    def ratios(self) -> FloatArray:
        """The plan's over the median random plan's, shape (3,)."""
        return np.asarray(self.planned / self.median)

    def figures(self) -> dict[str, float]:
        """Return the figures for JSON, mm and mrad."""
        return {
            "count": len(self.random),
            "median_rms_mm": float(self.median[0]) / MM,
            "median_rms_mrad": float(self.median[1]) / MRAD,
            "ratio_mm": float(self.ratios[0]),
            "ratio_mrad": float(self.ratios[1]),
        }


def compare_with_random(planner: Planner, plan: MeasurementPlan, count: int = 50, seed: int = 0) -> Comparison:
    """Compare a plan with random ones of as many poses, spread evenly over the workspace box.

    Loads and temperatures are drawn too, evenly from those that the plan may choose; as many poses are visited from
    both sides. ``seed`` is that of the first; the others follow.

    Raises:
        BadInputError: the count is not positive.
        UndeterminedError: a random plan does not determine the parameters.
    """
    if count < 1:
        raise BadInputError(f"compare with at least one random plan, not {count}")
    qualities = [plan.quality, *(planner.quality(*random_visits(planner, seed + k)) for k in range(count))]
    figures = np.array([(q.ladle_rms_m, q.ladle_rms_rad, q.ladle_worst_m) for q in qualities])
    return Comparison(figures[0], figures[1:])


def random_visits(planner: Planner, seed: int) -> tuple[FloatArray, list[Conditions]]:
    """Return rows of a random plan like the one asked for: commands (rows, k) in m and rad, and their conditions."""
    request = planner.request
    drawn = random_plan(planner.robot, request.poses, seed)
    random = np.random.default_rng([seed, 4])
    both = set(random.choice(request.poses, request.both_sides, replace=False).tolist())
    poses, conditions = [], []
    for k, pose in enumerate(drawn.rows):
        state = planner.states[int(random.integers(len(planner.states)))]
        for side in (1, -1) if k in both else (1,):
            poses.append(pose)
            conditions.append(Conditions(side, state.payload_kg, state.leg_degC))
    return np.array(poses), conditions
