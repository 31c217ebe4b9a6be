"""Bad sweep files and folders, through the command line: exit code 2, one line, nothing changed on disk."""

import os
import tempfile
from pathlib import Path

import pytest
import yaml

from pouring_robot.cli.app import main
from pouring_robot.sweeps import SweepConfig, SweepPlan, sweep
from tests.support import ACTUAL
from tests.sweeps.sweep_files import content, snapshot, write

NOBODY = 65534
LENGTHS = {"parameters": "a_e1_*", "half_width_mm": 0.1}


def errors(**entry):
    return {"errors": [LENGTHS, entry]}


BAD = {
    "unknown parameter": (
        errors(parameters="alpha_e1_57", half_width_mrad=1),
        "'alpha_e1_57'; did you mean 'alpha_e1_56'",
    ),
    "unknown pattern": (errors(parameters="beta_*", half_width_mrad=1), "names are like alpha_e1_56"),
    "negative tolerance": (errors(parameters="alpha_e1_56", half_width_mrad=-4), "half_width_mrad.*greater than 0"),
    "zero deviation": (errors(parameters="alpha_e1_56", distribution="normal", std_mrad=0), "std_mrad.*greater than 0"),
    "misspelt distribution": (
        errors(parameters="alpha_e1_56", distribution="unifrom", half_width_mrad=1),
        "did you mean 'uniform'",
    ),
    "misspelt key": (errors(parameters="alpha_e1_56", half_widht_mrad=1), "did you mean 'half_width_mrad'"),
    "size of another distribution": (
        errors(parameters="alpha_e1_56", distribution="normal", half_width_mrad=1),
        "does not belong to distribution 'normal'",
    ),
    "no limit": (errors(parameters="a_e2_*", distribution="truncated_normal", std_mm=1), "limit_mm is missing"),
    "no size": (errors(parameters="a_e2_*"), "no size is given"),
    "wrong unit": (errors(parameters="a_e2_*", half_width_mrad=1), "'a_e2_01' needs half_width_mm"),
    "a size for no length": (
        errors(parameters="alpha_e2_*", half_width_mm=1, half_width_mrad=1),
        "errors.1: half_width_mm fits none of its parameters, all angles; leave it out",
    ),
    "a size for no angle": (
        errors(parameters="a_e2_*", distribution="normal", std_mm=1, std_mrad=1),
        "errors.1: std_mrad fits none of its parameters, all lengths; leave it out",
    ),
    "given twice": (errors(parameters="a_e1_01", half_width_mm=1), "'a_e1_01' is given twice"),
    "not a number": (errors(parameters="a_e2_*", half_width_mm=float("nan")), "finite number"),
    "correlation above one": (errors(parameters="a_e2_*", half_width_mm=1, correlation=1.5), "less than or equal to 1"),
    "unknown study": ({"study": "monte_cralo"}, "monte_carlo"),
    "unknown layout": ({"layout": "papre"}, "unknown layout 'papre'"),
    "layout and model": ({"model": str(ACTUAL)}, "not both"),
    "missing model": ({"layout": None, "model": "nowhere.yaml"}, "nowhere.yaml"),
    "unknown frame": ({"frames": ["ladle_lipp"]}, "did you mean 'ladle_lip'"),
    "frame named twice": ({"frames": ["ladle_lip", "ladle_lip"]}, "a frame is given twice"),
    "frame elsewhere": ({"frames": ["leg1_foot"]}, "no frame 'leg1_foot'"),
    "a grid as a product": ({"poses": {"grid": {"x": 1000, "y": 1000, "z": 2}}}, "a grid of 2,000,000 poses is too"),
    "two kinds of poses": ({"poses": {"grid": {}, "random": {"count": 1}}}, "exactly one of grid, random and file"),
    "more poses than any memory holds": (
        {"poses": {"random": {"count": 2_000_000_000}}},
        "less than or equal to 1000000",
    ),
    "missing pose file": ({"poses": {"file": "nowhere.csv"}}, "nowhere.csv"),
    "upside-down box": (
        {"poses": {"grid": {"box": {"x_mm": [1, 0]}}}},
        "x_mm': a range starts with its lower end, unlike 1 to 0",
    ),
    "no samples": ({"samples": None}, "needs samples"),
    "more robots than a disk holds": (
        {"samples": 10**13},
        r"10000000000000 robots at 8 poses need 1\.\d\de\+7 GB, but the disk of .*out has .* GB; use fewer samples",
    ),
    "beyond all numbers": ({"samples": 10**400}, "use fewer samples or poses"),
    "sobol beyond all points": (
        {"study": "sobol", "samples": 2**50, "errors": [LENGTHS]},
        "use fewer samples",
    ),
    "samples one at a time": ({"study": "one_at_a_time"}, "takes no samples"),
    "sobol without power of two": ({"study": "sobol", "errors": [LENGTHS]}, "power of two"),
    "sobol of one": ({"study": "sobol", "errors": [LENGTHS], "samples": 1}, "power of two as samples, 2 or more"),
    "sobol with correlation": ({"study": "sobol", "samples": 64}, "independent errors"),
    "branch of many chains": ({"kind": "open_branch"}, "one chain alone"),
    "branch of a robot as built": (
        {"kind": "open_branch", "layout": None, "model": str(ACTUAL)},
        "a study of the drawing; give layout instead of model",
    ),
    "errors beside tolerances": ({"tolerances": str(ACTUAL)}, "leave one of the two out"),
    "allocation of a branch": ({"kind": "open_branch", "allocation": {}}, "needs kind 'closed_chain'"),
    "correlated apart": ({"allocation": {"by": "parameter"}}, "use 'by: part'"),
    "other format": ({"format": "pouring_robot/model/1"}, "pouring_robot/sweep/1"),
}


