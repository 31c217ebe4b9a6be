r"""The parameters of a sweep: those of the catalogue that its file names, their values, and their effect on joints.

All of them are added to the robot as it is: DH errors first, exactly as in
:meth:`~pouring_robot.robot.dh.table.DHTable.placement_errors`, then placement errors.

Every error is a monotone function of one standard normal deviate z, so that correlation has the same meaning for all
distributions (a Gaussian copula). Errors of one part share a deviate c:

.. math:: z_k = \sqrt{\rho}\, c + \sqrt{1-\rho}\, n_k

Values depend on the seed and the sample's index only: samples are drawn in blocks of fixed size, each with its own
spawn key (:func:`pouring_robot.io.seeds.spawned`). Chunks and workers do not change them.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import scipy.special

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.seeds import spawned
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.local_parameters import DriveParameter
from pouring_robot.mechanism.rotations import rotation_matrices, rotation_vectors
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.dh.chain import SITES, SYMBOLS, TRANSFORMS
from pouring_robot.robot.parameter_catalogue import Parameter, ParameterCatalogue
from pouring_robot.robot.tolerances import Tolerances, kind_of
from pouring_robot.sweeps.config import DISTRIBUTIONS, ErrorEntry, Margin, SweepConfig

BLOCK = 256


@dataclass(frozen=True)
class SweepParameter(Parameter):
    """A parameter of a sweep, and the entry of the sweep file's ``errors`` from which it comes."""

    entry: int = 0


def completed(config: SweepConfig, catalogue: ParameterCatalogue, robot: RobotDefinition) -> SweepConfig:
    """Return a sweep file completed with defaults of the robot: observed frames, and errors by tolerances.

    Every kind of error is a separate entry, normal with the standard deviation of its tolerance.

    Raises:
        DescriptionError: the tolerances file is wrong.
    """
    defaults: dict[str, Any] = {}
    if not config.frames:
        defaults["frames"] = tuple(dict.fromkeys((robot.loops.working_frame, str(robot.loops.end_frame))))
    if not config.errors:
        tolerances = Tolerances.load(config.beside(config.tolerances)) if config.tolerances else Tolerances.of(robot)
        kinds: dict[str, list[str]] = {}
        for p in catalogue.match("geometry"):
            kinds.setdefault(kind_of(p.local, robot.inner_joints), []).append(p.name)
        sizes = {kind: getattr(tolerances.kinds, kind) for kind in kinds}
        defaults["errors"] = tuple(
            ErrorEntry(parameters=tuple(names), distribution="normal", **{f"std_{sizes[kind].unit}": sizes[kind].std})
            for kind, names in kinds.items()
        )
    return config.model_copy(update=defaults)


def select(catalogue: ParameterCatalogue, config: SweepConfig) -> tuple[SweepParameter, ...]:
    """Return the parameters of a sweep in the order of its ``errors``.

    Raises:
        BadInputError: a name matches nothing, a parameter is given twice or has no size in its unit, or a size is in
            a unit of no parameter.
    """
    chosen: dict[str, SweepParameter] = {}
    for number, entry in enumerate(config.errors):
        try:
            found = {p.name: p for pattern in entry.parameters for p in catalogue.match(pattern)}
        except BadInputError as error:
            raise config.problem(str(error), number) from error
        size = DISTRIBUTIONS[entry.distribution][0][0]
        for name, p in found.items():
            if name in chosen:
                raise config.problem(f"'{name}' is given twice: here and in errors.{chosen[name].entry}", number)
            if entry.size_si(size, p.unit) is None:
                raise config.problem(f"'{name}' needs {size}_{'mm' if p.unit == 'm' else 'mrad'}", number)
        units = {p.unit for p in found.values()}
        for unit, shown, others in (("m", "mm", "angles"), ("rad", "mrad", "lengths")):
            if unit not in units and entry.size_si(size, unit) is not None:
                raise config.problem(f"{size}_{shown} fits none of its parameters, all {others}; leave it out", number)
        chosen |= {name: SweepParameter(**vars(p), entry=number) for name, p in found.items()}
    return tuple(chosen.values())


