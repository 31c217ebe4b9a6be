"""``pouring-robot view``: moves a robot, or plays a path or a campaign, live in the browser, on this machine only."""

from __future__ import annotations

import contextlib
import signal
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import opt, reads
from pouring_robot.exceptions import BadInputError

if TYPE_CHECKING:
    from pouring_robot.robot.robot import Robot
    from pouring_robot.robot.view.bench import RobotBench
    from pouring_robot.viewer import Scene


def view(
    *,
    commanded: bundles.CommandOptions,
    which: bundles.RobotOptions,
    under: bundles.ConditionOptions,
    path: Annotated[Path | None, reads("Play the poses of a table.", "POSES.csv")] = None,
    campaign: Annotated[Path | None, reads("Step through the rows of a campaign.")] = None,
    exaggerate: options.Exaggeration = None,
    port: Annotated[int, opt("TCP port on the loopback address; 0 takes a free one.")] = 0,
    browser: Annotated[bool, opt("Open the page in the browser.")] = True,
) -> None:
    """Move the nominal and the actual robot in the browser with sliders, until Ctrl-C.

    Without a command the robot starts in the middle of its workspace, or at its home. Sliders move the pose or the
    drives, the melt's temperature and its time, and every geometric error. With --path or --campaign the page plays
    instead.
    """
    from pouring_robot.viewer import serve

    if sum((commanded.given, path is not None, campaign is not None)) > 1:
        raise BadInputError("give only one of a command, --path and --campaign")
    if campaign is not None and exaggerate is not None:
        raise BadInputError("--exaggerate is for a robot or a path; the page of a campaign has a slider for it")
    if path is None and under.condition:
        raise BadInputError("--condition belongs to --path: sliders show the robot without conditions")
    bench = None
    if campaign is not None:
        scene = _campaign_scene(campaign, which)
    else:
        present = which.built(under=path is not None)
        options.print_notes(present.picture_notes)
        if path is not None:
            scene = _path_scene(present, path, under, exaggerate)
        else:
            bench = _bench(present, commanded, exaggerate)
            scene = bench.scene
    # Programs started in the background ignore Ctrl-C by inheritance; this one ends with it nevertheless.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with serve(scene, port, bench) as live:
        options.say(f"the robot is shown at {live.url} (this machine only); Ctrl-C ends it")
        if browser:
            webbrowser.open(live.url)
        with contextlib.suppress(KeyboardInterrupt):
            live.wait()
    options.say("closed; nothing is left running")


def _bench(robot: Robot, commanded: bundles.CommandOptions, exaggerate: float | None) -> RobotBench:
    """Return the bench of a robot, with sliders for the melt where it carries one."""
    from pouring_robot.robot.location import LadleLocation
    from pouring_robot.robot.pouring_robot import PouringRobot
    from pouring_robot.robot.view.bench import RobotBench
    from pouring_robot.thermal.scene import PouringBench

    location = robot.location_of(commanded.of(robot)) if commanded.given else robot.location_in_the_middle()
    if isinstance(robot, PouringRobot) and isinstance(location, LadleLocation):
        return PouringBench(robot, location, exaggerate)
    return RobotBench(robot, location, exaggerate)


def _path_scene(robot: Robot, path: Path, under: bundles.ConditionOptions, exaggerate: float | None) -> Scene:
    from pouring_robot.robot.view.nominal_and_actual import pose_scene

    commands = under.read_commands(robot, path)
    robots, notes = under.robots(robot, commands, path)
    options.print_notes(notes)
    found = bundles.each(commands, robots, path, "closing", lambda command, standing: standing.location_of(command))
    return pose_scene(found, exaggerate)


def _campaign_scene(file: Path, which: bundles.RobotOptions) -> Scene:
    from pouring_robot.campaign.data import Campaign
    from pouring_robot.diagnosis.report.modelled_and_measured import campaign_scene

    model = which.read()
    with progress.stage_bars() as show:
        show("reading and closing every row", 0, 0)
        scene = campaign_scene(Campaign.read(file, model.definition), model)
    if scene is None:
        raise BadInputError(f"{file}: no row has a measured position, or the robot's end body has nothing to draw")
    return scene
