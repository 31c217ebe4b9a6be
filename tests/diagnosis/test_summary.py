"""What a diagnosis reports, in figures and in words."""

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import FlagCode, flagged
from pouring_robot.cli.diagnose import _print
from pouring_robot.cli.shared.options import QUIET
from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.cross_validation import CrossValidatedGap
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.diagnosis.disagreement import free_residuals
from pouring_robot.diagnosis.doubts import beyond_linearisation
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.named_effects import FoundParameter
from pouring_robot.diagnosis.report.export import described, diagnosis_metrics
from pouring_robot.diagnosis.report.notes import note_lines
from pouring_robot.diagnosis.report.page import html_report
from pouring_robot.diagnosis.report.sentences import (
    absent_sources,
    apart_lines,
    effect_lines,
    form_text,
    gap_sentence,
    gap_table,
    left_lines,
    next_lines,
    parameter_text,
    sections,
    source_text,
    sure_text,
    untestable_lines,
)
from pouring_robot.diagnosis.suggest.next_measurements import Separation
from pouring_robot.effects.available import all_effects
from pouring_robot.effects.base import EffectParameter
from pouring_robot.effects.condition_facts import sources
from pouring_robot.estimation.intervals import value_and_half_width
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.exceptions import OutputError
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from tests.campaign.simulated import measure
from tests.diagnosis.hidden import HOT, NOTHING, ZEROS, campaign
from tests.rig import Wanted, make_campaign, write_case
from tests.rig.__main__ import case
from tests.support import ACTUAL

CONTRACT = {
    "verdict",
    "effects",
    "where",
    "gap",
    "untestable",
    "suggested_measurements",
    "data_flags",
    "model",
}


def words(diagnosis):
    return "\n".join(line for _, lines in sections(diagnosis, short=False) for line in lines)


def test_the_figures_have_all_keys(hot):
    figures = json.loads(json.dumps(diagnosis_metrics(hot, "out/model.yaml"), allow_nan=False))
    assert figures.keys() >= CONTRACT
    assert figures["verdict"] == "named"
    assert figures["model"] == "out/model.yaml"
    (effect,) = figures["effects"]
    assert effect["effect"] == "leg_thermal_expansion"
    assert effect["alternatives"] == []
    assert 0.9 < effect["probability"] <= 1.0
    assert effect["parameters"]["expansion"].keys() == {"value", "std", "unit"}
    assert effect["parameters"]["expansion"]["unit"] == "1e-6/K"
    for part in ("train", "held_out"):
        gap = figures["gap"][part]
        assert gap["before_rms_mm"] > 2.0 * gap["floor_rms_mm"]
        assert gap["after_rms_mm"] < 1.4 * gap["floor_rms_mm"]
        assert gap["after_rms_mrad"] < 1.4 * gap["floor_rms_mrad"]


def test_the_gap_is_per_coordinate(hot):
    gap = hot.held_out
    rows = ~hot.fitted
    linear = hot.before.every_row.of(rows)
    position = (linear.residual * linear.sigma)[linear.component < 3]
    assert gap.position("before") == pytest.approx(math.sqrt((position**2).mean()))
    assert gap.position("floor") == pytest.approx(hot.noise.position_m)


@pytest.mark.filterwarnings("error")
def test_exact_data_of_the_drawing_have_no_structure(drawing):
    exact = measure(drawing, count=40, seed=4, sigma_position_m=0.0, sigma_rotation_rad=0.0)
    found = diagnose(exact.campaign)
    assert found.headline.startswith("NO STRUCTURE")
    assert any("stands for it: state it (sigma_position_mm" in line for line in note_lines(found))


def test_a_gap_is_averaged_over_the_lengths_measured():
    """Two values of x, one of y that the frames absorb, one closure: 3, 4, 0 and 5 by hand."""
    size = 1e-3 * np.array([math.sqrt(12.5), 0.0, math.nan, 1.0, 1.0, 1.0, math.nan, 5.0])
    gap = Gap(2, size, size / 2.0, np.full(8, 1e-4), np.array([2, 1, 0, 2, 2, 2, 0, 1]))
    assert gap.position("before") == pytest.approx(1e-3 * math.sqrt((9.0 + 16.0 + 0.0 + 25.0) / 4.0))
    assert gap.position("floor") == pytest.approx(1e-4)
    assert gap.rotation("after") == pytest.approx(0.5e-3)
    assert gap.length == "length"
    assert set(gap.figures()["components"]) == {"x", "y", "rx", "ry", "rz", "closure"}


