"""What a diagnosis leaves behind: figures, amended model, report and ladles, all of them or none."""

from __future__ import annotations

import json
from pathlib import Path

from pouring_robot.diagnosis.report.page import html_report
from pouring_robot.diagnosis.report.record import diagnosis_figures
from pouring_robot.diagnosis.report.scene import ladle_scene
from pouring_robot.diagnosis.report.sentences import gap_sentence, headline
from pouring_robot.diagnosis.report.summary import Summary
from pouring_robot.exceptions import DescriptionError, OutputError
from pouring_robot.io.files import check_folder, write_together
from pouring_robot.robot.model import RobotModel
from pouring_robot.viewer.page import page as html_of

FIGURES, MODEL, REPORT, LADLES = "diagnosis.json", "model.yaml", "report.html", "ladles.html"


def write_diagnosis(summary: Summary, folder: Path | str) -> list[Path]:
    """Write ``diagnosis.json``, ``model.yaml``, ``report.html`` and ``ladles.html``; the figures last.

    ``ladles.html`` is left out where no row has a whole position: there is nothing to draw.

    Args:
        summary: what is told.
        folder: made if it is not there; files of an earlier diagnosis in it are replaced.

    Returns:
        The files, as they stand in the folder.

    Raises:
        OutputError: the folder cannot be written to.
    """
    folder = check_folder(folder)
    files: dict[Path, bytes | str] = {
        folder / MODEL: described(summary).file_text(folder),
        folder / REPORT: html_report(summary),
    }
    try:
        scene = ladle_scene(summary)
        if scene is not None:
            files[folder / LADLES] = html_of(scene)
    except DescriptionError as error:
        raise OutputError(folder, error.problem) from error
    figures = diagnosis_figures(summary, str(folder / MODEL))
    files[folder / FIGURES] = json.dumps(figures, indent=1, allow_nan=False) + "\n"
    return write_together(files)


def described(summary: Summary) -> RobotModel:
    """Return the amended model with a description that says what was found and how good it is."""
    model, present = summary.model, summary.diagnosis.model.description
    nearest = ", ".join(e.cause.effect for e in summary.nearest)
    said = [
        "Worse on held-out rows: do not use this model." if summary.worse else "",
        headline(summary),
        gap_sentence(summary),
        f"{nearest} stand in for something unknown and are no cause." if nearest and not summary.refused else "",
        f"Diagnosed with {summary.diagnosis.campaign.path.name}.",
        f"Before: {present}" if present else "",
    ]
    return model.model_copy(update={"description": " ".join(part for part in said if part)})
