"""What a command imports: nothing that it does not need, because imports take half of its time."""

import subprocess
import sys

from pouring_robot.io.cache import CACHE_VARIABLE
from tests.support import ACTUAL

HEAVY = ("dask", "matplotlib", "numba", "pandas", "scipy", "sklearn", "statsmodels", "trimesh", "xacro", "xarray")
POSE = ["pose", "--at-mm", "-100", "20", "-600", "--tilt-deg", "17", "--model", str(ACTUAL)]


def loaded_after(code):
    """Return the names of the libraries a fresh process has loaded after some code."""
    code += "\nimport sys; print('loaded:', *{name.partition('.')[0] for name in sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.rpartition("loaded:")[2].split())


def test_importing_the_package_loads_no_library():
    assert not loaded_after("import pouring_robot").intersection((*HEAVY, "numpy", "pinocchio", "pydantic", "typer"))


def test_a_pose_loads_no_heavy_library(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    run = f"from pouring_robot.cli.app import main\nassert main({POSE}) == 0\n"
    assert "xacro" in loaded_after(run)  # once a machine
    assert not loaded_after(run).intersection(HEAVY)


def test_a_mistyped_file_is_told_before_anything_is_loaded():
    commands = [
        *("calibrate no.csv --out x", "campaign check no.csv", "campaign simulate --plan no.csv --out x", "view"),
        *("compensate no.csv", "diagnose no.csv --out x", "effects", "export --out x", "path no.csv", "pose", "robots"),
        *("campaign plan --out x", "regress no.csv", "robot init no.urdf", "sensitivity", "sweep no.yaml --out x"),
        "thermal --history no.csv",
    ]
    code = "from pouring_robot.cli.app import main\n"
    for command in commands:
        given = command.split() if "no." in command else [*command.split(), "--robot", "no.yaml"]
        code += f"assert main({given}) == 2\n"
    assert not loaded_after(code).intersection((*HEAVY, "numpy", "pinocchio"))


def test_every_name_of_the_library_is_there():
    code = "import pouring_robot, importlib\nassert len(pouring_robot.__all__) > 20\n"
    code += "for room in ('', '.batch', '.mechanism', '.robot'):\n"
    code += "    module = importlib.import_module('pouring_robot' + room)\n"
    code += "    assert all(getattr(module, name) is not None for name in module.__all__)"
    assert "pinocchio" in loaded_after(code)
