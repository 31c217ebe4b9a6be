"""The closed robot in SDFormat: links at their closed poses, loops as joints or as Drake's bushings.

SDF has no joint values: the zero of every joint is the pose that the file shows.
"""

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from lxml import etree
from lxml.builder import E, ElementMaker

from pouring_robot.mechanism.loops_file import LoopSpec
from pouring_robot.mechanism.pinocchio_model import Mimic
from pouring_robot.robot.description.urdf import text, xml_text
from pouring_robot.robot.export.bodies_and_joints import Assembly, Body, Joint, Shape

_DRAKE = "http://drake.mit.edu"
# sdformat refuses a link of zero mass, and takes a link without an inertial as 1 kg.
_NO_MASS = 1e-6
# The newest version that Gazebo classic reads: joints between links only, roll, pitch and yaw, no mimic.
VERSION = "1.7"


def sdf(assembly: Assembly, loops: Literal["joints", "bushings"] = "joints") -> str:
    """Return the robot as SDF; meshes are OBJ files in ``meshes``.

    Loops are joints (``fixed`` or ``ball``) for simulators whose joints may close loops, or linear bushings with the
    stiffness of the robot for Drake, whose joints form a tree.
    """
    frames = {name for name, body in assembly.bodies.items() if _is_frame(body, assembly)}
    values = {joint.name: joint.value for joint in assembly.joints.values()}
    commands = ", ".join(f"{name} = {values[name]!r}" for name in assembly.loops.drives)
    model = E.model(
        *(_frame(b, assembly) if b.name in frames else _link(b, assembly) for b in assembly.bodies.values()),
        etree.Comment(f" zero is where {commands} "),
        *(etree.Comment(f" {note.replace('--', '- -')} ") for note in mimic_notes(assembly.mimics)),
        _joint(_called("fixed_to_world", assembly), "fixed", "world", _called(assembly.base, assembly)),
        *(_moving(joint, assembly) for joint in assembly.joints.values() if joint.child not in frames),
        *((_loop_bushing if loops == "bushings" else _loop_joint)(loop, assembly) for loop in assembly.loops.loops),
        name=assembly.name,
    )
    words = ElementMaker(nsmap={"drake": _DRAKE} if loops == "bushings" else None)
    return xml_text(words.sdf(model, version=VERSION), indented=True)


def mimic_notes(mimics: Sequence[Mimic]) -> list[str]:
    """Return notes on joints that mimic others, which this SDF version cannot express; none where there are none."""
    if not mimics:
        return []
    said = ", ".join(f"{mimic.joint} = {mimic.ratio:g} {mimic.leader}" for mimic in mimics)
    return [f"SDF {VERSION} has no mimic joints, so these joints move freely until the simulator couples them: {said}"]


def _is_frame(body: Body, assembly: Assembly) -> bool:
    """Return whether a link is a frame without mass and shape, for which SDF has its own element."""
    fixed = body.name in assembly.joints and assembly.joints[body.name].kind == "fixed"
    return body.inertia is None and fixed and not (body.visuals or body.collisions or assembly.carried_by(body.name))


def _called(name: str, assembly: Assembly) -> str:
    """Return the name of a link, or of a joint that we add; SDF refuses a name that a joint of the robot has."""
    return assembly.called(name, *(joint.name for joint in assembly.joints.values()))


def _pose(pose: pin.SE3) -> Any:
    return E.pose(text((*pose.translation, *pin.rpy.matrixToRpy(pose.rotation))))


def _frame(body: Body, assembly: Assembly) -> Any:
    on = assembly.bodies[assembly.joints[body.name].parent]
    names = {"name": _called(body.name, assembly), "attached_to": _called(on.name, assembly)}
    return E.frame(_pose(on.pose.actInv(body.pose)), **names)


