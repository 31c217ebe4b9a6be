"""Ladle locations in the viewer: nominal robot translucent, actual robot solid, error arrows.

Errors of a millimetre are invisible on a robot of metres. So every part of the actual robot is drawn with its
displacement from the nominal part enlarged: translation and rotation are each multiplied by a factor.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.poses import bodies_at
from pouring_robot.robot.location import Location
from pouring_robot.robot.visuals import visuals
from pouring_robot.viewer import GHOST_TINT, Colour, Curve, Scene, SceneArrows, SceneRobot, Step

# The largest error is drawn with about this length unless the user chooses a factor.
_DRAWN_ERROR_M = 0.15
_LARGEST_FACTOR = 1000.0
_MOST_ARROWS = 100


def exaggeration_for(largest_m: float) -> float:
    """Return a factor of the series 1, 2, 5, 10 … that makes a displacement in m visible."""
    if largest_m <= _DRAWN_ERROR_M / _LARGEST_FACTOR:
        return _LARGEST_FACTOR
    wanted = max(1.0, _DRAWN_ERROR_M / largest_m)
    decade = 10.0 ** math.floor(math.log10(wanted))
    return float(max(step * decade for step in (1, 2, 5) if step * decade <= wanted * (1 + 1e-9)))


def pose_scene(locations: Sequence[Location], exaggeration: float | None = None, actual: str = "as built") -> Scene:
    """Return the scene of locations: a step for each; the one with the largest error is shown first.

    Errors are enlarged by ``exaggeration``, by default chosen here; ``actual`` is the actual robot's name in the
    legend. Raises BadInputError where there is no location, or the factor is not a positive number.
    """
    if not locations:
        raise BadInputError("there is no pose to draw")
    errors = np.array([location.difference().distance_m for location in locations])
    factor = exaggeration_for(float(errors.max())) if exaggeration is None else exaggeration
    if not 0.0 < factor <= _LARGEST_FACTOR:
        raise BadInputError(f"the exaggeration factor must be above 0 and at most {_LARGEST_FACTOR:g}, not {factor}")
    worst = int(errors.argmax())
    words = locations[0].loops.working_frame.replace("_", " ")
    several = len(locations) > 1
    drawing, places = _bodies(locations)
    starts, vectors = _error_arrows(locations)
    arrows = [SceneArrows("error", starts[:, None], vectors[:, None], label=f"of the {words}")]
    if several:
        some = slice(None, None, -(-len(locations) // _MOST_ARROWS))
        words_of = f"at {'all ' if some.step == 1 else ''}{len(starts[some])} poses"
        arrows.append(SceneArrows("errors", starts[None, some], vectors[None, some], label=words_of))
    return Scene(
        title=f"Where the {words} really is: " + (f"{len(locations)} poses" if several else locations[0].title),
        robots=(
            drawn_robot(locations[0].actual.mechanism, places, "actual", actual, reference=drawing),
            drawn_robot(
                locations[0].nominal.mechanism, drawing, "nominal", "as commanded", opacity=0.35, tint=GHOST_TINT
            ),
        ),
        arrows=tuple(arrows),
        steps=tuple(
            Step(f"pose {n}: {one.title}" if several else "", _caption(one)) for n, one in enumerate(locations, start=1)
        ),
        axis="pose" if several else "",
        curves=(Curve(f"error of the {words}", "mm", errors / MM),) if several else (),
        first=worst,
        exaggeration=factor,
    )


def at_location(scene: Scene, location: Location) -> Scene:
    """Return the scene of one location, changed to another location; meshes, camera and factor are kept."""
    actual, nominal = scene.robots
    drawing, places = _bodies([location])
    starts, vectors = _error_arrows([location])
    return dataclasses.replace(
        scene,
        robots=(
            dataclasses.replace(actual, bodies=places, reference=drawing),
            dataclasses.replace(nominal, bodies=drawing),
        ),
        arrows=(dataclasses.replace(scene.arrows[0], starts_m=starts[:, None], vectors_m=vectors[:, None]),),
        steps=(Step("", _caption(location)),),
    )


def _bodies(locations: Sequence[Location]) -> tuple[FloatArray, FloatArray]:
    """Return the poses of the joints of the nominal and of the actual robots, (k, joints, 4, 4) each, in m."""
    drawing = bodies_at(locations[0].nominal.mechanism.shared_model, [one.nominal.configuration for one in locations])
    built = (one.actual for one in locations)
    return drawing, np.concatenate([bodies_at(one.mechanism.shared_model, [one.configuration]) for one in built])


def _error_arrows(locations: Sequence[Location]) -> tuple[FloatArray, FloatArray]:
    """Return the nominal positions of the working frames in the world, and their errors, shape (k, 3) each, in m."""
    starts, vectors = [], []
    for one in locations:
        starts.append(one.nominal.pose("universe", one.loops.working_frame).translation)
        base = one.nominal.pose("universe", one.loops.base_frame)
        vectors.append(base.rotation @ one.difference().translation_m)
    return np.array(starts), np.array(vectors)


def drawn_robot(
    mechanism: ClosedChainMechanism,
    bodies: FloatArray,
    name: str,
    label: str,
    opacity: float = 1.0,
    tint: Colour | None = None,
    reference: FloatArray | None = None,
) -> SceneRobot:
    """Return a mechanism with its joints at the poses ``bodies`` (k, joints, 4, 4), in m, ready for a scene.

    Without visuals, or where a mesh of them is not found, it is drawn as lines between its joints; the label says why.
    """
    visual, why, _ = visuals(mechanism)
    if why:
        label = f"{label}: lines between its joints, as {why}".removeprefix(": ")
    return SceneRobot(name, visual, bodies, reference, opacity=opacity, tint=tint, label=label)


def frame_places(mechanism: ClosedChainMechanism, bodies: FloatArray, name: str) -> FloatArray:
    """Return the poses of a frame in the world, (k, 4, 4), with joints at ``bodies``, (k, joints, 4, 4), in m."""
    frame = mechanism.shared_model.frames[mechanism.frame_id(name)]
    return np.asarray(bodies[:, frame.parentJoint] @ frame.placement.homogeneous)


def _caption(location: Location) -> tuple[tuple[str, str], ...]:
    translation, rotation = location.difference().to_mm_mrad()
    return (
        (
            f"error at the {location.loops.working_frame.replace('_', ' ')}, x y z",
            " ".join(f"{v:+z.2f}" for v in translation) + " mm",
        ),
        ("its rotation", " ".join(f"{v:+z.2f}" for v in rotation) + " mrad"),
        ("gap left at the joints", f"{location.actual.gap_m / MM:.4f} mm, {location.actual.gap_rad / MRAD:.3f} mrad"),
    )
