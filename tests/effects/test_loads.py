"""Effects of weight: forces by statics and by the independent machine, deflections by a compliant closure."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pouring_robot.effects.available import all_effects
from pouring_robot.effects.conditions import bare_conditions
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.robot.description.definition import RobotDefinition
from tests.effects.bench import (
    CENTRE_OF_MASS,
    CHANNELS,
    EFFECTS,
    GRAVITY,
    SIGMA_M,
    SIGMA_RAD,
    SPAN_M,
    TARE_KG,
    carried,
    soft_against_turning,
    stiff_drawing,
)
from tests.rig.machine import LOWER, UPPER
from tests.rig.true_values import true_values

TEXTBOOK = [("leg_compliance", "rod"), ("tilt_drive_compliance", "spring")]


def test_forces_are_those_of_the_independent_machine(bench):
    given, scene = bench.rows.conditions, bench.scene
    assert np.abs(given.weight_n - scene.weight).max() <= 1e-9
    assert np.abs(given.drive_force[:, :3] - scene.pull).max() <= 1e-6 * np.abs(scene.pull).max()
    assert np.abs(given.drive_force[:, 3] - scene.moment).max() <= 1e-6 * np.abs(scene.moment).max()


def test_forces_balance_the_ladle(bench):
    """Virtual work with the inverse kinematics, without the transfer matrix: Jᵀ f + weight = 0 for x, y, z, tilt.

    The rows of J are the changes of legs 1 to 3 and of θ46 = r − ψ4 with the platform's four freedoms.
    """
    given, scene = bench.rows.conditions, bench.scene
    position, quaternion = scene.poses.position, scene.poses.quaternion
    for k in range(len(scene)):
        r = 2.0 * np.arctan2(quaternion[k, 2], quaternion[k, 0])
        turn = np.array([[np.cos(r), 0.0, np.sin(r)], [0.0, 1.0, 0.0], [-np.sin(r), 0.0, np.cos(r)]])
        arms = LOWER @ turn.T
        legs = position[k] + arms - UPPER
        by_tilt = np.cross([0.0, 1.0, 0.0], arms)
        along = legs / np.linalg.norm(legs, axis=1)[:, None]
        j = np.zeros((4, 4))
        j[:3, :3], j[:3, 3] = along[:3], np.sum(along * by_tilt, axis=1)[:3]
        x, _, z = legs[3]
        lean = np.array([z, 0.0, -x]) / (x * x + z * z)  # derivative of ψ4 = atan2(−x, −z)
        j[3, :3], j[3, 3] = -lean, 1.0 - lean @ by_tilt[3]
        lever = np.cross([0.0, 1.0, 0.0], turn @ CENTRE_OF_MASS)[2]
        pulled_up = np.linalg.solve(j.T, -given.weight_n[k] * np.array([0.0, 0.0, 1.0, lever]))
        assert given.drive_force[k] == pytest.approx(pulled_up, rel=1e-6, abs=1e-3)


@pytest.fixture(scope="module")
def stiff_mechanism():
    return stiff_drawing()


@pytest.mark.parametrize("drive", range(4))
def test_deflections_are_those_of_a_closure_with_compliant_drives(bench, drawing, stiff_mechanism, drive):
    """One compliant drive and a mass of 300 kg in the total energy, against force over stiffness as a drive's change.

    The links' own weight, and the compliance of the joints, cancel in the differences.
    """
    row, mass, stiffness = 7, 300.0, 1e9 if drive < 3 else 1e8
    given, soft = bench.rows.conditions, {stiff_mechanism.loops.drives[drive]: stiffness}
    at = stiff_mechanism, drawing, bench.campaign.drives[row]

    def yielded(payload_kg):
        return carried(*at, payload_kg, soft).translation - carried(*at, payload_kg).translation

    force = given.drive_force[row, drive] * mass * GRAVITY / given.weight_n[row]
    found = (yielded(mass) - yielded(0.0)) / (force / stiffness)
    by_drive = bench.ordered(bench.rows.channel(CHANNELS[drive], bench.linear)).reshape(-1, 6)[row]
    expected = motion_of_platform(bench, row, by_drive)
    assert np.abs(found - expected).max() <= 3e-3 * np.abs(expected).max()


def motion_of_platform(bench, row, seen):
    """Return the motion of the platform's origin in the fixed platform from the seen motion of the target."""
    axes = bench.true_frames.T_tracker_base.rotation
    shift, turn = axes.T @ seen[:3] * SIGMA_M, axes.T @ seen[3:] * SIGMA_RAD
    rotation = bench.rows.conditions.rotation[row]
    return shift - np.cross(turn, rotation @ bench.true_frames.T_end_target.translation)


def test_gravity_is_the_standard_one():
    assert GRAVITY_M_S2 == 9.80665


