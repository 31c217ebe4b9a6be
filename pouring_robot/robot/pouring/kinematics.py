"""Kinematics of the 4-UPU mechanism: closed forms for the nominal robot, workspace and joint limits.

The nominal robot closes exactly, with two pairs of equal planar chains, so forward and inverse kinematics have closed
forms. They give the drive values that a controller commands, and the start of the actual robot's closure.
"""

import functools
import math
from collections.abc import Mapping

import numpy as np

from pouring_robot.batch.records import BatchCommand, BatchStart
from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS
from pouring_robot.mechanism.joint_limits import joint_reach, refuse_beyond
from pouring_robot.robot.description.drawing import Drawing
from pouring_robot.robot.pouring.names import CHAIN_JOINTS, DRIVE_JOINTS, LEGS
from pouring_robot.robot.pouring.platform_pose import PlatformPose

TASK_ROWS = (0, 1, 2, 4)
"""Rows of the platform's twist that the four drives control: x, y, z and the tilt about y."""


def chain_joints(
    fixed_m: FloatArray, moving_m: FloatArray, positions_m: FloatArray, tilts_rad: FloatArray
) -> FloatArray:
    """Return the joint values of all chains at positions (..., 3), m, and tilts (...), rad: nominal inverse kinematics.

    ``fixed_m`` and ``moving_m`` are the U-joint centres in the fixed and in the moving platform, shape (4, 3), in m.

    Returns:
        Shape (..., 4, 5): chains 1 to 4; in each the rotation of the leg about y (S1) and about x (S2) in rad, the
        distance between the two U-joint centres (S3) in m, and in rad S4 = -S2 and S5, the tilt minus S1.
    """
    tilt = np.asarray(tilts_rad, dtype=float)[..., None]
    bx, by, bz = moving_m.T
    turned = np.stack(
        [bx * np.cos(tilt) + bz * np.sin(tilt), by + 0.0 * tilt, bz * np.cos(tilt) - bx * np.sin(tilt)], axis=-1
    )
    leg = np.asarray(positions_m, dtype=float)[..., None, :] + turned - fixed_m
    length = np.hypot(np.hypot(leg[..., 0], leg[..., 1]), leg[..., 2])
    psi = np.arctan2(-leg[..., 0], -leg[..., 2])
    phi = np.arcsin(leg[..., 1] / length)
    return np.stack([psi, phi, length, -phi, tilt - psi], axis=-1)


