"""The effects, their forms, and the textbook signature of each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import effects_drives as d
from . import effects_loads as h
from . import outside as x
from .conditions import PITCH_M, REFERENCE_DEGC, SPAN_M, Scene
from .machine import LOWER, Errors
from .rotations import Array, skew

Form = Callable[[Scene, np.random.Generator], Errors]

LIBRARY: dict[str, dict[str, Form]] = {
    "drive_zero_offset": {"a": d.zero_offset, "b": d.zero_offset_one, "c": d.zero_offset_homing},
    "drive_scale": {"a": d.scale, "b": d.scale_progressive},
    "drive_cyclic": {"a": d.cyclic, "b": d.cyclic_two},
    "drive_backlash": {"a": d.backlash, "b": d.backlash_loaded, "c": d.backlash_one_sided},
    "joint_centre_offset": {"a": d.centres, "b": d.centres_moving, "c": d.centres_one},
    "joint_axis_tilt": {"a": d.tilts, "b": d.tilts_yokes, "c": d.tilts_bores},
    "leg_thermal_expansion": {"a": h.leg_heat, "b": h.leg_heat_core, "c": h.leg_heat_barrel},
    "platform_thermal_expansion": {"a": h.plate_heat, "b": h.plate_heat_uneven, "c": h.plate_heat_late},
    "leg_compliance": {"a": h.leg_spring, "b": h.leg_spring_nut, "c": h.leg_spring_contact},
    "tilt_drive_compliance": {"a": h.tilt_spring, "b": h.tilt_spring_stiffening},
    "truss_deflection": {"a": h.truss, "b": h.truss_even, "c": h.truss_sine},
    "base_drift": {"a": h.creep, "b": h.creep_settling, "c": h.creep_log},
    "tilt_encoder_eccentricity": {"a": d.eccentricity, "b": d.eccentricity_oval},
    "metrology_scale": {"a": h.ruler, "b": h.ruler_air},
}
"""The 14 effects by id, each in its forms."""

OUTSIDE: dict[str, dict[str, Form]] = {
    "x_sudden_knock": {"a": x.knock, "b": x.knock_mended},
    "x_refraction": {"a": x.refraction, "b": x.refraction_plume},
    "x_tracker_drift_nonlinear": {"a": x.tracker_drift, "b": x.tracker_swing},
    "x_operator_thermal": {"a": x.operator},
    "x_stick_slip": {"a": x.stick_slip, "b": x.stick_slip_legs},
    "x_leg_bending": {"a": x.leg_bending},
    "x_belt_ripple": {"a": x.belt_ripple},
    "x_unsettled": {"a": x.unsettled},
    "x_rail_joint": {"a": x.rail_joint},
}

FORMS = LIBRARY | OUTSIDE

UNITS = {
    "drive_scale": "mm/m",
    "joint_axis_tilt": "mrad",
    "leg_thermal_expansion": "1e-5 /K",
    "platform_thermal_expansion": "1e-5 /K",
    "leg_compliance": "mm at 5 kN",
    "tilt_drive_compliance": "mrad at 2 kNm",
    "truss_deflection": "mm at full load",
    "tilt_encoder_eccentricity": "mrad",
    "metrology_scale": "20 ppm",
}
"""Of an effect's size; millimetres where none is given (and milliradians of θ46 beside them)."""

CAPS = {
    "metrology_scale": 60.0,
    "tilt_encoder_eccentricity": 40.0,
    "leg_thermal_expansion": 8.0,
    "truss_deflection": 15.0,
}
"""Sizes beyond which nobody would believe an effect; 60 of its units where none is given."""

SESSIONS = {("drive_zero_offset", "c"): 2, ("x_tracker_drift_nonlinear", "a"): 3, ("x_operator_thermal", "a"): 3}
"""How many sessions a form needs to show."""


def as_moved(scene: Scene, columns: Array) -> Array:
    """Return motions of the fixed platform (n, 6, k) as motions of the moving one."""
    out = columns.copy()
    out[:, :3] -= skew(scene.poses.position) @ columns[:, 3:]
    return out


def textbook(scene: Scene) -> dict[str, Array]:
    """Return each effect's signature columns (n, 6, k): the first-order motion of the platform in its textbook form."""
    by_drive, by_local = scene.poses.by_drive, scene.poses.by_local
    if by_local is None:
        raise ValueError("plan the campaign with local=True")
    rows, legs, theta = len(scene), scene.drives[:, :3], scene.drives[:, 3]
    lengths = by_drive[:, :, :3]
    turns = (2.0 * np.pi / PITCH_M * legs)[:, None, :]
    warm = scene.thermometers - REFERENCE_DEGC
    growth = by_local[:, :, 12:24] @ LOWER.reshape(12, 1)

    x = scene.travel_m
    bend = np.zeros((rows, 6, 3))
    bend[:, 2, 0] = bend[:, 3, 1] = x**2 * (SPAN_M - x) ** 2 * scene.weight
    bend[:, 3, 2] = x * (SPAN_M - x) * (SPAN_M - 2.0 * x) * scene.weight
    drift = np.eye(6) * scene.when[:, None, None]
    ruler = np.concatenate([scene.poses.position, np.zeros((rows, 3))], axis=1)[:, :, None]
    return {
        "drive_zero_offset": by_drive,
        "drive_scale": lengths * legs[:, None, :],
        "drive_cyclic": np.concatenate([lengths * np.sin(turns), lengths * np.cos(turns)], axis=2),
        "drive_backlash": by_drive * scene.approach[:, None, :],
        "joint_centre_offset": by_local[:, :, :24],
        "joint_axis_tilt": by_local[:, :, 24:84],
        "leg_thermal_expansion": lengths @ (legs * warm[:, :3])[:, :, None],
        "platform_thermal_expansion": growth * warm[:, 4, None, None],
        "leg_compliance": lengths @ np.stack([scene.pull, scene.pull * legs], axis=2),
        "tilt_drive_compliance": by_drive[:, :, 3:] * scene.moment[:, None, None],
        "truss_deflection": as_moved(scene, bend),
        "base_drift": as_moved(scene, drift),
        "tilt_encoder_eccentricity": by_drive[:, :, 3:] * np.stack([np.sin(theta), np.cos(theta)], axis=1)[:, None, :],
        "metrology_scale": ruler,
    }
