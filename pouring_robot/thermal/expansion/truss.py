"""Temperatures of the truss above the robot, its deformation by heat or weight, and the fixed platform's displacement.

The bars of the trolley's frame and the two box girders under it are cut into cells. These conduct, give heat to the
air, radiate, and see the melt, like the platforms, past the moving platform's bars; bars of fixed platform and trolley
hide some of the points spread over the melt. Inside a girder plates radiate to each other: view factors in a long duct
follow from crossed strings (H. Hottel and A. Sarofim, Radiative Transfer), surfaces are grey in pairs. The truss is a
separate network that draws no heat from the robot's: wheels and bolts conduct little, and the trolley's low frame is
about as warm as the fixed platform under it. End carriages, rails and posts are far away and remain cold. A shield
under the truss is described by the property ``truss.exposed``.

A girder that is warmer below than above bows downwards, by the slope of α T over its height, and rests on the two rails
as a beam on two supports (W. Young and R. Budynas, Roark's Formulas for Stress and Strain, 7th ed., table 8.1). The
trolley's four wheels stand on the deformed girders. Its uprights expand downwards from the axles, and the fixed
platform moves with their feet. Everything expands from the middle of the truss.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.sparse
from scipy.constants import Stefan_Boltzmann

from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.robot.pouring.layout_schema import Layout
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.thermal.network.elements import FACE_NORMALS, BarCells, link_boxes, merged
from pouring_robot.thermal.network.heat_balance import (
    Circuit,
    grey_radiation,
    integrate,
    laplacian,
    steady_temperatures,
)
from pouring_robot.thermal.network.history import HeatHistory, Placed
from pouring_robot.thermal.network.thermal_network import ThermalNetwork

GIRDER_CELLS, TROLLEY_CELLS = 36, 6
_MELT_POINTS = 100
_SIDES = (1.0, -1.0)
_INSIDE_M = 1e-4
_ALONG = 11


@dataclass(frozen=True, eq=False)
class TrussTemperatures:
    """Temperatures of the truss."""

    # by girder (left, right), plate (bottom, webs below and above, top) and cell, shape (2, 6, cells)
    girders_degC: FloatArray
    trolley_degC: FloatArray  # by bar and cell from its lower end, shape (bars, cells)
    girders: BarCells  # cells of the plates in the fixed platform
    trolley: BarCells  # cells of the bars, also in the fixed platform


class TrussNetwork:
    """The truss over the melt of a robot's network, which gives the surroundings and the bars in between.

    Raises ThermalSolutionError where no temperatures are found.
    """

    def __init__(self, robot: ThermalNetwork) -> None:
        self._robot = robot
        layout = robot.robot.layout
        self._girders = _girder_cells(layout)
        self._inside = _inside_girders(layout, robot.properties.steel.emissivity.value)
        urdf = robot.robot.model.definition.urdf()
        up = np.array([0.0, 0.0, layout.truss.platform_drop.metres])
        frame = link_boxes(urdf, "trolley", skip_round=True) + up
        self._trolley = BarCells.cut(frame, TROLLEY_CELLS)
        self._in_the_way = merged(np.concatenate([frame, link_boxes(urdf, "fixed_platform")]))
        self._density = layout.materials.steel_density.value

    def temperatures(
        self, pose: Placed, melt_K: float, ambient_K: float, after_s: float | None = None
    ) -> TrussTemperatures:
        """Return the truss's temperatures while the robot is held at a pose, the trolley in the middle of its girders.

        ``after_s``: time since the melt came to the cold robot; None: the steady state.
        """
        found = []
        for cells, inside in ((self._girders, self._inside), (self._trolley, None)):
            circuit = self._circuit(cells, inside, pose)
            if after_s is None:
                state = steady_temperatures(circuit, melt_K, ambient_K)
            else:
                history = HeatHistory.constant(melt_K - ZERO_CELSIUS_K, ambient_K - ZERO_CELSIUS_K, after_s)
                cold = np.full(circuit.nodes, ambient_K)
                _, state = integrate(circuit, history, (0.0, after_s), cold, np.array([after_s]))
            found.append(state - ZERO_CELSIUS_K)
        return TrussTemperatures(
            found[0].reshape(2, -1, GIRDER_CELLS), found[1].reshape(-1, TROLLEY_CELLS), self._girders, self._trolley
        )

    def _circuit(self, cells: BarCells, inside: scipy.sparse.csc_array | None, pose: Placed) -> Circuit:
        properties, area = self._robot.properties, cells.face_area_m2.sum(axis=1)
        steel, on = properties.steel, float(self._robot.radiation)
        clear = _clear_share(cells.centres_m, self._robot.melt_points_m(pose, _MELT_POINTS), self._in_the_way)
        view = properties.truss.exposed.value * clear * self._robot.view_area_m2(cells, pose)
        to_melt, to_ambient = grey_radiation(area, view, on * steel.emissivity.value, properties.melt.emissivity.value)
        conducts = laplacian(cells.count, [(a, b, steel.conductivity.value * shape) for a, b, shape in cells.contacts])
        none, film = np.zeros(cells.count), properties.ambient.film_coefficient.value * area
        capacity = self._density * steel.heat_capacity.value * cells.volume_m3
        radiating = None if inside is None else on * inside
        return Circuit(conducts, none, film, to_melt, to_ambient, capacity, radiating)


def _clear_share(starts_m: FloatArray, ends_m: FloatArray, boxes_m: FloatArray) -> FloatArray:
    """Return the share of lines from each start (N, 3) to all ends (K, 3) that meet no box but their own; (N,)."""
    # Coordinates first: the maximum of three arrays is much faster than that of many triples.
    at, to = np.ascontiguousarray(starts_m.T)[..., None], np.ascontiguousarray(ends_m.T)[:, None]
    per_way = 1.0 / (to - at)
    hidden = np.zeros(per_way.shape[1:], dtype=bool)
    for lower, upper in boxes_m:
        inside = np.all((lower <= starts_m) & (starts_m <= upper), axis=1)
        one, other = ((side[:, None, None] - at) * per_way for side in (lower, upper))
        enters, leaves = np.minimum(one, other).max(axis=0), np.maximum(one, other).min(axis=0)
        hidden |= (enters < leaves) & (leaves > 0.0) & (enters < 1.0) & ~inside[:, None]
    return np.asarray(1.0 - hidden.mean(axis=1))


def _girder_cells(layout: Layout) -> BarCells:
    """Return the cells of both girders' plates in the fixed platform, without the inner faces of the boxes."""
    truss = layout.truss
    wall, up = truss.girder_wall.metres, truss.platform_drop.metres
    x, y, z = 0.5 * truss.gauge.metres, 0.5 * truss.girder_width.metres, 0.5 * truss.girder_height.metres
    plates = np.array(
        [
            ([-x, -y, -z], [x, y, wall - z]),
            ([-x, -y, wall - z], [x, wall - y, 0.0]),
            ([-x, y - wall, wall - z], [x, y, 0.0]),
            ([-x, -y, 0.0], [x, wall - y, z - wall]),
            ([-x, y - wall, 0.0], [x, y, z - wall]),
            ([-x, -y, z - wall], [x, y, z]),
        ]
    )
    middles = np.array([[0.0, side * truss.girder_offset.metres, up] for side in _SIDES])
    cells = BarCells.cut(np.concatenate([plates + middle for middle in middles]), GIRDER_CELLS)
    outside = cells.face_centres_m + _INSIDE_M * FACE_NORMALS
    inside = np.zeros(cells.face_area_m2.shape, dtype=bool)
    for middle in middles:
        inside |= np.all(np.abs(outside - middle) < np.array([x, y, z]), axis=2)
    return replace(cells, face_area_m2=np.where(inside, 0.0, cells.face_area_m2))


