"""In words: which measurement tells two effects apart, and what to record so that an effect can be tested at all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray

_HOW = {
    "drive_backlash": ("approach", "measure the same poses from both sides of every drive"),
    "leg_thermal_expansion": ("leg_rise_k", "measure the same poses at two temperatures of the legs"),
    "platform_thermal_expansion": ("platform_rise_k", "measure the same poses at two temperatures of the platform"),
    "leg_compliance": ("weight_n", "measure the same poses with the ladle empty and full"),
    "tilt_drive_compliance": ("weight_n", "measure the same poses with the ladle empty and full"),
    "truss_deflection": ("truss_travel_m", "measure at both ends and in the middle of the rails, empty and full"),
    "base_drift": ("time_s", "come back to the same poses hours later"),
    "tilt_encoder_eccentricity": ("tilt_drive", "let the tilt drive go through its whole range"),
    "drive_cyclic": ("screw", "measure at several places within one turn of the screws"),
    "drive_scale": ("lengths_m", "measure with legs as short and as long as they can be"),
    "metrology_scale": ("distance", "measure a calibrated length with the same device"),
    "joint_centre_offset": ("tilt_rad", "measure at the edges of the workspace, at both ends of the tilt"),
    "joint_axis_tilt": ("tilt_rad", "measure at the edges of the workspace, at both ends of the tilt"),
    "drive_zero_offset": ("tilt_rad", "measure at the edges of the workspace, at both ends of the tilt"),
}
"""Of each effect: what it depends on, and how to make that show."""
_SMALLEST = {
    "leg_rise_k": 20.0,
    "platform_rise_k": 20.0,
    "weight_n": 500.0,
    "truss_travel_m": 1.0,
    "tilt_drive": 0.2,
    "lengths_m": 0.1,
    "tilt_rad": 0.3,
    "time_s": 3600.0,
    "approach": 1.0,
}
"""Spread of a condition below which a campaign has held it still, in the condition's SI unit."""
_OPEN = "measure where the two predict most apart: the poses listed"
_RECORD = {
    "approach": "the side each drive was approached from (approach_q1 to approach_q4)",
    "leg_rise_k": "the temperature of every leg (leg1_degC to leg4_degC)",
    "platform_rise_k": "the temperature of the platform (platform_degC)",
    "weight_n": "the load (payload_kg), and state tare and centre of mass of the ladle",
    "leg_pull_n": "the load (payload_kg), and state tare and centre of mass of the ladle",
    "tilt_moment_nm": "the load (payload_kg), and state tare and centre of mass of the ladle",
    "truss_travel_m": "the place along the rails (truss_travel_m)",
    "truss_span_m": "the length of the rails (truss span in campaign.yaml)",
    "screw_pitch_m": "the pitch of the screws (screw pitch in campaign.yaml)",
    "melt_rise_k": "the temperature of the melt (melt_degC)",
    "ambient_rise_k": "the temperature of the hall (ambient_degC)",
}


def _values(conditions: Conditions, name: str) -> FloatArray | None:
    if name == "tilt_drive":
        return conditions.drives[:, 3]
    found: FloatArray | None = getattr(conditions, name, None)
    return found


def held_still(conditions: Conditions, name: str) -> bool:
    """Return whether a campaign hardly varied a condition: no column of it spreads (from lowest to highest) enough."""
    values = _values(conditions, name)
    if values is None or name not in _SMALLEST:
        return False
    spread = np.ptp(values.reshape(len(values), -1), axis=0)
    return bool((spread < _SMALLEST[name]).all())


def separating_words(first: str, second: str, conditions: Conditions) -> str:
    """Return how to tell two explanations apart: by what the campaign held still, else by what differs."""
    known = [_HOW[name] for name in (first, second) if name in _HOW]
    if not known:
        return _OPEN
    still = [how for by, how in known if held_still(conditions, by)]
    other = [how for by, how in known if by not in {"tilt_rad", "lengths_m"}]
    chosen = still or other or [how for _, how in known]
    return "; ".join(dict.fromkeys(chosen))


def untestable_words(untestable: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return what to record so that effects can be tested, one line each.

    Args:
        untestable: effects with the conditions that the campaign lacks.
    """
    lines: dict[str, list[str]] = {}
    for effect, lacking in untestable.items():
        for name in lacking:
            lines.setdefault(_RECORD.get(name, name), []).append(effect)
    return tuple(f"record {what}: without it {', '.join(effects)} cannot be tested" for what, effects in lines.items())
