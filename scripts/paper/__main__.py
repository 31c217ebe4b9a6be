"""Check what the paper says, claim by claim, against this robot.

    python -m scripts.paper geometry [--poses 10000] [--seed 2022] [--layout paper] [--out FOLDER]
    python -m scripts.paper thermal [--draws 8] [--seed 2022] [--layout paper] [--out FOLDER]
    python -m scripts.paper sections [--seed 2022] [--layout paper] [--out FOLDER]
    python -m scripts.paper readings [--seed 2022] [--out FOLDER]

Each part prints a table with one row per claim (what the paper says, what we compute, the verdict and why) and writes
it with its figures to a folder. Exit codes: 0 done, 2 bad input, 3 no solution.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pouring_robot.cli.shared.progress import stage_bars
from pouring_robot.exceptions import PouringRobotError
from pouring_robot.io.progress import Progress
from scripts.paper.geometry.report import GeometryReport
from scripts.paper.geometry.study import run_study
from scripts.paper.page import PaperReport, make_folder

DOCS = Path(__file__).resolve().parents[2] / "docs"

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None, no_args_is_help=True)


@app.callback()
def parts() -> None:
    """Check what the paper says, claim by claim, against this robot."""


@app.command()
def geometry(
    poses: Annotated[int, typer.Option(min=2, max=100_000, help="Poses drawn from the workspace.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the drawing.")] = 2022,
    layout: Annotated[str, typer.Option(help="Layout of the dimensions file.")] = "paper",
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where CSV, JSON, Markdown and figures go.")] = Path(
        "output/paper_geometry"
    ),
    docs: Annotated[bool, typer.Option("--docs", help="Renew docs/paper_geometry.md and its figures as well.")] = False,
) -> None:
    """Geometric errors, section 4: in the paper's open branch, then in the closed chain."""
    given = {"poses": (poses, 10_000), "seed": (seed, 2022), "layout": (layout, "paper")}

    def report(progress: Progress) -> PaperReport:
        return GeometryReport.of(run_study(layout, poses, seed, progress))

    _publish(report, given, out, docs)


@app.command()
def thermal(
    seed: Annotated[int, typer.Option(min=0, help="Seed of the drawing.")] = 2022,
    layout: Annotated[str, typer.Option(help="Layout of the dimensions file.")] = "paper",
    draws: Annotated[int, typer.Option(min=0, max=200, help="Further drawings of ten poses.")] = 8,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where CSV, JSON, Markdown and figures go.")] = Path(
        "output/paper_thermal"
    ),
    docs: Annotated[bool, typer.Option("--docs", help="Renew docs/paper_thermal.md and its figures as well.")] = False,
) -> None:
    """Heat and the joint regression, section 5: the melt's radiation, ten poses, twelve temperatures."""
    # scikit-learn takes a second to import; only this part pays for it.
    from scripts.paper.thermal.report import ThermalReport
    from scripts.paper.thermal.study import run_thermal_study

    given = {"seed": (seed, 2022), "layout": (layout, "paper"), "draws": (draws, 8)}

    def report(progress: Progress) -> PaperReport:
        return ThermalReport.of(run_thermal_study(layout, seed, draws, progress))

    _publish(report, given, out, docs)


@app.command()
def sections(
    seed: Annotated[int, typer.Option(min=0, help="Seed of the drawing.")] = 2022,
    layout: Annotated[str, typer.Option(help="Layout of the dimensions file.")] = "paper",
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where CSV, JSON and Markdown go.")] = Path(
        "output/paper_sections"
    ),
    docs: Annotated[bool, typer.Option("--docs", help="Renew docs/paper_sections.md as well.")] = False,
) -> None:
    """Abstract and sections 2, 3, 6, 7: strokes, load, shares of the error, weight, identification."""
    from scripts.paper.sections import SectionsReport, run_sections_study

    given = {"seed": (seed, 2022), "layout": (layout, "paper")}
    _publish(lambda progress: SectionsReport.of(run_sections_study(layout, seed, progress)), given, out, docs)


@app.command()
def readings(
    seed: Annotated[int, typer.Option(min=0, help="Seed of the drawing.")] = 2022,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where CSV, JSON and Markdown go.")] = Path(
        "output/paper_readings"
    ),
    docs: Annotated[bool, typer.Option("--docs", help="Renew docs/paper_readings.md as well.")] = False,
) -> None:
    """Every reading of what the paper leaves open, scored on the claims of sections 4 and 5."""
    from scripts.paper.readings import ReadingsReport, score_all

    _publish(lambda progress: ReadingsReport(seed, score_all(seed, progress)), {"seed": (seed, 2022)}, out, docs)


def _publish(
    make: Callable[[Progress], PaperReport],
    given: Mapping[str, tuple[object, object]],
    out: Path,
    docs: bool,
) -> None:
    """Make a report under a bar, print it and write it.

    Args:
        make: the report, told how to show its progress.
        given: arguments with their defaults; those that differ stand in the report's command.
        out: folder for everything.
        docs: whether to renew the documentation too.
    """
    arguments = "".join(f" --{name} {value}" for name, (value, default) in given.items() if value != default)
    try:
        make_folder(out)
        with stage_bars() as progress:
            report = make(progress)
        console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
        for item in report.renderables():
            console.print(item)
        written = report.write(out, arguments)
        if docs:
            written += report.write_docs(DOCS, arguments)
    except PouringRobotError as error:
        typer.echo(f"reproduce_paper: {error}", err=True)
        raise typer.Exit(error.exit_code) from None
    typer.echo(f"wrote {', '.join(str(path) for path in written)}", err=True)


if __name__ == "__main__":
    app()
