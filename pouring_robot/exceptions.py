"""Errors that the package raises on purpose, each with its figures and one line that says how to fix it.

:class:`BadInputError`: what was given is wrong. :class:`NoSolutionError`: the input is valid, but the mechanism has no
answer. :class:`StoppedError`: the user stopped the work. ``str(error)`` is always one line, and the arguments of a
constructor are attributes of the error.
"""

from __future__ import annotations

import copyreg
import difflib
import enum
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def closest(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest known name, or all known names when none is near."""
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; known: {', '.join(names)}" if names else ""


def some(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Return ``a, b and 7 more``: the first ``most`` names, and how many others there are."""
    return between.join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def counted(count: int, one: str) -> str:
    """Return ``1 row`` or ``7 rows``: a count and its noun, whose singular is ``one``."""
    return f"{count} {one}{'' if count == 1 else 's'}"


class ExitCode(enum.IntEnum):
    """Exit codes of the command line."""

    DONE = 0
    BAD_INPUT = 2  # a file, an option or a value cannot be used
    NO_SOLUTION = 3  # the input is valid, but the mechanism has no answer
    FAULT = 70  # an internal error of the program, as in ``sysexits.h``
    STOPPED = 130  # Ctrl-C, as in shells


class PouringRobotError(Exception):
    """Base of all errors of this package."""

    exit_code = ExitCode.FAULT

    def __str__(self) -> str:
        return " ".join(super().__str__().splitlines())

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy the attributes: the constructor does not take the message that Python would pass to it."""
        return copyreg.__newobj__, (type(self), *self.args), vars(self)  # type: ignore[attr-defined]


class BadInputError(PouringRobotError):
    """What the user gave cannot be used: a file, an option or a value."""

    exit_code = ExitCode.BAD_INPUT


class NoSolutionError(PouringRobotError):
    """The input is valid, but the mechanism has no answer for it."""

    exit_code = ExitCode.NO_SOLUTION


class StoppedError(PouringRobotError):
    """The user stopped the work; the message says which results are kept."""

    exit_code = ExitCode.STOPPED


class _FileError(BadInputError):
    """A file or folder is faulty; the message states the problem on one line."""

    _before = ""

    def __init__(self, path: Path | str, problem: str) -> None:
        self.path, self.problem = Path(path), " ".join(problem.split())
        super().__init__(f"{self._before}{path}: {self.problem}")


class OutputError(_FileError):
    """A result cannot be written where it was asked for."""

    _before = "cannot write "


class SweepStoreError(_FileError):
    """Results of a sweep cannot be written, read or resumed."""


class DescriptionError(_FileError):
    """A file that describes something is wrong: a URDF, a xacro, or a YAML file of any kind."""


class TableError(BadInputError):
    """A table of numbers is wrong.

    Attributes:
        line: line of the file (the header is line 1) or row from 1 (Parquet), where it is known.
        column: heading of the column, where it is known.
    """

    _shown_column = "column {}"

    def __init__(self, path: Path | str, problem: str, line: int | None = None, column: str | None = None) -> None:
        self.path, self.problem, self.line, self.column = Path(path), " ".join(problem.split()), line, column
        places = [f"line {line}"] if line is not None else []
        if column is not None:
            places.append(self._shown_column.format(" ".join(column.split())[:80]))
        where = f"{', '.join(places)}: " if places else ""
        super().__init__(f"{path}: {where}{self.problem}")


class CampaignError(TableError):
    """A measurement campaign or a pose plan is wrong."""

    _shown_column = "column '{}'"


class UnknownLayoutError(BadInputError):
    """A layout was requested that is not in the dimensions file."""

    def __init__(self, name: str, known: Sequence[str], path: Path | str) -> None:
        self.name, self.known, self.path = name, tuple(known), Path(path)
        super().__init__(f"unknown layout '{name}' in {self.path.name}; known: {', '.join(known)}")


class _UnknownPartError(BadInputError):
    """The robot has no part of that name; the nearest known one is suggested."""

    _kind = ""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        self.name, self.known = name, tuple(known)
        super().__init__(f"the robot has no {self._kind} '{name}'{closest(name, self.known)}")


class UnknownJointError(_UnknownPartError):
    """A joint was named that the robot does not have."""

    _kind = "joint"


class UnknownFrameError(_UnknownPartError):
    """A frame was named that the robot does not have."""

    _kind = "frame"


class UnsupportedMechanismError(BadInputError):
    """The engine for stars of chains cannot handle this mechanism; the general engine can."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(
            f"this engine takes serial chains that end on one common body, but {problem}; "
            "engine_for finds the engine for any mechanism"
        )