def run(*arguments, capsys):
    code = main(["sweep", *map(str, arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def assert_refused(code, out, err, pattern):
    import re

    assert code == 2 and out == "" and err.count("\n") == 1 and re.search(pattern, err), err


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_in_one_line(tmp_path, capsys, case):
    changes, pattern = BAD[case]
    config = write(tmp_path, **changes)
    before = snapshot(tmp_path)
    assert_refused(*run(config, "--out", tmp_path / "out", capsys=capsys), pattern)
    assert snapshot(tmp_path) == before and not (tmp_path / "out").exists()


def test_the_line_of_the_entry_is_named(tmp_path, capsys):
    config = write(tmp_path, **errors(parameters="alpha_e1_65", half_width_mrad=1))
    line = next(n for n, text in enumerate(config.read_text().splitlines(), start=1) if "alpha_e1_65" in text)
    _, _, err = run(config, "--out", tmp_path / "out", capsys=capsys)
    assert f"sweep.yaml: line {line}: errors.1:" in err


def test_a_pose_out_of_reach_has_no_solution(tmp_path, capsys):
    config = write(tmp_path, poses={"grid": {"box": {"z_mm": [-3000, -3000]}}})
    code, _, err = run(config, "--out", tmp_path / "out", capsys=capsys)
    assert code == 3 and "out of reach" in err and not (tmp_path / "out").exists()
    (tmp_path / "poses.csv").write_text("x_mm,y_mm,z_mm,tilt_deg\n-100,20,-600,17\n0,0,0,0\n")
    config = write(tmp_path, poses={"file": "poses.csv"})
    code, _, err = run(config, "--out", tmp_path / "out", capsys=capsys)
    assert code == 3 and "poses.csv: line 3: the pose is out of reach" in err


def test_bad_options(tmp_path, capsys):
    config, out = write(tmp_path), tmp_path / "out"
    assert_refused(*run(config, "--out", out, "--workers", "1", "--scheduler", "x", capsys=capsys), "not both")
    assert_refused(*run(config, "--out", out, "--workers", "-1", capsys=capsys), "workers")
    assert_refused(*run(config, capsys=capsys), "--out")
    assert_refused(*run(tmp_path / "none.yaml", "--out", out, capsys=capsys), "none.yaml")
    assert not out.exists()


def test_no_scheduler_there(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pouring_robot.sweeps.runner._CONNECT_SECONDS", 1)
    for address, pattern in (("tcp://127.0.0.1:9", "no Dask scheduler answers"), ("nonsense://x", "nonsense")):
        out = tmp_path / "out"
        assert_refused(*run(write(tmp_path), "--out", out, "--scheduler", address, capsys=capsys), pattern)
        assert not out.exists()


def test_the_folder_is_a_file_or_cannot_be_made(tmp_path, capsys):
    config = write(tmp_path)
    assert_refused(*run(config, "--out", config, capsys=capsys), "sweep.yaml: cannot be written to")
    assert_refused(*run(config, "--out", config / "below", capsys=capsys), "cannot be written to")
    assert yaml.safe_load(config.read_text()) == content()


def test_a_folder_without_permission(capsys):
    """Root may write everywhere: where the tests run as root, the command runs as nobody."""
    user = os.geteuid()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config, locked = write(folder), folder / "locked"
        locked.mkdir()
        for path, mode in ((folder, 0o755), (config, 0o644), (locked, 0o555)):
            path.chmod(mode)
        run(config, "--out", config, capsys=capsys)  # nobody may not be allowed to import what is not yet imported
        os.seteuid(user or NOBODY)
        try:
            answer = run(config, "--out", locked / "out", capsys=capsys)
        finally:
            os.seteuid(user)
        assert_refused(*answer, "Permission denied")


def test_poses_from_a_file_beside_the_sweep_file(tmp_path):
    (tmp_path / "poses.csv").write_text("x_mm,y_mm,z_mm,tilt_deg\n-100,20,-600,10\n-120,0,-500,0\n")
    plan = SweepPlan.load(write(tmp_path, poses={"file": "poses.csv"}))
    assert plan.poses.poses[:, 1].tolist() == [0.020, 0.0]


def test_relative_paths_mean_the_folder_in_which_they_were_said(tmp_path, monkeypatch):
    (elsewhere := tmp_path / "elsewhere").mkdir()
    (tmp_path / "poses.csv").write_text("x_mm,y_mm,z_mm,tilt_deg\n-100,20,-600,10\n")
    monkeypatch.chdir(tmp_path)
    config = SweepConfig.load(write(tmp_path, poses={"file": "poses.csv"}).name)
    found = sweep(config, "out")
    monkeypatch.chdir(elsewhere)
    assert SweepPlan(config).content_hash == found.store.plan.content_hash
    assert {path.parent for path in found.save()} == {tmp_path / "out"} and not [*elsewhere.iterdir()]
    assert found.to_dataset().displacement.notnull().all()


def test_a_grid_reaches_the_ends_of_the_workspace_and_a_box_narrows_it(make_plan):
    box = {"x_mm": [-120, -80], "tilt_deg": [0, 10]}
    plan = make_plan(poses={"grid": {"x": 2, "y": 3, "tilt": 2, "box": box}})
    x, y, z, tilt = plan.poses.poses.T
    assert len(plan.poses) == 12 and sorted(set(x)) == pytest.approx([-0.12, -0.08])
    assert sorted(set(y)) == pytest.approx([-0.05, 0.0, 0.05]) and sorted(set(z)) == pytest.approx([-0.625])
    assert sorted(set(tilt)) == pytest.approx([0.0, 0.17453292519943295])


def test_random_poses_lie_in_the_workspace_and_follow_their_seed(make_plan):
    first, again, other = (make_plan(poses={"random": {"count": 50, "seed": s}}).poses.poses for s in (1, 1, 2))
    assert (first == again).all() and not (first == other).any()
    assert (first.min(axis=0) >= [-0.150, -0.050, -0.825, -0.4884]).all()
    assert (first.max(axis=0) <= [-0.050, 0.050, -0.425, 1.08155]).all()
