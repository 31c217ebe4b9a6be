"""What is known of each condition: what to record for it, what to draw over it, how to make it tell effects apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM
from pouring_robot.robot.pouring.names import LEGS

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
        sources: what a campaign must hold so that it is known: columns of the table, ``section.key`` of the YAML.
        record: the same in words.
        vary: which measurement makes show what depends on it.
        least_spread: of :attr:`varied`, from lowest to highest in SI units; with less it was held still.
        varied: the values that a campaign varies with it, (n,) or (n, k).
        by_pose: whether every campaign varies it, as it goes by the pose.
    """

    axis: Callable[[Conditions], tuple[str, FloatArray | None]] = lambda _: ("", None)
    sources: tuple[str, ...] = ()
    record: str = ""
    vary: str = ""
    least_spread: float = 0.0
    varied: Callable[[Conditions], FloatArray | None] = lambda _: None
    by_pose: bool = False

    def held_still(self, conditions: Conditions) -> bool:
        """Return whether a campaign hardly varied it: no column of it spreads enough."""
        values = self.varied(conditions)
        if values is None:
            return False
        return bool((np.ptp(values.reshape(len(values), -1), axis=0) < self.least_spread).all())


def _scaled(values: FloatArray | None, unit: float) -> FloatArray | None:
    return None if values is None else values / unit


def _mean(values: FloatArray | None, unit: float = 1.0) -> FloatArray | None:
    return None if values is None else np.asarray(values[:, :3].mean(axis=1)) / unit


def _rising(approach: FloatArray | None) -> FloatArray | None:
    return None if approach is None else np.asarray((approach > 0.0).sum(axis=1), dtype=float)


def _turn(given: Conditions) -> FloatArray | None:
    pitch = given.screw_pitch_m
    return None if pitch is None else np.mod(360.0 * given.drives[:, 0] / pitch, 360.0)


def _time(given: Conditions) -> tuple[str, FloatArray | None]:
    return ("time [h]", given.time_s / _HOUR_S) if given.time_known else ("time [row]", given.time_s)


_LADLE = ("payload_kg", "ladle.tare_kg", "ladle.centre_of_mass_mm")
_LOAD = "the load (payload_kg), and state tare and centre of mass of the ladle"
_EMPTY_AND_FULL = "measure the same poses with the ladle empty and full"
_LEAST_LOAD_N, _LEAST_RISE_K = 500.0, 20.0

FACTS: dict[str, Facts] = {
    "time_s": Facts(
        _time,
        vary="come back to the same poses hours later",
        least_spread=_HOUR_S,
        varied=lambda c: c.time_s,
    ),
    "weight_n": Facts(
        lambda c: ("weight on the platform [kN]", _scaled(c.weight_n, _KILO)),
        _LADLE,
        _LOAD,
        _EMPTY_AND_FULL,
        _LEAST_LOAD_N,
        lambda c: c.weight_n,
    ),
    "leg_pull_n": Facts(
        lambda c: ("mean pull of the legs [kN]", _mean(c.leg_pull_n, _KILO)),
        _LADLE,
        _LOAD,
        _EMPTY_AND_FULL,
        _LEAST_LOAD_N,
        lambda c: c.weight_n,
    ),
    "tilt_moment_nm": Facts(
        lambda c: ("moment on the tilt drive [kNm]", _scaled(c.tilt_moment_nm, _KILO)),
        _LADLE,
        _LOAD,
        _EMPTY_AND_FULL,
        _LEAST_LOAD_N,
        lambda c: c.weight_n,
    ),
    "truss_travel_m": Facts(
        lambda c: ("truss travel [m]", c.truss_travel_m),
        ("truss_travel_m",),
        "the place along the rails (truss_travel_m)",
        "measure at both ends and in the middle of the rails, empty and full",
        1.0,
        lambda c: c.truss_travel_m,
    ),
    "truss_span_m": Facts(sources=("truss.span_m",), record="the length of the rails (truss span in campaign.yaml)"),
    "melt_rise_k": Facts(
        lambda c: ("melt above reference [K]", c.melt_rise_k),
        ("melt_degC",),
        "the temperature of the melt (melt_degC)",
        "measure the same poses with a hot and with a cold melt",
        _LEAST_RISE_K,
        lambda c: c.melt_rise_k,
    ),
    "ambient_rise_k": Facts(
        lambda c: ("hall above reference [K]", c.ambient_rise_k),
        ("ambient_degC",),
        "the temperature of the hall (ambient_degC)",
        "measure the same poses in a cold and in a warm hall",
        5.0,
        lambda c: c.ambient_rise_k,
    ),
    "leg_rise_k": Facts(
        lambda c: ("mean leg above reference [K]", _mean(c.leg_rise_k)),
        tuple(f"{leg}_degC" for leg in LEGS),
        f"the temperature of every leg ({LEGS[0]}_degC to {LEGS[-1]}_degC)",
        "measure the same poses at two temperatures of the legs",
        _LEAST_RISE_K,
        lambda c: c.leg_rise_k,
    ),
    "platform_rise_k": Facts(
        lambda c: ("platform above reference [K]", c.platform_rise_k),
        ("platform_degC",),
        "the temperature of the platform (platform_degC)",
        "measure the same poses at two temperatures of the platform",
        _LEAST_RISE_K,
        lambda c: c.platform_rise_k,
    ),
    "approach": Facts(
        lambda c: ("drives that came from below", _rising(c.approach)),
        ("approach_q1", "approach_q2", "approach_q3", "approach_q4"),
        "the side each drive was approached from (approach_q1 to approach_q4)",
        "measure the same poses from both sides of every drive",
        1.0,
        lambda c: c.approach,
    ),
    "screw_pitch_m": Facts(
        lambda c: ("turn of screw 1 [°]", _turn(c)),
        ("drives.screw_pitch_mm",),
        "the pitch of the screws (screw pitch in campaign.yaml)",
        "measure at several places within one turn of the screws",
    ),
    "lengths_m": Facts(
        lambda c: ("length of leg 1 [mm]", c.lengths_m[:, 0] / MM),
        vary="measure with legs as short and as long as they can be",
        least_spread=0.1,
        varied=lambda c: c.lengths_m,
        by_pose=True,
    ),
    "tilt_drive_rad": Facts(
        lambda c: ("theta46 [°]", np.degrees(c.drives[:, 3])),
        vary="let the tilt drive go through its whole range",
        least_spread=0.2,
        varied=lambda c: c.drives[:, 3],
    ),
    "tilt_rad": Facts(
        lambda c: ("tilt [°]", np.degrees(c.tilt_rad)),
        vary="measure at the edges of the workspace, at both ends of the tilt",
        least_spread=0.3,
        varied=lambda c: c.tilt_rad,
        by_pose=True,
    ),
    "height_m": Facts(lambda c: ("z [mm]", c.position_m[:, 2] / MM), by_pose=True),
}
"""By the names of fields of :class:`Conditions`, and two of its columns: ``tilt_drive_rad`` and ``height_m``."""
ALWAYS = ("tilt_rad", "height_m", "time_s")
"""What anything can be drawn over."""


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
