r"""Denavit-Hartenberg description of one UPU chain, and how its errors displace joint placements.

The chain is a product of eight transforms O→0→1→…→6→o (modified convention, in which frame j lies on axis j; J. J.
Craig, Introduction to Robotics, ch. 3):

.. math:: T_{j-1,j} = T_x(a_{j-1,j})\, R_x(\alpha_{j-1,j})\, T_z(d_j)\, R_z(\theta_j)

Axis S_j is the z axis of frame j, and x_j is the common normal of S_j and S_{j+1}. S_0 is Z of the fixed platform, S_2
to S_6 are the joints, S_o is z of the moving platform.

Errors. T_x commutes with R_x and T_z with R_z, and the joint moves along or about z, so every DH error is a constant
displacement of one joint's placement. The six placements of a chain ("sites": S1 to S5 in the URDF's numbering, and
the seat on the moving platform) hold the eight transforms as ``SITES`` says. With the constant matrices ``before`` and
``after``, which depend on the nominal geometry alone, the displacement of a joint is *exactly*

.. math:: E_k = \text{before}_k \, T_k \, \text{after}_k, \qquad E_6 = \text{before}_6 \, T_6^{-1} \, \text{after}_6

where T_k is the product of the site's transforms with errors at joint value zero. The seat is inverse because the
chain passes it from the foot to the platform, against the direction in which the URDF places it.

Matrices are homogeneous, shape (..., 4, 4), in m; twists are ordered (linear, angular), as in Pinocchio.

A chain's numbers are computed from the loaded nominal robot; none is typed in. Where the definition leaves a choice, it
is made as follows:

* S_1 lies on S_2, with x_1 vertical and pointing down through the U-joint centre. So θ_2 is the joint's own value, d_1
  the distance along S_1 to the centre, α_12 a rotation about a vertical axis, α_01 a rotation about x.
* An axis points as its URDF joint does, so a joint variable is a constant plus the URDF joint value.
* Between axes that meet, x_j is S_j × S_{j+1} in the upper and S_{j+1} × S_j in the lower half of the leg: α is +90°
  above, −90° below, and θ_4 is zero. Elsewhere a ≥ 0, that is, x_j points from S_j to S_{j+1}.

The paper's table of nominal values is lost. The position of S_1 and the direction of x_1 are those that reproduce what
its text says of chain 1: seven errors that reach 1 mm, X as main direction of α_12 and θ_1 and Y of α_01, equal spread
of α_01 and θ_1, a narrow one of α_12. The signs do not change the size of an effect: with one rule for both halves,
α_56 and θ_4 err by +1.3175 and −1.3175 mm as in the paper, with ours both by −1.3175.
"""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray, ReadOnly
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism

TRANSFORMS = ("O0", "01", "12", "23", "34", "45", "56", "6o")
SYMBOLS = ("a", "alpha", "d", "theta")
A, ALPHA, D, THETA = range(4)
# Which placement of the chain each transform displaces: S1, S2, S3, S4, S5, seat.
SITES = (0, 0, 0, 1, 2, 3, 4, 5)
SEAT = 5
# Where the value of each of the five joints enters: (transform, symbol).
VARIABLES = ((2, THETA), (3, THETA), (4, D), (5, THETA), (6, THETA))
JOINT_KINDS = "RRPRR"
Line = tuple[FloatArray, FloatArray]
"""An axis in space: a point on it and its unit direction, (3,) each."""
_GEOMETRY_TOLERANCE = 1e-9  # m and rad: looser than round-off, tighter than any machining error
_REPRODUCTION_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class DHChain(ReadOnly):
    """One chain: its nominal DH parameters and their places in the URDF."""

    number: int  # 1 to 4, the position of its loop in the loops file
    joints: tuple[str, ...]  # the six URDF joints whose placements make up the chain; the last is the (fixed) seat
    nominal: FloatArray  # a, α, d, θ of the eight transforms at joint value zero, shape (8, 4), in m and rad
    before: FloatArray  # constant matrices of the six sites, shape (6, 4, 4); ``after`` likewise (see module docstring)
    after: FloatArray

    def poses(self, joint_values: FloatArray, errors: FloatArray) -> FloatArray:
        """Return the pose of o in O at joint values (..., 5) with errors (8, 4); shape (..., 4, 4)."""
        values = np.zeros((*joint_values.shape[:-1], 8, 4))
        for k, (transform, symbol) in enumerate(VARIABLES):
            values[..., transform, symbol] = joint_values[..., k]
        transforms = dh_transform(values + (self.nominal + errors))
        return np.asarray(functools.reduce(np.matmul, np.moveaxis(transforms, -3, 0)))

    def site_transforms(self, errors: FloatArray) -> FloatArray:
        """Return the product of each site's transforms at joint value zero, for (..., 8, 4); shape (..., 6, 4, 4)."""
        transforms = dh_transform(self.nominal + errors)
        first = transforms[..., 0, :, :] @ transforms[..., 1, :, :] @ transforms[..., 2, :, :]
        return np.asarray(np.concatenate([first[..., None, :, :], transforms[..., 3:, :, :]], axis=-3))

    def displacements(self, errors: FloatArray) -> FloatArray:
        """Return the displacement E of each site, (..., 6, 4, 4), exactly equivalent to DH errors (..., 8, 4)."""
        sites = self.site_transforms(errors)
        sites[..., SEAT, :, :] = inverse(sites[..., SEAT, :, :])
        return np.asarray(self.before @ sites @ self.after)

    def targets(self, displacements: FloatArray) -> FloatArray:
        """Return the site transforms equivalent to displacements (6, 4, 4): the inverse of :meth:`displacements`."""
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
        # The first site holds three transforms: transform the twists of the first two to its end.
        twists[0] = twists[0] @ pin.SE3(transforms[1] @ transforms[2]).inverse().action.T
        twists[1] = twists[1] @ pin.SE3(transforms[2]).inverse().action.T
        return twists

    def placement_twists(self) -> FloatArray:
        """Return the twist of the displaced joint, in its placement frame, per unit of each DH number; (8, 4, 6)."""
        errors = np.zeros((8, 4))
        twists = self.site_twists(errors)
        twists[7] = -twists[7] @ pin.SE3(self.site_transforms(errors)[SEAT]).action.T
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


