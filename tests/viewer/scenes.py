"""A small robot with every kind of visual, and a scene with it; used by the tests of drawing."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import trimesh

from pouring_robot.mechanism.poses import bodies_at
from pouring_robot.viewer import GHOST_TINT, Curve, Scene, SceneArrows, SceneRobot, Step, visual_model

URDF = """<robot name="small">
  <link name="world"/>
  <link name="trolley"><visual><origin xyz="0 0 0.4"/>
    <geometry><box size="3 0.2 0.2"/></geometry></visual></link>
  <link name="arm">
    <visual><origin xyz="0 0 -0.25"/><geometry><cylinder radius="0.05" length="0.5"/></geometry>
      <material name="steel"><color rgba="0.5 0.6 0.7 1"/></material></visual>
    <visual><geometry><sphere radius="0.1"/></geometry></visual>
  </link>
  <link name="cup"><visual><origin rpy="0.3 0 0"/><geometry>
    <mesh filename="package://small/cup.stl" scale="0.001 0.001 0.001"/></geometry></visual></link>
  <joint name="fixed" type="fixed"><parent link="world"/><child link="trolley"/></joint>
  <joint name="turn" type="revolute"><parent link="trolley"/><child link="arm"/><origin xyz="1 2 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="free" type="floating"><parent link="arm"/><child link="cup"/><origin xyz="0 0 -0.6"/></joint>
</robot>"""


def small_scene(folder, **changes):
    """Return a robot at rest, translucent, and the same turned and moved; writes its mesh to the folder."""
    mesh_folder = folder / "small"
    mesh_folder.mkdir(exist_ok=True)
    trimesh.creation.box((300.0, 200.0, 100.0)).export(mesh_folder / "cup.stl")
    model = pin.buildModelFromXML(URDF)
    visual = visual_model(model, URDF.replace("package:/", str(folder)))
    nominal, actual = pin.neutral(model), pin.neutral(model)
    actual[0] = 0.2
    actual[1:4] = (0.01, 0.1, -0.05)
    places, reference = bodies_at(model, [actual]), bodies_at(model, [nominal])
    tail, vector = np.array([1.0, 2.0, -0.4]), np.array([0.005, 0.005, 0.0])
    settings = {
        "title": "Where is <the> cup?",
        "robots": (
            SceneRobot("actual", visual, places, label="closed & checked"),
            SceneRobot("nominal", visual, reference, opacity=0.35, tint=GHOST_TINT),
        ),
        "arrows": (SceneArrows("error", tail[None, None], vector[None, None], label="of the cup"),),
        "steps": (Step("", (("gap", "7.1 mm"),)),),
        "exaggeration": 20.0,
    }
    return Scene(**(settings | changes))


def film(folder, count=4, **changes):
    """Return the small robot moving its cup over some steps, its actual self off by a little more at each."""
    still = small_scene(folder)
    actual, nominal = still.robots
    reference = np.repeat(nominal.bodies, count, axis=0)
    reference[:, 2, 0, 3] += 0.1 * np.arange(count)
    places = reference.copy()
    places[:, 2, :3, 3] += 1e-3 * np.arange(count)[:, None] * np.array([0.0, 1.0, 1.0])
    places[:, 2, :3, :3] = places[:, 2, :3, :3] @ pin.utils.rotate("x", 2e-3)
    vectors = (places - reference)[:, 2, None, :3, 3]
    settings = {
        "robots": (replace(actual, bodies=places, reference=reference), replace(nominal, bodies=reference)),
        "arrows": (SceneArrows("error", reference[:, 2, None, :3, 3], vectors),),
        "steps": tuple(Step(f"step {k}", (("number", str(k)),)) for k in range(count)),
        "at": np.arange(count) ** 2.0,
        "axis": "time, s",
        "curves": (Curve("error", "mm", 1e3 * np.linalg.norm(vectors[:, 0], axis=1)),),
    }
    return replace(still, **(settings | changes))
