"""Plans: the exchange against brute force, indices by hand, expected spread against simulated fits, and bad input."""

from __future__ import annotations

import functools
import itertools
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pouring_robot.campaign.plan import read_plan
from pouring_robot.campaign.simulate import simulate_campaign
from pouring_robot.cli.app import main
from pouring_robot.design.exchange import CandidateSet, choose, log_determinants
from pouring_robot.design.information import covariance, informative_parameters, projected_singular_values
from pouring_robot.design.plan_rows import Columns, PlannedConditions, candidate_poses
from pouring_robot.design.planning import Comparison, Planner, compare_with_random, random_visits
from pouring_robot.design.request import PlanRequest, expected_size, planned_parameters
from pouring_robot.design.result import UndeterminedError, plot
from pouring_robot.estimation.identifiability import (
    CRITERIA,
    base_parameters,
    index_slopes,
    observability,
    observability_index,
)
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.exceptions import BadInputError, OutputError
from pouring_robot.io.quantity_columns import Quantity
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.robot.description.command import CommandAxis, command_box
from pouring_robot.robot.description.drive import Drive
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.tolerances import Tolerances
from tests.effects.test_bearings import GRAVITY, MILL, RAM_KG, TABLE_KG
from tests.support import gantry_file

SMALL = {"candidates": 300, "starts": 2}


def plain(rows, nuisance=0, prior=None):
    """Return candidates of one kind, each its own pose."""
    prior = np.zeros(rows.shape[2]) if prior is None else prior
    return CandidateSet(rows, nuisance, np.arange(len(rows)), np.zeros(len(rows), dtype=int), prior)


@pytest.fixture(scope="module")
def robot():
    return PouringRobot()


@pytest.fixture(scope="module")
def planner(robot):
    return Planner(robot, PlanRequest(**SMALL))


@pytest.fixture(scope="module")
def plan(planner):
    return planner.plan()


@pytest.fixture(scope="module")
def visited(robot):
    request = PlanRequest(
        poses=20, parameters=("drives",), both_sides=4, loads_kg=(0.0, 500.0), drive_degC=(20.0, 120.0), **SMALL
    )
    return Planner(robot, request).plan()


# --- indices -----------------------------------------------------------------------------------------


def test_indices_by_hand():
    values = np.array([4.0, 2.0, 1.0])
    hand = {"O1": 8.0 ** (1 / 3) / 3.0, "O2": 0.25, "O3": 1.0, "O4": 0.25, "O5": 1.0 / 1.75}
    for name, value in hand.items():
        assert observability_index(values, name, 9) == pytest.approx(value, rel=1e-14)
    assert observability_index(values, "D", 9) == observability_index(values, "O1", 9)
    assert observability(values, 9) == pytest.approx(hand)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_undetermined_combinations_do_not_count(criterion):
    assert observability_index(np.array([2.0, 0.0]), criterion, 3) == 0.0


@pytest.mark.parametrize("criterion", CRITERIA)
def test_slopes_are_derivatives(criterion):
    values, step = np.array([5.0, 3.0, 1.5, 0.7]), 1e-6
    for k, slope in enumerate(index_slopes(values, criterion, 6)):
        ahead, behind = (np.sqrt(values**2 + sign * step * (np.arange(4) == k)) for sign in (1.0, -1.0))
        up, down = (observability_index(v, criterion, 6) for v in (ahead, behind))
        assert slope == pytest.approx((up - down) / (2.0 * step), rel=1e-6, abs=1e-9)


def test_projected_singular_values_are_those_of_the_residual_columns():
    rows = np.random.default_rng(1).normal(size=(30, 7))
    frames, own = rows[:, :3], rows[:, 3:]
    left = own - frames @ np.linalg.lstsq(frames, own, rcond=None)[0]
    assert projected_singular_values(rows, 3) == pytest.approx(np.linalg.svd(left, compute_uv=False), rel=1e-12)


def test_prior_counts_as_a_measurement():
    random = np.random.default_rng(2)
    rows, prior = random.normal(size=(4, 5)), np.array([0.0, 0.0, 2.0, 3.0, 4.0])
    information = rows.T @ rows + np.diag(prior**2)
    assert covariance(rows, prior) == pytest.approx(np.linalg.inv(information), rel=1e-9)
    schur = np.linalg.inv(np.linalg.inv(information)[2:, 2:])
    values = projected_singular_values(rows, 2, prior)
    assert values == pytest.approx(np.sqrt(np.linalg.eigvalsh(schur))[::-1], rel=1e-9)


