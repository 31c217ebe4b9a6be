"""Contract of every effect: names, units and bounds; and columns that are the derivatives of the exact closure."""

import dataclasses
import math

import numpy as np
import pytest

from pouring_robot.diagnosis.library import Library
from pouring_robot.diagnosis.rows import Signatures, local_parameters
from pouring_robot.effects import Effect, EffectParameter, Form
from pouring_robot.effects.base import checked_forms
from pouring_robot.effects.conditions import condition_names
from pouring_robot.estimation.changes import SCALE
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.local_parameters import COMPONENTS
from pouring_robot.robot.model import RobotModel
from tests.effects.bench import EFFECTS, ROBOT, SIGMA_M, SIGMA_RAD
from tests.support import ACTUAL

LOCAL = {p.name for p in local_parameters(RobotModel())} | {f"base.{c}" for c in COMPONENTS} | {SCALE}
STATED = {"robot", "drives", "position_m", "rotation", "session", "time_s", "time_known", "filled", "assumed"}
MAY_BE_MISSING = condition_names(ROBOT) - STATED
STEP = 1e-4
"""Largest change of a local parameter, in m or rad."""


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda effect: effect.id)
def test_effect_is_well_formed(bench, effect):
    assert effect.id.isidentifier()
    assert effect.id == effect.id.lower()
    assert effect.story
    assert "\n" not in effect.story
    assert set(effect.needs) <= MAY_BE_MISSING
    forms = effect.forms(bench.rows.conditions)
    assert len({form.name for form in forms}) == len(forms) > 0
    for form in forms:
        parameters = form.parameters
        main = [p.main for p in parameters]
        assert main[0]
        assert main == sorted(main, reverse=True), "main parameters come first"
        assert len({p.name for p in parameters}) == len(parameters)
        for p in parameters:
            assert p.unit
            assert math.isfinite(p.prior_std)
            assert p.prior_std > 0.0
            assert p.bounds[0] <= 0.0 < p.bounds[1], "no effect at all must be possible"
            assert p.changes
            assert set(p.changes) <= LOCAL
            for change in p.changes.values():
                assert change.shape == (len(bench.rows),)
                assert np.isfinite(change).all()


def moved(rows, frames, parameter, size):
    """Return the exact prediction over the noise, (n, 6), with a parameter at a given size; rotations as matrices."""
    seen = rows.predicted(rows.changes([parameter], np.array([size])), frames)
    assert not seen.status.any()
    return seen


def turned(plus, minus):
    """Return the rotation vectors from one stack of matrices to another, to third order in them."""
    change = plus.rotation @ np.swapaxes(minus.rotation, 1, 2)
    skewed = 0.5 * (change - np.swapaxes(change, 1, 2))
    return np.stack([skewed[:, 2, 1], skewed[:, 0, 2], skewed[:, 1, 0]], axis=1)


def difference(rows, frames, parameter):
    """Return the derivative of the exact closure by a parameter over the noise: fourth-order differences, (n, 6)."""
    step = STEP / max(float(np.abs(change).max()) for change in parameter.changes.values())
    near, far = ([moved(rows, frames, parameter, sign * size * step) for sign in (1.0, -1.0)] for size in (1.0, 2.0))
    place, turn = (
        (8.0 * change(near) - change(far)) / (12.0 * step)
        for change in (lambda pair: pair[0].position_m - pair[1].position_m, lambda pair: turned(*pair))
    )
    return np.hstack([place / SIGMA_M, turn / SIGMA_RAD])


@pytest.fixture(scope="module", params=["drawing", "robot with machining errors"])
def robot(request, bench):
    """Rows and frames for the columns: the robot's own predictions as measurements, so that there is no residual."""
    if request.param == "drawing":
        return bench.rows, bench.true_frames
    model = RobotModel.load(ACTUAL)
    rows = bench.rows_of(bench.campaign, model)
    return bench.rows_of(bench.seen_as(rows, rows.unchanged()), model), bench.true_frames


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda effect: effect.id)
def test_columns_are_derivatives_of_the_exact_closure(robot, effect):
    rows, frames = robot
    linear = rows.linearise(rows.unchanged(), frames)
    checked = set()
    for form in effect.forms(rows.conditions):
        columns = Signatures(rows, form.parameters, linear)[:]
        for parameter, column in zip(form.parameters, columns.T, strict=True):
            if id(parameter) in checked:  # forms share parameters
                continue
            checked.add(id(parameter))
            found = np.zeros((len(rows), 6))
            found[linear.row, linear.component] = column
            expected = parameter.prior_std * difference(rows, frames, parameter)
            size = max(1.0, np.abs(expected).max())  # a column of less than the noise is compared with the noise
            assert np.abs(found - expected).max() <= 1e-6 * size, (form.name, parameter.name)


@pytest.mark.parametrize("effect", ["drive_zero_offset", "joint_axis_tilt", "truss_deflection"])
def test_parameters_add_up(bench, rng, effect):
    """The change of several parameters is the sum of theirs, and the closure has all of them."""
    form = EFFECTS[effect].forms(bench.rows.conditions)[0]
    values = 1e-4 * rng.normal(size=len(form.parameters))
    together = bench.rows.linearise(bench.rows.changes(form.parameters, values), bench.true_frames).residual
    prior_std = np.array([p.prior_std for p in form.parameters])
    expected = bench.linear.residual - Signatures(bench.rows, form.parameters, bench.linear)[:] @ (values / prior_std)
    assert np.abs(together - expected).max() <= 1e-4 * np.abs(expected).max()


