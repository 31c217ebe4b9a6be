"""Displacements of every part: rigid motion, expansion and weight against closed forms."""

import json

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from pouring_robot.cli.app import main
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_under_weight import stiffness_at, truss_sag_m, under_weight
from pouring_robot.thermal.expansion.displacement import DisplacementField
from pouring_robot.thermal.expansion.truss import TrussMotion
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot
from pouring_robot.thermal.network.history import HeatHistory, PoseSchedule
from pouring_robot.thermal.report import ShiftHeat, heated_drawing
from pouring_robot.thermal.scene import displacement_scene, shift_scene
from pouring_robot.viewer.shapes import colours_at

POSE = PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 10.0)
PARTS = ("fixed_platform", *LEGS, "platform", "ladle")


@pytest.fixture(scope="module")
def state(drawing):
    return HeatedRobot(drawing, HeatSection(melt_degC=1700.0)).locate(POSE)


def test_ends_of_legs_are_the_grown_joints(drawing, state):
    field, expansion = DisplacementField.of(state), state.robot.expansion
    names = np.array(field.parts)
    assert tuple(dict.fromkeys(field.parts)) == PARTS
    pose = state.result.pose_base_to_end
    for k, leg in enumerate(LEGS):
        rows = np.flatnonzero(names == leg)
        upper, lower = drawing.kinematics.fixed_centres_m[k], drawing.kinematics.moving_centres_m[k]
        assert field.points_m[rows[0]] == pytest.approx(upper)
        assert field.moved_m[rows[0]] == pytest.approx(expansion.fixed_platform_strain * upper)
        foot = pose.act(lower * (1.0 + expansion.platform_strain))
        assert field.points_m[rows[-1]] + field.moved_m[rows[-1]] == pytest.approx(foot, abs=1e-12)
        if k == 3:
            continue  # passive: it takes whatever length the others leave it
        cold = np.linalg.norm(field.points_m[rows[-1]] - field.points_m[rows[0]])
        warm = np.linalg.norm(foot - upper * (1.0 + expansion.fixed_platform_strain))
        assert warm / cold - 1.0 == pytest.approx(expansion.leg_strain[k], abs=1e-6)


def test_a_hotter_ladle_adds_its_own_growth(state):
    cool, hot = DisplacementField.of(state), DisplacementField.of(state, 500.0)
    ladle = np.array(cool.parts) == "ladle"
    assert np.array_equal(cool.moved_m[~ladle], hot.moved_m[~ladle])
    rim = np.flatnonzero(ladle)[:16]
    more = hot.moved_m[rim] - cool.moved_m[rim]
    shell = state.field.shell_degC
    # Opposite points of the rim part by α ΔT times the diameter.
    spread = np.linalg.norm(more[0] - more[8])
    assert spread == pytest.approx(1.2e-5 * (500.0 - shell) * 0.7, rel=1e-3)
    assert hot.largest_m > cool.largest_m > cool.mean_m
    from_o = DisplacementField.of(state, 500.0, ladle_from_o=True)
    assert from_o.largest_m > hot.largest_m


def test_weight_alone_and_both(drawing, state):
    loaded = under_weight(drawing, stiffness_at(drawing, POSE, 500.0), 500.0)
    weight, both = (DisplacementField.of(HeatedRobot(loaded, heat).locate(POSE)) for heat in (None, HeatSection()))
    fixed = np.array(weight.parts) == "fixed_platform"
    assert np.abs(weight.moved_m[fixed]).max() == 0.0 and np.abs(both.moved_m[fixed]).max() > 0.0
    heat = DisplacementField.of(state)
    missed = np.linalg.norm(both.moved_m - weight.moved_m - heat.moved_m, axis=1).max()
    assert missed < 0.15 * both.largest_m
    assert set(both.by_part) == set(PARTS)


def test_the_truss_sags_as_a_beam_and_takes_the_robot_along(drawing):
    carried, own = truss_sag_m(drawing, 500.0)
    # Two box girders of 110 × 150 × 8 mm over 3 m, a force in the middle.
    inertia = (0.110 * 0.150**3 - 0.094 * 0.134**3) / 12.0
    force = carried * 48.0 * 2.06e11 * 2.0 * inertia / 3.0**3
    assert 500.0 * 9.81 < force < 2500.0 * 9.81
    assert carried - truss_sag_m(drawing, 0.0)[0] == pytest.approx(500.0 * 9.80665 * 27.0 / (96.0 * 2.06e11 * inertia))
    # Each weighs 92 kg, spread along it.
    a_metre = 7850.0 * (0.110 * 0.150 - 0.094 * 0.134) * 9.80665
    assert own == pytest.approx(5.0 * a_metre * 3.0**4 / (384.0 * 2.06e11 * inertia))
    assert own == pytest.approx(0.127e-3, abs=0.5e-6)
    cold = HeatedRobot(drawing).locate(POSE)
    field = DisplacementField.of(cold).on(TrussMotion.under_weight(drawing.layout, carried, own))
    sag = carried + own
    truss = np.array(field.parts) == "truss"
    assert field.moved_m[~truss] == pytest.approx(np.tile([0.0, 0.0, -sag], (int(np.sum(~truss)), 1)), abs=1e-12)
    assert field.distance_m[truss].max() == pytest.approx(sag) and field.distance_m[truss].min() == 0.0


