"""The fit of the two outer frames to what was measured: robust, for any robot, from anywhere.

Directions of the twelve unknowns that the poses do not determine are found and held. A platform that turns only about y
leaves the y coordinate of t_2 open against the position of the base along its own y: t_2 then has a y of 0. Positions
alone leave R_2 open; it is then the identity. :class:`FrameFit` names what is held.

A direction of the unknowns counts as undetermined when the misfit hides it. Let J be the Jacobian, with positions
divided by the misfit of positions, rotations by that of rotations, and unknown lengths in units of the spread of the
target's positions; let σ be its singular values over the root of the number of rows. The poses themselves are known no
better than the misfit, so every σ is uncertain by one (Weyl's inequality). The worst misfit moves the unknowns by 1/σ:
with σ < 1 by more than a radian or the whole spread.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin
import scipy.linalg

from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames.outer import FRAME_PARAMETERS, FRAMES, OuterFrames
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES, frame_starts
from pouring_robot.estimation.robust import PRELIMINARY_HUBER_BOUND, huber_weights
from pouring_robot.exceptions import FrameFitError
from pouring_robot.mechanism.arrays import FloatArray, robust_sigma
from pouring_robot.mechanism.rotations import skew

RESOLUTION = 1e-6
"""Least misfit, relative to the spread and in rad: no instrument reads finer, so no data show anything smaller."""
_TURNS = 0.1  # rad for a shift by the spread: a direction that turns less counts as a shift
_STEPS, _TRIAL_STEPS = 60, 8
_CONVERGED = 1e-8
_WORSE, _HALVINGS = 1.1, 12  # near the solution the weights, not the steps, increase the misfit a little


@dataclass(frozen=True, eq=False)
class FrameFit:
    """The two fitted frames and their residuals."""

    frames: OuterFrames  # the two
    # what the data do not determine: combinations of :data:`FRAME_PARAMETERS`, by name and in m and rad, that change
    # nothing that is measured. The first name of each is held: the position of the target is 0 along it, a rotation
    # stays where the fit started, for positions only at the identity.
    undetermined: tuple[dict[str, float], ...]
    position_residual_m: FloatArray  # (n, 3) measured minus fitted position in tracker axes, in m; NaN where missing
    rotation_residual_rad: FloatArray | None  # (n, 3) rotation vectors, in rad, likewise; None for positions only
    position_scale_m: float  # robust standard deviation of a position coordinate, in m
    rotation_scale_rad: float | None  # robust standard deviation of a rotation component, in rad; None likewise


def fit_frames(
    poses: PoseStack,
    position_m: FloatArray,
    rotation: FloatArray | None = None,
    metres_per_rad: float = 1.0,
    *,
    rough: bool = False,
) -> FrameFit:
    """Fit both frames by iteratively reweighted least squares (Huber), so that single wrong rows have little influence.

    Args:
        poses: of the moving platform in the fixed platform; NaN rows do not count.
        position_m: measured, (n, 3), in m; missing coordinates NaN.
        rotation: measured, (n, 3, 3); NaN where missing. None: positions only.
        metres_per_rad: how rotations weigh against positions: noise of a coordinate over noise of a rotation
            component, in m. If it were fitted too, one of the two would be fitted at the cost of the other.
        rough: stay at the best start, for a quarter of the time; undetermined directions are then not searched for.

    Raises:
        FrameFitError: fewer than :data:`FEWEST_FOR_FRAMES` rows have a pose and a complete position.
    """
    turned = rotation if rotation is not None else np.full((len(poses), 3, 3), np.nan)
    fit = _Fit(poses, PoseStack(position_m, turned), metres_per_rad)
    if rough:
        return fit.at(min(fit.starts(), key=fit.absolute_misfit), ())
    tried = [fit.refined(start, fit.undetermined(start), _TRIAL_STEPS) for start in fit.starts()]
    frames = min(tried, key=fit.absolute_misfit)
    misfit_m, misfit_rad = (robust_sigma(part) for part in fit.residual(frames))
    held = fit.undetermined(frames, misfit_m, misfit_rad)
    frames = fit.refined(held.zeroed(frames), held)
    return fit.at(frames, fit.undetermined(frames, misfit_m, misfit_rad).named())


@dataclass(frozen=True, eq=False)
class _Axes:
    """Twelve nearly decoupled unknowns, with lengths in units of the spread of the target's positions.

    The base turns about the mean of these, the target about its own origin.
    """

    middle: FloatArray  # mean of the target's positions in the base, (3,), in m
    length: float  # root mean square of their distances from it, in m
    inner: FloatArray  # position of the target in the moving platform, (3,), in m

    @classmethod
    def of(cls, frames: OuterFrames, poses: PoseStack) -> Self:
        """Return the unknowns for given frames and complete poses."""
        places = frames.places(poses)
        middle = places.mean(axis=0)
        spread = float(np.sqrt(((places - middle) ** 2).sum(axis=1).mean()))
        return cls(middle, spread or 1.0, np.array(frames.T_end_target.translation))

    @property
    def columns(self) -> FloatArray:
        """Displacements of :data:`FRAME_PARAMETERS`, (12, 12), in m and rad, for a unit of each."""
        columns = np.eye(FRAMES)
        columns[0:3, 3:6], columns[6:9, 9:12] = skew(self.middle), skew(self.inner)
        columns[:, [0, 1, 2, 6, 7, 8]] *= self.length
        return columns

    def moved(self, frames: OuterFrames, values: FloatArray) -> OuterFrames:
        """Return displaced frames; turning the target never shifts it, so what is held of its position stays."""
        base, tool = values[:6], values[6:]
        shift = self.length * base[:3] + np.cross(self.middle, base[3:])
        inner = pin.SE3(pin.exp3(tool[3:]) @ frames.T_end_target.rotation, self.inner + self.length * tool[:3])
        return OuterFrames(frames.T_tracker_base * pin.SE3(pin.exp3(base[3:]), shift), inner)


@dataclass(frozen=True, eq=False)
class _Undetermined:
    """Directions of the frames that the data do not determine."""

    axes: _Axes  # the unknowns in which they are expressed
    base: FloatArray  # (6, k) orthonormal directions of the base that have no visible effect
    tool: FloatArray  # (6, l) orthonormal directions of the target that have none if the base compensates them
    answer: FloatArray  # (6, l) how the base compensates them

    @property
    def free(self) -> FloatArray:
        """Projector (12, 12) of the unknowns onto what is not held."""
        held = scipy.linalg.block_diag(self.base @ self.base.T, self.tool @ self.tool.T)
        return np.asarray(np.eye(FRAMES) - held)

    def zeroed(self, frames: OuterFrames) -> OuterFrames:
        """Return the frames with the target's position at zero along the undetermined shifts that turn nothing."""
        _, turned, shares = np.linalg.svd(np.concatenate([self.tool[3:], self.answer[3:]]))
        shares = shares[turned < _TURNS].T
        shifts = self.tool[:3] @ shares
        along = shifts.T @ self.axes.inner
        back = shares @ along / -self.axes.length
        moved = self.axes.moved(frames, np.concatenate([self.answer @ back, np.zeros(3), self.tool[3:] @ back]))
        inner = pin.SE3(moved.T_end_target.rotation, self.axes.inner - shifts @ along)
        return OuterFrames(moved.T_tracker_base, inner)

    def named(self) -> tuple[dict[str, float], ...]:
        """Return the directions by names of :data:`FRAME_PARAMETERS`, in m and rad, the one held first."""
        base, tool = _led(self.base), _led(self.tool)
        alone = np.concatenate([base, np.zeros_like(base)])
        both = np.concatenate([self.answer @ self.tool.T @ tool, tool])
        return tuple(self._shares(direction) for direction in (*both.T, *alone.T))

    def _shares(self, direction: FloatArray) -> dict[str, float]:
        held = direction.copy()
        held[:6] *= not direction[6:].any()
        lead = int(np.argmax(np.isclose(held, 1.0)))
        values = self.axes.columns @ direction
        values /= values[lead]
        order = [lead, *(k for k in range(FRAMES) if k != lead)]
        return {FRAME_PARAMETERS[k].name: float(values[k]) for k in order if abs(values[k]) > RESOLUTION}


