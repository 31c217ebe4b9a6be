"""The closed robot in SDFormat: its links where they stand, its loops as joints or as Drake's bushings.

SDF has no joint values: the zero of every joint is the pose that the file shows.
"""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from lxml import etree

from pouring_robot.mechanism.loops_file import LoopSpec
from pouring_robot.robot.description.urdf import text, xml_text
from pouring_robot.robot.export.assembly import Assembly, Body, Joint, Shape

_DRAKE = "http://drake.mit.edu"
# sdformat refuses a link without mass, and gives one without an inertial 1 kg.
_NO_MASS = 1e-6
_KINDS = {"spherical": "ball"}
# The newest that Gazebo classic reads: joints of links alone, attitudes as roll, pitch and yaw, no mimic.
VERSION = "1.7"


def sdf(assembly: Assembly, loops: Literal["joints", "bushings"] = "joints") -> str:
    """Return the robot as SDF; meshes are OBJ files in ``meshes``.

    Loops are joints (``fixed`` or ``ball``) for simulators whose joints may close loops; or linear bushings of the
    robot's own stiffness for Drake, whose joints make a tree.
    """
    root = etree.Element("sdf", nsmap={"drake": _DRAKE} if loops == "bushings" else None, version=VERSION)
    model = etree.SubElement(root, "model", name=assembly.name)
    frames = {name for name, body in assembly.bodies.items() if _is_frame(body, assembly)}
    for body in assembly.bodies.values():
        if body.name in frames:
            on = assembly.joints[body.name].parent
            frame = etree.SubElement(
                model, "frame", name=_called(body.name, assembly), attached_to=_called(on, assembly)
            )
            _pose(frame, assembly.bodies[on].pose.actInv(body.pose))
        else:
            _link(model, body, assembly)
    fixed = _joint(model, _called("fixed_to_world", assembly), "fixed", "world", _called(assembly.base, assembly))
    values = {joint.name: joint.value for joint in assembly.joints.values()}
    commands = ", ".join(f"{name} = {values[name]!r}" for name in assembly.loops.drives)
    fixed.addprevious(etree.Comment(f" zero is where {commands} "))
    for note in mimic_notes(assembly.mimics):
        fixed.addprevious(etree.Comment(f" {note.replace('--', '- -')} "))
    for joint in assembly.joints.values():
        if joint.child not in frames:
            _moving(model, joint, assembly)
    for loop in assembly.loops.loops:
        if loops == "bushings":
            _bushing(model, loop, assembly)
        else:
            kind = "fixed" if loop.type == "6d" else "ball"
            on, at = _carrier(loop.frame_b, assembly), assembly.bodies[loop.frame_b].pose
            ends = _called(_carrier(loop.frame_a, assembly), assembly), _called(on, assembly)
            joint = _joint(model, _called(f"{loop.name}_loop", assembly), kind, *ends)
            _pose(joint, assembly.bodies[on].pose.actInv(at))
    return xml_text(root, indented=True)


def mimic_notes(mimics: Mapping[tuple[str, str], float]) -> list[str]:
    """Return what SDF cannot say of joints that follow others, by follower and leader: none where there is none."""
    if not mimics:
        return []
    said = ", ".join(f"{follower} = {ratio:g} {leader}" for (follower, leader), ratio in mimics.items())
    return [f"SDF {VERSION} knows no mimic, so these joints move freely until the simulator couples them: {said}"]


def _is_frame(body: Body, assembly: Assembly) -> bool:
    """Return whether a link is a frame without mass and shape, which SDF has by itself."""
    fixed = body.name in assembly.joints and assembly.joints[body.name].kind == "fixed"
    return body.inertia is None and fixed and not (body.visuals or body.collisions or assembly.carried_by(body.name))


def _called(name: str, assembly: Assembly) -> str:
    """Return what a link, or a joint of ours, is called: not as a joint of the robot, which SDF refuses."""
    return assembly.called(name, *(joint.name for joint in assembly.joints.values()))


def _carrier(name: str, assembly: Assembly) -> str:
    return assembly.joints[name].parent if _is_frame(assembly.bodies[name], assembly) else name


