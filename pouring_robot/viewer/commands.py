"""A scene as meshcat drawing commands, packed and ready to send or to store; no server takes part.

The commands are written in meshcat's wire format directly. Its Python classes would put a time and the
network address of the machine into every object's id, and drop the normals; these ids are running numbers, so
the same scene always gives the same bytes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import umsgpack
from meshcat.geometry import pack_numpy_array

from pouring_robot.viewer.scene import SKY_BOTTOM, SKY_TOP, Camera, Scene, Vector
from pouring_robot.viewer.solids import Solid, camera_on, solids

ROOT = "scene"
"""Folder of the scene tree that holds everything this package draws."""

Command = dict[str, Any]


def drawing_commands(scene: Scene) -> tuple[bytes, ...]:
    """Return the meshcat commands that draw a scene, each packed with msgpack.

    Raises:
        DescriptionError: a visual of a robot cannot be drawn.
    """
    commands = _surroundings(scene.camera or camera_on(scene))
    for number, body in enumerate(solids(scene)):
        commands.extend(_solid_commands(body, f"solid-{number}"))
    return tuple(umsgpack.packb(command) for command in commands)


def clear_command() -> bytes:
    """Return the command that takes everything this package drew off a page."""
    packed: bytes = umsgpack.packb({"type": "delete", "path": f"/{ROOT}"})
    return packed


def _solid_commands(body: Solid, identity: str) -> list[Command]:
    """Return surface, edges and placement of one solid."""
    path = f"/{ROOT}/{body.group}/{body.name}"
    shape, see_through = body.shape, body.opacity < 1.0
    surface = _object(
        identity,
        "Mesh",
        {"position": shape.vertices, "normal": shape.normals},
        {
            "type": "MeshPhongMaterial",
            "color": _packed(body.colour),
            "specular": 0x222222,
            "shininess": 25,
            "opacity": body.opacity,
            "transparent": see_through or body.on_top,
            "side": 0,  # outsides only: a translucent body would show its own back wall
            "depthWrite": not see_through,
            "depthTest": not body.on_top,
        },
        index=shape.faces,
    )
    commands = [
        _command("set_object", f"{path}/surface", object=surface),
        _command("set_transform", path, matrix=_matrix(body.pose_world_to_solid)),
    ]
    if body.on_top:
        # three.js paints groups by number: what is on top comes last and looks at no depth.
        commands.append(_command("set_property", path, property="renderOrder", value=10))
    elif len(shape.edges):
        lines = _object(
            f"{identity}-edges",
            "LineSegments",
            {"position": shape.edges.reshape(-1, 3)},
            {
                "type": "LineBasicMaterial",
                "color": _packed(tuple(0.45 * value for value in body.colour)),
                "opacity": 0.45 if see_through else 0.55,
                "transparent": True,
            },
        )
        commands.append(_command("set_object", f"{path}/edges", object=lines))
    return commands


def _object(
    identity: str,
    kind: str,
    attributes: dict[str, Vector],
    material: dict[str, Any],
    index: np.ndarray[Any, Any] | None = None,
) -> dict[str, Any]:
    """Return three.js's JSON form of one object; every attribute has shape (n, 3)."""
    data: dict[str, Any] = {"attributes": {name: pack_numpy_array(values.T) for name, values in attributes.items()}}
    if index is not None:
        data["index"] = pack_numpy_array(index.astype(np.uint32).T)
    geometry, paint = f"{identity}-geometry", f"{identity}-material"
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [{"uuid": geometry, "type": "BufferGeometry", "data": data}],
        "materials": [{"uuid": paint, **material}],
        "object": {
            "uuid": identity,
            "type": kind,
            "geometry": geometry,
            "material": paint,
            "matrix": _matrix(np.eye(4)),
        },
    }


def _surroundings(camera: Camera) -> list[Command]:
    """Return background, lights and camera.

    meshcat's camera turns about the origin, so the scene is moved until the camera's target lies there.
    """
    shift = np.eye(4)
    shift[:3, 3] = -camera.target_m
    offset = camera.eye_m - camera.target_m
    x, y, z = (float(value) for value in offset)
    right, up, forward = camera.axes()
    distance = float(np.linalg.norm(offset))
    key = distance * (0.5 * right + 0.8 * up - 0.7 * forward)
    fill = distance * (-0.9 * right + 0.2 * up - 0.5 * forward)
    properties: dict[str, dict[str, Any]] = {
        "/Background": {"top_color": list(SKY_TOP), "bottom_color": list(SKY_BOTTOM)},
        "/Grid": {"visible": False},
        "/Axes": {"visible": False},
        # meshcat keeps the light or camera itself under this odd name below its folder.
        "/Lights/PointLightNegativeX/<object>": {"position": key.tolist(), "distance": 0, "intensity": 0.55},
        "/Lights/PointLightPositiveX/<object>": {"position": fill.tolist(), "distance": 0, "intensity": 0.25},
        "/Lights/AmbientLight/<object>": {"intensity": 0.5},
        "/Lights/FillLight/<object>": {"intensity": 0.1},
        # The folder "rotated" turns three.js's y axis into the world's z axis.
        "/Cameras/default/rotated/<object>": {"fov": camera.vertical_view_deg, "position": [x, z, -y]},
    }
    return [_command("set_transform", f"/{ROOT}", matrix=_matrix(shift))] + [
        _command("set_property", path, property=name, value=value)
        for path, values in properties.items()
        for name, value in values.items()
    ]


def _command(kind: str, path: str, **content: Any) -> Command:
    return {"type": kind, "path": path, **content}


def _matrix(pose: Vector) -> list[float]:
    """Return a homogeneous matrix column by column, as three.js reads it."""
    columns: list[float] = pose.T.ravel().tolist()
    return columns


def _packed(colour: tuple[float, ...]) -> int:
    """Return a colour as three.js writes it, 0xRRGGBB."""
    red, green, blue = (round(255 * min(max(value, 0.0), 1.0)) for value in colour)
    return (red << 16) | (green << 8) | blue