def test_form_that_is_not_there(bench):
    with pytest.raises(BadInputError, match=r"'drive_scale' has no form 'whole_lenth'; did you mean 'whole_length'\?"):
        EFFECTS["drive_scale"].form("whole_lenth", bench.rows.conditions)


def test_form_by_name(bench):
    conditions = bench.rows.conditions
    for effect in EFFECTS.values():
        for form in effect.forms(conditions):
            again = effect.form(form.name, conditions)
            assert [p.name for p in again.parameters] == [p.name for p in form.parameters]


class Users(Effect):
    """An effect with one parameter that does something wrong."""

    id = "users_own"
    story = "something a user thought of"

    def __init__(self, changes, prior_std=1.0):
        self.parameter = EffectParameter("one", "mm", prior_std, changes)

    def forms(self, conditions):
        return (Form("only", (self.parameter,)),)


class Namesakes(Users):
    def forms(self, conditions):
        return (Form("only", (self.parameter, self.parameter)),)


class Failing(Users):
    def forms(self, conditions):
        return {}["no such\nkey"]


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda effect: effect.id)
def test_the_library_passes_the_check_of_what_it_changes(bench, effect):
    """The valid names are written here a second time."""
    assert bench.rows.channels == LOCAL
    forms = checked_forms(effect, bench.rows.conditions, bench.rows.channels)
    assert [form.name for form in forms] == [form.name for form in effect.forms(bench.rows.conditions)]


@pytest.mark.parametrize(
    ("changes", "prior_std", "said"),
    [
        ({"drive.leg4_s3": np.zeros(70)}, 1.0, "changes 'drive.leg4_s3', which the robot does not have; did you mean"),
        ({"drive.lift": np.zeros(70)}, 1.0, "if it is not for the robot 'pouring_robot', list the robots it is for"),
        ({"base.tx": np.zeros(69)}, 1.0, "must change 'base.tx' by one finite number for each row"),
        ({"base.tx": np.float64(1.0)}, 1.0, "must change 'base.tx' by one finite number for each row"),
        ({"base.tx": np.full(70, np.nan)}, 1.0, "must change 'base.tx' by one finite number for each row"),
        ({"base.tx": np.zeros(70)}, 0.0, "needs a usual size above zero, not 0"),
        ({"base.tx": np.zeros(70)}, float("nan"), "needs a usual size above zero, not nan"),
        ({"base.tx": np.zeros(70)}, float("inf"), "needs a usual size above zero, not inf"),
    ],
)
def test_an_error_in_a_users_effect_is_reported_in_one_line(bench, changes, prior_std, said):
    with pytest.raises(BadInputError) as problem:
        Library.of(bench.rows, {"users_own": Users(changes, prior_std)})
    line = str(problem.value)
    assert said in line
    assert "the effect 'users_own', form 'only', parameter 'one'" in line
    assert "\n" not in line


def test_bounds_the_wrong_way_round_are_refused(bench):
    effect = Users({"base.tx": np.zeros(70)})
    effect.parameter = EffectParameter("one", "mm", 1.0, {"base.tx": np.zeros(70)}, bounds=(1.0, -1.0))
    with pytest.raises(BadInputError, match=r"parameter 'one' needs bounds with the lower one first, not \(1"):
        Library.of(bench.rows, {"users_own": effect})


@pytest.mark.parametrize("side", [[0, 1] * 35, np.arange(70) % 2 == 1])
def test_lists_and_booleans_change_rows_as_floats_do(bench, side):
    library = Library.of(bench.rows, {"users_own": Users({"base.tx": side})})
    (parameter,) = library.forms["users_own", "only"].parameters
    assert parameter.changes["base.tx"].dtype == float
    assert parameter.changes["base.tx"].tolist() == [0.0, 1.0] * 35


def test_parameters_of_one_name_are_refused(bench):
    """A model file holds values by name, so one would replace the other."""
    with pytest.raises(BadInputError, match="form 'only' needs parameters with different names"):
        Library.of(bench.rows, {"users_own": Namesakes({"base.tx": np.zeros(70)})})


def test_users_effect_that_fails(bench):
    with pytest.raises(
        BadInputError, match=r"the effect 'users_own' fails .*: KeyError: .*; correct its class or"
    ) as problem:
        Library.of(bench.rows, {"users_own": Failing({})})
    assert "\n" not in str(problem.value)


class Formless(Users):
    def forms(self, conditions):
        return ()


class Empty(Users):
    def forms(self, conditions):
        return (Form("only", ()),)


class ShapesOnly(Users):
    def forms(self, conditions):
        return (Form("only", (dataclasses.replace(self.parameter, main=False),)),)


class Double(Users):
    def forms(self, conditions):
        return (*super().forms(conditions), *super().forms(conditions))


@pytest.mark.parametrize("kind", [Formless, Empty, ShapesOnly, Double])
def test_an_effect_needs_forms_with_different_names_and_parameters(bench, kind):
    effect = kind({"drive.leg1_s3": np.ones(len(bench.rows))})
    with pytest.raises(BadInputError, match="'users_own' needs forms with different names, each with a main parameter"):
        checked_forms(effect, bench.rows.conditions, bench.rows.channels)
