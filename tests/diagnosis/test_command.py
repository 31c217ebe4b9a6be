"""``diagnose`` and ``effects`` as a user runs them, on sound, short and damaged campaigns."""

import contextlib
import csv
import functools
import io
import json
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings

from pouring_robot.cli.app import main
from pouring_robot.effects.available import all_effects
from pouring_robot.robot.model import RobotModel
from tests.campaign.test_fuzz import damages, spoil
from tests.diagnosis.hidden import HOT, NOTHING, campaign
from tests.support import ROOT

pytestmark = pytest.mark.usefixtures("undrawn")
FUZZ = settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
FILES = {"diagnosis.json", "model.yaml", "report.html", "ladles.html", "next.csv"}
TEMPERATURES = ("melt_degC", "ambient_degC", "leg1_degC", "leg2_degC", "leg3_degC", "leg4_degC", "platform_degC")


class Table:
    """The files of a campaign, to be damaged."""

    def __init__(self, folder):
        """Read both files."""
        with (folder / "campaign.csv").open(newline="") as file:
            self.rows = list(csv.DictReader(file))
        self.settings = yaml.safe_load((folder / "campaign.yaml").read_text())

    def without(self, *columns):
        """Return the table without some columns."""
        return self._of([{k: v for k, v in row.items() if k not in columns} for row in self.rows])

    def head(self, count):
        """Return the first rows."""
        return self._of(self.rows[:count])

    def changed(self, change):
        """Return the table with every row changed."""
        return self._of([change(k, dict(row)) for k, row in enumerate(self.rows)])

    def _of(self, rows):
        other = object.__new__(Table)
        other.rows, other.settings = rows, json.loads(json.dumps(self.settings))
        return other

    def texts(self):
        """Return both files as bytes."""
        stream = io.StringIO()
        writer = csv.DictWriter(stream, list(self.rows[0]))
        writer.writeheader()
        writer.writerows(self.rows)
        return stream.getvalue().encode(), yaml.safe_dump(self.settings).encode()


@pytest.fixture(scope="module")
def hot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hot")
    campaign(folder, HOT)
    return Table(folder)


def diagnosed(folder, table, *more):
    """Run the command as the shell does: exit code, figures (None on failure), standard output, error output."""
    (folder / "c.csv").write_bytes(table.texts()[0])
    (folder / "c.yaml").write_bytes(table.texts()[1])
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()) as error:
        code = main(["diagnose", str(folder / "c.csv"), "--out", str(folder / "out"), *more])
    left = {path.name for path in folder.iterdir()} - {"c.csv", "c.yaml"}
    if code:
        assert left == set()
        assert error.getvalue().count("\n") == 1
        return code, None, said.getvalue(), error.getvalue()
    assert left == {"out"}
    return code, json.loads((folder / "out" / "diagnosis.json").read_text()), said.getvalue(), error.getvalue()


@pytest.fixture
def run(tmp_path):
    return functools.partial(diagnosed, tmp_path)


@pytest.fixture(scope="module")
def written(hot, tmp_path_factory):
    """The folder of a sound campaign's files, and the command's results."""
    folder = tmp_path_factory.mktemp("sound")
    return folder / "out", diagnosed(folder, hot)


def named(figures):
    return [effect["effect"] for effect in figures["effects"]]


def test_the_suggested_next_measurements_can_be_measured_virtually(written, hot, tmp_path):
    """Effects with a time lag depend on the time, and the plan states it by the clock of the campaign."""
    out, (_, figures, _, _) = written
    simulate = ("campaign", "simulate", "--plan", str(out / "next.csv"), "--model", str(out / "model.yaml"))
    assert main([*simulate, "--out", str(tmp_path / "virtual.csv"), "--quiet"]) == 0
    with (tmp_path / "virtual.csv").open(newline="") as file:
        times = [float(row["time_s"]) for row in csv.DictReader(file)]
    last = max(float(row["time_s"]) for row in hot.rows)
    later = [last + 3600.0 * step["hours_later"] for step in figures["suggested_measurements"]]
    np.testing.assert_allclose(times, later, rtol=0, atol=18.5)  # hours are printed to two decimals


def test_a_sound_campaign_from_file_to_files(written):
    out, (code, figures, said, _) = written
    assert code == 0
    assert {path.name for path in out.iterdir()} == FILES
    assert figures["verdict"] == "named"
    assert named(figures) == ["leg_thermal_expansion"]
    assert figures["model"] == str(out / "model.yaml")
    assert said.startswith("NAMED: the model lacks leg_thermal_expansion")
    assert all(f"wrote {out / name}" in said.replace("\n", "") for name in FILES)


