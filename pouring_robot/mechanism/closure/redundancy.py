r"""What redundant drives disagree by: the part of the loops' residual that no pose takes away.

A mechanism with more drives than freedoms closes at the minimum of its energy, where :math:`J_f^T W^2 e = 0` for the
free joints f (e the loops' residual, W² its stiffness over that of translations). What is left lies in the null space
of :math:`(W J_f)^T`. The directions of it that the drives move at all, orthonormal columns B, give

.. math:: z = B^T W e \in R^r, \qquad \partial z / \partial p = B^T W\, \partial e / \partial p |_q

in m, r the number of redundant drives. As :math:`|z|^2` is twice the least energy over the stiffness, its derivative is
exact whatever the residual (envelope theorem): joints give way, but to first order that costs nothing. Where lines or
legs may turn freely at both ends, z is the least correction of their lengths that closes the loops.

What loops leave open that no drive moves (axes that are not parallel) strains the parts and is seen by no encoder: it
is not in z.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.placement_derivatives import PlacedTwists
from pouring_robot.mechanism.closure.solver import LEAST_SINGULAR_VALUE, ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import DriveParameter, LocalParameter

_MOVES = 1e-6
"""m of gap per m or rad of a drive: below, no drive moves a direction."""


def redundant_drives(mechanism: ClosedChainMechanism) -> int:
    """Return by how many drives outnumber their freedoms: 0 unless the robot file says so, or BadInputError if none.

    Counted as 6 or 3 equations a loop less the passive freedoms: no loop may hold anything twice.
    """
    if not mechanism.loops.redundant_drives:
        return 0
    equations = sum(3 if loop.type == "3d" else 6 for loop in mechanism.loops.loops)
    count = equations - mechanism.passive_columns.size
    if count < 1:
        raise BadInputError(
            f"redundant_drives: {equations} equations of the loops hold {mechanism.passive_columns.size} passive "
            "freedoms, so no drive is redundant; strike the key, or list all that is measured among the drives"
        )
    return count


def disagreement(
    solver: ClosureSolver, result: ClosureResult, parameters: Sequence[LocalParameter] = ()
) -> tuple[FloatArray, FloatArray]:
    """Return what redundant drives disagree by, shape (r,), and its derivative by parameters, shape (r, P), in m.

    ``result`` is a closure of the solver without loads; the parameters are of placements and drives.

    Raises:
        BadInputError: the drives are not redundant as the robot file says.
    """
    mechanism, energy = solver.mechanism, solver.energy
    count = redundant_drives(mechanism)
    state = energy.evaluate(result.configuration, result.configuration)
    pin.updateFramePlacements(energy.model, energy.data)
    weight = energy.root_stiffness / np.sqrt(mechanism.loops.stiffness_si[0])
    rows = weight * state.jacobian.reshape(-1, energy.model.nv)
    driven = rows @ mechanism.coupling[:, mechanism.drive_columns]
    left, sizes, _ = np.linalg.svd(rows @ energy.basis)
    held = left[:, np.count_nonzero(sizes > LEAST_SINGULAR_VALUE) :]
    turned, moved, _ = np.linalg.svd(held.T @ driven)
    if held.shape[1] < count or moved[count - 1] < _MOVES:
        raise BadInputError(f"the drives do not disagree in {count} ways here; are all loops needed, and all drives?")
    basis = _oriented(held @ turned[:, :count], driven)
    change = np.zeros((rows.shape[0], len(parameters)))
    for k, parameter in enumerate(parameters):
        if isinstance(parameter, DriveParameter):
            change[:, k] = driven[:, mechanism.loops.drives.index(parameter.joint)]
    if parameters:
        change += weight * energy.residual_change(state, PlacedTwists(mechanism, energy.data, parameters).columns())
    return basis.T @ (weight[:, 0] * state.residual.ravel()), basis.T @ change


def _oriented(basis: FloatArray, driven: FloatArray) -> FloatArray:
    """Return the basis turned so that rows that are alike get bases alike: towards a fixed answer to the drives.

    The first direction is the one in which all drives pull together, as lines in tension do.
    """
    count, drives = basis.shape[1], driven.shape[1]
    angles = np.pi / drives * (np.arange(drives)[:, None] + 0.5) * np.arange(count)
    left, _, right = np.linalg.svd(basis.T @ driven @ np.cos(angles))
    return np.asarray(basis @ (left @ right))
