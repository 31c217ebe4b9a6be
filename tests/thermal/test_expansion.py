"""Expansion as local parameters, the resulting pose, and the bending of legs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_bvp

from pouring_robot.exceptions import BadInputError, TemperatureError
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import DriveOffset, JointPlacement, RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring.thermal_properties import load_thermal_properties
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.leg_growth import LegBending, ThermalExpansion
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, WarmRobot
from pouring_robot.thermal.network.temperature_field import TemperatureField, gradient_across_tube
from pouring_robot.thermal.report import PoseHeat
from tests.support import CHAINS, oracle_cases, random_poses

POSE = PlatformPose((-0.100, 0.020, -0.600), np.radians(10.0))
PROPERTIES = load_thermal_properties()


def heated(**degC):
    return ThermalExpansion.from_temperatures(PROPERTIES, degC)


@pytest.mark.parametrize("case", oracle_cases()[::6])
def test_pose_against_the_independent_oracle(case):
    """Offsets of joint centres and drives, and warm legs: length = (commanded + offset) (1 + alpha rise)."""
    placements = {}
    for i in CHAINS:
        for joint, key in ((f"leg{i}_s1", "fixed"), (f"leg{i}_seat_mount", "moving")):
            offset = np.array(case[f"{key}_joint_centre_offsets_m"][i - 1]) * 1e3
            placements[joint] = JointPlacement(translation_mm=tuple(offset.tolist()))
    assert case["expansion_per_K"] == PROPERTIES.steel.expansion.value
    rises = {f"leg{i}": 20.0 + rise for i, rise in zip(CHAINS, case["leg_temperature_rise_K"], strict=True)}
    offsets = {f"leg{i}_s3": case["drive_offsets"]["leg_lengths_m"][i - 1] for i in (1, 2, 3)}
    offsets["leg4_s5"] = case["drive_offsets"]["tilt_drive_rad"]
    robot = PouringRobot(
        RobotModel(
            joint_placements=placements,
            drive_offsets={
                name: DriveOffset(**{"offset_mrad" if name == "leg4_s5" else "offset_mm": 1e3 * offset})
                for name, offset in offsets.items()
            },
        )
    )
    commanded = case["commanded"]
    pose = PlatformPose(tuple(commanded["position_m"]), commanded["tilt_rad"])
    result = WarmRobot(robot, heated(**rises), pose).solve().pose_base_to_end
    assert np.abs(result.translation - case["platform"]["position_m"]).max() < 1e-9
    assert np.abs(pin.log3(result.rotation) - case["platform"]["rotation_vector_rad"]).max() < 1e-9


def test_drives_follow_the_convention(drawing):
    """Offset, then grown with the leg; the tilt is no length."""
    offset = DriveOffset(offset_mm=2.0)
    robot = drawing.built_as(drawing.model.model_copy(update={"drive_offsets": {"leg1_s3": offset}}))
    drives = {"leg1_s3": 0.55, "leg2_s3": 0.55, "leg3_s3": 0.70, "leg4_s5": 0.1}
    grown = WarmRobot(robot, heated(leg1=120.0, leg3=220.0), POSE).actual_drives(drives)
    wanted = {"leg1_s3": 0.552 * 1.0012, "leg2_s3": 0.55, "leg3_s3": 0.70 * 1.0024, "leg4_s5": 0.1}
    assert grown == pytest.approx(wanted, rel=1e-14)


def test_placements_grow_the_platforms(drawing):
    expansion = heated(leg4=120.0, platform=220.0, fixed_platform=70.0)
    errors = expansion.placements(drawing.kinematics)
    for k, i in enumerate(CHAINS):
        seat, base = errors[f"leg{i}_seat_mount"], errors[f"leg{i}_s1"]
        assert seat.translation == pytest.approx(2.4e-3 * drawing.kinematics.moving_centres_m[k])
        assert base.translation == pytest.approx(6e-4 * drawing.kinematics.fixed_centres_m[k])
        assert np.array_equal(seat.rotation, np.eye(3))
    assert len(errors) == 2 * len(CHAINS)


def test_all_equally_warm_is_a_larger_robot(drawing):
    """Everything 100 K warmer: the same shape, scaled; the platform moves away along its own place."""
    warm = dict.fromkeys(("leg1", "leg2", "leg3", "leg4", "platform", "fixed_platform"), 120.0)
    for pose in random_poses(4, seed=9):
        result = WarmRobot(drawing, heated(**warm), pose).solve().pose_base_to_end
        assert result.translation == pytest.approx(np.array(pose.position_m) * (1 + 1.2e-3), abs=1e-10)
        assert result.rotation == pytest.approx(pose.to_se3().rotation, abs=1e-9)


def test_growth_of_the_passive_leg_moves_nothing(as_built):
    """Nor does it where the leg's axes are tilted: its joint is as long as the leg, as those of the driven legs are."""
    cold = as_built.locate(POSE).actual
    warm = WarmRobot(as_built, heated(leg4=500.0), POSE).solve()
    assert warm.pose_base_to_end.translation == pytest.approx(cold.pose_base_to_end.translation, abs=1e-12)
    assert warm.joint_values == pytest.approx(cold.joint_values, abs=1e-12)


