"""How far every part of the robot moves at a pose under heat, weight or both: the paper's Fig. 8.

Points of the legs lie on the line between their grown U-joint centres, those of a platform and of the ladle move with
it and grow from its origin; the ladle grows from the middle of its trunnion axis. All are seen from where the fixed
platform stands on the drawing. The truss, which the thermal network leaves cold, counts where it sags under weight, as
beams do, and takes everything down with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure import ClosureResult
from pouring_robot.robot.pouring.layout_schema import LayoutEntry
from pouring_robot.robot.pouring.names import LEGS
from pouring_robot.thermal.expansion.growth import ThermalExpansion
from pouring_robot.thermal.expansion.heated_robot import WarmState

if TYPE_CHECKING:
    import pandas as pd

_ON_A_LEG = 12
_ON_A_CIRCLE = 16
_ON_A_BAR = 5


@dataclass(frozen=True, eq=False)
class DisplacementField:
    """Where points of the parts are and how far they have moved.

    Attributes:
        parts: name of the part that each point belongs to, (n,): ``fixed_platform``, ``leg1`` …, ``platform``,
            ``ladle``; ``truss`` where it sags.
        points_m: on the drawing, in the fixed platform, shape (n, 3).
        moved_m: displacement, shape (n, 3).
    """

    parts: tuple[str, ...]
    points_m: FloatArray
    moved_m: FloatArray

    @classmethod
    def of(
        cls,
        state: WarmState,
        ladle_degC: float | None = None,
        *,
        ladle_from_o: bool = False,
        truss_sag_m: float = 0.0,
    ) -> DisplacementField:
        """Return it for a closed warm robot, or a cold one under loads.

        Args:
            state: the robot at its pose.
            ladle_degC: temperature of the ladle's steel; by default the network's shell, or the drawing's when cold.
            ladle_from_o: whether the ladle grows from o, which the paper takes for its centre, not from its trunnions.
            truss_sag_m: how far the girders sag in their middle.
        """
        robot = state.robot
        start = robot.kinematics.configuration(robot.pose)
        cold = robot.nominal_solver.solve(robot.kinematics.inverse(robot.pose), start)
        growth = 0.0
        if state.field is not None:
            properties = state.field.properties
            shell = state.field.shell_degC if ladle_degC is None else ladle_degC
            growth = properties.steel.expansion.value * (shell - properties.expansion.reference_temperature.value)
        return cls.between(cold, state.result, robot.expansion, robot.dimensions, growth, ladle_from_o, truss_sag_m)

    @classmethod
    def between(
        cls,
        cold: ClosureResult,
        warm: ClosureResult,
        expansion: ThermalExpansion,
        layout: LayoutEntry,
        ladle_strain: float = 0.0,
        ladle_from_o: bool = False,
        truss_sag_m: float = 0.0,
    ) -> DisplacementField:
        """Return it between two closures of the same command.

        Args:
            cold: the drawing.
            warm: grown, loaded or both.
            expansion: how much the parts have grown.
            layout: sizes of the parts.
            ladle_strain: growth of the ladle per length.
            ladle_from_o: as in :meth:`of`.
            truss_sag_m: likewise.
        """
        fixed, moving = layout.fixed_centres.metres, layout.moving_centres.metres
        shares = np.linspace(0.0, 1.0, _ON_A_LEG)
        parts: list[str] = []
        points, moved = [], []

        def add(part: str, before: FloatArray, after: FloatArray) -> None:
            parts.extend([part] * len(before))
            points.append(before)
            moved.append(after - before)

        def placed(result: ClosureResult, on_platform: FloatArray) -> FloatArray:
            pose = result.pose_base_to_end
            return np.asarray(on_platform @ np.array(pose.rotation).T + np.array(pose.translation))

        grown = fixed * (1.0 + expansion.fixed_platform_strain)
        bars = _outline(fixed)
        add("fixed_platform", bars, bars * (1.0 + expansion.fixed_platform_strain))
        feet = placed(cold, moving), placed(warm, moving * (1.0 + expansion.platform_strain))
        for k, leg in enumerate(LEGS):
            line = [a[k] + shares[:, None] * (b[k] - a[k]) for a, b in ((fixed, feet[0]), (grown, feet[1]))]
            add(leg, *line)
        bars = _outline(moving)
        add("platform", placed(cold, bars), placed(warm, bars * (1.0 + expansion.platform_strain)))
        ladle, trunnions = _ladle_points(layout)
        middle = np.zeros(3) if ladle_from_o else trunnions
        swollen = middle * (1.0 + expansion.platform_strain) + (ladle - middle) * (1.0 + ladle_strain)
        add("ladle", placed(cold, ladle), placed(warm, swollen))
        if truss_sag_m > 0.0:
            down = np.array([0.0, 0.0, -truss_sag_m])
            moved = [shift + down for shift in moved]
            girders, share = _girder_points(layout)
            add("truss", girders, girders + share[:, None] * down)
        return cls(tuple(parts), np.concatenate(points), np.concatenate(moved))

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
        """Mean over the parts, each counted alike."""
        return float(np.mean([mean for mean, _ in self.by_part.values()]))

    @property
    def largest_m(self) -> float:
        """Largest of all points."""
        return float(self.distance_m.max())

    def figures(self) -> dict[str, Any]:
        """Return mean and largest of each part in mm, ready for JSON."""
        parts = {part: {"mean_mm": mean * 1e3, "largest_mm": most * 1e3} for part, (mean, most) in self.by_part.items()}
        return {"parts": parts, "mean_mm": self.mean_m * 1e3, "largest_mm": self.largest_m * 1e3}

    def to_frame(self) -> pd.DataFrame:
        """Return one row a point, in mm."""
        import pandas as pd

        columns = {"part": list(self.parts)}
        table = pd.DataFrame(columns)
        table[["x_mm", "y_mm", "z_mm"]] = self.points_m * 1e3
        table[["moved_x_mm", "moved_y_mm", "moved_z_mm"]] = self.moved_m * 1e3
        table["moved_mm"] = self.distance_m * 1e3
        return table


def _outline(corners: FloatArray) -> FloatArray:
    """Return points on the bars of a platform, around its four joints (front and back, left and right)."""
    around = corners[[0, 1, 3, 2]]
    shares = np.linspace(0.0, 1.0, _ON_A_BAR, endpoint=False)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in zip(around, np.roll(around, -1, axis=0), strict=True)])


def _ladle_points(layout: LayoutEntry) -> tuple[FloatArray, FloatArray]:
    """Return points of the ladle in the moving platform: rim, middle, bottom and lip; and its trunnions' middle."""
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


def _girder_points(layout: LayoutEntry) -> tuple[FloatArray, FloatArray]:
    """Return points along both girders in the fixed platform, and their share of the sag under a load in the middle."""
    truss = layout.truss
    along = np.linspace(0.0, 1.0, 2 * _ON_A_BAR + 1)
    near = np.minimum(along, 1.0 - along)
    x, side, up = (along - 0.5) * truss.gauge.metres, truss.girder_offset.metres, truss.platform_drop.metres
    points = np.concatenate([np.column_stack([x, np.full_like(x, y), np.full_like(x, up)]) for y in (side, -side)])
    return points, np.tile(3.0 * near - 4.0 * near**3, 2)
