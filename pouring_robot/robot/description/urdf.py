"""URDF texts: displaced joints, and a folder with all files that a URDF names.

A URDF is a plain string here. :func:`perturb_urdf` displaces single joints in it, which is how every geometric error
enters a mechanism, and :func:`write_urdf` writes it into a folder with its meshes, so that any other program can load
it. DescriptionError is raised for text that is not readable XML, and for a mesh or folder that is missing or that a
description may not read.
"""

import contextlib
import itertools
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pouring_robot.exceptions import DescriptionError, UnknownJointError
from pouring_robot.io.files import read_text, write_together
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.joint_types import BOUNDED, UNITS
from pouring_robot.robot.description.untrusted import package, readable

MESH_PACKAGE = "package://pouring_robot_description/meshes"
_FILE = "file://"
_ROUND_OFF = 1e-15
_FARTHEST = 30.0
"""How far a centre of mass may be, over the length of all joints plus a metre: one in mm is a thousand times off."""


def shipped_folder(name: str, holds: str, words: str) -> Path:
    """Return a shipped folder that holds a file: inside an installed package, next to the package in a checkout."""
    package = Path(__file__).resolve().parents[2]
    for folder in (package / name, package.parent / name):
        if (folder / holds).is_file():
            return folder
    raise DescriptionError(package / name, f"{words} missing; reinstall pouring_robot")


def description_folder() -> Path:
    """Return the folder of the shipped description; raises DescriptionError where it is missing."""
    return shipped_folder("robot_description", "urdf/pouring_robot.urdf.xacro", "the robot description is")


def read_urdf(path: Path) -> str:
    """Return the text of a URDF without leading blank lines, which readers of URDFs allow and XML does not.

    The byte order mark that some editors write is removed too.
    """
    return read_text(path).lstrip("\ufeff \t\r\n")


def parsed(urdf: str, source: Path | str = "URDF") -> etree._Element:
    """Return the root of a URDF; raises DescriptionError, with its source, where the text is not readable XML."""
    try:
        return etree.fromstring(urdf.encode())
    except etree.XMLSyntaxError as error:
        wanted = "" if "<" in urdf else "; give a URDF or a xacro"
        raise DescriptionError(source, f"line {error.lineno}: {error.msg}{wanted}") from error


def xml_text(root: etree._Element, *, indented: bool = False) -> str:
    """Return XML text that ends with a newline; ``indented`` for a tree that was built element by element."""
    if indented:
        etree.indent(root)
    return str(etree.tostring(root, encoding="unicode")) + "\n"


def text(values: Iterable[float]) -> str:
    """Return numbers as text that reads back as the same doubles."""
    return " ".join(repr(float(value)) for value in values)


def reach(urdf: str, values: Mapping[str, float], driven: Collection[str]) -> float:
    """Return the length of the longest chain from the root to a link, stretched out, in m.

    Slides count with their values (m), or, where these are zero and they are driven, with their range.
    """
    root, steps = etree.fromstring(urdf.encode()), dict[str, float]()
    for joint in root.iterfind("joint"):
        name, slide = str(joint.get("name")), 0.0
        if joint.get("type") == "prismatic":
            slide = abs(values.get(name, 0.0)) or (float(np.ptp(limits_said(joint))) if name in driven else 0.0)
        steps[name] = float(np.linalg.norm(origin_pose(joint).translation)) + slide
    ways = carriers(root, *(str(link.get("name")) for link in root.iterfind("link"))).values()
    return max((sum(steps[name] for name in way) for way in ways), default=0.0)


def carriers(root: etree._Element, *frames: str) -> dict[str, list[str]]:
    """Return the joints, moving and fixed, that carry each of some frames of a URDF, the nearest first.

    A frame is a link or a joint; a joint counts among its own carriers.
    """
    whole = (j for j in root.iterfind("joint") if j.find("parent") is not None and j.find("child") is not None)
    joints = {j.get("name"): [j.find(end).get("link") for end in ("parent", "child")] for j in whole}
    above = {child: (name, parent) for name, (parent, child) in joints.items()}

    def way(frame: str) -> list[str]:
        link, found = joints[frame][1] if frame in joints and frame not in above else frame, list[str]()
        while link in above and above[link][0] not in found:
            name, link = above[link]
            found.append(name)
        return found

    return {frame: way(frame) for frame in frames}


def robot_name(root: etree._Element) -> str:
    """Return the name of a robot and of its files: that in the URDF, made safe as a file name."""
    return str(root.get("name", "robot")).replace("/", "_")


