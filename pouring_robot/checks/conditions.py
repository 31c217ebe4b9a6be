"""Checks of what was recorded beside drives and measurement: loads, travels, temperatures, time.

Nothing of the measured poses is needed. Each rule rests on what no robot does: it travels no further than its rails, no
hall is hotter than :data:`HOTTEST_HALL_DEGC`, cold parts have the hall's temperature, nobody records a load of a
thousandth of the robot's mass, none carries ten times its mass, no drive bears ten times its effort, a static pose
takes :data:`LEAST_PAUSE_S`.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, found, where
from pouring_robot.checks.units_and_axes import LENGTH_MISTAKES
from pouring_robot.io.temperatures import ABSOLUTE_ZERO_DEGC
from pouring_robot.io.units import UNITS
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.robot.description.drawing import Drawing

HOTTEST_HALL_DEGC, COLDEST_HALL_DEGC = 55.0, -30.0
LEAST_PAUSE_S = 1.0  # so long a robot stands still at least, and is measured
_SLIGHT = 1e-3  # of the robot's mass: a load that bends nothing
_COLD_K, _ALIKE_K, _APART_K = 10.0, 5.0, 30.0
_FEWEST_COLD = 3
_NEARLY_ALL = 0.9
_FAR = 10.0
_MOVING_K = 5.0
_TEMPERATURE_MISTAKES: tuple[tuple[str, Callable[[FloatArray], FloatArray]], ...] = (
    ("kelvin", lambda values: values + ABSOLUTE_ZERO_DEGC),
    ("degrees Fahrenheit", lambda values: (values - 32.0) / 1.8),
)


def check_conditions(campaign: Campaign, drawing: Drawing, drives: FloatArray) -> Iterator[DataFlag]:
    """Yield what is wrong with the conditions, given drives (n, drives) whose mistakes are undone, in m and rad."""
    yield from _travels(campaign, drawing)
    yield from _payload(campaign, drawing)
    yield from _forces(campaign, drawing)
    yield from _pauses(campaign, drawing, drives)
    yield from _still_thermometers(campaign)
    exchanged = list(_exchanged_with_the_hall(campaign))
    yield from exchanged or _temperature_units(campaign)


def _unit(
    campaign: Campaign, name: str, wrong: str, figures: dict[str, float], severity: Severity | None = None
) -> DataFlag:
    message = f"column '{campaign.heading(name)}' seems to hold {wrong}"
    return found(campaign, FlagCode.CONDITION_UNIT, message, (), [name], figures, severity=severity)


def _impossible(campaign: Campaign, name: str, wrong: BoolArray, unit: str, why: str) -> DataFlag:
    """Return the finding of the rows (n,) in which a condition is what it cannot be, in its inner unit."""
    rows, values = np.flatnonzero(wrong), campaign.quantity(name)
    first = float("nan") if values is None else float(values[rows[0]])
    message = f"column '{campaign.heading(name)}' holds {first:g} {unit} in {where(campaign, rows)}, and {why}"
    return found(campaign, FlagCode.IMPOSSIBLE_CONDITION, message, rows, [name], {f"first_{unit}": first})


def _known(campaign: Campaign, name: str) -> FloatArray:
    """Return the values of a condition that are there."""
    values = campaign.conditions.get(name, np.empty(0))
    return values[np.isfinite(values)]


def _travels(campaign: Campaign, drawing: Drawing) -> Iterator[DataFlag]:
    limits = drawing.mechanism.joint_limits()
    for name in campaign.robot.travels:
        values, (low, high) = _known(campaign, name), limits.get(name, (-np.inf, np.inf))
        # Rails may be longer than the drawing's, or counted from elsewhere, but not ten times as long.
        largest, reach = float(np.abs(values).max(initial=0.0)), _FAR * (high - low)
        if largest <= reach:
            continue
        factors = [(1.0, ""), *LENGTH_MISTAKES]
        fits = (w for f, w in factors if np.mean((values * f >= low) & (values * f <= high)) > _NEARLY_ALL)
        if wrong := next(fits, ""):
            said = f"{wrong}: it comes to {largest:g} m, and the axis ends at {high:g} m"
            yield _unit(campaign, name, said, {"largest_m": largest, "limit_m": high})
        elif (far := np.abs(campaign.conditions[name] - np.median(values)) > reach).any():
            yield _impossible(campaign, name, far, "m", f"its axis is {high - low:g} m long")


def _payload(campaign: Campaign, drawing: Drawing) -> Iterator[DataFlag]:
    values, mass = _known(campaign, "payload"), float(pin.computeTotalMass(drawing.mechanism.shared_model))
    largest = float(values.max(initial=0.0))
    wrong = "tonnes" if 0.0 < largest < _SLIGHT * mass else ""
    if largest > _FAR * mass > 0.0:
        if np.median(values[values > 0.0]) <= _FAR * mass:
            heavy = campaign.conditions["payload"] > _FAR * mass
            yield _impossible(campaign, "payload", heavy, "kg", f"the robot itself weighs {mass:.3g} kg")
            return
        wrong = "grams"
    if wrong:
        said = f"{wrong} under a heading in kg: at most {largest:g} kg on a robot of {mass:.3g} kg"
        yield _unit(campaign, "payload", said, {"largest_kg": largest, "robot_kg": mass})


def _forces(campaign: Campaign, drawing: Drawing) -> Iterator[DataFlag]:
    """Find what no drive bears; at rest it may bear more than its motor can move, but not ten times as much."""
    model = drawing.mechanism.shared_model
    for name, drive in zip(columns.force_names(campaign.robot), campaign.robot.drives, strict=True):
        values, effort = campaign.quantity(name), float(model.effortLimit[_place(model, drive.joint)])
        if values is not None and effort > 0.0 and (wrong := np.abs(values) > _FAR * effort).any():
            unit = next(iter(UNITS[drive.load]))
            yield _impossible(campaign, name, wrong, unit, f"the drive's effort ends at {effort:g} {unit}")


def _place(model: pin.Model, joint: str) -> int:
    """Return where a joint's limits stand in the model."""
    return int(model.joints[model.getJointId(joint)].idx_v)


