"""The files of a campaign: its table as CSV or Parquet, and the YAML beside it."""

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pouring_robot.campaign.columns import DISTANCE_FROM, MEASURED
from pouring_robot.campaign.metadata import CampaignMetadata, metadata_text
from pouring_robot.exceptions import OutputError
from pouring_robot.io.quantities import Quantity
from pouring_robot.io.tables import PARQUET_SUFFIXES, csv_text
from pouring_robot.mechanism.arrays import FloatArray

# Digits written: a hundredth of the best tracker's noise.
_DIGITS = {"length": 6, "angle": 10, "force": 4, "moment": 4, "mass": 3, "temperature": 3, "time": 3, "sign": 0}
Cells = Mapping[str, list[str]]


def campaign_files(
    path: Path, columns: Iterable[tuple[Quantity, FloatArray | Sequence[str]]], metadata: CampaignMetadata
) -> dict[Path, bytes]:
    """Return what the two files of a campaign hold, by path: the table, CSV or Parquet by its suffix, and the YAML.

    Columns hold their n values in inner units; labels that are all empty are left out.

    Raises:
        OutputError: the suffix is that of the YAML file.
    """
    if path.suffix.lower() in (".yaml", ".yml"):
        raise OutputError(path, "give the name of the table, such as campaign.csv; the YAML is written beside it")
    cells: dict[str, list[str]] = {}
    for column, values in columns:
        if column.kind == "label":
            cells |= {column.name: [str(value) for value in values]} if any(values) else {}
            continue
        millimetres = column.kind == "length" and (column.required or column.name in MEASURED)
        digits = _DIGITS[column.kind]
        scaled = np.round(np.asarray(values, dtype=float) * (1e3 if millimetres else 1.0), digits) + 0.0
        heading = f"{column.name}_mm" if millimetres else column.canonical
        cells[heading] = ["" if np.isnan(value) else f"{value:.{digits}f}" for value in scaled]
    parquet = path.suffix.lower() in PARQUET_SUFFIXES
    table = _parquet(cells) if parquet else csv_text(cells, zip(*cells.values(), strict=True)).encode()
    return {path: table, path.with_suffix(".yaml"): metadata_text(metadata).encode()}


def _parquet(cells: Cells) -> bytes:
    import pyarrow
    import pyarrow.parquet

    labels = ("sample", "session", DISTANCE_FROM)
    content = {
        heading: column if heading in labels else [float(cell) if cell else None for cell in column]
        for heading, column in cells.items()
    }
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(content), stream)
    return stream.getvalue()
