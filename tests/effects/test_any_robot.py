"""The library of robots that declare no causes: its effects, and columns that are derivatives of the closure."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.discrepancy_processes import CONSTANT, processes_of
from pouring_robot.diagnosis.report.sentences import as_zeros_text, source_text
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.effects import all_effects
from pouring_robot.effects.base import EffectParameter, channel, checked_forms
from pouring_robot.effects.condition_facts import INERTIAS, held_still, sources
from pouring_robot.effects.conditions import Conditions, bare_conditions, complete_conditions, learned_in
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.effects.families.drives import DriveScale, Ratio
from pouring_robot.effects.robots_under_conditions import robots_under
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.residuals import whiten
from pouring_robot.exceptions import MissingConditionsError
from pouring_robot.inference.gaussian_processes.processes import Channel, Part, between, columns_of, sums_of
from pouring_robot.io.typed_yaml import read_yaml, yaml_text
from pouring_robot.robot.effect_stack import EffectEntry, ParameterEntry
from pouring_robot.robot.model import RobotModel
from tests.effects.test_base import difference, moved
from tests.examples import arm
from tests.examples.campaigns import write
from tests.examples.machines import MACHINES
from tests.support import ROOT, gantry_file

NOISE = NoiseLevel.stated(5e-5, 6e-5)
ROWS = 24
EVERY = ("joint_placement", "link_thermal_expansion", "base_drift", "metrology_scale", "session_offset")
SLIDING = ("drive_zero_offset", "drive_scale", "drive_periodic", "drive_backlash", "drive_compliance")
TURNING = ("drive_zero_offset", "drive_scale", "joint_periodic", "drive_backlash", "drive_compliance")
IDS = {
    "arm": (*TURNING, "drive_coupling", "joint_compliance", *EVERY),
    "delta": TURNING + EVERY,
    "five_bar": TURNING + EVERY,
    "hexapod": SLIDING + EVERY,
}


@pytest.fixture(scope="module", params=sorted(MACHINES))
def rows(request, tmp_path_factory):
    """Some rows of an example robot in two sessions, equal to its own predictions, so that there is no residual."""
    folder = tmp_path_factory.mktemp(request.param)
    write(folder, MACHINES[request.param], seed=3, effect="session_offset", ratio=2.0)
    model = RobotModel.for_robot(ROOT / "examples" / "robots" / request.param / "robot.yaml")
    campaign = Campaign.read(folder / "campaign.csv", model.definition)
    chosen = np.linspace(0, len(campaign) - 1, ROWS).astype(int)
    rows = CampaignRows(campaign.subset(chosen), model, NOISE)
    seen = rows.predicted(rows.unchanged(), rows.frames)
    turn = np.array([pin.log3(rotation) for rotation in seen.rotation])
    itself = replace(rows.campaign, position_m=seen.position_m, rotation_vector_rad=turn)
    again = CampaignRows(itself, model, NOISE)
    again.frames = rows.frames
    return again


@pytest.mark.parametrize(("length", "moved", "still"), [(0.8, 0.8, False), (0.8, 0.1, True), (6.0, 0.8, True)])
def test_a_rail_counts_as_moved_only_over_most_of_its_length(tmp_path, length, moved, still):
    urdf = f"""<robot name="hung"><link name="hall"/><link name="base"/><link name="tool"/>
      <joint name="rail" type="prismatic"><parent link="hall"/><child link="base"/>
        <axis xyz="1 0 0"/><limit lower="0" upper="{length}" effort="1" velocity="1"/></joint>
      <joint name="pan" type="continuous"><parent link="base"/><child link="tool"/></joint></robot>"""
    (tmp_path / "hung.urdf").write_text(urdf, encoding="utf-8")
    said = "name: hung\nurdf: hung.urdf\nbase_frame: base\nend_frame: tool\ntravel: [rail]\ndrives: [{joint: pan}]\n"
    (tmp_path / "robot.yaml").write_text(f"format: pouring_robot/robot/1\n{said}", encoding="utf-8")
    robot = RobotModel.for_robot(tmp_path / "robot.yaml").definition
    rows = replace(bare_conditions(robot), travels={"rail": np.linspace(0.0, moved, 3)})
    assert held_still("rail_m", rows) is still


def test_a_load_counts_as_varied_relative_to_what_the_robot_is_made_for():
    """An arm of 29 kg lifts ten; with half a pound more or less nothing was varied."""
    robot = RobotModel.for_robot(ROOT / "examples" / "machines" / "ur10" / "robot.yaml").definition
    for mass_kg, still in ((10.0, False), (0.2, True)):
        rows = replace(bare_conditions(robot, 4), weight_n=9.80665 * mass_kg * np.array([0.0, 1.0, 0.0, 1.0]))
        assert held_still("weight_n", rows) is still


def test_slides_expand_with_the_links_or_have_a_scale_that_does_not(rows):
    """No file says whether a screw or a glass scale measures a travel: both are forms, and mixtures of the two."""
    effect, robot = all_effects(rows.conditions.robot)["link_thermal_expansion"], rows.conditions.robot
    forms = {form.name: form for form in checked_forms(effect, rows.conditions, rows.channels)}
    sliding = {f"drive.{drive.joint}" for drive in robot.drives if drive.unit == "m"}
    whole, alone = forms["by_ambient"].parameters, forms.get("by_ambient_frame_alone")
    assert (alone is not None) == bool(sliding) == any(p.name == "drives_share" for p in whole)
    if alone is not None:
        assert set(whole[0].changes) - set(alone.parameters[0].changes) == sliding
        assert set(alone.parameters[-1].changes) == sliding
        assert set(forms["by_ambient_drives_alone"].parameters[0].changes) == sliding


@pytest.mark.parametrize(
    ("thermometer", "way"), [("ambient", "by_ambient"), ("slow", "own_temperature"), ("x", "own_temperature")]
)
def test_screws_expand_by_the_thermometer_of_their_group_or_link_or_the_hall(tmp_path, thermometer, way):
    """By α (q - q₀) ΔT from a fixed bearing anywhere, all others by the hall; no link of this gantry has a length."""
    path = gantry_file(tmp_path)
    path.write_text(path.read_text(encoding="utf-8") + "groups: {slow: [x_slide]}\n", encoding="utf-8")
    bare = bare_conditions(RobotModel.for_robot(path).definition, 5)
    rises = {"ambient": np.full(5, 2.0), thermometer: np.array([0.0, 5.0, 9.0, 12.0, 14.0])}
    forms = all_effects(bare.robot)["link_thermal_expansion"].forms(replace(bare, rises=rises))
    form = {form.name: form for form in forms}[f"{way}_drives_alone"]
    main, ends = form.parameters[0], {p.name: p for p in form.parameters}
    for k, axis in enumerate("xyz"):
        warm = rises[thermometer if axis == "x" else "ambient"]
        np.testing.assert_allclose(main.changes[f"drive.{axis}_slide"], 1e-6 * bare.drives[:, k] * warm, rtol=1e-12)
        metre = ends[f"{axis}_slide_metre"]
        np.testing.assert_allclose(metre.changes[f"drive.{axis}_slide"], 1e-6 * warm, rtol=1e-12)
        assert metre.main, "held fast at its far end, it moves the slide more than its travel does"


def test_ids_say_what_an_effect_is_and_for_which_of_several_groups(rows):
    robot = rows.conditions.robot
    found = tuple(all_effects(robot))
    assert tuple(dict.fromkeys(name.partition(".")[0] for name in found)) == IDS[robot.name]
    groups = {name.partition(".")[2] for name in found} - {""}
    assert groups == (set(robot.groups) if len(robot.groups) > 1 else set())


def test_everything_but_forces_without_a_stated_load_can_be_tested(rows):
    """The campaigns hold every condition; only tare and centre of mass of a tool are not stated where a payload is."""
    given = rows.conditions
    lacking = {effect.id.partition(".")[0] for effect in all_effects(given.robot).values() if effect.missing(given)}
    assert lacking <= {"drive_compliance"}


def test_drives_with_vertical_axes_do_not_yield_under_weight(rows):
    """Those of the five-bar turn about the vertical: neither links nor a load exert a moment on them, in any pose."""
    given, effect = rows.conditions, all_effects(rows.conditions.robot)["drive_compliance"]
    assert effect.can_occur(given) == (given.robot.name != "five_bar")
    # What it might carry counts, whether or not its load is stated and its links have masses.
    told_nothing = replace(rows.campaign, conditions={})
    again = CampaignRows(told_nothing, rows.model, NOISE).conditions
    assert effect.can_occur(replace(again, drive_force=None)) == effect.can_occur(given)


def test_backlash_of_a_drive_that_carries_nothing_has_no_part_by_load(rows):
    """Split into three parameters with the same effect, a backlash of 0.4 mrad was found as 0.2 ± 0.3."""
    given = rows.conditions
    assert given.approach is not None
    (effect,) = (effect for name, effect in all_effects(given.robot).items() if name.startswith("drive_backlash"))
    by_load = {p.name for p in effect.form("both_sides", given).parameters if "_by_load" in p.name}
    carrying = [drive.symbol for drive, force in zip(given.robot.drives, given.mean_force, strict=True) if force > 1e-6]
    assert by_load == {f"{symbol}_play_by_load{order}" for symbol in carrying for order in ("", "_2")}


def test_joints_of_an_open_chain_carry_what_lies_behind_them(rows):
    """Against virtual rotations of each joint of the examiner's own chain; in loops no joint tilts."""
    given, effect = rows.conditions, all_effects(rows.conditions.robot).get("joint_compliance")
    assert (effect is not None) == (given.robot.name == "arm")
    if effect is None:
        return
    expected = arm.moments(given.drives, rows.campaign.conditions["payload"])
    size = np.abs(expected).max()
    for k, tilted in enumerate(expected.transpose(1, 2, 0)):
        for axis, moment in zip("xyz", tilted, strict=True):
            if not arm.AXES[k]["xyz".index(axis)]:
                found = given.joint_moments[f"joint{k + 1}.r{axis}"]
                np.testing.assert_allclose(found, moment, rtol=0, atol=1e-8 * size)  # theirs is a difference quotient
    form = effect.form("all", given)
    across = {f"joint{k + 1}.r{'xyz'[axis]}" for k, axis in np.argwhere(arm.AXES == 0)}
    assert {name for p in form.parameters for name in p.changes} == across
    alone = effect.form("joint2_alone", given).parameters
    (yielding,) = (p for p in alone if "joint2.rx" in p.changes)
    assert yielding.unit == "mrad at 100 Nm"
    np.testing.assert_allclose(yielding.changes["joint2.rx"], 1e-5 * given.joint_moments["joint2.rx"], rtol=1e-12)


