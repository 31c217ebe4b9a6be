"""The two frames nobody knows: tracker → fixed platform, and moving platform → target, fitted robustly.

Measured pose = T_tracker_fixed ∘ X ∘ T_platform_target, X the pose of the moving platform in the fixed platform.
With R_1, t_1 and R_2, t_2 the two frames and R, p a row's X:

    position  t_1 + R_1 (p + R t_2)          rotation  R_1 R R_2

The platform turns about y only, so the y coordinate of t_2 and the place of the fixed platform along its own y cannot
be told apart: t_2 is given y = 0. Positions alone leave R_2 open; it is then the unit rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.nominal import PoseStack, rotation_vectors
from pouring_robot.exceptions import FrameFitError
from pouring_robot.mechanism.arrays import FloatArray

FEWEST_ROWS = 6
"""Rows that a fit of the frames needs at the least."""
_MAD_TO_SIGMA = 1.4826
_HUBER = 1.5
_STEPS = 60
_LONGEST_STEP = 1e7


@dataclass(frozen=True, eq=False)
class FrameFit:
    """The two fitted frames and what they leave over.

    Attributes:
        pose_tracker_to_fixed_platform: pose of the fixed platform in the tracker frame.
        pose_platform_to_target: pose of the target in the moving platform; y of its origin is 0 (see the module).
        position_residual_m: (n, 3) measured minus fitted position in tracker axes, in m; NaN where missing.
        rotation_residual_rad: (n, 3) rotation vector from fitted to measured, in tracker axes, in rad; NaN where
            missing; None for positions only.
        position_scale_m: robust standard deviation of a position coordinate, in m.
        rotation_scale_rad: robust standard deviation of a rotation component, in rad; None for positions only.
    """

    pose_tracker_to_fixed_platform: pin.SE3
    pose_platform_to_target: pin.SE3
    position_residual_m: FloatArray
    rotation_residual_rad: FloatArray | None
    position_scale_m: float
    rotation_scale_rad: float | None

    def predict(self, poses: PoseStack) -> PoseStack:
        """Return the poses the tracker should see for poses of the moving platform in the fixed platform."""
        return _predicted(poses, self._frames)

    def to_fixed_platform(self, vectors: FloatArray) -> FloatArray:
        """Turn vectors (n, 3) from tracker axes into the axes of the fixed platform."""
        turned: FloatArray = vectors @ self.pose_tracker_to_fixed_platform.rotation
        return turned

    @property
    def _frames(self) -> _Frames:
        outer, inner = self.pose_tracker_to_fixed_platform, self.pose_platform_to_target
        return _Frames(outer.rotation, outer.translation, inner.rotation, inner.translation)


@dataclass(frozen=True, eq=False)
class _Frames:
    outer_rotation: FloatArray
    outer_translation: FloatArray
    inner_rotation: FloatArray
    inner_translation: FloatArray


def robust_sigma(values: FloatArray) -> float:
    """Return the standard deviation of zero-mean values by their median size, NaN left out; 0 without values."""
    kept = np.abs(values[np.isfinite(values)])
    return float(_MAD_TO_SIGMA * np.median(kept)) if kept.size else 0.0


def fit_frames(
    poses: PoseStack, position_m: FloatArray, rotation: FloatArray | None = None, metres_per_rad: float = 1.0
) -> FrameFit:
    """Fit both frames by iteratively reweighted least squares (Huber), so that single wrong rows hardly count.

    Args:
        poses: pose of the moving platform in the fixed platform for every row; NaN rows do not count.
        position_m: (n, 3) measured positions, in m; missing coordinates NaN.
        rotation: (n, 3, 3) measured rotations; NaN where missing. None: positions only.
        metres_per_rad: how rotations weigh against positions: noise of a coordinate over noise of a rotation
            component, in m. Were it fitted too, one of the two would be fitted at the cost of the other.

    Raises:
        FrameFitError: fewer than :data:`FEWEST_ROWS` rows have a pose and a complete position.
    """
    complete = poses.known & np.isfinite(position_m).all(axis=1)
    if complete.sum() < FEWEST_ROWS:
        raise FrameFitError(int(complete.sum()), FEWEST_ROWS)
    best: tuple[float, _Frames] | None = None
    for start, last in _starts(poses, position_m, complete):
        frames = _refine(poses, position_m, None, start, metres_per_rad)
        cost = float(np.nanmedian(np.linalg.norm(_position_residual(poses, position_m, frames), axis=1)))
        if best is None or cost < best[0]:
            best = cost, frames
        if last:
            break
    if best is None:
        raise FrameFitError(0, FEWEST_ROWS)
    frames = best[1]
    if rotation is not None and np.isfinite(rotation).any():
        frames = _with_inner_rotation(poses, rotation, frames)
        frames = _refine(poses, position_m, rotation, frames, metres_per_rad)
    else:
        rotation = None
    return _fit_of(poses, position_m, rotation, frames)


def _fit_of(poses: PoseStack, position_m: FloatArray, rotation: FloatArray | None, frames: _Frames) -> FrameFit:
    position = _position_residual(poses, position_m, frames)
    turn = None if rotation is None else _rotation_residual(poses, rotation, frames)
    return FrameFit(
        pose_tracker_to_fixed_platform=pin.SE3(frames.outer_rotation, frames.outer_translation),
        pose_platform_to_target=pin.SE3(frames.inner_rotation, frames.inner_translation),
        position_residual_m=position,
        rotation_residual_rad=turn,
        position_scale_m=robust_sigma(position),
        rotation_scale_rad=None if turn is None else robust_sigma(turn),
    )


def rotation_misfit(poses: PoseStack, rotation: FloatArray, fit: FrameFit) -> FloatArray:
    """Return the rotation residual (n, 3), in rad, with R_1 held as fitted to the positions and R_2 fitted anew."""
    frames = _with_inner_rotation(poses, rotation, fit._frames)
    return _rotation_residual(poses, rotation, frames)


def _predicted(poses: PoseStack, frames: _Frames) -> PoseStack:
    arm = poses.position_m + poses.rotation @ frames.inner_translation
    return PoseStack(
        frames.outer_translation + arm @ frames.outer_rotation.T,
        frames.outer_rotation @ poses.rotation @ frames.inner_rotation,
    )


def _position_residual(poses: PoseStack, position_m: FloatArray, frames: _Frames) -> FloatArray:
    return position_m - _predicted(poses, frames).position_m


def _rotation_residual(poses: PoseStack, rotation: FloatArray, frames: _Frames) -> FloatArray:
    return rotation_vectors(rotation @ np.swapaxes(_predicted(poses, frames).rotation, 1, 2))


# --- where to start -----------------------------------------------------------------------------------------------


def _starts(poses: PoseStack, position_m: FloatArray, rows: NDArray[np.bool_]) -> list[tuple[_Frames, bool]]:
    """Return frames to start from, each with whether it is good enough to stop at.

    Written out, the position is linear in R_1, in R_1 t_2 and in t_1: R_1 without its orthogonality is a least-squares
    problem. Only where the poses lie so that it is ill-conditioned (all in a line or a plane) the 24 rotations
    that take axes into axes are tried too.
    """
    affine, spread = affine_map(poses, position_m, rows)
    u, _, vt = np.linalg.svd(affine)
    outer = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    starts = [(_from_rotation(poses, position_m, rows, outer), spread > 1e-2)]
    if spread <= 1e-2:
        cube = Rotation.create_group("O").as_matrix()
        starts += [(_from_rotation(poses, position_m, rows, outer @ turn), False) for turn in cube]
    return starts


def affine_map(poses: PoseStack, position_m: FloatArray, rows: NDArray[np.bool_]) -> tuple[FloatArray, float]:
    """Return the best affine map from fixed-platform to tracker axes, (3, 3), and how well the poses determine it.

    A sound campaign gives a rotation. Mirrored axes give a negative determinant. The second value is the least
    over the largest singular value of the poses' spread: below 0.01 the map says little.
    """
    p, r = poses.position_m[rows], poses.rotation[rows]
    design = np.column_stack([p, r[:, 0, 0], r[:, 0, 2], np.ones(len(p))])
    solution = _robust_linear(design, position_m[rows])
    centred = design[:, :5] - design[:, :5].mean(axis=0)
    # What of the positions the tilt does not explain decides how well the map is known.
    tilt = centred[:, 3:]
    rest = centred[:, :3] - tilt @ np.linalg.lstsq(tilt, centred[:, :3], rcond=1e-9)[0]
    singular = np.linalg.svd(rest, compute_uv=False)
    spread = float(singular[-1] / singular[0]) if singular[0] > 0.0 else 0.0
    return solution[:3].T, spread


def _robust_linear(design: FloatArray, target: FloatArray) -> FloatArray:
    """Solve design @ solution = target, rows weighed by one over their misfit (least absolute deviations)."""
    weight = np.ones(len(design))
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0.0] = 1.0
    solution = np.zeros((design.shape[1], target.shape[1]))
    for _ in range(25):
        root = np.sqrt(weight)[:, None]
        solution = np.linalg.lstsq(root * design / scale, root * target, rcond=1e-9)[0] / scale[:, None]
        misfit = np.linalg.norm(target - design @ solution, axis=1)
        weight = 1.0 / np.maximum(misfit, 1e-3 * np.median(misfit) + 1e-12)
        weight /= weight.max()
    return solution


def _from_rotation(poses: PoseStack, position_m: FloatArray, rows: NDArray[np.bool_], outer: FloatArray) -> _Frames:
    """Return frames with R_1 given: t_1 and t_2 are then linear in the positions."""
    seen = position_m[rows] @ outer - poses.position_m[rows]
    r = poses.rotation[rows]
    # seen = R_1ᵀ t_1 + R t_2 with t_2 = (u, 0, w): x and z rows hold u and w, y only the constant.
    n = len(seen)
    design = np.zeros((2 * n, 4))
    design[:n, 0], design[n:, 1] = 1.0, 1.0
    design[:n, 2], design[:n, 3] = r[:, 0, 0], r[:, 0, 2]
    design[n:, 2], design[n:, 3] = r[:, 2, 0], r[:, 2, 2]
    solution = _robust_linear(design, np.concatenate([seen[:, 0], seen[:, 2]])[:, None])[:, 0]
    constant = np.array([solution[0], np.median(seen[:, 1]), solution[1]])
    return _Frames(outer, outer @ constant, np.eye(3), np.array([solution[2], 0.0, solution[3]]))


def _with_inner_rotation(poses: PoseStack, rotation: FloatArray, frames: _Frames) -> _Frames:
    """Return the frames with R_2 as the robust mean of what each row says of it."""
    seen = np.swapaxes(frames.outer_rotation @ poses.rotation, 1, 2) @ rotation
    seen = seen[np.isfinite(seen).all(axis=(1, 2))]
    weight = np.ones(len(seen))
    mean = Rotation.identity()
    for _ in range(15):
        mean = Rotation.from_matrix(seen).mean(weight)
        angle = (mean.inv() * Rotation.from_matrix(seen)).magnitude()
        weight = 1.0 / np.maximum(angle, 1e-3 * np.median(angle) + 1e-12)
        weight /= weight.max()
    return _Frames(frames.outer_rotation, frames.outer_translation, mean.as_matrix(), frames.inner_translation)


# --- Gauss-Newton ---------------------------------------------------------------------------------------------------


def _skew(vectors: FloatArray) -> FloatArray:
    matrices = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -z, y, -x
    matrices[:, 1, 0], matrices[:, 2, 0], matrices[:, 2, 1] = z, -y, x
    return matrices


def _refine(
    poses: PoseStack, position_m: FloatArray, rotation: FloatArray | None, frames: _Frames, metres_per_rad: float
) -> _Frames:
    """Run Gauss-Newton with Huber weights, a row's position and rotation judged apart."""
    for _ in range(_STEPS):
        step = _step(poses, position_m, rotation, frames, metres_per_rad)
        if not np.abs(step).max() < _LONGEST_STEP:  # poses that do not determine the frames at all
            break
        turn, shift, inner_turn, inner_shift = step[:3], step[3:6], step[6:9], step[9:12]
        frames = _Frames(
            Rotation.from_rotvec(turn).as_matrix() @ frames.outer_rotation,
            frames.outer_translation + shift,
            Rotation.from_rotvec(inner_turn).as_matrix() @ frames.inner_rotation,
            frames.inner_translation + inner_shift,
        )
        if np.abs(step).max() < 1e-8:
            break
    return frames


