"""The geometry of a mechanism as plain arrays, for the compiled kernels.

In a star, serial chains of one-freedom joints start on one body and end on one common free body. A serial arm is a star
of one chain whose joints are all driven or locked: the body at its tip follows. Everything is read from the mechanism's
Pinocchio model. Each joint frame is turned so that the joint's axis is its z axis; the turn is absorbed into the
placements on both sides, so kernels need only one kind of revolute and one of prismatic joint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from pouring_robot.exceptions import UnknownJointError, UnsupportedMechanismError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.rotations import turn_to

IntArray = NDArray[np.int64]
CountArray = NDArray[np.int32]
ByteArray = NDArray[np.uint8]

_FREE_BODY_FREEDOMS = 6


class Star(NamedTuple):
    """A star as arrays for the kernels: C chains of at most J joints, with at most P passive ones each.

    Shorter chains are padded with joints that do nothing. As all fields are arrays, a kernel compiled once fits all
    stars.
    """

    placements: FloatArray  # row-major rotation and translation of J joint placements, tip and seat, (C, J + 2, 12)
    site_axes: FloatArray  # turn of each site's frame that puts the joint's axis on z, row by row, (C (J + 1), 9)
    revolute: BoolArray  # (C, J)
    passive: IntArray  # joint in each passive place, -1 for an empty place, (C, P)
    place: IntArray  # passive place of each joint, -1 if it is not passive, (C, J)
    drives: IntArray  # chain and joint of each drive, (drives, 2)
    stiffness: FloatArray  # of a closure in N/m and Nm/rad, (2,)


@dataclass(frozen=True)
class Structure:
    """The sites, one a joint placement, where samples may displace a mechanism; and the form of an engine's joints.

    Joints of the general engine are Pinocchio's configurations themselves.
    """

    mechanism: ClosedChainMechanism  # that the samples displace
    site_joints: tuple[str, ...]  # joint that each site, by its number, displaces; empty: a site not used

    @property
    def site_count(self) -> int:
        """Number of sites."""
        return len(self.site_joints)

    @property
    def placed_joints(self) -> tuple[str, ...]:
        """The joints whose placements determine the pose: those of the sites used."""
        return tuple(filter(None, self.site_joints))

    def joints(self, configurations: FloatArray) -> FloatArray:
        """Return the engine's joints, (n, ...), from Pinocchio configurations (n, nq)."""
        return configurations

    def joint_values(self, joints: FloatArray) -> dict[str, FloatArray]:
        """Return the values of joints of one freedom, (n,) each in m or rad, by name, from the engine's joints."""
        return self.mechanism.joint_courses(joints)

    def configurations(self, joints: FloatArray) -> FloatArray:
        """Return Pinocchio configurations (n, nq) with the engine's joints, with which the loops close."""
        return joints

    def site(self, joint: str) -> int:
        """Return the number of the site that displaces a joint; raises UnknownJointError if none does."""
        if joint not in self.placed_joints:
            raise UnknownJointError(joint, self.placed_joints)
        return self.site_joints.index(joint)


