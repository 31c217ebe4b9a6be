"""Reader of the two focus tables: columns by place, since the headings name one column twice."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pouring_robot.exceptions import CampaignError
from pouring_robot.mechanism.arrays import FloatArray

FIRST_FILE, SECOND_FILE = "focus_temp_AJR.txt", "focusvstemp_GFA.txt"
_FIRST = {
    "focus_um": 3,  # CIC, the middle of the field: a tilt of the focal plane does not move it
    "exposure": 6,
    "air_degc": 0,
    "mirror_degc": 13,
    "truss_degc": 14,
    "date": 15,
    "azimuth_deg": 16,
    "elevation_deg": 17,
}
_SECOND = {
    "exposure": 0,
    "focus_um": 1,
    "truss_degc": 2,
    "elevation_deg": 3,
    "azimuth_deg": 4,
    "mirror_degc": 5,
    "date": 7,
}
_POINTING = ("elevation_deg", "azimuth_deg", "mirror_degc")
_LIMITS = {
    "focus_um": (-1e6, 1e6),
    "truss_degc": (-60.0, 60.0),
    "mirror_degc": (-60.0, 60.0),
    "air_degc": (-60.0, 60.0),
    "elevation_deg": (0.0, 90.0),
    "azimuth_deg": (-360.0, 360.0),
}


@dataclass(frozen=True, eq=False)
class FocusRows:
    """Best focus with its conditions; every array has shape (n,), NaN where not recorded.

    Attributes:
        instrument: index of the instrument: each has its own zero of focus.
        focus_um: hexapod position of best focus, in µm.
        truss_degc: mean temperature of the truss, in °C.
        mirror_degc: temperature of the primary mirror, in °C.
        air_degc: the single sensor T_NNT, in °C.
        elevation_deg: elevation, in degrees.
        azimuth_deg: azimuth, in degrees.
        date: night as YYYYMMDD.
        exposure: number of the exposure, which grows with time.
    """

    instrument: FloatArray
    focus_um: FloatArray
    truss_degc: FloatArray
    mirror_degc: FloatArray
    air_degc: FloatArray
    elevation_deg: FloatArray
    azimuth_deg: FloatArray
    date: FloatArray
    exposure: FloatArray

    def __len__(self) -> int:
        """Return n."""
        return len(self.focus_um)

    @property
    def night(self) -> NDArray[np.int64]:
        """Nights as YYYYMMDD."""
        return self.date.astype(np.int64)

    @property
    def day(self) -> FloatArray:
        """Days since the first night."""
        days = np.array([_date(value).toordinal() for value in self.date.tolist()], dtype=float)
        return np.asarray(days - days.min())

    def only(self, kept: NDArray[np.bool_]) -> FocusRows:
        """Return some of the rows."""
        return FocusRows(**{f.name: getattr(self, f.name)[kept] for f in fields(self)})

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Whether a row has elevation, azimuth and mirror temperature."""
        return np.isfinite(self.elevation_deg + self.azimuth_deg + self.mirror_degc)


def together(first: FocusRows, second: FocusRows) -> FocusRows:
    """Return the rows of two instruments as one table."""
    second = replace(second, instrument=second.instrument + first.instrument.max() + 1.0)
    return FocusRows(
        **{f.name: np.concatenate([getattr(first, f.name), getattr(second, f.name)]) for f in fields(first)}
    )


def read_first(folder: Path | str) -> FocusRows:
    """Return the rows of the commissioning instrument, ``focus_temp_AJR.txt``.

    Raises:
        CampaignError: the file is missing or damaged.
    """
    return _read(Path(folder) / FIRST_FILE, _FIRST, 18)


def read_second(folder: Path | str) -> FocusRows:
    """Return the rows of the guide cameras, ``focusvstemp_GFA.txt``; elevation 0 there means not recorded.

    Raises:
        CampaignError: the file is missing or damaged.
    """
    return _read(Path(folder) / SECOND_FILE, _SECOND, 8)


def _read(path: Path, columns: dict[str, int], width: int) -> FocusRows:
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise CampaignError(path, f"byte {error.start} is not text; give the observers' table as it is") from error
    except OSError as error:
        raise CampaignError(path, f"{error.strerror or error}; give the folder that holds this file") from error
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].split()
        if words:
            rows.append(_row(path, number, words, columns, width))
    if not rows:
        raise CampaignError(path, "it holds no row; lines that begin with # do not count")
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    nothing = np.full(len(rows), np.nan)
    return FocusRows(instrument=np.zeros(len(rows)), **{"air_degc": nothing, **table})


def _row(path: Path, number: int, words: list[str], columns: dict[str, int], width: int) -> dict[str, float]:
    if len(words) != width:
        raise CampaignError(
            path, f"{len(words)} values where {width} are needed; mend the line or begin it with #", number
        )
    row = {}
    for name, place in columns.items():
        try:
            value = float(words[place])
        except ValueError:
            value = math.nan
        low, high = _LIMITS.get(name, (0.0, 1e9))
        if not low <= value <= high:
            wrong = f"'{words[place][:40]}' in place {place + 1} is no number from {low:g} to {high:g}"
            raise CampaignError(path, f"{wrong}; mend the line or begin it with #", number, name)
        row[name] = value
    try:
        _date(row["date"])
    except ValueError as error:
        raise CampaignError(
            path, f"'{words[columns['date']][:40]}' is no date YYYYMMDD; mend it", number, "date"
        ) from error
    if row["elevation_deg"] == 0.0:
        row.update(dict.fromkeys(_POINTING, math.nan))
    return row


def _date(value: float) -> datetime.date:
    return datetime.datetime.strptime(f"{value:.0f}", "%Y%m%d").date()
