"""The folder of an exported robot: description, meshes in every format, joint values of the closed pose.

An SRDF lists the pairs of bodies that touch because they are joined, or because their shapes overlap in the drawing.
"""

import itertools
from pathlib import Path
from typing import Literal, get_args

import pinocchio as pin
from lxml import etree
from lxml.builder import E

from pouring_robot.exceptions import BadInputError, DescriptionError, closest
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.files import check_folder, write_together
from pouring_robot.mechanism.pinocchio_model import model_of
from pouring_robot.robot.description.untrusted import FOLDERS_VARIABLE
from pouring_robot.robot.description.urdf import urdf_files, with_mesh_files, xml_text
from pouring_robot.robot.export.bodies_and_joints import Assembly
from pouring_robot.robot.export.joints import JointRow, joints_text
from pouring_robot.robot.export.mjcf import mjcf
from pouring_robot.robot.export.sdf import VERSION, sdf
from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot, configured
from pouring_robot.robot.robot import LOADED, Command, Robot
from pouring_robot.viewer.shapes import read_mesh

Format = Literal["urdf", "mjcf", "sdf", "drake"]
FORMATS: tuple[Format, ...] = get_args(Format)
ADJACENT, TOUCHING = "Adjacent", "Default"
"""Reasons, in MoveIt's words: joined, and in contact at the exported pose."""


def export_robot(
    robot: Robot, folder: Path | str, form: Format = "urdf", command: Command | None = None, *, overwrite: bool = False
) -> list[Path]:
    """Write a robot as built, closed at a command, into a folder, all or nothing; return its files, description last.

    The default command is the middle of its workspace, or the home of its robot file.

    Raises:
        BadInputError: the robot or the format is not one, or it is not a command of this robot.
        NoSolutionError: no pose solves the command.
        DescriptionError: a mesh is missing or invalid, or the format cannot express something.
        OutputError: the folder cannot be written to, or a file exists already and ``overwrite`` is not set.
    """
    expect(robot, Robot, LOADED)
    if form not in FORMATS:
        raise BadInputError(f"unknown format '{form}'{closest(str(form), FORMATS)}")
    folder = check_folder(folder)
    return write_together(exported_files(ClosedRobot.of(robot.model, command), folder, form), overwrite=overwrite)


def exported_files(
    closed: ClosedRobot, folder: Path, form: Format = "urdf", *, zero_here: bool = False, absolute_meshes: bool = False
) -> dict[Path, bytes | str]:
    """Return the files of an export of a closed robot into a folder, by path; the description last.

    The description is a URDF with an SRDF and its robot file, MJCF, or SDF with loops as joints or, for Drake, as
    bushings. ``zero_here``: the URDF's joints count from the command, so that it is closed at zero; joint values and
    robot file, which count from the drawing's zeros, are not written. ``absolute_meshes``: meshes have absolute paths.
    Raises DescriptionError where a mesh is missing or invalid or the format cannot express something, BadInputError
    where the folder holds files of a tree with other zeros.
    """
    joints = {folder / f"joints.{kind}" for kind in ("csv", "json")}
    beside: dict[str, bytes] = closed.robot.model.definition.files_beside() if form == "urdf" else {}
    if zero_here:  # these count from the drawing's zeros
        for stale in sorted(path for path in (*joints, *map(folder.joinpath, beside)) if path.exists()):
            raise BadInputError(f"{stale}: belongs to a tree with other zeros; delete it, or choose another folder")
        joints, beside = set(), {}
    tree = urdf_files(closed.urdf_zero_here() if zero_here else closed.urdf, folder, beside)
    urdf, drawn = tree.popitem()
    assembly = Assembly.of(closed, drawn)
    name = assembly.name
    files: dict[Path, bytes | str] = dict(tree)
    for path in (path for path in tree if path.parent.name == "meshes"):
        mesh = read_mesh(path.name, tree[path])
        files[path.with_suffix(".obj")] = str(mesh.export(file_type="obj", header=None))
        files[path.with_suffix(".glb")] = bytes(mesh.export(file_type="glb"))
    pairs = joined_or_touching(closed, assembly)
    row = JointRow.of(closed.result, commanded=closed.drives)
    files |= {place: joints_text([row], place) for place in sorted(joints)}
    if form != "urdf":
        for missing in (name for name, _ in assembly.meshes if folder / "meshes" / name not in files):
            problem = f"the mesh {missing} is in a package that is not found"
            mend = f"give its file in the URDF, name the package's folder in {FOLDERS_VARIABLE}, or export urdf"
            raise DescriptionError("URDF", f"{problem}; {mend}")
    match form:
        case "mjcf":
            files[folder / f"{name}.xml"] = mjcf(closed, assembly, pairs)
        case "sdf" | "drake":
            files[folder / "model.config"] = _model_config(name)
            files[folder / f"{name}.sdf"] = sdf(assembly, "joints" if form == "sdf" else "bushings")
        case "urdf":
            files[urdf.with_suffix(".srdf")] = srdf(assembly, pairs)
            files[urdf] = _absolute(drawn, folder) if absolute_meshes else drawn
    return files


def _absolute(urdf: bytes, folder: Path) -> bytes:
    root = etree.fromstring(urdf)
    for mesh in root.iter("mesh"):
        if "://" not in mesh.get("filename"):
            mesh.set("filename", str((folder / mesh.get("filename")).resolve()))
    return xml_text(root).encode()


def _model_config(name: str) -> str:
    return xml_text(E.model(E.name(name), E.version("1.0"), E.sdf(f"{name}.sdf", version=VERSION)), indented=True)


def joined_or_touching(closed: ClosedRobot, assembly: Assembly) -> dict[tuple[str, str], str]:
    """Return the pairs of bodies whose collisions are to be ignored, with the reason."""
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
    model = model_of(closed.urdf, closed.robot.model.definition.path)
    shapes = pin.buildGeomFromUrdfString(model, _with_what_is_here(closed.urdf), pin.GeometryType.COLLISION)
    names = [model.frames[item.parentFrame].name for item in shapes.geometryObjects]
    for (i, one), (k, other) in itertools.combinations(enumerate(names), 2):
        if one != other:
            shapes.addCollisionPair(pin.CollisionPair(i, k))
    placed = shapes.createData()
    pin.computeCollisions(model, model.createData(), shapes, placed, configured(model, closed.joints), False)
    found = {
        (names[pair.first], names[pair.second])
        for pair, result in zip(shapes.collisionPairs, placed.collisionResults, strict=True)
        if result.isCollision()
    }
    return sorted(found)


def _with_what_is_here(urdf: str) -> str:
    """Return the URDF without the shapes whose meshes are in packages that only their owner has."""
    root = etree.fromstring(with_mesh_files(urdf).encode())
    for mesh in root.xpath("//mesh[starts-with(@filename, 'package://')]"):
        shape = mesh.getparent().getparent()
        shape.getparent().remove(shape)
    return xml_text(root)


def srdf(assembly: Assembly, pairs: dict[tuple[str, str], str]) -> str:
    """Return the SRDF of a robot: its drives as a group, its passive joints, and pairs that need no collision check."""
    held = {*assembly.loops.drives, *assembly.loops.locked_joints}
    passive = (joint for joint in assembly.joints.values() if joint.kind != "fixed" and joint.name not in held)
    root = E.robot(
        E.group(*(E.joint(name=name) for name in assembly.loops.drives), name="drives"),
        *(E.passive_joint(name=joint.name) for joint in passive),
        *(E.disable_collisions(link1=one, link2=two, reason=reason) for (one, two), reason in pairs.items()),
        name=assembly.name,
    )
    return xml_text(root, indented=True)
