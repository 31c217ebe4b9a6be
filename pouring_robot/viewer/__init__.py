"""One scene, three outputs: a page that stands alone, a picture made without a screen, a live view.

    scene = Scene("pose 3", robots=(actual, nominal), arrows=(error,), steps=(Step("", (("gap", "3.1 mm"),)),))
    write_html(scene, "view.html")
    write_png(scene, "view.png")
    with serve(scene) as view:
        view.wait()

A scene has one or more steps: a page plays them, a picture shows one.
"""

from pouring_robot.viewer.live import LiveView, serve
from pouring_robot.viewer.page import write_html
from pouring_robot.viewer.picture import draw, write_png
from pouring_robot.viewer.scene import (
    GHOST_TINT,
    Camera,
    Colour,
    ColourScale,
    Curve,
    Scene,
    SceneArrows,
    SceneRobot,
    Step,
    exaggeration_text,
)
from pouring_robot.viewer.solids import Solid, camera_on, enlarged, solids, visual_model

__all__ = [
    "GHOST_TINT",
    "Camera",
    "Colour",
    "ColourScale",
    "Curve",
    "LiveView",
    "Scene",
    "SceneArrows",
    "SceneRobot",
    "Solid",
    "Step",
    "camera_on",
    "draw",
    "enlarged",
    "exaggeration_text",
    "serve",
    "solids",
    "visual_model",
    "write_html",
    "write_png",
]
