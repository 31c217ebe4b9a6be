"""The report of a diagnosis as one self-contained HTML page."""

from __future__ import annotations

import html

from pouring_robot.diagnosis.parameters import NamedEffect
from pouring_robot.diagnosis.report.plots import pictures
from pouring_robot.diagnosis.report.sentences import (
    figures_of,
    gap_sentence,
    gap_table,
    headline,
    measurement_text,
    plain,
    sections,
)
from pouring_robot.diagnosis.report.summary import Summary, named_parameters
from pouring_robot.diagnosis.suggest.suggest import SuggestedMeasurement
from pouring_robot.mechanism.poses import MM
from pouring_robot.report.page_parts import html_page, html_picture, html_table

_STYLE = (
    "th:nth-child(2){text-align:left}h3{margin-bottom:.2rem}figcaption{color:#57606a;font-size:.9em}"
    ".wide{font-size:.85em}"
    "li.sub{list-style:none;color:#444}summary{cursor:pointer}"
)
_PARAMETER_HEAD = ("parameter", "value", "± 95 %", "unit", "")
_MOST_OPEN = 14


def html_report(summary: Summary) -> str:
    """Return the report as one page without any outside file."""
    diagnosis, text = summary.diagnosis, html.escape
    noise, sigma = diagnosis.noise, diagnosis.noise.position_m / MM
    held = (
        f"{int((~diagnosis.fitted).sum())} held out ({diagnosis.held_out_name})"
        if diagnosis.held_out_name
        else "none held out"
    )
    parts = [
        "<h1>Diagnosis</h1>",
        f"<p class='lead'><b>{text(headline(summary))}</b></p>",
        f"<p class='lead'>{text(gap_sentence(summary))}</p>",
        f"<p>{text(diagnosis.campaign.path.name)}: {int(diagnosis.fitted.sum())} rows fitted, {text(held)}, "
        f"{diagnosis.outliers.size} left out as gross errors; noise {sigma:.3g} mm ({noise.position_source}). "
        "Held-out rows chose and fitted nothing.</p>",
        "<h2>Gap before and after</h2>",
        html_table(*gap_table(summary)),
    ]
    shown = pictures(summary)
    parts += [html_picture(title, png) for title, png in shown[:1]]
    for heading, lines in sections(summary, short=False):
        parts.append(f"<h2>{text(heading[0].upper() + heading[1:])}</h2><ul>")
        parts += [f"<li{' class=sub' if line[0] == ' ' else ''}>{text(line.strip())}</li>" for line in lines]
        parts.append("</ul>")
    effects = (*summary.firm, *summary.nearest)
    parts += ["<h2>Parameters</h2>"] if effects else []
    for effect in effects:
        parts += _effect(summary, effect)
    parts.append("<h2>Pictures</h2>")
    parts += [html_picture(title, png) for title, png in shown[1:]]
    suggested = sorted(summary.suggestion.measurements, key=lambda m: m.rank)
    if suggested:
        parts += [
            "<h2>Measurements that tell most</h2>",
            f"<div class='wide'>{html_table(*_measurements(suggested))}</div>",
        ]
    parts += ["<h2>Findings of the data checks</h2><ul>"]
    parts += [f"<li>{text(str(flag))}</li>" for flag in diagnosis.flags] or ["<li>nothing</li>"]
    parts.append("</ul>")
    return html_page(f"Diagnosis of {diagnosis.campaign.path.name}", parts, _STYLE)


def _effect(summary: Summary, effect: NamedEffect) -> list[str]:
    """Return an effect with all its parameters, folded away where they are many or belong to no cause."""
    cause = effect.cause
    named = named_parameters(summary.diagnosis, effect)
    rows = [
        (
            plain(name),
            *figures_of(found),
            found.parameter.unit,
            ", ".join(
                word
                for word, holds in (
                    ("clear", found.std > 0.0 and abs(found.value) > 1.96 * found.std),
                    ("only shapes it", not found.parameter.main),
                )
                if holds
            ),
        )
        for name, found in named
    ]
    others = f"; cannot be told from {', '.join(cause.alternatives)}" if cause.alternatives else ""
    surely = f"probability {cause.probability:.4f}, log evidence {cause.evidence:.0f} nats{others}"
    words = f"{effect.story}; form '{plain(cause.form)}', {surely}"
    nearest = effect in summary.nearest
    title = html.escape(f"{cause.effect} (only the nearest; not the cause)" if nearest else cause.effect)
    table = html_table(_PARAMETER_HEAD, rows)
    if nearest or len(rows) > _MOST_OPEN:
        table = f"<details><summary>{len(rows)} parameters</summary>{table}</details>"
    return [f"<h3>{title}</h3><p>{html.escape(words)}</p>", table]


def _measurements(suggested: list[SuggestedMeasurement]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return heading and rows of what to measure next."""
    head: tuple[str, ...] = ("rank", "pose and conditions", "hours later", "nats", "tells apart")
    rows: list[tuple[str, ...]] = [
        (str(m.rank), measurement_text(m), f"{m.hours_later:.1f}", f"{m.nats:.1f}", " / ".join(m.separates))
        for m in suggested
    ]
    return head, rows
