"""The two outer frames nobody knows: tracker → fixed platform, and moving platform → target.

    seen = T_tracker_base ∘ X ∘ T_end_target

X is the pose of the moving platform (end) in the fixed platform (base). :class:`OuterFrames` carries poses to the
tracker and says how they move with the frames: the one Jacobian of the frames that checks, calibration, design and
diagnosis use. :func:`fit_frames` fits both robustly. With R_1, t_1 and R_2, t_2 the two frames and R, p a row's X:

    position  t_1 + R_1 (p + R t_2)          rotation  R_1 R R_2

The platform turns about y only, so the y coordinate of t_2 and the place of the fixed platform along its own y cannot
be told apart: :func:`fit_frames` gives t_2 a y of 0. Positions alone leave R_2 open; it is then the unit rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.exceptions import FrameFitError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import COMPONENTS, FrameParameter
from pouring_robot.mechanism.rotations import right_jacobian, rotation_matrices, skew

FRAME_PARAMETERS: tuple[FrameParameter, ...] = (
    *(FrameParameter("base", component) for component in COMPONENTS),
    *(FrameParameter("tool", component) for component in COMPONENTS),
)
"""The twelve unknowns of the two outer frames, first in every vector of unknowns."""
FRAMES = len(FRAME_PARAMETERS)
FEWEST_ROWS = 6
"""Rows that a fit of the frames needs at the least."""
_MAD_TO_SIGMA = 1.4826
_HUBER = 1.5
_STEPS = 60
_LONGEST_STEP = 1e7
_HELD = 7  # place of the target along the tilt axis among the unknowns of the frames
_SPREAD = 1e-2  # below it the affine map says little


@dataclass(frozen=True, eq=False)
class OuterFrames:
    """Where the tracker sees the fixed platform, and where the target sits on the moving one.

    Attributes:
        T_tracker_base: pose of the fixed platform in the tracker frame.
        T_end_target: pose of the target in the moving platform.
    """

    T_tracker_base: pin.SE3
    T_end_target: pin.SE3

    def moved(self, values: FloatArray) -> OuterFrames:
        """Return the frames displaced by the twelve unknowns of :data:`FRAME_PARAMETERS`, (12,), in m and rad.

        The base is displaced in its own axes, the target in those of the moving platform: T_tracker_base ∘ D(base)
        and D(tool) ∘ T_end_target with D(v, w) = SE3(exp(w), v).
        """
        base, tool = (pin.SE3(pin.exp3(part[3:]), part[:3]) for part in (values[:6], values[6:12]))
        return OuterFrames(self.T_tracker_base * base, tool * self.T_end_target)

    def seen(self, poses: PoseStack, base: FloatArray | None = None, scale: FloatArray | None = None) -> PoseStack:
        """Return the poses the tracker should see.

        Args:
            poses: n poses of the moving platform in the fixed platform.
            base: displacement of the fixed platform in its own axes, row by row, (n, 6), in m and rad.
            scale: relative error of the tracker's scale, (n,); positions count 1 + scale times, about its own origin.
        """
        outer, turned = self.T_tracker_base, self._turned(base)
        position = outer.translation + (turned @ self._arm(poses)[..., None])[..., 0]
        if base is not None:
            position += base[:, :3] @ outer.rotation.T
        if scale is not None:
            position *= 1.0 + scale[:, None]
        return PoseStack(position, turned @ poses.rotation @ self.T_end_target.rotation)

    def jacobian(self, poses: PoseStack, base: FloatArray | None = None) -> FloatArray:
        """Return how what is seen moves with :data:`FRAME_PARAMETERS` at zero, (n, 6, 12); see :meth:`seen`.

        Displacement of the target's origin (m) and rotation vector (rad), both in tracker axes, per m and rad.
        """
        turned, tool = self._turned(base), self.T_end_target.translation
        carried = turned @ poses.rotation
        jacobian = np.zeros((len(poses), 6, FRAMES))
        jacobian[:, :3, 0:3] = self.T_tracker_base.rotation
        jacobian[:, :3, 3:6] = -turned @ skew(self._arm(poses))
        jacobian[:, 3:, 3:6] = turned
        jacobian[:, :3, 6:9] = carried
        jacobian[:, :3, 9:12] = -carried @ skew(tool)
        jacobian[:, 3:, 9:12] = carried
        return jacobian

    def carried(self, matrix: FloatArray, poses: PoseStack, base: FloatArray | None = None) -> FloatArray:
        """Return columns of G, (n, 6, P), carried from the moving platform to the target, in tracker axes."""
        turned = self._turned(base)
        lever = poses.rotation @ self.T_end_target.translation
        shifted = matrix[:, :3] - skew(lever) @ matrix[:, 3:]
        return np.concatenate([turned @ shifted, turned @ matrix[:, 3:]], axis=1)

    def _turned(self, base: FloatArray | None) -> FloatArray:
        rotation: FloatArray = self.T_tracker_base.rotation
        return rotation if base is None else rotation @ rotation_matrices(base[:, 3:])

    def _arm(self, poses: PoseStack) -> FloatArray:
        """Return the target in the fixed platform, (n, 3), in m."""
        return np.asarray(poses.position_m + poses.rotation @ self.T_end_target.translation)


def displaced_columns(values: FloatArray) -> FloatArray:
    """Return ∂(unknowns at zero)/∂(unknowns at ``values``) of the frames, (12, 12): J at values is J at zero times it.

    J at zero is that of the frames already moved by ``values``, (12,), in m and rad. exp(w + dw) turns by the right
    Jacobian of w in turned axes, by the left one in the axes before.
    """
    chain, turn = np.eye(FRAMES), values[9:12]
    left = right_jacobian(-turn)  # the left Jacobian of w is the right one of -w
    chain[0:3, 0:3] = pin.exp3(values[3:6]).T
    chain[3:6, 3:6] = right_jacobian(values[3:6])
    chain[6:9, 9:12] = skew(values[6:9]) @ left
    chain[9:12, 9:12] = left
    return chain


@dataclass(frozen=True, eq=False)
class FrameFit:
    """The two fitted frames and what they leave over.

    Attributes:
        frames: the two; y of the target's origin is 0 (see the module).
        position_residual_m: (n, 3) measured minus fitted position in tracker axes, in m; NaN where missing.
        rotation_residual_rad: (n, 3) rotation vector from fitted to measured, in tracker axes, in rad; NaN where
            missing; None for positions only.
        position_scale_m: robust standard deviation of a position coordinate, in m.
        rotation_scale_rad: robust standard deviation of a rotation component, in rad; None for positions only.
    """

    frames: OuterFrames
    position_residual_m: FloatArray
    rotation_residual_rad: FloatArray | None
    position_scale_m: float
    rotation_scale_rad: float | None

    def to_fixed_platform(self, vectors: FloatArray) -> FloatArray:
        """Turn vectors (n, 3) from tracker axes into the axes of the fixed platform."""
        turned: FloatArray = vectors @ self.frames.T_tracker_base.rotation
        return turned


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
    complete = poses.complete & np.isfinite(position_m).all(axis=1)
    if complete.sum() < FEWEST_ROWS:
        raise FrameFitError(int(complete.sum()), FEWEST_ROWS)
    unturned = PoseStack(position_m, np.full((len(poses), 3, 3), np.nan))
    tried: list[tuple[float, OuterFrames]] = []
    for start in _starts(poses, position_m, complete):
        frames = _refine(poses, unturned, start, metres_per_rad)
        left = np.linalg.norm(position_m - frames.seen(poses).position_m, axis=1)
        tried.append((float(np.nanmedian(left)), frames))
    frames = min(tried, key=lambda one: one[0])[1]
    if rotation is None or not np.isfinite(rotation).any():
        return _fit_of(poses, unturned, frames, turned=False)
    measured = PoseStack(position_m, rotation)
    frames = _refine(poses, measured, _with_inner_rotation(poses, rotation, frames), metres_per_rad)
    return _fit_of(poses, measured, frames, turned=True)


def _fit_of(poses: PoseStack, measured: PoseStack, frames: OuterFrames, *, turned: bool) -> FrameFit:
    residual = measured.difference(frames.seen(poses))
    position, turn = residual[:, :3], residual[:, 3:] if turned else None
    return FrameFit(frames, position, turn, robust_sigma(position), None if turn is None else robust_sigma(turn))


def rotation_misfit(poses: PoseStack, rotation: FloatArray, frames: OuterFrames) -> FloatArray:
    """Return the rotation residual (n, 3), in rad, with R_1 held as fitted to the positions and R_2 fitted anew."""
    seen = _with_inner_rotation(poses, rotation, frames).seen(poses)
    return PoseStack(seen.position_m, rotation).difference(seen)[:, 3:]


# --- where to start -----------------------------------------------------------------------------------------------


def _starts(poses: PoseStack, position_m: FloatArray, rows: NDArray[np.bool_]) -> list[OuterFrames]:
    """Return frames to start from.

    Written out, the position is linear in R_1, in R_1 t_2 and in t_1: R_1 without its orthogonality is a least-squares
    problem. Only where the poses lie so that it is ill-conditioned (all in a line or a plane) the 24 rotations
    that take axes into axes are tried too.
    """
    affine, spread = affine_map(poses, position_m, rows)
    u, _, vt = np.linalg.svd(affine)
    outer = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    turns = [np.eye(3)]
    if spread <= _SPREAD:
        turns += list(Rotation.create_group("O").as_matrix())
    return [_from_rotation(poses, position_m, rows, outer @ turn) for turn in turns]


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


def _from_rotation(poses: PoseStack, position_m: FloatArray, rows: NDArray[np.bool_], outer: FloatArray) -> OuterFrames:
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
    inner = pin.SE3(np.eye(3), np.array([solution[2], 0.0, solution[3]]))
    return OuterFrames(pin.SE3(outer, outer @ constant), inner)


def _with_inner_rotation(poses: PoseStack, rotation: FloatArray, frames: OuterFrames) -> OuterFrames:
    """Return the frames with R_2 as the robust mean of what each row says of it."""
    seen = np.swapaxes(frames.T_tracker_base.rotation @ poses.rotation, 1, 2) @ rotation
    seen = seen[np.isfinite(seen).all(axis=(1, 2))]
    weight = np.ones(len(seen))
    mean = Rotation.identity()
    for _ in range(15):
        mean = Rotation.from_matrix(seen).mean(weight)
        angle = (mean.inv() * Rotation.from_matrix(seen)).magnitude()
        weight = 1.0 / np.maximum(angle, 1e-3 * np.median(angle) + 1e-12)
        weight /= weight.max()
    return OuterFrames(frames.T_tracker_base, pin.SE3(mean.as_matrix(), frames.T_end_target.translation))


# --- Gauss-Newton ---------------------------------------------------------------------------------------------------


def _refine(poses: PoseStack, measured: PoseStack, frames: OuterFrames, metres_per_rad: float) -> OuterFrames:
    """Run Gauss-Newton with Huber weights, a row's position and rotation judged apart."""
    for _ in range(_STEPS):
        step = _step(poses, measured, frames, metres_per_rad)
        if not np.abs(step).max() < _LONGEST_STEP:  # poses that do not determine the frames at all
            break
        tool = frames.T_end_target
        inner = pin.SE3(pin.exp3(step[9:12]) @ tool.rotation, tool.translation + step[6:9])
        base = pin.SE3(pin.exp3(step[3:6]), step[:3])
        frames = OuterFrames(frames.T_tracker_base * base, inner)
        if np.abs(step).max() < 1e-8:
            break
    return frames