def adjoint(transforms: FloatArray) -> FloatArray:
    """Return the adjoint matrices (n, 6, 6), for twists (linear, angular), of rigid transforms (n, 4, 4)."""
    return np.array([pin.SE3(transform).action for transform in transforms])


class NotUPUError(BadInputError):
    """A DH table was requested for a mechanism whose chains are not UPU chains."""

    def __init__(self, chain: str, problem: str) -> None:
        super().__init__(
            f"'{chain}' is no UPU chain: {problem}; build the DH table on the nominal 4-UPU robot and give "
            "errors as errors of that table"
        )


def dh_chain(mechanism: ClosedChainMechanism, index: int) -> DHChain:
    """Derive the DH chain of one loop, counted from 0, of the nominal robot's mechanism.

    Raises NotUPUError where it is not R R P R R from base to end frame, or U-joint axes do not meet at a right angle.
    """
    name = mechanism.loops.names[index]
    joints, sites, closing, own_axes = _read_placements(mechanism, index)
    at_zero = [*itertools.accumulate(sites[:SEAT], np.matmul)]  # poses of the five joints in O
    lines = [(pose[:3, 3], pose[:3, :3] @ axis) for pose, axis in zip(at_zero, own_axes, strict=True)]
    _check_u_joints(lines, joints, name)
    end = at_zero[-1] @ closing @ inverse(sites[SEAT])
    vertical, platform = (np.zeros(3), np.array([0.0, 0.0, 1.0])), (end[:3, 3], end[:3, 2])
    frames = _dh_frames([vertical, lines[0], *lines, platform], end, name)
    nominal = np.array([_dh_values(inverse(frames[k]) @ frames[k + 1]) for k in range(len(TRANSFORMS))])
    carried = inverse(np.stack(at_zero)) @ frames[3:8]  # DH frame on each joint's axis, in the URDF joint's frame
    before, after = inverse(sites), np.zeros((6, 4, 4))
    before[1:SEAT] = before[1:SEAT] @ carried[:-1]
    after[:SEAT], after[SEAT] = inverse(carried), inverse(carried[-1]) @ closing
    chain = DHChain(index + 1, joints, nominal, before, after)
    worst = float(np.abs(chain.displacements(np.zeros((8, 4))) - np.eye(4)).max())
    if worst > _REPRODUCTION_TOLERANCE:
        raise NotUPUError(name, f"its DH product misses the joint placements by {worst:.1e}")
    return chain


def _read_placements(
    mechanism: ClosedChainMechanism, index: int
) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray]:
    """Return a chain as in the URDF, relative to O and o, after checks of its structure.

    These are the six joints whose placements make it up, the last of them the seat; these placements, (6, 4, 4); the
    transform from the last joint to the seat where the loop is closed, (4, 4); and the joint axes in their own frames,
    (5, 3).
    """
    model, (a, b), loop = mechanism.shared_model, mechanism.anchors[index], mechanism.loops.loops[index]
    if loop.type != "6d" or mechanism.loops.end_frame is None:
        raise NotUPUError(loop.name, "its loop must be of type 6d, and the loops file must name the end frame")
    base = model.frames[mechanism.frame_id(mechanism.loops.base_frame)]
    end = model.frames[mechanism.frame_id(mechanism.loops.end_frame)]
    seat = model.frames[model.frames[mechanism.frame_id(loop.frame_b)].parentFrame]
    if b.parentJoint != end.parentJoint or seat.type != pin.FrameType.FIXED_JOINT:
        raise NotUPUError(loop.name, f"'{loop.frame_b}' is not fixed to '{end.name}' by a joint of its own")
    support = [0, *list(model.supports[a.parentJoint])[1:]]
    if base.parentJoint not in support:
        raise NotUPUError(loop.name, f"it does not hang from '{base.name}'")
    ids = support[support.index(base.parentJoint) + 1 :]
    axes = _joint_axes(mechanism, ids, loop.name)
    first, *others = (model.jointPlacements[j] for j in ids)
    sites = [base.placement.inverse() * first, *others, end.placement.inverse() * seat.placement]
    closing = a.placement * (b.placement.inverse() * seat.placement)
    names = (*(str(model.names[j]) for j in ids), str(seat.name))
    return names, np.stack([site.homogeneous for site in sites]), np.array(closing.homogeneous), axes