def test_covariance_keeps_digits_that_normal_equations_lose():
    rows = np.array([[1.0, 1.0], [0.0, 1e-9], [1.0, 1.0]])
    assert covariance(rows)[1, 1] == pytest.approx(1e18, rel=1e-6)


def test_the_choice_of_independent_columns_keeps_the_first_of_equals_and_drops_small_ones():
    rows = np.random.default_rng(3).normal(size=(50, 5))
    rows[:, 2] = 2.0 * rows[:, 1] + 3.0 * rows[:, 0]  # a frame column and an earlier parameter
    rows[:, 4] *= 1e-3
    assert informative_parameters(rows, 1, np.ones(4)) == [0, 2]
    assert informative_parameters(rows, 1, np.array([1.0, 1.0, 1.0, 1e4])) == [0, 2, 3]


# --- exchange ----------------------------------------------------------------------------------------


def test_log_determinants():
    half = np.random.default_rng(4).normal(size=(9, 6, 3))
    blocks = half @ np.swapaxes(half, 1, 2)
    expected = np.linalg.slogdet(np.eye(6) + blocks)[1]
    assert log_determinants(np.moveaxis(blocks, 0, -1)) == pytest.approx(expected, rel=1e-12)


def drawn_rows(seed):
    return np.random.default_rng([5, seed]).normal(size=(12, 2, 5)) * np.array([1.0, 10.0, 0.1, 1.0, 3.0])


@functools.cache
def of_all_plans(seed, nuisance, poses):
    """Return the singular values of every plan of some poses: all criteria follow from them."""
    rows = drawn_rows(seed)
    stacks = (rows[list(chosen)].reshape(-1, 5) for chosen in itertools.combinations(range(len(rows)), poses))
    return [projected_singular_values(stack, nuisance) for stack in stacks]


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("nuisance", [0, 2])
def test_exchange_reaches_the_best_of_all_plans(criterion, nuisance):
    for seed in range(3):
        rows = drawn_rows(seed)
        chosen = choose(plain(rows, nuisance), [0] * 5, criterion, seed=seed, starts=30)
        assert len(set(chosen.tolist())) == 5
        stack = rows[chosen].reshape(-1, 5)
        value = observability_index(projected_singular_values(stack, nuisance), criterion, 5)
        best = max(observability_index(one, criterion, 5) for one in of_all_plans(seed, nuisance, 5))
        assert value == pytest.approx(best, rel=1e-12)


def test_d_optimal_line_is_measured_at_its_ends():
    # Classical: a straight line is best determined by its two ends, with half of the measurements at each.
    at = np.repeat(np.linspace(-1.0, 1.0, 11), 5)
    rows = np.stack([np.ones_like(at), at], axis=1)[:, None, :]
    chosen = choose(plain(rows), [0] * 10)
    assert sorted(at[chosen]) == [-1.0] * 5 + [1.0] * 5


def test_exchange_does_not_depend_on_units():
    rows = np.random.default_rng(6).normal(size=(60, 3, 6))
    scaled = rows * np.array([1e-6, 1e5, 1.0, 1e3, 1e-2, 1e8])
    plans = [choose(plain(r, 2), [0] * 8, seed=1) for r in (rows, scaled)]
    assert set(plans[0].tolist()) == set(plans[1].tolist())


def test_kinds_fill_their_slots_and_exchange_positions():
    random = np.random.default_rng(7)
    once = random.normal(size=(8, 4, 3))
    twice = once.copy()
    once[:, 2:] = 0.0
    place, kind = np.tile(np.arange(8), 2), np.repeat([0, 1], 8)
    candidates = CandidateSet(np.concatenate([once, twice]), 0, place, kind, np.zeros(3))
    chosen = choose(candidates, [1, 1, 0, 0], starts=8)
    assert kind[chosen].tolist() == [1, 1, 0, 0]
    assert len(set(place[chosen].tolist())) == 4

    def value(both, one):
        stack = np.concatenate([*twice[list(both)], *once[list(one)]])
        return observability_index(projected_singular_values(stack, 0), "D", 4)

    best = max(
        value(both, one)
        for both in itertools.combinations(range(8), 2)
        for one in itertools.combinations(sorted(set(range(8)) - set(both)), 2)
    )
    assert value(place[chosen[:2]], place[chosen[2:]]) == pytest.approx(best, rel=1e-12)


