"""A measurement campaign: static poses, what was commanded, under which conditions, and what was measured."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign import columns
from pouring_robot.campaign.metadata import (
    FROM_THE_ROW_BEFORE,
    CampaignMetadata,
    campaign_files,
    metadata_in,
    metadata_path,
    read_metadata,
)
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.exceptions import BadInputError, CampaignError, PouringRobotError, closest, counted
from pouring_robot.io.argument_checks import as_tuple, expect
from pouring_robot.io.files import write_together
from pouring_robot.io.quantity_columns import Quantity, QuantityTable, first_fault
from pouring_robot.io.tables import table_of
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, finite, locked, numbers, read_only
from pouring_robot.mechanism.closure.redundancy import redundant_drives
from pouring_robot.mechanism.rotations import rotation_matrices
from pouring_robot.report.result import Result
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.robot import AnyRobot, definition_of

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Result):
    """n static poses in SI units; temperatures in °C as their names say. Arrays are read-only.

    Missing cells are NaN. An array is None when none of its columns was in the file (or every cell of them is empty).

    Attributes:
        path: the table's file; for a campaign made in memory, the name it would have.
        lines: (n,) line of each row in the file (the header is line 1; in Parquet, the row from 1).
        samples: (n,) the user's name for each row; "" where none was given.
        sessions: (n,) the session of each row; all "1" without such a column.
        headings: heading in the file of each quantity it holds, by quantity name (``q1`` → ``q1_mm``).
        ignored_columns: headings that are not part of the format and were left out.
        drives: (n, drives) commanded values of the driven joints, in m and rad, in the robot's order.
        position_m: (n, 3) measured origin of the target in the tracker frame, in m.
        rotation_vector_rad: (n, 3) measured rotation vector of the target in the tracker frame, in rad; None for a
            campaign of positions only.
        distance_m: (n, 1) measured distance of the target from a fixed point, the origin of the tracker frame, or
            from where it was in the row whose sample :attr:`distance_from` names, in m; None where none was measured.
        distance_from: (n,) that sample; "" for the fixed point. If empty, all are from the fixed point.
        force: (n, drives) measured force or moment on each drive along its motion, in N and Nm, tension positive.
        approach: (n, drives) +1 where the drive's joint was rising when it stopped, -1 falling. The table refers to the
            command, which with a negative ratio has the opposite sign.
        conditions: (n,) values of each known condition, by quantity name, in s, kg, m and °C: ``time``,
            ``payload``, ``ambient``, the robot's travels and thermometers.
    """

    robot: RobotDefinition
    path: Path
    metadata: CampaignMetadata
    lines: NDArray[np.int64]
    samples: tuple[str, ...]
    sessions: tuple[str, ...]
    headings: dict[str, str]
    ignored_columns: tuple[str, ...]
    drives: FloatArray
    position_m: FloatArray
    rotation_vector_rad: FloatArray | None = None
    approach: FloatArray | None = None
    distance_m: FloatArray | None = None
    distance_from: tuple[str, ...] = ()
    force: FloatArray | None = None
    conditions: Mapping[str, FloatArray] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        expect(self.path, Path | str, "the path of a campaign is that of its table, or the one it would have")
        expect(self.metadata, CampaignMetadata, "the metadata of a campaign are CampaignMetadata")
        demand = "the lines of a campaign are whole numbers, one per row"
        lines = finite(self.lines, (None,), demand)
        if (lines % 1.0).any():
            raise BadInputError(demand)
        changed = {"robot": definition_of(self.robot), "path": Path(self.path), "lines": read_only(lines.astype(int))}
        texts = {name: _texts(getattr(self, name)) for name in ("samples", "sessions", "distance_from")}
        for name, value in {**changed, **texts}.items():
            object.__setattr__(self, name, value)
        rows = len(self)
        if rows == 0:
            raise BadInputError("a campaign needs at least one row")
        if {len(self.samples), len(self.sessions), len(self.distance_from) or rows} != {rows}:
            raise BadInputError(f"a campaign of {rows} rows needs as many samples, sessions and distance_from")
        for name, parts in columns.array_names(self.robot).items():
            values = getattr(self, name)
            if values is not None or name in ("drives", "position_m"):
                object.__setattr__(self, name, _checked(name, values, (rows, len(parts))))
        conditions = columns.numeric_conditions(self.robot)
        for unknown in (name for name in self.conditions if name not in conditions):
            raise BadInputError(
                f"'{unknown}' is not a condition of {self.robot.name}{closest(unknown, self._quantities)}"
            )
        kept = {name: _checked(name, values, (rows,)) for name, values in self.conditions.items()}
        known = {name: values for name, values in kept.items() if not np.isnan(values).all()}  # without empty columns
        object.__setattr__(self, "conditions", locked(known))
        for quantity in self._quantities.values():
            values = None if quantity.kind == "label" else self.command(quantity.name)
            if values is not None and (fault := first_fault(values, quantity.kind)):
                row, said = fault
                raise BadInputError(f"row {row + 1} of the campaign, {quantity.canonical}: {said}")

    @functools.cached_property
    def _quantities(self) -> dict[str, Quantity]:
        return {quantity.name: quantity for quantity in columns.campaign_columns(self.robot)}

    @functools.cached_property
    def _places(self) -> dict[str, tuple[str, int]]:
        """Array and column of each quantity that is part of an array."""
        arrays = columns.array_names(self.robot).items()
        return {name: (array, index) for array, names in arrays for index, name in enumerate(names)}

    @classmethod
    def of(cls, campaign: Campaign | Path | str, robot: RobotDefinition | None = None) -> Campaign:
        """Return the campaign itself, or read it from its table; see :meth:`read`.

        Raises:
            BadInputError: it is neither, or a campaign of another robot.
        """
        if isinstance(campaign, Path | str):
            return cls.read(campaign, robot)
        expect(campaign, Campaign, "a campaign is a Campaign (from_frame makes one) or the path of its table")
        if robot is not None and campaign.robot.name != robot.name:
            raise BadInputError(f"the campaign is one of {campaign.robot.name}, the model one of {robot.name}")
        return campaign

    @classmethod
    def read(cls, path: Path | str, robot: AnyRobot = None) -> Campaign:
        """Read a campaign: a CSV, Parquet or Excel table with units on its headings, and the YAML of the same stem.

        Empty cells become NaN. Only what cannot be understood is refused here; the *values* are checked by
        :func:`pouring_robot.check_campaign`. ``robot`` may be the path of its file; without one it is the pouring
        robot's.

        Raises:
            CampaignError: the table or the YAML file is missing, a heading is misspelt, has a wrong unit or occurs
                twice, a required column is missing, or a cell is not a number; names file, line and column.
            DescriptionError: a key or value of the YAML file is wrong; names line and key.
            BadInputError: ``robot`` is not a robot, or a file of it is wrong.
        """
        expect(path, Path | str, "Campaign.from_frame takes a data frame; read takes the path of a table")
        path, robot = Path(path), definition_of(robot)
        try:
            table = columns.read_columns(path, robot)
        except CampaignError as problem:
            _refuse_campaign_of_another(path, robot, problem)
            raise
        return cls._of_table(table, robot, read_metadata(metadata_path(path)))

    @classmethod
    def from_frame(
        cls,
        frame: pandas.DataFrame,
        metadata: CampaignMetadata | Mapping[str, Any],
        robot: AnyRobot = None,
        *,
        path: Path | str = "campaign.csv",
    ) -> Campaign:
        """Make a campaign from a pandas data frame with the columns of its table, units on their names.

        ``metadata`` may be a mapping with the content of the YAML file, ``{}`` if nothing is stated; ``path`` is the
        name that the campaign is to have. Raises as :meth:`read`; rows are counted from 1.
        """
        import pandas

        expect(frame, pandas.DataFrame, "a campaign is made from a pandas DataFrame with units on its columns' names")
        expect(path, Path | str, "the path of a campaign is the one its table would have")
        expect(metadata, CampaignMetadata | Mapping, "the metadata of a campaign are a mapping of what its YAML holds")
        robot, path = definition_of(robot), Path(path)
        if not isinstance(metadata, CampaignMetadata):
            metadata = metadata_in(metadata, path.with_suffix(".yaml"))
        return cls._of_table(columns.read_columns(table_of(frame, path, CampaignError), robot), robot, metadata)

    @classmethod
    def _of_table(cls, table: QuantityTable, robot: RobotDefinition, metadata: CampaignMetadata) -> Campaign:
        arrays, sessions = columns.arrays_from(table.numbers, robot), columns.sessions_of(table)
        if metadata.approach == FROM_THE_ROW_BEFORE:
            came = columns.from_the_row_before(arrays["drives"], arrays["conditions"].get("time"), sessions)
            stated = arrays.get("approach", np.full(came.shape, np.nan))
            arrays["approach"] = np.where(np.isfinite(stated), stated, came)
        found = cls(
            robot=robot,
            path=table.table.path,
            metadata=metadata,
            lines=table.table.lines,
            samples=table.labels.get("sample", ("",) * len(table)),
            sessions=sessions,
            headings=table.headings,
            ignored_columns=table.unknown,
            distance_from=table.labels.get(columns.DISTANCE_FROM, ()),
            **arrays,
        )
        for row, name in enumerate(found.distance_from):
            if name and (found.samples.count(name) != 1 or found.samples[row] == name):
                wrong = f"must be the sample of one other row, not '{name}'"
                raise table.fault(wrong, row, columns.DISTANCE_FROM)
        return found

    def save(self, path: Path | str, *, overwrite: bool = False) -> tuple[Path, Path]:
        """Write and return the table (CSV, or Parquet by its suffix) and the YAML of the same stem, both or neither.

        Raises:
            OutputError: a file is there already and ``overwrite`` is not set, it cannot be written, or not with that
                suffix.
        """
        table, metadata = write_together(self.contents(Path(path)), overwrite=overwrite)
        return table, metadata

    def contents(self, path: Path) -> dict[Path, bytes]:
        """Return what the two files would hold, by path; raises OutputError for a suffix that cannot be written."""
        return campaign_files(path, self._columns(), self.metadata)

    @property
    def headline(self) -> str:
        """Its content in one line."""
        return f"{len(self)} {self.seen} in {counted(len(set(self.sessions)), 'session')}, {self.path.name}"

    def __len__(self) -> int:
        return int(self.lines.size)

    @property
    def full_pose(self) -> bool:
        """Whether rotations were measured too."""
        return self.rotation_vector_rad is not None

    @property
    def seen(self) -> str:
        """What was measured, in words, and the number of complete rows where some are incomplete."""
        if not (self.full_pose or self.position_measured.any()):
            return "distances" if self.distance_m is not None else "closures"
        said, count = ("full poses", 6) if self.full_pose else ("positions", 3)
        whole = int(self._values_known[:, :count].all(axis=1).sum())
        return said if whole == len(self) else f"{said} ({whole} whole)"

    @property
    def values_measured(self) -> int:
        """How many numbers were measured in the usable rows."""
        known = self._values_known[self.usable]
        return int(known.sum()) + len(known) * self.redundant_drives

    @functools.cached_property
    def redundant_drives(self) -> int:
        """Number of drives beyond the robot's freedoms: the number of closures measured in every row."""
        return redundant_drives(self.robot.mechanism()) if self.robot.loops.redundant_drives else 0

    @functools.cached_property
    def distance_start(self) -> Indices:
        """Row from which each distance is measured, (n,); -1 for the fixed point, -2 for a row not in this campaign."""
        rows = {sample: row for row, sample in enumerate(self.samples)}
        starts = self.distance_from or ("",) * len(self)
        return np.array([rows.get(name, -2) if name else -1 for name in starts], dtype=np.intp)

    @property
    def position_measured(self) -> BoolArray:
        """Which coordinates were measured, (n, 3)."""
        return np.asarray(np.isfinite(self.position_m), dtype=np.bool_)

    @property
    def rotation_measured(self) -> BoolArray:
        """Which rotation components were measured, (n, 3); all False for positions only."""
        if self.rotation_vector_rad is None:
            return np.zeros((len(self), 3), dtype=bool)
        return np.asarray(np.isfinite(self.rotation_vector_rad), dtype=np.bool_)

    @property
    def _values_known(self) -> BoolArray:
        """Which coordinates, rotation components and distances were measured, (n, 6 or 7)."""
        distance = [] if self.distance_m is None else [np.isfinite(self.distance_m)]
        return np.hstack([self.position_measured, self.rotation_measured, *distance])

    @property
    def measured_poses(self) -> PoseStack:
        """The measured poses of the target in the tracker frame, whose arrays may be changed; NaN where missing."""
        vectors = self.rotation_vector_rad
        rotation = np.full((len(self), 3, 3), np.nan) if vectors is None else rotation_matrices(vectors)
        return PoseStack(np.array(self.position_m), rotation)

    @property
    def usable(self) -> BoolArray:
        """Which rows can be compared with a model, (n,): all drives known, and anything measured in it or from it."""
        commanded = np.isfinite(self.drives).all(axis=1)
        measured = np.asarray(self._values_known.any(axis=1) | self.robot.loops.redundant_drives)
        if self.distance_m is not None:
            starts = self.distance_start[np.isfinite(self.distance_m[:, 0])]
            measured[starts[starts >= 0]] = True
        return np.asarray(commanded & measured, dtype=np.bool_)

    def rows_by_session(self) -> dict[str, Indices]:
        """Return the rows of each session, ascending, sessions in order of appearance."""
        names = np.array(self.sessions)
        return {name: np.flatnonzero(names == name) for name in dict.fromkeys(self.sessions)}

    @property
    def time_s(self) -> FloatArray | None:
        """Time of measurement, (n,), in s."""
        return self.conditions.get("time")

    @property
    def payload_kg(self) -> FloatArray | None:
        """Mass of the payload, (n,), in kg."""
        return self.conditions.get("payload")

    def drive_values(self, row: int) -> dict[str, float]:
        """Return the commanded drives of a row by joint name, in m and rad, as the solvers take them."""
        return {drive.joint: float(value) for drive, value in zip(self.robot.drives, self.drives[row], strict=True)}

    def with_conditions(self, **changes: FloatArray | None) -> Campaign:
        """Return the same with other conditions, (n,) each by quantity name; None takes one out.

        Raises:
            BadInputError: the robot has no such condition, or a shape is wrong.
        """
        given = {**self.conditions, **changes}
        return dataclasses.replace(self, conditions={k: v for k, v in given.items() if v is not None})

    def quantity(self, name: str) -> FloatArray | None:
        """Return a numeric quantity by its name (``q1``, ``approach_q3``, ``leg2``, ``time``, ``rx``), (n,), or None.

        Values are in m, rad, kg, s and °C; None means that the campaign does not have it.

        Raises:
            BadInputError: there is no such quantity.
        """
        if name not in self._places:
            if name not in self._quantities or self._quantities[name].kind == "label":
                raise BadInputError(f"a campaign has no quantity '{name}'; known: {', '.join(self._quantities)}")
            return self.conditions.get(name)
        array, column = self._places[name]
        values: FloatArray | None = getattr(self, array)
        if values is None:
            return None
        kept = np.isfinite(values[:, column]).any() or array not in ("approach", "force")
        return values[:, column] if kept else None

    def command(self, name: str) -> FloatArray | None:
        """Return a quantity as its column holds it: of a drive with a gear the motor's value, not the joint's."""
        values = self.quantity(name)
        array, column = self._places.get(name, ("", 0))
        if array not in ("drives", "approach") or values is None:
            return values
        drive = self.robot.drives[column]
        return drive.side(values) if array == "approach" else drive.commanded(values)

    def heading(self, name: str) -> str:
        """Return the heading of a quantity in the file, or the one it would have."""
        return self.headings.get(name, self._quantities[name].canonical)

    def missing_conditions(self) -> tuple[str, ...]:
        """Return the conditions the campaign does not have, by canonical heading (``payload_kg``, ``leg1_degC``).

        Effects that depend on them cannot be tested with it.
        """
        spared = {*self.robot.thermometers} - {*self.robot.expected_thermometers}
        known = (q for q in self.robot.condition_columns if q.kind != "label" and q.name not in spared)
        names = [q.canonical for q in known if self.quantity(q.name) is None]
        return tuple(names if "session" in self.headings else ["session", *names])

    def subset(self, rows: Sequence[int] | Indices | BoolArray) -> Campaign:
        """Return a campaign of the given rows (indices from 0, or a mask of shape (n,)), in the given order.

        Raises:
            BadInputError: no row is left, an index is out of range, or a mask has another length.
        """
        given, count = np.asarray(rows), len(self)
        try:
            chosen = np.arange(count)[given]
        except IndexError:
            chosen = np.empty(0, dtype=np.intp)
        if chosen.ndim != 1 or chosen.size == 0 or given.min() < 0:
            said = f"indices from 0 to {count - 1}, or a mask of all {count}; at least one is chosen"
            raise BadInputError(f"rows of a campaign are {said}")
        arrays: dict[str, Any] = {name: getattr(self, name) for name in (*columns.array_names(self.robot), "lines")}
        changed: dict[str, Any] = {name: None if v is None else v[chosen] for name, v in arrays.items()}
        changed["conditions"] = {name: values[chosen] for name, values in self.conditions.items()}
        for name in ("samples", "sessions", "distance_from"):
            labels = getattr(self, name)
            changed[name] = tuple(labels[i] for i in chosen) if labels else ()
        return dataclasses.replace(self, **changed)

    def to_frame(self) -> pandas.DataFrame:
        """Return the rows as a pandas data frame with canonical headings (SI units, °C), a valid campaign table."""
        import pandas

        return pandas.DataFrame({quantity.canonical: list(values) for quantity, values in self._columns()})

    def _columns(self) -> Iterator[tuple[Quantity, FloatArray | Sequence[str]]]:
        """Yield the existing columns, as a file holds them."""
        labels = {"sample": self.samples, "session": self.sessions, columns.DISTANCE_FROM: self.distance_from}
        for quantity in self._quantities.values():
            values = labels[quantity.name] if quantity.kind == "label" else self.command(quantity.name)
            if values is not None and (quantity.name != columns.DISTANCE_FROM or any(values)):
                yield quantity, values


def _refuse_campaign_of_another(path: Path, robot: RobotDefinition, problem: CampaignError) -> None:
    """Raise CampaignError that the columns are another robot's, if the YAML of the table names one."""
    try:
        named = read_metadata(metadata_path(path)).robot
    except PouringRobotError:
        return  # the YAML's own mistake; that of the columns comes first
    if named and named != robot.name:
        said = f"is a campaign of the robot '{named}', but was read as one of '{robot.name}'"
        mend = "give its robot file (--robot; in Python the argument robot, its path)"
        raise CampaignError(path, f"{said}; {mend}") from problem


def _texts(values: Any) -> tuple[str, ...]:
    """Return labels of rows as texts; whole numbers are accepted, too."""
    for label in (labels := as_tuple(values)):
        expect(label, str | Integral, "each sample, session and distance_from of a campaign is a text")
    return tuple(map(str, labels))


def _checked(name: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
    return read_only(numbers(values, shape, f"'{name}' of the campaign must be numbers of the shape {shape}"))
