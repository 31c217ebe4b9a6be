"""The closed robot in MuJoCo's format: all loops as equality constraints, drives as actuators.

Bodies are at a closed pose when the file is loaded, and ``ref`` gives the joints the package's values there. The
platform is a free body between all of its chains, so no chain is preferred.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, Self

import numpy as np
import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.loops_file import LoopSpec
from pouring_robot.robot.description.urdf import text, xml_text
from pouring_robot.robot.export.bodies_and_joints import Assembly, Body, Joint, Shape
from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot

# Time constant of a loop without external load, in s, and MuJoCo's largest impedance.
_TIME_CONSTANT, _LARGEST_IMPEDANCE = 0.02, 0.9999
_DEFAULT_DAMPING = 1.0
# Smallest moment of inertia of a moving body that MuJoCo accepts, in kg m².
_LEAST_MOMENT = 1e-15
_ROUND_OFF = 1e-9
# Condition number of the mass matrix above which something in it counts as massless.
_MOST_UNEQUAL = 1e14


def mjcf(closed: ClosedRobot, assembly: Assembly, touching: Iterable[tuple[str, str]] = ()) -> str:
    """Return the robot as MJCF, without contacts of pairs that touch; meshes are OBJ files in ``meshes``.

    Raises DescriptionError where a moving body has no mass, which MuJoCo refuses.
    """
    root = etree.Element("mujoco", model=assembly.name)
    # Frames without mass remain bodies, visuals remain, and no mass is invented or changed.
    etree.SubElement(
        root, "compiler", angle="radian", meshdir="meshes", autolimits="true", fusestatic="false",
        discardvisual="false", balanceinertia="false", boundmass="0", boundinertia="0",
        inertiafromgeom="false",
    )  # fmt: skip
    options = {"integrator": "implicitfast", "iterations": "100", "tolerance": "1e-14"}
    mobilities = _mobilities(closed, assembly)
    welds = {loop.name: _Weld.of(loop, assembly, mobilities) for loop in assembly.loops.loops}
    step = min((0.002, *(0.4 * weld.time_constant for weld in welds.values())))
    etree.SubElement(
        root, "option", gravity=text(closed.mechanism.shared_model.gravity.linear), timestep=repr(step), **options
    )
    etree.SubElement(root, "statistic", extent="3")
    asset = etree.SubElement(root, "asset")
    for (file, scale), name in assembly.meshes.items():
        shape = {"file": f"{PurePosixPath(file).stem}.obj", "scale": text(scale)}
        etree.SubElement(asset, "mesh", name=name, **shape, inertia="shell")  # flat meshes have no volume
    world = etree.SubElement(root, "worldbody")
    etree.SubElement(world, "light", pos="0 0 6", directional="true")
    _fill(world, assembly.bodies[assembly.base], assembly)
    for name in assembly.free:
        _fill(_placed(world, assembly, name, pin.SE3.Identity(), free=True), assembly.bodies[name], assembly)
    contact = etree.SubElement(root, "contact")
    for one, other in touching:
        names = ("world" if body == assembly.base else assembly.called(body) for body in (one, other))
        etree.SubElement(contact, "exclude", **dict(zip(("body1", "body2"), names, strict=True)))
    _close_loops(etree.SubElement(root, "equality"), welds, assembly)
    actuators = etree.SubElement(root, "actuator")
    # Each gives its rated force at its largest deflection, and no more beyond it.
    for joint in assembly.servos:
        stiffness = repr(joint.servo_stiffness)
        servo = etree.SubElement(actuators, "position", name=joint.name, joint=joint.name, kp=stiffness, dampratio="1")
        if joint.limits:
            servo.set("ctrlrange", text(joint.limits))
        if joint.effort:
            servo.set("forcerange", text((-joint.effort, joint.effort)))
    key = etree.SubElement(etree.SubElement(root, "keyframe"), "key", name="closed")
    key.set("ctrl", text(joint.value for joint in assembly.servos))
    return xml_text(root, indented=True)


def _mobilities(closed: ClosedRobot, assembly: Assembly) -> dict[str, tuple[float, float]]:
    """Return the mobility of each loop's body, all loops open, in translation (1/kg) and rotation (1/(kg m²)), by name.

    It is the mean of three directions at the centre of mass; MuJoCo does not define that of a body without mass.
    """
    mechanism, found = closed.mechanism, {}
    model, data = mechanism.shared_model, mechanism.shared_model.createData()
    mass = pin.crba(model, data, closed.result.configuration)
    mass = np.triu(mass) + np.triu(mass, 1).T
    for joint in assembly.servos:
        column = mechanism.joint_columns[joint.name].start
        mass[column, column] += joint.armature
    if not np.isfinite(np.linalg.cond(mass)) or np.linalg.cond(mass) > _MOST_UNEQUAL:
        least = int(np.argmin(np.diag(mass)))
        moving = next(name for name, column in mechanism.joint_columns.items() if column.start <= least < column.stop)
        raise DescriptionError(
            "URDF", f"the links that '{moving}' moves have no mass, which MuJoCo refuses; give them one"
        )
    pin.computeJointJacobians(model, data, closed.result.configuration)
    for loop in assembly.loops.loops:
        for name in (assembly.heavy(loop.frame_a), assembly.heavy(loop.frame_b)):
            inertia = assembly.bodies[name].inertia
            if inertia is None or name == assembly.base:
                found[name] = (0.0, 0.0)
                continue
            frame = model.frames[mechanism.frame_id(name)]
            centre = frame.placement * pin.SE3(np.eye(3), inertia.lever)
            jacobian = pin.getFrameJacobian(model, data, frame.parentJoint, centre, pin.LOCAL_WORLD_ALIGNED)
            shares = np.diag(jacobian @ np.linalg.solve(mass, jacobian.T)) / 3.0
            found[name] = (float(shares[:3].sum()), float(shares[3:].sum()))
    return found


def _pose(pose: pin.SE3) -> dict[str, str]:
    x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
    return {"pos": text(pose.translation), "quat": text((w, x, y, z))}


def _placed(parent: Any, assembly: Assembly, name: str, above: pin.SE3, *, free: bool = False) -> Any:
    place = _pose(above.actInv(assembly.bodies[name].pose))
    element = etree.SubElement(parent, "body", name=assembly.called(name), **place)
    if free:
        etree.SubElement(element, "freejoint", name=f"{name}_free")
    return element


def _weighs(body: Body, assembly: Assembly) -> bool:
    """Return whether a body, or one fixed to it, has a mass that is neither a point nor a line."""
    masses = (assembly.bodies[name].inertia for name in assembly.fixed_to(body.name))
    return any(mass is not None and np.linalg.eigvalsh(mass.inertia).min() > _LEAST_MOMENT for mass in masses)


def _fill(element: Any, body: Body, assembly: Assembly) -> None:
    """Add joint, mass and shapes of a body to its element, and below it the bodies that it carries."""
    joint = assembly.joints.get(body.name)
    if joint is not None and joint.kind != "fixed":
        _joint(element, joint, assembly)
        if not _weighs(body, assembly):
            lacks = "mass, or no moment of inertia about an axis" if body.inertia else "mass"
            problem = f"link {body.name} moves and has no {lacks}, which MuJoCo refuses; give it one"
            raise DescriptionError("URDF", problem)
    if body.inertia is not None and body.name != assembly.base:
        m = body.inertia.inertia
        least, middle, most = np.linalg.eigvalsh(m)
        if m.any() and not (least > 0.0 and most <= (least + middle) * (1.0 + _ROUND_OFF)):
            values = f"principal moments of inertia {least:.3g}, {middle:.3g}, {most:.3g} kg m²"
            problem = f"link {body.name}: {values} are physically impossible, which MuJoCo refuses"
            raise DescriptionError("URDF", f"{problem}; give positive ones, each at most the sum of the others")
        moments = {"fullinertia": text((m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))}
        if not m.any():  # MuJoCo accepts a point mass that does not move by itself in this form
            moments = {"diaginertia": "0 0 0"}
        etree.SubElement(element, "inertial", pos=text(body.inertia.lever), mass=repr(body.inertia.mass), **moments)
    for shape in body.visuals:
        _geom(element, shape, assembly, contype="0", conaffinity="0", group="2", rgba=text(shape.colour))
    for shape in body.collisions:
        _geom(element, shape, assembly, group="3")
    for frame in dict.fromkeys(assembly.loops.loop_frames):
        if assembly.heavy(frame) == body.name:
            place = _pose(body.pose.actInv(assembly.bodies[frame].pose))
            etree.SubElement(element, "site", name=frame, group="4", **place)
    for name in assembly.carried_by(body.name):
        _fill(_placed(element, assembly, name, body.pose), assembly.bodies[name], assembly)


def _joint(element: Any, joint: Joint, assembly: Assembly) -> None:
    if joint.kind == "spherical":
        etree.SubElement(element, "joint", name=joint.name, type="ball", damping=repr(_DEFAULT_DAMPING))
        return
    kind = "slide" if joint.kind == "prismatic" else "hinge"
    written = etree.SubElement(
        element, "joint", name=joint.name, type=kind, axis=text(joint.axis), ref=repr(joint.value),
        damping=repr(joint.damping or _DEFAULT_DAMPING), frictionloss=repr(joint.friction),
    )  # fmt: skip
    if joint in assembly.servos:
        written.set("armature", repr(joint.armature))
    if joint.limits:
        written.set("range", text(joint.limits))


def _geom(element: Any, shape: Shape, assembly: Assembly, **more: str) -> None:
    halved = {"box": (0.5, 0.5, 0.5), "cylinder": (1.0, 0.5), "sphere": (1.0,)}
    geom = etree.SubElement(element, "geom", type=shape.kind, **_pose(shape.pose), **more)
    if shape.kind == "mesh":
        geom.set("mesh", assembly.meshes[shape.mesh, shape.sizes])
    else:
        geom.set("size", text(np.multiply(halved[shape.kind], shape.sizes)))


@dataclass(frozen=True)
class _Weld:
    """MuJoCo's parameters for a loop with the stiffness of ours.

    A constraint at rest that is open by r pulls with k r d / ((1 - d) m): k = 1/(d t)² with its time constant t, d its
    impedance, m the sum of the mobilities of its two bodies. A weld's rotation counts as half its angle, times the
    torque scale.
    """

    time_constant: float
    impedance: float
    torque_scale: float

    @classmethod
    def of(cls, loop: LoopSpec, assembly: Assembly, mobilities: Mapping[str, tuple[float, float]]) -> Self:
        ends = (mobilities[assembly.heavy(frame)] for frame in (loop.frame_a, loop.frame_b))
        slide, turn = (sum(parts) for parts in zip(*ends, strict=True))
        along, about = assembly.loops.stiffness_si
        time = min(_TIME_CONSTANT, 1.0 / math.sqrt(along * slide * _LARGEST_IMPEDANCE * (1.0 - _LARGEST_IMPEDANCE)))
        impedance = 0.5 + math.sqrt(0.25 - 1.0 / (along * slide * time**2))
        return cls(time, impedance, 2.0 * math.sqrt(about / along * turn / slide))


def _close_loops(equality: Any, welds: Mapping[str, _Weld], assembly: Assembly) -> None:
    for loop in assembly.loops.loops:
        weld = welds[loop.name]
        softness = {"solref": text((weld.time_constant, 1.0)), "solimp": text((*[weld.impedance] * 2, 1e-3, 0.5, 2.0))}
        kind, scale = ("weld", {"torquescale": repr(weld.torque_scale)}) if loop.type == "6d" else ("connect", {})
        etree.SubElement(equality, kind, name=loop.name, site1=loop.frame_a, site2=loop.frame_b, **scale, **softness)
    for mimic in assembly.mimics:
        ratio = text((0.0, mimic.ratio, 0.0, 0.0, 0.0))
        etree.SubElement(equality, "joint", joint1=mimic.joint, joint2=mimic.leader, polycoef=ratio)
