"""Summary, ranking and the command's outputs."""

import csv
import html
import json
import re
import runpy
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from pouring_robot.cli.app import main
from pouring_robot.report.plots import new_figure, own_look, svg_of
from pouring_robot.robot.model import RobotModel
from pouring_robot.sweeps import ErrorEntry, SweepConfig, SweepPlan, open_results, run_sweep, sweep
from pouring_robot.sweeps.analysis.report import (
    _cumulative,
    html_report,
    map_of,
    report,
    share_text,
    study_figure,
)
from pouring_robot.sweeps.analysis.summary import Distances
from pouring_robot.sweeps.analysis.tolerances import transfer_matrices
from tests.support import LEARNED, ROOT
from tests.sweeps.sweep_files import write

ALLOCATION = {"by": "part", "share": 0.95, "machines": 50}


@pytest.fixture(scope="module")
def one_at_a_time(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one_at_a_time")
    plan = SweepPlan.load(write(folder, study="one_at_a_time", samples=None, chunk=30))
    return report(run_sweep(plan, folder / "out")), open_results(folder / "out")


def test_one_call_runs_reports_and_saves(one_at_a_time, tmp_path):
    first, _ = one_at_a_time
    path = write(tmp_path, study="one_at_a_time", samples=None, chunk=30)
    told = []
    outcome = sweep(path, tmp_path / "out", progress=lambda *step: told.append(step))
    assert told[-1][1] == told[-1][2] and {stage for stage, *_ in told} == {"sweep", "summary"}
    assert outcome.figures() == first.figures()
    assert sweep(SweepConfig.load(path), tmp_path / "out", resume=True).figures() == first.figures()
    assert repr(outcome) == f"<SweepReport: {outcome.headline}>" and "\n" not in outcome.headline
    assert f"{outcome.ranking[0].name} matters most" in outcome.headline
    frame = outcome.to_frame()
    assert frame.name.tolist() == [parameter.name for parameter in outcome.ranking]
    assert frame.largest_mm.tolist() == [parameter.figures["largest_mm"] for parameter in outcome.ranking]
    assert "<table" in outcome._repr_html_()
    assert float(abs(outcome.to_dataset().displacement).max()) > 0.0
    assert sorted(file.name for file in outcome.save()) == ["ranking.csv", "report.html", "summary.json", "sweep.png"]


def test_distances_within_a_decade_have_figures_on_their_axis():
    figure = new_figure(4.0, 3.0)
    distances = SimpleNamespace(edges_m=np.array([2e-3, 4e-3, 8e-3]), counts=np.array([1, 1, 0, 0]))
    with own_look():
        _cumulative(figure.subplots(), SimpleNamespace(distances=distances, accuracy_m=7e-3, frame="tool"))
    written = re.findall(r"<text[^>]*>(.*?)</text>", svg_of(figure))
    assert {"2", "3", "4", "6"} <= set(written) and "$" not in "".join(written)


def test_the_map_shows_every_pose_with_its_rms_over_the_robots(one_at_a_time):
    outcome, data = one_at_a_time
    moved = data.displacement.sel(frame="ladle_lip").values
    rms = 1e3 * np.sqrt((moved**2).sum(axis=-1).mean(axis=0))
    told = re.findall(
        r"<title>pose (\d+): x \S+, y (\S+), z \S+ mm: ([\d.]+) mm</title>",
        svg_of(map_of(outcome.store.plan, outcome.summary)),
    )
    assert sorted(int(pose) for pose, *_ in told) == list(range(1, len(rms) + 1))
    assert [float(value) for _, _, value in told] == pytest.approx([rms[int(k) - 1] for k, *_ in told], abs=6e-4)


def test_the_page_says_what_the_figures_say(one_at_a_time, tmp_path):
    outcome, _ = one_at_a_time
    page = html.unescape(html_report(outcome, study_figure(outcome), {"all figures": "summary.json"}))
    assert outcome.headline in page and 'href="summary.json"' in page
    assert "RMS over the errors alone" in page and "robots" not in page
    assert page.count('<td class="l">') >= len(outcome.ranking) and "SHA-256" in page
    assert [page.count(f'<tr><td class="l">{p.name}</td>') for p in outcome.ranking] == [1] * len(outcome.ranking)


def test_the_summary_is_that_of_the_arrays(one_at_a_time):
    outcome, data = one_at_a_time
    distance = np.linalg.norm(data.displacement.sel(frame="ladle_lip").values, axis=-1)
    figures = outcome.summary.figures()
    assert figures["status"] == {"ok": distance.size}
    assert figures["largest_mm"] == pytest.approx(1e3 * distance.max(), rel=1e-12)
    assert figures["share_within"] == (distance <= 0.010).mean()
    assert figures["worst_pose"] == int(np.argmax(distance.max(axis=0)))
    rms = np.sqrt((data.displacement.sel(frame="ladle_lip").values ** 2).mean(axis=(0, 1)))
    assert list(figures["rms_mm"].values()) == pytest.approx((1e3 * rms).tolist(), rel=1e-9)
    for share, value in figures["quantiles_mm"].items():
        exact = 1e3 * np.quantile(distance, float(share), method="inverted_cdf")
        assert value == pytest.approx(exact, rel=2e-3)


def test_the_ranking_is_by_the_largest_displacement(one_at_a_time):
    outcome, data = one_at_a_time
    distance = np.linalg.norm(data.displacement.sel(frame="ladle_lip").values, axis=-1).max(axis=1)
    order = [str(data.parameter.values[k]) for k in np.argsort(-distance, kind="stable")]
    assert [r.name for r in outcome.ranking][:5] == order[:5]
    assert outcome.ranking[0].figures["main_axis"] == "y"


def test_monte_carlo_ranks_by_first_order_scatter(make_plan, tmp_path):
    plan = make_plan()
    outcome = report(run_sweep(plan, tmp_path))
    std = np.array([margin.std for margin in plan.draws.margins])
    squares = ((transfer_matrices(plan, plan.poses)[:, :3] * std) ** 2).sum(axis=(0, 1))
    weights = {name: float(s) for name, s in zip(plan.names, squares / squares.sum(), strict=True)}
    assert sum(weights.values()) == pytest.approx(1.0)
    assert [r.weight for r in outcome.ranking] == pytest.approx([weights[r.name] for r in outcome.ranking])
    assert sorted(r.weight for r in outcome.ranking) == [r.weight for r in outcome.ranking][::-1]
    # A distance along an axis that the next joint slides or turns about moves nothing; G has round-off there.
    still = [r.figures for r in outcome.ranking if weights[r.name] < 1e-20]
    assert still and still == [{"share_of_scatter": 0.0, "rms_mm": 0.0, "main_axis": ""}] * len(still)


@pytest.mark.parametrize("kind", ["closed_chain", "open_branch"])
def test_the_transfer_matrix_is_that_of_the_frame(make_plan, kind):
    entry = ErrorEntry(parameters=("*_e1_*", "drive.leg1_s3"), half_width_mm=1.0, half_width_mrad=1.0)
    plan = make_plan(study="one_at_a_time", samples=None, kind=kind, errors=[entry])
    step = 1e-5
    near, far = (plan.moved(s * step * np.eye(len(plan.names)), plan.poses).displacement for s in (1.0, -1.0))
    found = transfer_matrices(plan, plan.poses)[:, :3]
    expected = np.moveaxis((near - far)[:, :, 0] / (2 * step), 0, -1)
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()


def test_the_transfer_matrix_of_a_model_is_taken_where_its_drives_really_stand(make_plan, tmp_path):
    path = tmp_path / "off.yaml"
    path.write_text(RobotModel(layout="paper").displaced({}, {"leg1_s3": 4e-3, "leg4_s5": 4e-3}).file_text(tmp_path))
    plan = make_plan(study="one_at_a_time", samples=None, layout=None, model=str(path))
    step = 1e-6
    near, far = (plan.moved(s * step * np.eye(len(plan.names)), plan.poses).displacement for s in (1.0, -1.0))
    expected = np.moveaxis((near - far)[:, :, 0] / (2 * step), 0, -1)
    assert np.abs(transfer_matrices(plan, plan.poses)[:, :3] - expected).max() < 1e-4 * np.abs(expected).max()


def test_effects_that_depend_on_conditions_are_said_to_be_left_out(tmp_path, capsys):
    file = write(tmp_path, layout=None, model=str(LEARNED), samples=2)
    assert main(["sweep", str(file), "--out", str(tmp_path / "a")]) == 0
    said = "does not apply the effects of .*learned.yaml that depend on conditions: tilt_drive_compliance, drive_scale"
    assert re.search(f"note: this command {said}", capsys.readouterr().err)
    with pytest.warns(UserWarning, match=f"sweep {said}"):
        sweep(file, tmp_path / "b")


def test_failures_are_counted_and_reported(tmp_path, capsys):
    # Random tilts of 0.15 rad: at many poses the parts do not fit together any more.
    config = write(tmp_path, errors=[{"parameters": "leg?_s2.r?", "half_width_mrad": 150}])
    assert main(["sweep", str(config), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "without a solution, kept with their status" in out and "never" not in out
    status = open_results(tmp_path / "out").status.values
    figures = json.loads((tmp_path / "out/summary.json").read_text())["summary"]
    assert sum(figures["status"].values()) == status.size
    assert figures["status"]["ok"] == (status == 0).sum() < status.size
    assert figures["share_within"] < (status == 0).mean() + 1e-12
    said = f"of the {(status == 0).sum()} of {status.size} cases that closed, there by no more than"
    assert said in " ".join(out.split())


def test_nothing_but_failures_still_gives_a_report_and_ends_without_a_solution(tmp_path, capsys):
    config, out = write(tmp_path, samples=3, errors=[{"parameters": "leg?_s?.r?", "half_width_mrad": 2000}]), tmp_path
    assert main(["sweep", str(config), "--out", str(out / "one"), "--json"]) == 3
    told = capsys.readouterr()
    figures = json.loads(told.out)["summary"]
    assert "ok" not in figures["status"] and figures["share_within"] == 0.0
    unknown = {"largest_mm", "largest_mrad", "worst_pose", "largest_gap_mm", "largest_gap_mrad"}
    assert [figures[name] for name in unknown] == [None] * 5
    assert {*figures["rms_mm"].values(), *figures["quantiles_mm"].values()} == {None}
    assert told.err.count("\n") == 1 and "none of the 24 cases closes" in told.err
    assert main(["sweep", str(config), "--out", str(out / "two")]) == 3
    told = capsys.readouterr().out
    assert "3 robots at 8 poses: none of the 24 cases closes" in told and "0.000 mm" not in told
    assert len(list((out / "two").iterdir())) == 5


def test_a_robot_as_built_that_closes_nowhere_has_no_error_of_its_own_that_is_known(tmp_path, capsys):
    signs = {1: (-1, 1), 2: (1, -1), 3: (-1, -1), 4: (1, 1)}
    placements = {
        f"leg{k}_s1": {"translation_mm": [500 * (-1) ** k, 500, 0], "rotation_mrad": [90 * x, 90 * y, 0]}
        for k, (x, y) in signs.items()
    }
    model = {"format": "pouring_robot/model/1", "layout": "paper", "joint_placements": placements}
    (tmp_path / "far_off.yaml").write_text(yaml.safe_dump(model))
    changes = {"layout": None, "model": "far_off.yaml", "study": "one_at_a_time", "samples": None}
    changes["errors"] = [{"parameters": "leg1_s1.tx", "half_width_mm": 0.1}]
    config = write(tmp_path, poses={"grid": {}}, **changes)
    assert main(["sweep", str(config), "--out", str(tmp_path / "one"), "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["own_error_mm"] is None
    assert main(["sweep", str(config), "--out", str(tmp_path / "one"), "--resume"]) == 3
    assert "note: the robot of far_off.yaml closes at none of these poses" in capsys.readouterr().out


@pytest.mark.parametrize("study", ["one_at_a_time", "monte_carlo"])
def test_poses_at_which_a_robot_as_built_does_not_close_are_kept_with_their_status(study, tmp_path):
    """With further errors it closes at some of them, but from where it has moved nobody knows."""
    moved = {"right_drive": [60, 0, 0], "left_drive": [-60, 0, 0], "right_pivot": [0, -60, 0]}
    placements = {joint: {"translation_mm": place} for joint, place in moved.items()}
    robot = str(ROOT / "examples" / "robots" / "five_bar" / "robot.yaml")
    model = {"format": "pouring_robot/model/1", "robot": robot, "joint_placements": placements}
    (tmp_path / "wide.yaml").write_text(yaml.safe_dump(model))
    found = []
    for name, poses in ("all", "29,-52\n0,0\n41,-70\n"), ("one", "0,0\n"):
        (tmp_path / f"{name}.csv").write_text(f"left_deg,right_deg\n{poses}")
        errors = [{"parameters": ["left_drive.tx", "right_drive.ty", "right_pivot.ty"], "half_width_mm": 80.0}]
        told = {"layout": None, "model": "wide.yaml", "study": study, "poses": {"file": f"{name}.csv"}}
        told |= {"errors": errors, "accuracy_mm": 100.0, "samples": 16 if study == "monte_carlo" else None}
        outcome = sweep(write(tmp_path, **told), tmp_path / f"{study}_{name}")
        found.append((outcome, json.loads(outcome.save()[0].read_text())))
    (every, figures), (alone, expected) = found
    data = every.to_dataset()
    assert (data.status != 0).to_numpy().tolist() == [[True, False, True]] * data.status.shape[0]
    for name in ("displacement", "rotation", "gap_m", "gap_rad"):
        assert np.isnan(data[name].isel(pose=[0, 2])).all() and np.isfinite(data[name].isel(pose=1)).all()
    for name in ("largest_mm", "rms_mm", "quantiles_mm"):
        assert figures["summary"][name] == expected["summary"][name]
    assert [(p.name, p.weight) for p in every.ranking] == [(p.name, p.weight) for p in alone.ranking]


def test_an_error_with_which_no_robot_closes_matters_most_and_has_no_largest(make_plan, tmp_path):
    wide = {"parameters": "leg1_s1.tx", "half_width_mm": 1e9}
    errors = [{"parameters": "leg2_s1.t?", "half_width_mm": 0.1}, wide]
    outcome = report(run_sweep(make_plan(study="one_at_a_time", samples=None, errors=errors), tmp_path))
    first = outcome.ranking[0]
    assert first.name == "leg1_s1.tx" and first.figures["largest_mm"] is None and first.figures["failed"] == 8
    assert outcome.summary.figures()["largest_mm"] > 0.0 and "in the 24 of 32 cases that closed" in outcome.headline
    assert "nan" not in outcome.save()[1].read_text()


def test_the_command_prints_tables_and_writes_its_files(tmp_path, capsys):
    config = write(tmp_path, allocation=ALLOCATION)
    assert main(["sweep", str(config), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "40 robots at 8 poses: ladle_lip is off by" in out
    assert "the tolerances that matter most" in out and "loosest tolerances that keep 10 mm" in out
    assert (tmp_path / "out/sweep.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "out/ranking.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) > 30 and set(rows[0]) >= {"name", "part", "tolerance", "unit", "share_of_scatter"}
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    loosest = {row["parameter"]: row for row in summary["allocation"]["tolerances"]}
    assert summary["seed"] == 11 and {name: row["unit"] for name, row in loosest.items()} == {
        row["name"]: row["unit"] for row in rows
    }
    scaled = {row["name"]: loosest[row["name"]]["factor"] * float(row["tolerance"]) for row in rows}
    assert {name: row["tolerance_mm_or_mrad"] for name, row in loosest.items()} == pytest.approx(scaled)


@pytest.mark.parametrize(
    "changes",
    [
        {"study": "one_at_a_time", "samples": None},
        {"study": "one_at_a_time", "samples": None, "kind": "open_branch"},
        {"study": "sobol", "samples": 4, "errors": [{"parameters": "alpha_e1_*", "half_width_mrad": 1}]},
        {"kind": "open_branch", "errors": [{"parameters": "alpha_e1_*", "half_width_mrad": 1}]},
    ],
)
def test_every_study_speaks_json(tmp_path, capsys, changes):
    config = write(tmp_path, **changes)
    assert main(["sweep", str(config), "--out", str(tmp_path / "out"), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["ranking"] and len(figures["written"]) == 5


def test_distances_keep_their_quantiles():
    drawn = np.random.default_rng(2).lognormal(sigma=3.0, size=50_000) * 1e-4
    distances = Distances()
    for part in np.split(drawn, 10):
        distances.add(part)
    for share in (0.01, 0.5, 0.9973):
        assert distances.quantile(share) == pytest.approx(np.quantile(drawn, share, method="inverted_cdf"), rel=2e-3)
    assert np.isnan(Distances().quantile(0.5))


def test_the_script_runs_and_the_example_file_is_sound(tmp_path, capsys, monkeypatch):
    SweepPlan.load(ROOT / "examples" / "sweep.yaml")
    monkeypatch.setattr("sys.argv", ["error_sweep.py", "--out", str(tmp_path / "out")])
    runpy.run_path(str(ROOT / "scripts" / "error_sweep.py"), run_name="__main__")
    printed = capsys.readouterr().out
    assert printed.count("at most") == 10 and "sweep.png" in printed


@pytest.mark.parametrize(("share", "said"), [(1.0, "100.00%"), (26999 / 27000, "99.99%"), (0.99726, "99.73%")])
def test_nearly_all_are_not_all(share, said):
    assert share_text(share) == said
