"""``pouring-robot diagnose``: which effect is missing in the model; ``pouring-robot effects``: what it may be."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console

from pouring_robot.cli.shared import options
from pouring_robot.cli.shared.tables import plain_table
from pouring_robot.exceptions import DiagnosisError
from pouring_robot.io.files import check_folder
from pouring_robot.robot.model import RobotModel

if TYPE_CHECKING:
    from pouring_robot.diagnosis.report.summary import Summary

OutFolder = Annotated[
    Path,
    typer.Option("--out", metavar="DIR", help="Folder for diagnosis.json, model.yaml, report.html and ladles.html."),
]
Exclude = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude",
        metavar="EFFECT",
        help="An effect that is not to be named (see `pouring-robot effects`); repeatable.",
    ),
]
HoldOutBy = Annotated[
    Literal["auto", "session", "time", "region"], typer.Option("--hold-out", help="What block takes no part.")
]


def diagnose(
    campaign: options.CampaignFile,
    out: OutFolder,
    model: options.ModelFile = None,
    exclude: Exclude = None,
    hold_out: HoldOutBy = "auto",
    as_json: options.AsJson = False,
) -> None:
    """Find where model and measurement disagree, name the missing effect, amend the model, show the gap shrink."""
    from threadpoolctl import threadpool_limits

    from pouring_robot.campaign.reader import read_campaign
    from pouring_robot.diagnosis.diagnose import DiagnosisOptions, exclude_ids
    from pouring_robot.diagnosis.diagnose import diagnose as run
    from pouring_robot.diagnosis.report.export import FIGURES, MODEL, write_diagnosis
    from pouring_robot.diagnosis.report.record import diagnosis_figures
    from pouring_robot.diagnosis.report.summary import Summary

    check_folder(out)
    present = RobotModel.load(model) if model else RobotModel()
    chosen = DiagnosisOptions(exclude=exclude_ids(exclude or ()), hold_out=hold_out)
    with options.status() as say:
        say("reading")
        data = read_campaign(campaign)
        try:
            found = run(data, present, chosen, say)
        except DiagnosisError as problem:
            raise DiagnosisError(f"{campaign}: {problem.problem}", problem.mend) from problem
        say("writing the report")
        with threadpool_limits(limits=1, user_api="blas"):  # as in diagnose
            summary = Summary.of(found)
            written = write_diagnosis(summary, out)
    if as_json:
        figures = diagnosis_figures(summary, str(out / MODEL))
        options.print_json(figures | {"written": [str(path) for path in written]})
        return
    console = options.console()
    _print(console, summary)
    for path in sorted(written, key=lambda path: path.name == FIGURES):
        console.print(f"wrote {path}", markup=False)


def effects(as_json: options.AsJson = False) -> None:
    """List the effects that a diagnosis can name: what happens, what the campaign must hold, parameters."""
    found = _library()
    if as_json:
        options.print_json({"effects": found})
        return
    console = options.console()
    for item in found:
        console.print(f"{item['effect']}: {item['story']}", style="bold", markup=False)
        _say(console, f"needs: {', '.join(item['needs']) or 'nothing but drives and measured poses'}")
        for form in item["forms"]:
            named = [f"{p['name']} [{p['unit']}]" for p in form["parameters"] if p["main"]]
            shape = sum(not p["main"] for p in form["parameters"])
            more = f", and {shape} that shape it" if shape else ""
            _say(console, f"form {form['form']}: {_shortened(named)}{more}")


def _library() -> list[dict[str, Any]]:
    """Return the library with forms and parameters, as they are for a campaign that holds every condition."""
    from pouring_robot.diagnosis.rows import channel_names, local_parameters
    from pouring_robot.effects.base import checked_forms
    from pouring_robot.effects.examples import complete_conditions
    from pouring_robot.effects.facts import sources
    from pouring_robot.effects.registry import all_effects

    conditions, channels = complete_conditions(), channel_names(local_parameters(RobotModel()))
    return [
        {
            "effect": effect.id,
            "story": effect.story,
            "needs": list(sources(effect.needs)),
            "forms": [
                {
                    "form": form.name,
                    "parameters": [{"name": p.name, "unit": p.unit, "main": p.main} for p in form.parameters],
                }
                for form in checked_forms(effect, conditions, channels)
            ],
        }
        for effect in all_effects().values()
    ]


def _shortened(names: list[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _print(console: Console, summary: Summary) -> None:
    from pouring_robot.diagnosis.report.sentences import gap_sentence, gap_table, headline, sections

    console.print(headline(summary), style="bold", markup=False)
    console.print(gap_sentence(summary), markup=False)
    console.print(plain_table(*gap_table(summary), left=(0, 1)))
    for heading, lines in sections(summary):
        console.print(f"{heading}:", style="bold", markup=False)
        for line in lines:
            _say(console, line.strip(), 2 + len(line) - len(line.lstrip()))


def _say(console: Console, line: str, by: int = 2) -> None:
    """Print a line indented, and as far as it wraps too."""
    space = " " * by
    folded = textwrap.fill(line, console.width, initial_indent=space, subsequent_indent=space, break_on_hyphens=False)
    console.print(folded, markup=False)
