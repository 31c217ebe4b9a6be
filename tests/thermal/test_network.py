"""The thermal network against closed forms, its energy balance, its refinement, and the paper's results."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import Stefan_Boltzmann

from pouring_robot.exceptions import BadInputError, DescriptionError, TemperatureError, ThermalSolutionError
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties, load_thermal_properties
from pouring_robot.thermal.network.elements import BarCells, _seen_around, link_boxes, merged
from pouring_robot.thermal.network.heat_balance import (
    Circuit,
    chain_links,
    grey_radiation,
    laplacian,
    steady_temperatures,
)
from pouring_robot.thermal.network.thermal_network import ThermalNetwork
from pouring_robot.thermal.network.view_factors import DiscChords
from tests.support import random_poses, unbalanced

POSE = PlatformPose((-0.100, 0.020, -0.600), np.radians(10.0))


def with_value(key, value):
    """Return the shipped properties with one value changed."""
    content = load_thermal_properties().model_dump()
    section, name = key.split(".")
    content[section][name]["value"] = value
    return ThermalProperties.model_validate(content)


def fin(count, radiation=0.0):
    """Return a steel fin, root held at the melt's temperature, its tip free: conductances and a closed form."""
    conductivity, radius, length, film = 60.0, 0.02, 0.5, 12.5
    step, section, around = length / count, np.pi * radius**2, 2 * np.pi * radius
    root = np.zeros(count)
    root[0] = 2 * conductivity * section / step
    circuit = Circuit(
        laplacian=laplacian(count, chain_links(np.arange(count), conductivity * section / step)),
        melt_contact=root,
        film=np.full(count, film * around * step),
        melt_radiation=np.zeros(count),
        ambient_radiation=np.full(count, radiation * around * step),
        capacity=np.full(count, 7850 * 490 * section * step),
    )
    places = step * (np.arange(count) + 0.5)
    decay = np.sqrt(film * around / (conductivity * section))
    return circuit, places, np.cosh(decay * (length - places)) / np.cosh(decay * length)


def fin_error(count):
    circuit, _, closed = fin(count)
    found = steady_temperatures(circuit, 500.0, 300.0)
    return np.abs((found - 300.0) / 200.0 - closed).max()


def test_fin_with_a_fixed_end():
    assert fin_error(40) < 1e-3


