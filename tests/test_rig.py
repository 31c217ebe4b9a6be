"""The independent machine: it is independent and correct, and its campaigns agree with their stated truth."""

import ast
import csv
import filecmp
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tests.rig import KINDS, LIBRARY, OUTSIDE, Wanted, make_campaign, write_case
from tests.rig.__main__ import main
from tests.rig.campaign import CONFOUNDED
from tests.rig.conditions import BOX, CENTRE_OF_MASS, plan
from tests.rig.effects import CAPS, FORMS, textbook
from tests.rig.machine import LOWER, SOFTNESS, UPPER, Errors, close, drives_of
from tests.rig.metrology import Tracker, basis, rms, without
from tests.rig.rotations import about, conjugate, from_vector, matrix, product, to_vector

ROOT = Path(__file__).resolve().parents[1]
RIG = ROOT / "tests" / "rig"
IDS = {
    *("drive_zero_offset", "drive_scale", "drive_cyclic", "drive_backlash", "joint_centre_offset", "joint_axis_tilt"),
    *("leg_thermal_expansion", "platform_thermal_expansion", "leg_compliance", "tilt_drive_compliance"),
    *("truss_deflection", "base_drift", "tilt_encoder_eccentricity", "metrology_scale"),
}
HEADER = (
    "sample,session,time_s,q1_mm,q2_mm,q3_mm,q4_rad,approach_q1,approach_q2,approach_q3,approach_q4,payload_kg,"
    "truss_travel_m,melt_degC,ambient_degC,leg1_degC,leg2_degC,leg3_degC,leg4_degC,platform_degC,x_mm,y_mm,z_mm"
)


def box_poses(rows, seed):
    pose = np.random.default_rng(seed).uniform(BOX[:, 0], BOX[:, 1], size=(rows, 4))
    return pose[:, :3], pose[:, 3]


def closed(position, tilt, errors, **options):
    lengths, theta = drives_of(position, tilt)
    return close(lengths[:, :3], theta, errors, (position, tilt), **options)


def tilted(rows, seed, rad):
    """A machine all of whose axes are off, the same in every row."""
    errors = Errors.none(rows)
    errors.tilt[:] = np.random.default_rng(seed).normal(size=(4, 5, 3)) * rad
    return errors


# --- independence ----------------------------------------------------------------------------------


def test_no_file_of_the_rig_imports_the_package_or_its_engine():
    allowed = {"__future__", "argparse", "collections", "csv", "dataclasses", "json", "pathlib", "typing"}
    for path in RIG.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                names.append(node.module)
            assert {name.split(".")[0] for name in names} <= allowed | {"numpy", "scipy", "yaml"}, path
            assert not (isinstance(node, ast.ImportFrom) and node.level > 1), path


