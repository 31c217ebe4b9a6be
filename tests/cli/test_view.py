"""What ``view`` shows: a bench, a path or a campaign; how it is served is tested with the viewer."""

import numpy as np
import pandas as pd
import pytest

from pouring_robot.cli.app import main
from pouring_robot.robot.view.bench import RobotBench
from pouring_robot.thermal.scene import PouringBench
from tests.robot.test_robot import ROBOTS
from tests.support import ROOT

ACTUAL, POSES = (str(ROOT / "examples" / name) for name in ("actual.yaml", "poses.csv"))


@pytest.fixture(name="shown")
def _shown(monkeypatch):
    """Collect scene and bench in place of serving them."""
    found = []

    class Served:
        url = "http://127.0.0.1:1/"

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def wait(self):
            return True

    monkeypatch.setattr(
        "pouring_robot.viewer.serve", lambda scene, port, bench: found.append((scene, bench)) or Served()
    )
    monkeypatch.setattr("signal.signal", lambda *_: None)
    return found


def test_a_robot_gets_a_bench(shown, capsys):
    assert main(["view", "--no-browser", "--model", ACTUAL, "--at-mm", "-90", "10", "-600", "--tilt-deg", "5"]) == 0
    assert "this machine only" in capsys.readouterr().out
    assert main(["view", "--no-browser", "--robot", str(ROBOTS / "delta" / "robot.yaml"), "--exaggerate", "7"]) == 0
    (scene, bench), (other, plain) = shown
    assert isinstance(bench, PouringBench) and scene is bench.scene
    values = {s["id"]: s["value"] for group in bench.sliders()["groups"] for s in group["sliders"]}
    assert [values[name] for name in ("x_mm", "y_mm", "z_mm", "tilt_deg")] == pytest.approx([-90, 10, -600, 5])
    assert type(plain) is RobotBench and other.exaggeration == 7.0


def test_a_robot_that_nobody_drew_is_shown_with_a_word(shown, capsys):
    for path, said in (("machines/ur10", True), ("robots/delta", False)):
        assert main(["view", "--no-browser", "--robot", str(ROOT / "examples" / path / "robot.yaml")]) == 0
        assert (
            "lines between its joints, as its URDF has no visuals" in " ".join(capsys.readouterr().out.split())
        ) is said


def test_a_path_and_a_campaign_play(shown, tmp_path, capsys):
    assert main(["view", "--no-browser", "--model", ACTUAL, "--path", POSES]) == 0
    campaign = str(tmp_path / "measured.csv")
    assert main(["campaign", "simulate", "--random", "20", "--seed", "1", "--model", ACTUAL, "--out", campaign]) == 0
    assert main(["view", "--no-browser", "--model", ACTUAL, "--campaign", campaign]) == 0
    (path, no_bench), (rows, neither) = shown
    assert no_bench is neither is None
    assert len(path.steps) == 5 and path.axis == "pose"
    assert len(rows.steps) == 20 and [robot.choice for robot in rows.robots] == [False, True, True, False]
    drawing, given = (curve.values.mean() for curve in rows.curves)
    assert given < 0.5 * drawing  # it was measured of this very model
    unseen = pd.read_csv(campaign)
    unseen.loc[:, unseen.columns.str.match("[xyz]_|r[xyz]_")] = np.nan
    unseen.to_csv(campaign, index=False)
    capsys.readouterr()
    assert main(["view", "--no-browser", "--campaign", campaign]) == 2
    assert "no row has a measured position" in capsys.readouterr().err
    assert main(["view", "--no-browser", "--campaign", campaign, "--exaggerate", "5"]) == 2
    assert "--exaggerate is for a robot or a path" in capsys.readouterr().err
