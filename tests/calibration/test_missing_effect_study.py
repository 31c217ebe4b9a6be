"""The study of intervals under a missing effect: a few campaigns, along a path, of an arm whose zeros drift."""

from scripts.studies import missing_effect
from tests.support import ROOT


def test_intervals_hold_the_results_of_other_campaigns(monkeypatch, capsys):
    """Those of a noise as large as the residual do not; the full study is scripts/studies/missing_effect.py."""
    monkeypatch.setattr(missing_effect, "_EFFECTS", {"time": missing_effect._by_time})
    robot = ROOT / "examples" / "robots" / "arm" / "robot.yaml"
    assert missing_effect.main(["--robot", str(robot), "--campaigns", "12", "--rows", "80"]) == 0
    drawn, path = (line.split() for line in capsys.readouterr().out.splitlines()[1:])
    assert drawn[:2] == ["time", "drawn"] and path[:2] == ["time", "path"]
    assert float(path[3]) < 70.0
    assert float(path[5]) > 85.0
    assert float(drawn[3]) < float(drawn[5])
