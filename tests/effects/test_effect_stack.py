"""The effect stack of a model file: read, written, put into the robot row by row, and what may be wrong with one."""

import numpy as np
import pytest

from pouring_robot.effects.conditions import complete_conditions
from pouring_robot.exceptions import BadInputError, DescriptionError, DiagnosisError
from pouring_robot.robot.effect_stack import EffectEntry, ParameterEntry
from pouring_robot.robot.model import RobotModel
from tests.effects.bench import EFFECTS, ROBOT


def entry(effect, form, values, **given):
    """Return an entry with values by name, in the effect's units (mm where the effect has no such parameter)."""
    units = {
        p.name: p.unit
        for kind in EFFECTS.values()
        if kind.id == effect
        for known in kind.forms(complete_conditions(ROBOT))
        for p in known.parameters
    }
    parameters = {
        name: ParameterEntry(value=value, std=0.1, unit=units.get(name, "mm")) for name, value in values.items()
    }
    return EffectEntry(effect=effect, form=form, parameters=parameters, **given)


STACK = [
    entry("leg_compliance", "rod", {"stretch": 1.3, "l2_difference": -0.05}),
    entry("drive_zero_offset", "all", {"l1_offset": 0.25}, placed=True),
    entry("base_drift", "steady", {"tx": 0.4, "rz_bend": -0.2}),
]


def put_in(bench, *entries):
    """Return the predictions of a model with effects for the rows of the bench."""
    rows = bench.rows_of(bench.campaign, RobotModel(effects=list(entries)))
    return rows.predicted(rows.unchanged(), bench.true_frames)


def test_round_trip(tmp_path):
    model = RobotModel(description="found", effects=STACK)
    path = model.save(tmp_path / "model.yaml")
    assert RobotModel.load(path) == model
    assert RobotModel.load(path).save(tmp_path / "again.yaml").read_bytes() == path.read_bytes()


def test_stacks_with_different_effects_are_not_equal(tmp_path):
    assert RobotModel(effects=STACK) != RobotModel(effects=STACK[:2])
    assert RobotModel(effects=STACK).is_drawing, "an effect that depends on conditions displaces nothing by itself"


@pytest.mark.parametrize("kind", EFFECTS.values(), ids=lambda kind: kind.id)
def test_stack_of_a_file_moves_the_robot_as_the_parameters_do(bench, rng, tmp_path, kind):
    """Every effect in its first form, through YAML: exactly the same closure."""
    form = kind.forms(bench.rows.conditions)[0]
    values = 0.1 * np.array([p.prior_std for p in form.parameters]) * rng.normal(size=len(form.parameters))
    named = {p.name: value for p, value in zip(form.parameters, values.tolist(), strict=True)}
    path = RobotModel(effects=[entry(kind.id, form.name, named)]).save(tmp_path / "model.yaml")
    seen = put_in(bench, *RobotModel.load(path).effects)
    expected = bench.rows.predicted(bench.rows.changes(form.parameters, values), bench.true_frames)
    assert np.abs(seen.position_m - expected.position_m).max() <= 1e-12
    assert np.abs(seen.rotation - expected.rotation).max() <= 1e-12


def test_parameters_left_out_are_zero(bench):
    nothing = put_in(bench, entry("leg_compliance", "rod", {}))
    assert np.array_equal(nothing.position_m, put_in(bench).position_m)


def test_effects_that_are_already_placements_are_not_applied_again(bench):
    seen = put_in(bench, entry("drive_zero_offset", "all", {"l1_offset": 0.25}, placed=True))
    assert np.array_equal(seen.position_m, put_in(bench).position_m)
    moved = put_in(bench, entry("drive_zero_offset", "all", {"l1_offset": 0.25}))
    assert np.abs(moved.position_m - seen.position_m).max() > 1e-4


def test_several_effects_add_up(bench):
    """Both of a pair, to second order in them."""
    first, second = entry("leg_compliance", "rod", {"stretch": 0.02}), entry("base_drift", "steady", {"tz": 0.05})
    none, one, other, both = (put_in(bench, *stack).position_m for stack in ((), (first,), (second,), (first, second)))
    assert np.abs(both - none).max() > 1e-5
    assert np.abs((both - none) - (one - none) - (other - none)).max() <= 1e-3 * np.abs(both - none).max()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (entry("leg_complience", "rod", {}), "an effect 'leg_complience'; did you mean 'leg_compliance'?"),
        (entry("leg_compliance", "rods", {}), "'leg_compliance' has no form 'rods'; did you mean 'rod'?"),
        (entry("leg_compliance", "rod", {"strech": 1.0}), "of this campaign; did you mean 'stretch'?"),
        (
            # A figure in millimetres must not be taken for one in milliradians.
            EffectEntry(effect="base_drift", form="steady", parameters={"tx": ParameterEntry(value=1e-3, unit="m")}),
            "'tx' of 'base_drift' is in 'm'; it must be in 'mm'",
        ),
    ],
)
def test_unknown_names_and_units_are_refused_in_one_line(bench, tmp_path, wrong, said):
    with pytest.raises(BadInputError) as problem:
        put_in(bench, wrong)
    assert said in str(problem.value)
    assert "\n" not in str(problem.value)
    model = RobotModel.load(RobotModel(effects=[wrong]).save(tmp_path / "model.yaml"))
    with pytest.raises(DescriptionError) as of_a_file:
        bench.rows_of(bench.campaign, model)
    assert str(of_a_file.value) == f"{tmp_path / 'model.yaml'}: {problem.value}"


def test_a_condition_that_the_campaign_lacks(bench):
    campaign = bench.campaign.with_conditions(truss_travel=None)
    model = RobotModel(effects=[entry("truss_deflection", "moving_load", {"sink": 1.0})])
    with pytest.raises(DiagnosisError, match="'truss_deflection' needs truss_travel_m, and the campaign") as problem:
        bench.rows_of(campaign, model)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("effects: [{effect: base_drift}]", "form"),
        ("effects: [{effect: base_drift, form: steady, colour: red}]", "colour"),
        ("effects: [{effect: base_drift, form: steady, parameters: {tx: {value: 1.0}}}]", "unit"),
        ("effects: [{effect: base_drift, form: steady, parameters: {tx: {value: 1, unit: mm, std: -1}}}]", "std"),
        ("effects: [{effect: base_drift, form: steady, parameters: {tx: {value: .nan, unit: mm}}}]", "value"),
        ("effects: {effect: base_drift}", "effects"),
    ],
)
def test_broken_stack_is_refused_with_its_place(tmp_path, text, said):
    path = tmp_path / "model.yaml"
    path.write_text(f"format: pouring_robot/model/1\n{text}\n", encoding="utf-8")
    with pytest.raises(DescriptionError) as problem:
        RobotModel.load(path)
    assert str(path) in str(problem.value)
    assert said in str(problem.value)
    assert "\n" not in str(problem.value)


def test_standard_deviation_is_not_negative():
    with pytest.raises(BadInputError, match="ParameterEntry: 'std'"):
        ParameterEntry(value=1.0, std=-1.0, unit="mm")
