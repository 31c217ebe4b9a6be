"""What a melt does to a robot: temperatures and deformation at a pose, and over a shift, as results with tables.

Deformation is that of the drawing: heat alone, no geometric errors.
"""

# ruff: noqa: N815 - units keep their capitals: K, W, degC
from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pouring_robot.io.files import write_whole
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD, PoseDifference, bodies_at
from pouring_robot.report.result import Result
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location_figures import difference_figures
from pouring_robot.robot.pouring.names import CHAINS, LEGS
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.growth import LegBending, ThermalExpansion
from pouring_robot.thermal.expansion.heated_robot import HeatedRobot, WarmRobot, drawing_of
from pouring_robot.thermal.network.assembly import ThermalNetwork
from pouring_robot.thermal.network.field import TemperatureField
from pouring_robot.thermal.network.history import HeatHistory, PoseSchedule
from pouring_robot.thermal.network.transient import simulate

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class PartTemperature:
    """One part."""

    part: str  # its name
    mean_degC: float  # along the way from joint to joint, or by volume
    hottest_degC: float  # hottest element
    across_K: float | None = None  # largest difference from one side of a leg to the other; None for other parts
    # of a leg, from joint to joint; of a platform's greatest half-width between U-joint centres; None: moves nothing
    growth_mm: float | None = None

    def figures(self) -> dict[str, float | None]:
        """Return its figures."""
        return {name: value for name, value in vars(self).items() if name != "part"}


def part_temperatures(
    robot: PouringRobot, field: TemperatureField, expansion: ThermalExpansion
) -> list[PartTemperature]:
    """Return every part's temperatures and growth."""
    hottest = np.max(field.leg_elements_degC, axis=1, where=field.between_joints > 0.0, initial=-np.inf)
    growth = np.array(expansion.leg_strain) * field.exposure.lengths_m / MM
    legs = zip(LEGS, *(v.tolist() for v in (field.leg_degC, hottest, field.leg_difference_K, growth)), strict=True)
    parts, kinematics = [PartTemperature(*leg) for leg in legs], robot.kinematics
    growth = expansion.platform_strain * np.abs(kinematics.moving_centres_m).max() / MM
    hottest = field.platform_elements_degC.max()
    parts.append(PartTemperature("platform", field.platform_degC, float(hottest), None, float(growth)))
    growth = expansion.fixed_platform_strain * np.abs(kinematics.fixed_centres_m).max() / MM
    hottest = field.fixed_platform_elements_degC.max()
    parts.append(PartTemperature("fixed_platform", field.fixed_platform_degC, float(hottest), None, float(growth)))
    if field.cladding_degC.size:
        parts.append(PartTemperature("cladding", float(field.cladding_degC.mean()), float(field.cladding_degC.max())))
    return [*parts, PartTemperature("ladle_shell", field.shell_degC, field.shell_degC)]


