"""The results of a sweep on disk: a Zarr v3 store that grows chunk by chunk and survives a kill at any moment.

Arrays and dimensions, with SI units as attributes, to be opened with :func:`open_results` or ``xarray.open_zarr``:

=============  =================================  ======  ==========================================================
displacement   sample, pose, frame, axis          m       with the errors minus without them, fixed platform's axes
rotation       sample, pose, axis                 rad     rotation vector of the same (all frames are on one body)
gap_m          sample, pose                       m       largest distance left open in a loop
gap_rad        sample, pose                       rad     largest angle left open in a loop
status         sample, pose                               0 ok, 255 not done yet, else why it has no solution
errors         sample, parameter                  m, rad  the errors of each robot
=============  =================================  ======  ==========================================================

In a one-at-a-time study the first dimension is ``parameter``, and ``tolerance`` replaces ``errors``.

A chunk's status is written last, each file atomically (Zarr writes a temporary file and renames it): a chunk counts as
done when its status can be read and contains no 255. Otherwise all its arrays are written again.

SweepStoreError is raised where a store is missing, damaged or not a store, another sweep is running in its folder, or
the folder cannot be written to.
"""

import contextlib
import errno
import fcntl
import json
import math
import os
import shutil
import time
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
import zarr
from numpy.typing import NDArray

from pouring_robot.batch import STATUS_NAMES as BATCH_STATUS_NAMES
from pouring_robot.exceptions import SweepStoreError
from pouring_robot.io.files import hidden_name
from pouring_robot.sweeps.plan import Chunk, ChunkResult, SweepPlan

STORE = "results.zarr"
SUMMARY, RANKING, PICTURE, PAGE = REPORTS = ("summary.json", "ranking.csv", "sweep.png", "report.html")
RESUME, _OVERWRITE = "--resume (resume=True)", "--overwrite (overwrite=True)"
FORMAT = "pouring_robot/sweep-results/1"
AXES = ("x", "y", "z")
NOT_DONE = 255
STATUS_NAMES = dict(enumerate(("ok", *BATCH_STATUS_NAMES[1:]))) | {NOT_DONE: "not done"}
# Bytes that stay in memory: eight sums per robot (in a Sobol study also its points, and twice its outputs), and an
# index per chunk.
_A_ROBOT, _A_SOBOL_ROBOT, _A_CHUNK = 64, 128, 400