class ClosureError(NoSolutionError):
    """The loops cannot be closed for these drive values.

    Attributes:
        iterations: Newton steps taken.
        gap_m: largest remaining distance between two frames that should coincide, in m; ``gap_rad``: angle, in rad.
        worst_loop: the loop with the largest gap; None for a mechanism without loops.
        status: as in the batch engines, one of ``batch.STATUS_NAMES``.
    """

    def __init__(
        self, reason: str, *, iterations: int, gap_m: float, gap_rad: float, worst_loop: str | None, status: str
    ) -> None:
        self.iterations, self.gap_m, self.gap_rad, self.worst_loop = iterations, gap_m, gap_rad, worst_loop
        self.status = status
        stopped = f"{reason} after {iterations} iterations"
        super().__init__(
            f"the arm finds no equilibrium: {stopped}; check the weight and the stiffness of its drives"
            if worst_loop is None
            else f"the loops do not close: {stopped}; '{worst_loop}' is left open by {gap_m * 1e3:.4g} mm and "
            f"{gap_rad * 1e3:.4g} mrad; check the drive values and the model's errors"
        )


class BatchClosureError(NoSolutionError):
    """Some samples of a batch have no closed pose.

    Attributes:
        counts: number of samples of each status other than closed.
        samples: number of samples in all.
        first: index of the first sample that failed.
    """

    def __init__(self, counts: dict[str, int], samples: int, first: int) -> None:
        self.counts, self.samples, self.first = dict(counts), samples, first
        failed = ", ".join(f"{count} {name}" for name, count in counts.items())
        super().__init__(
            f"{sum(counts.values())} of {samples} samples do not close ({failed}; the first is sample {first}); "
            "check their drive values and errors, or leave out the samples whose status is not 0"
        )


class UnreachablePoseError(NoSolutionError):
    """A pose needs a joint beyond its limits, by ``excess``; values are in m or rad, as ``unit`` says."""

    def __init__(self, joint: str, value: float, lower: float, upper: float, unit: str) -> None:
        self.joint, self.value, self.lower, self.upper, self.unit = joint, value, lower, upper, unit
        factor, shown = (1e3, "mm") if unit == "m" else (math.degrees(1.0), "deg")
        self.excess = lower - value if value < lower else value - upper
        # Two digits of the excess, and as many decimals of the values it is the difference of.
        small = 0.0 < self.excess * factor < 0.1
        digits = 1 - math.floor(math.log10(self.excess * factor)) if small else 2
        at, beyond, least, most = (f"{number * factor:z.{digits}f}" for number in (value, self.excess, lower, upper))
        super().__init__(
            f"the pose is out of reach: joint '{joint}' would stand at {at} {shown}, "
            f"{beyond} {shown} beyond its limits {least} to {most} {shown}"
        )


class UnreachableTargetError(NoSolutionError):
    """No drive values bring the end body to a pose.

    Attributes:
        left: remaining error of the nearest ones, (6,): displacement in m and rotation vector in rad.
        commanded: most freedoms that the drives command; ``asked``: freedoms of the pose.
    """

    def __init__(self, left: NDArray[np.float64], commanded: int, asked: int) -> None:
        self.left, self.commanded, self.asked = left, commanded, asked
        away, turned = (float(f"{1e3 * math.sqrt(float(part @ part)):.3g}") for part in (left[:3], left[3:]))
        super().__init__(
            f"the pose is out of reach: the nearest that was found is {away:g} mm and {turned:g} mrad away"
            + (f"; the robot commands {commanded} of the {asked} freedoms asked for" if commanded < asked else "")
        )


class PathPoseError(NoSolutionError):
    """The pose on a line of a list has no solution; ``reason`` is the error of the pose itself."""

    def __init__(self, path: Path | str, line: int, reason: NoSolutionError) -> None:
        self.path, self.line, self.reason = Path(path), line, reason
        super().__init__(f"{path}: line {line}: {reason}")


class _DegeneratePoseError(NoSolutionError):
    """Drives and platform do not determine each other here; ``ratio`` says how near this is to singular."""

    _words = ""

    def __init__(self, ratio: float) -> None:
        self.ratio = ratio
        super().__init__(f"{self._words} {ratio:.1e}); choose another pose")


class SingularPoseError(_DegeneratePoseError):
    """The drives do not determine the platform; ratio: least over largest eigenvalue of the free joints' Hessian."""

    _words = "the mechanism is singular here: with its drives held the platform can still move (eigenvalue ratio"


