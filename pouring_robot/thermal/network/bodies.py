"""The bodies of the robot as nodes of the network: the meaning of each node, and properties that no pose changes."""

import itertools
from dataclasses import dataclass
from typing import Self

import numpy as np

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.robot.pouring.layout_schema import Layout
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.thermal.network.elements import FACE_NORMALS, BarCells, LadleSections, LegGrid, link_boxes, merged
from pouring_robot.thermal.network.view_factors import DiscChords, hidden_view_factors

LINING_LAYERS = 5
_OFF_THE_FACE_M = 1e-6


@dataclass(frozen=True, eq=False)
class NodeMap:
    """Indices of the nodes of each body."""

    legs: Indices  # nodes of the legs, shape (4, N + F), the moving rod's first
    moving_platform: Indices  # steel of its cells, shape (P,)
    cladding: Indices  # surface of its cladding, shape (C,)
    clad_cells: Indices  # cells of the moving platform with cladding, shape (C,)
    fixed_platform: Indices  # its cells, shape (Q,)
    lining: Indices  # layers of the ladle's lining, from the melt outwards
    shell: int  # the ladle's shell

    @property
    def count(self) -> int:
        """Number of nodes."""
        return self.shell + 1

    @classmethod
    def of(cls, grid: LegGrid, moving_cells: int, clad_cells: Indices, fixed_cells: int) -> Self:
        """Number all nodes."""
        sizes = (len(LEGS) * len(grid.step_m), moving_cells, len(clad_cells), fixed_cells, LINING_LAYERS)
        ends = np.cumsum((0, *sizes))
        legs, moving, cladding, fixed, lining = (np.arange(a, b, dtype=np.intp) for a, b in itertools.pairwise(ends))
        return cls(legs.reshape(len(LEGS), -1), moving, cladding, clad_cells, fixed, lining, int(ends[-1]))


@dataclass(frozen=True, eq=False)
class Bodies:
    """All bodies of the robot, cut into nodes: legs, bars of both platforms, ladle; with layout and properties.

    A shell as thick as the ladle's wall raises BadInputError when the lining is requested.
    """

    nodes: NodeMap
    grid: LegGrid
    moving: BarCells  # in the moving platform's frame, P of them
    fixed: BarCells
    ladle: LadleSections
    in_the_way_m: FloatArray  # boxes of the moving platform's bars in the disc's frame, shape (B, 2, 3)
    area_m2: FloatArray  # surface exposed to air, of all nodes but the legs', whose changes with the pose, shape (n,)
    # that surface times its view factor, of the moving platform, which moves with the ladle; zero for all other nodes
    view_area_m2: FloatArray
    entry: Layout
    properties: ThermalProperties

    @classmethod
    def of(cls, urdf: str, entry: Layout, properties: ThermalProperties, grid: LegGrid, bars: int) -> Self:
        """Cut them, ``bars``: cells of each bar; and compute view factors of the moving platform's faces."""
        ladle, clad = LadleSections.of(entry), properties.moving_platform.cladding_thickness.metres > 0.0
        boxes = [link_boxes(urdf, f"{name}_platform") for name in ("moving", "fixed")]
        moving, fixed = (BarCells.cut(part, bars) for part in boxes)
        in_the_way = merged(boxes[0]) - ladle.melt_centre_m
        normals = np.broadcast_to(FACE_NORMALS, (moving.count, 6, 3))
        points = moving.face_centres_m - ladle.melt_centre_m + _OFF_THE_FACE_M * normals
        disc = DiscChords.of(ladle.melt_radius_m, count=128)
        faces, facing = points.reshape(-1, 1, 3), normals.reshape(-1, 1, 3)
        factors = hidden_view_factors(faces, faces[:, 0], facing, disc, in_the_way).reshape(moving.count, 6)
        covered = (factors > 0.0) & clad  # faces that see the melt, unless the bars are bare
        clad_cells = np.flatnonzero(np.sum(moving.face_area_m2 * covered, axis=1) > 0.0)
        nodes = NodeMap.of(grid, moving.count, clad_cells, fixed.count)
        surfaces = []
        for exposed in (moving.face_area_m2, moving.face_area_m2 * factors):
            surface = np.zeros(nodes.count)
            surface[nodes.moving_platform] = np.sum(exposed * ~covered, axis=1)
            surface[nodes.cladding] = np.sum(exposed * covered, axis=1)[clad_cells]
            surfaces.append(surface)
        area, view = surfaces
        area[nodes.fixed_platform], area[nodes.shell] = fixed.face_area_m2.sum(axis=1), ladle.outer_area_m2
        return cls(nodes, grid, moving, fixed, ladle, in_the_way, area, view, entry, properties)

    @property
    def lining_m(self) -> float:
        """Thickness of the lining: the ladle's wall without the shell."""
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

    def capacities(self) -> FloatArray:
        """Return the heat capacity of every node, shape (n,), in J/K."""
        nodes, grid, moving, ladle, properties = self.nodes, self.grid, self.moving, self.ladle, self.properties
        steel = self.entry.materials.steel_density.value * properties.steel.heat_capacity.value
        insulation = properties.insulation.density.value * properties.insulation.heat_capacity.value
        capacity = np.zeros(nodes.count)
        capacity[nodes.legs] = steel * grid.section_m2 * grid.step_m
        capacity[nodes.moving_platform] = steel * moving.volume_m3
        capacity[nodes.fixed_platform] = steel * self.fixed.volume_m3
        # Half of the cladding's capacity belongs to its surface, half to the bar.
        half = 0.5 * insulation * self.area_m2[nodes.cladding] * self.cladding_m
        capacity[nodes.cladding] = half
        capacity[nodes.moving_platform[nodes.clad_cells]] += half
        capacity[nodes.lining] = insulation * ladle.conducting_area_m2 * self.lining_m / LINING_LAYERS
        capacity[nodes.shell] = steel * ladle.outer_area_m2 * properties.ladle.shell_thickness.metres
        return capacity
