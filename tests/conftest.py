"""Robots and campaigns that many tests share; building one takes a few tenths of a second."""

import dataclasses
import gc

import numpy as np
import pytest
from hypothesis import Phase, settings

from pouring_robot.calibration import report
from pouring_robot.campaign.plan import PosePlan, random_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.cli import OBJECTS_BETWEEN_COLLECTIONS
from pouring_robot.diagnosis.report import export
from pouring_robot.robot.pouring_robot import PouringRobot, load_robot
from tests.campaign.simulated import SIGMA_M, SIGMA_RAD, measure
from tests.support import ACTUAL, crooked_model


def pytest_collection_finish():
    """Collect garbage as seldom as a command does, and never look through what was loaded for the tests."""
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    gc.freeze()


# Which lines a failing example runs through is not asked: Hypothesis would trace every line of every example for it.
settings.register_profile("untraced", phases=[phase for phase in Phase if phase is not Phase.explain])
settings.load_profile("untraced")


@pytest.fixture
def written(tmp_path, request):
    """What writes a file of a test, called as its module says (``WRITTEN``), and returns its path."""

    def write(content):
        path = tmp_path / request.module.WRITTEN
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture(scope="session")
def drawing():
    """The robot without errors."""
    return PouringRobot()


@pytest.fixture(scope="session")
def as_built():
    """The shipped example of a robot with machining errors."""
    return load_robot(ACTUAL)


@pytest.fixture(scope="session")
def crooked():
    """A robot whose axes are off by 2 mrad."""
    return PouringRobot(crooked_model(seed=7, axis_mrad=2.0))


@pytest.fixture(scope="session")
def very_crooked():
    """A robot whose axes are off by 4 mrad: its loops stay open by milliradians."""
    return PouringRobot(crooked_model(seed=11, axis_mrad=4.0))


@pytest.fixture(scope="session")
def clean(drawing):
    """Sixty full poses of the robot of the drawing."""
    return measure(drawing)


@pytest.fixture(scope="session")
def positions(drawing):
    """Sixty positions without rotations."""
    return measure(drawing, seed=2, sigma_rotation_rad=None)


@pytest.fixture(scope="session")
def real(as_built):
    """Eighty full poses of a robot with machining errors, which move its ladle by millimetres."""
    return measure(as_built, count=80, seed=5)


@pytest.fixture(scope="session")
def repeated(as_built):
    """Sixty poses, of which four were measured six times in a row, and no noise stated."""
    plan = random_plan(as_built, 60, 9)
    order = [k for k in range(60) for _ in range(6 if k % 15 == 0 else 1)]
    conditions = {name: values[order] for name, values in plan.conditions.items()}
    conditions |= {name: np.ones(len(order)) for name in conditions if name.startswith("approach")}
    again = PosePlan(
        tuple(plan.poses[k] for k in order),
        plan.drives[order],
        tuple(str(k) for k in range(len(order))),
        ("1",) * len(order),
        conditions,
    )
    campaign = simulate_campaign(as_built, again, MeasurementOptions(SIGMA_M, SIGMA_RAD, seed=9)).campaign
    blank = campaign.metadata.model_copy(update={"sigma_position_m": None, "sigma_rotation_rad": None})
    return dataclasses.replace(campaign, metadata=blank)


@pytest.fixture
def rng():
    return np.random.default_rng(20240611)


@pytest.fixture
def undrawn(monkeypatch):
    """Reports without pictures, which take as long as a search, for tests that look at other files."""
    monkeypatch.setattr(export, "_plots", lambda _: [("none", "<svg/>")])
    monkeypatch.setattr(report, "plots", lambda _: [("none", "<svg/>")])