def _pauses(campaign: Campaign, drawing: Drawing, drives: FloatArray) -> Iterator[DataFlag]:
    """Find a time that leaves none for standing still: it was given in minutes or hours."""
    time = campaign.conditions.get("time")
    if time is None:
        return
    model = drawing.mechanism.shared_model
    speeds = [model.velocityLimit[_place(model, drive.joint)] for drive in campaign.robot.drives]
    pauses: list[float] = []
    timed = np.isfinite(time) & campaign.usable
    for members in campaign.rows_by_session().values():
        rows = members[timed[members]]
        rows = rows[np.unique(time[rows], return_index=True)[1]]  # copies of a row have its time
        travel = np.abs(np.diff(drives[rows], axis=0)) / np.where(np.array(speeds) > 0.0, speeds, np.inf)
        pauses += (np.diff(time[rows]) - travel.max(axis=1, initial=0.0)).tolist()
    middle = float(np.median(pauses)) if len(pauses) >= _FEWEST_COLD else LEAST_PAUSE_S
    if middle < LEAST_PAUSE_S and np.ptp(time[np.isfinite(time)]) > 0.0:
        said = (
            f"minutes or hours under a heading in s: between two poses there are {middle:.2g} s to stand still (median)"
        )
        # A quick robot may be measured on the way: then only what is said of times is wrong.
        yield _unit(campaign, "time", said, {"pause_s": middle}, Severity.WARNING)


def _parts(campaign: Campaign) -> tuple[str, ...]:
    """Return the thermometers on the robot that were read, moved or not."""
    return tuple(name for name in campaign.robot.thermometers if name in campaign.conditions)


