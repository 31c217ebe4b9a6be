"""Readings of the tracker: two unknown frames, noise, and the size of an effect relative to the noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from .conditions import Scene
from .machine import Errors, close
from .rotations import Array, conjugate, from_vector, matrix, product, skew, to_vector, turn


@dataclass
class Tracker:
    """The device, where it stands and where its target sits.

    Attributes:
        base: fixed platform in the tracker's frame, translation then rotation vector (6,) [m, rad].
        target: target in the moving platform's frame (6,) [m, rad].
        sigma_position: noise of a coordinate [m].
        sigma_rotation: noise of a rotation component [rad]; none where it sees positions only.
    """

    base: Array
    target: Array
    sigma_position: float
    sigma_rotation: float | None

    def see(self, scene: Scene, errors: Errors) -> tuple[Array, Array]:
        """Return positions (n, 3) [m] and quaternions (n, 4) of the target in the tracker's frame, without noise."""
        near = (scene.position, scene.tilt)
        poses = close(scene.drives[:, :3], scene.drives[:, 3], errors, near)
        position, quaternion = poses.position, poses.quaternion
        position = position + turn(quaternion, self.target[:3])
        quaternion = product(quaternion, from_vector(self.target[3:]))
        for frame in (errors.base, np.broadcast_to(self.base, (len(scene), 6))):
            q = from_vector(frame[:, 3:])
            position, quaternion = frame[:, :3] + turn(q, position), product(q, quaternion)
        position = position * (1.0 + errors.scale[:, None]) + errors.seen[:, :3]
        return position, product(from_vector(errors.seen[:, 3:]), quaternion)

    def whiten(self, position: Array, rotation: Array) -> Array:
        """Return displacements (n, 3, …) [m] and turns [rad] over the noise, (n · 6, …) or (n · 3, …)."""
        parts = [position / self.sigma_position]
        if self.sigma_rotation is not None:
            parts.append(rotation / self.sigma_rotation)
        both = np.concatenate(parts, axis=1)
        return both.reshape(both.shape[0] * both.shape[1], *both.shape[2:])

    def difference(self, seen: tuple[Array, Array], faultless: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return how far one set of poses lies from another: displacements and turns in the tracker's frame."""
        return seen[0] - faultless[0], to_vector(product(seen[1], conjugate(faultless[1])))

    def frames(self, faultless: tuple[Array, Array]) -> Array:
        """Return the whitened columns of the two free frames, 12 of them."""
        position, quaternion = faultless
        rows = len(position)
        shift, rotate = np.zeros((rows, 3, 12)), np.zeros((rows, 3, 12))
        shift[:, :, :3] = rotate[:, :, 3:6] = np.eye(3)
        shift[:, :, 3:6] = -skew(position - position.mean(axis=0))
        shift[:, :, 6:9] = rotate[:, :, 9:12] = matrix(quaternion)
        return self.whiten(shift, rotate)

    def in_own_frame(self, scene: Scene, columns: Array) -> Array:
        """Return whitened signature columns (n, 6, k) of the platform's motion as the tracker sees the target move."""
        turned = matrix(from_vector(self.base[3:]))
        arm = turn(scene.poses.quaternion, self.target[:3])
        return self.whiten(turned @ (columns[:, :3] - skew(arm) @ columns[:, 3:]), turned @ columns[:, 3:])


def basis(columns: Array) -> Array:
    """Return orthonormal columns that span the same space."""
    size = np.linalg.norm(columns, axis=0)
    q, r, _ = qr(columns[:, size > 0] / size[size > 0], mode="economic", pivoting=True)
    pivots = np.abs(np.diag(r))
    return np.asarray(q[:, pivots > 1e-9 * pivots[0]])


def without(signature: Array, span: Array) -> Array:
    """Return what is left of a signature when an orthonormal span may absorb what it can."""
    return np.asarray(signature - span @ (span.T @ signature))


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
