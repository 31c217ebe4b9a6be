"""Possible next measurements: poses within reach, under plausible conditions, as rows added to those of a campaign.

They are in three blocks after the campaign, hours apart: the machine cold, hot, and cold again. Within a block
temperatures are constant; load, travels and sides of approach change from pose to pose. The measuring device may have
been set up anew, so that the new rows have frames of their own.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from pouring_robot.batch import BatchStart
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import random_plan
from pouring_robot.diagnosis.discrepancy_processes import processes_of
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.library import Library, known_effects, workmanship_of
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.estimation.frames.sessions import by_size
from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.gaussian_processes.processes import Part, columns_of
from pouring_robot.inference.problem import Explanation, Nuisance, Problem, Workmanship
from pouring_robot.io.seeds import Stream, generator
from pouring_robot.io.temperatures import reference_degC
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.mechanism.rotations import rotation_vectors, tilts_alone
from pouring_robot.robot.description.cause_types import Thermometers
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot, robot_of

SESSION = "next"
_HOUR_S = 3600.0
_BLOCKS = ((2.0, False), (6.0, True), (10.0, False))  # hours after the campaign, and whether the machine is hot
_TRIES = 4
_ROUND_OFF = 1e-8
_FRAME = 0.02  # prior standard deviation of the new rows' frames, in m and rad: a larger error would be noticed


def in_mm_deg(pose: pin.SE3) -> dict[str, float]:
    """Return a pose's position in mm and rotation in degrees by name: the tilt if it is about y alone, or a vector."""
    turn = np.degrees(pin.log3(pose.rotation)).tolist()
    turns = dict(zip(("rx_deg", "ry_deg", "rz_deg"), turn, strict=True))
    if tilts_alone(pose.rotation) is not None:
        turns = {"tilt_deg": turn[1]}
    return dict(zip(("x_mm", "y_mm", "z_mm"), (pose.translation / MM).tolist(), strict=True)) | turns


@dataclass(frozen=True, eq=False)
class Candidates:
    """Possible measurements."""

    poses: tuple[pin.SE3, ...]  # n poses of the end body in the base
    drives: FloatArray  # (n, drives) in m and rad
    hours_later: FloatArray  # after the last row of the campaign, (n,)
    # (n, drives) +1 or -1, NaN for drives of which the campaign does not record it; None where it records none
    approach: FloatArray | None
    conditions: dict[str, FloatArray]  # (n,) each by quantity name; only those that the campaign has

    def __len__(self) -> int:
        return len(self.poses)


Reach = tuple[tuple[pin.SE3, ...], FloatArray, float, dict[str, tuple[float, float]]]
"""Poses of the end body, their drives (count, drives), largest payload in kg, least and largest travels in m."""


def _reach(campaign: Campaign, model: RobotModel, count: int, seed: int) -> Reach:
    """Return what can be measured: the pouring robot's workspace, or the range of the campaign for any other robot."""
    robot = robot_of(model)
    if isinstance(robot, PouringRobot):
        plan = random_plan(robot, count, seed)
        span = campaign.metadata.truss_span_m or robot.layout.truss.span.metres
        travels = dict.fromkeys(campaign.robot.travels, (0.0, span))
        poses = tuple(pose.to_se3() for pose in plan.poses if isinstance(pose, PlatformPose))
        return poses, plan.drives, robot.layout.ladle.payload.value, travels
    drives, start = _between(campaign, model, count, seed)
    given = campaign.conditions
    recorded = {name: given[name] for name in campaign.robot.travels if name in given}
    travels = {name: (float(np.nanmin(values)), float(np.nanmax(values))) for name, values in recorded.items()}
    payload = float(np.nanmax(given["payload"])) if "payload" in given else 0.0
    return tuple(map(pin.SE3, start.rotation, start.position)), drives, payload, travels


