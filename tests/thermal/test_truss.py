"""The truss under heat: its network against closed forms, and its displacement against those of beams."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import Stefan_Boltzmann

from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties, load_thermal_properties
from pouring_robot.thermal.expansion import truss as network_of_truss
from pouring_robot.thermal.expansion.truss import TrussMotion, TrussNetwork
from pouring_robot.thermal.network.thermal_network import ThermalNetwork
from tests.support import unbalanced

MELT_K, AMBIENT_K, ALPHA = 1973.15, 293.15, 1.2e-5
POSE = PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 10.0)


@pytest.fixture(scope="module")
def robot(drawing):
    return ThermalNetwork(drawing)


@pytest.fixture(scope="module")
def truss(robot):
    return TrussNetwork(robot)


@pytest.fixture(scope="module")
def found(truss):
    return truss.temperatures(POSE, MELT_K, AMBIENT_K)


def motion(robot, found, **degC):
    """Return where the truss goes at other temperatures."""
    return TrussMotion.under_heat(robot.robot.layout, replace(found, **degC), robot.properties)


def test_an_evenly_warm_truss_grows_and_does_not_turn(robot, found):
    rise = 100.0
    girders, trolley = (np.full_like(values, 20.0 + rise) for values in (found.girders_degC, found.trolley_degC))
    went = motion(robot, found, girders_degC=girders, trolley_degC=trolley)
    assert went.turn_rad == pytest.approx(np.zeros(3), abs=1e-12)
    # Half a girder and a wheel up, from the axle (320 + 75 + 60 mm over O) down to the low frame, 62 mm over O.
    assert went.shift_m == pytest.approx([0.0, 0.0, ALPHA * rise * (0.075 + 0.060 - (0.455 - 0.062))], abs=1e-12)
    assert went.moved_m[[0, 10], 0] == pytest.approx(np.array([-1.0, 1.0]) * ALPHA * rise * 1.5)


def test_a_girder_warmer_below_bows_as_a_beam(robot, found):
    """Roark: an even slope g of the temperature bows a beam on two supports by α g L²/8 in its middle."""
    slope = -200.0  # K/m upwards
    height = found.girders.centres_m[:, 2].reshape(found.girders_degC.shape) - 0.320
    cold = np.full_like(found.trolley_degC, 20.0)
    went = motion(robot, found, girders_degC=20.0 + slope * height, trolley_degC=cold)
    assert went.moved_m[5, 2] == pytest.approx(ALPHA * slope * 9.0 / 8.0, rel=0.01)
    assert went.moved_m[[0, 10], 2] == pytest.approx(0.0, abs=1e-12)
    # The wheels stand 298 mm from the middle, where a parabola has 96 % of its depth.
    assert went.shift_m[2] / went.moved_m[5, 2] == pytest.approx(1.0 - (0.298 / 1.5) ** 2, rel=0.01)


def test_one_warm_girder_turns_the_platform_about_x(robot, found):
    slope = np.array([-200.0, 0.0])[:, None, None]
    height = found.girders.centres_m[:, 2].reshape(found.girders_degC.shape) - 0.320
    cold = np.full_like(found.trolley_degC, 20.0)
    went = motion(robot, found, girders_degC=20.0 + slope * height, trolley_degC=cold)
    # Left sinks, right stays: wheels of the girders are 244 mm apart, uprights' places count.
    assert went.turn_rad[0] < 0.0 and abs(went.turn_rad[1]) < 1e-9
    assert went.shift_m[1] == pytest.approx((0.320 + 0.075) * went.turn_rad[0])


def test_inside_a_girder_plates_exchange_what_crossed_strings_say(robot, found):
    matrix = network_of_truss._inside_girders(robot.robot.layout, 1.0).toarray()
    count, cells = matrix.shape[0] // 2, network_of_truss.GIRDER_CELLS
    assert np.allclose(matrix.sum(axis=1), 0.0, atol=1e-20) and np.array_equal(matrix, matrix.T)
    assert not matrix[:count, count:].any()
    one = matrix[:count:cells, :count:cells] / (Stefan_Boltzmann * 3.0 / cells)
    wide, high = 0.094, 0.134
    # A closed duct: what a strip sees is all, so the diagonal is its width; opposite sides by Hottel.
    halves = [0.5 * high] * 4
    assert np.diag(one) == pytest.approx([wide, *halves, wide])
    assert -one[0, -1] == pytest.approx(np.hypot(wide, high) - high)


def test_steady_truss_gives_off_what_it_takes(truss, found):
    for cells, inside, degC in (
        (truss._girders, truss._inside, found.girders_degC),
        (truss._trolley, None, found.trolley_degC),
    ):
        circuit = truss._circuit(cells, inside, POSE)
        balance = circuit.balance(degC.ravel() + 273.15, MELT_K, AMBIENT_K)
        assert unbalanced(balance) < 1e-8 and balance.melt_radiation_W > 1000.0


def test_jacobian_with_radiation_inside_against_differences(truss):
    circuit = truss._circuit(truss._girders, truss._inside, POSE)
    random = np.random.default_rng(1)
    t = random.uniform(300.0, 900.0, circuit.nodes)
    exact = circuit.jacobian(t).toarray()
    for k in random.integers(0, circuit.nodes, 8):
        step = np.zeros(circuit.nodes)
        step[k] = 0.01
        change = (circuit.heat(t + step, MELT_K, AMBIENT_K) - circuit.heat(t - step, MELT_K, AMBIENT_K)) / 0.02
        assert change == pytest.approx(exact[:, k], abs=1e-6)


def test_finer_cells_hardly_matter(robot, found, monkeypatch):
    monkeypatch.setattr(network_of_truss, "GIRDER_CELLS", 96)
    monkeypatch.setattr(network_of_truss, "TROLLEY_CELLS", 12)
    finer = TrussNetwork(robot).temperatures(POSE, MELT_K, AMBIENT_K)
    assert motion(robot, finer).shift_m[2] == pytest.approx(motion(robot, found).shift_m[2], rel=0.02)


def test_what_stands_between_hides_its_share():
    ends = np.array([[x, y, 0.0] for x in np.linspace(-1, 1, 40) for y in np.linspace(-1, 1, 40)])
    starts = np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 1.0], [0.0, 0.0, 0.5]])
    # A plate half way down: from above it covers the half of the ends with x > 0, from within itself nothing.
    plate = np.array([[[0.0, -9.0, 0.99], [9.0, 9.0, 1.01]]])
    assert network_of_truss._clear_share(starts, ends, plate) == pytest.approx([0.5, 1.0, 1.0])


def test_below_is_warmer_and_time_comes_to_the_steady_state(truss, found):
    assert np.all(found.girders_degC[:, 0] > found.girders_degC[:, -1])
    assert found.girders_degC[:, :, 12].max() > 3.0 * found.girders_degC[:, :, 0].max()
    late = truss.temperatures(POSE, MELT_K, AMBIENT_K, 12 * 3600.0)
    assert late.girders_degC == pytest.approx(found.girders_degC, abs=0.5)
    soon = truss.temperatures(POSE, MELT_K, AMBIENT_K, 60.0)
    assert soon.trolley_degC.max() < 0.5 * found.trolley_degC.max()


def test_a_shield_keeps_the_truss_cold(drawing):
    content = load_thermal_properties().model_dump()
    content["truss"]["exposed"]["value"] = 0.0
    shielded = ThermalNetwork(drawing, ThermalProperties.model_validate(content))
    found = TrussNetwork(shielded).temperatures(POSE, MELT_K, AMBIENT_K)
    assert found.girders_degC == pytest.approx(20.0, abs=1e-6) and found.trolley_degC == pytest.approx(20.0, abs=1e-6)
    assert motion(shielded, found).shift_m == pytest.approx(np.zeros(3), abs=1e-10)
