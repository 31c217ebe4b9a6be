"""``pouring-robot thermal``: temperatures and displacements of the robot under the melt, at a pose or over a shift."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import opt, reads, writes, writes_csv
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.temperatures import ABSOLUTE_ZERO_DEGC

if TYPE_CHECKING:
    from pouring_robot.report.page import Block
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.pouring.platform_pose import PlatformPose
    from pouring_robot.robot.pouring_robot import PouringRobot
    from pouring_robot.thermal.expansion.displacement import MovedParts
    from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot
    from pouring_robot.thermal.report import PoseHeat, ShiftHeat

_MOST_ROWS, _DRAWN = 2000, 121


@dataclass(frozen=True)
class Moved:
    """The causes under which displacements of every part are computed."""

    under: Annotated[
        Literal["heat", "weight", "both"] | None,
        opt("Compute how far every part moves: truss, platforms, legs, ladle."),
    ] = None
    payload_kg: Annotated[float | None, opt("Mass of melt for --under (default: the layout's largest).", min=0.0)] = (
        None
    )
    ladle_degC: Annotated[
        float | None,
        opt(
            "Temperature of the ladle's steel for --under (default: computed).", "--ladle-degC", min=ABSOLUTE_ZERO_DEGC
        ),
    ] = None
    stiffness: Annotated[Path | None, reads("Stiffness file of the parts for --under (default: the shipped one).")] = (
        None
    )

    def check(self) -> None:
        """Refuse options that do not belong together, and impossible loads and temperatures."""
        import numpy as np

        from pouring_robot.io.quantity_columns import first_fault

        if self.under is None and self != Moved():
            raise BadInputError("--payload-kg, --ladle-degC and --stiffness belong to --under heat, weight or both")
        if self.under == "heat" and (self.payload_kg is not None or self.stiffness is not None):
            raise BadInputError("--payload-kg and --stiffness belong to --under weight or both: heat bends nothing")
        if self.under == "weight" and self.ladle_degC is not None:
            raise BadInputError("--ladle-degC belongs to --under heat or both: weight acts on the cold robot")
        faults = (
            ("payload-kg", self.payload_kg is not None and first_fault(np.array([self.payload_kg]), "mass")),
            ("ladle-degC", self.ladle_degC is not None and first_fault(np.array([self.ladle_degC]), "temperature")),
        )
        for option, fault in faults:
            if fault:
                raise BadInputError(f"--{option}: {fault[1]}")

    @property
    def words(self) -> str:
        """The causes, in words."""
        return "heat and weight" if self.under == "both" else str(self.under)

    def parts(self, heated: HeatedRobot, pose: PlatformPose) -> MovedParts:
        """Return the displacement of every part; under weight the nominal parts yield according to their stiffness."""
        from pouring_robot.robot.pouring.stiffness import load_stiffness
        from pouring_robot.robot.pouring_under_weight import stiffness_at, truss_sag_m, under_weight
        from pouring_robot.thermal.expansion.displacement import DisplacementField, MovedParts
        from pouring_robot.thermal.expansion.truss import TrussMotion
        from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot as Heated

        drawing, carried, sag = heated.robot, heated, (0.0, 0.0)
        if self.under != "heat":
            parts = load_stiffness(self.stiffness)
            melt = drawing.layout.ladle.payload.value if self.payload_kg is None else self.payload_kg
            loaded = under_weight(drawing, stiffness_at(drawing, pose, melt, parts), melt)
            carried = Heated(loaded, heated.heat, heated.network) if self.under == "both" else Heated(loaded)
            sag = truss_sag_m(drawing, melt, parts)
        state, motion = carried.locate(pose), TrussMotion.under_weight(drawing.layout, *sag)
        if warm := carried.truss(state):
            motion += TrussMotion.under_heat(drawing.layout, warm, heated.network.properties)
        return MovedParts(DisplacementField.of(state, self.ladle_degC), motion, warm)

    def blocks(self, moved: MovedParts) -> list[Block]:
        """Return the displacement of every part, ready to be printed."""
        from pouring_robot.report.page import Paragraph, Table
        from pouring_robot.thermal.expansion.displacement import MOVED_HEAD

        table = Table(MOVED_HEAD, moved.rows())
        return [Paragraph(f"moved under {self.words}: mm"), table, Paragraph(moved.truss_line)]

    def page(self, robot: PouringRobot, pose: PlatformPose, moved: MovedParts) -> str:
        """Return a page with parts coloured by their displacement."""
        from pouring_robot.thermal.scene import displacement_scene
        from pouring_robot.viewer.page import page

        words = f"How far every part moves under {self.words}"
        return page(displacement_scene(robot, moved.hall, words, robot.kinematics.configuration(pose)))


def thermal(
    *,
    at_mm: options.AtMm = None,
    tilt_deg: options.TiltDeg = None,
    history: Annotated[
        Path | None,
        reads(
            "A shift: columns time_min (or _s, _h), melt_degC, optionally ambient_degC, and, if the pose changes, "
            "x_mm y_mm z_mm tilt_deg in every row.",
            "FILE.csv",
        ),
    ] = None,
    every_min: Annotated[
        float | None, opt("Time step of the rows of a shift (default: the rows of its file).", metavar="MIN")
    ] = None,
    which: bundles.RobotOptions,
    melt: bundles.Melt,
    conduction_only: Annotated[
        bool, opt("Leave radiation out, as the paper's first analysis does.", "--conduction-only")
    ] = False,
    csv: Annotated[Path | None, writes_csv("Write every element, or every row of a shift.")] = None,
    png: options.PngFile = None,
    moved: Moved,
    html: Annotated[Path | None, writes("Write a 3-D page: the shift, to play, or parts coloured by --under.")] = None,
    report: options.ReportFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Compute how warm the melt makes legs and platforms, and how that alone moves the ladle.

    --at-mm gives a pose, held until steady (or for --after-min); --history gives a shift. Of a model file the heat
    section is used, geometric errors are not. Its measured temperatures are of one moment, and not used in a shift.
    """
    from pouring_robot.cli.shared.tables import print_blocks
    from pouring_robot.report.page import Paragraph
    from pouring_robot.report.plots import png_of
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.pouring.platform_pose import PlatformPose
    from pouring_robot.thermal import page
    from pouring_robot.thermal.report import PoseHeat, ShiftHeat, heated_drawing

    ladle = options.with_melt(which.built(warm=True))
    _check(at_mm, tilt_deg, history, every_min, melt, moved, html)
    heat = melt.of(ladle) or HeatSection()
    pose = None if at_mm is None else PlatformPose.from_mm_deg(*at_mm, tilt_deg or 0.0)
    heated = heated_drawing(ladle, heat, radiation=not conduction_only)
    kind = "conduction alone" if conduction_only else "conduction and radiation"
    found: PoseHeat | ShiftHeat
    drawn: PoseHeat | ShiftHeat
    if history is not None:
        found, drawn = _shift(heated, history, pose, every_min, picture=bool(png or html or report))
        title = f"{history.name}: {kind}, layout {ladle.model.layout}"
    else:
        found = drawn = PoseHeat.of(heated, pose or PlatformPose((0.0, 0.0, 0.0), 0.0))
        temperature, ambient = heated.temperatures_degC
        when = "steady" if heat.after_min is None else f"after {heat.after_min:g} min"
        title = f"melt {temperature:g}, surroundings {ambient:g} °C, {when}; {kind}; layout {ladle.model.layout}"
    field = None
    if moved.under is not None and pose is not None:
        with progress.stage_bars() as show:
            show("moving every part", 0, 0)
            field = moved.parts(heated, pose)
    notes = _on_measured(heat, of_shift=history is not None)
    blocks = [*page.blocks(found), *(moved.blocks(field) if field else ()), *(Paragraph(note) for note in notes)]
    files: dict[Path, bytes | str] = {}
    if png:
        files[png] = png_of(page.picture(drawn, title))
    if report:
        files[report] = page.html_report(found, drawn, title, blocks)
    if html is not None and field is not None and pose is not None:
        files[html] = moved.page(heated.robot, pose, field)
    elif html is not None and history is not None and isinstance(drawn, ShiftHeat):
        files[html] = _shift_page(heated.robot, drawn, history)
    written = [found.save(csv, overwrite=options.OVERWRITE.get())] if csv else []
    written += options.write_all(files)
    if as_json:
        figures: dict[str, Any] = found.figures()
        if history is None and heat.measured_degC:
            figures["measured_degC"] = heat.measured_degC
        if field is not None:
            figures["displacement"] = {"under": moved.under, **field.figures()}
        names = {"layout": ladle.model.layout, "radiation": not conduction_only, "notes": notes}
        return options.print_figures(figures | names, written)
    options.say(found.headline, style="bold")
    options.say(title)
    print_blocks(blocks)
    options.print_written(written)


