"""Runs a sweep: in this process, in local processes, or on a Dask cluster; always the same chunks and results."""

import concurrent.futures
import contextlib
import functools
import itertools
import logging
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pouring_robot
from pouring_robot.exceptions import BadInputError, SweepWorkerError
from pouring_robot.io.argument_checks import expect, whole
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.sweeps.analysis.report import SweepReport, report
from pouring_robot.sweeps.config import SweepConfig
from pouring_robot.sweeps.plan import Chunk, ChunkResult, SweepPlan
from pouring_robot.sweeps.store import RESUME, SweepStore, remove_sweep, require_room

_Results = Generator[tuple[Chunk, ChunkResult], None, None]
_CONNECT_SECONDS = 15
# A terminal's Ctrl-C reaches all processes; this one handles it and ends the others.
_DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
_AHEAD = 2  # chunks in progress per thread of the cluster: none is idle, and memory is bounded


def sweep(
    config: SweepPlan | SweepConfig | Path | str,
    out: Path | str,
    *,
    resume: bool = False,
    overwrite: bool = False,
    workers: int = 0,
    scheduler: str | None = None,
    progress: Progress = say_nothing,
) -> SweepReport:
    """Run a tolerance study and return its report; only the store is written until the report is saved.

    A warning lists what is ignored of the model file: heat, and effects that depend on conditions.

    Args:
        config: the sweep file, its content, or a plan made from it.
        out: folder for the results, created if necessary.
        resume: continue a sweep that was begun there.
        overwrite: replace a sweep that is there.
        workers: processes on this machine, 0 or more, at most one per chunk; 0: this process, with all its threads.
            They also run the calling script, so its code must be under ``if __name__ == "__main__":``.
        scheduler: address of a Dask cluster to compute on instead; results are written here.
        progress: called for every chunk.

    Raises:
        DescriptionError: the file is wrong.
        BadInputError: ``config`` is none of these, a name in it does not fit the robot, the results are larger than the
            disk or their sums than the memory, ``workers`` is not a valid number, or both ``resume`` and ``overwrite``,
            or ``workers`` and ``scheduler``, are given.
        UnreachablePoseError: a pose is out of reach.
        SweepStoreError: the folder holds other results or cannot be written to, or the disk is full.
        SweepWorkerError: the cluster cannot be reached, or its workers do not start or fail.
        NoSolutionError: no tolerances keep the requirement.
    """
    if isinstance(config, Path | str):
        config = SweepConfig.load(config)
    plan = SweepPlan(config) if isinstance(config, SweepConfig) else config
    expect(plan, SweepPlan, "a sweep is a SweepPlan, a SweepConfig or the path of a file")
    if plan.config.model is not None:
        plan.model.warn_of_left_out("sweep", str(plan.config.model))
    expect(out, Path | str, "the folder for results is a path")
    folder = Path(out).absolute()  # the process may change its folder before the report is saved
    store = run_sweep(
        plan, folder, resume=resume, overwrite=overwrite, workers=workers, scheduler=scheduler, progress=progress
    )
    return report(store, progress)


@one_blas_thread()
def run_sweep(
    plan: SweepPlan,
    folder: Path | str,
    *,
    resume: bool = False,
    overwrite: bool = False,
    workers: int = 0,
    scheduler: str | None = None,
    progress: Progress = say_nothing,
) -> SweepStore:
    """Compute and write the missing chunks of a sweep; arguments and errors as for :func:`sweep`."""
    if overwrite and resume:
        raise BadInputError("resume or overwrite, not both: one continues, the other starts again")
    workers = whole(workers, 0, "workers is a number of processes, 0 for this one alone")
    if workers and scheduler:
        raise BadInputError("workers or a scheduler, not both: the cluster has workers of its own")
    require_room(folder, plan)
    if overwrite:
        remove_sweep(folder)
    store = SweepStore(folder, plan, resume=resume)
    with store.alone():
        try:
            _complete(store, workers, scheduler, progress)
        except BaseException:
            store.discard_empty()
            raise
    return store


def _complete(store: SweepStore, workers: int, scheduler: str | None, progress: Progress) -> None:
    plan, missing = store.plan, store.missing()
    total = plan.chunk_grid[0] * plan.chunk_grid[1]
    done = total - len(missing)
    progress("sweep", done, total)
    if not missing:
        return
    here = ((chunk, plan.compute(chunk)) for chunk in missing)
    results = _clustered(plan, missing, workers, scheduler) if workers or scheduler else here
    with contextlib.closing(results):
        for number, (chunk, result) in enumerate(results, start=done + 1):
            store.write(chunk, result)
            progress("sweep", number, total)


def _clustered(plan: SweepPlan, chunks: list[Chunk], workers: int, scheduler: str | None) -> _Results:
    """Yield chunks as a cluster finishes them; Dask reassigns those of a lost worker."""
    with _client(min(workers, len(chunks)), scheduler) as client:
        import distributed

        waiting = iter(chunks)
        # The plan is sent as a task, not as data: if the workers that hold it are lost, Dask makes it again.
        there = client.submit(functools.partial(_received, plan), pure=False)
        finished = distributed.as_completed(loop=client.loop)
        pending: dict[Any, Chunk] = {}

        def send(count: int) -> None:
            for chunk in itertools.islice(waiting, count):
                future = client.submit(SweepPlan.compute, there, chunk, pure=False)
                pending[future] = chunk
                finished.add(future)

        threads = max(1, sum(client.nthreads().values()))
        send(_AHEAD * threads)
        for future in finished:
            result = _result(future)
            send(1)
            yield pending.pop(future), result


def _received(plan: SweepPlan) -> SweepPlan:
    plan.threads = 1  # a worker computes one chunk per thread at a time
    return plan


def _result(future: Any) -> ChunkResult:
    from distributed.comm.core import CommClosedError

    try:
        result: ChunkResult = future.result()
    except (concurrent.futures.CancelledError, CommClosedError) as problem:
        raise SweepWorkerError(f"the Dask scheduler is lost; start it again, then continue with {RESUME}") from problem
    except Exception as problem:
        reason = f"{type(problem).__name__}: {' '.join(str(problem).split())[:200]}"
        raise SweepWorkerError(
            f"a worker of the cluster failed ({reason}); see its log, then continue with {RESUME}"
        ) from problem
    if result.version != pouring_robot.__version__:
        raise SweepWorkerError(
            f"a worker runs pouring_robot {result.version}, this is {pouring_robot.__version__}; "
            "install the same version everywhere"
        )
    return result


@contextlib.contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """Connect to a cluster, or start one with processes on this machine."""
    import distributed

    with contextlib.ExitStack() as stack:
        if scheduler is None:
            try:
                cluster: Any = distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address="127.0.0.1:0",  # Dask starts a server anyway: any free port, this machine
                    scheduler_kwargs={"dashboard": False},
                    silence_logs=logging.CRITICAL,  # errors of workers are reported by `_result`
                    preload=_DEAF,
                )
            except RuntimeError as problem:
                raise SweepWorkerError(
                    "no worker starts on this machine; workers run a script, too, so call the sweep in it under "
                    "if __name__ == '__main__':"
                ) from problem
            stack.enter_context(cluster)
        else:
            cluster = scheduler
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # its messages are given here
        try:
            client = stack.enter_context(distributed.Client(cluster, timeout=_CONNECT_SECONDS, set_as_default=False))
        except (OSError, ValueError, TypeError) as problem:
            raise SweepWorkerError(
                f"no Dask scheduler answers at '{scheduler}': {' '.join(str(problem).split())[:200]}; "
                "give an address such as tcp://host:8786"
            ) from problem
        yield client
