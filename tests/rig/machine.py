"""The mechanism, written independently of the package: point joints and axis vectors, quaternions, an energy minimum.

In the reference posture every body is upright: the legs hang straight down and the platform is level. There an axis is
a direction and a joint is a point; a pose is reached by rotating each joint about its axis. A chain has four rotations
and one slide,

    q_end = q(u1, θ1) q(u2, θ2) q(u4, θ3) q(u5, θ4),      b = A + q(u1, θ1) q(u2, θ2) (l n),

with u1 ∥ y, u2 ∥ x, n = −z, u4 ∥ x, u5 ∥ y in a faultless machine. The closure residual between the chain's end and the
platform is a gap and a twist; all four chains' gaps and twists, the twist weighted by a length of 32 mm, are minimised
over the platform pose and the passive joints. Units: metres and radians.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .rotations import Array, about, conjugate, from_vector, matrix, product, skew, turn

UPPER = np.array([[-340.0, 374.0, 0.0], [-340.0, -374.0, 0.0], [340.0, 374.0, 0.0], [340.0, -374.0, 0.0]]) / 1000.0
"""Upper U-joint centres A."""
LOWER = np.array([[-182.5, 330.0, 0.0], [-182.5, -330.0, 0.0], [182.5, 330.0, 0.0], [182.5, -330.0, 0.0]]) / 1000.0
"""Lower U-joint centres B."""
AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""u1, u2, n, u4, u5 in the reference posture."""
SOFTNESS = np.sqrt(1e5 / 1e8)
"""√(rotation stiffness / translation stiffness) of a leg [m]."""


