"""Write the ladle's mesh from the dimensions file, so that picture and numbers agree.

Usage: ``python scripts/make_meshes.py [--layouts FILE] [--layout NAME] [--out FOLDER]``
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pouring_robot.io.files import write_whole
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.pouring.layout import load_layout
from pouring_robot.robot.pouring.layout_schema import Ladle

SEGMENTS = 72
"""Facets around the ladle; the lip needs about ten of them."""

LIP_DEPTH = 0.45
"""The lip fades out over this share of the height below the rim."""

_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def ladle_profile(ladle: Ladle) -> NDArray[np.float64]:
    """Return the outline of half the vessel's section as (n, 2) points (radius, z) in m.

    It runs from the middle of the outer bottom over the rim, at z = 0, to the middle of the inner bottom.
    """
    top, bottom, height, wall = (
        size.metres for size in (ladle.outer_radius_top, ladle.outer_radius_bottom, ladle.height, ladle.wall)
    )
    slope = (top - bottom) / height
    flange, flange_height = ladle.rim_flange.metres, ladle.rim_flange_height.metres
    outer = [bottom + slope * height * share for share in np.linspace(0.0, 1.0 - flange_height / height, 8)]
    outer_z = np.linspace(-height, -flange_height, 8)
    inner_depth = height - wall
    inner_z = np.linspace(0.0, -inner_depth, 9)
    inner = top - wall - (top - bottom) * np.linspace(0.0, 1.0, 9)
    points = [(0.0, -height), *zip(outer, outer_z, strict=True)]
    points += [(outer[-1] + flange, -flange_height), (top + flange, 0.0)]
    points += [*zip(inner, inner_z, strict=True), (0.0, -inner_depth)]
    return np.array(points)


def ladle_triangles(ladle: Ladle) -> NDArray[np.float64]:
    """Return the closed surface of the ladle as (n, 3, 3) triangle corners in m, normals outwards.

    The profile is turned about z; towards +x and near the rim both walls bulge outwards into a pouring lip.
    Its tip lies at the outer radius plus the lip's reach.
    """
    profile = ladle_profile(ladle)
    angles = np.linspace(-np.pi, np.pi, SEGMENTS, endpoint=False)
    radius, z = profile[:, 0], profile[:, 1]
    # The flange already reaches out by its width; the bulge adds the rest, so the tip is at radius + reach.
    around = np.exp(-((angles / ladle.lip_half_angle.radians) ** 2))
    near_rim = np.clip(1.0 + z / (LIP_DEPTH * ladle.height.metres), 0.0, 1.0) ** 2
    bulge = (ladle.lip_reach.metres - ladle.rim_flange.metres) * np.outer(near_rim * (radius > 0.0), around)
    turned = radius[:, None] + bulge
    height = np.broadcast_to(z[:, None], turned.shape)
    grid = np.stack([turned * np.cos(angles), turned * np.sin(angles), height], axis=-1)
    following = np.roll(grid, -1, axis=1)
    quads = (grid[:-1], following[:-1], following[1:], grid[1:])
    triangles = np.concatenate(
        [np.stack([quads[0], quads[1], quads[2]], 2), np.stack([quads[0], quads[2], quads[3]], 2)]
    ).reshape(-1, 3, 3)
    flat = np.linalg.norm(_normals(triangles), axis=1) == 0.0  # at the two middles a quad is one triangle
    return np.asarray(triangles[~flat])


def _normals(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normals of triangles, twice their area long."""
    first, second, third = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.cross(second - first, third - first)


def write_stl(path: Path, triangles: NDArray[np.float64]) -> None:
    """Write triangles (n, 3, 3) in m as a binary STL."""
    normals = _normals(triangles)
    records = np.zeros(len(triangles), dtype=_STL_TRIANGLE)
    records["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    records["corners"] = triangles
    header = b"ladle of pouring_robot, metres".ljust(80, b" ")
    write_whole(path, header + np.uint32(len(triangles)).tobytes() + records.tobytes())


def main(argv: list[str] | None = None) -> None:
    """Write the mesh named in the layout."""
    parser = argparse.ArgumentParser(description="Write the ladle's mesh from the dimensions file.")
    parser.add_argument("--layouts", type=Path, default=None, help="dimensions file, default: the shipped")
    parser.add_argument("--layout", default="paper", help="layout whose ladle is drawn")
    parser.add_argument("--out", type=Path, default=None, help="folder (default: the description's meshes)")
    arguments = parser.parse_args(argv)
    ladle = load_layout(arguments.layout, arguments.layouts).ladle
    folder = arguments.out or description_folder() / "meshes"
    write_stl(folder / ladle.mesh.value, ladle_triangles(ladle))
    print(folder / ladle.mesh.value)


if __name__ == "__main__":
    main()
