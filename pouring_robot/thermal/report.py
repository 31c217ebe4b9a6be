"""Effects of the melt on a robot: temperatures and deformation at a pose, and over a shift, as results with tables.

Deformation is that of the nominal robot: heat alone, no geometric errors. NoSolutionError is raised where the warm
nominal robot cannot reach a pose, or no temperatures are found.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from pouring_robot.io.files import write_whole
from pouring_robot.io.tables import csv_text
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.poses import PoseDifference, bodies_at
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.report.result import Result
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location_figures import difference_figures
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.pouring.platform_pose import POSE_COLUMNS, PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.leg_growth import LegBending, ThermalExpansion
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, WarmRobot, drawing_of
from pouring_robot.thermal.network.history import HeatHistory, PoseSchedule
from pouring_robot.thermal.network.temperature_field import TemperatureField
from pouring_robot.thermal.network.thermal_network import ThermalNetwork, simulate


def part_figures(
    robot: PouringRobot, field: TemperatureField, expansion: ThermalExpansion
) -> dict[str, dict[str, float | None]]:
    """Return the temperatures and the growth of every part, by name.

    Means are along the path from joint to joint, or by volume; ``across_K`` is the largest difference between opposite
    sides of a leg. Growth is that of a leg from joint to joint, or of a platform's largest half-width between U-joint
    centres. Figures that a part does not have are None.
    """
    hottest = np.max(field.leg_elements_degC, axis=1, where=field.between_joints > 0.0, initial=-np.inf)
    strain = np.array(expansion.leg_strain)
    growth = strain * field.exposure.lengths_m / (1.0 + strain) / MM  # this length is the expanded one
    legs = zip(*(v.tolist() for v in (field.leg_degC, hottest, field.leg_difference_K, growth)), strict=True)
    found: dict[str, tuple[float | None, ...]] = dict(zip(LEGS, legs, strict=True))
    growth = expansion.platform_strain * np.abs(robot.kinematics.moving_centres_m).max() / MM
    found["platform"] = field.platform_degC, float(field.platform_elements_degC.max()), None, float(growth)
    growth = expansion.fixed_platform_strain * np.abs(robot.kinematics.fixed_centres_m).max() / MM
    hottest = field.fixed_platform_elements_degC.max()
    found["fixed_platform"] = field.fixed_platform_degC, float(hottest), None, float(growth)
    if field.cladding_degC.size:
        found["cladding"] = float(field.cladding_degC.mean()), float(field.cladding_degC.max()), None, None
    found["ladle_shell"] = field.shell_degC, field.shell_degC, None, None
    names = ("mean_degC", "hottest_degC", "across_K", "growth_mm")
    return {part: dict(zip(names, values, strict=True)) for part, values in found.items()}


@dataclass(frozen=True, eq=False, repr=False)
class PoseHeat(Result):
    """A pose under heat."""

    pose: PlatformPose  # the commanded pose
    field: TemperatureField
    parts: dict[str, dict[str, float | None]]  # as :func:`part_figures` returns them
    moved: dict[str, PoseDifference]  # displacement of each reported frame by heat alone; the last is the lip
    bending: LegBending  # of the legs
    bent: FloatArray  # displacement of the lip by bending, from G, shape (6,): x, y, z (m), rotation vector (rad)
    accuracy_m: float  # required accuracy of the robot

    @classmethod
    def of(cls, heated: HeatedRobot, pose: PlatformPose) -> Self:
        """Compute it for the nominal robot, with its heat, at a commanded pose."""
        state = heated.locate(pose)
        field, robot, location = state.field, heated.robot, state.location
        if field is None:
            raise ValueError("a cold robot has no temperatures")
        loops = location.loops
        moved = {frame: location.difference(frame) for frame in loops.reported_frames}
        bending, solver = LegBending.of(field), state.robot.actual_solver
        *_, tilt_drive = drive_parameters(solver.mechanism)
        lip_by_drive = closed_chain_transfer(solver, state.result, [tilt_drive], loops.working_frame).matrix[:, 0]
        parts = part_figures(robot, field, state.robot.expansion)
        bent = lip_by_drive * bending.tilt_drive_offset_rad
        return cls(pose, field, parts, moved, bending, bent, robot.accuracy_m)

    @property
    def headline(self) -> str:
        """Temperatures of the legs and displacement of the lip by heat, on one line."""
        legs = ", ".join(f"{value:.0f}" for value in self.field.leg_degC)
        frame, lip = list(self.moved.items())[-1]
        moved = f"heat alone moves '{frame}' by {lip.distance_m / MM:.3f} mm relative to the fixed platform"
        return f"legs at {legs} degC; {moved}"

    @property
    def bending_tilt_rad(self) -> float:
        """How far bending of leg 4 would rotate the ladle about y."""
        return float(self.bent[4])

    @property
    def bending_lip_m(self) -> float:
        """How far bending of leg 4 would move the lip."""
        return float(np.linalg.norm(self.bent[:3]))

    @property
    def bending_matters(self) -> bool:
        """Whether bending of leg 4 would move the lip by more than a tenth of the required accuracy."""
        return self.bending_lip_m > 0.1 * self.accuracy_m

    def _table(self) -> Any:
        """One row per part."""
        return [{"part": part, **figures} for part, figures in self.parts.items()]

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write every element of legs and platforms as CSV: its position (empty for platforms) and temperature.

        Raises OutputError where that is impossible, or the file exists already and ``overwrite`` is not set.
        """
        field = self.field
        rods = ["moving_rod"] * field.bodies.grid.moving + ["fixed_rod"] * field.bodies.grid.fixed
        rows: list[tuple[str, str, str, str]] = []
        for k, leg in enumerate(LEGS):
            values = zip(rods, field.exposure.from_upper_joint_m[k] / MM, field.leg_elements_degC[k], strict=True)
            rows += [(leg, rod, f"{place:.6g}", f"{value:.6f}") for rod, place, value in values]
        platforms = {"platform": field.platform_elements_degC, "fixed_platform": field.fixed_platform_elements_degC}
        for part, cells in platforms.items():
            rows += [(part, f"cell_{n}", "", f"{value:.6f}") for n, value in enumerate(cells, start=1)]
        headings = "part", "element", "from_upper_joint_mm", "temperature_degC"
        return write_whole(path, csv_text(headings, rows), overwrite=overwrite)

    def figures(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        balance = self.field.balance
        return {
            "pose": self.pose.figures(),
            "parts": self.parts,
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
                "tilt_error_mrad": self.bending_tilt_rad / MRAD,
                "lip_mm": self.bending_lip_m / MM,
                "matters": self.bending_matters,
            },
        }


