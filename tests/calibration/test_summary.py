"""The figures: complete, finite, in JSON; warnings where they are due."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pouring_robot.calibration.report import ladle_line
from pouring_robot.calibration.summary import calibration_metrics, next_measurements, notes_of, warnings_of
from pouring_robot.checks.flags import DataFlag, FlagCode
from pouring_robot.robot.heat_section import HeatSection
from tests.support import ROOT


def test_figures_are_json_and_agree_with_the_calibration(found):
    figures = json.loads(json.dumps(calibration_metrics(found), allow_nan=False))
    assert figures["gap"]["held_out"]["after"]["rms_mm"] == pytest.approx(
        found.misfit(found.split.test, after=True).rms_mm
    )
    assert figures["gap"]["held_out"]["floor"] == pytest.approx(found.floor(np.arange(len(found.before))))
    assert len(figures["parameters"]) == len(figures["correlation"]["names"])
    assert figures["base_parameters"]["rank"] == found.base.rank
    assert figures["noise"]["position_source"] == "repeats"
    assert figures["iso_9283"]["poses"] == 4


def test_the_documentation_names_every_key_of_the_json_and_no_other(found):
    page = (ROOT / "docs" / "calibration.md").read_text().partition("## What `calibration.json` holds")[2]
    rows = re.findall(r"^\| (`.*?) \| (.*) \|$", page.partition("\n## ")[0], flags=re.MULTILINE)
    told = {key: words for keys, words in rows for key in re.findall(r"`(\w+)`", keys)}
    figures = calibration_metrics(found)
    assert set(told) == set(figures)
    assert set(figures["ladle"]) <= {*re.findall(r"`(\w+)`", told["ladle"])}


def test_unchanged_figures(unchanged):
    figures = json.loads(json.dumps(calibration_metrics(unchanged), allow_nan=False))
    assert figures["status"] == "unchanged"
    assert figures["parameters"] == []
    # The y of target and tracker are confounded, but nothing was changed along it.
    assert figures["warnings"] == ["no parameter improves held-out rows, so the model is unchanged"]
    assert figures["iso_9283"] is None


def test_warnings(found):
    # Sixty poses all over the box show all that can be shown: what remains open is no reason to measure again.
    assert not any("rank" in line for line in warnings_of(found))
    short = replace(found, rank_anywhere=found.base.rank + 3)
    assert any(f"do not show 3 of {found.base.rank + 3} combinations" in line for line in warnings_of(short))
    assert calibration_metrics(found)["rank_deficient"] is True
    worse = replace(found, before=found.after, after=found.before)
    assert any("do not use this model" in line for line in warnings_of(worse))
    assert not any("do not use" in line for line in warnings_of(found))
    codes = FlagCode.ANOTHER_ROBOT, FlagCode.MEASUREMENT_JUMP, FlagCode.OUTLIER, FlagCode.NO_TEMPERATURES
    flags = tuple(DataFlag(code, code.severity, f"found: {code}", "mend") for code in codes)
    told = [line for line in warnings_of(replace(found, flags=flags)) if line.startswith("found: ")]
    assert told == ["found: another_robot", "found: measurement_jump"]  # rows that are left out are named elsewhere
    fit = found.fit
    larger = replace(fit.equations, residual=3.0 / fit.noise_ratio() * fit.equations.residual)
    large = replace(found, fit=replace(fit, equations=larger))
    assert any("3.00 times the noise: the model lacks an effect" in line for line in warnings_of(large))
    # The misfit may also be due to groups that few rows could not distinguish from chance.
    kept = large.selection.groups
    more = replace(large, candidates=(*kept, replace(kept[0], name="others")))
    assert any("or a group that was not kept (others; --keep-all keeps all)" in line for line in warnings_of(more))
    assert not any("not kept" in line for line in warnings_of(replace(large, candidates=kept)))


def test_a_search_that_ended_at_its_limit_and_rows_that_do_not_close_are_reported(found):
    equations = replace(found.fit.equations, failed=np.array([3, 7]))
    short = replace(found, fit=replace(found.fit, equations=equations, converged=False, last_step=0.4))
    added = [line for line in warnings_of(short) if line not in warnings_of(found)]
    assert len(added) == 2 and "ended at its limit" in added[0] and "be 0.40 standard deviations" in added[0]
    assert added[1] == "no pose of the robot matches the drives of 2 rows; left out"
    figures = calibration_metrics(short)
    assert (figures["fit"]["converged"], figures["rows"]["not_closing"]) == (False, 2)


def test_a_workspace_without_a_pose_is_reported(found):
    """The limits of a robot file may leave no pose in which it closes."""
    none = replace(found, ladle=replace(found.ladle, position_m=np.zeros((0, 3)), std_m=np.zeros((0, 3))))
    assert calibration_metrics(none)["ladle"] == {"poses": 0}
    assert ladle_line(none) == "the workspace box holds no pose the robot can take"
    assert [any("least certain" in line for line in next_measurements(one)) for one in (found, none)] == [True, False]


def test_worse_errors_are_reported_for_every_kind(found):
    """Distances with positions, and alone: then the figure of lengths is theirs, and not that of positions."""
    size = found.before.shape[0]
    none, small, large = np.full((size, 3), np.nan), np.full((size, 1), 1e-4), np.full((size, 1), 2e-4)
    for placed in (found.after[:, :3], none):
        before, after = (np.hstack([placed, none, distance]) for distance in (small, large))
        (told,) = [line for line in warnings_of(replace(found, before=before, after=after)) if "do not use" in line]
        assert told == "worse on held-out rows: closure 0.1 to 0.2 mm; do not use this model"


def test_what_to_measure_next(found, unchanged):
    lines = next_measurements(found)
    assert any("poses that narrow the intervals most" in line for line in lines)
    short = replace(found, rank_anywhere=found.base.rank + 3)
    assert any("poses that determine what is still unknown" in line for line in next_measurements(short))
    assert any("campaign plan --out next.csv --priors" in line for line in lines)
    assert any("least certain at x" in line for line in lines)
    assert not any("measured three times" in line for line in lines)
    assert any("measured three times" in line for line in next_measurements(unchanged))
    places = replace(found, campaign=replace(found.campaign, rotation_vector_rad=None))
    larger = replace(found.fit.equations, residual=3.0 / found.fit.noise_ratio() * found.fit.equations.residual)
    large = replace(found, fit=replace(found.fit, equations=larger))
    for other, said in ((places, "only positions were measured"), (large, "run pouring-robot diagnose")):
        assert [any(said in line for line in next_measurements(one)) for one in (found, other)] == [False, True]


def test_a_plan_is_suggested_for_the_target_that_was_seen(unchanged, clean):
    """Positions alone tell the lip by where the target sits; how far along y, only together with the base."""
    hidden_mm = 1e3 * clean.pose_platform_to_target.translation
    (told,) = re.findall(r"--target-mm (\S+) \S+ (\S+) ", next_measurements(unchanged)[0])
    assert [float(figure) for figure in told] == pytest.approx(hidden_mm[[0, 2]], abs=1.0)


@pytest.mark.parametrize(
    ("layout", "named"),
    [({"layout": "wide"}, "--layout wide"), ({"layouts_file": "x.yaml"}, "--model calibrated.yaml")],
)
def test_a_plan_is_suggested_for_the_machine_that_was_measured(found, layout, named):
    other = found.present.model_copy(update=layout)
    other._defined = (other.robot_path, other.layout, other.layouts_path), found.present.definition
    assert any(f"campaign plan {named} --out" in line for line in next_measurements(replace(found, present=other)))
    elsewhere = next_measurements(replace(found, present=other), Path("my results"))  # typed in the folder above
    typed = named.replace("calibrated.yaml", "'my results/calibrated.yaml'")
    assert any(f"campaign plan {typed} --out" in line for line in elsewhere)


def test_notes_say_what_no_measurement_determines(found, unchanged):
    notes = notes_of(found)
    never = len(found.base.names) - found.base.rank
    assert any(f"rank deficient by nature: {never} of {len(found.base.names)} directions" in line for line in notes)
    assert any("the full pose of the target nowhere" in line for line in notes)
    assert any("individually held by their tolerances" in line for line in notes)
    assert calibration_metrics(found)["notes"] == notes
    assert notes_of(unchanged) == []


def test_dropped_groups_are_named_as_taken_for_exact(found):
    dropped = [group.name for group in found.candidates if group not in found.selection.groups]
    everything = replace(found, candidates=found.selection.groups)
    assert not any("taken as exact" in line for line in notes_of(everything))
    (line,) = [line for line in notes_of(replace(found, candidates=found.candidates)) if "exact" in line]
    assert dropped and all(name in line for name in dropped)


def test_an_unused_heat_section_is_warned_of(found):
    warm = replace(found, present=found.present.model_copy(update={"heat": HeatSection()}))
    assert any("heat section of the model was not used" in line for line in warnings_of(warm))


@pytest.mark.parametrize(("factor", "lines_of", "shown"), [(4.0, warnings_of, ".1f"), (0.2, notes_of, ".2f")])
def test_values_far_from_their_tolerances_are_reported(found, factor, lines_of, shown):
    """A robot made to its tolerances is not; one with four times or a fifth of these errors is."""

    def told(one):
        return [line for line in lines_of(one) if "times as large as the tolerances" in line]

    assert not told(found)
    scaled = replace(found.fit.unknowns, values=factor * found.fit.unknowns.values)
    other = replace(found, fit=replace(found.fit, unknowns=scaled))
    frame = other.to_frame()
    times = np.sqrt(((frame["value"] / frame["prior_std"]) ** 2).sum() / frame["learnt"].sum())
    assert abs(np.log(times)) > np.log(2.0)
    assert [f"are {times:{shown}} times as large" in line for line in told(other)] == [True]


def test_rows_that_are_worse_one_by_one_are_reported_though_their_values_are_not_worse(found):
    """Rows with one coordinate count as much as rows with three."""
    sigma, test = found.noise.position_m, found.split.test
    before, after = (np.full((len(found.before), 6), size * sigma) for size in (1.0, 0.65))
    after[test[::2], 0] = 1.6 * sigma
    for seen in (before, after):
        seen[test[::2], 1:] = seen[:, 3:] = np.nan
    told = warnings_of(replace(found, before=before, after=after))
    assert "worse on held-out rows, row by row; do not use this model" in told


def test_a_loss_within_chance_in_held_out_rows_is_not_called_worse(found):
    """Rotations are a tenth worse by chance, within two standard errors, while positions are ten times better."""
    random = np.random.default_rng(2)
    sigma = np.repeat([found.noise.position_m, found.noise.rotation_rad], 3)
    before = sigma * random.normal(size=(len(found.before), 6)) * np.repeat([10.0, 1.0], 3)
    after = sigma * random.normal(size=before.shape)
    test = found.split.test
    after[test, 3:] *= 1.1 * np.sqrt(np.square(before[test, 3:]).sum() / np.square(after[test, 3:]).sum())
    assert not any("do not use" in line for line in warnings_of(replace(found, before=before, after=after)))
    after[test, 3:] *= 3.0
    assert any("do not use" in line for line in warnings_of(replace(found, before=before, after=after)))
