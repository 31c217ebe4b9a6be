"""A scene as one HTML page that needs no network, no server and no other file.

It holds each shape once, then the places of all bodies at every step. Numbers are in single precision, as base64:
accurate to a tenth of a micrometre on a robot of metres, and five hundred steps of the whole robot take about a
megabyte. A body that never moves takes one entry.
"""

import base64
import dataclasses
import json
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pouring_robot.io.files import write_whole
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import rotation_vectors
from pouring_robot.report.page import templates
from pouring_robot.viewer.scene import SKY_BOTTOM, SKY_TOP, Camera, Scene, SceneArrows, SceneRobot, at_step, legend
from pouring_robot.viewer.shapes import Shape, camera_around, colours_at, outline, shape_of, view_height

Content = dict[str, Any]

_DIRECTIONS = {"front": (1.0, -0.35, 0.12), "side": (0.0, -1.0, 0.12), "above": (0.35, -0.2, 1.0)}
_CLOSER = 0.4
_STILL = 1e-12


def write_html(scene: Scene, path: Path | str) -> Path:
    """Write a scene as a self-contained meshcat page, with a time bar where it has several steps; whole or not at all.

    The viewer's script takes 0.9 MB of it, the robot about 1 MB, and each hundred steps some 0.2 MB.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_whole(path, page(scene))


def page(scene: Scene, *, live: bool = False, bench: dict[str, Any] | None = None) -> str:
    """Return the page of a scene as HTML, with the sliders of a bench; ``live``: a program serves it.

    Its content policy lets it reach nothing but that program.
    """
    content = page_content(scene) | {"live": live, "bench": bench}
    return (
        templates("pouring_robot.viewer")
        .get_template("page.html.j2")
        .render(
            scene=scene,
            legend=legend(scene),
            ramp=scene.scale.colours(np.linspace(scene.scale.lower, scene.scale.upper, 11)) if scene.scale else (),
            bench=bench,
            enlarges=bool(scene.arrows) or any(robot.reference is not None for robot in scene.robots),
            connect="'self'" if live else "'none'",
            content=json.dumps(content, allow_nan=False).replace("<", r"\u003c"),
            viewer=_viewer_script(),
        )
    )


def _viewer_script() -> str:
    """Return meshcat's viewer as JavaScript for use between script tags."""
    # Found without an import, which would load IPython and open a socket.
    script = distribution("meshcat").locate_file("meshcat/viewer/dist/main.min.js")
    source = Path(str(script)).read_text(encoding="utf-8")
    return source.replace("</script", r"<\/script")


def page_content(scene: Scene) -> Content:
    """Return everything that the script of a page draws."""
    shapes: dict[Shape, int] = {}
    robots = [_robot(scene, robot, shapes) for robot in scene.robots]
    points = outline(scene)
    camera = scene.camera or camera_around(points)
    return {
        "shapes": [_shape(shape) for shape in shapes],
        "robots": robots,
        "cameras": {
            name: {"eye": one.eye_m.tolist(), "target": one.target_m.tolist(), "view_deg": one.vertical_view_deg}
            for name, one in _cameras(scene, camera, points).items()
        },
        "sky": [list(SKY_TOP), list(SKY_BOTTOM)],
        "thickness": 0.005 * view_height(camera),
        "exaggeration": scene.exaggeration,
        "first": scene.first,
        "film": film(scene),
    }


def film(scene: Scene) -> Content:
    """Return everything that changes from step to step: places, colours, arrows, texts and curves."""
    count = len(scene.steps)
    at = np.arange(1.0, count + 1.0) if scene.at is None else scene.at
    return {
        "robots": {robot.name: _places(scene, robot) for robot in scene.robots},
        "arrows": [_arrows(item) for item in scene.arrows],
        "steps": [{"label": step.label, "caption": step.caption} for step in scene.steps],
        "at": at.tolist(),
        "curves": [
            {"unit": c.unit, "values": [v if np.isfinite(v) else None for v in c.values.tolist()], "colour": c.colour}
            for c in scene.curves
        ],
    }