class SweepStore:
    """The store of one sweep in its folder, open for writing; ``resume``: continue an existing one.

    An existing store is refused and left unchanged without ``resume``, or if it is damaged or of another sweep.
    """

    def __init__(self, folder: Path | str, plan: SweepPlan, *, resume: bool = False) -> None:
        self.folder, self.plan = Path(folder), plan
        self.path = self.folder / STORE
        self._made: list[Path] = []
        if self.path.exists() or self.path.is_symlink():
            if not resume:
                raise SweepStoreError(
                    self.folder, (f"holds results already; continue with {RESUME}, or use {_OVERWRITE}")
                )
            self._group = open_group(self.path)
            self._refuse_other()
        else:
            for report in (name for name in REPORTS if (self.folder / name).exists()):
                raise SweepStoreError(
                    self.folder, f"holds {report} of another sweep; use another folder or {_OVERWRITE}"
                )
            with writing(self.folder):
                self._made = self._make()
            self._group = open_group(self.path)
        self._arrays: dict[str, Any] = {}
        for name, expected in _arrays(plan).items():
            try:
                self._arrays[name] = array = self._group[name]
            except Exception as problem:
                raise _damaged(self.path, f"array '{name}': {problem or 'missing'}") from problem
            if not isinstance(array, zarr.Array):
                raise _damaged(self.path, f"'{name}' is no array")
            if (array.shape, array.chunks) != (expected.shape, expected.chunks):
                raise _damaged(self.path, f"array '{name}' has shape {array.shape}, not {expected.shape}")

    def done(self, chunk: Chunk) -> bool:
        """Return whether a chunk is complete."""
        try:
            status = self._arrays["status"][chunk.samples, chunk.poses]
        except Exception:  # after any error in Zarr the chunk is not complete
            return False
        return bool((np.asarray(status) != NOT_DONE).all())

    def missing(self) -> list[Chunk]:
        """Return the chunks that remain to be computed, in order."""
        return [chunk for chunk in self.plan.chunks() if not self.done(chunk)]

    def write(self, chunk: Chunk, result: ChunkResult) -> None:
        """Write a chunk, its status last."""
        with writing(self.folder, f"the finished chunks are kept; correct it and continue with {RESUME}"):
            if "errors" in self._arrays and chunk.index[1] == 0:
                self._arrays["errors"][chunk.samples] = result.errors
            for name in ("displacement", "rotation", "gap_m", "gap_rad", "status"):
                self._arrays[name][chunk.samples, chunk.poses] = getattr(result, name)

    def read(self, name: str, chunk: Chunk) -> NDArray[Any]:
        """Return one array of a chunk."""
        try:
            return np.asarray(self._arrays[name][chunk.samples, chunk.poses])
        except Exception as problem:
            place = ".".join(str(k) for k in chunk.index)
            raise SweepStoreError(
                self.path,
                f"chunk {place} of '{name}' is damaged; remove its file under status/c and continue with {RESUME}",
            ) from problem

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Lock the folder against a second sweep, and delete incomplete files of a killed one."""
        with _locked(self.path):
            for stale in self.folder.glob(f".{STORE}.*.part"):
                shutil.rmtree(stale, ignore_errors=True)
            for name in self._arrays:
                for stale in (self.path / name).rglob("*.partial"):
                    stale.unlink(missing_ok=True)
            yield

    def discard_empty(self) -> None:
        """Remove what the constructor made, as long as no chunk is done; call while :meth:`alone`."""
        if self._made and not any(self.done(chunk) for chunk in self.plan.chunks()):
            shutil.rmtree(self.path, ignore_errors=True)
            for folder in self._made:
                with contextlib.suppress(OSError):  # it contains other files
                    folder.rmdir()

    def _make(self) -> list[Path]:
        """Write the empty store next to its place, then rename it; return it and the folders made for it."""
        made = [place for place in (self.folder, *self.folder.parents) if not place.exists()]
        self.folder.mkdir(parents=True, exist_ok=True)
        part = hidden_name(self.path)
        try:
            _write_empty(part, self.plan)
            part.rename(self.path)
        except BaseException as problem:
            for _ in range(3):  # Zarr's own thread may still be writing a file
                shutil.rmtree(part, ignore_errors=True)
                time.sleep(0.05)
            for folder in made:
                with contextlib.suppress(OSError):  # another sweep has started there
                    folder.rmdir()
            if isinstance(problem, OSError) and self.path.exists():
                raise SweepStoreError(self.folder, "another sweep has begun in this folder; wait for it") from problem
            raise
        return [self.path, *made]

    def _refuse_other(self) -> None:
        attributes = dict(self._group.attrs)
        if attributes.get("format") != FORMAT or "content" not in attributes:
            raise SweepStoreError(self.path, "is not the store of a sweep; use another folder")
        if attributes.get("content_hash") == self.plan.content_hash:
            return
        try:
            other = json.loads(str(attributes["content"]))
        except ValueError as problem:
            raise _damaged(self.path, "its attributes cannot be read") from problem
        raise SweepStoreError(
            self.folder,
            f"holds the results of another sweep ({_difference(other, self.plan.content)}); use another folder",
        )


def open_results(folder: Path | str) -> xr.Dataset:
    """Open the results in a sweep's folder, finished or not; arrays are read chunk by chunk when they are used."""
    path = Path(folder) / STORE if (Path(folder) / STORE).exists() else Path(folder)
    open_group(path)
    try:
        dataset: xr.Dataset = xr.open_zarr(path, consolidated=False)
        return dataset
    except Exception as problem:
        raise _damaged(path, str(problem)) from problem


