"""The pages of a diagnosis: complete, self-contained, and consistent with the figures."""

import copy
import html
import os
import pickle
import re
import shutil
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from pouring_robot.checks.flags import FlagCode, Severity
from pouring_robot.diagnosis.gap import in_base
from pouring_robot.diagnosis.report.export import described, write_diagnosis
from pouring_robot.diagnosis.report.modelled_and_measured import (
    _MEASURED_TINT,
    _STATE_TINTS,
    _scene,
    campaign_scene,
    ladle_scene,
    seen_states,
)
from pouring_robot.diagnosis.report.notes import note_lines
from pouring_robot.diagnosis.report.page import html_report
from pouring_robot.diagnosis.report.plots import _signatures, evidence_steps, plots, rival_margins
from pouring_robot.exceptions import OutputError
from pouring_robot.io import interrupt
from pouring_robot.robot.model import RobotModel
from pouring_robot.viewer import solids
from pouring_robot.viewer.scene import ARROW_RED
from tests.diagnosis.hidden import STEP_M

NAMES = {"diagnosis.json", "model.yaml", "report.html", "ladles.html", "next.csv"}


@pytest.fixture(scope="module")
def hot(hot, tmp_path_factory):
    """The diagnosis of a file whose name would break a careless page."""
    told = shutil.copy(hot.campaign.path, tmp_path_factory.mktemp("hot") / "<script>alert(1).csv")
    return replace(hot, campaign=replace(hot.campaign, path=told))


@pytest.fixture(scope="module")
def page(hot, drawn):
    return html_report(hot, drawn)


@pytest.fixture(scope="module")
def drawn(hot):
    return plots(hot)


@pytest.fixture(scope="module")
def written(hot, tmp_path_factory):
    folder = tmp_path_factory.mktemp("written")
    return folder / "out", write_diagnosis(hot, folder / "out")


@pytest.fixture(scope="module")
def refused(hot):
    """The diagnosis as if its causes brought the fitted rows no closer."""
    gap = hot.train
    return replace(hot, train=replace(gap, after=2.0 * gap.before))


@pytest.fixture(scope="module")
def refused_drawn(refused):
    return plots(refused)


def test_a_diagnosis_can_be_passed_to_another_process(hot):
    again = pickle.loads(pickle.dumps(hot))
    assert again.headline == hot.headline and again.amended == hot.amended


def test_the_page_is_complete_and_needs_no_other_file(hot, page):
    assert page.startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert not re.findall(r"(?:src|href)='(?!data:)", page)
    assert hot.headline in page.replace("&#x27;", "'")
    assert "No probability exceeds 1 - 0.01, " in page, "what bounds it"
    for tag in ("h2", "h3", "ul", "li", "table", "details", "figure"):
        assert page.count(f"<{tag}") == page.count(f"</{tag}>"), tag


def test_the_page_of_a_refused_model_shows_no_after(refused, refused_drawn):
    page = html_report(refused, refused_drawn)
    assert "The model is not amended" in page
    assert "<td>after</td>" not in page
    assert described(refused).effects == []


def test_text_of_a_campaign_cannot_break_the_page(page):
    assert "alert(1)" in page and "<script>alert" not in page


def test_plots_are_pictures(drawn, refused_drawn):
    for shown in (drawn, refused_drawn):
        assert len({title for title, _ in shown}) == len(shown) == 5
        for title, svg in shown:
            marks = etree.fromstring(svg).iter("{http://www.w3.org/2000/svg}use", "{http://www.w3.org/2000/svg}path")
            assert sum(1 for _ in marks) > 20, title


def test_every_point_of_the_residuals_has_its_line_and_value(hot, drawn):
    shown = next(svg for title, svg in drawn if title.startswith("Residuals"))
    told = re.findall(r"<title>line (\d+): ([+-][\d.]+) mm (before|after)</title>", shown)
    assert {int(line) for line, _, _ in told} == set(hot.campaign.lines[np.isfinite(hot.campaign.position_m).all(1)])


def test_rows_are_ringed_where_some_are_held_out(hot, drawn):
    assert "held-out rows ringed" in drawn[1][0]
    assert "no row held out" in plots(replace(hot, fitted=np.ones_like(hot.fitted)))[1][0]


def test_a_long_story_is_wrapped_above_its_plot(hot):
    told = replace(hot, effects=tuple(replace(effect, story="what may happen " * 15) for effect in hot.effects))
    written = re.findall(r"<text[^>]*>([^<]*what[^<]*)</text>", _signatures(told))
    assert len(written) == 3 * len(hot.firm) and max(map(len, written)) <= 120


def test_measurements_are_listed_most_informative_first(hot, page):
    table = re.search("Most informative measurements.*?</table>", page, re.DOTALL)[0]
    rows = re.findall(r'<td class="l">next_(\d+)</td><td>([\d.]+)</td>.*?<td>(\d+)</td></tr>', table)
    nats = [float(cell) for _, cell, _ in rows]
    assert nats == sorted(nats, reverse=True) and len(nats) == len(hot.suggestion.measurements) > 0
    assert all(hot.suggestion.measurements[int(sample) - 1].rank == int(number) for sample, _, number in rows)


