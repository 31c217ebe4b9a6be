"""The closed pose by engines independent of ours: MuJoCo with our MJCF, Drake with our SDF.

MuJoCo is started with every joint displaced, and comes to rest by its own dynamics. Drake's joints form a tree: the
forces of bushings and bodies, as summed by Drake, are balanced by Newton's method, with drives held. ``write`` needs
the package, ``check`` one of the engines and SciPy, in any environment:

    python scripts/studies/closure_elsewhere.py write FOLDER
    OTHER_PYTHON scripts/studies/closure_elsewhere.py check FOLDER

Cases, each with fifty poses spread over the workspace: the drawing; joint centres off by 0.5 mm; axes tilted by 1 mrad
under gravity and 500 kg in the ladle, with the loop stiffness of ``loops.yaml``. MuJoCo's servos are as compliant as
its file says, and our closure gets drives of the same compliance; Drake's drives are rigid, and so are ours then.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
from pathlib import Path
from typing import Any

import numpy as np

POSES, SEED, PAYLOAD_KG = 50, 2015, 500.0
BASE, LIP, PAYLOAD_FRAME = "fixed_platform", "ladle_lip", "ladle"
# How far off everything starts: m and rad, joint by joint.
START = 2e-3


def write(folder: Path) -> None:
    """Export the three robots and say where they stand by our closure at fifty poses."""
    from pouring_robot.io.files import write_together
    from pouring_robot.mechanism.closure.energy import Loads
    from pouring_robot.mechanism.closure.solver import ClosureSolver
    from pouring_robot.robot.export.bodies_and_joints import Assembly
    from pouring_robot.robot.export.folder import exported_files
    from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
    from pouring_robot.robot.pouring.layout import load_layout

    loaded = {"gravity": True, "payload_kg": PAYLOAD_KG, "payload_frame": PAYLOAD_FRAME}
    cases: dict[str, tuple[RobotModel, dict[str, Any]]] = {
        "drawing": (RobotModel(), {}),
        "centres": (_crooked(0.0), {}),
        "loaded": (_crooked(1.0), loaded),
    }
    for name, (model, loads) in cases.items():
        closed = ClosedRobot.of(model)
        for form in ("mjcf", "drake"):
            write_together(exported_files(closed, folder / name / form, form))
        stiffness = {joint.name: joint.servo_stiffness for joint in Assembly.of(closed).servos}
        yielding = {drive: stiffness[drive] for drive in closed.mechanism.loops.drives}
        drawing = FourUPUKinematics(model.definition.mechanism())
        solvers = {
            "mujoco": ClosureSolver(closed.mechanism, Loads(**loads, drive_stiffness=yielding)),
            "drake": ClosureSolver(closed.mechanism, Loads(**loads)),
        }
        rows = []
        commands = drawing.commands(_spread(load_layout().box))
        for values in commands.drives.tolist():
            drives = dict(zip(closed.mechanism.loops.drives, values, strict=True))
            location = closed.robot.location_at(values)
            nominal, cold = location.nominal, location.actual
            row: dict[str, Any] = {"drives": drives, "joints": cold.joint_values}
            row["platform"] = cold.pose("universe", "moving_platform").homogeneous.tolist()
            row["nominal"] = nominal.pose(BASE, LIP).translation.tolist()
            for engine, solver in solvers.items():
                found = solver.solve(drives, cold.configuration)
                row[engine] = found.pose(BASE, LIP).translation.tolist()
            rows.append(row)
        zero = {"joints": closed.joints, "poses": rows, "loaded": bool(loads)}
        (folder / name / "poses.json").write_text(json.dumps(zero) + "\n", encoding="utf-8")


def _crooked(axis_mrad: float) -> Any:
    """Return a robot with joint centres off by 0.5 mm and axes tilted, normal deviates."""
    from pouring_robot.robot.model import JointPlacement, RobotModel

    random, placements = np.random.default_rng(SEED), {}
    for leg in range(1, 5):
        for joint, centre_mm in (("s1", 0.5), ("s2", 0.0), ("s4", 0.0), ("seat_mount", 0.5)):
            shift, turn = (tuple((random.normal(size=3) * by).tolist()) for by in (centre_mm, axis_mrad))
            placements[f"leg{leg}_{joint}"] = JointPlacement(translation_mm=shift, rotation_mrad=turn)
    return RobotModel(joint_placements=placements)


def _spread(box: Any) -> Any:
    """Return poses anywhere in the workspace, (POSES, 4)."""
    lower, upper = box
    return np.random.default_rng(SEED).uniform(lower, upper, (POSES, 4))


def _quaternion(rotation: Any) -> Any:
    """Return a rotation (3, 3) as w, x, y, z."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])