@pytest.mark.parametrize("payload_kg", [None, 2.0])
def test_links_without_masses_are_not_taken_for_weightless(tmp_path, payload_kg):
    """As in most published URDFs of industrial arms. The weight of a payload is known: it loads the lifting drive."""
    random = np.random.default_rng(1)
    places = random.uniform(0.1, 0.7, (12, 3))
    load = "" if payload_kg is None else ",payload_kg"
    lines = [f"x_slide_m,y_slide_m,z_slide_m,x_m,y_m,z_m{load}"]
    lines += [",".join(map(str, [*place, *place, *([payload_kg] if load else [])])) for place in places.tolist()]
    (tmp_path / "campaign.csv").write_text("\n".join(lines))
    (tmp_path / "campaign.yaml").write_text("robot: gantry\nmetrology: {sigma_position_mm: 0.05}\n")
    model = RobotModel.for_robot(gantry_file(tmp_path))
    campaign = Campaign.read(tmp_path / "campaign.csv", model.definition)
    given, effect = CampaignRows(campaign, model, NOISE).conditions, all_effects(model.definition)["drive_compliance"]
    if payload_kg is None:
        assert source_text(sources(effect.missing(given), model.definition), campaign) == f"add {INERTIAS}"
    else:
        assert not effect.missing(given)
        np.testing.assert_allclose(given.drive_force, np.tile([0.0, 0.0, -2.0 * 9.80665], (12, 1)), atol=1e-9)


