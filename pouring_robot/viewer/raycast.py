"""Which surface each ray of a camera meets first, and how bright it is there; no graphics library."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter

from pouring_robot.io.seeds import RAYS_SEED
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.viewer.scene import Camera
from pouring_robot.viewer.shapes import Solid

Floats = npt.NDArray[np.float32]

_FAR = np.float32(1e30)
_FLUSH_M = np.float32(5e-4)
_OCCLUSION_RAYS = 8
_SHADOW_RAYS = 4
_GOLDEN_SECTION = 0.618033988749895


@dataclass(frozen=True)
class View:
    """Layout of a camera's picture in samples."""

    camera: Camera  # where it looks from
    columns: int  # samples from the left to the right edge
    rows: int  # samples from the upper to the lower edge
    middle: float  # column at which the camera's target appears

    @property
    def _focal(self) -> float:
        """Samples that an object one metre wide covers at one metre from the eye."""
        return float(0.5 * self.rows / np.tan(np.radians(self.camera.vertical_view_deg) / 2.0))

    def directions(self, first_row: int, last_row: int) -> Floats:
        """Return the directions of the rays of some rows, shape (rows, columns, 3), unit, world axes.

        All rays start at the eye.
        """
        right, up, forward = self.camera.axes().astype(np.float32)
        x = ((np.arange(self.columns) + 0.5 - self.middle) / self._focal).astype(np.float32)
        y = ((0.5 * self.rows - np.arange(first_row, last_row) - 0.5) / self._focal).astype(np.float32)
        directions = forward + x[None, :, None] * right + y[:, None, None] * up
        directions /= np.sqrt(1 + x[None, :, None] ** 2 + y[:, None, None] ** 2)
        return np.ascontiguousarray(directions)

    def project(self, points_m: FloatArray) -> FloatArray:
        """Return column and row at which world points appear, shape (n, 2); NaN for those behind the eye."""
        x, y, depth = self.camera.axes() @ (points_m - self.camera.eye_m).T
        depth = np.where(depth > 1e-6, depth, np.nan)
        return np.stack([self.middle + x / depth * self._focal, 0.5 * self.rows - y / depth * self._focal], 1)

    def window(self, bodies: Sequence[Solid]) -> tuple[slice, slice]:
        """Return the rows and columns outside which the solids cannot be seen."""
        places = self.project(np.concatenate([body.vertices_in_world() for body in bodies]))
        sizes = (self.columns, self.rows)
        if np.isnan(places).any():  # something is next to or behind the eye
            return slice(0, self.rows), slice(0, self.columns)
        low = np.clip(places.min(axis=0) - 2, 0, sizes).astype(int).tolist()
        high = np.clip(places.max(axis=0) + 3, 0, sizes).astype(int).tolist()
        return slice(low[1], high[1]), slice(low[0], high[0])


@dataclass(frozen=True)
class Hits:
    """Hits of the rays; arrays of shape (rows, columns) or (rows, columns, 3)."""

    depth: Floats  # distance from the eye, m; very large where nothing was met
    part: npt.NDArray[np.int32]  # number of the solid, -1 where nothing was met
    normal: Floats  # unit normal that faces the eye, world axes; zero where nothing was met
    colour: Floats  # colour of the solid without light, 0 to 1
    plane: Floats  # distance of the eye from the surface's plane at the point, m; zero where nothing was met

    @property
    def mask(self) -> BoolArray:
        """Where something was met."""
        return np.asarray(self.part >= 0)

    def every(self, step: int) -> Self:
        """Return every ``step``-th hit in both directions."""
        return type(self)(**{name: array[::step, ::step] for name, array in vars(self).items()})


