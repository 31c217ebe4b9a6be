"""A scene as one HTML page that needs no network, no server and no file beside it."""

import json
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from pouring_robot.io.files import write_whole
from pouring_robot.report.page import templates
from pouring_robot.viewer.packing import page_content, ramp
from pouring_robot.viewer.scene import Scene, legend


def write_html(scene: Scene, path: Path | str) -> Path:
    """Write a scene as a self-contained meshcat page, with a time bar where it has several steps; whole or not at all.

    The viewer's script takes 0.9 MB of it, the robot about 1 MB, and each hundred steps some 0.2 MB.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_whole(path, page(scene))


def page(scene: Scene, *, live: bool = False, bench: dict[str, Any] | None = None) -> str:
    """Return the page of a scene as HTML, with the sliders of a bench; ``live`` says that a program serves it.

    Its content policy lets it reach nothing but that program.
    """
    content = page_content(scene) | {"live": live, "bench": bench}
    return (
        templates("pouring_robot.viewer")
        .get_template("page.html.j2")
        .render(
            scene=scene,
            legend=legend(scene),
            ramp=ramp(scene.scale) if scene.scale else (),
            bench=bench,
            connect="'self'" if live else "'none'",
            content=json.dumps(content, allow_nan=False).replace("<", r"\u003c"),
            viewer=_viewer_script(),
        )
    )


def _viewer_script() -> str:
    """Return meshcat's viewer as JavaScript that may stand between script tags."""
    # Found without an import, which would take IPython along and open a socket.
    script = distribution("meshcat").locate_file("meshcat/viewer/dist/main.min.js")
    source = Path(str(script)).read_text(encoding="utf-8")
    return source.replace("</script", r"<\/script")
