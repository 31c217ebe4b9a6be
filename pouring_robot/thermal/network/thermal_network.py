"""The thermal network of the robot: one melt, four legs, two platforms, one ladle.

The melt's surface, a disc that tilts with the ladle, radiates into the half-space above it. The radiation that reaches
legs and platforms depends on pose and tilt; only the moving platform's bars obstruct it. Heat is conducted along rods
and bars, through U joints, and from the melt through lining and shell into the platform. Every surface gives heat to
the surroundings by convection and re-radiation.
"""

import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pouring_robot.exceptions import HistoryError
from pouring_robot.io.argument_checks import whole
from pouring_robot.io.temperatures import kelvin
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.solver import ClosureResult
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties, load_thermal_properties
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.network.bodies import Bodies
from pouring_robot.thermal.network.conduction import add_nut_contact, constant_conductances
from pouring_robot.thermal.network.elements import FACE_NORMALS, BarCells, LegExposure, LegGrid
from pouring_robot.thermal.network.heat_balance import SOLVER, Circuit, grey_radiation, integrate, steady_temperatures
from pouring_robot.thermal.network.history import HeatHistory, Placed, PoseSchedule
from pouring_robot.thermal.network.temperature_field import TemperatureField
from pouring_robot.thermal.network.view_factors import DiscChords, hidden_view_factors

_KEPT_POSES = 32