def test_tilts_equivalent_to_zeros_of_the_joint_before_rotate_the_flange_alike():
    """By the examiner's chain, whose rotation does not depend on positions. No other tilt is equivalent to a zero."""
    robot = RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml").definition
    drives, size = arm.targets(np.random.default_rng(3), 5), 1e-3

    def turned(tilt=0.0, zero=0.0):
        return arm.forward(drives + zero, tilt=tilt)[1]

    found, tilts = {}, causes_of(robot).placements.tilts
    for k, tilt in enumerate(tilts):
        for axis in tilt.directions:
            moved = turned(tilt=size * np.eye(18)[3 * k + "xyz".index(axis)].reshape(6, 3))
            for j in range(6):
                apart = min(np.abs(moved - turned(zero=sign * size * np.eye(6)[j])).max() for sign in (1.0, -1.0))
                if apart < 1e-3 * size:
                    found[f"{tilt.joint}.tilt_{axis}"] = f"joint{j + 1}"
    assert found == {f"{t.joint}.tilt_{axis}": joint for t in tilts for axis, joint in t.zeros.items()}
    assert len(found) == 4
    said = as_zeros_text(["joint1.tilt_x", "joint2.tilt_z"], tilts)
    assert said.endswith("joint before: joint2.tilt z (zero of joint1)")
    assert not as_zeros_text(["joint1.tilt_x"], tilts)


