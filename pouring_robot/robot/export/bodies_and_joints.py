"""A closed robot as bodies (with their poses), joints and loops, from which MJCF and SDF are written."""

import functools
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, Self

import numpy as np
import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.joint_types import EXPORTED
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.mechanism.pinocchio_model import Mimic
from pouring_robot.robot.description.urdf import joint_axis, limits_of, origin_pose, robot_name
from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot


@dataclass(frozen=True)
class Shape:
    """A visual or collision shape."""

    kind: str  # ``box``, ``cylinder``, ``sphere`` or ``mesh``
    # in m: lengths of a box; radius and length of a cylinder; radius of a sphere; scale of a mesh
    sizes: tuple[float, ...]
    pose: pin.SE3  # in the body's frame
    mesh: str = ""  # file name of a mesh
    colour: tuple[float, ...] = (0.7, 0.7, 0.7, 1.0)  # red, green, blue, opacity

    @property
    def stem(self) -> str:
        """Name of its mesh without suffix, the same for all formats."""
        return PurePosixPath(self.mesh).stem


@dataclass(frozen=True)
class Body:
    """A link with its pose."""

    name: str
    pose: pin.SE3  # in the world, m
    inertia: pin.Inertia | None  # in the body's frame; None for a frame without mass
    visuals: tuple[Shape, ...]  # shapes that are drawn
    collisions: tuple[Shape, ...]  # shapes that collide


# URDF attributes with the sizes of a shape.
_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ("scale",)}
# Of a drive's servo: deflection at its rated force, in m or rad, and bandwidth, in rad/s.
_YIELDS, _BANDWIDTH = 5e-3, 100.0


@dataclass(frozen=True)
class Joint:
    """A joint of the tree."""

    name: str
    kind: str  # ``revolute`` (``continuous`` too), ``prismatic``, ``spherical`` or ``fixed``
    parent: str  # body that carries it; ``child``: body that it moves
    child: str
    axis: FloatArray  # in the child, unit length, (3,)
    value: float  # at the poses of the bodies, in m or rad
    limits: tuple[float, float] | None  # lower and upper value; None: no limits
    effort: float  # largest force or torque stated, N or Nm; 0: none. Likewise ``velocity``, m/s or rad/s.
    velocity: float
    damping: float  # Ns/m or Nms/rad; ``friction``: N or Nm
    friction: float

    @property
    def servo_effort(self) -> float:
        """Largest force or torque of a servo that moves it, in N or Nm."""
        return self.effort or 1e3

    @property
    def servo_stiffness(self) -> float:
        """Stiffness of that servo, in N/m or Nm/rad."""
        return self.servo_effort / _YIELDS

    @property
    def armature(self) -> float:
        """Inertia of that servo's motor, reflected to the joint, in kg or kg m²."""
        return self.servo_stiffness / _BANDWIDTH**2


