"""Whitened rows from poses and conditions, by G of the closed chain, and the poses to choose from."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.stats import qmc

from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.campaign.simulate import metadata_of
from pouring_robot.design.request import PlannedParameter
from pouring_robot.effects.conditions import slide_offsets_m
from pouring_robot.effects.nominal_rows import loads_on, nominal_rows
from pouring_robot.estimation.frames.outer import FRAMES, OuterFrames
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.io.temperatures import REFERENCE_DEGC, reference_degC
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, grid
from pouring_robot.robot.description.command import CommandAxis, command_box
from pouring_robot.robot.robot import Robot

_EDGE_LEVELS = 3
_Parts = tuple[FloatArray, FloatArray, Mapping[float, FloatArray], FloatArray]


@dataclass(frozen=True)
class PlannedConditions:
    """How a pose is visited."""

    side: int = 1  # +1: every drive was rising when it stopped, -1: falling, 0: not stated
    payload_kg: float = 0.0  # for the pouring robot the melt in its ladle
    drive_degC: float = REFERENCE_DEGC


class Columns:
    """Rows of the Jacobian for poses and conditions. The outer frame's axes are assumed to be the fixed platform's."""

    def __init__(self, robot: Robot, parameters: Sequence[PlannedParameter]) -> None:
        nominal = robot.nominal_solver.mechanism
        self.robot, self.parameters = robot, tuple(parameters)
        self.local = [p.local for p in parameters if p.kind == "local"]
        self.drives = robot.parameters.drives
        self._model = MeasurementModel(robot.model, self.local)
        self._lip_m = np.array(nominal.T_end_tool.translation)
        self._facts = CampaignMetadata(**metadata_of(robot))

    def reachable(self, poses: FloatArray) -> BoolArray:
        """Return which commands (n, k), in m and rad, are within joint limits; shape (n,)."""
        return self.robot.drawing.in_reach(self.robot.drawing.commands(poses).start)

    def measured(
        self, poses: FloatArray, conditions: Sequence[PlannedConditions], noise: NoiseLevel, target_m: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return whitened rows of n poses (n, k), in m and rad, under each of c conditions, and which poses close.

        The noise of the device decides how many components k a pose has; ``target_m`` is the position of the target on
        the moving platform, (3,). Shapes (n, c, k, 12 + P), per m, rad, m/N ... of each unknown, and (n,).
        """
        parts, closed = self._parts(poses, conditions, target_m)
        sigma = noise.sigma
        rows = np.stack([self._row(c, *parts) for c in conditions], axis=1)
        return rows[:, :, : len(sigma)] / sigma[:, None], closed

    def ladle(self, poses: FloatArray, conditions: PlannedConditions) -> tuple[FloatArray, BoolArray]:
        """Return how the working frame moves per unit of each unknown at n poses (n, k), and which close, (n,).

        It is expressed in the tracker's frame and fixed to the target. Shape (n, 6, 12 + P): displacement in m,
        rotation vector in rad. At side 0 it is the mean of both sides.
        """
        parts, closed = self._parts(poses, [conditions], self._lip_m)
        return self._row(conditions, *parts), closed

    def _parts(
        self, poses: FloatArray, conditions: Sequence[PlannedConditions], target_m: FloatArray
    ) -> tuple[_Parts, BoolArray]:
        """Return the parts of rows (see :meth:`_row`) and which poses close, (n,)."""
        command = self.robot.drawing.commands(poses)
        modelled = self._model.at(command.drives, command.start)
        frames = OuterFrames(pin.SE3.Identity(), pin.SE3(np.eye(3), np.asarray(target_m, dtype=float)))
        seen = modelled.linearise(Unknowns.zero(frames, len(self.local)))
        # The drives may be among the parameters already, where none may be given twice.
        drives = modelled.with_parameters(self.drives).linearise(Unknowns.zero(frames, len(self.drives)))
        base, by_drive = (np.nan_to_num(part.derivatives) for part in (seen, drives))
        closed = seen.closed & drives.closed
        forces = self._forces(modelled, closed, (visit.payload_kg for visit in conditions))
        return (
            base,
            by_drive[:, :, FRAMES:],
            forces,
            command.drives + slide_offsets_m(self.robot.model.definition),
        ), closed

    def _forces(
        self, modelled: ModelledRows, closed: BoolArray, payloads_kg: Iterable[float]
    ) -> dict[float, FloatArray]:
        """Return the forces of each payload and the links' own weight on every drive, (n, D), as effects have them.

        They are computed for closed rows, if compliances are planned; otherwise zero.
        """
        forces = {payload: np.zeros((len(modelled), len(self.drives))) for payload in payloads_kg}
        if closed.any() and any(parameter.kind == "compliance" for parameter in self.parameters):
            nominal = nominal_rows(self.robot.model.definition, *modelled[closed].by_drawing())
            for payload, force in forces.items():
                _, force[closed], *_ = loads_on(nominal, self._facts, np.full(len(nominal.position_m), payload))
        return forces

    def _row(
        self,
        conditions: PlannedConditions,
        base: FloatArray,
        drives: FloatArray,
        forces: Mapping[float, FloatArray],
        spans: FloatArray,
    ) -> FloatArray:
        """Return columns of all unknowns, (n, 6, 12 + P).

        ``base`` has those of frames and local parameters, ``drives`` those of the drives; ``forces`` are on these, by
        payload, and ``spans`` are their lengths.
        """
        rows = np.empty((len(base), 6, FRAMES + len(self.parameters)))
        rows[:, :, : base.shape[2]] = base
        force = forces[conditions.payload_kg]
        for k, parameter in enumerate(self.parameters[len(self.local) :], start=base.shape[2]):
            drive = [d.joint for d in self.drives].index(parameter.local.joint)
            column = drives[:, :, drive]
            if parameter.kind == "backlash":
                rows[:, :, k] = -0.5 * conditions.side * column
            elif parameter.kind == "compliance":
                rows[:, :, k] = column * force[:, drive, None]
            else:
                warmth = conditions.drive_degC - reference_degC(self._facts.reference_temperature_degC)
                rows[:, :, k] = column * (warmth * spans[:, drive])[:, None]
        return rows


def candidate_poses(axes: Sequence[CommandAxis], count: int) -> FloatArray:
    """Return commands that fill the workspace: its corners, edges and middles, and a Sobol sequence between.

    There are about ``count``, but at least the corners, edges and middles, where these are no more than a third. They
    are round figures within the limits, so that the plan's file states exactly what was planned, none twice; shape (n,
    k), in m and rad.
    """
    lower, upper = command_box(axes)
    levels = np.linspace(0.0, 1.0, _EDGE_LEVELS)
    edges = _EDGE_LEVELS ** len(axes) <= max(count / 3, _EDGE_LEVELS**4)
    marked = grid(*[levels] * len(axes)) if edges else np.empty((0, len(axes)))
    wanted = max(0, count - len(marked))
    filled = qmc.Sobol(len(axes), scramble=False).random_base2(int(np.ceil(np.log2(wanted + 1))))[:wanted]
    step, zero = np.array([(axis.step, axis.value(0.0)) for axis in axes]).T
    poses = lower + (upper - lower) * np.concatenate([marked, filled])
    least, most = np.ceil((lower - zero) / step - 1e-9), np.floor((upper - zero) / step + 1e-9)
    whole = np.clip(np.round((poses - zero) / step), least, most)
    _, first = np.unique(whole, axis=0, return_index=True)
    return np.asarray(zero + whole[np.sort(first)] * step)
