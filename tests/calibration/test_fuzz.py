"""Damaged campaigns: ``calibrate`` never shows a traceback, prints one line, and writes all or nothing."""

import random
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from pouring_robot.cli import app
from pouring_robot.cli.app import main
from tests.campaign.test_fuzz import damages, spoil

pytestmark = pytest.mark.usefixtures("undrawn")
FUZZ = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
FILES = {"calibrated.yaml", "calibration.json", "loops.yaml", "pouring_robot.urdf", "report.html", "meshes"}


@pytest.fixture(scope="module")
def sound(tmp_path_factory, clean):
    """Return the bytes of a sound table and its YAML."""
    folder = tmp_path_factory.mktemp("sound")
    clean.campaign.subset(range(24)).save(folder / "c.csv")
    return (folder / "c.csv").read_bytes(), (folder / "c.yaml").read_bytes()


def run(arguments, capsys):
    """Run the command as the shell does; return exit code and error output."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    return code, capsys.readouterr().err


def check(table, metadata, capsys, *more):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "c.csv").write_bytes(table)
        (folder / "c.yaml").write_bytes(metadata)
        code, error = run(
            ["calibrate", folder / "c.csv", "--out", folder / "out", "--parameters", "drives", *more], capsys
        )
        left = {path.name for path in folder.iterdir()} - {"c.csv", "c.yaml"}
        if code == 0:
            assert left == {"out"}
            assert {path.name for path in (folder / "out").iterdir()} == FILES
            return 0
        assert code in {2, 3}
        assert error.count("\n") == 1, error
        assert "Traceback" not in error
        assert not left
        return code


def test_the_sound_files_pass(sound, capsys):
    assert check(*sound, capsys) == 0


@FUZZ
@given(changes=damages())
def test_damaged_table(sound, capsys, changes):
    check(spoil(sound[0], changes), sound[1], capsys)


@FUZZ
@given(changes=damages())
def test_damaged_metadata(sound, capsys, changes):
    check(sound[0], spoil(sound[1], changes), capsys)


@settings(FUZZ, max_examples=6)
@given(
    seed=st.integers(0, 10_000),
    value=st.sampled_from(["", "0", "-1e9", "1e-300", "nan", "550", "3.2", "x"]),
    share=st.sampled_from([0.02, 0.3, 1.0]),
)
def test_spoilt_columns(sound, capsys, seed, value, share):
    """Cells of one column, few or all, replaced: the table stays a table."""
    pick = random.Random(seed)
    rows = [line.split(",") for line in sound[0].decode().splitlines()]
    column = pick.randrange(len(rows[0]))
    for row in rows[1:]:
        if pick.random() < share:
            row[column] = value
    check("\n".join(",".join(row) for row in rows).encode(), sound[1], capsys)


@pytest.mark.parametrize(
    "metadata", [b"metrology: {sigma_position_mm: 1.0e-9, sigma_rotation_rad: 1.0e-12}\n", b"{}\n"]
)
@pytest.mark.parametrize("noise", ["0", "0.05"])
def test_absurd_noise(tmp_path, capsys, metadata, noise):
    table = tmp_path / "s.csv"
    made = ["campaign", "simulate", "--out", table, "--random", "40", "--noise-mm", noise, "--noise-mrad", noise]
    code, error = run([*made, "--seed", "2"], capsys)
    assert code == 0 or "noise" in error
    if code == 0:
        check(table.read_bytes(), metadata, capsys)


def test_the_help_names_every_option():
    result = CliRunner().invoke(app.app, ["calibrate", "--help"])
    assert result.exit_code == 0
    for option in ("--out", "--parameters", "--tolerances", "--hold-out", "--loss", "--keep-all", "--json", "--model"):
        assert option in result.output
