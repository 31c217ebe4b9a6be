"""Closing the loops: against an independent formulation, against itself in other orders, and its failures."""

import itertools

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pouring_robot.exceptions import BadInputError, ClosureError, UnknownFrameError, UnknownJointError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from tests.support import (
    CHAINS,
    carried_by,
    circle_meeting,
    displaced,
    displacement,
    oracle_cases,
    perturbed,
    planar_urdf,
    pose_gap,
    random_poses,
)

ROUND_TRIPS = 1000


def start_and_drives(robot, pose):
    return robot.kinematics.configuration(pose), robot.kinematics.inverse(pose)


# --- the independent oracle -------------------------------------------------------------------------


def oracle_mechanism(drawing, case):
    """Return the oracle's robot (displaced U-joint centres) and its true drive values."""
    placements = {}
    for k, i in enumerate(CHAINS):
        placements[f"leg{i}_s1"] = displacement(case["fixed_joint_centre_offsets_m"][k])
        placements[f"leg{i}_seat_mount"] = displacement(case["moving_joint_centre_offsets_m"][k])
    mechanism = perturbed(drawing.nominal_solver.mechanism, placements)
    growth = 1.0 + case["expansion_per_K"] * np.array(case["leg_temperature_rise_K"][:3])
    lengths = np.add(case["drives"]["leg_lengths_m"], case["drive_offsets"]["leg_lengths_m"]) * growth
    tilt_drive = case["drives"]["tilt_drive_rad"] + case["drive_offsets"]["tilt_drive_rad"]
    return mechanism, dict(zip(mechanism.loops.drives, [*lengths, tilt_drive], strict=True))


def test_agrees_with_all_60_oracle_poses(drawing):
    cases = oracle_cases()
    assert len(cases) == 60
    gaps = []
    for case in cases:
        commanded = PlatformPose(tuple(case["commanded"]["position_m"]), case["commanded"]["tilt_rad"])
        start, nominal_drives = start_and_drives(drawing, commanded)
        lengths = case["drives"]["leg_lengths_m"]
        assert list(nominal_drives.values())[:3] == pytest.approx(lengths, abs=1e-12)
        mechanism, drives = oracle_mechanism(drawing, case)
        pose = ClosureSolver(mechanism).solve(drives, start).pose_base_to_end
        expected = case["platform"]
        rotation = Rotation.from_rotvec(expected["rotation_vector_rad"]).as_matrix()
        gaps.append(pose_gap(pose, pin.SE3(rotation, np.array(expected["position_m"]))))
    assert np.max(gaps, axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)


# --- another formulation: plain numpy kinematics of the URDF, scipy's least squares -------------------


