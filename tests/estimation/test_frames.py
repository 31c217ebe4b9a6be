"""The two unknown frames are found to within the noise, for any attitude and with gross errors in single rows."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.estimation.frames.fit import fit_frames
from pouring_robot.estimation.frames.outer import displaced_columns
from pouring_robot.estimation.frames.starts import affine_map
from pouring_robot.exceptions import FrameFitError
from pouring_robot.mechanism.rotations import rotation_matrices
from tests.campaign.simulated import SIGMA_M, SIGMA_RAD, measure
from tests.estimation.virtual import TRUE_FRAMES


def fit_of(robot, measured, **options):
    campaign = measured.campaign
    poses = nominal_poses(robot.kinematics, campaign.drives)
    vectors = campaign.rotation_vector_rad
    rotation = None if vectors is None else rotation_matrices(vectors)
    return poses, fit_frames(poses, campaign.position_m, rotation, **options)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("full", [True, False])
def test_recovers_what_the_tracker_sees_within_noise(drawing, seed, full):
    measured = measure(drawing, seed=seed, sigma_rotation_rad=SIGMA_RAD if full else None, outliers=5, lost=0.02)
    poses, fit = fit_of(drawing, measured)
    seen = fit.frames.seen(poses)
    outer, inner = measured.pose_tracker_to_fixed_platform, measured.pose_platform_to_target
    truth = [outer * pose * inner for pose in measured.actual_poses]
    error = seen.position_m - np.array([pose.translation for pose in truth])
    assert np.abs(error).max() < 2.5 * SIGMA_M
    assert fit.position_scale_m == pytest.approx(SIGMA_M, rel=0.25)
    assert fit.frames.T_end_target.translation[1] == 0.0
    # The tracker's attitude is known from positions alone; its position along y only together with the target's.
    turn = pin.log3(fit.frames.T_tracker_base.rotation @ outer.rotation.T)
    assert np.linalg.norm(turn) < 1e-3
    assert fit.frames.T_end_target.translation[[0, 2]] == pytest.approx(inner.translation[[0, 2]], abs=4e-4)
    shift = outer.rotation @ np.array([0.0, inner.translation[1], 0.0])
    assert np.linalg.norm(fit.frames.T_tracker_base.translation - outer.translation - shift) < 2e-3
    if full:
        assert fit.rotation_scale_rad == pytest.approx(SIGMA_RAD, rel=0.25)
        rotations = np.array([pose.rotation for pose in truth])
        turns = [pin.log3(a @ b.T) for a, b in zip(seen.rotation, rotations, strict=True)]
        assert np.abs(turns).max() < 2.5 * SIGMA_RAD
    else:
        assert fit.rotation_residual_rad is None
        assert fit.rotation_scale_rad is None


def test_a_fifth_of_wrong_rows_hardly_matters(drawing):
    measured = measure(drawing, count=100, seed=9, outliers=20, outlier_m=0.5)
    _, fit = fit_of(drawing, measured)
    sound = np.setdiff1d(np.arange(100), measured.outlier_rows)
    assert np.abs(fit.position_residual_m[sound]).max() < 6 * SIGMA_M


def test_poses_in_one_plane_still_give_the_frames(drawing):
    measured = measure(drawing, count=200, seed=3, sigma_rotation_rad=None)
    campaign = measured.campaign
    poses = nominal_poses(drawing.kinematics, campaign.drives)
    chosen = np.argsort(np.abs(poses.position_m[:, 1]))[:25]
    flat = campaign.subset(chosen)
    fit = fit_frames(nominal_poses(drawing.kinematics, flat.drives), flat.position_m)
    assert fit.position_scale_m < 2 * SIGMA_M


def test_refuses_too_few_rows(drawing, clean):
    campaign = clean.campaign.subset(range(5))
    with pytest.raises(FrameFitError, match="at least 6 rows") as caught:
        fit_frames(nominal_poses(drawing.kinematics, campaign.drives), campaign.position_m)
    assert (caught.value.rows, caught.value.needed) == (5, 6)


def test_affine_map_is_a_rotation_and_shows_mirrored_axes(drawing, clean):
    campaign = clean.campaign
    poses = nominal_poses(drawing.kinematics, campaign.drives)
    rows = np.ones(len(campaign), dtype=bool)
    affine, spread = affine_map(poses, campaign.position_m, rows)
    assert spread > 0.05
    assert np.linalg.det(affine) == pytest.approx(1.0, abs=0.02)
    mirrored, _ = affine_map(poses, campaign.position_m * [1, -1, 1], rows)
    assert np.linalg.det(mirrored) < 0


def test_the_jacobian_of_the_frames_is_the_derivative_of_what_is_seen(drawing, clean):
    poses = nominal_poses(drawing.kinematics, clean.campaign.drives[:7])
    random = np.random.default_rng(4)
    frames = TRUE_FRAMES
    base = 0.1 * random.normal(size=(7, 6))
    step = 1e-6
    for rows_displaced in (None, base):
        jacobian = frames.jacobian(poses, rows_displaced)
        for k, axis in enumerate(np.eye(12)):
            if k < 6 and rows_displaced is not None:
                turned = np.array([pin.exp3(w) @ pin.exp3(step * axis[3:6]) for w in base[:, 3:]])
                after = np.hstack([base[:, :3] + step * axis[:3], [pin.log3(turn) for turn in turned]])
                seen = frames.seen(poses, after)
            else:
                seen = frames.moved(step * axis).seen(poses, rows_displaced)
            change = seen.difference(frames.seen(poses, rows_displaced)) / step
            np.testing.assert_allclose(jacobian[:, :, k], change, atol=2e-5)


def test_displaced_columns_chain_the_jacobian_to_displaced_frames(drawing, clean):
    poses = nominal_poses(drawing.kinematics, clean.campaign.drives[:5])
    frames, values = TRUE_FRAMES, 0.3 * np.random.default_rng(1).normal(size=12)
    moved, step = frames.moved(values), 1e-6
    jacobian = moved.jacobian(poses) @ displaced_columns(values)
    for k, axis in enumerate(np.eye(12)):
        change = frames.moved(values + step * axis).seen(poses).difference(moved.seen(poses)) / step
        np.testing.assert_allclose(jacobian[:, :, k], change, atol=2e-5)
