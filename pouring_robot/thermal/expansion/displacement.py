"""How far every part of the robot moves at a pose under heat, weight or both: the paper's Fig. 8.

Points of the legs are on the line between their expanded U-joint centres. Points of a platform move with it and expand
from its origin; the ladle expands from the middle of its trunnion axis. Displacements are relative to the fixed
platform; with a truss that warms and sags they are relative to the hall, and the truss is one of the parts.
"""

import functools
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.pouring.layout_schema import Layout
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.thermal.expansion.truss import TrussMotion, TrussTemperatures
from pouring_robot.thermal.expansion.warm_pouring_robot import WarmState

_ON_A_LEG = 12
_ON_A_CIRCLE = 16
_ON_A_BAR = 5
MOVED_HEAD = ("part", "mean", "largest", "from fixed platform: mean", "largest")
"""Headings of :meth:`MovedParts.rows`."""


@dataclass(frozen=True, eq=False)
class DisplacementField:
    """Points of the parts and their displacements."""

    # part of each point, (n,): ``fixed_platform``, ``leg1`` …, ``platform``, ``ladle``; also ``truss`` if displacements
    # are relative to the hall
    parts: tuple[str, ...]
    points_m: FloatArray  # in the drawing, in the fixed platform, shape (n, 3)
    moved_m: FloatArray  # their displacement, shape (n, 3)

    @classmethod
    def of(cls, state: WarmState, ladle_degC: float | None = None, *, ladle_from_o: bool = False) -> Self:
        """Return it for a closed warm robot, or a cold one under loads, relative to the drawing at the same command.

        ``ladle_degC``: temperature of the ladle's steel; by default the network's shell, or the drawing's when cold.
        ``ladle_from_o``: whether the ladle expands from o, the centre in the paper, instead of from its trunnions.
        """
        robot, expansion, layout = state.robot, state.robot.expansion, state.robot.layout
        drives, start = robot.kinematics.inverse(robot.pose), robot.kinematics.configuration(robot.pose)
        poses = robot.nominal_solver.solve(drives, start).pose_base_to_end, state.result.pose_base_to_end
        fixed, moving = np.array(layout.fixed_centres.metres), np.array(layout.moving_centres.metres)
        fixed_growth, moving_growth = 1.0 + expansion.fixed_platform_strain, 1.0 + expansion.platform_strain
        ladle_growth = 1.0
        if state.field is not None:
            ladle_growth += state.field.properties.strain(state.field.shell_degC if ladle_degC is None else ladle_degC)

        def carried(before: FloatArray, after: FloatArray) -> list[FloatArray]:
            """Return points of the moving platform, cold and warm, in the fixed platform."""
            pairs = zip((before, after), poses, strict=True)
            return [np.asarray(points @ np.array(p.rotation).T + np.array(p.translation)) for points, p in pairs]

        bars, feet = _outline(fixed), carried(moving, moving * moving_growth)
        shares = np.linspace(0.0, 1.0, _ON_A_LEG)[:, None]
        found = {"fixed_platform": [bars, bars * fixed_growth]}
        for k, leg in enumerate(LEGS):
            ends = zip((fixed, fixed * fixed_growth), feet, strict=True)
            found[leg] = [upper[k] + shares * (lower[k] - upper[k]) for upper, lower in ends]
        bars = _outline(moving)
        found["platform"] = carried(bars, bars * moving_growth)
        ladle, trunnions = _ladle_points(layout)
        middle = np.zeros(3) if ladle_from_o else trunnions
        found["ladle"] = carried(ladle, middle * moving_growth + (ladle - middle) * ladle_growth)
        parts = tuple(part for part, (points, _) in found.items() for _ in points)
        before, after = (np.concatenate(places) for places in zip(*found.values(), strict=True))
        return cls(parts, before, after - before)

    def on(self, truss: TrussMotion) -> Self:
        """Return the same relative to the hall: the truss moves too, and carries everything with it."""
        moved = self.moved_m + truss.carried_m(self.points_m)
        return type(self)(
            (*self.parts, *["truss"] * len(truss.points_m)),
            np.concatenate([self.points_m, truss.points_m]),
            np.concatenate([moved, truss.moved_m]),
        )

    @property
    def distance_m(self) -> FloatArray:
        """How far each point has moved, shape (n,)."""
        return np.asarray(np.linalg.norm(self.moved_m, axis=1))

    @property
    def by_part(self) -> dict[str, tuple[float, float]]:
        """Mean and largest displacement of each part, in m."""
        names = np.array(self.parts)
        rows = {part: self.distance_m[names == part] for part in dict.fromkeys(self.parts)}
        return {part: (float(values.mean()), float(values.max())) for part, values in rows.items()}

    @property
    def mean_m(self) -> float:
        """Mean over the parts, with equal weights."""
        return float(np.mean([mean for mean, _ in self.by_part.values()]))

    @property
    def largest_m(self) -> float:
        """Largest of all points."""
        return float(self.distance_m.max())

    def figures(self) -> dict[str, Any]:
        """Return mean and largest of each part in mm, ready for JSON."""
        parts = {part: {"mean_mm": mean / MM, "largest_mm": most / MM} for part, (mean, most) in self.by_part.items()}
        return {"parts": parts, "mean_mm": self.mean_m / MM, "largest_mm": self.largest_m / MM}


