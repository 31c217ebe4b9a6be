"""Rotations of many rows at once: quaternions (w, x, y, z), rotation vectors, matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def skew(v: Array) -> Array:
    """Return the matrices that turn ``w`` into ``v × w``; ``v`` is (…, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def product(a: Array, b: Array) -> Array:
    """Return the quaternion product: first turn by ``b``, then by ``a``."""
    w = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    v = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([w, v], axis=-1)


def conjugate(q: Array) -> Array:
    """Return the inverse of unit quaternions."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def about(axis: Array, angle: Any) -> Array:
    """Return the quaternion of a turn by ``angle`` [rad] about a unit ``axis``."""
    half = np.asarray(angle, dtype=float)[..., None] / 2.0
    axis, half = np.broadcast_arrays(axis, half)
    return np.concatenate([np.cos(half[..., :1]), np.sin(half) * axis], axis=-1)


def from_vector(v: Array) -> Array:
    """Return the quaternion of a rotation vector [rad]."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2.0), v * np.sinc(angle / (2.0 * np.pi)) / 2.0], axis=-1)


def to_vector(q: Array) -> Array:
    """Return the rotation vector [rad], its length at most π."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return q[..., 1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)


def matrix(q: Array) -> Array:
    """Return the rotation matrices of unit quaternions."""
    s = skew(q[..., 1:])
    return np.asarray(np.eye(3) + 2.0 * q[..., :1, None] * s + 2.0 * s @ s)


def turn(q: Array, v: Array) -> Array:
    """Return the vectors ``v`` turned by ``q``."""
    t = 2.0 * np.cross(q[..., 1:], v)
    return np.asarray(v + q[..., :1] * t + np.cross(q[..., 1:], t))
