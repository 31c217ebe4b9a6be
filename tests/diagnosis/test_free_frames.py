"""Which directions of the two frames are free in a campaign: those that it determines, not those it hardly shows."""

import numpy as np
import pandas
import pytest
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.diagnosis.rows import observable_directions
from pouring_robot.estimation.frames.outer import FRAME_STD, FRAMES
from pouring_robot.inference.problem import Nuisance
from tests.examples.campaigns import write
from tests.examples.machines import MACHINES
from tests.support import ROOT

ROWS = 30


def columns_telling(least):
    """Return frame columns with singular values of 1e5 but for the least, and the unit vector of that one."""
    rng = np.random.default_rng(1)
    axes, _ = np.linalg.qr(rng.normal(size=(6 * ROWS, FRAMES)))
    directions, _ = np.linalg.qr(rng.normal(size=(FRAMES, FRAMES)))
    told = np.append(np.full(FRAMES - 1, 1e5), least)
    return (axes * told) @ directions.T, axes[:, -1]


def free(columns):
    return Nuisance.of(columns @ observable_directions(columns))


@pytest.mark.parametrize(("least", "told"), [(0.5 / FRAME_STD, False), (2.0 / FRAME_STD, True), (0.0, False)])
def test_frames_explain_only_along_directions_that_the_rows_determine(least, told):
    columns, course = columns_telling(least)
    left = free(columns).cleared(8.0 * course)
    assert np.linalg.norm(left) == pytest.approx(0.0 if told else 8.0, abs=1e-6)


def test_determined_directions_are_projected_out_whole():
    columns, course = columns_telling(0.5 / FRAME_STD)
    told = columns @ np.random.default_rng(2).normal(size=FRAMES)
    left = free(columns).cleared(told)
    assert np.linalg.norm(left - course * (course @ told)) < 1e-9 * np.linalg.norm(told)


def test_the_target_stays_where_only_a_moving_base_would_determine_it(tmp_path):
    """A delta only translates, so tracker and target are confounded; a rotating base would show where the target is."""
    write(tmp_path, MACHINES["delta"], 2, "session_offset")
    found = diagnose(tmp_path / "campaign.csv", ROOT / "examples" / "robots" / "delta" / "robot.yaml")
    assert "session_offset" in {name for e in found.firm for name in (e.cause.effect, *e.cause.alternatives)}
    moved = found.after.frames.T_end_target.translation - found.before.frames.T_end_target.translation
    assert np.linalg.norm(moved) < 0.01
    assert found.held_out.position("after") < 1.3 * found.held_out.position("floor")


TOP_M = np.array([[-0.34, 0.374, 0.0], [-0.34, -0.374, 0.0], [0.34, 0.374, 0.0], [0.34, -0.374, 0.0]])
BELOW_M = np.array([[-0.1825, 0.33, 0.0], [-0.1825, -0.33, 0.0], [0.1825, 0.33, 0.0], [0.1825, -0.33, 0.0]])
SIDE_M, TILTS, SINKS = 0.15, 0.6e-3, 0.4e-3


def test_sinking_of_a_rotating_base_is_known_as_well_as_the_position_of_the_target():
    """A base that rolls by w while it sinks by z moves a target that sits d to the side by z + w d.

    The platform tilts about y only, so no row shows d: closed form, with the drawing of docs/mechanism.md.
    """
    rng, rows = np.random.default_rng(100), 120
    time_s = np.linspace(0.0, 14400.0, rows)
    table = []
    for passed in time_s / 14400.0 - 0.5:
        *place, tilt = rng.uniform([-0.15, -0.05, -0.825, -0.4], [-0.05, 0.05, -0.425, 1.0])
        turned = Rotation.from_euler("y", tilt)
        legs = place + turned.apply(BELOW_M) - TOP_M
        lengths = np.linalg.norm(legs, axis=1)[:3]
        theta46 = tilt - np.arctan2(-legs[3, 0], -legs[3, 2])
        base = Rotation.from_rotvec([TILTS * passed, 0.0, 0.0])
        seen = base.apply(place + turned.apply([0.1, SIDE_M, -0.05])) + np.array([0.0, 0.0, SINKS * passed])
        attitude = (base * turned * Rotation.from_rotvec(rng.normal(0.0, 3e-5, 3))).as_rotvec()
        table.append([*(1e3 * lengths), theta46, *(1e3 * (seen + rng.normal(0.0, 3e-5, 3))), *attitude])
    columns = ["q1_mm", "q2_mm", "q3_mm", "q4_rad", "x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad"]
    noise = {"metrology": {"sigma_position_mm": 0.03, "sigma_rotation_rad": 3e-5}}
    found = diagnose(Campaign.from_frame(pandas.DataFrame(table, columns=columns).assign(time_s=time_s), noise))
    (drift,) = found.effects
    known = {one.parameter.name: one for one in drift.parameters}
    assert known["rx"].value == pytest.approx(1e3 * TILTS, abs=0.04)
    assert known["rx"].std < 0.02
    # Undetermined positions are known to 0.1 m, shared by tracker and target.
    assert abs(known["tz"].value - 1e3 * SINKS) < 3.0 * known["tz"].std
    assert known["tz"].std == pytest.approx(np.hypot(0.011, 0.6 * 100.0 / 2**0.5 * 1e-3), rel=0.2)