def _inside_girders(layout: Layout, emissivity: float) -> scipy.sparse.csc_array:
    """Return the radiation coefficients between the plates of each girder, cell by cell along it, in W/K⁴."""
    truss, wall = layout.truss, layout.truss.girder_wall.metres
    wide, high = truss.girder_width.metres - 2.0 * wall, truss.girder_height.metres - 2.0 * wall
    # Corners of the strips in the cross-section, in the order of the plates.
    corners = np.array([[0.0, 0.0], [wide, 0.0], [0.0, 0.5 * high], [wide, 0.5 * high], [0.0, high], [wide, high]])
    strips = [(0, 1), (0, 2), (1, 3), (2, 4), (3, 5), (4, 5)]
    one = np.zeros((len(strips), len(strips)))
    for i, (a, b) in enumerate(strips):
        for j, (c, d) in enumerate(strips):
            ends = corners[[a, b]][:, None] - corners[[c, d]]
            lengths = np.linalg.norm(ends, axis=2)
            # Crossed strings minus uncrossed ones; which is which follows from the order of the ends.
            one[i, j] = 0.0 if i == j else 0.5 * abs(lengths[0, 1] + lengths[1, 0] - lengths[0, 0] - lengths[1, 1])
    one *= Stefan_Boltzmann / (2.0 / emissivity - 1.0) * truss.gauge.metres / GIRDER_CELLS
    one = np.diag(one.sum(axis=1)) - one
    each_side = scipy.sparse.eye_array(len(_SIDES))
    return scipy.sparse.csc_array(scipy.sparse.kron(each_side, np.kron(one, np.eye(GIRDER_CELLS))))


