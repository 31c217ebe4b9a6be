"""Is calibration right? Coverage of the 95 % intervals and held-out error on many virtual robots.

    python scripts/studies/calibration.py --runs 400 --parameters geometry --json study.json

Each run draws a robot from the tolerances, measures it with :func:`~pouring_robot.simulate_campaign` (the
one-at-a-time closure, not the batch engine), identifies it from the training blocks, and compares how often the 95 %
intervals contain the true values, and how large the held-out error is relative to the noise.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import random_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.cli.shared.progress import stage_bars
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAME_PARAMETERS, FRAMES
from pouring_robot.estimation.identifiability import BaseParameters, base_parameters, robot_combinations
from pouring_robot.estimation.intervals import Z95
from pouring_robot.estimation.map_fit import Fit, FitOptions, identify
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.residuals import MeasuredPoses, regressor, whiten
from pouring_robot.estimation.splits import split
from pouring_robot.exceptions import CalibrationError, PouringRobotError
from pouring_robot.io.files import write_whole
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import all_parameters
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.tolerances import Tolerances

_FRAMES = tuple(p.name for p in FRAME_PARAMETERS)


@dataclass(frozen=True)
class StudyOptions:
    """What to study.

    Attributes:
        runs: number of virtual robots.
        rows: poses of each campaign; a fifth of them is held out as a block of the workspace.
        parameters: sets, groups or patterns; true errors are drawn for these and no others.
        sigma_position_m: noise of a coordinate, in m.
        sigma_rotation_rad: noise of a rotation component, in rad; None: positions only.
        seed: of everything random.
    """

    runs: int = 400
    rows: int = 150
    parameters: tuple[str, ...] = ("geometry",)
    sigma_position_m: float = 5e-5
    sigma_rotation_rad: float | None = 5e-5
    seed: int = 0


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What came out.

    Attributes:
        names: of the parameters.
        covered: whether the 95 % interval held the truth, shape (runs, P).
        covered_combinations: the same for each identifiable combination without frames, shape (runs, C).
        held_out_ratio: RMS of each run's held-out rows over the noise, shape (runs,).
        expected_ratio: what it is expected to be: noise, and what these rows leave open of the prediction (from the
            fit's covariance); no method that has only these rows does better. Shape (runs,).
        before_ratio: the same for the drawing with its frames fitted, shape (runs,).
        evaluations: predictions of all rows that each fit took, shape (runs,).
        seconds: time of each fit, shape (runs,).
        failed: runs without an answer, by reason; they are in none of the arrays.
    """

    names: tuple[str, ...]
    covered: BoolArray
    covered_combinations: BoolArray
    held_out_ratio: FloatArray
    expected_ratio: FloatArray
    before_ratio: FloatArray
    evaluations: FloatArray
    seconds: FloatArray
    failed: tuple[str, ...]

    @property
    def coverage(self) -> float:
        """Share of all intervals that hold the truth."""
        return float(self.covered.mean())

    @property
    def combination_coverage(self) -> float:
        """Share of the identifiable combinations' intervals that hold the truth."""
        return float(self.covered_combinations.mean()) if self.covered_combinations.size else float("nan")

    @property
    def held_out(self) -> float:
        """RMS of all held-out rows over the noise."""
        return float(np.sqrt((self.held_out_ratio**2).mean()))

    def figures(self) -> dict[str, float]:
        """Return the outcome ready for JSON."""
        per_parameter = self.covered.mean(axis=0)
        return {
            "runs": float(len(self.seconds)),
            "failed": float(len(self.failed)),
            "parameters": float(len(self.names)),
            "coverage": self.coverage,
            "coverage_least_parameter": float(per_parameter.min()),
            "coverage_largest_parameter": float(per_parameter.max()),
            "combinations": float(self.covered_combinations.shape[1]),
            "combination_coverage": self.combination_coverage,
            "held_out_over_noise": self.held_out,
            "held_out_expected": float(np.sqrt((self.expected_ratio**2).mean())),
            "before_over_noise": float(np.sqrt((self.before_ratio**2).mean())),
            "evaluations_median": float(np.median(self.evaluations)),
            "evaluations_largest": float(self.evaluations.max()),
            "seconds_median": float(np.median(self.seconds)),
        }


@dataclass(frozen=True, eq=False)
class _Run:
    covered: BoolArray
    covered_combinations: BoolArray
    held_out: float
    expected: float
    before: float
    evaluations: int
    seconds: float


