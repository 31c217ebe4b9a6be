"""Small turns against Pinocchio and against differences."""

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.rotations import inverse_right_jacobians, skew

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


def test_the_inverse_is_the_inverse_and_missing_stays_missing():
    found = inverse_right_jacobians(VECTORS)
    expected = np.array([np.linalg.inv(pin.Jexp3(v)) for v in VECTORS])
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.isnan(inverse_right_jacobians(np.full((1, 3), np.nan))).all()
