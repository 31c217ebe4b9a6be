"""Losses: convex where promised, their weights are their slopes, and a block counts as one."""

import numpy as np
import pytest

from pouring_robot.estimation.residuals import WhitenedEquations
from pouring_robot.estimation.robust import noise_shares, robust_terms, typical_size
from pouring_robot.exceptions import BadInputError


def equations(residual, components=None):
    residual = np.asarray(residual, dtype=float)
    count = residual.size
    where = np.tile(np.arange(6), count // 6 + 1)[:count] if components is None else np.asarray(components)
    return WhitenedEquations(residual, np.arange(count) // 6, where, None, np.zeros(0, dtype=np.intp))


@pytest.mark.parametrize("loss", ["huber", "soft_l1", "linear"])
def test_weights_are_the_slope_of_the_loss(loss):
    residual = np.array([0.3, -0.4, 0.2, 9.0, 2.0, -3.0])
    _, weights = robust_terms(equations(residual), loss)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        plus, minus = (robust_terms(equations(residual + s * step), loss)[0] for s in (1.0, -1.0))
        assert (plus - minus) / 2e-6 == pytest.approx(2.0 * weights[k] * residual[k], rel=1e-6)


def test_an_outlier_in_one_coordinate_lowers_the_weight_of_its_block_only():
    _, weights = robust_terms(equations([50.0, 0.1, 0.1, 0.1, 0.1, 0.1]), "huber")
    assert weights[:3].max() < 0.1
    np.testing.assert_array_equal(weights[3:], 1.0)


def test_scatter_is_one_for_noise_and_follows_larger_residuals():
    noise = np.random.default_rng(0).normal(size=6000)
    assert typical_size(equations(noise)) == pytest.approx(1.0, abs=0.05)
    assert typical_size(equations(4.0 * noise)) == pytest.approx(4.0, rel=0.05)
    assert typical_size(equations(0.1 * noise)) == 1.0


@pytest.mark.parametrize("components", [None, 7 + np.arange(60_000) % 6], ids=["poses", "six closures"])
@pytest.mark.parametrize("loss", ["huber", "soft_l1", "linear"])
def test_weighted_squares_of_noise_have_the_stated_mean(loss, components):
    noise = equations(np.random.default_rng(1).normal(size=60_000), components)
    assert typical_size(noise) == pytest.approx(1.0, abs=0.02)
    _, weights = robust_terms(noise, loss)
    found, said = (weights * noise.residual) ** 2, noise_shares(noise, loss)
    assert found.mean() == pytest.approx(said.mean(), rel=4.0 * np.sqrt(2.0 / 60_000))  # four standard errors


def test_an_unknown_loss_is_refused():
    with pytest.raises(BadInputError, match="there is no loss 'cauchy'"):
        robust_terms(equations(np.ones(6)), "cauchy")