def _still_thermometers(campaign: Campaign) -> Iterator[DataFlag]:
    """Find a sensor that never moves in the whole campaign while others do, and that is none of a source kept hot."""
    names = _parts(campaign)
    spread = {name: float(np.ptp(_known(campaign, name))) for name in names}
    # Of those that flicker from row to row one knows that they were read, and finely.
    lively = [n for n in names if spread[n] > _MOVING_K and np.mean(np.diff(_known(campaign, n)) != 0.0) > 0.5]
    for name in (name for name in names if spread[name] == 0.0 and len(lively) >= 2):
        value = float(_known(campaign, name)[0])
        others = np.concatenate([_known(campaign, other) for other in lively])
        if others.min() < value < others.max():
            message = (
                f"column '{campaign.heading(name)}' is {value:g} in every row, while {len(lively)} other "
                f"temperatures move by up to {max(spread.values()):.0f} K"
            )
            yield found(campaign, FlagCode.STUCK_COLUMN, message, (), [name], {"value": value})


def _exchanged_with_the_hall(campaign: Campaign) -> Iterator[DataFlag]:
    hall = campaign.conditions.get(columns.AMBIENT)
    if hall is None or np.nanmax(hall) <= HOTTEST_HALL_DEGC:
        return
    for name in _parts(campaign):
        values = campaign.conditions[name]
        both = np.isfinite(values) & np.isfinite(hall)
        mild = values[both].size and COLDEST_HALL_DEGC < values[both].min() < values[both].max() < HOTTEST_HALL_DEGC
        if mild and np.mean(values[both] < hall[both] - _ALIKE_K) > 0.5 and np.ptp(hall[both]) > np.ptp(values[both]):
            headings = " and ".join(f"'{campaign.heading(column)}'" for column in (columns.AMBIENT, name))
            message = (
                f"columns {headings} seem to be exchanged: the hall would come to {np.nanmax(hall):.0f} °C, and the "
                f"part stay at {values[both].max():.0f} °C"
            )
            yield found(campaign, FlagCode.CONDITIONS_EXCHANGED, message, (), (columns.AMBIENT, name))
            return


def _temperature_units(campaign: Campaign) -> Iterator[DataFlag]:
    hall, parts = campaign.conditions.get(columns.AMBIENT), _parts(campaign)
    if hall is None:
        # Several parts are not hot and alike by chance; where none is made hot, neither is a single one.
        if len(parts) > bool(campaign.robot.expected_thermometers):
            coldest = [float(_known(campaign, name).min()) for name in parts]
            low, high = min(coldest), max(coldest)
            halls = low + ABSOLUTE_ZERO_DEGC > COLDEST_HALL_DEGC and high + ABSOLUTE_ZERO_DEGC < HOTTEST_HALL_DEGC
            if halls and high - low < _COLD_K:
                said = f"kelvin under a heading in °C, as all may: parts are at {low:.0f} °C or more"
                yield _unit(campaign, parts[0], said, {"coldest_degC": low}, Severity.WARNING)
        return
    middle = float(np.nanmedian(hall))
    for scale, degC in _TEMPERATURE_MISTAKES:
        if middle > HOTTEST_HALL_DEGC and COLDEST_HALL_DEGC < float(degC(np.array(middle))) < HOTTEST_HALL_DEGC:
            said = f"{scale} under a heading in °C, as other temperatures may: the hall would be at {middle:.0f} °C"
            yield _unit(campaign, columns.AMBIENT, said, {"median_degC": middle})
            return
    if len(parts) < 3:  # which are cold, two others must say
        return
    for name in parts:
        others = [campaign.conditions[other] - hall for other in parts if other != name]
        cold = np.median(np.abs(others), axis=0) < _COLD_K
        values, apart = campaign.conditions[name][cold], np.array(others)[:, cold]
        for scale, degC in _TEMPERATURE_MISTAKES:
            # Converted, it must be as cold as the others are, not only near the hall: a part may warm up alone.
            warmth = degC(values) - hall[cold]
            least, most = apart.min(axis=0, initial=0.0), apart.max(axis=0, initial=0.0)
            alike = (warmth > least - _ALIKE_K) & (warmth < most + _ALIKE_K)
            alike &= np.abs(values - hall[cold]) > _APART_K
            if alike.size >= _FEWEST_COLD and alike.mean() > _NEARLY_ALL and np.ptp(values) > 0.0:
                said = f"{scale} under a heading in °C: it is at {np.median(values):.0f} °C where the others are cold"
                yield _unit(campaign, name, said, {"median_degC": float(np.median(values))}, Severity.WARNING)