class ErrorMap:
    """Converts arrays of parameter values, a column per parameter, into placement errors and drive errors."""

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
        """Return the errors of the drives, in m and rad, shape (n, drives), for values (n, parameters)."""
        return np.asarray(values @ self._drive_columns)

    def placement_errors(self, values: FloatArray) -> FloatArray:
        """Return the displacement of every joint of :attr:`joints` for values (n, parameters) in m and rad.

        They are translation in m and rotation vector in rad in the joint's placement frame, shape (n, joints, 6).
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
                # without errors the joint stays exactly where it is
                rows = np.flatnonzero(numbers[:, transforms].any(axis=(1, 2)))
                placed = np.tile(np.eye(4), (rows.size, 1, 1))
                placed[:, :3, :3], placed[:, :3, 3] = rotation_matrices(errors[rows, site, 3:]), errors[rows, site, :3]
                moved = displacements[rows, own] @ placed
                errors[rows, site, :3], errors[rows, site, 3:] = moved[:, :3, 3], rotation_vectors(moved[:, :3, :3])
        return errors


@dataclass(frozen=True, eq=False)
class Draws:
    """The errors of all samples, computed when they are needed."""

    study: str
    seed: int
    count: int  # number of samples in all
    margins: tuple[Margin, ...]  # distribution of every parameter
    parts: tuple[int, ...]  # index of each parameter's part, shape (parameters,)
    shared: FloatArray  # weight of the part's common deviate, the root of the correlation, shape (parameters,)

    @classmethod
    def of(cls, config: SweepConfig, parameters: Sequence[SweepParameter]) -> Self:
        """Return the draws of a sweep."""
        names, samples = sorted({p.part for p in parameters}), config.samples or 0
        counts = {"one_at_a_time": len(parameters), "monte_carlo": samples, "sobol": samples * (len(parameters) + 2)}
        margins = tuple(config.errors[p.entry].margin(p.unit) for p in parameters)
        parts = tuple(names.index(p.part) for p in parameters)
        shared = np.sqrt([config.errors[p.entry].correlation for p in parameters])
        return cls(config.study, config.seed, counts[config.study], margins, parts, shared)

    def values(self, first: int, last: int) -> FloatArray:
        """Return the errors of samples ``first`` to ``last`` in m and rad, shape (last - first, parameters)."""
        if self.study == "one_at_a_time":
            return np.diag([m.tolerance for m in self.margins])[first:last]
        deviates = self._saltelli(first, last) if self.study == "sobol" else self._random(first, last)
        return np.stack([m.from_deviates(deviates[:, k]) for k, m in enumerate(self.margins)], axis=1)

    def _random(self, first: int, last: int) -> FloatArray:
        blocks = []
        for number in range(first // BLOCK, (last - 1) // BLOCK + 1):
            generator = spawned(self.seed, "errors", number)
            common = generator.standard_normal((BLOCK, max(self.parts) + 1))
            independent = generator.standard_normal((BLOCK, len(self.parts)))
            blocks.append(self.shared * common[:, list(self.parts)] + np.sqrt(1.0 - self.shared**2) * independent)
        start = first - first % BLOCK
        return np.concatenate(blocks)[first - start : last - start]

    def _saltelli(self, first: int, last: int) -> FloatArray:
        """Return rows of the matrix that SALib's sampler would build at once: A, A with one column of B each, B."""
        count = len(self.margins)
        base = sobol_points(count, self.count // (count + 2), self.seed)
        point, place = np.divmod(np.arange(first, last), count + 2)
        rows = base[point, :count]
        one = (place >= 1) & (place <= count)
        rows[one, place[one] - 1] = base[point[one], count + place[one] - 1]
        rows[place == count + 1] = base[point[place == count + 1], count:]
        # A scrambled point may be exactly zero, whose deviate would be infinite.
        return np.asarray(scipy.special.ndtri(np.maximum(rows, 2.0**-54)))


@functools.lru_cache(maxsize=4)
def sobol_points(parameters: int, points: int, seed: int) -> FloatArray:
    """Return the Sobol sequence behind Saltelli's scheme, shape (points, 2 · parameters), in 0 to 1."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(d=2 * parameters, scramble=True, seed=seed)
    return np.asarray(sequence.random(points))