def test_running_the_rig_loads_nothing_of_the_package():
    code = (
        "import sys, tests.rig as rig; rig.make_campaign('pair', 1, rows=20);"
        "print(sorted(m for m in sys.modules if m.split('.')[0] in ('pouring_robot', 'pinocchio')))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- the machine -----------------------------------------------------------------------------------


def test_drives_of_the_design_page():
    lengths, theta = drives_of(np.array([[-0.100, 0.020, -0.600]]), np.array([0.3]))
    np.testing.assert_allclose(1e3 * lengths[0], [550.5232, 553.7110, 706.2394, 708.727], atol=5.1e-4)
    np.testing.assert_allclose(theta, -0.0858709, atol=5e-8)


def test_without_errors_the_closure_returns_the_pose_from_a_centimetre_off():
    position, tilt = box_poses(100, 1)
    lengths, theta = drives_of(position, tilt)
    poses = close(lengths[:, :3], theta, Errors.none(100), (position + 0.006, tilt - 0.01))
    np.testing.assert_allclose(poses.position, position, atol=1e-12)
    np.testing.assert_allclose(to_vector(poses.quaternion), np.outer(tilt, [0, 1, 0]), atol=1e-12)
    np.testing.assert_allclose(poses.passive[:, 3, 3], lengths[:, 3], atol=1e-12)


def test_closed_poses_of_the_oracle():
    cases = json.loads((ROOT / "tests" / "data" / "closure_oracle.json").read_text(encoding="utf-8"))

    def column(*keys):
        out = []
        for item in cases:
            for key in keys:
                item = item[key]  # noqa: PLW2901
            out.append(item)
        return np.array(out, dtype=float)

    errors = Errors.none(len(cases))
    errors.upper, errors.lower = column("fixed_joint_centre_offsets_m"), column("moving_joint_centre_offsets_m")
    commanded = column("drives", "leg_lengths_m")
    growth = 1.0 + column("expansion_per_K")[:, None] * column("leg_temperature_rise_K")[:, :3]
    errors.length[:, :3] = (commanded + column("drive_offsets", "leg_lengths_m")) * growth - commanded
    errors.theta = column("drive_offsets", "tilt_drive_rad")
    near = (column("commanded", "position_m"), column("commanded", "tilt_rad"))
    poses = close(commanded, column("drives", "tilt_drive_rad"), errors, near)
    np.testing.assert_allclose(poses.position, column("platform", "position_m"), atol=1e-9)
    np.testing.assert_allclose(to_vector(poses.quaternion), column("platform", "rotation_vector_rad"), atol=1e-9)


def slow_pose(lengths, theta, tilt, start):
    """The energy minimum of one pose, by a general minimiser, rotation matrices and the logarithm of the twist."""
    rotation = Rotation.from_rotvec
    axes = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1], [1, 0, 0], [0, 1, 0]], dtype=float)

    def gaps(unknown):
        platform = rotation(unknown[3:6])
        out = []
        for i in range(4):
            u = rotation(tilt[i]).apply(axes)
            a, b, c, d = unknown[6 + 4 * i : 10 + 4 * i]
            length, last = (lengths[i], d) if i < 3 else (d, theta)
            leg = rotation(a * u[0]) * rotation(b * u[1])
            end = leg * rotation(c * u[3]) * rotation(last * u[4])
            out.append(unknown[:3] + platform.apply(LOWER[i]) - UPPER[i] - leg.apply(length * u[2]))
            out.append(SOFTNESS * (end.inv() * platform).as_rotvec())
        return np.concatenate(out)

    return least_squares(gaps, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac").x


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_tilted_axes_close_as_a_general_minimiser_closes_them(seed):
    position, tilt = box_poses(1, seed)
    errors = tilted(1, seed, 2e-3)
    poses = closed(position, tilt, errors)
    lengths, theta = drives_of(position, tilt)
    nominal = closed(position, tilt, Errors.none(1))
    start = np.concatenate([position[0], [0.0, tilt[0], 0.0], nominal.passive.ravel()])
    slow = slow_pose(lengths[0, :3], theta[0], errors.tilt[0], start)
    np.testing.assert_allclose(poses.position[0], slow[:3], atol=2e-7)
    np.testing.assert_allclose(to_vector(poses.quaternion)[0], slow[3:6], atol=2e-7)
    assert np.abs(poses.position[0] - position[0]).max() > 1e-4


def test_one_milliradian_moves_the_ladle_ten_millimetres_sideways():
    position, tilt = box_poses(200, 5)
    moved = np.array([closed(position, tilt, tilted(200, k, 1e-3)).position - position for k in range(6)])
    worst = np.abs(moved).max(axis=(0, 1))
    assert 5e-3 < worst[1] < 40e-3
    assert worst[1] > 2.0 * max(worst[0], worst[2])
    spread = closed(position, tilt, Errors.none(200), local=True).by_local[:, 1, 24:84]
    assert 8e-3 < 1e-3 * np.linalg.norm(spread, axis=1).max() < 13e-3


def test_the_twist_weight_hardly_matters_and_the_gap_is_taken_where_one_likes():
    position, tilt = box_poses(50, 6)
    errors = tilted(50, 6, 4e-4)
    joint, origin = (closed(position, tilt, errors, at_joint=flag).position for flag in (True, False))
    assert np.abs(joint - origin).max() < 0.02 * np.abs(joint - position).max()


def test_transfer_matrices_are_the_derivatives():
    position, tilt = box_poses(20, 7)
    exact = closed(position, tilt, Errors.none(20), local=True)
    names = [("upper", 12), ("lower", 12), ("tilt", 60), ("length", 4), ("theta", 1)]
    place = 0
    for name, count in names:
        for k in range(0, count, 5):
            ends = []
            for step in (1e-5, -1e-5):
                errors = Errors.none(20)
                getattr(errors, name).reshape(20, -1)[:, k] = step
                ends.append(closed(position, tilt, errors))
            turned = to_vector(product(ends[0].quaternion, conjugate(ends[1].quaternion)))
            slope = np.concatenate([ends[0].position - ends[1].position, turned], axis=1) / 2e-5
            np.testing.assert_allclose(exact.by_local[:, :, place + k], slope, atol=1e-5, err_msg=f"{name} {k}")
        place += count
    np.testing.assert_allclose(exact.by_drive, exact.by_local[:, :, [84, 85, 86, 88]], atol=1e-9)


def test_pull_and_moment_are_the_slope_of_the_ladles_energy():
    scene = plan(np.random.default_rng(8), 30, 1)

    def height(errors):
        poses = close(scene.drives[:, :3], scene.drives[:, 3], errors, (scene.position, scene.tilt))
        return poses.position[:, 2] + (matrix(poses.quaternion) @ CENTRE_OF_MASS)[:, 2]

    for k in range(4):
        up, down = Errors.none(30), Errors.none(30)
        for errors, step in ((up, 1e-6), (down, -1e-6)):
            (errors.theta if k == 3 else errors.length[:, k])[:] = step
        force = -scene.weight * (height(up) - height(down)) / 2e-6
        np.testing.assert_allclose(scene.moment if k == 3 else scene.pull[:, k], force, rtol=1e-5, atol=0.05)
    assert scene.pull[:, :2].sum(axis=1).min() > 0.0  # the ladle hangs


def test_rotations_agree_with_scipy():
    rng = np.random.default_rng(9)
    v, w = rng.normal(size=(2, 40, 3))
    a, b = Rotation.from_rotvec(v), Rotation.from_rotvec(w)
    p, q = from_vector(v), from_vector(w)
    np.testing.assert_allclose(matrix(product(p, q)), (a * b).as_matrix(), atol=1e-13)
    np.testing.assert_allclose(to_vector(product(p, q)), (a * b).as_rotvec(), atol=1e-12)
    np.testing.assert_allclose(
        matrix(about(np.array([0.0, 1.0, 0.0]), 0.3)), Rotation.from_rotvec([0, 0.3, 0]).as_matrix()
    )


# --- effects and campaigns -------------------------------------------------------------------------


def test_the_fourteen_ids_in_two_forms_each_and_six_outsiders():
    assert set(LIBRARY) == IDS
    assert all(len(forms) >= 2 for forms in LIBRARY.values())
    assert len(OUTSIDE) >= 6
    assert all(name.startswith("x_") for name in OUTSIDE)
    assert set(textbook(plan(np.random.default_rng(0), 20, 1, local=True))) == IDS


@pytest.mark.parametrize("effect", [*LIBRARY, *OUTSIDE])
def test_every_form_is_as_large_as_asked(effect):
    for form in FORMS[effect]:
        campaign = make_campaign("single", 11, wanted=(Wanted(effect, 4.0, form),), rows=50, sessions=3)
        (told,) = campaign.truth["effects"]
        assert (told["effect"], told["form"]) == (effect, form)
        capped = told["size"] == CAPS.get(effect, 60.0) and told["ratio_to_noise"] < 4.0
        assert capped or told["ratio_to_noise"] == pytest.approx(4.0, rel=1e-6)
        assert not capped or effect == "metrology_scale"
        assert told["rms_mm"] > 0.0


@pytest.fixture(scope="module")
def bench():
    """A campaign, a tracker that sees it, and the textbook's columns."""
    scene = plan(np.random.default_rng(12), 80, 2, local=True)
    tracker = Tracker(np.zeros(6), np.zeros(6), 5e-5, 3e-5)
    faultless = tracker.see(scene, Errors.none(80))
    return scene, tracker, faultless, tracker.frames(faultless), textbook(scene)


@pytest.mark.parametrize("effect", list(LIBRARY))
def test_of_every_form_the_textbook_explains_most(effect, bench):
    scene, tracker, faultless, frames, columns = bench
    both = basis(np.concatenate([frames, tracker.in_own_frame(scene, columns[effect])], axis=1))
    for form, errors in FORMS[effect].items():
        unit = errors(scene, np.random.default_rng(13)) * 0.1
        signature = tracker.whiten(*tracker.difference(tracker.see(scene, unit), faultless))
        assert rms(without(signature, both)) < 0.75 * rms(without(signature, basis(frames))), form


def frames_fitted(campaign):
    """The residual over the noise when the test's own fit of the two frames is taken out."""
    table = {name: np.array([float(row[name]) for row in campaign.rows]) for name in campaign.rows[0]}
    drives = np.column_stack([table["q1_mm"], table["q2_mm"], table["q3_mm"], 1e3 * table["q4_rad"]]) / 1e3
    seen = np.column_stack([table[k] for k in ("x_mm", "y_mm", "z_mm")]) / 1e3
    turn = Rotation.from_rotvec(np.column_stack([table[k] for k in ("rx_rad", "ry_rad", "rz_rad")]))
    near = (seen, turn.as_euler("YXZ")[:, 0])
    poses = close(drives[:, :3], drives[:, 3], Errors.none(len(seen)), near)
    plate = Rotation.from_matrix(matrix(poses.quaternion))
    noise = campaign.settings["metrology"]

    def residual(x):
        base, target = Rotation.from_rotvec(x[3:6]), Rotation.from_rotvec(x[9:12])
        position = x[:3] + base.apply(poses.position + plate.apply(x[6:9]))
        twist = (turn * (base * plate * target).inv()).as_rotvec()
        parts = ((seen - position) * 1e3 / noise["sigma_position_mm"], twist / noise["sigma_rotation_rad"])
        return np.concatenate([part.ravel() for part in parts])

    return least_squares(residual, np.zeros(12), x_scale="jac").fun


@pytest.mark.parametrize(("effect", "form", "ratio"), [("drive_scale", "b", 6.0), ("joint_axis_tilt", "a", 3.0)])
def test_the_file_shows_noise_and_effect_at_the_wanted_ratio(effect, form, ratio):
    options = {"rows": 150, "background": False, "full_pose": True, "spoilt": False}
    null = frames_fitted(make_campaign("null", 21, **options))
    assert np.mean(null**2) == pytest.approx(1.0, abs=0.15)
    gap = frames_fitted(make_campaign("single", 22, wanted=(Wanted(effect, ratio, form),), **options))
    assert np.sqrt(np.mean(gap**2) - 1.0) == pytest.approx(ratio, rel=0.03)


@pytest.mark.parametrize("number", range(len(CONFOUNDED)))
def test_confounded_cases_name_the_truth_and_its_doubles(number):
    campaign = make_campaign("confounded", (30, number), turn=number, rows=120)
    assert campaign == make_campaign("confounded", (30, number), turn=number, rows=120)
    told = campaign.truth["effects"][0]
    assert told["effect"] == CONFOUNDED[number][0]
    assert told["effect"] in campaign.truth["accept"]
    assert 2 <= len(campaign.truth["accept"]) <= 5


@pytest.mark.parametrize("number", range(len(OUTSIDE)))
def test_no_mixture_of_known_effects_explains_an_outsider(number):
    campaign = make_campaign("outside", (40, number), turn=number, rows=110)
    told = campaign.truth["effects"][0]
    assert told["ratio_beyond_library"] > 1.2
    assert told["ratio_beyond_library"] <= told["ratio_to_noise"]


def test_files_are_as_the_contract_says(tmp_path):
    for seed, full in enumerate((True, False)):
        campaign = make_campaign("pair", (50, seed), full_pose=full)
        folder = write_case(tmp_path / str(seed), campaign)
        text = (folder / "campaign.csv").read_text(encoding="utf-8")
        assert text.splitlines()[0] == HEADER + (",rx_rad,ry_rad,rz_rad" if full else "")
        rows = list(csv.DictReader(text.splitlines()))
        assert [int(row["sample"]) for row in rows] == list(range(len(rows)))
        assert {row[f"approach_q{k}"] for row in rows for k in (1, 2, 3, 4)} == {"1", "-1"}
        assert all(-175 < float(row["x_mm"]) < -25 for row in rows if row["x_mm"])
        # The last third repeats the first poses; times rise.
        repeat = len(rows) - len(rows) // 3
        assert [row["q1_mm"] for row in rows[repeat:]] == [row["q1_mm"] for row in rows[: len(rows) - repeat]]
        times = [float(row["time_s"]) for row in rows]
        assert times == sorted(times)

        settings = yaml.safe_load((folder / "campaign.yaml").read_text(encoding="utf-8"))
        sigma = settings["metrology"].pop("sigma_rotation_rad")
        assert (sigma in {3e-5, 6e-5}) is full
        assert settings["metrology"].pop("sigma_position_mm") in {0.03, 0.05, 0.1}
        assert settings == {
            "robot": "pouring_robot",
            "description": "static poses of the moving platform seen by a laser tracker",
            "metrology": {"target": "moving_platform", "frame": "tracker"},
            "drives": {"screw_pitch_mm": 10.0},
            "truss": {"span_m": 6.0},
            "ladle": {"tare_kg": 180.0, "centre_of_mass_mm": [50.0, 0.0, -280.0]},
            "reference_temperature_degC": 20.0,
        }
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        assert {"effects", "kind", "background", "outliers", "accept", "frames", "seed"} == set(truth)
        assert truth["kind"] == "pair"
        assert len({item["effect"] for item in truth["effects"]}) == 2
        told = set(truth["effects"][0]) - {"parameters"}  # only forms that have constants tell them
        assert told == {"effect", "form", "size", "ratio_to_noise", "rms_mm", "unit"}


def test_lost_cells_outliers_and_biased_thermometers_occur():
    campaigns = [make_campaign("null", (60, k), rows=110) for k in range(30)]
    lost = [sum(cell == "" for row in item.rows for cell in row.values()) for item in campaigns]
    assert any(lost)
    assert max(lost) <= 3
    assert any(item.truth["outliers"] for item in campaigns)
    assert max(len(item.truth["outliers"]) for item in campaigns) <= 2
    scene = plan(np.random.default_rng(61), 150, 1)
    gap = scene.thermometers[:, :4] - scene.leg_temperature
    assert np.abs(gap.mean(axis=0)).max() > 0.3


def test_a_seed_gives_the_same_files_and_another_one_does_not(tmp_path, capsys):
    for folder, seed in (("first", 1), ("again", 1), ("other", 2)):
        main(["--out", str(tmp_path / folder), "--cases", "4", "--seed", str(seed)])
    assert len(capsys.readouterr().out.splitlines()) == 12
    for number in range(4):
        for name in ("campaign.csv", "campaign.yaml", "truth.json"):
            one, again = (tmp_path / folder / f"case_{number:03d}" / name for folder in ("first", "again"))
            assert filecmp.cmp(one, again, shallow=False)
        other = tmp_path / "other" / f"case_{number:03d}" / "campaign.csv"
        assert other.read_bytes() != (tmp_path / "first" / f"case_{number:03d}" / "campaign.csv").read_bytes()


def test_a_tracker_metres_away_sees_the_same_machine():
    near, far = (make_campaign("null", 70, rows=60, full_pose=True, far_tracker=flag) for flag in (False, True))
    assert max(abs(float(row["x_mm"] or 0.0)) for row in near.rows) < 200.0
    assert max(abs(float(row[k] or 0.0)) for row in far.rows for k in ("x_mm", "y_mm", "z_mm")) > 400.0


def test_wrong_names_are_refused():
    with pytest.raises(ValueError, match="no kind 'triple'"):
        make_campaign("triple", 1)
    with pytest.raises(ValueError, match="no effect 'rust'"):
        make_campaign("single", 1, wanted=(Wanted("rust", 3.0),))
    with pytest.raises(ValueError, match="has no form 'z'"):
        make_campaign("single", 1, wanted=(Wanted("drive_scale", 3.0, "z"),))
    with pytest.raises(ValueError, match="no trap 'fog'"):
        make_campaign("null", 1, trap="fog")
    assert KINDS == ("null", "single", "pair", "outside", "confounded")