@dataclass(frozen=True, eq=False)
class TrussMotion:
    """Displacement of the truss. All values are in the nominal fixed platform."""

    points_m: FloatArray  # along the girders' axes, then at the uprights' axles and feet, shape (n, 3)
    moved_m: FloatArray
    shift_m: FloatArray  # of the fixed platform's origin, shape (3,)
    turn_rad: FloatArray  # small rotation vector, shape (3,)

    def __add__(self, other: Self) -> Self:
        """Return the sum of both displacements."""
        moved = self.moved_m + other.moved_m
        return type(self)(self.points_m, moved, self.shift_m + other.shift_m, self.turn_rad + other.turn_rad)

    def carried_m(self, points_m: FloatArray) -> FloatArray:
        """Return the displacements of points in the fixed platform, shape (n, 3), that move with it."""
        return np.asarray(self.shift_m + np.cross(self.turn_rad, points_m))

    @classmethod
    def under_weight(cls, layout: Layout, carried_m: float, own_m: float) -> Self:
        """Return it for girders that sag in their middle by given amounts under a force there and under own weight."""
        points = _points(layout)
        near = 0.5 - np.abs(points[: 2 * _ALONG, 0]) / layout.truss.gauge.metres
        sags = carried_m * (3.0 * near - 4.0 * near**3) + own_m * 3.2 * (near - 2.0 * near**3 + near**4)
        shift = np.array([0.0, 0.0, -carried_m - own_m])
        moved = np.tile(shift, (len(points), 1))
        moved[: 2 * _ALONG, 2] = -sags
        return cls(points, moved, shift, np.zeros(3))

    @classmethod
    def under_heat(cls, layout: Layout, found: TrussTemperatures, properties: ThermalProperties) -> Self:
        """Return it for temperatures."""
        truss, points = layout.truss, _points(layout)
        height, wheel = truss.girder_height.metres, truss.wheel_radius.metres
        girders, feet = points[: 2 * _ALONG].reshape(2, _ALONG, 3), points[2 * _ALONG :].reshape(2, -1, 3)
        step = truss.gauge.metres / found.girders_degC.shape[2]
        bow, strain = _bow_and_strain(found, properties)
        ends = step * np.arange(bow.shape[1] + 1) - 0.5 * truss.gauge.metres
        places = 0.5 * (ends[1:] + ends[:-1])
        moved = np.zeros_like(girders)
        wheels = np.empty((len(_SIDES), 2))
        for k in range(len(_SIDES)):
            grown = np.append(0.0, np.cumsum(strain[k] * step))
            moved[k, :, 0] = np.interp(girders[k, :, 0], ends, grown) - np.interp(0.0, ends, grown)
            moved[k, :, 2] = _sagged(girders[k, :, 0], places, bow[k] * step, truss.gauge.metres)
            at = feet[0, 2 * k : 2 * k + 2, 0]
            rises = 0.5 * height * np.interp(at, places, strain[k])
            wheels[k] = _sagged(at, places, bow[k] * step, truss.gauge.metres) + rises
        warm = properties.strain(found.trolley_degC[_uprights(found, feet[0])])
        axles = wheels.ravel() + wheel * warm[:, -1]
        hang = -(feet[0, 0, 2] - feet[1, 0, 2]) * warm.mean(axis=1)
        leans, tilts = _plane(feet[0], wheels.ravel()), _plane(feet[1], axles - wheels.ravel() + hang)
        lever = np.array([0.0, 0.0, -truss.platform_drop.metres - 0.5 * height])
        shift = np.array([0.0, 0.0, leans[0] + tilts[0]]) + np.cross(leans[1], lever)
        level = np.zeros_like(feet)
        level[0, :, 2], level[1, :, 2] = axles, axles + hang
        return cls(points, np.concatenate([moved.reshape(-1, 3), level.reshape(-1, 3)]), shift, leans[1] + tilts[1])


