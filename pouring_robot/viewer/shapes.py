"""Triangles of a robot's visual geometry, whatever the URDF made them of."""

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
from pouring_robot.mechanism.arrays import read_only

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

_CREASE_RAD = np.radians(35.0)
"""Neighbouring triangles that meet at more than this angle show an edge instead of a rounding."""
_ROUND_SECTIONS = 40
"""Sides of the prism that stands for a cylinder."""


@dataclass(frozen=True)
class Shape:
    """A surface of triangles in its own frame."""

    vertices: Vertices  # shape (v, 3), m; doubled along creases so that each copy has one normal
    normals: Vertices  # shape (v, 3), unit, outward where the triangles are wound counter-clockwise
    faces: Faces  # shape (f, 3), rows of vertex numbers
    edges: Vertices  # shape (e, 2, 3), m: both ends of every crease and border


def visual_model(model: pin.Model, urdf_text: str, package_dirs: Sequence[Path | str] = ()) -> pin.GeometryModel:
    """Return the visual geometry of a URDF text for a model of it; ``package://`` addresses are looked up in folders.

    Raises:
        DescriptionError: the URDF does not parse, or a mesh is not found.
    """
    folders = [str(folder) for folder in package_dirs]
    try:
        return pin.buildGeomFromUrdfString(model, urdf_text, pin.GeometryType.VISUAL, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        raise DescriptionError("robot description", f"its visual geometry cannot be read: {error}") from error


def shape_of(item: pin.GeometryObject) -> Shape:
    """Return the triangles of one visual in its own frame, scale included.

    Raises:
        DescriptionError: the visual is of a kind that no URDF can hold (a plane, an octree, ...).
    """
    geometry = item.geometry
    match geometry:
        case coal.Box():
            return _made(_box, *(2.0 * geometry.halfSide).tolist())
        case coal.Cylinder():
            return cylinder(geometry.radius, 2.0 * geometry.halfLength)
        case coal.Capsule():
            return _made(trimesh.creation.capsule, 2.0 * geometry.halfLength, geometry.radius)
        case coal.Sphere():
            return _made(trimesh.creation.icosphere, 3, geometry.radius)
        case coal.BVHModelBase():
            return _from_mesh(geometry)
    raise DescriptionError(
        "robot description", f"visual '{item.name}' is a {type(geometry).__name__}, which cannot be drawn"
    )


@lru_cache(maxsize=256)
def cylinder(radius: float, length: float) -> Shape:
    """Return a closed cylinder along z, centred on its frame; radius and length in m."""
    return smooth(trimesh.creation.cylinder(radius, length, sections=_ROUND_SECTIONS))


def _box(*sides: float) -> Any:
    return trimesh.creation.box(sides)


@lru_cache(maxsize=256)
def _made(make: Callable[..., Any], *sizes: float) -> Shape:
    """Return the shape of a solid that trimesh makes, its middle in the origin: releases put a capsule's elsewhere."""
    body = make(*sizes)
    body.apply_translation(-body.bounds.mean(axis=0))
    return smooth(body)


def _from_mesh(geometry: coal.BVHModelBase) -> Shape:
    """Return the shape of a mesh that Pinocchio loaded; its scale is already in the vertices."""
    vertices = np.array(geometry.vertices(), dtype=np.float64)
    triangles = map(geometry.tri_indices, range(geometry.num_tris))
    faces = np.array([[one[0], one[1], one[2]] for one in triangles], dtype=np.int64)
    return _meshed(vertices.tobytes(), faces.tobytes())


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
