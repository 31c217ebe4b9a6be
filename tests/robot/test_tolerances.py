"""Tolerances: each parameter has its kind, files are checked, and priors are in SI."""

import numpy as np
import pytest

from pouring_robot.estimation.frames.outer import FRAME_STD, FRAMES
from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.local_parameters import placement_parameters
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.tolerances import Tolerances, kind_of
from tests.estimation.virtual import model_of
from tests.support import ROOT


def test_priors_are_in_metres_and_radians(drawing):
    tolerances, model = Tolerances.load(), model_of(drawing, "all")
    prior = model.prior_std(tolerances)
    np.testing.assert_array_equal(prior[:FRAMES], FRAME_STD)
    by_name = dict(zip(model.names, prior, strict=True))
    assert by_name["leg1_s1.tx"] == pytest.approx(1e-3 * tolerances.kinds.joint_centre.std)
    assert by_name["leg2_s4.rx"] == pytest.approx(1e-3 * tolerances.kinds.joint_axis.std)
    kinds = {kind_of(p, model.model.definition.inner_joints) for p in model.parameters}
    assert kinds == {"linear_drive_offset", "rotary_drive_offset", "joint_centre", "joint_axis", "inner_offset"}


def test_inner_joints_are_those_that_the_robot_names():
    """Four of the hexapod's legs have joints named like inner joints of the pouring robot."""
    robot = RobotDefinition.load(ROOT / "examples" / "robots" / "hexapod" / "robot.yaml")
    tolerances = Tolerances.load()
    std = tolerances.std([p for p in placement_parameters(["leg1_s2", "leg5_s2"]) if p.unit == "m"], robot)
    np.testing.assert_array_equal(std, 6 * [tolerances.kinds.joint_centre.to_si()])


def test_a_file_may_hold_some_kinds_only_and_use_their_former_names(tmp_path):
    shipped, path = Tolerances.load(), tmp_path / "t.yaml"
    for called in ("linear_drive_offset", "leg_drive_offset"):
        path.write_text(f"kinds: {{{called}: {{std: 7.0, unit: mm, source: tape}}}}\n")
        kinds = Tolerances.load(path).kinds
        assert kinds.linear_drive_offset.std == 7.0
        assert kinds.model_copy(update={"linear_drive_offset": shipped.kinds.linear_drive_offset}) == shipped.kinds
    path.write_text("kinds: {leg_drive_ofset: {std: 7.0, unit: mm, source: tape}}\n")
    with pytest.raises(DescriptionError, match=r"unknown key .kinds\.leg_drive_ofset"):
        Tolerances.load(path)
    said = "{std: 7.0, unit: mm, source: tape}"
    path.write_text(f"kinds: {{leg_drive_offset: {said}, linear_drive_offset: {said}}}\n")
    with pytest.raises(DescriptionError, match="leg_drive_offset"):
        Tolerances.load(path)


def test_a_users_own_file(tmp_path):
    text = Tolerances.load().model_dump()
    text["kinds"]["joint_centre"]["std"] = 0.25
    path = tmp_path / "t.yaml"
    import yaml

    path.write_text(yaml.safe_dump(text))
    assert Tolerances.load(path).kinds.joint_centre.to_si() == pytest.approx(0.25e-3)
    for key, value, words in (("std", -1.0, "std"), ("unit", "mrad", "must be mm"), ("colour", "red", "colour")):
        wrong = Tolerances.load().model_dump()
        wrong["kinds"]["joint_centre"][key] = value
        path.write_text(yaml.safe_dump(wrong))
        with pytest.raises(DescriptionError, match=words):
            Tolerances.load(path)
    with pytest.raises(DescriptionError):
        Tolerances.load(tmp_path / "none.yaml")
