"""What a calibration leaves behind: model file, URDF, figures and report, all of them or none."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from pathlib import Path

from pouring_robot.calibration.calibrate import Calibration
from pouring_robot.calibration.report import headline, html_report
from pouring_robot.calibration.summary import calibration_figures, warnings_of
from pouring_robot.description import write_urdf
from pouring_robot.exceptions import DescriptionError, OutputError
from pouring_robot.files import write_whole
from pouring_robot.model import RobotModel, loops_file

MODEL, FIGURES, REPORT, LOOPS = "calibrated.yaml", "calibration.json", "report.html", "loops.yaml"


def check_folder(folder: Path | str) -> Path:
    """Find out before the work whether results can be put into a folder, which may not be there yet.

    Raises:
        OutputError: they cannot.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise OutputError(folder, "it is a file; give a folder")
    place = folder if folder.exists() else folder.absolute().parent
    if not place.is_dir():
        raise OutputError(folder, f"the folder {place} does not exist; make it first")
    if not os.access(place, os.W_OK):
        raise OutputError(folder, "permission denied; choose a place you may write to")
    return folder


def write_calibration(calibration: Calibration, folder: Path | str) -> list[Path]:
    """Write the model file, the URDF with meshes and loops, ``calibration.json`` and ``report.html``.

    Everything is made in a hidden folder beside the target first; a failure leaves the target as it was.

    Args:
        calibration: what was found; its warnings stand in the model file's description too.
        folder: made if it is not there; files of an earlier calibration in it are replaced.

    Returns:
        The files, as they stand in the folder.

    Raises:
        OutputError: the folder cannot be written to.
    """
    folder = check_folder(folder)
    hidden = folder.absolute().with_name(f".{folder.absolute().name[:80]}.{secrets.token_hex(6)}.part")
    try:
        hidden.mkdir()
        _fill(calibration, hidden)
        return _move(hidden, folder)
    except OSError as error:
        raise OutputError(folder, f"{error.strerror or error}; choose a place you may write to") from error
    except DescriptionError as error:
        raise OutputError(folder, error.problem) from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def _fill(calibration: Calibration, folder: Path) -> None:
    model = described(calibration)
    model.save(folder / MODEL)
    write_urdf(model.tree_urdf(), folder)
    write_whole(folder / LOOPS, loops_file().read_bytes())
    write_whole(folder / FIGURES, json.dumps(calibration_figures(calibration), indent=1, allow_nan=False) + "\n")
    write_whole(folder / REPORT, html_report(calibration))


def described(calibration: Calibration) -> RobotModel:
    """Return the calibrated model with a description that says how good it is, warnings first."""
    warnings = [line for line in warnings_of(calibration) if "deficient" in line or "do not use" in line]
    present = calibration.present.description
    said = [
        *(f"{line[0].upper()}{line[1:]}." for line in warnings),
        headline(calibration),
        f"Calibrated with {calibration.campaign.path.name}.",
    ]
    return calibration.calibrated.model_copy(
        update={"description": " ".join([*said, *([f"Before: {present}"] if present else [])])}
    )


def _move(hidden: Path, folder: Path) -> list[Path]:
    """Put the finished files into place one by one, the model file last."""
    folder.mkdir(exist_ok=True)
    found = sorted(path.relative_to(hidden) for path in hidden.rglob("*") if path.is_file())
    found.sort(key=lambda path: path.name == MODEL)
    for path in found:
        (folder / path).parent.mkdir(exist_ok=True)
        (hidden / path).replace(folder / path)
    return [folder / path for path in found if path.parent == Path()]
