"""The telescope as a problem for the diagnosis core: a constant focus, known effects, nights that may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pouring_robot.inference.gaussian_processes.kernels import separate, smooth, standardised, wandering
from pouring_robot.inference.gaussian_processes.processes import Process
from pouring_robot.inference.problem import Explanation, Problem
from pouring_robot.mechanism.arrays import FloatArray

from .data import FocusRows

PRIOR_STD_UM = 100.0
"""Usual size of every effect, per K where it is one of temperature: a steel truss of 9 m grows 100 µm a kelvin.

Alike for all, so that it favours none; evidence is averaged over scales from a hundredth to ten times it.
"""
NIGHT = "night"


@dataclass(frozen=True, eq=False)
class Form:
    """One form of a known effect.

    Attributes:
        columns: shape (n, k): change of focus per unit of each parameter, in µm per ``units``.
        names: of the parameters.
        units: of the parameters.
    """

    columns: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]


STORIES = {
    "truss_expansion": "the truss that carries the camera grows",
    "mirror_expansion": "mirror and cell change shape",
    "air_temperature": "what follows the sensor T_NNT",
    "elevation_flexure": "truss and cell sag with elevation",
    "azimuth": "what follows the azimuth, such as the dome",
}


def effect_forms(rows: FocusRows) -> dict[tuple[str, str], Form]:
    """Return the forms of the effects whose conditions every row has, by effect and form."""
    elevation, azimuth = np.radians(rows.elevation_deg), np.radians(rows.azimuth_deg)
    found = {
        ("truss_expansion", "linear"): _by_temperature(rows.truss_degc),
        ("mirror_expansion", "linear"): _by_temperature(rows.mirror_degc),
        ("air_temperature", "linear"): _by_temperature(rows.air_degc),
        ("elevation_flexure", "sine"): Form(np.sin(elevation)[:, None], ("sine",), ("µm",)),
        ("elevation_flexure", "sine and cosine"): _by_angle(elevation),
        ("azimuth", "sine and cosine"): _by_angle(azimuth),
    }
    return {key: form for key, form in found.items() if np.isfinite(form.columns).all()}


def _by_temperature(given: FloatArray) -> Form:
    return Form((given - given.mean())[:, None], ("slope",), ("µm/K",))


def _by_angle(angle: FloatArray) -> Form:
    return Form(np.column_stack([np.sin(angle), np.cos(angle)]), ("sine", "cosine"), ("µm", "µm"))


def night_columns(rows: FocusRows) -> dict[int, FloatArray]:
    """Return a column (n, 1) for each night that is not a whole instrument's."""
    found = {int(night): (rows.night == night).astype(float)[:, None] for night in np.unique(rows.night)}
    per_instrument = [rows.instrument == k for k in np.unique(rows.instrument)]
    return {n: c for n, c in found.items() if not any((c[:, 0] > 0.0)[own].all() for own in per_instrument)}


def forms(rows: FocusRows) -> dict[tuple[str, str], Form]:
    """Return all that may be fitted: forms of effects, and an offset of each night."""
    nights = {
        (f"{NIGHT} {night}", "offset"): Form(column, ("offset",), ("µm",))
        for night, column in night_columns(rows).items()
    }
    return effect_forms(rows) | nights


def is_night(key: tuple[str, str]) -> bool:
    """Return whether an explanation is a night's own offset, which names no cause."""
    return key[0].startswith(f"{NIGHT} ")


def problem_of(rows: FocusRows) -> Problem:
    """Return the problem for a noise of 1 µm: constants are free, a night off is an explanation but no cause."""
    found = [
        Explanation(*key, PRIOR_STD_UM * f.columns, np.ones(f.columns.shape[1], dtype=bool), cause=not is_night(key))
        for key, f in forms(rows).items()
    ]
    return Problem.build(rows.focus_um, constants(rows), (), found)


def constants(rows: FocusRows) -> FloatArray:
    """Return a column for each instrument's own zero of focus, shape (n, instruments)."""
    return separate(rows.instrument.astype(np.int64))


def descriptions(rows: FocusRows) -> list[Process]:
    """Return how something unknown may move the focus; columns in µm, not whitened."""
    found = [("each night", separate(rows.night)), ("date", wandering(rows.day))]
    found += [("order of exposures", wandering(np.argsort(np.argsort(rows.exposure)).astype(float)))]
    found += [(f"{NIGHT} {night} alone", column) for night, column in night_columns(rows).items()]
    for by, given in (("truss temperature", rows.truss_degc), ("mirror temperature", rows.mirror_degc)):
        found.append((by, smooth(standardised(given), 1.0)))
    found.append(("elevation", smooth(rows.elevation_deg, 20.0)))
    azimuth = np.radians(rows.azimuth_deg)
    found.append(("azimuth", smooth(np.column_stack([np.sin(azimuth), np.cos(azimuth)]), 1.0)))
    return [
        Process.of_columns("focus", by, PRIOR_STD_UM * columns) for by, columns in found if np.isfinite(columns).all()
    ]
