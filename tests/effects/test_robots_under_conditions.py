"""Effects that depend on conditions, applied to the robot at any command: the same robot that a diagnosis closes."""

import dataclasses
import re

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot import (
    HeatedRobot,
    PlatformPose,
    RobotUnderConditions,
    compensate,
    compensate_under,
    random_plan,
    robots_under,
    simulate_campaign,
)
from pouring_robot.batch import engine_for
from pouring_robot.cli.app import main
from pouring_robot.compensation.pose import compensate_drives
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.effects import all_effects
from pouring_robot.effects.conditions import learned_in, recorded
from pouring_robot.estimation.changes import RowChanges
from pouring_robot.exceptions import (
    BadInputError,
    DescriptionError,
    MissingConditionsError,
    NoSolutionError,
    UnsettledCommandsError,
)
from pouring_robot.io.typed_yaml import read_yaml, yaml_text
from pouring_robot.io.units import joint_shown_in
from pouring_robot.robot.effect_stack import EffectEntry, LearnedCampaign, ParameterEntry
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import robot_of
from pouring_robot.thermal.expansion.warm_pouring_robot import drawing_of
from tests.effects.bench import EFFECTS, NOISE, SIGMA_M
from tests.examples.machines import MACHINES
from tests.support import LEARNED, ROOT, random_poses

MOVING = [effect for effect in EFFECTS.values() if effect.moves_robot]


def entry_of(kind, conditions, random, form=0):
    """Return an effect in one of its forms with random values, as a diagnosis writes it."""
    form = kind.forms(conditions)[form]
    values = {
        p.name: ParameterEntry(value=0.3 * p.prior_std * float(random.normal()), unit=p.unit) for p in form.parameters
    }
    return EffectEntry(effect=kind.id, form=form.name, learned="bench", parameters=values)


def model_with(rows, *entries, **given):
    """Return a robot that has learned effects in the campaign of some rows."""
    learned = {"bench": learned_in(rows.campaign, rows.conditions)}
    return RobotModel(effects=list(entries), learned=learned, **given)


def given_of(campaign):
    """Return the conditions of a campaign by heading, as a user would give them."""
    drives = {quantity.canonical for quantity in campaign.robot.drive_columns}
    sides = {f"approach_q{k + 1}": campaign.approach[:, k] for k in range(4)}
    numbers = {heading: values for heading, values in recorded(campaign).items() if heading not in drives}
    return sides | numbers | {"session": campaign.sessions}


def places(robots, drives):
    """Return the poses of the end bodies of robots in the base, (n, 4, 4)."""
    both = zip(robots, drives, strict=True)
    return np.array([robot.location_at(row).actual.pose_base_to_end.homogeneous for robot, row in both])


def predicted(rows):
    """Return the same for the rows of a diagnosis: closed at once, the base displaced behind the closure."""
    frames = dataclasses.replace(rows.frames, T_tracker_base=pin.SE3.Identity(), T_end_target=pin.SE3.Identity())
    seen = rows.predicted(rows.unchanged(), frames)
    return np.concatenate([seen.rotation, seen.position_m[:, :, None]], axis=2)


def rows_of(campaign, model):
    return CampaignRows(campaign, model, NOISE)


BASE_JOINT = "base_link-base_fixed_joint"  # which may stand for the link that it carries
SOME = slice(None, None, 5)
"""Rows to be compared: they are closed one at a time, which takes long."""
CROOKED = {"leg2_s1": {"translation_mm": (0.3, -0.2, 0.1), "rotation_mrad": (0.4, 0.1, -0.3)}}


@pytest.fixture(scope="module")
def bare(bench):
    """Poses of a crooked robot in some rows of the campaign, without effects."""
    drives = bench.campaign.drives[SOME]
    return places([robot_of(RobotModel(joint_placements=CROOKED))] * len(drives), drives)


@pytest.mark.parametrize("kind", MOVING, ids=lambda kind: kind.id)
def test_a_robot_has_the_poses_that_the_diagnosis_predicts(bench, bare, rng, kind):
    """Rows out of order, first and last form; 1e-7 m: the robot composes placements, a diagnosis adds twists."""
    rows = rows_of(bench.campaign, RobotModel())
    for form in {0, len(kind.forms(rows.conditions)) - 1}:
        model = model_with(rows, entry_of(kind, rows.conditions, rng, form), joint_placements=CROOKED)
        robots = robots_under(model, list(bench.campaign.drives), given_of(bench.campaign))
        found = places(robots[SOME], bench.campaign.drives[SOME])
        expected = predicted(rows_of(bench.campaign, model))[SOME]
        assert np.abs(found[:, :3] - expected).max() <= 1e-7
        assert np.abs(found - bare).max() >= 1e-6, "the effect must do something in these rows"


