"""``pouring-robot campaign``: exit codes, one-line errors, JSON, pictures, nothing half-written."""

import json

import pandas as pd
import pytest
from matplotlib.text import Text
from PIL import Image

from pouring_robot.checks import plots
from pouring_robot.cli.app import main
from tests.support import ACTUAL, ROOT


def simulate(folder, *more, name="c.csv"):
    return main(["campaign", "simulate", "--out", str(folder / name), "--random", "40", "--seed", "6", *more])


def test_simulate_and_check(tmp_path, capsys):
    truth = tmp_path / "truth.json"
    assert simulate(tmp_path, "--model", str(ACTUAL), "--outliers", "2", "--truth", str(truth)) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.csv", "c.yaml", "truth.json"]
    hidden = json.loads(truth.read_text())
    capsys.readouterr()
    assert main(["campaign", "check", str(tmp_path / "c.csv"), "--png", str(tmp_path / "c.png")]) == 0
    output = capsys.readouterr().out
    for line in hidden["outlier_lines"]:
        assert f"line {line}: gross error" in output
    assert "40 rows of full poses" in output
    with Image.open(tmp_path / "c.png") as picture:
        assert picture.width > 1000
        assert len(picture.convert("RGB").getcolors(1 << 20)) > 20
    assert main(["campaign", "check", str(tmp_path / "c.csv"), "--json", "--model", str(ACTUAL)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["outlier_rows"] == hidden["outliers"]
    assert figures["rows"] == 40
    assert figures["ranges"]["q1"]["unit"] == "mm"


@pytest.mark.parametrize("load", ["400", "4000"])
def test_says_of_conditions_what_path_says(tmp_path, capsys, load):
    plan, model = tmp_path / "plan.csv", ["--model", str(ROOT / "examples" / "learned.yaml")]
    plan.write_text(f"x_mm,y_mm,z_mm,tilt_deg,payload_kg\n-100,20,-600,17,{load}\n", encoding="utf-8")
    told, out = [], ["--out", str(tmp_path / "c.csv")]
    for command in (["path"], ["campaign", "simulate", *out, "--plan"]):
        assert main([*command, str(plan), *model]) == 0
        told.append([line for line in capsys.readouterr().out.splitlines() if line.startswith("note: ")])
    beyond = ["note: payload_kg 4000 lies outside 143.3 to 510, over which effects were learned"]
    assert told[1] == told[0] == (beyond if load == "4000" else [])


def test_sessions_that_are_not_listed_are_counted(tmp_path, capsys):
    assert simulate(tmp_path) == 0
    path = tmp_path / "c.csv"
    table = pd.read_csv(path).assign(session=[f"s{row // 2}" for row in range(40)])
    table.to_csv(path, index=False)
    capsys.readouterr()
    assert main(["campaign", "check", str(path)]) == 0
    assert "s11 (2) and 8 more " in " ".join(capsys.readouterr().out.split())


def test_says_what_is_undone_and_how_many_rows_are_used(tmp_path, capsys):
    assert simulate(tmp_path) == 0
    path = tmp_path / "c.csv"
    head, *rows = path.read_text().splitlines()
    k = head.split(",").index("q1_mm")
    turned = [",".join([*row[:k], f"-{row[k]}", *row[k + 1 :]]) for row in (line.split(",") for line in rows)]
    path.write_text("\n".join([head, *turned]) + "\n")
    capsys.readouterr()
    assert main(["campaign", "check", str(path)]) == 2
    output = " ".join(capsys.readouterr().out.split())
    assert "frames fitted, with the sign of 'q1_mm' reversed: " in output
    path.write_text("\n".join([head, *(row for row in rows for _ in range(2))]) + "\n")
    assert main(["campaign", "check", str(path)]) == 0
    output = capsys.readouterr().out
    assert "80 rows of full poses, 40 usable" in output and "frames fitted: " in " ".join(output.split())
    assert main(["campaign", "check", str(path), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["usable_rows"], figures["undone"]) == (40, [])


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_an_error_in_the_data_ends_with_exit_code_2(tmp_path, capsys, more):
    assert simulate(tmp_path) == 0
    path = tmp_path / "c.csv"
    path.write_text(path.read_text().replace("x_mm,y_mm,z_mm", "x_m,y_m,z_m", 1))
    capsys.readouterr()
    assert main(["campaign", "check", str(path), *more]) == 2
    printed = capsys.readouterr()
    assert "1 error in the data: " in printed.err
    assert printed.err.count("\n") == 1
    assert ("position_unit" if more else "error: ") in printed.out


def test_parquet_frames_and_positions(tmp_path, capsys):
    frame = ["100", "200", "300", "10", "20", "30"]
    more = ["--position-only", "--tracker-frame", *frame, "--target-frame", *frame, "--lost", "0.05"]
    assert simulate(tmp_path, *more, "--truth", str(tmp_path / "t.json"), name="c.parquet") == 0
    capsys.readouterr()
    assert json.loads((tmp_path / "t.json").read_text())["pose_platform_to_target"]["translation_mm"] == pytest.approx(
        [100, 200, 300]
    )
    assert main(["campaign", "check", str(tmp_path / "c.parquet")]) == 0
    output = capsys.readouterr().out
    assert "40 rows of positions" in output
    assert "checks: nothing found" in output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["campaign", "check", "no.csv"], "cannot be read"),
        (["campaign", "simulate", "--out", "x.csv"], "--plan FILE or by --random"),
        (["campaign", "simulate", "--out", "x.csv", "--random", "0"], "1 to 100000"),
        (["campaign", "simulate", "--out", "x.csv", "--random", "5", "--lost", "7"], "share of lost cells"),
        (["campaign", "simulate", "--out", "x.csv", "--random", "5", "--noise-mm", "-1"], "in m must be between"),
        (
            ["campaign", "simulate", "--out", "x.csv", "--random", "5", "--position-only", "--noise-mrad", "1"],
            "without rotations they have no noise",
        ),
        (["campaign", "simulate", "--out", "x.csv", "--random", "5", "--outliers", "9"], "9 gross errors"),
        (["campaign", "simulate", "--out", "x.yaml", "--random", "5"], "x.yaml"),
        (
            ["campaign", "simulate", "--out", "x.xlsx", "--random", "5"],
            "it is written as .csv or .parquet or .pq, not as .xlsx",
        ),
        (["campaign", "simulate", "--out", "x.txt", "--random", "5"], "not as .txt; give it such an ending"),
        (["campaign", "simulate", "--out", "x", "--random", "5"], "not without an ending"),
        (["campaign", "plan", "--out", "x.xlsx"], "it is written as .csv, not as .xlsx"),
        (["campaign", "plan", "--out", "x.parquet"], "it is written as .csv, not as .parquet"),
        (["campaign", "simulate", "--out", "x.csv", "--random", "5", "--truth", "x.csv"], "same file name"),
        (["campaign", "simulate", "--out", "no/x.csv", "--random", "5"], "does not exist"),
        (["campaign"], "Missing command"),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_does_not_overwrite_unless_told(tmp_path, capsys):
    assert simulate(tmp_path) == 0
    before = (tmp_path / "c.csv").read_bytes()
    assert simulate(tmp_path) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (tmp_path / "c.csv").read_bytes() == before
    assert simulate(tmp_path, "--overwrite", "--noise-mm", "0.1") == 0
    assert (tmp_path / "c.csv").read_bytes() != before


def test_pictures_with_nothing_to_fit(tmp_path, capsys):
    assert main(["campaign", "simulate", "--out", str(tmp_path / "c.csv"), "--random", "3"]) == 0
    assert main(["campaign", "check", str(tmp_path / "c.csv"), "--png", str(tmp_path / "c.png")]) == 2
    assert "too few" in capsys.readouterr().out
    assert (tmp_path / "c.png").stat().st_size > 0


def test_every_session_of_a_picture_has_its_colour_and_a_name_within_it(tmp_path, monkeypatch):
    assert simulate(tmp_path) == 0
    table, seen = pd.read_csv(tmp_path / "c.csv"), []
    table["session"] = [f"{chr(65 + k % 9)} shift with a long name" for k in range(len(table))]
    table.to_csv(tmp_path / "c.csv", index=False)
    monkeypatch.setattr(plots, "png_of", lambda figure: seen.append(figure) or b"")
    main(["campaign", "check", str(tmp_path / "c.csv"), "--png", str(tmp_path / "c.png")])
    (figure,) = seen
    figure.canvas.draw()
    (legend,) = figure.legends
    frame = legend.get_window_extent()
    assert figure.bbox.x0 <= frame.x0 and frame.x1 <= figure.bbox.x1
    colours = [tuple(handle.get_facecolor()[0]) for handle in legend.legend_handles if hasattr(handle, "get_offsets")]
    assert len(set(colours)) == len(colours) >= 8
    assert "other sessions" in [text.get_text() for text in legend.get_texts()]


def test_a_picture_names_what_was_measured(tmp_path, capsys, monkeypatch):
    """Lines alone tell no place, and then there is nothing that a frame could be fitted to."""
    machine, words = ROOT / "examples/machines/hangprinter", []
    monkeypatch.setattr(plots, "png_of", lambda figure: words.extend(t.get_text() for t in figure.findobj(Text)) or b"")
    check = ["campaign", "check", str(machine / "samples.csv"), "--robot", str(machine / "robot.yaml")]
    assert main([*check, "--png", str(tmp_path / "c.png")]) == 0
    assert "44 rows of closures" in capsys.readouterr().out
    assert "samples.csv: 44 closures, as commanded, in the base's frame" in words
    assert "no row has a measured position" in words
