"""Checks that need no drawing: name of the robot, copies, stuck columns, approach, time, noise, counts."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import FEW_ROWS, FEW_VALUES, DataFlag, FlagCode, Severity, flagged, stuck, where
from pouring_robot.checks.thermometers import readings
from pouring_robot.estimation.frames.starts import FEWEST_FOR_FRAMES
from pouring_robot.estimation.noise import noise_beforehand, noise_key
from pouring_robot.exceptions import counted, some
from pouring_robot.io.units import UNITS
from pouring_robot.mechanism.arrays import FloatArray, Indices, runs

_SAME_POSE = 1e-4  # m or rad: closer commands are the same pose
_SHORTEST_RUN = 4
_NAMED = 8
_ATTITUDE = 3  # this many unknown columns may be a rotation, as angles or as a quaternion
_AS_ROTATION_VECTOR = (
    "if they hold the rotation, convert it to a rotation vector, rx_rad, ry_rad, rz_rad (SciPy: "
    "Rotation.from_quat([x, y, z, w]).as_rotvec(), or from_euler('ZYX', [a, b, c], degrees=True)); otherwise "
    "nothing is wrong"
)
_PLANE = "nothing is wrong if a probe touched a plane, such as a print bed; otherwise the sensor froze: measure again"
_SOCKET = "nothing is wrong if it was held at known places, such as a ball in sockets; otherwise measure again"
_SHUFFLED = 0.25  # share of the steps that go back in time; in a shuffled column it is one half


def check_columns(campaign: Campaign, held: Sequence[Indices] = ()) -> Iterator[DataFlag]:
    """Yield mistakes in the columns themselves; ``held`` are the rows at each place where the target was held."""
    for check in (
        _another_robot,
        _row_count,
        _missing_drives,
        _repeated_rows,
        _no_lengths,
        functools.partial(_stuck_measurements, held=held),
        _stuck_drives,
        _approach,
        _time,
        _sessions,
        _noise_level,
        _ignored,
    ):
        yield from check(campaign)


def distinct_poses(campaign: Campaign) -> int:
    """Return how many different poses were commanded; those within 0.1 mm and 0.1 mrad count as one."""
    return len(np.unique(np.round(campaign.drives[campaign.usable] / _SAME_POSE), axis=0))


def _another_robot(campaign: Campaign) -> Iterator[DataFlag]:
    """Find a campaign of another robot whose columns happen to fit; files that name none count as this one's."""
    named, robot = campaign.metadata.robot, campaign.robot.name
    if named and named != robot:
        message = f"the YAML file names the robot '{named}', but the rows were read for '{robot}'"
        yield flagged(campaign, FlagCode.ANOTHER_ROBOT, message)


def _row_count(campaign: Campaign) -> Iterator[DataFlag]:
    usable, poses = int(campaign.usable.sum()), distinct_poses(campaign)
    metrics = {"usable_rows": float(usable), "distinct_poses": float(poses)}
    rows, names = _uncommanded(campaign)
    mend = ""
    if rows.size and usable + rows.size >= FEW_ROWS:
        empty = _headings([campaign.heading(name) for name in names])
        mend = f"fill in what was commanded: {empty} is empty in {counted(rows.size, 'row')}"
    if usable < FEW_ROWS:
        message, severity = f"{counted(usable, 'row')} can be used", None
        if usable < FEWEST_FOR_FRAMES:
            message, severity = f"{message}, too few to find the two frames ({FEWEST_FOR_FRAMES})", Severity.ERROR
        yield flagged(campaign, FlagCode.TOO_FEW_ROWS, message, metrics=metrics, severity=severity, remedy=mend)
    elif campaign.values_measured < FEW_VALUES:
        message = f"{usable} rows are few: they hold {campaign.values_measured} measured values"
        remedy = f"measure at least {FEW_VALUES} values, preferably three times as many, spread over the workspace"
        yield flagged(campaign, FlagCode.TOO_FEW_ROWS, message, metrics=metrics, remedy=remedy)
    if usable >= FEWEST_FOR_FRAMES > poses:
        message = f"{usable} rows show only {counted(poses, 'different pose')}"
        yield flagged(campaign, FlagCode.ONE_POSE, message, (), columns.drive_names(campaign.robot), metrics)


def _uncommanded(campaign: Campaign) -> tuple[Indices, list[str]]:
    """Return the rows in which a command is missing, and the drives that lack any."""
    missing = ~np.isfinite(campaign.drives)
    names = [columns.drive_names(campaign.robot)[k] for k in np.flatnonzero(missing.any(axis=0))]
    return np.flatnonzero(missing.any(axis=1)), names


def _missing_drives(campaign: Campaign) -> Iterator[DataFlag]:
    rows, names = _uncommanded(campaign)
    if rows.size:
        said = _headings([campaign.heading(name) for name in names])
        message = f"{said}: the command is missing in {where(campaign, rows)}"
        yield flagged(campaign, FlagCode.MISSING_DRIVES, message, rows, names, {"rows": float(rows.size)})


