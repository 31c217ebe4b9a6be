"""One scene, three outputs: a page that stands alone, a picture made without a screen, a live view.

    scene = Scene("pose 3", robots=(actual, nominal), arrows=(error,), steps=(Step("", (("gap", "3.1 mm"),)),))
    write_html(scene, "view.html")
    write_png(scene, "view.png")
    with serve(scene) as view:
        view.wait()

A scene has one or more steps: a page plays them, a picture shows one.
"""

from pouring_robot.viewer.live import LiveView as LiveView
from pouring_robot.viewer.live import serve as serve
from pouring_robot.viewer.page import write_html as write_html
from pouring_robot.viewer.picture import draw as draw
from pouring_robot.viewer.picture import write_png as write_png
from pouring_robot.viewer.scene import GHOST_TINT as GHOST_TINT
from pouring_robot.viewer.scene import Camera as Camera
from pouring_robot.viewer.scene import Colour as Colour
from pouring_robot.viewer.scene import ColourScale as ColourScale
from pouring_robot.viewer.scene import Curve as Curve
from pouring_robot.viewer.scene import Scene as Scene
from pouring_robot.viewer.scene import SceneArrows as SceneArrows
from pouring_robot.viewer.scene import SceneRobot as SceneRobot
from pouring_robot.viewer.scene import Step as Step
from pouring_robot.viewer.scene import exaggeration_text as exaggeration_text
from pouring_robot.viewer.shapes import visual_model as visual_model
from pouring_robot.viewer.solids import Solid as Solid
from pouring_robot.viewer.solids import camera_on as camera_on
from pouring_robot.viewer.solids import enlarged as enlarged
from pouring_robot.viewer.solids import solids as solids