@dataclass(frozen=True)
class StarStructure(Structure):
    """A star mechanism with its names; sites go chain by chain: J joints, then the seat (empty for a serial arm)."""

    star: Star  # the arrays
    joint_names: tuple[tuple[str, ...], ...]  # names of each chain's joints from base to tip

    @classmethod
    def from_mechanism(cls, mechanism: ClosedChainMechanism) -> StarStructure:
        """Read a mechanism; raises UnsupportedMechanismError where the mechanism is not a star."""
        chains = _chains(mechanism)
        every = {j for chain in chains for j in chain.joints}
        for mimic in mechanism.mimics:
            if mechanism.joint_id(mimic.joint) in every:
                raise UnsupportedMechanismError(f"joint '{mimic.joint}' mimics '{mimic.leader}'")
        model, joints = mechanism.shared_model, max(len(chain.joints) for chain in chains)
        axes = np.tile(np.eye(3), (len(chains), joints + 1, 1, 1))
        revolute = np.zeros((len(chains), joints), dtype=bool)
        for i, chain in enumerate(chains):
            length = len(chain.joints)
            axes[i, :length], revolute[i, :length] = _turns(mechanism, chain.joints)
        drives, passive = _roles(mechanism, [chain.joints for chain in chains])
        place = np.full((len(chains), joints), -1)
        for i, number in np.argwhere(passive >= 0):
            place[i, passive[i, number]] = number
        star = Star(
            placements=_placements(mechanism, chains, axes),
            site_axes=fixed(axes.reshape(-1, 9)),
            revolute=fixed(revolute, np.bool_),
            passive=fixed(passive, np.int64),
            place=fixed(place, np.int64),
            drives=fixed(drives, np.int64),
            stiffness=fixed(np.array(mechanism.loops.stiffness_si)),
        )
        names = tuple(tuple(model.names[j] for j in chain.joints) for chain in chains)
        sites = (
            (*own, *[""] * (joints - len(own)), chain.seat_joint) for own, chain in zip(names, chains, strict=True)
        )
        return cls(mechanism, sum(sites, ()), star, names)

    def __reduce__(self) -> tuple[Callable[[ClosedChainMechanism], StarStructure], tuple[ClosedChainMechanism]]:
        """Pickle as the mechanism, from which the arrays are read again: pickled arrays would become writable."""
        return StarStructure.from_mechanism, (self.mechanism,)

    def displaced_star(self, mechanism: ClosedChainMechanism) -> Star:
        """Return the star of the mechanism with displaced joints: roles, and axes in their own frames, stay."""
        chains, joints = self.star.revolute.shape
        axes = self.star.site_axes.reshape(chains, joints + 1, 3, 3)
        return self.star._replace(placements=_placements(mechanism, _chains(mechanism), axes))

    @property
    def is_serial(self) -> bool:
        """Whether no loop is closed: the drives carry the end frame."""
        return not self.mechanism.anchors

    def joints(self, configurations: FloatArray) -> FloatArray:
        """Return joints by chain (n, chains, joints), as the base class; shorter chains are padded with 0."""
        values = self.mechanism.joint_courses(configurations)
        joints = np.zeros((len(configurations), *self.star.revolute.shape))
        for i, names in enumerate(self.joint_names):
            for k, name in enumerate(names):
                joints[:, i, k] = values[name]
        return joints

    def joint_values(self, joints: FloatArray) -> dict[str, FloatArray]:
        """Return the values of joints by name, as the base class, from joints by chain (n, chains, joints)."""
        return {name: joints[:, i, k] for i, names in enumerate(self.joint_names) for k, name in enumerate(names)}

    def configurations(self, joints: FloatArray) -> FloatArray:
        """Return configurations as the base class; the free body is at zero, as the loops determine its pose."""
        mechanism, values = self.mechanism, self.joint_values(joints)
        neutral = mechanism.neutral_configuration()
        rows = (dict(zip(values, row, strict=True)) for row in np.transpose(list(values.values())).tolist())
        found = [mechanism.with_mimics(mechanism.with_joint_values(neutral, row), row) for row in rows]
        return np.array(found).reshape(-1, len(neutral))


def fixed(array: ArrayLike, kind: type[np.float64] | type[np.int64] | type[np.bool_] = np.float64) -> NDArray[Any]:
    """Return a read-only contiguous view, or a copy where needed: kernels are compiled for this kind of array only."""
    view = np.require(array, kind, ["C", "A"]).view()
    view.setflags(write=False)
    return view


@dataclass(frozen=True)
class _Chain:
    """One chain: its joints from base to tip, frame a on the last of them, frame b in the end frame and its joint."""

    joints: list[int]
    tip: pin.SE3
    seat: pin.SE3
    seat_joint: str