@pytest.mark.parametrize(("effect", "form"), TEXTBOOK)
def test_compliance_has_the_stated_meaning(bench, effect, form):
    errors = bench.errors(effect, "a")
    ((name, (value, unit)),) = true_values(effect, "a", 1.0, bench.scene, errors).items()
    main = bench.form(effect, form).parameters[0]
    assert (main.name, main.unit, main.bounds) == (name, unit, (0.0, np.inf))
    assert bench.apart(bench.motion(errors), bench.valued(effect, form, {name: value})) <= 1e-6


def test_columns_span_those_of_the_textbook(bench):
    """In the rig's textbook a leg stretches with pull, and with pull times length: the two main forms together."""
    theirs = bench.textbook("leg_compliance")
    ours = np.hstack([bench.columns("leg_compliance", form, main=True) for form in ("rod", "nut")])
    assert bench.outside(theirs, ours) <= 1e-8
    assert bench.outside(ours, theirs) <= 1e-8
    moment = bench.columns("tilt_drive_compliance", "spring", main=True)
    assert bench.outside(bench.textbook("tilt_drive_compliance"), moment) <= 1e-8


@pytest.mark.parametrize(
    ("effect", "rig", "form", "most"),
    [
        ("leg_compliance", "b", "nut", 1e-6),
        ("leg_compliance", "c", "contact", 1e-6),
        ("tilt_drive_compliance", "b", "spring", 1e-3),  # a hyperbolic tangent against a cubic
        ("truss_deflection", "a", "moving_load", 1e-6),
        ("truss_deflection", "b", "even_load", 1e-6),
        ("truss_deflection", "c", "half_sine", 1e-6),
    ],
)
def test_forms_of_the_rig_are_within_a_form(bench, effect, rig, form, most):
    assert bench.outside(bench.motion(bench.errors(effect, rig)), bench.columns(effect, form)) <= most


def test_the_truss_sinks_by_millimetres_and_leans_by_the_slope(bench):
    """The rig's beam sinks by 1 mm under 6.5 kN at mid-span; its carriage leans to one side or the other."""
    errors = bench.errors("truss_deflection", "a")
    assert true_values("truss_deflection", "a", 1.0, bench.scene, errors) == {"sink": (1.0, "mm at 6.5 kN")}
    motion = bench.motion(errors)
    apart = [bench.apart(motion, bench.valued("truss_deflection", "moving_load", {"sink": 1.0, "lean": side}))
             for side in (1.0, -1.0)]  # fmt: skip
    assert min(apart) <= 1e-6
    assert max(apart) > 0.5


@pytest.mark.parametrize("form", ["moving_load", "even_load", "half_sine"])
def test_shapes_of_deflection(bench, form):
    """1 at mid-span, 0 at the posts, and the lean is the slope of the line: central differences."""
    step = 1e-4
    along = np.linspace(0.1, SPAN_M - 0.1, len(bench.rows))

    def line(travel):
        given = replace(bench.rows.conditions, travels={"truss_travel": travel}, weight_n=np.full(len(travel), 6500.0))
        parameters = {p.name: p for p in EFFECTS["truss_deflection"].form(form, given).parameters}
        return -parameters["sink"].changes["base.tz"], parameters["lean"].changes["base.rx"]

    assert line(np.full(len(along), SPAN_M / 2))[0] == pytest.approx(1e-3)
    for post in (0.0, SPAN_M):
        assert line(np.full(len(along), post))[0] == pytest.approx(0.0, abs=1e-12)
    slope = (line(along + step)[0] - line(along - step)[0]) / (2.0 * step)
    assert line(along)[1] == pytest.approx(slope, rel=1e-6, abs=1e-10)


@pytest.mark.parametrize("rail", ["x", "y"])
@pytest.mark.parametrize("mounted", [(0.0, 0.0, 0.0), (np.pi, 0.0, 0.0), (0.3, -0.2, 0.5)])
def test_a_base_sinks_along_gravity_and_leans_along_its_rail(tmp_path, rail, mounted):
    """In any mounting: a beam along x pitches where one along y rolls."""
    way = np.eye(3)["xyz".index(rail)]
    urdf = f"""<robot name="hung"><link name="hall"/><link name="car"/><link name="base"/><link name="tool"/>
      <joint name="rail" type="prismatic"><parent link="hall"/><child link="car"/>
        <axis xyz="{" ".join(map(str, way))}"/><limit lower="0" upper="6" effort="1" velocity="1"/></joint>
      <joint name="plate" type="fixed"><parent link="car"/><child link="base"/>
        <origin rpy="{" ".join(map(str, mounted))}"/></joint>
      <joint name="pan" type="continuous"><parent link="base"/><child link="tool"/></joint></robot>"""
    (tmp_path / "hung.urdf").write_text(urdf, encoding="utf-8")
    said = "name: hung\nurdf: hung.urdf\nbase_frame: base\nend_frame: tool\ntravel: [rail]\ndrives: [{joint: pan}]\n"
    (tmp_path / "robot.yaml").write_text(f"format: pouring_robot/robot/1\n{said}", encoding="utf-8")
    robot = RobotDefinition.load(tmp_path / "robot.yaml")
    given = {"travels": {"rail": np.full(3, 1.5)}, "weight_n": np.full(3, 1000.0), "truss_span_m": 6.0}
    rows = replace(bare_conditions(robot), **given)
    axes = Rotation.from_euler("xyz", mounted).as_matrix()
    parameters = {p.name: p.changes for p in all_effects(robot)["base_deflection"].form("half_sine", rows).parameters}
    moved = {
        name: axes @ [changes.get(f"base.{kind}{axis}", np.zeros(3))[0] for axis in "xyz"]
        for kind, name in (("t", "sink"), ("r", "lean"))
        for changes in [parameters[name]]
    }
    quarter = np.pi / 4.0  # half a sine over 6 m, at a quarter of it
    np.testing.assert_allclose(moved["sink"], [0.0, 0.0, -1e-3 * np.sin(quarter)], rtol=0, atol=1e-15)
    slope = 1e-3 * np.pi / 6.0 * np.cos(quarter)
    np.testing.assert_allclose(moved["lean"], slope * np.cross(way, [0.0, 0.0, 1.0]), rtol=0, atol=1e-15)


