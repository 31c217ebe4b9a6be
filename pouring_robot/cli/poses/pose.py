"""``pouring-robot pose``: where a robot is for one command."""

from pouring_robot.cli.shared import bundles, options


def pose(
    *,
    commanded: bundles.CommandOptions,
    which: bundles.RobotOptions,
    under: bundles.ConditionOptions,
    as_json: options.AsJson = False,
    drawing: bundles.Drawing,
    heat: bundles.Heat,
    thermal_model: options.ThermalModelFile = None,
) -> None:
    """Compute the nominal and actual pose of the ladle, or of another robot, cold or warm, and the internal loads.

    Text and JSON alike give positions and legs in mm, tilt and joint angles in degrees, and errors in mm and mrad.
    """
    from pouring_robot.cli.poses import heat as warm
    from pouring_robot.cli.shared import locations
    from pouring_robot.robot.location_figures import location_figures

    built = which.built(warm=True, under=True)
    command = commanded.of(built)
    (present,), conditions = under.robots(built, {0: command})
    given = heat.of(built)
    law = warm.thermal_law(thermal_model, present, given, cold=heat.cold)
    heated = warm.heated_of(present, law.heat if law else given)
    warmth = warm.Warmth.of(present, heated, command, shares=True)
    found, location = warmth.robot, warmth.location
    # Both may raise at a singular pose: do them before anything is written.
    dexterity, weakness = found.dexterity(location), found.axis_weakness(location)
    notes = locations.location_notes(built, drawing, which.model)
    notes += (*conditions, *warm.twice_lines(built, given))
    drawn, unlike_the_tree = drawing.files([location], built.model, warm=heated is not None)
    notes += unlike_the_tree
    written = options.write_all(drawn)
    if as_json:
        figures = location_figures(location, dexterity, weakness)
        figures |= {**found.model.named, "notes": notes, "written": [str(path) for path in written]}
        figures |= warmth.figures()
        if law and warmth.warm:
            full = warmth.warm[1].location
            figures |= {"thermal_model": law.words(full.commanded), "paper_sum_mm": law.sum_mm(present, full)}
        return options.print_json(figures)
    locations.print_location(location)
    warmth.print()
    if law and warmth.warm:
        law.print_sum(present, warmth.warm[1].location)
    locations.print_closure_note(location, dexterity, weakness, notes)
    options.print_written(written)
