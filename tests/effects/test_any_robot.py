"""The library of robots that declare no causes: what it holds, and columns that are derivatives of the closure."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.effects import all_effects
from pouring_robot.effects.base import checked_forms
from pouring_robot.estimation.noise_level import NoiseLevel
from pouring_robot.robot.model import RobotModel
from tests.effects.test_base import difference
from tests.examples.campaigns import write
from tests.examples.machines import MACHINES
from tests.support import ROOT

NOISE = NoiseLevel(5e-5, 6e-5, "stated", "stated")
ROWS = 24
EVERY = ("joint_placement", "link_thermal_expansion", "base_drift", "metrology_scale", "session_offset")
SLIDING = ("drive_zero_offset", "drive_scale", "drive_periodic", "drive_backlash", "drive_compliance")
TURNING = ("drive_zero_offset", "joint_periodic", "drive_backlash", "drive_compliance")
IDS = {
    "arm": TURNING + EVERY,
    "delta": TURNING + EVERY,
    "five_bar": TURNING + EVERY,
    "hexapod": SLIDING + EVERY,
}


@pytest.fixture(scope="module", params=sorted(MACHINES))
def rows(request, tmp_path_factory):
    """Some rows of an example robot in two sessions, measured by itself, so that nothing is left over."""
    folder = tmp_path_factory.mktemp(request.param)
    write(folder, MACHINES[request.param], seed=3, effect="session_offset", ratio=2.0)
    model = RobotModel.for_robot(ROOT / "examples" / "robots" / request.param / "robot.yaml")
    campaign = Campaign.read(folder / "campaign.csv", model.definition)
    chosen = np.linspace(0, len(campaign) - 1, ROWS).astype(int)
    rows = CampaignRows(campaign.subset(chosen), model, NOISE)
    seen = rows.predicted(rows.unchanged(), rows.frames)
    turn = np.array([pin.log3(rotation) for rotation in seen.rotation])
    itself = replace(rows.campaign, position_m=seen.position_m, rotation_vector_rad=turn)
    again = CampaignRows(itself, model, NOISE)
    again.frames = rows.frames
    return again


def test_ids_say_what_it_is_and_of_several_groups_which(rows):
    robot = rows.conditions.robot
    found = tuple(all_effects(robot))
    assert tuple(dict.fromkeys(name.partition(".")[0] for name in found)) == IDS[robot.name]
    groups = {name.partition(".")[2] for name in found} - {""}
    assert groups == (set(robot.groups) if len(robot.groups) > 1 else set())


def test_all_but_forces_without_a_stated_load_can_be_tested(rows):
    """The campaigns hold every condition; only tare and centre of mass of a tool are not stated where a payload is."""
    given = rows.conditions
    lacking = {effect.id.partition(".")[0] for effect in all_effects(given.robot).values() if effect.missing(given)}
    assert lacking <= {"drive_compliance"}


def test_columns_are_derivatives_of_the_exact_closure(rows, rng):
    """Of every form one parameter, drawn, and its first."""
    linear = rows.linearise(rows.unchanged(), rows.frames)
    given = rows.conditions
    for effect in all_effects(given.robot).values():
        if effect.missing(given):
            continue
        form = checked_forms(effect, given, rows.channels)[0]
        for place in {0, int(rng.integers(len(form.parameters)))}:
            parameter = form.parameters[place]
            if not any(np.abs(change).max() > 0.0 for change in parameter.changes.values()):
                continue  # nothing of it is there in these rows
            found = np.zeros((len(rows), 6))
            found[linear.row, linear.component] = rows.column(parameter, linear)
            expected = parameter.prior_std * difference(rows, rows.frames, parameter)
            size = max(1.0, np.abs(expected).max())
            assert np.abs(found - expected).max() <= 1e-5 * size, (effect.id, parameter.name)


def test_orders_of_a_joint_are_said_together():
    """A closed form: amplitudes 3 and 4 at order 2 make 5, and 5 / √2 rms."""
    robot = RobotModel.for_robot(ROOT / "examples" / "robots" / "arm" / "robot.yaml").definition
    effect = all_effects(robot)["joint_periodic"]
    first = robot.drives[0].symbol
    said = effect.in_words({f"{first}_sine_2": 3.0, f"{first}_cosine_2": -4.0})
    assert len(said) == len(robot.drives)
    assert "3.536 mrad rms" in said[0]
    assert said[0].endswith("2 (5.000)")
    assert all("0.000 mrad rms" in line for line in said[1:])
