"""The robot coloured by how far each of its parts moves: the paper's Fig. 8 as a page or a picture."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
from matplotlib import colormaps

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.robot import PouringRobot
from pouring_robot.robot.scene import VIEW_DIRECTION, drawn_robot
from pouring_robot.thermal.expansion.displacement import DisplacementField
from pouring_robot.viewer import Scene, camera_on

_SCALE = "turbo"


def displacement_scene(robot: PouringRobot, field: DisplacementField, title: str, configuration: FloatArray) -> Scene:
    """Return the drawing, every visual in the colour of its part's point nearest to its middle.

    What belongs to no part of the field, such as a truss that stands still, keeps its own colour.

    Args:
        robot: the drawing.
        field: of the pose.
        title: of the page.
        configuration: of the pose, shape (nq,).
    """
    mechanism = robot.nominal_solver.mechanism
    drawn = drawn_robot(mechanism, configuration, "robot", "coloured by displacement")
    model, visual = drawn.model, drawn.visual
    data, places = model.createData(), pin.GeometryData(visual)
    pin.updateGeometryPlacements(model, data, visual, places, configuration)
    pin.updateFramePlacements(model, data)
    base = data.oMf[mechanism.frame_id(mechanism.loops.base_frame)]
    largest = max(field.largest_m, 1e-12)
    parts = np.array(field.parts)
    for item, place in zip(visual.geometryObjects, places.oMg, strict=True):
        own = np.flatnonzero(parts == _part(model.frames[item.parentFrame].name))
        if not own.size:
            continue
        middle = base.actInv(place).act(np.array(_middle(item)))
        nearest = own[int(np.linalg.norm(field.points_m[own] - middle, axis=1).argmin())]
        item.meshColor = np.array([*colormaps[_SCALE](field.distance_m[nearest] / largest)[:3], 1.0])
    rows = [
        (part.replace("_", " "), f"mean {mean / MM:.2f}, most {most / MM:.2f} mm")
        for part, (mean, most) in field.by_part.items()
    ]
    rows.append(("colours", f"blue 0 to red {largest / MM:.2f} mm"))
    scene = Scene(title=title, robots=(drawn,), caption=tuple(rows))
    return dataclasses.replace(scene, camera=camera_on(scene, VIEW_DIRECTION))


def _part(link: str) -> str:
    """Return which part of the field a link belongs to."""
    leg = link.partition("_")[0]
    if leg in LEGS:
        return leg
    return {"moving_platform": "platform", "trolley": "truss", "truss_bridge": "truss"}.get(
        link, link.split("_lip", maxsplit=1)[0]
    )


def _middle(item: pin.GeometryObject) -> FloatArray:
    """Return the middle of a visual in its own frame, shape (3,), in m."""
    item.geometry.computeLocalAABB()
    middle: FloatArray = np.asarray(item.geometry.aabb_center) * np.asarray(item.meshScale)
    return middle