def test_measured_temperatures_replace_computed_ones(network):
    field = network.steady(POSE)
    computed = ThermalExpansion.from_field(field)
    measured = ThermalExpansion.from_field(field, {"leg2": 20.0, "platform": 120.0})
    assert computed.leg_strain == pytest.approx(1.2e-5 * (field.leg_degC - 20.0))
    assert measured.leg_strain[1] == 0.0
    assert measured.platform_strain == pytest.approx(1.2e-3)
    assert measured.leg_strain[0] == computed.leg_strain[0]
    assert measured.fixed_platform_strain == computed.fixed_platform_strain


def test_strain_is_the_integral_along_the_leg(network):
    field = network.steady(POSE)
    growth = 1.2e-5 * np.sum(field.between_joints * (field.leg_elements_degC - 20.0), axis=1)
    expansion = ThermalExpansion.from_field(field)
    assert np.array(expansion.leg_strain) * field.exposure.lengths_m == pytest.approx(growth, rel=1e-12)


def test_bad_parts_and_temperatures():
    with pytest.raises(BadInputError, match="did you mean 'leg1'"):
        heated(leg_1=100.0)
    with pytest.raises(TemperatureError, match="platform"):
        heated(platform=-300.0)


def test_cold_robot_is_the_robot_as_built(as_built):
    cold = WarmRobot(as_built, heated(), POSE).solve().pose_base_to_end
    located = as_built.locate(POSE).actual.pose_base_to_end
    assert PoseDifference.between(located, cold).distance_m < 1e-12


def test_paper_millimetres_in_one_direction_and_linear_in_the_melts_temperature(network, drawing):
    """Ten poses at 10 degrees of tilt, as in the paper: about 3 mm, downwards in all, straight over temperature."""
    poses = [PlatformPose(pose.position_m, np.radians(10.0)) for pose in random_poses(10, seed=1)]
    melts = np.linspace(600.0, 1700.0, 5)
    moves = np.array(
        [
            [
                WarmRobot(drawing, ThermalExpansion.from_field(network.steady(pose, melt)), pose)
                .solve()
                .pose_base_to_end.translation
                - np.array(pose.position_m)
                for melt in melts
            ]
            for pose in poses
        ]
    )
    size = np.linalg.norm(moves[:, -1], axis=1)
    assert 1.5e-3 < size.mean() < 4.5e-3
    assert np.all(moves[:, -1, 2] < 0.0)
    assert np.all(moves[:, -1, 0] < 0.0)
    correlations = [np.corrcoef(melts, moves[k, :, axis])[0, 1] for k in range(len(poses)) for axis in (0, 2)]
    assert np.abs(correlations).min() > 0.98


def test_gradient_across_a_tube_against_a_boundary_value_solver():
    """First harmonic of the temperature: (rho T')' = T / rho, flux outside, nothing lost inside."""
    conductivity, loss, outer, inner, flux = 60.0, 60.0, 0.048, 0.028, 20e3

    def slope(r, y):
        return np.vstack([y[1], y[0] / r**2 - y[1] / r])

    def ends(a, b):
        return np.array([a[1], conductivity * b[1] + loss * b[0] - flux])

    grid = np.linspace(inner, outer, 100)
    solution = solve_bvp(slope, ends, grid, np.ones((2, 100)), tol=1e-9)
    r = np.linspace(inner, outer, 4001)
    moment = np.trapezoid(solution.sol(r)[0] * r**2, r) * 4.0 / (outer**4 - inner**4)
    found = gradient_across_tube(flux, conductivity, np.array(loss), np.array(outer), np.array(inner))
    assert found == pytest.approx(moment, rel=1e-6)
    solid = gradient_across_tube(flux, conductivity, np.array(loss), np.array(0.02), np.array(0.0))
    assert solid == pytest.approx(flux / (conductivity + loss * 0.02))
    # The same tube as a leg: from its hot side to its cold one.
    leg = SimpleNamespace(
        bodies=SimpleNamespace(grid=SimpleNamespace(outer_m=np.array([outer]), inner_m=np.array([inner]))),
        gradient_K_per_m=np.tile([found, 0.0, 0.0], (4, 1, 1)),
        between_joints=np.ones((4, 1)),
    )
    difference = TemperatureField.leg_difference_K.fget(leg)
    assert difference == pytest.approx(np.full(4, 2.0 * solution.sol(outer)[0]), rel=1e-6)