def _copies(campaign: Campaign) -> Indices:
    """Return the usable rows whose drives and measurements equal an earlier row's to the last digit.

    None where as many rows are equal in all measured columns but one: readings of few digits are equal by chance.
    """
    measured = [campaign.position_m]
    measured += [values for values in (campaign.rotation_vector_rad, campaign.distance_m) if values is not None]
    usable, drives = np.flatnonzero(campaign.usable), campaign.drives.shape[1]
    table = np.concatenate([campaign.drives, *measured], axis=1)[usable] + 0.0  # -0 is 0
    first = np.unique(np.nan_to_num(table, nan=1e300), axis=0, return_index=True)[1]
    if first.size < usable.size:
        table = table[:, np.isfinite(table).any(axis=0)]
        table = table[np.isfinite(table).all(axis=1)]
        alike, values = _pairs(table), range(drives, table.shape[1])
        if len(values) > 1 and 0 < alike <= sum(_pairs(np.delete(table, k, axis=1)) - alike for k in values):
            return np.zeros(0, dtype=np.intp)
    return np.delete(usable, first)


def _pairs(table: FloatArray) -> int:
    """Return how many pairs of rows (n, k) are equal."""
    counts = np.unique(table, axis=0, return_counts=True)[1]
    return int((counts * (counts - 1) // 2).sum())


def without_copies(campaign: Campaign) -> Campaign:
    """Return the campaign with blank commands in copied rows, so that they are compared with no pose."""
    copies, drives = _copies(campaign), np.array(campaign.drives)
    drives[copies] = np.nan
    return replace(campaign, drives=drives) if copies.size else campaign


def _repeated_rows(campaign: Campaign) -> Iterator[DataFlag]:
    """Find rows that are copies: noise with enough digits never repeats."""
    copies = _copies(campaign)
    if copies.size:
        message = f"{where(campaign, copies)}: drives and measurement repeat an earlier row to the last digit"
        yield flagged(campaign, FlagCode.REPEATED_ROWS, message, copies, metrics={"rows": float(copies.size)})


def _no_lengths(campaign: Campaign) -> Iterator[DataFlag]:
    """Find distances of zero or less."""
    values = campaign.quantity(columns.DISTANCE)
    rows = np.flatnonzero([] if values is None else values <= 0.0)
    if rows.size:
        message = f"{where(campaign, rows)}: a distance of 0 or less, which cannot be used"
        yield flagged(campaign, FlagCode.NO_LENGTH, message, rows, [columns.DISTANCE], {"rows": float(rows.size)})


def _stuck_measurements(campaign: Campaign, held: Sequence[Indices]) -> Iterator[DataFlag]:
    """Find measured columns that keep their value to the last digit while the drives move.

    If only one was measured, with one value in all rows, it may be the position of a plane that a probe touched. Places
    where the target was held are stated to the last digit and may share a coordinate.
    """
    moved = np.abs(np.diff(campaign.drives, axis=0)).max(axis=1) > 1e-3
    if held:
        stood, several = np.sort(np.concatenate(held)), f" at each of {len(held)} places" if len(held) > 1 else ""
        message = f"{where(campaign, stood)}: the target stood still{several} while the drives moved"
        yield flagged(
            campaign, FlagCode.STUCK_COLUMN, message, stood, columns.POSITION, severity=Severity.NOTE, remedy=_SOCKET
        )
    found_in = ((name, campaign.quantity(name)) for name in (*columns.POSITION, *columns.ROTATION, columns.DISTANCE))
    measured = {name: values for name, values in found_in if values is not None and np.isfinite(values).any()}
    alone = len(measured) == 1
    measured.pop(columns.DISTANCE, None)  # two places may well be at the same distance
    for name, values in measured.items():
        if held and name in columns.POSITION:
            continue
        plane = alone and np.nanmax(values) == np.nanmin(values)
        for rows in runs((np.diff(values) == 0.0) & moved, _SHORTEST_RUN):
            severity, remedy = (Severity.NOTE, _PLANE) if plane else (Severity.ERROR, "")
            yield stuck(campaign, name, values[rows[0]], rows, severity, remedy)


def _stuck_drives(campaign: Campaign) -> Iterator[DataFlag]:
    drives = campaign.drives[campaign.usable]
    if distinct_poses(campaign) < FEWEST_FOR_FRAMES:
        return
    for index, name in enumerate(columns.drive_names(campaign.robot)):
        if np.ptp(drives[:, index]) == 0.0:
            yield stuck(campaign, name, drives[0, index], np.flatnonzero(campaign.usable), Severity.WARNING)


def _approach(campaign: Campaign) -> Iterator[DataFlag]:
    if campaign.approach is None:
        return
    for name, values in zip(columns.approach_names(campaign.robot), campaign.approach.T, strict=True):
        rows = np.flatnonzero(np.isfinite(values) & (np.abs(values) != 1.0))
        if rows.size:
            held = f"column '{campaign.heading(name)}' holds {values[rows[0]]:g} at {where(campaign, rows)}"
            message = f"{held}; it may be +1 or -1"
            yield flagged(campaign, FlagCode.BAD_APPROACH, message, rows, [name], {"rows": float(rows.size)})


def _time(campaign: Campaign) -> Iterator[DataFlag]:
    time, copies = campaign.time_s, _copies(campaign)
    if time is None:
        return
    rows: list[int] = []
    steps, backwards = 0, True
    for session in campaign.rows_by_session().values():
        members = np.setdiff1d(session[np.isfinite(time[session])], copies)
        highest = np.maximum.accumulate(time[members])
        rows += members[1:][time[members[1:]] <= highest[:-1]].tolist()
        steps += int((np.diff(time[members]) < 0.0).sum())
        backwards &= bool((np.diff(time[members]) <= 0.0).all())
    if not rows:
        return
    code, at, severity, remedy = FlagCode.TIME_SHUFFLED, list[int](), None, ""
    if steps < _SHUFFLED * len(campaign):
        code, at, said = FlagCode.TIME_NOT_INCREASING, rows, f"does not increase at {where(campaign, rows)}"
    elif backwards:  # temperatures are as smooth backwards as forwards
        said = "decreases from row to row: the newest row comes first"
        remedy = "sort the rows of each session by time, oldest first"
    else:
        said = f"is in no order: it decreases {steps} times"
        # Temperatures are smooth in the order in which they were read, whatever the order of the rows.
        rougher = _roughness(campaign, np.argsort(time, kind="stable")) - _roughness(campaign, slice(None))
        if rougher < 0.0:
            said += "; sorted by it, the temperatures are smooth"
            code, severity = FlagCode.TIME_NOT_INCREASING, Severity.NOTE
            remedy = "nothing is wrong if the rows were sorted; sort them by time, so that jumps can be detected"
        else:
            said += ", and does not belong to these rows"
            said += "; in the order of the rows, the temperatures are smooth" if rougher > 0.0 else ""
    figures, message = {"rows": float(len(rows)), "falls": float(steps)}, f"column '{campaign.heading('time')}' {said}"
    yield flagged(campaign, code, message, at, ["time"], figures, severity=severity, remedy=remedy)


def _roughness(campaign: Campaign, order: Indices | slice) -> float:
    """Return the sum of the temperatures' changes from row to row in an order, in K."""
    columns_ = [campaign.conditions[name][order] for name in readings(campaign)]
    return float(sum(np.nansum(np.abs(np.diff(values[np.isfinite(values)]))) for values in columns_))


def _sessions(campaign: Campaign) -> Iterator[DataFlag]:
    """Find sessions that are labels of rows: with a place for each, there are too many unknowns to fit."""
    count = len(set(campaign.sessions))
    if count > 1 and 2 * count > len(campaign):
        message = f"{count} sessions in {len(campaign)} rows, fewer than two rows each on average"
        yield flagged(campaign, FlagCode.SESSIONS_OF_ROWS, message)


def _noise_level(campaign: Campaign) -> Iterator[DataFlag]:
    noise = noise_beforehand(campaign, np.flatnonzero(campaign.usable))
    missing = [noise_key(kind) for kind in noise.measured if noise[kind].source != "stated"]
    if missing:
        message = f"the YAML file states no noise level: metrology.{' and '.join(missing)}"
        yield flagged(campaign, FlagCode.NO_NOISE_LEVEL, message)


def _ignored(campaign: Campaign) -> Iterator[DataFlag]:
    """Find unknown headings; the findings hold these headings themselves, as they name no quantities."""
    others = list(campaign.ignored_columns)
    unused = [name for name in others if name.rpartition("_")[2] in UNITS["temperature"]]
    if unused:
        parts = some((columns.AMBIENT, *campaign.robot.thermometers), _NAMED)
        message = f"{_headings(unused)}: the robot has no part of that name, so the readings are not used"
        remedy = f"{FlagCode.UNUSED_TEMPERATURE.remedy}; parts: {parts}"
        yield replace(flagged(campaign, FlagCode.UNUSED_TEMPERATURE, message, remedy=remedy), columns=tuple(unused))
        others = [name for name in others if name not in unused]
    if others:
        message, severity, remedy = f"{_headings(others)}: not a campaign column, left out", Severity.NOTE, ""
        if campaign.position_measured.any() and not campaign.full_pose and len(others) >= _ATTITUDE:
            message += "; no rotation was read"
            severity, remedy = Severity.WARNING, _AS_ROTATION_VECTOR
        flag = flagged(campaign, FlagCode.IGNORED_COLUMNS, message, severity=severity, remedy=remedy)
        yield replace(flag, columns=tuple(others))


def _headings(names: Sequence[str]) -> str:
    return f"column{'s' * (len(names) > 1)} {some([repr(name) for name in names], _NAMED)}"
