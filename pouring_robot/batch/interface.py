"""What every batch engine offers, whatever the robot's topology, and starts where nobody knows inverse kinematics."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from pouring_robot.batch.samples import BatchClosure, BatchStart, BatchTransfer, SiteErrors, shaped
from pouring_robot.batch.structure import Structure, fixed
from pouring_robot.exceptions import BadInputError, ClosureError
from pouring_robot.mechanism.arrays import FloatArray, lock_arrays
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS, ClosureOptions, ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import (
    DriveParameter,
    GeometricParameter,
    LocalParameter,
    PlacementParameter,
)

_STEPS = 8


class Engine(ABC):
    """Closures and transfer matrices of many samples. Which engine does it changes nothing but the time it takes."""

    structure: Structure  # the mechanism and its sites
    options: ClosureOptions  # when a closure counts as found

    @property
    def parameters(self) -> tuple[PlacementParameter, ...]:
        """All placement parameters of the mechanism, six a site that is used."""
        return self.structure.parameters

    def start_at(self, configurations: FloatArray) -> BatchStart:
        """Return Pinocchio configurations, shape (n, nq), as starts."""
        poses = [self.structure.mechanism.pose_base_to_end(configuration) for configuration in configurations]
        position = np.array([pose.translation for pose in poses]).reshape(-1, 3)
        rotation = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
        return BatchStart(position, rotation, self.structure.joints(configurations))

    def close(
        self, drives: FloatArray, start: BatchStart, errors: SiteErrors | FloatArray | None = None
    ) -> BatchClosure:
        """Close the loops of every sample; raises BadInputError where a shape does not fit.

        Args:
            drives: drive values in the order of the loops file, m or rad, shape (n, drives).
            start: where to start from, of n samples; it also holds the values of locked joints.
            errors: placement errors that displace the mechanism's present placements, as ``perturb_urdf`` does: one set
                for all samples, shape (sites * 6,), translation (m) and rotation vector (rad) site by site; a set for
                each, shape (n, sites * 6); or one displaced site a sample.
        """
        drives = shaped(drives, (len(start), len(self.structure.mechanism.loops.drives)), "'drives'")
        closed = self._closed(drives, start, SiteErrors.take(errors, len(start), self.structure.site_count))
        lock_arrays(closed)
        return closed

    @abstractmethod
    def _closed(self, drives: FloatArray, start: BatchStart, placed: SiteErrors) -> BatchClosure: ...

    def transfer(
        self,
        closed: BatchClosure,
        parameters: Sequence[LocalParameter] | None = None,
        errors: SiteErrors | FloatArray | None = None,
    ) -> BatchTransfer:
        """Return the closed chain's G, exact at any residual (default: of all placement parameters).

        Samples that failed give NaN and keep their status; ``errors`` are those that the others were closed with.
        Raises UnknownJointError where the engine does not displace a joint, BadInputError for what else does not fit.
        """
        placed = SiteErrors.take(errors, len(closed), self.structure.site_count)
        return self._transfer(closed, self._chosen(parameters), placed)

    @abstractmethod
    def _transfer(
        self, closed: BatchClosure, chosen: tuple[GeometricParameter, ...], placed: SiteErrors
    ) -> BatchTransfer: ...

    def _chosen(self, parameters: Sequence[LocalParameter] | None) -> tuple[GeometricParameter, ...]:
        """Return the columns of G that are wanted."""
        chosen: list[GeometricParameter] = []
        for parameter in self.parameters if parameters is None else parameters:
            if not isinstance(parameter, PlacementParameter | DriveParameter):
                raise BadInputError(
                    f"the batch engine has no column for '{parameter.name}'; it takes placement errors and drives: "
                    "use closed_chain_transfer for the others"
                )
            chosen.append(parameter)
        return tuple(chosen)


def closed_home(
    mechanism: ClosedChainMechanism, home: Mapping[str, float], options: ClosureOptions = DEFAULT_OPTIONS
) -> ClosureResult:
    """Return a closed configuration at or near given joint values, by name in m or rad; others start at zero.

    Drives stand where ``home`` says; where the loops do not close so, drives that are not named give way.

    Raises:
        UnknownJointError: a name is no joint.
        BadInputError: a value is not finite, or a named joint has several freedoms.
        ClosureError: the mechanism does not close there.
    """
    start = mechanism.with_joint_values(mechanism.neutral_configuration(), home)
    named = tuple(name for name in mechanism.loops.drives if name in home)
    solver = ClosureSolver(mechanism, options=options)
    try:
        return solver.solve_from(start)
    except ClosureError:
        if len(named) == len(mechanism.loops.drives):
            raise
        yielding = ClosureSolver(mechanism.with_drives(named), options=options)
        return solver.solve_from(yielding.solve_from(start).configuration)


class HomotopyStarts:
    """Closed poses for any drive values, followed from one closed home in even steps, all samples at once.

    The last step may have an engine of its own, ``last``, that asks for more than those on the way. Raises as
    :func:`closed_home`.
    """

    def __init__(self, engine: Engine, home: Mapping[str, float], last: Engine | None = None) -> None:
        self.engine, self._last = engine, last or engine
        mechanism = engine.structure.mechanism
        closed = closed_home(mechanism, home, engine.options)
        self._home = engine.start_at(closed.configuration[None])
        values = closed.joint_values | dict(home)  # a configuration does not know of whole turns
        self._home_drives = np.array([values[name] for name in mechanism.loops.drives])

    def starts(self, drives: FloatArray) -> BatchStart:
        """Return closed poses for drives (n, drives), in m and rad; NaN where a step finds none.

        A serial arm needs no start: it gets its home's locked joints. Raises BadInputError where the shape is wrong.
        """
        drives = fixed(drives)
        if drives.ndim != 2 or drives.shape[1] != self._home_drives.size:
            raise BadInputError(f"drives must have the shape (n, {self._home_drives.size}), not {drives.shape}")
        start = self._home[np.zeros(len(drives), dtype=np.int64)]
        serial = not self.engine.structure.mechanism.anchors
        for step in range(_STEPS if serial else 1, _STEPS + 1):
            share = step / _STEPS
            engine = self._last if step == _STEPS else self.engine
            start = engine.close((1.0 - share) * self._home_drives + share * drives, start).as_start()
        return start
