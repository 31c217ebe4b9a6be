"""Joints that follow another one or err once per turn, simulated by rotations independent of the library."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pouring_robot import Campaign, RobotModel, diagnose
from pouring_robot.checks.check import check_campaign
from pouring_robot.checks.flags import FlagCode
from pouring_robot.diagnosis import DiagnosisOptions
from pouring_robot.io.units import MRAD
from tests.examples import arm
from tests.examples.machines import MACHINES
from tests.support import ROOT

ROBOT = ROOT / "examples" / "robots" / "arm" / "robot.yaml"
SIGMA_M, SIGMA_RAD, SHARE = 3e-5, 3e-5, 1e-3


def measured(folder, joint, error):
    """Return a campaign of 120 poses in which the joints have an error of the drives (n, 6), in rad."""
    random = np.random.default_rng(4)
    drives = MACHINES["arm"].targets(random, 120)
    turned = drives.copy()
    turned[:, joint] += error(drives)
    position, rotation = arm.forward(turned)
    position = position + SIGMA_M * random.normal(size=position.shape)
    seen = Rotation.from_matrix(rotation) * Rotation.from_rotvec(SIGMA_RAD * random.normal(size=position.shape))
    table = {f"q{k}_rad": values for k, values in enumerate(drives.T, 1)}
    table |= {f"{axis}_m": values for axis, values in zip("xyz", position.T, strict=True)}
    table |= {f"r{axis}_rad": values for axis, values in zip("xyz", seen.as_rotvec().T, strict=True)}
    pd.DataFrame(table).to_csv(folder / "campaign.csv", index=False)
    noise = f"{{sigma_position_m: {SIGMA_M}, sigma_rotation_rad: {SIGMA_RAD}}}"
    (folder / "campaign.yaml").write_text(f"metrology: {noise}\n", encoding="utf-8")
    return Campaign.read(folder / "campaign.csv", RobotModel.for_robot(ROBOT).definition)


@pytest.fixture(scope="module", params=[(5, 4), (2, 1)], ids=["wrist", "forearm"])
def coupled(request, tmp_path_factory):
    """The joints, by their numbers from 1, and the campaign."""
    follower, leader = request.param
    made = measured(tmp_path_factory.mktemp("arm"), follower, lambda drives: SHARE * drives[:, leader])
    return follower + 1, leader + 1, made


def test_a_joint_coupled_to_another_is_named_with_its_ratio(coupled):
    """It was a wrong gear of the other joint and a joint out of place, 99 % sure, or a noise above the stated one."""
    follower, leader, campaign = coupled
    model = RobotModel.for_robot(ROBOT)
    found = diagnose(campaign, model, DiagnosisOptions(next_count=0))
    (effect,) = found.effects
    assert effect.cause.effect == "drive_coupling"
    (said,) = effect.parameters
    assert (said.parameter.name, said.parameter.unit) == (f"q{follower}_by_q{leader}", "mrad/rad")
    assert said.value == pytest.approx(SHARE / MRAD, abs=3.0 * said.std)
    assert said.std < 0.05
    flags = check_campaign(campaign, model.definition.drawing())
    assert FlagCode.NOISE_TOO_SMALL not in [flag.code for flag in flags]


def test_without_that_cause_the_condition_it_depends_on_is_reported(coupled):
    follower, leader, campaign = coupled
    options = DiagnosisOptions(next_count=0, exclude=("drive_coupling",))
    found = diagnose(campaign, RobotModel.for_robot(ROBOT), options)
    told = [line.sentence for line in found.where.findings if f"value of q{leader}" in line.sentence]
    assert told[0].startswith(f"Depends on the value of q{leader}: q{follower} by ")
    if leader == 5:
        assert found.verdict == "unknown"
        assert {part.structure.process.name for part in found.remainder} == {"drives by other drives"}


@pytest.mark.parametrize("joint", [2, 4])
def test_an_eccentric_disc_is_named_alone_with_its_size_and_angle(tmp_path, joint):
    """An encoder's disc errs by e/r sin(q + φ). It was a wrong gear or zero with waves of all joints, 99 % sure."""
    sine, cosine = 0.4, -0.3  # mrad
    campaign = measured(
        tmp_path,
        joint,
        lambda drives: MRAD * (sine * np.sin(drives[:, joint]) + cosine * np.cos(drives[:, joint])),
    )
    found = diagnose(campaign, RobotModel.for_robot(ROBOT), DiagnosisOptions(next_count=0))
    (effect,) = found.effects
    assert (effect.cause.effect, effect.cause.form) == ("joint_periodic", f"q{joint + 1}_once")
    for said, truth in zip(effect.parameters, (sine, cosine, 0.0, 0.0), strict=True):
        assert said.value == pytest.approx(truth, abs=3.0 * said.std)
    (told,) = found.in_words(effect)
    assert told.startswith(f"q{joint + 1}: 0.3")


@pytest.mark.parametrize("joint", [1, 2])
def test_an_eccentric_disc_that_is_oval_as_well_is_named_alone(tmp_path, joint):
    """Over less than a turn the sum of both orders looked like the first order with a wrong gear, 99 % sure."""
    campaign = measured(
        tmp_path,
        joint,
        lambda drives: 0.5 * MRAD * (np.sin(drives[:, joint] + 1.0) + 0.2 * np.sin(2.0 * drives[:, joint] - 1.0)),
    )
    found = diagnose(campaign, RobotModel.for_robot(ROBOT), DiagnosisOptions(next_count=0))
    assert [(e.cause.effect, e.cause.form) for e in found.effects] == [("joint_periodic", f"q{joint + 1}_once")]
