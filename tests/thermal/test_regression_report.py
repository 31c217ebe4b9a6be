"""Results of a table, axis by axis; the thermal-model file; the same for the drives of another robot."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from pouring_robot.cli.app import main
from pouring_robot.exceptions import BadInputError, DescriptionError, TableError
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.robot import Robot
from pouring_robot.thermal.regression.report import blocks, by_axis, read_positions, regress
from pouring_robot.thermal.regression.table import ErrorTable
from pouring_robot.thermal.regression.thermal_model import Positions, ThermalModel
from tests.support import ROOT

T = np.linspace(873.15, 1973.15, 8)
HEAT = (T - 293.15) / 1680.0


@pytest.fixture
def measured():
    """Ten poses in three directions; Y depends on where they are, with both signs."""
    random = np.random.default_rng(3)
    places = random.uniform(-0.1, 0.1, size=(10, 3))
    places[5:, 1] = -places[:5, 1]  # as many left as right of the middle
    x, y, z = -3e-4 * (1.0 + 2.0 * places[:, 0]), 0.02 * places[:, 1], -1e-3 * (1.0 + places[:, 2])
    # A little curvature of its own in each set keeps them apart.
    bend = 1e-6 * np.outer(np.sin(3.0 * HEAT), random.normal(size=30))
    errors = HEAT[:, None] * np.stack([x, y, z], axis=1).ravel() + bend
    names = tuple(f"P{k}_{axis}" for k in range(10) for axis in "xyz")
    return ErrorTable(T, errors, names), Positions(("x", "y", "z"), ("m", "m", "m"), places)


def test_directions_and_what_helps(measured):
    table, places = measured
    alone, known = regress(table), regress(table, places)
    assert list(alone.axes) == ["x", "y", "z"] and alone.axes["y"].table.names == tuple(f"P{k}" for k in range(10))
    assert alone.axes["x"].helps and alone.axes["z"].helps and not alone.axes["y"].helps
    assert {one.method for one in known.axes.values()} == {"pose"} and all(one.helps for one in known.axes.values())
    assert regress(table, method="paper").axes["z"].method == "paper"
    with pytest.raises(BadInputError, match="needs the poses"):
        regress(table, method="pose")


def test_poses_of_one_direction_are_not_said_to_err_in_opposite_ones():
    """One pose errs by 1.5 mm at the hottest, nine by 0.2 to 0.6, all of them forward: too different for one line."""
    hot_K = np.linspace(1773.15, 1973.15, 8)
    gains = np.append(1.5, np.linspace(0.2, 0.6, 9))
    scatter = 0.05 * np.random.default_rng(4).normal(size=(8, 10))
    errors = 1e-3 * (gains * (hot_K[:, None] - 293.15) / 1680.0 + scatter)
    found = regress(ErrorTable(hot_K, errors, tuple(f"P{k}" for k in range(10))))
    assert (errors > 0.0).all()
    (told,) = [part.text for part in blocks(found) if "the paper's P_end does not" in getattr(part, "text", "")]
    assert told.endswith("poses err in opposite directions or too differently for one line")


def test_formulas_are_those_of_the_models(measured):
    one = regress(measured[0]).axes["z"]
    lines = dict(line.split(") ", 1) for line in one.formulas())
    slope = float(lines["(22"].split(" TEMP")[0].rsplit(" ", 1)[1])
    assert slope == pytest.approx(1e3 * one.model.coef_, rel=1e-4)
    c0 = float(lines["(21"].split(" = ")[1].split(" ")[0])
    assert c0 == pytest.approx(one.model.component_regression_.intercept_ - 273.15, rel=1e-4)
    assert "+ -" not in lines["(21"]
    # Equation 21 through the printed numbers gives the temperature back.
    c = [float(word) for word in lines["(21"].replace("+ ", "").split()[3::2]]
    sets = one.table.errors[:, one.model.selector_.sensitive_] * 1e3
    np.testing.assert_allclose(c0 + sets @ np.array(c), T - 273.15, atol=0.02 * np.ptp(T))


def test_the_file_says_what_the_line_says(measured, tmp_path):
    table, places = measured
    found = regress(table, places)
    assert not found.foreign_inputs
    turned = Positions(("x", "y", "tilt"), ("m", "rad", "rad"), places.values)
    assert regress(table, turned).foreign_inputs == ["y (rad)"]
    path = found.model().save(tmp_path / "heat.yaml")
    model = ThermalModel.load(path)
    at = dict(zip("xyz", places.values[4], strict=True))
    for k, axis in enumerate("xyz"):
        line = found.axes[axis].lines["pose"].predict(T[[5]], places.values[[4]])[0, 0]
        assert model.displacement_m(T[5] - 273.15, at)[k] == pytest.approx(line, abs=1e-15)
    assert model.beyond(1800.0, at) == ["melt 1800 degC (600 to 1700)"] and model.beyond(1700.0, at) == []
    with pytest.raises(BadInputError, match="needs z"):
        model.displacement_m(1500.0, {"x": 0.0, "y": 0.0})
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    down = content | {"melt_degC": content["melt_degC"][::-1]}
    path.write_text(yaml.safe_dump(down), encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"'melt_degC': a range starts with its lower end, unlike 1700 to 600"):
        ThermalModel.load(path)
    offset = content["axes"]["x"]["coefficients"][0]
    for wrong in (offset[:3], offset[:1]):
        content["axes"]["x"]["coefficients"][0] = wrong
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        with pytest.raises(DescriptionError, match=r"axes.x: rows of coefficients need 1 or 4 numbers, both alike"):
            ThermalModel.load(path)


def test_a_table_that_says_no_direction(measured, tmp_path):
    plain = by_axis(measured[0])["z"]
    with pytest.raises(BadInputError, match="give --axis"):
        regress(plain).model()
    assert list(regress(plain, axis="z").model().axes) == ["z"]
    mixed = ErrorTable(T, measured[0].errors[:, :3], ("P0_x", "P1", "P2_x"))
    with pytest.raises(TableError, match="name all or none"):
        by_axis(mixed)


def test_one_direction_of_several(measured):
    both = measured[0].select([name for name in measured[0].names if not name.endswith("_z")])
    assert list(regress(both, axis="y").axes) == ["y"]
    assert by_axis(both, "y")["y"].errors.tolist() == by_axis(both)["y"].errors.tolist()
    with pytest.raises(TableError, match="has no direction z, only x, y; give --axis one of these"):
        regress(both, axis="z")


@pytest.mark.parametrize(
    ("sets", "with_places", "words"),
    [
        (1, False, r"\(1\) to leave out each in turn; give 3 or more$"),
        (2, True, r"\(2\) to leave out each in turn and fit a line over x, y, z; give 6 or more$"),
        (5, True, r"\(5\) to leave out each in turn and fit a line over x, y, z; give 6 or more, or no --poses$"),
    ],
)
def test_too_few_sets_are_refused_with_the_number_that_is_enough(measured, sets, with_places, words):
    table = by_axis(measured[0])["x"]
    with pytest.raises(TableError, match=words):
        regress(table.select(table.names[:sets]), measured[1].rows(range(sets)) if with_places else None)
    assert regress(table.select(table.names[:6]), measured[1].rows(range(6)))


def test_more_groups_than_sets_are_refused(measured):
    with pytest.raises(TableError, match="10 sets cannot make 11 groups; give --groups 10 or fewer"):
        regress(measured[0], axis="x", n_clusters=11)
    assert len(regress(measured[0], axis="x", n_clusters=10).axes["x"].sensitive) == 10
    assert regress(measured[0], axis="x", n_clusters=11, lambda_cut=0.5)  # cut at λ, the number is not used


def test_the_group_that_no_set_frees_of_collinearity_is_told_wherever_it_stands():
    t = np.linspace(-1.0, 1.0, 12)
    between, last = t + 0.175 * np.sin(7.0 * t), 0.6 * t + np.cos(3.0 * t)
    second = [between, between + 0.02 * np.cos(20.0 * t)]
    third = [last + 0.01 * np.cos(11.0 * k * t) for k in (1, 2, 3)]
    sets = 1e-3 * np.column_stack([t + 0.05 * np.cos(9.0 * t), *second, *third])
    found = regress(ErrorTable(1400.0 + 500.0 * t, sets, tuple("ABCDEF")), n_clusters=3)
    selector = found.axes[""].model.selector_
    assert selector.guard_held_.tolist() == [True, False, True]
    told = [block.text for block in blocks(found) if "collinearity" in getattr(block, "text", "")]
    name = found.axes[""].sensitive[1]
    assert told == [
        f"note: no set of the group of {name} is free of collinearity (VIF "
        f"{selector.vif_[selector.sensitive_[1]]:.4g}); principal components allow for it"
    ]


def test_a_set_that_equation_21_does_not_hold_is_told_by_its_name():
    celsius = np.linspace(600.0, 1700.0, 12)
    step = (celsius - 1150.0) / 550.0
    # A to C are lines of temperature, which alone tell it; D, the third of those left where A is left out, is unlike.
    sets = 1e-4 * np.column_stack([step, 1.2 * step, 0.9 * step, step**2 + 0.2 * step, 1.1 * step**2 + 0.1 * step])
    with pytest.raises(BadInputError, match="do not represent error set D, so"):
        regress(ErrorTable(celsius + 273.15, sets, tuple("ABCDE")))


def test_inputs_that_follow_from_each_other_are_refused(measured):
    table, places = measured
    tied = np.column_stack([places.values, 0.3 - 2.0 * places.values[:, 2]])
    with pytest.raises(TableError, match=": z, q1 of --poses are linearly dependent over all sets; leave one"):
        regress(table, Positions((*places.names, "q1"), (*places.units, "rad"), tied))


def test_positions_are_read_in_the_tables_order(tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text("set,x_mm,tilt_deg,q1_rad\nB,2,10,0.5\nA,1,10,0.25\n", encoding="utf-8")
    found = read_positions(file, ("A", "B"))
    assert found.names == ("x", "q1") and found.units == ("m", "rad")  # what never changes says nothing
    np.testing.assert_allclose(found.values, [[1e-3, 0.25], [2e-3, 0.5]])
    assert found.ranges == {"x": (1e-3, 2e-3), "tilt": (np.radians(10.0),) * 2, "q1": (0.25, 0.5)}
    with pytest.raises(TableError, match="no row for the sets C"):
        read_positions(file, ("A", "C"))
    with file.open("a", encoding="utf-8") as stream:
        stream.write("\nB,3,10,0.5\n")
    with pytest.raises(TableError, match="set B occurs more than once, in lines 2, 5; keep one"):
        read_positions(file, ("A", "B"))
    file.write_text("set,x_mm,x_m\nA,1,0.3\nB,2,0.2\n", encoding="utf-8")  # a pose has one x
    with pytest.raises(TableError, match="'x' occurs twice, in two units; keep one"):
        read_positions(file, ("A", "B"))
    file.write_text("set\nA\nB\n", encoding="utf-8")
    with pytest.raises(TableError, match="no column says where the sets were measured; add x_mm"):
        read_positions(file, ("A", "B"))


def test_a_pose_beyond_those_of_the_sets_is_told(measured):
    table, places = measured
    spans = {"x": (-0.1, 0.1), "tilt": (0.2, 0.2), "q1": (0.0, 1.0)}
    model = regress(table, replace(places, ranges=spans)).model()
    assert model.beyond(700.0, {"x": 0.1, "y": 5.0, "tilt": 0.2}) == []
    told = model.beyond(700.0, {"x": -0.25, "tilt": 0.0, "q1": 2.0})
    assert told == ["x -250 mm (-100 to 100)", "tilt 0 deg (11.4592)", "q1 2 m or rad (0 to 1)"]


def test_drives_of_another_robot(tmp_path, capsys):
    """A delta whose arms grow: its error depends on the drives, and so does the line."""
    robot = Robot(RobotModel.for_robot(ROOT / "examples" / "robots" / "delta" / "robot.yaml"))
    drives, _ = robot.model.definition.workspace(robot.drawing, 24)
    elbow = [p.name for p in robot.parameters.placements if p.name.startswith("arm1_elbow1.t")]
    moved = np.array([robot.transfer(d, elbow, "platform").to_numpy()[:3].sum(axis=1) for d in drives])
    errors = 1e-3 * HEAT[:, None, None] * moved + 1e-7 * np.sin(4.0 * HEAT)[:, None, None] * moved[::-1]
    head = [f"P{k}_{axis}_mm" for k in range(len(drives)) for axis in "xyz"]
    rows = np.column_stack([T - 273.15, 1e3 * errors.reshape(len(T), -1)])
    (tmp_path / "t.csv").write_text(
        ",".join(["melt_degC", *head]) + "\n" + "\n".join(",".join(f"{v:.12g}" for v in row) for row in rows) + "\n"
    )
    lines = [f"P{k}," + ",".join(f"{v:.12g}" for v in d) for k, d in enumerate(drives)]
    (tmp_path / "p.csv").write_text("set,q1_rad,q2_rad,q3_rad\n" + "\n".join(lines) + "\n")
    files = [str(tmp_path / name) for name in ("t.csv", "p.csv", "m.yaml")]
    page = tmp_path / "report.html"
    assert main(["regress", files[0], "--poses", files[1], "--out", files[2], "--report", str(page)]) == 0
    html = page.read_text(encoding="utf-8")
    assert html.count("<table>") == 6 and "<svg" in html and "VIF against those chosen before" in html
    out, err = capsys.readouterr()
    assert err.startswith("note: pose and compensate cannot use ") and "depends on q1 (rad), q2 (rad), q3 (rad)" in err
    assert "(22) P_end" in out and "VIF against those chosen before" in out
    model = ThermalModel.load(files[2])
    assert model.inputs == ("q1", "q2", "q3")
    assert main(["regress", files[0], "--method", "pose"]) == 2
    assert "--poses FILE" in capsys.readouterr().err


def test_groups_that_only_appear_when_a_set_is_left_out_have_no_line(tmp_path, capsys):
    """Three sets that rise alike are one group; without one of them rounding may part the other two."""
    table, page = tmp_path / "alike.csv", tmp_path / "page.html"
    rows = (f"{t},{t / 900},{t / 800},{t / 850}\n" for t in range(900, 1701, 100))
    table.write_text("melt_degC,P1_mm,P2_mm,P3_mm\n" + "".join(rows), encoding="utf-8")
    assert main(["regress", str(table), "--axis", "x", "--report", str(page)]) == 0
    assert "single 2" not in capsys.readouterr().out
    report = regress(ErrorTable.read_csv(table), axis="x")
    assert report.axes["x"].unseen.keys() <= report.axes["x"].lines.keys()
