"""What a calibration leaves behind: model file, URDF, figures and report, all of them or none."""

import json
from pathlib import Path

from pouring_robot.calibration.findings import CalibrationFindings
from pouring_robot.calibration.report import FIGURES, MODEL, headline, html_report
from pouring_robot.calibration.summary import calibration_metrics, notes_of, warnings_of
from pouring_robot.exceptions import DescriptionError, OutputError
from pouring_robot.io.files import check_folder, write_together
from pouring_robot.robot.description.urdf import urdf_files
from pouring_robot.robot.export.closed import ClosedRobot
from pouring_robot.robot.model import RobotModel

REPORT = "report.html"


def write_calibration(calibration: CalibrationFindings, folder: Path | str) -> list[Path]:
    """Write model file, URDF with meshes and loops, ``calibration.json`` and ``report.html``, and return the files.

    Files of an earlier calibration in the folder, which is made if need be, are replaced.

    Raises:
        OutputError: the folder cannot be written to.
    """
    folder, model = check_folder(folder), described(calibration)
    try:
        files = urdf_files(ClosedRobot.of(model).urdf, folder, model.definition.files_beside())
    except DescriptionError as error:
        raise OutputError(folder, error.problem) from error
    files[folder / FIGURES] = json.dumps(calibration_metrics(calibration), indent=1, allow_nan=False) + "\n"
    files[folder / REPORT] = html_report(calibration)
    files[folder / MODEL] = model.file_text(folder)  # others may wait for it
    return [path for path in write_together(files) if path.parent == folder]


def described(calibration: CalibrationFindings) -> RobotModel:
    """Return the calibrated model with a description that says how good it is, warnings first."""
    told = [*warnings_of(calibration), *notes_of(calibration)]
    warnings = [line for line in told if any(words in line for words in ("deficient", "do not use", "heat section"))]
    said = [f"{line[0].upper()}{line[1:]}." for line in warnings]
    said += [headline(calibration), f"Calibrated with {calibration.campaign.path.name}."]
    if calibration.present.description:
        said.append(f"Before: {calibration.present.description}")
    return calibration.calibrated.model_copy(update={"description": " ".join(said)})
