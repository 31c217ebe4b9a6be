"""Other programs with the exported robot: do they load it, draw all of it, and find the same mass and pose of the lip?

``write`` needs the package; ``check`` needs only the programs, with a row for each that is installed, so that they may
be in another environment:

    python scripts/studies/consumers.py write FOLDER
    OTHER_PYTHON scripts/studies/consumers.py check FOLDER [NAME ...]

The robot is ``examples/actual.yaml``; the lip's pose is compared in the fixed platform at the exported pose.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

POSE_MM, TILT_DEG = (-100.0, 20.0, -600.0), 17.0
BASE, LIP = "fixed_platform", "ladle_lip"


@dataclass(frozen=True)
class Found:
    """What a program made of the robot.

    Attributes:
        lip_m: pose of the lip in the fixed platform, (4, 4), m; None where it cannot say.
        visuals: how many shapes it draws; None where it cannot say.
        mass_kg: of all links; None where it does not care.
    """

    lip_m: Any
    visuals: int | None = None
    mass_kg: float | None = None


def write(folder: Path) -> None:
    """Export the robot in all formats, and what is expected of it."""
    from pouring_robot.io.files import write_together
    from pouring_robot.robot.export.folder import FORMATS, exported_files
    from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.pouring.platform_pose import PlatformPose
    from pouring_robot.robot.pouring_robot import PouringRobot

    model = RobotModel.load(Path(__file__).parents[2] / "examples" / "actual.yaml")
    located = PouringRobot(model).locate(PlatformPose.from_mm_deg(*POSE_MM, TILT_DEG))
    closed = ClosedRobot.of(model, located.commanded)
    for form in FORMATS:
        write_together(exported_files(closed, folder / form, form))
    write_together(exported_files(closed, folder / "absolute", absolute_meshes=True))
    links = ElementTree.fromstring(closed.urdf).findall("link")
    expected = {
        "lip": located.poses(LIP)[1].homogeneous.tolist(),
        "joints": closed.joints,
        "visuals": sum(len(link.findall("visual")) for link in links),
        "mass_kg": sum(float(str(mass.get("value"))) for link in links for mass in link.iterfind("inertial/mass")),
    }
    (folder / "expected.json").write_text(json.dumps(expected, indent=1) + "\n", encoding="utf-8")


def pose(rotation: Any, translation: Any) -> Any:
    """Return a homogeneous matrix, (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.reshape(rotation, (3, 3)), np.ravel(translation)
    return matrix


def seen_from(base: Any, tip: Any) -> Any:
    """Return the pose of one frame in another, (4, 4), from both in the world."""
    return np.linalg.inv(base) @ tip


def pinocchio(folder: Path, joints: dict[str, float], *, wrapper: bool = False) -> Found:
    """Pinocchio, by its functions or by RobotWrapper without a folder."""
    import pinocchio as pin

    if wrapper:
        robot = pin.RobotWrapper.BuildFromURDF(str(folder / "absolute" / "pouring_robot.urdf"))
        model, visual = robot.model, robot.visual_model
    else:
        path = str(folder / "urdf" / "pouring_robot.urdf")
        model, _, visual = pin.buildModelsFromUrdf(path, str(folder / "urdf"))
    data, configuration = model.createData(), pin.neutral(model)
    for name, value in joints.items():
        configuration[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, configuration)
    base, lip = (data.oMf[model.getFrameId(name)].homogeneous for name in (BASE, LIP))
    return Found(seen_from(base, lip), visual.ngeoms, float(sum(i.mass for i in model.inertias)))


def yourdfpy(folder: Path, joints: dict[str, float]) -> Found:
    """Yourdfpy."""
    import yourdfpy as library

    robot = library.URDF.load(str(folder / "urdf" / "pouring_robot.urdf"))
    robot.update_cfg(joints)
    mass = sum(link.inertial.mass for link in robot.robot.links if link.inertial)
    return Found(robot.get_transform(LIP, BASE), len(robot.scene.geometry), mass)


def urchin(folder: Path, joints: dict[str, float]) -> Found:
    """Urchin."""
    import urchin as library

    robot = library.URDF.load(str(folder / "urdf" / "pouring_robot.urdf"))
    poses = {link.name: matrix for link, matrix in robot.link_fk(cfg=joints).items()}
    base_link = next(link for link in robot.links if link.name == "world")
    mass = sum(link.inertial.mass for link in robot.links if link.inertial and link is not base_link)
    return Found(seen_from(poses[BASE], poses[LIP]), sum(len(link.visuals) for link in robot.links), mass)


def check_urdf(folder: Path, joints: dict[str, float]) -> Found:
    """check_urdf of urdfdom, as it comes with Pinocchio."""
    program = Path(sys.executable).with_name("check_urdf")
    if not program.is_file():
        raise ImportError("check_urdf is not beside this Python")
    path = folder / "urdf" / "pouring_robot.urdf"
    subprocess.run([program, path], check=True, capture_output=True)
    return Found(None)


def mujoco(folder: Path, joints: dict[str, float], form: str = "mjcf/pouring_robot.xml") -> Found:
    """MuJoCo with our MJCF, or with the URDF."""
    import mujoco as library

    model = library.MjModel.from_xml_path(str(folder / form))
    data = library.MjData(model)
    for name, value in joints.items():
        data.joint(name).qpos[0] = value
    library.mj_kinematics(model, data)
    kept = [model.body(k).name for k in range(model.nbody)]
    if LIP not in kept:  # from a URDF its compiler melts what is fixed into one body
        return Found(None, None, float(model.body_mass.sum()))
    base, lip = (pose(data.body(name).xmat, data.body(name).xpos) for name in (BASE, LIP))
    visuals = int((model.geom_contype == 0).sum())
    return Found(seen_from(base, lip), visuals, float(model.body_mass.sum()))


def drake(folder: Path, joints: dict[str, float], form: str = "drake/pouring_robot.sdf") -> Found:
    """Drake with our SDF, which stands closed at zero, or with the URDF."""
    from pydrake.geometry import Role
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.systems.framework import DiagramBuilder

    plant, scene = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    Parser(plant).AddModels(str(folder / form))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    if form.endswith(".urdf"):
        for name, value in joints.items():
            one = plant.GetJointByName(name)
            (one.set_translation if hasattr(one, "set_translation") else one.set_angle)(context, value)
    base, lip = (plant.GetFrameByName(name).CalcPoseInWorld(context).GetAsMatrix4() for name in (BASE, LIP))
    shapes = scene.model_inspector().NumGeometriesWithRole(Role.kIllustration)
    return Found(seen_from(base, lip), shapes, plant.CalcTotalMass(context))


def pybullet(folder: Path, joints: dict[str, float]) -> Found:
    """PyBullet; its poses of links are those of their centres of mass, and single precision inside its shapes."""
    import pybullet as library

    client = library.connect(library.DIRECT)
    robot = library.loadURDF(str(folder / "urdf" / "pouring_robot.urdf"), useFixedBase=True, physicsClientId=client)
    names = {}
    for k in range(library.getNumJoints(robot)):
        info = library.getJointInfo(robot, k)
        names[info[12].decode()] = k
        if info[1].decode() in joints:
            library.resetJointState(robot, k, joints[info[1].decode()])

    def place(link: str) -> Any:
        state = library.getLinkState(robot, names[link], computeForwardKinematics=True)
        return pose(library.getMatrixFromQuaternion(state[5]), state[4])

    mass = sum(library.getDynamicsInfo(robot, k)[0] for k in names.values())
    found = Found(seen_from(place(BASE), place(LIP)), len(library.getVisualShapeData(robot)), mass)
    library.disconnect(client)
    return found


def roboticstoolbox(folder: Path, joints: dict[str, float]) -> Found:
    """Robotics Toolbox for Python."""
    import roboticstoolbox as library

    robot = library.Robot.URDF(str(folder / "urdf" / "pouring_robot.urdf"))
    q = np.zeros(robot.n)
    for link in robot.links:
        if link.isjoint:
            q[link.jindex] = joints[link._joint_name]
    base, lip = (np.asarray(robot.fkine(q, end=name)) for name in (BASE, LIP))
    return Found(seen_from(base, lip), None, float(sum(link.m for link in robot.links)))


def kinpy(folder: Path, joints: dict[str, float]) -> Found:
    """kinpy, which takes the text."""
    import kinpy as library

    chain = library.build_chain_from_urdf((folder / "urdf" / "pouring_robot.urdf").read_text(encoding="utf-8"))
    placed = chain.forward_kinematics(joints)
    return Found(seen_from(placed[BASE].matrix(), placed[LIP].matrix()))


def ikpy(folder: Path, joints: dict[str, float]) -> Found:
    """ikpy, a chain from the fixed platform to the lip along leg 1."""
    from ikpy.chain import Chain

    path = str(folder / "urdf" / "pouring_robot.urdf")
    tree: Any = ElementTree.parse(path).getroot()
    above = {joint.find("child").get("link"): joint for joint in tree.findall("joint")}
    way = [LIP]
    while way[0] != BASE:
        joint = above[way[0]]
        way = [joint.find("parent").get("link"), joint.get("name"), *way]
    chain = Chain.from_urdf_file(path, base_elements=way)
    return Found(chain.forward_kinematics([joints.get(link.name, 0.0) for link in chain.links]))


def viser(folder: Path, joints: dict[str, float]) -> Found:
    """viser: what its server holds, read back."""
    import viser as library
    from viser.extras import ViserUrdf

    server = library.ViserServer(port=0, verbose=False)
    shown = ViserUrdf(server, folder / "urdf" / "pouring_robot.urdf")
    shown.update_cfg(np.array([joints[name] for name in shown.get_actuated_joint_names()]))
    found = Found(shown._urdf.get_transform(LIP, BASE), len(shown._meshes))
    server.stop()
    return found


def rerun(folder: Path, joints: dict[str, float]) -> Found:
    """Rerun: its URDF tree."""
    import rerun as library

    tree = library.urdf.UrdfTree.from_file_path(folder / "urdf" / "pouring_robot.urdf")
    library.init("pouring_robot", spawn=False)
    library.log_file_from_path(folder / "urdf" / "pouring_robot.urdf")
    placed = {}

    def place(link: str) -> Any:
        if link not in placed:
            joint = next((j for j in tree.joints() if j.child_link == link), None)
            placed[link] = np.eye(4) if joint is None else place(joint.parent_link) @ _moved(joint, joints)
        return placed[link]

    return Found(seen_from(place(BASE), place(LIP)))


def _moved(joint: Any, joints: dict[str, float]) -> Any:
    moved = joint.compute_transform(joints.get(joint.name, 0.0))
    x, y, z, w = moved.quaternion.as_arrow_array().to_pylist()[0]
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return pose(turn, moved.translation.as_arrow_array().to_pylist()[0])


def urdf_loader(folder: Path, joints: dict[str, float]) -> Found:
    """urdf-loader of three.js, in node; NODE_PATH's parent holds its node_modules."""
    place = os.environ.get("URDF_LOADER")
    if not place:
        raise ImportError("name the folder that holds node_modules with urdf-loader, three and jsdom: URDF_LOADER")
    script = Path(__file__).with_name("urdf_loader.mjs")
    ran = subprocess.run(
        ["node", script, place, folder / "urdf" / "pouring_robot.urdf", json.dumps(joints), BASE, LIP],
        check=True,
        capture_output=True,
        text=True,
    )
    answer = json.loads(ran.stdout.strip().splitlines()[-1])
    base, lip = (np.reshape(answer[name], (4, 4)).T for name in (BASE, LIP))
    return Found(seen_from(base, lip), answer["visuals"])


Program = tuple[str, str, Callable[[Path, dict[str, float]], Found]]
PROGRAMS: tuple[Program, ...] = (
    ("Pinocchio", "pin", pinocchio),
    ("Pinocchio RobotWrapper, `--absolute-meshes`", "pin", lambda f, j: pinocchio(f, j, wrapper=True)),
    ("yourdfpy", "yourdfpy", yourdfpy),
    ("urchin", "urchin", urchin),
    ("check_urdf", "cmeel-urdfdom", check_urdf),
    ("MuJoCo, MJCF", "mujoco", mujoco),
    ("MuJoCo, URDF", "mujoco", lambda f, j: mujoco(f, j, "urdf/pouring_robot.urdf")),
    ("Drake, `--format drake`", "drake", drake),
    ("Drake, `--format sdf`", "drake", lambda f, j: drake(f, j, "sdf/pouring_robot.sdf")),
    ("Drake, `--format mjcf`", "drake", lambda f, j: drake(f, j, "mjcf/pouring_robot.xml")),
    ("Drake, URDF", "drake", lambda f, j: drake(f, j, "urdf/pouring_robot.urdf")),
    ("PyBullet", "pybullet", pybullet),
    ("Robotics Toolbox", "roboticstoolbox-python", roboticstoolbox),
    ("kinpy", "kinpy", kinpy),
    ("ikpy", "ikpy", ikpy),
    ("viser", "viser", viser),
    ("rerun", "rerun-sdk", rerun),
    ("three.js urdf-loader", "", urdf_loader),
)
REFUSED = {
    "Drake, `--format sdf`": "form one or more loops in the system graph",
    "Drake, `--format mjcf`": "There is no RigidBody named 'world'",
}
"""Files that a program does not read, and what it says of them; another refusal is a fault."""


def version_of(distribution: str) -> str:
    """Return the version that is installed; of urdf-loader what its package.json says."""
    if distribution:
        return importlib.metadata.version(distribution)
    package = Path(os.environ["URDF_LOADER"], "node_modules", "urdf-loader", "package.json")
    return str(json.loads(package.read_text(encoding="utf-8"))["version"])


def check(folder: Path, names: list[str]) -> list[list[str]]:
    """Return one row a program: name, version, loads, shapes shown, mass, lip."""
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
    rows = []
    for name, distribution, run in PROGRAMS:
        if names and name not in names:
            continue
        try:
            with contextlib.redirect_stdout(sys.stderr):
                found = run(folder, dict(expected["joints"]))
        except ImportError as problem:
            print(f"{name}: not here ({problem})", file=sys.stderr)
            continue
        except RuntimeError as problem:
            if name not in REFUSED or REFUSED[name] not in str(problem):
                raise
            rows.append([name, version_of(distribution), f"no: “… {REFUSED[name]} …”", "–", "–", "–"])
            continue
        shown = "–" if found.visuals is None else f"{found.visuals} of {expected['visuals']}"
        mass = "–" if found.mass_kg is None else f"{found.mass_kg - expected['mass_kg']:+.1e} kg"
        lip = "–" if found.lip_m is None else f"{np.abs(found.lip_m - expected['lip']).max():.0e}"
        rows.append([name, version_of(distribution), "yes", shown, mass, lip])
    return rows


def main(argv: list[str] | None = None) -> None:
    """Write the folder, or check it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("write", "check"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*")
    arguments = parser.parse_args(argv)
    if arguments.what == "write":
        write(arguments.folder)
        return
    head = ["program", "version", "loads", "shapes shown", "mass off", "lip off (m, or entry of the rotation)"]
    for row in (head, ["---"] * len(head), *check(arguments.folder.absolute(), arguments.names)):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
