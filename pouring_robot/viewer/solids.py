"""A scene as a flat list of coloured solids in the world: the one list that every output draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import trimesh

from pouring_robot.viewer.scene import SKY_TOP, Camera, Colour, Scene, SceneArrow, SceneFrame, SceneRobot, Vector
from pouring_robot.viewer.shapes import Shape, cylinder, shape_of, smooth

SHARED = "shared"
"""Group of the bodies that stand in the same place in a solid and in a translucent robot: drawn once."""
_DIRECTION = (0.60, -1.0, 0.50)
"""From the mechanism towards the camera by default: between the rails, the pouring lip to the right."""
_HAZE = 0.45
"""Share of the sky's colour in what stands in the background."""
_SAME_PLACE = 1e-4
"""Two placements closer than this (m, and rad as matrix entries) cannot be told apart in a picture."""


@dataclass(frozen=True)
class Solid:
    """One body of a picture.

    Attributes:
        group: the robot, arrow or frame it belongs to, or :data:`SHARED`.
        name: unique within the group.
        link: the link it hangs on; empty for arrows and frames.
        shape: its triangles in its own frame, m.
        pose_world_to_solid: homogeneous matrix, shape (4, 4), m.
        colour: red, green, blue, 0 to 1.
        opacity: 1 is solid.
        on_top: drawn in front of everything else.
    """

    group: str
    name: str
    link: str
    shape: Shape
    pose_world_to_solid: Vector
    colour: Colour
    opacity: float = 1.0
    on_top: bool = False

    def vertices_in_world(self) -> Vector:
        """Return the vertices in the world frame, shape (v, 3), m."""
        pose = self.pose_world_to_solid
        return self.shape.vertices @ pose[:3, :3].T + pose[:3, 3]

    def normals_in_world(self) -> Vector:
        """Return the vertex normals in the world frame, shape (v, 3), unit."""
        return self.shape.normals @ self.pose_world_to_solid[:3, :3].T


def solids(scene: Scene) -> tuple[Solid, ...]:
    """Return every solid of a scene: robots in their order, then frames, then arrows.

    Raises:
        DescriptionError: a visual of a robot cannot be drawn.
    """
    camera = scene.camera or camera_on(scene)
    bodies = [_hazy(body, scene) for robot in scene.robots for body in _robot_solids(robot)]
    thickness = 0.005 * view_height(camera)
    for frame in scene.frames:
        bodies.extend(_frame_solids(frame, thickness))
    shared = _draw_once(bodies)
    return (*shared, *(body for arrow in scene.arrows for body in _arrow_solids(arrow, thickness)))


def camera_on(scene: Scene, direction: Sequence[float] = _DIRECTION, vertical_view_deg: float = 30.0) -> Camera:
    """Return a camera that shows the robots, without the links in the background, as large as will fit.

    Args:
        scene: what to look at; its own camera plays no part.
        direction: from the mechanism towards the camera, in the world frame; any length.
        vertical_view_deg: angle between the lower and the upper edge of the picture, degrees.

    Raises:
        DescriptionError: a visual of a robot cannot be drawn.
    """
    bodies = [body for robot in scene.robots for body in _robot_solids(robot)]
    chosen = [body for body in bodies if body.link not in scene.background_links] or bodies
    ends = [np.stack([arrow.start_m, arrow.end_m]) for arrow in scene.arrows]
    points = np.concatenate([np.zeros((0, 3)), *ends, *(body.vertices_in_world() for body in chosen)])
    if not len(points):
        return Camera(3.0 * np.asarray(direction), np.zeros(3), vertical_view_deg)
    target = (points.min(axis=0) + points.max(axis=0)) / 2.0
    towards_eye = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    right, up, forward = Camera(target + towards_eye, target).axes()
    half_view = 0.92 * np.tan(np.radians(vertical_view_deg) / 2.0)
    distance = 1.0
    for _ in range(4):  # in perspective the middle of the picture is not the middle of the box
        x, y, depth = np.stack([right, up, forward]) @ (points - target).T
        # A point at lateral offset a and depth b stays inside while a <= (distance + b) half_view.
        lateral = np.maximum(np.abs(y), np.abs(x) / 0.85)
        distance = max(float((lateral / half_view - depth).max()), 1e-3)
        slopes = np.stack([x, y]) / (distance + depth)
        across, along = (slopes.min(axis=1) + slopes.max(axis=1)) / 2.0 * distance
        target = target + across * right + along * up
    return Camera(target + distance * towards_eye, target, vertical_view_deg)


def view_height(camera: Camera) -> float:
    """Return the height of what the camera sees at the distance of its target, m."""
    distance = float(np.linalg.norm(camera.target_m - camera.eye_m))
    return 2.0 * distance * float(np.tan(np.radians(camera.vertical_view_deg) / 2.0))


