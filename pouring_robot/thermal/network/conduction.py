"""Conductances between nodes: along rods and bars, through joints and layers, and from rod to rod at the nut."""

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.thermal.network.bodies import LINING_LAYERS, Bodies
from pouring_robot.thermal.network.heat_balance import chain_links, laplacian


def constant_conductances(bodies: Bodies) -> tuple[FloatArray, float]:
    """Return the Laplacian of conductances that no pose changes, (n, n), and that between melt and lining, in W/K.

    They are for conduction along every rod and bar, across U joints, cladding and lining, and from the shell through
    trunnions to the hangers. Only the contact between moving and fixed rods changes with the pose
    (:func:`add_nut_contact`).
    """
    nodes, grid, moving, fixed, ladle = bodies.nodes, bodies.grid, bodies.moving, bodies.fixed, bodies.ladle
    entry, contact = bodies.entry, bodies.properties.contact
    steel, insulation = (part.conductivity.value for part in (bodies.properties.steel, bodies.properties.insulation))
    rod_per_step, *_, housing_per_step = steel * grid.section_m2 / grid.step_m
    drop, bearings = np.array([0.0, 0.0, entry.leg.foot_drop.metres]), entry.fixed_platform.bearing_offset.metres
    # The upper U joint's heat is shared by the two elements of the fixed rod nearest to it.
    upper_shares = [float(np.interp(0.0, grid.fixed_middles_m, unit)) for unit in np.eye(grid.fixed)]
    links: list[tuple[int, int, float]] = []
    for i in range(len(LEGS)):
        rod, housing = nodes.legs[i, : grid.moving], nodes.legs[i, grid.moving :]
        links += chain_links(rod, rod_per_step) + chain_links(housing, housing_per_step)
        foot = moving.nearest(entry.moving_centres.metres[i] - drop)
        # The joint is at the rod's end, half an element from the node.
        lower_joint = 1.0 / (1.0 / contact.lower_joint.value + 0.5 / rod_per_step)
        links.append((int(rod[0]), int(nodes.moving_platform[foot]), lower_joint))
        for side in (-1.0, 1.0):
            bar = fixed.nearest(entry.fixed_centres.metres[i] + np.array([0.0, side * bearings, 0.0]))
            for head, share in zip(housing, upper_shares, strict=True):
                links.append((int(head), int(nodes.fixed_platform[bar]), 0.5 * share * contact.upper_joint.value))
    for cells, numbers in ((moving, nodes.moving_platform), (fixed, nodes.fixed_platform)):
        links += [(int(numbers[a]), int(numbers[b]), steel * shape) for a, b, shape in cells.contacts]
    for surface, cell in zip(nodes.cladding, nodes.clad_cells, strict=True):
        across = insulation * float(bodies.area_m2[surface]) / bodies.cladding_m
        links.append((int(surface), int(nodes.moving_platform[cell]), across))
    trunnion = steel * ladle.trunnion_area_m2 / ladle.trunnion_length_m
    hangers = [int(nodes.moving_platform[moving.nearest(point)]) for point in ladle.trunnions_m]
    links += [(nodes.shell, hanger, trunnion) for hanger in hangers]
    layer = insulation * ladle.conducting_area_m2 * LINING_LAYERS / bodies.lining_m
    links += chain_links(nodes.lining, layer)
    links.append((int(nodes.lining[-1]), nodes.shell, 2.0 * layer))
    return laplacian(nodes.count, links), 2.0 * layer


def add_nut_contact(bodies: Bodies, matrix: FloatArray, touching_m2: FloatArray) -> None:
    """Add, in place, the conductance where the moving rods touch the fixed ones, in W/K, to a Laplacian (n, n).

    Args:
        bodies: the bodies to whose nodes the matrix belongs.
        matrix: the Laplacian, changed in place.
        touching_m2: contact area between elements of the moving rod (N) and of the fixed rod (F), (4, N, F).
    """
    contact = bodies.properties.contact.nut.value * touching_m2
    for own, between in zip(bodies.nodes.legs, contact, strict=True):
        rod, housing = np.split(own, [bodies.grid.moving])
        matrix[np.ix_(rod, housing)] -= between
        matrix[np.ix_(housing, rod)] -= between.T
        matrix[rod, rod] += between.sum(axis=1)
        matrix[housing, housing] += between.sum(axis=0)
