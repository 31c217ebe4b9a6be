"""Possible next measurements: poses within reach, under plausible conditions, as rows beside those of a campaign.

They are measured in three blocks after the campaign, hours apart: the machine cold, hot, and cold again. Within a block
temperatures stand still; load, place of the truss and sides of approach change from pose to pose. The measuring device
may have been set up anew, so that the new rows have frames of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import random_plan
from pouring_robot.diagnosis.descriptions import descriptions
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.problem import Library, problem_at
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.inference.discrepancy import Description
from pouring_robot.inference.explanations import Background, Explanation, Problem
from pouring_robot.io.temperatures import REFERENCE_DEGC
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.robot import PouringRobot

SESSION = "next"
_HOUR_S = 3600.0
_BLOCKS = ((2.0, False), (6.0, True), (10.0, False))
"""Hours after the campaign, and whether the machine is hot."""
_MELT_DEGC, _LEG_RISE_K, _PLATFORM_RISE_K = 1600.0, 100.0, 130.0
_FRAME = 0.02
"""How far the frames of the new rows may be off, in m and rad: further than anybody fails to see."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Possible measurements.

    Attributes:
        poses: n poses of the moving platform.
        drives: (n, drives) in m and rad.
        hot: whether the machine is hot, (n,).
        hours_later: after the last row of the campaign, (n,).
        approach: (n, drives) +1 or -1; None where the campaign does not say it of every drive.
        conditions: (n,) each by quantity name; only those that the campaign has.
    """

    poses: tuple[PlatformPose, ...]
    drives: FloatArray
    hot: NDArray[np.bool_]
    hours_later: FloatArray
    approach: FloatArray | None
    conditions: dict[str, FloatArray]

    def __len__(self) -> int:
        """Return the number of candidates."""
        return len(self.poses)


def candidates(campaign: Campaign, robot: PouringRobot, count: int, seed: int) -> Candidates:
    """Return measurements that could follow a campaign, drawn within limits.

    Args:
        campaign: its conditions are those that can be recorded.
        robot: what can be reached and carried.
        count: how many.
        seed: of the draw.
    """
    plan = random_plan(robot, count, seed)
    random = np.random.default_rng([seed, 7])
    block = np.sort(np.arange(count) % len(_BLOCKS))
    after_h, hot = np.array([_BLOCKS[k][0] for k in block]), np.array([_BLOCKS[k][1] for k in block])
    within = np.arange(count) - np.searchsorted(block, block)
    later = after_h + within / 60.0
    last = 0.0 if campaign.time_s is None else float(np.nanmax(campaign.time_s))
    span = campaign.metadata.truss_span_m or robot.layout.truss_span_m
    loads = np.array([0.0, 0.5, 1.0]) * robot.layout.ladle.payload_kg
    reference = campaign.metadata.reference_temperature_degC
    cold = REFERENCE_DEGC if reference is None else reference
    approach = random.choice([-1.0, 1.0], plan.drives.shape)
    made: dict[str, FloatArray] = {
        "time": last + _HOUR_S * later,
        "payload": random.choice(loads, count),
        "truss_travel": np.round(random.uniform(0.0, span, count), 2),
        "melt": np.where(hot, _MELT_DEGC, cold),
        "ambient": np.full(count, cold),
    }
    for name in (part for part in campaign.robot.thermometers if part not in made):
        made[name] = _warm(campaign.quantity(name), cold, _PLATFORM_RISE_K if name == "platform" else _LEG_RISE_K, hot)
    kept = {name: values for name, values in made.items() if name in campaign.conditions}
    return Candidates(plan.poses, plan.drives, hot, later, approach if _recorded(campaign.approach) else None, kept)


def _recorded(values: FloatArray | None) -> bool:
    """Return whether a campaign says a condition: no column of it is empty."""
    return values is not None and bool(np.isfinite(values.reshape(len(values), -1)).any(axis=0).all())


def _warm(seen: FloatArray | None, cold: float, rise_k: float, hot: NDArray[np.bool_]) -> FloatArray:
    """Return temperatures of a part, (n,): cold, or as hot as it was seen, at least by a plausible rise."""
    highest = cold + rise_k if seen is None else max(float(np.nanmax(seen)), cold + rise_k)
    return np.asarray(np.where(hot, np.round(highest), cold))


class Prospect:
    """Explanations of a campaign, with what they would predict of possible measurements.

    Args:
        diagnosis: of the campaign.
        possible: the measurements.

    Attributes:
        problem: the fitted rows of the campaign and all explanations.
        components: measured of a pose, 3 or 6.
        frames: columns of the new rows' own frames, times their usual size, (n * components, 12).
    """

    def __init__(self, diagnosis: Findings, possible: Candidates) -> None:
        """Linearise the rows of the campaign as its diagnosis left them, and the new ones as drawn."""
        old, self._after = diagnosis.rows, diagnosis.after
        rows = CampaignRows(_together(old.campaign, possible, diagnosis), diagnosis.model, diagnosis.noise)
        changes = old.changes(self._after.parameters, self._after.values)
        self._rows, self._linear = rows, rows.linearise(changes.and_unchanged(len(possible)), self._after.frames)
        new = self._linear.row >= len(old)
        self._old = np.append(diagnosis.fitted, np.zeros(len(possible), dtype=bool))[self._linear.row]
        self._new = np.asarray(new, dtype=np.bool_)
        self.components = int(new.sum()) // len(possible)
        known = diagnosis.diagnoser.library
        library = Library.of(rows, {name: known.effects[name] for name in known.effects if name in known.tried})
        self._whole = problem_at(rows, self._linear, library, np.zeros(self._linear.residual.size))
        self.problem = Problem.build(
            diagnosis.hypothesis.problem.residual,
            self._linear.free[self._old],
            [replace(b, columns=b.columns[self._old]) for b in self._whole.backgrounds],
            [replace(e, columns=e.columns[self._old]) for e in self._whole.explanations],
        )
        self._described: dict[str, Description] = {}
        self.frames = _FRAME * self._linear.free[self._new]

    def explanation(self, name: str) -> Explanation | None:
        """Return a description as an explanation of the campaign's rows; None where there is none of that name."""
        if not self._described:
            self._described = {d.name: d for d in descriptions(self._rows, self._linear)}
        found = self._described.get(name)
        if found is None:
            return None
        columns = self.problem.nuisance.cleared(found.columns[self._old])
        return Explanation(name, "description", columns, np.ones(columns.shape[1], dtype=bool), cause=False)

    def new_columns(self, item: Explanation | Background, index: int = -1) -> FloatArray:
        """Return the columns of an explanation, or of the background of an index, in the new rows."""
        if isinstance(item, Background):
            return self._whole.backgrounds[index].columns[self._new]
        if item.form == "description" and item.effect in self._described:
            return self._described[item.effect].columns[self._new]
        return next(e.columns for e in self._whole.explanations if e.key == item.key)[self._new]


