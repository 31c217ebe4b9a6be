"""One step of a scene as a flat list of coloured solids in the world, for pictures and for placing cameras.

A solid's shape is the triangles of a robot's visual geometry, of any kind in the URDF.
"""

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh

from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.arrays import FloatArray, evenly_spaced, read_only
from pouring_robot.mechanism.rotations import rotation_matrices, rotation_vectors
from pouring_robot.viewer.scene import SKY_TOP, Camera, Colour, Scene, SceneArrows, SceneRobot, at_step

_DIRECTION = (1.0, -0.7, 0.38)
"""Towards the camera: far enough to the front that the mechanism's weak direction, sideways, shows its full length."""
_HAZE = 0.45  # share of the sky's colour in links of the background
_LOOKED_AT = 5  # steps that a camera takes into account
_SAME_PLACE = 1e-4  # two placements closer than this (m, and rad as matrix entries) look the same in a picture
_CREASE_RAD = np.radians(35.0)
"""Neighbouring triangles that meet at more than this angle show an edge instead of a rounding."""
_ROUND_SECTIONS = 40  # sides of the prism that represents a cylinder


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface of triangles in its own frame."""

    vertices: FloatArray  # shape (v, 3), m; doubled along creases so that each copy has one normal
    normals: FloatArray  # shape (v, 3), unit, outward where the triangles are wound counter-clockwise
    faces: npt.NDArray[np.int64]  # shape (f, 3), rows of vertex numbers
    edges: FloatArray  # shape (e, 2, 3), m: both ends of every crease and border


def visual_model(model: pin.Model, urdf_text: str) -> pin.GeometryModel:
    """Return the visual geometry of a URDF text for a model of it.

    Raises:
        DescriptionError: the URDF does not parse, or a mesh is not found.
    """
    try:
        return pin.buildGeomFromUrdfString(model, urdf_text, pin.GeometryType.VISUAL)
    except (ValueError, RuntimeError) as error:
        # The rest is for who wrote the reader.
        if file := re.search(r"(?<=Could not load resource ).+|package://\S+\b", str(error)):
            why = "this mesh is missing or broken; put it there, or take it out of the URDF"
            raise DescriptionError(file[0], why) from error
        raise DescriptionError("robot description", f"its visual geometry cannot be read: {error}") from error


def shape_of(item: pin.GeometryObject) -> Shape:
    """Return the triangles of one visual in its own frame, scale included.

    Raises:
        DescriptionError: the visual is of a kind that no URDF can hold (a plane, an octree, ...).
    """
    geometry = item.geometry
    match geometry:
        case coal.Box():
            return _made(trimesh.creation.box, tuple((2.0 * geometry.halfSide).tolist()))
        case coal.Cylinder():
            return _made(trimesh.creation.cylinder, geometry.radius, 2.0 * geometry.halfLength, _ROUND_SECTIONS)
        case coal.Capsule():
            return _made(trimesh.creation.capsule, 2.0 * geometry.halfLength, geometry.radius)
        case coal.Sphere():
            return _made(trimesh.creation.icosphere, 3, geometry.radius)
        case coal.BVHModelBase():
            # Its scale is already in the vertices; faces that it mirrors are rewound, or they would be inside out.
            triangles = map(geometry.tri_indices, range(geometry.num_tris))
            faces = np.array([[one[0], one[1], one[2]] for one in triangles], dtype=np.int64)
            places = np.array(geometry.vertices(), dtype=np.float64)
            if len(np.unique(faces)) < len(places):
                # Of a node with several meshes Pinocchio's reader takes all triangles for those of the first one.
                file = Path(item.meshPath)
                whole = read_mesh(file.name, file.read_bytes())
                faces, places = np.asarray(whole.faces, dtype=np.int64), item.meshScale * whole.vertices
            wound = faces[:, ::-1] if np.prod(item.meshScale) < 0.0 else faces
            return _meshed(places.tobytes(), wound.tobytes())
    raise DescriptionError(
        "robot description", f"visual '{item.name}' is a {type(geometry).__name__}, which cannot be drawn"
    )


@lru_cache(maxsize=128)  # by content: both robots of a scene load the same files
def read_mesh(name: str, content: bytes) -> Any:
    """Return the trimesh of a mesh file, in the units of the file; raises DescriptionError where that is none."""
    try:
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type=Path(name).suffix[1:])
    except Exception as problem:  # each format has a reader of its own, which may fail in any way
        why = " ".join(str(problem).split())
        raise DescriptionError("URDF", f"the mesh {name} cannot be read: {why}") from problem
    if mesh.is_empty:
        raise DescriptionError("URDF", f"the mesh {name} has no faces; is the file complete?")
    return mesh


@lru_cache(maxsize=256)
def _made(make: Callable[..., Any], *sizes: float | tuple[float, ...]) -> Shape:
    """Return the shape of a solid that trimesh makes, centred on the origin: some releases shift capsules."""
    body = make(*sizes)
    body.apply_translation(-body.bounds.mean(axis=0))
    return smooth(body)


@lru_cache(maxsize=128)  # by content: both robots of a scene load the same files
def _meshed(vertices: bytes, faces: bytes) -> Shape:
    places, triangles = np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, dtype=np.int64).reshape(-1, 3)
    return smooth(trimesh.Trimesh(places.copy(), triangles.copy(), process=True))


def smooth(body: trimesh.Trimesh) -> Shape:
    """Return the shape of a mesh: rounded where it is round, sharp along its creases."""
    creases = body.face_adjacency_angles > _CREASE_RAD
    borders = body.edges_unique[np.bincount(body.edges_unique_inverse, minlength=len(body.edges_unique)) == 1]
    lines = np.concatenate([body.face_adjacency_edges[creases].reshape(-1, 2), borders.reshape(-1, 2)])
    split = trimesh.graph.smooth_shade(body, angle=_CREASE_RAD)
    floats = (split.vertices, split.vertex_normals, body.vertices[lines].reshape(-1, 2, 3))
    vertices, normals, edges = (read_only(np.array(array, dtype=np.float64)) for array in floats)
    return Shape(vertices, normals, read_only(np.array(split.faces, dtype=np.int64)), edges)


@dataclass(frozen=True)
class Solid:
    """One body of a picture."""

    group: str  # the robot or the arrows it belongs to
    name: str  # unique within the group
    link: str  # the link that carries it; empty for arrows
    shape: Shape  # its triangles in its own frame, m
    pose_world_to_solid: FloatArray  # homogeneous matrix, shape (4, 4), m
    colour: Colour  # red, green, blue, 0 to 1
    opacity: float = 1.0  # 1 is solid
    on_top: bool = False  # drawn in front of everything else

    def vertices_in_world(self) -> FloatArray:
        """Return the vertices in the world frame, shape (v, 3), m."""
        pose = self.pose_world_to_solid
        return self.shape.vertices @ pose[:3, :3].T + pose[:3, 3]


def enlarged(bodies: FloatArray, reference: FloatArray, factor: float) -> FloatArray:
    """Return poses moved to ``factor`` times their distance from a reference, shape (..., 4, 4).

    Shift and rotation vector are each multiplied, body by body, in the axes of the world.
    """
    moved, axes = reference.copy(), reference[..., :3, :3]
    moved[..., :3, :3] = rotation_matrices(factor * rotation_vectors(bodies[..., :3, :3], since=axes)) @ axes
    moved[..., :3, 3] += factor * (bodies - reference)[..., :3, 3]
    return moved


def solids(scene: Scene, step: int | None = None) -> tuple[Solid, ...]:
    """Return every solid of a step (default: the first shown): robots, then arrows; of several states the first."""
    step = scene.first if step is None else step
    thickness = 0.005 * view_height(scene.camera or camera_on(scene))
    choices = [robot.name for robot in scene.robots if robot.choice]
    robots = [robot for robot in scene.robots if robot.name not in choices[1:]]
    bodies = [body for robot in robots for body in robot_solids(scene, robot, step)]
    arrows = [item for item in scene.arrows if item.shown_with in ("", *choices[:1])]
    return (*_draw_once(bodies), *(s for item in arrows for s in _arrow_solids(scene, item, step, thickness)))


def camera_on(scene: Scene) -> Camera:
    """Return a camera that shows the robots, without the links in the background, as large as will fit.

    The scene's own camera is not used.
    """
    return camera_around(outline(scene))


def outline(scene: Scene) -> FloatArray:
    """Return the points of a scene that a camera is to show, from several steps, in the world, shape (k, 3), m."""
    steps = sorted({*evenly_spaced(len(scene.steps), _LOOKED_AT).tolist(), scene.first})
    bodies = [body for step in steps for robot in scene.robots for body in robot_solids(scene, robot, step)]
    chosen = [body for body in bodies if body.link not in scene.background_links] or bodies
    ends = [end for item in scene.arrows for step in steps for end in arrow_ends(scene, item, step)]
    return np.concatenate([np.zeros((0, 3)), *ends, *(body.vertices_in_world() for body in chosen)])


def camera_around(points: FloatArray, direction: Sequence[float] = _DIRECTION) -> Camera:
    """Return a camera in a direction (any length) of the world that shows points (k, 3) as large as will fit."""
    if not len(points):
        return Camera(3.0 * np.asarray(direction), np.zeros(3))
    target = (points.min(axis=0) + points.max(axis=0)) / 2.0
    towards_eye = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    right, up, forward = Camera(target + towards_eye, target).axes()
    half_view = 0.92 * np.tan(np.radians(Camera.vertical_view_deg) / 2.0)
    distance = 1.0
    for _ in range(4):  # in perspective the middle of the picture is not the middle of the box
        x, y, depth = np.stack([right, up, forward]) @ (points - target).T
        # A point at lateral offset a and depth b stays inside while a <= (distance + b) half_view.
        lateral = np.maximum(np.abs(y), np.abs(x) / 0.85)
        distance = max(float((lateral / half_view - depth).max()), 1e-3)
        slopes = np.stack([x, y]) / (distance + depth)
        across, along = (slopes.min(axis=1) + slopes.max(axis=1)) / 2.0 * distance
        target = target + across * right + along * up
    return Camera(target + distance * towards_eye, target)


def view_height(camera: Camera) -> float:
    """Return the height of the camera's view at the distance of its target, m."""
    distance = float(np.linalg.norm(camera.target_m - camera.eye_m))
    return 2.0 * distance * float(np.tan(np.radians(camera.vertical_view_deg) / 2.0))


