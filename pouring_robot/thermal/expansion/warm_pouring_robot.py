"""The robot as built under the heat of its melt: temperatures at the ladle's actual pose, and the resulting pose.

Temperatures depend on the pose and the pose on temperatures. Both are computed alternately, temperatures at a closure
and the closure at these temperatures, until an iteration no longer moves the ladle. Within a closure temperatures are
constant. The movement in the last iteration is reported.

Along a path all poses are closed at once. To compensate, temperatures are computed once per pose, at the wanted pose.
To locate, they are computed twice: at the commanded pose, shared between nearby poses, then at the actual pose. Those
of one pose are the start for the next. The lengths of legs are taken from the drawing at that pose; the actual lengths
differ by millimetres, which is about a kelvin.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from pouring_robot.batch.records import BatchClosure, BatchStart
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.argument_checks import as_tuple, expect, whole
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import LocalParameter, drive_parameters
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.mechanism.rotations import tilts
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.location import LadleLocation, as_poses
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Command
from pouring_robot.thermal.expansion.leg_growth import ThermalExpansion, growth_of_drives
from pouring_robot.thermal.expansion.truss import TrussNetwork, TrussTemperatures
from pouring_robot.thermal.network.heat_balance import SOLVER
from pouring_robot.thermal.network.history import HeatHistory, Placed
from pouring_robot.thermal.network.temperature_field import TemperatureField
from pouring_robot.thermal.network.thermal_network import ThermalNetwork, simulate

if TYPE_CHECKING:
    import xarray as xr

SETTLED_M = 1e-10
"""The iteration of temperatures and closure ends when it moves the platform's origin by less."""
MOST_TURNS = 12
# Over these metres and radians a leg's expansion changes by 10 µm, which moves the ladle by a tenth of a millimetre
# where it is weak; leg temperatures there differ by a thirtieth of a kelvin, which moves the lip by less than 10 µm.
_STANDS_IN = 0.005


class WarmRobot(PouringRobot):
    """The robot as built, its parts expanded by heat: a :class:`PouringRobot` that is warm.

    Heat is applied first and the geometric error in the joint's displaced frame, so that a U-joint centre is at its
    expanded nominal position plus its offset. The value of a leg's prismatic joint is its expanded length; ``pose`` is
    the one that :meth:`solve` commands.
    """

    def __init__(self, robot: PouringRobot, expansion: ThermalExpansion, pose: PlatformPose) -> None:
        expect(expansion, ThermalExpansion, "the growth of the parts is a ThermalExpansion")
        # Not super().__init__: model, nominal solver and kinematics are the given robot's; building them takes time.
        self.__dict__.update(vars(robot))
        self.expansion, self.pose = expansion, pose
        mechanism = robot.kinematics.mechanism.with_stiffness(robot.actual_solver.mechanism.loops.stiffness)
        for errors in (expansion.placements(robot.kinematics), robot.model.displacements()):
            mechanism = mechanism.displaced(errors)
        self.actual_solver = ClosureSolver(mechanism, robot.actual_solver.energy.loads, robot.actual_solver.options)
        growth = growth_of_drives(np.array([expansion.leg_strain]), mechanism.loops.drives)[0]
        self._growth = dict(zip(mechanism.loops.drives, growth.tolist(), strict=True))

    def actual_drive_values(self, drives: FloatArray) -> FloatArray:
        """Like that of every robot: command plus offset, then expanded with the leg."""
        return np.asarray(super().actual_drive_values(drives) * list(self._growth.values()))

    def built_as(self, model: RobotModel) -> Self:
        """Like that of every robot, with the same thermal expansion."""
        return type(self)(super().built_as(model), self.expansion, self.pose)

    def transfer(
        self, command: Command, parameters: str | Sequence[str | LocalParameter] = "geometry", frame: str | None = None
    ) -> xr.DataArray:
        """Like that of every robot; the error of a drive expands with its leg."""
        found = super().transfer(command, parameters, frame)
        growth = {drive.name: self._growth[drive.joint] for drive in drive_parameters(self.actual_solver.mechanism)}
        return found.copy(data=found.values * [growth.get(name, 1.0) for name in found.parameter.values.tolist()])

    def solve(self) -> ClosureResult:
        """Close the robot at the drive values that a controller commands for its pose; raises like other commands."""
        return self.actual_of(self.pose)


