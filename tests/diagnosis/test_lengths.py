"""One or two wrong lengths of an arm, simulated by a chain of rotations independent of the library."""

import numpy as np
import pytest

from pouring_robot.diagnosis.diagnose import DiagnosisOptions, diagnose
from pouring_robot.diagnosis.report.notes import note_lines
from tests.examples.campaigns import write
from tests.examples.effects import EFFECTS, LARGEST, Hidden
from tests.examples.machines import MACHINES
from tests.support import ROOT

ROBOT = ROOT / "examples" / "robots" / "arm" / "robot.yaml"
UPPER, FORE = (2, 2), (3, 0)  # joint and axis of the lengths


@pytest.mark.parametrize("wrong", [{UPPER: 1.0}, {UPPER: 1.2, FORE: 1.0}], ids=["one", "two"])
@pytest.mark.parametrize("seed", [1, 2])
def test_wrong_lengths_are_named_as_placements_and_not_as_unknown_or_tracker_scale(tmp_path, monkeypatch, wrong, seed):
    """Two lengths off in proportion are nearly what a tracker's scale does to all of them."""
    origin = np.zeros((6, 3))
    for place, size in wrong.items():
        origin[place] = size
    monkeypatch.setitem(EFFECTS, "lengths", lambda *_: Hidden(geometry={"origin": origin}, told={"m": 1.0}))
    monkeypatch.setitem(LARGEST, "lengths", 1e-2)
    truth = write(tmp_path, MACHINES["arm"], seed, "lengths", ratio=7.0)
    found = diagnose(tmp_path / "campaign.csv", ROBOT, DiagnosisOptions(next_count=0))
    assert found.verdict == "named"
    assert [cause.effect for cause in found.judgement.causes] == ["joint_placement"]
    told = found.to_frame().set_index("parameter")
    assert {*told.index} == {f"joint{joint + 1}.t{'xyz'[axis]}" for joint, axis in wrong}
    for (joint, axis), size in wrong.items():
        name, true_mm = f"joint{joint + 1}.t{'xyz'[axis]}", 1e3 * size * truth["effects"][0]["size"]
        assert told.value[name] == pytest.approx(true_mm, abs=4.0 * told["std"][name])
    # Along the forearm, about which joint 4 turns, an error of the next joint's placement is the same.
    alike = "joint_placement: in these poses joint5.tx would have the same effect as joint4.tx"
    assert (alike in note_lines(found)) == (FORE in wrong)
