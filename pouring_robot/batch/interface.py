"""What every batch engine offers, whatever the robot's topology: type against this."""

from collections.abc import Sequence
from typing import Protocol

from pouring_robot.batch.samples import BatchClosure, BatchStart, BatchTransfer, SiteErrors
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureOptions
from pouring_robot.mechanism.parameters import LocalParameter, PlacementParameter


class Structure(Protocol):
    """Where samples may displace a mechanism: its sites, one a joint placement."""

    @property
    def mechanism(self) -> ClosedChainMechanism:
        """The mechanism that the samples displace."""

    @property
    def site_joints(self) -> tuple[str, ...]:
        """Joint whose placement each site displaces; a site's number is its index. Empty: a site that is not used."""

    @property
    def site_count(self) -> int:
        """Number of sites."""

    @property
    def parameters(self) -> tuple[PlacementParameter, ...]:
        """All placement parameters, six a site that is used."""

    def joint_values(self, joints: FloatArray) -> dict[str, FloatArray]:
        """Return the values of joints of one coordinate, (n,) each in m or rad, by name, from the engine's joints."""

    def site(self, joint: str) -> int:
        """Return the number of the site that displaces a joint's placement.

        Raises:
            UnknownJointError: no site displaces it.
        """


class Engine(Protocol):
    """Closures and transfer matrices of many samples. Which engine does it changes nothing but the time it takes."""

    options: ClosureOptions

    @property
    def structure(self) -> Structure:
        """The mechanism and its sites."""

    @property
    def parameters(self) -> tuple[PlacementParameter, ...]:
        """All placement parameters of the mechanism."""

    def start_at(self, configurations: FloatArray) -> BatchStart:
        """Return Pinocchio configurations, shape (n, nq), as starts."""

    def close(
        self, drives: FloatArray, start: BatchStart, errors: SiteErrors | FloatArray | None = None
    ) -> BatchClosure:
        """Close the loops of every sample.

        Args:
            drives: drive values in the order of the loops file, m or rad, shape (n, drives).
            start: where to start from, of n samples; it also holds the values of locked joints.
            errors: placement errors that displace the mechanism's present placements, as ``perturb_urdf`` does: one set
                for all samples, shape (sites * 6,), translation (m) and rotation vector (rad) site by site; a set for
                each, shape (n, sites * 6); or one displaced site a sample.

        Raises:
            BadInputError: a shape does not fit.
        """

    def transfer(
        self,
        closed: BatchClosure,
        parameters: Sequence[LocalParameter] | None = None,
        errors: SiteErrors | FloatArray | None = None,
    ) -> BatchTransfer:
        """Return the closed chain's G, exact at any residual.

        Args:
            closed: closed samples; those that failed give NaN and keep their status.
            parameters: placement and drive parameters, each a twist at one joint; by default all of :attr:`parameters`.
            errors: the placement errors the samples were closed with.

        Raises:
            UnknownJointError: a parameter names a joint that the engine does not displace.
            BadInputError: a parameter is of another kind, or a shape does not fit.
        """