def test_even_gradient_bends_a_leg_into_a_circle():
    """Of kappa l the ends, free to turn, take half each; the bow is kappa l²/8."""
    length, gradient = 0.8, 400.0
    weights = np.full((4, 40), length / 40)
    depth = np.tile(length * (np.arange(40) + 0.5) / 40, (4, 1))
    field = SimpleNamespace(
        between_joints=weights,
        exposure=SimpleNamespace(lengths_m=np.full(4, length), from_upper_joint_m=depth),
        properties=PROPERTIES,
        gradient_K_per_m=np.broadcast_to([gradient, 0.0, 0.0], (4, 40, 3)),
        leg_directions=np.broadcast_to([0.0, 0.0, -1.0], (4, 3)),
    )
    bending = LegBending.of(field)
    curvature = 1.2e-5 * gradient
    assert bending.bow_m == pytest.approx(curvature * length**2 / 8)
    # Hot in front: the bow goes to the front, so the lower end points back, which is a positive turn about y.
    assert bending.end_rotation_rad == pytest.approx(np.tile([0.0, curvature * length / 2, 0.0], (4, 1)))
    assert bending.tilt_drive_offset_rad == pytest.approx(curvature * length / 2)


@pytest.mark.parametrize(
    ("place", "tilt_mrad", "lip_mm"),
    [((-100, 20, -600, 17), -0.34, 0.23), ((-150, 50, -450, 60), -1.49, 0.40), ((-50, 50, -800, 45), -1.43, 0.34)],
)
def test_a_bent_leg_4_moves_the_ladle_as_the_closed_chain_lets_it(drawing, place, tilt_mrad, lip_mm):
    """Not as an arm that is turned by as much. The warm robot is closed with the tilt drive as far off, either way."""
    pose = PlatformPose.from_mm_deg(*place)
    heated_robot = HeatedRobot(drawing, HeatSection())
    found, expansion = PoseHeat.of(heated_robot, pose), heated_robot.locate(pose).robot.expansion
    told = found.figures()["bending"]
    # By a closure of another hand: 0.505, 0.889 and 0.711 mrad, 0.336, 0.242 and 0.168 mm per mrad of the drive.
    assert told["tilt_error_mrad"] == pytest.approx(tilt_mrad, abs=0.006)
    assert told["lip_mm"] == pytest.approx(lip_mm, abs=0.006)
    assert told["matters"] is False
    offset = found.bending.tilt_drive_offset_rad
    off = {"leg4_s5": DriveOffset(offset_mrad=1e3 * offset)}, {"leg4_s5": DriveOffset(offset_mrad=-1e3 * offset)}
    models = (drawing.model.model_copy(update={"drive_offsets": one}) for one in off)
    one, other = (WarmRobot(drawing.built_as(model), expansion, pose).solve() for model in models)
    lips = [closed.pose("fixed_platform", "ladle_lip") for closed in (one, other)]
    moved = PoseDifference.between(lips[1], lips[0])
    assert found.bending_tilt_rad == pytest.approx(moved.rotation_rad[1] / 2.0, rel=1e-5)
    assert found.bending_lip_m == pytest.approx(moved.distance_m / 2.0, rel=1e-4)
    assert replace(found, accuracy_m=9.9 * found.bending_lip_m).bending_matters


def test_legs_bend_outwards_over_the_melt(network):
    field = network.steady(PlatformPose((-0.1, 0.0, -0.6), 0.0))
    assert np.all(field.leg_difference_K > 5.0)
    # The chord is shorter than the arc by κ² l³/24 = (8/3) bow²/l, which is why the network leaves it out.
    bow = LegBending.of(field).bow_m
    assert np.all(8.0 / 3.0 * bow**2 / field.exposure.lengths_m < 1e-6)
    # The hot side looks at the melt, between the legs in y.
    middle = field.gradient_K_per_m[:, 4]
    assert np.all(middle[[0, 2], 1] < 0.0)
    assert np.all(middle[[1, 3], 1] > 0.0)


@pytest.mark.parametrize("given", [{"leg_strain": (1e-3,) * 3}, {"leg_strain": 1e-3}, {"platform_strain": np.nan}])
def test_what_is_no_strain_of_each_part_is_refused(given):
    with pytest.raises(BadInputError, match="finite growths per length: four of the legs, one of each platform"):
        ThermalExpansion(**given)
    assert ThermalExpansion(np.full(4, 1e-3)) == ThermalExpansion((1e-3,) * 4)