def _between(campaign: Campaign, model: RobotModel, count: int, seed: int) -> tuple[FloatArray, BatchStart]:
    """Return drive values between those of two random rows of the campaign each, and their closed poses."""
    random = generator(seed, Stream.DRIVES)
    shares = random.uniform(0.0, 1.0, (_TRIES * count, 1))
    first, second = random.integers(0, len(campaign), (2, _TRIES * count))
    drives = shares * campaign.drives[first] + (1.0 - shares) * campaign.drives[second]
    start = model.definition.drawing().starts(drives)
    closed = np.flatnonzero(np.isfinite(start.position).all(axis=1))[:count]
    if closed.size < count:
        raise BadInputError(
            "hardly any pose between those of the campaign closes the loops; measure poses closer to each other"
        )
    return drives[closed], start[closed]


def candidates(campaign: Campaign, model: RobotModel, count: int, seed: int) -> Candidates:
    """Return ``count`` random measurements that could follow a campaign, within reach and its recorded conditions."""
    poses, drives, payload_kg, travels = _reach(campaign, model, count, seed)
    random = generator(seed, Stream.CANDIDATES)
    block = np.sort(np.arange(count) % len(_BLOCKS))
    after_h, hot = np.array([_BLOCKS[k][0] for k in block]), np.array([_BLOCKS[k][1] for k in block])
    within = np.arange(count) - np.searchsorted(block, block)
    later = after_h + within / 60.0
    last = 0.0 if campaign.time_s is None else float(np.nanmax(campaign.time_s))
    cold = reference_degC(campaign.metadata.reference_temperature_degC)
    approach = random.choice([-1.0, 1.0], drives.shape)
    made: dict[str, FloatArray] = {
        "time": last + _HOUR_S * later,
        "payload": random.choice(np.array([0.0, 0.5, 1.0]) * payload_kg, count),
    }
    made |= {name: np.round(random.uniform(*limits, count), 2) for name, limits in travels.items()}
    for kind in causes_of(campaign.robot).thermometers:
        # Only a load that is carried is hot; parts are still hot just after it was poured out.
        heated = hot & (made["payload"] > 0.0) if kind.hot_degC is not None else hot
        made |= {member: _warm(kind, campaign.quantity(member), cold, heated) for member in kind.members}
    kept = {name: values for name, values in made.items() if name in campaign.conditions}
    sides = campaign.approach
    recorded = None if sides is None else np.where(np.isfinite(sides).any(axis=0), approach, np.nan)
    return Candidates(poses, drives, later, recorded, kept)


def _warm(kind: Thermometers, seen: FloatArray | None, cold: float, hot: BoolArray) -> FloatArray:
    """Return temperatures of a part, (n,): cold, or the highest measured, at least by a plausible rise."""
    if kind.hot_degC is not None:
        return np.where(hot, kind.hot_degC, cold)
    if not kind.hot_rise_k:
        return np.full(len(hot), cold)
    highest = max(-np.inf if seen is None else float(np.nanmax(seen)), cold + kind.hot_rise_k)
    return np.asarray(np.where(hot, np.round(highest), cold))


Item = TypeVar("Item", Explanation, Workmanship)


