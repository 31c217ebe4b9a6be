"""Effects of weight: legs stretch, the tilt drive yields, the truss sinks and rolls."""

from __future__ import annotations

import numpy as np

from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.drives import CHANNELS, LEGS, of_legs
from pouring_robot.mechanism.poses import MM, MRAD

_LEG_LOAD_N, _LEG_M, _MOMENT_NM, _WEIGHT_N = 5000.0, 0.6, 2000.0, 6500.0
"""Loads at which deflections are given: about the largest of this robot."""
_LATER = 0.2


class LegCompliance(Effect):
    """Legs stretch under ladle weight."""

    id = "leg_compliance"
    story = "the legs stretch under the weight they carry"
    needs = ("leg_pull_n",)
    small = 0.02  # mm at 5 kN

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Rods (with pull and length), nuts and bearings (with pull), ball contacts (with its power 2/3)."""
        pull = np.asarray(conditions.leg_pull_n) / _LEG_LOAD_N
        rod = pull * conditions.lengths_m[:, :3] / _LEG_M
        courses = {"rod": rod, "nut": pull, "contact": np.sign(pull) * np.abs(pull) ** (2.0 / 3.0)}
        unit = "mm at 5 kN"
        found = []
        for name, course in courses.items():
            shape = [
                EffectParameter("stiffening", unit, _LATER, of_legs(MM, pull * np.abs(pull)), main=False),
                EffectParameter("rod_share", unit, 0.3, of_legs(MM, rod - pull), main=False),
                *(
                    EffectParameter(f"l{k + 1}_difference", unit, 0.1, {CHANNELS[k]: MM * course[:, k]}, main=False)
                    for k in LEGS
                ),
            ]
            main = EffectParameter("stretch", unit, 1.0, of_legs(MM, course), bounds=(0.0, np.inf))
            found.append(Form(name, (main, *shape)))
        return tuple(found)


class TiltDriveCompliance(Effect):
    """θ46 yields to the ladle's moment."""

    id = "tilt_drive_compliance"
    story = "the tilt drive yields to the moment of the ladle"
    needs = ("tilt_moment_nm",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """In proportion to the moment, perhaps stiffening."""
        moment = np.asarray(conditions.tilt_moment_nm) / _MOMENT_NM
        unit = "mrad at 2 kNm"
        channel = CHANNELS[3]
        return (
            Form(
                "spring",
                (
                    EffectParameter("yield", unit, 1.0, {channel: MRAD * moment}, bounds=(0.0, np.inf)),
                    EffectParameter("cubic", unit, _LATER, {channel: MRAD * moment**3}, main=False),
                    EffectParameter("quadratic", unit, _LATER, {channel: MRAD * moment * np.abs(moment)}, main=False),
                ),
            ),
        )


class TrussDeflection(Effect):
    """Fixed platform sinks and rolls with travel and load."""

    id = "truss_deflection"
    story = "the truss sinks under the carriage and leans with the slope of its deflection"
    needs = ("weight_n", "truss_travel_m", "truss_span_m")
    driven_by = "truss_travel_m"

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """A moving load on two posts, an evenly loaded beam, half a sine; torsion and dead load may add to it."""
        span = float(conditions.truss_span_m or np.nan)
        x = np.asarray(conditions.truss_travel_m) / span
        lines = {
            "moving_load": (16.0 * (x * (1.0 - x)) ** 2, 32.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / span),
            "even_load": (3.2 * x * (1.0 - x) * (1.0 + x - x**2), 3.2 * (1.0 - 6.0 * x**2 + 4.0 * x**3) / span),
            "half_sine": (np.sin(np.pi * x), np.pi / span * np.cos(np.pi * x)),
        }
        load = np.asarray(conditions.weight_n) / _WEIGHT_N
        found = []
        for name, (sink, slope) in lines.items():
            courses = (
                ("sink", "mm", 1.0, "base.tz", -MM * sink, True),
                ("lean", "mrad m/mm", 1.0, "base.rx", MRAD * slope, True),
                ("torsion", "mrad", 0.5, "base.rx", MRAD * sink, False),
            )
            live = [
                EffectParameter(label, f"{unit} at 6.5 kN", prior_std, {channel: course * load}, main)
                for label, unit, prior_std, channel, course, main in courses
            ]
            dead = [
                EffectParameter(f"dead_{label}", unit, 0.3 * prior_std, {channel: course}, main=False)
                for label, unit, prior_std, channel, course, _ in courses
            ]
            found.append(Form(name, (*live, *dead)))
        return tuple(found)
