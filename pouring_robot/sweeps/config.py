"""The sweep file: which errors, of which size, at which poses. Values stay in mm and mrad, as people write them."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pydantic
import scipy.special
from numpy.typing import ArrayLike
from pydantic import NonNegativeInt, PositiveFloat

from pouring_robot.exceptions import BadInputError, DescriptionError, closest
from pouring_robot.io.argument_checks import as_path
from pouring_robot.io.typed_yaml import Range, StrictModel, read_yaml, validate
from pouring_robot.io.units import DEG, MM
from pouring_robot.mechanism.arrays import FloatArray

Grouping = Literal["parameter", "part", "entry"]

NORMAL_TOLERANCE_SIGMAS, WITHIN_IT = 3.0, 0.9973
"""The tolerance assigned to an untruncated normal distribution, in standard deviations, and the share within it."""
_MOST_POSES = 1_000_000
Places = Annotated[int, pydantic.Field(ge=1, le=10_000)]


@dataclass(frozen=True)
class Margin:
    """Distribution of one error about zero, in its own unit."""

    tolerance: float  # largest error: half width, or limit; of an untruncated normal, three standard deviations
    std: float  # standard deviation, after truncation
    from_deviates: Callable[[FloatArray], FloatArray]  # errors for standard normal deviates of any shape


def _truncated(std: float, limit: float) -> Margin:
    cut = limit / std
    inside = scipy.special.erf(cut / np.sqrt(2.0))
    # Second moment within the limits over the share within them: positive terms, so narrow limits lose no digits.
    variance = scipy.special.gammainc(1.5, 0.5 * cut**2) / inside
    return Margin(limit, std * float(np.sqrt(variance)), functools.partial(_within, std, inside))


def _evenly(half_width: float, deviates: FloatArray) -> FloatArray:
    return np.asarray(half_width * scipy.special.erf(deviates / np.sqrt(2.0)))


def _within(std: float, inside: float, deviates: FloatArray) -> FloatArray:
    # erf is exact for small deviates, where 1 - ndtr would round them.
    return np.asarray(std * np.sqrt(2.0) * scipy.special.erfinv(_evenly(inside, deviates)))


DISTRIBUTIONS: dict[str, tuple[tuple[str, ...], Callable[..., Margin]]] = {
    "uniform": (("half_width",), lambda half: Margin(half, half / np.sqrt(3.0), functools.partial(_evenly, half))),
    "normal": (("std",), lambda std: Margin(NORMAL_TOLERANCE_SIGMAS * std, std, functools.partial(np.multiply, std))),
    "truncated_normal": (("std", "limit"), _truncated),
}
"""What each is made of: its sizes, first how wide it is, which it needs in the unit of every parameter."""


class ErrorEntry(StrictModel):
    """Errors with the same distribution."""

    # names or patterns such as ``alpha_e*_56``, ``leg1_s1.t?``, ``drive.*``
    parameters: tuple[str, ...] = pydantic.Field(min_length=1)
    distribution: str = "uniform"  # a name of ``DISTRIBUTIONS``
    # half width of the uniform distribution, for lengths; ``half_width_mrad`` for angles, and likewise below
    half_width_mm: PositiveFloat | None = None
    half_width_mrad: PositiveFloat | None = None
    std_mm: PositiveFloat | None = None  # standard deviation of the normal distribution, before truncation
    std_mrad: PositiveFloat | None = None
    limit_mm: PositiveFloat | None = None  # where the normal distribution is truncated on both sides
    limit_mrad: PositiveFloat | None = None
    # correlation r of the normal deviates behind the errors of one part, 0 to 1. Between normal errors it is their
    # correlation; between uniform ones that is (6/π) asin(r/2), at most 0.02 less
    correlation: float = pydantic.Field(default=0.0, ge=0.0, le=1.0)

    @pydantic.field_validator("parameters", mode="before")
    @classmethod
    def _one_is_a_list(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @pydantic.field_validator("distribution", mode="before")
    @classmethod
    def _suggest(cls, value: Any) -> Any:
        if not isinstance(value, str) or value not in DISTRIBUTIONS:
            raise ValueError(f"unknown distribution{closest(str(value), DISTRIBUTIONS)}")
        return value

    @pydantic.model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        wanted = DISTRIBUTIONS[self.distribution][0]
        for unit in ("mm", "mrad"):
            given = [size for size in ("half_width", "std", "limit") if getattr(self, f"{size}_{unit}") is not None]
            if strange := [size for size in given if size not in wanted]:
                raise ValueError(f"{strange[0]}_{unit} does not belong to distribution '{self.distribution}'")
            if given and (missing := [size for size in wanted if size not in given]):
                raise ValueError(f"{missing[0]}_{unit} is missing: a truncated normal needs both")
        names = [f"{wanted[0]}_{unit}" for unit in ("mm", "mrad")]
        if all(getattr(self, name) is None for name in names):
            raise ValueError(f"no size is given; a {self.distribution} distribution needs {' or '.join(names)}")
        return self

    def size_si(self, size: str, unit: str) -> float | None:
        """Return ``half_width``, ``std`` or ``limit`` in its unit, m or rad; both file units are thousandths."""
        value = getattr(self, f"{size}_{'mm' if unit == 'm' else 'mrad'}")
        return None if value is None else MM * float(value)

    def margin(self, unit: str) -> Margin:
        """Return the distribution of its errors in a unit, m or rad."""
        sizes, made = DISTRIBUTIONS[self.distribution]
        return made(*(self.size_si(size, unit) for size in sizes))


class Box(StrictModel):
    """A part of the workspace, by lower and upper limits; limits that are left out are those of the layout."""

    x_mm: Range | None = None
    y_mm: Range | None = None
    z_mm: Range | None = None
    tilt_deg: Range | None = None

    def limits(self, layout: ArrayLike) -> FloatArray:
        """Return lower and upper limits of x, y, z and tilt, shape (2, 4), in m and rad; ``layout``: its limits."""
        limits = np.array(layout)
        for k, pair in enumerate((self.x_mm, self.y_mm, self.z_mm, self.tilt_deg)):
            if pair is not None:
                limits[:, k] = np.array(pair) * (DEG if k == 3 else MM)
        return limits


class Grid(StrictModel):
    """A number of values along each axis of a box, evenly spaced including both ends; one value is the middle."""

    x: Places = 1
    y: Places = 1
    z: Places = 1
    tilt: Places = 1
    box: Box = Box()

    @pydantic.model_validator(mode="after")
    def _not_too_many(self) -> Self:
        count = self.x * self.y * self.z * self.tilt
        if count > _MOST_POSES:
            raise ValueError(f"a grid of {count:,} poses is too large; use {_MOST_POSES:,} at most")
        return self


class RandomBox(StrictModel):
    """A number of poses drawn uniformly from a box."""

    count: int = pydantic.Field(ge=1, le=_MOST_POSES)
    seed: NonNegativeInt = 0
    box: Box = Box()


class Poses(StrictModel):
    """Commanded poses: one of the three; a file is a CSV with columns x, y, z, tilt and units in their names."""

    grid: Grid | None = None
    random: RandomBox | None = None
    file: str | None = None

    @pydantic.model_validator(mode="after")
    def _one(self) -> Self:
        if sum(choice is not None for choice in (self.grid, self.random, self.file)) != 1:
            raise ValueError("give exactly one of grid, random and file")
        return self


class Allocation(StrictModel):
    """The loosest tolerances that keep the requirement."""

    share: float = pydantic.Field(default=WITHIN_IT, gt=0.5, lt=1.0)  # of the robots that must meet it at each pose
    # whether each parameter, each part or each entry of ``errors`` gets a separate tolerance factor
    by: Grouping = "parameter"
    loosest_factor: PositiveFloat = 10.0  # largest ratio of a tolerance to the one in ``errors``
    machines: int = pydantic.Field(default=1000, ge=1)  # robots drawn to verify the result by exact closures


class SweepConfig(StrictModel):
    """A sweep file; files that it names are relative to its folder.

    Wrong content raises BadInputError; if it was read from a file, DescriptionError, which names line and key.
    """

    format: Literal["pouring_robot/sweep/1"] = "pouring_robot/sweep/1"
    description: str = ""  # a line for people
    layout: str | None = None  # name of the layout in the shipped dimensions file; or
    robot: str | None = None  # robot file of another robot; or
    model: str | None = None  # model file of a robot as built; errors are added to its own
    # ``one_at_a_time`` sets each error alone to its tolerance; ``monte_carlo`` draws robots; ``sobol`` draws robots by
    # Saltelli's scheme for Sobol indices
    study: Literal["one_at_a_time", "monte_carlo", "sobol"]
    # ``closed_chain``, or ``open_branch``: only the chain with the errors, its joints held, as in the paper
    kind: Literal["closed_chain", "open_branch"] = "closed_chain"
    # observed frames, fixed to the end body; by default the working frame and the end frame
    frames: tuple[str, ...] = ()
    poses: Poses  # commanded poses; every robot goes to every pose
    errors: tuple[ErrorEntry, ...] = ()  # possible errors; by default all of the geometry, by its tolerances
    tolerances: str | None = None  # a tolerances file for that (default: the robot's own, or the shipped one)
    # number of robots (monte_carlo) or of base samples, a power of two (sobol)
    samples: int | None = pydantic.Field(default=None, ge=1)
    seed: NonNegativeInt = 0  # of the draws
    # closures computed and written at a time; limits memory, does not change results
    chunk: int = pydantic.Field(default=20_000, ge=1, le=1_000_000)
    accuracy_mm: PositiveFloat | None = None  # required accuracy; by default that of the layout, for the pouring robot
    allocation: Allocation | None = None  # if given, the loosest tolerances are computed

    _folder: Path = pydantic.PrivateAttr(default_factory=Path)
    _source: Path | None = pydantic.PrivateAttr(default=None)
    _lines: tuple[int, ...] = pydantic.PrivateAttr(default=())

    @pydantic.model_validator(mode="after")
    def _fits_together(self) -> Self:
        if sum(name is not None for name in (self.layout, self.robot, self.model)) > 1:
            raise ValueError("give one of layout, robot and model, not both: a model file names its robot and layout")
        if self.errors and self.tolerances is not None:
            raise ValueError("tolerances replace errors; leave one of the two out")
        if (self.study == "one_at_a_time") != (self.samples is None):
            need = "takes no samples" if self.samples is not None else "needs samples, the number of robots"
            raise ValueError(f"study '{self.study}' {need}")
        if self.study == "sobol" and (self.samples == 1 or (self.samples or 0).bit_count() != 1):
            raise ValueError(f"study 'sobol' needs a power of two as samples, 2 or more, not {self.samples}")
        if self.study == "sobol" and any(entry.correlation for entry in self.errors):
            raise ValueError("Sobol indices need independent errors; leave correlation out, or use monte_carlo")
        if self.kind == "open_branch" and self.model is not None:
            raise ValueError("kind 'open_branch' is a study of the drawing; give layout instead of model")
        if self.kind == "open_branch" and self.allocation is not None:
            raise ValueError("allocation needs kind 'closed_chain': an open branch understates the errors")
        if len(set(self.frames)) < len(self.frames):
            raise ValueError("a frame is given twice")
        return self

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a sweep file."""
        path = as_path(path)
        content = read_yaml(path)
        config = validate(cls, content, path)
        config._folder, config._source = path.absolute().parent, path
        entries = content.get("errors", ())
        config._lines = tuple(int(entries.lc.item(k)[0]) + 1 for k in range(len(entries)))
        return config

    def with_robot(self, robot: Path | str) -> Self:
        """Return the same sweep for another robot, by its robot file."""
        if self.layout is not None or self.model is not None:
            raise self.problem("names a layout or a model; leave that out with --robot")
        return self.model_copy(update={"robot": str(Path(robot).absolute())})

    @property
    def source(self) -> Path | None:
        """The file it was read from, if any."""
        return self._source

    def problem(self, message: str, entry: int | None = None) -> BadInputError:
        """Return the error, to be raised, for a problem with the file or with one of its ``errors``."""
        if self._source is None:
            return BadInputError(message)
        line = f"line {self._lines[entry]}: errors.{entry}: " if entry is not None and self._lines else ""
        return DescriptionError(self._source, line + message)

    def beside(self, name: str) -> Path:
        """Return the path of a file that the sweep file names."""
        return self._folder / name
