"""Commanded poses from CSV."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pouring_robot.exceptions import BadInputError, TableError
from pouring_robot.robot.command_table import read_pose_lines, read_poses
from tests.support import ROOT

HEADER = "x_mm,y_mm,z_mm,tilt_deg\n"
WRITTEN = "poses.csv"


def test_the_shipped_poses():
    poses = read_poses(ROOT / "examples" / "poses.csv")
    assert len(poses) == 5
    assert poses[0].to_mm_deg() == pytest.approx((-100.0, 0.0, -600.0, 17.0), abs=1e-12)


def test_poses_are_labelled_by_their_lines(written):
    path = written(HEADER + "\n1,2,-500,4\n ,,,\n5,6,-700,8\n")
    lines = read_pose_lines(path)
    assert {line: pose.to_mm_deg()[2] for line, pose in lines.items()} == pytest.approx({3: -500.0, 5: -700.0})
    assert read_poses(path) == list(lines.values())


@pytest.mark.parametrize(
    "content",
    [
        "x_mm,y_mm,z_mm,tilt_deg\n-100,20,-600,30\n",
        "tilt_deg,z_m,y_mm,x_m\n30,-0.6,20,-0.1\n",
        "x_mm, y_mm , z_mm,tilt_mrad\n-100, 20, -6e2, 523.5987755982989\n\n",
        "x_um,y_m,z_um,tilt_deg\n-100000,0.02,-600000,30\n",
        f"x_mm,y_mm,z_mm,tilt_rad\r\n-100,20,-600,{math.pi / 6!r}\r\n ,,,\r\n",
        b"\xef\xbb\xbfx_mm,y_mm,z_mm,tilt_deg\n-100,20,-600,30\n",
        '"x_mm","y_mm","z_mm","tilt_deg"\n"-100","20","-600","30"',
        "sample,x_mm,y_mm,z_mm,tilt_deg\nnext_1,-100,20,-600,30\n",
    ],
    ids=["plain", "other units and order", "blanks", "micrometres", "CRLF", "byte order mark", "quotes", "a plan's"],
)
def test_units_are_part_of_the_names(written, content):
    (pose,) = read_poses(written(content))
    assert pose.position_m == pytest.approx((-0.1, 0.02, -0.6), abs=1e-15)
    assert pose.tilt_rad == pytest.approx(math.pi / 6, abs=1e-12)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("\n", "line 1"),
        (HEADER, "no pose below its header"),
        (HEADER + ",,,\n", "no pose below its header"),
        (HEADER + "1,2,3,4\n1,2,x,4\n", "line 3, column z_mm: 'x' is not a finite number"),
        (HEADER + "1,2,nan,4\n", "line 2, column z_mm: 'nan'"),
        (HEADER + "1,2,3,inf\n", "line 2, column tilt_deg: 'inf'"),
        (HEADER + "1,2,3\n", "line 2, column tilt_deg: ''"),
        (HEADER + "1,,3,4\n", "line 2, column y_mm: ''"),
        (HEADER + "\n\n1,2,3,4\n1;2;3;4\n", "line 5, column x_mm: '1;2;3;4'"),
        ("x_mm,y_mm,z_mm\n1,2,3\n", r"line 1: the column for tilt \(tilt_rad or tilt_mrad or tilt_deg\) is missing"),
        ("x_mm,y_mm,z_mm,tilt_deg,x_m\n1,2,3,4,5\n", "line 1: the column for x .* occurs twice"),
        (",x_mm,y_mm,z_mm,tilt_deg\n0,1,2,3,4\n", "line 1: a column has no heading; name it, or remove it"),
        ("x_mm,y_mm,z_mm,tilt_dge\n1,2,3,4\n", "line 1: unknown column 'tilt_dge'; did you mean 'tilt_deg'"),
        ("x_cm,y_mm,z_mm,tilt_deg\n1,2,3,4\n", "line 1: unknown column 'x_cm'"),
        ("x,y,z,tilt\n1,2,3,4\n", "line 1: unknown column 'x' names no unit; write x_m or x_mm or x_um"),
        ("X,Y,Z,tilt\n1,2,3,4\n", "line 1: unknown column 'X' names no unit; write x_m or x_mm or x_um"),
        ("x_mm;y_mm;z_mm;tilt_deg\n1;2;3;4\n", "line 1: .* must be parted by commas"),
        ("format: mine\nat: [1, 2, 3]\n", r"line 2: 3 cells for 1 columns; does line 1 name every column\?"),
        (b"\xff\xfe\x00", "UTF-8"),
        (HEADER + "1,2,3,4,5\n", "line 2"),
        (HEADER + '"1\n\n",2,3,4\n5,6,7,x\n', "line 5"),
    ],
)
def test_mistakes_name_line_and_column(written, content, words):
    path = written(content)
    with pytest.raises(TableError, match=words) as caught:
        read_poses(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_missing_file(tmp_path):
    with pytest.raises(TableError, match="cannot be read: No such file"):
        read_poses(tmp_path / "absent.csv")
    with pytest.raises(TableError, match="cannot be read"):
        read_poses(tmp_path)


CELLS = st.one_of(
    st.floats().map(repr), st.text(max_size=6), st.sampled_from(["", '"', ",", "\n", "\0", "1e400", "x_mm"])
)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(header=st.one_of(st.just(HEADER), st.text(max_size=20)), rows=st.lists(st.lists(CELLS, max_size=5), max_size=4))
def test_any_table_reads_or_is_refused(tmp_path, header, rows):
    path = tmp_path / "poses.csv"
    path.write_text(header + "\n".join(",".join(row) for row in rows), encoding="utf-8", errors="replace")
    try:
        poses = read_poses(path)
    except BadInputError as error:
        assert "\n" not in str(error)
    else:
        assert all(math.isfinite(v) for pose in poses for v in (*pose.position_m, pose.tilt_rad))


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=60))
def test_any_bytes_read_or_are_refused(tmp_path, content):
    path = tmp_path / "poses.csv"
    path.write_bytes(HEADER.encode() + content)
    try:
        read_poses(path)
    except BadInputError as error:
        assert "\n" not in str(error)
