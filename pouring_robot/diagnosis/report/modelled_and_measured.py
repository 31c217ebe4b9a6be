"""Measured against drawn and modelled ladles: one measured ladle, and the states with which it can be compared.

Each state is a robot with its own two outer frames, fitted to the campaign: the drawing, the model given, the amended
model. Its residual is drawn, enlarged, from where the ladle was measured; without a residual the two coincide.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.estimation.changes import RowChanges
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.estimation.map_fit import seen_from_one_place
from pouring_robot.estimation.noise import noise_beforehand
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.poses import bodies_at
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import robot_of
from pouring_robot.robot.view.nominal_and_actual import drawn_robot, exaggeration_for, frame_places
from pouring_robot.viewer import GHOST_TINT, Curve, Scene, SceneArrows, SceneRobot, Step
from pouring_robot.viewer.scene import BACKGROUND_LINKS, Colour

_MEASURED_TINT: Colour = (0.94, 0.89, 0.26)  # of Okabe and Ito, three times as bright as arrows and states
_STATE_TINTS: dict[str, Colour] = {
    "drawing": (0.45, 0.45, 0.50),
    "model given": (0.55, 0.35, 0.75),
    "amended model": (0.0, 0.45, 0.70),
}
_MOST_ARROWS = 150
_NOISE = 30.0
"""Gap, in noise standard deviations, below which the enlargement no longer grows: mere noise is then some mm."""


@dataclasses.dataclass(frozen=True, eq=False)
class ModelledState:
    """A robot compared with the measurements; poses of the end body in the base, NaN where a row has none."""

    name: str  # in words
    model: FloatArray  # by this robot, (n, 4, 4)
    # as measured, through its frames, likewise; with the model's rotation where only a position was measured
    measured: FloatArray

    @classmethod
    def of(cls, name: str, rows: CampaignRows, changes: RowChanges, frames: OuterFrames) -> Self:
        """Return the state of a robot with changes put in, for the rows of a campaign."""
        predicted = rows.predicted(changes, frames)
        turned = np.where(np.isfinite(rows.measured.rotation), rows.measured.rotation, predicted.rotation)
        poses = ((predicted.rotation, predicted.position_m), (turned, rows.measured.position_m))
        return cls(name, *(_inside(frames, *pose) for pose in poses))

    def gaps_m(self, tool: FloatArray) -> FloatArray:
        """Return how far the robot's working frame is from where it was measured, (n, 3), in the base's axes."""
        return ((self.model - self.measured) @ tool)[:, :3, 3]


def _inside(frames: OuterFrames, rotation: FloatArray, position_m: FloatArray) -> FloatArray:
    """Return poses of the end body in the base, (n, 4, 4), from what the tracker sees of the target."""
    poses = np.tile(np.eye(4), (len(position_m), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotation, position_m
    inner, outer = (frame.inverse().homogeneous for frame in (frames.T_end_target, frames.T_tracker_base))
    return np.asarray(outer @ poses @ inner)


def seen_states(diagnosis: Conclusions) -> list[ModelledState]:
    """Return the drawing, the model given if it differs, and the amended model if there is one."""
    rows, before, after = diagnosis.rows, diagnosis.before, diagnosis.final.state
    given = ModelledState.of("model given", rows, rows.changes(before.parameters, before.values), before.frames)
    states = _drawing_and(given, rows)
    if diagnosis.changed:
        changes = rows.changes(after.parameters, after.values)
        states.append(ModelledState.of("amended model", rows, changes, after.frames))
    return states


def _drawing_and(given: ModelledState, rows: CampaignRows) -> list[ModelledState]:
    """Return the drawing and the given model, or the drawing alone where the model is the drawing."""
    if rows.model.is_drawing and not rows.model.effects:
        return [dataclasses.replace(given, name="drawing")]
    bare: dict[str, Any] = {"joint_placements": {}, "drive_offsets": {}, "effects": []}
    drawn = CampaignRows(rows.campaign, rows.model.model_copy(update=bare), rows.noise)
    return [_as_given("drawing", drawn), given]


def _as_given(name: str, rows: CampaignRows) -> ModelledState:
    """Return the state of a robot without changes, with frames fitted to all rows."""
    return ModelledState.of(name, rows, rows.unchanged(), rows.refined_frames(np.ones(len(rows), dtype=bool)))


def ladle_scene(diagnosis: Conclusions) -> Scene | None:
    """Return the rows with the largest, the median and the smallest gap to the model given, each with every state.

    None where no row has a measured position, and for robots that carry no ladle.
    """
    if diagnosis.model.robot is not None:
        return None
    states, campaign = seen_states(diagnosis), diagnosis.rows.campaign
    reference = states[-2 if diagnosis.changed else -1]
    gaps = np.linalg.norm(reference.gaps_m(_tool(diagnosis.model)), axis=1)
    order = _everywhere(states)
    order = order[np.argsort(gaps[order])]
    if not order.size:
        return None
    labels = dict[int, str]()
    for word, row in zip(("worst", "median", "best"), order[[-1, order.size // 2, 0]].tolist(), strict=True):
        labels.setdefault(row, f"{word}: {_sample(campaign, row)}")
    return _scene(diagnosis.rows, states, labels)


def campaign_scene(campaign: Campaign, model: RobotModel) -> Scene | None:
    """Return a scene of every measured row of a campaign against a model and the drawing; None without any.

    Raises:
        CampaignError: the data do not fit the robot.
        FrameFitError: too few rows have a pose and a position.
    """
    one_place = seen_from_one_place(campaign, model)
    if not one_place.usable.any():
        return None
    usable = one_place.subset(np.flatnonzero(one_place.usable))
    rows = CampaignRows(usable, model, noise_beforehand(usable, np.arange(len(usable))))
    states = _drawing_and(_as_given("model given", rows), rows)
    labels = {row: _sample(usable, row) for row in _everywhere(states).tolist()}
    return _scene(rows, states, labels, axis="row") if labels else None


def _everywhere(states: Sequence[ModelledState]) -> Indices:
    """Return the rows in which every state has a measured and a modelled pose."""
    both = np.array([state.model + state.measured for state in states])
    return np.flatnonzero(np.isfinite(both).all(axis=(0, 2, 3)))


def _tool(model: RobotModel) -> FloatArray:
    return np.asarray(model.definition.mechanism().T_end_tool.homogeneous)


def _sample(campaign: Campaign, row: int) -> str:
    return f"sample {campaign.samples[row]}" if campaign.samples[row] else f"line {campaign.lines[row]}"


def _scene(
    against: CampaignRows, states: Sequence[ModelledState], labels: dict[int, str], axis: str = ""
) -> Scene | None:
    """Return a scene of some rows, by their labels; None where no geometry is attached to the end body."""
    campaign, model = against.campaign, against.model
    robot = robot_of(model)
    mechanism, loops = robot.nominal_solver.mechanism, robot.nominal_solver.mechanism.loops
    configurations = [robot.drawing.configuration_at(campaign.drives[row]) for row in labels]
    places = bodies_at(mechanism.shared_model, configurations)
    drawn = drawn_robot(mechanism, places, "robot", "as drawn", opacity=0.25, tint=GHOST_TINT)
    world = frame_places(mechanism, places[:1], loops.base_frame)[0]  # rails stand at home
    ladle, rest = _taken_apart(drawn.visual, mechanism, str(loops.end_frame))
    if not ladle.ngeoms:
        return None
    rows, tool = np.array(list(labels)), _tool(model)
    shown = states[-1].measured  # where it was measured is best known through the frames of the best robot
    measured = world @ shown[rows]
    gaps = {state.name: state.gaps_m(tool) for state in states}
    sizes = {name: np.linalg.norm(gap, axis=1) for name, gap in gaps.items()}
    robots = [SceneRobot("measured", ladle, measured[:, None], tint=_MEASURED_TINT)]
    arrows = []
    everywhere = _everywhere(states)
    everywhere = everywhere[:: -(-everywhere.size // _MOST_ARROWS)]  # no more than a picture can show
    words = loops.working_frame.replace("_", " ")
    for state in states:
        moved = shown.copy()
        moved[:, :3, 3] += (state.model - state.measured)[:, :3, 3]
        moved[:, :3, :3] = state.model[:, :3, :3] @ np.swapaxes(state.measured[:, :3, :3], 1, 2) @ shown[:, :3, :3]
        said = f"median gap {np.nanmedian(sizes[state.name]) / MM:.2f} mm"
        robots.append(
            SceneRobot(
                state.name, ladle, (world @ moved[rows])[:, None], measured[:, None], opacity=0.6,
                tint=_STATE_TINTS[state.name], label=said, choice=True,
            )
        )  # fmt: skip
        tips, vectors = (world @ shown @ tool)[:, :3, 3], gaps[state.name] @ world[:3, :3].T
        arrows += [
            SceneArrows(f"gap to the {state.name}", tips[rows, None], vectors[rows, None], shown_with=state.name),
            SceneArrows(
                f"gaps to the {state.name}", tips[None, everywhere], vectors[None, everywhere], shown_with=state.name
            ),
        ]
    robots.append(dataclasses.replace(drawn, visual=rest))
    return Scene(
        title=f"{campaign.path.name}: what was measured, against {' and '.join(state.name for state in states)}",
        robots=tuple(robots),
        arrows=tuple(arrows),
        steps=tuple(Step(label, _caption(words, against, row, sizes)) for row, label in labels.items()),
        axis=axis,
        curves=tuple(
            Curve(f"{words}: gap to the {name}", "mm", size[rows] / MM, _STATE_TINTS[name])
            for name, size in sizes.items()
        )
        if axis
        else (),
        exaggeration=exaggeration_for(max(_NOISE * _noise_m(against), *(float(s[rows].max()) for s in sizes.values()))),
    )


def _noise_m(against: CampaignRows) -> float:
    """Return the noise of a coordinate, in m; 0 where it is not known."""
    noise = against.noise["position"]
    return noise.sigma if noise.source not in ("residuals", "none") else 0.0


def _taken_apart(
    visual: pin.GeometryModel, mechanism: ClosedChainMechanism, frame: str
) -> tuple[pin.GeometryModel, pin.GeometryModel]:
    """Return the geometry that moves with a frame, attached to it as a single body, and the rest without the truss."""
    end = mechanism.shared_model.frames[mechanism.frame_id(frame)]
    ladle, rest = pin.GeometryModel(), pin.GeometryModel()
    for part in visual.geometryObjects:
        if part.parentJoint == end.parentJoint:
            copy = part.copy()
            copy.parentJoint, copy.parentFrame = 0, 0
            copy.placement = end.placement.inverse() * part.placement
            ladle.addGeometryObject(copy)
        elif part.name.rpartition("_")[0] not in BACKGROUND_LINKS:
            rest.addGeometryObject(part)
    return ladle, rest


def _caption(
    words: str, against: CampaignRows, row: int, sizes_m: dict[str, FloatArray]
) -> tuple[tuple[str, str], ...]:
    """Return the gap of a row to every state, at the working frame."""
    campaign, noise = against.campaign, _noise_m(against)
    where = (f"{_sample(campaign, row)}", f"line {campaign.lines[row]} of the file")
    off = [(f"{words}: gap to the {name}", f"{size[row] / MM:.2f} mm") for name, size in sizes_m.items()]
    more = [("noise per coordinate", f"{noise / MM:.3g} mm")] if noise else []
    if not np.isfinite(against.measured.rotation[row]).all():
        more.append(("measured", "rotations are the model's: only positions were measured"))
    return (where, *off, *more)
