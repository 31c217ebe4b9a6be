"""One scene, three outputs: a page that stands alone, a picture made without a screen, a live view.

    scene = Scene("pose 3", robots=(nominal, actual), arrows=(error,), caption=(("gap", "3.1 mm"),))
    write_html(scene, "view.html")
    write_png(scene, "view.png")
    with serve(scene) as view:
        view.wait()

Every output draws the same list of solids (:func:`solids`), so they cannot disagree.
"""

from __future__ import annotations

from pouring_robot.viewer.live import LiveView, serve
from pouring_robot.viewer.page import write_html
from pouring_robot.viewer.picture import draw, write_png
from pouring_robot.viewer.scene import GHOST_TINT, Camera, Scene, SceneArrow, SceneFrame, SceneRobot, exaggeration_text
from pouring_robot.viewer.shapes import visual_model
from pouring_robot.viewer.solids import Solid, camera_on, solids

__all__ = [
    "GHOST_TINT",
    "Camera",
    "LiveView",
    "Scene",
    "SceneArrow",
    "SceneFrame",
    "SceneRobot",
    "Solid",
    "camera_on",
    "draw",
    "exaggeration_text",
    "serve",
    "solids",
    "visual_model",
    "write_html",
    "write_png",
]