def drawing_of(robot: PouringRobot) -> PouringRobot:
    """Return the nominal robot of the same layout: no geometric errors, drive offsets, effects or loads."""
    nothing: dict[str, object] = {"heat": None, "effects": []}
    nothing |= {name: {} for name in ("joint_placements", "drive_offsets", "learned")}
    bare = robot.model.model_copy(update=nothing)
    return PouringRobot(bare, options=robot.actual_solver.options)


Close = Callable[[WarmRobot], Sequence[ClosureResult]]
"""Closes a warm robot: first with the drive values of the last iteration, finally with those it then chooses."""


@dataclass(frozen=True, eq=False)
class WarmState:
    """Consistent temperatures and robot."""

    field: TemperatureField | None  # the temperatures; None for a cold robot
    robot: WarmRobot  # as built, at these temperatures
    result: ClosureResult  # its closure
    turns: int  # number of iterations, each with new temperatures
    unsettled_m: float  # how far the last temperatures moved the moving platform's origin, at constant drive values

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.location.headline}>"

    @functools.cached_property
    def location(self) -> LadleLocation:
        """Where the ladle should be and where the warm ladle is, with the robot's pose as command."""
        return self.robot.locate(self.robot.pose)


@dataclass(frozen=True)
class PoseShares:
    """Errors of a frame by geometry and by heat, alone and together: from the nominal pose, in the fixed platform.

    Geometry means errors, drive offsets and loads; heat alone acts on the drawing; together is the actual pose.
    """

    geometry: PoseDifference
    heat: PoseDifference
    together: PoseDifference

    @property
    def remainder(self) -> PoseDifference:
        """Difference from the sum: together - geometry - heat; for rotations it is of second order."""
        whole, geometry, heat = self.together, self.geometry, self.heat
        shift = whole.translation_m - geometry.translation_m - heat.translation_m
        return PoseDifference(shift, whole.rotation_rad - geometry.rotation_rad - heat.rotation_rad)


