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

A chain's numbers are read off the loaded nominal robot; nothing is typed in. Where the definition leaves a choice it
is made as follows:

* S_1 lies on S_2, with x_1 vertical and pointing down through the U-joint centre. So θ_2 is the joint's own value, d_1
  the way along S_1 to the centre, α_12 a turn about a vertical axis, α_01 a turn about x.
* An axis points as its URDF joint does, so a joint variable is a constant plus the URDF joint value.
* Between axes that meet, x_j is S_j × S_{j+1} in the upper and S_{j+1} × S_j in the lower half of the leg: α is +90°
  above, −90° below, and θ_4 is zero. Elsewhere a ≥ 0, that is, x_j points from S_j to S_{j+1}.

The paper's table of nominal values is lost. The place of S_1 and the direction of x_1 are the ones that give what its
text says of chain 1: seven errors that reach 1 mm, X as main direction of α_12 and θ_1 and Y of α_01, equal spread of
α_01 and θ_1, a narrow one of α_12. The signs change no size of an effect; with one
rule for both halves α_56 and θ_4 err by +1.3175 and −1.3175 mm, as the paper has it, with ours both by −1.3175.
"""

import functools
import itertools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
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
_GEOMETRY_TOLERANCE = 1e-9  # m and rad: looser than round-off, tighter than any machining error
_REPRODUCTION_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class DHChain:
    """One chain: its nominal DH numbers and where they sit in the URDF."""

    number: int  # 1 to 4, the place of its loop in the loops file
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
    """Return the matrices (n, 6, 6) that carry twists (linear, angular) through rigid transforms (n, 4, 4)."""
    return np.array([pin.SE3(transform).action for transform in transforms])


class NotUPUError(BadInputError):
    """A DH table was asked for a mechanism whose chains are not of the UPU kind.

    Attributes:
        chain: the loop at fault.
        problem: what differs, on one line.
    """

    def __init__(self, chain: str, problem: str) -> None:
        self.chain, self.problem = chain, problem
        super().__init__(
            f"'{chain}' is no UPU chain: {problem}; build the DH table on the nominal 4-UPU robot and give "
            "errors as errors of that table"
        )


@dataclass(frozen=True)
class _Line:
    """An axis in space: a point on it and its unit direction, both shape (3,)."""

    point: FloatArray
    direction: FloatArray


@dataclass(frozen=True)
class _Placements:
    """A chain as the URDF has it, relative to O and o; homogeneous matrices.

    ``sites`` are the placements of S1 to S5 and of the seat, ``foot`` and ``rest`` the closing frames on the last
    joint and on the seat, ``axes`` the joint axes in their own frames, shape (5, 3).
    """

    joints: tuple[str, ...]
    sites: FloatArray
    foot: FloatArray
    rest: FloatArray
    axes: FloatArray


def dh_chain(mechanism: ClosedChainMechanism, index: int) -> DHChain:
    """Derive the DH chain of one loop, counted from 0, of the nominal robot's mechanism.

    Raises NotUPUError where it is not R R P R R from base to end frame, or axes of a U joint meet at another angle.
    """
    name = mechanism.anchors[index].name
    placements = _read_placements(mechanism, index)
    at_zero = _poses_at_zero(placements)
    frames = _dh_frames(_axes(placements, at_zero, name), at_zero[-1], name)
    nominal = np.array([_dh_values(inverse(frames[k]) @ frames[k + 1]) for k in range(len(TRANSFORMS))])
    carried = inverse(at_zero[:5]) @ frames[3:8]  # DH frame on each joint's axis, seen from the URDF joint
    before, after = np.zeros((6, 4, 4)), np.zeros((6, 4, 4))
    before[0], after[0] = inverse(placements.sites[0]), inverse(carried[0])
    for k in range(1, SEAT):
        before[k], after[k] = inverse(placements.sites[k]) @ carried[k - 1], inverse(carried[k])
    before[SEAT] = inverse(placements.sites[SEAT])
    after[SEAT] = inverse(carried[4]) @ placements.foot @ inverse(placements.rest)
    for array in (nominal, before, after):
        array.setflags(write=False)
    chain = DHChain(index + 1, placements.joints, nominal, before, after)
    worst = float(np.abs(chain.displacements(np.zeros((8, 4))) - np.eye(4)).max())
    if worst > _REPRODUCTION_TOLERANCE:
        raise NotUPUError(name, f"its DH product misses the joint placements by {worst:.1e}")
    return chain


def _read_placements(mechanism: ClosedChainMechanism, index: int) -> _Placements:
    """Read one chain out of the Pinocchio model, checking its structure."""
    model, anchor, loop = mechanism.shared_model, mechanism.anchors[index], mechanism.loops.loops[index]
    if anchor.kind != "6d" or mechanism.loops.end_frame is None:
        raise NotUPUError(anchor.name, "its loop must be of type 6d, and the loops file must name the end frame")
    base = model.frames[mechanism.frame_id(mechanism.loops.base_frame)]
    end = model.frames[mechanism.frame_id(mechanism.loops.end_frame)]
    seat = model.frames[model.frames[mechanism.frame_id(loop.frame_b)].parentFrame]
    if anchor.joint_b != end.parentJoint or seat.type != pin.FrameType.FIXED_JOINT:
        raise NotUPUError(anchor.name, f"'{loop.frame_b}' is not fixed to '{end.name}' by a joint of its own")
    ids: list[int] = []
    joint = anchor.joint_a
    while joint not in (0, base.parentJoint):
        ids.insert(0, joint)
        joint = model.parents[joint]
    axes = _joint_axes(mechanism, ids, anchor.name)
    if joint != base.parentJoint:
        raise NotUPUError(anchor.name, f"it does not hang from '{base.name}'")
    sites = [np.array(model.jointPlacements[j].homogeneous) for j in ids]
    sites[0] = np.array(base.placement.inverse().homogeneous) @ sites[0]
    sites.append(np.array((end.placement.inverse() * seat.placement).homogeneous))
    return _Placements(
        joints=(*(str(model.names[j]) for j in ids), str(seat.name)),
        sites=np.stack(sites),
        foot=np.array(anchor.placement_a.homogeneous),
        rest=np.array((seat.placement.inverse() * anchor.placement_b).homogeneous),
        axes=axes,
    )


def _joint_axes(mechanism: ClosedChainMechanism, ids: list[int], chain: str) -> FloatArray:
    """Return the axis of each joint in its own frame, shape (5, 3), once the joints prove to be R R P R R."""
    kinds, axes = "", []
    for joint, column in zip(ids, mechanism.joint_axes(ids), strict=True):
        linear, angular = column[:3], column[3:]
        pure = mechanism.shared_model.nvs[joint] == 1 and (not linear.any() or not angular.any())
        kinds += ("R" if angular.any() else "P") if pure else "?"
        axes.append(np.array(angular if angular.any() else linear))
    if kinds != JOINT_KINDS:
        raise NotUPUError(chain, f"its joints are {' '.join(kinds) or 'none'}, not {' '.join(JOINT_KINDS)}")
    return np.array(axes)


def _poses_at_zero(placements: _Placements) -> FloatArray:
    """Return the five joints and o in O with every joint at zero; shape (6, 4, 4)."""
    joints = [*itertools.accumulate(placements.sites[:SEAT], np.matmul)]
    return np.stack([*joints, joints[-1] @ placements.foot @ inverse(placements.sites[SEAT] @ placements.rest)])


def _axes(placements: _Placements, at_zero: FloatArray, chain: str) -> list[_Line]:
    """Return S_0 … S_6, S_o at joint value zero, once both U joints prove to be U joints."""
    joints = [_Line(at_zero[k][:3, 3], at_zero[k][:3, :3] @ placements.axes[k]) for k in range(5)]
    for k, (first, second) in enumerate(itertools.pairwise(joints)):
        names = f"the axes of '{placements.joints[k]}' and '{placements.joints[k + 1]}'"
        lean = abs(float(first.direction @ second.direction))
        if lean > _GEOMETRY_TOLERANCE:
            raise NotUPUError(chain, f"{names} are {lean * 1e3:.3g} mrad from a right angle")
        gap = abs(float(np.cross(first.direction, second.direction) @ (second.point - first.point)))
        if gap > _GEOMETRY_TOLERANCE:
            raise NotUPUError(chain, f"{names} miss each other by {gap * 1e3:.3g} mm")
    vertical = _Line(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    platform = _Line(at_zero[5][:3, 3], at_zero[5][:3, 2])
    return [vertical, joints[0], *joints, platform]


def _dh_frames(axes: list[_Line], end: FloatArray, chain: str) -> FloatArray:
    """Return the frames O, 0, 1, …, 6, o at joint value zero; shape (9, 4, 4)."""
    frames = [np.eye(4)]
    for j in range(7):
        line, following = axes[j], axes[j + 1]
        if j == 1:
            # S_1 and S_2 are one line; the U-joint centre, where S_3 crosses it, and the vertical fix the frame.
            foot, _ = _common_normal(axes[2], axes[3], chain)
            down = np.array([0.0, 0.0, -1.0])
            normal = down - (down @ line.direction) * line.direction
        else:
            foot, between = _common_normal(line, following, chain)
            turn = np.cross(line.direction, following.direction)
            lower_half = j in (4, 5)
            meet = float(np.linalg.norm(between)) < _GEOMETRY_TOLERANCE
            normal = (-turn if lower_half else turn) if meet else np.copysign(1.0, turn @ between) * turn
        frames.append(_frame(foot, normal / np.linalg.norm(normal), line.direction))
    return np.stack([*frames, end])


def _common_normal(line: _Line, other: _Line, chain: str) -> tuple[FloatArray, FloatArray]:
    """Return the foot of the common normal on ``line`` and the vector from there to ``other``."""
    turn = np.cross(line.direction, other.direction)
    squared = float(turn @ turn)
    if squared < _GEOMETRY_TOLERANCE:
        raise NotUPUError(chain, "the first or last joint is parallel to Z of its platform")
    across = other.point - line.point
    foot = line.point + (np.cross(across, other.direction) @ turn / squared) * line.direction
    return foot, (across @ turn / squared) * turn


def _frame(origin: FloatArray, x: FloatArray, z: FloatArray) -> FloatArray:
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = x, np.cross(z, x), z, origin
    return frame


def _dh_values(step: FloatArray) -> FloatArray:
    """Return a, α, d, θ of a transform that is known to be a DH transform; shape (4,)."""
    angles = np.arctan2([-step[1, 2], -step[0, 1]], [step[2, 2], step[0, 0]])
    angles[angles < _GEOMETRY_TOLERANCE - np.pi] += 2.0 * np.pi  # half a turn is +180°, whatever round-off says
    return np.array([step[0, 3], angles[0], step[:3, 2] @ step[:3, 3], angles[1]]) + 0.0