class PlainRobot:
    """The four chains read from the URDF text, moved by homogeneous matrices, without Pinocchio."""

    def __init__(self, urdf):
        self.joints = {joint.get("name"): joint for joint in etree.fromstring(urdf.encode()).iterfind("joint")}

    def origin(self, name):
        origin = self.joints[name].find("origin")
        matrix = np.eye(4)
        matrix[:3, 3] = [float(v) for v in origin.get("xyz", "0 0 0").split()]
        rpy = [float(v) for v in origin.get("rpy", "0 0 0").split()]
        matrix[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        return matrix

    def foot(self, chain, values):
        matrix = np.eye(4)
        for number, value in enumerate(values, start=1):
            name = f"leg{chain}_s{number}"
            axis = np.array([float(v) for v in self.joints[name].find("axis").get("xyz").split()])
            motion = np.eye(4)
            if self.joints[name].get("type") == "prismatic":
                motion[:3, 3] = axis * value
            else:
                motion[:3, :3] = Rotation.from_rotvec(axis * value).as_matrix()
            matrix = matrix @ self.origin(name) @ motion
        return matrix


def log_of(matrix):
    """Return the se(3) logarithm, by the closed form of the left Jacobian's inverse."""
    turn = Rotation.from_matrix(matrix[:3, :3]).as_rotvec()
    angle = np.linalg.norm(turn)
    cross = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    factor = 1 / 12 + angle**2 / 720 if angle < 1e-2 else (1 - angle / 2 / np.tan(angle / 2)) / angle**2
    inverse = np.eye(3) - cross / 2 + factor * cross @ cross
    return np.concatenate([inverse @ matrix[:3, 3], turn])


def platform_by_scipy(urdf, drives, pose, start_values, stiffness):
    """Minimise the sum of half e^T K e over the passive joints and the platform; return the platform's matrix."""
    robot = PlainRobot(urdf)
    names = [f"leg{i}_s{j}" for i in CHAINS for j in range(1, 6)]
    passive = [name for name in names if name not in drives]
    scale = np.sqrt(np.repeat(stiffness, 3))

    def platform(unknowns):
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_rotvec(unknowns[3:6]).as_matrix()
        matrix[:3, 3] = unknowns[:3]
        return matrix

    def residual(unknowns):
        values = dict(zip(passive, unknowns[6:], strict=True)) | drives
        moving = platform(unknowns)
        parts = []
        for i in CHAINS:
            foot = robot.foot(i, [values[f"leg{i}_s{j}"] for j in range(1, 6)])
            parts.append(scale * log_of(np.linalg.inv(foot) @ moving @ robot.origin(f"leg{i}_seat_mount")))
        return np.concatenate(parts)

    start = [*pose.position_m, 0.0, pose.tilt_rad, 0.0, *(start_values[name] for name in passive)]
    found = least_squares(residual, start, jac="3-point", method="trf", xtol=1e-15, ftol=1e-15, gtol=1e-13)
    return platform(found.x), found.cost


@pytest.mark.parametrize("seed", [0, 1])
def test_agrees_with_plain_kinematics_and_scipy_when_the_loops_stay_open(very_crooked, seed):
    (pose,) = random_poses(1, seed=100 + seed)
    location = very_crooked.locate(pose)
    mechanism = location.actual.mechanism
    matrix, energy = platform_by_scipy(
        mechanism.urdf,
        location.drives,
        pose,
        location.nominal.joint_values,
        mechanism.loops.stiffness_si,
    )
    assert location.actual.gap_rad > 1e-3
    assert location.actual.energy == pytest.approx(energy, rel=1e-9)
    assert pose_gap(location.actual.pose_base_to_end, pin.SE3(matrix)) == pytest.approx([0.0, 0.0], abs=2e-8)


# --- all chains are equivalent --------------------------------------------------------------------------


# Each chain carries the platform, the others follow in one order and its reverse: a description takes a second.
ORDERS = [
    order for order in itertools.permutations(CHAINS) if sorted(order[1:]) in (list(order[1:]), list(order[:0:-1]))
]


@pytest.mark.parametrize("order", ORDERS, ids=lambda order: "".join(map(str, order)))
def test_the_carrying_chain_and_the_order_of_the_chains_do_not_matter(as_built, crooked, order):
    for robot in (as_built, crooked):
        solver = ClosureSolver(carried_by(robot.model, order)[1])
        for pose in random_poses(5, seed=3):
            location = robot.locate(pose)
            start = solver.mechanism.with_joint_values(
                solver.mechanism.neutral_configuration(), location.nominal.joint_values
            )
            found = solver.solve(location.drives, start)
            gap = pose_gap(found.pose_base_to_end, location.actual.pose_base_to_end)
            assert gap == pytest.approx([0.0, 0.0], abs=1e-10)
            assert found.joint_values == pytest.approx(location.actual.joint_values, abs=1e-10)
            assert found.energy == pytest.approx(location.actual.energy, rel=1e-9)


@pytest.mark.parametrize("order", [(3, 1, 0, 2), (1, 0, 3, 2), (3, 2, 1, 0)])
def test_the_order_of_the_loops_does_not_matter(crooked, order):
    loops = crooked.model.definition.loops
    permuted = loops.model_copy(update={"loops": tuple(loops.loops[k] for k in order)})
    solver = ClosureSolver(ClosedChainMechanism(crooked.model.urdf(), permuted))
    for pose in random_poses(10, seed=4):
        location = crooked.locate(pose)
        found = solver.solve(location.drives, location.nominal.configuration)
        gap = pose_gap(found.pose_base_to_end, location.actual.pose_base_to_end)
        assert gap == pytest.approx([0.0, 0.0], abs=1e-10)
        assert found.residual == pytest.approx(location.actual.residual[list(order)], abs=1e-10)


def test_the_position_of_the_truss_does_not_matter(crooked):
    (pose,) = random_poses(1, seed=5)
    location = crooked.locate(pose)
    travels = {"truss_travel": 4.3, "trolley_travel": -0.6}
    moved = crooked.actual_solver.mechanism.with_joint_values(location.nominal.configuration, travels)
    found = crooked.actual_solver.solve(location.drives, moved)
    gap = pose_gap(found.pose_base_to_end, location.actual.pose_base_to_end)
    assert gap == pytest.approx([0.0, 0.0], abs=1e-10)
    assert found.joint_values["truss_travel"] == 4.3
    shift = found.pose("universe", "fixed_platform").translation
    shift -= location.actual.pose("universe", "fixed_platform").translation
    assert shift == pytest.approx([-0.6, 4.3, 0.0], abs=1e-12)


# --- round trips --------------------------------------------------------------------------------------


def test_inverse_then_closure_returns_every_pose_of_the_box(drawing):
    solver = drawing.nominal_solver
    worst = [0.0, 0.0]
    for pose in random_poses(ROUND_TRIPS, seed=6):
        start, drives = start_and_drives(drawing, pose)
        gap = pose_gap(solver.solve(drives, start).pose_base_to_end, pose.to_se3())
        worst = np.maximum(worst, gap)
    assert worst == pytest.approx([0.0, 0.0], abs=1e-10)


def test_every_pose_is_found_again_from_20_mm_and_50_mrad_away(drawing):
    random = np.random.default_rng(8)
    solver = drawing.nominal_solver
    worst, most = [0.0, 0.0], 0
    for pose in random_poses(ROUND_TRIPS, seed=7):
        start = drawing.kinematics.configuration(displaced(pose, random))
        found = solver.solve(drawing.kinematics.inverse(pose), start)
        worst = np.maximum(worst, pose_gap(found.pose_base_to_end, pose.to_se3()))
        most = max(most, found.iterations)
    assert worst == pytest.approx([0.0, 0.0], abs=1e-10)
    assert most <= 20


def test_the_robot_as_built_is_found_from_far_as_from_near(crooked):
    random = np.random.default_rng(9)
    solver = crooked.actual_solver
    for pose in random_poses(300, seed=10):
        start, drives = start_and_drives(crooked, pose)
        near = solver.solve(drives, start)
        far = solver.solve(drives, crooked.kinematics.configuration(displaced(pose, random)))
        gap = pose_gap(near.pose_base_to_end, far.pose_base_to_end)
        assert gap == pytest.approx([0.0, 0.0], abs=1e-10)


# --- over-constraint ------------------------------------------------------------------------------------


def test_two_equations_are_redundant_unless_an_axis_is_off(drawing, crooked):
    for pose in random_poses(20, seed=12):
        location = crooked.locate(pose)
        assert (location.nominal.rank, location.nominal.freedoms) == (22, 4)
        assert location.actual.rank == 24
        assert location.nominal.gap_m < 1e-12
        assert location.nominal.gap_rad < 1e-12
        assert location.actual.gap_rad > 1e-4


def test_centre_and_length_errors_close_exactly(drawing):
    placements = {f"leg{i}_s1": displacement((0.002, -0.001 * i, 0.0015)) for i in CHAINS}
    placements["leg3_s3"] = displacement((0.0, 0.0, 0.003))
    solver = ClosureSolver(perturbed(drawing.nominal_solver.mechanism, placements))
    for pose in random_poses(20, seed=13):
        start, drives = start_and_drives(drawing, pose)
        found = solver.solve(drives, start)
        assert max(found.gap_m, found.gap_rad) < 1e-12
        # Distances between the displaced centres are what the drives command, whatever else the closure does.
        for i in (1, 2):
            span = found.pose(f"leg{i}_s1", f"leg{i}_seat").translation
            assert np.linalg.norm(span) == pytest.approx(drives[f"leg{i}_s3"], abs=1e-12)
        span = np.linalg.norm(found.pose("leg3_s1", "leg3_seat").translation)
        # The axis points down, so the rod's shift of 3 mm up along it shortens the leg by 3 mm.
        assert span == pytest.approx(drives["leg3_s3"] - 0.003, abs=1e-12)


def wrench_on_platform(result):
    """Return the sum of the loops' wrenches on the platform: force and moment at its origin, in its own axes."""
    total = np.zeros(6)
    for loop, residual, load in zip(result.mechanism.loops.loops, result.residual, result.internal_wrench, strict=True):
        seat_from_foot = result.pose(loop.frame_a, loop.frame_b)
        assert pin.log6(seat_from_foot).vector == pytest.approx(residual, abs=1e-14)
        total += result.pose("moving_platform", loop.frame_b).act(pin.Force(-load)).vector
    return total


def test_without_weight_the_chains_forces_on_the_platform_balance(very_crooked):
    for pose in random_poses(10, seed=14):
        actual = very_crooked.locate(pose).actual
        largest = np.abs(actual.internal_wrench).max()
        assert largest > 1.0  # N or Nm: the forces are not zero
        assert np.abs(wrench_on_platform(actual)).max() < 1e-7 * largest


def test_with_weight_the_chains_carry_platform_ladle_and_payload(very_crooked):
    payload, centre = 500.0, np.array([0.05, 0.01, -0.3])
    loads = Loads(
        gravity=True,
        payload_kg=payload,
        payload_centre_m=tuple(centre),
        drive_stiffness={"leg1_s3": 2e7, "leg3_s3": 2e7, "leg4_s5": 1e6},
    )
    solver = ClosureSolver(very_crooked.model.mechanism(), loads)
    # Masses and centres straight from the URDF: moving platform and ladle.
    links = {link.get("name"): link for link in etree.fromstring(solver.mechanism.urdf.encode()).iterfind("link")}
    for pose in random_poses(5, seed=15):
        start, drives = start_and_drives(very_crooked, pose)
        result = solver.solve(drives, start)
        rotation = result.pose_base_to_end.rotation
        down = rotation.T @ [0.0, 0.0, -GRAVITY_M_S2]
        weight = np.concatenate([payload * down, np.cross(centre, payload * down)])
        for name in ("moving_platform", "ladle"):
            inertial = links[name].find("inertial")
            mass = float(inertial.find("mass").get("value"))
            centre_here = np.array([float(v) for v in inertial.find("origin").get("xyz").split()])
            arm = result.pose("moving_platform", name).act(centre_here)
            weight += np.concatenate([mass * down, np.cross(arm, mass * down)])
        balance = wrench_on_platform(result) + weight
        assert np.abs(balance).max() < 1e-6 * np.abs(weight).max()
        assert np.linalg.norm(weight[:3]) > payload * GRAVITY_M_S2


def hanger(roof_height):
    """Return a weight of 300 kg that hangs on a rod of 20 kg, which a drive lowers from the roof."""
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    urdf = (
        '<robot name="hanger"><link name="hall"/><link name="roof"/><link name="hook"/><link name="eye"/>'
        f'<link name="rod"><inertial><mass value="20"/>{inertia}</inertial></link>'
        f'<link name="weight"><inertial><origin xyz="0 0 -0.2"/><mass value="300"/>{inertia}</inertial></link>'
        '<joint name="roof_mount" type="fixed"><parent link="hall"/><child link="roof"/>'
        f'<origin xyz="0 0 {roof_height}"/></joint>'
        '<joint name="lift" type="prismatic"><parent link="roof"/><child link="rod"/><axis xyz="0 0 -1"/>'
        '<limit lower="0" upper="3" effort="1" velocity="1"/></joint>'
        '<joint name="hook_mount" type="fixed"><parent link="rod"/><child link="hook"/></joint>'
        '<joint name="cut" type="fixed"><parent link="rod"/><child link="weight"/></joint>'
        '<joint name="eye_mount" type="fixed"><parent link="weight"/><child link="eye"/></joint></robot>'
    )
    loops = LoopsFile(
        base_frame="roof",
        cut_joints=("cut",),
        drives=("lift",),
        end_frame="weight",
        loops=({"name": "hang", "frame_a": "hook", "frame_b": "eye"},),
    )
    return ClosedChainMechanism(urdf, loops)


@pytest.mark.parametrize("roof_height", [10.0, 1.2, 0.0], ids=lambda height: f"roof at {height} m")
def test_a_hanging_body_stretches_drive_and_joint_by_force_over_stiffness(roof_height):
    """Whatever the datum of the potential energy: above, at, or below zero."""
    mechanism = hanger(roof_height)
    solver = ClosureSolver(mechanism, Loads(gravity=True, drive_stiffness={"lift": 4e6}))
    found = solver.solve({"lift": 1.0}, mechanism.neutral_configuration())
    stretch, gap = 320 * GRAVITY_M_S2 / 4e6, 300 * GRAVITY_M_S2 / 1e8
    assert found.joint_values["lift"] - 1.0 == pytest.approx(stretch, rel=1e-6)
    assert found.residual[0] == pytest.approx([0, 0, -gap, 0, 0, 0], abs=1e-6 * gap)
    assert found.pose_base_to_end.translation == pytest.approx([0, 0, -1.0 - stretch - gap], abs=1e-9)


def test_a_compliant_drive_does_not_deflect_without_load():
    mechanism = hanger(0.0)
    solver = ClosureSolver(mechanism, Loads(drive_stiffness={"lift": 4e6}))
    found = solver.solve({"lift": 1.0}, mechanism.neutral_configuration())
    assert found.joint_values["lift"] == pytest.approx(1.0, abs=1e-12)


def test_a_mechanism_that_is_closed_already_takes_two_steps_of_exactly_zero():
    """Links that turn about vertical axes: the weight does no work, and the start is already closed."""
    urdf = planar_urdf("flat", [("a", 0.0, [0.5, 0.5]), ("b", 0.5, [0.25, 0.25])]).replace("0 1 0", "0 0 1")
    loops = LoopsFile(drives=("a_j1",), loops=({"name": "tips", "frame_a": "a_tip", "frame_b": "b_tip"},))
    mechanism = ClosedChainMechanism(urdf, loops)
    result = ClosureSolver(mechanism, Loads(gravity=True)).solve({}, mechanism.neutral_configuration())
    assert (result.gap_m, result.gap_rad) == (0.0, 0.0)
    np.testing.assert_array_equal(result.configuration, mechanism.neutral_configuration())


def with_stiffness(mechanism, translation, rotation):
    """Return the mechanism with another stiffness of its loops (N/m, Nm/rad)."""
    values = {"translation": translation, "rotation": rotation}
    stiffness = mechanism.loops.stiffness
    changed = {name: getattr(stiffness, name).model_copy(update={"value": v}) for name, v in values.items()}
    loops = mechanism.loops.model_copy(update={"stiffness": stiffness.model_copy(update=changed)})
    return ClosedChainMechanism(mechanism.urdf, loops)


def test_drives_yield_by_virtual_work_over_stiffness(drawing):
    """Drive force = -dV/dq with V the weight's potential along the rigid motion, by central differences."""
    rigid = drawing.nominal_solver
    model = rigid.mechanism.copy_model()
    data = model.createData()
    pose = PlatformPose((-0.1, 0.02, -0.6), 0.3)
    start, drives = start_and_drives(drawing, pose)
    # Loops ten thousand times stiffer than shipped: the layout is weak sideways, and rigid motion is compared.
    stiff = with_stiffness(rigid.mechanism, 1e12, 1e9)
    loaded = ClosureSolver(stiff, Loads(gravity=True, drive_stiffness=dict.fromkeys(drives, 1e9)))
    yielded = loaded.solve(drives, start).joint_values

    def potential(name, change):
        found = rigid.solve(drives | {name: drives[name] + change}, start)
        return pin.computePotentialEnergy(model, data, found.configuration)

    for name in drives:
        force = -(potential(name, 1e-4) - potential(name, -1e-4)) / 2e-4
        assert abs(force) > 50.0  # N or Nm
        assert (yielded[name] - drives[name]) * 1e9 == pytest.approx(force, rel=1e-3)


def ladle_shifts(drawing, mechanisms, poses):
    """Return the ladle's displacement from the drawing, shape (poses, mechanisms, 3)."""
    solvers = [ClosureSolver(mechanism) for mechanism in mechanisms]
    shifts = []
    for pose in poses:
        location = drawing.locate(pose)
        nominal = location.nominal.pose("fixed_platform", "ladle").translation
        starts = (location.drives, location.nominal.configuration)
        shifts.append([s.solve(*starts).pose("fixed_platform", "ladle").translation - nominal for s in solvers])
    return np.array(shifts)


@pytest.mark.parametrize(("axis_mrad", "limit"), [(4.0, 3e-3), (0.4, 1e-3)])
def test_the_ladle_hardly_depends_on_the_ratio_of_stiffnesses(drawing, axis_mrad, limit):
    """sqrt(k_rot / k_trans) up to 0.1 m changes the displacement by less than the limit."""
    random = np.random.default_rng(21)
    shifts = []
    for _ in range(8):
        placements = {}
        for i in CHAINS:
            for joint, free in (("s1", (1, 0, 1)), ("s2", (0, 1, 1)), ("s4", (0, 1, 1)), ("seat_mount", (1, 0, 1))):
                turns = random.uniform(-axis_mrad, axis_mrad, size=3) * 1e-3 * free
                placements[f"leg{i}_{joint}"] = displacement(rotation_rad=turns)
        mechanism = perturbed(drawing.nominal_solver.mechanism, placements)
        ratios = [with_stiffness(mechanism, 1e8, 1e8 * length**2) for length in (0.0316, 0.02, 0.06, 0.1)]
        shifts.append(ladle_shifts(drawing, ratios, random_poses(6, seed=22)))
    lengths = np.linalg.norm(np.array(shifts), axis=-1)
    changes = np.linalg.norm(np.array(shifts) - np.array(shifts)[:, :, :1], axis=-1)
    # Root mean square over poses and robots: at single poses the displacements themselves may cancel.
    assert np.sqrt((changes**2).mean(axis=(0, 1)).max() / (lengths**2).mean()) < limit


@pytest.mark.parametrize("length_m", [0.01, 0.0316, 0.1])
def test_one_crooked_seat_closes_whatever_the_ratio_of_stiffnesses(drawing, length_m):
    placements = {"leg1_seat_mount": displacement(rotation_rad=(0.0, 0.0, 0.004))}
    mechanism = with_stiffness(perturbed(drawing.nominal_solver.mechanism, placements), 1e8, 1e8 * length_m**2)
    solver = ClosureSolver(mechanism)
    for pose in random_poses(60, seed=21):
        start, drives = start_and_drives(drawing, pose)
        assert solver.solve(drives, start).iterations < 60


# --- other mechanisms -------------------------------------------------------------------------------------


def test_four_bar_follows_its_closed_form():
    ground, crank, coupler, rocker = 1.0, 0.35, 0.9, 0.7
    urdf = planar_urdf("four_bar", [("a", 0.0, [crank, coupler]), ("b", ground, [rocker, 0.0])])
    loops = LoopsFile(
        drives=("a_j1",),
        end_frame="a_l2",
        loops=({"name": "pin", "frame_a": "a_tip", "frame_b": "b_tip", "type": "6d"},),
    )
    mechanism = ClosedChainMechanism(urdf, loops)
    solver = ClosureSolver(mechanism)
    start = mechanism.with_joint_values(mechanism.neutral_configuration(), {"a_j2": -0.9, "b_j1": -1.8, "b_j2": 0.9})
    for angle in np.linspace(-0.3, -6.4, 40):
        found = solver.solve({"a_j1": angle}, start)
        start = found.configuration
        # About y: a positive angle takes x to -z.
        knee = crank * np.array([np.cos(angle), -np.sin(angle)])
        tip = circle_meeting(knee, coupler, (ground, 0.0), rocker, side=+1)
        pose = found.pose("universe", "a_tip")
        assert pose.translation == pytest.approx([tip[0], 0.0, tip[1]], abs=1e-10)
        along = (tip - knee) / coupler
        assert pose.rotation[:, 0] == pytest.approx([along[0], 0.0, along[1]], abs=1e-10)
        # 6 equations, of which a planar loop needs 3: four joints - 3 = 1 freedom.
        assert (found.rank, found.freedoms) == (3, 1)


# --- results --------------------------------------------------------------------------------------------


def test_a_result_cannot_be_changed_afterwards(very_crooked):
    solver = very_crooked.actual_solver
    start, drives = start_and_drives(very_crooked, PlatformPose((-0.1, 0.0, -0.6), 0.2))
    given = solver.mechanism.with_joint_values(start, drives)
    found = solver.solve_from(given)
    for name in ("configuration", "residual", "internal_wrench", "jacobian", "commanded"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(found, name)[0] = 0.0
    # The caller's own arrays stay the caller's.
    held = found.commanded.copy()
    given += 1.0
    assert found.commanded.tolist() == held.tolist()
    again = solver.solve_from(found.commanded)
    assert again != found
    assert again.configuration.tolist() == found.configuration.tolist()
    forces, torques = found.internal_wrench[:, :3], found.internal_wrench[:, 3:]
    assert found.internal_force_n == pytest.approx(max(np.linalg.norm(force) for force in forces))
    assert found.internal_torque_nm == pytest.approx(max(np.linalg.norm(torque) for torque in torques))


# --- failures ----------------------------------------------------------------------------------------------


def test_legs_that_cannot_meet_name_the_loop_that_stays_open(drawing):
    start, drives = start_and_drives(drawing, PlatformPose((-0.1, 0.0, -0.6), 0.0))
    with pytest.raises(ClosureError, match=r"^the loops do not close: .* mm and .* mrad") as caught:
        drawing.nominal_solver.solve(drives | {"leg1_s3": 0.3, "leg2_s3": 0.3, "leg3_s3": 1.1}, start)
    error = caught.value
    assert error.exit_code == 3
    assert error.worst_loop in drawing.nominal_solver.mechanism.loops.names
    assert error.gap_m > 0.01 or error.gap_rad > 0.1
    assert "\n" not in str(error)


def test_parts_that_do_not_fit_are_distinguished_from_a_search_that_does_not_converge(very_crooked):
    pose = PlatformPose((-0.1, 0.0, -0.6), 0.2)
    start, drives = start_and_drives(very_crooked, pose)
    narrow = ClosureSolver(very_crooked.actual_solver.mechanism, options=ClosureOptions(max_gap_rad=1e-4))
    with pytest.raises(ClosureError, match="the parts do not fit together") as misfit:
        narrow.solve(drives, start)
    assert misfit.value.gap_rad == pytest.approx(very_crooked.locate(pose).actual.gap_rad, rel=1e-9)
    hasty = ClosureSolver(very_crooked.actual_solver.mechanism, options=ClosureOptions(max_iterations=1))
    with pytest.raises(ClosureError, match="do not settle after 1 iterations") as stopped:
        hasty.solve(drives, start_and_drives(very_crooked, PlatformPose((0.0, 0.0, -0.5), 0.1))[0])
    assert stopped.value.iterations == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.5j, np.complex128(0.5), object()])
