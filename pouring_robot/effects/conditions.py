"""What effects may depend on, row by row: commands, loads, temperatures, time; from a campaign and the drawing.

Forces follow from virtual work: a drive that yields by dq under the weight W at height h carries -W ∂h/∂q.
"""

import functools
import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from pouring_robot.campaign.columns import approach_names, force_names, runs_in_time
from pouring_robot.campaign.data import Campaign
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.effects.missing_cells import filled_in, with_gaps
from pouring_robot.effects.nominal_rows import NominalRows, loads_on
from pouring_robot.io.temperatures import reference_degC
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.mechanism.rotations import nearest_rotations, rotation_vectors, tilts_alone
from pouring_robot.robot.description.cause_types import Causes
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drive import Drive
from pouring_robot.robot.effect_stack import LearnedCampaign

RISE, FORCE, SIDES, LOAD = "_rise_k", "_force", "_approach", "payload_kg"
_STILL = 1e-6
_TURN, _ARC_GAP = 2.0 * np.pi, np.radians(15.0)
"""Angles no further apart than this are in one arc. Coefficients that fall with the order are those of a random walk
around a turn. Between two measured angles it is a Brownian bridge: the variance of what they do not predict is at most
0.48 times the distance between them, in rad, as a share of the walk's variance: here an eighth."""


@functools.lru_cache(maxsize=16)
def slide_offsets_m(robot: RobotDefinition) -> FloatArray:
    """Return by how much the joints at both ends of each sliding drive are further apart than its value, (D,), in m.

    Measured along the slide, from the moving joint before it to the one behind it, or to the loop that it closes.
    """
    mechanism, apart = robot.mechanism(), np.zeros(len(robot.drives))
    model = mechanism.shared_model
    for k, drive in enumerate(robot.drives):
        joint = model.getJointId(drive.joint)
        if drive.unit == "rad" or model.parents[joint] == 0:
            continue
        axis = mechanism.joint_axes([joint])[0, :3]
        before, placed = model.jointPlacements[joint], model.jointPlacements
        ends = [placed[after].translation for after in range(1, model.njoints) if model.parents[after] == joint]
        frames = (model.frames[mechanism.frame_id(name)] for name in mechanism.loops.loop_frames)
        ends += [frame.placement.translation for frame in frames if frame.parentJoint == joint]
        apart[k] = axis @ before.rotation.T @ before.translation + (axis @ ends[0] if ends else 0.0)
    return apart


