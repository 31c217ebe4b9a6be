"""A scene as plain data: robots at one or more steps, arrows, texts, curves and a camera.

All values are true to scale. One number of the scene says how many times differences are enlarged; readers of a page
can change it.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray, finite, read_only

Colour = tuple[float, float, float]
"""Red, green and blue, each 0 to 1."""

GHOST_TINT: Colour = (0.36, 0.55, 0.80)
"""The grey-blue of a nominal robot that is drawn translucent over the actual one."""

SKY_TOP: Colour = (0.80, 0.86, 0.93)
SKY_BOTTOM: Colour = (0.97, 0.98, 0.99)
"""Background, from the upper to the lower edge."""

BACKGROUND_LINKS = ("world", "truss_bridge", "trolley")
"""The truss that carries the mechanism."""

STEEL: Colour = (0.55, 0.58, 0.62)
"""Colour in the legend of a robot in its own colours."""

ARROW_RED: Colour = (0.86, 0.10, 0.10)


@dataclass(frozen=True, eq=False)
class SceneRobot:
    """One robot, at every step of the scene or, if there is one entry only, in the same place throughout."""

    name: str  # its name in the legend; unique in the scene
    visual: pin.GeometryModel  # its visual geometry, from :func:`pouring_robot.viewer.visual_model`.
    # poses of the bodies that carry the visuals (their ``parentJoint``), shape (k, bodies, 4, 4), m
    bodies: FloatArray
    # poses of the same bodies without error, likewise; the scene enlarges the difference. None:
    # nothing is enlarged.
    reference: FloatArray | None = None
    colours: FloatArray | None = None  # of every visual, shape (k, visuals, 3), 0 to 1; None keeps ``tint``
    opacity: float = 1.0  # 1 is solid; below 1 the robot is drawn translucent
    tint: Colour | None = None  # colour of every part; None keeps the colours of the URDF
    label: str = ""  # a few words for the legend after the name
    choice: bool = False  # it is one of several states, of which a page shows one at a time, the first to begin with

    def __post_init__(self) -> None:
        _check_name(self.name)
        least = max((item.parentJoint for item in self.visual.geometryObjects), default=0) + 1
        for field in ("bodies", "reference"):
            if (places := getattr(self, field)) is not None:
                if places.ndim != 4 or places.shape[1] < least or places.shape[2:] != (4, 4):
                    wanted = f"(k, {least} or more, 4, 4)"
                    raise BadInputError(f"robot '{self.name}': {field} have the shape {places.shape}, not {wanted}")
                if not np.all(np.isfinite(places)):
                    raise BadInputError(f"robot '{self.name}': {field} hold a value that is not finite")
        if not 0.0 < self.opacity <= 1.0:
            raise BadInputError(f"robot '{self.name}': opacity {self.opacity:g} is not in (0, 1]")

    @property
    def links(self) -> tuple[str, ...]:
        """The link of every visual; Pinocchio calls a visual by its link and a number."""
        return tuple(item.name.rpartition("_")[0] for item in self.visual.geometryObjects)


@dataclass(frozen=True, eq=False)
class SceneArrows:
    """Arrows drawn in front of everything, at every step or the same throughout; one alone is labelled by length."""

    name: str  # unique in the scene
    starts_m: FloatArray  # tails in the world, shape (k, arrows, 3), m
    vectors_m: FloatArray  # true lengths and directions, likewise; they are drawn enlarged
    colour: Colour = ARROW_RED  # red, green, blue, 0 to 1
    label: str = ""  # a few words for the legend after the name
    shown_with: str = ""  # the state (a robot with ``choice``) that they belong to; "" for all

    def __post_init__(self) -> None:
        _check_name(self.name)
        for field in ("starts_m", "vectors_m"):
            demand = f"arrows '{self.name}': {field} must be finite numbers of the shape (k, arrows, 3)"
            finite(getattr(self, field), (None, None, 3), demand)


@dataclass(frozen=True)
class Step:
    """One moment, or one row, of a scene."""

    label: str = ""  # a few words; "" where there is one step only
    caption: tuple[tuple[str, str], ...] = ()  # rows of a small table, each (what, figure with its unit)


@dataclass(frozen=True, eq=False)
class Curve:
    """A figure over all steps."""

    name: str  # what it is
    unit: str  # of its values; curves of one unit have one scale
    values: FloatArray  # shape (k,)
    colour: Colour = ARROW_RED  # red, green, blue, 0 to 1


@dataclass(frozen=True)
class ColourScale:
    """Meaning of colours: matplotlib's map ``turbo`` from one value to another, with their unit."""

    name: str
    unit: str
    lower: float
    upper: float

    def colours(self, values: FloatArray) -> FloatArray:
        """Return the colours of values, shape (..., 3), 0 to 1."""
        from matplotlib import colormaps

        share = (values - self.lower) / max(self.upper - self.lower, 1e-12)
        return np.asarray(colormaps["turbo"](share), dtype=np.float64)[..., :3]