def _step(
    poses: PoseStack, position_m: FloatArray, rotation: FloatArray | None, frames: _Frames, metres_per_rad: float
) -> FloatArray:
    """Return the step of (R_1, t_1, R_2, t_2), (12,), in rad and m; the y of t_2 does not move."""
    carried = frames.outer_rotation @ poses.rotation
    arm = (poses.position_m + poses.rotation @ frames.inner_translation) @ frames.outer_rotation.T
    centre = np.nanmean(arm, axis=0)  # turning about the middle of the poses keeps the columns apart
    residual = _position_residual(poses, position_m, frames)
    n, eye = len(poses), np.eye(3)
    jacobian = np.zeros((n, 3, 12))
    jacobian[:, :, 0:3], jacobian[:, :, 3:6] = -_skew(arm - centre), eye
    jacobian[:, :, 9:12] = carried
    jacobian[:, :, 10] = 0.0
    equations = [(jacobian, residual)]
    if rotation is not None:
        turned = np.zeros((n, 3, 12))
        turned[:, :, 0:3], turned[:, :, 6:9] = eye, carried
        equations.append((metres_per_rad * turned, metres_per_rad * _rotation_residual(poses, rotation, frames)))
    scale = max(robust_sigma(np.concatenate([values for _, values in equations])), 1e-12)
    weighted = [_weighted(*equation, scale) for equation in equations]
    rows, targets = (np.concatenate(parts) for parts in zip(*weighted, strict=True))
    norms = np.linalg.norm(rows, axis=0)
    norms[norms == 0.0] = 1.0
    step: FloatArray = np.linalg.lstsq(rows / norms, targets, rcond=1e-9)[0] / norms
    step[3:6] -= np.cross(step[0:3], centre)  # back to turning about the tracker's origin
    return step


def _weighted(jacobian: FloatArray, residual: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return the known equations, each row by the root of Huber's weight of its length."""
    known = np.isfinite(residual) & np.isfinite(jacobian).all(axis=2)
    filled = np.where(known, residual, 0.0)
    length = np.sqrt((filled**2).sum(axis=1) / np.maximum(known.sum(axis=1), 1))
    weight = (_HUBER * scale / np.maximum(length, _HUBER * scale)) ** 0.5
    weights = np.broadcast_to(weight[:, None], known.shape)[known]
    return jacobian[known] * weights[:, None], residual[known] * weights