@pytest.mark.parametrize("seed", range(20))
def test_a_worse_model_is_detected_from_all_values(seed):
    """Each divided by its noise, rotations and distances too; by hand, value by value."""
    random = np.random.default_rng(seed)
    sigma, counts = random.uniform(1e-5, 1e-3, 8), random.integers(0, 9, 8)
    kept = random.integers(0, 2, 3).repeat((3, 3, 2)).astype(bool) | (counts > 6)  # whole kinds may be missing
    counts = np.where(kept, counts, 0)
    before, after = (np.where(counts > 0, sigma * random.uniform(0.5, 3.0, 8), np.nan) for _ in range(2))
    squares = [0.0, 0.0]
    for component in np.flatnonzero(counts):
        for _ in range(counts[component]):
            for k, size in enumerate((before, after)):
                squares[k] += (size[component] / sigma[component]) ** 2
    assert Gap(9, before, after, sigma, counts).worse == (math.sqrt(squares[1]) > 1.05 * math.sqrt(squares[0]))


def test_a_model_with_worse_rotations_is_not_to_be_used(hot):
    """Rotations alone suffice: where nothing else was measured, and where positions are unchanged."""
    gap = hot.held_out
    turned = np.where(np.arange(len(gap.before)) < 3, gap.before, 2.0 * gap.before)
    for counts in (gap.counts, np.where(np.arange(len(gap.counts)) < 3, 0, gap.counts)):
        assert replace(hot, held_out=replace(gap, after=turned, counts=counts)).worse
        assert not replace(hot, held_out=replace(gap, after=gap.before, counts=counts)).worse
    assert replace(hot, train=replace(hot.train, after=np.where(turned > gap.before, turned, hot.train.before))).refused


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        (slice(3, 6), "Held-out rows (no position measured): {:.3f} mrad RMS per component"),
        (slice(0, 3), "Held-out rows (no rotation measured): {:.3f} mm RMS per coordinate"),
    ],
)
@pytest.mark.parametrize("refused", ["", "no credible robot"])
def test_the_gap_reports_what_was_not_measured_in_the_held_out_rows(hot, kept, said, refused, monkeypatch):
    counts = np.zeros(6, dtype=int)
    counts[kept] = hot.held_out.counts[kept]
    gap = replace(hot.held_out, counts=counts)
    monkeypatch.setattr(Conclusions, "refused", refused)
    sentence = gap_sentence(replace(hot, held_out=gap))
    part = gap.position("before") if kept.start == 0 else gap.rotation("before")
    assert sentence.startswith(said.format(1e3 * part))
    assert "nan" not in sentence


@pytest.mark.parametrize(
    ("left", "said"), [(2.0, "none"), (1.001, "none"), (0.999, "none"), (0.5, r"\d\d %"), (0.0, "all")]
)
def test_a_gap_that_grew_has_no_negative_share_closed(hot, left, said):
    gap = hot.held_out
    after = np.sqrt(gap.floor**2 + left**2 * (gap.before**2 - gap.floor**2))
    sentence = gap_sentence(replace(hot, held_out=replace(gap, after=after)))
    assert re.search(rf"\({said} of the gap in position closed\)", sentence)


def test_the_headline_names_the_effect_and_how_sure_it_is(hot):
    assert hot.headline == "NAMED: the model lacks leg_thermal_expansion (99 % sure)."
    assert "noise" in gap_sentence(hot)
    assert "of the gap in position closed" in gap_sentence(hot)
    assert "warm legs are longer" in words(hot)


def test_all_forms_found_are_named():
    items = [SimpleNamespace(form=form) for form in ("a_alone", "b_alone", "all")]
    diagnosis = SimpleNamespace(hypothesis=SimpleNamespace(items=items))
    for indices, said in (((0, 1), "forms 'a alone', 'b alone'"), ((1, 2), "form 'b alone'"), ((2,), "")):
        cause = SimpleNamespace(indices=indices, form=items[indices[0]].form)
        assert form_text(diagnosis, SimpleNamespace(cause=cause)) == said


def test_a_near_miss_is_reported_where_nothing_is_named(nothing, monkeypatch):
    assert not [line for line in next_lines(nothing) if line.startswith("not certain enough")]
    monkeypatch.setattr(Findings, "spare", {"drive_scale": 3.2, "base_drift": 2.9})
    (said,) = [line for line in next_lines(nothing) if line.startswith("not certain enough")]
    assert said == "not certain enough to be named: drive_scale (+3.2 nats); 4.6 are needed, so measure more rows"


