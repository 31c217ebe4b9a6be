"""Effects of the drives against the independent machine, and what their descriptions promise."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pouring_robot.diagnosis.library import Library
from pouring_robot.effects.available import all_effects
from pouring_robot.effects.conditions import bare_conditions
from pouring_robot.effects.families.drives import Periodic
from pouring_robot.inference.thresholds import DEFAULT_THRESHOLDS
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.drive import Drive
from tests.effects.bench import CHANNELS, EFFECTS, PITCH_M
from tests.rig.true_values import true_values
from tests.support import round_off

TEXTBOOK = [
    ("drive_zero_offset", "all"),
    ("drive_scale", "whole_length"),
    ("drive_cyclic", "turns"),
    ("drive_backlash", "both_sides"),
    ("tilt_encoder_eccentricity", "turns"),
]
OTHER = [
    ("drive_zero_offset", "b", "all"),
    ("drive_zero_offset", "c", "all_homed"),
    ("drive_cyclic", "b", "turns"),
    ("drive_backlash", "c", "rising_only"),
    ("tilt_encoder_eccentricity", "b", "turns"),
]


@pytest.mark.parametrize(("effect", "form"), TEXTBOOK)
def test_columns_span_those_of_the_textbook(bench, effect, form):
    """Each set of columns spans the other; the rig differentiates another formulation by hand."""
    ours, theirs = bench.columns(effect, form, main=True), bench.textbook(effect)
    assert bench.outside(theirs, ours) <= 1e-8
    assert bench.outside(ours, theirs) <= 1e-8


@pytest.mark.parametrize(("effect", "form"), TEXTBOOK)
def test_values_have_the_stated_meaning(bench, effect, form):
    """With the rig's true constants as values, in their units, the library moves the ladle as the rig's closure does.

    Only one of the two rounds the legs' lengths to the controller's steps, hence 1e-6.
    """
    errors = bench.errors(effect, "a")
    values = true_values(effect, "a", 1.0, bench.scene, errors)
    units = {p.name: p.unit for p in bench.form(effect, form).parameters}
    assert {name: unit for name, (_, unit) in values.items()} == {name: units[name] for name in values}
    found = bench.valued(effect, form, {name: value for name, (value, _) in values.items()})
    assert bench.apart(bench.motion(errors), found) <= 1e-6


@pytest.mark.parametrize(("effect", "rig", "form"), OTHER)
def test_other_forms_of_the_rig_are_within_a_form(bench, effect, rig, form):
    assert bench.outside(bench.motion(bench.errors(effect, rig)), bench.columns(effect, form)) <= 1e-6


@pytest.mark.parametrize(("effect", "rig", "form", "most"), [
    ("drive_scale", "b", "from_home", 0.01),  # the same except for legs shorter than their home
    ("drive_backlash", "b", "both_sides", 0.03),  # a quotient of the load against a polynomial of it
])  # fmt: skip
def test_forms_of_another_shape_are_nearly_spanned(bench, effect, rig, form, most):
    assert bench.outside(bench.motion(bench.errors(effect, rig)), bench.columns(effect, form)) <= most


@pytest.mark.parametrize("home_m", [0.2, 0.4, 0.7])
def test_a_stroke_from_any_home_is_within_the_form(bench, home_m):
    """So is its square: a parabola stays one whatever its origin."""
    own = [p for p in bench.form("drive_scale", "from_home").parameters if p.name.startswith("l1_")]
    columns = np.column_stack([p.changes[CHANNELS[0]] for p in own])
    stroke = bench.rows.conditions.lengths_m[:, 0] - home_m
    for wanted in (1e-3 * stroke, 1e-3 * stroke**2):
        left = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
        assert np.abs(left).max() <= round_off(np.linalg.cond(columns), terms=columns.size) * np.abs(wanted).max()


@pytest.mark.parametrize("home_m", np.linspace(0.35, 0.75, 9))
def test_a_stroke_from_a_home_inside_it_is_mostly_spanned_by_the_lead_of_some_form(bench, home_m):
    """Otherwise it would be refused as bent: the share must exceed what the search asks of main parameters."""
    wanted, shares = bench.rows.conditions.lengths_m[:, 0] - home_m, []
    for name in ("from_home", "from_retracted", "from_extended"):
        lead = next(p for p in bench.form("drive_scale", name).parameters if p.name == "l1_scale")
        course = lead.changes[CHANNELS[0]]
        shares.append((course @ wanted) ** 2 / ((course @ course) * (wanted @ wanted)))
    assert max(shares) > 1.5 * DEFAULT_THRESHOLDS.least_main_share


def test_one_zero_alone_is_a_part_of_the_form_of_all(bench):
    every = bench.form("drive_zero_offset", "all").parameters
    for k, name in enumerate(("l1", "l2", "l3", "theta46")):
        (alone,) = bench.form("drive_zero_offset", f"{name}_alone").parameters
        assert alone.name == every[k].name
        assert list(alone.changes) == [CHANNELS[k]]
        assert np.all(alone.changes[CHANNELS[k]] == 1e-3)


def test_homing_is_by_session(bench):
    """One constant for each drive and session; together the sessions make the offset."""
    homed = {p.name: p for p in bench.form("drive_zero_offset", "all_homed").parameters}
    sessions = [homed[f"l2_homing_session_{s}"].changes[CHANNELS[1]] for s in (1, 2, 3)]
    assert np.array_equal(sum(sessions), homed["l2_offset"].changes[CHANNELS[1]])
    for s, change in enumerate(sessions):
        assert np.array_equal(change != 0.0, bench.rows.conditions.session == s)


def test_one_session_has_no_homing(bench):
    from dataclasses import replace

    one = replace(bench.rows.conditions, session=np.zeros(len(bench.rows), dtype=np.intp))
    assert [form.name for form in EFFECTS["drive_zero_offset"].forms(one)] == [
        "all", "l1_alone", "l2_alone", "l3_alone", "theta46_alone",
    ]  # fmt: skip


def test_a_cyclic_error_is_periodic_in_the_turn(bench):
    from dataclasses import replace

    given = bench.rows.conditions
    further = replace(given, drives=given.drives + np.array([PITCH_M, -2 * PITCH_M, 7 * PITCH_M, 0.1]))
    before, after = (EFFECTS["drive_cyclic"].form("turns", c).parameters for c in (given, further))
    for p, q in zip(before, after, strict=True):
        for channel, change in p.changes.items() if not p.name.endswith("by_length") else ():
            assert np.allclose(change, q.changes[channel], rtol=0.0, atol=1e-14)


def left_of(wanted, bench, effect, form, drive="l1_"):
    """Return the residual of a course (n,) after a drive's own columns of a form, and their condition number."""
    columns = np.column_stack(
        [p.changes[CHANNELS[0]] for p in bench.form(effect, form).parameters if p.name.startswith(drive)]
    )
    return wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0], np.linalg.cond(columns)


