"""Tables of joint values of closed poses, for other programs: a row per pose, joint names of the exported tree, SI."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from pouring_robot.batch.records import BatchClosure
from pouring_robot.batch.structure import Structure
from pouring_robot.io.figures import json_text
from pouring_robot.io.tables import csv_text
from pouring_robot.mechanism.closure.solver import ClosureResult
from pouring_robot.robot.model import RobotModel


@dataclass(frozen=True)
class JointRow:
    """The joints of the robot as built at one command."""

    values: Mapping[str, float]  # by joint, in m or rad; a drive has its command, as in the exported tree
    units: Mapping[str, str]  # ``m`` or ``rad``, by joint
    gap_m: float  # largest distance left open in a loop, in m; ``gap_rad``: largest angle, in rad
    gap_rad: float

    @classmethod
    def of(
        cls,
        closed: ClosureResult,
        offsets: Mapping[str, float] = MappingProxyType({}),
        commanded: Mapping[str, float] = MappingProxyType({}),
    ) -> Self:
        """Take them from a closure; the exported tree contains the drives' ``offsets``, which are subtracted here.

        A closure does not count whole turns of joints without limits; drives get the turns of ``commanded``.
        """
        mechanism = closed.mechanism
        beyond, known = mechanism.with_followers(offsets), {**commanded, **mechanism.follower_values(commanded)}
        values = {name: value - beyond.get(name, 0.0) for name, value in closed.joint_values.items()}
        for name in known.keys() & mechanism.endless:
            values[name] += math.tau * round((known[name] - values[name]) / math.tau)
        units = {name: mechanism.unit_of(name) for name in values}
        return cls(values, units, closed.gap_m, closed.gap_rad)

    @classmethod
    def of_many(cls, structure: Structure, closed: BatchClosure, model: RobotModel) -> list[Self]:
        """Take them from an engine's closures, minus the model's drive offsets; NaN for poses without a solution."""
        mechanism = structure.mechanism
        beyond = mechanism.with_followers(model.drive_offset_values())
        columns = dict.fromkeys(mechanism.loops.locked_joints, np.zeros(len(closed)))
        columns |= structure.joint_values(closed.joints)
        columns = {name: values - beyond.get(name, 0.0) for name, values in columns.items()}
        units = {name: mechanism.unit_of(name) for name in columns}
        gaps = [np.linalg.norm(part, axis=2).max(axis=1) for part in np.split(closed.residual, 2, axis=2)]
        rows = zip(np.transpose(list(columns.values())).tolist(), *(gap.tolist() for gap in gaps), strict=True)
        return [cls(dict(zip(columns, row, strict=True)), units, gap, turn) for row, gap, turn in rows]


def joints_json(rows: Sequence[JointRow]) -> dict[str, Any]:
    """Return the table, ready for JSON."""
    poses = [
        {"joints": dict(row.values), "left_open_m": row.gap_m, "left_open_rad": row.gap_rad}
        if math.isfinite(row.gap_m)
        else {"joints": None}
        for row in rows
    ]
    return {"units": dict(rows[0].units) if rows else {}, "poses": poses}


def joints_text(rows: Sequence[JointRow], path: Path) -> str:
    """Return the table as JSON if the file's suffix says so, otherwise as CSV with units in the headings."""
    if path.suffix.lower() == ".json":
        return json_text(joints_json(rows))
    heads = [f"{name}_{unit}" for name, unit in rows[0].units.items()] if rows else []
    values = ([*map(float, row.values.values()), row.gap_m, row.gap_rad] for row in rows)
    return csv_text([*heads, "left_open_m", "left_open_rad"], values)
