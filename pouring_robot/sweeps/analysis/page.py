"""What a sweep found, in lines and tables for terminal and page, and the page itself."""

from collections.abc import Mapping

from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Table, html_page
from pouring_robot.report.plots import svg_of
from pouring_robot.sweeps.analysis.findings import SweepFindings
from pouring_robot.sweeps.analysis.plots import map_of, study_figure


def summary_lines(found: SweepFindings) -> list[str]:
    """Return how far the tool is off, which share is within the requirement, and what had no solution."""
    figures = found.summary.figures()
    quantiles = ", ".join(
        f"{v:.3f} mm in {100 * float(k):g} %" for k, v in figures["quantiles_mm"].items() if v is not None
    )
    what = "errors alone" if found.store.plan.config.study == "one_at_a_time" else "robots"
    lines = [
        f"{figures['robots']} {what} at {figures['poses']} poses: {figures['frame']} is off by up to "
        f"{quantiles} of them, never by more than {figures['largest_mm']:.3f} mm "
        f"and {figures['largest_mrad']:.3f} mrad",
        f"within {figures['accuracy_mm']:g} mm: {figures['share_within']:.2%} of all, "
        f"{figures['share_of_robots_within_everywhere']:.2%} of the {what} at every pose",
    ]
    if found.summary.failed:
        failed = ", ".join(f"{count} {name}" for name, count in figures["status"].items() if name != "ok")
        lines.append(f"note: without a solution, kept with their status: {failed}")
    if found.indices and found.indices.dropped:
        lines.append(f"note: {found.indices.dropped} base samples without a solution are left out of the indices")
    return lines


def ranking_table(found: SweepFindings) -> Table:
    """Return the tolerances, the one that matters most first."""
    head = [name.replace("_", " ") for name in ("parameter", "part", "tolerance", *found.ranking[0].figures)]
    rows = []
    for p in found.ranking:
        cells = (f"{v:.4g}" if isinstance(v, float) else str(v) for v in p.figures.values())
        rows.append([p.name, p.part, f"{p.tolerance:.4g} {p.unit}", *cells])
    return Table(head, rows)


def allocation_line(found: SweepFindings) -> str:
    """Return what the loosest tolerances keep."""
    figures = found.allocation.figures() if found.allocation else {}
    checked = figures["verified"]
    return (
        f"loosest tolerances that keep {figures['requirement_mm']:g} mm for {figures['wanted_share']:.2%} of the "
        f"robots at every pose; {checked['robots']} of them closed exactly at the {checked['poses']} hardest poses: "
        f"{checked['share_within']:.2%} within, {checked['share_at_worst_pose']:.2%} at the worst pose"
    )


def allocation_table(found: SweepFindings) -> Table:
    """Return the loosest tolerances, the tightest first; those that hardly matter stand at the cap."""
    figures = found.allocation.figures() if found.allocation else {}
    rows = [
        (row["parameter"], f"{row['tolerance_mm_or_mrad']:.4g}", f"{row['factor']:.3f}", "at the cap" * row["at_cap"])
        for row in sorted(figures["tolerances"], key=lambda row: float(row["factor"]))
    ]
    return Table(("parameter", "tolerance mm or mrad", "times the given one", ""), rows)


def html_report(found: SweepFindings, links: Mapping[str, str]) -> str:
    """Return the report as one page without any outside file."""
    config, frame = found.store.plan.config, found.summary.frame
    study = f"{config.study.replace('_', ' ')}, {config.kind.replace('_', ' ')}"
    drawn = svg_of(study_figure(found.store, found.summary, found.ranking))
    blocks: list[Block] = [
        Paragraph(found.headline, "headline"),
        Lines(summary_lines(found)),
        Paragraph(f"{study}; seed {config.seed}; content of the sweep {found.store.plan.content_hash}"),
        Plot(f"What matters, and how far {frame} is off", drawn),
        Heading("Where in the workspace"),
        Plot(
            f"{frame} off by, RMS over the robots: slices of the workspace, the worst tilt there", svg_of(map_of(found))
        ),
    ]
    if found.allocation:
        blocks += [Heading("The loosest tolerances that will do"), Paragraph(allocation_line(found))]
        blocks.append(allocation_table(found))
    ranking = ranking_table(found)
    blocks += [Heading(f"The tolerances that matter most ({frame})"), ranking]
    title = f"Sweep in {found.store.folder.name}"
    return html_page(title, title, blocks, links=links, data=[config.source] if config.source else [])