def test_where_frames_absorb_all_parameters_asked_for_others_are_named(tmp_path):
    """For three slides at right angles, zeros and placements of joints are equivalent to frames."""
    robot = Robot.load(gantry_file(tmp_path))
    with pytest.raises(BadInputError, match=r"\(drive.x_slide, .* …\): they .* the frames .*--parameters geometry"):
        Planner(robot, PlanRequest(reduce=True))
    assert Planner(robot, PlanRequest(parameters=("geometry",), reduce=True)).parameters


def test_noise_that_hides_all_parameters_is_not_blamed_on_the_frames(robot):
    """With tolerances of tenths of a millimetre a tracker of 30 mm shows nothing, and one of 0.05 mm shows 15."""
    with pytest.raises(BadInputError, match=r"20 poses show none .* above the noise.* less noise"):
        Planner(robot, PlanRequest(noise=NoiseLevel.stated(0.03, 0.03), poses=20, **SMALL))


def test_exchange_refuses_candidates_it_cannot_choose_from():
    rows = np.random.default_rng(8).normal(size=(4, 3, 2))
    with pytest.raises(BadInputError, match="more candidates"):
        choose(plain(rows), [0] * 5)
    rows[:, :, 1] = rows[:, :, 0]
    with pytest.raises(BadInputError, match="do not determine"):
        choose(plain(rows), [0] * 3)


# --- the robot ---------------------------------------------------------------------------------------


def test_candidates_are_round_figures_inside_the_box(robot):
    poses = candidate_poses(robot.command_axes, 400)
    lower, upper = robot.layout.box
    assert np.all(poses >= lower - 1e-12) and np.all(poses <= upper + 1e-12)
    assert 390 <= len(np.unique(poses, axis=0)) == len(poses) <= 400
    shown = np.column_stack([poses[:, :3] * 1e4, np.degrees(poses[:, 3]) * 100.0])
    assert shown == pytest.approx(np.round(shown), abs=1e-6)


def test_figures_in_the_table_are_round_whatever_the_command_at_zero():
    drive = Drive("q", "q", "rad", "angle", factor=-2.0, zero=0.3)
    axes = (CommandAxis(Quantity("q", "angle"), -1.6, 1.9, drive), CommandAxis(Quantity("s", "length"), 0.1, 0.7))
    poses = candidate_poses(axes, 200)
    lower, upper = command_box(axes)
    assert np.all(poses >= lower - 1e-12) and np.all(poses <= upper + 1e-12)
    for axis, values in zip(axes, poses.T.tolist(), strict=True):
        assert [float(axis.text(value)) for value in values] == pytest.approx([axis.shown(value) for value in values])
    assert axes[1].text(-1e-5) == "0.0"


def test_a_plan_is_much_better_than_random_ones(planner, plan):
    comparison = compare_with_random(planner, plan, 50)
    assert (comparison.ratios <= 0.70).all()


@pytest.mark.parametrize("criterion", ["O2", "O3", "O4", "O5"])
def test_each_criterion_is_best_in_its_own_index(robot, planner, plan, criterion):
    request = PlanRequest(criterion=criterion, candidates=300, starts=1)
    own = Planner(robot, request).plan()
    assert own.value == pytest.approx(own.quality.indices[criterion], rel=1e-12)
    assert own.value >= plan.quality.indices[criterion]
    assert own.quality.indices["O1"] <= plan.quality.indices["O1"]


def test_same_seed_same_plan(robot, plan):
    again = Planner(robot, PlanRequest(**SMALL)).plan()
    assert again.csv() == plan.csv()
    assert again.quality.parameter_std == pytest.approx(plan.quality.parameter_std, rel=1e-12)


