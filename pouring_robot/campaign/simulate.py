"""Virtual measurement: the campaign of a robot as built, with noise, gross errors, unknown frames and lost cells."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pouring_robot.campaign.columns import POSITION, ROTATION, arrays_from
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import LEAST_SIGMA, CampaignMetadata
from pouring_robot.campaign.plan import PosePlan, refuse_redundant
from pouring_robot.exceptions import BadInputError, CampaignError, NoSolutionError
from pouring_robot.io import usual_noise
from pouring_robot.io.argument_checks import Options, expect, whole
from pouring_robot.io.figures import json_text
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.seeds import Stream, generator
from pouring_robot.io.temperatures import REFERENCE_DEGC
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray, finite
from pouring_robot.mechanism.poses import pose_figures
from pouring_robot.mechanism.rotations import rotation_vectors
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import LOADED, Robot

_SCREW_PITCH_M = 0.010


@dataclass(frozen=True)
class MeasurementOptions(Options):
    """How the virtual tracker measures; figures out of range raise BadInputError.

    Attributes:
        sigma_position_m: standard deviation of a coordinate, in m; 0: exact.
        sigma_rotation_rad: standard deviation of a rotation component, in rad; None: positions only.
        outliers: number of rows with a gross error.
        outlier_m: their shift is 0.5 to 1.5 times this, in a random direction, in m.
        lost: share of measured cells that are empty, 0 to 0.9.
        pose_tracker_to_fixed_platform: None: drawn, as ``pose_platform_to_target``.
        seed: of everything random.
    """

    sigma_position_m: float = usual_noise.SIGMA
    sigma_rotation_rad: float | None = usual_noise.SIGMA
    outliers: int = 0
    outlier_m: float = 5e-3
    lost: float = 0.0
    pose_tracker_to_fixed_platform: pin.SE3 | None = None
    pose_platform_to_target: pin.SE3 | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value, most in (
            ("noise of a position in m", self.sigma_position_m, 1.0),
            ("noise of a rotation in rad", 0.0 if self.sigma_rotation_rad is None else self.sigma_rotation_rad, 1.0),
            ("size of a gross error in m", self.outlier_m, 100.0),
            ("share of lost cells", self.lost, 0.9),
        ):
            said = f"the {name} must be between 0 and {most:g}, not {value}"
            if not 0.0 <= finite(value, (), said) <= most:
                raise BadInputError(said)
        whole(self.seed, 0, "the seed of a virtual measurement is a whole number from 0 on")
        whole(self.outliers, 0, "the number of gross errors is a whole number from 0 on")


@dataclass(frozen=True, eq=False)
class VirtualMeasurement:
    """A campaign as a user would get it, and the hidden truth."""

    campaign: Campaign
    # of the moving platform in the frame of the fixed platform, of the robot as built, row by row
    actual_poses: tuple[pin.SE3, ...] = field(repr=False)
    pose_tracker_to_fixed_platform: pin.SE3 = field(repr=False)
    pose_platform_to_target: pin.SE3 = field(repr=False)
    outlier_rows: tuple[int, ...]  # rows with a gross error, from 0
    lost_cells: tuple[tuple[int, str], ...]  # row and quantity of each cell that was emptied
    seed: int

    def truth_text(self, model: Path | None = None) -> str:
        """Return the hidden truth as JSON text; ``model`` is the model file the robot came from."""
        content = {
            "seed": self.seed,
            "model": None if model is None else str(model),
            "pose_tracker_to_fixed_platform": pose_figures(self.pose_tracker_to_fixed_platform),
            "pose_platform_to_target": pose_figures(self.pose_platform_to_target),
            "outliers": list(self.outlier_rows),
            "outlier_lines": [int(self.campaign.lines[row]) for row in self.outlier_rows],
            "lost_cells": [{"row": row, "column": self.campaign.heading(name)} for row, name in self.lost_cells],
            "actual_poses": [pose_figures(pose) for pose in self.actual_poses],
        }
        return json_text(content)


@one_blas_thread()
def simulate_campaign(
    robot: Robot,
    plan: PosePlan,
    options: MeasurementOptions | None = None,
    *,
    path: Path | str = "campaign.csv",
    robots: Sequence[Robot] | None = None,
    scale: ArrayLike = 0.0,
    progress: Progress = say_nothing,
) -> VirtualMeasurement:
    """Simulate measurements of a robot as built, which closes its loops at the commanded drives.

    ``path`` is the name the campaign is to have; ``robots`` are the states of the robot at each pose, where these
    depend on the conditions of the plan. ``scale`` is the relative scale error of the tracker, one number or one a
    pose, (n,): positions are multiplied by 1 + scale about the tracker's origin. It is not part of a robot: where a
    model has it, ``RobotUnderConditions(robot, …).seen(plan.drives)`` returns both robots and scale.

    Raises:
        BadInputError: there is no robot or plan, options or path are of a wrong type, the model has effects that depend
            on conditions and ``robots`` is missing, the number of robots or scales is not that of poses, there are more
            gross errors than rows, or the robot has redundant drives: their readings follow from the body's pose, not
            the other way round.
        CampaignError: the robot as built cannot take a pose; names the row.
    """
    options = options or MeasurementOptions()
    expect(options, MeasurementOptions, "the options of a virtual measurement are MeasurementOptions")
    expect(path, Path | str, "the path of a campaign is the one its table would have")
    expect(robot, Robot, LOADED)
    expect(plan, PosePlan, "the plan is a PosePlan: of random_plan, read_plan, or plan_campaign(…).pose_plan")
    rows = len(plan)
    if robots is None and robot.model.conditional:
        call = "robots_under(robot, plan.poses, plan.given(robot.model.definition))"
        raise BadInputError(f"where the robot stands depends on the plan's conditions: give robots={call}")
    for standing in robots or ():
        expect(standing, Robot, LOADED)
    if robots is not None and len(robots) != rows:
        raise BadInputError(f"{len(robots)} robots do not match {rows} poses; give one per pose")
    wrong_scale = f"the error of the tracker's scale is one number, or one for each of {rows} poses"
    if np.shape(scale) not in ((), (rows,)):
        raise BadInputError(wrong_scale)
    stretch = 1.0 + np.broadcast_to(finite(scale, np.shape(scale), wrong_scale), rows)[:, None]
    refuse_redundant(robot)
    if options.outliers > rows:
        raise BadInputError(f"{options.outliers} gross errors do not fit into {rows} rows")
    path = Path(path)
    random = generator(options.seed, Stream.SIMULATION)
    outer, inner = _frames(options, random)
    actual = _actual_poses(robot, plan, robots, path, progress)
    observed = [outer * pose * inner for pose in actual]
    position = stretch * np.array([pose.translation for pose in observed])
    position += random.normal(size=(rows, 3)) * options.sigma_position_m
    wrong = np.sort(random.choice(rows, options.outliers, replace=False))
    direction = random.normal(size=(wrong.size, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    position[wrong] += direction * random.uniform(0.5, 1.5, (wrong.size, 1)) * options.outlier_m
    measured = dict(zip(POSITION, position.T, strict=True))
    if options.sigma_rotation_rad is not None:
        noise = random.normal(size=(rows, 3)) * options.sigma_rotation_rad
        turned = np.array([pin.exp3(turn) @ pose.rotation for turn, pose in zip(noise, observed, strict=True)])
        measured |= dict(zip(ROTATION, rotation_vectors(turned).T, strict=True))
    lost = []
    for name, values in measured.items():
        for row in np.flatnonzero(random.random(rows) < options.lost).tolist():
            values[row] = np.nan
            lost.append((row, name))
    campaign = _campaign(robot, plan, options, path, measured)
    return VirtualMeasurement(campaign, tuple(actual), outer, inner, tuple(wrong.tolist()), tuple(lost), options.seed)


def _actual_poses(
    robot: Robot, plan: PosePlan, robots: Sequence[Robot] | None, path: Path, progress: Progress
) -> list[pin.SE3]:
    """Return the pose of the robot as built at each pose of the plan: in one batch for one robot without load."""
    rows, found = len(plan), dict[int, pin.SE3]()
    if robots is None and not robot.loaded:
        command, within = robot.drawing.commands(plan.rows), robot.drawing.in_reach
        closed = robot.close(command.drives, command.start)
        sound = np.flatnonzero(closed.closed & within(command.start) & within(closed.as_start()))
        found = {row: pin.SE3(closed.rotation[row], closed.position[row]) for row in sound.tolist()}
    actual = []
    for row, (standing, pose) in enumerate(zip(robots or [robot] * rows, plan.poses, strict=True)):
        try:  # a pose that was not found is closed alone, which says why
            actual.append(found[row] if row in found else standing.actual_of(pose).pose_base_to_end)
        except NoSolutionError as error:
            raise CampaignError(path, f"pose {row + 1} of the plan: {error}") from error
        progress("measuring", row + 1, rows)
    return actual


def _frames(options: MeasurementOptions, random: np.random.Generator) -> tuple[pin.SE3, pin.SE3]:
    """Return the frames given, or drawn: tracker 2 to 5 m off, target at 0.05 to 0.25 m, in any orientation."""

    def draw(lower: float, upper: float) -> pin.SE3:
        direction, attitude = random.normal(size=3), random.normal(size=4)
        distance = random.uniform(lower, upper) / np.linalg.norm(direction)
        attitude /= np.linalg.norm(attitude)
        return pin.SE3(pin.Quaternion(*attitude.tolist()).toRotationMatrix(), distance * direction)

    # Both are always drawn, so that giving one does not change the noise.
    outer, inner = draw(2.0, 5.0), draw(0.05, 0.25)
    return options.pose_tracker_to_fixed_platform or outer, options.pose_platform_to_target or inner


def metadata_of(robot: Robot) -> dict[str, Any]:
    """Return the facts about a robot that a campaign's metadata may state, by their names there."""
    if not isinstance(robot, PouringRobot):
        return {"target": robot.model.definition.loops.end_frame, "reference_temperature_degC": REFERENCE_DEGC}
    layout, ladle = robot.layout, robot.layout.ladle
    properties = (robot.model.heat or HeatSection()).thermal_properties()
    return {
        "reference_temperature_degC": properties.expansion.reference_temperature.value,
        "screw_pitch_m": _SCREW_PITCH_M,
        "truss_span_m": layout.truss.span.metres,
        "ladle_tare_kg": ladle.tare.value,
        "ladle_centre_of_mass_m": ladle.centre_of_mass.metres,
    }