def moved_base(model):
    """Return the end body's pose at home with the base moved, and the same in closed form: the displaced robot."""
    robot, home = robot_of(model), model.definition.home_drives
    moved = np.array([1e-3, -2e-3, 0.5e-3, 1e-3, 2e-3, -1e-3])
    names = [f"base.{name}" for name in ("tx", "ty", "tz", "rx", "ry", "rz")]
    structure = engine_for(robot.nominal_solver.mechanism).structure
    changes = RowChanges.of(dict(zip(names, moved[:, None], strict=True)), structure, 1)
    standing = RobotUnderConditions(robot, {})._standing(changes, 0, structure.site_joints)
    there = pin.SE3(pin.exp3(moved[3:]), moved[:3]) * robot.location_at(home).actual.pose_base_to_end
    return standing.location_at(home).actual.pose_base_to_end.homogeneous, there.homogeneous


@pytest.mark.parametrize("machine", sorted(MACHINES))
def test_a_moving_base_moves_any_robot(machine):
    found, there = moved_base(RobotModel.for_robot(ROOT / "examples" / "robots" / machine / "robot.yaml"))
    np.testing.assert_allclose(found, there, atol=1e-9)


@pytest.mark.parametrize("machine", [*sorted(MACHINES), None])
def test_a_robot_on_a_moving_base_is_a_robot_like_any_other(tmp_path, capsys, machine):
    """It can be saved and read again, and no note says that its model file does not displace something."""
    model = RobotModel.for_robot(ROOT / "examples" / "robots" / machine / "robot.yaml") if machine else RobotModel()
    moved = {"tx": ParameterEntry(value=2.0, unit="mm")}
    entry = EffectEntry(effect="base_drift", form="steady", learned="here", parameters=moved)
    said = {"ranges": {"time_s": (0.0, 1000.0)}, "sessions": {"1": 9}, "reference_temperature_degC": 20.0}
    learned = LearnedCampaign(mean_span_m=[0.5] * len(model.definition.drives), **said)
    model.model_copy(update={"effects": [entry], "learned": {"here": learned}}).save(tmp_path / "taught.yaml")
    home = model.definition.home_drives if machine else np.array([0.6, 0.6, 0.75, 0.1])
    (robot,) = RobotUnderConditions(tmp_path / "taught.yaml", {"time_s": 900.0}).robots([home])
    robot.model.model_copy(update={"effects": [], "learned": {}}).save(tmp_path / "standing.yaml")
    again = robot_of(RobotModel.load(tmp_path / "standing.yaml")).location_at(home).difference()
    assert again.translation_m == pytest.approx([0.8e-3, 0.0, 0.0], abs=1e-7)
    shown = [value / joint_shown_in(drive.unit)[1] for drive, value in zip(model.definition.drives, home, strict=True)]
    wanted = ["pose", "--model", str(tmp_path / "taught.yaml"), "--condition", "time_s=900", "--drives"]
    assert main([*wanted, " ".join(map(str, shown))]) == 0
    assert "displacing" not in capsys.readouterr().out


@pytest.mark.parametrize(("base", "end"), [("base", "tool0"), ("tool0", "base"), (BASE_JOINT, "tool0")])
def test_a_base_frame_that_carries_nothing_moves_too(tmp_path, base, end):
    """Such as the frame in which a UR's controller gives poses, or the tool, from which the arm's foot moves."""
    shipped = ROOT / "examples" / "machines" / "ur10" / "robot.yaml"
    said = read_yaml(shipped) | {"base_frame": base, "end_frame": end, "payload_frame": end}
    path = tmp_path / "robot.yaml"
    path.write_text(yaml_text(said | {"urdf": str(shipped.with_name("ur10.urdf"))}), encoding="utf-8")
    found, there = moved_base(RobotModel.for_robot(path))
    np.testing.assert_allclose(found, there, atol=1e-9)


AXIS = '<axis xyz="0 0 1"/></joint>'
PIVOT = '<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/><origin xyz="{}"/>' + AXIS
MOUNT = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/><origin xyz="{}"/></joint>'
FOUR_BAR = [
    *(f'<link name="{name}"/>' for name in ("ground", "base", "crank", "bar", "tip", "rocker", "foot", "seen")),
    MOUNT.format("stand", "ground", "base", "0 0 0"),
    PIVOT.format("drive", "base", "crank", "-1 0 0"),
    PIVOT.format("elbow", "crank", "bar", "0 1 0"),
    MOUNT.format("mount", "bar", "tip", "0.5 0.2 0"),
    PIVOT.format("knee", "bar", "rocker", "1 0 0"),
    MOUNT.format("end", "rocker", "foot", "0 -1 0"),
]
FOUR_BAR_FILE = """format: pouring_robot/robot/1
name: four_bar
urdf: four_bar.urdf
base_frame: {0}
end_frame: {1}
drives: [{{joint: drive}}]
loops: [{{name: loop, frame_a: foot, frame_b: base, type: 3d}}]
"""


