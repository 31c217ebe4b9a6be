"""Checks that need no robot: repeated rows, stuck and jumping columns, approach, time, noise, number of rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, Rows, Severity, row_tuple, where
from pouring_robot.estimation.frames import FEWEST_ROWS, robust_sigma
from pouring_robot.mechanism.arrays import FloatArray

FEW_ROWS = 20
"""Below this many usable rows little beyond the two frames can be told."""
_SAME_POSE = (1e-4, 1e-4, 1e-4, 1e-4)  # m, m, m, rad: closer commands are the same pose
_LONGEST_RUN = 4
_LONGEST_TEMPERATURE_RUN = 10
_TEMPERATURE_SPIKE_K = 25.0


def check_columns(campaign: Campaign) -> Iterator[DataFlag]:
    """Yield what is wrong with the columns as such."""
    for check in _CHECKS:
        yield from check(campaign)


def distinct_poses(campaign: Campaign) -> int:
    """Return how many different poses were commanded; closer than 0.1 mm and 0.1 mrad counts as the same."""
    drives = campaign.drives[campaign.usable]
    return len(np.unique(np.round(drives / np.array(_SAME_POSE)), axis=0)) if len(drives) else 0


def _row_count(campaign: Campaign) -> Iterator[DataFlag]:
    usable, poses = int(campaign.usable.sum()), distinct_poses(campaign)
    metrics = {"usable_rows": float(usable), "distinct_poses": float(poses)}
    if usable < FEW_ROWS:
        enough = usable >= FEWEST_ROWS
        yield DataFlag(
            FlagCode.TOO_FEW_ROWS,
            Severity.WARNING if enough else Severity.ERROR,
            f"{usable} rows can be used" + ("" if enough else f", too few to find the two frames ({FEWEST_ROWS})"),
            f"measure at least {FEW_ROWS} poses, better 60, spread over the workspace",
            metrics=metrics,
        )
    if usable >= FEWEST_ROWS and poses < FEWEST_ROWS:
        yield DataFlag(
            FlagCode.ONE_POSE,
            Severity.ERROR,
            f"{usable} rows show only {poses} different pose{'s' if poses > 1 else ''}",
            "command poses that differ in all four drives; repeats alone cannot fix the frames",
            columns=tuple(campaign.heading(name) for name in columns.DRIVES),
            metrics=metrics,
        )


def _missing_drives(campaign: Campaign) -> Iterator[DataFlag]:
    missing = ~np.isfinite(campaign.drives)
    rows = np.flatnonzero(missing.any(axis=1))
    if rows.size:
        names = [name for name, absent in zip(columns.DRIVES, np.any(missing, axis=0).tolist(), strict=True) if absent]
        yield DataFlag(
            FlagCode.MISSING_DRIVES,
            Severity.WARNING,
            f"a commanded drive is missing in {where(campaign, rows)}",
            "these rows cannot be used; fill in what was commanded",
            row_tuple(rows),
            tuple(campaign.heading(name) for name in names),
            {"rows": float(rows.size)},
        )


def _repeated_rows(campaign: Campaign) -> Iterator[DataFlag]:
    """Find rows whose drives and measurements are the same to the last digit: noise never repeats."""
    measured = [campaign.position_m]
    if campaign.rotation_vector_rad is not None:
        measured.append(campaign.rotation_vector_rad)
    table = np.concatenate([campaign.drives, *measured], axis=1)
    seen: dict[bytes, int] = {}
    copies = []
    for row in np.flatnonzero(campaign.usable):
        key = np.nan_to_num(table[row] + 0.0, nan=1e300).tobytes()
        if key in seen:
            copies.append(int(row))
        seen.setdefault(key, int(row))
    if copies:
        yield DataFlag(
            FlagCode.REPEATED_ROWS,
            Severity.WARNING,
            f"{where(campaign, copies)}: drives and measurement repeat an earlier row to the last digit",
            "remove the copies: a second measurement of a pose would differ by its noise",
            tuple(copies),
            metrics={"rows": float(len(copies))},
        )


def _stuck_measurements(campaign: Campaign) -> Iterator[DataFlag]:
    """Find measured columns that keep their value to the last digit while the drives move."""
    moved = np.abs(np.diff(campaign.drives, axis=0)).max(axis=1) > 1e-3 if len(campaign) > 1 else np.zeros(0)
    for name in (*columns.POSITION, *columns.ROTATION):
        values = campaign.quantity(name)
        if values is None:
            continue
        same = (np.diff(values) == 0.0) & (moved == 1)
        for start, end in _runs(same):
            if end - start + 1 >= _LONGEST_RUN:
                yield _stuck(campaign, name, np.arange(start, end + 1), Severity.ERROR)


def _stuck_drives(campaign: Campaign) -> Iterator[DataFlag]:
    drives = campaign.drives[campaign.usable]
    if len(drives) < FEWEST_ROWS or distinct_poses(campaign) < FEWEST_ROWS:
        return
    for index, name in enumerate(columns.DRIVES):
        if np.ptp(drives[:, index]) == 0.0:
            yield _stuck(campaign, name, np.flatnonzero(campaign.usable), Severity.WARNING)


def _stuck_temperatures(campaign: Campaign) -> Iterator[DataFlag]:
    """Find a leg or platform sensor that stands still while most of its neighbours change."""
    names = [name for name in columns.PARTS if campaign.quantity(name) is not None]
    changes = {name: np.diff(_values(campaign, name)) != 0.0 for name in names}
    for name in names:
        others = [changes[other] for other in names if other != name]
        if not others:
            continue
        still = ~changes[name] & (np.mean(others, axis=0) > 0.5)
        for start, end in _runs(still):
            if end - start + 1 >= _LONGEST_TEMPERATURE_RUN:
                yield _stuck(campaign, name, np.arange(start, end + 1), Severity.WARNING)


def _stuck(campaign: Campaign, name: str, rows: Rows, severity: Severity) -> DataFlag:
    heading = campaign.heading(name)
    first, last = int(campaign.lines[rows[0]]), int(campaign.lines[rows[-1]])
    drive = name in columns.DRIVES
    return DataFlag(
        FlagCode.STUCK_COLUMN,
        severity,
        f"column '{heading}' keeps one value from line {first} to line {last}"
        + ("" if drive else " while the rest of the row changes"),
        "if the drive really stood still its errors cannot be found; else mend the column"
        if drive
        else "the sensor hung or cells were filled down; empty these cells, or measure them again",
        row_tuple(rows),
        (heading,),
        {"rows": float(rows.size), "value": float(_values(campaign, name)[rows[0]])},
    )


def _temperature_jumps(campaign: Campaign) -> Iterator[DataFlag]:
    """Find single readings that leave both neighbours: a leg or a hall does not warm and cool within one pose."""
    for name in ("ambient", *columns.PARTS):
        if campaign.quantity(name) is None or len(campaign) < 5:
            continue
        values = _values(campaign, name)
        before, now, after = values[:-2], values[1:-1], values[2:]
        aside = now - 0.5 * (before + after)
        limit = np.fmax(_TEMPERATURE_SPIKE_K, 10.0 * robust_sigma(aside)) + 2.0 * np.abs(after - before)
        rows = 1 + np.flatnonzero(np.abs(aside) > limit)
        if rows.size:
            heading = campaign.heading(name)
            largest = float(np.abs(aside[rows - 1]).max())
            yield DataFlag(
                FlagCode.COLUMN_JUMP,
                Severity.WARNING,
                f"column '{heading}' jumps by up to {largest:.0f} K and back at {where(campaign, rows)}",
                "a loose sensor or a typing error; empty these cells, or correct them",
                row_tuple(rows),
                (heading,),
                {"largest_K": largest},
            )


def _approach(campaign: Campaign) -> Iterator[DataFlag]:
    for name in columns.APPROACHES:
        values = campaign.quantity(name)
        if values is None:
            continue
        rows = np.flatnonzero(np.isfinite(values) & (np.abs(values) != 1.0))
        if rows.size:
            heading = campaign.heading(name)
            yield DataFlag(
                FlagCode.BAD_APPROACH,
                Severity.ERROR,
                f"column '{heading}' holds {values[rows[0]]:g} at {where(campaign, rows)}; it may be +1 or -1",
                "write +1 where the drive was rising when it stopped, -1 where falling, nothing where unknown",
                row_tuple(rows),
                (heading,),
                {"rows": float(rows.size)},
            )


def _time(campaign: Campaign) -> Iterator[DataFlag]:
    time = campaign.time_s
    if time is None:
        return
    rows = []
    for session in campaign.rows_by_session().values():
        members = session[np.isfinite(time[session])]
        highest = np.maximum.accumulate(time[members])
        rows += members[1:][time[members[1:]] <= highest[:-1]].tolist()
    if rows:
        yield DataFlag(
            FlagCode.TIME_NOT_INCREASING,
            Severity.WARNING,
            f"column '{campaign.heading('time')}' does not increase at {where(campaign, rows)}",
            "give the time of each measurement within its session, or name a new session where the clock restarts",
            tuple(rows),
            (campaign.heading("time"),),
            {"rows": float(len(rows))},
        )


def _noise_level(campaign: Campaign) -> Iterator[DataFlag]:
    missing = [] if campaign.metadata.sigma_position_m else ["sigma_position_mm"]
    if campaign.full_pose and not campaign.metadata.sigma_rotation_rad:
        missing.append("sigma_rotation_rad")
    if missing:
        yield DataFlag(
            FlagCode.NO_NOISE_LEVEL,
            Severity.WARNING,
            f"the YAML file states no noise level: metrology.{' and '.join(missing)}",
            "state the standard deviation of one measured component, from the device's data or from repeats",
        )


def _temperatures(campaign: Campaign) -> Iterator[DataFlag]:
    if all(campaign.quantity(name) is None for name in columns.TEMPERATURES):
        yield DataFlag(
            FlagCode.NO_TEMPERATURES,
            Severity.NOTE,
            "there is no temperature in the campaign",
            f"effects of heat cannot be tested; record at least the legs and the platform ({columns.PARTS[0]}_degC …, "
            "platform_degC)",
        )


def _ignored(campaign: Campaign) -> Iterator[DataFlag]:
    if campaign.ignored_columns:
        names = ", ".join(f"'{name}'" for name in campaign.ignored_columns[:8])
        yield DataFlag(
            FlagCode.IGNORED_COLUMNS,
            Severity.NOTE,
            f"columns that are no part of a campaign were left out: {names}",
            "rename them if they hold a condition; else all is well",
            columns=campaign.ignored_columns,
        )


def _values(campaign: Campaign, name: str) -> FloatArray:
    values = campaign.quantity(name)
    return np.full(len(campaign), np.nan) if values is None else values


def _runs(same: FloatArray) -> Iterator[tuple[int, int]]:
    """Yield first and last row of every run in which each step ``same[i]`` (row i to i+1) is set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    yield from ((int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True))


_CHECKS: tuple[Callable[[Campaign], Iterator[DataFlag]], ...] = (
    _row_count,
    _missing_drives,
    _repeated_rows,
    _stuck_measurements,
    _stuck_drives,
    _stuck_temperatures,
    _temperature_jumps,
    _approach,
    _time,
    _noise_level,
    _temperatures,
    _ignored,
)