def _step(poses: PoseStack, measured: PoseStack, frames: OuterFrames, metres_per_rad: float) -> FloatArray:
    """Return the step of the base (in its own axes), of t_2 and of R_2, (12,), in m and rad; y of t_2 stays."""
    middle = np.nanmean(frames._arm(poses), axis=0)  # turning about the middle of the poses keeps the columns apart
    columns = np.eye(FRAMES)
    columns[0:3, 3:6], columns[6:9, 9:12] = skew(middle), skew(frames.T_end_target.translation)
    jacobian = frames.jacobian(poses) @ columns
    jacobian[:, :, _HELD] = 0.0
    residual = measured.difference(frames.seen(poses))
    residual[:, 3:], jacobian[:, 3:] = metres_per_rad * residual[:, 3:], metres_per_rad * jacobian[:, 3:]
    scale = max(robust_sigma(residual), 1e-12)
    weighted = [_weighted(jacobian[:, part], residual[:, part], scale) for part in (slice(0, 3), slice(3, 6))]
    rows, targets = (np.concatenate(parts) for parts in zip(*weighted, strict=True))
    norms = np.linalg.norm(rows, axis=0)
    norms[norms == 0.0] = 1.0
    step: FloatArray = np.linalg.lstsq(rows / norms, targets, rcond=1e-9)[0] / norms
    step[_HELD] = 0.0
    step[0:3] += np.cross(middle, step[3:6])  # back to turning about the origin of the fixed platform
    return step


def _weighted(jacobian: FloatArray, residual: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return the known equations, each row by the root of Huber's weight of its length."""
    known = np.isfinite(residual) & np.isfinite(jacobian).all(axis=2)
    filled = np.where(known, residual, 0.0)
    length = np.sqrt((filled**2).sum(axis=1) / np.maximum(known.sum(axis=1), 1))
    weight = (_HUBER * scale / np.maximum(length, _HUBER * scale)) ** 0.5
    weights = np.broadcast_to(weight[:, None], known.shape)[known]
    return jacobian[known] * weights[:, None], residual[known] * weights
