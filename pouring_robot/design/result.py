"""What a plan is and what is to be expected of it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.design.columns import Conditions
from pouring_robot.design.exchange import IntArray
from pouring_robot.design.information import Criterion, observability_index
from pouring_robot.design.parameters import PlannedParameter
from pouring_robot.design.request import PlanRequest
from pouring_robot.estimation.identifiability import BaseParameters
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray


class UndeterminedError(BadInputError):
    """The measurements cannot determine the wanted parameters.

    Attributes:
        groups: parameters that cannot be told apart.
        unseen: parameters without any effect.
        too_many: parameters to leave out, so that the others are determined.
    """

    def __init__(self, what: str, found: BaseParameters, frames: Collection[str]) -> None:
        """Name the combinations and what to leave out."""
        self.groups, self.unseen = found.groups, found.unseen
        self.too_many = tuple(name for name in found.names if name not in found.base and name not in frames)
        parts = []
        for group in self.groups:
            own = [name for name in group.members if name not in frames]
            own += ["the frames of tracker and target"] if len(own) < len(group.members) else []
            parts.append(f"{group.hidden} of {_some(own, ' + ', 6)}")
        parts += [f"{_some(self.unseen, ', ', 4)} (without effect)"] if self.unseen else []
        count = len(found.names) - found.rank
        super().__init__(
            f"{what} cannot determine {count} combination{'s' if count > 1 else ''} of the parameters: "
            f"{_some(parts, '; ', 3)}; leave out {_some(self.too_many, ', ', 6)} (--reduce does so), plan more poses, "
            "or let tolerances count as priors (--priors)"
        )


def _some(names: Sequence[str], between: str, most: int) -> str:
    more = [f"{len(names) - most} more"] if len(names) > most else []
    return between.join([*names[:most], *more])


@dataclass(frozen=True, eq=False)
class PlanQuality:
    """What is to be expected of a fit to a plan; standard deviations in inner units.

    Attributes:
        covariance: of the f frame numbers that can be told apart and the parameters, shape (f + P, f + P).
        parameter_std: of the parameters, shape (P,).
        ladle_poses: poses of the workspace, x y z in m and tilt in rad, shape (g, 4).
        ladle_std: of the pouring lip there, x y z in m and rotation vector in rad, shape (g, 6).
        singular_values: of the plan with the frames projected out, per shown unit (mm, mrad ...), shape (P,).
        poses: number of poses.
    """

    covariance: FloatArray
    parameter_std: FloatArray
    ladle_poses: FloatArray
    ladle_std: FloatArray
    singular_values: FloatArray
    poses: int

    @property
    def ladle_position_std_m(self) -> FloatArray:
        """Root of the summed variances of x, y, z at each workspace pose, shape (g,), in m."""
        return np.asarray(np.linalg.norm(self.ladle_std[:, :3], axis=1))

    @property
    def ladle_rms_m(self) -> float:
        """Standard deviation of the ladle's place: root mean square over the workspace, in m."""
        return float(np.sqrt(np.mean(self.ladle_position_std_m**2)))

    @property
    def ladle_rms_rad(self) -> float:
        """The same of its attitude, in rad."""
        return float(np.sqrt(np.mean(np.sum(self.ladle_std[:, 3:] ** 2, axis=1))))

    @property
    def ladle_worst_m(self) -> float:
        """Largest standard deviation of the ladle's place in the workspace, in m."""
        return float(self.ladle_position_std_m.max())

    @property
    def indices(self) -> dict[str, float]:
        """O1 to O5, by name."""
        names: tuple[Criterion, ...] = ("O1", "O2", "O3", "O4", "O5")
        return {name: float(observability_index(self.singular_values, name, self.poses)) for name in names}


@dataclass(frozen=True, eq=False)
class MeasurementPlan:
    """A plan.

    Attributes:
        request: what was asked for.
        parameters: what is to be determined.
        left_out: names of parameters that were asked for but left out: what is kept shows the same.
        poses: rows in the order to measure them, x y z in m and tilt in rad, shape (rows, 4).
        conditions: of each row.
        pose_numbers: which of the n poses each row is, from 1.
        quality: what is to be expected.
        value: the criterion's index, per shown unit.
        start_values: the index that each start of the search reached.
    """

    request: PlanRequest
    parameters: tuple[PlannedParameter, ...]
    left_out: tuple[str, ...]
    poses: FloatArray
    conditions: tuple[Conditions, ...]
    pose_numbers: IntArray
    quality: PlanQuality
    value: float
    start_values: tuple[float, ...]