@dataclass
class Errors:
    """What is wrong with the machine, one row a pose. Effects add up in here.

    Attributes:
        upper, lower: displacement of the U-joint centres on the fixed and moving platform (n, 4, 3) [m].
        tilt: turn of each axis u1, u2, n, u4, u5 of each chain in its own body (n, 4, 5, 3) [rad].
        length: of legs 1…4 beyond what the drive says; leg 4 is passive, its value does nothing (n, 4) [m].
        theta: of the last revolute of chain 4 (n,) [rad].
        base: displacement of the fixed platform, translation then rotation vector (n, 6) [m, rad].
        seen: what the metrology adds to the pose, translation then rotation vector (n, 6) [m, rad].
        scale: of the metrology's lengths (n,) [1].
    """

    upper: Array
    lower: Array
    tilt: Array
    length: Array
    theta: Array
    base: Array
    seen: Array
    scale: Array

    @classmethod
    def none(cls, rows: int) -> Errors:
        """Return a faultless machine."""
        sizes = [(4, 3), (4, 3), (4, 5, 3), (4,), (), (6,), (6,), ()]
        return cls(*(np.zeros((rows, *size)) for size in sizes))

    def __add__(self, other: Errors) -> Errors:
        """Return both together."""
        return Errors(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __mul__(self, factor: float) -> Errors:
        """Return them as many times as large."""
        return Errors(*(getattr(self, f.name) * factor for f in fields(self)))

    def local(self) -> Array:
        """Return what acts inside the loops as one vector a row: upper, lower, tilt, length, theta."""
        rows = len(self.theta)
        parts = (self.upper, self.lower, self.tilt, self.length, self.theta)
        return np.concatenate([part.reshape(rows, -1) for part in parts], axis=1)


@dataclass
class Poses:
    """Where the platform is, and what the closure left.

    Attributes:
        position: of the platform's origin in the fixed platform's frame (n, 3) [m].
        quaternion: of its orientation (n, 4).
        passive: joint values of the chains in the order θ1, θ2, θ3, then θ4 or leg 4's length (n, 4, 4).
        residual: gap [m] and twist [rad] of the four chains (n, 4, 6).
        by_drive: ∂(position, rotation)/∂(l1, l2, l3, θ46) (n, 6, 4).
        by_local: ∂(position, rotation)/∂(local errors) (n, 6, 89), if asked for.
    """

    position: Array
    quaternion: Array
    passive: Array
    residual: Array
    by_drive: Array
    by_local: Array | None


def drives_of(position: Array, tilt: Array) -> tuple[Array, Array]:
    """Return what the faultless drives read at poses: leg lengths (n, 4) [m] and θ46 (n,) [rad]."""
    leg, psi, _ = _legs(position, tilt)
    return leg, tilt - psi[:, 3]


def _legs(position: Array, tilt: Array) -> tuple[Array, Array, Array]:
    ends = position[:, None, :] + turn(about(AXES[0], tilt)[:, None, :], LOWER)
    d = ends - UPPER
    length = np.linalg.norm(d, axis=-1)
    return length, np.arctan2(-d[..., 0], -d[..., 2]), np.arcsin(d[..., 1] / length)


def close(
    lengths: Array, theta: Array, errors: Errors, near: tuple[Array, Array], at_joint: bool = True, local: bool = False
) -> Poses:
    """Return the poses at which the energy of the four chains is least.

    Args:
        lengths: commanded leg lengths 1…3 (n, 3) [m].
        theta: commanded θ46 (n,) [rad].
        errors: of the machine.
        near: position (n, 3) [m] and tilt (n,) [rad] to begin at, a centimetre or a degree off at most.
        at_joint: take the gap at the lower U joint; at the platform's origin otherwise.
        local: also return ∂pose/∂(local errors).
    """
    rows = len(theta)
    upper, lower = UPPER + errors.upper, LOWER + errors.lower
    axes = turn(from_vector(errors.tilt), AXES)
    length = np.zeros((rows, 4))
    length[:, :3] = lengths + errors.length[:, :3]
    foot = theta + errors.theta

    position, quaternion = near[0].copy(), about(AXES[0], near[1])
    leg4, psi, phi = _legs(*near)
    passive = np.stack([psi, phi, -phi, near[1][:, None] - psi], axis=-1)
    passive[:, 3, 3] = leg4[:, 3]

    weight = np.tile([1.0, 1.0, 1.0, SOFTNESS, SOFTNESS, SOFTNESS], 4)
    for _ in range(30):
        length[:, 3] = passive[:, 3, 3]
        last = passive[:, :, 3].copy()
        last[:, 3] = foot
        J, drive, slots, e = _gaps(position, quaternion, passive, last, length, upper, lower, axes, at_joint, local)
        J, e = J.reshape(rows, 24, 22) * weight[:, None], e.reshape(rows, 24) * weight
        Jt = J.transpose(0, 2, 1)
        normal = Jt @ J
        move = -np.linalg.solve(normal, Jt @ e[..., None])[..., 0]
        position = position + move[:, :3]
        quaternion = product(from_vector(move[:, 3:6]), quaternion)
        quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
        passive = passive + move[:, 6:].reshape(rows, 4, 4)
        if np.abs(move).max(initial=0.0) < 1e-12:
            break
    else:
        raise ArithmeticError(f"the machine does not close: the last step was {np.abs(move).max():.1e}")

    by_drive = -np.linalg.solve(normal, Jt @ (drive.reshape(rows, 24, 4) * weight[:, None]))[:, :6]
    by_local = None
    if local:
        by_local = -np.linalg.solve(normal, Jt @ (slots.reshape(rows, 24, -1) * weight[:, None]))[:, :6]
    return Poses(position, quaternion, passive, (e / weight).reshape(rows, 4, 6), by_drive, by_local)


def _gaps(
    position: Array,
    quaternion: Array,
    passive: Array,
    last: Array,
    length: Array,
    upper: Array,
    lower: Array,
    axes: Array,
    at_joint: bool,
    local: bool,
) -> tuple[Array, Array, Array, Array]:
    """Return ∂e/∂(pose, passive joints), ∂e/∂drives, ∂e/∂(local errors) and the gaps and twists e (n, 4, 6)."""
    rows = len(position)
    q1 = about(axes[:, :, 0], passive[:, :, 0])
    q2 = product(q1, about(axes[:, :, 1], passive[:, :, 1]))
    q3 = product(q2, about(axes[:, :, 3], passive[:, :, 2]))
    q4 = product(q3, about(axes[:, :, 4], last))
    n = turn(q2, axes[:, :, 2])
    arm = length[..., None] * n
    end = upper + arm
    plate = quaternion[:, None, :]
    held = lower if at_joint else np.zeros_like(lower)  # the point of the platform at which the gap is taken
    offset, reach = turn(plate, held), turn(q4, held - lower)

    twist = product(plate, conjugate(q4))
    twist = np.where(twist[..., :1] < 0.0, -twist, twist)
    e = np.concatenate([position[:, None, :] + offset - end - reach, 2.0 * twist[..., 1:]], axis=-1)
    scalar, v = twist[..., 0, None, None] * np.eye(3), skew(twist[..., 1:])
    by_plate, by_end = scalar - v, -(scalar + v)

    def turned(omega: Array, lever: Array) -> Array:
        """Return the change of e when the end turns by omega (…, 3) about a point ``lever`` away from it."""
        return np.concatenate([-np.cross(omega, lever), np.einsum("nijk,nik->nij", by_end, omega)], axis=-1)

    u = (axes[:, :, 0], turn(q1, axes[:, :, 1]), turn(q2, axes[:, :, 3]), turn(q3, axes[:, :, 4]))
    slide = np.concatenate([-n, np.zeros_like(n)], axis=-1)
    column = [turned(u[0], arm + reach), turned(u[1], arm + reach), turned(u[2], reach), turned(u[3], reach)]

    J = np.zeros((rows, 4, 6, 22))
    J[..., :3, :3] = np.eye(3)
    J[..., :3, 3:6] = -skew(offset)
    J[..., 3:, 3:6] = by_plate
    drive = np.zeros((rows, 4, 6, 4))
    for i in range(4):
        for k in range(3):
            J[:, i, :, 6 + 4 * i + k] = column[k][:, i]
        J[:, i, :, 9 + 4 * i] = column[3][:, i] if i < 3 else slide[:, i]
        drive[:, i, :, i] = slide[:, i] if i < 3 else column[3][:, i]
    if not local:
        return J, drive, np.zeros((rows, 4, 6, 0)), e

    slots = np.zeros((rows, 4, 6, 89))
    before = (np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), q1.shape), q1, q2, q2, q3)
    after = (q1, q2, None, q3, q4)
    levers = (arm + reach, arm + reach, None, reach, reach)
    for i in range(4):
        slots[:, i, :3, 3 * i : 3 * i + 3] = -np.eye(3)
        # The platform carries the held point, the chain's end turns about the joint.
        slots[:, i, :3, 12 + 3 * i : 15 + 3 * i] = matrix(plate[:, 0]) if at_joint else matrix(q4[:, i])
        for k in range(5):
            place = slice(24 + 15 * i + 3 * k, 27 + 15 * i + 3 * k)
            if k == 2:
                slots[:, i, :3, place] = matrix(q2[:, i]) @ skew(length[:, i, None] * axes[:, i, 2])
                continue
            stop, lever = after[k], levers[k]
            assert stop is not None and lever is not None
            change = matrix(before[k][:, i]) - matrix(stop[:, i])
            slots[:, i, :3, place] = skew(lever[:, i]) @ change
            slots[:, i, 3:, place] = by_end[:, i] @ change
        if i < 3:
            slots[:, i, :, 84 + i] = slide[:, i]
    slots[:, 3, :, 88] = column[3][:, 3]
    return J, drive, slots, e