def _together(campaign: Campaign, possible: Candidates, diagnosis: Findings) -> Campaign:
    """Return a campaign with the possible measurements behind its rows, as the drawing predicts them."""
    n, frames = len(possible), diagnosis.after.frames
    outer, inner = frames.T_tracker_base, frames.T_end_target
    seen = [outer * pose.to_se3() * inner for pose in possible.poses]
    arrays: dict[str, Any] = {
        "drives": possible.drives,
        "approach": possible.approach,
        "position_m": np.array([pose.translation for pose in seen]),
        "rotation_vector_rad": Rotation.from_matrix([pose.rotation for pose in seen]).as_rotvec(),
    }
    empty = np.full(n, np.nan)
    joined: dict[str, Any] = {
        name: np.concatenate([values, np.tile(empty[:, None], values.shape[1]) if added is None else added])
        for name, added in arrays.items()
        if (values := getattr(campaign, name)) is not None
    }
    joined["conditions"] = {
        name: np.append(values, possible.conditions.get(name, empty)) for name, values in campaign.conditions.items()
    }
    return replace(
        campaign,
        lines=np.append(campaign.lines, int(campaign.lines.max()) + 1 + np.arange(n)),
        samples=(*campaign.samples, *(f"next_{k + 1}" for k in range(n))),
        sessions=(*campaign.sessions, *((SESSION,) * n)),
        **joined,
    )
