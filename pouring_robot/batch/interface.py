"""The interface of all batch engines, for any topology of the robot."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from pouring_robot.batch.records import BatchClosure, BatchStart, BatchTransfer, SiteErrors, shaped
from pouring_robot.batch.structure import Structure
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray, lock_arrays
from pouring_robot.mechanism.closure.solver import ClosureOptions
from pouring_robot.mechanism.local_parameters import (
    DriveParameter,
    GeometricParameter,
    LocalParameter,
    PlacementParameter,
    placement_parameters,
)


class Engine(ABC):
    """Closures and transfer matrices of many samples. Engines differ in speed only, not in results."""

    structure: Structure  # the mechanism and its sites
    options: ClosureOptions  # when a closure counts as found

    @property
    def parameters(self) -> tuple[PlacementParameter, ...]:
        """All placement parameters, six for each site used, in the order of the columns of placement errors."""
        return placement_parameters(self.structure.placed_joints)

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

        Samples that failed give NaN and keep their status; ``errors`` are those with which the others were closed.
        Raises UnknownJointError where the engine does not displace a joint, BadInputError for any other misfit.
        """
        placed = SiteErrors.take(errors, len(closed), self.structure.site_count)
        return self._transfer(closed, self._chosen(parameters), placed)

    @abstractmethod
    def _transfer(
        self, closed: BatchClosure, chosen: tuple[GeometricParameter, ...], placed: SiteErrors
    ) -> BatchTransfer: ...

    def _chosen(self, parameters: Sequence[LocalParameter] | None) -> tuple[GeometricParameter, ...]:
        """Return the requested columns of G."""
        chosen: list[GeometricParameter] = []
        for parameter in self.parameters if parameters is None else parameters:
            if not isinstance(parameter, PlacementParameter | DriveParameter):
                raise BadInputError(
                    f"the batch engine has no column for '{parameter.name}'; it takes placement errors and drives: "
                    "use closed_chain_transfer for the others"
                )
            chosen.append(parameter)
        return tuple(chosen)
