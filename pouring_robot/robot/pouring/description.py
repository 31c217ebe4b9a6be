"""The robot's description: xacro and dimensions file in, URDF out, without ROS.

A URDF is a plain string here. :func:`render_urdf` makes it, :func:`perturb_urdf` moves single joints in it,
which is how every geometric error enters the mechanism, and :func:`write_urdf` puts it into a folder with its
meshes, so that any other program can load it.
"""

from __future__ import annotations

import functools
import importlib.metadata
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree
from numpy.typing import NDArray

from pouring_robot.exceptions import DescriptionError, UnknownJointError
from pouring_robot.io.cache import content_key, kept_text
from pouring_robot.io.files import write_together
from pouring_robot.robot.pouring.layout import (
    LadleDimensions,
    Layout,
    check_layout,
    description_folder,
    layout_names,
    load_layout,
    read_text,
    shipped_layouts_file,
)
from pouring_robot.robot.pouring.names import CHAINS

__all__ = [
    "LadleDimensions",
    "Layout",
    "PlacementError",
    "description_folder",
    "layout_names",
    "load_layout",
    "perturb_urdf",
    "render_urdf",
    "write_urdf",
]

_MESH_PACKAGE = "package://robot_description/meshes"


@dataclass(frozen=True)
class PlacementError:
    """How far a joint is from where it should be, both parts in the joint's nominal frame.

    Attributes:
        translation_m: shift of the joint's origin, m.
        rotation_rad: rotation vector (axis times angle), rad.
    """

    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse what is not three finite numbers each.

        Raises:
            ValueError: a part is not three finite numbers.
        """
        for name, part in (("translation_m", self.translation_m), ("rotation_rad", self.rotation_rad)):
            if len(part) != 3 or not all(math.isfinite(v) for v in part):
                raise ValueError(f"{name} must be three finite numbers, not {part}")

    @classmethod
    def from_se3(cls, displacement: pin.SE3) -> PlacementError:
        """Take a displacement given as the pose of the actual placement in the nominal one."""
        x, y, z = displacement.translation.tolist()
        rx, ry, rz = pin.log3(displacement.rotation).tolist()
        return cls((x, y, z), (rx, ry, rz))

    def to_se3(self) -> pin.SE3:
        """Return the same as the pose of the actual placement in the nominal one."""
        return pin.SE3(pin.exp3(np.array(self.rotation_rad)), np.array(self.translation_m))


def render_urdf(
    layout: str = "paper",
    *,
    chain_order: Sequence[int] = (1, 2, 3, 4),
    layouts_file: Path | None = None,
    mesh_folder: Path | None = None,
) -> str:
    """Return the robot's URDF.

    Rendering takes half a second; the result is kept on disk by a hash of everything it depends on, so a changed
    file is seen and an unchanged one is rendered once a machine. Safe to call from several threads.

    Args:
        layout: name of a layout in the dimensions file.
        chain_order: the four chains; the first carries the moving platform in the tree, the others
            close on it.
        layouts_file: dimensions file (default: the shipped one).
        mesh_folder: folder written into the mesh addresses (default: ``package://robot_description/meshes``).

    Raises:
        DescriptionError: the dimensions file or a xacro file is wrong; names file and, where known, line
            and key.
        UnknownLayoutError: the dimensions file holds no such layout.
        ValueError: ``chain_order`` is not an order of 1, 2, 3, 4.
    """
    if sorted(chain_order) != list(CHAINS):
        raise ValueError(f"chain_order must hold 1, 2, 3 and 4 once each, not {tuple(chain_order)}")
    path = (layouts_file or shipped_layouts_file()).absolute()
    dimensions = read_text(path)
    check_layout(layout, path, dimensions)
    folder = description_folder() / "urdf"
    arguments = {
        "layout": layout,
        "chains": " ".join(str(chain) for chain in chain_order),
        "mesh_prefix": _MESH_PACKAGE if mesh_folder is None else mesh_folder.absolute().as_posix(),
    }
    parts = [f"{key}={value}" for key, value in arguments.items()]
    parts += [importlib.metadata.version("xacro"), *(read_text(file) for file in sorted(folder.glob("*.xacro")))]
    arguments["layouts_file"] = str(path)  # its text counts, not its place
    return _rendered(content_key([dimensions, *parts]), dimensions, folder, tuple(arguments.items()))


def perturb_urdf(urdf: str, placements: Mapping[str, PlacementError]) -> str:
    """Return the URDF with single joints displaced.

    Each joint's origin M becomes M · SE3(exp3(rotation_rad), translation_m); all else stays as it is. Numbers
    are written so that reading them gives the same double again: errors of a nanometre survive.

    Args:
        urdf: the nominal URDF.
        placements: displacement by joint name.

    Raises:
        UnknownJointError: the URDF has no joint of that name.
        DescriptionError: the URDF is not readable XML, or a joint's origin is not six numbers.
    """
    try:
        root = etree.fromstring(urdf.encode())
    except etree.XMLSyntaxError as error:
        raise DescriptionError("URDF", f"line {error.lineno}: {error.msg}") from error
    joints = {joint.get("name", ""): joint for joint in root.iterfind("joint")}
    for name, placement in placements.items():
        if name not in joints:
            raise UnknownJointError(name, joints)
        _displace(joints[name], placement)
    text: str = etree.tostring(root, encoding="unicode")
    return text + "\n"


def write_urdf(urdf: str, folder: Path, beside: Mapping[str, bytes] | None = None) -> Path:
    """Write a URDF and its meshes into a folder, all or nothing.

    Mesh addresses become relative (``meshes/…``), which readers resolve from the URDF's own folder, so that
    the folder can be moved or sent away.

    Args:
        urdf: as :func:`render_urdf` or :func:`perturb_urdf` give it.
        folder: made if it is not there.
        beside: further files to write with it, by name.

    Returns:
        The URDF's path, ``<robot name>.urdf``.

    Raises:
        DescriptionError: the URDF is not readable XML, or a mesh is missing.
        OutputError: the folder cannot be written; it is left as it was.
    """
    files = urdf_files(urdf, folder, beside)
    return write_together(files)[-1]


def urdf_files(urdf: str, folder: Path, beside: Mapping[str, bytes] | None = None) -> dict[Path, bytes | str]:
    """Return what :func:`write_urdf` writes, by path; the URDF last.

    Raises:
        DescriptionError: the URDF is not readable XML, or a mesh is missing.
    """
    try:
        root = etree.fromstring(urdf.encode())
    except etree.XMLSyntaxError as error:
        raise DescriptionError("URDF", f"line {error.lineno}: {error.msg}") from error
    files: dict[Path, bytes | str] = {}
    for mesh in root.iter("mesh"):
        source = _mesh_path(mesh.get("filename", ""))
        try:
            files[folder / "meshes" / source.name] = source.read_bytes()
        except OSError as error:
            raise DescriptionError(source, f"cannot be read: {error.strerror}") from error
        mesh.set("filename", f"meshes/{source.name}")
    files |= {folder / name: content for name, content in (beside or {}).items()}
    files[folder / f"{root.get('name', 'robot')}.urdf"] = (
        etree.tostring(root, xml_declaration=True, encoding="utf-8") + b"\n"
    )
    return files


@functools.lru_cache(maxsize=64)
def _rendered(key: str, dimensions: str, folder: Path, arguments: tuple[tuple[str, str], ...]) -> str:
    """Return the rendering that the key stands for: an earlier process may have made it."""

    def render() -> str:
        from pouring_robot.robot.pouring.rendering import run_xacro

        urdf, path = (
            run_xacro(folder / "pouring_robot.urdf.xacro", dict(arguments)),
            Path(dict(arguments)["layouts_file"]),
        )
        if read_text(path) != dimensions:  # xacro read it by itself: do not keep its answer under the other's name
            raise DescriptionError(path, "changed while it was read; run the command again")
        return urdf

    return kept_text(f"urdf/{key}.urdf", render)


def _displace(joint: etree._Element, placement: PlacementError) -> None:
    """Move one joint's origin in place."""
    origin = joint.find("origin")
    if origin is None:
        origin = etree.SubElement(joint, "origin")
    xyz, rpy = _numbers(joint, origin, "xyz"), _numbers(joint, origin, "rpy")
    nominal = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    actual = nominal * placement.to_se3()
    origin.set("xyz", " ".join(repr(float(v)) for v in actual.translation))
    origin.set("rpy", " ".join(repr(float(v)) for v in pin.rpy.matrixToRpy(actual.rotation)))


def _numbers(joint: etree._Element, origin: etree._Element, attribute: str) -> NDArray[np.float64]:
    text = origin.get(attribute, "0 0 0")
    try:
        x, y, z = (float(part) for part in text.split())
    except ValueError as error:
        name = joint.get("name")
        problem = f"joint {name}: origin {attribute}='{text}' is not three numbers"
        raise DescriptionError("URDF", problem) from error
    return np.array([x, y, z])


def _mesh_path(address: str) -> Path:
    """Return the file a mesh address stands for: our own package, or a plain path."""
    if address.startswith(_MESH_PACKAGE):
        path = description_folder() / "meshes" / address.removeprefix(_MESH_PACKAGE).lstrip("/")
    else:
        path = Path(address.removeprefix("file://"))
    if not path.is_file():
        raise DescriptionError(path, "this mesh is missing")
    return path
