"""A mechanism whose joints stand off from where its URDF puts them, without reading the URDF again."""

from __future__ import annotations

from collections.abc import Mapping

import pinocchio as pin


def displace_model(model: pin.Model, displacements: Mapping[str, pin.SE3]) -> None:
    """Displace joints, fixed and moving, with all they carry, in place.

    Args:
        model: Pinocchio's model of a URDF; lists every frame after its parent.
        displacements: the pose of the actual placement in the present one, by joint.
    """
    before = [frame.placement.copy() for frame in model.frames]
    moved = [False] * len(before)  # frames that no longer stand where they stood on their joint
    for i in range(1, len(before)):
        frame = model.frames[i]
        own, parent = displacements.get(frame.name), frame.parentFrame
        is_joint, is_fixed = frame.type == pin.FrameType.JOINT, frame.type == pin.FrameType.FIXED_JOINT
        if not is_joint and not is_fixed:
            own = None  # a link may bear the name of a joint
        if own is None and not moved[parent]:
            continue
        present = model.jointPlacements[frame.parentJoint] if is_joint else before[i]
        placement = model.frames[parent].placement * before[parent].actInv(present)
        if own is not None:
            placement = placement * own
        if is_joint:  # what it carries stays where it is on it
            model.jointPlacements[frame.parentJoint] = placement
            continue
        moved[i], frame.placement = True, placement
        if frame.inertia.mass > 0.0:
            _move_mass(model, frame, before[i])


def _move_mass(model: pin.Model, frame: pin.Frame, before: pin.SE3) -> None:
    """Move the body behind a fixed joint, which Pinocchio has merged into the moving one; parameters are additive."""
    joint = frame.parentJoint
    total = model.inertias[joint].toDynamicParameters()
    total += frame.placement.act(frame.inertia).toDynamicParameters()
    total -= before.act(frame.inertia).toDynamicParameters()
    model.inertias[joint] = pin.Inertia.FromDynamicParameters(total)
