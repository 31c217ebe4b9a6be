"""Which link each joint is attached to, and which links carry what: for growth, or a moving base, that displaces it."""

import functools
from collections.abc import Collection, Iterator, Mapping

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.pinocchio_model import frame_index
from pouring_robot.robot.description.definition import RobotDefinition


@functools.lru_cache(maxsize=16)
def joint_attachments(robot: RobotDefinition) -> Mapping[str, tuple[str, pin.SE3]]:
    """Return for each joint, fixed or moving, the link it is attached to and its placement in that link."""
    model = robot.mechanism().shared_model
    found: dict[str, tuple[str, pin.SE3]] = {}
    for frame in model.frames[1:]:  # the first is the world, which is attached to nothing
        if frame.type not in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT):
            continue
        link = model.frames[frame.parentFrame]
        fixed = frame.type == pin.FrameType.FIXED_JOINT
        placed = link.placement.actInv(frame.placement if fixed else model.jointPlacements[frame.parentJoint])
        found[frame.name] = link.name, placed
    return found


def lever(placed: pin.SE3) -> FloatArray:
    """Return a place in its own axes, (3,), in m: uniform growth of its link displaces it by this times the strain."""
    return np.asarray(placed.rotation.T @ placed.translation)


def carrier(model: pin.Model, name: str) -> pin.Frame:
    """Return the joint, fixed or moving, that carries a link; the name of a joint returns that joint."""
    frame = model.frames[frame_index(model, name)]
    return model.frames[frame.parentFrame] if frame.type == pin.FrameType.BODY else frame


def grown_places(robot: RobotDefinition, places: Collection[str]) -> list[tuple[str, str, FloatArray]]:
    """Return which links displace joints (``places``) by growing, also through fixed ones that are not among these.

    That is the joint, a link that carries it (as far as the next joint that moves or may be displaced), and the place
    on that link of what it carries there, (3,), in the joint's own axes, in m.
    """
    found = []
    for joint in places:
        link, placed = joint_attachments(robot)[joint]
        found.append((joint, link, lever(placed)))
        found += [(joint, below, placed.rotation.T @ place) for below, place in carried(robot, link, places)]
    return found


def chain_ends(robot: RobotDefinition, places: Collection[str]) -> list[tuple[str, str, FloatArray]]:
    """Return which last links displace the end of a chain that ends in a fixed joint, which has no displacement itself.

    They move the loop's frame on the chain, which is the same as moving the seat on the other side back: in a closed
    ``6d`` loop both have the same axes. As :func:`grown_places` for each such end whose seat, a fixed joint, is among
    ``places``.
    """
    model = robot.mechanism().shared_model
    ends = [(loop.frame_a, carrier(model, loop.frame_b)) for loop in robot.loops.loops if loop.type == "6d"]
    seated = [(end, seat.name) for end, seat in ends if seat.type == pin.FrameType.FIXED_JOINT and seat.name in places]
    return [(seat, link, -place) for end, seat in seated for link, place in carried(robot, end, places)]


def carried(robot: RobotDefinition, link: str, places: Collection[str]) -> Iterator[tuple[str, FloatArray]]:
    """Yield the links that carry a link, such as the end frame's, through fixed joints, none of them in ``places``.

    With each comes the place on it of what it carries there, (3,), in the axes of the link carried, in m.
    """
    model, turned = robot.mechanism().shared_model, np.eye(3)
    joint = carrier(model, link)
    while joint.type == pin.FrameType.FIXED_JOINT and joint.name not in ("universe", *places):
        link, placed = joint_attachments(robot)[joint.name]
        turned = placed.rotation @ turned
        yield link, np.asarray(turned.T @ placed.translation)
        joint = carrier(model, link)
