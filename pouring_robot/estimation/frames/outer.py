"""The two unknown outer frames: tracker → fixed platform, and moving platform → target.

    seen = T_tracker_base ∘ X ∘ T_end_target

X is the pose of the moving platform (end) in the fixed platform (base). :class:`OuterFrames` transforms poses to the
tracker and differentiates them by the frames: the one Jacobian of the frames that checks, calibration, design and
diagnosis use. :mod:`pouring_robot.estimation.frames.fit` fits both. With R_1, t_1 and R_2, t_2 the two frames and R, p
a row's X:

    position  t_1 + R_1 (p + R t_2)          rotation  R_1 R R_2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.local_parameters import COMPONENTS, FrameParameter
from pouring_robot.mechanism.rotations import rotation_matrices, skew

FRAME_PARAMETERS: tuple[FrameParameter, ...] = (
    *(FrameParameter("base", component) for component in COMPONENTS),
    *(FrameParameter("tool", component) for component in COMPONENTS),
)
"""The twelve unknowns of the two outer frames, first in every vector of unknowns."""
FRAMES = len(FRAME_PARAMETERS)
FRAME_STD = 0.1
"""Prior of the outer frames relative to their first fit, in m and rad: nothing is known about them. It is large against
what any campaign leaves open, so it only picks one of several equivalent answers (see the y of target and tracker)."""


@dataclass(frozen=True, eq=False)
class OuterFrames:
    """Where the tracker sees the fixed platform, and where the target is on the moving one."""

    T_tracker_base: pin.SE3  # pose of the fixed platform in the tracker frame
    T_end_target: pin.SE3  # pose of the target in the moving platform

    def moved(self, values: FloatArray) -> OuterFrames:
        """Return the frames displaced by the twelve unknowns of :data:`FRAME_PARAMETERS`, (12,), in m and rad.

        The base is displaced in its own axes, the target in those of the moving platform: T_tracker_base ∘ D(base)
        and D(tool) ∘ T_end_target with D(v, w) = SE3(exp(w), v).
        """
        base, tool = (pin.SE3(pin.exp3(part[3:]), part[:3]) for part in (values[:6], values[6:12]))
        return OuterFrames(self.T_tracker_base * base, tool * self.T_end_target)

    def seen(self, poses: PoseStack, base: FloatArray | None = None, scale: FloatArray | None = None) -> PoseStack:
        """Return the target poses that the tracker should see for n poses of the moving platform in the fixed one.

        Row by row ``base``, (n, 6), displaces the fixed platform in its own axes, in m and rad, and positions are
        multiplied by 1 + ``scale``, (n,), about the tracker's own origin.
        """
        outer, turned = self.T_tracker_base, self._turned(base)
        if base is None:
            position = self.seen_places(poses)
        else:
            position = outer.translation + (turned @ self.places(poses)[..., None])[..., 0]
            position += base[:, :3] @ outer.rotation.T
        if scale is not None:
            position *= 1.0 + scale[:, None]
        # One product for all rows with the common factor: many products of 3 x 3 matrices take far longer.
        rotation = (poses.rotation.reshape(-1, 3) @ self.T_end_target.rotation).reshape(-1, 3, 3)
        return PoseStack(position, turned @ rotation)

    def seen_places(self, poses: PoseStack) -> FloatArray:
        """Return where the tracker should see the target, (n, 3), in m; see :meth:`seen`."""
        return np.asarray(self.T_tracker_base.translation + self.places(poses) @ self.T_tracker_base.rotation.T)

    def jacobian(self, poses: PoseStack, base: FloatArray | None = None) -> FloatArray:
        """Return the derivative of :meth:`seen` by :data:`FRAME_PARAMETERS` at zero, (n, 6, 12).

        Displacement of the target's origin (m) and rotation vector (rad), both in tracker axes, per m and rad.
        """
        turned, tool = self._turned(base), self.T_end_target.translation
        carried = turned @ poses.rotation
        jacobian = np.zeros((len(poses), 6, FRAMES))
        jacobian[:, :3, 0:3] = self.T_tracker_base.rotation
        jacobian[:, :3, 3:6] = -turned @ skew(self.places(poses))
        jacobian[:, 3:, 3:6] = turned
        jacobian[:, :3, 6:9] = carried
        jacobian[:, :3, 9:12] = -carried @ skew(tool)
        jacobian[:, 3:, 9:12] = carried
        return jacobian

    def carried(
        self, matrix: FloatArray, poses: PoseStack, base: FloatArray | None = None, out: FloatArray | None = None
    ) -> FloatArray:
        """Return columns of G, (n, 6, P), transformed from the moving platform to the target, in tracker axes.

        They are written to ``out`` if it is given.
        """
        turned, moved = self._turned(base), np.empty_like(matrix) if out is None else out
        lever = poses.rotation @ self.T_end_target.translation
        np.matmul(turned, matrix[:, :3] - skew(lever) @ matrix[:, 3:], out=moved[:, :3])
        np.matmul(turned, matrix[:, 3:], out=moved[:, 3:])
        return moved

    def _turned(self, base: FloatArray | None) -> FloatArray:
        rotation: FloatArray = self.T_tracker_base.rotation
        return rotation if base is None else rotation @ rotation_matrices(base[:, 3:])

    def places(self, poses: PoseStack) -> FloatArray:
        """Return the position of the target in the fixed platform, (n, 3), in m."""
        return np.asarray(poses.position_m + poses.rotation @ self.T_end_target.translation)


def displaced_columns(values: FloatArray) -> FloatArray:
    """Return ∂(unknowns at zero)/∂(unknowns at ``values``) of the frames, (12, 12): J at values is J at zero times it.

    J at zero is that of the frames already moved by ``values``, (12,), in m and rad. exp(w + dw) turns by the right
    Jacobian of w in the rotated axes, by the left one in the original axes.
    """
    chain, turn = np.eye(FRAMES), values[9:12]
    left = pin.Jexp3(-turn)  # the left Jacobian of w is the right one of -w
    chain[0:3, 0:3] = pin.exp3(values[3:6]).T
    chain[3:6, 3:6] = pin.Jexp3(values[3:6])
    chain[6:9, 9:12] = skew(values[6:9]) @ left
    chain[9:12, 9:12] = left
    return chain
