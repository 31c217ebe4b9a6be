r"""The disagreement of redundant drives: the part of the loops' residual that no pose removes.

A mechanism with more drives than freedoms closes at the minimum of its energy, where :math:`J_f^T W^2 e = 0` for the
free joints f (e the loops' residual, W² its stiffness over that of translations). The remaining residual lies in the
null space of :math:`(W J_f)^T`. Those of its directions that the drives move at all, orthonormal columns B, give

.. math:: z = B^T W e \in R^r, \qquad \partial z / \partial p = B^T W\, \partial e / \partial p |_q

in m, r the number of redundant drives. As :math:`|z|^2` is twice the least energy over the stiffness, its derivative is
exact whatever the residual (envelope theorem): joints respond, but to first order this does not change the energy.
Where lines or legs may turn freely at both ends, z is the least correction of their lengths that closes the loops.

Residuals that no drive moves (axes that are not parallel) strain the parts, and no encoder measures them: they are not
in z.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import EnergyState
from pouring_robot.mechanism.closure.placement_derivatives import PlacedTwists
from pouring_robot.mechanism.closure.solver import LEAST_SINGULAR_VALUE, ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import DriveParameter, LocalParameter

_MOVES = 1e-6
"""m of gap per m or rad of a drive; with less, no drive moves a direction."""


def redundant_drives(mechanism: ClosedChainMechanism) -> int:
    """Return how many drives exceed the freedoms: 0 unless the robot file states redundancy; BadInputError if none do.

    That is the number of ways in which drives open loops that no passive joint closes, in any pose of the tree but
    special ones. It is counted on the drawing, in which a planar mechanism is planar: one built slightly off it strains
    its parts.
    """
    if not mechanism.loops.redundant_drives:
        return 0
    if "redundant" not in mechanism.drawn:
        mechanism.drawn["redundant"] = _outnumbering(mechanism)
    return mechanism.drawn["redundant"]


def _outnumbering(mechanism: ClosedChainMechanism) -> int:
    drawn = mechanism.displaced({joint: error.inverse() for joint, error in mechanism.errors.items()})
    model, anywhere = drawn.shared_model, np.random.default_rng(0).uniform(-1.0, 1.0, drawn.shared_model.nv)
    anywhere[np.setdiff1d(np.arange(model.nv), drawn.closing_columns)] = 0.0
    pose = pin.integrate(model, drawn.neutral_configuration(), drawn.coupling @ anywhere)
    rows = _opening(ClosureSolver(drawn), pose)[1]
    passive, all_joints = (
        np.linalg.matrix_rank(rows @ drawn.coupling[:, columns], LEAST_SINGULAR_VALUE)
        for columns in (drawn.passive_columns, drawn.closing_columns)
    )
    if all_joints == passive:
        raise BadInputError(
            f"redundant_drives: whatever the {len(drawn.drive_columns)} drives do, the passive joints close the loops; "
            "strike the key, or list all that is measured among the drives"
        )
    return int(all_joints - passive)


def _opening(solver: ClosureSolver, configuration: FloatArray) -> tuple[EnergyState, FloatArray]:
    """Return the energy's state at a configuration (nq,), and the weighted Jacobian of the loops, (6 loops, nv)."""
    energy = solver.energy
    state = energy.evaluate(configuration, configuration)
    return state, _weight(solver) * state.jacobian.reshape(-1, energy.model.nv)


def _weight(solver: ClosureSolver) -> FloatArray:
    return np.asarray(solver.energy.root_stiffness / np.sqrt(solver.mechanism.loops.stiffness_si[0]))


def disagreement(
    solver: ClosureSolver, result: ClosureResult, count: int, parameters: Sequence[LocalParameter] = ()
) -> tuple[FloatArray, FloatArray]:
    """Return the disagreement of redundant drives, shape (r,), and its derivative by parameters, shape (r, P), in m.

    ``result`` is a closure of the solver without loads; ``count`` is r, from :func:`redundant_drives`; the parameters
    are of placements and drives.

    Raises:
        BadInputError: the drives are not as redundant as the robot file states.
    """
    mechanism, energy, weight = solver.mechanism, solver.energy, _weight(solver)
    state, rows = _opening(solver, result.configuration)
    pin.updateFramePlacements(energy.model, energy.data)
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
    """Return the basis rotated towards a fixed response to the drives, so that similar rows get similar bases.

    The first direction is the one in which all drives pull together, as lines in tension do.
    """
    count, drives = basis.shape[1], driven.shape[1]
    angles = np.pi / drives * (np.arange(drives)[:, None] + 0.5) * np.arange(count)
    left, _, right = np.linalg.svd(basis.T @ driven @ np.cos(angles))
    return np.asarray(basis @ (left @ right))