def test_the_amended_model_closes_the_gap(hot, run, written):
    code, figures, said, _ = run(hot, "--model", str(written[0] / "model.yaml"))
    assert code == 0
    assert figures["verdict"] == "no_gap"
    assert figures["effects"] == []
    assert not figures["amended"]
    assert said.startswith("NO GAP")


def test_json_output_is_json_and_equals_the_file_and_files_of_a_user_stay(hot, run, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("x")
    code, figures, said, _ = run(hot, "--json")
    printed = json.loads(said)
    assert code == 0
    assert len(printed.pop("written")) == len(FILES)
    assert printed == figures
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*FILES, "mine.txt"}


def test_the_documentation_names_every_key_of_the_json_and_no_other(written):
    _, (_, figures, _, _) = written
    page = (ROOT / "docs" / "diagnosis.md").read_text()
    rows = re.findall(r"^\| (`.*?) \| (.*) \|$", page.partition("`diagnosis.json` holds (")[2], flags=re.MULTILINE)
    told = {key: words for keys, words in rows for key in re.findall(r"`(\w+)`", keys)}
    assert set(told) == set(figures)
    (effect,) = figures["effects"]
    assert set(effect) <= {*re.findall(r"`(\w+)`", told["effects"]), "effect"}
    assert figures["amended"]


def test_an_excluded_effect_is_not_named(hot, run):
    _, figures, _, _ = run(hot.head(45), "--exclude", "leg_thermal_expansion")
    assert "leg_thermal_expansion" not in [e["effect"] for key in ("effects", "nearest") for e in figures[key]]


def test_an_effect_that_does_not_exist_is_reported_with_the_nearest_name(hot, run):
    code, _, _, error = run(hot, "--exclude", "leg_thermal_expanson")
    assert code == 2
    assert "leg_thermal_expansion" in error