@pytest.mark.parametrize(("base", "end"), [("base", "tip"), ("ground", "tip"), ("bar", "ground")])
def test_a_base_on_which_chains_end_needs_a_link_of_its_own_to_move(tmp_path, base, end):
    """Only placements of joints move a base: a loop's frame, or the joint that carries it, has none there."""
    path = tmp_path / "robot.yaml"
    parts = "".join((*FOUR_BAR, MOUNT.format("seat", base, "seen", "0 0 0")))
    (tmp_path / "four_bar.urdf").write_text(f'<robot name="four_bar">{parts}</robot>', encoding="utf-8")
    path.write_text(FOUR_BAR_FILE.format(base, end), encoding="utf-8")
    if base != "ground":
        with pytest.raises(DescriptionError, match=f"chains end on base_frame '{base}' without a joint that can"):
            moved_base(RobotModel.for_robot(path))
    path.write_text(FOUR_BAR_FILE.format("seen", end), encoding="utf-8")
    np.testing.assert_allclose(*moved_base(RobotModel.for_robot(path)), atol=1e-9)


def test_rows_alone_are_predicted_as_among_others(bench, rng):
    """Shapes refer to the campaign they were learned in, not to the rows at hand."""
    rows = rows_of(bench.campaign, RobotModel())
    some = np.array([3, 9, 17, 25, 33, 40, 58, 66])
    for name in ("base_drift", "drive_backlash", "leg_thermal_expansion", "drive_zero_offset"):
        kind = EFFECTS[name]
        entry = entry_of(kind, rows.conditions, rng, -1)
        settled = {n: p for n, p in entry.parameters.items() if not n.startswith("lag")}
        model = model_with(rows, entry.model_copy(update={"parameters": settled}))
        every, alone = (predicted(rows_of(c, model)) for c in (bench.campaign, bench.campaign.subset(some)))
        np.testing.assert_allclose(alone, every[some], atol=1e-9)


def test_an_effect_of_the_measuring_device_moves_no_robot(bench):
    rows = rows_of(bench.campaign, RobotModel())
    scale = {"scale": ParameterEntry(value=500.0, unit="1e-6")}
    model = model_with(rows, EffectEntry(effect="metrology_scale", form="constant", learned="bench", parameters=scale))
    under = RobotUnderConditions(robot_of(model), {})
    (standing,) = under.robots(bench.campaign.drives[:1])
    assert standing.model.joint_placements == {}
    assert under.notes == ("metrology_scale does not move the robot, only what is measured",)


def test_a_wrong_device_sees_the_robots_by_its_scale(bench, rng):
    """The robots are those without it; the scale is that of its form, in millionths per kelvin of the air."""
    rows = rows_of(bench.campaign, RobotModel())
    air = {"scale_by_air": ParameterEntry(value=20.0, unit="1e-6/K")}
    device = EffectEntry(effect="metrology_scale", form="air", learned="bench", parameters=air)
    model = model_with(rows, entry_of(EFFECTS["base_drift"], rows.conditions, rng, -1), device)
    drives, given = bench.campaign.drives[:3], {"time_s": [3e3, 4e3, 5e3], "session": bench.campaign.sessions[0]}
    under = RobotUnderConditions(model, given | {"ambient_degC": [18.0, 21.0, 30.0]})
    robots, scale = under.seen(drives)
    assert not [note for note in under.notes if "does not move the robot" in note]
    assert [robot.model for robot in robots] == [robot.model for robot in under.robots(drives)]
    mean = np.mean(bench.campaign.conditions["ambient"])
    np.testing.assert_allclose(scale, 20e-6 * (np.array([18.0, 21.0, 30.0]) - mean), rtol=1e-9)
    with pytest.raises(MissingConditionsError) as problem:
        RobotUnderConditions(model, {}).seen(drives)
    assert problem.value.headings == ("time_s", "ambient_degC"), "what it goes by is asked for with what robots do"


