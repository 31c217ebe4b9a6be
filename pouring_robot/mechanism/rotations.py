"""Rotations of stacks of poses: vectors and their Jacobians, tilts, nearest rotations; motion of points at an arm.

With exp(w) the rotation of a rotation vector w (Rodrigues), the right Jacobian (``pin.Jexp3``) is defined by
``exp(w + dw) = exp(w) exp(right_jacobian(w) dw)``; see e.g. Chirikjian, *Stochastic Models, Information Theory, and
Lie Groups* 2, §10.6.
"""

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray

_TURNED = 1e-9  # by as much round-off lets the cosine of a turn about other axes differ from one
# Below this angle (rad) the series is exact to round-off where the closed form would divide zero by zero.
_SMALL = 1e-4


def skew(vectors: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of cross products with vectors (..., 3)."""
    matrices = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]  # np.moveaxis is slow
    matrices[..., 0, 1], matrices[..., 0, 2], matrices[..., 1, 2] = -z, y, -x
    matrices[..., 1, 0], matrices[..., 2, 0], matrices[..., 2, 1] = z, -y, x
    return matrices


def tilts(rotations: FloatArray) -> FloatArray:
    """Return the tilts of rotations (..., 3, 3) about y, (...), in rad: the direction of their third axis."""
    return np.asarray(np.arctan2(rotations[..., 0, 2], rotations[..., 2, 2]))


def tilts_alone(rotations: FloatArray) -> FloatArray | None:
    """Return :func:`tilts` of rotations (n, 3, 3) where they turn about y alone, (n,); None where they do not."""
    return tilts(rotations) if np.abs(rotations[..., 1, 1] - 1.0).max(initial=0.0) <= _TURNED else None


def tilt_rates(rotations: FloatArray, turns: FloatArray) -> FloatArray:
    """Return the changes of :func:`tilts`, (..., p), by turns ω (..., 3, p), which move the third axis c by ω × c."""
    x, z = rotations[..., 0, 2, None], rotations[..., 2, 2, None]
    moved = np.cross(turns, rotations[..., 2, None], axis=-2)
    return np.asarray((z * moved[..., 0, :] - x * moved[..., 2, :]) / (x**2 + z**2))


def nearest_rotations(matrices: FloatArray) -> FloatArray:
    """Return the rotations nearest to matrices, (..., 3, 3) each (Kabsch, Acta Crystallographica A 32, 1976)."""
    u, _, vt = np.linalg.svd(matrices)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    return np.asarray(u @ vt)


def moved_point(twists: FloatArray, arm: FloatArray) -> FloatArray:
    """Return how a point at an arm (..., 3) from a body's origin moves, (..., 3, p), by twists of it, (..., 6, p)."""
    return np.asarray(twists[..., :3, :] + np.cross(twists[..., 3:, :], arm[..., :, None], axis=-2))


def inverse_right_jacobians(rotation_vectors: FloatArray) -> FloatArray:
    """Return the inverse right Jacobians (n, 3, 3) at rotation vectors (n, 3), in rad; NaN stays NaN.

    ``log(exp(r) exp(d)) = r + inverse_right_jacobian(r) d`` to first order in d:
    1 + [r]/2 + (1/a² - (1 + cos a)/(2 a sin a)) [r]², a = |r|.
    """
    cross = skew(rotation_vectors)
    angle = np.linalg.norm(rotation_vectors, axis=-1)
    large = np.where(angle > _SMALL, angle, 1.0)
    factor = np.where(
        angle > _SMALL,
        1.0 / large**2 - (1.0 + np.cos(large)) / (2.0 * large * np.sin(large)),
        1.0 / 12.0 + angle**2 / 720.0,
    )
    return np.asarray(np.eye(3) + 0.5 * cross + factor[..., None, None] * (cross @ cross))


def rotation_matrices(rotation_vectors_rad: FloatArray) -> FloatArray:
    """Return rotation matrices (..., 3, 3) of rotation vectors (..., 3) in rad; NaN where a component is missing."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(np.array(rotation_vectors_rad).reshape(-1, 3))  # it takes no read-only array
    return np.asarray(turns.as_matrix().reshape(*rotation_vectors_rad.shape, 3))


def rotation_vectors(matrices: FloatArray, since: FloatArray | None = None) -> FloatArray:
    """Return rotation vectors (..., 3), in rad, of rotation matrices (..., 3, 3); NaN stays NaN.

    If axes ``since``, (..., 3, 3), are given, of the rotations that turn them into those of the matrices, in the base
    of both.
    """
    from scipy.spatial.transform import Rotation

    if since is not None:
        matrices = matrices @ np.swapaxes(since, -1, -2)
    known = np.isfinite(matrices).all(axis=(-2, -1))
    vectors = np.full((*known.shape, 3), np.nan)
    if known.any():
        vectors[known] = Rotation.from_matrix(matrices[known]).as_rotvec()
    return vectors


def turn_to(axis: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) whose third column is an axis (3,); exact permutations for the coordinate axes."""
    unit = axis / np.linalg.norm(axis)
    helper = np.roll(np.eye(3)[int(np.argmax(np.abs(unit)))], 1)
    first = np.cross(helper, unit)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(unit, first), unit], axis=1)