@dataclass(frozen=True, eq=False)
class Conditions:
    """The conditions of n rows, in SI units; None where a campaign does not state them.

    Besides the attributes there are conditions by name (:meth:`value`): ``<thermometer>_rise_k`` of a thermometer or of
    all of a kind, ``<travel>_m``, ``<group>_force`` of the drives of a group.
    """

    robot: RobotDefinition  # of the drawing: drives, groups, names
    drives: FloatArray  # commanded drives, (n, D), in m and rad
    position_m: FloatArray  # nominal origin of the end body in the base, (n, 3)
    rotation: FloatArray  # nominal axes of the end body, (n, 3, 3)
    session: Indices  # number from 0, (n,); -1: nothing was learned in it, -2: it is not stated
    time_s: FloatArray  # time of measurement, (n,); without a time column the number of the row is used instead
    time_known: bool  # whether there was a time column
    swing_rad: FloatArray | None = None  # of the joint about which each drive's chain swings, (n, D); NaN without one
    # side each drive was approached from, (n, D), +1 or -1; 0 where it is stated for others only
    approach: FloatArray | None = None
    weight_n: FloatArray | None = None  # weight of tool and payload, (n,)
    # force or moment on each drive along its motion, (n, D), in N and Nm; tension is positive. As measured, else
    # computed from weight; NaN for drives for which it is not known.
    drive_force: FloatArray | None = None
    # the same per newton of weight at tool and payload, even if there is none, (n, D), in N/N and Nm/N; None: the place
    # of that weight is not known
    force_by_weight: FloatArray | None = None
    # moment of weight on each joint, by the local parameter that turns it, (n,), in Nm: in closed loops that of
    # :attr:`weight_n` alone, in open chains also that of the links; None: not known
    joint_moments: Mapping[str, FloatArray] | None = None
    slides_m: Mapping[str, FloatArray] = field(default_factory=dict)  # nominal values of sliding joints, (n,), in m
    rises: Mapping[str, FloatArray] = field(default_factory=dict)  # above the reference, by thermometer, (n,), in K
    travels: Mapping[str, FloatArray] = field(default_factory=dict)  # position of the base, by axis, (n,), in m
    screw_pitch_m: float | None = None  # travel of a sliding drive per turn
    truss_span_m: float | None = None  # length of the rails
    learned: LearnedCampaign | None = None  # the campaign that shapes refer to; None: these rows
    filled: tuple[str, ...] = ()  # conditions of which single cells were filled in from their neighbours in time
    assumed: tuple[str, ...] = ()  # what was assumed, one line each

    def __len__(self) -> int:
        return len(self.drives)

    @property
    def from_zero(self) -> FloatArray:
        """Commanded drives, counted from the controller's zero, (n, D), in m and rad."""
        return self.drives - [drive.zero for drive in self.robot.drives]

    @property
    def spans(self) -> FloatArray:
        """Distance between the joints at both ends of each sliding drive, (n, D), in m; the value of a turning one."""
        return np.asarray(self.drives + slide_offsets_m(self.robot))

    @property
    def causes(self) -> Causes:
        """The robot's possible causes, and the words for them."""
        return causes_of(self.robot)

    def places(self, drives: Sequence[Drive]) -> list[int]:
        """Return the columns of some drives."""
        return [self.robot.drives.index(drive) for drive in drives]

    @property
    def lengths_m(self) -> FloatArray:
        """Commanded lengths of the sliding drives, (n, slides)."""
        return self.drives[:, [k for k, drive in enumerate(self.robot.drives) if drive.unit == "m"]]

    @property
    def angles_rad(self) -> FloatArray:
        """Commanded angles of the turning drives, (n, turning)."""
        return self.drives[:, [k for k, drive in enumerate(self.robot.drives) if drive.unit == "rad"]]

    @property
    def tilt_rad(self) -> FloatArray | None:
        """Nominal rotation of the end body about the base's y axis, (n,); None where it also rotates otherwise."""
        return tilts_alone(self.rotation)

    @property
    def turn_rad(self) -> FloatArray:
        """Varying components of the end body's rotation from its mean, (n, 0 to 3): rotation vector in the base."""
        tilt = self.tilt_rad
        if tilt is not None:
            return tilt[:, None][:, : int(np.ptp(tilt) > _STILL)]
        vectors = rotation_vectors(self.rotation, since=nearest_rotations(self.rotation.mean(axis=0)))
        return vectors[:, np.ptp(vectors, axis=0) > _STILL]

    @property
    def elapsed(self) -> FloatArray:
        """Share of the campaign's time that has passed, 0 to 1 within it, (n,)."""
        first, last = self.learned.time_s if self.learned else (self.time_s.min(), self.time_s.max())
        return np.asarray((self.time_s - first) / max(float(last - first), 1e-9))

    @property
    def timed(self) -> bool:
        """Whether the rows' time, measured or row order, is of the kind that shapes refer to."""
        return self.learned is None or self.time_known == self.learned.timed

    @property
    def mean_span_m(self) -> FloatArray:
        """Mean size of :attr:`spans` in the campaign, (D,), whichever way from zero a slide goes."""
        return np.array(self.learned.mean_span_m) if self.learned else np.abs(self.spans).mean(axis=0)

    @property
    def mean_force(self) -> FloatArray:
        """Mean of the absolute force on each drive in the campaign, (D,); empty where it is not known."""
        if self.learned:
            return np.array(self.learned.mean_force)
        return np.abs(np.asarray(self.drive_force)).mean(axis=0) if self.forces_known else np.zeros(0)

    @property
    def forces_known(self) -> bool:
        """Whether the force on every drive is known."""
        return self.drive_force is not None and bool(np.isfinite(self.drive_force).all())

    def mean_rise_k(self, thermometer: str) -> float:
        """Return the mean temperature above the reference in the campaign; 0 where a learned campaign lacks it."""
        return self.learned.mean_rise_k.get(thermometer, 0.0) if self.learned else float(self.rises[thermometer].mean())

    @property
    def session_shares(self) -> FloatArray:
        """Share of the campaign's rows in each session, (sessions,)."""
        counts = np.array(list(self.learned.sessions.values())) if self.learned else np.bincount(self.session)
        return np.asarray(counts / counts.sum())

    def learned_share(self, drive: Drive, shortest_rad: float) -> FloatArray:
        """Return what share of the harmonics of a turning drive's own angle is known in each row, (n,).

        It is 1 at measured angles. Beyond the arcs of a turn that contain these, and between two arcs further apart
        than half of the shortest wave, it fades to 0 over a quarter of that wave: samples no further apart than half of
        a wave determine it (Shannon 1949).
        """
        arcs = self.learned.seen_rad.get(drive.joint, []) if self.learned else []
        if not arcs:
            return np.ones(len(self))
        angles, (first, last) = self.drives[:, self.places((drive,))], np.array(arcs).T
        past_end = ((angles - first) % _TURN - (last - first)).min(axis=1)
        before_start = ((first - angles) % _TURN).min(axis=1)
        within = (past_end <= 0.0) | (past_end + before_start <= max(_ARC_GAP, 0.5 * shortest_rad))
        apart = np.where(within, 0.0, np.minimum(past_end, before_start))
        return np.asarray(np.maximum(1.0 - apart / (0.25 * shortest_rad), 0.0))

    def value(self, name: str) -> Any:
        """Return a condition by its name: (n,) or (n, k), or one number for the campaign; None if there is none."""
        if hasattr(self, name):
            return getattr(self, name)
        if name.endswith(RISE):
            found = [self.rises.get(member) for member in self.causes.members(name.removesuffix(RISE))]
            kept = [rise for rise in found if rise is not None]
            if len(kept) < len(found):
                return None
            return kept[0] if len(kept) == 1 else np.column_stack(kept)
        if name.endswith(FORCE):
            forces = self._of_group(name.removesuffix(FORCE), self.drive_force)
            return None if forces is None or not np.isfinite(forces).all() else forces
        if name.endswith(SIDES):
            return self._of_group(name.removesuffix(SIDES), self.approach)
        return self.travels.get(name.removesuffix("_m"))

    def _of_group(self, name: str, of_drives: FloatArray | None) -> FloatArray | None:
        """Return the columns of a group's drives, from those of all, (n, D); None without these or such a group."""
        group = self.robot.groups.get(name, ())
        return None if of_drives is None or not group else of_drives[:, self.places(group)]

    def in_session(self, number: int) -> FloatArray:
        """Return 1 in rows of a session, else 0, (n,); NaN where the session is not stated."""
        return np.where(self.session < -1, np.nan, self.session == number)

    @functools.cached_property
    def runs(self) -> list[Indices]:
        """Rows in time order, as one run or one run per session: :func:`~.columns.runs_in_time`."""
        return runs_in_time(self.time_s, self.session.tolist())

    def behind(self, values: FloatArray, lag_s: float) -> FloatArray:
        """Return values, (n,) or (n, k), that follow given ones with a first-order lag, in time order.

        They had settled before the first row, also before that of a session whose clock starts anew. They are NaN where
        the time of rows is not known, unless all given values are alike.
        """
        if not self.timed and len(self) > 1 and np.ptp(values, axis=0).any():
            return np.full_like(values, np.nan)
        out = np.array(values, dtype=float)
        for before, now in itertools.chain(*map(itertools.pairwise, self.runs)):
            passed = (self.time_s[now] - self.time_s[before]) / lag_s
            kept = float(np.exp(-passed))
            # Values change linearly from row to row, but in one step at the start of the gap between two sessions.
            evenly = passed > 0.0 and self.session[now] == self.session[before]
            still = float(-np.expm1(-passed)) / passed if evenly else kept
            out[now] = values[now] + (out[before] - values[before]) * kept - (values[now] - values[before]) * still
        return out