def _shift_page(robot: PouringRobot, shift: ShiftHeat, file: Path) -> str:
    """Return a page that plays a shift, with parts coloured by temperature."""
    from pouring_robot.thermal.scene import shift_scene
    from pouring_robot.viewer.page import page

    return page(shift_scene(robot, shift, f"How the melt of {file.name} warms the robot"))


def _on_measured(heat: HeatSection, *, of_shift: bool) -> list[str]:
    """Return a line on how measured temperatures in the model file are used, if there are any."""
    if not heat.measured_degC:
        return []
    values = ", ".join(f"{part} {value:g} degC" for part, value in heat.measured_degC.items())
    count = "are of one moment and not used in a shift" if of_shift else "replace computed ones in the expansion"
    return [f"measured temperatures of the model file {count}: {values}"]


def _check(
    at_mm: options.AtMm,
    tilt_deg: options.TiltDeg,
    history: Path | None,
    every_min: float | None,
    melt: bundles.Melt,
    moved: Moved,
    html: Path | None,
) -> None:
    """Refuse inconsistent options for a held pose, a shift, and their pictures."""
    moved.check()
    if moved.under is None and history is None and html is not None:
        raise BadInputError("--html draws a shift or what --under asks for: give --history, or --under heat")
    if moved.under is not None and (at_mm is None or history is not None):
        raise BadInputError("--under is for a pose that is held: give --at-mm and --tilt-deg, and no --history")
    if history is not None and (melt.melt_degC is not None or melt.steady or melt.after_min is not None):
        raise BadInputError(
            "--history gives the melt's temperature and the time; leave out --melt-degC, --steady and --after-min"
        )
    if every_min is not None and history is None:
        raise BadInputError("--every-min gives the rows of a shift; give the shift by --history")
    if tilt_deg is not None and at_mm is None:
        raise BadInputError("--tilt-deg belongs to a pose; give its position by --at-mm")
    if history is None and at_mm is None:
        raise BadInputError("give the pose: --at-mm X Y Z and --tilt-deg T")


