"""``pouring-robot diagnose``: which effect is missing in the model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import opt, results_folder
from pouring_robot.cli.shared.tables import print_lines, print_table
from pouring_robot.exceptions import DiagnosisError

if TYPE_CHECKING:
    from pouring_robot.diagnosis.diagnose import Diagnosis


def diagnose(
    campaign: options.CampaignFile,
    out: Annotated[Path, results_folder("diagnosis.json", "model.yaml", "report.html", "ladles.html", "next.csv")],
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
    exclude: Annotated[
        list[str] | None,
        opt("An effect to leave out (see `pouring-robot effects`); repeatable.", metavar="EFFECT"),
    ] = None,
    hold_out: options.HoldOutBy = "auto",
    false_names: Annotated[
        float,
        opt("Accepted rate of false names where nothing is missing; it sets the thresholds.", metavar="RATE"),
    ] = 0.01,
    made_within_mm: Annotated[
        float | None,
        opt(
            "Known standard deviation of the joints' places in mm, and of their axes in mrad (default: estimated).",
            "--made-within",
            metavar="MM",
        ),
    ] = None,
    next_count: Annotated[
        int, opt("Number of measurements to suggest, as the plan next.csv.", "--next", metavar="N", min=1, max=75)
    ] = 10,
    as_json: options.AsJson = False,
) -> None:
    """Find where model and measurement disagree, name the missing effect, amend the model, show the gap shrink."""
    from pouring_robot.campaign.data import Campaign
    from pouring_robot.diagnosis.diagnose import DiagnosisOptions
    from pouring_robot.diagnosis.diagnose import diagnose as run
    from pouring_robot.diagnosis.report.export import METRICS, MODEL, diagnosis_metrics

    present = bundles.RobotOptions(model, robot).read()
    chosen = DiagnosisOptions(
        exclude=tuple(dict.fromkeys(exclude or ())),
        hold_out=hold_out,
        false_names=false_names,
        next_count=next_count,
        made_within_mm=made_within_mm,
    )
    with progress.stage_bars() as show:
        show("reading", 0, 0)
        data = Campaign.read(campaign, present.definition)
        try:
            found = run(data, present, chosen, show)
        except DiagnosisError as problem:
            raise DiagnosisError(f"{campaign}: {problem.problem}", problem.mend) from problem
        show("writing the report", 0, 0)
        written = found.save(out, overwrite=options.OVERWRITE.get())
    if as_json:
        return options.print_figures(diagnosis_metrics(found, str(out / MODEL)), written)
    _print(found)
    options.print_written(sorted(written, key=lambda path: path.name == METRICS))


def _print(diagnosis: Diagnosis) -> None:
    from pouring_robot.diagnosis.report.sentences import gap_sentence, gap_table, headline, sections, worse_sentence

    options.say(headline(diagnosis), style="bold")
    options.say(gap_sentence(diagnosis))
    if warning := worse_sentence(diagnosis):
        options.say(warning, style="bold")
    print_table(*gap_table(diagnosis), left=(0, 1))
    for heading, lines in sections(diagnosis):
        options.say(f"{heading}:", style="bold")
        print_lines(lines)