def robot_solids(scene: Scene, robot: SceneRobot, step: int) -> list[Solid]:
    """Return every visual of a robot at a step, enlarged as the scene states; paler in the background."""
    places = at_step(robot.bodies, step)
    if robot.reference is not None:
        places = enlarged(places, at_step(robot.reference, step), scene.exaggeration)
    return [
        Solid(
            group=robot.name,
            name=item.name,
            link=link,
            shape=shape_of(item),
            pose_world_to_solid=places[item.parentJoint] @ item.placement.homogeneous,
            colour=(red, green, blue),
            opacity=robot.opacity,
        )
        for item, link, (red, green, blue) in zip(
            robot.visual.geometryObjects, robot.links, colours_at(scene, robot, step).tolist(), strict=True
        )
    ]


def colours_at(scene: Scene, robot: SceneRobot, step: int) -> FloatArray:
    """Return the colours of a robot's visuals at a step, shape (visuals, 3), 0 to 1."""
    own = np.array([robot.tint or item.meshColor[:3] for item in robot.visual.geometryObjects]).reshape(-1, 3)
    colours = own if robot.colours is None else at_step(robot.colours, step).copy()
    hazy = np.isin(robot.links, scene.background_links)
    colours[hazy] = (1.0 - _HAZE) * colours[hazy] + _HAZE * np.array(SKY_TOP)
    return colours