def _link(body: Body, assembly: Assembly) -> Any:
    inertia = body.inertia or pin.Inertia(_NO_MASS, np.zeros(3), _NO_MASS * np.eye(3))
    entries = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    moments = (E(f"i{'xyz'[i]}{'xyz'[k]}", repr(float(inertia.inertia[i, k]))) for i, k in entries)
    return E.link(
        _pose(body.pose),
        E.inertial(_pose(pin.SE3(np.eye(3), inertia.lever)), E.mass(repr(inertia.mass)), E.inertia(*moments)),
        *(E.visual(*_shape(s), _paint(s), name=f"{body.name}_visual_{k}") for k, s in enumerate(body.visuals)),
        *(E.collision(*_shape(s), name=f"{body.name}_collision_{k}") for k, s in enumerate(body.collisions)),
        name=_called(body.name, assembly),
    )


def _shape(shape: Shape) -> Iterator[Any]:
    sizes = {"size" if shape.kind == "box" else "scale": text(shape.sizes)}
    if shape.kind in ("cylinder", "sphere"):
        sizes = dict(zip(("radius", "length"), map(repr, shape.sizes), strict=False))
    mesh = {"uri": f"meshes/{shape.stem}.obj"} if shape.kind == "mesh" else {}
    yield _pose(shape.pose)
    yield E.geometry(E(shape.kind, *(E(tag, value) for tag, value in (mesh | sizes).items())))


def _paint(shape: Shape) -> Any:
    return E.material(E.ambient(text(shape.colour)), E.diffuse(text(shape.colour)))


def _joint(name: str, kind: str, parent: str, child: str, *more: Any) -> Any:
    return E.joint(E.parent(parent), E.child(child), *more, name=name, type={"spherical": "ball"}.get(kind, kind))


def _moving(joint: Joint, assembly: Assembly) -> Any:
    ends = _called(joint.parent, assembly), _called(joint.child, assembly)
    if joint.kind not in ("revolute", "prismatic"):
        return _joint(joint.name, joint.kind, *ends)
    lower, upper = (repr(float(bound - joint.value)) for bound in joint.limits or (-np.inf, np.inf))
    driven = any(joint is servo for servo in assembly.servos)
    limit = E.limit(E.lower(lower), E.upper(upper))
    limit.append(E.effort(repr(joint.servo_effort) if driven else "0"))  # readers of 0 put no motor there
    if joint.velocity:
        limit.append(E.velocity(repr(joint.velocity)))
    dynamics = E.dynamics(E.damping(repr(joint.damping)), E.friction(repr(joint.friction)))
    return _joint(joint.name, joint.kind, *ends, E.axis(E.xyz(text(joint.axis)), limit, dynamics))


def _loop_joint(loop: LoopSpec, assembly: Assembly) -> Any:
    """Return a loop as a joint between links, because SDF joints cannot connect frames."""
    a, b = (assembly.bodies[frame] for frame in (loop.frame_a, loop.frame_b))
    on, under = (assembly.bodies[assembly.joints[e.name].parent] if _is_frame(e, assembly) else e for e in (b, a))
    name, ends = _called(f"{loop.name}_loop", assembly), (_called(one.name, assembly) for one in (under, on))
    return _joint(name, "fixed" if loop.type == "6d" else "ball", *ends, _pose(on.pose.actInv(b.pose)))


def _loop_bushing(loop: LoopSpec, assembly: Assembly) -> Any:
    translation, rotation = assembly.loops.stiffness_si
    rotation = rotation if loop.type == "6d" else 0.0
    said = {
        "frameA": _called(loop.frame_a, assembly),
        "frameC": _called(loop.frame_b, assembly),
        "torque_stiffness": text([rotation] * 3),
        "torque_damping": text([1e-3 * rotation] * 3),
        "force_stiffness": text([translation] * 3),
        "force_damping": text([1e-3 * translation] * 3),
    }
    words = ElementMaker(namespace=_DRAKE, nsmap={"drake": _DRAKE})
    return words.linear_bushing_rpy(*(words(f"bushing_{key}", value) for key, value in said.items()))
