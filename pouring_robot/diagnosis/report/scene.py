"""Nominal, modelled and measured ladles of a few rows in one scene, differences enlarged.

A measured pose is taken through the two frames of the amended model into the fixed platform. The rows stand side
by side, though all were measured in one place; the legs are drawn for the first only.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.estimation.frames import OuterFrames
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, PoseDifference
from pouring_robot.robot.robot import PouringRobot
from pouring_robot.robot.scene import VIEW_DIRECTION, drawn_robot, enlarged_pose, exaggeration_for
from pouring_robot.viewer import GHOST_TINT, Scene, SceneArrow, SceneRobot, camera_on
from pouring_robot.viewer.scene import BACKGROUND_LINKS, Colour

_SHOWN, _APART_M = 3, 1.4
# To the right for who looks along the scene's view direction.
_ASIDE = np.array([-VIEW_DIRECTION[1], VIEW_DIRECTION[0], 0.0]) / np.hypot(*VIEW_DIRECTION[:2])
_MODEL_TINT, _MEASURED_TINT = (0.0, 0.45, 0.70), (0.84, 0.37, 0.0)


@dataclasses.dataclass(frozen=True, eq=False)
class SeenRow:
    """One row in the fixed platform.

    Attributes:
        row: index among the inliers.
        nominal: moving platform by the drawing.
        model: moving platform by the amended model.
        measured: moving platform as measured; its rotation is the model's where only the position was measured.
    """

    row: int
    nominal: pin.SE3
    model: pin.SE3
    measured: pin.SE3

    def off(self, which: pin.SE3, at_platform: pin.SE3) -> PoseDifference:
        """Return how far a pose is from the drawing, at a frame fixed on the moving platform."""
        return PoseDifference.between(self.nominal * at_platform, which * at_platform)


def seen_rows(diagnosis: Conclusions) -> list[SeenRow]:
    """Return representative rows, the one farthest from the drawing first."""
    rows, state = diagnosis.rows, diagnosis.before if diagnosis.refused else diagnosis.after
    here = OuterFrames(pin.SE3.Identity(), pin.SE3.Identity())
    drawing = _drawing(diagnosis).predicted(rows.unchanged(), here)
    model = rows.predicted(rows.changes(state.parameters, state.values), here)
    whole = np.isfinite(rows.measured.position_m).all(axis=1) & drawing.closed & model.closed
    return _chosen(
        [
            SeenRow(
                row,
                pin.SE3(drawing.rotation[row], drawing.position_m[row]),
                pin.SE3(model.rotation[row], model.position_m[row]),
                _measured(rows, state.frames, row, model.rotation[row]),
            )
            for row in np.flatnonzero(whole).tolist()
        ],
        diagnosis.model.nominal_mechanism().T_end_tool,
        rows.conditions.position_m,
    )


def _drawing(diagnosis: Conclusions) -> CampaignRows:
    bare: dict[str, Any] = {"joint_placements": {}, "drive_offsets": {}, "effects": []}
    if diagnosis.model.is_drawing and not diagnosis.model.effects:
        return diagnosis.rows
    return CampaignRows(diagnosis.rows.campaign, diagnosis.model.model_copy(update=bare), diagnosis.noise)


def _measured(rows: CampaignRows, frames: OuterFrames, row: int, rotation: FloatArray) -> pin.SE3:
    """Return the moving platform as measured, in the fixed platform."""
    outer, inner = frames.T_tracker_base, frames.T_end_target
    turned = rows.measured.rotation[row]
    seen_turn = turned if np.isfinite(turned).all() else outer.rotation @ rotation @ inner.rotation
    seen = pin.SE3(seen_turn, rows.measured.position_m[row])
    return outer.inverse() * seen * inner.inverse()


def _chosen(found: list[SeenRow], lip: pin.SE3, places: FloatArray) -> list[SeenRow]:
    """Return the row farthest from the drawing and then, one by one, the row farthest in space from those chosen."""
    if not found:
        return []
    sizes = np.array([item.off(item.measured, lip).distance_m for item in found])
    where = places[[item.row for item in found]]
    picked = [int(np.argmax(sizes))]
    while len(picked) < min(_SHOWN, len(found)):
        apart = np.linalg.norm(where[:, None] - where[picked][None], axis=2).min(axis=1)
        picked.append(int(np.argmax(apart)))
    return [found[k] for k in picked]


def ladle_scene(diagnosis: Conclusions) -> Scene | None:
    """Return the scene; None where no row has a measured position, and for robots that carry no ladle."""
    if diagnosis.model.robot is not None:
        return None
    found = seen_rows(diagnosis)
    if not found:
        return None
    lip = diagnosis.model.nominal_mechanism().T_end_tool
    factor = exaggeration_for(max(item.off(item.measured, lip).distance_m for item in found))
    robot = PouringRobot(diagnosis.model)
    mechanism, loops = robot.nominal_solver.mechanism, robot.nominal_solver.mechanism.loops
    commanded = diagnosis.rows.campaign.drive_values(found[0].row)
    configuration = robot.kinematics.configuration(robot.kinematics.forward(commanded))
    whole = drawn_robot(mechanism, configuration, "legs", "as drawn", opacity=0.25, tint=GHOST_TINT)
    data = whole.model.createData()
    pin.framesForwardKinematics(whole.model, data, configuration)
    base = data.oMf[mechanism.frame_id(loops.base_frame)]
    ladle = _Ladle(whole, mechanism.frame_id(str(loops.end_frame)), data)
    slots = [pin.SE3(np.eye(3), k * _APART_M * _ASIDE) * base for k in range(len(found))]
    whole = dataclasses.replace(whole, visual=ladle.others(BACKGROUND_LINKS))

    def drawn(name: str, label: str, tint: Colour, opacity: float, poses: list[pin.SE3]) -> SceneRobot:
        placed = [slot * pose for slot, pose in zip(slots, poses, strict=True)]
        return SceneRobot(name, pin.Model(), ladle.at(placed), np.zeros(0), opacity=opacity, tint=tint, label=label)

    def enlarged(nominal: pin.SE3, pose: pin.SE3) -> pin.SE3:
        return enlarged_pose(nominal, PoseDifference.between(nominal, pose), factor)

    model = [enlarged(item.nominal, item.model) for item in found]
    measured = [enlarged(item.nominal, item.measured) for item in found]
    assumed = [("measured", "rotations are the model's: only positions were measured")]
    assumed = [] if diagnosis.campaign.full_pose else assumed
    said = "as the given model says" if diagnosis.refused else "as the amended model says"
    scene = Scene(
        title=f"Nominal, modelled and measured ladles of {diagnosis.campaign.path.name}",
        robots=(
            drawn("measured", "as measured", _MEASURED_TINT, 1.0, measured),
            drawn("model", said, _MODEL_TINT, 0.55, model),
            drawn("nominal", "as drawn", GHOST_TINT, 0.35, [item.nominal for item in found]),
            whole,
        ),
        arrows=tuple(
            SceneArrow(
                f"line {_line(diagnosis, item)}",
                (slot * item.nominal * lip).translation,
                (slot * end * lip).translation,
                label=f"{item.off(item.measured, lip).distance_m / MM:.2f} mm",
            )
            for slot, item, end in zip(slots, found, measured, strict=True)
        ),
        caption=(*(_caption(diagnosis, item, lip) for item in found), *assumed),
        exaggeration=factor,
    )
    return dataclasses.replace(scene, camera=camera_on(scene, VIEW_DIRECTION))


class _Ladle:
    """What moves with the platform, cut out of a drawn robot."""

    def __init__(self, robot: SceneRobot, frame: int, data: pin.Data) -> None:
        """Keep the parts that hang on the joint of a frame, placed in that frame."""
        joint = robot.model.frames[frame].parentJoint
        self._robot = robot
        self._parts = [part for part in robot.visual.geometryObjects if part.parentJoint == joint]
        self._pose_platform_to_joint = data.oMf[frame].actInv(data.oMi[joint])

    def others(self, left_out: Sequence[str]) -> pin.GeometryModel:
        """Return what does not move with the platform, some links left out."""
        own, visual = {part.name for part in self._parts}, pin.GeometryModel()
        for part in self._robot.visual.geometryObjects:
            if part.name not in own and self._robot.model.frames[part.parentFrame].name not in left_out:
                visual.addGeometryObject(part.copy())
        return visual

    def at(self, poses: Sequence[pin.SE3]) -> pin.GeometryModel:
        """Return one ladle for each pose of the platform in the world, fixed there."""
        visual = pin.GeometryModel()
        for k, pose in enumerate(poses):
            for part in self._parts:
                copy = part.copy()
                copy.name, copy.parentJoint, copy.parentFrame = f"{part.name} {k}", 0, 0
                copy.placement = pose * self._pose_platform_to_joint * part.placement
                visual.addGeometryObject(copy)
        return visual


def _line(diagnosis: Conclusions, item: SeenRow) -> int:
    return int(diagnosis.rows.campaign.lines[item.row])


def _caption(diagnosis: Conclusions, item: SeenRow, lip: pin.SE3) -> tuple[str, str]:
    """Return what a row says: measured against the drawing and against the model, at the pouring lip."""
    drawn = item.off(item.measured, lip).distance_m / MM
    left = float(np.linalg.norm((item.measured * lip).translation - (item.model * lip).translation)) / MM
    return f"line {_line(diagnosis, item)}", f"{drawn:.2f} mm off drawing, {left:.2f} off model"