def joint_axis(joint: etree._Element) -> FloatArray:
    """Return the axis of a joint as written, of any length, (3,)."""
    axis = joint.find("axis")
    return np.array(("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split(), dtype=float)


def limits_said(joint: etree._Element) -> tuple[float, float]:
    """Return the limits of a joint as written, m or rad; zeros where it has none."""
    limit = joint.find("limit")
    return (0.0, 0.0) if limit is None else (float(limit.get("lower", "0")), float(limit.get("upper", "0")))


def limits_of(joint: etree._Element) -> tuple[float, float] | None:
    """Return the limits of a joint, m or rad; None where it has none, by its type or because both are equal."""
    lower, upper = limits_said(joint)
    return (lower, upper) if joint.get("type") in BOUNDED and lower < upper else None


def check_sound(root: etree._Element, source: Path | str) -> None:
    """Refuse what readers accept without warning: axes of zero length, reversed limits, negative masses.

    Masses far from the robot, whose weight would be a moment that no robot can carry, are refused too.
    """
    size = 1.0
    for part in root.iterfind("*"):
        try:
            fault = _fault(part)
        except ValueError as error:
            fault = f"{error}; axes, limits and masses are numbers"
        if fault:
            raise DescriptionError(source, f"{part.tag} '{part.get('name')}': {fault}")
        if part.tag == "joint":
            slide = np.ptp(limits_said(part)) if part.get("type") == "prismatic" else 0.0
            size += float(np.linalg.norm(_three(part, "xyz", source)) + slide)
    for link in root.iterfind("link"):
        inertial = link.find("inertial")
        away = 0.0 if inertial is None else float(np.linalg.norm(_three(inertial, "xyz", source)))
        if not away <= _FARTHEST * size:
            fault = f"a centre of mass {away:.4g} m from its frame; give its inertial origin in m"
            raise DescriptionError(source, f"link '{link.get('name')}': {fault}")


def _fault(part: etree._Element) -> str:
    if part.tag == "joint":
        kind, axis, (lower, upper) = part.get("type"), joint_axis(part), limits_said(part)
        if kind in UNITS and (axis.shape != (3,) or not axis.any()):
            return "it has no direction; give its axis three numbers, not all zero"
        # Programs that move planar joints take z as normal of a joint without axis, though the default axis is x.
        said = kind == "planar" and part.find("axis") is not None
        if said and (axis.shape != (3,) or axis[:2].any() or not axis[2]):
            return (
                "its plane must be normal to z; write axis 0 0 1, and turn its origin so that z is normal to the plane"
            )
        if kind in BOUNDED and part.find("limit") is None:
            return "it has no limits; give it some, or the type 'continuous' if it turns endlessly"
        if kind in BOUNDED and lower > upper:
            return f"limits {lower:g} to {upper:g} (m, rad); exchange them"
    mass = part.find("inertial/mass") if part.tag == "link" else None
    if mass is not None and not float(mass.get("value", "0")) >= 0.0:
        return f"a mass of {mass.get('value')} kg; give 0 or more"
    return ""


def perturb_urdf(urdf: str, placements: Mapping[str, pin.SE3], source: Path | str = "URDF") -> str:
    """Return the URDF with single joints, by name, displaced; ``source`` is the file that error messages name.

    Each joint's origin M becomes M times its displacement; everything else is unchanged. Numbers are written so that
    they read back as the same doubles: errors of a nanometre survive. Raises UnknownJointError, ValueError where a
    displacement is not finite, or DescriptionError where the text is not readable XML or an origin is not six numbers.
    """
    root = parsed(urdf, source)
    joints = {joint.get("name", ""): joint for joint in root.iterfind("joint")}
    for name, placement in placements.items():
        if name not in joints:
            raise UnknownJointError(name, joints)
        if not np.isfinite(placement.homogeneous).all():
            raise ValueError(f"the displacement of '{name}' must be finite numbers")
        actual, origin = origin_pose(joints[name], source) * placement, joints[name].find("origin")
        if origin is None:
            origin = etree.SubElement(joints[name], "origin")
        origin.set("xyz", text(actual.translation))
        origin.set("rpy", text(pin.rpy.matrixToRpy(actual.rotation)))
    return xml_text(root)


def with_mesh_files(urdf: str) -> str:
    """Return the URDF with the meshes of our own package addressed as files, for readers that resolve no packages."""
    return urdf.replace(MESH_PACKAGE, (description_folder() / "meshes").as_posix())


def _of_others(address: str) -> bool:
    """Return whether a mesh is in another package than ours, or on another machine."""
    if address.startswith(_FILE):
        return not _exists(address.removeprefix(_FILE))
    return address.startswith("package://") and not address.startswith(MESH_PACKAGE)


def _exists(path: str) -> bool:
    with contextlib.suppress(OSError):  # a name that is too long, or in a folder that nobody may read
        return Path(path).exists()
    return False


def meshes_from(urdf: str, folder: Path) -> str:
    """Return the URDF with absolute addresses of meshes: of files, and of those in packages that can be found.

    Those of another machine, which computations do not need, start with file://.
    """
    if "<mesh" not in urdf:
        return urdf
    root = parsed(urdf)
    for mesh in root.iter("mesh"):
        kind, _, address = mesh.get("filename", "").rpartition("://")
        if kind in ("", "file"):
            foreign = Path(address).is_absolute() and not _exists(address)  # on another machine
            mesh.set("filename", f"{_FILE}{address}" if foreign else str(readable(address, folder)))
        elif _of_others(mesh.get("filename")):
            with contextlib.suppress(DescriptionError):  # computations do not need meshes
                name, _, rest = address.partition("/")
                if (file := readable(package(name, folder) / rest, folder)).is_file():
                    mesh.set("filename", str(file))
    return xml_text(root)


def write_urdf(urdf: str, folder: Path, beside: Mapping[str, bytes] | None = None) -> Path:
    """Write a URDF with its meshes, and further files ``beside`` it, into a folder, all or nothing; return its path.

    Mesh addresses become relative (``meshes/…``), which readers resolve from the URDF's own folder, so that the folder
    can be moved or sent. Raises OutputError where it cannot be written; the folder is then unchanged.
    """
    return write_together(urdf_files(urdf, folder, beside))[-1]


def urdf_files(urdf: str, folder: Path, beside: Mapping[str, bytes] | None = None) -> dict[Path, bytes]:
    """Return the files that :func:`write_urdf` writes, by path; the URDF last."""
    root = parsed(urdf)
    files, names = dict[Path, bytes](), dict[Path, str]()
    for mesh in root.iter("mesh"):
        if _of_others(mesh.get("filename", "")):
            continue  # only its owner has it: the address stays
        source = _mesh_path(mesh.get("filename", ""))
        if source not in names:  # visual and collision meshes often have the same name, in two folders or formats
            others = itertools.chain([source.name], (f"{k}_{source.name}" for k in itertools.count(2)))
            stems = {Path(name).stem for name in names.values()}  # which name the mesh's other formats, too
            names[source] = next(name for name in others if Path(name).stem not in stems)
        try:
            files[folder / "meshes" / names[source]] = source.read_bytes()
        except OSError as error:
            raise DescriptionError(source, f"cannot be read: {error.strerror}") from error
        mesh.set("filename", f"meshes/{names[source]}")
    _say_massless(root)
    _say_unit_axes(root)
    if root.find("mujoco") is None:  # by default MuJoCo fuses links and drops visuals of a URDF; others ignore this
        settings = {"fusestatic": "false", "discardvisual": "false", "balanceinertia": "false", "strippath": "false"}
        etree.SubElement(etree.SubElement(root, "mujoco"), "compiler", settings)
    files |= {folder / name: content for name, content in (beside or {}).items()}
    # No XML declaration: some readers pass the text on as a string, which must not declare an encoding.
    files[folder / f"{robot_name(root)}.urdf"] = xml_text(root).encode()
    return files


def _say_massless(root: etree._Element) -> None:
    """Write a mass of zero for carried frames that state no mass: some readers would take it as 1 kg."""
    carried = {joint.find("child").get("link") for joint in root.iterfind("joint")}
    for link in root.iterfind("link"):
        if link.get("name") in carried and link.find("inertial") is None:
            inertial = etree.SubElement(link, "inertial")
            etree.SubElement(inertial, "mass", value="0")
            etree.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))


