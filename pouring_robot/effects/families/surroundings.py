"""Families of effects of the robot's surroundings: the ground under it and the device that measures it."""

import functools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pouring_robot.effects.base import EffectParameter, Family, Form
from pouring_robot.effects.conditions import Conditions
from pouring_robot.estimation.changes import SCALE
from pouring_robot.io.units import shown_in
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.mechanism.local_parameters import COMPONENTS, component_unit

_SETTLING = (0.15, 0.3, 0.6)  # time constants of settling, as shares of the campaign


class BaseDrift(Family):
    """The base drifts with time. Its displacement is zero in the middle of the campaign's time, or on average."""

    driven_by = "time_s"

    def missing(self, conditions: Conditions) -> tuple[str, ...]:
        """The order of rows can replace time within the campaign itself only."""
        return () if conditions.timed else ("time_s",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Steady with a slowly changing rate, settling, or with the logarithm of time."""
        t = conditions.elapsed
        middle = t - 0.5
        bend, turn = _moved(middle**2 - 1.0 / 12.0, "bend", 0.3), _moved(middle**3 - 0.15 * middle, "turn", 0.15)
        forms = [Form("steady", (*_moved(middle), *bend, *turn))]
        # Minus the mean over evenly spaced times; any constant would do, as the frames are free.
        courses = {f"settling_{s:g}": s * (1.0 - np.exp(-1.0 / s)) - np.exp(-t / s) for s in _SETTLING}
        courses["logarithmic"] = (np.log1p(4.0 * t) + 1.0) / np.log(5.0) - 1.25
        for name, course in courses.items():
            forms.append(Form(name, (*_moved(course), *_moved(middle, "steady", 0.2))))
        return tuple(forms)


def _moved(course: FloatArray, name: str = "", share: float = 1.0) -> Iterator[EffectParameter]:
    """Yield six parameters that move the base by ``course``, (n,); with a name they only shape the main ones."""
    for component in COMPONENTS:
        (unit, si), prior_std = shown_in(component_unit(component)), 1.0 if component.startswith("t") else 0.4
        label = f"{component}_{name}" if name else component
        yield EffectParameter(label, unit, share * prior_std, {f"base.{component}": si * course}, main=not name)


class SessionOffset(Family):
    """Base or measuring device are at another place in each session."""

    driven_by = "session"

    def missing(self, conditions: Conditions) -> tuple[str, ...]:
        """It needs several sessions."""
        return () if len(conditions.session_shares) > 1 else ("session",)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Six displacements of the base per session, or three without rotation; what all share belongs to the frames.

        In a session in which none were learned they are zero. They are reported relative to their mean over the fitted
        rows.
        """
        moved = [
            replace(parameter, name=f"session_{k + 1}_{parameter.name}")
            for k, share in enumerate(conditions.session_shares.tolist())
            for parameter in _moved(np.where(conditions.session == -1, 0.0, conditions.in_session(k) - share))
        ]
        ways = {"each_session": moved, "each_session_shifted": [p for p in moved if p.unit == "mm"]}
        return tuple(
            Form(
                name,
                tuple(p),
                "whether it turns",
                reporting_matrix=functools.partial(_from_mean, conditions.session, len(p)),
            )
            for name, p in ways.items()
        )


def _from_mean(session: Indices, count: int, fitted: BoolArray) -> FloatArray:
    """Return the matrix, (count, count), that subtracts from displacements by session their mean over fitted rows."""
    shares = np.bincount(session[fitted], minlength=int(session.max()) + 1) / fitted.sum()
    return np.kron(np.eye(len(shares)) - shares, np.eye(count // len(shares)))


class MetrologyScale(Family):
    """The measuring device's scale is wrong."""

    shaped_by = ("ambient_rise_k",)
    moves_robot = False
    distinguished_by = "measure a calibrated length with the same device"

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """Constant, or by air temperature where that is known: the refractive index changes by 1e-6 per kelvin."""
        ppm = 1e-6 * np.ones(len(conditions))
        constant = EffectParameter("scale", "1e-6", 100.0, {SCALE: ppm})
        if "ambient" not in conditions.rises:
            return (Form("constant", (constant,)),)
        change = ppm * (conditions.rises["ambient"] - conditions.mean_rise_k("ambient"))
        air = EffectParameter("scale_by_air", "1e-6/K", 3.0, {SCALE: change})
        forms = {"constant": (constant, replace(air, main=False)), "air": (air, replace(constant, main=False))}
        return tuple(Form(name, parameters) for name, parameters in forms.items())
