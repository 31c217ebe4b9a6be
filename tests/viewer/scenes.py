"""A small robot with every kind of visual, and a scene with it; used by the tests of the drawing part."""

import numpy as np
import pinocchio as pin
import trimesh

from pouring_robot.viewer import GHOST_TINT, Scene, SceneArrow, SceneFrame, SceneRobot, visual_model

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
    visual = visual_model(model, URDF, [folder])
    nominal, actual = pin.neutral(model), pin.neutral(model)
    actual[0] = 0.2
    actual[1:4] = (0.01, 0.1, -0.05)
    settings = {
        "title": "Where is <the> cup?",
        "robots": (
            SceneRobot("nominal", model, visual, nominal, opacity=0.35, tint=GHOST_TINT),
            SceneRobot("actual", model, visual, actual, label="closed & checked"),
        ),
        "arrows": (SceneArrow("error", np.array([1.0, 2.0, -0.4]), np.array([1.1, 2.1, -0.4]), label="7.1 mm"),),
        "frames": (SceneFrame("lip", pin.SE3(np.eye(3), np.array([1.0, 2.0, -0.4])), 0.1),),
        "caption": (("gap", "7.1 mm"),),
        "exaggeration": 20.0,
    }
    return Scene(**(settings | changes))
