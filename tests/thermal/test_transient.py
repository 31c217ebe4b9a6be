"""Temperatures over time: closed form, settling, heat stored, changing poses, bad histories."""

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate._ivp import bdf

from pouring_robot.exceptions import HistoryError, TableError, TemperatureError
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.thermal.network.heat_balance import SOLVER, Circuit, integrate
from pouring_robot.thermal.network.history import HeatHistory, PoseSchedule, read_shift
from pouring_robot.thermal.network.thermal_network import simulate
from tests.support import unbalanced

POSE = PlatformPose((-0.100, 0.020, -0.600), 0.2)
OTHER = PlatformPose((-0.060, -0.030, -0.800), -0.1)
DAY_S = 86400.0


@pytest.mark.parametrize("method", ["BDF", "Radau"])
def test_a_lump_cools_exponentially(method):
    circuit = Circuit(np.zeros((1, 1)), np.zeros(1), np.array([2.0]), np.zeros(1), np.zeros(1), np.array([1000.0]))
    history = HeatHistory.constant(20.0, 20.0, 2000.0)
    times = np.linspace(0.0, 2000.0, 9)
    start = np.array([793.15])
    reported, _ = integrate(circuit, history, (0.0, 2000.0), start, times, SOLVER | {"method": method})
    expected = 293.15 + 500.0 * np.exp(-times / 500.0)
    assert np.array(reported)[:, 0] == pytest.approx(expected, abs=5e-3)


def test_a_lump_follows_a_ramp():
    circuit = Circuit(np.zeros((1, 1)), np.zeros(1), np.array([2.0]), np.zeros(1), np.zeros(1), np.array([1000.0]))
    history = HeatHistory(np.array([0.0, 5000.0]), np.array([20.0, 20.0]), np.array([20.0, 120.0]))
    reported, last = integrate(circuit, history, (0.0, 5000.0), np.array([293.15]), np.array([5000.0]))
    expected = 293.15 + 0.02 * (5000.0 - 500.0 * (1.0 - np.exp(-10.0)))
    assert last[0] == pytest.approx(expected, abs=5e-3)
    assert len(reported) == 1


def test_what_memory_held_before_raises_no_warning(network, monkeypatch):
    """SciPy's BDF subtracts from memory that it has not yet set, and never reads the difference."""

    class Numpy:
        def __getattr__(self, name):
            return getattr(np, name)

        def empty(self, shape, dtype):
            return np.full(shape, 0x7FF0000000000001, dtype=np.uint64).view(dtype)  # NaN that signals

    told = HeatHistory.constant(1700.0, 20.0, 600.0)
    (*_, expected) = simulate(network, told, POSE)
    monkeypatch.setattr(bdf, "np", Numpy())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (*_, found) = simulate(network, told, POSE)
    assert np.array_equal(found.temperatures_K, expected.temperatures_K)


@pytest.mark.parametrize("method", ["BDF", "Radau"])
def test_settles_to_steady(network, method):
    result = simulate(network, HeatHistory.constant(1700.0, 20.0, 2 * DAY_S), POSE, solver=SOLVER | {"method": method})
    steady = network.steady(POSE, 1700.0, 20.0)
    assert np.abs(result[-1].temperatures_K - steady.temperatures_K).max() < 1e-3
    assert unbalanced(result[-1].balance) < 1e-5


def test_starts_at_the_surroundings_or_where_told(network):
    history = HeatHistory.constant(1700.0, 35.0, 3600.0)
    cold = simulate(network, history, POSE)
    assert np.all(cold[0].temperatures_K == 308.15)
    steady = network.steady(POSE, 1700.0, 35.0)
    warm = simulate(network, history, POSE, start=steady)
    assert np.abs(warm[-1].temperatures_K - steady.temperatures_K).max() < 1e-3


def test_heat_that_came_in_is_there(network):
    """Stored heat against the integral of the network's balance."""
    times = np.linspace(0.0, 3600.0, 721)
    result = simulate(network, HeatHistory.constant(1700.0, 20.0, 3600.0), POSE, times_s=times)
    capacity = network.circuit(POSE).capacity
    stored = capacity @ (result[-1].temperatures_K - result[0].temperatures_K)
    rates = [field.balance.stored_W for field in result]
    assert np.trapezoid(rates[4:], times[4:]) == pytest.approx(
        capacity @ (result[-1].temperatures_K - result[4].temperatures_K), rel=1e-3
    )
    assert stored > 0.0