def _hazy(body: Solid, scene: Scene) -> Solid:
    """Return the body paler when it stands in the background."""
    if body.link not in scene.background_links:
        return body
    red, green, blue = ((1.0 - _HAZE) * own + _HAZE * sky for own, sky in zip(body.colour, SKY_TOP, strict=True))
    return replace(body, colour=(red, green, blue))


def _robot_solids(robot: SceneRobot) -> list[Solid]:
    """Place every visual of a robot by forward kinematics."""
    data, placed = robot.model.createData(), robot.visual.createData()
    pin.forwardKinematics(robot.model, data, np.array(robot.configuration))
    pin.updateGeometryPlacements(robot.model, data, robot.visual, placed)
    return [
        Solid(
            group=robot.name,
            name=item.name,
            link=robot.model.frames[item.parentFrame].name,
            shape=shape_of(item),
            pose_world_to_solid=np.array(pose.homogeneous),
            colour=robot.tint or _urdf_colour(item),
            opacity=robot.opacity,
        )
        for item, pose in zip(robot.visual.geometryObjects, placed.oMg, strict=True)
    ]


def _urdf_colour(item: pin.GeometryObject) -> Colour:
    red, green, blue = (float(value) for value in item.meshColor[:3])
    return red, green, blue


def _draw_once(bodies: list[Solid]) -> list[Solid]:
    """Drop translucent bodies that stand exactly where the solid robot has the same one.

    Two surfaces in one place would flicker in a browser, and the part of the machine that no error moves
    belongs to both robots alike: it goes into a group of its own and stays when either robot is hidden.
    """
    solid = {body.name: number for number, body in enumerate(bodies) if body.opacity == 1.0 and body.link}
    kept: list[Solid | None] = list(bodies)
    for number, body in enumerate(bodies):
        twin = solid.get(body.name) if body.opacity < 1.0 else None
        if twin is not None and _coincide(body, bodies[twin]):
            kept[number] = None
            kept[twin] = replace(bodies[twin], group=SHARED)
    return [body for body in kept if body is not None]


def _coincide(one: Solid, other: Solid) -> bool:
    same_shape = np.array_equal(one.shape.vertices, other.shape.vertices)
    return same_shape and np.allclose(one.pose_world_to_solid, other.pose_world_to_solid, rtol=0.0, atol=_SAME_PLACE)


def _frame_solids(frame: SceneFrame, thickness_m: float) -> list[Solid]:
    """Three rods along the axes of a frame."""
    pose = frame.pose_world_to_frame
    axes = zip("xyz", np.eye(3), ((0.85, 0.15, 0.15), (0.15, 0.62, 0.2), (0.15, 0.3, 0.85)), strict=True)
    return [
        Solid(
            group=frame.name,
            name=axis,
            link="",
            shape=cylinder(0.5 * thickness_m, frame.axis_length_m),
            pose_world_to_solid=_along_z(
                pose.translation, pose.translation + frame.axis_length_m * (pose.rotation @ direction)
            ),
            colour=colour,
        )
        for axis, direction, colour in axes
    ]


def _arrow_solids(arrow: SceneArrow, thickness_m: float) -> list[Solid]:
    """A shaft and a head; an arrow shorter than its head is all head, one of no length is a ball."""
    length = float(np.linalg.norm(arrow.end_m - arrow.start_m))

    def solid(name: str, shape: Shape, pose: Vector) -> Solid:
        return Solid(arrow.name, name, "", shape, pose, arrow.colour, on_top=True)

    if length < 0.5 * thickness_m:
        ball = smooth(trimesh.creation.icosphere(subdivisions=2, radius=1.2 * thickness_m))
        pose = np.eye(4)
        pose[:3, 3] = arrow.end_m
        return [solid("ball", ball, pose)]
    head = min(7.0 * thickness_m, 0.75 * length)
    neck = arrow.end_m - (arrow.end_m - arrow.start_m) * (head / length)
    cone = smooth(trimesh.creation.cone(radius=head / 2.6, height=head, sections=32))
    pose_head = _along_z(neck, arrow.end_m)
    pose_head[:3, 3] = neck  # a cone stands on its frame, a cylinder is centred on it
    shaft = cylinder(min(thickness_m, head / 7.0), length - head)
    return [solid("shaft", shaft, _along_z(arrow.start_m, neck)), solid("head", cone, pose_head)]


def _along_z(start: Vector, end: Vector) -> Vector:
    """Return the pose of a frame halfway between two points, its z axis from the first to the second."""
    z = (end - start) / np.linalg.norm(end - start)
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = (start + end) / 2.0
    return pose
