"""Pairs of bodies that touch because they are joined, or because they are drawn into each other: SRDF says so."""

import pinocchio as pin
from lxml import etree

from pouring_robot.robot.description.urdf import with_mesh_files, xml_text
from pouring_robot.robot.export.assembly import Assembly
from pouring_robot.robot.export.closed import ClosedRobot

ADJACENT, TOUCHING = "Adjacent", "Default"
"""Reasons, in MoveIt's words: joined, and in contact at the pose that was exported."""


def joined_or_touching(closed: ClosedRobot, assembly: Assembly) -> dict[tuple[str, str], str]:
    """Return why collisions of a pair of bodies are to be left out, by pair."""
    parts = {name: assembly.solid(name) for name in assembly.bodies}
    ends = [(joint.parent, joint.child) for joint in assembly.joints.values()]
    ends += [(loop.frame_a, loop.frame_b) for loop in assembly.loops.loops]
    pairs: dict[tuple[str, str], str] = {}
    for one, other in ends:
        if parts[one] != parts[other]:
            pairs[parts[one], parts[other]] = ADJACENT
    for pair in _in_contact(closed):
        if pair not in pairs and pair[::-1] not in pairs:
            pairs[pair] = TOUCHING
    return pairs


def _in_contact(closed: ClosedRobot) -> list[tuple[str, str]]:
    model = pin.buildModelFromXML(closed.urdf)
    shapes = pin.buildGeomFromUrdfString(model, _with_what_is_here(closed.urdf), pin.GeometryType.COLLISION)
    names = [model.frames[item.parentFrame].name for item in shapes.geometryObjects]
    for i, one in enumerate(names):
        for k in range(i + 1, len(names)):
            if names[k] != one:
                shapes.addCollisionPair(pin.CollisionPair(i, k))
    configuration = pin.neutral(model)
    for name, value in closed.joints.items():
        if model.existJointName(name) and model.joints[model.getJointId(name)].nq == 1:
            configuration[model.joints[model.getJointId(name)].idx_q] = value
    placed = shapes.createData()
    pin.computeCollisions(model, model.createData(), shapes, placed, configuration, False)
    found = {
        (names[pair.first], names[pair.second])
        for pair, result in zip(shapes.collisionPairs, placed.collisionResults, strict=True)
        if result.isCollision()
    }
    return sorted(found)


def _with_what_is_here(urdf: str) -> str:
    """Return the URDF without the shapes whose meshes lie in packages that only their owner has."""
    root = etree.fromstring(with_mesh_files(urdf).encode())
    for mesh in root.xpath("//mesh[starts-with(@filename, 'package://')]"):
        shape = mesh.getparent().getparent()
        shape.getparent().remove(shape)
    return xml_text(root)


def srdf(assembly: Assembly, pairs: dict[tuple[str, str], str]) -> str:
    """Return the SRDF of a robot: its drives as a group, what moves passively, and pairs that need no checking."""
    root = etree.Element("robot", name=assembly.name)
    group = etree.SubElement(root, "group", name="drives")
    for name in assembly.loops.drives:
        etree.SubElement(group, "joint", name=name)
    held = {*assembly.loops.drives, *assembly.loops.locked_joints}
    for joint in assembly.joints.values():
        if joint.kind != "fixed" and joint.name not in held:
            etree.SubElement(root, "passive_joint", name=joint.name)
    for (one, other), reason in pairs.items():
        etree.SubElement(root, "disable_collisions", link1=one, link2=other, reason=reason)
    return xml_text(root, indented=True)