@pytest.mark.parametrize("bend", [-1.0, 0.7, 3.0])
def test_the_wobble_of_a_bent_screw_may_grow_along_it(bench, bend):
    """A wave whose amplitude is linear in the stroke, from any origin."""
    length = bench.rows.conditions.drives[:, 0]
    wanted = 1e-3 * (1.0 + bend * length) * np.sin(2.0 * np.pi * length / PITCH_M + 0.4)
    left, condition = left_of(wanted, bench, "drive_cyclic", "turns")
    assert np.abs(left).max() <= round_off(condition, terms=10 * len(wanted)) * np.abs(wanted).max()


def test_backlash_lies_on_the_flank_to_which_force_presses(bench):
    """Where the force exceeds the friction that drags the nut, which is the same for all screws."""
    form = "pressed_from_1.06"
    given = bench.rows.conditions
    usual = np.abs(given.drive_force[:, :3]).mean()
    for k, p in enumerate(bench.form("drive_backlash", form).parameters[:3]):
        force, side = given.drive_force[:, k], given.approach[:, k]
        dragged = np.abs(force) < 1.06 * usual
        assert 0 < dragged.sum() < len(force)
        change = p.changes[CHANNELS[k]]
        assert np.array_equal(change[dragged], 1e-3 * side[dragged])
        assert np.array_equal(change[~dragged], -1e-3 * np.sign(force[~dragged]))


def test_a_model_file_may_hold_any_force_that_presses(bench):
    """It is not limited to the forms that are searched: what was learned elsewhere presses from the same force on."""
    assert "pressed_from_0.777" not in [form.name for form in EFFECTS["drive_backlash"].forms(bench.rows.conditions)]
    assert bench.form("drive_backlash", "pressed_from_0.777").name == "pressed_from_0.777"


def test_backlash_on_one_side_leaves_the_other_alone(bench):
    side = bench.rows.conditions.approach
    for form, idle in (("rising_only", -1.0), ("falling_only", 1.0)):
        for k, p in enumerate(bench.form("drive_backlash", form).parameters[:4]):
            change = p.changes[CHANNELS[k]]
            assert not change[side[:, k] == idle].any()
            assert np.allclose(change[side[:, k] != idle], -1e-3 * idle)


def test_backlash_is_fitted_for_drives_whose_side_of_approach_is_known(bench):
    """A campaign may give it for one drive only, or leave the others' columns empty."""
    backlash, campaign = EFFECTS["drive_backlash"], bench.campaign
    partly = np.where(np.arange(4) == 1, campaign.approach, np.nan)
    given = bench.rows_of(replace(campaign, approach=partly)).conditions
    assert not backlash.missing(given)
    for form in backlash.forms(given):
        assert {p.name.split("_")[0] for p in form.parameters} == {"l2"}
    first, *_ = backlash.form("both_sides", given).parameters
    whole = {p.name: p for p in backlash.form("both_sides", bench.rows.conditions).parameters}
    assert first.name == "l2_play"
    np.testing.assert_array_equal(first.changes[CHANNELS[1]], whole["l2_play"].changes[CHANNELS[1]])
    unknown = bench.rows_of(replace(campaign, approach=np.full_like(campaign.approach, np.nan))).conditions
    assert backlash.missing(unknown) == ("approach",)