def test_both_solvers_agree_through_history_and_poses(network):
    history = HeatHistory(
        np.array([0.0, 1800.0, 2400.0, 7200.0]),
        np.array([1500.0, 1700.0, 1700.0, 1600.0]),
        np.array([20.0, 20.0, 30.0, 30.0]),
    )
    poses = [(0.0, POSE), (2000.0, OTHER), (5000.0, POSE)]
    bdf, radau = (
        simulate(network, history, poses, times_s=np.arange(0.0, 7201.0, 600.0), solver=SOLVER | {"method": method})
        for method in ("BDF", "Radau")
    )
    for one, other in zip(bdf, radau, strict=True):
        assert one.leg_degC == pytest.approx(other.leg_degC, abs=0.02)
        assert one.platform_degC == pytest.approx(other.platform_degC, abs=0.02)


def test_after_a_change_of_pose_the_steel_keeps_its_heat(network):
    history = HeatHistory.constant(1700.0, 20.0, 2 * DAY_S)
    result = simulate(
        network, history, [(0.0, POSE), (DAY_S, OTHER)], times_s=np.array([DAY_S - 1.0, DAY_S, DAY_S + 1.0, 2 * DAY_S])
    )
    before, at, after, end = (field.temperatures_K for field in result)
    assert np.abs(at - before).max() < 0.01
    # Only the cladding's thin surface is quick.
    assert np.abs(after - at)[network.bodies.nodes.legs].max() < 3.0
    assert np.abs(end - network.steady(OTHER).temperatures_K).max() < 1e-3
    # The field's geometry is that of the pose held from then on.
    assert result[1].exposure.lengths_m == pytest.approx(network.steady(OTHER).exposure.lengths_m)
    assert result[0].exposure.lengths_m == pytest.approx(network.steady(POSE).exposure.lengths_m)


def test_corners_are_where_the_slope_changes():
    history = HeatHistory(np.arange(6.0), np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0]), np.full(6, 20.0))
    assert history.corners_s.tolist() == [2.0, 4.0]


@pytest.mark.parametrize(
    ("times", "melt", "says"),
    [
        ([0.0, 10.0, 5.0], [1700.0] * 3, "entry 3: its time of 5 s is not later than 10 s"),
        ([0.0, 0.0], [1700.0] * 2, "entry 2"),
        ([0.0], [1700.0], "at least two entries"),
        ([0.0, float("nan")], [1700.0] * 2, "finite"),
        ([0.0, 1.0], [1700.0] * 3, "3 entries"),
    ],
)
def test_bad_histories(times, melt, says):
    with pytest.raises(HistoryError, match=says) as caught:
        HeatHistory(np.array(times), np.array(melt), np.full(len(times), 20.0))
    assert "\n" not in str(caught.value)


def test_impossible_temperatures_in_a_history():
    with pytest.raises(TemperatureError, match="entry 2: melt"):
        HeatHistory(np.array([0.0, 1.0]), np.array([1700.0, -400.0]), np.full(2, 20.0))
    with pytest.raises(TemperatureError, match=r"entry 1: ambient: 293.15 degC is hotter than any surroundings"):
        HeatHistory.constant(1700.0, 293.15, 60.0)


def test_bad_schedules(network):
    history = HeatHistory.constant(1700.0, 20.0, 100.0)
    with pytest.raises(HistoryError, match="entry 2"):
        simulate(network, history, [(50.0, POSE), (10.0, OTHER)])
    with pytest.raises(HistoryError, match="after the history's end"):
        simulate(network, history, [(0.0, POSE), (200.0, OTHER)])
    with pytest.raises(HistoryError, match="no pose"):
        PoseSchedule(())
    for times in ([5.0, 1.0], [], [0.0, 200.0]):
        with pytest.raises(HistoryError, match="times to report"):
            simulate(network, history, POSE, times_s=np.array(times))


