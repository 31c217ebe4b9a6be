"""Joints that are not what the URDF says: released, fixed, universal, spherical, or tied to another by ``mimic``."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import BadInputError, UnknownJointError

JointKind = Literal[
    "fixed", "spherical", "universal_xy", "universal_xz", "universal_yx", "universal_yz", "universal_zx", "universal_zy"
]
"""What a joint may be changed to. A universal joint turns about two axes of its placement, the first one first, in two
joints ``<name>_X`` and ``<name>_Y`` (or Z)."""
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def change_joints(urdf: str, kinds: Mapping[str, str]) -> str:
    """Return the URDF with joints of other kinds; spherical ones, which URDF does not know, turn about one axis yet.

    Kinds are :data:`JointKind` or ``floating``, by joint.

    Raises:
        UnknownJointError: the URDF has no such joint.
        etree.XMLSyntaxError: the text is not XML.
    """
    root = etree.fromstring(urdf.encode())
    found = {joint.get("name"): joint for joint in root.iterfind("joint")}
    for name, kind in kinds.items():
        if name not in found:
            raise UnknownJointError(name, found)
        joint = found[name]
        for tied in joint.findall("mimic"):
            joint.remove(tied)
        if kind.startswith("universal"):
            _split(joint, *kind[-2:])
        else:
            joint.set("type", "continuous" if kind == "spherical" else kind)
    return str(etree.tostring(root, encoding="unicode"))


def _split(joint: etree._Element, first: str, second: str) -> None:
    """Turn a joint into two that turn about different axes, with a link of no mass between them."""
    name, robot = str(joint.get("name")), joint.getparent()
    between = f"{name}_{first.upper()}_link"
    other = copy.deepcopy(joint)
    for part, letter in ((joint, first), (other, second)):
        part.set("name", f"{name}_{letter.upper()}")
        part.set("type", "continuous")
        axis = part.find("axis")
        (etree.SubElement(part, "axis") if axis is None else axis).set("xyz", _AXES[letter])
    joint.find("child").set("link", between)
    other.find("parent").set("link", between)
    for origin in other.findall("origin"):
        other.remove(origin)
    etree.SubElement(robot, "link", name=between)
    robot.append(other)


def make_spherical(model: pin.Model, names: set[str]) -> pin.Model:
    """Return the model with the named joints made spherical; frames, masses and limits stay."""
    made = pin.Model()
    made.name, made.gravity = model.name, model.gravity
    for j in range(1, model.njoints):
        name, joint = str(model.names[j]), model.joints[j]
        kind = pin.JointModelSpherical() if name in names else joint
        new = made.addJoint(model.parents[j], kind, model.jointPlacements[j], name)
        made.appendBodyToJoint(new, model.inertias[j], pin.SE3.Identity())
        if name not in names:
            own, old = made.joints[new], slice(joint.idx_q, joint.idx_q + joint.nq)
            here = slice(own.idx_q, own.idx_q + own.nq)
            made.lowerPositionLimit[here] = model.lowerPositionLimit[old]
            made.upperPositionLimit[here] = model.upperPositionLimit[old]
    for frame in list(model.frames)[1:]:
        made.addFrame(frame, False)
    return made


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: its value is ``ratio`` times the leader's plus ``offset`` (m or rad)."""

    joint: str  # the follower
    leader: str  # what it follows, itself free to move
    ratio: float  # of the two values
    offset: float  # in m or rad


def read_mimics(urdf: str) -> tuple[Mimic, ...]:
    """Return joints that mimic others, mimics of mimics by the first; raises BadInputError where they are wrong."""
    own = {}
    for joint in etree.fromstring(urdf.encode()).iterfind("joint"):
        tied = joint.find("mimic")
        if tied is not None and joint.get("type") != "fixed":
            name = str(joint.get("name"))
            try:
                ratio, offset = float(tied.get("multiplier", 1.0)), float(tied.get("offset", 0.0))
            except ValueError as problem:
                raise BadInputError(f"joint '{name}': multiplier and offset of mimic must be numbers") from problem
            own[name] = Mimic(name, str(tied.get("joint")), ratio, offset)
    return tuple(_resolved(mimic, own) for mimic in own.values())


def _resolved(mimic: Mimic, every: Mapping[str, Mimic]) -> Mimic:
    for _ in every:
        if mimic.leader not in every:
            return mimic
        above = every[mimic.leader]
        mimic = Mimic(mimic.joint, above.leader, mimic.ratio * above.ratio, mimic.ratio * above.offset + mimic.offset)
    raise BadInputError(f"joint '{mimic.joint}' mimics itself by way of others; let one of them be free")