@dataclass(frozen=True, eq=False)
class MovedParts:
    """Displacements of every part of a robot on its truss."""

    own: DisplacementField  # of the robot's parts, relative to the fixed platform
    truss: TrussMotion  # displacement of the truss
    warm: TrussTemperatures | None  # temperatures of the truss; None for a cold one

    @functools.cached_property
    def hall(self) -> DisplacementField:
        """All parts, relative to the hall."""
        return self.own.on(self.truss)

    def rows(self) -> list[tuple[str, ...]]:
        """Return a row per part and one for all, in mm: mean and largest, from the hall and from the fixed platform."""
        rows = {
            name: [field.by_part[name] for field in (self.hall, self.own) if name in field.by_part]
            for name in self.hall.by_part
        }
        rows["mean of the parts, largest"] = [(field.mean_m, field.largest_m) for field in (self.hall, self.own)]
        return [
            (name.replace("_", " "), *(f"{value / MM:.3f}" for pair in pairs for value in pair))
            for name, pairs in rows.items()
        ]

    @property
    def truss_line(self) -> str:
        """Line with the temperatures of the truss and the displacement of the fixed platform."""
        warm = ""
        if self.warm is not None:
            girders, trolley = (v.max() for v in (self.warm.girders_degC, self.warm.trolley_degC))
            warm = f"girders up to {girders:.0f} degC, trolley up to {trolley:.0f}; "
        x, y, z = (f"{value / MM:+z.2f}" for value in self.truss.shift_m)
        rx, ry, _ = (f"{value / MRAD:+z.2f}" for value in self.truss.turn_rad)
        return f"truss: {warm}it moves the fixed platform by {x} {y} {z} mm and turns it by {rx} {ry} mrad"

    def figures(self) -> dict[str, Any]:
        """Return mean and largest of each part in mm, relative to hall and fixed platform, ready for JSON."""
        truss: dict[str, Any] = {
            "shift_mm": (self.truss.shift_m / MM).tolist(),
            "turn_mrad": (self.truss.turn_rad / MRAD).tolist(),
        }
        if self.warm is not None:
            truss["girders_hottest_degC"] = float(self.warm.girders_degC.max())
            truss["trolley_hottest_degC"] = float(self.warm.trolley_degC.max())
        return self.hall.figures() | {"from_fixed_platform": self.own.figures(), "truss": truss}


def _outline(corners: FloatArray) -> FloatArray:
    """Return points on the bars of a platform, around its four joints (front and back, left and right)."""
    around = corners[[0, 1, 3, 2]]
    shares = np.linspace(0.0, 1.0, _ON_A_BAR, endpoint=False)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in zip(around, np.roll(around, -1, axis=0), strict=True)])


def _ladle_points(layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Return points of the ladle in the moving platform: rim, middle, bottom and lip; and the trunnions' midpoint."""
    ladle = layout.ladle
    rim, height = ladle.rim_centre.metres, ladle.height.metres
    turns = 2.0 * np.pi * np.arange(_ON_A_CIRCLE) / _ON_A_CIRCLE
    circle = np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns])
    top, bottom = ladle.outer_radius_top.metres, ladle.outer_radius_bottom.metres
    rings = [
        rim + (top + share * (bottom - top)) * circle - share * height * np.array([0.0, 0.0, 1.0])
        for share in (0.0, 0.5, 1.0)
    ]
    lip = np.array([[rim[0] + top + ladle.lip_reach.metres, 0.0, rim[2]]])
    middle = np.array(rim) - np.array([0.0, 0.0, layout.moving_platform.trunnion_drop.metres])
    return np.concatenate([*rings, lip]), middle