def test_effects_lists_the_whole_library(capsys):
    assert main(["effects"]) == 0
    text = capsys.readouterr().out
    assert main(["effects", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["effects"]
    assert [item["effect"] for item in listed] == list(all_effects())
    for item in listed:
        assert f"{item['effect']}: {item['story']}" in text.replace("\n", " ")
        assert all(form["parameters"] for form in item["forms"])
    needs = {item["effect"]: item["needs"] for item in listed}
    assert needs["drive_backlash"] == [f"approach_q{k}" for k in (1, 2, 3, 4)]
    assert needs["joint_axis_tilt"] == []


# --- short and damaged campaigns --------------------------------------------------------------------------------------


def test_fewer_than_eight_rows_are_refused(hot, run):
    code, _, _, error = run(hot.head(7))
    assert code == 2
    assert "only 7 rows" in error
    assert "measure more poses" in error
    assert "c.csv" in error


@pytest.mark.parametrize("count", [9, 14, 25])
def test_short_campaigns_report_how_little_they_are(hot, run, count):
    code, figures, said, _ = run(hot.head(count))
    assert code == 0
    assert f"only {count} rows" in said
    assert figures["verdict"] in {"no_gap", "named", "group", "unknown"}
    if count < 15:
        assert figures["gap"]["held_out"] is None
        assert "no rows are held out" in said.replace("\n", " ")


def test_one_pose_repeated_is_refused(hot, run):
    measured = ("q1_mm", "q2_mm", "q3_mm", "q4_rad", "x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad")
    noise = np.random.default_rng(0)

    def same(_, row):
        row |= {name: hot.rows[0][name] for name in measured}
        return row | {"x_mm": f"{float(row['x_mm']) + 0.05 * noise.normal():.5f}"}

    code, _, _, error = run(hot.changed(same))
    assert code == 2
    assert "only 1 different pose" in error


def test_without_stated_noise_the_source_of_the_noise_is_reported(hot, run):
    table = hot.head(70)
    for name in list(table.settings["metrology"]):
        if name.startswith("sigma"):
            del table.settings["metrology"][name]
    code, figures, said, _ = run(table)
    assert code == 0
    assert figures["noise"]["position_source"] in {"repeats", "residuals"}
    assert "noise is not stated" in said.replace("\n", " ")


def test_a_single_rotation_leaves_no_residual_and_is_no_misfit(hot, run):
    """The frames explain it exactly: only rounding remains, from which no noise may be estimated."""
    table = hot.head(16).changed(lambda k, row: row | (dict.fromkeys(("rx_rad", "ry_rad", "rz_rad"), "") if k else {}))
    table.settings["metrology"] = {
        name: value for name, value in table.settings["metrology"].items() if not name.startswith("sigma")
    }
    code, figures, _, _ = run(table)
    assert code == 0
    assert figures["misfit"] == ""
    assert figures["verdict"] != "unknown"
    assert not any("size_mrad" in entry for entry in figures["where"])


def test_without_temperatures_heat_is_untestable_and_nothing_else_is_blamed(hot, run):
    code, figures, said, _ = run(hot.head(45).without(*TEMPERATURES))
    assert code == 0
    assert {"leg_thermal_expansion", "platform_thermal_expansion"} <= {u["effect"] for u in figures["untestable"]}
    assert "leg1_degC, leg2_degC, leg3_degC, leg4_degC" in said.replace("\n  ", " ")
    assert not {"leg_thermal_expansion", "platform_thermal_expansion"} & set(named(figures))


def test_without_time_the_order_of_rows_stands_for_it(hot, run):
    code, figures, said, _ = run(hot.without("time_s"))
    assert code == 0
    assert "no times are given" in said
    assert named(figures)[:1] == ["leg_thermal_expansion"]


def test_positions_only(hot, run):
    code, figures, said, _ = run(hot.without("rx_rad", "ry_rad", "rz_rad"))
    assert code == 0
    assert figures["gap"]["train"]["before_rms_mrad"] is None
    assert "mrad" not in said.splitlines()[1]


def test_empty_cells_are_filled_in_and_that_is_reported(hot, run):
    random = np.random.default_rng(1)

    def holes(_, row):
        return {
            k: "" if k in ("payload_kg", "leg2_degC", "x_mm") and random.random() < 0.2 else v for k, v in row.items()
        }

    code, figures, said, _ = run(hot.changed(holes))
    assert code == 0
    assert "missing cells were filled in" in said
    assert figures["verdict"] in {"named", "group"}
    assert "leg_thermal_expansion" in named(figures)


def test_wrong_units_are_reported(hot, run):
    code, _, _, error = run(
        hot.changed(lambda _, row: row | {n: f"{float(row[n]) / 1e3}" for n in ("x_mm", "y_mm", "z_mm")})
    )
    assert code in {2, 3}
    assert "metres under a heading in millimetres" in error


def test_a_model_whose_effects_need_conditions_the_campaign_lacks_is_refused(hot, run, written):
    code, _, _, error = run(hot.without(*TEMPERATURES), "--model", str(written[0] / "model.yaml"))
    assert code == 3
    assert "leg_thermal_expansion" in error


def test_an_output_folder_that_cannot_be_made_is_reported_before_the_work(hot, tmp_path, capsys):
    (tmp_path / "file").write_text("x")
    assert main(["diagnose", "--out", str(tmp_path / "file"), "nothing.csv"]) == 2
    assert "give a folder" in capsys.readouterr().err


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    campaign(folder, NOTHING, rows=16)
    return (folder / "campaign.csv").read_bytes(), (folder / "campaign.yaml").read_bytes()


def check(table, metadata, capsys):
    """Run on damaged files: done, or refused in one line without leaving any file behind."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "c.csv").write_bytes(table)
        (folder / "c.yaml").write_bytes(metadata)
        capsys.readouterr()
        code = main(["diagnose", str(folder / "c.csv"), "--out", str(folder / "out")])
        error = capsys.readouterr().err
        left = {path.name for path in folder.iterdir()} - {"c.csv", "c.yaml"}
        if code == 0:
            assert left == {"out"}
            assert {path.name for path in (folder / "out").iterdir()} <= FILES
            RobotModel.load(folder / "out" / "model.yaml")
            return
        assert code in {2, 3}
        assert error.count("\n") == 1, error
        assert "Traceback" not in error
        assert not left


@FUZZ
@given(changes=damages())
@example(changes=[(0.7002813453912137, 2, b"")])  # backlash, whose forms do not differ in the other rows
def test_a_damaged_table_never_leads_to_a_traceback(small, changes, capsys):
    check(spoil(small[0], changes), small[1], capsys)


@FUZZ
@given(changes=damages())
def test_a_damaged_yaml_never_leads_to_a_traceback(small, changes, capsys):
    check(small[0], spoil(small[1], changes), capsys)