def test_only_driven_joints_have_a_zero(rows):
    """The passive revolute joints of loops have none."""
    driven = {drive.joint for drive in rows.conditions.robot.drives if drive.unit == "rad"}
    tilts = rows.conditions.causes.placements.tilts
    assert {joint for tilt in tilts for joint in tilt.zeros.values()} <= driven


def test_what_depends_on_the_drives_own_values_needs_no_condition(rows):
    given, effects = rows.conditions, all_effects(rows.conditions.robot)
    entries, testable = [], {name for name, effect in effects.items() if not effect.missing(given)}
    for name in testable:
        form = effects[name].forms(given)[0]
        parameters = {p.name: ParameterEntry(value=1.0, unit=p.unit) for p in form.parameters}
        entries.append(EffectEntry(effect=name, form=form.name, learned="here", parameters=parameters))
    learned = {"here": learned_in(rows.campaign, given)}
    found = rows.not_told_by_commands(rows.model.model_copy(update={"effects": entries, "learned": learned}))
    by_command = {"drive_zero_offset", "drive_scale", "drive_periodic", "joint_periodic", "joint_placement"}
    by_command |= {"drive_coupling", "metrology_scale"}  # which does not change a command
    if not np.any(given.drive_force):
        by_command.add("drive_compliance")  # weight loads none of the drives
    assert {*found} == {name for name in testable if name.partition(".")[0] not in by_command}


@pytest.mark.parametrize("hall", [True, False])
def test_the_thermometers_asked_for_are_those_of_the_campaign_that_taught(rows, hall):
    """Any thermometer allows the effect; a form uses all those that the campaign had."""
    parts = {f"{name}_degC": 25.0 for name in rows.conditions.rises if name != "ambient"}
    campaign = rows.campaign if hall else rows.campaign.with_conditions(ambient=None)
    given = CampaignRows(campaign, rows.model, NOISE).conditions
    grown = {"expansion": ParameterEntry(value=10.0, unit="1e-6/K")}
    entry = EffectEntry(effect="link_thermal_expansion", form="own_temperature", learned="here", parameters=grown)
    there = {"effects": [entry], "learned": {"here": learned_in(campaign, given)}}
    model = rows.model.model_copy(update=there)
    for known in ({}, {"ambient_degC": 20.0}):
        with pytest.raises(MissingConditionsError) as problem:
            robots_under(model, list(given.drives[:1]), known)
        assert set(problem.value.headings) == ({"ambient_degC"} if hall and not known else {*parts})
    assert robots_under(model, list(given.drives[:1]), parts | ({"ambient_degC": 20.0} if hall else {}))


def test_columns_are_derivatives_of_the_exact_closure(rows, rng):
    """For every form one random parameter and the first."""
    linear = rows.linearise(rows.unchanged(), rows.frames)
    given = rows.conditions
    for effect in all_effects(given.robot).values():
        if effect.missing(given):
            continue
        form = checked_forms(effect, given, rows.channels)[0]
        for place in {0, int(rng.integers(len(form.parameters)))}:
            parameter = form.parameters[place]
            if not any(np.abs(change).max() > 0.0 for change in parameter.changes.values()):
                continue  # the parameter has no effect in these rows
            found = np.zeros((len(rows), 6))
            found[linear.row, linear.component] = rows.column(parameter, linear)
            expected = parameter.prior_std * difference(rows, rows.frames, parameter)
            size = max(1.0, np.abs(expected).max())
            assert np.abs(found - expected).max() <= 1e-5 * size, (effect.id, parameter.name)


