"""What the viewer shows of ladle locations: nominal robot translucent, actual robot solid, error arrows.

Errors of a millimetre are invisible on a robot of metres, so the actual robot is drawn with its displacement
enlarged: the platform exactly (position and rotation each times the factor), the legs by their joint values.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.poses import MM, MRAD, PoseDifference
from pouring_robot.robot.description.urdf import with_mesh_files
from pouring_robot.robot.location import Location
from pouring_robot.robot.metrics import decimals
from pouring_robot.viewer import GHOST_TINT, Scene, SceneArrow, SceneRobot, camera_on, visual_model

# The largest error is drawn about this long unless the user says otherwise.
_DRAWN_ERROR_M = 0.15
_LARGEST_FACTOR = 1000.0
# Towards the camera: far enough to the front that the mechanism's weak direction, sideways, shows its full length.
VIEW_DIRECTION = (1.0, -0.7, 0.38)


def automatic_exaggeration(locations: Sequence[Location]) -> float:
    """Return a factor of the series 1, 2, 5, 10 … that makes the largest error visible."""
    return exaggeration_for(max(location.difference().distance_m for location in locations))


def exaggeration_for(largest_m: float) -> float:
    """Return a factor of the series 1, 2, 5, 10 … that makes a displacement in m visible."""
    if largest_m <= _DRAWN_ERROR_M / _LARGEST_FACTOR:
        return _LARGEST_FACTOR
    wanted = max(1.0, _DRAWN_ERROR_M / largest_m)
    decade = 10.0 ** math.floor(math.log10(wanted))
    return float(max(step * decade for step in (1, 2, 5) if step * decade <= wanted * (1 + 1e-9)))


def pose_scene(locations: Sequence[Location], exaggeration: float | None = None, actual: str = "as built") -> Scene:
    """Return the scene of one or more locations: robots at the one with the largest error, an arrow at each.

    Args:
        locations: at least one.
        exaggeration: how many times the errors are enlarged; None chooses.
        actual: what the legend calls the actual robot.

    Raises:
        BadInputError: there is no location, or the factor is not a positive number.
    """
    if not locations:
        raise BadInputError("there is no pose to draw")
    factor = automatic_exaggeration(locations) if exaggeration is None else exaggeration
    if not 0.0 < factor <= _LARGEST_FACTOR:
        raise BadInputError(f"the exaggeration factor must be above 0 and at most {_LARGEST_FACTOR:g}, not {factor}")
    worst = max(locations, key=lambda location: location.difference().distance_m)
    tip = worst.loops.working_frame.replace("_", " ")
    scene = Scene(
        title=f"Where the {tip} really is: {worst.title}",
        robots=(
            drawn_robot(
                worst.actual.mechanism,
                exaggerated_configuration(worst, factor),
                "actual",
                actual,
                model=_enlarged_model(worst, factor),
            ),
            drawn_robot(
                worst.nominal.mechanism,
                worst.nominal.configuration,
                "nominal",
                "as commanded",
                opacity=0.35,
                tint=GHOST_TINT,
            ),
        ),
        arrows=tuple(
            _arrow("error" if len(locations) == 1 else f"error {i}", location, factor)
            for i, location in enumerate(locations, start=1)
        ),
        caption=_caption(worst, len(locations)),
        exaggeration=factor,
    )
    return dataclasses.replace(scene, camera=camera_on(scene, VIEW_DIRECTION))


def drawn_robot(
    mechanism: ClosedChainMechanism,
    configuration: FloatArray,
    name: str,
    label: str,
    opacity: float = 1.0,
    tint: tuple[float, float, float] | None = None,
    model: pin.Model | None = None,
) -> SceneRobot:
    """Return a mechanism in a configuration (nq,), ready for a scene; its joints may be placed by another model."""
    model = model or mechanism.shared_model
    visual = visual_model(model, with_mesh_files(mechanism.tree_urdf))
    return SceneRobot(name, model, visual, configuration, opacity=opacity, tint=tint, label=label)


def _enlarged_model(location: Location, factor: float) -> pin.Model:
    """Return the actual robot, its joints' displacements enlarged where the tree itself carries the end body.

    Where loops do, the end body is put where it belongs by its cut joints.
    """
    drawn, model = location.nominal.mechanism.shared_model, location.actual.mechanism.copy_model()
    if not location.loops.cut_joints:
        for joint in range(1, model.njoints):
            placement = drawn.jointPlacements[joint]
            error = pin.log6(placement.actInv(model.jointPlacements[joint]))
            model.jointPlacements[joint] = placement * pin.exp6(factor * error)
    return model


def enlarged_pose(nominal: pin.SE3, difference: PoseDifference, factor: float) -> pin.SE3:
    """Return the nominal pose displaced by ``factor`` times the difference."""
    rotation = pin.exp3(factor * difference.rotation_rad) @ nominal.rotation
    return pin.SE3(rotation, nominal.translation + factor * difference.translation_m)


def exaggerated_configuration(location: Location, factor: float) -> FloatArray:
    """Return a configuration of the actual robot with its displacement enlarged; shape (nq,).

    The platform stands exactly where the enlarged difference puts it; the legs' joints are extrapolated.
    """
    mechanism = location.actual.mechanism
    model = mechanism.shared_model
    configuration = pin.interpolate(model, location.nominal.configuration, location.actual.configuration, factor)
    base, end = location.loops.base_frame, str(location.loops.end_frame)
    nominal, _ = location.poses(end)
    target = enlarged_pose(nominal, location.difference(end), factor)
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration)
    pose_world_to_platform = data.oMf[mechanism.frame_id(base)] * target
    for cut in mechanism.loops.cut_joints:
        joint = mechanism.joint_id(cut)
        current = data.oMi[joint]
        platform = data.oMf[mechanism.frame_id(end)]
        # The joint's own motion so that the platform, rigid on it, arrives at its target.
        moved = current * pin.XYZQUATToSE3(configuration[_stored(model, joint)]).inverse()
        wanted = moved.actInv(pose_world_to_platform * platform.actInv(current))
        configuration[_stored(model, joint)] = pin.SE3ToXYZQUAT(wanted)
    return np.asarray(configuration)


def _stored(model: pin.Model, joint: int) -> slice:
    return slice(model.idx_qs[joint], model.idx_qs[joint] + model.nqs[joint])


def _arrow(name: str, location: Location, factor: float) -> SceneArrow:
    end_frame = str(location.loops.end_frame)
    nominal_base = location.nominal.pose("universe", location.loops.base_frame)
    nominal, _ = location.poses(location.loops.working_frame)
    platform, _ = location.poses(end_frame)
    drawn_platform = enlarged_pose(platform, location.difference(end_frame), factor)
    end = drawn_platform * platform.actInv(nominal)
    difference = location.difference()
    return SceneArrow(
        name,
        nominal_base.act(nominal.translation),
        nominal_base.act(end.translation),
        label=f"{difference.distance_m / MM:.2f} mm",
    )


def _caption(location: Location, count: int) -> tuple[tuple[str, str], ...]:
    translation, rotation = location.difference().to_mm_mrad()
    rows = [
        (
            f"error at the {location.loops.working_frame.replace('_', ' ')}, x y z",
            " ".join(decimals(v, 2, sign=True) for v in translation) + " mm",
        ),
        ("its rotation", " ".join(decimals(v, 2, sign=True) for v in rotation) + " mrad"),
        (
            "left open at the joints",
            f"{location.actual.gap_m / MM:.4f} mm, {location.actual.gap_rad / MRAD:.3f} mrad",
        ),
    ]
    if count > 1:
        rows.append(("shown", f"the largest of {count} poses; an arrow at each"))
    return tuple(rows)
