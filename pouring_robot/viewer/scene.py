"""What is to be seen, as plain data: robots in a configuration, arrows, frames, words and a camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pouring_robot.exceptions import BadInputError

Vector = npt.NDArray[np.float64]
Colour = tuple[float, float, float]
"""Red, green and blue, each 0 to 1."""

GHOST_TINT: Colour = (0.36, 0.55, 0.80)
"""The grey-blue of a nominal robot that is drawn translucent over the actual one."""

SKY_TOP: Colour = (0.80, 0.86, 0.93)
SKY_BOTTOM: Colour = (0.97, 0.98, 0.99)
"""Background, from the upper to the lower edge."""

BACKGROUND_LINKS = ("world", "truss_bridge", "trolley")
"""The truss that carries the mechanism."""

_ARROWS_NAMED = 3
"""More arrows than this are not named one by one."""

STEEL: Colour = (0.55, 0.58, 0.62)
"""What the legend shows for a robot in its own colours."""

ARROW_RED: Colour = (0.86, 0.10, 0.10)


@dataclass(frozen=True)
class SceneRobot:
    """One robot in one configuration.

    Attributes:
        name: what the legend calls it; unique in the scene.
        model: Pinocchio model whose frames the visuals hang on.
        visual: its visual geometry, from :func:`pouring_robot.viewer.visual_model`.
        configuration: shape (model.nq,), m and rad, as Pinocchio orders it.
        opacity: 1 is solid; below 1 the robot is drawn translucent.
        tint: colour of every part; None keeps the colours of the URDF.
        label: a few words for the legend after the name.
    """

    name: str
    model: pin.Model
    visual: pin.GeometryModel
    configuration: Vector
    opacity: float = 1.0
    tint: Colour | None = None
    label: str = ""

    def __post_init__(self) -> None:
        """Refuse what cannot be drawn."""
        _check_name(self.name)
        configuration = np.array(self.configuration, dtype=np.float64)
        if configuration.shape != (self.model.nq,):
            raise BadInputError(
                f"robot '{self.name}': the configuration has shape {configuration.shape}, "
                f"its model needs ({self.model.nq},)"
            )
        if not np.all(np.isfinite(configuration)):
            raise BadInputError(f"robot '{self.name}': the configuration holds a value that is not finite")
        if not 0.0 < self.opacity <= 1.0:
            raise BadInputError(f"robot '{self.name}': opacity {self.opacity:g} is not in (0, 1]")
        configuration.setflags(write=False)
        object.__setattr__(self, "configuration", configuration)


@dataclass(frozen=True)
class SceneArrow:
    """A solid arrow, drawn in front of everything.

    Attributes:
        name: unique in the scene.
        start_m: tail in the world frame, shape (3,), m.
        end_m: tip in the world frame, shape (3,), m; already exaggerated when the scene is.
        colour: red, green, blue, 0 to 1.
        label: a few words, such as the true length; written beside the tip and in the legend.
    """

    name: str
    start_m: Vector
    end_m: Vector
    colour: Colour = ARROW_RED
    label: str = ""

    def __post_init__(self) -> None:
        """Refuse what cannot be drawn."""
        _check_name(self.name)
        for field in ("start_m", "end_m"):
            object.__setattr__(self, field, _point(getattr(self, field), f"arrow '{self.name}': {field}"))


@dataclass(frozen=True)
class SceneFrame:
    """A coordinate frame, drawn as three axes: x red, y green, z blue.

    Attributes:
        name: unique in the scene.
        pose_world_to_frame: where the frame stands in the world, m and rad.
        axis_length_m: length of each axis, m.
    """

    name: str
    pose_world_to_frame: pin.SE3
    axis_length_m: float = 0.1

    def __post_init__(self) -> None:
        """Refuse what cannot be drawn."""
        _check_name(self.name)


@dataclass(frozen=True)
class Camera:
    """A perspective camera; the world's z axis points up in the picture.

    Attributes:
        eye_m: where it stands in the world, shape (3,), m.
        target_m: what it looks at (and what a live view turns about), shape (3,), m.
        vertical_view_deg: angle between the lower and the upper edge of the picture, degrees.
    """

    eye_m: Vector
    target_m: Vector
    vertical_view_deg: float = 30.0

    def __post_init__(self) -> None:
        """Refuse a camera that looks nowhere."""
        for field in ("eye_m", "target_m"):
            object.__setattr__(self, field, _point(getattr(self, field), f"camera: {field}"))
        sideways = np.linalg.norm((self.target_m - self.eye_m)[:2])
        if sideways < 1e-9:
            raise BadInputError("camera: it looks straight up or down; move eye_m sideways of target_m")
        if not 1.0 <= self.vertical_view_deg <= 120.0:
            raise BadInputError(f"camera: vertical_view_deg {self.vertical_view_deg:g} is not in [1, 120]")

    def axes(self) -> Vector:
        """Return the camera's right, up and forward directions in the world as rows, shape (3, 3)."""
        forward = self.target_m - self.eye_m
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])