def _stated(sigma: float | None) -> float | None:
    """Return a noise as the YAML states it; None where it is too small to be stated, or nothing was measured."""
    return sigma if sigma and sigma >= LEAST_SIGMA else None


def _campaign(
    robot: Robot, plan: PosePlan, options: MeasurementOptions, path: Path, measured: dict[str, FloatArray]
) -> Campaign:
    ((what, name),) = robot.model.named.items()
    metadata = CampaignMetadata(
        robot=robot.model.definition.name,
        description=f"virtual measurement of {what} {name}, {len(plan)} poses, seed {options.seed}",
        sigma_position_m=_stated(options.sigma_position_m),
        sigma_rotation_rad=_stated(options.sigma_rotation_rad),
        **metadata_of(robot),
    )
    definition = robot.model.definition
    lengths = (drive.column for drive in definition.drives if drive.command == "length")
    return Campaign(
        robot=definition,
        path=path,
        metadata=metadata,
        lines=np.arange(2, len(plan) + 2),
        samples=plan.samples,
        sessions=plan.sessions,
        headings={"session": "session", **{name: f"{name}_mm" for name in (*POSITION, *lengths)}},
        ignored_columns=(),
        **arrays_from(definition.commanded(plan.drives) | plan.conditions | measured, definition),
    )