def test_no_gap_names_nothing(nothing):
    assert nothing.headline.startswith("NO GAP")
    assert diagnosis_metrics(nothing, "m")["effects"] == []
    assert "closed" not in gap_sentence(nothing)
    assert "which effect" not in dict(sections(nothing))


def test_a_state_without_its_causes_is_not_believed(hot):
    """The final state leaves the predicted residual; the given model leaves the whole gap."""
    ended = hot.diagnoser._state(hot.after.parameters, hot.after.values, hot.after.frames)
    assert beyond_linearisation(ended, hot.hypothesis, Thresholds()) == ""
    said = beyond_linearisation(hot.diagnoser.at_rest(), hot.hypothesis, Thresholds())
    assert "too large to be credible" in said
    assert float(said.split(" times the noise")[0].split()[-1]) > 1.5


def test_an_effect_that_may_not_be_named_is_unknown_and_described(excluded):
    figures = diagnosis_metrics(excluded, "m")
    assert figures["verdict"] == "unknown"
    assert excluded.headline.startswith("UNKNOWN")
    assert "base_drift" not in {e["effect"] for e in figures["effects"]}
    assert dict(sections(excluded))["what is left"]
    assert figures["reasons"]
    firm, nearest = ({e["effect"] for e in figures[key]} for key in ("effects", "nearest"))
    assert not firm & nearest
    # At a prompt, too, an effect that may only stand in for the unknown is not called sure.
    assert nearest and {e.cause.effect for e in excluded.effects if "sure" not in repr(e)} == nearest
    assert all("may stand in for something unknown" in repr(e) for e in excluded.nearest)
    # The machine is faultless: apart from noise the gap is the step, whatever part known effects absorb.
    step = np.sqrt(excluded.hypothesis.problem.given_size**2 - 1.0)
    assert figures["unknown_size_in_noise"] == pytest.approx(step, rel=0.05)
    assert f"by {step:.1f} times the noise" in excluded.headline


def test_lines_and_sections_are_short(hot, nothing, excluded):
    for diagnosis in (hot, nothing, excluded):
        assert all("\n" not in line for _, lines in sections(diagnosis) for line in lines)
        assert len(sections(diagnosis)) <= 7


def test_a_group_is_reported_with_what_would_distinguish_it(hot):
    (effect,) = hot.firm
    cause = replace(effect.cause, alternatives=("drive_scale",))
    judgement = replace(hot.judgement, verdict="group", causes=(cause,))
    group = replace(hot, effects=(replace(effect, cause=cause),), judgement=judgement)
    assert "leg_thermal_expansion or drive_scale" in group.headline
    assert "look nearly the same" in apart_lines(group)[0]


@pytest.mark.parametrize(("found", "said"), [
    ({"leg_thermal_expansion": 5}, False),
    ({"leg_thermal_expansion": 2}, True),
    ({}, True),
])  # fmt: skip
def test_the_headline_reports_a_cause_found_in_few_blocks_only(hot, found, said):
    turns = CrossValidatedGap(5, hot.held_out, 1e-5, 0, found)
    turned = replace(hot, in_turn=turns)
    headline = turned.headline
    assert ["how sure a cause is" in html_report(one, [("", "")]) for one in (hot, turned)] == [False, True]
    seldom = f"% sure: found in {found.get('leg_thermal_expansion', 0)} of 5 searches that leave out a block)"
    assert (seldom in headline) == said
    assert ("leave out a block" in headline) == said
    (cause,) = hot.judgement.causes
    share = (found.get("leg_thermal_expansion", 0) + 1) / 7
    assert turns.tempered(cause).probability == (share if said else cause.probability)
    alike = replace(turns, found={**found, "other": 3})
    assert not alike.seldom(replace(cause, alternatives=("other",)))
    workmanship = replace(cause, indices=())
    assert turns.tempered(workmanship) == workmanship


