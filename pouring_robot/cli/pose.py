"""``pouring-robot pose``: where a robot is for one command."""

from __future__ import annotations

from pouring_robot.cli.shared import heat_options, options


def pose(
    at_mm: options.AtMm = None,
    tilt_deg: options.TiltDeg = None,
    rotation_deg: options.RotationDeg = None,
    drives: options.Drives = None,
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
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
    thermal_model: heat_options.ThermalModelFile = None,
) -> None:
    """Say where the ladle, or another robot, should be, where it is, cold or warm, and what the joints are forced to.

    Text and JSON alike give positions and legs in mm, tilt and joint angles in degrees, and errors in mm and mrad.
    """
    from pouring_robot.cli.shared import locations
    from pouring_robot.robot.metrics import location_figures

    options.refuse_unwritable(html, png, joints)
    present = options.robot_of(model, robot, layout, warm=True)
    command = options.command_of(present, at_mm, tilt_deg, rotation_deg, drives)
    heat = heat_options.heat_of(present, melt_degC, ambient_degC, steady, after_min, cold)
    law = heat_options.thermal_law(thermal_model, present, heat)
    heated = heat_options.heated_of(present, law.heat if law else heat)
    warmth = heat_options.Warmth.of(present, heated, command, shares=True)
    found, location = warmth.robot, warmth.location
    # Both may find a singular pose: before anything is written.
    dexterity, weakness = found.dexterity(location), found.axis_weakness(location)
    notes = locations.location_notes(found, html, png, model_file=model is not None)
    written = locations.write_drawings([location], html, png, exaggerate, warm=heated is not None)
    written += locations.write_joints([location], present.model, joints)
    if as_json:
        figures = location_figures(location, dexterity, weakness)
        figures |= {**found.name, "notes": notes, "written": [str(path) for path in written]}
        options.print_json(figures | warmth.figures() | heat_options.sum_figures(law, present, command, location))
        return
    console = options.console()
    console.print(locations.drives_line(location))
    console.print(locations.location_table(location))
    warmth.print(console)
    heat_options.print_sum(console, law, present, command, location)
    locations.print_closure_note(console, location, dexterity, weakness, notes)
    options.print_written(console, written)
