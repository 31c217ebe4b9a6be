"""A calibration as a result for the user: verdict, one line at the prompt, its parameters as a table, its files."""

import pytest

from pouring_robot.exceptions import OutputError


def test_verdict_line_and_table(found, unchanged):
    assert found.verdict == "accepted"
    assert unchanged.verdict == "unchanged"
    assert len(unchanged.to_frame()) == 0
    assert repr(found) == f"<Calibration: {found.headline}>"
    assert "Held-out error" in found.headline
    frame = found.to_frame()
    assert len(frame) == sum(len(group.parameters) for group in found.selection.groups)
    assert (frame.low95 <= frame.value).all()
    assert found.headline in found._repr_html_()


def test_saved_files(found, tmp_path, undrawn):
    names = {path.name for path in found.save(tmp_path / "out")}
    assert {"calibrated.yaml", "calibration.json", "report.html", "loops.yaml"} <= names
    with pytest.raises(OutputError, match="exists already"):
        found.save(tmp_path / "out")
    assert {path.name for path in found.save(tmp_path / "out", overwrite=True)} == names