def test_girders_under_their_own_weight_bend_as_their_moment_says(drawing):
    """The moment w x (L - x) / 2 over E I, integrated twice."""
    inertia, a_metre = (0.110 * 0.150**3 - 0.094 * 0.134**3) / 12.0, 7850.0 * (0.110 * 0.150 - 0.094 * 0.134) * 9.80665
    x = np.linspace(0.0, 3.0, 3001)
    slope = cumulative_simpson(a_metre * x * (3.0 - x) / (2.0 * 2.06e11 * inertia), x=x, initial=0.0)
    line = cumulative_simpson(slope, x=x, initial=0.0)
    line -= x / 3.0 * line[-1]
    _, own = truss_sag_m(drawing, 0.0)
    motion = TrussMotion.under_weight(drawing.layout, 0.0, own)
    girder = motion.points_m[:11, 0] + 1.5
    assert motion.moved_m[:11, 2] == pytest.approx(np.interp(girder, x, line), abs=1e-9)


def test_the_hall_sees_truss_and_robot_together(drawing, state):
    field, heated = DisplacementField.of(state), HeatedRobot(drawing, HeatSection())
    motion = TrussMotion.under_heat(drawing.layout, heated.truss(state), heated.network.properties)
    seen = field.on(motion)
    of_robot = np.array(seen.parts) != "truss"
    origin = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
    assert motion.carried_m(origin)[1] - motion.carried_m(origin)[0] == pytest.approx(
        0.3 * np.cross(motion.turn_rad, [1.0, 0.0, 0.0])
    )
    np.testing.assert_allclose(seen.moved_m[of_robot] - field.moved_m, motion.carried_m(field.points_m), atol=1e-15)
    scene = displacement_scene(drawing, seen, "heat", drawing.kinematics.configuration(POSE))
    (robot,), scale = scene.robots, scene.scale
    places = [k for k, item in enumerate(robot.visual.geometryObjects) if item.name == "truss_bridge_0"]
    middle = float(np.linalg.norm(motion.moved_m[11 + 5])) * 1e3  # of the right girder
    assert colours_at(scene, robot, 0)[places] == pytest.approx(scale.colours(np.array([middle])), abs=1e-9)
    # A bare truss over an open ladle sinks by more than the robot under it grows.
    assert -motion.shift_m[2] > field.largest_m and seen.mean_m > field.mean_m


def test_colours_follow_the_field(drawing, state):
    field = DisplacementField.of(state)
    scene = displacement_scene(drawing, field, "heat", drawing.kinematics.configuration(POSE))
    (robot,) = scene.robots
    colours = {item.name: colour for item, colour in zip(robot.visual.geometryObjects, robot.colours[0], strict=True)}
    ladle = next(colour for name, colour in colours.items() if name.startswith("ladle_"))
    fixed = next(colour for name, colour in colours.items() if name.startswith("fixed_platform_"))
    assert ladle[0] > fixed[0]  # redder
    assert dict(scene.steps[0].caption)["ladle"].startswith("mean ")