def test_a_history_file(tmp_path):
    path = tmp_path / "shift.csv"
    path.write_text("time_min, melt_degC, ambient_degC\n0,1500,20\n\n30,1700,25\n", encoding="utf-8")
    history, _ = read_shift(path)
    assert history.times_s.tolist() == [0.0, 1800.0]
    assert history.at(900.0) == pytest.approx((1873.15, 295.65))
    path.write_text("time_s,melt_degC\n0,1500\n30,1700\n", encoding="utf-8")
    assert read_shift(path, 15.0)[0].ambient_degC.tolist() == [15.0, 15.0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1"),
        ("time_s,melt\n0,1\n", "unknown column 'melt' names no unit; write melt_degC"),
        ("time_s,time_min,melt_degC\n0,0,1\n", "the column for time (time_s or time_min or time_h) occurs twice"),
        ("time_s,melt_degC,melt_degC\n0,0,1\n", "occurs twice"),
        ("time_s,melt_degC\n0,1700\n5,\n", "line 3, column melt_degC"),
        ("time_s,melt_degC\n0,1700\n5,1700\n4,1700\n", "line 4, column time_s: is not later than"),
        ("time_s,melt_degC\n0,1700\n5,-300\n", "line 3, column melt_degC: -300 degC lies below"),
        ("time_s,melt_K\n0,1973\n5,-30\n", "line 3, column melt_K: -303.15 degC lies below"),
        ("time_s,ambient_K\n0,293\n", "the column for melt (melt_degC or melt_K) is missing"),
        ("time_s,melt_K,melt_degC\n0,1973,1700\n", "the column for melt (melt_degC or melt_K) occurs twice"),
        ("time_s,melt_degC\n0,1700\n", "at least two entries"),
    ],
)
def test_bad_history_files(tmp_path, text, says):
    path = tmp_path / "shift.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TableError) as caught:
        read_shift(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_shift_file_may_hold_poses(tmp_path):
    path = tmp_path / "shift.csv"
    path.write_text(
        "time_min,melt_degC,x_mm,y_mm,z_mm,tilt_deg\n0,1500,-100,0,-600,10\n5,1500,-100,0,-600,10\n9,1700,-60,5,-500,0\n",
        encoding="utf-8",
    )
    history, schedule = read_shift(path, 25.0)
    assert history.ambient_degC.tolist() == [25.0] * 3
    assert schedule.entries == (
        (0.0, PlatformPose.from_mm_deg(-100.0, 0.0, -600.0, 10.0)),
        (540.0, PlatformPose.from_mm_deg(-60.0, 5.0, -500.0, 0.0)),
    )
    path.write_text("time_min,melt_degC\n0,1500\n5,1500\n", encoding="utf-8")
    assert read_shift(path)[1] is None
    with pytest.raises(TableError, match="column 'y_mm' is missing"):
        path.write_text("time_min,melt_degC,x_mm\n0,1500,1\n5,1500,1\n", encoding="utf-8")
        read_shift(path)


def test_a_shift_file_takes_any_unit_of_a_kind(tmp_path):
    """1773.15 K are 1500 degC, pi/6 rad 30 degrees."""
    path = tmp_path / "shift.csv"
    head = "time_h,melt_K,ambient_K,x_m,y_um,z_mm,tilt_mrad\n"
    path.write_text(f"{head}0,1773.15,293.15,-0.1,20000,-600,523.5987755982989\n0.5,1973.15,298.15,-0.1,0,-600,0\n")
    history, schedule = read_shift(path)
    assert history.times_s.tolist() == [0.0, 1800.0]
    assert history.melt_degC.tolist() == pytest.approx([1500.0, 1700.0])
    assert history.ambient_degC.tolist() == pytest.approx([20.0, 25.0])
    first, second = (pose.to_mm_deg() for _, pose in schedule.entries)
    assert first == pytest.approx((-100.0, 20.0, -600.0, 30.0))
    assert second == pytest.approx((-100.0, 0.0, -600.0, 0.0))


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.one_of(
        st.text(max_size=60),
        st.lists(
            st.lists(st.sampled_from(["0", "1", "1700", "-400", "1e9", "nan", "", '"', "x"]), max_size=4), max_size=4
        ).map(lambda rows: "time_s,melt_degC,ambient_degC\n" + "\n".join(map(",".join, rows))),
    )
)
def test_any_text_is_read_or_refused(tmp_path, text):
    path = tmp_path / "shift.csv"
    path.write_text(text, encoding="utf-8", errors="replace")
    try:
        history, _ = read_shift(path)
    except TableError as problem:
        assert "\n" not in str(problem)
    else:
        assert np.all(np.diff(history.times_s) > 0.0)