def test_sides_of_approach_follow_from_the_order(bench):
    rows = rows_of(bench.campaign, RobotModel())
    play = {"l1_play": ParameterEntry(value=0.2, unit="mm")}
    model = model_with(rows, EffectEntry(effect="drive_backlash", form="both_sides", learned="bench", parameters=play))
    poses = [PlatformPose.from_mm_deg(-100, 0, z, 0) for z in (-600, -650, -620)]
    offsets = [
        [robot.model.drive_offsets["leg1_s3"].offset_mm for robot in robots_under(model, order, {"payload_kg": 200.0})]
        for order in (poses, poses[::-1])
    ]
    np.testing.assert_allclose(np.abs(offsets), 0.2, atol=1e-12)
    down = np.sign(offsets[0][0])  # the first one rises
    assert np.sign(offsets).tolist() == [[down, down, -down], [down, down, -down]]
    told = {"payload_kg": 200.0, "approach_q2": [1.0, 1.0, -1.0]}  # of one drive; the others follow all the same
    partly = [robot.model.drive_offsets["leg1_s3"].offset_mm for robot in robots_under(model, poses, told)]
    assert partly == offsets[0]
    with pytest.raises(MissingConditionsError, match="'drive_backlash' needs approach_q1, approach_q2"):
        robots_under(model, poses[:1], {"payload_kg": 200.0})
    others = {"payload_kg": 200.0, "approach_q2": 1.0, "approach_q4": 1.0}  # a single pose has no order
    with pytest.raises(MissingConditionsError, match="'drive_backlash' needs approach_q1, approach_q3: "):
        robots_under(model, poses[:1], others)


LACKING = {
    "leg_thermal_expansion": ("leg3_degC", "leg3_degC"),
    "platform_thermal_expansion": ("platform_degC", "platform_degC"),
    "leg_compliance": ("payload_kg", "payload_kg"),
    "truss_deflection": ("truss_travel_m", "truss_travel_m"),
    "drive_backlash": ("payload_kg", "payload_kg"),
    "base_drift": ("time_s", "time_s"),
}


@pytest.mark.parametrize(("name", "lost"), [*LACKING.items(), ("drive_zero_offset", ("session", "session"))])
def test_a_missing_condition_is_named_with_how_to_give_it(bench, rng, name, lost):
    rows, (heading, said) = rows_of(bench.campaign, RobotModel()), lost
    model = model_with(rows, entry_of(EFFECTS[name], rows.conditions, rng, -1))
    given = given_of(bench.campaign)
    del given[heading]
    with pytest.raises(MissingConditionsError) as problem:
        robots_under(model, list(bench.campaign.drives), given)
    assert problem.value.effect == name
    assert said in problem.value.headings
    assert "ladle" not in str(problem.value), "the ladle's mass stands in the model"
    assert f"--condition {problem.value.headings[0]}=VALUE" in str(problem.value)
    assert "\n" not in str(problem.value)


def test_conditions_that_several_effects_miss_are_asked_for_at_once(bench, rng):
    """They are those that each effect asks for; a load that one of them needs cannot be replaced by forces."""
    rows, kinds = rows_of(bench.campaign, RobotModel()), ("tilt_drive_compliance", "base_drift", "truss_deflection")
    entries = [entry_of(EFFECTS[name], rows.conditions, rng, -1) for name in kinds]
    asked, moved = [], list(bench.campaign.drives)
    for some in (*([entry] for entry in entries), entries):
        with pytest.raises(MissingConditionsError) as problem:
            robots_under(model_with(rows, *some), moved, {})
        asked.append(problem.value)
    *each, together = asked
    assert {*together.headings} == {heading for one in each for heading in one.headings}
    assert len(together.headings) == len({*together.headings}) > max(len(one.headings) for one in each)
    assert (together.effect, *together.others) == kinds
    first, second, third = kinds
    begin = f"the model's effects '{first}', '{second}', '{third}' need {', '.join(together.headings)}: give a column"
    assert str(together).startswith(begin)
    given = {name: values for name, values in given_of(bench.campaign).items() if name in together.headings}
    assert len(robots_under(model_with(rows, *entries), moved, given)) == len(moved)


def test_lags_need_times_only_where_conditions_vary(bench, rng):
    rows = rows_of(bench.campaign, RobotModel())
    model = model_with(rows, entry_of(EFFECTS["leg_thermal_expansion"], rows.conditions, rng))
    given = {heading: values for heading, values in given_of(bench.campaign).items() if heading.endswith("degC")}
    with pytest.raises(MissingConditionsError, match="needs time_s:"):
        robots_under(model, list(bench.campaign.drives), given)
    first = {heading: values[0] for heading, values in given.items()}
    assert len(robots_under(model, list(bench.campaign.drives[:3]), first)) == 3  # nothing changes from row to row
    (standing,) = robots_under(model, [bench.campaign.drives[0]], first)  # in equilibrium at the given temperatures
    assert standing.model.drive_offsets