def test_expected_spread_is_that_of_simulated_fits(planner, plan):
    random = np.random.default_rng(9)
    rows, _ = planner.measured(planner.columns, plan.poses, [PlannedConditions()])
    frames = [k for k in range(12) if k != 7]  # the frames' shifts along y are confounded: see the module
    picked = rows[:, 0][..., [*frames, *range(12, rows.shape[-1])]].reshape(-1, rows.shape[-1] - 1)
    noise = random.normal(size=(len(picked), 4000))
    fitted = np.linalg.lstsq(picked, noise, rcond=None)[0]
    sizes = np.array([p.shown_in[1] for p in plan.parameters])
    spread = fitted.std(axis=1)[11:] * sizes
    assert spread == pytest.approx(plan.quality.parameter_std, rel=0.05)
    work = PlannedConditions(0)
    ladle, _ = planner.columns.ladle(plan.quality.ladle_poses[::97], work)
    moved = ladle[..., [*frames, *range(12, ladle.shape[-1])]] * np.r_[[1e-3] * 11, sizes] @ fitted
    assert moved.std(axis=-1) == pytest.approx(plan.quality.ladle_std[::97], rel=0.06)


def test_the_spread_is_proportional_to_the_noise(robot, plan):
    noisy = Planner(
        robot, PlanRequest(noise=NoiseLevel.stated(1e-4, 1e-4), parameters=tuple(p.name for p in plan.parameters))
    )
    quality = noisy.quality(plan.poses)
    assert quality.parameter_std == pytest.approx(2.0 * plan.quality.parameter_std, rel=1e-6)


def test_unit_of_names_and_columns(robot):
    """Local columns are differences of exact closures, without the frames."""
    planner = Planner(robot, PlanRequest(parameters=("drives",), **SMALL))
    poses = planner.poses[:3]
    rows, _ = planner.columns.measured(poses, [PlannedConditions()], NoiseLevel.stated(1.0, 1.0), np.zeros(3))
    command = robot.kinematics.commands(poses)
    engine = planner.columns._model.engine
    for k, parameter in enumerate(planner.parameters):
        moved = []
        for sign in (1.0, -1.0):
            drives = command.drives.copy()
            drives[:, [d.name for d in planner.columns.drives].index(parameter.name)] += sign * 1e-6
            moved.append(engine.close(drives, command.start).position)
        assert rows[:, 0, :3, 12 + k] == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-5)


def test_compliance_columns_are_those_of_compliant_drives_in_the_closure(robot):
    """With loops so stiff that they hardly open; their remaining deflection, that of a rigid drive, is subtracted."""
    planner = Planner(robot, PlanRequest(parameters=("drives",), loads_kg=(0.0, 100.0), **SMALL))
    pose, ladle, stiffness = planner.poses[[90]], robot.layout.ladle, 1e8
    conditions = PlannedConditions(1, 100.0 - ladle.tare.value)
    rows, _ = planner.columns.measured(pose, [conditions], NoiseLevel.stated(1.0, 1.0), np.zeros(3))
    command = robot.kinematics.commands(pose)
    drives = dict(zip([d.joint for d in planner.columns.drives], command.drives[0], strict=True))
    start = robot.kinematics.configuration(robot.kinematics.forward(drives))
    loops = robot.model.definition.loops
    translation, rotation = (
        q.model_copy(update={"value": q.value * 1e4}) for q in (loops.stiffness.translation, loops.stiffness.rotation)
    )
    stiff = loops.stiffness.model_copy(update={"translation": translation, "rotation": rotation})
    mechanism = ClosedChainMechanism(robot.model.urdf(), loops.model_copy(update={"stiffness": stiff}))

    def loaded_shift(drive_stiffness):
        places = []
        for mass in (0.0, 100.0):
            loads = Loads(True, mass, "moving_platform", ladle.centre_of_mass.metres, drive_stiffness)
            closed = ClosureSolver(mechanism, loads).solve(drives, start)
            places.append(closed.pose("fixed_platform", "moving_platform").translation)
        return places[1] - places[0]

    rigid = loaded_shift({})
    seen = 0
    for k, parameter in enumerate(planner.parameters):
        if parameter.kind == "compliance":
            bent = stiffness * (loaded_shift({parameter.local.joint: stiffness}) - rigid)
            assert rows[0, 0, :3, 12 + k] == pytest.approx(bent, abs=0.01 * np.abs(bent).max())
            seen += 1
    assert seen == 4


