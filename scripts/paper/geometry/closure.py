"""Figures of the closed mechanism for the study: exact closures with one error each, first-order effects, and ranks."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pouring_robot.batch import BatchCommand, CompiledEngine, SiteErrors
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.local_parameters import placement_parameters
from pouring_robot.robot.dh.table import DHParameter, DHTable

_CHECKED_POSES = 1000
"""First order and ranks are taken at the first poses only; they need no more."""
_RANK_TOLERANCE = 1e-9  # singular values end above 1e-7 of the largest and go on below 1e-10
_LEVER_M = 0.3  # makes rotations lengths, so that one tolerance serves the six rows of G
_PASSIVE_ERROR = 4e-3  # of a passive joint, m or rad


class Ranks(NamedTuple):
    """How many combinations of errors the platform's pose tells apart, over all checked poses together.

    Attributes:
        placements: of all six displacements of all joint placements and all DH errors.
        table: of all DH errors.
        kept: of the DH errors that do not drop out.
    """

    placements: int
    table: int
    kept: int


class ClosedChainStudy:
    """The nominal mechanism at many poses, ready to be given errors.

    Args:
        mechanism: the nominal robot.
        table: its DH table.
        command: the poses.
    """

    def __init__(self, mechanism: ClosedChainMechanism, table: DHTable, command: BatchCommand) -> None:
        """Take what is given; all work is done when it is asked for."""
        self._engine, self._table, self._command = CompiledEngine(mechanism), table, command
        self._left_open = np.zeros(2)

    @property
    def left_open(self) -> tuple[float, float]:
        """Largest gap and angle left open by any closure so far, in µm and mrad."""
        return float(self._left_open[0]) * 1e6, float(self._left_open[1]) * 1e3

    def exact(
        self,
        parameters: Sequence[DHParameter],
        sizes: FloatArray,
        progress: Progress = say_nothing,
        poses: int | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Close the mechanism with one error at a time, its drives at their nominal values.

        Args:
            parameters: the errors, P of them.
            sizes: in m or rad, shape (P,).
            progress: told of every closed error.
            poses: how many of the first poses; by default all.

        Returns:
            Translations in m and rotation vectors in rad of o, in the axes of O; shape (P, poses, 3) each.

        Raises:
            BatchClosureError: there is no equilibrium at a pose.
        """
        command = self._command[:poses]
        nominal = command.start
        translation, rotation = np.zeros((2, len(parameters), len(command), 3))
        for k, (parameter, size) in enumerate(zip(parameters, sizes, strict=True)):
            errors = self._site_errors(parameter, float(size), len(command))
            closed = self._engine.close(command.drives, nominal, errors).require_all()
            translation[k] = closed.position - nominal.position
            rotation[k] = rotation_vectors(closed.rotation @ np.swapaxes(nominal.rotation, 1, 2))
            gaps = np.linalg.norm(closed.residual.reshape(-1, 2, 3), axis=-1).max(axis=0)
            self._left_open = np.maximum(self._left_open, gaps)
            progress("closing the loops with one error each", k + 1, len(parameters))
        return translation, rotation

    def first_order(self, parameters: Sequence[DHParameter], sizes: FloatArray) -> FloatArray:
        """Return the translations that G gives at the first (up to 1000) poses, shape (P, poses, 3), in m."""
        twists = self._twists(parameters)
        return np.asarray(np.moveaxis(self._transfer[:, :3] @ (twists * sizes), -1, 0))

    @functools.cached_property
    def ranks(self) -> Ranks:
        """Ranks of G over the checked poses; see :class:`Ranks`."""
        table = self._transfer @ self._twists(self._table.parameters)
        kept = np.array([not parameter.drops_out for parameter in self._table.parameters])
        return Ranks(_rank(np.concatenate([table, self._transfer], axis=2)), _rank(table), _rank(table[:, :, kept]))

    @functools.cached_property
    def passive_effect_m(self) -> float:
        """Largest distance by which an error of 4 mrad or 4 mm of a passive joint variable moves o, in m."""
        passive = [p for p in self._table.parameters if p.role == "joint variable"]
        sizes = np.full(len(passive), _PASSIVE_ERROR)
        return float(np.linalg.norm(self.exact(passive, sizes, poses=_CHECKED_POSES)[0], axis=-1).max())

    def _twists(self, parameters: Sequence[DHParameter]) -> FloatArray:
        """Return the linear map (6 · joints, parameters) from small DH errors to displaced joints of the table."""
        matrix = np.zeros((len(self._table.joints), 6, len(parameters)))
        for k, parameter in enumerate(parameters):
            matrix[self._table.joints.index(parameter.joint), :, k] = parameter.twist
        return matrix.reshape(-1, len(parameters))

    def _site_errors(self, parameter: DHParameter, size: float, count: int) -> SiteErrors:
        """Return the displaced joint placement that equals one DH error, exactly, for all samples."""
        ((joint, error),) = self._table.placement_errors({parameter.name: size}).items()
        site = self._engine.structure.site(joint)
        displacement = np.concatenate([error.translation, pin.log3(error.rotation)])
        return SiteErrors.one_each(np.full(count, site), np.tile(displacement, (count, 1)))

    @functools.cached_property
    def _transfer(self) -> FloatArray:
        """G by the six displacements of each joint of the table, shape (checked poses, 6, 6 · joints)."""
        command = self._command[:_CHECKED_POSES]
        closed = self._engine.close(command.drives, command.start).require_all()
        return self._engine.transfer(closed, placement_parameters(self._table.joints)).matrix


def rotation_vectors(rotations: FloatArray) -> FloatArray:
    """Return the rotation vectors (n, 3) in rad of rotation matrices (n, 3, 3) that turn by less than 90°."""
    skew = 0.5 * (rotations - np.swapaxes(rotations, 1, 2))
    vectors = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
    sine = np.linalg.norm(vectors, axis=-1, keepdims=True)
    turned = sine > 0.0
    return np.asarray(vectors * np.where(turned, np.arcsin(np.minimum(sine, 1.0)) / np.where(turned, sine, 1.0), 1.0))


def _rank(transfer: FloatArray) -> int:
    rows = transfer.copy()
    rows[:, 3:] *= _LEVER_M
    # The singular values of a tall matrix are those of its triangle.
    triangle = np.linalg.qr(rows.reshape(-1, rows.shape[-1]), mode="r")
    values = np.linalg.svd(triangle, compute_uv=False)
    return int((values > _RANK_TOLERANCE * values[0]).sum())