class FourUPUKinematics(Drawing):
    """Closed-form kinematics of the nominal mechanism, whose joint placements are the only source of geometry."""

    def __init__(self, nominal: ClosedChainMechanism) -> None:
        super().__init__(nominal, {}, DEFAULT_OPTIONS)
        loops, frames = nominal.loops, nominal.frames_at(nominal.neutral_configuration()).oMf

        def place(*names: str) -> FloatArray:
            base, frame = (frames[nominal.frame_id(name)] for name in names)
            return np.array(base.actInv(frame).translation)

        self.fixed_centres_m = np.array([place(loops.base_frame, joints[0]) for joints in CHAIN_JOINTS])
        self.moving_centres_m = np.array([place(str(loops.end_frame), f"{leg}_seat") for leg in LEGS])

    def chain_joints(self, positions_m: FloatArray, tilts_rad: FloatArray) -> FloatArray:
        """Return the joint values of all chains for arrays of poses; see :func:`chain_joints`."""
        return chain_joints(self.fixed_centres_m, self.moving_centres_m, positions_m, tilts_rad)

    def commands(self, poses: FloatArray) -> BatchCommand:
        """Return drive values and closed poses for poses (n, 4): x, y, z in m, tilt in rad; joint limits are ignored.

        Raises:
            BadInputError: the array has another shape.
        """
        poses = np.ascontiguousarray(poses, dtype=float)
        if poses.ndim != 2 or poses.shape[1] != 4:
            raise BadInputError(f"poses must have the shape (n, 4): x, y, z, tilt; not {poses.shape}")
        joints = self.chain_joints(poses[:, :3], poses[:, 3])
        cos, sin, zero, one = np.cos(poses[:, 3]), np.sin(poses[:, 3]), np.zeros(len(poses)), np.ones(len(poses))
        rotation = np.stack([cos, zero, sin, zero, one, zero, -sin, zero, cos], axis=-1).reshape(-1, 3, 3)
        places = {name: (i, k) for i, chain in enumerate(CHAIN_JOINTS) for k, name in enumerate(chain)}
        drives = np.stack([joints[:, *places[name]] for name in self.mechanism.loops.drives], axis=1)
        return BatchCommand(poses, drives, BatchStart(poses[:, :3], rotation, joints))

    def starts(self, drives: FloatArray, /) -> BatchStart:
        """Return the closed poses for drive values (n, 4), in m and rad; NaN where there is none.

        Raises NoSolutionError, like :meth:`forward`, for a layout that has no closed form.
        """
        return self.commands(self._assemblies(drives)[0][:, 0]).start

    def configuration_at(self, drives: FloatArray, /) -> FloatArray:
        """Return the closed nominal configuration, (nq,), for drive values (4,), in m and rad."""
        return self.configuration(self.forward(self.mechanism.named_drives(drives)))

    def joint_values(self, pose: PlatformPose) -> dict[str, float]:
        """Return the value of all 20 chain joints at a pose of the nominal robot, in m and rad."""
        expect(pose, PlatformPose, "a pose is a PlatformPose")
        joints = self.chain_joints(np.array(pose.position_m), np.array(pose.tilt_rad))
        return dict(zip(sum(CHAIN_JOINTS, ()), joints.ravel().tolist(), strict=True))

    def inverse(self, pose: PlatformPose) -> dict[str, float]:
        """Return the drive values to command for a pose, in m and rad; raises UnreachablePoseError beyond limits."""
        values = self.joint_values(pose)
        refuse_beyond(joint_reach(self.mechanism, values))
        return {drive: values[drive] for drive in self.mechanism.loops.drives}

    def configuration(self, pose: PlatformPose) -> FloatArray:
        """Return the closed nominal configuration at a pose, ignoring joint limits; shape (nq,)."""
        return self.mechanism.with_joint_values(self.mechanism.neutral_configuration(), self.joint_values(pose))

    @functools.cached_property
    def _pairs(self) -> tuple[FloatArray, FloatArray]:
        """Return fixed and moving centres of the two chain pairs in the x-z plane, shape (2, 2)."""
        pairs = [centres[:, [0, 2]].reshape(2, 2, 2) for centres in (self.fixed_centres_m, self.moving_centres_m)]
        for pair in pairs:
            if not np.allclose(pair[:, 0], pair[:, 1], atol=1e-12):
                raise NoSolutionError(
                    "the closed-form forward kinematics needs chains 1 and 2, and 3 and 4, in common planes; "
                    "this layout has them apart: give the closure a start configuration instead"
                )
        return pairs[0].mean(axis=1), pairs[1].mean(axis=1)

    def forward(self, drives: Mapping[str, float], near: PlatformPose | None = None) -> PlatformPose:
        """Return the nominal pose for drive values (m, rad) by joint name, in closed form.

        Legs 1 and 2 determine y. Seen along y, leg pair 3-4 is then a rod fixed to the platform at the angle theta46,
        and the rear fixed joints are at an intersection of two circles. Of the two intersections the one nearer to
        ``near`` is taken (default: the assembly mode in which the platform hangs upright).

        Raises BadInputError where a value is missing or not finite, or a name is not a drive; NoSolutionError where no
        pose has these leg lengths, or they do not determine y (equal half-widths).
        """
        self.check_drives(drives)
        values = np.array([float(drives[name]) for name in DRIVE_JOINTS])
        if not np.isfinite(values).all():
            *legs, theta = values.tolist()
            raise BadInputError(f"the drive values must be finite numbers, not {legs} m and {theta} rad")
        (poses,), (sides,), (across,) = self._assemblies(values[None])
        if np.isnan(sides).any():
            short = int(np.argmax(np.isnan(sides)))
            why = f"a leg of {values[[0, 2][short]] / MM:.3f} mm cannot span {abs(across[short]) / MM:.3f} mm sideways"
            raise NoSolutionError(f"no pose has these leg lengths: {why}; check the drive values")
        if np.isnan(poses).any():
            rear, front = sides / MM
            why = f"the rear legs ({rear:.2f} mm seen along y) cannot meet the front ones ({front:.2f} mm)"
            raise NoSolutionError(f"no pose has these leg lengths: {why}; check the drive values")
        upright, other = map(PlatformPose.of_values, poses)
        return min(upright, other, key=lambda pose: _apart(pose, near or upright))

    @np.errstate(invalid="ignore", over="ignore")  # drive values without a pose give NaN
    def _assemblies(self, drives: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the two poses for drive values (n, 4), m and rad, upright first, (n, 2, 4), and extents of the legs.

        These are the lengths of rear and front legs seen along y, and their extents along y, (n, 2) each. Values are
        NaN where there is no pose.
        """
        fixed, moving = self._pairs
        offsets = self.moving_centres_m[:, 1] - self.fixed_centres_m[:, 1]
        if abs(offsets[0] - offsets[1]) < 1e-9:
            raise NoSolutionError("legs 1 and 2 are parallel in y, so their lengths do not fix y; change the layout")
        l1, l2, _, theta = drives.T
        y = ((l1**2 - l2**2) - (offsets[0] ** 2 - offsets[1] ** 2)) / (2.0 * (offsets[0] - offsets[1]))
        across = y[:, None] + offsets[[0, 2]]
        sides = np.sqrt(drives[:, [0, 2]] ** 2 - across**2)
        # In platform axes: front fixed centre from the rod's known angle, rear one from two circles.
        front_fixed = moving[1] + sides[:, 1:] * np.column_stack([-np.sin(theta), np.cos(theta)])
        rear_fixed = _circle_meetings(moving[0], sides[:, 0], front_fixed, float(np.linalg.norm(fixed[1] - fixed[0])))
        in_platform, in_base = front_fixed[:, None] - rear_fixed, fixed[1] - fixed[0]
        # x-z plane with R_y(r): a vector (x, z) in platform axes is (x cos r + z sin r, z cos r - x sin r) in O's axes.
        tilt = np.arctan2(in_platform[..., 1], in_platform[..., 0]) - math.atan2(in_base[1], in_base[0])
        tilt = np.arctan2(np.sin(tilt), np.cos(tilt))
        cos, sin = np.cos(tilt), np.sin(tilt)
        x = fixed[0, 0] - (rear_fixed[..., 0] * cos + rear_fixed[..., 1] * sin)
        z = fixed[0, 1] - (rear_fixed[..., 1] * cos - rear_fixed[..., 0] * sin)
        poses = np.stack([x, np.broadcast_to(y[:, None], x.shape), z, tilt], axis=-1)
        return np.take_along_axis(poses, np.abs(tilt).argsort(axis=1, kind="stable")[..., None], axis=1), sides, across


def _circle_meetings(centre_a: FloatArray, radii_a: FloatArray, centres_b: FloatArray, radius_b: float) -> FloatArray:
    """Return the two intersections of two circles in a plane, (n, 2, 2); NaN where there are none.

    Centres are (2,) and (n, 2), radii (n,) and one for all.
    """
    across = centres_b - centre_a
    distance = np.linalg.norm(across, axis=1)
    along = (radii_a**2 - radius_b**2 + distance**2) / (2.0 * distance)
    foot = centre_a + (along / distance)[:, None] * across
    aside = (np.sqrt(radii_a**2 - along**2) / distance)[:, None] * np.column_stack([-across[:, 1], across[:, 0]])
    return np.stack([foot + aside, foot - aside], axis=1)


def _apart(pose: PlatformPose, near: PlatformPose) -> float:
    """Return the distance between two poses, in m + rad."""
    gap = np.linalg.norm(np.subtract(pose.position_m, near.position_m))
    return float(gap) + abs(math.remainder(pose.tilt_rad - near.tilt_rad, 2.0 * math.pi))
