"""The robot's description: xacro and dimensions file in, URDF out, without ROS.

A URDF is a plain string here. :func:`render_urdf` makes it, :func:`perturb_urdf` moves single joints in it,
which is how every geometric error enters the mechanism, and :func:`write_urdf` puts it into a folder with its
meshes, so that any other program can load it.
"""

from __future__ import annotations

import hashlib
import html
import math
import os
import re
import threading
import xml.parsers.expat
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import xacro
from lxml import etree
from numpy.typing import NDArray

from pouring_robot.exceptions import DescriptionError, UnknownJointError
from pouring_robot.io.files import write_together
from pouring_robot.robot.pouring.layout import (
    CHAINS,
    LadleDimensions,
    Layout,
    check_layout,
    description_folder,
    layout_names,
    load_layout,
    read_text,
    shipped_layouts_file,
)

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
_CACHE_SIZE = 64
# How xacro begins to complain about the way a macro is called.
_CALLERS_FAULTS = ("Invalid parameter", "Undefined parameters", "Not enough blocks", "Unused block")

# xacro keeps its file stack, arguments and include list in module globals.
_xacro_lock = threading.Lock()
_rendered: OrderedDict[str, str] = OrderedDict()


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


def render_urdf(
    layout: str = "paper",
    *,
    chain_order: Sequence[int] = (1, 2, 3, 4),
    layouts_file: Path | None = None,
    mesh_folder: Path | None = None,
) -> str:
    """Return the robot's URDF.

    Rendering takes a few tenths of a second; the result is kept by a hash of everything it depends on, so a
    changed file is seen and an unchanged one is not rendered twice. Safe to call from several threads.

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
        "layouts_file": str(path),
        "chains": " ".join(str(chain) for chain in chain_order),
        "mesh_prefix": _MESH_PACKAGE if mesh_folder is None else mesh_folder.absolute().as_posix(),
    }
    key = _content_hash(dimensions, folder, arguments)
    with _xacro_lock:
        if key not in _rendered:
            _rendered[key] = _run_xacro(folder / "pouring_robot.urdf.xacro", arguments)
            if len(_rendered) > _CACHE_SIZE:
                _rendered.popitem(last=False)
        _rendered.move_to_end(key)
        return _rendered[key]


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
    try:
        root = etree.fromstring(urdf.encode())
    except etree.XMLSyntaxError as error:
        raise DescriptionError("URDF", f"line {error.lineno}: {error.msg}") from error
    files: dict[Path, bytes] = {}
    for mesh in root.iter("mesh"):
        source = _mesh_path(mesh.get("filename", ""))
        try:
            files[folder / "meshes" / source.name] = source.read_bytes()
        except OSError as error:
            raise DescriptionError(source, f"cannot be read: {error.strerror}") from error
        mesh.set("filename", f"meshes/{source.name}")
    files |= {folder / name: content for name, content in (beside or {}).items()}
    target = folder / f"{root.get('name', 'robot')}.urdf"
    files[target] = etree.tostring(root, xml_declaration=True, encoding="utf-8") + b"\n"
    write_together(files)
    return target


def _content_hash(dimensions: str, folder: Path, arguments: Mapping[str, str]) -> str:
    """Hash all that a rendering depends on: the xacro files, the dimensions and the arguments."""
    digest = hashlib.sha256()
    texts = [dimensions, *(read_text(path) for path in sorted(folder.glob("*.xacro")))]
    for text in [*texts, *(f"{key}={value}" for key, value in sorted(arguments.items()))]:
        digest.update(text.encode() + b"\0")
    return digest.hexdigest()


def _run_xacro(path: Path, arguments: Mapping[str, str]) -> str:
    """Run xacro in this process; the caller holds the lock."""
    try:
        document = xacro.process_file(str(path), mappings=dict(arguments), verbosity=0)
    except xml.parsers.expat.ExpatError as error:
        raise DescriptionError(_file_at_fault(path, ""), f"not valid XML: {error}") from error
    except Exception as error:  # xacro evaluates expressions, so a broken file can raise anything
        raise DescriptionError(_file_at_fault(path, str(error)), f"xacro: {error or type(error).__name__}") from error
    # The banner names the path of this machine; the same description must give the same text anywhere.
    for node in list(document.childNodes):
        if node.nodeType == node.COMMENT_NODE:
            document.removeChild(node)
    return re.sub(r"\n\s*\n", "\n", document.toprettyxml(indent="  "))


def _file_at_fault(path: Path, problem: str) -> Path:
    """Return the file xacro stumbled over: on failure it leaves its stacks as they stood.

    The macro on top is not always at fault: xacro enters it before it evaluates what its caller passes, and evaluates
    properties where they are used. So the file must hold the text that the problem quotes.
    """
    stacks = [xacro.filestack, *(macro.history[-1] for macro in xacro.macrostack or [])]
    entered = [Path(os.path.normpath(stack[-1])) for stack in stacks if stack and stack[-1]] or [path]
    quoted = re.search(
        r"evaluating expression '(.*?)'(?:\s+when evaluating |\s*$)|unknown macro name: (\S+)", problem, re.DOTALL
    )
    if quoted:
        wanted = _plain(f"${{{quoted[1]}}}" if quoted[1] is not None else f"<{quoted[2]}")
        for file in (*reversed(entered), *sorted(path.parent.glob("*.xacro"))):
            if wanted in _plain(html.unescape(read_text(file))):
                return file
    if len(entered) > 1 and problem.startswith(_CALLERS_FAULTS):
        return entered[-2]
    return entered[-1]


def _plain(text: str) -> str:
    return "".join(text.split())


def _displace(joint: etree._Element, placement: PlacementError) -> None:
    """Move one joint's origin in place."""
    origin = joint.find("origin")
    if origin is None:
        origin = etree.SubElement(joint, "origin")
    xyz, rpy = _numbers(joint, origin, "xyz"), _numbers(joint, origin, "rpy")
    nominal = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    error = pin.SE3(pin.exp3(np.array(placement.rotation_rad)), np.array(placement.translation_m))
    actual = nominal * error
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
