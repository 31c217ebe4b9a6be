"""What is drawn of a robot: the visuals of its URDF; without these, or their meshes, lines between its joints."""

import coal
import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.robot.description.untrusted import FOLDERS_VARIABLE
from pouring_robot.robot.description.urdf import with_mesh_files
from pouring_robot.viewer import visual_model

_THICKNESS = 0.03  # of a line, over the longest one
_SAME_PLACE = 1e-6  # m
_COLOUR = np.array([0.55, 0.6, 0.65, 1.0])


def visuals(mechanism: ClosedChainMechanism) -> tuple[pin.GeometryModel, str, str]:
    """Return what is drawn of a mechanism, why these are lines between its joints, and how to mend that.

    The latter two are "" where its visuals are drawn.
    """
    why, mend = "its URDF has no visuals", "give its links a 'visual'"
    try:
        visual = visual_model(mechanism.shared_model, with_mesh_files(mechanism.tree_urdf))
    except DescriptionError as problem:
        why, mend = f"{problem.path.name} is missing or broken", problem.problem
        if "package:" in problem.path.parts:
            mend = f"name the folder that holds its package in {FOLDERS_VARIABLE}"
    else:
        if visual.ngeoms:
            return visual, "", ""
    return skeleton(mechanism.shared_model), why, mend


def skeleton(model: pin.Model) -> pin.GeometryModel:
    """Return a ball at every moving joint, and lines from it to the joints and frames that it carries.

    Joints at one place have one ball. Lines are fixed to their joint, so the travel of a slide has none.
    """
    origins = [(model.parents[joint], model.jointPlacements[joint].translation) for joint in range(1, model.njoints)]
    carried = [*origins, *((frame.parentJoint, frame.placement.translation) for frame in model.frames)]
    lines = {(joint, *np.round(end, 6)): end for joint, end in carried if np.linalg.norm(end) > _SAME_PLACE}
    radius = 0.5 * _THICKNESS * max(map(np.linalg.norm, lines.values()), default=1.0)
    found = pin.GeometryModel()

    def add(joint: int, placement: pin.SE3, shape: coal.ShapeBase) -> None:
        item = pin.GeometryObject(f"{model.names[joint]}_{found.ngeoms}", joint, placement, shape)
        item.meshColor = _COLOUR
        found.addGeometryObject(item)

    for joint, (parent, origin) in enumerate(origins, start=1):
        if not parent or np.linalg.norm(origin) > _SAME_PLACE:
            add(joint, pin.SE3.Identity(), coal.Sphere(2.0 * radius))
    for (joint, *_), end in lines.items():
        along = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end).matrix(), 0.5 * end)
        add(joint, along, coal.Capsule(radius, float(np.linalg.norm(end))))
    return found