def test_another_session_has_no_homing_error_of_its_own(bench, rng):
    rows = rows_of(bench.campaign, RobotModel())
    kind = EFFECTS["drive_zero_offset"]
    homed, plain = (entry_of(kind, rows.conditions, np.random.default_rng(1), form) for form in (-1, 0))
    homed = entry_of(
        kind,
        rows.conditions,
        np.random.default_rng(1),
        [f.name for f in kind.forms(rows.conditions)].index("all_homed"),
    )
    command = [bench.campaign.drives[0]]
    (new,) = robots_under(model_with(rows, homed), command, {"session": "tomorrow"})
    (none,) = robots_under(model_with(rows, plain), command, {})
    assert new.model.drive_offsets == none.model.drive_offsets
    (known,) = robots_under(model_with(rows, homed), command, {"session": bench.campaign.sessions[0]})
    assert known.model.drive_offsets != none.model.drive_offsets


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"ambient_C": 30.0},
            "'ambient_C' is not a condition of pouring_robot; did you mean 'ambient_degC' or 'ambient_K'?",
        ),
        ({"leg1_degK": 40.0}, "'leg1_degK' is not a condition of pouring_robot; did you mean 'leg1_degC' or 'leg1_K'?"),
        ({"leg1": 200.0}, "'leg1' is not a condition of pouring_robot; did you mean 'leg1_degC' or 'leg1_K'?"),
        ({"time_s": 1.0, "time_min": 1.0}, "'time_min': the condition 'time' is given twice"),
        ({"leg1_degC": [20.0, 1e300]}, "leg1_degC of command 2: 1e+300 degC is hotter than any melt"),
        ({"time_s": "noon"}, "time_s: give a finite number for every command, not noon"),
        ({"time_s": [1.0, np.nan]}, "time_s: give a finite number for every command"),
        ({"time_s": np.ma.masked_equal([1.0, 0.0], 0.0)}, "time_s: give a finite number for every command"),
        ({"leg1_degC": -300.0}, "leg1_degC: -300 degC lies below absolute zero"),
        ({"leg1_degC": [20.0, 9999.0]}, "leg1_degC of command 2: 9999 degC is hotter than any melt"),
        ({"payload_kg": -3.0}, "payload_kg: -3 kg is not a possible load (0 to 10000 kg)"),
        ({"approach_q1": 0.5}, "approach_q1: give +1 or -1 for every command, not 0.5"),
        ({"time_s": [1.0, 2.0, 3.0]}, "give each condition one value, or one for each of the 2 commands"),
        ({"time_s": 0.0, "session": [1.0, 2.0]}, "each sample, session and distance_from of a campaign is a text"),
        ({"time_s": 0.0, "session": None}, "is a text, not a NoneType"),
        ({3: 0.0}, "the key of a condition must be a heading of a campaign, not a int"),
    ],
)
def test_bad_conditions_are_refused_in_one_line(bench, given, said):
    rows = rows_of(bench.campaign, RobotModel())
    model = model_with(rows, EffectEntry(effect="base_drift", form="steady", learned="bench"))
    with pytest.raises(BadInputError) as problem:
        robots_under(model, list(bench.campaign.drives[:2]), {"time_s": 0.0} | given if "time_s" in given else given)
    assert said in str(problem.value)
    assert "\n" not in str(problem.value)


def test_an_effect_without_the_campaign_that_taught_it_is_refused(tmp_path):
    path = RobotModel(effects=[EffectEntry(effect="base_drift", form="steady")]).save(tmp_path / "model.yaml")
    model = RobotModel.load(path)
    with pytest.raises(
        DescriptionError, match=f"{path}: .* 'base_drift' does not say in which campaign it was learned"
    ):
        RobotUnderConditions(robot_of(model), {})


def test_a_drift_learned_without_times_is_refused_elsewhere(bench):
    rows = rows_of(bench.campaign.with_conditions(time=None), RobotModel())
    drift = {"tx": ParameterEntry(value=0.3, unit="mm")}
    model = model_with(rows, EffectEntry(effect="base_drift", form="steady", learned="bench", parameters=drift))
    for given in ({"time_s": 10.0}, {}):
        with pytest.raises(BadInputError, match="learned in a campaign without times, so it is unknown"):
            robots_under(model, [bench.campaign.drives[0]], given)
    again = predicted(rows_of(rows.campaign, model))
    assert np.ptp(again[:, 0, 3] - predicted(rows)[:, 0, 3]) == pytest.approx(0.3e-3, rel=1e-3)


@pytest.mark.parametrize("kind", ["leg_thermal_expansion", "platform_thermal_expansion"])
def test_expansion_learned_without_times_is_applied_by_thermometers(bench, rng, kind):
    rows = rows_of(bench.campaign.with_conditions(time=None), RobotModel())
    model = model_with(rows, entry_of(EFFECTS[kind], rows.conditions, rng))
    rows, given = rows_of(rows.campaign, model), given_of(rows.campaign)
    some = slice(2, 5)
    robots = robots_under(model, rows.campaign.drives[some], {name: value[some] for name, value in given.items()})
    assert places(robots, rows.campaign.drives[some])[:, :3] == pytest.approx(predicted(rows)[some], abs=1e-8)