@dataclass(frozen=True)
class Scene:
    """Everything a picture shows.

    Attributes:
        title: one line above the picture.
        robots: the robots; names unique.
        arrows: error arrows.
        frames: coordinate frames.
        caption: rows of a small table, each (what, figure with its unit).
        exaggeration: how many times the differences between the robots are drawn larger than they are. The
            caller has already moved robots and arrows; this is what the picture says about it.
        camera: None looks at the mechanism (:func:`pouring_robot.viewer.camera_on`).
        background_links: links far larger than the mechanism. They are drawn pale, and the camera does not
            try to show them whole.
    """

    title: str
    robots: tuple[SceneRobot, ...]
    arrows: tuple[SceneArrow, ...] = ()
    frames: tuple[SceneFrame, ...] = ()
    caption: tuple[tuple[str, str], ...] = ()
    exaggeration: float = 1.0
    camera: Camera | None = None
    background_links: tuple[str, ...] = BACKGROUND_LINKS

    def __post_init__(self) -> None:
        """Refuse an empty scene, a name used twice and a meaningless factor."""
        if not self.robots:
            raise BadInputError("the scene has no robot to draw")
        items: tuple[SceneRobot | SceneArrow | SceneFrame, ...] = (*self.robots, *self.arrows, *self.frames)
        names = [item.name for item in items]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise BadInputError(f"the scene uses the name '{twice[0]}' twice; rename one")
        if not (np.isfinite(self.exaggeration) and self.exaggeration > 0.0):
            raise BadInputError(f"exaggeration {self.exaggeration:g} must be a number above 0")


def exaggeration_text(scene: Scene) -> str:
    """Return the sentence that tells a reader how far the picture is from true scale."""
    if scene.exaggeration == 1.0:
        return "drawn to scale"
    return f"errors drawn {scene.exaggeration:g} × larger than they are"


@dataclass(frozen=True)
class LegendEntry:
    """One line of the legend.

    Attributes:
        words: what it says.
        colour: colour of the sign before the words.
        opacity: opacity of that sign.
        is_arrow: whether the sign is an arrow.
        names: robots or arrows of the scene that the line stands for.
    """

    words: str
    colour: Colour
    opacity: float
    is_arrow: bool
    names: tuple[str, ...]


def legend(scene: Scene) -> tuple[LegendEntry, ...]:
    """Return a line for each robot and each arrow; more than a few arrows share one."""
    robots = tuple(
        LegendEntry(_words(robot), robot.tint or STEEL, robot.opacity, False, (robot.name,)) for robot in scene.robots
    )
    arrows = scene.arrows
    if len(arrows) > _ARROWS_NAMED:
        names = tuple(arrow.name for arrow in arrows)
        return (*robots, LegendEntry(f"errors at {len(arrows)} places", arrows[0].colour, 1.0, True, names))
    return robots + tuple(LegendEntry(_words(arrow), arrow.colour, 1.0, True, (arrow.name,)) for arrow in arrows)


def labelled_arrows(scene: Scene) -> tuple[SceneArrow, ...]:
    """Return the arrows with a label at their tip: all of a few, the longest of many."""
    if len(scene.arrows) <= _ARROWS_NAMED:
        return scene.arrows
    return (max(scene.arrows, key=lambda arrow: float(np.linalg.norm(arrow.end_m - arrow.start_m))),)


def _words(item: SceneRobot | SceneArrow) -> str:
    return f"{item.name}: {item.label}" if item.label else item.name


def _check_name(name: str) -> None:
    """Names become paths in the scene tree, where a slash would make a folder."""
    if not name or "/" in name:
        raise BadInputError(f"'{name}' cannot name a part of a scene: it must not be empty or hold a '/'")


def _point(value: npt.ArrayLike, what: str) -> Vector:
    """Return a read-only, finite point of shape (3,), m."""
    point = np.array(value, dtype=np.float64)
    if point.shape != (3,) or not np.all(np.isfinite(point)):
        raise BadInputError(f"{what} must be three finite numbers (m)")
    point.setflags(write=False)
    return point
