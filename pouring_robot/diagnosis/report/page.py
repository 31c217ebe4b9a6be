"""The report of a diagnosis as one self-contained HTML page."""

from collections.abc import Iterable, Mapping

from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.named_effects import NamedEffect
from pouring_robot.diagnosis.report.sentences import (
    form_text,
    gap_sentence,
    gap_table,
    headline,
    plain,
    sections,
    worse_sentence,
)
from pouring_robot.diagnosis.suggest.next_measurements import SuggestedMeasurement
from pouring_robot.estimation.intervals import value_and_half_width
from pouring_robot.io.units import MM
from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Table, html_page

_ADDED = (
    "Each adds its nats to those of lower numbers. The device is assumed to be set up again, so the first may add "
    "nothing. If you make only some, take the lowest numbers. Samples are named as in next.csv."
)
_ALL = (
    "Root mean squares of the values measured in these rows: 'all mm' over all lengths (coordinates, distances, "
    "closures), 'all mrad' over all rotation components."
)
_PARAMETER_HEAD = ("parameter", "value", "± 95 %", "unit", "")
_MOST_OPEN = 14


def html_report(
    diagnosis: Conclusions, pictures: Iterable[tuple[str, str]], links: Mapping[str, str] | None = None
) -> str:
    """Return the report with its pictures as one page, with links to the other files by what they are."""
    first, *others = [Plot(title, svg) for title, svg in pictures]
    blocks: list[Block] = [
        Paragraph(headline(diagnosis), "headline"),
        Paragraph(gap_sentence(diagnosis), "lead"),
        *([Paragraph(said, "lead")] if (said := worse_sentence(diagnosis)) else []),
        Paragraph(_rows_used(diagnosis)),
        Heading("Gap before and after"),
        Paragraph(_ALL),
        Table(*gap_table(diagnosis)),
        first,
    ]
    for heading, lines in sections(diagnosis, short=False):
        blocks += [Heading(heading[0].upper() + heading[1:]), Lines(lines)]
    effects = (*diagnosis.firm, *diagnosis.nearest)
    blocks += [Heading("Parameters")] if effects else []
    if effects and diagnosis.verdict != "unknown":
        rate = diagnosis.diagnoser.asked.false_names
        bound = f"No probability exceeds 1 - {rate:g}, by the accepted rate of false names (--false-names)"
        blocks.append(Paragraph(f"{bound}: the cause may be something that is not in the library."))
    for effect in effects:
        blocks += _effect(diagnosis, effect)
    blocks += [Heading("Pictures"), *others]
    suggested = diagnosis.suggestion.best_first
    if suggested:
        blocks += [Heading("Most informative measurements"), Paragraph(_ADDED), _measurements(diagnosis, suggested)]
    blocks += [Heading("Findings of the data checks"), Lines([str(f) for f in diagnosis.flags] or ["nothing"])]
    title = f"Diagnosis of {diagnosis.campaign.path.name}"
    return html_page(title, blocks, links=links, data=[diagnosis.campaign.path])


def _rows_used(diagnosis: Conclusions) -> str:
    """Return which rows were used for what, and their noise."""
    noise, sigma = diagnosis.noise, diagnosis.noise.length_m / MM
    held, played = "none held out", ""
    if diagnosis.held_out_name:
        held = f"{int((~diagnosis.fitted).sum())} held out ({diagnosis.held_out_name})"
        played = " Held-out rows were used neither for selection nor for the fit whose residuals are shown."
    if diagnosis.in_turn:
        played = f"{played.removesuffix('.')}; as each block was held out in turn, they influenced how sure a cause is."
    if diagnosis.held_out_name and diagnosis.final.diagnoser.fitted.all():
        played += " The amended model was then fitted to all rows."
    return (
        f"{diagnosis.campaign.path.name}: {int(diagnosis.fitted.sum())} rows fitted, {held}, {diagnosis.left_out.size} "
        f"left out as gross errors or copies; noise {sigma:.3g} mm ({noise[noise.length_kind].source}).{played}"
    )


def _effect(diagnosis: Conclusions, effect: NamedEffect) -> list[Block]:
    """Return an effect with all its parameters, folded where they are many or may belong to no cause."""
    cause = effect.cause
    named = diagnosis.parameters_of(effect)
    rows = [
        (
            plain(name),
            *value_and_half_width(found.value, found.std, found.dof),
            found.parameter.unit,
            ", ".join(
                word
                for word, holds in (
                    ("significant", found.moved),
                    ("only shapes the effect", not found.parameter.main),
                )
                if holds
            ),
        )
        for name, found in named
    ]
    others = f"; cannot be distinguished from {', '.join(cause.alternatives)}" if cause.alternatives else ""
    # Where something is unknown, a probability among the known causes would mislead.
    sure = "" if diagnosis.verdict == "unknown" else f"probability {cause.probability:.4f}, "
    surely = f"{sure}log evidence {cause.evidence:.0f} nats{others}"
    form = form_text(diagnosis, effect)
    words = f"{effect.story}; {form}{', ' if form else ''}{surely}"
    nearest = effect in diagnosis.nearest
    title = f"{cause.effect} (perhaps only the nearest)" if nearest else cause.effect
    folded = f"{len(rows)} parameters" if nearest or len(rows) > _MOST_OPEN else ""
    together = diagnosis.in_words(effect)
    said = [Lines(list(together))] if together else []
    return [Heading(title, 3), Paragraph(words), *said, Table(_PARAMETER_HEAD, rows, folded)]


def _measurements(diagnosis: Conclusions, suggested: list[SuggestedMeasurement]) -> Table:
    """Return what to measure next, each with its number in the plan."""
    planned = diagnosis.suggestion.measurements
    return Table(
        ("sample", "adds, nats", "pose and conditions", "hours later", "distinguishes", "number"),
        [
            (
                m.plan_row(planned.index(m) + 1)["sample"],
                f"{m.nats:.1f}",
                m.words,
                f"{m.hours_later:.1f}",
                " / ".join(m.separates),
                str(m.rank),
            )
            for m in suggested
        ],
    )
