"""A closed robot as bodies, joints and loops, each body where it stands: what MJCF and SDF are written from."""

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
from pouring_robot.robot.export.closed_robot import ClosedRobot


@dataclass(frozen=True)
class Shape:
    """A visual or a collision."""

    kind: str  # ``box``, ``cylinder``, ``sphere`` or ``mesh``
    # in m: lengths of a box; radius and length of a cylinder; radius of a sphere; scale of a mesh
    sizes: tuple[float, ...]
    pose: pin.SE3  # in its body
    mesh: str = ""  # file name of a mesh
    colour: tuple[float, ...] = (0.7, 0.7, 0.7, 1.0)  # red, green, blue, opacity

    @property
    def stem(self) -> str:
        """Name of its mesh without suffix, as all formats of it have."""
        return PurePosixPath(self.mesh).stem


@dataclass(frozen=True)
class Body:
    """A link where it stands."""

    name: str
    pose: pin.SE3  # in the world, m
    inertia: pin.Inertia | None  # in the body's frame; None for a frame without mass
    visuals: tuple[Shape, ...]  # what is drawn
    collisions: tuple[Shape, ...]  # what is touched


# What says the sizes of a shape.
_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ("scale",)}
# Of a drive's servo: what it yields at its rated force, in m or rad, and how fast it answers, in rad/s.
_YIELDS, _BANDWIDTH = 5e-3, 100.0


@dataclass(frozen=True)
class Joint:
    """A joint of the tree."""

    name: str
    kind: str  # ``revolute`` (``continuous`` too), ``prismatic``, ``spherical`` or ``fixed``
    parent: str  # body that carries it; ``child``: body that it moves
    child: str
    axis: FloatArray  # in the child, unit length, (3,)
    value: float  # at which the bodies stand where they stand, in m or rad
    limits: tuple[float, float] | None  # lower and upper value; None: it goes round
    effort: float  # largest force or torque said, N or Nm; 0: none. Likewise ``velocity``, m/s or rad/s.
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
        """Inertia of that servo's motor, seen from the joint, in kg or kg m²."""
        return self.servo_stiffness / _BANDWIDTH**2


@dataclass(frozen=True, eq=False)
class Assembly:
    """A closed robot without its cut joints: every chain closes on the platform by a loop."""

    name: str
    bodies: Mapping[str, Body]  # by name, each after the one that carries it
    joints: Mapping[str, Joint]  # by the name of the body that each moves; bodies that nothing carries are not in it
    loops: LoopsFile  # frames (bodies here) that coincide, drives, stiffness
    base: str  # the body that stands still, first of all
    mimics: tuple[Mimic, ...]  # joints that follow others

    @classmethod
    def of(cls, closed: ClosedRobot, urdf: bytes | None = None) -> Self:
        """Read it off a closed robot; raises DescriptionError for a joint or shape that cannot be written.

        ``urdf`` is the tree as it is exported, whose meshes are called as their files are; by default as it is drawn.
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
        """Return a link's name where some are ``taken``, and ``world`` always: the robot's stands before it then."""
        return f"{self.name}_{name}" if name in ("world", *taken) else name

    def solid(self, name: str) -> str:
        """Return the body that a frame without mass sits on; a body with mass is its own."""
        while self.bodies[name].inertia is None and name in self.joints and self.joints[name].kind == "fixed":
            name = self.joints[name].parent
        return name

    def fixed_to(self, name: str) -> Iterator[str]:
        """Yield a body and those that are fixed to it, down the tree."""
        yield name
        for child in self.carried_by(name):
            if self.joints[child].kind == "fixed":
                yield from self.fixed_to(child)

    def heavy(self, name: str) -> str:
        """Return a body with mass that a frame goes with: its :meth:`solid`, or what is fixed to that; else that."""
        solid = self.solid(name)
        return next((body for body in self.fixed_to(solid) if self.bodies[body].inertia is not None), solid)

    def carried_by(self, name: str) -> tuple[str, ...]:
        """Return the bodies that a body carries by joints."""
        return tuple(joint.child for joint in self.joints.values() if joint.parent == name)

    @property
    def servos(self) -> tuple[Joint, ...]:
        """The joints that are held by a servo: drives, then the locked ones."""
        by_name = {joint.name: joint for joint in self.joints.values() if joint.kind in ("revolute", "prismatic")}
        return tuple(by_name[n] for n in (*self.loops.drives, *self.loops.locked_joints) if n in by_name)

    @property
    def free(self) -> tuple[str, ...]:
        """Bodies that only loops hold."""
        return tuple(name for name in self.bodies if name not in self.joints and name != self.base)

    @functools.cached_property
    def meshes(self) -> dict[tuple[str, tuple[float, ...]], str]:
        """A name for each mesh in each size, by its file and scale: left and right are often one mesh, mirrored."""
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
    own = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    own.inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # as it is said, also that of no body
    return origin_pose(inertial).act(own)


def _shapes(link: Any, what: str, paint: Mapping[Any, Any]) -> Iterator[Shape]:
    for entry in link.iterfind(what):
        form, material, rgba = entry.find("geometry")[0], entry.find("material"), None
        if material is not None:  # those with a colour of their own are often all called alike, or not at all
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
    said = {key: value for part in entry.xpath("limit | dynamics") for key, value in part.attrib.items()}
    return Joint(
        name,
        "revolute" if kind == "continuous" else kind,
        str(entry.find("parent").get("link")),
        str(entry.find("child").get("link")),
        axis / (np.linalg.norm(axis) or 1.0),  # fixed joints may have none
        closed.joints.get(name, 0.0),
        None if kind == "spherical" else limits_of(entry),
        *(float(said.get(key, "0")) for key in ("effort", "velocity", "damping", "friction")),
    )