class LockedPoseError(_DegeneratePoseError):
    """No drives move a frame along some direction; ratio: least over largest singular value of its Jacobian."""

    _words = "the drives cannot move the robot in every direction here (ratio of singular values"


class CompensationError(NoSolutionError):
    """No drive values bring the robot as built to a pose.

    Attributes:
        wanted: the nominal command for that pose, in words.
        left_m: distance that remains after the last step, in m; ``left_rad``: remaining tilt, in rad.
    """

    def __init__(self, wanted: str, left_m: float, left_rad: float) -> None:
        self.wanted, self.left_m, self.left_rad = wanted, left_m, left_rad
        super().__init__(
            f"no drive values found for {wanted}: Newton's last step leaves {left_m * 1e3:.3g} mm and "
            f"{left_rad * 1e3:.3g} mrad; choose a pose further from a singularity"
        )


class UnsettledCommandsError(NoSolutionError):
    """Effects depend on the commands that are to cancel them, and these commands do not converge.

    Attributes:
        pose: number of the pose, from 1.
        moved: how much a command still changes, in m or rad.
    """

    def __init__(self, pose: int, moved: float) -> None:
        self.pose, self.moved = pose, moved
        super().__init__(
            f"pose {pose}: the model's effects depend on the compensated commands, which do not converge: they still "
            f"change by {moved * 1e3:.2g} mm or mrad; state sides of approach (approach_<drive>), or check the size "
            "of the effects"
        )


class SweepWorkerError(BadInputError):
    """The cluster of a sweep cannot be reached, or its workers fail."""


class FrameFitError(BadInputError):
    """The frames of tracker and target cannot be fitted.

    Attributes:
        rows: rows with reachable drives and a complete measured position.
        needed: rows that are needed.
    """

    def __init__(self, rows: int, needed: int) -> None:
        self.rows, self.needed = rows, needed
        super().__init__(
            f"the frames of tracker and target need at least {needed} rows with reachable drives and a complete "
            f"position, and there are {rows}; measure more poses, or correct the drive values"
        )


class DataError(NoSolutionError):
    """Measured data cannot answer what is asked of them; ``mend`` says what to do about it."""

    def __init__(self, problem: str, mend: str) -> None:
        self.problem, self.mend = " ".join(problem.split()), " ".join(mend.split())
        super().__init__(f"{self.problem}; {self.mend}")


class CalibrationError(DataError):
    """A robot cannot be calibrated with these data; nothing is exported."""


class DiagnosisError(DataError):
    """A campaign cannot be diagnosed; nothing is written."""


class MissingConditionsError(BadInputError):
    """A model's effect depends on conditions that were not given: columns, or keys of a campaign's YAML.

    ``headings`` are all that are missing, also for ``others`` of its effects; ``problem`` is the message without the
    remedy.
    """

    def __init__(
        self, effect: str, headings: Sequence[str], instead: Sequence[str] = (), others: Sequence[str] = ()
    ) -> None:
        self.effect, self.headings, self.instead, self.others = effect, tuple(headings), tuple(instead), tuple(others)
        first, names = self.headings[0], "', '".join((effect, *others))
        needed = ", ".join(headings) + (f" (or, for the load, {', '.join(instead)})" if instead else "")
        self.problem = f"the model's effect{'s' if others else ''} '{names}' need{'' if others else 's'} {needed}"
        super().__init__(
            f"{self.problem}: give a column of that name beside the poses, or one value for all of them by --condition "
            f"{first}=VALUE (in Python {{'{first}': VALUE}})"
        )


class TooLargeError(BadInputError):
    """A joint or drive is displaced by more than any robot's error; ``problem`` is the message without the remedy."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(f"{problem}; check the unit")


class TemperatureError(BadInputError):
    """A temperature, such as that of the ``melt``, is impossible for the reason ``fault``, or not finite."""

    def __init__(self, what: str, value_degC: float, fault: str = "") -> None:
        self.what, self.value_degC = what, value_degC
        self.fault = fault or f"{value_degC:g} degC is not a temperature; check the value"
        super().__init__(f"{what}: {self.fault}")


class HistoryError(BadInputError):
    """A history of temperatures or poses cannot be used; ``row`` is the faulty entry, from 1, if there is one."""

    def __init__(self, problem: str, row: int | None = None) -> None:
        self.problem, self.row = problem, row
        super().__init__(f"history{'' if row is None else f', entry {row}'}: {problem}")


class ThermalSolutionError(NoSolutionError):
    """The temperatures cannot be found."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(f"no temperatures found: {problem}; check the thermal properties")
