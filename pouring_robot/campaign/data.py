"""A measurement campaign: static poses, what was commanded, under which conditions, and what was measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign import columns
from pouring_robot.campaign.metadata import CampaignMetadata, metadata_path, read_metadata
from pouring_robot.campaign.writer import campaign_files
from pouring_robot.exceptions import BadInputError, CampaignError
from pouring_robot.io.files import check_outputs, write_together
from pouring_robot.io.quantities import read_quantities
from pouring_robot.mechanism.arrays import FloatArray, read_only
from pouring_robot.report.result import Result
from pouring_robot.robot.pouring.names import DRIVE_JOINTS, LEGS

if TYPE_CHECKING:
    import pandas

BoolArray: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Result):
    """n static poses in SI units; temperatures in °C as their names say. Arrays are read-only.

    Missing cells are NaN. An array is None when no column of it was in the file (or every cell of them is empty).

    Attributes:
        path: the table's file; where a campaign was made in memory, the name it would have.
        metadata: what holds for all rows.
        lines: (n,) line of each row in the file (the header is line 1; in Parquet, the row from 1).
        samples: (n,) the user's name of each row; "" where none was given.
        sessions: (n,) the session of each row; all "1" without a column.
        headings: heading in the file of each quantity that was there, by quantity name (``q1`` → ``q1_mm``).
        ignored_columns: headings that are no part of the contract and were left out.
        drives: (n, 4) commanded drives q1 q2 q3 in m and q4 in rad (:data:`DRIVE_JOINTS`).
        approach: (n, 4) +1 where the drive was rising when it stopped, -1 falling.
        time_s: (n,) time of measurement, in s.
        payload_kg: (n,) mass in the ladle, in kg.
        truss_travel_m: (n,) place along the rails, in m.
        melt_degC: (n,) temperature of the melt, in °C.
        ambient_degC: (n,) temperature of the hall, in °C.
        leg_degC: (n, 4) temperature of each leg, in °C.
        platform_degC: (n,) temperature of the moving platform, in °C.
        position_m: (n, 3) measured origin of the target in the tracker frame, in m.
        rotation_vector_rad: (n, 3) measured rotation vector of the target in the tracker frame, in rad; None for a
            campaign of positions only.
    """

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
    time_s: FloatArray | None = None
    payload_kg: FloatArray | None = None
    truss_travel_m: FloatArray | None = None
    melt_degC: FloatArray | None = None  # noqa: N815 - units are spelt as in the campaign files
    ambient_degC: FloatArray | None = None  # noqa: N815
    leg_degC: FloatArray | None = None  # noqa: N815
    platform_degC: FloatArray | None = None  # noqa: N815

    def __post_init__(self) -> None:
        """Check shapes and make the arrays read-only.

        Raises:
            BadInputError: an array has the wrong shape, or there is no row.
        """
        rows = int(np.asarray(self.lines).size)
        if rows == 0:
            raise BadInputError("a campaign needs at least one row")
        lines = np.array(self.lines, dtype=np.int64)
        lines.flags.writeable = False
        object.__setattr__(self, "lines", lines)
        if len(self.samples) != rows or len(self.sessions) != rows:
            raise BadInputError(f"a campaign of {rows} rows needs as many samples and sessions")
        for name, width in ARRAYS.items():
            values = getattr(self, name)
            if values is None:
                continue
            shape = (rows, width) if width else (rows,)
            if np.shape(values) != shape:
                raise BadInputError(f"'{name}' of the campaign must have shape {shape}, not {np.shape(values)}")
            object.__setattr__(self, name, read_only(np.array(values, dtype=np.float64)))

    @classmethod
    def of(cls, campaign: Campaign | Path | str) -> Campaign:
        """Return a campaign: itself, or read from its table.

        Raises:
            CampaignError: as :meth:`read`.
            BadInputError: it is neither.
        """
        if isinstance(campaign, Path | str):
            return cls.read(campaign)
        if not isinstance(campaign, Campaign):
            raise BadInputError(f"a campaign is a Campaign or the path of its table, not a {type(campaign).__name__}")
        return campaign

    @classmethod
    def read(cls, path: Path | str) -> Campaign:
        """Read a campaign: a CSV, Parquet or Excel table with units on its headings, and the YAML of the same stem.

        Empty cells become NaN. What is wrong with the *values* is the business of
        :func:`pouring_robot.checks.check.check_campaign`; here only what cannot be understood is refused.

        Raises:
            CampaignError: the table or the YAML file is missing, a heading is misspelt, has a wrong unit or stands
                twice, a required column is missing, or a cell is no number; names file, line and column.
            CampaignFileError: a key or value of the YAML file is wrong; names line and key.
        """
        path = Path(path)
        table = read_quantities(path, columns.CAMPAIGN, "q1_mm", CampaignError)
        metadata = read_metadata(metadata_path(path))
        arrays = arrays_from(table.numbers)
        drives, position = arrays.pop("drives"), arrays.pop("position_m")
        if drives is None or position is None:  # the reader of tables has made sure of both
            raise CampaignError(path, "holds no drives or no positions")
        return cls(
            path=path,
            metadata=metadata,
            lines=table.table.lines,
            samples=table.labels.get("sample", ("",) * len(table)),
            sessions=columns.sessions_of(table),
            headings=table.headings,
            ignored_columns=table.unknown,
            drives=drives,
            position_m=position,
            **arrays,
        )

    def save(self, path: Path | str, *, overwrite: bool = False) -> tuple[Path, Path]:
        """Write the table (CSV, or Parquet by its suffix) and the YAML of the same stem, both or neither.

        Returns:
            The two files.

        Raises:
            OutputError: a file is there already and ``overwrite`` is not set, or it cannot be written.
        """
        files = self.contents(Path(path))
        check_outputs(list(files), overwrite=overwrite)
        write_together(files)
        table, metadata = files
        return table, metadata

    def contents(self, path: Path) -> dict[Path, bytes]:
        """Return what the two files of the campaign would hold, by path.

        Raises:
            OutputError: the suffix is that of the YAML file.
        """
        return campaign_files(path, self.quantity, self.samples, self.sessions, self.metadata)

    @property
    def headline(self) -> str:
        """What is in it, in one line."""
        sessions = len(set(self.sessions))
        kind = "full poses" if self.full_pose else "positions"
        return f"{len(self)} {kind} in {sessions} session{'s' if sessions > 1 else ''}, {self.path.name}"

    def __len__(self) -> int:
        """Return the number of rows."""
        return int(self.lines.size)

    @property
    def full_pose(self) -> bool:
        """Whether rotations were measured too."""
        return self.rotation_vector_rad is not None

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
    def usable(self) -> BoolArray:
        """Which rows can be compared with a model, (n,): all drives known and anything measured."""
        commanded = np.isfinite(self.drives).all(axis=1)
        measured = self.position_measured.any(axis=1) | self.rotation_measured.any(axis=1)
        return np.asarray(commanded & measured, dtype=np.bool_)

    def rows_by_session(self) -> dict[str, NDArray[np.intp]]:
        """Return the rows of each session, ascending, sessions in order of appearance."""
        names = np.array(self.sessions)
        return {name: np.flatnonzero(names == name) for name in dict.fromkeys(self.sessions)}

    def drive_values(self, row: int) -> dict[str, float]:
        """Return the commanded drives of a row by joint name, in m and rad: what the solvers take."""
        return {name: float(value) for name, value in zip(DRIVE_JOINTS, self.drives[row], strict=True)}

    def quantity(self, name: str) -> FloatArray | None:
        """Return a numeric quantity by its name (``q1``, ``approach_q3``, ``leg2``, ``time``, ``rx``), (n,), or None.

        Values are in m, rad, kg, s and °C; None means that the campaign does not have it.

        Raises:
            BadInputError: there is no such quantity.
        """
        if name not in _PLACES:
            raise BadInputError(f"a campaign has no quantity '{name}'; known: {', '.join(_PLACES)}")
        array, column = _PLACES[name]
        values: FloatArray | None = getattr(self, array)
        if values is None or column is None:
            return values
        return values[:, column] if np.isfinite(values[:, column]).any() or name in _MEASURED else None

    def heading(self, name: str) -> str:
        """Return the heading of a quantity in the file, or the one it would have."""
        return self.headings.get(name, _CANONICAL[name])

    def missing_conditions(self) -> tuple[str, ...]:
        """Return the conditions the campaign does not have, by canonical heading (``payload_kg``, ``leg1_degC``).

        What depends on them cannot be tested with it.
        """
        absent = [q for q in columns.CONDITIONS if q.kind != "label" and self.quantity(q.name) is None]
        names = [q.canonical for q in absent]
        return tuple(names if "session" in self.headings else ["session", *names])

    def subset(self, rows: Sequence[int] | NDArray[np.intp] | BoolArray) -> Campaign:
        """Return a campaign of the given rows (indices from 0, or a mask of shape (n,)), in the given order.

        Raises:
            BadInputError: no row is left, or an index is out of range.
        """
        chosen = np.asarray(rows)
        chosen = np.flatnonzero(chosen) if chosen.dtype == bool and chosen.size == len(self) else chosen
        if chosen.size == 0 or chosen.dtype.kind not in "iu" or chosen.min() < -len(self) or chosen.max() >= len(self):
            raise BadInputError(f"rows of a campaign are indices from 0 to {len(self) - 1}, at least one")
        changed: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        changed = {name: None if values is None else values[chosen] for name, values in changed.items()}
        changed["lines"] = self.lines[chosen]
        changed["samples"] = tuple(self.samples[i] for i in chosen)
        changed["sessions"] = tuple(self.sessions[i] for i in chosen)
        return dataclasses.replace(self, **changed)

    def to_frame(self) -> pandas.DataFrame:
        """Return the rows as a pandas data frame with canonical headings (SI units, °C), a valid campaign table."""
        import pandas

        content: dict[str, object] = {}
        for quantity in columns.CAMPAIGN:
            if quantity.name == "sample":
                content["sample"] = list(self.samples)
            elif quantity.name == "session":
                content["session"] = list(self.sessions)
            else:
                values = self.quantity(quantity.name)
                if values is not None:
                    content[quantity.canonical] = values
        return pandas.DataFrame(content)


ARRAYS: dict[str, int] = {
    "drives": 4,
    "position_m": 3,
    "rotation_vector_rad": 3,
    "approach": 4,
    "time_s": 0,
    "payload_kg": 0,
    "truss_travel_m": 0,
    "melt_degC": 0,
    "ambient_degC": 0,
    "leg_degC": 4,
    "platform_degC": 0,
}
"""Arrays of a campaign with their number of columns; 0: one value a row."""

_CANONICAL = {quantity.name: quantity.canonical for quantity in columns.CAMPAIGN}
_GROUPS: dict[str, tuple[str, ...]] = {
    "drives": columns.DRIVES,
    "position_m": columns.POSITION,
    "rotation_vector_rad": columns.ROTATION,
    "approach": columns.APPROACHES,
    "leg_degC": LEGS,
}
_MEASURED = {*columns.DRIVES, *columns.POSITION, *columns.ROTATION}
_PLACES: dict[str, tuple[str, int | None]] = {
    **{name: (array, index) for array, names in _GROUPS.items() for index, name in enumerate(names)},
    **{heading.rpartition("_")[0]: (heading, None) for heading, width in ARRAYS.items() if width == 0},
}

Quantities = dict[str, FloatArray]


def arrays_from(quantities: Quantities) -> dict[str, FloatArray | None]:
    """Return the arrays of a campaign from single quantities, (n,) each, by name; absent ones become NaN or None."""
    rows = next(iter(quantities.values())).size
    empty = np.full(rows, np.nan)
    arrays: dict[str, FloatArray | None] = {}
    for array, width in ARRAYS.items():
        names = _GROUPS.get(array, (array.rpartition("_")[0],))
        given = np.stack([quantities.get(name, empty) for name in names], axis=-1)
        held = np.isfinite(given).any() or array in ("drives", "position_m")
        arrays[array] = (given if width else given[:, 0]) if held else None
    return arrays
