"""Writing a campaign: its table and the YAML beside it, both or neither."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import metadata_text
from pouring_robot.exceptions import OutputError
from pouring_robot.io.files import check_outputs, write_together
from pouring_robot.io.tables import PARQUET_SUFFIXES

# Digits written: a hundredth of the best tracker's noise.
_DIGITS = {"length": 6, "angle": 10, "mass": 3, "temperature": 3, "time": 3, "sign": 0}
_WRITTEN_IN_MM = (*columns.LENGTH_DRIVES, *columns.POSITION)


def write_campaign(campaign: Campaign, path: Path | str, *, overwrite: bool = False) -> tuple[Path, Path]:
    """Write the table (CSV, or Parquet by its suffix) and the YAML of the same stem.

    Returns:
        The two files.

    Raises:
        OutputError: a file is there already and ``overwrite`` is not set, or it cannot be written.
    """
    path = Path(path)
    files = campaign_contents(campaign, path)
    check_outputs(list(files), overwrite=overwrite)
    write_together(files)
    table, metadata = files
    return table, metadata


def campaign_contents(campaign: Campaign, path: Path) -> dict[Path, bytes]:
    """Return what the two files of a campaign would hold, by path.

    Raises:
        OutputError: the suffix is that of the YAML file.
    """
    beside = path.with_suffix(".yaml")
    if path.suffix.lower() in (".yaml", ".yml"):
        raise OutputError(path, "give the name of the table, such as campaign.csv; the YAML is written beside it")
    table = _parquet(campaign) if path.suffix.lower() in PARQUET_SUFFIXES else _csv(campaign).encode()
    return {path: table, beside: metadata_text(campaign.metadata).encode()}


def _cells(campaign: Campaign) -> dict[str, list[str]]:
    """Return the cells of every column by heading, in the units of the contract; missing ones are empty."""
    cells: dict[str, list[str]] = {}
    for quantity in columns.CAMPAIGN:
        if quantity.name == "sample":
            if any(campaign.samples):
                cells["sample"] = list(campaign.samples)
            continue
        if quantity.name == "session":
            cells["session"] = list(campaign.sessions)
            continue
        values = campaign.quantity(quantity.name)
        if values is None:
            continue
        millimetres = quantity.name in _WRITTEN_IN_MM
        heading = f"{quantity.name}_mm" if millimetres else quantity.canonical
        digits = _DIGITS[quantity.kind]
        scaled = np.round(values * 1e3 if millimetres else values, digits) + 0.0
        cells[heading] = ["" if np.isnan(value) else f"{value:.{digits}f}" for value in scaled]
    return cells


def _csv(campaign: Campaign) -> str:
    cells = _cells(campaign)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(cells)
    writer.writerows(zip(*cells.values(), strict=True))
    return stream.getvalue()


def _parquet(campaign: Campaign) -> bytes:
    import pyarrow
    import pyarrow.parquet

    labels = ("sample", "session")
    content = {
        heading: cells if heading in labels else [float(cell) if cell else None for cell in cells]
        for heading, cells in _cells(campaign).items()
    }
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(content), stream)
    return stream.getvalue()