@dataclass(frozen=True, eq=False)
class Assembly:
    """A closed robot without its cut joints: a loop closes every chain on the platform."""

    name: str
    bodies: Mapping[str, Body]  # by name, each after the body that carries it
    joints: Mapping[str, Joint]  # by the name of the body that each moves; without bodies that nothing carries
    loops: LoopsFile  # frames (here bodies) that coincide, drives, stiffness
    base: str  # the fixed body, first in ``bodies``
    mimics: tuple[Mimic, ...]  # joints that mimic others

    @classmethod
    def of(cls, closed: ClosedRobot, urdf: bytes | None = None) -> Self:
        """Make it from a closed robot; raises DescriptionError for a joint or shape that cannot be exported.

        ``urdf`` is the tree as exported, in which meshes have the names of their files; by default the robot's own.
        """
        root, mechanism = etree.fromstring(urdf or closed.urdf.encode()), closed.mechanism
        paint = {m.get("name"): m.find("color").get("rgba") for m in root.iterfind(".//material[color]")}
        links = {str(link.get("name")): link for link in root.iterfind("link")}
        kept = (entry for entry in root.iterfind("joint") if entry.get("name") not in mechanism.loops.cut_joints)
        joints = {joint.child: joint for joint in (_joint(entry, closed) for entry in kept)}
        carried = {entry.find("child").get("link") for entry in root.iterfind("joint")}
        base = next(name for name in links if name not in carried)

        def depth(name: str) -> int:
            return 1 + depth(joints[name].parent) if name in joints else 0

        bodies = {
            name: Body(
                name,
                closed.result.pose("universe", name),
                _inertia(links[name]),
                tuple(_shapes(links[name], "visual", paint)),
                tuple(_shapes(links[name], "collision", paint)),
            )
            for name in sorted(links, key=depth)
        }
        for frame in mechanism.loops.loop_frames:
            if frame not in links:
                raise DescriptionError("URDF", f"the loop's frame '{frame}' is no link, so it cannot be exported")
        return cls(robot_name(root), bodies, joints, mechanism.loops, base, mechanism.mimics)

    def called(self, name: str, *taken: str) -> str:
        """Return a link's name in the file; the robot's name is put before ``world`` and names that are ``taken``."""
        return f"{self.name}_{name}" if name in ("world", *taken) else name

    def solid(self, name: str) -> str:
        """Return the body that a frame without mass is fixed to; for a body with mass, itself."""
        while self.bodies[name].inertia is None and name in self.joints and self.joints[name].kind == "fixed":
            name = self.joints[name].parent
        return name

    def fixed_to(self, name: str) -> Iterator[str]:
        """Yield a body and all bodies fixed to it, down the tree."""
        yield name
        for child in self.carried_by(name):
            if self.joints[child].kind == "fixed":
                yield from self.fixed_to(child)

    def heavy(self, name: str) -> str:
        """Return a body with mass to which a frame is fixed: its :meth:`solid` or one fixed to it; else the former."""
        solid = self.solid(name)
        return next((body for body in self.fixed_to(solid) if self.bodies[body].inertia is not None), solid)

    def carried_by(self, name: str) -> tuple[str, ...]:
        """Return the bodies whose joints a body carries."""
        return tuple(joint.child for joint in self.joints.values() if joint.parent == name)

    @property
    def servos(self) -> tuple[Joint, ...]:
        """Joints held by a servo: drives, then locked joints."""
        by_name = {joint.name: joint for joint in self.joints.values() if joint.kind in ("revolute", "prismatic")}
        return tuple(by_name[n] for n in (*self.loops.drives, *self.loops.locked_joints) if n in by_name)

    @property
    def free(self) -> tuple[str, ...]:
        """Bodies that are held by loops only."""
        return tuple(name for name in self.bodies if name not in self.joints and name != self.base)

    @functools.cached_property
    def meshes(self) -> dict[tuple[str, tuple[float, ...]], str]:
        """Names of meshes by file and scale: left and right are often the same mesh, mirrored."""
        found: dict[tuple[str, tuple[float, ...]], str] = {}
        for shape in (s for body in self.bodies.values() for s in (*body.visuals, *body.collisions) if s.mesh):
            if (shape.mesh, shape.sizes) not in found:
                names = itertools.chain([shape.stem], (f"{shape.stem}_{k}" for k in itertools.count(2)))
                found[shape.mesh, shape.sizes] = next(name for name in names if name not in found.values())
        return found


def _inertia(link: Any) -> pin.Inertia | None:
    inertial = link.find("inertial")
    mass = float(inertial.find("mass").get("value")) if inertial is not None else 0.0
    if mass == 0.0:
        return None
    moments = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (float(moments.get(f"i{key}", "0")) for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
    inertia = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    inertia.inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # as stated, even if physically impossible
    return origin_pose(inertial).act(inertia)


def _shapes(link: Any, what: str, paint: Mapping[Any, Any]) -> Iterator[Shape]:
    for entry in link.iterfind(what):
        form, material, rgba = entry.find("geometry")[0], entry.find("material"), None
        if material is not None:  # materials with their own colour often all have the same name, or none
            own = material.find("color")
            rgba = paint.get(material.get("name")) if own is None else own.get("rgba")
        colour = tuple(float(v) for v in rgba.split()) if rgba else Shape.colour
        if form.tag not in _SIZES:
            raise DescriptionError("URDF", f"link {link.get('name')}: a '{form.tag}' cannot be exported")
        written = (form.get(key, "1 1 1" if key == "scale" else "") for key in _SIZES[form.tag])
        mesh = PurePosixPath(form.get("filename", "")).name
        yield Shape(form.tag, tuple(map(float, " ".join(written).split())), origin_pose(entry), mesh, colour)


def _joint(entry: Any, closed: ClosedRobot) -> Joint:
    name, kind = str(entry.get("name")), str(entry.get("type"))
    if kind not in EXPORTED:
        raise DescriptionError("URDF", f"joint {name}: '{kind}' cannot be exported; leave it to cut_joints")
    if closed.mechanism.loops.joint_types.get(name) == "spherical":
        kind = "spherical"
    axis = joint_axis(entry)
    stated = {key: value for part in entry.xpath("limit | dynamics") for key, value in part.attrib.items()}
    return Joint(
        name,
        "revolute" if kind == "continuous" else kind,
        str(entry.find("parent").get("link")),
        str(entry.find("child").get("link")),
        axis / (np.linalg.norm(axis) or 1.0),  # fixed joints may have no axis
        closed.joints.get(name, 0.0),
        None if kind == "spherical" else limits_of(entry),
        *(float(stated.get(key, "0")) for key in ("effort", "velocity", "damping", "friction")),
    )
