"""The telescope example: synthetic tables with a known truth; the real ones if they are next to the clone."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

from examples.telescope_focus.command import main
from examples.telescope_focus.data import FIRST_FILE, SECOND_FILE, read_first, read_second
from examples.telescope_focus.findings import Findings, least_squares
from examples.telescope_focus.model import constants
from examples.telescope_focus.plan import propose, with_conditions
from examples.telescope_focus.report import report
from pouring_robot.exceptions import CampaignError, DiagnosisError
from tests.support import ROOT, SHARED

REAL = SHARED / "data" / "desi_focus_thermal"
NIGHTS = (20210301, 20210302, 20210304, 20210305, 20210307, 20210309, 20210310, 20210312)
ODD = 20210309
SLOPE, OFFSET, NOISE = -105.0, -320.0, 40.0


def tables(folder, seed, *, slope=SLOPE, offset=OFFSET, flexure=0.0, lowest_deg=60.0, exposures=4, air_k=1.0):
    """Write two tables in the observers' format; in the first every night has its own temperatures."""
    rng = np.random.default_rng(seed)
    folder.mkdir(exist_ok=True)
    lines = ["#T_NNT CIN CIW CIC CIE CIS expmin psf psf psf psf psf psf gauss T_mirrorNIB T_trussmean date AZ EL", ""]
    for count, night in enumerate(NIGHTS):
        start, mirror = rng.uniform(5.0, 17.0), rng.uniform(6.0, 14.0)
        for k in range(exposures):
            truss, elevation = start - 0.4 * k, rng.uniform(lowest_deg, 88.0)
            focus = -7500.0 + slope * truss + offset * (night == ODD) + flexure * math.sin(math.radians(elevation))
            fields = [focus + NOISE * rng.normal() for _ in range(5)]
            values = [truss + air_k * rng.normal(), *fields, 1000 + 100 * count + k, *([1.1] * 5), 1, mirror, truss]
            lines.append(" ".join(f"{v:.2f}" for v in values) + f" {night} {rng.uniform(0, 360):.2f} {elevation:.2f}")
    lines.insert(4, "#" + lines[3])
    (folder / FIRST_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
    second = ["#start_expnum focus_est truss_temp el az mirtemp psf_size date"]
    for k in range(30):
        truss, elevation = rng.uniform(6.0, 17.0), rng.uniform(30.0, 88.0)
        focus = 1500.0 + slope * truss + flexure * math.sin(math.radians(elevation)) + NOISE * rng.normal()
        pointing = f"{elevation:.1f} {rng.uniform(0, 360):.1f} {rng.uniform(6, 14):.1f}" if k < 20 else "0 0 0"
        second.append(f"{9000 + k} {focus:.0f} {truss:.1f} {pointing} 1.2 {20210901 + k // 3} # a remark")
    (folder / SECOND_FILE).write_text("\n".join(second) + "\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tables(tmp_path_factory.mktemp("focus"), 3)


@pytest.fixture(scope="module")
def findings(folder):
    return Findings(read_first(folder))


@pytest.fixture(scope="module")
def printed(folder):
    """The report as JSON, by the command in a separate process, run as a script outside the checkout."""
    script = ROOT / "examples" / "telescope_focus" / "diagnose.py"
    command = [sys.executable, str(script), str(folder), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert done.stderr == ""
    assert done.returncode == 0
    return json.loads(done.stdout)


def test_the_reader_takes_columns_by_position(folder):
    rows = read_first(folder)
    assert len(rows) == 32
    words = (folder / FIRST_FILE).read_text().splitlines()[2].split()
    first = (rows.air_degc[0], rows.focus_um[0], rows.exposure[0], rows.mirror_degc[0], rows.truss_degc[0])
    assert first == tuple(float(words[k]) for k in (0, 3, 6, 13, 14))
    assert (rows.night[0], rows.azimuth_deg[0], rows.elevation_deg[0]) == (NIGHTS[0], *map(float, words[16:]))
    assert rows.day[-1] == 11.0
    second = read_second(folder)
    assert second.complete.tolist() == [True] * 20 + [False] * 10


def test_truss_is_named_and_the_odd_night_is_unknown(printed):
    assert printed["verdict"] == "unknown"
    (named,) = printed["effects"]
    assert named["effect"] == "truss_expansion"
    assert named["probability"] > 0.95
    slope = named["parameters"]["slope"]
    assert abs(slope["value"] - SLOPE) < 3.0 * slope["std"] < 15.0
    (night,) = printed["unknown"]["nights"]
    assert night["night"] == str(ODD)
    assert abs(night["offset"]["value"] - OFFSET) < 3.0 * night["offset"]["std"] < 120.0
    assert printed["unknown"]["left_after_nights"] == []


def test_noise_is_found_from_the_rows(printed):
    noise = printed["noise"]
    assert abs(noise["mean_um"] - NOISE) < 3.0 * noise["std_um"] < 30.0


def test_the_residual_shrinks_to_the_noise(printed):
    left = [step["residual_std_um"] for step in printed["gap"]["train"]]
    assert [step["with"] for step in printed["gap"]["train"]][1] == ["truss_expansion"]
    assert left == sorted(left, reverse=True)
    assert left[-1] == pytest.approx(NOISE, rel=0.35)
    held_out = printed["gap"]["held_out"]
    assert held_out["before_std_um"] > 4.0 * held_out["after_std_um"]
    assert held_out["after_std_um"] == pytest.approx(NOISE, rel=0.4)


def test_elevation_is_undecided_and_low_and_high_elevations_are_suggested(printed):
    item = next(i for i in printed["undecided"] if i["effect"] == "elevation_flexure" and i["form"] == "sine")
    assert item["evidence_nats"] < 5.0
    assert abs(item["parameters"]["sine"]["value"]) < 3.0 * item["parameters"]["sine"]["std"]
    plan = next(p for p in printed["suggested_measurements"] if p["decides"] == "elevation_flexure")
    assert {"25", "85"} <= set(plan["exposures"]["elevation_deg"])
    assert sum(plan["exposures"]["elevation_deg"].values()) == 8
    assert plan["expected_information_nats"] > plan["ordinary_exposures_nats"] > 0.0
    std = plan["change_std_um"]
    assert std["then"] < std["with_ordinary_exposures"] < std["now"]


def test_the_plan_reaches_the_promised_standard_deviation(folder, findings):
    """With the proposed exposures added to the rows, the covariance of least squares shrinks as promised."""
    angles = np.arange(25.0, 86.0, 5.0)
    key = ("elevation_flexure", "sine and cosine")
    candidates = with_conditions(findings.rows, len(angles), elevation_deg=angles)
    plan = propose(findings, key, candidates, 8, night_std_um=300.0)
    held = [findings.forms[k].columns for k in (key, *findings.keys)]
    before = np.hstack([*held, constants(findings.rows), np.zeros((len(findings.rows), 1))])
    waves = np.radians(plan.rows.elevation_deg)
    new = np.zeros((8, before.shape[1]))
    new[:, 0], new[:, 1] = np.sin(waves), np.cos(waves)
    truss = 2 + sum(
        findings.forms[k].columns.shape[1] for k in findings.keys[: findings.keys.index(findings.causes[0])]
    )
    new[:, truss] = plan.rows.truss_degc - findings.rows.truss_degc.mean()
    new[:, -2:] = 1.0
    night = np.zeros(before.shape[1])
    night[-1] = findings.noise_um / 300.0
    low, high = np.radians(25.0), np.radians(85.0)
    turn = np.array([np.sin(high) - np.sin(low), np.cos(high) - np.cos(low)])
    for table, expected in ((before, plan.now), (np.vstack([before, new]), plan.then)):
        known = np.linalg.inv(table.T @ table + np.outer(night, night))[:2, :2] * findings.noise_um**2
        assert expected == pytest.approx(np.sqrt(turn @ known @ turn), rel=1e-3)


def test_steps_are_those_of_least_squares(findings):
    rows, (_, fit) = findings.rows, findings.steps()[1]
    slope, spread = np.polyfit(rows.truss_degc, rows.focus_um, 1, cov=True)
    assert fit.values[0] == pytest.approx(slope[0])
    assert np.sqrt(fit.covariance[0, 0]) == pytest.approx(np.sqrt(spread[0, 0]))
    assert least_squares(rows, []).std_um == pytest.approx(rows.focus_um.std(ddof=1))


def test_without_an_odd_night_truss_is_named_and_nothing_is_unknown(tmp_path):
    found = Findings(read_first(tables(tmp_path, 5, offset=0.0)))
    assert found.keys == (("truss_expansion", "linear"),)
    assert found.structures(found.keys) == []


def test_effects_that_these_rows_cannot_distinguish_are_a_group(tmp_path):
    """The sensor follows the truss to a twentieth of a kelvin: whichever is named, the other is its alternative."""
    diagnosis = report(*(read(tables(tmp_path, 9, offset=0.0, air_k=0.05)) for read in (read_first, read_second)))
    assert diagnosis["verdict"] == "group"
    (named,) = diagnosis["effects"]
    assert {named["effect"], *named["alternatives"]} == {"truss_expansion", "air_temperature"}
    assert 0.4 < named["probability"] < 0.95


def test_a_constant_focus_lacks_nothing(tmp_path):
    found = Findings(read_first(tables(tmp_path, 6, slope=0.0, offset=0.0)))
    assert found.keys == ()
    assert found.noise_um == pytest.approx(NOISE, rel=0.4)


def test_flexure_is_named_where_elevations_show_it(tmp_path):
    found = Findings(read_first(tables(tmp_path, 7, offset=0.0, flexure=400.0, lowest_deg=25.0)))
    assert {key[0] for key in found.causes} == {"truss_expansion", "elevation_flexure"}
    assert found.nights == ()


def test_a_condition_that_never_changes_cannot_be_tested(tmp_path, monkeypatch):
    made = []  # made by the command: from the first table, then from both
    kept = lambda rows: made.append(Findings(rows)) or made[-1]  # noqa: E731
    monkeypatch.setattr("examples.telescope_focus.report.Findings", kept)
    assert main([str(tables(tmp_path, 8, offset=0.0, lowest_deg=88.0)), "--json"]) == 0
    assert made[0].untestable == ["elevation_flexure"]
    assert all(key[0] != "elevation_flexure" for key, *_ in made[0].undecided())


def test_text_says_the_same(folder, capsys, printed, monkeypatch):
    monkeypatch.setattr("examples.telescope_focus.command.report", lambda *_: printed)  # as computed for the JSON
    assert main([str(folder)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("Verdict: unknown\n")
    assert "Named: truss_expansion" in text
    assert f"Unknown: the night {ODD} (4 rows)" in text
    assert f"left {printed['gap']['train'][0]['residual_std_um']:6.0f} µm  constant only" in text
    assert "elevation_flexure: elevation 25 deg" in text
    assert "10 of 30 rows" in text


def _damaged(folder, tmp_path, name, change):
    for file in (FIRST_FILE, SECOND_FILE):
        (tmp_path / file).write_bytes((folder / file).read_bytes())
    lines = (folder / name).read_text().splitlines()
    number = next(k for k, line in enumerate(lines) if line and not line.startswith("#")) + 1
    lines[number] = change(lines[number].partition("#")[0].split())
    (tmp_path / name).write_text("\n".join(lines))
    return number + 1


def _with(place, word):
    return lambda words: " ".join([*words[:place], word, *words[place + 1 :]])


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (FIRST_FILE, lambda words: " ".join(words[:-1]), "17 values where 18 are needed"),
        (FIRST_FILE, _with(3, "12,5"), "column 'focus_um': '12,5'"),
        (FIRST_FILE, _with(14, "nan"), "column 'truss_degc'"),
        (FIRST_FILE, _with(17, "97"), "column 'elevation_deg'"),
        (FIRST_FILE, _with(15, "20210231"), "no date"),
        (SECOND_FILE, _with(2, "1e400"), "column 'truss_degc'"),
        (SECOND_FILE, lambda words: " ".join([*words, "7"]), "9 values where 8 are needed"),
    ],
)
def test_a_damaged_line_is_reported_in_one_line(folder, tmp_path, capsys, name, change, said):
    number = _damaged(folder, tmp_path, name, change)
    assert main([str(tmp_path)]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.count("\n") == 1
    assert f"{name}: line {number}" in error
    assert said in error


def test_missing_and_unreadable_files_are_reported_in_one_line(folder, tmp_path, capsys):
    given = tmp_path / "given"
    assert main([str(given)]) == 2
    given.mkdir()
    (given / FIRST_FILE).write_bytes((folder / FIRST_FILE).read_bytes())
    assert main([str(given)]) == 2
    (given / SECOND_FILE).write_bytes(b"\xff\xfe\x00")
    assert main([str(given)]) == 2
    (given / SECOND_FILE).write_text("# nothing\n")
    assert main([str(given)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [
        said in line for said, line in zip((FIRST_FILE, SECOND_FILE, "not text", "no row"), lines, strict=True)
    ] == [True] * 4
    with pytest.raises(CampaignError):
        read_second(given)


def test_too_few_or_equal_rows_get_a_clear_answer(folder, tmp_path, capsys):
    few = tables(tmp_path / "few", 3, exposures=1)
    assert main([str(few)]) == 3
    assert "8 complete rows, 12 are needed" in capsys.readouterr().err
    rows = read_first(folder)
    rows.focus_um[:] = -9000.0
    with pytest.raises(DiagnosisError, match="the same in every row"):
        Findings(rows)


@pytest.mark.skipif(not REAL.is_dir(), reason=f"the observers' tables are not ours to ship: no {REAL}")
def test_the_real_telescope(capsys):
    """Figures of an independent least-squares fit of the same rows."""
    assert main([str(REAL), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "unknown"
    (named,) = found["effects"]
    assert named["effect"] == "truss_expansion"
    assert abs(named["parameters"]["slope"]["value"] + 111.0) < 4.0
    assert found["unknown"]["nights"][0]["night"] == "20190409"
    steps = found["gap"]["train"]
    assert [step["residual_std_um"] for step in steps][:3] == pytest.approx([484.0, 115.0, 70.0], abs=1.0)
    with_night = steps[2]["parameters"]
    assert with_night["truss_expansion: slope"]["value"] == pytest.approx(-111.0, abs=1.0)
    assert with_night["truss_expansion: slope"]["std"] == pytest.approx(3.7, abs=0.5)
    assert with_night["night 20190409: offset"]["value"] == pytest.approx(-255.0, abs=2.0)
    assert with_night["night 20190409: offset"]["std"] == pytest.approx(36.0, abs=1.0)
    assert "elevation_flexure" in {item["effect"] for item in found["undecided"]}
    assert found["suggested_measurements"][0]["decides"] == "elevation_flexure"
    assert found["gap"]["held_out"]["after_std_um"] < 0.4 * found["gap"]["held_out"]["before_std_um"]