@pytest.mark.parametrize(("base", "end"), [("table", "tool"), ("bed", "table")])
def test_compliance_columns_of_another_robot_are_those_of_its_weight_where_it_acts(tmp_path, base, end):
    """A mill in closed form: its links have mass, and the payload hangs at its own frame, on the ram, not the table."""
    load, centre, hook, target = 50.0, np.array([0.0, 0.1, -0.2]), np.array([0.3, 0.25, 0.1]), np.array([0.1, 0.2, 0.3])
    mount = f'<joint name="hang" type="fixed"><parent link="{end}"/><child link="hook"/><origin xyz="0.3 0.25 0.1"/>'
    urdf = MILL.replace("</robot>", f'<link name="hook"/>{mount}</joint></robot>')
    (tmp_path / "mill.urdf").write_text(urdf, encoding="utf-8")
    names = ("ram", "tilt") if end == "tool" else ("tilt",)
    said = f"name: mill\nurdf: mill.urdf\nbase_frame: {base}\nend_frame: {end}\npayload_frame: hook\n"
    drives = ", ".join(f"{{joint: {name}}}" for name in names)
    text = f"format: pouring_robot/robot/1\n{said}drives: [{drives}]\nusual_moment_nm: 250\n"
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    planned = planned_parameters(robot, PlanRequest(loads_kg=(0.0, load)))
    columns = Columns(robot, planned)
    ram, tilt = 0.15, 0.7
    commands = np.array([[ram, tilt][-len(names) :]])
    rows, _ = columns.measured(commands, [PlannedConditions(1, load)], NoiseLevel.stated(1.0, 1.0), target)
    found = {p.name: rows[0, 0, :, 12 + k] for k, p in enumerate(planned)}
    turn, x = Rotation.from_euler("x", tilt).as_matrix(), np.array([1.0, 0.0, 0.0])

    def rise(place):
        return np.cross(x, turn @ place)[2]  # of a point on the table, by the tilt

    if end == "tool":
        seen = turn.T @ (np.array([0.4, 0.3, 0.2 + ram]) + target)  # from the trunnion, in axes of the table
        moment = -GRAVITY * TABLE_KG * rise(centre)
        expected = {
            "ram": np.r_[-GRAVITY * (RAM_KG + load) * turn.T[:, 2], np.zeros(3)],
            "tilt": -moment * np.r_[np.cross(x, seen), x],
        }
    else:
        moment = -GRAVITY * (TABLE_KG * rise(centre) + load * rise(hook))
        expected = {"tilt": moment * np.r_[np.cross(x, turn @ target), x]}
    for name in names:
        np.testing.assert_allclose(found[f"compliance.{name}"], expected[name], rtol=0, atol=1e-9)
    definition = robot.model.definition
    given = Tolerances.of(definition)
    sizes = {p.name: expected_size(p, definition, given) for p in planned if p.kind == "compliance"}
    usual = {"compliance.ram": 1e-3 / 1000.0, "compliance.tilt": 1e-3 / 250.0}  # 1 mm and 1 mrad at the usual load
    assert sizes == pytest.approx({name: usual[name] for name in sizes}) and len(sizes) == len(names)


def test_backlash_and_expansion_columns_follow_the_drives(robot):
    request = PlanRequest(parameters=("drives",), both_sides=2, drive_degC=(20.0, 70.0), **SMALL)
    planner = Planner(robot, request)
    poses = planner.poses[:4]
    visits = [PlannedConditions(1, 0.0, 20.0), PlannedConditions(-1, 0.0, 70.0)]
    rows, _ = planner.columns.measured(poses, visits, NoiseLevel.stated(1.0, 1.0), np.zeros(3))
    column = {p.name: rows[..., 12 + k] for k, p in enumerate(planner.parameters)}
    lengths = robot.kinematics.commands(poses).drives
    for k in (1, 2, 3):
        drive = column[f"drive.leg{k}_s3"]
        backlash, expansion = column[f"backlash.leg{k}_s3"], column[f"expansion.leg{k}_s3"]
        assert backlash[:, 0] == pytest.approx(-0.5 * drive[:, 0])
        assert backlash[:, 1] == pytest.approx(0.5 * drive[:, 1])
        assert not expansion[:, 0].any()
        assert expansion[:, 1] == pytest.approx(50.0 * lengths[:, [k - 1]] * drive[:, 1])