def test_measurements_that_distinguish_nothing_are_not_listed(hot):
    (effect,) = hot.firm
    pair = Separation(effect.cause.effect, "drive_scale", 0.0, 1.0, 0.5, "measure cold and hot")
    cause = replace(effect.cause, alternatives=("drive_scale",))
    judgement = replace(hot.judgement, verdict="group", causes=(cause,))
    listed = []
    for nats in (1.0, 0.04):
        group = replace(hot, effects=(replace(effect, cause=cause),), judgement=judgement)
        vars(group)["suggestion"] = replace(hot.suggestion, separations=(pair,), expected_nats=nats)
        listed.append((next_lines(group), apart_lines(group)))
    assert any("1.0 nats expected" in line for line in listed[0][0])
    assert listed[1][0] == [
        "none of the measurements that were tried would distinguish leg_thermal_expansion from drive_scale"
    ]
    assert [len(lines) for _, lines in listed] == [2, 1]


def test_missing_columns_are_named(tmp_path):
    data = campaign(tmp_path, NOTHING, rows=40)
    spanless = data.metadata.model_copy(update={"truss_span_m": None})
    bare = replace(data, metadata=spanless).with_conditions(
        **dict.fromkeys(("leg1", "leg2", "leg3", "leg4", "payload"))
    )
    diagnosis = diagnose(bare)
    lines = untestable_lines(diagnosis)
    assert "leg_thermal_expansion: add columns leg1_degC, leg2_degC, leg3_degC, leg4_degC" in lines
    assert "leg_compliance, tilt_drive_compliance: add column payload_kg" in lines
    assert "truss_deflection: add column payload_kg and truss.span_m in campaign.yaml" in lines
    untestable = {u["effect"]: u for u in diagnosis_metrics(diagnosis, "m")["untestable"]}
    assert untestable["truss_deflection"]["add"] == ["payload_kg", "truss.span_m"]


def test_a_single_session_is_no_missing_column(nothing):
    unnamed = replace(nothing.campaign, headings={})
    one = replace(unnamed, headings={"session": "session"})
    assert source_text(("session",), unnamed) == "add column session"
    assert source_text(("session",), one).startswith("all rows are of one session; set up base and device again")


def test_an_unknown_may_be_what_could_not_be_tested(excluded):
    line = "first make testable what may be the cause: truss_deflection"
    assert line in next_lines(replace(excluded, untestable={"truss_deflection": ("truss_span_m",)}))
    assert not any("make testable" in one for one in next_lines(replace(excluded, untestable={})))


def test_a_cause_that_depends_on_the_pose_may_be_weight_where_no_masses_are_known(diagnosed, hot):
    """A joint's first order in its own angle is also what the weight of the link behind it does to a soft drive."""
    untestable = {"joint_compliance": ("joint_moments",), "truss_deflection": ("truss_span_m",)}
    line = (
        "first make testable joint_compliance: weight, too, varies with the pose, and its effect may be part of what "
        "is named"
    )
    zeros = diagnosed(ZEROS)
    assert line in next_lines(replace(zeros, untestable=untestable))
    for other in (zeros, replace(hot, untestable=untestable)):  # the masses are known; heat depends on thermometers
        assert not any("make testable" in one for one in next_lines(other))


def test_a_value_that_is_physically_impossible_is_reported(hot):
    """Legs do not shrink when warm; a value within the noise, or already in the model, is not reported."""
    (effect,) = hot.effects
    (main, *others), words = effect.parameters, "physically impossible: expansion; something else acts there"

    def told(value, of=hot):
        shrunk = replace(effect, parameters=(replace(main, value=value), *others))
        return [line for line in effect_lines(of, shrunk) if line.startswith(words)]

    assert main.parameter.name == "expansion" and main.parameter.bounds == (0.0, np.inf)
    assert told(-3.0 * main.std) and not told(-2.0 * main.std) and not told(main.value)
    known = tuple(replace(item, bounds=None) for item in hot.hypothesis.items)
    assert not told(-3.0 * main.std, replace(hot, hypothesis=replace(hot.hypothesis, items=known)))


def test_sources_of_an_unknown_need_keep_its_name():
    robot = RobotModel().definition
    assert sources(("humidity",), robot) == ("humidity",)
    assert sources(("legs_force", "weight_n"), robot) == sources(("weight_n",), robot)


def test_every_need_of_the_library_has_a_source(nothing):
    campaign_ = nothing.campaign
    for effect in all_effects().values():
        assert all(need not in sources([need], campaign_.robot) or need == "truss_travel_m" for need in effect.needs)
        assert absent_sources(effect.needs, campaign_) == sources(effect.needs, campaign_.robot)