def condition_names(robot: RobotDefinition) -> frozenset[str]:
    """Return the names of all conditions that rows may have, measured or computed."""
    own = {
        *(f.name for f in fields(Conditions)),
        *(n for n, own in vars(Conditions).items() if isinstance(own, property)),
    }
    thermometers = {"ambient", *robot.thermometers, *(t.name for t in causes_of(robot).thermometers)}
    rises, travels = {f"{t}{RISE}" for t in thermometers}, {f"{t}_m" for t in robot.travels}
    return frozenset(own | rises | travels | {f"{group}{kind}" for group in robot.groups for kind in (FORCE, SIDES)})


def conditions_of(campaign: Campaign, nominal: NominalRows, learned: LearnedCampaign | None = None) -> Conditions:
    """Return the conditions of a campaign whose rows are all usable; ``nominal`` are the same rows by the drawing.

    If another campaign is given (``learned``), shapes refer to it, and its facts about the machine hold.
    """
    whole = functools.partial(filled_in, campaign)
    facts, robot = learned or campaign.metadata, nominal.robot
    stated = facts.reference_temperature_degC
    reference = reference_degC(stated)
    weight, force, by_weight, moments = loads_on(nominal, facts, whole("payload"))
    for k, name in enumerate(force_names(robot)):
        measured = whole(name)
        if measured is not None:
            force = np.full(campaign.drives.shape, np.nan) if force is None else np.array(force)
            force[:, k] = measured
    known = whole("time")
    names = {name: k for k, name in enumerate(learned.sessions if learned else dict.fromkeys(campaign.sessions))}
    thermometers = (member for kind in causes_of(robot).thermometers for member in kind.members)
    warm = {member: whole(member) for member in thermometers if member in campaign.conditions}
    travels = {name: whole(name) for name in robot.travels}
    sides = [whole(name) for name in approach_names(robot)]
    any_side = any(side is not None for side in sides)
    no_side = np.zeros(len(campaign))
    return Conditions(
        robot=robot,
        drives=np.array(campaign.drives),
        position_m=nominal.position_m,
        rotation=nominal.rotation,
        session=np.array([names.get(name, -1 if name else -2) for name in campaign.sessions], dtype=np.intp),
        time_s=np.arange(len(campaign), dtype=float) if known is None else known,
        time_known=known is not None,
        swing_rad=nominal.swing_rad,
        approach=np.column_stack([no_side if s is None else s for s in sides]) if any_side else None,
        weight_n=weight,
        drive_force=force,
        force_by_weight=by_weight,
        joint_moments=moments,
        slides_m=nominal.slides_m,
        rises={name: values - reference for name, values in warm.items() if values is not None},
        travels={name: values for name, values in travels.items() if values is not None},
        screw_pitch_m=facts.screw_pitch_m,
        truss_span_m=facts.truss_span_m,
        learned=learned,
        filled=with_gaps(campaign),
        assumed=() if stated is not None else (f"reference temperature {reference:g} °C",),
    )


