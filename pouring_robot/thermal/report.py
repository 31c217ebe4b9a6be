"""What a melt does to a robot, as figures and as CSV: temperatures and deformation at a pose, and over a shift.

Deformation is that of the drawing: heat alone, no geometric errors.
"""

# ruff: noqa: N815 - units keep their capitals: K, W, degC
from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD, PoseDifference
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.metrics import difference_figures
from pouring_robot.robot.pouring.names import CHAINS
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.robot import PouringRobot
from pouring_robot.thermal.expansion.bending import LegBending
from pouring_robot.thermal.expansion.growth import ThermalExpansion
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot
from pouring_robot.thermal.expansion.warm_robot import solve_heated
from pouring_robot.thermal.network.field import TemperatureField
from pouring_robot.thermal.network.history import HeatHistory, Placed, PoseSchedule
from pouring_robot.thermal.network.robot_network import ThermalNetwork
from pouring_robot.thermal.network.transient import simulate


@dataclass(frozen=True)
class PartTemperature:
    """One part.

    Attributes:
        part: its name.
        mean_degC: mean: along the way from joint to joint, or by volume.
        hottest_degC: hottest element.
        across_K: largest difference from one side of a leg to the other; None for other parts.
        growth_m: of a leg, from joint to joint; of a platform, of its greatest half-width between U-joint centres;
            None for parts whose growth moves nothing.
    """

    part: str
    mean_degC: float
    hottest_degC: float
    across_K: float | None = None
    growth_m: float | None = None


def part_temperatures(
    robot: PouringRobot, field: TemperatureField, expansion: ThermalExpansion
) -> list[PartTemperature]:
    """Return every part's temperatures and growth."""
    lengths, counted = field.exposure.lengths_m, field.between_joints > 0.0
    rows = []
    for k, i in enumerate(CHAINS):
        hottest = float(field.leg_elements_degC[k][counted[k]].max())
        across, growth = float(field.leg_difference_K[k]), float(expansion.leg_strain[k] * lengths[k])
        rows.append(PartTemperature(f"leg{i}", float(field.leg_degC[k]), hottest, across, growth))
    for name, mean, elements, strain, centres in (
        (
            "platform",
            field.platform_degC,
            field.platform_elements_degC,
            expansion.platform_strain,
            robot.kinematics.moving_centres_m,
        ),
        (
            "fixed_platform",
            field.fixed_platform_degC,
            field.fixed_platform_elements_degC,
            expansion.fixed_platform_strain,
            robot.kinematics.fixed_centres_m,
        ),
    ):
        growth = strain * float(np.abs(centres).max())
        rows.append(PartTemperature(name, mean, float(elements.max()), None, growth))
    if field.cladding_degC.size:
        rows.append(PartTemperature("cladding", float(field.cladding_degC.mean()), float(field.cladding_degC.max())))
    rows.append(PartTemperature("ladle_shell", field.shell_degC, field.shell_degC))
    return rows