def test_both_ends_of_a_distance_between_rows_move_by_their_own_conditions(rows, rng):
    place = rows.predicted(rows.unchanged(), rows.frames).position_m
    distances = {
        "position_m": np.full((ROWS, 3), np.nan),
        "rotation_vector_rad": None,
        "distance_m": np.linalg.norm(place - np.roll(place, 7, axis=0), axis=1)[:, None],
        "distance_from": tuple(np.roll(rows.campaign.samples, 7).tolist()),
    }
    apart = CampaignRows(replace(rows.campaign, **distances), rows.model, NOISE)
    linear = apart.linearise(apart.unchanged(), rows.frames)
    assert len(linear.residual) == ROWS
    for effect in all_effects(apart.conditions.robot).values():
        if effect.missing(apart.conditions):
            continue
        parameter = checked_forms(effect, apart.conditions, apart.channels)[0].parameters[0]
        step = 1e-5 / max(1e-3, *(float(np.abs(change).max()) for change in parameter.changes.values()))
        ends = [moved(apart, rows.frames, parameter, size) for size in (-step, step)]
        read, less = (whiten(apart.measured, seen).residual for seen in ends)
        expected = parameter.prior_std * (read - less) / (2.0 * step)
        found = apart.column(parameter, linear)
        np.testing.assert_allclose(found, expected, atol=1e-4 * max(1.0, np.abs(expected).max()), err_msg=effect.id)
    # Unknown effects move them likewise.
    name, course = channel(apart.conditions.robot.drives[0]), rng.normal(size=(ROWS, 1))
    sums = sums_of(linear.row, ROWS)
    plain = Part(Channel("", np.ones(ROWS), sums), course)
    # An effect of varying size, and a drive.
    for change in (rng.normal(size=ROWS), np.ones(ROWS)):
        part = Part(apart.moving("any", {name: change}, linear, sums), course)
        expected = apart.column(EffectParameter("any", "rad", 1.0, {name: change * course[:, 0]}), linear)
        np.testing.assert_allclose(columns_of([part])[:, 0], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    first = columns_of([Part(apart.moving_drives(linear, sums)[0], course)])
    np.testing.assert_allclose(first, columns_of([part]), rtol=1e-12)
    np.testing.assert_allclose(between([plain], [part]), [[course[:, 0] @ expected]], rtol=1e-9)


def test_orders_of_a_joint_are_reported_together():
    """Closed form: amplitudes 3 and 4 at order 2 give 5, and 5 / √2 rms."""
    robot = RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml").definition
    effect = all_effects(robot)["joint_periodic"]
    first, second = (drive.symbol for drive in robot.drives[:2])
    said = effect.in_words({f"{first}_sine_2": 3.0, f"{first}_cosine_2": -4.0, f"{second}_sine_1": 0.0}, {})
    assert "3.536 mrad rms" in said[0]
    assert said[0].endswith("2 (5.000)")
    assert said[1].startswith(f"{robot.drives[1].words}: 0.000 mrad rms")
    assert len(said) == 2  # a form of some joints alone says nothing of the others


@pytest.mark.parametrize(("known_to", "lead", "more"), [
    (1.0, "+98 ± 12 ppm at zero, +40 ± 24 ppm more per metre", "5.000490 ± 0.000059 mm per turn"),
    (10.0, "+0.010 ± 0.012 % at zero, +0.004 ± 0.024 % more per metre", "5.00049 ± 0.00059 mm per turn"),
])  # fmt: skip
def test_a_lead_has_the_digits_that_its_interval_supports(known_to, lead, more):
    drive = RobotModel.for_robot(ROOT / "examples" / "robots" / "hexapod" / "robot.yaml").definition.drives[0]
    values = {f"{drive.symbol}_scale": 0.098, f"{drive.symbol}_progression": 0.020}  # mm/m, mm/m²
    stds = dict.fromkeys(values, 0.006 * known_to)
    (said,) = DriveScale(
        "drive_scale", "", (drive, replace(drive, joint="other", symbol="other")), build_up=True
    ).in_words(values, stds)
    assert said == f"{drive.words}: lead error {lead} (95 %)"
    by_motor = replace(drive, command="angle", factor=0.005 / (2.0 * np.pi))
    (said,) = DriveScale("drive_scale", "", (by_motor,), build_up=True).in_words(values, stds)
    assert said.startswith(f"{drive.words}: lead error {lead}; that is {more}, ")


@pytest.mark.parametrize(
    ("share", "std", "said"),
    [(30.0, 0.006, "+3.0000 ± 0.0012 %"), (-0.3, 0.006, "-300 ± 12 ppm"), (0.0, 21.5, "+0.0 ± 4.2 %")],
    ids=["percent", "ppm", "hardly known"],
)
def test_a_ratio_is_reported_as_a_share(share, std, said):
    drive, other, *_ = RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml").definition.drives
    name = f"{drive.symbol}_scale"
    ratio, told = (
        Ratio("drive_scale", "", (drive, other)),
        f"{drive.words}: it turns {said} further than commanded",
    )
    assert ratio.in_words({name: share}, {name: std}) == (f"{told} (95 %)",)
    home = {f"{drive.symbol}_home": 10.0}  # a drive with a wrong home has an offset besides the error of its ratio
    (line,) = ratio.in_words({name: share, **home}, {name: std, **dict.fromkeys(home, 0.5)})
    assert line == f"{told}, and is +10.00 ± 0.98 mrad off at count zero (95 %)"


def yields(folder, efforts):
    """Return the usual sizes of the compliance of a UR10's drives, (6,), for the efforts in its URDF."""
    source = ROOT / "examples" / "machines" / "ur10"
    said = iter(efforts)
    text = re.sub(r'effort="[^"]*"', lambda _: f'effort="{next(said)}"', (source / "ur10.urdf").read_text())
    assert next(said, None) is None
    folder.mkdir()
    (folder / "ur10.urdf").write_text(text)
    shutil.copy(source / "robot.yaml", folder)
    robot = RobotModel.for_robot(folder / "robot.yaml").definition
    still, one = np.zeros((1, len(robot.drives))), np.zeros(1)
    session = np.zeros(1, dtype=np.intp)
    given = Conditions(robot, still, np.zeros((1, 3)), np.eye(3)[None], session, one, True, drive_force=still)
    form = all_effects(robot)["drive_compliance"].form("spring", given)
    return np.array([parameter.prior_std for parameter in form.parameters if parameter.main])


def test_drives_with_lower_effort_limits_are_softer_in_proportion(tmp_path):
    """At their limits they deflect alike, with the usual mean compliance; where one limit is missing, all are alike."""
    efforts = np.array([330.0, 330.0, 150.0, 54.0, 54.0, 27.0])
    sizes = yields(tmp_path / "said", efforts.tolist())
    np.testing.assert_allclose(sizes * efforts, sizes[0] * efforts[0], rtol=1e-12)
    assert sizes.prod() == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_array_equal(yields(tmp_path / "unsaid", [330.0, 330.0, 0.0, 54.0, 54.0, 27.0]), np.ones(6))


def test_no_joint_is_misplaced_where_the_robot_file_rules_it_out(tmp_path):
    said = read_yaml(ROOT / "examples" / "machines" / "ur10" / "robot.yaml")
    said |= {"urdf": str(ROOT / "examples" / "machines" / "ur10" / "ur10.urdf"), "places": []}
    (tmp_path / "robot.yaml").write_text(yaml_text(said))
    robot = RobotModel.for_robot(tmp_path / "robot.yaml").definition
    names = [p.name for p in all_effects(robot)["joint_placement"].forms(complete_conditions(robot))[0].parameters]
    assert names and all(".tilt_" in name for name in names)
    (tmp_path / "robot.yaml").write_text(yaml_text(said | {"axes": []}))
    assert "joint_placement" not in all_effects(RobotModel.for_robot(tmp_path / "robot.yaml").definition)


def test_a_constant_displacement_is_equivalent_to_a_known_effect(rows):
    """It is no separate explanation in that one's place: the effect's own parameters make all of it."""
    linear, given = rows.linearise(rows.unchanged(), rows.frames), rows.conditions
    known, said = all_effects(given.robot), set()
    for process in processes_of(rows, linear, np.eye(3)):
        if process.by == CONSTANT:
            said |= process.same_as
            for effect in process.same_as:
                forms = checked_forms(known[effect], given, rows.channels)
                own = np.column_stack([rows.column(p, linear) for form in forms for p in form.parameters])
                columns = columns_of(process.lengths[""])
                basis = scipy.linalg.orth(own / np.linalg.norm(own, axis=0).clip(min=1e-300), rcond=1e-9)
                left = np.linalg.norm(columns - basis @ (basis.T @ columns), axis=0)
                assert (left <= 1e-6 * np.linalg.norm(columns)).all()
    zeros = {effect for effect in known if effect.partition(".")[0] == "drive_zero_offset"}
    assert said == {*zeros, "joint_placement"}


def test_nothing_unknown_moves_a_seen_position_where_none_is_measured():
    """For a Maslow, of which only four belts are measured, "seen place by pose" was reported."""
    machine = ROOT / "examples" / "machines" / "hangprinter"
    model = RobotModel.for_robot(machine / "robot.yaml")
    campaign = Campaign.read(machine / "samples.csv", model.definition)
    lines = CampaignRows(campaign, model, NOISE)
    linear = lines.linearise(lines.unchanged(), lines.frames)
    moved = {process.where for process in processes_of(lines, linear, np.eye(3))}
    assert "readings" in moved and not any("place" in where for where in moved)
