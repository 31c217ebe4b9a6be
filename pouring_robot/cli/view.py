"""``pouring-robot view``: the scene of ``pose`` live in the browser, on this machine only."""

from __future__ import annotations

import contextlib
import signal
import webbrowser
from typing import Annotated

import typer

from pouring_robot.cli.shared import options


def view(
    at_mm: options.AtMm = None,
    tilt_deg: options.TiltDeg = None,
    rotation_deg: options.RotationDeg = None,
    drives: options.Drives = None,
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
    layout: options.LayoutName = None,
    exaggerate: options.Exaggeration = None,
    port: Annotated[int, typer.Option(help="TCP port on the loopback address; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Show the nominal and the actual robot live in the browser until Ctrl-C.

    Without a command it stands in the middle of its workspace, or at its home.
    """
    from pouring_robot.robot.scene import pose_scene
    from pouring_robot.viewer import serve

    present = options.robot_of(model, robot, layout)
    if at_mm is None and drives is None:
        location = present.location_in_the_middle()
    else:
        location = present.location_of(options.command_of(present, at_mm, tilt_deg, rotation_deg, drives))
    scene = pose_scene([location], exaggerate)
    console = options.console()
    options.print_notes(console, present.picture_notes)
    # Programs started in the background inherit Ctrl-C as ignored; this one ends with it all the same.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with serve(scene, port) as live:
        console.print(f"the robot is shown at {live.url} (this machine only); Ctrl-C ends it")
        if browser:
            webbrowser.open(live.url)
        with contextlib.suppress(KeyboardInterrupt):
            live.wait()
    console.print("closed; nothing is left running")
