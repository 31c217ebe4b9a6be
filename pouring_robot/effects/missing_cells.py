"""Missing cells of conditions: filled in from their neighbours in time where these determine them.

What is measured besides the pose (temperatures, forces) follows the rows before and after. What is set row by row
(loads, travels, sides) may stay constant for many rows or be drawn anew for each: the column itself shows which.
"""

import numpy as np

from pouring_robot.campaign.columns import SET, approach_names, runs_in_time
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import FROM_THE_ROW_BEFORE
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

CAME_FROM = "the side that the drives came from"
_MOST_BEYOND = 3  # rows before the first or after the last known value that are filled in with it
_ALIKE = 0.1
"""Share of a column's range: values no further apart are alike. A cell that is off by as much changes an effect, in one
row, by a tenth of the most that the effect does."""
_SHARE_ALIKE = 0.9
"""Share of values between two alike ones that must be like them, as expected for the next one (Laplace's rule of
succession)."""


def rows_without(campaign: Campaign) -> dict[str, Indices]:
    """Return the rows in which a condition is not known and others do not determine it, by its heading, ascending.

    What is measured is determined by the known values around it; what is set row by row, by two that are alike; what is
    the same wherever it is known, by any. Nothing is known before the first or after the last one, but a few rows there
    count as between. Where each pose was driven to from the row before, the side of a session's first row is not known.
    """
    order, found = np.argsort(_times(campaign), kind="stable"), {}
    for quantity in campaign.robot.condition_columns:
        side = quantity.kind == "sign" and campaign.metadata.approach == FROM_THE_ROW_BEFORE
        if quantity.kind in ("label", "time") or side:
            continue
        values = campaign.quantity(quantity.name)
        if values is not None and not np.isfinite(values).all():
            unknown = order[_undetermined(values[order], between=quantity.kind not in SET)]
            if unknown.size:
                found[quantity.canonical] = np.sort(unknown)
    if campaign.metadata.approach == FROM_THE_ROW_BEFORE and campaign.approach is not None:
        sideless = campaign.usable & np.isnan(campaign.approach).all(axis=1)
        if sideless.any() and not sideless.all():
            found[CAME_FROM] = np.flatnonzero(sideless)
    return found


def with_gaps(campaign: Campaign) -> tuple[str, ...]:
    """Return the headings of conditions that are known in some rows only."""
    some = ((q.canonical, campaign.quantity(q.name)) for q in campaign.robot.condition_columns if q.kind != "label")
    return tuple(heading for heading, values in some if values is not None and not np.isfinite(values).all())


def filled_in(campaign: Campaign, name: str) -> FloatArray | None:
    """Return a quantity, (n,), with missing cells filled in from their neighbours in time; None where there is none."""
    values = campaign.quantity(name)
    if values is None or np.isfinite(values).all():
        return values
    known, time = np.isfinite(values), _times(campaign)
    order = np.argsort(time[known], kind="stable")
    cells = np.interp(time[~known], time[known][order], values[known][order])
    whole = np.array(values)
    whole[~known] = np.sign(cells) + (cells == 0.0) if name in approach_names(campaign.robot) else cells
    return whole


def _undetermined(values: FloatArray, between: bool) -> Indices:
    """Return which missing ones of values in time order, (n,), the others do not determine, by index.

    ``between`` says that any two known ones determine what lies between them.
    """
    known, gaps = np.flatnonzero(np.isfinite(values)), np.flatnonzero(np.isnan(values))
    if not known.size or np.ptp(values[known]) == 0.0:
        return gaps[:0]
    after = np.searchsorted(known, gaps)
    last = known.size - 1
    first, second = values[known[np.maximum(after - 1, 0)]], values[known[np.minimum(after, last)]]
    determined = np.ones(gaps.size, dtype=bool) if between else _alike(first, second, values[known])
    for end in (after == 0, after > last):
        determined[end] &= end.sum() <= _MOST_BEYOND
    return gaps[~determined]


def _alike(first: FloatArray, second: FloatArray, known: FloatArray) -> BoolArray:
    """Return where two values, (m,) each, are alike, if by known ones, (k,) in time order, those between are alike."""
    least = _ALIKE * np.ptp(known)
    around = np.abs(known[2:] - known[:-2]) <= least
    between = around & (np.abs(known[1:-1] - known[:-2]) <= least)
    determines = (between.sum() + 1.0) / (around.sum() + 2.0) >= _SHARE_ALIKE
    return np.asarray((np.abs(first - second) <= least) & determines)


def _times(campaign: Campaign) -> FloatArray:
    """Return the times of the rows, (n,), in s, or their ranks where not all are known or sessions start anew."""
    time, places = campaign.time_s, np.arange(len(campaign), dtype=float)
    if time is None or not np.isfinite(time).all():
        return places
    first, *others = runs_in_time(time, campaign.sessions)
    places[np.concatenate([first, *others])] = np.arange(len(campaign))
    return places if others else time