def test_every_effect_is_drawn_over_something(nothing):
    conditions = nothing.rows.conditions
    for effect in all_effects().values():
        assert not effect.axis(conditions).of_rows


def test_lines_of_gross_errors_are_those_of_the_file(tmp_path):
    """A duplicate row is left out but is no gross error, nor is a drive beyond its limits, reported with its excess."""
    data = campaign(tmp_path, NOTHING, rows=60)
    lines = (tmp_path / "campaign.csv").read_text().splitlines()
    place = lines[0].split(",").index("z_mm")
    cells = lines[29].split(",")
    cells[place] = f"{float(cells[place]) + 25.0:.4f}"
    lines[29] = ",".join(cells)
    cells = lines[40].split(",")
    cells[lines[0].split(",").index("q1_mm")] = "9000"
    lines[40] = ",".join(cells)
    lines.append(lines[11])
    (tmp_path / "campaign.csv").write_text("\n".join(lines) + "\n")
    diagnosis = diagnose(Campaign.read(data.path))
    assert diagnosis_metrics(diagnosis, "m")["rows"]["left_out_lines"] == [30, 41, 62]
    assert "left out as gross errors: line 30" in note_lines(diagnosis)
    assert any("values of line 41 (beyond the joint limits: 'q1_mm' by up" in line for line in note_lines(diagnosis))


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (1.23456, 0.05, ("+1.235", "0.098")),
        (-123.4, 20.0, ("-123", "39")),
        (0.5, 0.0, ("+0.500", "0.000")),
        (-4e-4, 0.05, ("+0.000", "0.098")),
    ],
)
def test_a_value_has_the_digits_that_its_interval_supports(value, std, shown):
    parameter = EffectParameter("l1_offset", "mm", 1.0, {})
    assert value_and_half_width(value, std, math.inf) == shown
    assert parameter_text("l1_offset", FoundParameter(parameter, value, std)) == f"l1 offset {shown[0]} ± {shown[1]} mm"


def test_the_table_has_no_empty_columns_and_none_without_a_unit(tmp_path, hot):
    positions = diagnose(campaign(tmp_path, NOTHING, full_pose=False))
    for diagnosis, count in ((positions, 7), (hot, 11)):
        head, rows = gap_table(diagnosis)
        assert len(head) == count
        assert all(len(row) == count for row in rows)
        assert head[2:6] == ("x mm", "y mm", "z mm", "all mm")
        assert all(name.endswith(" mrad") for name in head[6:-1])
    assert diagnosis_metrics(positions, "m")["gap"]["held_out"]["after_rms_mrad"] is None


def test_a_shift_at_the_lip_is_the_difference_of_two_robots(tmp_path):
    """The drive offsets found are put into a robot file, and that robot is closed one pose at a time."""
    found = diagnose(campaign(tmp_path, ZEROS, rows=40))
    (effect,) = found.effects
    state = found.final.state
    values = dict(zip(map(id, state.parameters), state.values.tolist(), strict=True))
    names = {"l1": "leg1_s3", "l2": "leg2_s3", "l3": "leg3_s3", "theta46": "leg4_s5"}
    offsets = {}
    for p in effect.parameters:
        joint = names[p.parameter.name.split("_")[0]]
        offsets[joint] = {"offset_mrad" if joint == "leg4_s5" else "offset_mm": values[id(p.parameter)]}
    assert len(state.parameters) == len(effect.parameters)
    built, drawing = PouringRobot(RobotModel(drive_offsets=offsets)), PouringRobot()
    moved = found.moved[effect.cause.effect]
    lip = found.model.definition.mechanism().T_end_tool
    for row in (0, 17, 33):
        drives = found.rows.campaign.drive_values(row)
        there, here = (robot.forward(drives).pose_base_to_end * lip for robot in (built, drawing))
        np.testing.assert_allclose(moved[row], there.translation - here.translation, rtol=0.0, atol=1e-8)


def test_free_residuals_are_those_of_the_given_model(hot):
    data = free_residuals(hot.diagnoser.at_rest(), hot.rows)
    np.testing.assert_allclose(data.nuisance.axes.T @ data.nuisance.axes, np.eye(data.nuisance.dof), atol=1e-9)
    # The frames were fitted to the fitted rows; over all rows they absorb little more.
    assert np.linalg.norm(data.cleared) <= np.linalg.norm(data.residual)