def bare_conditions(robot: RobotDefinition, rows: int = 3) -> Conditions:
    """Return plausible conditions of a few rows in one session, with nothing but drives and measured poses."""
    one, course = np.ones(rows), np.linspace(0.0, 1.0, rows)
    middle = np.array([0.55 if drive.unit == "m" else 0.0 for drive in robot.drives])
    return Conditions(
        robot=robot,
        drives=middle + 0.1 * course[:, None],
        position_m=np.column_stack([-0.1 * one, 0.02 * course, -0.6 - 0.1 * course]),
        rotation=np.tile(np.eye(3), (rows, 1, 1)),
        session=np.zeros(rows, dtype=np.intp),
        time_s=3600.0 * course,
        time_known=True,
        swing_rad=0.1 * np.ones((rows, len(middle))),
    )


def complete_conditions(robot: RobotDefinition, rows: int = 3, *, every_thermometer: bool = False) -> Conditions:
    """Return the same with every condition but several sessions; the figures are of no real machine.

    Thermometers are those that one expects, or every one that the robot may have.
    """
    bare = bare_conditions(robot, rows)
    joints = robot.drawing().engine.structure.placed_joints
    kinds = (kind for kind in causes_of(robot).thermometers if every_thermometer or kind.expected)
    members = [member for kind in kinds for member in kind.members]
    return replace(
        bare,
        approach=np.ones_like(bare.drives),
        weight_n=np.full(rows, 5000.0),
        drive_force=np.full_like(bare.drives, 1000.0),
        joint_moments={f"{joint}.r{axis}": np.full(rows, 500.0) for joint in joints for axis in "xyz"},
        slides_m=dict.fromkeys(joints, np.linspace(0.0, 0.5, rows)),
        rises=dict.fromkeys(members, np.full(rows, 50.0)),
        travels=dict.fromkeys(robot.travels, np.linspace(0.0, 3.0, rows)),
        screw_pitch_m=0.01,
        truss_span_m=6.0,
    )