def in_mujoco(folder: Path, case: dict[str, Any], random: np.random.Generator) -> Any:
    """Return where the lip comes to rest in the base, (poses, 3), m."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(folder / "mjcf" / "pouring_robot.xml"))
    if case["loaded"]:
        melt = spec.body(PAYLOAD_FRAME).add_body(name="melt")
        melt.mass, melt.inertia, melt.explicitinertial = PAYLOAD_KG, [1e-3] * 3, True
    else:
        spec.option.gravity = np.zeros(3)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    model = spec.compile()
    data, found = mujoco.MjData(model), []
    free = model.joint("moving_platform_free").qposadr[0]
    for row in case["poses"]:
        mujoco.mj_resetData(model, data)
        for name, value in row["joints"].items():
            data.joint(name).qpos[0] = value + random.uniform(-START, START)
        platform = np.array(row["platform"])
        data.qpos[free : free + 3] = platform[:3, 3] + random.uniform(-START, START, 3)
        data.qpos[free + 3 : free + 7] = _quaternion(platform[:3, :3])
        for k in range(model.nu):
            data.ctrl[k] = row["drives"].get(model.actuator(k).name, 0.0)
        for _ in range(60):
            mujoco.mj_step(model, data, 500)
            if np.abs(data.qvel).max() < 1e-10:
                break
        base, lip = data.body(BASE), data.body(LIP)
        found.append(base.xmat.reshape(3, 3).T @ (lip.xpos - base.xpos))
    return np.array(found)


class _Drake:
    """Drake's plant with the drives of one pose, and what its forces do at unknown passive joints and platform."""

    def __init__(self, folder: Path, case: dict[str, Any]) -> None:
        """Load the SDF, with the payload where there is one."""
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import SpatialInertia

        plant = MultibodyPlant(0.0)
        (robot,) = Parser(plant).AddModels(str(folder / "drake" / "pouring_robot.sdf"))
        if case["loaded"]:
            melt = plant.AddRigidBody("melt", robot, SpatialInertia.SolidSphereWithMass(PAYLOAD_KG, 1e-3))
            plant.WeldFrames(plant.GetFrameByName(PAYLOAD_FRAME), melt.body_frame())
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -9.80665 if case["loaded"] else 0.0])
        plant.Finalize()
        self.plant, self.context, self.zero = plant, plant.CreateDefaultContext(), case["joints"]
        self.platform = plant.GetBodyByName("moving_platform")
        self.joints = {name: plant.GetJointByName(name) for name in self.zero}
        self.passive: list[str] = []
        self.row: dict[str, Any] = {}

    def at(self, row: dict[str, Any]) -> Any:
        """Take a pose, and return the unknowns there: passive joints, shift and turn of the platform."""
        held = (*row["drives"], "truss_travel", "trolley_travel")
        self.row, self.passive = row, [name for name in self.joints if name not in held]
        first = self.platform.floating_velocities_start_in_v()
        own = [self.joints[name].velocity_start() for name in self.passive]
        self.columns = [*own, *range(first, first + 6)]
        return np.array([row["joints"][name] for name in self.passive] + [0.0] * 6)

    def put(self, unknown: Any) -> None:
        """Stand it there."""
        from pydrake.math import RigidTransform, RotationMatrix
        from scipy.spatial.transform import Rotation

        values = self.row["drives"] | dict(zip(self.passive, unknown[:-6], strict=True))
        for name, value in values.items():
            joint, where = self.joints[name], value - self.zero[name]
            (joint.set_translation if hasattr(joint, "set_translation") else joint.set_angle)(self.context, where)
        platform = np.array(self.row["platform"])
        turned = Rotation.from_rotvec(unknown[-3:]).as_matrix() @ platform[:3, :3]
        place = RigidTransform(RotationMatrix.ProjectToRotationMatrix(turned), platform[:3, 3] + unknown[-6:-3])
        self.plant.SetFreeBodyPose(self.context, self.platform, place)

    def unbalanced(self, unknown: Any) -> Any:
        """Return the forces and torques that nothing holds."""
        from pydrake.multibody.tree import MultibodyForces

        self.put(unknown)
        forces = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, forces)
        still = np.zeros(self.plant.num_velocities())
        return self.plant.CalcInverseDynamics(self.context, still, forces)[self.columns]