class PredictedMeasurements:
    """Explanations of a campaign, with their predictions of possible measurements."""

    def __init__(self, diagnosis: Findings, possible: Candidates) -> None:
        """Linearise the rows of the campaign with what the fitted ones show, and the new ones as drawn."""
        old, self._after = diagnosis.rows, diagnosis.after
        rows = CampaignRows(_together(old.campaign, possible, diagnosis), diagnosis.model, old.noise)
        changes = old.changes(self._after.parameters, self._after.values).among(np.arange(len(old)), len(rows))
        self._rows, self._linear = rows, rows.linearise(changes, self._after.frames)
        new = self._linear.row >= len(old)
        self._old = np.append(diagnosis.fitted, np.zeros(len(possible), dtype=bool))[self._linear.row]
        self._new = np.asarray(new, dtype=np.bool_)
        self.components = int(new.sum()) // len(possible)  # measured per pose, 1 to 6
        known = diagnosis.diagnoser.library
        tried = {effect for effect, _ in known.forms}
        chosen = {name: effect for name, effect in known.effects.items() if name in tried}
        library = Library.of(rows, chosen, known.made_within, diagnosis.hypothesis.keys)
        self._nuisance = Nuisance.of(self._linear.free)
        self._new_columns: dict[tuple[str, str], FloatArray] = {}
        self._described: dict[tuple[str, str], tuple[Part, ...]] = {}
        given = diagnosis.hypothesis.problem
        workmanship = self._with_new_rows(workmanship_of(rows, self._linear, library), given, given.workmanship)
        found = self._with_new_rows(known_effects(rows, self._linear, library), given, given.explanations)
        # The fitted rows of the campaign and all explanations.
        self.problem = Problem(given.residual, given.nuisance, tuple(workmanship), tuple(found))
        # Columns of the new rows' own frames, times their usual size, (n * components, 12).
        self.frames = _FRAME * self._linear.frame_columns[self._new]

    def _with_new_rows(self, items: Iterable[Item], given: Problem, before: Sequence[Item]) -> Iterator[Item]:
        """Yield the same with the columns of the campaign's rows; those of the new rows are stored.

        Columns that the new rows did not change are not stored twice.
        """
        held = {item.key: item.columns for item in before}
        for item in items:
            columns = self._nuisance.cleared(item.columns[:])
            self._new_columns[item.key] = columns[self._new]
            old = given.nuisance.cleared(columns[self._old])
            known = held.get(item.key, old)
            yield replace(item, columns=known if _alike(known[:], old) else old)

    def explanations(self, wanted: Collection[tuple[str, str]]) -> dict[tuple[str, str], Explanation]:
        """Return processes at one length scale each, by both names, as explanations of the campaign's rows.

        Only those that exist: with the new rows a condition may no longer be known in all rows.
        """
        for process in processes_of(self._rows, self._linear, self._after.frames.T_tracker_base.rotation):
            of_it = {(process.name, length): parts for length, parts in process.lengths.items()}
            self._described |= {key: parts for key, parts in of_it.items() if key in wanted}
        found: dict[tuple[str, str], Explanation] = {}
        for key, parts in self._described.items():
            columns = self.problem.nuisance.cleared(columns_of(parts)[self._old])
            found[key] = Explanation(*key, columns, np.ones(columns.shape[1], dtype=bool), cause=False)
        return found

    def new_columns(self, item: Explanation | Workmanship) -> FloatArray:
        """Return the columns of an explanation or of workmanship in the new rows."""
        known = self._new_columns.get(item.key)
        return columns_of(self._described[item.key])[self._new] if known is None else known


def _alike(one: FloatArray, other: FloatArray) -> bool:
    """Return whether columns are equal up to round-off, which is all that the frames of new rows change in them."""
    if one.shape != other.shape:
        return False
    return bool((np.abs(one - other).max(axis=0) <= _ROUND_OFF * np.abs(one).max(axis=0)).all())


def _together(campaign: Campaign, possible: Candidates, diagnosis: Findings) -> Campaign:
    """Return a campaign with the possible measurements appended, as the drawing predicts them.

    What was measured in no row of the campaign, such as one coordinate or all rotations, is not measured in these.
    """
    n, frames = len(possible), diagnosis.after.frames
    outer, inner = frames.T_tracker_base, frames.T_end_target
    readings = [outer * pose * inner for pose in possible.poses]
    place = np.array([pose.translation for pose in readings])
    turn = rotation_vectors(np.array([pose.rotation for pose in readings]))
    session = by_size(campaign)[0] if campaign.metadata.own_frames else SESSION
    arrays: dict[str, Any] = {
        "drives": possible.drives,
        "approach": possible.approach,
        "position_m": np.where(campaign.position_measured.any(axis=0), place, np.nan),
        "rotation_vector_rad": np.where(campaign.rotation_measured.any(axis=0), turn, np.nan),
        "force": None,
        "distance_m": None,
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
        sessions=(*campaign.sessions, *((session,) * n)),
        **joined,
    )