def of_commands(campaign: Campaign, nominal: NominalRows, learned: LearnedCampaign | None) -> Conditions:
    """Return the conditions of commands, as :func:`conditions_of`, but the order of commands never stands for time."""
    found = conditions_of(campaign, nominal, learned)
    return replace(found, time_known=True) if learned and not learned.timed else found


def recorded(campaign: Campaign) -> dict[str, FloatArray]:
    """Return the drives and conditions that a campaign has, (n,) each, by heading, in inner units."""
    found = {q.canonical: campaign.command(q.name) for q in campaign.robot.ranged_columns}
    return {heading: values for heading, values in found.items() if values is not None}


def learned_in(campaign: Campaign, conditions: Conditions) -> LearnedCampaign:
    """Return what effects learned in a campaign, under its conditions, refer to when they are applied elsewhere."""
    metadata = campaign.metadata
    shared = metadata.model_dump(include={*LearnedCampaign.model_fields})  # facts of the machine
    shared["reference_temperature_degC"] = reference_degC(metadata.reference_temperature_degC)
    return LearnedCampaign(
        ranges={name: (float(np.nanmin(v)), float(np.nanmax(v))) for name, v in recorded(campaign).items()},
        seen_rad={
            drive.joint: arcs_of(campaign.drives[:, k])
            for k, drive in enumerate(campaign.robot.drives)
            if drive.unit == "rad"
        },
        sessions={name: rows.size for name, rows in campaign.rows_by_session().items()},
        mean_span_m=conditions.mean_span_m.tolist(),
        mean_force=conditions.mean_force.tolist(),
        mean_rise_k={name: float(rise.mean()) for name, rise in conditions.rises.items()},
        **shared,
    )


def force_headings(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the headings of the force or moment on each drive."""
    return tuple(column.canonical for column in robot.condition_columns if column.kind in ("force", "moment"))


def forces_measured(robot: RobotDefinition, headings: Collection[str]) -> bool:
    """Return whether headings include the force or moment on every drive, so that no load need be known."""
    return {*force_headings(robot)} <= {*headings}


def arcs_of(angles: FloatArray) -> list[tuple[float, float]]:
    """Return the arcs of a turn that contain angles, (n,), in rad; between the arcs nothing is predicted."""
    ordered = np.unique(angles % _TURN)
    ends = np.flatnonzero(np.diff(ordered, append=ordered[0] + _TURN) > _ARC_GAP)
    if not ends.size:
        return [(0.0, _TURN)]
    first, last = ordered[(ends + 1) % len(ordered)], np.roll(ordered[ends], -1)
    return [(start, start + (end - start) % _TURN) for start, end in zip(first.tolist(), last.tolist(), strict=True)]