def test_conditions_beyond_those_learned_are_reported(bench):
    rows = rows_of(bench.campaign, RobotModel())
    model = model_with(rows, EffectEntry(effect="base_drift", form="steady", learned="bench"))
    under = RobotUnderConditions(robot_of(model), {"time_h": 1000.0})
    assert repr(under) == "<RobotUnderConditions: layout paper, 1 effect under time>"
    under.robots(bench.campaign.drives[:1])
    (line,) = under.notes
    last = bench.campaign.time_s.max()
    assert line.startswith("time_s 3.6e+06 lies outside ")
    assert f"{last:.6g}, over which effects were learned" in line


def test_conditions_far_beyond_those_learned_are_named_where_the_effect_becomes_too_large(bench):
    """A drift extrapolated for weeks moves the robot by metres: no unit is wrong then, unless it was before."""
    rows = rows_of(bench.campaign, RobotModel())
    said = []
    for value in (1.0, 1e4):
        drift = {"tx": ParameterEntry(value=value, unit="mm")}
        entry = EffectEntry(effect="base_drift", form="steady", learned="bench", parameters=drift)
        with pytest.raises(BadInputError) as problem:
            robots_under(model_with(rows, entry), [bench.campaign.drives[0]], {"time_h": 10000.0})
        said.append(str(problem.value))
    last = bench.campaign.time_s.max()
    assert re.fullmatch(
        rf"time_s 3.6e\+07 lies outside .* to {last:.6g}, over which .*; there '.* mm is too large .*", said[0]
    )
    assert "check the unit" not in said[0] and "measure there" in said[0] and "\n" not in said[0]
    assert "check the unit" in said[1] and "lies outside" not in said[1]


COMPENSATED = ("leg_compliance", "drive_cyclic", "base_drift", "tilt_encoder_eccentricity", "leg_thermal_expansion")


def test_compensation_closes_the_error_by_the_closure_of_a_diagnosis(bench, rng):
    """The drives found are taken as rows of a campaign: the poses that a diagnosis predicts are the wanted ones."""
    rows = rows_of(bench.campaign, RobotModel())
    model = model_with(rows, *(entry_of(EFFECTS[name], rows.conditions, rng) for name in COMPENSATED))
    wanted = random_poses(12, 4)
    given = {h: v[:12] for h, v in given_of(bench.campaign).items()}
    under = RobotUnderConditions(robot_of(model), given)
    found = compensate_under(under, wanted, lambda k, robot: compensate(HeatedRobot(robot), wanted[k]))
    commands = np.array([list(one.drives.values()) for one in found])
    campaign = dataclasses.replace(bench.campaign.subset(np.arange(12)), drives=commands)
    reached = predicted(rows_of(campaign, model))[:, :, 3]
    off = np.linalg.norm(reached - [pose.position_m for pose in wanted], axis=1)
    assert off.max() <= 1e-7  # the robot composes placements, a diagnosis adds twists
    before = np.array([one.before.distance_m for one in found])
    plain = robots_under(under.robot, wanted, given)
    located = zip(plain, wanted, strict=True)
    end = bench.campaign.robot.loops.end_frame
    expected = np.array([robot.locate(pose).difference(end).distance_m for robot, pose in located])
    np.testing.assert_allclose(before, expected, atol=1e-9)
    assert np.median(before) > 10.0 * SIGMA_M  # there was an error to compensate


SOFT = """
format: pouring_robot/model/1
effects:
- effect: leg_compliance
  form: nut
  learned: then
  parameters: {stretch: {value: 2.0, unit: mm at 5 kN}}
- effect: tilt_drive_compliance
  form: spring
  learned: then
  parameters: {yield: {value: 5.0, unit: mrad at 2 kNm}}
learned:
  then:
    sessions: {"1": 10}
    mean_span_m: [0.6, 0.6, 0.7, 0.1]
    mean_force: [1800.0, 2400.0, 1600.0, 470.0]
    reference_temperature_degC: 20
    ladle_tare_kg: 180.0
    ladle_centre_of_mass_m: [0.05, 0.0, -0.28]
"""


def test_commands_of_compliant_parts_converge(tmp_path):
    """From iteration to iteration they improve little at the end; the pose is far from singular."""
    (tmp_path / "soft.yaml").write_text(SOFT)
    under = RobotUnderConditions(robot_of(RobotModel.load(tmp_path / "soft.yaml")), {"payload_kg": 500.0})
    pose, turns = PlatformPose.from_mm_deg(-150, -50, -800, -25), []

    def bring(_, robot):
        turns.append(robot)
        return compensate(HeatedRobot(robot), pose)

    (found,) = compensate_under(under, [pose], bring)
    (loaded,) = under.robots([list(found.drives.values())])
    place = loaded.forward(found.drives, near=pose).pose_base_to_end
    np.testing.assert_allclose(place.translation, pose.position_m, rtol=0.0, atol=1e-9)
    assert found.before.distance_m > 1e-3
    assert len(turns) <= 12


