"""Pages and pictures of ladle locations, for the commands that can draw."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.robot import LadleLocation, PouringRobot


def drawing_notes(robot: PouringRobot, html: Path | None, png: Path | None) -> list[str]:
    """Return what a user should know of the picture before trusting it, one line each; nothing without a drawing."""
    if not (html or png):
        return []
    from pouring_robot.robot.pouring.ladle_mesh import stale_mesh_note

    note = stale_mesh_note(robot.layout)
    return [note] if note else []


def write_drawings(
    locations: Sequence[LadleLocation],
    html: Path | None,
    png: Path | None,
    exaggerate: float | None,
    *,
    warm: bool = False,
) -> list[Path]:
    """Write the page and the picture that were asked for, and return what was written.

    Raises:
        BadInputError: the exaggeration factor is not positive, or given without a drawing.
        OutputError: a file cannot be written.
    """
    if not (html or png):
        if exaggerate is not None:
            raise BadInputError("--exaggerate enlarges the errors of a drawing; ask for one with --html or --png")
        return []
    # The drawing libraries take half a second to import; only commands that draw pay for it.
    from pouring_robot.robot.scene import pose_scene
    from pouring_robot.viewer import write_html, write_png

    scene = pose_scene(locations, exaggerate, "as built, warm" if warm else "as built")
    written = [write_html(scene, html)] if html else []
    return written + ([write_png(scene, png)] if png else [])
