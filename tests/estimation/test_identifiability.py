"""Base parameters: the groups are the true null space, as seen by an independent regressor."""

import numpy as np
import pytest

from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.identifiability import RANK_TOLERANCE, base_parameters, observability, robot_combinations
from pouring_robot.estimation.measurement import Unknowns
from pouring_robot.estimation.residuals import regressor
from pouring_robot.exceptions import BadInputError
from tests.estimation.virtual import TRUE_FRAMES, Virtual, model_of, reference_regressor


def physical_null_space(matrix, base):
    """Return the unobservable directions in the unknowns' own units, orthonormal, (K, K - rank)."""
    matrix = np.where(np.isin(base.names, base.unseen), 0.0, matrix)
    lengths = np.linalg.norm(matrix, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    return np.linalg.qr(np.linalg.svd(matrix / scale)[2][base.rank :].T / scale[:, None])[0]


def test_a_matrix_with_known_dependencies():
    random = np.random.default_rng(0)
    a, b, c, d = random.normal(size=(4, 30))
    matrix = np.column_stack([a, 2.0 * a, b, c, b - 3.0 * c, d, np.zeros(30)])
    found = base_parameters(matrix, list("uvwxyzo"), lead=["u"])
    assert found.rank == 4
    assert found.deficient
    assert found.unseen == ("o",)
    assert [set(group.members) for group in found.groups] == [{"u", "v"}, {"w", "x", "y"}]
    assert found.groups[0].combinations == ({"u": pytest.approx(1.0), "v": pytest.approx(2.0)},)
    assert found.groups[0].texts() == ("u + 2 v",)
    assert np.abs(matrix @ physical_null_space(matrix, found)).max() < 1e-12
    assert physical_null_space(matrix, found).shape == (7, 3)
    # The groups hold all the information: the identifiable combinations determine every prediction.
    values = random.normal(size=7)
    shares = np.zeros((3, 7))
    combinations = [c for group in found.groups for c in group.combinations]
    for k, combination in enumerate(combinations):
        for name, share in combination.items():
            shares[k, "uvwxyzo".index(name)] = share
    leaders = ["uvwxyzo".index(next(iter(c))) for c in combinations]
    predicted = matrix[:, leaders] @ (shares @ values) + d * values[5]
    np.testing.assert_allclose(predicted, matrix @ values, atol=1e-12)


def test_units_of_the_columns_do_not_matter():
    random = np.random.default_rng(1)
    matrix = random.normal(size=(40, 6))
    matrix[:, 5] = matrix[:, 0] - matrix[:, 1]
    scale = np.array([1.0, 1e3, 1e-3, 1e3, 1.0, 1e-3])  # millimetres or metres
    assert base_parameters(matrix * scale, list("abcdef")).rank == 5


def test_wrong_matrices_are_refused():
    for matrix in (np.zeros((3, 2)), np.full((3, 3), np.nan), np.zeros(3)):
        with pytest.raises(BadInputError, match="finite entries"):
            base_parameters(matrix, list("abc"))
    assert base_parameters(np.zeros((4, 3)), list("abc")).rank == 0


@pytest.mark.parametrize("wanted", [("centres",), ("drives", "leg1_s?.r?", "leg1_seat_mount.*", "leg3_s3.*")])
def test_groups_are_the_null_space_of_an_independent_regressor(drawing, wanted):
    """Differences of ClosureSolver over perturbed URDFs, independent of the batch engine's Jacobian."""
    model = model_of(drawing, *wanted)
    virtual = Virtual(drawing, model, 14, seed=8)
    zero = Unknowns.zero(TRUE_FRAMES, len(model.parameters))
    analytic = regressor(virtual.rows.linearise(zero), np.ones(6))
    independent = reference_regressor(drawing, model.model, model.parameters, virtual.rows.drives)
    np.testing.assert_allclose(analytic, independent, atol=2e-8)
    # Differences are accurate to about 1e-9, so the null space is decided at 1e-7 here.
    ours, theirs = (base_parameters(matrix, model.names, tolerance=1e-7) for matrix in (analytic, independent))
    assert ours.rank == theirs.rank < len(model.names)
    assert ours.unseen == theirs.unseen
    hidden, also = physical_null_space(analytic, ours), physical_null_space(independent, theirs)
    np.testing.assert_allclose(np.linalg.svd(hidden.T @ also, compute_uv=False), 1.0, atol=1e-9)
    assert np.abs(independent @ hidden).max() < 2e-8
    count = sum(group.hidden for group in ours.groups) + len(ours.unseen)
    assert count == len(model.names) - ours.rank


@pytest.mark.parametrize("wanted", ["geometry", "all", "dh"])
def test_the_threshold_lies_in_a_wide_gap(drawing, wanted):
    """A threshold ten times lower or higher gives the same rank, so round-off never decides it."""
    model = model_of(drawing, wanted)
    virtual = Virtual(drawing, model, 30, seed=4)
    seen = regressor(virtual.rows.linearise(Unknowns.zero(TRUE_FRAMES, len(model.parameters))), np.ones(6))
    found = [base_parameters(seen, model.names, tolerance=RANK_TOLERANCE * f) for f in (0.1, 1.0, 100.0)]
    assert len({one.rank for one in found}) == 1
    assert len({one.unseen for one in found}) == 1


def test_a_hidden_direction_changes_no_prediction_and_a_base_parameter_does(drawing):
    model = model_of(drawing, "geometry")
    virtual = Virtual(drawing, model, 60)
    zero = Unknowns.zero(TRUE_FRAMES, len(model.parameters))
    seen = virtual.rows.linearise(zero)
    matrix = regressor(seen, np.ones(6))
    found = base_parameters(matrix, model.names, lead=model.names[:FRAMES])
    null_space = physical_null_space(matrix, found)
    assert null_space.shape[1] == len(model.names) - found.rank > 10
    for direction in null_space.T[::7]:
        moved = virtual.rows.predict(zero.at(1e-5 * direction))
        # To first order nothing moves; 1e-5 squared remains.
        assert np.abs(moved.position_m - seen.position_m).max() < 5e-8


def test_y_of_the_target_is_confounded_with_y_of_the_base(drawing):
    """The platform turns about y only, so a target moved along y and a robot moved along y look alike."""
    model = model_of(drawing, "drives")
    virtual = Virtual(drawing, model, 40)
    seen = virtual.rows.linearise(Unknowns.zero(TRUE_FRAMES, 4))
    found = base_parameters(regressor(seen, np.ones(6)), model.names, lead=model.names[:FRAMES])
    assert [group.texts() for group in found.groups] == [("base.ty + tool.ty",)]
    assert not found.unseen
    names = robot_combinations(found, model.names[:FRAMES])
    assert names == [{f"drive.{name}": 1.0} for name in ("leg1_s3", "leg2_s3", "leg3_s3", "leg4_s5")]


def test_observability_indices_by_hand():
    found = observability(np.array([4.0, 1.0]), 9)
    assert found == pytest.approx({"O1": 2.0 / 3.0, "O2": 0.25, "O3": 1.0, "O4": 0.25, "O5": 0.8})
    assert set(observability(np.zeros(0), 3).values()) == {0.0}
