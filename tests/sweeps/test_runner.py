"""The same results whatever happens in between: kills, workers, lost workers, Ctrl-C."""

import functools
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError, Future

import pytest
from distributed.comm.core import CommClosedError

from pouring_robot.cli.app import main
from pouring_robot.exceptions import BadInputError, SweepStoreError, SweepWorkerError
from pouring_robot.sweeps import SweepPlan, SweepStore, run_sweep
from pouring_robot.sweeps.runner import _result
from tests.support import ROOT
from tests.sweeps.sweep_files import numbers, snapshot, write

CHUNKS = 90
MANY_CHUNKS = {"samples": CHUNKS, "chunk": 8}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A sweep of many chunks, run in one go: (sweep file, folder)."""
    folder = tmp_path_factory.mktemp("undisturbed")
    config = write(folder, **MANY_CHUNKS)
    assert main(["sweep", str(config), "--out", str(folder / "out"), "--json"]) == 0
    return config, folder / "out"


def finished_chunks(out):
    return len(list(out.glob("results.zarr/status/c/*/0")))


def start(config, out, *more):
    command = [sys.executable, "-m", "pouring_robot", "sweep", str(config), "--out", str(out), "--resume", "--json"]
    command += more
    # A group of its own: the signal must not reach the tests. It is heard even if whoever runs the tests ignores it.
    return subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )


def wait_for(out, chunks, process):
    until = time.monotonic() + 60
    while finished_chunks(out) < chunks and process.poll() is None and time.monotonic() < until:
        time.sleep(0.001)


def test_killed_at_two_moments_and_resumed_is_as_if_never_killed(undisturbed, tmp_path):
    config, expected = undisturbed
    out = tmp_path / "out"
    moments = random.Random(int.from_bytes(os.urandom(4), "big"))
    for low in (0, 45):
        process = start(config, out)
        wait_for(out, low + moments.randrange(1, 40), process)
        time.sleep(moments.random() * 0.01)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL, "it ended before it was killed"
        assert not (out / "summary.json").exists()
    assert 45 < finished_chunks(out) < CHUNKS
    assert main(["sweep", str(config), "--out", str(out), "--resume", "--json"]) == 0
    assert snapshot(out) == snapshot(expected)  # the reports and every byte of the store, and nothing left over


def test_ctrl_c_keeps_what_is_done(undisturbed, tmp_path, capsys, monkeypatch):
    config, expected = undisturbed
    out, write_chunk = tmp_path / "out", SweepStore.write

    def write_twenty(store, chunk, result):
        if chunk.index[0] == 20:
            raise KeyboardInterrupt
        write_chunk(store, chunk, result)

    with monkeypatch.context() as patch:
        patch.setattr(SweepStore, "write", write_twenty)
        assert main(["sweep", str(config), "--out", str(out)]) == 130
    err = capsys.readouterr().err
    assert err == f"pouring-robot: stopped; 20 of {CHUNKS} chunks are kept in {out}: continue with --resume\n"
    assert finished_chunks(out) == 20
    run_sweep(SweepPlan.load(config), out, resume=True)
    assert numbers(out) == numbers(expected)


def test_ctrl_c_of_a_terminal_reaches_worker_processes_too(undisturbed, tmp_path):
    config, expected = undisturbed
    out = tmp_path / "out"
    process = start(config, out, "--workers", "1")
    wait_for(out, 1, process)  # of 90, so that a busy machine is not too late
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    said = error.decode()
    assert said.startswith("pouring-robot: stopped; ") and said.count("\n") == 1
    run_sweep(SweepPlan.load(config), out, resume=True)
    assert numbers(out) == numbers(expected)


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes, as a user might have one."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as running:
        yield running


def test_a_killed_worker_loses_nothing(undisturbed, tmp_path, cluster):
    config, expected = undisturbed
    seen = []

    def kill_one(stage, done, total):
        seen.append(done)
        if done in (15, 40):  # the second one may well be the worker that took over
            alive = [nanny.pid for nanny in cluster.workers.values() if nanny.pid]
            os.kill(alive[0], signal.SIGKILL)

    run_sweep(SweepPlan.load(config), tmp_path / "out", scheduler=cluster.scheduler_address, progress=kill_one)
    assert seen == list(range(CHUNKS + 1))
    assert numbers(tmp_path / "out") == numbers(expected)


def test_a_cluster_goes_on_where_this_process_stopped(undisturbed, tmp_path, cluster):
    config, expected = undisturbed
    plan = SweepPlan.load(config)

    def stop(stage, done, total):
        if done == 50:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(plan, tmp_path / "out", progress=stop)
    run_sweep(plan, tmp_path / "out", resume=True, scheduler=cluster.scheduler_address)
    assert numbers(tmp_path / "out") == numbers(expected)


def fail(plan, chunk):
    raise ValueError("a fault on the worker")


def test_a_fault_on_a_worker_is_one_line(plan, tmp_path, cluster, monkeypatch):
    monkeypatch.setattr(SweepPlan, "compute", fail)
    with pytest.raises(SweepWorkerError, match=r"a worker of the cluster failed \(ValueError: a fault on the worker\)"):
        run_sweep(plan, tmp_path / "out", scheduler=cluster.scheduler_address)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("gone", [CancelledError(), CommClosedError("Stream is closed")])
def test_a_lost_scheduler_is_one_line(gone):
    future = Future()
    future.set_exception(gone)
    with pytest.raises(
        SweepWorkerError, match="the Dask scheduler is lost; start it again, then continue with --resume"
    ):
        _result(future)


def test_workers_of_another_version_are_refused(plan, tmp_path, cluster, monkeypatch):
    monkeypatch.setattr("pouring_robot.sweeps.runner.pouring_robot.__version__", "99.0")
    plan = SweepPlan(plan.config)  # others' keeps the version that it saw first
    with pytest.raises(SweepWorkerError, match=r"a worker runs pouring_robot 0\..*, this is 99.0"):
        run_sweep(plan, tmp_path / "out", scheduler=cluster.scheduler_address)


def test_a_stop_before_the_first_chunk_leaves_nothing(plan, tmp_path):
    def stop(stage, done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(plan, tmp_path / "out", progress=stop)
    assert not (tmp_path / "out").exists()


def test_a_stop_does_not_take_older_results_away(undisturbed, tmp_path, plan):
    with pytest.raises(SweepStoreError):
        run_sweep(plan, undisturbed[1])
    assert finished_chunks(undisturbed[1]) == CHUNKS


@pytest.mark.parametrize("workers", [-1, 1.5, "2", True])
def test_workers_are_a_number_of_processes(plan, tmp_path, workers):
    with pytest.raises(BadInputError, match=f"workers is a number of processes, .* not {workers!r}"):
        run_sweep(plan, tmp_path / "out", workers=workers)
    assert not (tmp_path / "out").exists()


def test_workers_and_a_scheduler_are_not_both_asked_for(plan, tmp_path):
    with pytest.raises(BadInputError, match="workers or a scheduler, not both"):
        run_sweep(plan, tmp_path / "out", workers=1, scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()


def test_workers_that_do_not_start_are_told_with_what_scripts_need(plan, tmp_path, monkeypatch):
    def refuse(**settings):
        raise RuntimeError("Nanny failed to start.")  # as where each would begin the sweep anew

    monkeypatch.setattr("distributed.LocalCluster", refuse)
    with pytest.raises(SweepWorkerError, match=r"no worker starts .* under if __name__ == '__main__':"):
        run_sweep(plan, tmp_path / "out", workers=1)


def test_no_more_processes_are_started_than_there_are_chunks(plan, tmp_path, monkeypatch):
    started = []

    def refuse(workers, scheduler):
        started.append(workers)
        raise SweepWorkerError("none")

    monkeypatch.setattr("pouring_robot.sweeps.runner._client", refuse)
    with pytest.raises(SweepWorkerError):
        run_sweep(plan, tmp_path / "out", workers=100_000)
    assert started == [plan.chunk_grid[0] * plan.chunk_grid[1]]