@dataclass(frozen=True)
class Camera:
    """A perspective camera; the world's z axis points up in the picture."""

    eye_m: FloatArray  # its place in the world, shape (3,), m
    target_m: FloatArray  # the point it looks at (and about which a live view turns), shape (3,), m
    vertical_view_deg: float = 30.0  # angle between the lower and the upper edge of the picture, degrees

    def __post_init__(self) -> None:
        for field in ("eye_m", "target_m"):
            point = finite(getattr(self, field), (3,), f"camera: {field} must be three finite numbers (m)")
            object.__setattr__(self, field, read_only(point))
        sideways = np.linalg.norm((self.target_m - self.eye_m)[:2])
        if sideways < 1e-9:
            raise BadInputError("camera: it looks straight up or down; move eye_m sideways of target_m")
        if not 1.0 <= self.vertical_view_deg <= 120.0:
            raise BadInputError(f"camera: vertical_view_deg {self.vertical_view_deg:g} is not in [1, 120]")

    def axes(self) -> FloatArray:
        """Return the camera's right, up and forward directions in the world as rows, shape (3, 3)."""
        forward = self.target_m - self.eye_m
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that a picture or page shows; both raise DescriptionError if a visual of a robot cannot be drawn."""

    title: str  # one line above the picture
    robots: tuple[SceneRobot, ...]  # the robots; names unique
    arrows: tuple[SceneArrows, ...] = ()  # error arrows
    steps: tuple[Step, ...] = (Step(),)  # shown one after the other; a picture shows the step ``first``
    at: FloatArray | None = None  # places of the steps on their axis, increasing, shape (k,); None numbers them from 1
    axis: str = ""  # name of that axis, with its unit; "" where steps have no order, and a page has a button for each
    curves: tuple[Curve, ...] = ()  # figures over the steps
    scale: ColourScale | None = None  # what colours mean
    first: int = 0  # the step that is shown first
    exaggeration: float = 1.0  # factor by which differences between the robots are enlarged
    camera: Camera | None = None  # None looks at the mechanism (:func:`pouring_robot.viewer.camera_on`).
    # links far larger than the mechanism. They are drawn pale, and the camera need not show them whole.
    background_links: tuple[str, ...] = BACKGROUND_LINKS

    def __post_init__(self) -> None:
        if not self.robots:
            raise BadInputError("the scene has no robot to draw")
        names = [*(robot.name for robot in self.robots), *(item.name for item in self.arrows)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise BadInputError(f"the scene uses the name '{twice[0]}' twice; rename one")
        if not (np.isfinite(self.exaggeration) and self.exaggeration > 0.0):
            raise BadInputError(f"exaggeration {self.exaggeration:g} must be a number above 0")
        over_steps = [
            *((r.name, field) for r in self.robots for field in (r.bodies, r.reference, r.colours)),
            *((a.name, field) for a in self.arrows for field in (a.starts_m, a.vectors_m)),
            *((curve.name, curve.values) for curve in self.curves),
            ("at", self.at),
        ]
        for name, values in over_steps:
            if values is not None and len(values) not in (1, len(self.steps)):
                raise BadInputError(f"'{name}' has {len(values)} entries, the scene {len(self.steps)} steps")
        if not 0 <= self.first < len(self.steps):
            raise BadInputError(f"the scene has no step {self.first}")


def at_step(values: FloatArray, step: int) -> FloatArray:
    """Return the entry of one step; there may be one for all."""
    return np.asarray(values[step if len(values) > 1 else 0])


def exaggeration_text(scene: Scene) -> str:
    """Return the text that tells a reader whether the picture is to scale."""
    if scene.exaggeration == 1.0:
        return "drawn to scale"
    return f"errors drawn {scene.exaggeration:g} × their size"


@dataclass(frozen=True)
class LegendEntry:
    """One line of the legend."""

    name: str  # the robot or the arrows it represents
    words: str  # its text
    colour: Colour  # colour of the sign before the text
    opacity: float  # opacity of that sign
    is_arrow: bool = False  # whether the sign is an arrow
    choice: bool = False  # it is one of several, of which one is shown at a time


def legend(scene: Scene) -> tuple[LegendEntry, ...]:
    """Return a line for each robot and for arrows of each kind; arrows that belong to a state have none."""
    robots = [LegendEntry(r.name, _words(r), r.tint or STEEL, r.opacity, choice=r.choice) for r in scene.robots]
    arrows = [LegendEntry(a.name, _words(a), a.colour, 1.0, is_arrow=True) for a in scene.arrows if not a.shown_with]
    return (*robots, *arrows)


def _words(item: SceneRobot | SceneArrows) -> str:
    return f"{item.name}: {item.label}" if item.label else item.name


def _check_name(name: str) -> None:
    """Names become paths in the scene tree, where a slash would make a folder."""
    if not name or "/" in name:
        raise BadInputError(f"'{name}' cannot name a part of a scene: it must not be empty or hold a '/'")