class ThermalNetwork:
    """Temperatures of a robot for a pose and a melt.

    Geometry comes from the robot, by default the drawing of the default layout: U-joint centres from its nominal
    mechanism, bars from its URDF, sizes from its layout; the properties are by default those of the shipped
    ``thermal.yaml``. The moving rod is cut into ``elements_per_leg`` over its full length, the fixed rod to match, and
    each bar of the platforms by default into a fifth of that. Without radiation only conduction and convection remain.
    Impossible temperatures of melt or surroundings raise TemperatureError, a part that is connected to nothing
    ThermalSolutionError.

    Raises:
        BadInputError: a number of elements is not whole, or below four for a leg, or the shell leaves no lining.
        DescriptionError: the robot's description is wrong, or its platforms are not frames of boxes.
    """

    def __init__(
        self,
        robot: PouringRobot | None = None,
        properties: ThermalProperties | None = None,
        elements_per_leg: int = 20,
        *,
        elements_per_bar: int | None = None,
        radiation: bool = True,
    ) -> None:
        elements_per_leg = whole(elements_per_leg, 4, "a leg needs a whole number of elements, at least 4")
        self.robot = robot or PouringRobot()
        self.properties = properties or load_thermal_properties()
        self.radiation = radiation
        entry, urdf = self.robot.layout, self.robot.model.definition.urdf()
        grid = LegGrid.of(entry.leg, elements_per_leg, max(2, round(elements_per_leg / 4)))
        per_bar = max(2, elements_per_leg // 5) if elements_per_bar is None else elements_per_bar
        per_bar = whole(per_bar, 1, "a bar needs a whole number of elements, at least 1")
        self.bodies = Bodies.of(urdf, entry, self.properties, grid, per_bar)
        self._disc = DiscChords.of(self.bodies.ladle.melt_radius_m)
        self._laplacian, self._melt_contact = constant_conductances(self.bodies)
        self._capacity = self.bodies.capacities()

    def steady(
        self,
        pose: Placed,
        melt_degC: float | None = None,
        ambient_degC: float | None = None,
        near: TemperatureField | None = None,
    ) -> TemperatureField:
        """Return the steady-state temperatures at a held pose.

        ``pose``: of the nominal robot, or a closure of any robot of this layout; melt and surroundings are by default
        those of the properties; ``near``: temperatures at a nearby pose, to start from.
        """
        melt_K, ambient_K = self.temperatures_K(melt_degC, ambient_degC)
        start = None if near is None else near.temperatures_K
        found = steady_temperatures(self.circuit(pose), melt_K, ambient_K, start)
        return self.field(pose, found, melt_K, ambient_K)

    def temperatures_K(self, melt_degC: float | None, ambient_degC: float | None) -> tuple[float, float]:
        """Return melt and ambient temperature in K; None means that of the properties."""
        melt, ambient = self.properties.melt.temperature.value, self.properties.ambient.temperature.value
        return (
            kelvin(melt if melt_degC is None else melt_degC, "melt"),
            kelvin(ambient if ambient_degC is None else ambient_degC, "ambient", surroundings=True),
        )

    def circuit(self, pose: Placed) -> Circuit:
        """Return the coefficients of the network at a pose."""
        return self._at(pose)[0]

    def field(self, pose: Placed, temperatures_K: FloatArray, melt_K: float, ambient_K: float) -> TemperatureField:
        """Return the temperature field at a pose from temperatures of all nodes, shape (n,), in K."""
        return TemperatureField(temperatures_K, melt_K, ambient_K, self.bodies, *self._at(pose))

    def _at(self, pose: Placed) -> tuple[Circuit, LegExposure, FloatArray]:
        return _built(self, tuple(np.concatenate([part.ravel() for part in self._placements(pose)]).tolist()))

    def _placements(self, pose: Placed) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return upper and lower U-joint centres, (4, 3) each, and the moving platform, all in the fixed platform."""
        kinematics = self.robot.kinematics
        if isinstance(pose, ClosureResult):
            platform = pose.pose("fixed_platform", "moving_platform")
            upper, lower = (
                np.array([pose.pose("fixed_platform", f"{leg}_{part}").translation for leg in LEGS])
                for part in ("fixed_rod", "moving_rod")
            )
            return upper, lower, np.array(platform.rotation), np.array(platform.translation)
        placement = pose.to_se3()
        rotation, position = np.array(placement.rotation), np.array(placement.translation)
        return kinematics.fixed_centres_m, position + kinematics.moving_centres_m @ rotation.T, rotation, position

    def _build(self, placements: tuple[float, ...]) -> tuple[Circuit, LegExposure, FloatArray]:
        """Assemble the network at flattened :meth:`_placements`; return it, the legs and the platform's axes."""
        upper, lower, rotation, position = np.split(np.array(placements), [12, 24, 33])
        rotation = rotation.reshape(3, 3)
        origin = position + rotation @ self.bodies.ladle.melt_centre_m
        upper, lower = ((centres.reshape(4, 3) - origin) @ rotation for centres in (upper, lower))
        bodies, properties = self.bodies, self.properties
        exposure = LegExposure.at(bodies.grid, upper, lower, self._disc, self.bodies.in_the_way_m)
        nodes, matrix = bodies.nodes, self._laplacian.copy()
        add_nut_contact(bodies, matrix, exposure.touching_m2)
        area, view = bodies.area_m2.copy(), bodies.view_area_m2.copy()
        area[nodes.legs], view[nodes.legs] = exposure.area_m2, exposure.area_m2 * exposure.view_factor
        view[nodes.fixed_platform] = self._view_area(bodies.fixed, rotation, origin)
        melt_contact = np.zeros(nodes.count)
        melt_contact[nodes.lining[0]] = self._melt_contact
        emissivity = np.full(nodes.count, properties.steel.emissivity.value)
        emissivity[nodes.cladding] = properties.insulation.emissivity.value
        radiation = grey_radiation(area, view, emissivity, properties.melt.emissivity.value)
        to_melt, to_ambient = (float(self.radiation) * one for one in radiation)
        film = properties.ambient.film_coefficient.value * area
        return Circuit(matrix, melt_contact, film, to_melt, to_ambient, self._capacity), exposure, rotation

    def view_area_m2(self, cells: BarCells, pose: Placed) -> FloatArray:
        """Return area times view factor to the melt of cells given in the fixed platform's frame, shape (N,)."""
        _, _, rotation, position = self._placements(pose)
        return self._view_area(cells, rotation, position + rotation @ self.bodies.ladle.melt_centre_m)

    def melt_points_m(self, pose: Placed, count: int) -> FloatArray:
        """Return points spread evenly over the melt's surface (Vogel's spiral), in the fixed platform, (count, 3)."""
        _, _, rotation, position = self._placements(pose)
        turns = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
        radii = self._disc.radius_m * np.sqrt((np.arange(count) + 0.5) / count)
        on_disc = np.column_stack([radii * np.cos(turns), radii * np.sin(turns), np.zeros(count)])
        return np.asarray(position + (on_disc + self.bodies.ladle.melt_centre_m) @ rotation.T)

    def _view_area(self, cells: BarCells, rotation: FloatArray, origin: FloatArray) -> FloatArray:
        normals = np.broadcast_to(FACE_NORMALS @ rotation, (cells.count, 6, 3))
        faces, middles = ((points - origin) @ rotation for points in (cells.face_centres_m, cells.centres_m))
        factors = hidden_view_factors(faces, middles, normals, self._disc, self.bodies.in_the_way_m)
        return np.asarray(np.sum(cells.face_area_m2 * factors, axis=1))


@functools.lru_cache(_KEPT_POSES)  # shared by all networks and threads
def _built(network: ThermalNetwork, placements: tuple[float, ...]) -> tuple[Circuit, LegExposure, FloatArray]:
    return network._build(placements)


@one_blas_thread()
def simulate(
    network: ThermalNetwork,
    history: HeatHistory,
    poses: Placed | PoseSchedule | Sequence[tuple[float, Placed]],
    *,
    start: TemperatureField | None = None,
    times_s: FloatArray | None = None,
    solver: Mapping[str, Any] = SOLVER,
) -> tuple[TemperatureField, ...]:
    """Integrate the temperatures of a robot's network over a history; return them at times, each at the pose then held.

    ``poses``: one pose held throughout, or entries of time and pose; ``start``: initial temperatures, by default those
    of the surroundings; ``times_s``: increasing, within the history, by default its entries. Integration restarts where
    the pose or the slope of a temperature changes; between these points everything is smooth.

    Raises:
        HistoryError: a time to report is outside the history or out of order, or a pose comes after its end.
        ThermalSolutionError: the integrator fails.
    """
    schedule = PoseSchedule.of(poses, history.start_s)
    for row, (time, _) in enumerate(schedule.entries, start=1):
        if time > history.end_s:
            raise HistoryError(f"a pose starts at {time:g} s, after the history's end at {history.end_s:g} s", row)
    wanted = np.array(history.times_s if times_s is None else times_s, dtype=float)
    if wanted.size == 0 or np.any(np.diff(wanted) <= 0.0):
        raise HistoryError("the times to report must increase")
    if wanted[0] < history.start_s or wanted[-1] > history.end_s:
        span = f"{history.start_s:g} to {history.end_s:g} s"
        raise HistoryError(f"the times to report, {wanted[0]:g} to {wanted[-1]:g} s, leave the history, {span}")
    cold = np.full(network.bodies.nodes.count, history.at(history.start_s)[1])
    state = cold if start is None else start.temperatures_K
    changes = [time for time, _ in schedule.entries if history.start_s < time < history.end_s]
    edges = np.unique(np.concatenate([[history.start_s, history.end_s], history.corners_s, changes]))
    states: list[FloatArray] = []
    for begin, end in itertools.pairwise(edges):
        if not np.any(wanted >= begin):
            break
        # A time at which the pose changes is reported at the new pose: it belongs to the segment that starts there.
        inside = wanted[(wanted >= begin) & ((wanted < end) | (end == edges[-1]))]
        circuit = network.circuit(schedule.at(float(begin)))
        reported, state = integrate(circuit, history, (float(begin), float(end)), state, inside, solver)
        states += reported
    return tuple(
        network.field(schedule.at(float(time)), values, *history.at(float(time)))
        for time, values in zip(wanted, states, strict=True)
    )
