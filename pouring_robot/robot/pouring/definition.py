"""The pouring robot as a robot definition: its layouts, its closed-form kinematics, its names."""

import dataclasses
import functools
from pathlib import Path

from pouring_robot.io.quantity_columns import Quantity
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.robot.description.command import CommandAxis
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.robot_file import RobotFile
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.dh.table import DHTable
from pouring_robot.robot.pouring.causes import CAUSES
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.layout import load_layout, render_urdf
from pouring_robot.robot.pouring.names import (
    DEFAULT_LAYOUT,
    DRIVE_SYMBOLS,
    DRIVE_WORDS,
    GROUPS,
    INNER_JOINTS,
    LEGS,
    SETS,
)
from pouring_robot.robot.pouring.platform_pose import PLATFORM_POSE

_SHARES = (0.1, 0.5, 0.9)  # of the workspace box along each axis
THERMOMETERS = ("melt", *LEGS, "platform")


_dh_table = functools.lru_cache(maxsize=4)(DHTable.from_mechanism)  # requested many times for the same drawing


class PouringDefinition(RobotDefinition):
    """The pouring robot in one layout; raises DescriptionError, or UnknownLayoutError where the layout is unknown."""

    parameter_groups, parameter_sets, inner_joints, causes = GROUPS, SETS, INNER_JOINTS, CAUSES
    thermometers = expected_thermometers = THERMOMETERS
    tool_words = "the ladle", "the pouring lip"

    def __init__(self, layout: str = DEFAULT_LAYOUT, layouts_file: Path | None = None) -> None:
        self.layout, self.layouts_file = layout, layouts_file
        file, path = _shipped()
        super().__init__(file.model_copy(update={"home": {}}), path)  # the file's home is for one layout only
        names = zip(self.drives, DRIVE_SYMBOLS, DRIVE_WORDS, strict=True)
        self.drives = tuple(dataclasses.replace(d, symbol=symbol, words=words) for d, symbol, words in names)

    def urdf(self) -> str:
        """Return the URDF of the nominal robot."""
        return render_urdf(self.layout, layouts_file=self.layouts_file)

    def files_beside(self) -> dict[str, bytes]:
        """Return the loops file."""
        return {"loops.yaml": (self.path.parent / str(self.file.loops)).read_bytes()}

    def drawing(self, mechanism: ClosedChainMechanism | None = None) -> FourUPUKinematics:
        """Return the closed-form kinematics."""
        return FourUPUKinematics(mechanism or self.mechanism())

    def _spread(self, mechanism: ClosedChainMechanism, count: int) -> FloatArray:
        """Return a grid over the workspace box, regardless of ``count``."""
        return load_layout(self.layout, self.layouts_file).grid(*[_SHARES] * 4)

    def dh_table(self, nominal: ClosedChainMechanism) -> DHTable:
        """Return the DH table of the four chains."""
        return _dh_table(nominal)

    @property
    def command_columns(self) -> tuple[Quantity, ...]:
        """Columns of position and tilt of the platform."""
        return PLATFORM_POSE

    def command_axes(self, mechanism: ClosedChainMechanism) -> tuple[CommandAxis, ...]:
        """Return position and tilt of the platform, with the workspace box as limits."""
        box = load_layout(self.layout, self.layouts_file).box
        edges = zip(self.command_columns, *(corner.tolist() for corner in box), strict=True)
        return tuple(CommandAxis(column, lower, upper) for column, lower, upper in edges)


@functools.cache
def _shipped() -> tuple[RobotFile, Path]:
    path = description_folder() / "robot.yaml"
    return RobotFile.load(path), path