def test_legs_do_not_expand_at_the_temperature_of_the_drawing():
    """The properties of its heat state that temperature, and the expansion at another one follows from their steel."""
    heat = HeatSection(properties={"expansion": {"reference_temperature": 30.0}})
    robot = PouringRobot.without_warning(RobotModel(heat=heat))
    planner = Planner(robot, PlanRequest(parameters=("drives",), drive_degC=(30.0, 70.0), **SMALL))
    visits = [PlannedConditions(drive_degC=30.0), PlannedConditions(drive_degC=70.0)]
    rows, _ = planner.columns.measured(planner.poses[:4], visits, NoiseLevel.stated(1.0, 1.0), np.zeros(3))
    column = {p.name: rows[..., 12 + k] for k, p in enumerate(planner.parameters)}
    properties = heat.thermal_properties()
    growth = properties.strain(70.0) * robot.kinematics.commands(planner.poses[:4]).drives[:, :1]
    found = properties.steel.expansion.value * column["expansion.leg1_s3"]
    assert not found[:, 0].any()
    assert found[:, 1] == pytest.approx(growth * column["drive.leg1_s3"][:, 1])


def test_conditions_determine_their_parameters(visited):
    names = [p.name for p in visited.parameters]
    assert {"backlash.leg1_s3", "compliance.leg4_s5", "expansion.leg3_s3"} <= set(names)
    assert len(visited.poses) == 24
    assert sum(c.side < 0 for c in visited.conditions) == 4
    states = [(c.payload_kg, c.drive_degC) for c in visited.conditions]
    assert len({(*p, *s) for p, s in zip(visited.poses.tolist(), states, strict=True)}) == 20
    heat = [c.drive_degC for c in visited.conditions]
    assert heat == sorted(heat) and len(set(heat)) == 2
    assert len({c.payload_kg for c in visited.conditions}) == 2
    std = dict(zip(names, visited.quality.parameter_std, strict=True))
    assert std["expansion.leg1_s3"] < 2e-6 and std["backlash.leg1_s3"] < 1e-4


def test_a_pose_visited_from_both_sides_counts_once_in_every_figure(robot):
    planner = Planner(robot, PlanRequest(poses=12, both_sides=5, **SMALL))
    plan = planner.plan()
    again = planner.quality(plan.poses, plan.conditions)
    assert (len(plan.poses), again.poses) == (17, 12)
    assert again.indices == pytest.approx(plan.quality.indices, rel=1e-9)
    twice = planner.quality(np.tile(plan.poses, (2, 1)), plan.conditions * 2)  # twice the information
    assert twice.poses == 24 and twice.indices["O1"] == pytest.approx(plan.quality.indices["O1"], rel=1e-6)


def test_priors_determine_everything_and_no_plan_is_worse_than_they_are(robot):
    tolerances = Tolerances.load()
    request = PlanRequest(poses=6, parameters=("geometry",), priors=tolerances, candidates=200, starts=1)
    plan = Planner(robot, request).plan()
    assert not plan.left_out
    prior = tolerances.std([p.local for p in plan.parameters], robot.model.definition)
    assert np.all(plan.quality.parameter_std <= prior * (1.0 + 1e-9))
    assert np.any(plan.quality.parameter_std < 0.5 * prior)


def test_positions_alone_give_less_information(robot, plan):
    names = tuple(p.name for p in plan.parameters if p.name != "leg1_seat_mount.tz")
    qualities = [
        Planner(robot, PlanRequest(parameters=names, noise=noise, reduce=True, **SMALL)).plan().quality
        for noise in (NoiseLevel.stated(5e-5, 5e-5), NoiseLevel.stated(5e-5, None))
    ]
    assert qualities[1].ladle_rms_m > qualities[0].ladle_rms_m


# --- bad input ---------------------------------------------------------------------------------------


def test_undetermined_combinations_are_named(robot):
    with pytest.raises(UndeterminedError) as caught:
        Planner(robot, PlanRequest(parameters=("leg1_s1.ty", "leg1_seat_mount.ty", "leg4_s1.ty"), **SMALL))
    error = caught.value
    assert error.unseen == ("leg4_s1.ty",)
    assert "leg1_s1.ty + leg1_seat_mount.ty" in str(error) and "leg4_s1.ty (without effect)" in str(error)
    assert str(error).endswith("or let tolerances count as priors (--priors); more poses do not help")
    assert "leave out" in str(error) and "plan more poses" not in str(error)
    rest = {"leg1_s1.ty", "leg1_seat_mount.ty", "leg4_s1.ty"} - set(error.too_many)
    Planner(robot, PlanRequest(parameters=tuple(rest), **SMALL))


