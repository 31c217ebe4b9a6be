"""Planning a campaign: which poses to measure, under which conditions, and how well the robot will then be known.

    planner = Planner(load_robot(), PlanRequest(poses=30))
    plan = planner.plan()
    plan.quality.parameter_std, plan.quality.ladle_rms_m      # before a single measurement

The unknowns are the twelve numbers of the two outer frames and the wanted parameters; the frames are nuisance
parameters. See :mod:`~pouring_robot.estimation.identifiability` for the indices, :mod:`~pouring_robot.design.exchange`
for the search. Everything is linear in the unknowns, about the given model; effects of the conditions are the simple
columns of :mod:`~pouring_robot.design.request`. The benchmark of a plan is as many poses drawn at random.
"""

import contextlib
import functools
import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.campaign.columns import approach_names
from pouring_robot.campaign.plan import plan_of, random_plan, refuse_redundant
from pouring_robot.design.exchange import CandidateSet, choose
from pouring_robot.design.information import covariance, informative_parameters, projected_singular_values, with_prior
from pouring_robot.design.plan_rows import Columns, PlannedConditions, candidate_poses
from pouring_robot.design.request import PlannedParameter, PlanRequest, expected_size, planned_parameters
from pouring_robot.design.result import MeasurementPlan, PlanQuality, UndeterminedError
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.estimation.frames.outer import FRAME_PARAMETERS, FRAMES
from pouring_robot.estimation.identifiability import base_parameters, observability_index
from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.seeds import Stream, generator
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import LOADED, Robot
from pouring_robot.robot.tolerances import Tolerances

_LADLE_LEVELS = (3, 3, 7, 7)  # of the workspace's grid, its faces included, along x, y, z and tilt
_ONE, _BOTH = 0, 1  # kinds of a candidate: visited from one side, or from both


@one_blas_thread()
def plan_campaign(
    robot: Robot, request: PlanRequest | None = None, progress: Progress = say_nothing
) -> MeasurementPlan:
    """Return the most informative poses and conditions for a robot's parameters; see :class:`Planner`."""
    return Planner(robot, request).plan(progress)