def _say_unit_axes(root: etree._Element) -> None:
    """Normalise axes to length 1: some readers multiply the travel of a joint by the length."""
    for joint in root.iterfind("joint"):
        axis = joint_axis(joint)
        length = np.linalg.norm(axis)
        if length > 0.0 and abs(length - 1.0) > _ROUND_OFF:
            joint.find("axis").set("xyz", text(axis / length))


def origin_pose(element: etree._Element, source: Path | str = "URDF") -> pin.SE3:
    """Return the origin of a joint, shape or mass; raises DescriptionError where it is not six numbers."""
    xyz, rpy = (_three(element, key, source) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _three(element: etree._Element, attribute: str, source: Path | str) -> FloatArray:
    origin = element.find("origin")
    written = "0 0 0" if origin is None else origin.get(attribute, "0 0 0")
    try:
        x, y, z = (float(part) for part in written.split())
    except ValueError as error:
        named = element if element.get("name") else element.getparent()  # a mass is named by its link
        problem = f"{named.tag} {named.get('name')}: origin {attribute}='{written}' is not three numbers"
        raise DescriptionError(source, problem) from error
    return np.array([x, y, z])


def _mesh_path(address: str) -> Path:
    """Return the file of a mesh address: in our own package, or a plain path."""
    if address.startswith(MESH_PACKAGE):
        meshes = description_folder() / "meshes"
        path = readable(address.removeprefix(MESH_PACKAGE).lstrip("/"), meshes)
    else:
        path = Path(address.removeprefix(_FILE))
    if not path.is_file():
        raise DescriptionError(path, "this mesh is missing; put it there, or remove it from the URDF")
    return path