def test_the_result_is_one_line_at_a_prompt_and_a_table_in_a_notebook(hot, tmp_path, undrawn):
    assert repr(hot) == f"<Diagnosis: {hot.headline}>"
    assert hot.verdict == "named"
    frame = hot.to_frame()
    assert list(frame["effect"].unique()) == ["leg_thermal_expansion"]
    row = frame.set_index("parameter").loc["expansion"]
    assert (row["unit"], bool(row["firm"]), row["alternatives"]) == ("1e-6/K", True, "")
    assert 0.0 < row["std"] < abs(row["value"])
    assert hot.headline in hot._repr_html_()
    assert {path.name for path in hot.save(tmp_path / "out")} >= {"diagnosis.json", "model.yaml"}
    with pytest.raises(OutputError, match="exists already"):
        hot.save(tmp_path / "out")


def test_the_residuals_of_the_rows_make_the_gap(hot):
    found, (effect,) = hot.to_dataset(), hot.effects
    assert {str(found[name].attrs["units"]) for name in found} == {"m or rad, see 'unit'"}
    assert found.sizes == {"row": len(hot.campaign), "component": 6} and list(found.unit.values[2:4]) == ["m", "rad"]
    for which in ("before", "after"):
        table = found[f"residual_{which}"].where(found.used == "held out").sel(component=["x", "y", "z"])
        assert float(np.sqrt((table**2).mean())) == pytest.approx(hot.held_out.position(which), rel=1e-9)
    assert np.isnan(found.residual_after.where(found.used == "left out", drop=True)).all()
    assert repr(effect).startswith(f"<NamedEffect: leg_thermal_expansion, {effect.cause.form}, ")
    sure = replace(effect, cause=replace(effect.cause, probability=0.9986))
    assert repr(sure).endswith(", 99.8 % sure>")
    assert len(repr(effect.parameters[0])) < 300


def test_the_thresholds_given_decide_what_is_reported(excluded):
    """What counts as structure and as beaten follows from the thresholds of the diagnosis; here they are extreme."""
    deaf = replace(excluded.judgement, thresholds=Thresholds(false_names=5e-324), tried=10**308)
    assert excluded.remainder
    assert deaf.clear_structures == tuple(s for s in deaf.structures if s.evidence > deaf.structure_evidence)
    keen = replace(excluded.judgement, thresholds=Thresholds(false_names=1.0 - 1e-9), tried=1)
    assert {*keen.beaten} == {c.effect for c, _ in excluded.judgement.challenged}
    assert not replace(deaf, challenges=()).beaten


def test_noise_from_repeats_is_as_uncertain_as_their_number_makes_it(hot):
    """With a stated noise nothing changes; with 30 differences of repeats chance is more probable."""
    stated = free_residuals(hot.diagnoser.at_rest(), hot.rows)
    assert stated.noise.dof == np.inf
    noise = NoiseLevel(hot.noise.kinds | {"position": replace(hot.noise["position"], source="repeats", dof=30.0)})
    repeated = free_residuals(hot.diagnoser.at_rest(), hot.rows.with_noise(noise))
    assert repeated.noise.dof == 30.0
    squares, count = 1.4 * 300.0, 300.0
    assert repeated.p_value(squares, count) > 10.0 * stated.p_value(squares, count)


@pytest.mark.parametrize(("again", "told"), [([0, 0, 1, 1, 1, 2], True), ([0, 0, 1, 2, 1], False)])
def test_repeats_that_follow_each_other_may_not_show_the_repeatability(hot, again, told):
    """Three readings of each pose of a real arm gave a noise of 0.001 mm, and no model predicted other rows."""
    noise = NoiseLevel(hot.noise.kinds | {"position": replace(hot.noise["position"], source="repeats")})
    lines = note_lines(replace(hot, noise=noise, campaign=hot.campaign.subset(np.array(again))))
    assert any("all repeats follow each other" in line for line in lines) == told


def worse(diagnosis):
    """Return a diagnosis whose amended model is as far from the held-out rows as the given one was."""
    gap = diagnosis.held_out
    return replace(diagnosis, held_out=replace(gap, before=gap.after, after=gap.before))


