"""``pouring-robot export``: the robot as built for other programs, closed."""

from pathlib import Path
from typing import Annotated, Literal

from pouring_robot.cli.shared import bundles, options
from pouring_robot.cli.shared.options import opt, results_folder
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.units import MM, MRAD


def export(
    *,
    out: Annotated[Path, results_folder(what="the description and its meshes")],
    form: Annotated[
        Literal["urdf", "mjcf", "sdf", "drake"],
        opt("sdf: loops as joints, for Gazebo classic; drake: SDF with loops as bushings.", "--format"),
    ] = "urdf",
    commanded: bundles.CommandOptions,
    zero_here: Annotated[bool, opt("URDF: set the zeros of all joints at this pose.", "--zero-here")] = False,
    absolute_meshes: Annotated[bool, opt("URDF: give meshes by absolute paths.", "--absolute-meshes")] = False,
    which: bundles.RobotOptions,
) -> None:
    """Write the robot as built, closed at a pose: description, meshes, joint values, loop closures.

    Default pose: the middle of the workspace, or the home of the robot file.
    """
    for name, wanted in (("--zero-here", zero_here), ("--absolute-meshes", absolute_meshes)):
        if wanted and form != "urdf":
            raise BadInputError(f"{name} is for --format urdf: {form} is written closed and names its own meshes")
    from pouring_robot.mechanism.arrays import rms
    from pouring_robot.robot.export.folder import exported_files
    from pouring_robot.robot.export.sdf import mimic_notes
    from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot, ball_notes
    from pouring_robot.robot.pouring.layout import stale_mesh_note

    present = which.built()
    built = present.model
    closed = ClosedRobot.of(built, commanded.of(present) if commanded.given else None)
    files = exported_files(closed, out, form, zero_here=zero_here, absolute_meshes=absolute_meshes)
    options.refuse_targets([file for file in files if file.exists()])
    options.print_written(reversed(options.write_all(files)))
    result, off_m = closed.result, closed.over_workspace() if form == "urdf" else None
    options.say(f"closed: gaps of {result.gap_m / MM:.2g} mm and {result.gap_rad / MRAD:.2g} mrad at most")
    if off_m is not None:
        loops = closed.mechanism.loops
        options.say(
            f"the tree carries '{loops.end_frame}' on one chain: '{loops.working_frame}' is exact here; with the joint "
            f"values of {off_m.size} poses of the workspace it is off by {rms(off_m) / MM:.2g} mm rms and "
            f"{off_m.max() / MM:.2g} mm at most"
        )
    note = None if built.robot else stale_mesh_note(built.layout, built.layouts_path)
    followers = closed.mechanism.mimics if form in ("sdf", "drake") else ()
    counts = "joints count from this pose, so no table of joint values and no file of loop closures is written"
    balls = ball_notes(closed.balls, zero_here) if form == "urdf" else []
    options.print_notes([*balls, *([counts] if zero_here else []), *([note] if note else []), *mimic_notes(followers)])