def require_room(folder: Path | str, plan: SweepPlan) -> None:
    """Raise BadInputError for a sweep whose results are larger than its disk, or its sums larger than the memory.

    Results count without compression; the whole disk counts, as space can be freed while the sweep runs.
    """
    place, robots = Path(folder), plan.draws.count
    results = [array for array in _arrays(plan).values() if array.values is None]
    size = sum(math.prod(array.shape) * array.empty.itemsize for array in results)
    a_robot = _A_SOBOL_ROBOT if plan.config.study == "sobol" else _A_ROBOT
    kept = robots * a_robot + math.prod(plan.chunk_grid) * _A_CHUNK
    with writing(place):
        there = next(one for one in (place / STORE, place, *place.absolute().parents) if one.exists())
        disk = shutil.disk_usage(there).total
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    study = f"{robots} robots at {len(plan.poses)} poses"
    if 0 < disk < size:  # some file systems do not report their size
        raise plan.config.problem(
            f"the results of {study} need {_gigabytes(size)}, but the disk of {place} has {_gigabytes(disk)}; "
            "use fewer samples or poses, or a larger disk"
        )
    if kept > memory:
        raise plan.config.problem(
            f"the sums of {study} need {_gigabytes(kept)} of memory, but this machine has {_gigabytes(memory)}; "
            "use fewer samples, or larger chunks"
        )


def _gigabytes(size: int) -> str:
    return f"{Decimal(size) / 10**9:.3g} GB"  # which may exceed any float


