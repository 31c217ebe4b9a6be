"""Reading a campaign: the table and the YAML file beside it."""

from __future__ import annotations

from pathlib import Path

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign, arrays_from
from pouring_robot.campaign.metadata import metadata_path, read_metadata
from pouring_robot.exceptions import CampaignError
from pouring_robot.io.quantities import QuantityTable, read_quantities


def read_campaign(path: Path | str) -> Campaign:
    """Read a campaign a CSV, Parquet or Excel table with units on its headings, and the YAML of the same stem.

    Empty cells become NaN. What is wrong with the *values* is the business of
    :func:`pouring_robot.campaign.check_campaign`; here only what cannot be understood is refused.

    Raises:
        CampaignError: the table or the YAML file is missing, a heading is misspelt, has a wrong unit or stands twice,
            a required column is missing, or a cell is no number; names file, line and column.
        CampaignFileError: a key or value of the YAML file is wrong; names line and key.
    """
    path = Path(path)
    table = read_quantities(path, columns.CAMPAIGN, "q1_mm", CampaignError)
    metadata = read_metadata(metadata_path(path))
    arrays = arrays_from(table.numbers)
    drives, position = arrays.pop("drives"), arrays.pop("position_m")
    if drives is None or position is None:  # the reader of tables has made sure of both
        raise CampaignError(path, "holds no drives or no positions")
    return Campaign(
        path=path,
        metadata=metadata,
        lines=table.table.lines,
        samples=table.labels.get("sample", ("",) * len(table)),
        sessions=sessions_of(table),
        headings=table.headings,
        ignored_columns=table.unknown,
        drives=drives,
        position_m=position,
        **arrays,
    )


def sessions_of(table: QuantityTable) -> tuple[str, ...]:
    """Return the session of each row; all "1" without a column.

    Raises:
        CampaignError: a cell of the column is empty.
    """
    sessions = table.labels.get("session", ("1",) * len(table))
    if "" in sessions:
        problem = "the session is missing; name one in every row, or leave the column out"
        raise table.fault(problem, sessions.index(""), "session")
    return sessions