class Layer:
    """Solids that are viewed together."""

    def __init__(self, bodies: Sequence[Solid], view: View) -> None:
        """Move the solids so that the eye is the origin and build the search tree.

        With the eye at the origin, single precision is accurate to micrometres wherever the robot stands.
        """
        self.bodies = tuple(bodies)
        self.camera = view.camera
        self.window = view.window(bodies)
        counts = [len(body.shape.vertices) for body in bodies]
        starts = np.cumsum([0, *counts[:-1]])
        vertices = np.concatenate([body.vertices_in_world() for body in bodies]) - self.camera.eye_m
        normals = [body.shape.normals @ body.pose_world_to_solid[:3, :3].T for body in bodies]
        self._normals = np.concatenate(normals).astype(np.float32)
        faces = [body.shape.faces + start for body, start in zip(bodies, starts, strict=True)]
        self._faces = np.concatenate(faces).astype(np.int32)
        self._part = np.repeat(np.arange(len(bodies), dtype=np.int32), [len(one) for one in faces])
        self._colours = np.array([body.colour for body in bodies], dtype=np.float32)
        from embreex.mesh_construction import TriangleMesh  # for pictures only: see the extra `viewer`
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        TriangleMesh(self._scene, vertices.astype(np.float32), self._faces)
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the search tree

    def meet(self, directions: Floats) -> Hits:
        """Return what each ray from the eye meets first; directions of shape (rows, columns, 3), unit."""
        flat = np.ascontiguousarray(directions.reshape(-1, 3))
        answer = self._scene.run(np.zeros_like(flat), flat, output=1)
        met = np.flatnonzero(answer["primID"] >= 0)
        face = answer["primID"][met]
        depth, part = answer["tfar"][met], self._part[face]
        first, second, third = (self._normals[self._faces[face, corner]] for corner in range(3))
        u, v = answer["u"][met, None], answer["v"][met, None]
        normal = _unit((1 - u - v) * first + u * second + v * third)
        normal *= np.where(np.einsum("ij,ij->i", normal, flat[met]) > 0, np.float32(-1), np.float32(1))[:, None]
        plane = depth * np.einsum("ij,ij->i", normal, flat[met])

        def full(values: npt.NDArray[Any], empty: float | np.float32 = 0.0) -> npt.NDArray[Any]:
            laid_out = np.full((len(flat), *values.shape[1:]), empty, dtype=values.dtype)
            laid_out[met] = values
            return laid_out.reshape(*directions.shape[:2], *values.shape[1:])

        return Hits(full(depth, _FAR), full(part, -1), full(normal), full(self._colours[part]), full(plane))

    def daylight(self, directions: Floats, hits: Hits, reach_m: float) -> tuple[Floats, Floats]:
        """Return how open hits of rays are to their surroundings and how much key light reaches them, 0 to 1.

        A wall farther away than the reach, in m, darkens nothing.
        """
        mask = hits.mask
        normal = hits.normal[mask]
        points = directions[mask] * hits.depth[mask][:, None] + normal * np.float32(2e-3 * reach_m)
        random = np.random.default_rng(RAYS_SEED)
        # A point on a unit ball around the tip of the normal: directions by the cosine of their angle.
        around = (normal + offset for offset in _around(random, len(points), _OCCLUSION_RAYS))
        open_ = np.mean([self._free(points, towards, reach_m) for towards in around], axis=0)
        key = key_light(self.camera)
        around = (key + np.float32(0.06) * offset for offset in _around(random, len(points), _SHADOW_RAYS))
        lit = np.mean([self._free(points, towards, _FAR) for towards in around], axis=0)
        return _blurred(open_, mask, 11), _blurred(lit, mask, 5)

    def _free(self, points: Floats, directions: Floats, reach_m: float | np.float32) -> Floats:
        """Return 1 where a ray is free up to its reach, 0 where something blocks it."""
        reach = np.full(len(points), reach_m, dtype=np.float32)
        blocked = self._scene.run(points, _unit(directions), dists=reach, query="OCCLUDED")
        return np.asarray(blocked < 0, dtype=np.float32)


def key_light(camera: Camera) -> Floats:
    """Return the direction towards the main light: from above, behind the viewer's right shoulder; unit."""
    right, up, forward = camera.axes()
    direction = 0.45 * right + 0.75 * up - 0.65 * forward
    return np.asarray(direction / np.linalg.norm(direction), dtype=np.float32)