def test_a_model_that_is_worse_on_held_out_rows_is_reported_as_such(hot, tmp_path, capsys):
    assert not hot.worse
    diagnosis = worse(hot)
    assert diagnosis.worse
    model = described(diagnosis)
    assert model.description.startswith("Worse on held-out rows")
    assert [learned.worse for learned in model.learned.values()] == [True]
    assert not any(learned.worse for learned in described(hot).learned.values())
    written = model.save(tmp_path / "found.yaml")
    (line,) = RobotModel.load(written).cautions(str(written))
    (name,) = model.learned
    assert line.startswith(f"{written} with what it learned in '{name}': ") and line.endswith(": do not use it")
    assert described(hot).cautions() == ()
    for given in (diagnosis.amended, written):
        with pytest.warns(UserWarning) as told:
            Robot(given)
        assert "do not use it" in str(told[0].message)
    QUIET.set(False)  # commands that ran before in this process may have been made quiet
    _print(diagnosis)
    said = capsys.readouterr().out
    assert said.index("do not use this model") < said.index("fitted"), "before the table of the gap"
    assert "do not use this model" in html_report(diagnosis, [("", "")])
    assert not any("do not use" in line for line in note_lines(diagnosis)), "it stands beside the gap"
    assert [diagnosis_metrics(one, "model.yaml")["worse"] for one in (hot, diagnosis)] == [False, True]


def test_constant_displacements_are_marked_too_where_held_out_rows_speak_against_them(diagnosed):
    """Nothing else that was learned depends on the campaign. A model that stays as given has no mark."""
    found = diagnosed(ZEROS)
    still, refused = worse(found).amended, replace(worse(found), train=worse(found).held_out)
    assert all(entry.placed for entry in still.effects) and not found.amended.learned
    assert [learned.worse for learned in still.learned.values()] == [True]
    assert refused.refused and not refused.worse and not refused.amended.learned


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (1.0 - 1e-12, "more than 99.9 % sure"),
        (0.999, "99.9 % sure"),
        (0.9986, "99.8 % sure"),
        (0.99 - 1e-9, "99 % sure"),
        (0.58, "58 % sure"),
        (0.5, "50 % sure"),
    ],
)
def test_no_probability_is_reported_as_a_hundred_percent(probability, words):
    assert sure_text(probability) == words


def test_a_noise_that_the_found_cause_reaches_is_not_called_too_small(diagnosed):
    hot = diagnosed(HOT)
    flag = flagged(hot.campaign, FlagCode.NOISE_TOO_SMALL, "the stated noise is too small")
    gap = hot.train
    assert gap.position("after") < 1.2 * gap.position("floor")
    assert f"data: {flag.message}" not in note_lines(replace(hot, flags=(flag,)))
    unexplained = replace(hot, flags=(flag,), train=replace(gap, after=gap.before))
    assert f"data: {flag.message}" in note_lines(unexplained)


def test_workmanship_is_reported_with_its_size_where_there_is_a_cause(diagnosed):
    """The rig's centres are off by 15 um, its axes by 10 urad; sizes are found to a factor of two."""
    (told,) = [line for line in note_lines(diagnosed(HOT, background=True)) if "workmanship" in line]
    found = re.fullmatch(r"in addition, workmanship: .* by about (\S+) mm and (\S+) mrad \(standard deviation\)", told)
    assert 0.5 <= float(found[1]) / 0.015 <= 2.0
    assert 0.5 <= float(found[2]) / 0.010 <= 2.0
    assert not [line for line in note_lines(diagnosed(HOT)) if "workmanship" in line]


def test_a_headline_says_where_workmanship_makes_more_of_the_gap(tmp_path):
    """A tracker scale of half the noise and centres off by 60 um: the scale alone would mislead the reader."""
    scale = (Wanted("metrology_scale", 1.5, "a"),)
    about = {"rows": 100, "sessions": 3, "background": True, "full_pose": True, "spoilt": False}
    made = make_campaign("single", 3, wanted=scale, workmanship=4.0, **about)
    told = diagnose(write_case(tmp_path, made) / "campaign.csv")
    assert told.headline.startswith("NAMED: the model lacks metrology_scale")
    found = re.search(
        r"Workmanship accounts for more of the gap: all joints are off by about (\S+) mm and", told.headline
    )
    assert 0.5 <= float(found[1]) / 0.060 <= 2.0
    assert not [line for line in note_lines(told) if "workmanship" in line]  # once is enough