@dataclass(frozen=True, eq=False)
class PoseHeat:
    """A pose under heat.

    Attributes:
        pose: the commanded pose.
        field: temperatures.
        parts: by part, and how much each grows.
        moved: by how much heat alone moves each reported frame.
        bending: of the legs.
        lever_m: distance of the lip from the tilt axis, by which bending's tilt error counts.
        accuracy_m: required of the robot.
    """

    pose: PlatformPose
    field: TemperatureField
    parts: list[PartTemperature]
    moved: dict[str, PoseDifference]
    bending: LegBending
    lever_m: float
    accuracy_m: float

    @classmethod
    def of(cls, heated: HeatedRobot, pose: PlatformPose) -> PoseHeat:
        """Find it.

        Args:
            heated: the drawing, with its heat.
            pose: the commanded pose.

        Raises:
            NoSolutionError: the warm drawing cannot take the pose, or no temperatures are found.
        """
        found = heated.locate(pose)
        field, robot = found.state.field, heated.robot
        if field is None:
            raise ValueError("a cold robot has no temperatures")
        moved = {frame: found.location.difference(frame) for frame in found.location.loops.reported_frames}
        lip = found.location.nominal.pose(found.location.loops.end_frame or "", found.location.loops.working_frame)
        lever = float(np.hypot(lip.translation[0], lip.translation[2]))
        parts = part_temperatures(robot, field, found.state.robot.expansion)
        return cls(pose, field, parts, moved, LegBending.of(field), lever, robot.layout.accuracy_m)

    @property
    def bending_matters(self) -> bool:
        """Whether bending of leg 4 moves the lip by more than a tenth of the required accuracy."""
        return self.bending.matters(self.lever_m, self.accuracy_m)

    def figures(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        x, y, z, tilt = self.pose.to_mm_deg()
        balance = self.field.balance
        return {
            "pose": {"x_mm": x, "y_mm": y, "z_mm": z, "tilt_deg": tilt},
            "parts": {
                row.part: {
                    "mean_degC": row.mean_degC,
                    "hottest_degC": row.hottest_degC,
                    "across_K": row.across_K,
                    "growth_mm": None if row.growth_m is None else row.growth_m / MM,
                }
                for row in self.parts
            },
            "moved": {frame: difference_figures(difference) for frame, difference in self.moved.items()},
            "heat_W": {
                "from_melt_by_contact": balance.melt_conduction_W,
                "from_melt_by_radiation": balance.melt_radiation_W,
                "to_surroundings_by_air": balance.ambient_film_W,
                "to_surroundings_by_radiation": balance.ambient_radiation_W,
                "stored": balance.stored_W,
            },
            "bending": {
                "bow_mm": (self.bending.bow_m / MM).tolist(),
                "tilt_error_mrad": self.bending.tilt_error_rad / MRAD,
                "matters": self.bending_matters,
            },
        }

    def csv(self) -> str:
        """Return one row an element of the legs and platforms: where it is and how warm."""
        rows: list[list[Any]] = []
        field = self.field
        for k, i in enumerate(CHAINS):
            rods = ["moving_rod"] * field.grid.moving + ["fixed_rod"] * field.grid.fixed
            values = zip(rods, field.leg_positions_m[k], field.leg_elements_degC[k], strict=True)
            rows += [[f"leg{i}", rod, f"{place / MM:.6g}", f"{value:.6f}"] for rod, place, value in values]
        for name, elements in (
            ("platform", field.platform_elements_degC),
            ("fixed_platform", field.fixed_platform_elements_degC),
        ):
            rows += [[name, f"cell_{n}", "", f"{value:.6f}"] for n, value in enumerate(elements, start=1)]
        return _csv(["part", "element", "from_upper_joint_mm", "temperature_degC"], rows)


@dataclass(frozen=True, eq=False)
class ShiftHeat:
    """Temperatures and deformation over time. Arrays have k rows, one a time.

    Attributes:
        times_s: shape (k,).
        melt_degC, ambient_degC: shape (k,).
        leg_degC: mean of each leg, shape (k, 4).
        platform_degC, fixed_platform_degC, shell_degC, hottest_degC: shape (k,); the last over all leg elements.
        moved: by how much heat alone moves end frame and lip, at the pose held, by frame, k entries each.
        poses: the pose held at each time.
    """

    times_s: FloatArray
    melt_degC: FloatArray
    ambient_degC: FloatArray
    leg_degC: FloatArray
    platform_degC: FloatArray
    fixed_platform_degC: FloatArray
    shell_degC: FloatArray
    hottest_degC: FloatArray
    moved: dict[str, list[PoseDifference]]
    poses: list[PlatformPose]

    @classmethod
    def of(
        cls,
        robot: PouringRobot,
        network: ThermalNetwork,
        history: HeatHistory,
        schedule: PoseSchedule,
        times_s: FloatArray,
        measured_degC: dict[str, float] | None = None,
    ) -> ShiftHeat:
        """Follow a history.

        Args:
            robot: the drawing.
            network: its thermal network.
            history: melt and ambient temperature; the robot begins as warm as the surroundings.
            schedule: the poses held.
            times_s: when to report.
            measured_degC: measured temperatures that replace computed ones, by part.

        Raises:
            HistoryError: a time or a pose lies outside the history.
            NoSolutionError: the warm drawing cannot take a pose, or no temperatures are found.
        """
        found = simulate(network, history, schedule, times_s=times_s).fields
        held = [_as_pose(schedule.at(float(time))) for time in times_s]
        loops = robot.nominal_solver.mechanism.loops
        frames = (loops.end_frame or "", loops.working_frame)
        moved: dict[str, list[PoseDifference]] = {frame: [] for frame in frames}
        for pose, field in zip(held, found, strict=True):
            warm = solve_heated(robot, ThermalExpansion.from_field(field, measured_degC), pose)
            cold = robot.nominal_solver.solve(robot.kinematics.inverse(pose), robot.kinematics.configuration(pose))
            for frame in frames:
                nominal, actual = (result.pose(loops.base_frame, frame) for result in (cold, warm))
                moved[frame].append(PoseDifference.between(nominal, actual))
        ambient = np.interp(times_s, history.times_s, history.ambient_degC)
        return cls(
            times_s,
            np.interp(times_s, history.times_s, history.melt_degC),
            ambient,
            np.array([field.leg_degC for field in found]),
            np.array([field.platform_degC for field in found]),
            np.array([field.fixed_platform_degC for field in found]),
            np.array([field.shell_degC for field in found]),
            np.array([field.leg_elements_degC.max() for field in found]),
            moved,
            held,
        )

    def only(self, times_s: FloatArray) -> ShiftHeat:
        """Return the same at some of its times."""
        kept = np.flatnonzero(np.isin(self.times_s, times_s))
        arrays = {f.name: getattr(self, f.name)[kept] for f in fields(self) if f.name not in ("moved", "poses")}
        moved = {frame: [values[k] for k in kept] for frame, values in self.moved.items()}
        return replace(self, **arrays, moved=moved, poses=[self.poses[k] for k in kept])

    def rows(self) -> Iterator[dict[str, float]]:
        """Return one row a time, with units in the names."""
        end, lip = self.moved
        for k, time in enumerate(self.times_s):
            x, y, z, tilt = self.poses[k].to_mm_deg()
            row = {"time_min": float(time) / 60.0, "melt_degC": self.melt_degC[k], "ambient_degC": self.ambient_degC[k]}
            row |= {"x_mm": x, "y_mm": y, "z_mm": z, "tilt_deg": tilt}
            row |= {f"leg{i}_degC": self.leg_degC[k, i - 1] for i in CHAINS}
            row |= {"platform_degC": self.platform_degC[k], "fixed_platform_degC": self.fixed_platform_degC[k]}
            row |= {"ladle_shell_degC": self.shell_degC[k], "hottest_leg_element_degC": self.hottest_degC[k]}
            for name, value in zip("xyz", self.moved[end][k].translation_m, strict=True):
                row[f"{end}_moved_{name}_mm"] = value / MM
            row[f"{end}_moved_mm"] = self.moved[end][k].distance_m / MM
            row[f"{lip}_moved_mm"] = self.moved[lip][k].distance_m / MM
            row["tilt_moved_mrad"] = float(self.moved[end][k].rotation_rad[1]) / MRAD
            yield {name: float(value) for name, value in row.items()}

    def csv(self) -> str:
        """Return one row a time."""
        rows = list(self.rows())
        return _csv(list(rows[0]), [[f"{value:.9g}" for value in row.values()] for row in rows])


def drawing_of(robot: PouringRobot) -> PouringRobot:
    """Return the robot of the drawing of the same layout: no geometric errors, no drive offsets, no loads."""
    bare = robot.model.model_copy(update={"joint_placements": {}, "drive_offsets": {}})
    return PouringRobot(bare, options=robot.actual_solver.options)


def heated_drawing(robot: PouringRobot, heat: HeatSection, *, radiation: bool = True) -> HeatedRobot:
    """Return the drawing of a robot with heat, with or without radiation.

    Raises:
        BadInputError: the properties do not fit the layout.
    """
    drawing = drawing_of(robot)
    return HeatedRobot(drawing, heat, ThermalNetwork(drawing, heat.thermal_properties(), radiation=radiation))


def _as_pose(place: Placed) -> PlatformPose:
    return place if isinstance(place, PlatformPose) else PlatformPose.from_se3(place.pose_base_to_end)


def _csv(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return stream.getvalue()