def _led(directions: FloatArray) -> FloatArray:
    """Return directions (6, k) that span the same space, each 1 in an entry where the others are zero."""
    if not directions.shape[1]:
        return directions
    leads = np.sort(scipy.linalg.qr(directions.T, pivoting=True)[2][: directions.shape[1]])
    led = directions @ np.linalg.inv(directions[leads])
    return np.asarray(np.where(np.abs(led) > RESOLUTION, led, 0.0))


class _Fit:
    """The search, for one campaign; see :func:`fit_frames`."""

    def __init__(self, poses: PoseStack, measured: PoseStack, metres_per_rad: float) -> None:
        self.poses, self.measured, self.metres_per_rad = poses, measured, metres_per_rad
        self.complete, self.turned = poses[poses.complete], bool(np.isfinite(measured.rotation).any())

    def starts(self) -> list[OuterFrames]:
        """Return where the search starts, the best first."""
        complete = self.poses.complete & np.isfinite(self.measured.position_m).all(axis=1)
        if complete.sum() < FEWEST_FOR_FRAMES:
            raise FrameFitError(int(complete.sum()), FEWEST_FOR_FRAMES)
        return frame_starts(self.poses[complete], self.measured[complete], self.metres_per_rad)

    def at(self, frames: OuterFrames, undetermined: tuple[dict[str, float], ...]) -> FrameFit:
        """Return the frames with their residuals."""
        position, turn = self.residual(frames)
        if not self.turned:
            return FrameFit(frames, undetermined, position, None, robust_sigma(position), None)
        return FrameFit(frames, undetermined, position, turn, robust_sigma(position), robust_sigma(turn))

    def residual(self, frames: OuterFrames) -> tuple[FloatArray, FloatArray]:
        """Return measured minus expected positions, (n, 3) in m, and rotations, (n, 3) in rad; NaN if not measured."""
        if not self.turned:  # rotations would take most of the time, for nothing
            return self.measured.position_m - frames.seen_places(self.poses), np.full((len(self.poses), 3), np.nan)
        residual = self.measured.difference(frames.seen(self.poses))
        return residual[:, :3], residual[:, 3:]

    def absolute_misfit(self, frames: OuterFrames) -> float:
        """Return the sum of the rows' distances, in m; angles count by ``metres_per_rad``."""
        return self._size(self.residual(frames))

    def _size(self, residual: tuple[FloatArray, FloatArray]) -> float:
        position, turn = (np.nansum(np.linalg.norm(part, axis=1)) for part in residual)
        return float(position + self.metres_per_rad * turn)

    def undetermined(self, frames: OuterFrames, misfit_m: float = 0.0, misfit_rad: float = 0.0) -> _Undetermined:
        """Return what the data do not determine, given the misfit: directions with σ below one; see the module."""
        axes = _Axes.of(frames, self.complete)
        jacobian = frames.jacobian(self.poses) @ axes.columns
        jacobian[:, :3] /= max(misfit_m, RESOLUTION * axes.length)
        jacobian[:, 3:] /= max(misfit_rad, RESOLUTION)
        measured = np.isfinite(np.concatenate([self.measured.position_m, self.measured.rotation[:, 0]], axis=1))
        rows = jacobian[measured & np.isfinite(jacobian).all(axis=2)]
        compact = np.asarray(np.linalg.qr(rows / np.sqrt(len(self.poses)), mode="r"))
        left, sizes, right = np.linalg.svd(compact[:, :6], full_matrices=False)
        known = sizes >= 1.0
        projected = left[:, known].T @ compact[:, 6:]
        _, hidden, turned = np.linalg.svd(compact[:, 6:] - left[:, known] @ projected)
        tool = _clean(turned[hidden < 1.0].T)
        answer = -(right[known].T / sizes[known]) @ projected @ tool
        return _Undetermined(axes, _clean(right[~known].T), tool, answer)

    def refined(self, frames: OuterFrames, held: _Undetermined, steps: int = _STEPS) -> OuterFrames:
        """Run Gauss-Newton with Huber weights, separate for a row's position and rotation; long steps are halved."""
        free, residual = held.free, self.residual(frames)
        size = self._size(residual)
        for _ in range(steps):
            axes = _Axes.of(frames, self.complete)
            step = free @ self._step(frames, residual, axes.columns @ free)
            for _ in range(_HALVINGS):
                moved = axes.moved(frames, step)
                remaining = self.residual(moved)
                reached = self._size(remaining)
                if reached <= _WORSE * size:
                    break
                step *= 0.5
            frames, residual, size = moved, remaining, reached
            if np.abs(step).max() < _CONVERGED:
                break
        return frames

    def _step(self, frames: OuterFrames, parts: tuple[FloatArray, FloatArray], columns: FloatArray) -> FloatArray:
        residual = np.column_stack([parts[0], self.metres_per_rad * parts[1]])
        jacobian = frames.jacobian(self.poses) @ columns
        jacobian[:, 3:] *= self.metres_per_rad
        scale = max(robust_sigma(residual), 1e-12)
        measured = (slice(0, 3), slice(3, 6))[: 1 + self.turned]
        rows = [_weighted(jacobian[:, part], residual[:, part], scale) for part in measured]
        compact = np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))
        step: FloatArray = np.linalg.lstsq(compact[:, :FRAMES], compact[:, FRAMES], rcond=1e-9)[0]
        return step


def _clean(directions: FloatArray) -> FloatArray:
    """Return orthonormal directions without round-off, so that what is held stays exactly where it is."""
    cleaned = np.where(np.abs(directions) > 1e-12, directions, 0.0)
    return np.asarray(cleaned / np.linalg.norm(cleaned, axis=0))


def _weighted(jacobian: FloatArray, residual: FloatArray, scale: float) -> FloatArray:
    """Return the known equations, residual last, each row times the root of Huber's weight of its length."""
    known = np.isfinite(residual) & np.isfinite(jacobian).all(axis=2)
    filled = np.where(known, residual, 0.0)
    length = np.sqrt((filled**2).sum(axis=1) / np.maximum(known.sum(axis=1), 1))
    weight = np.sqrt(huber_weights(length, PRELIMINARY_HUBER_BOUND * scale))
    weights = np.broadcast_to(weight[:, None], known.shape)[known]
    return np.asarray(np.column_stack([jacobian[known], residual[known]]) * weights[:, None])
