"""How well the ladle is known: propagated covariance against many draws, without directions that no campaign shows."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.calibration.metrics import ladle_uncertainty, workspace_rows
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.map_fit import identify
from tests.estimation.virtual import Virtual, model_of


@pytest.fixture(scope="module")
def fitted(drawing):
    virtual = Virtual(drawing, model_of(drawing, "geometry"), 120, seed=1)
    start = first_frames(virtual.rows, virtual.measured)
    return virtual, identify(virtual.rows, virtual.measured, start, virtual.prior)


def uncertainty(drawing, virtual, covariance, unknowns, *, located=True, turned):
    rows = workspace_rows(virtual.model)
    lip = drawing.nominal_solver.mechanism.T_end_tool
    return rows, lip, ladle_uncertainty(rows, unknowns, [covariance], located=located, turned=turned)


@pytest.mark.parametrize("located", [True, False])
def test_propagated_covariance_is_the_scatter_of_draws(drawing, fitted, located):
    """Target and lip are one rigid body, seen from the tracker or from the base; draws are predicted exactly."""
    virtual, fit = fitted
    small = 1e-4 * fit.covariance  # small enough for first order
    rows, lip, found = uncertainty(drawing, virtual, small, fit.unknowns, located=located, turned=True)
    rows = rows[np.arange(0, len(rows), 9)]
    frames = fit.unknowns.frames
    target_to_lip, axes = frames.T_end_target.inverse() * lip, np.eye(3) if located else frames.T_tracker_base.rotation
    random = np.random.default_rng(0)
    draws = random.multivariate_normal(fit.unknowns.values, small, size=300, method="svd")
    seen = []
    if not located:
        draws[:, :FRAMES] = fit.unknowns.values[:FRAMES]
    for values in draws:
        there = rows.predict(fit.unknowns.at(values))
        seen.append((there.position_m + there.rotation @ target_to_lip.translation) @ axes)
    np.testing.assert_allclose(found.std_m[::9], np.std(seen, axis=0), rtol=0.25)


def test_a_measured_target_orientation_gives_hundredths_of_a_millimetre(drawing, fitted):
    virtual, fit = fitted
    known = uncertainty(drawing, virtual, fit.covariance, fit.unknowns, turned=True)[2]
    blind = uncertainty(drawing, virtual, fit.covariance, fit.unknowns, turned=False)[2]
    assert np.median(known.half_width_m) < 2e-4
    # A rotation of all seats together looks like one of the target: where that was not measured, tolerances decide.
    assert np.median(blind.half_width_m) > 4.0 * np.median(known.half_width_m)


def test_workspace_grid(drawing, fitted):
    rows = workspace_rows(fitted[0].model)
    assert 40 < len(rows) <= 81
    assert (rows.start.position >= drawing.layout.box[0][:3]).all()
    assert fitted[1].covariance.shape == (FRAMES + 88,) * 2
    assert isinstance(drawing.nominal_solver.mechanism.T_end_tool, pin.SE3)
