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
from pouring_robot.thermal.network.elements import FACE_NORMALS, LEGS, BarCells, LadleSections, LegGrid, link_boxes
from pouring_robot.thermal.network.view_factors import Boxes, DiscChords, hidden_view_factors

LINING_LAYERS = 5
_OFF_THE_FACE_M = 1e-6


@dataclass(frozen=True, eq=False)
class NodeMap:
    """Which node stands for what."""

    legs: IndexArray  # nodes of the legs, shape (4, N + F), the moving rod's first
    moving_platform: IndexArray  # steel of its cells, shape (P,)
    cladding: IndexArray  # its surface, shape (C,)
    clad_cells: IndexArray  # of the moving platform's cells those that have one, shape (C,)
    fixed_platform: IndexArray  # of its cells, shape (Q,)
    lining: IndexArray  # layers of the ladle's lining, from the melt outwards
    shell: int  # the ladle's shell

    @property
    def count(self) -> int:
        """Number of nodes."""
        return self.shell + 1

    @classmethod
    def of(cls, grid: LegGrid, moving_cells: int, clad_cells: IndexArray, fixed_cells: int) -> NodeMap:
        """Number all nodes."""
        sizes = (LEGS * len(grid.step_m), moving_cells, len(clad_cells), fixed_cells, LINING_LAYERS)
        ends = np.cumsum((0, *sizes))
        legs, moving, cladding, fixed, lining = (np.arange(a, b, dtype=np.intp) for a, b in itertools.pairwise(ends))
        return cls(legs.reshape(LEGS, len(grid.step_m)), moving, cladding, clad_cells, fixed, lining, int(ends[-1]))


@dataclass(frozen=True, eq=False)
class MovingPlatform:
    """Bars of the moving platform with what they see of the melt; ladle and platform move as one, so it is constant."""

    cells: BarCells  # in the moving platform's frame, P of them
    clad_area_m2: FloatArray  # area that sees the melt and is clad, shape (P,); zero for bare bars
    clad_view_area_m2: FloatArray  # the same times its view factor
    bare_area_m2: FloatArray  # the remaining area
    bare_view_area_m2: FloatArray  # the same times its view factor

    @classmethod
    def of(cls, cells: BarCells, in_the_way: Boxes, ladle: LadleSections, *, clad: bool) -> MovingPlatform:
        """Look at the melt from every face of the cells; ``in_the_way`` stands in the disc's frame."""
        normals = np.broadcast_to(FACE_NORMALS, (cells.count, 6, 3))
        points = cells.face_centres_m - ladle.melt_centre_m + _OFF_THE_FACE_M * normals
        disc = DiscChords.of(ladle.melt_radius_m, count=128)
        faces, facing = points.reshape(-1, 1, 3), normals.reshape(-1, 1, 3)
        factors = hidden_view_factors(faces, faces[:, 0], facing, disc, in_the_way).reshape(cells.count, 6)
        covered = (factors > 0.0) & clad
        area, view = cells.face_area_m2, cells.face_area_m2 * factors
        return cls(cells, *(np.sum(a * share, axis=1) for share in (covered, ~covered) for a in (area, view)))


@dataclass(frozen=True, eq=False)
class Bodies:
    """All bodies of the robot, cut into nodes: legs, bars of both platforms, ladle; with layout and properties.

    A shell that leaves nothing of the ladle's wall raises BadInputError when the lining is asked for.
    """

    nodes: NodeMap
    grid: LegGrid
    moving: MovingPlatform
    fixed: BarCells
    ladle: LadleSections
    entry: LayoutEntry
    properties: ThermalProperties

    @classmethod
    def of(
        cls, urdf: str, entry: LayoutEntry, properties: ThermalProperties, grid: LegGrid, bars: int, in_the_way: Boxes
    ) -> Bodies:
        """Cut them; ``bars``: cells of each bar, ``in_the_way``: the moving platform's bars in the disc's frame."""
        ladle, clad = LadleSections.of(entry), properties.moving_platform.cladding_thickness.metres > 0.0
        moving, fixed = (BarCells.cut(link_boxes(urdf, f"{name}_platform"), bars) for name in ("moving", "fixed"))
        seeing = MovingPlatform.of(moving, in_the_way, ladle, clad=clad)
        nodes = NodeMap.of(grid, moving.count, np.flatnonzero(seeing.clad_area_m2 > 0.0), fixed.count)
        return cls(nodes, grid, seeing, fixed, ladle, entry, properties)

    @property
    def lining_m(self) -> float:
        """What the shell leaves of the ladle's wall."""
        shell, wall = self.properties.ladle.shell_thickness.metres, self.ladle.wall_m
        if not 0.0 < shell < wall:
            raise BadInputError(
                f"ladle.shell_thickness of {shell * 1e3:g} mm must lie between 0 and the layout's wall of "
                f"{wall * 1e3:g} mm; the rest is lining"
            )
        return wall - shell

    @property
    def cladding_m(self) -> float:
        """Thickness of the moving platform's cladding."""
        return self.properties.moving_platform.cladding_thickness.metres