def _add(parent: Any, tag: str, value: str) -> Any:
    element = etree.SubElement(parent, tag)
    element.text = value
    return element


def _pose(parent: Any, pose: pin.SE3) -> None:
    _add(parent, "pose", text((*pose.translation, *pin.rpy.matrixToRpy(pose.rotation))))


def _link(model: Any, body: Body, assembly: Assembly) -> None:
    link = etree.SubElement(model, "link", name=_called(body.name, assembly))
    _pose(link, body.pose)
    inertia = body.inertia or pin.Inertia(_NO_MASS, np.zeros(3), _NO_MASS * np.eye(3))
    inertial = etree.SubElement(link, "inertial")
    _pose(inertial, pin.SE3(np.eye(3), inertia.lever))
    _add(inertial, "mass", repr(inertia.mass))
    moments = etree.SubElement(inertial, "inertia")
    for i, k in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        _add(moments, f"i{'xyz'[i]}{'xyz'[k]}", repr(float(inertia.inertia[i, k])))
    for what, shapes in (("visual", body.visuals), ("collision", body.collisions)):
        for number, shape in enumerate(shapes):
            _shape(etree.SubElement(link, what, name=f"{body.name}_{what}_{number}"), shape, coloured=what == "visual")


def _shape(element: Any, shape: Shape, *, coloured: bool) -> None:
    _pose(element, shape.pose)
    form = etree.SubElement(etree.SubElement(element, "geometry"), shape.kind)
    if shape.kind == "mesh":
        _add(form, "uri", f"meshes/{shape.stem}.obj")
        _add(form, "scale", text(shape.sizes))
    elif shape.kind == "box":
        _add(form, "size", text(shape.sizes))
    else:
        for tag, size in zip(("radius", "length"), shape.sizes, strict=False):
            _add(form, tag, repr(size))
    if coloured:
        material = etree.SubElement(element, "material")
        for tag in ("ambient", "diffuse"):
            _add(material, tag, text(shape.colour))


def _joint(model: Any, name: str, kind: str, parent: str, child: str) -> Any:
    joint = etree.SubElement(model, "joint", name=name, type=_KINDS.get(kind, kind))
    _add(joint, "parent", parent)
    _add(joint, "child", child)
    return joint


def _moving(model: Any, joint: Joint, assembly: Assembly) -> None:
    written = _joint(model, joint.name, joint.kind, *(_called(name, assembly) for name in (joint.parent, joint.child)))
    if joint.kind not in ("revolute", "prismatic"):
        return
    axis = etree.SubElement(written, "axis")
    _add(axis, "xyz", text(joint.axis))
    limit = etree.SubElement(axis, "limit")
    for tag, bound in zip(("lower", "upper"), joint.limits or (-np.inf, np.inf), strict=True):
        _add(limit, tag, repr(float(bound - joint.value)))
    driven = any(joint is servo for servo in assembly.servos)
    _add(limit, "effort", repr(joint.effort) if driven else "0")  # who reads 0 puts no motor there
    if joint.velocity:
        _add(limit, "velocity", repr(joint.velocity))
    dynamics = etree.SubElement(axis, "dynamics")
    _add(dynamics, "damping", repr(joint.damping))
    _add(dynamics, "friction", repr(joint.friction))


def _bushing(model: Any, loop: LoopSpec, assembly: Assembly) -> None:
    translation, rotation = assembly.loops.stiffness_si
    rotation = rotation if loop.type == "6d" else 0.0
    bushing = etree.SubElement(model, f"{{{_DRAKE}}}linear_bushing_rpy")
    for key, value in (
        ("frameA", _called(loop.frame_a, assembly)),
        ("frameC", _called(loop.frame_b, assembly)),
        ("torque_stiffness", text([rotation] * 3)),
        ("torque_damping", text([1e-3 * rotation] * 3)),
        ("force_stiffness", text([translation] * 3)),
        ("force_damping", text([1e-3 * translation] * 3)),
    ):
        _add(bushing, f"{{{_DRAKE}}}bushing_{key}", value)
