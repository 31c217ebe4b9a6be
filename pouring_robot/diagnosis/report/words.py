"""Conditions and effects in the words of the shop floor: what a column is called, what effects are drawn over."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM

_LADLE = ("payload_kg", "ladle.tare_kg", "ladle.centre_of_mass_mm")
_SOURCES: dict[str, tuple[str, ...]] = {
    "approach": ("approach_q1", "approach_q2", "approach_q3", "approach_q4"),
    "weight_n": _LADLE,
    "leg_pull_n": _LADLE,
    "tilt_moment_nm": _LADLE,
    "truss_travel_m": ("truss_travel_m",),
    "melt_rise_k": ("melt_degC",),
    "ambient_rise_k": ("ambient_degC",),
    "leg_rise_k": ("leg1_degC", "leg2_degC", "leg3_degC", "leg4_degC"),
    "platform_rise_k": ("platform_degC",),
    "screw_pitch_m": ("drives.screw_pitch_mm",),
    "truss_span_m": ("truss.span_m",),
}
"""What a campaign must hold so that a condition is known: columns of the table, and ``section.key`` of the YAML."""


def sources(needs: Iterable[str]) -> tuple[str, ...]:
    """Return the columns and YAML keys that conditions come from; a condition of somebody's own keeps its name."""
    return tuple(dict.fromkeys(name for need in needs for name in _SOURCES.get(need, (need,))))


def absent_sources(needs: Iterable[str], campaign: Campaign) -> tuple[str, ...]:
    """Return those of :func:`sources` that a campaign does not have."""
    columns = {*campaign.missing_conditions()}
    stated = {
        "ladle.tare_kg": campaign.metadata.ladle_tare_kg,
        "ladle.centre_of_mass_mm": campaign.metadata.ladle_centre_of_mass_m,
        "drives.screw_pitch_mm": campaign.metadata.screw_pitch_m,
        "truss.span_m": campaign.metadata.truss_span_m,
    }
    wanted = sources(needs)
    found = tuple(name for name in wanted if name in columns or (name in stated and stated[name] is None))
    return found or wanted


def source_text(names: Sequence[str], campaign: Campaign) -> str:
    """Return in words what is to be added to a campaign: columns to the table, keys to the YAML beside it."""
    keys = [name for name in names if "." in name]
    columns = [name for name in names if "." not in name]
    parts = [f"column{'s' if len(columns) > 1 else ''} {', '.join(columns)}"] if columns else []
    parts += [f"{', '.join(keys)} in {campaign.path.with_suffix('.yaml').name}"] if keys else []
    return " and ".join(parts)


@dataclass(frozen=True, eq=False)
class Axis:
    """What effects and residuals are drawn over.

    Attributes:
        label: with its unit.
        values: shape (n,).
    """

    label: str
    values: FloatArray


def axes_of(given: Conditions) -> dict[str, Axis]:
    """Return everything rows can be drawn over, by condition; only what the campaign has and what varies in it."""
    found = {
        "time": (f"time [{'h' if given.time_known else 'row'}]", given.time_s / (3600.0 if given.time_known else 1.0)),
        "tilt": ("tilt [°]", np.degrees(given.tilt_rad)),
        "x": ("x [mm]", given.position_m[:, 0] / MM),
        "height": ("z [mm]", given.position_m[:, 2] / MM),
        "length": ("length of leg 1 [mm]", given.lengths_m[:, 0] / MM),
        "theta46": ("theta46 [°]", np.degrees(given.drives[:, 3])),
    }
    scaled: tuple[tuple[str, str, FloatArray | None, float], ...] = (
        ("load", "weight on the platform [kN]", given.weight_n, 1e3),
        ("moment", "moment on the tilt drive [kNm]", given.tilt_moment_nm, 1e3),
        ("travel", "truss travel [m]", given.truss_travel_m, 1.0),
        ("melt", "melt above reference [K]", given.melt_rise_k, 1.0),
        ("legs", "mean leg above reference [K]", _mean(given.leg_rise_k), 1.0),
        ("pull", "mean pull of the legs [kN]", _mean(given.leg_pull_n), 1e3),
        ("platform", "platform above reference [K]", given.platform_rise_k, 1.0),
        ("approach", "drives that came from below", None if given.approach is None else _rising(given.approach), 1.0),
    )
    found |= {name: (label, values / unit) for name, label, values, unit in scaled if values is not None}
    if given.screw_pitch_m is not None:
        found["turn"] = ("turn of screw 1 [°]", np.mod(360.0 * given.drives[:, 0] / given.screw_pitch_m, 360.0))
    return {name: Axis(label, values) for name, (label, values) in found.items() if np.ptp(values) > 0.0}


def _mean(values: FloatArray | None) -> FloatArray | None:
    return None if values is None else np.asarray(values[:, :3].mean(axis=1))


def _rising(approach: FloatArray) -> FloatArray:
    return np.asarray((approach > 0.0).sum(axis=1), dtype=float)


_DRIVEN_BY = {
    "drive_scale": "length",
    "drive_cyclic": "turn",
    "drive_backlash": "approach",
    "leg_thermal_expansion": "legs",
    "platform_thermal_expansion": "platform",
    "leg_compliance": "pull",
    "tilt_drive_compliance": "moment",
    "truss_deflection": "travel",
    "base_drift": "time",
    "tilt_encoder_eccentricity": "theta46",
}
_BY_NEED = {
    "approach": "approach",
    "weight_n": "load",
    "leg_pull_n": "pull",
    "tilt_moment_nm": "moment",
    "truss_travel_m": "travel",
    "melt_rise_k": "melt",
    "leg_rise_k": "legs",
    "platform_rise_k": "platform",
    "screw_pitch_m": "turn",
}


def driving_axis(effect: str, needs: Sequence[str], axes: dict[str, Axis]) -> Axis | None:
    """Return what an effect is best drawn over; an effect of somebody's own is drawn over its first need."""
    wanted = [_DRIVEN_BY.get(effect, ""), *(_BY_NEED.get(need, "") for need in needs), "tilt", "height", "time"]
    return next((axes[name] for name in wanted if name in axes), None)
