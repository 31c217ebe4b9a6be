"""A scene as one HTML page that needs no network, no server and no file beside it."""

from __future__ import annotations

import base64
import json
from importlib.resources import files
from pathlib import Path

from pouring_robot.io.files import write_whole
from pouring_robot.report.page import templates
from pouring_robot.viewer.commands import ROOT, drawing_commands
from pouring_robot.viewer.scene import Scene, exaggeration_text, labelled_arrows, legend


def write_html(scene: Scene, path: Path | str) -> Path:
    """Write a scene as a self-contained meshcat page.

    The viewer's script takes 0.9 MB of it, surfaces and edges the rest: about 3 MB for both robots in all.

    Args:
        scene: what to show.
        path: the file; written whole or not at all.

    Returns:
        The path.

    Raises:
        OutputError: the file cannot be written.
        DescriptionError: a visual of a robot cannot be drawn.
    """
    return write_whole(path, page(scene))


def page(scene: Scene, *, live: bool = False) -> str:
    """Return the page of a scene as HTML.

    Args:
        scene: what to show.
        live: True leaves the drawing commands out and lets the page fetch them from where it came from
            (:func:`pouring_robot.viewer.serve`). The page may reach nothing else in either form: its content
            policy forbids it.

    Raises:
        DescriptionError: a visual of a robot cannot be drawn.
    """
    commands = () if live else drawing_commands(scene)
    packed = [base64.b64encode(command).decode("ascii") for command in commands]
    return _filled(
        "page.html.j2",
        scene,
        connect="'self'" if live else "'none'",
        commands=json.dumps(packed),
        viewer=_viewer_script(),
        root=ROOT,
        live="true" if live else "false",
    )


def overlay(scene: Scene) -> str:
    """Return the words of a page as an HTML fragment: title, legend with switches, table, scale, labels of arrows."""
    return _filled("overlay.html.j2", scene)


def _filled(template: str, scene: Scene, **more: str) -> str:
    words = {"legend": legend(scene), "scale": exaggeration_text(scene), "arrows": labelled_arrows(scene)}
    return templates("pouring_robot.viewer").get_template(template).render(scene=scene, **words, **more)


def _viewer_script() -> str:
    """Return meshcat's viewer as JavaScript that may stand between script tags."""
    source = files("meshcat").joinpath("viewer", "dist", "main.min.js").read_text(encoding="utf-8")
    return source.replace("</script", r"<\/script")