@dataclass(frozen=True, eq=False, repr=False)
class ShiftHeat(Result):
    """Temperatures and deformation over time; k entries, one per time."""

    times_s: FloatArray  # shape (k,)
    history: HeatHistory
    fields: list[TemperatureField]
    poses: list[PlatformPose]  # held then
    moved: dict[str, list[PoseDifference]]  # displacements of end frame and lip by heat alone, at the held pose
    # poses in the world of the joints of the cold and of the warm nominal robot, (k, 2, joints, 4, 4), in m
    bodies: FloatArray

    @classmethod
    def of(
        cls,
        robot: PouringRobot,
        network: ThermalNetwork,
        history: HeatHistory,
        schedule: PoseSchedule,
        times_s: FloatArray,
    ) -> Self:
        """Simulate a history of the nominal robot, initially at the temperature of the surroundings; report at times.

        Measured temperatures in a heat section hold for one moment, so they are not used. Times and poses outside the
        history raise HistoryError.
        """
        found = simulate(network, history, schedule, times_s=times_s)
        places = (schedule.at(float(time)) for time in times_s)
        held = [p if isinstance(p, PlatformPose) else PlatformPose.from_se3(p.pose_base_to_end) for p in places]
        loops = robot.nominal_solver.mechanism.loops
        frames = (loops.end_frame or "", loops.working_frame)
        moved, bodies = {frame: list[PoseDifference]() for frame in frames}, []
        for pose, field in zip(held, found, strict=True):
            warm = WarmRobot(robot, ThermalExpansion.from_field(field), pose).solve()
            cold = robot.nominal_solver.solve(robot.kinematics.inverse(pose), robot.kinematics.configuration(pose))
            for frame in frames:
                nominal, actual = (result.pose(loops.base_frame, frame) for result in (cold, warm))
                moved[frame].append(PoseDifference.between(nominal, actual))
            bodies.append([bodies_at(one.mechanism.shared_model, [one.configuration])[0] for one in (cold, warm)])
        return cls(times_s, history, list(found), held, moved, np.array(bodies))

    def only(self, times_s: FloatArray) -> Self:
        """Return the same for some of its times."""
        kept = np.flatnonzero(np.isin(self.times_s, times_s))
        fields, poses = [self.fields[k] for k in kept], [self.poses[k] for k in kept]
        moved = {frame: [values[k] for k in kept] for frame, values in self.moved.items()}
        times_s, bodies = self.times_s[kept], self.bodies[kept]
        return replace(self, times_s=times_s, fields=fields, poses=poses, moved=moved, bodies=bodies)

    @property
    def headline(self) -> str:
        """Highest temperature of the legs and largest displacement of the lip by heat, on one line."""
        frame, lip = list(self.moved.items())[-1]
        hottest = max(float(field.leg_degC.max()) for field in self.fields)
        farthest = max(difference.distance_m for difference in lip) / MM
        hours = (self.times_s[-1] - self.times_s[0]) / 3600.0
        return f"{hours:.3g} h: legs up to {hottest:.0f} degC; heat alone moves '{frame}' by up to {farthest:.3f} mm"

    def _table(self) -> Any:
        """One row per time, with units in the names."""
        (end, at_end), (lip, at_lip) = self.moved.items()
        history, fields = self.history, self.fields
        poses = np.array([pose.to_mm_deg() for pose in self.poses])
        legs = np.array([field.leg_degC for field in fields])
        columns: dict[str, Any] = {
            "time_min": self.times_s / 60.0,
            "melt_degC": np.interp(self.times_s, history.times_s, history.melt_degC),
            "ambient_degC": np.interp(self.times_s, history.times_s, history.ambient_degC),
            **dict(zip(POSE_COLUMNS, poses.T, strict=True)),
            **{f"{leg}_degC": legs[:, k] for k, leg in enumerate(LEGS)},
            "platform_degC": [field.platform_degC for field in fields],
            "fixed_platform_degC": [field.fixed_platform_degC for field in fields],
            "ladle_shell_degC": [field.shell_degC for field in fields],
            "hottest_leg_element_degC": [field.leg_elements_degC.max() for field in fields],
        }
        for k, axis in enumerate("xyz"):
            columns[f"{end}_moved_{axis}_mm"] = [difference.translation_m[k] / MM for difference in at_end]
        columns[f"{end}_moved_mm"] = [difference.distance_m / MM for difference in at_end]
        columns[f"{lip}_moved_mm"] = [difference.distance_m / MM for difference in at_lip]
        columns["tilt_moved_mrad"] = [difference.rotation_rad[1] / MRAD for difference in at_end]
        return columns

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write one row per time as CSV.

        Raises OutputError where that is impossible, or the file exists already and ``overwrite`` is not set.
        """
        table = self.to_frame().to_csv(index=False, float_format="%.9g", lineterminator="\n")
        return write_whole(path, table, overwrite=overwrite)

    def figures(self) -> dict[str, Any]:
        """Return every row, ready for JSON."""
        return {"rows": self.to_frame().to_dict("records")}


def heated_drawing(robot: PouringRobot, heat: HeatSection, *, radiation: bool = True) -> HeatedRobot:
    """Return the nominal robot of a robot with heat, with or without radiation."""
    drawing = drawing_of(robot)
    return HeatedRobot(drawing, heat, ThermalNetwork(drawing, heat.thermal_properties(), radiation=radiation))
