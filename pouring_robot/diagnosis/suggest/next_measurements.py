"""What to measure next: poses and conditions that best distinguish the explanations that a diagnosis leaves."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.columns import approach_names
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.suggest.candidates import SESSION, Candidates, PredictedMeasurements, candidates, in_mm_deg
from pouring_robot.diagnosis.suggest.contenders import Contender, contest
from pouring_robot.effects.base import Effect
from pouring_robot.effects.condition_facts import facts_of, held_still
from pouring_robot.effects.conditions import LOAD, Conditions
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.exceptions import BadInputError, counted
from pouring_robot.inference.discrimination import Prediction, choose, expected, total
from pouring_robot.inference.thresholds import LITTLE_NATS
from pouring_robot.io.argument_checks import whole
from pouring_robot.io.seeds import Stream, generator
from pouring_robot.io.tables import rows_csv
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.definition import RobotDefinition

USUAL_COUNT = 10
RANDOM_SETS = 50
_NO_NATS = 0.05  # less counts as nothing: it would be shown as 0.0
MOST_COUNT = 75  # number of candidate poses
NO_POSE = "no pose distinguishes them: their effect on what is measured is the same"
_OPEN = "measure the poses listed, where their predictions differ most"


@dataclass(frozen=True, eq=False)
class SuggestedMeasurement:
    """One pose under some conditions."""

    robot: RobotDefinition  # the measured robot
    pose: pin.SE3  # of the end body in the base
    drives: FloatArray  # commanded, (drives,), in m and rad
    conditions: dict[str, float]  # by the column names of a campaign file, in the units they carry
    hours_later: float  # after the last row of the campaign
    rank: int  # 1 for the most informative measurement, and so on: make the lowest ranks if only some can be made
    separates: tuple[str, str]  # the two explanations it distinguishes best
    nats: float  # expected growth of their log evidence difference, given the measurements of a lower rank

    def figures(self) -> dict[str, Any]:
        """Return the measurement in mm, degrees and the units of its names."""
        place, drives = in_mm_deg(self.pose), self._commanded()
        return {
            "pose": {name: round(value, 3 if name.endswith("_mm") else 4) for name, value in place.items()},
            "drives": drives,
            "conditions": dict(self.conditions),
            "hours_later": round(self.hours_later, 2),
            "rank": self.rank,
            "separates": list(self.separates),
            "expected_nats": self.nats,
            "why": f"distinguishes {self.separates[0]} from {self.separates[1]}",
        }

    @property
    def in_drives(self) -> bool:
        """Whether the robot is commanded by its drives, not by poses."""
        return {column.name for column in self.robot.command_columns} == {drive.column for drive in self.robot.drives}

    def plan_row(self, number: int) -> dict[str, Any]:
        """Return the measurement as a row of a plan: what to command, and the conditions."""
        pose = {name: float(f"{value:.6g}") for name, value in in_mm_deg(self.pose).items()}
        command = self._commanded() if self.in_drives else pose
        return {"sample": f"next_{number}", "session": SESSION, **command, **self.conditions}

    def _commanded(self) -> dict[str, float]:
        drives = {}
        for drive, value in zip(self.robot.drives, self.drives.tolist(), strict=True):
            unit, si, digits = ("mm", MM, 5) if drive.command == "length" else ("rad", 1.0, 8)
            drives[f"{drive.column}_{unit}"] = round(float(drive.commanded(np.asarray(value))) / si, digits)
        return drives

    @property
    def words(self) -> str:
        """What to command (with drives also the position that they lead to), and the conditions."""
        given, robot = self.conditions, self.robot
        place = in_mm_deg(self.pose)
        x, y, z = (place.pop(f"{axis}_mm") for axis in "xyz")
        turn = ", ".join(f"{name.removesuffix('_deg')} {value:z.0f}°" for name, value in place.items())
        at = f"x {x:z.0f}, y {y:z.0f}, z {z:z.0f} mm"
        said = [f"{self._drive_words}, at {at}" if self.in_drives else f"{at}, {turn}"]
        names = approach_names(robot)
        sides = {name: "+" if given[name] > 0 else "-" for name in names if name in given}
        if len(sides) == len(names):
            said.append(f"approached {''.join(sides.values())}")
        elif sides:  # their order does not show of which drives they are
            each = (f"{name.removeprefix('approach_')} {side}" for name, side in sides.items())
            said.append(f"approached {', '.join(each)}")
        shown = [(LOAD, "load", 0, "kg"), *((f"{name}_m", name.split("_")[-1], 1, "m") for name in robot.travels)]
        for kind in causes_of(robot).thermometers:
            if kind.hot_rise_k:
                name, word = next(iter(kind.members.items()))
                shown.append((f"{name}_degC", f"{word.removesuffix(' temperature')} at", 0, "°C"))
        said += [f"{words} {given[name]:z.{digits}f} {unit}" for name, words, digits, unit in shown if name in given]
        return ", ".join(said)

    @property
    def _drive_words(self) -> str:
        """The commanded drives by the names of their columns, in mm and degrees."""
        said = []
        for drive, value in zip(self.robot.drives, self.drives, strict=True):
            command = drive.commanded(value)
            shown = f"{command / MM:z.1f} mm" if drive.command == "length" else f"{math.degrees(command):z.2f}°"
            said.append(f"{drive.column} {shown}")
        return ", ".join(said)


@dataclass(frozen=True)
class Separation:
    """How well the measurements distinguish one pair of explanations."""

    first: str  # the better explanation so far
    second: str  # the other one
    now_nats: float  # log evidence of the first minus that of the second so far
    expected_nats: float  # its expected growth in favour of the right one, whichever that is
    random_median_nats: float  # the same for as many measurements chosen at random
    how: str  # how to distinguish them


@dataclass(frozen=True, eq=False)
class Suggestion:
    """What to measure next."""

    # in the order in which to make them; none where there is nothing to distinguish
    measurements: tuple[SuggestedMeasurement, ...]
    separations: tuple[Separation, ...]  # pairs of explanations
    expected_nats: float  # how well all pairs are distinguished: a geometric mean
    # the same for random choices among the same candidates, one for each set, (sets,)
    random_nats: FloatArray = field(default_factory=lambda: np.zeros(0))
    advice: tuple[str, ...] = ()  # what else would help, one line each
    seed: int = 0  # of the candidates and the random choices
    failed: str = ""  # why nothing could be suggested; "" where that is no failure

    @property
    def best_first(self) -> list[SuggestedMeasurement]:
        """The measurements, the one that adds most first."""
        return sorted(self.measurements, key=lambda m: (-m.nats, m.rank))

    @property
    def tells(self) -> bool:
        """Whether the measurements distinguish anything at all."""
        return self.expected_nats >= _NO_NATS

    def plan_text(self) -> str:
        """Return the measurements as a plan: a CSV table that ``campaign simulate --plan`` and a crew can run."""
        return rows_csv([m.plan_row(k + 1) for k, m in enumerate(self.measurements)])

    def figures(self) -> dict[str, Any]:
        """Return ``suggestion`` of ``diagnosis.json``; the measurements have a key of their own."""
        return {
            "separations": [asdict(pair) for pair in self.separations],
            "expected_nats": self.expected_nats,
            "random_median_nats": float(np.median(self.random_nats)) if self.random_nats.size else None,
            "random_sets": int(self.random_nats.size),
            "advice": list(self.advice),
            "seed": self.seed,
        }


@one_blas_thread()
def suggest_measurements(diagnosis: Findings, count: int = USUAL_COUNT, seed: int = 0) -> Suggestion:
    """Return up to ``count`` measurements that best separate the surviving explanations of a campaign.

    They are chosen among poses within reach and conditions that the campaign records, allowing for what the frames of a
    newly set up device absorb. A device that is not moved gives no less information.

    Args:
        diagnosis: of the campaign.
        count: how many; 0: none, and no pairs are compared.
        seed: of the candidates, and of the random choices they are compared with.

    Raises:
        DiagnosisError: the drawing does not close at a candidate.
        BadInputError: hardly any pose of the workspace is within reach, distances or closures were measured, or the
            count is not a whole number from 0.
    """
    count = whole(count, 0, "the number of measurements to suggest must be a whole number from 0 on")
    advice = untestable_words(diagnosis.untestable, diagnosis.rows.conditions.robot)
    if not count:
        return Suggestion((), (), 0.0, advice=advice, seed=seed)
    if diagnosis.rows.measured.others:
        raise BadInputError("this takes a device that measures positions or poses, not distances or closures")
    possible = candidates(diagnosis.rows.campaign, diagnosis.model, MOST_COUNT, seed)
    prospect = PredictedMeasurements(diagnosis, possible)
    contenders, pairs = contest(diagnosis, prospect)
    if not pairs:
        return Suggestion((), (), 0.0, advice=advice, seed=seed)
    predictions = [_prediction(c, prospect) for c in contenders]
    k = prospect.components
    choice = choose(predictions, pairs, k, count)
    random = generator(seed, Stream.RANDOM_SETS)
    sets = [random.choice(len(possible), choice.chosen.size, replace=False) for _ in range(RANDOM_SETS)]
    at_random = np.array([expected(predictions, pairs, k, chosen) for chosen in sets])
    grown = expected(predictions, pairs, k, choice.chosen)
    names = [(contenders[a].name, contenders[b].name) for a, b in pairs]
    effects, conditions = diagnosis.diagnoser.library.effects, diagnosis.rows.conditions
    evidence = [contender.log_evidence for contender in contenders]
    by_luck = np.median(at_random, axis=0)
    separations = tuple(
        Separation(
            *names[k],
            evidence[a] - evidence[b],
            float(grown[k]),
            float(by_luck[k]),
            separating_words(*names[k], effects, conditions, tells=grown[k] >= _NO_NATS),
        )
        for k, (a, b) in enumerate(pairs)
    )
    order = np.argsort(choice.chosen, kind="stable")  # candidates are in order of time
    robot = diagnosis.rows.campaign.robot
    measurements = [
        _measurement(robot, possible, int(choice.chosen[i]), int(i) + 1, names, choice.gains[i]) for i in order
    ]
    together = float(total(grown))
    if together < LITTLE_NATS:
        advice = (
            *advice,
            f"{counted(len(measurements), 'more measurement')} like these would add little: {together:.1f} nats",
        )
    return Suggestion(tuple(measurements), separations, together, total(at_random), advice=advice, seed=seed)


def _prediction(contender: Contender, prospect: PredictedMeasurements) -> Prediction:
    """Return the prediction of the candidates by a contender that is fitted to the campaign."""
    hypothesis = contender.hypothesis
    mean, covariance = hypothesis.coefficients()
    groups = zip(hypothesis.fitted, hypothesis.weights(), strict=True)
    scaled = [prospect.new_columns(own) * weights for own, weights in groups]
    columns = np.hstack([np.zeros((len(prospect.frames), 0)), *scaled])
    spread = columns @ covariance @ columns.T + prospect.frames @ prospect.frames.T
    spread.flat[:: len(columns) + 1] += 1.0
    return Prediction(columns @ mean, spread)


def _measurement(
    robot: RobotDefinition,
    possible: Candidates,
    index: int,
    rank: int,
    names: Sequence[tuple[str, str]],
    gains: FloatArray,
) -> SuggestedMeasurement:
    sides = () if possible.approach is None else possible.approach[index]
    both = zip(robot.drives, sides, strict=False)
    given = {drive.approach_column: float(drive.side(side)) for drive, side in both if np.isfinite(side)}
    canonical = {quantity.name: quantity.canonical for quantity in robot.condition_columns}
    given |= {canonical[n]: float(v[index]) for n, v in possible.conditions.items() if n in canonical}
    best = int(np.argmax(gains))
    return SuggestedMeasurement(
        robot,
        possible.poses[index],
        possible.drives[index],
        given,
        float(possible.hours_later[index]),
        rank,
        names[best],
        float(gains[best]),
    )


def separating_words(
    first: str, second: str, effects: Mapping[str, Effect], conditions: Conditions, *, tells: bool = True
) -> str:
    """Return how to distinguish two explanations, effects or not: by what was held constant, else by what differs.

    ``tells`` says whether poses distinguish them at all: a zero and a joint that is turned about its axis are the same.
    """
    both = [effects[name] for name in (first, second) if name in effects]
    ways = [(effect.driver, effect.distinguishing_measurement(conditions)) for effect in both]
    known = [(driver, how) for driver, how in ways if how]
    still = [how for driver, how in known if held_still(driver, conditions)]
    free = [how for driver, how in known if not facts_of(driver, conditions.robot).by_pose]
    if not (still or free or tells):
        return NO_POSE
    chosen = still or free or [how for _, how in known]
    return "; ".join(dict.fromkeys(chosen)) or _OPEN


def untestable_words(untestable: Mapping[str, tuple[str, ...]], robot: RobotDefinition) -> tuple[str, ...]:
    """Return what to record so that effects can be tested, by the conditions that the campaign lacks, one line each."""
    lines: dict[str, list[str]] = {}
    for effect, lacking in untestable.items():
        for name in lacking:
            lines.setdefault(facts_of(name, robot).record or name, []).append(effect)
    return tuple(f"record {what}: without it {', '.join(effects)} cannot be tested" for what, effects in lines.items())