def test_fin_converges_at_second_order():
    errors = np.array([fin_error(n) for n in (20, 40, 80, 160)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders > 1.9)


def test_a_radiating_fin_against_a_boundary_value_solver():
    from scipy.integrate import solve_bvp

    emission = 0.8 * Stefan_Boltzmann
    circuit, places, _ = fin(400, emission)
    found = steady_temperatures(circuit, 900.0, 300.0)
    ratio = 2.0 / (60.0 * 0.02)

    def slope(_x, y):
        return np.vstack([y[1], ratio * (12.5 * (y[0] - 300.0) + emission * (y[0] ** 4 - 300.0**4))])

    grid = np.linspace(0, 0.5, 200)
    guess = np.vstack([900 - 800 * grid, np.full_like(grid, -800.0)])
    solution = solve_bvp(slope, lambda a, b: np.array([a[0] - 900.0, b[1]]), grid, guess, tol=1e-8)
    assert np.abs(found - solution.sol(places)[0]).max() < 0.02


def test_one_plate_between_melt_and_surroundings():
    to_melt, to_ambient = np.array([3e-9]), np.array([1e-8])
    circuit = Circuit(np.zeros((1, 1)), np.zeros(1), np.zeros(1), to_melt, to_ambient, np.ones(1))
    found = steady_temperatures(circuit, 1973.15, 293.15)[0]
    closed = ((3e-9 * 1973.15**4 + 1e-8 * 293.15**4) / 1.3e-8) ** 0.25
    assert found == pytest.approx(closed, rel=1e-12)


def test_an_isolated_part_is_reported():
    nothing = np.zeros(2)
    circuit = Circuit(laplacian(2, [(0, 1, 1.0)]), nothing, nothing, nothing, nothing, np.ones(2))
    with pytest.raises(ThermalSolutionError, match="connected to nothing"):
        steady_temperatures(circuit, 500.0, 300.0)


def test_jacobian_against_differences(network):
    circuit = network.circuit(POSE)
    random = np.random.default_rng(1)
    t = random.uniform(300.0, 900.0, circuit.nodes)
    exact = circuit.jacobian(t).toarray()
    for k in random.integers(0, circuit.nodes, 12):
        step = np.zeros(circuit.nodes)
        step[k] = 0.01
        change = (circuit.heat(t + step, 1973.15, 293.15) - circuit.heat(t - step, 1973.15, 293.15)) / 0.02
        assert change == pytest.approx(exact[:, k], abs=1e-6)
    assert np.array_equal(exact, exact.T)
    assert np.allclose(circuit.laplacian.sum(axis=1), 0.0, atol=1e-9)


@pytest.mark.parametrize("radiation", [True, False])
def test_energy_balance(drawing, radiation):
    network = ThermalNetwork(drawing, radiation=radiation)
    for pose in random_poses(6, seed=3):
        for melt in (300.0, 1700.0):
            balance = network.steady(pose, melt).balance
            assert unbalanced(balance) < 1e-9
            assert balance.melt_conduction_W > 100.0
            assert (balance.melt_radiation_W > 1000.0 if melt > 1000.0 else True) or not radiation


def test_melt_as_cold_as_the_surroundings_warms_nothing(network):
    field = network.steady(POSE, 35.0, 35.0)
    assert np.abs(field.temperatures_K - 308.15).max() < 1e-9


def test_nothing_is_hotter_than_the_melt_or_colder_than_the_surroundings(network):
    for pose in random_poses(10, seed=8):
        t = network.steady(pose).temperatures_K
        assert t.min() > 293.15
        assert t.max() < 1973.15


def test_mirrored_poses_swap_the_legs(network):
    left = network.steady(PlatformPose((-0.1, 0.03, -0.6), 0.2))
    right = network.steady(PlatformPose((-0.1, -0.03, -0.6), 0.2))
    # The points of the disc's sample are not mirrored; that is all the difference.
    assert left.leg_degC == pytest.approx(right.leg_degC[[1, 0, 3, 2]], abs=3.0)


def test_tilting_the_mouth_towards_legs_warms_them(network):
    upright, tilted = (network.steady(PlatformPose((-0.1, 0.0, -0.6), r)) for r in (0.0, 0.6))
    assert np.all(tilted.leg_degC[2:] > upright.leg_degC[2:] + 10.0)
    assert np.all(tilted.leg_degC[:2] < upright.leg_degC[:2] - 10.0)


def test_the_platform_shades_the_legs(network, drawing):
    free = ThermalNetwork(drawing)
    free.bodies = replace(free.bodies, in_the_way_m=np.zeros((0, 2, 3)))
    assert np.all(free.steady(POSE).leg_degC > network.steady(POSE).leg_degC + 20.0)


def test_legs_converge_with_refinement(drawing):
    """Without shadows, whose sampling is another matter; bars kept as they are."""
    means = []
    for count in (12, 24, 48, 96):
        network = ThermalNetwork(drawing, elements_per_leg=count, elements_per_bar=4)
        network.bodies = replace(network.bodies, in_the_way_m=np.zeros((0, 2, 3)))
        means.append(network.steady(POSE).leg_degC)
    steps = np.abs(np.diff(means, axis=0)).max(axis=1)
    # Ends of the housing cut elements anywhere, so single steps are uneven; over two of them the order is seen.
    assert steps[-1] < 0.3
    assert np.log2(steps[0] / steps[-1]) / 2 > 1.2


def test_twenty_elements_are_enough(drawing, network):
    fine = ThermalNetwork(drawing, elements_per_leg=80)
    for pose in random_poses(4, seed=12):
        assert fine.steady(pose).leg_degC == pytest.approx(network.steady(pose).leg_degC, abs=6.0)


def test_leg_view_factor_is_the_mean_around_the_rod():
    """Around itself a thin rod sees of every bit of the disc sin(angle to its axis)/π of what a facing element sees."""
    radius, down = 0.3, np.array([0.1, -0.05, -1.0]) / np.linalg.norm([0.1, -0.05, -1.0])
    points = np.array([[0.35, 0.1, 0.15], [0.1, -0.2, 0.4], [-0.5, 0.2, 0.8]])
    no_boxes = np.zeros((0, 2, 3))
    centres, along = np.tile(points, (4, 1, 1)), np.tile(-down, (4, 1))
    lit = np.ones((4, 3), dtype=bool)
    found, harmonic = _seen_around(centres, along, np.full(3, 1e-9), lit, DiscChords.of(radius), no_boxes)
    r, a = np.meshgrid(radius * np.sqrt((np.arange(300) + 0.5) / 300), 2 * np.pi * np.arange(400) / 400)
    for k, point in enumerate(points):
        ray = np.stack([r * np.cos(a), r * np.sin(a), 0 * r], axis=-1) - point
        distance = np.linalg.norm(ray, axis=-1)
        across = ray / distance[..., None]
        across = across - (across @ down)[..., None] * down
        weight = point[2] / distance**3 * radius**2
        assert found[0, k] == pytest.approx((np.linalg.norm(across, axis=-1) * weight).mean() / np.pi, rel=2e-3)
        # First harmonic of max(cos, 0) is 1/2.
        assert harmonic[0, k] == pytest.approx((across * weight[..., None]).mean(axis=(0, 1)) / 2, abs=2e-4)


def test_a_closure_of_the_robot_gives_the_same_as_its_pose(network, drawing):
    closed = drawing.locate(POSE).nominal
    assert network.steady(closed).temperatures_K == pytest.approx(network.steady(POSE).temperatures_K, abs=1e-6)


def test_path_weights_add_up_to_the_leg(network):
    for pose in random_poses(5, seed=5):
        field = network.steady(pose)
        lengths = field.exposure.lengths_m
        assert field.between_joints.sum(axis=1) == pytest.approx(lengths, abs=1e-12)
        mean = np.sum(field.between_joints * field.leg_elements_degC, axis=1) / lengths
        assert field.leg_degC == pytest.approx(mean, abs=1e-9)


def test_bars_conduct_and_lose_no_surface(drawing):
    straight = np.array([[[0.0, 0.0, 0.0], [1.0, 0.1, 0.2]]])
    cells = BarCells.cut(straight, 5)
    assert [c[2] for c in cells.contacts] == pytest.approx([0.02 / 0.2] * 4)
    assert cells.face_area_m2.sum() == pytest.approx(2 * (0.02 + 0.1 + 0.2))
    boxes = link_boxes(drawing.model.definition.urdf(), "moving_platform")
    whole = BarCells.cut(boxes, 4)
    assert whole.volume_m3.sum() == pytest.approx(np.prod(boxes[:, 1] - boxes[:, 0], axis=1).sum())
    assert np.all(whole.face_area_m2 >= 0.0)
    one = merged(boxes)
    assert len(one) == len(boxes) - 2  # two bars across, each drawn in two halves
    assert np.prod(one[:, 1] - one[:, 0], axis=1).sum() == pytest.approx(whole.volume_m3.sum())


def test_links_that_are_no_boxes_are_refused(drawing):
    with pytest.raises(DescriptionError, match="leg1_fixed_rod"):
        link_boxes(drawing.model.definition.urdf(), "leg1_fixed_rod")
    with pytest.raises(DescriptionError, match="nowhere"):
        link_boxes(drawing.model.definition.urdf(), "nowhere")


def test_a_box_whose_origin_is_no_place_is_refused_with_its_link():
    box = '<visual><origin xyz="{}"/><geometry><box size="1 1 1"/></geometry></visual>'
    urdf = f'<robot name="r"><link name="bar">{box}</link></robot>'
    np.testing.assert_array_equal(link_boxes(urdf.format("1 0 2"), "bar"), [[[0.5, -0.5, 1.5], [1.5, 0.5, 2.5]]])
    with pytest.raises(DescriptionError, match="link bar: origin xyz='1 0' is not three numbers"):
        link_boxes(urdf.format("1 0"), "bar")


def test_impossible_input_is_refused(network, drawing):
    with pytest.raises(TemperatureError, match=r"melt: -300 degC"):
        network.steady(POSE, -300.0)
    with pytest.raises(TemperatureError, match="ambient"):
        network.steady(POSE, 1700.0, float("nan"))
    with pytest.raises(TemperatureError, match=r"ambient: 293.15 degC is hotter than any surroundings"):
        network.steady(POSE, 1700.0, 293.15)
    with pytest.raises(TemperatureError, match="melt: 3000 degC is hotter than any melt"):
        network.steady(POSE, 3000.0)
    for elements in (3, 20.5, float("nan")):
        with pytest.raises(BadInputError, match="a leg needs a whole number of elements, at least 4"):
            ThermalNetwork(drawing, elements_per_leg=elements)
    for cells in (0, 2.5):
        with pytest.raises(BadInputError, match="a bar needs a whole number of elements, at least 1"):
            ThermalNetwork(drawing, elements_per_bar=cells)


def test_the_other_layout_works():
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.pouring_robot import PouringRobot

    field = ThermalNetwork(PouringRobot(RobotModel(layout="wide"))).steady(POSE)
    assert unbalanced(field.balance) < 1e-9
    assert np.all(field.leg_degC > 100.0)


def test_paper_conduction_alone_leaves_the_chains_at_room_temperature(drawing):
    network = ThermalNetwork(drawing, radiation=False)
    for pose in random_poses(5, seed=2):
        field = network.steady(pose)
        assert np.all(field.leg_degC < 20.0 + 10.0)
        assert field.leg_difference_K == pytest.approx(np.zeros(4))


def test_paper_radiation_heats_to_300_mostly_and_500_near_the_melt(network):
    fields = [network.steady(pose) for pose in random_poses(20, seed=6)]
    means = np.array([field.leg_degC for field in fields])
    hottest = np.array([field.leg_elements_degC.max() for field in fields])
    assert 270.0 < np.median(means) < 400.0
    assert 430.0 < np.median(hottest) < 570.0


def test_bare_bars_over_the_mouth_would_glow(drawing):
    bare = ThermalNetwork(drawing, with_value("moving_platform.cladding_thickness", 0.0)).steady(POSE)
    assert bare.platform_elements_degC.max() > 1000.0
    assert bare.cladding_degC.size == 0
    assert unbalanced(bare.balance) < 1e-9


def test_the_melt_tilts_with_the_ladle(network, drawing):
    """The disc's frame against the ladle's link in the closed mechanism."""
    level = drawing.layout.ladle.melt_below_rim.metres
    for pose in random_poses(4, seed=21):
        exposure, closed = network.steady(pose).exposure, drawing.locate(pose).nominal
        lower = exposure.centres_m[:, 2] + 2.5 * network.bodies.grid.step_m[0] * exposure.down
        expected = [
            closed.pose("ladle", f"leg{i}_moving_rod").translation + np.array([0.0, 0.0, level]) for i in (1, 2, 3, 4)
        ]
        assert lower == pytest.approx(np.array(expected), abs=1e-9)


def test_heat_through_the_lining_is_that_of_a_wall(network):
    field, ladle = network.steady(POSE), network.bodies.ladle
    area = np.sqrt(ladle.inner_area_m2 * ladle.outer_area_m2)
    wall = 0.055 * area / (ladle.wall_m - 0.010) * (1700.0 - field.shell_degC)
    assert field.balance.melt_conduction_W == pytest.approx(wall, rel=1e-9)


def test_a_surface_radiates_by_its_whole_area():
    to_melt, to_ambient = grey_radiation(np.array([2.0]), np.array([0.5]), 0.8, 0.7)
    assert to_melt[0] == pytest.approx(0.8 * 0.7 * 0.5 * Stefan_Boltzmann)
    assert to_melt[0] + to_ambient[0] == pytest.approx(0.8 * 2.0 * Stefan_Boltzmann)