def test_backlash_without_loads_has_no_load_parameters(bench):
    """The payload is not needed; without it the backlash cannot depend on it."""
    names = [p.name for p in EFFECTS["drive_backlash"].form("both_sides", bench.without("payload")).parameters]
    assert names[:4] == ["l1_play", "l2_play", "l3_play", "theta46_play"]
    assert not any("load" in name for name in names)
    assert any("load" in p.name for p in bench.form("drive_backlash", "both_sides").parameters)


def test_the_scale_of_one_drive_alone_is_its_part_of_the_form_of_all(bench):
    """Leads that depend on the length: a single screw of another batch costs no parameters of the others."""
    whole = {p.name: p for p in bench.form("drive_scale", "whole_length").parameters}
    forms = {form.name: form for form in EFFECTS["drive_scale"].forms(bench.rows.conditions)}
    alone = {name: form for name, form in forms.items() if name.endswith("_alone")}
    assert len(alone) == 3
    assert sorted(p.name for form in alone.values() for p in form.parameters) == sorted(whole)
    for form in alone.values():
        assert [p.main for p in form.parameters] == [True, False]
        for p in form.parameters:
            (own,) = p.changes
            assert np.array_equal(p.changes[own], whole[p.name].changes[own])


def test_forces_that_press_alike_are_one_form(bench):
    """Backlash without pressing is "both sides"; of a force that is even except for one row hardly two forms remain."""
    given = bench.rows.conditions
    usual = np.abs(given.drive_force).mean(axis=0)
    usual[:3] = usual[:3].mean()  # equal screws
    even = usual * np.sign(given.drive_force)
    even[0] *= 1.3
    names = {}
    for kind, force in {"own": given.drive_force, "even": even}.items():
        rows = SimpleNamespace(conditions=replace(given, drive_force=force), channels=bench.rows.channels)
        forms = Library.of(rows, {"drive_backlash": EFFECTS["drive_backlash"]}).forms
        names[kind] = [name for _, name in forms]
        flanks = [
            np.array([p.changes[c] for c, p in zip(CHANNELS, form.parameters, strict=False)]) for form in forms.values()
        ]
        assert not any(np.array_equal(one, other) for one, other in itertools.combinations(flanks, 2))
    plain = ["both_sides", "rising_only", "falling_only"]
    assert names["even"][:3] == names["own"][:3] == plain
    assert len(names["even"]) == 5 < len(names["own"])


def test_slides_without_a_screw_have_no_period():
    """A linear motor next to two screws needs no lead in the campaign and has no wobble."""
    screw, other = (Drive(name, name, "m", "angle", 0.01 / (2.0 * np.pi)) for name in "xz")
    motor = Drive("y", "y", "m", "length")
    given = {"sizes": (1.0, 0.2), "period": "pitch"}
    effect = Periodic("drive_periodic", "", (screw, motor, other), **given)
    assert (effect.needs, effect.drives) == ((), (screw, other))
    assert Periodic("drive_periodic", "", (motor,), **given).needs == ("screw_pitch_m",)


def test_the_wobble_of_a_screw_with_travel_on_both_sides_of_zero_keeps_its_size(tmp_path):
    """It grows towards one end, as for a bent screw, but moderately, and is finite where the drive never moves."""
    joint = """<joint name="{0}" type="prismatic"><parent link="{1}"/><child link="{2}"/><axis xyz="{3}"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
    links = "".join(f'<link name="{name}"/>' for name in ("bed", "saddle", "table"))
    slides = joint.format("x", "bed", "saddle", "1 0 0") + joint.format("y", "saddle", "table", "0 1 0")
    (tmp_path / "stage.urdf").write_text(f'<robot name="stage">{links}{slides}</robot>', encoding="utf-8")
    said = "name: stage\nurdf: stage.urdf\nbase_frame: bed\nend_frame: table\n"
    drives = "drives: [{joint: x, column: a}, {joint: y, column: b}]\n"
    (tmp_path / "robot.yaml").write_text(f"format: pouring_robot/robot/1\n{said}{drives}", encoding="utf-8")
    robot = RobotDefinition.load(tmp_path / "robot.yaml")
    out = np.linspace(0.02, 0.7, 20)
    commands = np.column_stack([np.concatenate([out, -out]), np.zeros(40)])
    rows = replace(bare_conditions(robot, 40), drives=commands, screw_pitch_m=0.01)
    parameters = all_effects(robot)["drive_periodic"].form("turns", rows).parameters
    sizes = {p.name: p.prior_std * np.abs(next(iter(p.changes.values()))).max() for p in parameters}
    for drive, name in itertools.product("ab", ("sine", "cosine")):
        assert sizes[f"{drive}_{name}_1_by_length"] <= 4.0 * max(sizes[f"{drive}_{name}_1"], 1e-6)
