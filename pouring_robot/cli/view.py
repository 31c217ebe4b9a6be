"""``pouring-robot view``: the scene of ``pose`` live in the browser, on this machine only."""

from __future__ import annotations

import contextlib
import signal
import webbrowser
from typing import Annotated

import typer

from pouring_robot.cli.shared import options

MIDDLE_MM = (-100.0, 0.0, -600.0)


def view(
    at_mm: options.AtMm = MIDDLE_MM,
    tilt_deg: options.TiltDeg = 0.0,
    model: options.ModelFile = None,
    layout: options.LayoutName = None,
    exaggerate: options.Exaggeration = None,
    port: Annotated[int, typer.Option(help="TCP port on the loopback address; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Show nominal and actual ladle live in the browser until Ctrl-C."""
    from pouring_robot.robot.pouring.ladle_mesh import stale_mesh_note
    from pouring_robot.robot.pouring.poses import PlatformPose
    from pouring_robot.robot.scene import pose_scene
    from pouring_robot.viewer import serve

    robot = options.robot_of(model, layout)
    scene = pose_scene([robot.locate(PlatformPose.from_mm_deg(*at_mm, tilt_deg))], exaggerate)
    console = options.console()
    note = stale_mesh_note(robot.layout)
    options.print_notes(console, [note] if note else [])
    # Programs started in the background inherit Ctrl-C as ignored; this one ends with it all the same.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with serve(scene, port) as live:
        console.print(f"the ladle is shown at {live.url} (this machine only); Ctrl-C ends it")
        if browser:
            webbrowser.open(live.url)
        with contextlib.suppress(KeyboardInterrupt):
            live.wait()
    console.print("closed; nothing is left running")
