"""``pouring-robot campaign check``: what is in measured data, and what is wrong with it, before a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pouring_robot.cli.shared import bundles, options
from pouring_robot.cli.shared.tables import print_table

if TYPE_CHECKING:
    from collections.abc import Iterator

_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}


def check(
    *, file: options.CampaignFile, which: bundles.Which, as_json: options.AsJson = False, png: options.PngFile = None
) -> None:
    """Say what is in a campaign and what is wrong with its data, before any fit; exit code 2 if there is an error."""
    from pouring_robot.campaign.data import Campaign
    from pouring_robot.checks.check import campaign_metrics, examine
    from pouring_robot.checks.flags import refuse_errors
    from pouring_robot.checks.plots import write_picture
    from pouring_robot.robot.pouring.definition import PouringDefinition
    from pouring_robot.robot.pouring.layout import load_layout

    definition = which.read().definition
    campaign = Campaign.read(file, definition)
    found = examine(campaign, definition.drawing())
    figures = campaign_metrics(campaign, found)
    box = None  # of other robots
    if isinstance(definition, PouringDefinition):
        box = load_layout(definition.layout, definition.layouts_file)
    written = [write_picture(campaign, found, box, png)] if png else []
    if as_json:
        options.print_figures(figures, written)
    else:
        _print_summary(figures)
        options.print_written(written)
    refuse_errors(campaign, found.flags)


def _print_summary(figures: dict[str, Any]) -> None:
    sessions = ", ".join(f"{name} ({rows})" for name, rows in list(figures["sessions"].items())[:12])
    options.say(
        f"{figures['file']}: {figures['rows']} rows of {figures['seen']}, {figures['usable_rows']} usable, "
        f"{figures['distinct_poses']} distinct poses"
    )
    options.say(f"sessions (rows): {sessions}")
    rows = []
    for name, values in figures["ranges"].items():
        if not name.startswith("approach"):
            digits = 4 if values["unit"] == "rad" else 2
            ends = (f"{values[end]:.{digits}f}" for end in ("least", "largest"))
            rows.append((name, values["unit"].replace("degC", "°C"), *ends, str(values["missing"] or "")))
    print_table(("column", "unit", "least", "largest", "missing"), rows, (0, 1))
    for line in _lines(figures):
        options.say(line)
    if not figures["flags"]:
        options.say("checks: nothing found")
    for flag in figures["flags"]:
        severity = flag["severity"]
        options.say(f"{severity}: {flag['message']}", style=_STYLES[severity])
        options.say(f"    → {flag['mend']}")


def _lines(figures: dict[str, Any]) -> Iterator[str]:
    """Yield what is not recorded, how far the nominal robot is off, and what the data do not tell."""
    if missing := figures["missing_conditions"]:
        yield f"not recorded, so what depends on it cannot be tested: {', '.join(missing)}"
    if misfit := figures["misfit"]:
        parts = []
        for what, unit in (("position", "mm"), ("rotation", "mrad")):
            value, noise = misfit[f"{what}_{unit}"], misfit[f"{what}_noise_{unit}"]
            if value is not None:
                parts.append(f"{value:.3g} {unit}" + (f" (noise {noise:.3g})" if noise else ""))
        yield f"against the nominal robot, the two unknown frames fitted: {', '.join(parts)} a component, robust"
    disagree = figures["redundant_drives_disagree_mm"]
    if disagree is not None:
        yield f"redundant drives of the nominal robot disagree by {disagree:.3g} mm (RMS)"
    for direction in figures["untold_of_the_frames"]:  # held at zero, and costs nothing
        text = " ".join(f"{share:+.3g} {name}" for name, share in direction.items())
        yield f"the poses do not tell of the frames: {text.removeprefix('+')}"
