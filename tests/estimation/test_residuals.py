"""Differences, masks and whitening."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.residuals import MeasuredPoses, regressor, whiten
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.rotations import inverse_right_jacobians
from tests.campaign.simulated import damaged
from tests.estimation.virtual import SIGMA, Virtual, model_of


@pytest.fixture(scope="module")
def virtual(drawing):
    return Virtual(drawing, model_of(drawing, "centres"), 10, sigma=2e-3)


def test_whitened_residuals_differentiate(virtual):
    seen = virtual.rows.linearise(virtual.unknowns)
    equations = whiten(virtual.measured, seen)
    assert equations.residual.shape == (60,)
    assert np.std(equations.residual) == pytest.approx(1.0, abs=0.3)
    step = 1e-6
    for k in (0, 4, 7, 10, 12, 20, 30):
        aside = np.zeros_like(virtual.unknowns.values)
        aside[k] = step
        plus, minus = (
            whiten(virtual.measured, virtual.rows.predict(virtual.unknowns.at(virtual.unknowns.values + s * aside)))
            for s in (1.0, -1.0)
        )
        expected = (plus.residual - minus.residual) / (2.0 * step)
        np.testing.assert_allclose(equations.jacobian[:, k], expected, rtol=1e-5, atol=1e-3)


def test_missing_cells_remove_their_equations(virtual, drawing):
    position, rotation = virtual.measured.position_m.copy(), virtual.measured.rotation.copy()
    position[0, 1], position[3] = np.nan, np.nan
    rotation[2, 0, 0], rotation[3] = np.nan, np.nan
    partial = MeasuredPoses(position, rotation, SIGMA, SIGMA)
    equations = whiten(partial, virtual.rows.predict(virtual.unknowns))
    assert equations.residual.size == 60 - 1 - 3 - 6
    assert equations.jacobian is None
    assert not equations.failed.size
    assert [c for r, c in zip(equations.rows, equations.components, strict=True) if r == 0] == [0, 2, 3, 4, 5]
    assert 3 not in equations.rows


def test_measured_rows_without_a_prediction_are_reported(virtual):
    drives = virtual.rows.drives.copy()
    drives[4, 0] = 9.0
    rows = virtual.model.at(drives)
    equations = whiten(virtual.measured, rows.linearise(virtual.unknowns))
    assert equations.failed.tolist() == [4]
    assert 4 not in equations.rows
    assert np.isfinite(equations.jacobian).all()


def test_a_rotation_counts_only_when_complete(clean):
    campaign = damaged(clean.campaign, rotation_vector_rad=lambda r: r.__setitem__((0, 1), np.nan))
    measured = MeasuredPoses.from_campaign(campaign, NoiseLevel.stated(SIGMA, SIGMA))
    assert measured.known[0].tolist() == [True, True, True, False, False, False]
    assert measured.known[1].all()


def test_positions_only(positions):
    measured = MeasuredPoses.from_campaign(positions.campaign, NoiseLevel.stated(SIGMA, None))
    assert measured.known[:, :3].all()
    assert not measured.known[:, 3:].any()


def test_rows_without_drives_are_not_measured(clean):
    campaign = damaged(clean.campaign, drives=lambda d: d.__setitem__((5, 2), np.nan))
    assert not MeasuredPoses.from_campaign(campaign, NoiseLevel.stated(SIGMA, SIGMA)).known[5].any()


def test_regressor_is_the_jacobian_over_the_noise(virtual):
    seen = virtual.rows.linearise(virtual.unknowns)
    sigma = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    full = regressor(seen, sigma)
    np.testing.assert_allclose(full, (seen.jacobian / sigma[:, None]).reshape(60, -1))
    known = np.zeros((10, 6), dtype=bool)
    known[:, :3] = True
    assert regressor(seen, sigma, known).shape[0] == 30
    with pytest.raises(BadInputError, match="linearise"):
        regressor(virtual.rows.predict(virtual.unknowns), sigma)


def test_inverse_right_jacobian_of_the_logarithm():
    random = np.random.default_rng(1)
    for size in (1e-7, 9e-5, 1.1e-4, 0.3, 2.5):
        vectors = random.normal(size=(5, 3))
        vectors *= size / np.linalg.norm(vectors, axis=1, keepdims=True)
        expected = np.array([np.linalg.inv(pin.Jexp3(v)) for v in vectors])
        np.testing.assert_allclose(inverse_right_jacobians(vectors), expected, atol=1e-9)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
def test_noise_must_be_positive(sigma):
    with pytest.raises(BadInputError, match="positive"):
        MeasuredPoses(np.zeros((2, 3)), np.zeros((2, 3, 3)), sigma, 1.0)