def test_a_stated_noise_that_is_too_small_is_reported_as_such(nothing):
    data = nothing.campaign
    halves = {key: 0.5 * getattr(data.metadata, key) for key in ("sigma_position_m", "sigma_rotation_rad")}
    stated = data.metadata.model_copy(update=halves)
    found = diagnose(replace(data, metadata=stated))
    left, noise = diagnosis_metrics(found, "model.yaml")["noise_left"], data.metadata.sigma_position_m
    assert left["position_mm"] == pytest.approx(1e3 * noise, rel=0.15)
    assert left["rotation_mrad"] == pytest.approx(1e3 * data.metadata.sigma_rotation_rad, rel=0.15)
    sizes = f"{left['position_mm']:.2g} mm and {left['rotation_mrad']:.2g} mrad"
    said = f"the residuals scatter from row to row, like noise of {sizes} instead of the stated {500.0 * noise:.2g} mm"
    assert found.headline.startswith(f"UNKNOWN: {said}")
    assert any(line.startswith("measure some poses three times") for line in next_lines(found))
    assert diagnosis_metrics(nothing, "model.yaml")["noise_left"] is None


@pytest.mark.parametrize(
    ("kind", "key", "unit"),
    [("position", "sigma_position_m", "mm"), ("rotation", "sigma_rotation_rad", "mrad"), ("", "", "")],
)
def test_a_stated_noise_that_is_too_small_for_one_kind_is_reported_with_it(kind, key, unit):
    """Errors of many joints, noise of 0.05 mm and 0.05 mrad; a fifth is stated for one of them, or for none.

    The search repeated under the actual noise gives as good a model as where that is stated.
    """
    data = measure(PouringRobot.load(ACTUAL), count=60, seed=3).campaign
    stated = {key: 10e-6} if kind else {}
    found = diagnose(replace(data, metadata=data.metadata.model_copy(update=stated)))
    assert [effect.cause.effect for effect in found.firm] == ["joint_centre_offset"]
    assert found.held_out.position("after") == pytest.approx(50e-6, rel=0.4)
    said = [found.headline, *left_lines(found), *note_lines(found)]
    if not kind:
        assert found.headline.startswith("NAMED")
        assert not [line for line in said if "scatters" in line]
        return
    times = re.match(
        rf"UNKNOWN: the residuals scatter from row to row, like noise of the {kind}s (\S+) times as large: "
        rf"(\S+) {unit} instead of the stated 0\.01 {unit}\. Also found: joint_centre_offset\.$",
        found.headline,
    )
    assert [float(one) for one in times.groups()] == pytest.approx([5.0, 0.05], rel=0.15)
    figures = diagnosis_metrics(found, "model.yaml")
    other = {"position": "rotation_mrad", "rotation": "position_mm"}[kind]
    assert figures["noise_left"][other] == figures["noise"][other] == pytest.approx(0.05)
    assert figures["noise"][f"{kind}_{unit}"] == pytest.approx(0.01)


def test_clear_structure_under_a_larger_noise_is_not_called_noise(tmp_path):
    """With four false causes refraction scatters like a noise; with fewer it depends on the pose."""
    found = diagnose(write_case(tmp_path, case(386, 98, wide=True)) / "campaign.csv")
    assert found.judgement.verdict == "unknown"
    assert found.noise_left is None
    assert found.judgement.reasons[0].startswith(
        "the residuals depend on something that no effect explains: readings depending on pose"
    )


def test_joints_are_named_although_the_stated_noise_is_too_small():
    """Errors of many joints, noise of 0.05 mm, stated 0.02 mm: the model must not stay as it was."""
    data = measure(PouringRobot.load(ACTUAL), count=60, seed=3).campaign
    found = diagnose(replace(data, metadata=data.metadata.model_copy(update={"sigma_position_m": 2e-5})))
    assert found.headline.startswith("UNKNOWN: the residuals scatter from row to row, like noise of")
    assert found.headline.endswith("Also found: joint_centre_offset.")
    assert found.held_out.closed > 0.9  # of 0.97, as the floor is the stated noise


def test_cautions_of_an_effect_are_printed_with_or_without_words_on_its_parameters_together(hot, monkeypatch):
    (effect,) = hot.firm
    known = type(hot.diagnoser.library.effects[effect.cause.effect])
    monkeypatch.setattr(known, "to_read_with_care", lambda self, given: ("the sun shone",))
    for together in ((), ("they grow alike",)):
        monkeypatch.setattr(known, "in_words", lambda self, values, stds, said=together: said)
        lines = effect_lines(hot, effect)
        assert "the sun shone" in lines
        assert [line for line in lines if line == "they grow alike"] == list(together)