class Planner:
    """Plans for one robot and one request. Candidates and their columns are computed once.

    Raises:
        BadInputError: there is no robot, its drives are redundant, a parameter is unknown, a load is more than the
            ladle holds, or there are too few candidates.
        UndeterminedError: measurements anywhere, or those of a plan, cannot determine the parameters.
        NoSolutionError: the robot can reach hardly any of its workspace, or does not close at a pose of a plan.
    """

    def __init__(self, robot: Robot, request: PlanRequest | None = None) -> None:
        expect(robot, Robot, LOADED)
        refuse_redundant(robot)
        self.robot, self.request = robot, request or PlanRequest()
        expect(self.request, PlanRequest, "the request of a plan is a PlanRequest")
        loads = self.request.loads_kg
        if isinstance(robot, PouringRobot) and max(loads, default=0.0) > robot.layout.ladle.payload.value:
            most = robot.layout.ladle.payload.value
            raise BadInputError(f"the ladle holds at most {most:g} kg of melt, not {max(loads):g} kg")
        asked = planned_parameters(robot, self.request)
        self.poses, rows = self._rows(Columns(robot, asked))
        # Some of the frames' twelve numbers cannot be distinguished: along y, the axis of every tilt, both frames shift
        # the target alike. Which one is kept changes neither the parameters nor the ladle seen by the tracker.
        names = [p.name for p in FRAME_PARAMETERS]
        apart = base_parameters(rows[..., :FRAMES].reshape(-1, FRAMES), names).base
        self._frames = [k for k, name in enumerate(names) if name in apart]
        self._frame_names = [names[k] for k in self._frames]
        rows = self._apart(rows)
        self.nuisance = len(self._frames)
        kept = self._kept(asked, rows)
        self.left_out = tuple(p.name for k, p in enumerate(asked) if k not in kept)
        if not kept:
            raise BadInputError(self._why_none(rows.reshape(-1, rows.shape[-1])))
        self.parameters = tuple(asked[k] for k in kept)
        self.columns = Columns(robot, self.parameters)
        self._candidate_rows = rows[..., [*range(self.nuisance), *(self.nuisance + k for k in kept)]]

    def _why_none(self, rows: FloatArray) -> str:
        """Return why all parameters are left out: the frames have the same effect, or the effect is below the noise."""
        some = f"{', '.join(self.left_out[:4])}{' …' if len(self.left_out) > 4 else ''}"
        names = [*self._frame_names, *self.left_out]
        if set(base_parameters(rows, names, lead=self._frame_names).base) <= set(self._frame_names):
            mend = "" if self.request.parameters else "; name others, or all of the geometry (--parameters geometry)"
            same = "they cannot be separated from the frames of tracker and target"
            return f"measurements cannot determine any of the parameters ({some}): {same}{mend}"
        return (
            f"{self.request.poses} poses show none of the parameters ({some}) above the noise, even if off by their "
            "tolerances; plan more poses, or measure with less noise (--sigma-mm, --sigma-mrad)"
        )

    def _apart(self, columns: FloatArray) -> FloatArray:
        """Return columns, (..., 12 + P), without those of the frames that cannot be distinguished, (..., f + P)."""
        return np.delete(columns, np.setdiff1d(np.arange(FRAMES), self._frames), axis=-1)

    @functools.cached_property
    def states(self) -> tuple[PlannedConditions, ...]:
        """Loads and temperatures to choose from."""
        usual = PlannedConditions()
        loads = self.request.loads_kg or (usual.payload_kg,)
        temperatures = self.request.drive_degC or (usual.drive_degC,)
        return tuple(PlannedConditions(1, load, degrees) for degrees in temperatures for load in loads)

    def _rows(self, columns: Columns) -> tuple[FloatArray, FloatArray]:
        """Return poses to choose from, and their whitened rows (n, states, sides, k, 12 + P) per shown unit."""
        sides = (1, -1) if self.request.both_sides else (1,)
        visits = [replace(state, side=side) for state in self.states for side in sides]
        # Where a pose can be visited in several ways, fewer poses give as many candidates.
        candidates = candidate_poses(self.robot.command_axes, self.request.candidates // len(visits))
        poses = candidates[columns.reachable(candidates)]
        rows, closed = self.measured(columns, poses, visits)
        count, least, tried = np.count_nonzero(closed), max(self.request.poses, 20), len(candidates)
        if count < least and count > tried / 2:
            raise BadInputError(
                f"{least} candidate poses are needed, but only {count} of {tried} close; give more candidates "
                f"(--candidates) than {self.request.candidates}"
            )
        if count < least:
            raise NoSolutionError("hardly any pose of the workspace can be reached; check limits and model")
        shape = (-1, len(self.states), len(sides), *rows.shape[2:])
        return poses[closed], rows[closed].reshape(shape)

    def measured(
        self, columns: Columns, poses: FloatArray, visits: Sequence[PlannedConditions]
    ) -> tuple[FloatArray, BoolArray]:
        """Return whitened rows (n, visits, k, 12 + P) per shown unit, and which poses close, (n,)."""
        rows, closed = columns.measured(poses, visits, self.request.noise, np.array(self.request.target_m))
        return rows * _units(columns.parameters), closed

    def _inverse_std(self, parameters: Sequence[PlannedParameter]) -> FloatArray:
        """Return one over the prior standard deviation in shown units, shape (f + P,); 0 without a prior."""
        weights = np.zeros(self.nuisance + len(parameters))
        priors, robot = self.request.priors, self.robot.model.definition
        for k, parameter in enumerate(parameters, start=self.nuisance):
            if priors is not None and parameter.kind == "local":
                weights[k] = parameter.shown_in[1] / expected_size(parameter, robot, priors)
        return weights

    def _kept(self, asked: Sequence[PlannedParameter], rows: FloatArray) -> list[int]:
        """Return which parameters to plan for; refuse where undetermined ones may not be left out."""
        flat = rows.reshape(-1, rows.shape[-1])
        if self.request.reduced and self.request.priors is None:
            robot = self.robot.model.definition
            tolerances = Tolerances.of(robot)
            sizes = np.array([expected_size(p, robot, tolerances) / p.shown_in[1] for p in asked])
            # All candidates count as one plan of the wanted size.
            share = math.sqrt(self.request.poses / len(self.poses) / rows.shape[1] / rows.shape[2])
            return informative_parameters(flat * share, self.nuisance, sizes)
        self._refuse_undetermined("measurements all over the workspace", flat, asked, everywhere=True)
        return list(range(len(asked)))

    def _refuse_undetermined(
        self, what: str, rows: FloatArray, parameters: Sequence[PlannedParameter], *, everywhere: bool = False
    ) -> None:
        names = [*self._frame_names, *(p.name for p in parameters)]
        found = base_parameters(with_prior(rows, self._inverse_std(parameters)), names, lead=self._frame_names)
        if found.deficient:
            priors, frames = self.request.priors is not None, set(self._frame_names)
            reducible = not (self.request.reduced or priors)
            raise UndeterminedError(what, found, frames, reducible=reducible, everywhere=everywhere, priors=priors)

    @one_blas_thread()
    def plan(self, progress: Progress = say_nothing) -> MeasurementPlan:
        """Return the best plan found."""
        request, rows = self.request, self._candidate_rows
        candidates, slots = self._candidate_set(rows)
        chosen = choose(
            candidates, slots, request.criterion, seed=request.seed, starts=request.starts, progress=progress
        )
        places = candidates.place[chosen].tolist()
        visits = [(*divmod(place, len(self.states)), both) for place, both in zip(places, slots.tolist(), strict=True)]
        numbered = [
            (n, pose, state, side)
            for n, (pose, state, both) in enumerate(self._ordered(visits), start=1)
            for side in ((1, -1) if both else (1,))
        ]
        conditions = tuple(replace(self.states[state], side=side) for _, _, state, side in numbered)
        stack = np.stack([rows[pose, state, 0 if side > 0 else 1] for _, pose, state, side in numbered])
        poses = self.poses[[pose for _, pose, _, _ in numbered]]
        quality = self._quality(stack, request.poses)
        index = float(observability_index(quality.singular_values, request.criterion, request.poses))
        axes, robot, left_out = self.robot.command_axes, self.robot.model.definition, self.left_out
        samples = tuple(f"{n}{'b' if side < 0 else ''}" for n, _, _, side in numbered)
        drives, sessions = self.robot.drawing.commands(poses).drives, ("1",) * len(samples)
        planned = plan_of(self.robot, poses, drives, samples, sessions, self._given(conditions))
        return MeasurementPlan(
            request, axes, robot, self.parameters, left_out, poses, conditions, planned, quality, index
        )

    def _given(self, visits: Sequence[PlannedConditions]) -> dict[str, FloatArray]:
        """Return the planned conditions of each visit, (n,) by name."""
        request, robot = self.request, self.robot.model.definition
        asked = {
            "side": approach_names(robot) if request.both_sides else (),
            "payload_kg": ("payload",) if request.loads_kg else (),
            "drive_degC": causes_of(robot).beside_drives if request.drive_degC else (),
        }
        return {
            name: np.array([getattr(visit, field) for visit in visits], dtype=float)
            for field, names in asked.items()
            for name in names
        }

    def _candidate_set(self, rows: FloatArray) -> tuple[CandidateSet, Indices]:
        """Return candidates of one visit and, if requested, of two; and the kind of each slot of the plan."""
        count, states, sides, size, unknowns = rows.shape
        visits = rows.reshape(count * states, sides * size, unknowns)
        place, kind = np.arange(len(visits)), np.full(len(visits), _ONE)
        request = self.request
        slots = np.array([_BOTH] * request.both_sides + [_ONE] * (request.poses - request.both_sides), dtype=np.intp)
        if request.both_sides:
            once = visits.copy()
            once[:, size:] = 0.0
            visits = np.concatenate([once, visits])
            place, kind = np.tile(place, 2), np.repeat([_ONE, _BOTH], len(place))
        return CandidateSet(visits, self.nuisance, place, kind, self._inverse_std(self.parameters)), slots

    def _ordered(self, visits: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
        """Return the visits in a practicable order: by rising heat, then by load, with short ways between poses."""
        lower, upper = self.poses.min(axis=0), self.poses.max(axis=0)
        scaled = (self.poses - lower) / np.maximum(upper - lower, 1e-12)
        ordered: list[tuple[int, int, int]] = []
        here = np.zeros(lower.size)
        for state in sorted({s for _, s, _ in visits}, key=lambda s: (self.states[s].drive_degC, s)):
            remaining = sorted(v for v in visits if v[1] == state)
            while remaining:
                nearest = min(remaining, key=lambda v: (float(np.linalg.norm(scaled[v[0]] - here)), v))
                remaining.remove(nearest)
                ordered.append(nearest)
                here = scaled[nearest[0]]
        return ordered

    @one_blas_thread()
    def quality(self, poses: FloatArray, conditions: Sequence[PlannedConditions] | None = None) -> PlanQuality:
        """Return the quality of any other plan, for the same parameters and noise.

        Its rows are commands (rows, k), in m and rad, by default all visited alike: from one side, empty and at the
        reference temperature. A pose that is visited from both sides has two rows and counts once.
        """
        poses = np.asarray(poses, dtype=float)
        given = list(conditions or [PlannedConditions()] * len(poses))
        unique = list(dict.fromkeys(given))
        rows, closed = self.measured(self.columns, poses, unique)
        if not closed.all():
            raise NoSolutionError(f"row {int(np.argmin(closed)) + 1} of the plan does not close; choose another pose")
        picked = self._apart(rows)[np.arange(len(poses)), [unique.index(c) for c in given]]
        sides: dict[tuple[object, ...], Counter[int]] = defaultdict(Counter)
        for pose, visit in zip(poses.tolist(), given, strict=True):
            sides[*pose, replace(visit, side=0)][visit.side] += 1
        return self._quality(picked, sum(max(times.values()) for times in sides.values()))

    def _quality(self, rows: FloatArray, poses: int) -> PlanQuality:
        flat, inverse_std = rows.reshape(-1, rows.shape[-1]), self._inverse_std(self.parameters)
        self._refuse_undetermined(f"a plan of {poses} (measured figures: {len(flat)})", flat, self.parameters)
        units = self._apart(_units(self.parameters))
        expected = covariance(flat, inverse_std) * np.outer(units, units)
        grid, ladle = self._ladle
        variance = np.einsum("gip,pq,giq->gi", ladle, expected, ladle, optimize=True)
        std = np.sqrt(np.diagonal(expected)[self.nuisance :])
        values = projected_singular_values(flat, self.nuisance, inverse_std)
        return PlanQuality(expected, std, grid, np.sqrt(np.maximum(variance, 0.0)), values, poses)

    @functools.cached_property
    def _ladle(self) -> tuple[FloatArray, FloatArray]:
        """Workspace poses within reach, and the working frame's columns there at the heaviest load and highest heat."""
        if isinstance(self.robot, PouringRobot):
            grid = self.robot.layout.grid(*(np.linspace(0.0, 1.0, n) for n in _LADLE_LEVELS))
            grid = grid[self.columns.reachable(grid)]
        else:
            grid, _ = self.robot.model.definition.workspace(self.robot.drawing)
        work = PlannedConditions(0, max(s.payload_kg for s in self.states), max(s.drive_degC for s in self.states))
        columns, closed = self.columns.ladle(grid, work)
        return grid[closed], self._apart(columns[closed])


def _units(parameters: Sequence[PlannedParameter]) -> FloatArray:
    """Return the size of the unit in which each unknown is shown (frames: mm, mrad), (12 + P,), in its inner unit."""
    return np.array([MM] * FRAMES + [p.shown_in[1] for p in parameters])


@dataclass(frozen=True, eq=False)
class Comparison:
    """Expected standard deviations of the ladle by a plan, (3,), and by each of k random ones, (k, 3).

    Of its position and orientation, root mean square over the workspace, in m and rad, and of its position at the worst
    pose of the workspace, in m. Infinite where a plan does not determine the parameters.
    """

    planned: FloatArray
    random: FloatArray

    @property
    def median(self) -> FloatArray:
        """Those of the median random plan, shape (3,)."""
        return np.asarray(np.median(self.random, axis=0))

    @property
    def ratios(self) -> FloatArray:
        """Ratios of the plan's to those of the median random plan, shape (3,)."""
        return np.asarray(self.planned / self.median)

    def figures(self) -> dict[str, float | None]:
        """Return the figures for JSON, mm and mrad; no median where more than half do not determine the parameters."""
        mm, mrad = (
            float(median) / unit if np.isfinite(median) else None
            for median, unit in zip(self.median[:2], (MM, MRAD), strict=True)
        )
        return {
            "count": len(self.random),
            "undetermined": int(np.isinf(self.random[:, 0]).sum()),
            "median_rms_mm": mm,
            "median_rms_mrad": mrad,
            "ratio_mm": float(self.ratios[0]),
            "ratio_mrad": float(self.ratios[1]),
        }


def compare_with_random(planner: Planner, plan: MeasurementPlan, count: int = 50, seed: int = 0) -> Comparison:
    """Compare a plan with random ones of as many poses, spread evenly over the workspace box.

    Loads and temperatures are also drawn, evenly from those that the plan may choose; as many poses are visited from
    both sides. ``seed`` is that of the first; the others follow. A plan that cannot determine the parameters has
    infinite standard deviations. Raises BadInputError if ``count`` is not positive.
    """
    if count < 1:
        raise BadInputError(f"compare with at least one random plan, not {count}")

    def stds(quality: PlanQuality) -> list[float]:
        return [quality.ladle_rms_m, quality.ladle_rms_rad, quality.ladle_worst_m]

    random = np.full((count, 3), np.inf)
    for k in range(count):
        with contextlib.suppress(UndeterminedError):
            random[k] = stds(planner.quality(*random_visits(planner, seed + k)))
    return Comparison(np.array(stds(plan.quality)), random)


def random_visits(planner: Planner, seed: int) -> tuple[FloatArray, list[PlannedConditions]]:
    """Return rows of a random plan for the same request: commands (rows, k) in m and rad, and their conditions."""
    request = planner.request
    drawn = random_plan(planner.robot, request.poses, seed)
    random = generator(seed, Stream.VISITS)
    both = set(random.choice(request.poses, request.both_sides, replace=False).tolist())
    poses, conditions = [], []
    for k, pose in enumerate(drawn.rows):
        state = planner.states[int(random.integers(len(planner.states)))]
        for side in (1, -1) if k in both else (1,):
            poses.append(pose)
            conditions.append(PlannedConditions(side, state.payload_kg, state.drive_degC))
    return np.array(poses), conditions
