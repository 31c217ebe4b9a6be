"""The melt's sliders: against direct calls of the warm robot."""

import numpy as np
import pytest

from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot
from pouring_robot.thermal.scene import PouringBench
from tests.robot.benches import POSE, ask, check, origins


def test_a_slider_let_go_of_shows_the_settled_robot(as_built):
    bench = PouringBench(as_built, as_built.location_in_the_middle())
    pose = PlatformPose.from_mm_deg(*POSE.values())
    check(ask(bench, POSE), as_built.locate(pose))  # the melt has not come yet
    warm = {**POSE, "melt_degC": 1550.0, "after_min": 40.0}
    heated = HeatedRobot(as_built, HeatSection(melt_degC=1550.0, after_min=40.0)).locate(pose).location
    settled = ask(bench, warm, settled=True)
    check(settled, heated)
    assert heated.difference().distance_m > 1.2 * as_built.locate(pose).difference().distance_m
    # Moving it, temperatures are good to a kelvin: a few hundredths of a millimetre.
    moving = origins(ask(bench, warm), "actual") - origins(settled, "actual")
    assert np.linalg.norm(moving, axis=1).max() < 1e-4
    values = {name: settled["values"][name] for name in POSE}
    assert values == pytest.approx(POSE, abs=1e-9)
    by_drives = ask(bench, settled["values"] | {"melt_degC": 1550.0, "after_min": 40.0}, "drives", settled=True)
    check(by_drives, heated)


def test_impossible_heat_is_refused(as_built):
    bench = PouringBench(as_built, as_built.location_in_the_middle())
    assert "melt_degC" in ask(bench, {"melt_degC": -300.0, "after_min": 10.0})["refused"]


@pytest.mark.filterwarnings("ignore:PouringRobot uses the cold robot")
def test_a_melt_of_zero_degrees_is_one(as_built):
    cold = PouringRobot(as_built.model.model_copy(update={"heat": HeatSection(melt_degC=0.0)}))
    bench = PouringBench(cold, cold.location_in_the_middle())
    assert {s["id"]: s["value"] for g in bench.sliders()["groups"] for s in g["sliders"]}["melt_degC"] == 0.0


@pytest.mark.filterwarnings("ignore:PouringRobot uses the cold robot")
def test_what_was_measured_at_one_moment_is_not_that_of_all_times(as_built):
    values = {**POSE, "melt_degC": 1550.0, "after_min": 1.0}
    told = HeatSection(melt_degC=1550.0, after_min=45.0, measured_degC={"leg1": 210.0})
    robot = PouringRobot(as_built.model.model_copy(update={"heat": told}))
    found = ask(PouringBench(robot, robot.location_in_the_middle()), values, settled=True)
    heated = HeatedRobot(as_built, HeatSection(melt_degC=1550.0, after_min=1.0))
    check(found, heated.locate(PlatformPose.from_mm_deg(*POSE.values())).location)
