"""The parameters of a sweep: those of the catalogue that its file names, and what their values do to the joints.

All of them act on top of the robot as it is: DH errors first, exactly as
:meth:`~pouring_robot.robot.dh.table.DHTable.placement_errors` has them, then placement errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import DriveParameter
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.dh.chain import SITES, SYMBOLS, TRANSFORMS
from pouring_robot.robot.parameters import Parameter, ParameterCatalogue
from pouring_robot.robot.tolerances import Tolerances, kind_of
from pouring_robot.sweeps.config import ErrorEntry, SweepConfig


@dataclass(frozen=True)
class SweepParameter(Parameter):
    """A parameter of a sweep, and which of the sweep file's ``errors`` it comes from."""

    entry: int = 0


def completed(config: SweepConfig, catalogue: ParameterCatalogue, robot: RobotDefinition) -> SweepConfig:
    """Return a sweep file with what it leaves to the robot: observed frames, and errors by tolerances.

    Every kind of error is an entry of its own, normal with the standard deviation of its tolerance.

    Raises:
        DescriptionError: the tolerances file is wrong.
    """
    said: dict[str, Any] = {}
    if not config.frames:
        said["frames"] = tuple(dict.fromkeys((robot.loops.working_frame, str(robot.loops.end_frame))))
    if not config.errors:
        tolerances = Tolerances.load(config.beside(config.tolerances)) if config.tolerances else Tolerances.of(robot)
        kinds: dict[str, list[Parameter]] = {}
        for p in catalogue.match("geometry"):
            kinds.setdefault(kind_of(p.local, robot.inner_joints), []).append(p)
        said["errors"] = tuple(
            ErrorEntry(
                parameters=tuple(p.name for p in found),
                distribution="normal",
                **{f"std_{tolerance.unit}": tolerance.std},
            )
            for kind, found in kinds.items()
            for tolerance in (getattr(tolerances.kinds, kind),)
        )
    return config.model_copy(update=said)


def select(catalogue: ParameterCatalogue, config: SweepConfig) -> tuple[SweepParameter, ...]:
    """Return the parameters of a sweep in the order of its ``errors``.

    Raises:
        BadInputError: a name matches nothing, a parameter is given twice or has no size of its unit.
    """
    chosen: dict[str, SweepParameter] = {}
    for number, entry in enumerate(config.errors):
        try:
            found = {p.name: p for pattern in entry.parameters for p in catalogue.match(pattern)}
        except BadInputError as error:
            raise config.problem(str(error), number) from error
        size = "half_width" if entry.distribution == "uniform" else "std"
        for name, p in found.items():
            if name in chosen:
                raise config.problem(f"'{name}' is given twice: here and in errors.{chosen[name].entry}", number)
            if entry.size_si(size, p.unit) is None:
                raise config.problem(f"'{name}' needs {size}_{'mm' if p.unit == 'm' else 'mrad'}", number)
        chosen |= {name: SweepParameter(**vars(p), entry=number) for name, p in found.items()}
    return tuple(chosen.values())


class ErrorMap:
    """Turns arrays of values of parameters, which are their columns, into placement errors and drive errors."""

    def __init__(self, catalogue: ParameterCatalogue, parameters: Sequence[Parameter]) -> None:
        self.joints = catalogue.joints
        self._chains = catalogue.table.chains if catalogue.table else {}
        drives = [drive.joint for drive in catalogue.drives]
        site = {joint: k for k, joint in enumerate(self.joints)}
        self._drive_columns = np.zeros((len(parameters), len(drives)))
        self._placements: list[tuple[int, int, int]] = []
        self._dh: dict[int, list[tuple[int, tuple[int, int]]]] = {}
        for k, p in enumerate(parameters):
            if isinstance(p.local, DriveParameter):
                self._drive_columns[k, drives.index(p.local.joint)] = 1.0
            elif p.dh is not None:
                self._dh.setdefault(p.chain, []).append((k, p.dh.place))
            else:
                self._placements.append((k, site[p.local.joint], p.local.twist.index(1.0)))

    def drive_errors(self, values: FloatArray) -> FloatArray:
        """Return the errors of the drives in m and rad, shape (n, drives), for values (n, parameters)."""
        return np.asarray(values @ self._drive_columns)

    def placement_errors(self, values: FloatArray) -> FloatArray:
        """Return the displacement of every joint of :attr:`joints` for values (n, parameters) in m and rad.

        Translation in m and rotation vector in rad in the joint's placement frame, shape (n, joints, 6).
        """
        errors = np.zeros((len(values), len(self.joints), 6))
        for column, site, component in self._placements:
            errors[:, site, component] = values[:, column]
        for number, columns in self._dh.items():
            chain = self._chains[number]
            numbers = np.zeros((len(values), len(TRANSFORMS), len(SYMBOLS)))
            for column, place in columns:
                numbers[:, place[0], place[1]] = values[:, column]
            displacements = chain.displacements(numbers)
            for own in sorted({SITES[transform] for _, (transform, _) in columns}):
                site = self.joints.index(chain.joints[own])
                transforms = [k for k, k_site in enumerate(SITES) if k_site == own]
                rows = numbers[:, transforms].any(axis=(1, 2))  # without errors the joint stays exactly where it is
                moved = displacements[rows, own] @ homogeneous(errors[rows, site])
                errors[rows, site, :3] = moved[:, :3, 3]
                errors[rows, site, 3:] = Rotation.from_matrix(moved[:, :3, :3]).as_rotvec()
        return errors


def homogeneous(errors: FloatArray) -> FloatArray:
    """Return placement errors (n, 6), translation (m) and rotation vector (rad), as matrices (n, 4, 4)."""
    matrix = np.zeros((len(errors), 4, 4))
    matrix[:, :3, :3] = Rotation.from_rotvec(errors[:, 3:]).as_matrix()
    matrix[:, :3, 3] = errors[:, :3]
    matrix[:, 3, 3] = 1.0
    return matrix