class HeatedRobot:
    """A robot as built, warmed by its melt.

    ``heat``: how warm it is; None: cold. ``network``: by default made when needed, from the robot and the properties in
    ``heat``; BadInputError is raised where these do not fit the layout, or for another robot than the pouring robot.
    Its methods raise ThermalSolutionError where no temperatures are found, UnreachablePoseError or ClosureError where
    the robot, warm or cold, cannot follow a command, UnknownFrameError for a frame that it does not have.
    """

    def __init__(
        self, robot: PouringRobot, heat: HeatSection | None = None, network: ThermalNetwork | None = None
    ) -> None:
        if not isinstance(robot, PouringRobot):
            raise BadInputError(
                f"only a PouringRobot is heated by its melt, but this is a {type(robot).__name__}; any robot is "
                "compensated by compensate_drives(robot, robot.location_at(drives))"
            )
        if isinstance(robot, WarmRobot):
            raise BadInputError("a WarmRobot is warm already: give the robot it was made of, and its heat")
        expect(heat, HeatSection | None, "heat is the HeatSection of a model, or None for a cold robot")
        self.robot, self.heat = robot, heat
        self._given_network = network

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {' '.join(*self.robot.model.named.items())}, {self.heat or 'cold'}>"

    def built_as(self, robot: PouringRobot) -> Self:
        """Return another robot of the same drawing under the same heat; the network is shared."""
        return self if robot is self.robot else type(self)(robot, self.heat, self.network)

    @functools.cached_property
    def network(self) -> ThermalNetwork:
        """The robot's thermal network, with the properties of the model file."""
        return self._given_network or ThermalNetwork(self.robot, (self.heat or HeatSection()).thermal_properties())

    @property
    def temperatures_degC(self) -> tuple[float, float]:
        """Temperatures of melt and surroundings."""
        heat = self.heat or HeatSection()
        melt, ambient = self.network.temperatures_K(heat.melt_degC, heat.ambient_degC)
        return melt - ZERO_CELSIUS_K, ambient - ZERO_CELSIUS_K

    def summary(self, computed: str = "") -> str:
        """Return a description of the heat, with the temperatures ``computed`` of parts, if any."""
        if self.heat is None:
            return "none, the robot is at the temperature of the drawing"
        melt, ambient = self.temperatures_degC
        minutes, measured = self.heat.after_min, self.heat.measured_degC
        when = "steady" if minutes is None else f"{minutes:g} min after the melt came"
        said = [f"melt {melt:g}, surroundings {ambient:g} degC, {when}"]
        if computed:
            said.append(f"{computed} computed" if measured else computed)
        if measured:
            parts = ", ".join(f"{part} {value:g}" for part, value in measured.items())
            said.append(f"measured instead: {parts} degC")
        return "; ".join(said)

    @property
    def after_s(self) -> float | None:
        """How long the melt has been there; None: the steady state."""
        return 60.0 * self.heat.after_min if self.heat and self.heat.after_min else None

    def field(
        self, pose: Placed, near: TemperatureField | None = None, solver: Mapping[str, Any] = SOLVER
    ) -> TemperatureField | None:
        """Return the temperatures at a held pose, or None for a cold robot; ``near``: as for the network."""
        if self.heat is None:
            return None
        if self.after_s is None:
            return self.network.steady(pose, *self.temperatures_degC, near)
        history = HeatHistory.constant(*self.temperatures_degC, self.after_s)
        return simulate(self.network, history, pose, solver=solver)[-1]

    def truss(self, state: WarmState) -> TrussTemperatures | None:
        """Return the temperatures of the truss over the robot in a state; None for a cold robot."""
        if state.field is None:
            return None
        network = TrussNetwork(self.network)
        return network.temperatures(state.result, state.field.melt_K, state.field.ambient_K, self.after_s)

    def expansion(self, field: TemperatureField | None) -> ThermalExpansion:
        """Return the thermal expansion of the parts; measured temperatures replace computed ones."""
        if field is None or self.heat is None:
            return ThermalExpansion()
        return ThermalExpansion.from_field(field, self.heat.measured_degC)

    def settle(self, pose: PlatformPose, close: Close) -> WarmState:
        """Compute temperatures and closure alternately, starting at a pose, until the ladle no longer moves.

        Raises:
            NoSolutionError: ``close`` raises it, or no temperatures are found.
        """
        place: Placed = pose
        field = None
        before, moved = np.full(3, np.inf), 0.0 if self.heat is None else np.inf
        for turns in range(1, MOST_TURNS + 1):
            field = self.field(place, field)
            warm = WarmRobot(self.robot, self.expansion(field), pose)
            found = close(warm)
            if self.heat is not None:
                moved = float(np.linalg.norm(found[0].pose_base_to_end.translation - before))
            place = result = found[-1]
            state = WarmState(field, warm, result, turns, moved)
            if moved < SETTLED_M:
                break
            before = np.array(result.pose_base_to_end.translation)
        return state

    def locate(self, pose: PlatformPose) -> WarmState:
        """Return the warm robot at a commanded pose; its ``location`` is that of the ladle."""
        drives = self.robot.kinematics.inverse(pose)
        return self.settle(pose, lambda warm: [warm.forward(drives, near=pose)])

    def shares(self, state: WarmState, frames: str | Sequence[str]) -> dict[str, PoseShares]:
        """Return errors of frames by geometry and heat, alone and together; heat alone has the same temperatures."""
        pose, base = state.robot.pose, state.location.loops.base_frame
        cold = self.robot.locate(pose)
        warm = WarmRobot(drawing_of(self.robot), state.robot.expansion, pose).solve()
        return {
            frame: PoseShares(
                cold.difference(frame),
                PoseDifference.between(cold.nominal.pose(base, frame), warm.pose(base, frame)),
                state.location.difference(frame),
            )
            for frame in as_tuple(frames)
        }


def strains_along(heated: HeatedRobot, poses: FloatArray, threads: int = 2, show: Progress = say_nothing) -> FloatArray:
    """Return the thermal strains of the parts at held poses, (n, 6): legs, moving and fixed platform."""
    strain, threads = np.zeros((len(poses), 6)), whole(threads, 1, "threads are a number of them, from 1 on")
    if heated.heat is None or not len(poses):
        return strain
    done, heated = [0], HeatedRobot(heated.robot, heated.heat, heated.network)  # network made before threads need it

    def take(rows: Indices) -> None:
        field = None
        for row in rows:
            field = heated.field(PlatformPose.of_values(poses[row]), field)
            grown = heated.expansion(field)
            strain[row] = *grown.leg_strain, grown.platform_strain, grown.fixed_platform_strain
            done[0] += 1
            show("temperatures", done[0], len(poses))

    pieces = np.array_split(np.arange(len(poses)), min(threads, len(poses)))
    with one_blas_thread(), ThreadPoolExecutor(len(pieces)) as pool:
        list(pool.map(take, pieces))
    return strain


