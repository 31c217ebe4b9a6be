"""The store on disk: its content, which sweep may continue it, and failures of the disk."""

import errno
import json
import shutil
import subprocess

import numpy as np
import pytest
import zarr

from pouring_robot.cli.app import main
from pouring_robot.exceptions import SweepStoreError
from pouring_robot.sweeps import SweepConfig, SweepPlan, SweepStore, open_results, run_sweep
from tests.sweeps.sweep_files import numbers, snapshot, write


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished sweep with its reports: (sweep file, folder)."""
    folder = tmp_path_factory.mktemp("finished")
    config = write(folder)
    assert main(["sweep", str(config), "--out", str(folder / "out"), "--json"]) == 0
    return config, folder / "out"


@pytest.fixture
def copy(finished, tmp_path):
    """A copy of it that a test may spoil."""
    shutil.copytree(finished[1], tmp_path / "out")
    return finished[0], tmp_path / "out"


def refused(config, out, pattern, capsys, *options):
    capsys.readouterr()
    before = snapshot(out)
    code = main(["sweep", str(config), "--out", str(out), *options])
    captured = capsys.readouterr()
    assert code == 2 and captured.out == "" and captured.err.count("\n") == 1, captured.err
    assert pattern in captured.err, captured.err
    assert snapshot(out) == before


def test_what_is_too_large_is_refused_before_older_results_are_taken_away(copy, tmp_path, capsys, monkeypatch):
    _, out = copy
    large = write(tmp_path, "large.yaml", samples=10**12)
    refused(large, out, "1000000000000 robots at 8 poses need", capsys, "--overwrite")
    usage = shutil.disk_usage(out)
    for total in (10**18, 0):  # of none that tells its size
        monkeypatch.setattr("pouring_robot.sweeps.store.shutil.disk_usage", lambda _, t=total: usage._replace(total=t))
        refused(large, out, "of memory, but this machine has", capsys, "--overwrite")


def test_arrays_are_labelled_and_carry_units(finished, plan):
    data = open_results(finished[1])
    assert data.displacement.dims == ("sample", "pose", "frame", "axis")
    assert {name: data[name].attrs["units"] for name in ("displacement", "rotation", "gap_m", "gap_rad")} == {
        "displacement": "m",
        "rotation": "rad",
        "gap_m": "m",
        "gap_rad": "rad",
    }
    assert data.status.dtype == np.uint8 and (data.status == 0).all()
    assert tuple(data.parameter.values) == plan.names
    assert np.array_equal(data.errors.values, plan.draws.values(0, plan.draws.count))
    assert np.array_equal(data.position.values, plan.poses.start.position)
    displacement = plan.moved(plan.draws.values(5, 6), plan.poses).displacement
    assert np.array_equal(data.displacement.sel(frame="ladle_lip").values[5], displacement[0, :, 0])


def test_seed_config_version_and_content_are_on_record(finished, plan):
    attributes = open_results(finished[1]).attrs
    assert attributes["seed"] == 11 and attributes["version"] == plan.content["version"]
    assert attributes["content_hash"] == plan.content_hash
    assert SweepConfig.model_validate_json(attributes["config"]) == plan.config


def test_a_one_at_a_time_study_is_labelled_by_parameter(make_plan, tmp_path):
    plan = make_plan(study="one_at_a_time", samples=None, chunk=30)
    run_sweep(plan, tmp_path)
    data = open_results(tmp_path)
    one = data.displacement.sel(parameter="alpha_e3_23", frame="ladle_lip")
    row = plan.names.index("alpha_e3_23")
    alone = np.diag([m.tolerance for m in plan.draws.margins])[row : row + 1]
    assert (
        np.array_equal(one.values, plan.moved(alone, plan.poses).displacement[0, :, 0])
        and data.tolerance.values[row] == 0.5e-3
    )


def test_chunks_by_pose_give_the_same_numbers(make_plan, tmp_path, finished):
    run_sweep(make_plan(chunk=5), tmp_path)  # of eight poses
    for name in ("displacement", "rotation", "status", "errors", "gap_rad"):
        assert np.array_equal(open_results(tmp_path)[name].values, open_results(finished[1])[name].values)


def test_results_are_only_overwritten_if_asked_for(copy, tmp_path, capsys):
    both = "holds results already; continue with --resume (resume=True), or use --overwrite (overwrite=True)"
    refused(*copy, both, capsys)
    refused(*copy, "resume or overwrite, not both", capsys, "--resume", "--overwrite")
    other = write(tmp_path, seed=12)
    assert main(["sweep", str(other), "--out", str(copy[1]), "--overwrite"]) == 0
    assert open_results(copy[1]).attrs["seed"] == 12
    assert not [path for path in copy[1].iterdir() if path.name.startswith(".")]


def test_what_is_no_sweep_is_not_overwritten(copy, capsys):
    group = zarr.open_group(copy[1] / "results.zarr", mode="w")
    group.attrs["format"] = "something else"
    refused(*copy, "is not the store of a sweep", capsys, "--overwrite")


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"seed": 12}, "seed"),
        ({"chunk": 32}, "chunk"),
        ({"samples": 41}, "samples"),
        ({"layout": "wide"}, "layout, urdf"),
        ({"poses": {"grid": {"x": 2}}}, "poses); use another folder"),
    ],
)
def test_another_sweep_is_not_gone_on_with(copy, tmp_path, capsys, changes, named):
    other = write(tmp_path, **changes)
    refused(other, copy[1], f"results of another sweep (it differs in {named}", capsys, "--resume")


def test_another_version_of_the_package_is_not_gone_on_with(copy, capsys, monkeypatch):
    monkeypatch.setattr("pouring_robot.__version__", "99.0")
    refused(*copy, "it differs in package version 0.", capsys, "--resume")


def test_reports_without_their_store_are_not_overwritten(copy, capsys):
    shutil.rmtree(copy[1] / "results.zarr")
    refused(*copy, "holds summary.json of another sweep", capsys)
    refused(*copy, "holds summary.json of another sweep", capsys, "--resume")


@pytest.mark.parametrize(
    ("file", "text", "pattern"),
    [
        ("zarr.json", "{", "is damaged"),
        ("zarr.json", None, "is damaged"),
        ("displacement/zarr.json", "{}", "is damaged"),
        ("status/zarr.json", None, "is damaged"),
        ("displacement/c/1/0/0/0", "spoilt", "chunk 1.0 of 'displacement' is damaged"),
    ],
)
def test_a_damaged_store_is_left_alone(copy, capsys, file, text, pattern):
    path = copy[1] / "results.zarr" / file
    path.unlink() if text is None else path.write_text(text)
    refused(*copy, pattern, capsys, "--resume")


def test_a_strange_store_is_left_alone(copy, capsys):
    path = copy[1] / "results.zarr" / "zarr.json"
    metadata = json.loads(path.read_text())
    metadata["attributes"] = {"title": "somebody else's"}
    path.write_text(json.dumps(metadata))
    refused(*copy, "is not the store of a sweep", capsys, "--resume")


@pytest.mark.parametrize("name", ["gap_rad", "tolerance"])
def test_a_store_of_another_shape_is_left_alone(copy, capsys, name):
    path = copy[1] / "results.zarr" / name / "zarr.json"
    metadata = json.loads(path.read_text())
    metadata["shape"] = [3 for _ in metadata["shape"]]
    path.write_text(json.dumps(metadata))
    refused(*copy, "is damaged", capsys, "--resume")


def test_a_chunk_without_its_status_is_done_again(copy, finished, capsys):
    store = copy[1] / "results.zarr"
    (store / "status/c/1/0").write_bytes((store / "status/c/1/0").read_bytes()[:-3])
    (store / "displacement/c/1/0/0/0").write_bytes(b"half")
    (store / "status/c/3/0").unlink()
    assert main(["sweep", str(copy[0]), "--out", str(copy[1]), "--resume", "--json"]) == 0
    assert snapshot(copy[1]) == snapshot(finished[1])


def test_a_finished_sweep_is_only_summed_up_again(copy, finished, monkeypatch):
    monkeypatch.setattr(SweepPlan, "compute", lambda *_: pytest.fail("nothing is left to compute"))
    (copy[1] / "summary.json").unlink()
    assert main(["sweep", str(copy[0]), "--out", str(copy[1]), "--resume", "--json"]) == 0
    assert snapshot(copy[1]) == snapshot(finished[1])


def test_no_two_sweeps_in_one_folder_at_a_time(copy, plan):
    store = SweepStore(copy[1], plan, resume=True)
    with store.alone(), pytest.raises(SweepStoreError, match="another sweep is running"), store.alone():
        pass


class FullDisk:
    """Lets Zarr write so many files of some kind, then there is no space left."""

    def __init__(self, monkeypatch, files, kind=""):
        from zarr.storage import _local

        self.left, put = files, _local._put

        def write_or_fail(path, *arguments, **options):
            self.left -= kind in str(path)
            if self.left < 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            return put(path, *arguments, **options)

        monkeypatch.setattr(_local, "_put", write_or_fail)


def test_a_disk_full_from_the_start_leaves_nothing(tmp_path, capsys, monkeypatch):
    config, kept = write(tmp_path), tmp_path / "kept"
    kept.mkdir()
    for files, kind in ((7, ""), (0, "displacement/c")):
        for out in (tmp_path / "out", kept):
            with monkeypatch.context() as patch:
                FullDisk(patch, files, kind)
                assert main(["sweep", str(config), "--out", str(out)]) == 2
            assert "there is no space left on the device" in capsys.readouterr().err
            assert sorted(tmp_path.rglob("*")) == [kept, config]


def test_a_disk_that_fills_up_keeps_what_is_done(tmp_path, capsys, finished, monkeypatch):
    config, out = write(tmp_path), tmp_path / "out"
    with monkeypatch.context() as patch:
        FullDisk(patch, files=2, kind="displacement/c")
        assert main(["sweep", str(config), "--out", str(out)]) == 2
    err = capsys.readouterr().err
    assert "no space left on the device; the finished chunks are kept" in err and err.count("\n") == 1
    assert len(list((out / "results.zarr/status/c").iterdir())) == 2
    assert sorted(p.name for p in out.iterdir()) == ["results.zarr"]
    assert main(["sweep", str(config), "--out", str(out), "--resume", "--json"]) == 0
    assert numbers(out) == numbers(finished[1])


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 300 kB, where the machine lets us make one."""
    mount = tmp_path / "disk"
    mount.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(mount)]
    if not shutil.which("mount") or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("needs the right to mount a small file system")
    yield mount
    subprocess.run(["umount", str(mount)], check=True)


def test_a_really_full_disk(tmp_path, capsys, small_disk):
    out = small_disk / "out"
    refused(write(tmp_path, samples=400), out, "the disk of", capsys)
    config = write(tmp_path, samples=160, chunk=80)
    assert main(["sweep", str(config), "--out", str(out)]) == 2
    err = capsys.readouterr().err
    assert "no space left on the device; the finished chunks are kept" in err and err.count("\n") == 1
    assert 0 < len(list((out / "results.zarr/status/c").iterdir())) < 16


def test_there_is_nothing_to_open(tmp_path):
    with pytest.raises(SweepStoreError, match="holds no results of a sweep"):
        open_results(tmp_path / "nothing")
