r"""Starts of a fit of the two outer frames: from anywhere, for any robot, despite single wrong rows.

With R_1, t_1 and R_2, t_2 the outer frames, R, p the pose of a row, s and S what is measured of it, and A = R_1ᵀ,

.. math:: A s = p + R t_2 + c, \qquad R^T A S = R_2

For a given A, c and t_2 are linear and R_2 is a mean. Eliminating them leaves a quadratic form of the nine entries of A
(in robotics the problem is known as AX = YB). Newton's method minimises it over all rotations from the 24 rotations
that map axes to axes; after a few steps only the better ones continue. No matrix is inverted that few, flat or
straight poses make singular. The form is made of all rows, and of small sets of rows drawn at random, some of which
contain no gross error; the absolute misfit of all rows then ranks the results (least squares of random sets: Fischler &
Bolles, CACM 24, 1981).
"""

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.io.seeds import FRAMES_SEED
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, evenly_spaced
from pouring_robot.mechanism.rotations import nearest_rotations, rotation_matrices, skew

FEWEST_FOR_FRAMES = 6  # fewest rows for a fit of the frames
CUBE_ROTATIONS: FloatArray = Rotation.create_group("O").as_matrix()
"""The 24 rotations that map axes to axes, (24, 3, 3): no rotation is far from the nearest of them."""
_MOST_ROWS = 400  # a start needs no more
_SETS = 32  # of six rows; with a quarter of the rows wrong, every set contains a wrong one once in 500 times
_STEPS = 20
_KEPT = {1: 8, 3: 4}  # how many of the 24, those of least misfit, continue after so many steps
_CONVERGED = 1e-9  # rad: the next step would be its square
_LONGEST_TURN = 0.7  # rad: beyond it a quadratic is a poor model of rotations
_APART = 0.15  # distance of matrices, 0.1 rad: nearer starts count as the same
_MOST_STARTS = 3
TURNING = 1e-6  # root mean square of the variation of rotation matrices: no instrument sees less
_ROUND_OFF = 1e-9


def frame_starts(poses: PoseStack, measured: PoseStack, metres_per_rad: float) -> list[OuterFrames]:
    """Return up to three different starts, the best first; rotations weigh ``metres_per_rad`` against positions.

    Poses of the moving platform in the fixed one are complete; measured poses, of the target in the tracker frame, have
    NaN rotations where these are missing.
    """
    chosen = evenly_spaced(len(poses), _MOST_ROWS)
    there, seen = poses[chosen], measured[chosen]
    middle, centre = np.median(seen.position_m, axis=0), np.median(there.position_m, axis=0)
    # All rows, and sets of six drawn at random.
    drawn = np.random.default_rng(FRAMES_SEED).random((_SETS, len(chosen))).argsort(axis=1).argsort(axis=1)
    sets = np.vstack([np.ones(len(chosen)), drawn < FEWEST_FOR_FRAMES])
    form = _Form(
        PoseStack(there.position_m - centre, there.rotation),
        PoseStack(seen.position_m - middle, seen.rotation),
        metres_per_rad,
        sets,
    )
    rotations = form.least()
    misfit, constants, inner, inner_rotation = form.rest(rotations)
    starts: list[OuterFrames] = []
    for k in np.argsort(misfit):
        outer = rotations[k].T
        if all(np.linalg.norm(other.T_tracker_base.rotation - outer) > _APART for other in starts):
            place = outer @ (constants[k] - centre) + middle
            starts.append(OuterFrames(pin.SE3(outer, place), pin.SE3(inner_rotation[k], inner[k])))
        if len(starts) == _MOST_STARTS:
            break
    return starts


def affine_map(poses: PoseStack, position_m: FloatArray, rows: BoolArray) -> tuple[FloatArray, float]:
    """Return the best affine map from fixed-platform to tracker axes, (3, 3), and how well the poses determine it.

    A sound campaign gives a rotation; mirrored axes give a negative determinant. The second value is the ratio of the
    least to the largest singular value of the part of the poses' positions that their rotations do not explain: below
    0.01 the map is poorly determined.
    """
    p, r = poses.position_m[rows], poses.rotation[rows].reshape(-1, 9)
    p, r = p - p.mean(axis=0), r - r.mean(axis=0)
    left, varying, _ = np.linalg.svd(r, full_matrices=False)
    turns = left[:, varying > TURNING * np.sqrt(len(r))]
    design = np.column_stack([p, turns, np.ones(len(p))])
    rest = p - turns @ (turns.T @ p)
    singular = np.linalg.svd(rest, compute_uv=False)
    spread = float(singular[-1] / singular[0]) if len(p) > design.shape[1] and singular[0] > 0.0 else 0.0
    return _robust_linear(design, position_m[rows])[:3].T, spread


