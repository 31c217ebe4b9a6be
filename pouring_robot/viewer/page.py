"""A scene as one HTML page that needs no network, no server and no file beside it."""

from __future__ import annotations

import base64
import html
import json
from importlib.resources import files
from pathlib import Path
from string import Template

from pouring_robot.io.files import write_whole
from pouring_robot.viewer.commands import ROOT, drawing_commands
from pouring_robot.viewer.scene import Colour, Scene, Vector, exaggeration_text, labelled_arrows, legend


class _PageTemplate(Template):
    """Template whose placeholders cannot be taken for JavaScript or CSS."""

    delimiter = "%%"


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
    template = _PageTemplate(files("pouring_robot.viewer").joinpath("page.html").read_text(encoding="utf-8"))
    return template.substitute(
        connect="'self'" if live else "'none'",
        title=html.escape(scene.title),
        overlay=overlay(scene),
        commands=json.dumps(packed),
        viewer=_viewer_script(),
        root=ROOT,
        live="true" if live else "false",
    )


def overlay(scene: Scene) -> str:
    """Return the words of a page as an HTML fragment: title, legend with switches, table, scale, labels of arrows."""
    rows = "".join(
        f"<tr><th>{html.escape(what)}</th><td>{html.escape(figure)}</td></tr>" for what, figure in scene.caption
    )
    return (
        f"<h1>{html.escape(scene.title)}</h1><ul>{_legend(scene)}</ul>"
        + (f"<table>{rows}</table>" if rows else "")
        + f"<p>{html.escape(exaggeration_text(scene))}</p>{_labels(scene)}"
    )


def _labels(scene: Scene) -> str:
    """Return the words beside the tips of arrows; the page's script keeps them there."""
    return "".join(
        f'<span class="label" data-group="{html.escape(arrow.name)}"'
        f' data-tail="{_numbers(arrow.start_m)}" data-tip="{_numbers(arrow.end_m)}"'
        f' style="color: rgb({_css(arrow.colour)})">{html.escape(arrow.label)}</span>'
        for arrow in labelled_arrows(scene)
        if arrow.label
    )


def _legend(scene: Scene) -> str:
    """Return a line with a switch for every robot and every arrow."""
    return "".join(
        f'<li><label><input type="checkbox" checked data-groups="{html.escape("/".join(entry.names))}">'
        f'<span class="swatch{" arrow" if entry.is_arrow else ""}"'
        f' style="background: rgba({_css(entry.colour)}, {entry.opacity:g})"></span>'
        f"<span>{html.escape(entry.words)}</span></label></li>"
        for entry in legend(scene)
    )


def _numbers(point: Vector) -> str:
    return " ".join(repr(float(value)) for value in point)


def _css(colour: Colour) -> str:
    return ", ".join(str(round(255 * value)) for value in colour)


def _viewer_script() -> str:
    """Return meshcat's viewer as JavaScript that may stand between script tags."""
    source = files("meshcat").joinpath("viewer", "dist", "main.min.js").read_text(encoding="utf-8")
    return source.replace("</script", r"<\/script")
