"""Rotations against Pinocchio, against differences and against nearby rotations."""

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.rotations import inverse_right_jacobians, moved_point, nearest_rotations, skew, tilts

VECTORS = np.array([[0.0, 0.0, 0.0], [1e-6, -2e-6, 5e-7], [0.3, -0.2, 0.5], [2.0, 1.0, -1.5]])


def test_skew_is_the_cross_product():
    other = np.array([0.4, -1.0, 2.0])
    np.testing.assert_allclose(skew(VECTORS) @ other, np.cross(VECTORS, other), atol=1e-15)


def test_right_jacobian_by_differences():
    step = 1e-6
    for vector in VECTORS:
        for axis in np.eye(3):
            turn = pin.exp3(vector - step * axis).T @ pin.exp3(vector + step * axis)
            np.testing.assert_allclose(pin.log3(turn) / (2 * step), pin.Jexp3(vector) @ axis, atol=1e-8)


def test_the_inverse_is_the_inverse_and_missing_values_stay_missing():
    found = inverse_right_jacobians(VECTORS)
    expected = np.array([np.linalg.inv(pin.Jexp3(v)) for v in VECTORS])
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.isnan(inverse_right_jacobians(np.full((1, 3), np.nan))).all()


def test_a_point_at_an_arm_moves_with_its_frame():
    arm, twists = np.array([[0.3, -0.2, 0.5]]), np.random.default_rng(0).normal(size=(1, 6, 4))
    there = pin.SE3(np.eye(3), arm[0]).toActionMatrixInverse() @ twists[0]
    np.testing.assert_allclose(moved_point(twists, arm)[0], there[:3], atol=1e-15)


def test_tilts_are_rotations_about_y():
    angles = np.array([-2.0, 0.0, 0.4])
    np.testing.assert_allclose(tilts(np.array([pin.utils.rotate("y", a) for a in angles])), angles, atol=1e-15)


def test_no_rotation_is_nearer_to_a_matrix():
    random = np.random.default_rng(0)
    matrices = random.normal(size=(20, 3, 3))  # of either sign
    found = nearest_rotations(matrices)
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    apart = np.linalg.norm(found - matrices, axis=(1, 2))
    for vector in random.normal(scale=0.1, size=(50, 3)):
        assert (np.linalg.norm(found @ pin.exp3(vector) - matrices, axis=(1, 2)) >= apart).all()