def _robust_linear(design: FloatArray, target: FloatArray) -> FloatArray:
    """Solve design @ solution = target with rows weighted by one over their misfit (least absolute deviations)."""
    weight = np.ones(len(design))
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0.0] = 1.0
    for _ in range(25):
        root = np.sqrt(weight)[:, None]
        solution: FloatArray = np.linalg.lstsq(root * design / scale, root * target, rcond=1e-9)[0] / scale[:, None]
        misfit = np.linalg.norm(target - design @ solution, axis=1)
        weight = 1.0 / np.maximum(misfit, 1e-3 * np.median(misfit) + 1e-12)
        weight /= weight.max()
    return solution


def _positive(matrices: FloatArray) -> BoolArray:
    """Return which symmetric matrices (..., 3, 3) are positive definite: their leading minors are positive.

    For many small matrices eigenvalues take twenty times as long.
    """
    a, b, c = (matrices[..., 0, k] for k in range(3))
    d, e, f = matrices[..., 1, 1], matrices[..., 1, 2], matrices[..., 2, 2]
    second = a * d - b * b
    whole = f * second - a * e * e + c * (2.0 * b * e - c * d)
    return np.asarray((a > 0.0) & (second > 0.0) & (whole > 0.0))


class _Form:
    """The quadratic forms of A, one for each set of rows: their sum of squares with the best c, t_2 and R_2.

    They serve :func:`frame_starts` for n rows; ``sets`` holds the weights of the rows in each set, (K, n).
    """

    def __init__(self, poses: PoseStack, measured: PoseStack, metres_per_rad: float, sets: FloatArray) -> None:
        n, self.metres_per_rad = len(poses), metres_per_rad
        # Equations of a row: (A s - R t_2 - p) - c, by the entries of A, by t_2 and by one.
        self.rows = np.zeros((n, 3, 13))
        self.rows[:, :, :9] = np.kron(np.eye(3), measured.position_m[:, None])
        self.rows[:, :, 9:12], self.rows[:, :, 12] = -poses.rotation, -poses.position_m
        weight = sets.sum(axis=1)
        self.mean = np.einsum("kn,nij->kij", sets, self.rows, optimize=True) / weight[:, None, None]
        squares = np.einsum("nij,nil->njl", self.rows, self.rows).reshape(n, -1)
        gram = (sets @ squares).reshape(-1, 13, 13)
        gram -= weight[:, None, None] * np.swapaxes(self.mean, 1, 2) @ self.mean  # with the best c
        size, frame = np.linalg.eigh(gram[:, 9:12, 9:12])
        # t_2 is determined by the variation of the rotations, whose entries are of size one.
        varies = size > TURNING**2 * weight[:, None]
        inverse = (frame * (varies / np.where(varies, size, 1.0))[:, None]) @ np.swapaxes(frame, 1, 2)
        kept = [*range(9), 12]
        self.to_inner = -inverse @ gram[:, 9:12, kept]
        reduced = gram[:, kept][:, :, kept] + gram[:, kept, 9:12] @ self.to_inner
        self.matrix, self.vector = reduced[:, :9, :9], -reduced[:, :9, 9]
        # Rᵀ A S is R_2 of a row; entry by entry it is (Rᵀ ⊗ Sᵀ) times those of A.
        known = np.isfinite(measured.rotation).all(axis=(1, 2))
        turns = np.einsum("nji,nlk->nikjl", poses.rotation[known], measured.rotation[known]).reshape(-1, 81)
        counts = np.maximum(sets[:, known].sum(axis=1), 1.0)[:, None, None]
        self.turns = turns.reshape(-1, 9, 9)
        self.mean_turn = (sets[:, known] @ turns).reshape(-1, 9, 9) / counts
        scatter = np.eye(9) - np.swapaxes(self.mean_turn, 1, 2) @ self.mean_turn
        self.matrix = self.matrix + 0.5 * metres_per_rad**2 * counts * scatter * known.any()

    def least(self) -> FloatArray:
        """Return the rotation A with the least sum of squares for each set, (K, 3, 3)."""
        sets, axes = len(self.matrix), skew(np.eye(3))
        # Derivative of a small rotation of A about each axis, by the entries of A; and its second-order curvature term.
        turned = np.concatenate([np.kron(np.eye(3), axis) for axis in axes], axis=1)
        twice = 0.5 * (axes[:, None] @ axes + axes @ axes[:, None])
        floor = _ROUND_OFF * np.trace(self.matrix, axis1=1, axis2=2)[:, None, None] + np.finfo(float).tiny
        flat = np.tile(CUBE_ROTATIONS.reshape(-1, 9), (sets, 1, 1))
        still = np.arange(sets)  # in the other sets every start has converged
        for steps in range(_STEPS):
            if steps in _KEPT:
                least = np.argsort(self._cost(flat), axis=1)[:, : _KEPT[steps], None]
                flat = np.take_along_axis(flat, least, axis=1)
            now, matrix = flat[still], self.matrix[still]
            rotation = now.reshape(still.size, -1, 3, 3)
            slope = now @ matrix - self.vector[still, None]
            along = (now @ turned).reshape(still.size, -1, 9)
            back = np.swapaxes(rotation, 2, 3) @ slope.reshape(rotation.shape)
            back = back.reshape(now.shape)
            gradient = back @ axes.reshape(3, 9).T
            seen = (along @ matrix).reshape(*rotation.shape[:3], 9)
            curvature = seen @ np.swapaxes(along.reshape(seen.shape), 2, 3)
            whole = curvature + (back @ twice.reshape(9, 9).T).reshape(rotation.shape)
            # Always downhill: where the whole curvature is not positive, that of the squares alone is used.
            chosen = np.where(_positive(whole)[..., None, None], whole, curvature)
            chosen += floor[still, ..., None] * np.eye(3)
            step = -np.linalg.solve(chosen, gradient[..., None])[..., 0]
            length = np.linalg.norm(step, axis=-1, keepdims=True)
            turn = rotation_matrices(step * np.minimum(1.0, _LONGEST_TURN / np.maximum(length, 1e-12)))
            flat[still] = (rotation @ turn).reshape(now.shape)
            if steps >= max(_KEPT):
                still = still[length.max(axis=(1, 2)) > _CONVERGED]
            if not still.size:
                break
        best = np.argmin(self._cost(flat), axis=1)
        return np.asarray(flat[np.arange(sets), best].reshape(-1, 3, 3))

    def _cost(self, flat: FloatArray) -> FloatArray:
        """Return the sums of squares, (K, s), of rotations by their entries, (K, s, 9), less a constant of the set."""
        return np.asarray(((flat @ self.matrix - 2.0 * self.vector[:, None]) * flat).sum(axis=-1))

    def rest(self, rotations: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the absolute misfit of all rows, (K,), in m, and c (K, 3), t_2 (K, 3), R_2 (K, 3, 3) for given A."""
        flat = rotations.reshape(-1, 9)
        one = np.ones((len(flat), 1))
        inner = (self.to_inner @ np.concatenate([flat, one], axis=1)[..., None])[..., 0]
        values = np.concatenate([flat, inner, one], axis=1)
        constants = (self.mean @ values[..., None])[..., 0]
        residual = np.einsum("nij,kj->kni", self.rows, values, optimize=True) - constants[:, None]
        misfit = np.linalg.norm(residual, axis=2).sum(axis=1)
        if not len(self.turns):
            return misfit, constants, inner, np.tile(np.eye(3), (len(flat), 1, 1))
        inner_rotation = nearest_rotations((self.mean_turn @ flat[..., None]).reshape(-1, 3, 3))
        turned = np.einsum("nij,kj->kni", self.turns, flat, optimize=True) - inner_rotation.reshape(-1, 1, 9)
        misfit = misfit + np.sqrt(0.5) * self.metres_per_rad * np.linalg.norm(turned, axis=2).sum(axis=1)
        return misfit, constants, inner, inner_rotation