def test_commands_that_never_converge_are_refused_with_the_cause(rng):
    under, pose = RobotUnderConditions(LEARNED, {"payload_kg": 400.0}), PlatformPose((-0.1, 0.02, -0.6), 0.3)

    def restless(_, robot):
        found = compensate(HeatedRobot(robot), pose)
        return dataclasses.replace(found, drives={k: v + 1e-4 * rng.normal() for k, v in found.drives.items()})

    with pytest.raises(UnsettledCommandsError, match="pose 1: the model's effects depend on the compensated commands"):
        compensate_under(under, [pose], restless)


def test_compensation_of_any_robot(tmp_path):
    model = RobotModel.for_robot(ROOT / "examples" / "robots" / "delta" / "robot.yaml")
    home = model.definition.home_drives
    drawing = robot_of(model)
    load = all_effects(model.definition)["joint_periodic"]
    rows = 5
    drives = home + np.linspace(-0.05, 0.05, rows)[:, None]
    learned = RobotUnderConditions(drawing, {})._rows(drives)
    from pouring_robot.effects.conditions import complete_conditions

    conditions = complete_conditions(model.definition, rows)
    form = load.forms(conditions)[0]
    wave = {form.parameters[k].name: ParameterEntry(value=2.0, unit=form.parameters[k].unit) for k in range(2)}
    entry = EffectEntry(effect=load.id, form=form.name, learned="rows", parameters=wave)
    taught = model.model_copy(
        update={
            "effects": [entry],
            "learned": {"rows": learned_in(learned, dataclasses.replace(conditions, drives=drives))},
        }
    )
    under = RobotUnderConditions(robot_of(taught), {})
    wanted = list(drives)
    found = compensate_under(under, wanted, lambda k, robot: compensate_drives(robot, robot.location_at(wanted[k])))
    commands = np.array([list(one.drives.values()) for one in found])
    reached = places(under.robots(commands), commands)
    np.testing.assert_allclose(reached, places([drawing] * rows, drives), atol=1e-9)
    assert min(one.before.distance_m for one in found) > 1e-5


def test_no_commands_are_no_robots_and_numbers_are_drives(bench):
    model = model_with(
        rows_of(bench.campaign, RobotModel()), EffectEntry(effect="base_drift", form="steady", learned="bench")
    )
    assert robots_under(model, [], {}) == []
    assert compensate_under(RobotUnderConditions(model, {}), [], lambda k, robot: None) == []
    with pytest.raises(NoSolutionError, match=r"command 1: .* numbers are drive values, in m and rad"):
        robots_under(model, np.array([[-0.1, 0.02, -0.6, 0.3]]), {"time_s": 0.0})


def test_commands_and_conditions_of_a_wrong_type_are_refused_in_one_line():
    pose, given = PlatformPose((-0.1, 0.02, -0.6), 0.3), {"payload_kg": 400.0}
    under = RobotUnderConditions(LEARNED, given)
    for call, words in (
        (
            lambda: robots_under(LEARNED, [pose], None),
            r"must be a mapping by headings of a campaign, .* not a NoneType",
        ),
        (lambda: robots_under(LEARNED, [pose], ["payload_kg"]), "must be a mapping by headings of a campaign"),
        (lambda: robots_under(LEARNED, pose, given), "commands must be a list of .* not a PlatformPose"),
        (lambda: robots_under(RobotModel(), [pose], given), "nothing in the model depends on conditions: give none"),
        (lambda: under.robots([0.55, 0.55, 0.70, -0.09]), r"finite numbers of the shape \(n, 4\): leg1_s3"),
        (lambda: under.robots([[0.55, 0.55, 0.70]]), r"finite numbers of the shape \(n, 4\): leg1_s3"),
        (lambda: compensate_under(under, pose, lambda k, robot: None), "commands must be a list of "),
        (lambda: compensate_under(LEARNED, [pose], lambda k, robot: None), "must be a RobotUnderConditions"),
    ):
        with pytest.raises(BadInputError, match=words):
            call()
    drives = under.robot.drives_of(pose)
    assert [one.model for one in under.robots([drives.tolist()])] == [one.model for one in under.robots(drives[None])]


@pytest.mark.filterwarnings("error")
def test_where_effects_are_applied_no_warning_says_that_they_are_left_out():
    model = RobotModel.load(LEARNED)
    robot, pose = robot_of(model), PlatformPose.from_mm_deg(-100, 20, -600, 17)
    for standing in (robot, drawing_of(robot), *robots_under(LEARNED, [pose], {"payload_kg": 400.0})):
        assert standing.locate(pose).in_workspace