def test_the_report_does_not_refer_to_itself(page):
    assert "more in the report" not in page


def test_plots_are_reproducible(drawn, written):
    """The written report draws them anew."""
    page = (written[0] / "report.html").read_text(encoding="utf-8")
    assert all(svg in page and f"<figcaption>{title}<" in html.unescape(page) for title, svg in drawn)


def test_evidence_steps_end_at_the_evidence_of_the_hypothesis(hot):
    hypothesis = hot.hypothesis
    ((name, gained),) = evidence_steps(hypothesis)
    assert "leg_thermal_expansion" in name
    without = hypothesis.without_items((0,)).log_evidence
    # Levels of workmanship settle anew, step by step: they may end one step apart, which changes little.
    assert gained >= hypothesis.log_evidence - without - 3.0


def test_no_rival_is_better_than_the_cause(hot):
    (cause,) = hot.judgement.causes
    margins = rival_margins(hot.hypothesis, cause)
    assert cause.effect not in margins
    assert min(margins.values()) > 5.0


def test_each_state_has_the_gap_of_its_model(hot):
    drawing, amended = seen_states(hot)
    assert (drawing.name, amended.name) == ("drawing", "amended model")
    # The target's origin through the frames of each state against whitened residuals: the same gap by two routes.
    for state, seen in ((drawing, hot.before), (amended, hot.final.state)):
        target = seen.frames.T_end_target.homogeneous
        gap = ((state.measured - state.model) @ target)[:, :3, 3] @ seen.frames.T_tracker_base.rotation.T
        residual = np.full((len(gap), 6), np.nan)
        residual[seen.every_row.row, seen.every_row.component] = seen.every_row.residual * seen.every_row.sigma
        np.testing.assert_allclose(gap, residual[:, :3], atol=1e-6)


def test_a_note_says_why_no_ladle_is_drawn_of_distances_alone(hot):
    campaign, said = hot.campaign, "no ladles.html: no row has a complete measured position"
    nowhere, away = np.full_like(campaign.position_m, np.nan), np.linalg.norm(campaign.position_m, axis=1)[:, None]
    wire = replace(campaign, position_m=nowhere, rotation_vector_rad=None, distance_m=away)
    assert [said in note_lines(found) for found in (hot, replace(hot, campaign=wire))] == [False, True]


def test_the_gap_is_drawn_from_where_the_ladle_was_measured(hot):
    scene, (drawing, amended) = ladle_scene(hot), seen_states(hot)
    assert [robot.name for robot in scene.robots] == ["measured", "drawing", "amended model", "robot"]
    assert [robot.choice for robot in scene.robots] == [False, True, True, False]
    lip = hot.model.definition.mechanism().T_end_tool.homogeneous
    sizes = {state.name: np.linalg.norm(state.gaps_m(lip), axis=1) for state in (drawing, amended)}
    samples = hot.rows.campaign.samples
    rows = [samples.index(step.label.rpartition("sample ")[2]) for step in scene.steps]
    assert [step.label.partition(":")[0] for step in scene.steps] == ["worst", "median", "best"]
    assert sizes["drawing"][rows[0]] == sizes["drawing"].max()
    assert sizes["drawing"][rows[2]] == sizes["drawing"].min()
    assert sizes["amended model"].max() < 0.5 * sizes["drawing"].max()
    one = {arrows.shown_with: arrows for arrows in scene.arrows if arrows.starts_m.shape[1] == 1}
    every = {arrows.shown_with: arrows for arrows in scene.arrows if arrows.starts_m.shape[1] > 1}
    measured = scene.robots[0].bodies[:, 0]
    for robot in scene.robots[1:3]:
        np.testing.assert_allclose(robot.reference[:, 0], measured)
        lengths = np.linalg.norm(one[robot.name].vectors_m[:, 0], axis=1)
        np.testing.assert_allclose(lengths, sizes[robot.name][rows], rtol=1e-9)
        np.testing.assert_allclose(one[robot.name].starts_m[:, 0], (measured @ lip)[:, :3, 3], atol=1e-12)
        # From the measured lip to the lip of the state: the same gap, drawn as a body.
        drawn = ((robot.bodies[:, 0] - measured) @ lip)[:, :3, 3]
        np.testing.assert_allclose(drawn, one[robot.name].vectors_m[:, 0], atol=2e-6)
    assert np.median(np.linalg.norm(every["amended model"].vectors_m, axis=-1)) < 0.2 * np.median(
        np.linalg.norm(every["drawing"].vectors_m, axis=-1)
    )
    assert not [body for body in solids(scene) if body.link == "truss_bridge"]


def test_arrows_and_states_contrast_with_what_was_measured():
    """Without colours, too: WCAG 2 asks for a contrast of 3 between the parts of a picture."""

    def luminance(colour):
        linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    bright = luminance(_MEASURED_TINT) + 0.05
    assert all(bright / (luminance(tint) + 0.05) >= 3.0 for tint in (ARROW_RED, *_STATE_TINTS.values()))