def _joint_axes(mechanism: ClosedChainMechanism, ids: list[int], chain: str) -> FloatArray:
    """Return the axis of each joint in its own frame, shape (5, 3), after a check that the joints are R R P R R."""
    twists, freedoms = mechanism.joint_axes(ids), mechanism.shared_model.nvs
    kinds = ["?" if freedoms[j] != 1 else "R" if twist[3:].any() else "P" for j, twist in zip(ids, twists, strict=True)]
    if kinds != [*JOINT_KINDS]:
        raise NotUPUError(chain, f"its joints are {' '.join(kinds) or 'none'}, not {' '.join(JOINT_KINDS)}")
    return np.array([twist[3:] if kind == "R" else twist[:3] for twist, kind in zip(twists, kinds, strict=True)])


def _check_u_joints(lines: Sequence[Line], joints: Sequence[str], chain: str) -> None:
    """Refuse consecutive axes that do not meet at a right angle."""
    for k, ((point, axis), (other, following)) in enumerate(itertools.pairwise(lines)):
        names = f"the axes of '{joints[k]}' and '{joints[k + 1]}'"
        lean = abs(float(axis @ following))
        if lean > _GEOMETRY_TOLERANCE:
            raise NotUPUError(chain, f"{names} are {lean * 1e3:.3g} mrad from a right angle")
        gap = abs(float(np.cross(axis, following) @ (other - point)))
        if gap > _GEOMETRY_TOLERANCE:
            raise NotUPUError(chain, f"{names} miss each other by {gap * 1e3:.3g} mm")


def _dh_frames(lines: Sequence[Line], end: FloatArray, chain: str) -> FloatArray:
    """Return the frames O, 0, 1, …, 6, o at joint value zero of the axes S_0 … S_6, S_o; shape (9, 4, 4)."""
    frames = np.tile(np.eye(4), (9, 1, 1))
    for j, ((point, axis), (other, following)) in enumerate(itertools.pairwise(lines)):
        if j == 1:
            # S_1 and S_2 are one line; the U-joint centre, where S_3 crosses it, and the vertical determine the frame.
            foot, _ = _common_normal(*lines[2], *lines[3], chain)
            down = np.array([0.0, 0.0, -1.0])
            normal = down - (down @ axis) * axis
        else:
            foot, between = _common_normal(point, axis, other, following, chain)
            turn = np.cross(axis, following)
            lower_half = j in (4, 5)
            meet = float(np.linalg.norm(between)) < _GEOMETRY_TOLERANCE
            normal = (-turn if lower_half else turn) if meet else np.copysign(1.0, turn @ between) * turn
        x = normal / np.linalg.norm(normal)
        frames[j + 1, :3] = np.column_stack([x, np.cross(axis, x), axis, foot])
    frames[-1] = end
    return frames


def _common_normal(
    point: FloatArray, axis: FloatArray, other: FloatArray, following: FloatArray, chain: str
) -> tuple[FloatArray, FloatArray]:
    """Return the foot of the common normal on the first of two lines, and the vector from it to the second."""
    turn = np.cross(axis, following)
    squared = float(turn @ turn)
    if squared < _GEOMETRY_TOLERANCE:
        raise NotUPUError(chain, "the first or last joint is parallel to Z of its platform")
    across = other - point
    foot = point + (np.cross(across, following) @ turn / squared) * axis
    return foot, (across @ turn / squared) * turn


def _dh_values(step: FloatArray) -> FloatArray:
    """Return a, α, d, θ of a transform that must be a DH transform; shape (4,)."""
    angles = np.arctan2([-step[1, 2], -step[0, 1]], [step[2, 2], step[0, 0]])
    angles[angles < _GEOMETRY_TOLERANCE - np.pi] += 2.0 * np.pi  # half a turn is +180°, regardless of round-off
    return np.array([step[0, 3], angles[0], step[:3, 2] @ step[:3, 3], angles[1]]) + 0.0
