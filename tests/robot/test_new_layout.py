"""A user's own machine: default answers give the paper's robot, and the checks find what is known by hand."""

import dataclasses
import math

import numpy as np
import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.pouring.layout import load_layout
from pouring_robot.robot.pouring.new_layout import NewLayout, check_lines, checked
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import load_robot
from pouring_robot.thermal.network.elements import LegGrid


def test_the_defaults_are_the_papers_robot():
    """The leg lengths that the workspace needs are those in the dimensions file, from its own drawing."""
    found = checked(NewLayout.usual())
    assert found.needed_mm == pytest.approx((283.8, 1069.9), abs=0.05)
    assert (found.reached, found.poses, found.limiting, found.singular) == (2401, 2401, {}, False)


def test_the_amplification_is_that_of_pinocchio():
    """One over the smallest singular value of the Jacobian of the closed chains at the same pose."""
    found, robot = checked(NewLayout.usual()), load_robot()
    x, y, z, tilt = found.worst
    location = robot.locate(PlatformPose((1e-3 * x, 1e-3 * y, 1e-3 * z), math.radians(tilt)))
    assert robot.dexterity(location).distance == pytest.approx(1.0 / found.amplified[1], rel=1e-5)


def test_hanging_like_a_swing_it_is_singular():
    """Platforms of one width: where the legs are vertical, none resists a lateral shift."""
    usual = NewLayout.usual()
    swing = dataclasses.replace(usual, moving_mm=(usual.moving_mm[0], usual.fixed_mm[1]))
    assert checked(swing).singular


def test_a_platform_that_is_held_nowhere_has_no_figure():
    """With platforms of one size, four parallel legs let the lower one swing in any pose."""
    usual = NewLayout.usual()
    *_, figures, warning = check_lines(checked(dataclasses.replace(usual, moving_mm=usual.fixed_mm)))
    assert "without bound" in figures
    assert "e+" not in figures
    assert warning == "warning: most poses of the workspace are singular, where the drives do not hold the platform"


def test_a_stroke_that_is_too_short_is_reported_for_each_leg():
    usual = NewLayout.usual()
    found = checked(dataclasses.replace(usual, stroke_mm=(400.0, 2000.0)))
    lengths = usual.joints(usual.poses)[..., 2]
    short = (lengths < 0.4).sum(axis=0)
    assert found.limiting == {f"leg{leg}_s3": count for leg, count in enumerate(short.tolist(), 1) if count}
    assert found.reached == int((lengths >= 0.4).all(axis=1).sum())


def test_the_file_holds_the_owners_values(tmp_path):
    own = dataclasses.replace(NewLayout.usual(), name="own", fixed_mm=(1000.0, 900.0), z_mm=(-1200.0, -700.0))
    path = tmp_path / "layouts.yaml"
    path.write_text(own.file_text(), encoding="utf-8")
    layout = load_layout("own", path)
    np.testing.assert_allclose(np.ptp(layout.fixed_centres.metres, axis=0), [1.0, 0.9, 0.0])
    np.testing.assert_allclose([corner[2] for corner in layout.box], (-1.2, -0.7))
    text = path.read_text(encoding="utf-8")
    assert "paper's robot" not in text.split("layouts:")[1]
    assert text.count("as the owner says") == 2
    assert load_layout("own", path).ladle.tare == load_layout().ladle.tare


def test_rods_are_as_long_as_the_longest_leg(tmp_path):
    """Heat flows along it; the warm end of a rod that ends in the air would count for the whole leg."""
    tall = dataclasses.replace(NewLayout.usual(), name="tall", fixed_mm=(1500.0, 1500.0), z_mm=(-3000.0, -2500.0))
    (path := tmp_path / "layouts.yaml").write_text(tall.file_text(), encoding="utf-8")
    entry = load_layout("tall", path)
    longest = max(entry.joint_limits.s3.metres)
    way = LegGrid.of(entry.leg, 20, 5).path_weights_m(np.full(4, longest))
    np.testing.assert_allclose(way.sum(axis=1), longest)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"name": "two words"}, "one word"),
        ({"name": "on"}, "one word"),  # a boolean of YAML 1.1, which xacro reads
        ({"stroke_mm": (-300.0, 500.0)}, "stroke_mm: sizes and masses must be above zero"),
        ({"stroke_mm": (500.0, 300.0)}, "stroke_mm: give the lower end first"),
        ({"z_mm": (300.0, 700.0)}, "lower z"),  # above the base a leg is long enough, too
        ({"z_mm": (-400.0, -800.0)}, "lower end first"),
        ({"payload_kg": 0.0}, "above zero"),
        ({"fixed_mm": (math.nan, 1.0)}, "above zero"),
    ],
)
def test_impossible_machines_are_refused(wrong, words):
    with pytest.raises(BadInputError, match=words):
        dataclasses.replace(NewLayout.usual(), **wrong)


def test_platforms_that_meet_are_refused():
    with pytest.raises(BadInputError, match="lower z"):
        checked(dataclasses.replace(NewLayout.usual(), z_mm=(-800.0, 100.0)))