def test_a_shift_plays_in_the_colours_of_its_temperatures(drawing):
    heated = heated_drawing(drawing, HeatSection())
    history = HeatHistory.constant(1700.0, 20.0, 3600.0)
    times = np.array([0.0, 1800.0, 3600.0])
    shift = ShiftHeat.of(heated.robot, heated.network, history, PoseSchedule.of(POSE, 0.0), times)
    scene = shift_scene(drawing, shift, "a shift")
    (robot,), (arrow,) = scene.robots, scene.arrows
    names = [item.name for item in robot.visual.geometryObjects]
    assert scene.scale is not None
    for step, field in enumerate(shift.fields):
        colours = dict(zip(names, robot.colours[step], strict=True))
        for link, value in (("moving_platform_0", field.platform_degC), ("ladle_0", field.shell_degC)):
            np.testing.assert_allclose(colours[link], scene.scale.colours(np.array(value)))
        # The truss has no temperature here, and its own yellow would be one.
        assert np.ptp([colour for link, colour in colours.items() if link.startswith("truss")], axis=1).max() < 0.1
        lip = shift.moved["ladle_lip"][step]
        assert np.linalg.norm(arrow.vectors_m[step, 0]) == pytest.approx(lip.distance_m)
        body = robot.visual.geometryObjects[names.index("ladle_0")].parentJoint
        nominal, warm = robot.reference[step, body], robot.bodies[step, body]
        at_lip = np.linalg.inv(nominal) @ np.append(arrow.starts_m[step, 0], 1.0)
        # The ladle's own growth, of less than a tenth of a millimetre, moves its lip but not its body.
        np.testing.assert_allclose(((warm - nominal) @ at_lip)[:3], arrow.vectors_m[step, 0], atol=1e-4)
    hottest = max(field.leg_elements_degC.max() for field in shift.fields)
    assert 0.8 * hottest < scene.scale.upper <= hottest
    assert [curve.unit for curve in scene.curves] == ["mm", *["°C"] * 4]
    assert scene.at.tolist() == [0.0, 30.0, 60.0]


def test_the_command(capsys, tmp_path):
    at = ["thermal", "--at-mm", "-100", "20", "-600", "--tilt-deg", "10"]
    page = tmp_path / "field.html"
    assert main([*at, "--under", "both", "--html", str(page), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["displacement"]
    assert set(told["parts"]) == {*PARTS, "truss"} and set(told["from_fixed_platform"]["parts"]) == set(PARTS)
    assert told["truss"]["girders_hottest_degC"] > 100.0 and page.stat().st_size > 1e5
    assert main([*at, "--under", "weight", "--payload-kg", "0"]) == 0
    printed = capsys.readouterr().out
    assert "moved under weight: mm" in printed
    assert "truss: it moves the fixed platform by +0.00 +0.00 -0.90 mm" in printed  # 0.777 and 0.127 of the girders
    assert main([*at, "--under", "heat", "--after-min", "1", "--conduction-only"]) == 0
    assert "girders up to 20 degC" in capsys.readouterr().out
    refused = main([*at, "--html", str(page), "--overwrite"])
    assert refused == 2 and "give --history, or --under heat" in capsys.readouterr().err


def test_the_report_holds_what_is_printed(capsys, tmp_path):
    model, report = tmp_path / "model.yaml", tmp_path / "report.html"
    RobotModel(heat=HeatSection(measured_degC={"leg1": 210.0})).save(model)
    options = ["--model", str(model), "--under", "both", "--report", str(report)]
    assert main(["thermal", "--at-mm", "-100", "20", "-600", *options]) == 0
    printed, page = (" ".join(text.split()) for text in (capsys.readouterr().out, report.read_text("utf-8")))
    for said in (
        "moved under heat and weight: mm",
        "mean of the parts, largest",
        "truss: girders up to",
        "leg1 210 degC",
    ):
        assert said in printed and said in page


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--under", "heat", "--payload-kg", "5"], "belong to --under weight or both"),
        (["--under", "weight", "--ladle-degC", "300"], "weight acts on the cold robot"),
        (["--under", "weight", "--payload-kg", "1e5"], "--payload-kg: 100000 kg is not a possible load"),
        (["--under", "heat", "--ladle-degC", "nan"], "'--ladle-degC'"),
        (["--under", "heat", "--ladle-degC", "-400"], "'--ladle-degC'"),
        (["--under", "heat", "--ladle-degC", "inf"], "--ladle-degC: inf degC is hotter than any melt"),
    ],
)
def test_loads_and_temperatures_that_mean_nothing_are_refused(options, said, capsys):
    assert main(["thermal", "--at-mm", "-100", "20", "-600", *options]) == 2
    assert said in capsys.readouterr().err


def test_a_measured_stiffness_takes_the_place_of_the_computed_one(capsys, tmp_path):
    """Under weight o goes sideways mostly as the torsion of the legs lets it."""
    shipped = description_folder() / "config" / "stiffness.yaml"
    own = tmp_path / "own.yaml"
    own.write_text(shipped.read_text().replace("measured: {}", "measured: {leg_torsion: 1.0e+7}"))
    told = []
    for extra in ([], ["--stiffness", str(own)]):
        assert main(["thermal", "--at-mm", "-100", "20", "-600", "--under", "weight", "--json", *extra]) == 0
        told.append(json.loads(capsys.readouterr().out)["displacement"]["parts"]["platform"])
    assert told[1]["mean_mm"] < 0.2 * told[0]["mean_mm"]
