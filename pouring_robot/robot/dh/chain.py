r"""Denavit-Hartenberg description of one UPU chain, and how its errors displace joint placements.

The chain is a product of eight transforms O→0→1→…→6→o (modified convention, in which frame j lies on axis j; J. J.
Craig, Introduction to Robotics, ch. 3):

.. math:: T_{j-1,j} = T_x(a_{j-1,j})\, R_x(\alpha_{j-1,j})\, T_z(d_j)\, R_z(\theta_j)

Axis S_j is the z axis of frame j, and x_j is the common normal of S_j and S_{j+1}. S_0 is Z of the fixed platform, S_2
to S_6 are the joints, S_o is z of the moving platform; ``dh.derivation`` reads them off.

Errors. T_x commutes with R_x and T_z with R_z, and the joint moves along or about z, so every DH error is a constant
displacement of one joint's placement. The six placements of a chain ("sites": S1 to S5 in the URDF's numbering, and
the seat on the moving platform) hold the eight transforms as ``SITES`` says. With the constant matrices ``before`` and
``after``, which depend on the nominal geometry alone, the displacement of a joint is *exactly*

.. math:: E_k = \text{before}_k \, T_k \, \text{after}_k, \qquad E_6 = \text{before}_6 \, T_6^{-1} \, \text{after}_6

where T_k is the product of the site's transforms with errors at joint value zero. The seat is inverse because the
chain passes it from the foot to the platform, against the direction in which the URDF places it.

Matrices are homogeneous, shape (..., 4, 4), in m; twists are ordered (linear, angular), as in Pinocchio.
"""

from dataclasses import dataclass

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray

TRANSFORMS = ("O0", "01", "12", "23", "34", "45", "56", "6o")
SYMBOLS = ("a", "alpha", "d", "theta")
A, ALPHA, D, THETA = range(4)
# Which placement of the chain each transform displaces: S1, S2, S3, S4, S5, seat.
SITES = (0, 0, 0, 1, 2, 3, 4, 5)
SEAT = 5
# Where the value of each of the five joints enters: (transform, symbol).
VARIABLES = ((2, THETA), (3, THETA), (4, D), (5, THETA), (6, THETA))
JOINT_KINDS = "RRPRR"


@dataclass(frozen=True, eq=False)
class DHChain:
    """One chain: its nominal DH numbers and where they sit in the URDF."""

    number: int  # 1 to 4, the place of its loop in the loops file
    joints: tuple[str, ...]  # the six URDF joints whose placements make up the chain; the last is the (fixed) seat
    nominal: FloatArray  # a, α, d, θ of the eight transforms at joint value zero, shape (8, 4), in m and rad
    before: FloatArray  # constant matrices of the six sites, shape (6, 4, 4); ``after`` likewise (see module docstring)
    after: FloatArray

    def at(self, joint_values: FloatArray, errors: FloatArray) -> FloatArray:
        """Return the DH numbers at joint values (..., 5) with errors (8, 4); shape (..., 8, 4)."""
        values = np.zeros((*joint_values.shape[:-1], 8, 4))
        for k, (transform, symbol) in enumerate(VARIABLES):
            values[..., transform, symbol] = joint_values[..., k]
        return values + (self.nominal + errors)

    def poses(self, joint_values: FloatArray, errors: FloatArray) -> FloatArray:
        """Return the pose of o in O at joint values (..., 5) with errors (8, 4); shape (..., 4, 4)."""
        transforms = dh_transform(self.at(joint_values, errors))
        pose = transforms[..., 0, :, :]
        for k in range(1, len(TRANSFORMS)):
            pose = pose @ transforms[..., k, :, :]
        return np.asarray(pose)

    def site_transforms(self, errors: FloatArray) -> FloatArray:
        """Return the product of each site's transforms at joint value zero, for (..., 8, 4); shape (..., 6, 4, 4)."""
        transforms = dh_transform(self.nominal + errors)
        first = transforms[..., 0, :, :] @ transforms[..., 1, :, :] @ transforms[..., 2, :, :]
        return np.asarray(np.concatenate([first[..., None, :, :], transforms[..., 3:, :, :]], axis=-3))

    def displacements(self, errors: FloatArray) -> FloatArray:
        """Return the displacement E of each site that equals DH errors (..., 8, 4), exactly; shape (..., 6, 4, 4)."""
        sites = self.site_transforms(errors)
        sites[..., SEAT, :, :] = inverse(sites[..., SEAT, :, :])
        return np.asarray(self.before @ sites @ self.after)

    def targets(self, displacements: FloatArray) -> FloatArray:
        """Return the site transforms that given displacements (6, 4, 4) ask for: inverse of the former."""
        sites = inverse(self.before) @ displacements @ inverse(self.after)
        sites[SEAT] = inverse(sites[SEAT])
        return np.asarray(sites)

    def site_twists(self, errors: FloatArray) -> FloatArray:
        """Return the body twist of its site's transform per unit of each DH number; shape (8, 4, 6)."""
        values = self.nominal + errors
        transforms = dh_transform(values)
        twists = np.zeros((8, 4, 6))
        twists[:, D, 2] = twists[:, THETA, 5] = 1.0
        turn_back = adjoint(inverse(dh_transform(values * np.array([0.0, 0.0, 1.0, 1.0]))))
        twists[:, A], twists[:, ALPHA] = turn_back[:, :, 0], turn_back[:, :, 3]
        # The first site holds three transforms: carry the twists of the first two on to its end.
        twists[0] = twists[0] @ adjoint(inverse(transforms[1] @ transforms[2])).T
        twists[1] = twists[1] @ adjoint(inverse(transforms[2])).T
        return twists

    def placement_twists(self) -> FloatArray:
        """Return the twist of the displaced joint, in its placement frame, per unit of each DH number; (8, 4, 6)."""
        errors = np.zeros((8, 4))
        twists = self.site_twists(errors)
        twists[7] = -twists[7] @ adjoint(self.site_transforms(errors)[SEAT]).T
        carry = adjoint(inverse(self.after))[list(SITES)]
        return np.asarray(np.einsum("tij,tsj->tsi", carry, twists))


def dh_transform(values: FloatArray) -> FloatArray:
    """Return Tx(a) Rx(α) Tz(d) Rz(θ) for values (..., 4) in m and rad; shape (..., 4, 4)."""
    a, alpha, d, theta = np.moveaxis(np.asarray(values, dtype=float), -1, 0)
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    matrix = np.zeros((*a.shape, 4, 4))
    matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 3] = ct, -st, a
    matrix[..., 1, 0], matrix[..., 1, 1], matrix[..., 1, 2] = ca * st, ca * ct, -sa
    matrix[..., 2, 0], matrix[..., 2, 1], matrix[..., 2, 2] = sa * st, sa * ct, ca
    matrix[..., 1, 3], matrix[..., 2, 3], matrix[..., 3, 3] = -sa * d, ca * d, 1.0
    return matrix


def inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of rigid transforms (..., 4, 4)."""
    result = np.zeros_like(matrix)
    rotation = np.swapaxes(matrix[..., :3, :3], -1, -2)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, matrix[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def adjoint(matrix: FloatArray) -> FloatArray:
    """Return the matrices (..., 6, 6) that carry twists (linear, angular) through rigid transforms (..., 4, 4)."""
    rotation, offset = matrix[..., :3, :3], matrix[..., :3, 3]
    result = np.zeros((*matrix.shape[:-2], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotation
    # Column k of the coupling block is offset × (column k of the rotation).
    result[..., :3, 3:] = np.cross(offset[..., None, :], np.swapaxes(rotation, -1, -2)).swapaxes(-1, -2)
    return result