@dataclass(frozen=True, eq=False, repr=False)
class PoseHeat(Result):
    """A pose under heat."""

    pose: PlatformPose  # the commanded pose
    field: TemperatureField
    parts: list[PartTemperature]
    moved: dict[str, PoseDifference]  # by how much heat alone moves each reported frame; the last is the lip
    bending: LegBending  # of the legs
    lever_m: float  # distance of the lip from the tilt axis, by which bending's tilt error counts
    accuracy_m: float  # required of the robot

    @classmethod
    def of(cls, heated: HeatedRobot, pose: PlatformPose) -> PoseHeat:
        """Find it for the drawing, with its heat, at a commanded pose.

        Raises:
            NoSolutionError: the warm drawing cannot take the pose, or no temperatures are found.
        """
        state = heated.locate(pose)
        field, robot, location = state.field, heated.robot, state.location
        if field is None:
            raise ValueError("a cold robot has no temperatures")
        loops = location.loops
        moved = {frame: location.difference(frame) for frame in loops.reported_frames}
        lip = location.nominal.pose(loops.end_frame or "", loops.working_frame)
        lever = float(np.hypot(lip.translation[0], lip.translation[2]))
        parts = part_temperatures(robot, field, state.robot.expansion)
        return cls(pose, field, parts, moved, LegBending.of(field), lever, robot.layout.accuracy_m)

    @property
    def headline(self) -> str:
        """How warm the legs are and how far that moves the lip, on one line."""
        legs = ", ".join(f"{value:.0f}" for value in self.field.leg_degC)
        frame, lip = list(self.moved.items())[-1]
        moved = f"heat alone moves '{frame}' by {lip.distance_m / MM:.3f} mm against the fixed platform"
        return f"legs at {legs} degC; {moved}"

    @property
    def bending_matters(self) -> bool:
        """Whether bending of leg 4 moves the lip by more than a tenth of the required accuracy."""
        return self.bending.matters(self.lever_m, self.accuracy_m)

    def to_frame(self) -> pd.DataFrame:
        """Return one row a part."""
        import pandas as pd

        return pd.DataFrame(self.parts)

    def elements(self) -> pd.DataFrame:
        """Return one row an element of legs and platforms: where it is (NaN in platforms) and how warm."""
        import pandas as pd

        field = self.field
        rods = ["moving_rod"] * field.bodies.grid.moving + ["fixed_rod"] * field.bodies.grid.fixed
        rows: list[tuple[str, str, float, float]] = []
        for k, i in enumerate(CHAINS):
            values = zip(rods, field.exposure.from_upper_joint_m[k] / MM, field.leg_elements_degC[k], strict=True)
            rows += [(f"leg{i}", rod, place, value) for rod, place, value in values]
        platforms = {"platform": field.platform_elements_degC, "fixed_platform": field.fixed_platform_elements_degC}
        for part, cells in platforms.items():
            rows += [(part, f"cell_{n}", np.nan, value) for n, value in enumerate(cells, start=1)]
        return pd.DataFrame(rows, columns=["part", "element", "from_upper_joint_mm", "temperature_degC"])

    def save(self, path: Path | str) -> Path:
        """Write every element as CSV.

        Raises:
            OutputError: the file cannot be written.
        """
        table = self.elements()
        table["from_upper_joint_mm"] = table["from_upper_joint_mm"].map("{:.6g}".format, na_action="ignore")
        return write_whole(path, table.to_csv(index=False, float_format="%.6f", lineterminator="\n"))

    def figures(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        x, y, z, tilt = self.pose.to_mm_deg()
        balance = self.field.balance
        return {
            "pose": {"x_mm": x, "y_mm": y, "z_mm": z, "tilt_deg": tilt},
            "parts": {one.part: one.figures() for one in self.parts},
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


@dataclass(frozen=True, eq=False, repr=False)
class ShiftHeat(Result):
    """Temperatures and deformation over time; k entries, one a time."""

    times_s: FloatArray  # shape (k,)
    history: HeatHistory
    fields: list[TemperatureField]
    poses: list[PlatformPose]  # held then
    moved: dict[str, list[PoseDifference]]  # by how much heat alone moves end frame and lip, at the pose held, by frame
    # where the joints of the cold and of the warm drawing stand in the world, (k, 2, joints, 4, 4), in m
    bodies: FloatArray

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
        """Follow a history of the drawing, which begins as warm as the surroundings; report at times.

        ``measured_degC``: measured temperatures that replace computed ones, by part.

        Raises:
            HistoryError: a time or a pose lies outside the history.
            NoSolutionError: the warm drawing cannot take a pose, or no temperatures are found.
        """
        found = simulate(network, history, schedule, times_s=times_s)
        places = (schedule.at(float(time)) for time in times_s)
        held = [p if isinstance(p, PlatformPose) else PlatformPose.from_se3(p.pose_base_to_end) for p in places]
        loops = robot.nominal_solver.mechanism.loops
        frames = (loops.end_frame or "", loops.working_frame)
        moved, bodies = {frame: list[PoseDifference]() for frame in frames}, []
        for pose, field in zip(held, found, strict=True):
            warm = WarmRobot(robot, ThermalExpansion.from_field(field, measured_degC), pose).solve()
            cold = robot.nominal_solver.solve(robot.kinematics.inverse(pose), robot.kinematics.configuration(pose))
            for frame in frames:
                nominal, actual = (result.pose(loops.base_frame, frame) for result in (cold, warm))
                moved[frame].append(PoseDifference.between(nominal, actual))
            bodies.append([bodies_at(one.mechanism.shared_model, [one.configuration])[0] for one in (cold, warm)])
        return cls(times_s, history, list(found), held, moved, np.array(bodies))

    def only(self, times_s: FloatArray) -> ShiftHeat:
        """Return the same at some of its times."""
        kept = np.flatnonzero(np.isin(self.times_s, times_s))
        fields, poses = [self.fields[k] for k in kept], [self.poses[k] for k in kept]
        moved = {frame: [values[k] for k in kept] for frame, values in self.moved.items()}
        times_s, bodies = self.times_s[kept], self.bodies[kept]
        return replace(self, times_s=times_s, fields=fields, poses=poses, moved=moved, bodies=bodies)

    @property
    def headline(self) -> str:
        """How warm the legs get and how far that moves the lip at most, on one line."""
        frame, lip = list(self.moved.items())[-1]
        hottest = max(float(field.leg_degC.max()) for field in self.fields)
        farthest = max(difference.distance_m for difference in lip) / MM
        hours = (self.times_s[-1] - self.times_s[0]) / 3600.0
        return f"{hours:.3g} h: legs up to {hottest:.0f} degC; heat alone moves '{frame}' by up to {farthest:.3f} mm"

    def to_frame(self) -> pd.DataFrame:
        """Return one row a time, with units in the names."""
        import pandas as pd

        (end, at_end), (lip, at_lip) = self.moved.items()
        history, fields = self.history, self.fields
        columns: dict[str, Any] = {
            "time_min": self.times_s / 60.0,
            "melt_degC": np.interp(self.times_s, history.times_s, history.melt_degC),
            "ambient_degC": np.interp(self.times_s, history.times_s, history.ambient_degC),
        }
        poses = np.array([pose.to_mm_deg() for pose in self.poses])
        columns |= dict(zip(("x_mm", "y_mm", "z_mm", "tilt_deg"), poses.T, strict=True))
        legs = np.array([field.leg_degC for field in fields])
        columns |= {f"leg{i}_degC": legs[:, k] for k, i in enumerate(CHAINS)}
        columns["platform_degC"] = [field.platform_degC for field in fields]
        columns["fixed_platform_degC"] = [field.fixed_platform_degC for field in fields]
        columns["ladle_shell_degC"] = [field.shell_degC for field in fields]
        columns["hottest_leg_element_degC"] = [field.leg_elements_degC.max() for field in fields]
        for k, axis in enumerate("xyz"):
            columns[f"{end}_moved_{axis}_mm"] = [difference.translation_m[k] / MM for difference in at_end]
        columns[f"{end}_moved_mm"] = [difference.distance_m / MM for difference in at_end]
        columns[f"{lip}_moved_mm"] = [difference.distance_m / MM for difference in at_lip]
        columns["tilt_moved_mrad"] = [difference.rotation_rad[1] / MRAD for difference in at_end]
        return pd.DataFrame(columns)

    def save(self, path: Path | str) -> Path:
        """Write one row a time as CSV.

        Raises:
            OutputError: the file cannot be written.
        """
        return write_whole(path, self.to_frame().to_csv(index=False, float_format="%.9g", lineterminator="\n"))

    def figures(self) -> dict[str, Any]:
        """Return every row, ready for JSON."""
        return {"rows": self.to_frame().to_dict("records")}


def heated_drawing(robot: PouringRobot, heat: HeatSection, *, radiation: bool = True) -> HeatedRobot:
    """Return the drawing of a robot with heat, with or without radiation.

    Raises:
        BadInputError: the properties do not fit the layout.
    """
    drawing = drawing_of(robot)
    return HeatedRobot(drawing, heat, ThermalNetwork(drawing, heat.thermal_properties(), radiation=radiation))
