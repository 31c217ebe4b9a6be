"""``pouring-robot pose``: where the ladle is for one commanded pose."""

from __future__ import annotations

from pouring_robot.cli import options
from pouring_robot.cli.drawing import write_drawings
from pouring_robot.cli.tables import location_table, print_closure_note
from pouring_robot.poses import PlatformPose
from pouring_robot.report import location_figures


def pose(
    at_mm: options.AtMm,
    tilt_deg: options.TiltDeg = 0.0,
    model: options.ModelFile = None,
    layout: options.LayoutName = None,
    as_json: options.AsJson = False,
    html: options.HtmlFile = None,
    png: options.PngFile = None,
    exaggerate: options.Exaggeration = None,
) -> None:
    """Say where the ladle should be, where it is, and what the joints are forced to."""
    options.refuse_unwritable(html, png)
    robot = options.robot_of(model, layout)
    location = robot.locate(PlatformPose.from_mm_deg(*at_mm, tilt_deg))
    dexterity = robot.dexterity(location)  # may find a singular pose: before anything is written
    written = write_drawings([location], html, png, exaggerate)
    if as_json:
        figures = location_figures(location, dexterity)
        options.print_json(figures | {"layout": robot.model.layout, "written": [str(path) for path in written]})
        return
    console = options.console()
    drives = "  ".join(
        f"{name} {value * 1e3:.4f} mm" if location.actual.mechanism.unit_of(name) == "m" else f"{name} {value:.7f} rad"
        for name, value in location.drives.items()
    )
    console.print(f"drives: {drives}")
    console.print(location_table(location))
    print_closure_note(console, robot, location)
    for path in written:
        console.print(f"wrote {path}")
