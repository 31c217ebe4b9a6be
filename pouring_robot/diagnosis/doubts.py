"""Why an answer is unknown whatever explains best, in words: doubts about noise, linearisation or single rows."""

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import FEW_ROWS, where
from pouring_robot.diagnosis.diagnoser import LinearState
from pouring_robot.diagnosis.rows import CampaignRows, LinearRows
from pouring_robot.diagnosis.search_and_noise import Searched
from pouring_robot.estimation.kinds import unit_of
from pouring_robot.estimation.noise import largest_noise
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.problem import Nuisance
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.mechanism.arrays import rms
from pouring_robot.robot.tolerances import Tolerances

FEWEST_ROWS = 8
"""Fewer usable rows are not diagnosed."""


def few_without_wrong_rows(campaign: Campaign, found: Searched) -> str:
    """Return which rows may be wrong, in words, if too few would remain without them; "" if there are none."""
    rows = found.asked.inliers.size
    wrong = found.gross_errors if rows < FEW_ROWS else found.asked.inliers[:0]
    if not wrong.size or rows - wrong.size >= FEWEST_ROWS:
        return ""
    return f"{where(campaign, wrong)} may be wrong, and too few rows remain without them; measure there again"


def beyond_linearisation(after: LinearState, hypothesis: Hypothesis, thresholds: Thresholds) -> str:
    """Return that causes, put into the robot, do not do what they were found for, in words; "" where they do.

    They are then too large to be linearised: the point where the search gave up, and no causes at work.
    """
    unnamed = [hypothesis.part(k) for k in hypothesis.unnamed]
    left = hypothesis.problem.nuisance.cleared(after.linear.residual)
    predicted = hypothesis.remainder + sum(unnamed, np.zeros(left.size))
    if len(unnamed) == len(hypothesis.items) or rms(left - predicted) < thresholds.structure_size:
        return ""
    sizes = f"{rms(left):.1f} times the noise instead of the predicted {rms(predicted):.1f}"
    return (
        f"put into the robot, with exactly closed loops, what was found leaves {sizes}: it is too large to be credible"
    )


def noise_too_large(rows: CampaignRows, linear: LinearRows) -> str:
    """Return which noise estimated from the residuals is too large to be noise, in words; "" where none is."""
    robot, parameters, frames = rows.model.definition, rows.measurement.parameters, Nuisance.of(linear.free)
    noise = rows.noise
    sizes = zip(parameters, Tolerances.of(robot).std(parameters, robot), strict=True)
    tolerated = (frames.cleared(size * rows.channel(one.name, linear)) for one, size in sizes)
    limits = largest_noise(noise, linear.component, tolerated) if noise.from_residuals else {}
    words = [
        f"{noise[kind].sigma / si:.3g} {unit} RMS per {'coordinate' if kind == 'position' else kind}, where all errors "
        f"within the tolerances make {limit / si:.3g} {unit}"
        for kind, limit in limits.items()
        for unit, si in [unit_of(kind)]
        if noise[kind].sigma > limit
    ]
    return f"the residuals are too large for noise: {'; '.join(words)}" if words else ""