def _joints_between(mechanism: ClosedChainMechanism, tip: int, what: str) -> list[int]:
    """Return the joints from the base frame's body to joint ``tip``, after checking that each has one freedom."""
    model = mechanism.shared_model
    base = model.frames[mechanism.frame_id(mechanism.loops.base_frame)].parentJoint
    support = [0, *list(model.supports[tip])[1:]]
    if base not in support:
        raise UnsupportedMechanismError(f"{what} does not start on the base frame's body")
    joints = support[support.index(base) + 1 :]
    if not joints:
        raise UnsupportedMechanismError(f"{what} has no joint")
    wide = [model.names[j] for j in joints if model.nvs[j] != 1]
    if wide:
        raise UnsupportedMechanismError(f"joint '{wide[0]}' of {what} has more than one freedom")
    return joints


def _placements(mechanism: ClosedChainMechanism, chains: list[_Chain], axes: FloatArray) -> FloatArray:
    """Return the placements of a star whose joint axes are turned onto z by ``axes``, (C, J + 1, 3, 3)."""
    model, joints = mechanism.shared_model, axes.shape[1] - 1
    base = model.frames[mechanism.frame_id(mechanism.loops.base_frame)].placement
    placements = np.tile(np.r_[np.eye(3).ravel(), np.zeros(3)], (len(chains), joints + 2, 1))
    for i, chain in enumerate(chains):
        first, *others = (model.jointPlacements[j] for j in chain.joints)
        before = np.eye(3)
        for k, placement in enumerate([base.actInv(first), *others, chain.tip]):
            # the tip, not turned, stands behind the joints that do nothing
            at, after = (k, axes[i, k]) if k < len(chain.joints) else (joints, np.eye(3))
            placements[i, at, :9] = (before.T @ placement.rotation @ after).ravel()
            placements[i, at, 9:] = before.T @ placement.translation
            before = after
        placements[i, joints + 1] = np.r_[chain.seat.rotation.ravel(), chain.seat.translation]
    return fixed(placements)


def _serial_chain(mechanism: ClosedChainMechanism) -> _Chain:
    """Return the chain of a mechanism without loops: the end frame is its tip and seat in one."""
    model, end = mechanism.shared_model, mechanism.shared_model.frames[_end_frame(mechanism)]
    joints = _joints_between(mechanism, end.parentJoint, f"the chain to '{end.name}'")
    passive = set(mechanism.passive_columns.tolist())
    for j in joints:
        if model.idx_vs[j] in passive:
            raise UnsupportedMechanismError(f"joint '{model.names[j]}' is neither driven nor locked")
    for name in mechanism.loops.drives:
        if mechanism.joint_id(name) not in joints:
            raise UnsupportedMechanismError(f"drive '{name}' does not move '{end.name}'")
    return _Chain(joints, end.placement, pin.SE3.Identity(), "")


def _chains(mechanism: ClosedChainMechanism) -> list[_Chain]:
    """Return the chains, after checking that they make a star; without loops there is one."""
    if not mechanism.anchors:
        return [_serial_chain(mechanism)]
    model, loops = mechanism.shared_model, mechanism.loops
    names = list(model.names)
    end = {b.parentJoint for _, b in mechanism.anchors}
    if len(end) != 1 or model.nvs[next(iter(end))] != _FREE_BODY_FREEDOMS:
        raise UnsupportedMechanismError("the second frames of its loops are not on one free body (see cut_joints)")
    if loops.end_frame is None or model.frames[_end_frame(mechanism)].parentJoint not in end:
        raise UnsupportedMechanismError("its end_frame is not on the body the chains end on")
    to_end, chains = model.frames[_end_frame(mechanism)].placement.inverse(), []
    for i, (loop, (a, b)) in enumerate(zip(loops.loops, mechanism.anchors, strict=True)):
        if loop.type != "6d":
            raise UnsupportedMechanismError(f"loop '{loop.name}' holds its origins only (3d)")
        joints = _joints_between(mechanism, a.parentJoint, f"the chain of loop '{loop.name}'")
        seat = next(iter(seat_joints(mechanism, i)), "")
        if seat and seat not in mechanism.frame_paths[loop.frame_b]:
            raise UnsupportedMechanismError(f"chain '{loop.name}' ends in '{seat}', and no seat stands for it")
        chains.append(_Chain(joints, a.placement, to_end * b.placement, seat))
    every = [j for chain in chains for j in chain.joints]
    shared = {names[j] for j in every if every.count(j) > 1}
    if shared:
        raise UnsupportedMechanismError(f"two chains share joint '{min(shared)}'")
    return chains