def test_the_dead_load_bends_whatever_the_payload(bench):
    parameters = {p.name: p for p in bench.form("truss_deflection", "moving_load").parameters}
    load = bench.rows.conditions.weight_n / 6500.0
    for name in ("sink", "lean", "torsion"):
        (channel,) = parameters[name].changes
        dead = parameters[f"dead_{name}"].changes[channel]
        assert parameters[name].changes[channel] == pytest.approx(dead * load, rel=1e-12)


def test_forces_are_proportional_to_the_weight_of_the_ladle(bench):
    """Weight and forces follow from tare and payload."""
    twice = bench.campaign.with_conditions(payload=2.0 * bench.campaign.payload_kg + TARE_KG)
    heavier = bench.rows_of(twice).conditions
    assert heavier.drive_force == pytest.approx(2.0 * bench.rows.conditions.drive_force, rel=1e-12)


def test_a_rod_stretches_under_its_load_in_either_direction_of_its_slide(tmp_path):
    """Hooke's law: a load on a steel rod is lower by W l / E A, and a slide may count down or up from zero."""
    lowered = {}
    for way, limits in ((-1.0, "0 1"), (1.0, "-1 0")):
        lower, upper = limits.split()
        urdf = f"""<robot name="hoist"><link name="hall"/><link name="hook"/>
          <joint name="rod" type="prismatic"><parent link="hall"/><child link="hook"/><axis xyz="0 0 {way}"/>
            <limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint></robot>"""
        (tmp_path / "hoist.urdf").write_text(urdf, encoding="utf-8")
        said = "name: hoist\nurdf: hoist.urdf\nbase_frame: hall\nend_frame: hook\ndrives: [{joint: rod}]\n"
        (tmp_path / "robot.yaml").write_text(f"format: pouring_robot/robot/1\n{said}", encoding="utf-8")
        robot = RobotDefinition.load(tmp_path / "robot.yaml")
        lengths, weight = np.array([[0.2], [0.5], [0.9]]), 1000.0
        rows = replace(bare_conditions(robot), drives=-way * lengths, drive_force=np.full((3, 1), -way * weight))
        rod = all_effects(robot)["drive_compliance"].form("rod", rows).parameters[0]
        assert rod.bounds[0] == 0.0  # it yields along the load and never against it
        lowered[way] = -way * rod.changes["drive.rod"]
    np.testing.assert_allclose(lowered[-1.0], 1e-3 * np.array([0.2, 0.5, 0.9]), rtol=1e-12)
    np.testing.assert_allclose(lowered[1.0], lowered[-1.0], rtol=1e-12)


def test_moments_on_joints_turn_compliant_closures(bench, drawing, stiff_mechanism):
    """Closures that yield only in rotation, by the total energy, against moment over stiffness at their joints."""
    row, mass, softer = 7, 300.0, 1e-9
    stiff = 1.0 / stiff_mechanism.loops.stiffness.rotation.value
    soft = soft_against_turning(stiff_mechanism, 1.0 / (stiff + softer))
    given, at = bench.rows.conditions, (drawing, bench.campaign.drives[row])

    def yielded(payload_kg):
        return carried(soft, *at, payload_kg).translation - carried(stiff_mechanism, *at, payload_kg).translation

    found = yielded(mass) - yielded(0.0)
    seats = [name for name in given.joint_moments if name.split(".")[0].endswith("seat_mount")]
    assert len(seats) == 12
    seen = sum(
        bench.ordered(bench.rows.channel(name, bench.linear)).reshape(-1, 6)[row] * given.joint_moments[name][row]
        for name in seats
    )
    expected = motion_of_platform(bench, row, seen) * mass * GRAVITY / given.weight_n[row] * softer
    assert np.abs(found - expected).max() <= 3e-3 * np.abs(expected).max()
