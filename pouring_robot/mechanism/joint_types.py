"""Types of joints: those a file may change a joint to, and how; units; which may be driven; which are exported.

Those ``joint_types`` that a URDF can express are already in the URDF of a robot (``robot/description/definition.py``);
ball joints, which it cannot express, are made in Pinocchio's model.
"""

import copy
from collections.abc import Mapping
from typing import Literal

import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import UnknownJointError

JointKind = Literal[
    "fixed", "spherical", "universal_xy", "universal_xz", "universal_yx", "universal_yz", "universal_zx", "universal_zy"
]
"""Types that a joint may be changed to. A universal joint turns about two axes of its placement, in the order named, in
two joints ``<name>_X`` and ``<name>_Y`` (or Z)."""
NOT_IN_URDF = frozenset({"spherical"})
"""Those of them that a URDF cannot express."""
UNITS: Mapping[str, Literal["m", "rad"]] = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}
"""URDF's types of one freedom, the only ones that may be driven, and the units of their values."""
BOUNDED = ("revolute", "prismatic")
"""Those of them that have limits."""
EXPORTED = (*UNITS, "fixed")
"""URDF's types that are exported to MJCF and SDF."""
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def unit_of(joint: pin.JointModel) -> Literal["m", "rad"]:
    """Return the unit of a one-freedom joint of Pinocchio's: a length or an angle."""
    return "m" if joint.nv == 1 and joint.shortname().startswith("JointModelP") else "rad"


def change_joints(urdf: str, kinds: Mapping[str, str]) -> str:
    """Return the URDF with joints of other kinds (``JointKind`` or ``floating``); a spherical one turns about one axis.

    Raises UnknownJointError where the URDF has no such joint, etree.XMLSyntaxError where it is not XML.
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
            joint.set("type", "continuous" if kind in NOT_IN_URDF else kind)
    return str(etree.tostring(root, encoding="unicode"))


def _split(joint: etree._Element, first: str, second: str) -> None:
    """Turn a joint into two that turn about different axes, with a massless link between them."""
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
            moved, there = slice(joint.idx_v, joint.idx_v + joint.nv), slice(own.idx_v, own.idx_v + own.nv)
            for limit in ("upperEffortLimit", "velocityLimit"):
                getattr(made, limit)[there] = getattr(model, limit)[moved]
    for frame in list(model.frames)[1:]:
        made.addFrame(frame, False)
    return made
