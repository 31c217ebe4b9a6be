"""What is known of each condition: what to record for it, what to draw over it, how to make it tell effects apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.robot.pouring.names import DRIVE_COLUMNS, LEGS

APPROACHES = tuple(f"approach_{column}" for column in DRIVE_COLUMNS)
_KILO, _HOUR_S = 1e3, 3600.0


@dataclass(frozen=True, eq=False)
class Axis:
    """What effects and residuals are drawn over.

    Attributes:
        label: with its unit.
        values: shape (n,).
        of_rows: whether it is only the order of the rows, where nothing else varies.
    """

    label: str
    values: FloatArray
    of_rows: bool = False


@dataclass(frozen=True)
class Facts:
    """Facts about one condition.

    Attributes:
        axis: what to draw over it, (n,) numbers in the unit of the label; None where the campaign does not say.
        word: its name in sentences on what data depend on; "" where another condition stands for it there.
        sources: what a campaign must hold so that it is known: columns of the table, ``section.key`` of the YAML.
        record: the same in words.
        vary: which measurement makes show what depends on it.
        least_spread: from lowest to highest in SI units; with less it was held still. 0 where that is no question.
        varied: condition that a campaign varies with it, if not itself.
        by_pose: whether every campaign varies it, as it goes by the pose.
    """

    axis: Callable[[Conditions], tuple[str, FloatArray | None]] = lambda _: ("", None)
    word: str = ""
    sources: tuple[str, ...] = ()
    record: str = ""
    vary: str = ""
    least_spread: float = 0.0
    varied: str = ""
    by_pose: bool = False


def _scaled(values: FloatArray | None, unit: float) -> FloatArray | None:
    return None if values is None else values / unit


def _mean(values: FloatArray | None, unit: float = 1.0) -> FloatArray | None:
    return None if values is None else np.asarray(values[:, :3].mean(axis=1)) / unit


def _time(given: Conditions) -> tuple[str, FloatArray | None]:
    return ("time [h]", given.time_s / _HOUR_S) if given.time_known else ("time [row]", given.time_s)


def _of_weight(label: str, values: Callable[[Conditions], FloatArray | None], word: str = "") -> Facts:
    """Return the facts of a condition that goes by the load."""
    return Facts(
        lambda c: (label, values(c)),
        word,
        ("payload_kg", "ladle.tare_kg", "ladle.centre_of_mass_mm"),
        "the load (payload_kg), and state tare and centre of mass of the ladle",
        "measure the same poses with the ladle empty and full",
        500.0,
        varied="weight_n",
    )


FACTS: dict[str, Facts] = {
    "weight_n": _of_weight("weight on the platform [kN]", lambda c: _scaled(c.weight_n, _KILO), "load"),
    "leg_pull_n": _of_weight("mean pull of the legs [kN]", lambda c: _mean(c.leg_pull_n, _KILO)),
    "tilt_moment_nm": _of_weight("moment on the tilt drive [kNm]", lambda c: _scaled(c.tilt_moment_nm, _KILO)),
    "truss_travel_m": Facts(
        lambda c: ("truss travel [m]", c.truss_travel_m),
        "truss travel",
        ("truss_travel_m",),
        "the place along the rails (truss_travel_m)",
        "measure at both ends and in the middle of the rails, empty and full",
        1.0,
    ),
    "truss_span_m": Facts(sources=("truss.span_m",), record="the length of the rails (truss span in campaign.yaml)"),
    "melt_rise_k": Facts(
        lambda c: ("melt above reference [K]", c.melt_rise_k),
        "melt temperature",
        ("melt_degC",),
        "the temperature of the melt (melt_degC)",
        "measure the same poses with a hot and with a cold melt",
        20.0,
    ),
    "ambient_rise_k": Facts(
        lambda c: ("hall above reference [K]", c.ambient_rise_k),
        "hall temperature",
        ("ambient_degC",),
        "the temperature of the hall (ambient_degC)",
        "measure the same poses in a cold and in a warm hall",
        5.0,
    ),
    "leg_rise_k": Facts(
        lambda c: ("mean leg above reference [K]", _mean(c.leg_rise_k)),
        "leg temperatures",
        tuple(f"{leg}_degC" for leg in LEGS),
        f"the temperature of every leg ({LEGS[0]}_degC to {LEGS[-1]}_degC)",
        "measure the same poses at two temperatures of the legs",
        20.0,
    ),
    "platform_rise_k": Facts(
        lambda c: ("platform above reference [K]", c.platform_rise_k),
        "platform temperature",
        ("platform_degC",),
        "the temperature of the platform (platform_degC)",
        "measure the same poses at two temperatures of the platform",
        20.0,
    ),
    "approach": Facts(
        lambda c: ("drives that came from below", None if c.approach is None else 1.0 * (c.approach > 0.0).sum(axis=1)),
        "side of approach",
        APPROACHES,
        f"the side each drive was approached from ({APPROACHES[0]} to {APPROACHES[-1]})",
        "measure the same poses from both sides of every drive",
        1.0,
    ),
    "time_s": Facts(_time, "time", vary="come back to the same poses hours later", least_spread=_HOUR_S),
    "screw_pitch_m": Facts(
        lambda c: (
            "turn of screw 1 [°]",
            None if c.screw_pitch_m is None else np.mod(360.0 * c.drives[:, 0] / c.screw_pitch_m, 360.0),
        ),
        sources=("drives.screw_pitch_mm",),
        record="the pitch of the screws (screw pitch in campaign.yaml)",
        vary="measure at several places within one turn of the screws",
    ),
    "lengths_m": Facts(
        lambda c: ("length of leg 1 [mm]", c.lengths_m[:, 0] / MM),
        vary="measure with legs as short and as long as they can be",
        least_spread=0.1,
        by_pose=True,
    ),
    "tilt_drive_rad": Facts(
        lambda c: ("theta46 [°]", np.degrees(c.tilt_drive_rad)),
        vary="let the tilt drive go through its whole range",
        least_spread=0.2,
    ),
    "tilt_rad": Facts(
        lambda c: ("tilt [°]", np.degrees(c.tilt_rad)),
        vary="measure at the edges of the workspace, at both ends of the tilt",
        least_spread=0.3,
        by_pose=True,
    ),
    "height_m": Facts(lambda c: ("z [mm]", c.position_m[:, 2] / MM), by_pose=True),
}
"""By the names of fields and properties of :class:`Conditions`, and ``height_m`` of the platform."""
ALWAYS = ("tilt_rad", "height_m", "time_s")
"""What anything can be drawn over."""


def held_still(name: str, conditions: Conditions) -> bool:
    """Return whether a campaign hardly varied a condition: no column of it spreads enough."""
    facts = FACTS.get(name, Facts())
    values = getattr(conditions, facts.varied or name) if facts.least_spread else None
    return values is not None and bool((np.ptp(values.reshape(len(values), -1), axis=0) < facts.least_spread).all())


def in_words(conditions: Conditions, *names: str) -> dict[str, FloatArray]:
    """Return conditions by their names in sentences; those that the campaign has."""
    found = {FACTS[name].word: getattr(conditions, name) for name in names}
    return {word: values for word, values in found.items() if values is not None}


def axis_over(wanted: Iterable[str], conditions: Conditions) -> Axis:
    """Return the axis of the first condition that varies in a campaign; the order of the rows where none does."""
    for name in wanted:
        label, values = FACTS.get(name, Facts()).axis(conditions)
        if values is not None and np.ptp(values) > 0.0:
            return Axis(label, values)
    return Axis("row", np.arange(len(conditions), dtype=float), of_rows=True)


def sources(needs: Iterable[str]) -> tuple[str, ...]:
    """Return the columns and YAML keys that conditions come from; a condition of somebody's own keeps its name."""
    return tuple(dict.fromkeys(name for need in needs for name in (FACTS.get(need, Facts()).sources or (need,))))