def _points(layout: Layout) -> FloatArray:
    """Return points along both girders, then axles and feet of the four uprights, shape (2 · 11 + 8, 3), in m."""
    truss = layout.truss
    bar, up = truss.trolley_bar.metres, truss.platform_drop.metres
    x, y = 0.5 * (truss.trolley_length.metres - bar), truss.girder_offset.metres
    along = np.linspace(-0.5, 0.5, _ALONG) * truss.gauge.metres
    girders = [[place, side * y, up] for side in _SIDES for place in along]
    out = y + 0.5 * truss.girder_width.metres + bar
    axle = up + 0.5 * truss.girder_height.metres + truss.wheel_radius.metres
    foot = 0.5 * (layout.fixed_platform.bar_height.metres + bar)
    uprights = [[end * x, side * out, z] for z in (axle, foot) for side in _SIDES for end in (-1.0, 1.0)]
    return np.array(girders + uprights)


def _bow_and_strain(found: TrussTemperatures, properties: ThermalProperties) -> tuple[FloatArray, FloatArray]:
    """Return curvature downwards, in 1/m, and strain of both girders, cell by cell, shape (2, cells)."""
    shape = found.girders_degC.shape
    height, size = (values.reshape(shape) for values in (found.girders.centres_m[:, 2], found.girders.volume_m3))
    above = height - height.mean(axis=1, keepdims=True)
    grown = size * properties.strain(found.girders_degC)
    return -(grown * above).sum(axis=1) / (size * above**2).sum(axis=1), grown.sum(axis=1) / size.sum(axis=1)


def _sagged(at: FloatArray, places: FloatArray, turns: FloatArray, span: float) -> FloatArray:
    """Return the deflection, upwards positive, of a beam on two supports that is kinked by angles at places."""
    s, x = places + 0.5 * span, np.asarray(at)[:, None] + 0.5 * span
    return np.asarray(-(np.minimum(x, s) * (span - np.maximum(x, s)) / span) @ turns)


def _uprights(found: TrussTemperatures, axles: FloatArray) -> Indices:
    """Return the trolley's upright bar at each axle."""
    cells = found.trolley.centres_m.reshape(*found.trolley_degC.shape, 3)
    flat = np.ptp(cells[..., 2], axis=1) == 0.0
    away = np.linalg.norm(cells[:, 0, None, :2] - axles[:, :2], axis=2) + np.where(flat, np.inf, 0.0)[:, None]
    return np.asarray(away.argmin(axis=0))


def _plane(points: FloatArray, heights: FloatArray) -> tuple[float, FloatArray]:
    """Return height in the middle and rotation vector of the least-squares plane through heights at points."""
    rows = np.column_stack([np.ones(len(points)), points[:, :2]])
    middle, along_x, along_y = np.linalg.lstsq(rows, heights, rcond=None)[0]
    return float(middle), np.array([along_y, -along_x, 0.0])
