r"""DH errors from displaced joint placements, exactly.

Six placements of a chain hold 36 numbers, a DH chain 32, and the pose of its end depends on 24 of them over all joint
values: a displacement along or about a joint's axis can be assigned before or behind the joint (2 for each of the
five), and for the prismatic joint so can any lateral shift (2 more). So both sides are compared up to a transform
:math:`H_k` that commutes with the motion of joint k:

.. math:: T_k(\delta) = H_{k-1}^{-1} \, T_k^{\text{asked}} \, H_k, \qquad H_0 = H_6 = 1

These 36 equations are solved by Newton's method; of the solutions the one with the smallest
:math:`\sum (\delta / \text{scale})^2` is taken, with the paper's error sizes as scales (0.2 mm, 4 mrad). At the
solution the DH errors are in the row space of their own linearised equations: the condition of the constrained minimum
itself, not of its first-order approximation. The residuals of the equations converge quadratically, the size of the
errors linearly, and faster for smaller errors (10 steps at 5 mm and 5 mrad).
"""

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import NoSolutionError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.robot.dh.chain import JOINT_KINDS, SITES, DHChain, adjoint, inverse

# The error sizes of the paper's study (its section 4.3); here they only weight lengths against angles.
LENGTH_SCALE_M = 2e-4
ANGLE_SCALE_RAD = 4e-3

_ITERATIONS = 150
_CLOSED = 1e-14  # m and rad
_SETTLED = 1e-13  # the remaining error after a step of this size is far smaller
# Twists that commute with the motion of a joint along or about its z axis.
_COMMUTING = {"R": (2, 5), "P": (0, 1, 2, 5)}
_SLIDES = [(joint, component) for joint, kind in enumerate(JOINT_KINDS) for component in _COMMUTING[kind]]


def fit_errors(chain: DHChain, displacements: FloatArray, fitted: BoolArray) -> FloatArray:
    """Return the smallest DH errors (8, 4), in m and rad, that are equivalent to displaced joints of a chain.

    Args:
        chain: the nominal chain.
        displacements: E of its six sites, shape (6, 4, 4).
        fitted: which DH parameters may have an error, boolean (8, 4).

    Raises:
        NoSolutionError: Newton's method does not converge; the displacements are not small errors.
    """
    import scipy.linalg

    asked = chain.targets(displacements)
    errors, slides = np.zeros((8, 4)), np.tile(np.eye(4), (7, 1, 1))
    scales = np.tile([LENGTH_SCALE_M, ANGLE_SCALE_RAD], (8, 2))[fitted]
    for _ in range(_ITERATIONS):
        wanted = inverse(slides[:-1]) @ asked @ slides[1:]
        gaps = inverse(wanted) @ chain.site_transforms(errors)
        residual = np.array([pin.log6(pin.SE3(gap)).vector for gap in gaps]).ravel()
        columns, costless = _error_columns(chain, errors)[:, fitted], _slide_columns(wanted)
        blind = scipy.linalg.null_space(costless.T).T
        shown = blind @ columns
        weighted = scipy.linalg.lstsq(shown * scales, shown @ errors[fitted] - blind @ residual)[0]
        step = weighted * scales - errors[fitted]
        errors[fitted] += step
        slides = _slide(slides, scipy.linalg.lstsq(costless, -residual - columns @ step)[0])
        if np.abs(residual).max() < _CLOSED and np.abs(step).max(initial=0.0) < _SETTLED:
            return errors
    raise NoSolutionError(
        f"chain {chain.number}: no DH errors found for these joint placements ({np.abs(residual).max():.1e} m or rad "
        f"left after {_ITERATIONS} Newton steps, the last one of {np.abs(step).max():.1e}); give errors of mm and mrad"
    )


def _error_columns(chain: DHChain, errors: FloatArray) -> FloatArray:
    """Return the body twists of the six sites per unit of each DH number, shape (36, 8, 4)."""
    columns = np.zeros((6, 8, 4, 6))
    columns[SITES, range(8)] = chain.site_twists(errors)
    return np.moveaxis(columns, -1, 1).reshape(36, 8, 4)


def _slide_columns(wanted: FloatArray) -> FloatArray:
    """Return how the residuals of the six sites change with each step of the slides, shape (36, 12)."""
    backward, columns = adjoint(inverse(wanted)), np.zeros((6, 6, len(_SLIDES)))
    for k, (joint, component) in enumerate(_SLIDES):
        columns[joint, component, k] = -1.0
        columns[joint + 1, :, k] = backward[joint + 1, :, component]
    return columns.reshape(36, -1)


def _slide(slides: FloatArray, steps: FloatArray) -> FloatArray:
    """Return the transforms H_k after a step along the twists that commute with each joint; they remain a group."""
    twists = np.zeros((7, 6))
    for (joint, component), step in zip(_SLIDES, steps, strict=True):
        twists[joint + 1, component] = step
    return np.asarray(slides @ [pin.exp6(twist).homogeneous for twist in twists])