def _draw_once(bodies: list[Solid]) -> list[Solid]:
    """Drop translucent bodies that coincide with the same body of a solid robot, so that no gap looks like no gap."""
    solid = {body.name: body for body in bodies if body.opacity == 1.0}
    return [b for b in bodies if b.opacity == 1.0 or b.name not in solid or not _coincide(b, solid[b.name])]


def _coincide(one: Solid, other: Solid) -> bool:
    same_shape = np.array_equal(one.shape.vertices, other.shape.vertices)
    return same_shape and np.allclose(one.pose_world_to_solid, other.pose_world_to_solid, rtol=0.0, atol=_SAME_PLACE)


def arrow_ends(scene: Scene, item: SceneArrows, step: int) -> tuple[FloatArray, FloatArray]:
    """Return tails and tips of arrows as they are drawn, shape (arrows, 3) each, m."""
    tails = at_step(item.starts_m, step)
    return tails, tails + scene.exaggeration * at_step(item.vectors_m, step)


def _arrow_solids(scene: Scene, item: SceneArrows, step: int, thickness_m: float) -> list[Solid]:
    """A shaft and a head each; an arrow shorter than its head is all head, one of no length is a ball."""
    tails, tips = arrow_ends(scene, item, step)
    slim = thickness_m if len(tails) == 1 else 0.4 * thickness_m
    return [
        Solid(item.name, f"{part} {number}", "", shape, pose, item.colour, on_top=True)
        for number, (start, end) in enumerate(zip(tails, tips, strict=True))
        for part, shape, pose in _arrow_parts(start, end, slim)
    ]


def _arrow_parts(start: FloatArray, end: FloatArray, thickness_m: float) -> list[tuple[str, Shape, FloatArray]]:
    way = end - start
    length = float(np.linalg.norm(way))
    if length < 0.5 * thickness_m:
        ball = smooth(trimesh.creation.icosphere(subdivisions=2, radius=1.2 * thickness_m))
        return [("ball", ball, pin.SE3(np.eye(3), end).homogeneous)]
    head = min(7.0 * thickness_m, 0.75 * length)
    neck = end - way * (head / length)
    cone = smooth(trimesh.creation.cone(radius=head / 2.6, height=head, sections=32))
    shaft = _made(trimesh.creation.cylinder, min(thickness_m, head / 7.0), length - head, _ROUND_SECTIONS)
    along = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way).matrix()
    # A cylinder is centred on its frame, a cone has its base on it.
    places = {"shaft": (shaft, (start + neck) / 2.0), "head": (cone, neck)}
    return [(part, shape, pin.SE3(along, place).homogeneous) for part, (shape, place) in places.items()]
