"""How heat or weight deforms the truss, and where it takes the fixed platform.

A girder that is warmer below than above bows downwards, by the slope of α T over its height, and lies on the two rails
as a beam on two supports (W. Young and R. Budynas, Roark's Formulas for Stress and Strain, 7th ed., table 8.1). The
trolley stands on its four wheels where the girders then are. Its uprights grow downwards from the axles, and the fixed
platform goes with their feet. Everything grows from the middle of the truss.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import IndexArray
from pouring_robot.robot.pouring.layout_schema import LayoutEntry
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties
from pouring_robot.thermal.network.truss import TrussTemperatures

_ALONG = 11
_SIDES = (1.0, -1.0)


@dataclass(frozen=True, eq=False)
class TrussMotion:
    """Where the truss goes. All in the fixed platform of the drawing."""

    points_m: FloatArray  # along the girders' axes, then at the uprights' axles and feet, shape (n, 3)
    moved_m: FloatArray
    shift_m: FloatArray  # of the fixed platform's origin, shape (3,)
    turn_rad: FloatArray  # small rotation vector, shape (3,)

    def __add__(self, other: TrussMotion) -> TrussMotion:
        """Return both together."""
        moved = self.moved_m + other.moved_m
        return TrussMotion(self.points_m, moved, self.shift_m + other.shift_m, self.turn_rad + other.turn_rad)

    def carried_m(self, points_m: FloatArray) -> FloatArray:
        """Return how points that stand in the fixed platform, shape (n, 3), go with it."""
        return np.asarray(self.shift_m + np.cross(self.turn_rad, points_m))

    @classmethod
    def under_weight(cls, layout: LayoutEntry, sag_m: float) -> TrussMotion:
        """Return it for girders that sag in their middle, as under a force there."""
        points = _points(layout)
        near = 0.5 - np.abs(points[: 2 * _ALONG, 0]) / layout.truss.gauge.metres
        share = np.concatenate([3.0 * near - 4.0 * near**3, np.ones(len(points) - 2 * _ALONG)])
        down = np.array([0.0, 0.0, -sag_m])
        return cls(points, share[:, None] * down, down, np.zeros(3))

    @classmethod
    def under_heat(cls, layout: LayoutEntry, found: TrussTemperatures, properties: ThermalProperties) -> TrussMotion:
        """Return it for temperatures."""
        truss, points = layout.truss, _points(layout)
        alpha, cold = properties.steel.expansion.value, properties.expansion.reference_temperature.value
        height, wheel = truss.girder_height.metres, truss.wheel_radius.metres
        girders, feet = points[: 2 * _ALONG].reshape(2, _ALONG, 3), points[2 * _ALONG :].reshape(2, -1, 3)
        step = truss.gauge.metres / found.girders_degC.shape[2]
        bow, strain = _bow_and_strain(found, alpha, cold)
        ends = step * np.arange(bow.shape[1] + 1) - 0.5 * truss.gauge.metres
        places = 0.5 * (ends[1:] + ends[:-1])
        moved = np.zeros_like(girders)
        wheels = np.empty((len(_SIDES), 2))
        for k in range(len(_SIDES)):
            grown = np.append(0.0, np.cumsum(strain[k] * step))
            moved[k, :, 0] = np.interp(girders[k, :, 0], ends, grown) - np.interp(0.0, ends, grown)
            moved[k, :, 2] = _sagged(girders[k, :, 0], places, bow[k] * step, truss.gauge.metres)
            at = feet[0, 2 * k : 2 * k + 2, 0]
            rises = 0.5 * height * np.interp(at, places, strain[k])
            wheels[k] = _sagged(at, places, bow[k] * step, truss.gauge.metres) + rises
        warm = alpha * (found.trolley_degC[_uprights(found, feet[0])] - cold)
        axles = wheels.ravel() + wheel * warm[:, -1]
        hang = -(feet[0, 0, 2] - feet[1, 0, 2]) * warm.mean(axis=1)
        leans, tilts = _plane(feet[0], wheels.ravel()), _plane(feet[1], axles - wheels.ravel() + hang)
        lever = np.array([0.0, 0.0, -truss.platform_drop.metres - 0.5 * height])
        shift = np.array([0.0, 0.0, leans[0] + tilts[0]]) + np.cross(leans[1], lever)
        level = np.zeros_like(feet)
        level[0, :, 2], level[1, :, 2] = axles, axles + hang
        return cls(points, np.concatenate([moved.reshape(-1, 3), level.reshape(-1, 3)]), shift, leans[1] + tilts[1])


def _points(layout: LayoutEntry) -> FloatArray:
    """Return points along both girders, then axles and feet of the four uprights, shape (2 · 11 + 8, 3), in m."""
    truss = layout.truss
    bar, up = truss.trolley_bar.metres, truss.platform_drop.metres
    x, y = 0.5 * (truss.trolley_length.metres - bar), truss.girder_offset.metres
    along = np.linspace(-0.5, 0.5, _ALONG) * truss.gauge.metres
    girders = [[place, side * y, up] for side in _SIDES for place in along]
    out = y + 0.5 * truss.girder_width.metres + bar
    axle = up + 0.5 * truss.girder_height.metres + truss.wheel_radius.metres
    foot = 0.5 * (layout.fixed_platform.bar_height.metres + bar)
    uprights = [[end * x, side * out, z] for z in (axle, foot) for side in _SIDES for end in (-1.0, 1.0)]
    return np.array(girders + uprights)


def _bow_and_strain(found: TrussTemperatures, alpha: float, cold: float) -> tuple[FloatArray, FloatArray]:
    """Return curvature downwards, in 1/m, and strain of both girders, cell by cell, shape (2, cells)."""
    shape = found.girders_degC.shape
    height, size = (values.reshape(shape) for values in (found.girders.centres_m[:, 2], found.girders.volume_m3))
    above = height - height.mean(axis=1, keepdims=True)
    grown = alpha * size * (found.girders_degC - cold)
    return -(grown * above).sum(axis=1) / (size * above**2).sum(axis=1), grown.sum(axis=1) / size.sum(axis=1)


def _sagged(at: FloatArray, places: FloatArray, turns: FloatArray, span: float) -> FloatArray:
    """Return the deflection, upwards positive, of a beam on two supports that is turned by angles at places."""
    s, x = places + 0.5 * span, np.asarray(at)[:, None] + 0.5 * span
    return np.asarray(-(np.minimum(x, s) * (span - np.maximum(x, s)) / span) @ turns)


def _uprights(found: TrussTemperatures, axles: FloatArray) -> IndexArray:
    """Return which of the trolley's bars stands at each axle."""
    cells = found.trolley.centres_m.reshape(*found.trolley_degC.shape, 3)
    flat = np.ptp(cells[..., 2], axis=1) == 0.0
    away = np.linalg.norm(cells[:, 0, None, :2] - axles[:, :2], axis=2) + np.where(flat, np.inf, 0.0)[:, None]
    return np.asarray(away.argmin(axis=0))


def _plane(points: FloatArray, heights: FloatArray) -> tuple[float, FloatArray]:
    """Return height in the middle and rotation vector of the plane through heights at points, least squares."""
    rows = np.column_stack([np.ones(len(points)), points[:, :2]])
    middle, along_x, along_y = np.linalg.lstsq(rows, heights, rcond=None)[0]
    return float(middle), np.array([along_y, -along_x, 0.0])