def test_a_virtual_measurement_requires_what_the_model_learned():
    robot = robot_of(RobotModel.load(LEARNED))
    plan = random_plan(robot, 4, 1)
    with pytest.raises(BadInputError, match="depends on the plan's conditions: give robots=robots_under"):
        simulate_campaign(robot, plan)


def taught_arm(effect, form, parameter, loads, **measured):
    """Return an arm that learned one effect parameter in two rows, with loads or (None) without, and its home.

    Other ``measured`` quantities are given by heading.
    """
    from pouring_robot.effects.conditions import complete_conditions

    model = RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml")
    home, kind = model.definition.home_drives, all_effects(model.definition)[effect]
    conditions = complete_conditions(model.definition, 2)
    (found,) = (p for f in kind.forms(conditions) if f.name == form for p in f.parameters if p.name == parameter)
    given = measured if loads is None else {"payload_kg": loads, **measured}
    rows = RobotUnderConditions(robot_of(model), given)._rows(np.stack([home, home + 0.3]))
    entry = EffectEntry(
        effect=effect,
        form=form,
        learned="rows",
        parameters={parameter: ParameterEntry(value=1.0, unit=found.unit)},
    )
    learned = {"rows": learned_in(rows, conditions)}
    return model.model_copy(update={"effects": [entry], "learned": learned}), home


def test_a_missing_load_is_not_taken_for_zero_where_loads_were_learned():
    """The links' own weight alone makes moments: what a robot does under them is not what it does under a load."""
    spring = ("drive_compliance", "spring", "q2_yield")
    model, home = taught_arm(*spring, [0.0, 10.0])
    with pytest.raises(MissingConditionsError, match=r"'drive_compliance' needs payload_kg: .*payload_kg=VALUE"):
        robots_under(model, [home], {})
    light, heavy = (robots_under(model, [home], {"payload_kg": load})[0].model.drive_offsets for load in (0.0, 10.0))
    assert light != heavy
    unloaded, _ = taught_arm(*spring, None)
    assert robots_under(unloaded, [home], {})[0].model.drive_offsets == light
    assert robots_under(model, [home], moments_of(model)), "who measures what drives carry need not say what they lift"
    waves, _ = taught_arm("joint_periodic", "turns", "q2_sine_1", [0.0, 10.0])
    assert robots_under(waves, [home], {})  # no load changes them


def moments_of(model):
    """Return a moment for each drive of an arm, by heading."""
    return {f"{drive.force_column}_Nm": 1.0 for drive in model.definition.drives}


@pytest.mark.parametrize("loads", [None, [0.0, 10.0]])
def test_measured_forces_are_not_replaced_by_the_links_own_weight(loads):
    """All of them must be given, or the load from which they follow."""
    measured = moments_of(RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml"))
    model, home = taught_arm("drive_compliance", "spring", "q2_yield", loads, **measured)
    some = {"force_q1_Nm": 1.0}
    for given in ({}, some):
        with pytest.raises(MissingConditionsError) as problem:
            robots_under(model, [home], given)
        asked = problem.value
        assert asked.headings == ("payload_kg",)
        assert f"needs payload_kg (or, for the load, {', '.join(h for h in measured if h not in given)}): " in str(
            asked
        )
    assert robots_under(model, [home], measured) and robots_under(model, [home], {"payload_kg": 5.0})


def test_backlash_depends_on_the_load_that_presses():
    """Measured moments stand for the load."""
    play = ("drive_backlash", "both_sides", "q2_play")
    sides = {f"approach_q{k + 1}": 1.0 for k in range(6)}
    model, home = taught_arm(*play, [0.0, 10.0], **sides)
    with pytest.raises(MissingConditionsError, match="'drive_backlash' needs payload_kg: "):
        robots_under(model, [home], sides)
    assert robots_under(model, [home], sides | moments_of(model))
    assert robots_under(taught_arm(*play, None, **sides)[0], [home], sides)


def test_a_load_is_reported_as_beyond_zero_where_the_campaign_had_none():
    """The campaign's load counts as zero only where its forces were computed."""
    spring = ("drive_compliance", "spring", "q2_yield")
    model, home = taught_arm(*spring, None)
    waves, _ = taught_arm("joint_periodic", "turns", "q2_sine_1", None)
    moments = moments_of(model)
    measured, _ = taught_arm(*spring, None, **moments)
    both = model.model_copy(update={"effects": [*model.effects, *waves.effects]})

    def notes(taught, load, given):
        under = RobotUnderConditions(robot_of(taught), {"payload_kg": load, **given})
        under.robots(np.array([home]))
        return under.notes

    beyond = ("payload_kg 20 lies outside 0, at which effects were learned",)
    for taught, given, said in ((model, {}, beyond), (both, {}, beyond), (waves, {}, ()), (measured, moments, ())):
        assert (notes(taught, 0.0, given), notes(taught, 20.0, given)) == ((), said)