def test_with_only_frames_asked_for_no_parameter_is_to_be_left_out():
    found = base_parameters(np.diag([0.0, 1.0]), ["frame", "leg1_s1.ty"], lead=["frame"])
    error = UndeterminedError("a plan", found, {"frame"})
    assert error.too_many == () and "leave out" not in str(error) and "plan more poses" in str(error)


def test_too_few_poses_are_refused(robot):
    with pytest.raises(UndeterminedError, match="a plan of 2") as caught:
        Planner(robot, PlanRequest(poses=2, parameters=("drives",), **SMALL)).plan()
    assert "\n" not in str(caught.value) and "--reduce does so), or plan more poses" in str(caught.value)


def test_an_option_that_is_given_already_is_not_advised(robot):
    with pytest.raises(UndeterminedError, match="plan more poses") as caught:
        Planner(robot, PlanRequest(poses=5, reduce=True, **SMALL)).plan()
    assert "--reduce" not in str(caught.value)
    with pytest.raises(UndeterminedError, match=r"the frames of tracker and target; plan more poses$"):
        Planner(robot, PlanRequest(poses=1, priors=Tolerances.load(), **SMALL)).plan()


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"poses": 0}, "number of poses"),
        ({"poses": "12"}, "number of poses must be 1 to 500, not '12'"),
        ({"both_sides": 31}, "both sides"),
        ({"criterion": "E"}, "known: D, O1"),
        ({"loads_kg": (5.0, 5.0)}, "two different"),
        ({"drive_degC": (20.0, 1e5)}, "drive temperature"),
        ({"target_m": (0.0, 0.0, 1e3)}, "target"),
        ({"target_m": (0.0, 0.0)}, "three figures of at most 10 m"),
        ({"target_m": "lip"}, "three figures of at most 10 m"),
        ({"noise": 5e-5}, "a NoiseLevel, such as .* not a float"),
        ({"priors": "tolerances.yaml"}, "priors of a plan are Tolerances, such as Tolerances.load reads, not a str"),
        ({"loads_kg": 400.0}, "two different"),
        ({"loads_kg": ("a", "b")}, "a load in kg must be 0 to 10000, not"),
        ({"seed": -1}, "seed"),
    ],
)
def test_meaningless_figures_are_refused(figures, said):
    with pytest.raises(BadInputError, match=said):
        PlanRequest(**figures)


def test_figures_may_be_arrays_and_a_single_name_is_one_name():
    figures = {"loads_kg": np.array([0, 400]), "target_m": np.zeros(3), "parameters": "centres"}
    assert PlanRequest(**figures) == PlanRequest(loads_kg=(0.0, 400.0), parameters=("centres",))


def test_a_plan_is_of_a_request(robot):
    with pytest.raises(BadInputError, match="the request of a plan is a PlanRequest, not a dict"):
        Planner(robot, {"poses": 20})


def test_overload_is_refused(robot):
    with pytest.raises(BadInputError, match="at most 500 kg"):
        Planner(robot, PlanRequest(loads_kg=(0.0, 501.0), **SMALL))


def test_random_visits_have_the_same_effort(robot):
    planner = Planner(robot, PlanRequest(poses=9, parameters=("drives",), both_sides=3, loads_kg=(0, 100), **SMALL))
    poses, conditions = random_visits(planner, 1)
    assert len(poses) == len(conditions) == 12
    assert {c.payload_kg for c in conditions} <= {0, 100}


# --- files and command line --------------------------------------------------------------------------


def test_plan_file_is_what_simulate_reads(robot, visited, tmp_path):
    path = tmp_path / "plan.csv"
    visited.save(path)
    with pytest.raises(OutputError, match="exists already"):
        visited.save(path)
    read = read_plan(path, robot)
    got = np.array([[*p.position_m, p.tilt_rad] for p in read.poses])
    assert got == pytest.approx(visited.poses, abs=1e-12)
    assert read.conditions["approach_q1"].tolist() == [c.side for c in visited.conditions]
    assert read.conditions["payload"].tolist() == [c.payload_kg for c in visited.conditions]
    assert read.conditions["leg2"].tolist() == [c.drive_degC for c in visited.conditions]
    from_file, at_once = (simulate_campaign(robot, one).campaign for one in (read, visited.pose_plan))
    pd.testing.assert_frame_equal(from_file.to_frame(), at_once.to_frame())


