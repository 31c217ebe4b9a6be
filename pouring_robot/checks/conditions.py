"""Checks of the conditions recorded with drives and measurements: loads, travels, forces, time.

Measured poses are not needed. Each rule rests on what no robot does: it travels no further than its rails, nobody
records a load of a thousandth of the robot's mass, none carries ten times its mass, no drive bears ten times its
effort, and a static pose takes at least :data:`LEAST_PAUSE_S`.
"""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, flagged, where
from pouring_robot.checks.units_and_axes import LENGTH_MISTAKES
from pouring_robot.io.units import UNITS
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.robot.description.drawing import Drawing

LEAST_PAUSE_S = 1.0  # a robot stands still for at least this long to be measured
_SLIGHT = 1e-3  # of the robot's mass: a load that deflects nothing
_FEWEST_PAUSES = 3
_NEARLY_ALL = 0.9
_FAR = 10.0


def check_conditions(campaign: Campaign, drawing: Drawing, drives: FloatArray) -> Iterator[DataFlag]:
    """Yield mistakes in the conditions, given drives (n, drives) with their mistakes undone, in m and rad."""
    yield from _travels(campaign, drawing)
    yield from _payload(campaign, drawing)
    yield from _forces(campaign, drawing)
    yield from _pauses(campaign, drawing, drives)


def wrong_unit(
    campaign: Campaign,
    name: str,
    wrong: str,
    figures: dict[str, float],
    severity: Severity | None = None,
    remedy: str = "",
) -> DataFlag:
    """Return the finding that a condition is given in a unit other than its heading's."""
    message = f"column '{campaign.heading(name)}' seems to hold {wrong}"
    return flagged(campaign, FlagCode.CONDITION_UNIT, message, (), [name], figures, severity=severity, remedy=remedy)


def _impossible(campaign: Campaign, name: str, wrong: BoolArray, unit: str, why: str) -> DataFlag:
    """Return the finding of the rows (n,) in which a condition has an impossible value, in its internal unit."""
    rows, values = np.flatnonzero(wrong), campaign.quantity(name)
    first = float("nan") if values is None else float(values[rows[0]])
    message = f"column '{campaign.heading(name)}' holds {first:g} {unit} in {where(campaign, rows)}, but {why}"
    return flagged(campaign, FlagCode.IMPOSSIBLE_CONDITION, message, rows, [name], {f"first_{unit}": first})


def known(campaign: Campaign, name: str) -> FloatArray:
    """Return the values of a condition that are not missing."""
    values = campaign.conditions.get(name, np.empty(0))
    return values[np.isfinite(values)]


def _travels(campaign: Campaign, drawing: Drawing) -> Iterator[DataFlag]:
    limits = drawing.mechanism.joint_limits()
    for name in campaign.robot.travels:
        values, (low, high) = known(campaign, name), limits.get(name, (-np.inf, np.inf))
        # Rails may be longer than the drawing's, or have another zero, but are not ten times as long.
        largest, reach = float(np.abs(values).max(initial=0.0)), max(_FAR * (high - low), -low, high)
        if largest <= reach:
            continue
        factors = [(1.0, ""), *LENGTH_MISTAKES]
        fits = (w for f, w in factors if np.mean(np.abs(values * f) <= reach) > _NEARLY_ALL)
        if wrong := next(fits, ""):
            said = f"{wrong}: it reaches {largest:g} m, but the axis ends at {high:g} m"
            yield wrong_unit(campaign, name, said, {"largest_m": largest, "limit_m": high})
        else:
            far = np.abs(campaign.conditions[name]) > reach
            yield _impossible(campaign, name, far, "m", f"its axis is {high - low:g} m long")


def _payload(campaign: Campaign, drawing: Drawing) -> Iterator[DataFlag]:
    values, mass = known(campaign, "payload"), float(pin.computeTotalMass(drawing.mechanism.shared_model))
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
        yield wrong_unit(campaign, "payload", said, {"largest_kg": largest, "robot_kg": mass})


def _forces(campaign: Campaign, drawing: Drawing) -> Iterator[DataFlag]:
    """Find forces that no drive bears; at rest it may bear more than its motor can move, but not ten times as much."""
    model = drawing.mechanism.shared_model
    for name, drive in zip(columns.force_names(campaign.robot), campaign.robot.drives, strict=True):
        values, effort = campaign.quantity(name), float(model.effortLimit[_place(model, drive.joint)])
        if values is not None and effort > 0.0 and (wrong := np.abs(values) > _FAR * effort).any():
            unit = next(iter(UNITS[drive.load]))
            yield _impossible(campaign, name, wrong, unit, f"the drive's effort limit is {effort:g} {unit}")


def _place(model: pin.Model, joint: str) -> int:
    """Return the index of a joint's limits in the model."""
    return int(model.joints[model.getJointId(joint)].idx_v)


def _pauses(campaign: Campaign, drawing: Drawing, drives: FloatArray) -> Iterator[DataFlag]:
    """Find times that leave no pause at the poses: they were given in minutes or hours."""
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
    middle = float(np.median(pauses)) if len(pauses) >= _FEWEST_PAUSES else LEAST_PAUSE_S
    if middle < LEAST_PAUSE_S and np.ptp(time[np.isfinite(time)]) > 0.0:
        said = (
            f"minutes or hours under a heading in s: only {middle:.2g} s remain to stand still between two poses "
            "(median)"
        )
        # A quick robot may be measured on the way: then only what is said of times is wrong.
        yield wrong_unit(campaign, "time", said, {"pause_s": middle}, Severity.WARNING)