def test_drive_and_start_must_be_numbers(drawing, value):
    start, drives = start_and_drives(drawing, PlatformPose((-0.1, 0.0, -0.6), 0.0))
    with pytest.raises(BadInputError, match=r"'leg2_s3'.*finite"):
        drawing.nominal_solver.solve(drives | {"leg2_s3": value}, start)
    start[5] = value if isinstance(value, float) else np.nan
    with pytest.raises(BadInputError, match="start configuration"):
        drawing.nominal_solver.solve(drives, start)


def test_unknown_names_are_refused(drawing):
    location = drawing.locate(PlatformPose((-0.1, 0.0, -0.6), 0.0))
    with pytest.raises(UnknownJointError, match="did you mean 'leg1_s3'"):
        drawing.nominal_solver.solve({"leg1_s33": 0.5}, location.nominal.configuration)
    with pytest.raises(UnknownFrameError, match="did you mean 'ladle_lip'"):
        location.nominal.pose("fixed_platform", "ladle_lips")
    with pytest.raises(BadInputError, match="freedoms"):
        drawing.nominal_solver.solve({"moving_platform_mount": 0.5}, location.nominal.configuration)


def test_a_mechanism_without_end_frame_has_no_end_pose(drawing):
    loops = drawing.model.definition.loops.model_copy(update={"end_frame": None})
    solver = ClosureSolver(ClosedChainMechanism(drawing.model.urdf(), loops))
    start, drives = start_and_drives(drawing, PlatformPose((-0.1, 0.0, -0.6), 0.0))
    with pytest.raises(BadInputError, match="no end_frame"):
        _ = solver.solve(drives, start).pose_base_to_end