def lit_colours(camera: Camera, directions: Floats, hits: Hits, daylight: Sequence[Floats] | None = None) -> Floats:
    """Return the colours (rows, columns, 3), 0 to 1, of the hits of rays under key light, fill light and sky.

    ``daylight`` is from :meth:`Layer.daylight`; by default all light reaches every point.
    """
    right, up, forward = camera.axes().astype(np.float32)
    key, fill = key_light(camera), np.float32(0.1) * up - np.float32(0.85) * right - np.float32(0.5) * forward
    mask = hits.mask
    open_, lit = [np.ones(1, dtype=np.float32)] * 2 if daylight is None else [share[mask] for share in daylight]
    normal, view = hits.normal[mask], -directions[mask]
    facing_key = np.maximum(normal @ key, 0) * lit
    facing_fill = np.maximum(normal @ fill, 0)
    sky = 0.5 + 0.5 * normal[:, 2]
    shade = 0.35 + 0.65 * open_
    light = shade * (0.42 + 0.30 * sky + 0.22 * facing_fill) + 0.58 * facing_key
    shine = 0.16 * lit * np.maximum(np.einsum("ij,ij->i", normal, _unit(key + view)), 0) ** 32
    colours = np.zeros_like(hits.colour)
    colours[mask] = np.clip(hits.colour[mask] * light[:, None] + shine[:, None], 0, 1)
    return colours


def edge_mask(hits: Hits) -> BoolArray:
    """Return where a solid ends before another or has a crease: one sample wide, shape (rows, columns).

    Where two of one colour lie in one plane, chance decides which of them a ray meets: there is no line between them.
    """
    edge = np.zeros(hits.part.shape, dtype=bool)
    for axis in (0, 1):
        near: list[slice] = [slice(None), slice(None)]
        far = near.copy()
        near[axis], far[axis] = slice(None, -1), slice(1, None)
        one, other = tuple(near), tuple(far)
        cosine = np.einsum("ijk,ijk->ij", hits.normal[one], hits.normal[other])
        bend = cosine < 0.72
        flush = (cosine > 0.999) & (np.abs(hits.plane[one] - hits.plane[other]) < _FLUSH_M)
        flush &= (hits.colour[one] == hits.colour[other]).all(axis=2)
        changed = (hits.part[one] != hits.part[other]) & ~flush
        line = changed | (bend & hits.mask[one])
        # The line is drawn on the nearer of the two, so that it belongs to the body that ends there.
        nearer = hits.depth[one] <= hits.depth[other]
        edge[one] |= line & nearer
        edge[other] |= line & ~nearer
    return edge


def _unit(vectors: Floats) -> Floats:
    """Return vectors of shape (n, 3) with length one."""
    lengths = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return np.asarray(vectors / np.maximum(lengths, np.float32(1e-9))[:, None], dtype=np.float32)


def _around(random: np.random.Generator, count: int, rounds: int) -> Iterator[Floats]:
    """Yield unit vectors of shape (count, 3) that are spread evenly over all directions in all rounds together.

    Each vector takes one step of a spiral from pole to pole every round. Vectors drawn independently would need several
    times as many rounds for the same smoothness.
    """
    start = random.random(count, dtype=np.float32)
    for step in range(rounds):
        z = (step + random.random(count, dtype=np.float32)) * np.float32(2 / rounds) - 1
        angle = np.float32(2 * np.pi) * (start + np.float32(step * _GOLDEN_SECTION % 1.0))
        radius = np.sqrt(np.maximum(1 - z * z, 0))
        yield np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def _blurred(values: Floats, mask: BoolArray, width: int) -> Floats:
    """Spread values over their neighbours, counting only samples that met something."""
    spread = np.zeros(mask.shape, dtype=np.float32)
    spread[mask] = values
    weight = uniform_filter(mask.astype(np.float32), width)
    smooth = uniform_filter(spread, width) / np.maximum(weight, np.float32(1e-6))
    return np.asarray(np.clip(smooth, 0.0, 1.0), dtype=np.float32)