class WarmPath:
    """Closes the robot as built, without loads, with thermal expansion pose by pose.

    Poses, commanded or wanted, are (n, 4), in m and rad; ``strain`` is as :func:`strains_along` returns it.
    """

    def __init__(self, heated: HeatedRobot, poses: FloatArray, strain: FloatArray) -> None:
        self.robot = robot = heated.robot
        self.strain, self.engine = strain, robot.engine()
        self.errors = self._displaced(heated) if strain.any() else None
        self.growth = growth_of_drives(strain, robot.actual_solver.mechanism.loops.drives)
        self.command = robot.kinematics.commands(poses)

    def _displaced(self, heated: HeatedRobot) -> FloatArray:
        """Return displacements by heat of the joints as built, (n, sites * 6): H E = E (E⁻¹ H E), H a translation."""
        structure, built = self.engine.structure, heated.robot.model.displacements()
        errors = np.zeros((len(self.strain), structure.site_count, 6))
        for k, part in ((4, ThermalExpansion(platform_strain=1.0)), (5, ThermalExpansion(fixed_platform_strain=1.0))):
            for joint, shift in part.placements(heated.robot.kinematics).items():
                if np.any(shift.translation):
                    turned = built[joint].rotation if joint in built else np.eye(3)
                    way = turned.T @ shift.translation
                    errors[:, structure.site(joint), :3] += self.strain[:, k, None] * way
        return errors.reshape(len(errors), structure.site_count * 6)

    def close(self, drives: FloatArray, start: BatchStart) -> BatchClosure:
        """Return the closed robot for commanded drives (n, 4), in m and rad: offset, then expanded with the leg."""
        return self.engine.close(self.robot.actual_drive_values(drives) * self.growth, start, self.errors)

    def drives_to_end(self, closed: BatchClosure) -> FloatArray:
        """Return the end frame's Jacobian for commanded drives, (n, 6, 4): of origin (m) and rotation vector (rad)."""
        drives = drive_parameters(self.engine.structure.mechanism)
        return np.asarray(self.engine.transfer(closed, drives, self.errors).matrix * self.growth[:, None, :])


def locate_path(
    heated: HeatedRobot, poses: ArrayLike, threads: int = 2, show: Progress = say_nothing
) -> tuple[xr.Dataset, BatchClosure]:
    """Return where the ladle should be and where the warm ladle is for many commanded poses, and closures as built.

    Poses are x, y, z in m and the tilt in rad, shape (n, 4), best along a path; the dataset is like that of
    :meth:`PouringRobot.locate`. ``threads`` share the computation of temperatures. Poses of another shape, and a robot
    that carries loads, raise BadInputError.
    """
    commanded = place = as_poses(poses)
    if heated.heat is not None and len(commanded):  # shadows differ a few mm off the command
        rows, row_of = np.unique(_stand_ins(commanded), return_inverse=True)
        warm = WarmPath(heated, commanded, strains_along(heated, commanded[rows], threads, show)[row_of])
        closed = warm.close(warm.command.drives, warm.command.start)
        found = np.column_stack([closed.position, tilts(closed.rotation)])
        place = np.where(np.isfinite(found), found, commanded)
    warm = WarmPath(heated, commanded, strains_along(heated, place, threads, show))
    closed = warm.close(warm.command.drives, warm.command.start)
    return heated.robot.path_dataset(warm.command, closed), closed


def _stand_ins(poses: FloatArray) -> Indices:
    """Return for each pose an earlier one whose expansion is near enough to locate it, or itself, (n,)."""
    chosen, last = np.arange(len(poses)), 0
    for row in range(1, len(poses)):
        if np.abs(poses[row] - poses[last]).max() < _STANDS_IN:
            chosen[row] = last
        else:
            last = row
    return chosen