def constant_laplacian(bodies: Bodies) -> tuple[FloatArray, float]:
    """Return the conductances between nodes that no pose changes, (n, n), and that between melt and lining, in W/K.

    Conduction along every rod and bar, across U joints, cladding and lining, from shell through trunnions to the
    hangers. What changes with the pose is only where the moving rod touches the fixed one.
    """
    nodes, grid, moving, fixed = bodies.nodes, bodies.grid, bodies.moving, bodies.fixed
    ladle, entry, contact = bodies.ladle, bodies.entry, bodies.properties.contact
    steel, insulation = (part.conductivity.value for part in (bodies.properties.steel, bodies.properties.insulation))
    rod_per_step, *_, housing_per_step = steel * grid.section_m2 / grid.step_m
    # The upper U joint's heat is shared by the two elements of the fixed rod nearest to it.
    upper_shares = [float(np.interp(0.0, grid.fixed_middles_m, unit)) for unit in np.eye(grid.fixed)]
    links: list[tuple[int, int, float]] = []
    for i in range(LEGS):
        rod, housing = nodes.legs[i, : grid.moving], nodes.legs[i, grid.moving :]
        links += chain_links(rod, rod_per_step) + chain_links(housing, housing_per_step)
        foot = moving.cells.nearest(entry.moving_centres.metres[i] - np.array([0.0, 0.0, entry.leg.foot_drop.metres]))
        # The joint sits at the rod's end, half an element away from the node.
        lower_joint = 1.0 / (1.0 / contact.lower_joint.value + 0.5 / rod_per_step)
        links.append((int(rod[0]), int(nodes.moving_platform[foot]), lower_joint))
        bearings = entry.fixed_platform.bearing_offset.metres
        for side in (-1.0, 1.0):
            bar = fixed.nearest(entry.fixed_centres.metres[i] + np.array([0.0, side * bearings, 0.0]))
            for head, share in zip(housing, upper_shares, strict=True):
                links.append((int(head), int(nodes.fixed_platform[bar]), 0.5 * share * contact.upper_joint.value))
    for cells, numbers in ((moving.cells, nodes.moving_platform), (fixed, nodes.fixed_platform)):
        links += [(int(numbers[a]), int(numbers[b]), steel * shape) for a, b, shape in cells.contacts]
    for k, cell in enumerate(nodes.clad_cells):
        across = insulation * float(moving.clad_area_m2[cell]) / bodies.cladding_m
        links.append((int(nodes.cladding[k]), int(nodes.moving_platform[cell]), across))
    trunnion = steel * ladle.trunnion_area_m2 / ladle.trunnion_length_m
    for point in ladle.trunnions_m:
        links.append((nodes.shell, int(nodes.moving_platform[moving.cells.nearest(point)]), trunnion))
    layer = insulation * ladle.conducting_area_m2 * LINING_LAYERS / bodies.lining_m
    links += chain_links(nodes.lining, layer)
    links.append((int(nodes.lining[-1]), nodes.shell, 2.0 * layer))
    return laplacian(nodes.count, links), 2.0 * layer


def capacities(bodies: Bodies) -> FloatArray:
    """Return the heat capacity of every node, shape (n,), in J/K."""
    nodes, grid, moving, ladle, properties = bodies.nodes, bodies.grid, bodies.moving, bodies.ladle, bodies.properties
    steel = bodies.entry.materials.steel_density.value * properties.steel.heat_capacity.value
    insulation = properties.insulation.density.value * properties.insulation.heat_capacity.value
    capacity = np.zeros(nodes.count)
    capacity[nodes.legs] = steel * grid.section_m2 * grid.step_m
    capacity[nodes.moving_platform] = steel * moving.cells.volume_m3
    capacity[nodes.fixed_platform] = steel * bodies.fixed.volume_m3
    # Half of the cladding goes with its surface, half with the bar.
    half = 0.5 * insulation * moving.clad_area_m2[nodes.clad_cells] * bodies.cladding_m
    capacity[nodes.cladding] = half
    capacity[nodes.moving_platform[nodes.clad_cells]] += half
    capacity[nodes.lining] = insulation * ladle.conducting_area_m2 * bodies.lining_m / LINING_LAYERS
    capacity[nodes.shell] = steel * ladle.outer_area_m2 * properties.ladle.shell_thickness.metres
    return capacity


def radiation_conductances(
    area_m2: FloatArray, view_area_m2: FloatArray, emissivity: FloatArray | float, melt_emissivity: float
) -> tuple[FloatArray, FloatArray]:
    """Return how strongly surfaces of area and area times view factor, (n,), radiate with melt and surroundings.

    Surfaces are grey and diffuse; the view factors are small enough to leave out what is reflected to and fro. The
    melt's surface takes and gives the share ``melt_emissivity`` of what it meets and reflects the surroundings with
    the rest, so that in surroundings as hot as the melt nothing flows. Shape (n,) each, in W/K⁴.
    """
    seen = melt_emissivity * view_area_m2
    scale = emissivity * Stefan_Boltzmann
    return scale * seen, scale * (area_m2 - seen)
