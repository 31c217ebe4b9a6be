"""The robot as files for other programs, in the manner of ``robot_descriptions``: a URDF and its package."""

import tempfile
from pathlib import Path

from pouring_robot.exceptions import BadInputError, OutputError
from pouring_robot.io.cache import cache_folder, content_key
from pouring_robot.robot.description.urdf import description_folder, shipped_folder, write_urdf
from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot
from pouring_robot.robot.model import RobotModel


def package_path() -> Path:
    """Return the folder of the robot description: meshes, xacro, dimensions, loops; like ``description_folder``."""
    return description_folder()


def examples_path() -> Path:
    """Return the folder of the examples; raises DescriptionError where it is missing from the installation."""
    return shipped_folder("examples", "actual.yaml", "the examples are")


def urdf_path(*, layout: str | None = None, model: RobotModel | Path | str | None = None) -> Path:
    """Return a URDF file with its meshes, in the cache folder, of a layout (default: ``paper``) or a model.

    A model, or its file, is the robot as built; drive offsets become displaced joints. Raises BadInputError where both
    are given or one is wrong, OutputError where the cache folder cannot be written to.
    """
    if layout is not None and model is not None:
        raise BadInputError("give layout or model, not both: the model names its layout")
    urdf = ClosedRobot.of(RobotModel(layout=layout) if layout else RobotModel.of(model)).urdf
    place = (cache_folder() or Path(tempfile.gettempdir(), "pouring_robot")) / "robots" / content_key([urdf])
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(place, f"{problem.strerror}; name another folder in POURING_ROBOT_CACHE") from problem
    # Written each time: a mesh may have been deleted, or the description may have changed.
    return write_urdf(urdf, place)