def _shift(
    heated: HeatedRobot,
    file: Path,
    pose: PlatformPose | None,
    every_min: float | None,
    *,
    picture: bool,
) -> tuple[ShiftHeat, ShiftHeat]:
    """Simulate a shift, and return it at the wanted times and, for a picture, at enough times to draw curves."""
    import numpy as np

    from pouring_robot.thermal.network.history import PoseSchedule, read_shift
    from pouring_robot.thermal.report import ShiftHeat

    past, schedule = read_shift(file, heated.temperatures_degC[1])
    if (schedule is None) == (pose is None):
        where = "gives no pose: add --at-mm X Y Z" if schedule is None else "gives the poses: leave --at-mm out"
        raise BadInputError(f"{file}: {where}")
    schedule = schedule or PoseSchedule.of(pose or (), past.start_s)
    for line, (_, held) in zip(schedule.lines, schedule.entries, strict=False):  # a pose of --at-mm is on no line
        with bundles.at_line(file, line):
            heated.robot.actual_of(cast("PlatformPose", held))
    times = past.times_s
    if every_min is not None:
        if not every_min > 0.0 or (past.end_s - past.start_s) / (60.0 * every_min) > _MOST_ROWS:
            raise BadInputError(
                f"--every-min {every_min:g}: give a time that makes 1 to {_MOST_ROWS} rows of the shift"
            )
        times = np.append(np.arange(past.start_s, past.end_s - 1e-6, 60.0 * every_min), past.end_s)
    shown = np.union1d(times, np.linspace(past.start_s, past.end_s, _DRAWN)) if picture else times
    drawn = ShiftHeat.of(heated.robot, heated.network, past, schedule, shown)
    return drawn.only(times), drawn
