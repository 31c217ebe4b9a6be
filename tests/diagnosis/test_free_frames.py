"""Which directions of the two frames a campaign leaves free: those that it tells, not those that it hardly sees."""

import numpy as np
import pytest

from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.diagnosis.rows import told_directions
from pouring_robot.estimation.frames.outer import FRAME_STD, FRAMES
from pouring_robot.inference.problem import Nuisance
from tests.examples.campaigns import write
from tests.examples.machines import MACHINES
from tests.support import ROOT

ROWS = 30


def columns_telling(least):
    """Return columns of frames that are told by singular values of 1e5 but one, and what that one adds, of length 1."""
    rng = np.random.default_rng(1)
    axes, _ = np.linalg.qr(rng.normal(size=(6 * ROWS, FRAMES)))
    directions, _ = np.linalg.qr(rng.normal(size=(FRAMES, FRAMES)))
    told = np.append(np.full(FRAMES - 1, 1e5), least)
    return (axes * told) @ directions.T, axes[:, -1]


def free(columns):
    return Nuisance.of(columns @ told_directions(columns))


@pytest.mark.parametrize(("least", "told"), [(0.5 / FRAME_STD, False), (2.0 / FRAME_STD, True), (0.0, False)])
def test_frames_explain_only_along_what_the_rows_tell_of_them(least, told):
    columns, course = columns_telling(least)
    left = free(columns).cleared(8.0 * course)
    assert np.linalg.norm(left) == pytest.approx(0.0 if told else 8.0, abs=1e-6)


def test_what_is_told_is_taken_out_whole():
    columns, course = columns_telling(0.5 / FRAME_STD)
    told = columns @ np.random.default_rng(2).normal(size=FRAMES)
    left = free(columns).cleared(told)
    assert np.linalg.norm(left - course * (course @ told)) < 1e-9 * np.linalg.norm(told)


def test_what_only_a_moving_base_tells_of_the_target_stays_as_it_was(tmp_path):
    """A delta only shifts: tracker and target trade places; where its base turns, rows would tell the target's."""
    write(tmp_path, MACHINES["delta"], 2, "session_offset")
    found = diagnose(tmp_path / "campaign.csv", ROOT / "examples" / "robots" / "delta" / "robot.yaml")
    assert "session_offset" in {name for e in found.firm for name in (e.cause.effect, *e.cause.alternatives)}
    moved = found.after.frames.T_end_target.translation - found.before.frames.T_end_target.translation
    assert np.linalg.norm(moved) < 0.01
    assert found.held_out.position("after") < 1.3 * found.held_out.position("floor")