def test_a_model_given_is_a_state_of_its_own(hot):
    scene = campaign_scene(hot.campaign, hot.amended)
    assert [robot.name for robot in scene.robots] == ["measured", "drawing", "model given", "robot"]
    assert len(scene.steps) == len(hot.rows.campaign)
    drawing, given = (curve.values for curve in scene.curves)
    assert np.median(given) < 0.2 * np.median(drawing)
    sigma = 1e3 * hot.noise.position_m
    assert np.sqrt(np.mean(given**2)) < 3.0 * np.sqrt(3.0) * sigma
    assert ("noise per coordinate", f"{sigma:.3g} mm") in scene.steps[0].caption
    quiet = _scene(hot.rows, seen_states(hot)[1:], {0: "quiet"})  # only noise remains: it is not drawn as a gap
    assert quiet.exaggeration * np.linalg.norm(quiet.arrows[0].vectors_m) < 0.03


def test_a_row_without_a_rotation_is_labelled_with_the_source_of_the_one_drawn(hot):
    turned = hot.campaign.rotation_vector_rad.copy()
    turned[::2] = np.nan
    mixed = replace(hot.campaign, rotation_vector_rad=turned)
    captions = [dict(step.caption) for step in campaign_scene(mixed, hot.amended).steps]
    lines = dict(zip(mixed.lines.tolist(), np.isnan(turned).any(axis=1), strict=True))
    without = [lines[int(next(iter(told.values())).split()[1])] for told in captions]
    assert [told.get("measured", "").startswith("rotations are the model's") for told in captions] == without
    assert any(without) and not all(without)


def test_residuals_rotated_into_the_fixed_platform_keep_their_length():
    table = np.random.default_rng(0).normal(size=(4, 6))
    axes = pin.exp3(np.array([0.2, -0.4, 1.0]))
    turned = in_base(table, axes)
    np.testing.assert_allclose(np.linalg.norm(turned[:, :3], axis=1), np.linalg.norm(table[:, :3], axis=1))
    np.testing.assert_allclose(turned[:, 3:] @ axes.T, table[:, 3:])


def test_a_step_is_found_with_its_line_and_size(excluded):
    """After line 41 the tracker sees everything 1 mm higher: nothing in the library does that."""
    found = excluded
    assert found.judgement.verdict == "unknown"
    described_ = [item for item in found.remainder if item.step_after is not None]
    (item,) = described_[:1]
    assert item.structure.process.by in {"time", "order"}
    assert item.component == "z"
    fitted = found.rows.campaign.lines[found.fitted]
    assert item.step_after == fitted[fitted <= 41].max()
    assert item.step == pytest.approx(STEP_M, rel=0.25)
    assert "a step of +" in item.sentence
    assert item.figures()["step"]["after_line"] == item.step_after
    (flag,) = (flag for flag in found.flags if flag.code is FlagCode.MEASUREMENT_JUMP)
    small = replace(found, flags=(replace(flag, severity=Severity.NOTE),))
    assert f"data: {flag.message}" in note_lines(small)


def test_everything_is_written_and_the_model_can_be_read_back(hot, written):
    folder, paths = written
    assert {path.name for path in paths} == NAMES
    assert {path.name for path in folder.iterdir()} == NAMES
    model = RobotModel.load(folder / "model.yaml")
    assert [e.effect for e in model.effects] == [e.effect for e in hot.amended.effects]
    assert model.description.startswith("NAMED")
    assert [path.name for path in folder.parent.iterdir()] == ["out"]


def test_files_that_only_an_earlier_diagnosis_had_are_removed(hot, written, monkeypatch, undrawn, tmp_path):
    folder = shutil.copytree(written[0], tmp_path / "out")
    (folder / "notes.txt").write_text("a person's")
    without = copy.copy(hot)
    without.__dict__["suggestion"] = replace(hot.suggestion, measurements=())
    monkeypatch.setattr("pouring_robot.diagnosis.report.modelled_and_measured.ladle_scene", lambda _: None)
    write_diagnosis(without, folder, overwrite=True)
    assert {path.name for path in folder.iterdir()} == {*NAMES, "notes.txt"} - {"ladles.html", "next.csv"}
    (folder / "next.csv").write_text("what was measured")
    vars(without)["campaign"] = replace(hot.campaign, path=folder / "next.csv")
    write_diagnosis(without, folder, overwrite=True)
    assert (folder / "next.csv").read_text() == "what was measured"


def test_a_failure_leaves_the_folder_as_it_was(hot, written, monkeypatch, undrawn):
    folder, _ = written
    before = {path.name: path.read_bytes() for path in folder.iterdir()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        write_diagnosis(hot, folder, overwrite=True)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in folder.parent.iterdir()] == ["out"]


def test_a_ctrl_c_that_a_library_swallowed_stops_before_anything_is_written(hot, tmp_path, monkeypatch):
    monkeypatch.setattr(interrupt._Heard, "yes", True)
    with pytest.raises(KeyboardInterrupt):
        write_diagnosis(hot, tmp_path / "out")
    assert not (tmp_path / "out").exists()