def _robot(scene: Scene, robot: SceneRobot, shapes: dict[Shape, int]) -> Content:
    """Return the constant data of a robot; shapes are numbered in the order in which they occur."""
    colours = colours_at(scene, robot, scene.first).tolist()
    visuals = [
        {
            "name": item.name,
            "body": item.parentJoint,
            "shape": shapes.setdefault(shape_of(item), len(shapes)),
            "matrix": item.placement.homogeneous.T.ravel().tolist(),  # column by column, as three.js reads it
            "colour": colour,
        }
        for item, colour in zip(robot.visual.geometryObjects, colours, strict=True)
    ]
    return {"name": robot.name, "opacity": robot.opacity, "visuals": visuals}


def _places(scene: Scene, robot: SceneRobot) -> Content:
    """Return origin and quaternion of every body without error, and shift and rotation vector of its error."""
    reference = robot.bodies if robot.reference is None else robot.reference
    axes = Rotation.from_matrix(reference[..., :3, :3].reshape(-1, 3, 3))
    quaternions = axes.as_quat(canonical=True).reshape(*reference.shape[:2], 4)
    turn = rotation_vectors(robot.bodies[..., :3, :3], since=reference[..., :3, :3])
    shift = np.broadcast_to((robot.bodies - reference)[..., :3, 3], turn.shape)
    content: Content = {
        "places": _course(np.concatenate([reference[..., :3, 3], quaternions], axis=-1)),
        "errors": _course(np.concatenate([shift, turn], axis=-1)),
    }
    if robot.colours is not None:
        frames = (colours_at(scene, robot, step) for step in range(len(robot.colours)))
        content["colours"] = [_bytes(np.round(255.0 * frame).astype(np.uint8)) for frame in frames]
    return content


def _course(values: FloatArray) -> list[str]:
    """Return the values of every body over the steps, one entry where it does not move, from numbers (k, bodies, n)."""
    courses = np.swapaxes(values, 0, 1)
    still = np.ptp(courses, axis=1).max(axis=-1, initial=0.0) < _STILL
    return [_floats(one[:1] if rests else one) for one, rests in zip(courses, still.tolist(), strict=True)]


def _arrows(item: SceneArrows) -> Content:
    steps = range(max(len(item.starts_m), len(item.vectors_m)))
    ends = [np.stack([at_step(item.starts_m, k), at_step(item.vectors_m, k)], axis=1) for k in steps]
    return {
        "name": item.name,
        "colour": item.colour,
        "shown_with": item.shown_with,
        "count": item.starts_m.shape[1],
        "ends": _floats(np.array(ends)),
    }


def _shape(shape: Shape) -> Content:
    normals = np.round(127.0 * shape.normals).astype(np.int8)
    return {
        "vertices": _floats(shape.vertices),
        "normals": _bytes(normals),
        "faces": _bytes(shape.faces.astype(np.uint16 if len(shape.vertices) < 1 << 16 else np.uint32)),
        "wide": len(shape.vertices) >= 1 << 16,
        "edges": _floats(shape.edges),
    }


def _cameras(scene: Scene, overview: Camera, points: FloatArray) -> dict[str, Camera]:
    """Return the cameras: an overview, three sides, and one closer to the tip where there is a single arrow."""
    found = {"all": overview} | {name: camera_around(points, direction) for name, direction in _DIRECTIONS.items()}
    single = [item for item in scene.arrows if item.starts_m.shape[1] == 1]
    if single:
        place = at_step(single[0].starts_m, scene.first)[0]
        found["tip"] = dataclasses.replace(
            overview, eye_m=place + _CLOSER * (overview.eye_m - overview.target_m), target_m=place
        )
    return found


def _floats(values: FloatArray) -> str:
    return _bytes(np.asarray(values, dtype="<f4"))


def _bytes(values: np.ndarray[Any, Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
