"""From bodies to nodes: which node is what, and the parts of the network that no pose changes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.constants import Stefan_Boltzmann

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import IndexArray
from pouring_robot.robot.pouring.layout_schema import LayoutEntry
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.thermal.network.circuit import chain_links, laplacian
from pouring_robot.thermal.network.elements import FACE_NORMALS, BarCells, LadleSections
from pouring_robot.thermal.network.leg_elements import LEGS, LegGrid
from pouring_robot.thermal.network.view_factors import Boxes, DiscChords, hidden_view_factors

LINING_LAYERS = 5
_OFF_THE_FACE_M = 1e-6


@dataclass(frozen=True, eq=False)
class NodeMap:
    """Which node stands for what.

    Attributes:
        legs: nodes of the legs, shape (4, N + F), the moving rod's first.
        moving_platform: steel of the moving platform's cells, shape (P,).
        cladding: surface of their cladding, shape (C,); ``clad_cells`` the cells that have one, shape (C,).
        fixed_platform: cells of the fixed platform, shape (Q,).
        lining: layers of the ladle's lining, from the melt outwards.
        shell: the ladle's shell.
    """

    legs: IndexArray
    moving_platform: IndexArray
    cladding: IndexArray
    clad_cells: IndexArray
    fixed_platform: IndexArray
    lining: IndexArray
    shell: int

    @property
    def count(self) -> int:
        """Number of nodes."""
        return self.shell + 1

    @classmethod
    def of(cls, grid: LegGrid, moving_cells: int, clad_cells: IndexArray, fixed_cells: int) -> NodeMap:
        """Number all nodes."""
        sizes = (LEGS * grid.count, moving_cells, len(clad_cells), fixed_cells, LINING_LAYERS)
        ends = np.cumsum((0, *sizes))
        groups = [np.arange(a, b, dtype=np.intp) for a, b in itertools.pairwise(ends)]
        legs = groups[0].reshape(LEGS, grid.count)
        return cls(legs, groups[1], groups[2], clad_cells, groups[3], groups[4], int(ends[-1]))


@dataclass(frozen=True, eq=False)
class MovingPlatform:
    """Bars of the moving platform with what they see of the melt; ladle and platform move as one, so it is constant.

    Attributes:
        cells: in the moving platform's frame.
        view_factor: of each face, in the order of the faces, shape (P, 6).
        clad_area_m2: area that sees the melt and is clad, shape (P,); zero for bare bars.
        clad_view_area_m2: the same area times its view factor.
        bare_area_m2: the remaining area; ``bare_view_area_m2`` times its view factor.
        cladding_m: thickness of the cladding.
    """

    cells: BarCells
    view_factor: FloatArray
    clad_area_m2: FloatArray
    clad_view_area_m2: FloatArray
    bare_area_m2: FloatArray
    bare_view_area_m2: FloatArray
    cladding_m: float

    @classmethod
    def of(
        cls, boxes: Boxes, in_the_way: Boxes, ladle: LadleSections, cells_per_bar: int, cladding_m: float
    ) -> MovingPlatform:
        """Cut the bars and look at the melt from every face."""
        cells = BarCells.cut(boxes, cells_per_bar)
        normals = np.broadcast_to(FACE_NORMALS, (cells.count, 6, 3))
        points = cells.face_centres_m - ladle.melt_centre_m + _OFF_THE_FACE_M * normals
        disc = DiscChords.of(ladle.melt_radius_m, count=128)
        faces, facing = points.reshape(-1, 1, 3), normals.reshape(-1, 1, 3)
        factors = hidden_view_factors(faces, faces[:, 0], facing, disc, in_the_way).reshape(cells.count, 6)
        clad = (factors > 0.0) & (cladding_m > 0.0)
        area, view = cells.face_area_m2, cells.face_area_m2 * factors
        return cls(
            cells,
            factors,
            np.sum(area * clad, axis=1),
            np.sum(view * clad, axis=1),
            np.sum(area * ~clad, axis=1),
            np.sum(view * ~clad, axis=1),
            cladding_m,
        )


@dataclass(frozen=True, eq=False)
class Bodies:
    """All bodies of the robot, cut into nodes.

    Attributes:
        nodes: which node stands for what.
        grid: elements of a leg.
        moving: the moving platform.
        fixed: cells of the fixed platform.
        ladle: sizes of the ladle.
        entry: the layout.
        properties: materials, surfaces and contacts.
    """

    nodes: NodeMap
    grid: LegGrid
    moving: MovingPlatform
    fixed: BarCells
    ladle: LadleSections
    entry: LayoutEntry
    properties: ThermalProperties


def constant_laplacian(bodies: Bodies) -> tuple[FloatArray, float]:
    """Return the conductances between nodes that no pose changes, and that between melt and first lining layer.

    Conduction along every rod and bar, across U joints, cladding and lining, from shell through trunnions to the
    hangers. What changes with the pose is only where the moving rod touches the fixed one.

    Returns:
        The Laplacian, shape (n, n), and a conductance, both in W/K.

    Raises:
        BadInputError: the shell is as thick as the ladle's whole wall.
    """
    nodes, grid, moving, fixed = bodies.nodes, bodies.grid, bodies.moving, bodies.fixed
    ladle, entry, properties = bodies.ladle, bodies.entry, bodies.properties
    steel, insulation = properties.steel.conductivity.value, properties.insulation.conductivity.value
    links: list[tuple[int, int, float]] = []
    for i in range(LEGS):
        rod, housing = nodes.legs[i, : grid.moving], nodes.legs[i, grid.moving :]
        links += chain_links(rod, steel * grid.moving_section_m2 / grid.moving_step_m)
        links += chain_links(housing, steel * grid.fixed_section_m2 / grid.fixed_step_m)
        foot = moving.cells.nearest(entry.moving_centres.metres[i] - np.array([0.0, 0.0, entry.leg.foot_drop.metres]))
        # The joint sits at the rod's end, half an element away from the node.
        half_element = 0.5 * grid.moving_step_m / (steel * grid.moving_section_m2)
        lower_joint = 1.0 / (1.0 / properties.contact.lower_joint.value + half_element)
        links.append((int(rod[0]), int(nodes.moving_platform[foot]), lower_joint))
        bearings = entry.fixed_platform.bearing_offset.metres
        for side in (-1.0, 1.0):
            bar = fixed.nearest(entry.fixed_centres.metres[i] + np.array([0.0, side * bearings, 0.0]))
            for head, share in zip(housing, grid.upper_joint_shares, strict=True):
                joint = 0.5 * float(share) * properties.contact.upper_joint.value
                links.append((int(head), int(nodes.fixed_platform[bar]), joint))
    for cells, numbers in ((moving.cells, nodes.moving_platform), (fixed, nodes.fixed_platform)):
        links += [(int(numbers[a]), int(numbers[b]), steel * shape) for a, b, shape in cells.contacts]
    for k, cell in enumerate(nodes.clad_cells):
        across = insulation * float(moving.clad_area_m2[cell]) / moving.cladding_m
        links.append((int(nodes.cladding[k]), int(nodes.moving_platform[cell]), across))
    trunnion = steel * ladle.trunnion_area_m2 / ladle.trunnion_length_m
    for point in ladle.trunnions_m:
        links.append((nodes.shell, int(nodes.moving_platform[moving.cells.nearest(point)]), trunnion))
    layer = insulation * _lining_area(ladle) * LINING_LAYERS / lining_thickness_m(ladle, properties)
    links += chain_links(nodes.lining, layer)
    links.append((int(nodes.lining[-1]), nodes.shell, 2.0 * layer))
    return laplacian(nodes.count, links), 2.0 * layer


def capacities(bodies: Bodies) -> FloatArray:
    """Return the heat capacity of every node, shape (n,), in J/K."""
    nodes, grid, moving, ladle, properties = bodies.nodes, bodies.grid, bodies.moving, bodies.ladle, bodies.properties
    steel = bodies.entry.materials.steel_density.value * properties.steel.heat_capacity.value
    insulation = properties.insulation.density.value * properties.insulation.heat_capacity.value
    capacity = np.zeros(nodes.count)
    capacity[nodes.legs[:, : grid.moving]] = steel * grid.moving_section_m2 * grid.moving_step_m
    capacity[nodes.legs[:, grid.moving :]] = steel * grid.fixed_section_m2 * grid.fixed_step_m
    capacity[nodes.moving_platform] = steel * moving.cells.volume_m3
    capacity[nodes.fixed_platform] = steel * bodies.fixed.volume_m3
    # Half of the cladding goes with its surface, half with the bar.
    half = 0.5 * insulation * moving.clad_area_m2[nodes.clad_cells] * moving.cladding_m
    capacity[nodes.cladding] = half
    capacity[nodes.moving_platform[nodes.clad_cells]] += half
    capacity[nodes.lining] = insulation * _lining_area(ladle) * lining_thickness_m(ladle, properties) / LINING_LAYERS
    capacity[nodes.shell] = steel * ladle.outer_area_m2 * properties.ladle.shell_thickness.metres
    return capacity


def lining_thickness_m(ladle: LadleSections, properties: ThermalProperties) -> float:
    """Return what the shell leaves of the ladle's wall, in m.

    Raises:
        BadInputError: nothing.
    """
    shell = properties.ladle.shell_thickness.metres
    if not 0.0 < shell < ladle.wall_m:
        raise BadInputError(
            f"ladle.shell_thickness of {shell * 1e3:g} mm must lie between 0 and the layout's wall of "
            f"{ladle.wall_m * 1e3:g} mm; the rest is lining"
        )
    return ladle.wall_m - shell


def _lining_area(ladle: LadleSections) -> float:
    """Return the area of a plane slab that conducts like the curved wall: geometric mean of inside and outside."""
    return float(np.sqrt(ladle.inner_area_m2 * ladle.outer_area_m2))


def radiation_conductances(
    area_m2: FloatArray, view_area_m2: FloatArray, emissivity: FloatArray | float, melt_emissivity: float
) -> tuple[FloatArray, FloatArray]:
    """Return how strongly surfaces radiate with melt and surroundings.

    Surfaces are grey and diffuse; the view factors are small enough to leave out what is reflected to and fro. The
    melt's surface takes and gives the share ``melt_emissivity`` of what it meets and reflects the surroundings with
    the rest, so that in surroundings as hot as the melt nothing flows.

    Args:
        area_m2: shape (n,).
        view_area_m2: area times view factor to the melt, shape (n,).
        emissivity: of the surfaces.
        melt_emissivity: of the melt.

    Returns:
        To the melt and to the surroundings, shape (n,) each, in W/K⁴.
    """
    seen = melt_emissivity * view_area_m2
    scale = emissivity * Stefan_Boltzmann
    return scale * seen, scale * (area_m2 - seen)