def remove_sweep(folder: Path | str) -> None:
    """Remove the store and the reports of a sweep, if there are any."""
    folder = Path(folder)
    path = folder / STORE
    with writing(folder):
        if path.exists() or path.is_symlink():
            if dict(open_group(path).attrs).get("format") != FORMAT:
                raise SweepStoreError(path, "is not the store of a sweep; use another folder")
            with _locked(path):
                path.rename(gone := hidden_name(path))  # atomically: an interruption leaves no partial store
                shutil.rmtree(gone)
        for name in REPORTS:
            (folder / name).unlink(missing_ok=True)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Lock a store against other sweeps."""
    handle = os.open(path, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as problem:
            raise SweepStoreError(path.parent, "another sweep is running in this folder; wait for it") from problem
        yield
    finally:
        os.close(handle)  # releases the lock


def open_group(path: Path) -> zarr.Group:
    """Open a store for reading and writing."""
    if not path.is_dir():
        raise SweepStoreError(path, "holds no results of a sweep")
    try:
        return zarr.open_group(path, mode="r+", zarr_format=3)
    except Exception as problem:
        raise _damaged(path, str(problem)) from problem


@contextlib.contextmanager
def writing(folder: Path, advice: str = "choose a place you may write to") -> Iterator[None]:
    """Convert a failure to write, any OSError, into a SweepStoreError of one line."""
    try:
        yield
    except OSError as problem:
        full = problem.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "there is no space left on the device" if full else (problem.strerror or str(problem))
        raise SweepStoreError(folder, f"cannot be written to: {reason}; {advice}") from problem


def _damaged(path: Path, reason: str) -> SweepStoreError:
    short = " ".join(reason.split())[:200]
    return SweepStoreError(path, f"is damaged ({short}); nothing was changed: restore it, or use another folder")


def _difference(other: Any, own: dict[str, Any]) -> str:
    """Return in words the keys in which two contents differ."""
    if not isinstance(other, dict):
        return "with unknown settings"
    named = []
    for key, value in own.items():
        if other.get(key) == value:
            continue
        if key == "config" and isinstance(other.get(key), dict):
            named += [k for k in value if other[key].get(k) != value[k]]
        elif key == "version":
            named.append(f"package version {other.get(key)}")
        else:
            named.append(key)
    return "it differs in " + ", ".join(dict.fromkeys(named or ["unknown settings"]))


class _Array(NamedTuple):
    """One array of the store: its name and dimensions, and its values where they are known from the start."""

    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dimensions: tuple[str, ...]
    attributes: dict[str, Any]
    values: NDArray[Any] | None = None
    empty: np.generic = np.float64("nan")  # value of entries that are not known yet

    @classmethod
    def known(cls, values: Any, dimensions: tuple[str, ...], **attributes: str) -> "_Array":
        array = np.asarray(values)
        array = array.astype(np.dtypes.StringDType()) if array.dtype.kind == "U" else array
        return cls(array.shape, array.shape, dimensions, attributes, array)


def _arrays(plan: SweepPlan) -> dict[str, _Array]:
    """Return the arrays of the store: those known from the start, then those written chunk by chunk."""
    both, block = (plan.draws.count, len(plan.poses)), (plan.sample_block, plan.pose_block)
    first = "parameter" if plan.config.study == "one_at_a_time" else "sample"
    frames, parameters, margins = len(plan.config.frames), plan.parameters, plan.draws.margins
    either = {"units": "m or rad, see 'unit'"}
    codes = {"codes": "; ".join(f"{code} {name}" for code, name in STATUS_NAMES.items())}
    place, known = f"{plan.mechanism.loops.end_frame}, commanded", _Array.known
    tilts = plan.model.definition.command_columns[-1].name == "tilt"
    tilt = {"tilt": known(plan.poses.poses[:, 3], ("pose",), units="rad")} if tilts else {}
    errors = (both[0], len(parameters)), (block[0], len(parameters)), ("sample", "parameter")
    moved = (*both, frames, 3), (*block, frames, 3), (first, "pose", "frame", "axis")
    return {
        "parameter": known(plan.names, ("parameter",)),
        "unit": known([p.unit for p in parameters], ("parameter",)),
        "part": known([p.part for p in parameters], ("parameter",)),
        "tolerance": known([margin.tolerance for margin in margins], ("parameter",), **either),
        "std": known([margin.std for margin in margins], ("parameter",), **either),
        "frame": known(plan.config.frames, ("frame",)),
        "axis": known(AXES, ("axis",)),
        "position": known(plan.poses.start.position, ("pose", "axis"), units="m", of=place),
        **tilt,
        "drive": known([drive.joint for drive in plan.catalogue.drives], ("drive",)),
        "command": known(plan.poses.drives, ("pose", "drive"), units="m or rad, by drive"),
        "displacement": _Array(*moved, {"units": "m"}),
        "rotation": _Array((*both, 3), (*block, 3), (first, "pose", "axis"), {"units": "rad"}),
        "gap_m": _Array(both, block, (first, "pose"), {"units": "m"}),
        "gap_rad": _Array(both, block, (first, "pose"), {"units": "rad"}),
        "status": _Array(both, block, (first, "pose"), codes, empty=np.uint8(NOT_DONE)),
        **({"errors": _Array(*errors, either)} if first == "sample" else {}),
    }


def _write_empty(path: Path, plan: SweepPlan) -> None:
    config = plan.config
    group = zarr.create_group(
        path,
        zarr_format=3,
        attributes={
            "format": FORMAT,
            "title": config.description or f"{config.study}, {config.kind}",
            "study": config.study,
            "kind": config.kind,
            "seed": config.seed,
            **plan.model.named,
            "version": plan.content["version"],
            "config": config.model_dump_json(),
            "content": json.dumps(plan.content, sort_keys=True),
            "content_hash": plan.content_hash,
        },
    )
    for name, (shape, chunks, dimensions, attributes, values, empty) in _arrays(plan).items():
        unknown = {"shape": shape, "dtype": empty.dtype, "fill_value": empty.item()}
        content: dict[str, Any] = unknown if values is None else {"data": values}
        group.create_array(name, chunks=chunks, dimension_names=dimensions, attributes=attributes, **content)