def test_the_plot_shows_commands_as_in_the_table(visited, monkeypatch):
    drawn = []
    monkeypatch.setattr("pouring_robot.design.result.png_of", lambda figure: drawn.append(figure) or b"")
    drive = Drive("x", "x", "m", "length", factor=-2.0, zero=1.0)
    plot(replace(visited, axes=(replace(visited.axes[0], drive=drive), *visited.axes[1:])))
    across = np.concatenate([points.get_offsets()[:, 0] for points in drawn[0].axes[0].collections])
    told = (visited.poses[:, 0] - 1.0) / -2.0 * 1e3
    spread = 0.1 * np.ptp(told)  # poses at one position are drawn slightly apart
    assert told.min() - spread <= across.min() <= across.max() <= told.max() + spread


def test_plot_and_figures(robot, visited, tmp_path):
    assert len(plot(visited)) > 20_000
    assert repr(visited) == f"<MeasurementPlan: {visited.headline}>"
    assert visited.to_frame().x_mm.tolist() == [row["x_mm"] for row in visited.rows()]
    figures = json.loads(json.dumps(visited.figures(), allow_nan=False))
    assert figures["rows"] == len(figures["plan"]) == 24
    assert {p["unit"] for p in figures["parameters"]} >= {"mm", "mrad", "µm/kN", "mrad/kNm", "1e-6/K"}


def test_random_plans_that_determine_too_little_are_counted(tmp_path, capsys):
    """Four poses at two temperatures: a random plan may well have one of them only, and no expansion."""
    command = ["campaign", "plan", "--out", str(tmp_path / "plan.csv"), "--poses", "4"]
    command += ["--parameters", "drives", "--temperatures", "20", "120", "--candidates", "100", "--starts", "1"]
    assert main(command) == 0
    assert "of 25 random plans of as many poses cannot determine the parameters" in capsys.readouterr().out
    assert main([*command, "--json", "--overwrite"]) == 0
    compared = json.loads(capsys.readouterr().out)["random_plans"]
    assert 0 < compared["undetermined"] < 13
    assert compared["median_rms_mm"] > 0.0


def test_without_a_sufficient_random_plan_there_is_no_median():
    found = Comparison(np.ones(3), np.full((3, 3), np.inf)).figures()
    assert (found["undetermined"], found["median_rms_mm"], found["ratio_mrad"]) == (3, None, 0.0)


def test_command_line(tmp_path, capsys):
    out = tmp_path / "plan.csv"
    small = ["--candidates", "150", "--starts", "1", "--poses", "8", "--parameters", "drives"]
    assert main(["campaign", "plan", "--out", str(out), *small]) == 0
    printed = capsys.readouterr().out
    assert "pouring lip" in printed and "drive.leg1_s3" in printed
    assert len(out.read_text().splitlines()) == 9
    assert main(["campaign", "plan", "--out", str(out), "--json", "--overwrite", *small]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["random_plans"]["ratio_mm"] < 0.8
    measured = tmp_path / "measured.csv"
    assert main(["campaign", "simulate", "--plan", str(out), "--out", str(measured)]) == 0
    assert len(measured.read_text().splitlines()) == 9


def test_more_poses_than_candidates_ask_for_more_candidates(tmp_path, capsys):
    command = ["campaign", "plan", "--poses", "400", "--candidates", "100", "--out", str(tmp_path / "plan.csv")]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "400 candidate poses are needed, but only" in said and "give more candidates (--candidates) than 100" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["--sigma-mm", "-1"],
        ["--parameters", "drive.leg9"],
        ["--parameters", "geometry"],
        ["--criterion", "X"],
        ["--tolerances", "none.yaml"],
        ["--loads", "0", "9999"],
        ["--position-only", "--sigma-mrad", "3"],
    ],
)
def test_bad_input_is_reported_in_one_line(arguments, tmp_path, capsys):
    out = tmp_path / "plan.csv"
    assert main(["campaign", "plan", "--out", str(out), *arguments]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not out.exists()
