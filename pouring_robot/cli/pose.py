"""``pouring-robot pose``: where the ladle is for one commanded pose."""

from __future__ import annotations

from pouring_robot.cli.shared import heat_options, options


def pose(
    at_mm: options.AtMm,
    tilt_deg: options.TiltDeg = 0.0,
    model: options.ModelFile = None,
    layout: options.LayoutName = None,
    as_json: options.AsJson = False,
    html: options.HtmlFile = None,
    png: options.PngFile = None,
    exaggerate: options.Exaggeration = None,
    joints: options.JointsFile = None,
    melt_degC: heat_options.MeltDegC = None,
    ambient_degC: heat_options.AmbientDegC = None,
    steady: heat_options.Steady = False,
    after_min: heat_options.AfterMin = None,
    cold: heat_options.Cold = False,
) -> None:
    """Say where the ladle should be, where it is, cold or warm, and what the joints are forced to.

    Text and JSON alike give positions and legs in mm, tilt and joint angles in degrees, and errors in mm and mrad.
    """
    from pouring_robot.cli.shared import locations
    from pouring_robot.robot.metrics import location_figures
    from pouring_robot.robot.pouring.poses import PlatformPose

    options.refuse_unwritable(html, png, joints)
    robot = options.robot_of(model, layout, warm=True)
    heat = heat_options.heat_of(robot, melt_degC, ambient_degC, steady, after_min, cold)
    heated, wanted = heat_options.heated_of(robot, heat), PlatformPose.from_mm_deg(*at_mm, tilt_deg)
    warmth = heat_options.Warmth.of(robot, heated, wanted, shares=True)
    robot, location = warmth.robot, warmth.location
    # Both may find a singular pose: before anything is written.
    dexterity, weakness = robot.dexterity(location), robot.axis_weakness(location)
    notes = locations.location_notes(robot, html, png, model_file=model is not None)
    written = locations.write_drawings([location], html, png, exaggerate, warm=heated is not None)
    written += locations.write_joints([location], robot.model, joints)
    if as_json:
        figures = location_figures(location, dexterity, weakness)
        figures |= {"layout": robot.model.layout, "notes": notes, "written": [str(path) for path in written]}
        options.print_json(figures | warmth.figures())
        return
    console = options.console()
    console.print(locations.drives_line(location))
    console.print(locations.location_table(location))
    warmth.print(console)
    locations.print_closure_note(console, location, dexterity, weakness, notes)
    options.print_written(console, written)