def _roles(mechanism: ClosedChainMechanism, chains: list[list[int]]) -> tuple[IntArray, IntArray]:
    """Return chain and joint of each drive, and each chain's passive joints, filled up with -1."""
    model = mechanism.shared_model
    where = {model.idx_vs[j]: (i, k) for i, chain in enumerate(chains) for k, j in enumerate(chain)}
    drives = np.array([where.get(c, (-1, -1)) for c in mechanism.drive_columns.tolist()], dtype=np.int64).reshape(-1, 2)
    if not mechanism.anchors:
        return drives, np.full((1, 1), -1, dtype=np.int64)
    free_body = mechanism.anchors[0][1].parentJoint
    free = set(range(model.idx_vs[free_body], model.idx_vs[free_body] + _FREE_BODY_FREEDOMS))
    passive_columns = mechanism.passive_columns.tolist()
    if not free <= set(passive_columns):
        raise UnsupportedMechanismError("the body the chains end on is driven or locked")
    outside = (set(mechanism.drive_columns.tolist()) | set(passive_columns)) - set(where) - free
    if outside:
        owner = next(name for name, own in mechanism.joint_columns.items() if min(outside) in own)
        raise UnsupportedMechanismError(f"joint '{owner}' belongs to no chain")
    per_chain = [[where[c][1] for c in passive_columns if where.get(c, (-1, 0))[0] == i] for i in range(len(chains))]
    passive = np.full((len(chains), max(1, *map(len, per_chain))), -1, dtype=np.int64)
    for i, places in enumerate(per_chain):
        passive[i, : len(places)] = sorted(places)
    return drives, passive


def _turns(mechanism: ClosedChainMechanism, chain: list[int]) -> tuple[FloatArray, BoolArray]:
    """Return for each joint a rotation that turns z onto its axis, shape (joints, 3, 3), and whether it is revolute."""
    turns, revolute, names = [], [], mechanism.shared_model.names
    for j, twist in zip(chain, mechanism.joint_axes(chain), strict=True):
        if not twist.any():  # its axis has no length
            raise UnsupportedMechanismError(f"joint '{names[j]}' is neither revolute nor prismatic")
        revolute.append(mechanism.unit_of(names[j]) == "rad")
        turns.append(turn_to(twist[3:] if revolute[-1] else twist[:3]))
    return np.array(turns), np.array(revolute)


def _end_frame(mechanism: ClosedChainMechanism) -> int:
    return mechanism.frame_id(mechanism.loops.end_frame or "")


def seat_joints(mechanism: ClosedChainMechanism, loop: int) -> tuple[str, ...]:
    """Return the fixed joints that carry the frames of a loop and whose placements count, frame b's first.

    In a loop closed in all directions, displacing frame a is the inverse of displacing frame b, so one of the two
    suffices; in one closed at a point both count.
    """
    one = mechanism.loops.loops[loop]
    carriers = (_fixed_joint(mechanism, frame) for frame in (one.frame_b, one.frame_a))
    found = [name for name in carriers if name in mechanism.seen_joints]
    return tuple(found[:1] if one.type == "6d" else found)


def _fixed_joint(mechanism: ClosedChainMechanism, name: str) -> str:
    """Return the fixed joint that carries a frame, or "" where none does."""
    model = mechanism.shared_model
    frame = model.frames[mechanism.frame_id(name)]
    carrier = frame if frame.type == pin.FrameType.FIXED_JOINT else model.frames[frame.parentFrame]
    return str(carrier.name) if carrier.type == pin.FrameType.FIXED_JOINT else ""