def in_drake(folder: Path, case: dict[str, Any], random: np.random.Generator) -> Any:
    """Return where Drake's forces balance: the lip in the base, (poses, 3), m."""
    drake, found = _Drake(folder, case), []
    for row in case["poses"]:
        start = drake.at(row)
        drake.put(_balanced(drake.unbalanced, start + random.uniform(-START, START, len(start)) / 4.0))
        base, lip = (drake.plant.GetFrameByName(name).CalcPoseInWorld(drake.context) for name in (BASE, LIP))
        found.append((base.inverse() @ lip).translation())
    return np.array(found)


def _balanced(function: Any, unknown: Any) -> Any:
    """Return where a function of forces vanishes: Newton with central differences, steps halved where it must."""
    for _ in range(40):
        value = function(unknown)
        step = 1e-6
        columns = []
        for k in range(len(unknown)):
            away = np.zeros(len(unknown))
            away[k] = step
            columns.append((function(unknown + away) - function(unknown - away)) / (2.0 * step))
        move = np.linalg.solve(np.transpose(columns), -value)
        unknown = unknown + move * min(1.0, 0.05 / np.abs(move).max())
        if np.abs(move).max() < 1e-11:
            return unknown
    raise RuntimeError(f"the forces do not balance: the last step was {np.abs(move).max():.1e}")


def check(folder: Path) -> list[list[str]]:
    """Return one row a case and engine that is installed: what it was moved by, and how far the engines are apart."""
    rows = []
    for engine, distribution, run in (("mujoco", "mujoco", in_mujoco), ("drake", "drake", in_drake)):
        try:
            version = importlib.metadata.version(distribution)
        except importlib.metadata.PackageNotFoundError:
            continue
        for case in ("drawing", "centres", "loaded"):
            content = json.loads((folder / case / "poses.json").read_text(encoding="utf-8"))
            found = run(folder / case, content, np.random.default_rng(SEED))
            ours, nominal = (np.array([row[key] for row in content["poses"]]) for key in (engine, "nominal"))
            apart, moved = np.linalg.norm(found - ours, axis=1), np.linalg.norm(ours - nominal, axis=1)
            share = f"{(apart / moved).max():.2%}" if moved.max() > 1e-9 else "–"
            mean = f"{moved.mean() * 1e3:.2f} mm"
            rows.append([f"{engine} {version}", case, str(len(found)), mean, f"{apart.max():.1e} m", share])
    return rows


def main(argv: list[str] | None = None) -> None:
    """Write the folder, or check it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("write", "check"))
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args(argv)
    if arguments.what == "write":
        write(arguments.folder)
        return
    head = ["engine", "case", "poses", "lip moved on average by", "engines apart at most", "of what it moved"]
    for row in (head, ["---"] * len(head), *check(arguments.folder)):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
