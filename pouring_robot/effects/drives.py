"""Effects of the drives: zeros, leads, screws, lost motion, the tilt encoder."""

from __future__ import annotations

import numpy as np

from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.pouring.names import DRIVE_JOINTS, DRIVE_SYMBOLS

CHANNELS = tuple(f"drive.{joint}" for joint in DRIVE_JOINTS)
LEGS = (0, 1, 2)
"""Drives that are lengths; the fourth is an angle."""
_MIDDLE_M, _HALF_STROKE_M = 0.55, 0.2
_HOMES_M = (0.3, 0.4, 0.5)
"""Lengths at which a leg may have been homed."""


def of_legs(unit: float, courses: FloatArray) -> dict[str, FloatArray]:
    """Return the change of all three driven legs along courses (n, 3 or more), of a unit in m."""
    return {CHANNELS[k]: unit * courses[:, k] for k in LEGS}


def of_drive(drive: int, name: str, prior_std: float, course: FloatArray, main: bool = True) -> EffectParameter:
    """Return a parameter that moves one drive along a course (n,), in its own unit."""
    unit, si = ("mm", MM) if drive in LEGS else ("mrad", MRAD)
    return EffectParameter(f"{DRIVE_SYMBOLS[drive]}_{name}", unit, prior_std, {CHANNELS[drive]: si * course}, main)


class DriveZeroOffset(Effect):
    """Constant error of l1, l2, l3 and θ46."""

    id = "drive_zero_offset"
    story = "the zeros of the drives are set wrong"
    driven_by = "tilt_rad"
    _HOMING = 0.02

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All four drives, or one alone; each session's homing may scatter by a fiftieth."""
        one = np.ones(len(conditions))
        homing = [
            of_drive(k, f"homing_session_{s + 1}", self._HOMING, (conditions.session == s).astype(float), main=False)
            for k in range(4)
            for s in range(int(conditions.session.max()) + 1)
            if conditions.session.max() > 0
        ]
        offsets = [of_drive(k, "offset", 1.0, one) for k in range(4)]
        forms = [Form("all", tuple(offsets)), *(Form(f"{DRIVE_SYMBOLS[k]}_alone", (offsets[k],)) for k in range(4))]
        if homing:
            forms += [Form(f"{form.name}_homed", (*form.parameters, *homing)) for form in forms]
        return tuple(forms)


class DriveScale(Effect):
    """Lead error of l1, l2, l3."""

    id = "drive_scale"
    story = "the screws have another lead than the controller believes"
    driven_by = "lengths_m"

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """In proportion to the length, or to the stroke from a home position; the lead may change along the screw."""
        found = []
        for home_m in (0.0, *_HOMES_M):
            name = f"stroke_from_{1e3 * home_m:.0f}_mm" if home_m else "whole_length"
            stroke = conditions.lengths_m - home_m
            bent = (conditions.lengths_m - _MIDDLE_M) ** 2 - _HALF_STROKE_M**2 / 3.0
            if home_m:
                bent = stroke * np.abs(stroke)
            lead = [of_drive(k, "scale", 1.0, stroke[:, k]) for k in LEGS]
            progressive = [of_drive(k, "progression", 0.5, bent[:, k], main=False) for k in LEGS]
            both = (*lead, *progressive)
            parameters = tuple(EffectParameter(p.name, "mm/m", p.prior_std, p.changes, p.main) for p in both)
            found.append(Form(name, parameters))
        return tuple(found)


class DriveCyclic(Effect):
    """Periodic with the screw pitch."""

    id = "drive_cyclic"
    story = "the screws run out of true: an error that returns with every turn"
    needs = ("screw_pitch_m",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Once a turn; two and three times a turn as overtones."""
        parameters = []
        for harmonic, prior_std in ((1, 1.0), (2, 0.25), (3, 0.1)):
            for k in LEGS:
                turn = 2.0 * np.pi * harmonic * conditions.drives[:, k] / float(conditions.screw_pitch_m or np.nan)
                parameters += [
                    of_drive(k, f"{name}_{harmonic}", prior_std, wave(turn), main=harmonic == 1)
                    for name, wave in (("sine", np.sin), ("cosine", np.cos))
                ]
        return (Form("turns", tuple(parameters)),)


class DriveBacklash(Effect):
    """Lost motion, by the side a drive was approached from."""

    id = "drive_backlash"
    story = "nuts and gears have play: a drive stops short on the side it came from"
    needs = ("approach",)
    _LOADED, _LATER, _WORN = 0.3, 0.1, 0.1

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Symmetrical, or on one side only; load may take up part of it, wear may make more of it along the screw."""
        side = np.asarray(conditions.approach)
        found = []
        for name, sides in (
            ("both_sides", side),
            ("rising_only", 0.5 * (side + 1.0)),
            ("falling_only", 0.5 * (side - 1.0)),
        ):
            parameters = [of_drive(k, "play", 1.0, sides[:, k]) for k in range(4)]
            stroke = (conditions.lengths_m - _MIDDLE_M) / _HALF_STROKE_M
            parameters += [
                of_drive(k, name, prior_std, sides[:, k] * stroke[:, k] ** power, main=False)
                for name, prior_std, power in (("play_by_length", self._WORN, 1), ("play_by_length_2", self._WORN, 2))
                for k in LEGS
            ]
            if conditions.leg_pull_n is not None and conditions.tilt_moment_nm is not None:
                force = np.abs(np.column_stack([conditions.leg_pull_n, conditions.tilt_moment_nm]))
                relative = force / np.maximum(force.mean(axis=0), 1e-9) - 1.0
                parameters += [
                    of_drive(k, name, std, sides[:, k] * relative[:, k] ** power, main=False)
                    for name, std, power in (("play_by_load", self._LOADED, 1), ("play_by_load_2", self._LATER, 2))
                    for k in range(4)
                ]
            found.append(Form(name, tuple(parameters)))
        return tuple(found)


class TiltEncoderEccentricity(Effect):
    """Error of θ46 periodic in θ46."""

    id = "tilt_encoder_eccentricity"
    story = "the disc of the tilt encoder sits off centre"
    driven_by = "tilt_drive_rad"

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Once a turn; an oval disc adds twice a turn."""
        angle = conditions.drives[:, 3]
        parameters = [
            of_drive(3, f"{name}_{harmonic}", prior_std, wave(harmonic * angle), main=harmonic == 1)
            for harmonic, prior_std in ((1, 1.0), (2, 0.25))
            for name, wave in (("sine", np.sin), ("cosine", np.cos))
        ]
        return (Form("turns", tuple(parameters)),)