def coverage_study(
    options: StudyOptions | None = None,
    tolerances: Tolerances | None = None,
    progress: Progress = say_nothing,
) -> StudyResult:
    """Run the study.

    Raises:
        BadInputError: the parameters are wrong.
        CalibrationError: no run has an answer.
    """
    options, tolerances = options or StudyOptions(), tolerances or Tolerances.load()
    drawing = PouringRobot()
    groups = drawing.parameters.groups(options.parameters)
    model = MeasurementModel(RobotModel(), all_parameters(groups))
    runs, failed = [], []
    for run in range(options.runs):
        progress("runs", run, options.runs)
        try:
            runs.append(_run(drawing, model, tolerances, options, run))
        except PouringRobotError as error:
            failed.append(f"run {run}: {error}")
    if not runs:
        raise CalibrationError("no run of the study has an answer", failed[0] if failed else "ask for one or more")
    return StudyResult(
        names=tuple(p.name for p in model.parameters),
        covered=np.array([run.covered for run in runs]),
        covered_combinations=np.array([run.covered_combinations for run in runs]),
        held_out_ratio=np.array([run.held_out for run in runs]),
        expected_ratio=np.array([run.expected for run in runs]),
        before_ratio=np.array([run.before for run in runs]),
        evaluations=np.array([float(run.evaluations) for run in runs]),
        seconds=np.array([run.seconds for run in runs]),
        failed=tuple(failed),
    )


def virtual_campaign(
    drawing: PouringRobot, model: MeasurementModel, truth: FloatArray, options: StudyOptions, seed: int
) -> Campaign:
    """Measure the robot that has the given parameter values, shape (P,), in m and rad.

    Raises:
        CampaignError: the robot cannot take a pose.
    """
    actual = PouringRobot(model.amended(truth))
    plan = random_plan(drawing, options.rows, seed)
    noise = MeasurementOptions(options.sigma_position_m, options.sigma_rotation_rad, seed=seed)
    return simulate_campaign(actual, plan, noise).campaign


def _run(
    drawing: PouringRobot, model: MeasurementModel, tolerances: Tolerances, options: StudyOptions, run: int
) -> _Run:
    seed = options.seed * 1_000_003 + run
    random = np.random.default_rng([seed, 3])
    truth = random.normal(size=len(model.parameters)) * tolerances.std(model.parameters, model.model.definition)
    campaign = virtual_campaign(drawing, model, truth, options, seed)
    parts = split(campaign, np.zeros(0, dtype=np.intp), "region")
    noise = NoiseLevel.stated(options.sigma_position_m, options.sigma_rotation_rad)
    measured = MeasuredPoses.from_campaign(campaign, noise)
    rows = model.at(campaign.drives)
    train, seen = rows[parts.train], measured[parts.train]
    clock = time.perf_counter()
    start = first_frames(train, seen)
    fit = identify(train, seen, start, model.prior_std(tolerances), FitOptions(curvature=True))
    seconds = time.perf_counter() - clock
    wrong = fit.unknowns.values[FRAMES:] - truth
    shares = _shares(
        base_parameters(regressor(train.linearise(start), seen.sigma, seen.known), model.names, lead=_FRAMES)
    )
    covariance = fit.covariance[FRAMES:, FRAMES:]
    spread = np.sqrt(np.einsum("ij,jk,ik->i", shares, covariance, shares))
    held_out, judged = rows[parts.test], measured[parts.test]
    return _Run(
        np.abs(wrong) <= Z95 * fit.std[FRAMES:],
        np.abs(shares @ wrong) <= Z95 * spread,
        _ratio(judged, held_out, fit.unknowns),
        _expected(judged, held_out, fit),
        _ratio(judged, held_out, start),
        fit.evaluations,
        seconds,
    )


def _shares(base: BaseParameters) -> FloatArray:
    """Return the identifiable combinations as rows, shape (C, P)."""
    place = {name: k for k, name in enumerate(base.names[FRAMES:])}
    combinations = robot_combinations(base, _FRAMES)
    shares = np.zeros((len(combinations), len(place)))
    for k, combination in enumerate(combinations):
        for name, share in combination.items():
            shares[k, place[name]] = share
    return shares


def _expected(measured: MeasuredPoses, rows: ModelledRows, fit: Fit) -> float:
    """Return the RMS residual over the noise that rows unseen by a fit should have: its own uncertainty and noise."""
    equations = regressor(rows.linearise(fit.unknowns), measured.sigma, measured.known)
    return float(np.sqrt(1.0 + ((equations @ fit.covariance) * equations).sum(axis=1).mean()))


def _ratio(measured: MeasuredPoses, rows: ModelledRows, unknowns: Unknowns) -> float:
    """Return the RMS residual of rows over their noise."""
    return float(np.sqrt((whiten(measured, rows.predict(unknowns)).residual ** 2).mean()))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study, print its figures, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--rows", type=int, default=150, help="poses of each campaign")
    parser.add_argument("--parameters", nargs="+", default=["geometry"], help="sets, groups or patterns")
    parser.add_argument("--positions-only", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", metavar="FILE", help="write the figures")
    given = parser.parse_args(arguments)
    options = StudyOptions(
        runs=given.runs,
        rows=given.rows,
        parameters=tuple(given.parameters),
        sigma_rotation_rad=None if given.positions_only else 5e-5,
        seed=given.seed,
    )
    try:
        with stage_bars() as progress:
            result = coverage_study(options, progress=progress)
        for name, value in result.figures().items():
            print(f"{name:28s} {value:.4g}")
        for line in result.failed:
            print(line, file=sys.stderr)
        if given.json:
            write_whole(given.json, json.dumps(result.figures(), indent=1) + "\n")
    except PouringRobotError as error:
        print(f"calibration_study: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
