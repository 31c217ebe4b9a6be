"""The study of the paper's section 4: every geometric error alone, at many poses, at the platform's centre o.

    study = run_study("paper", count=10_000, seed=2022)
    study.open_branch.of_chain(1).reaching(1e-3)       # which errors move o by more than 1 mm in a coordinate
    study.closed_chain.of_chain(1).reaching(1e-3)      # and which do once all four chains hold the platform

``open branch`` is the paper's model: one chain, its joints held. ``closed chain`` is the robot. Both are exact, not
first order. The paper's statements are judged in the modules ``parameter_claims``, ``size_claims`` and
``shape_claims``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.batch import BatchCommand
from pouring_robot.exceptions import BadInputError
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.robot.dh.table import DHParameter, DHTable
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.layout import load_layout
from pouring_robot.robot.pouring.layout_schema import Layout
from pouring_robot.sensitivity import samples
from scripts.paper.geometry.closure import ClosedChainStudy, rotation_vectors

LENGTH_ERROR_M = 0.2 * MM
"""Size of every length error in the paper's section 4.3."""
ANGLE_ERROR_RAD = 4.0 * MRAD
"""Size of every angle error there."""
POSITION_BOUNDARY_M = 1e-3 * MM
"""Below this order of magnitude the paper calls a position error negligible (section 4.3)."""
ATTITUDE_BOUNDARY_RAD = 1e-5
"""Likewise an attitude error."""
PILE_M = 1.3175 * MM
"""Where section 4.4 sees position errors pile up."""
NAMED_SENSITIVE = ("α01", "α12", "α23", "α34", "α56", "θ1")
"""The six parameters that section 4.4 names beside Fig. 5; the seventh has a misprinted name."""


class ErrorSamples(samples.ErrorSamples[DHParameter]):
    """How each error of the DH table alone moves the platform, and what the paper asks of that."""

    def of_chain(self, chain: int) -> ErrorSamples:
        """Return the samples of one chain's errors."""
        return self.subset([parameter for parameter in self.parameters if parameter.chain == chain])

    def of_unit(self, unit: str) -> ErrorSamples:
        """Return the samples of the lengths (``m``) or the angles (``rad``)."""
        return self.subset([parameter for parameter in self.parameters if parameter.unit == unit])

    def reaching(self, limit_m: float) -> ErrorSamples:
        """Return the samples of the errors that pass a limit in one coordinate at one pose at least."""
        tops = self.peak_m.max(axis=1)
        return self.subset([p for p, top in zip(self.parameters, tops, strict=True) if top > limit_m])

    def along(self, label: str) -> FloatArray:
        """Return the translations of one error along its main direction, shape (n,), in m; 0 if it moves nothing."""
        axis = samples.AXES.find(self.main_axis(label))
        return np.asarray(self.moves(label)[:, axis] if axis >= 0 else np.zeros(len(self.moves(label))))

    def spread_m(self, label: str) -> float:
        """Return how far one error's translations scatter about their mean, root of the summed variances, in m."""
        return float(np.sqrt(self.moves(label).var(axis=0).sum()))

    @functools.cached_property
    def rms_m(self) -> FloatArray:
        """Root mean square coordinate over the poses, shape (P, 3), in m."""
        return np.asarray(np.sqrt(np.square(self.translation_m).mean(axis=1)))


def error_size(parameter: DHParameter) -> float:
    """Return the paper's size of an error, in m or rad."""
    return LENGTH_ERROR_M if parameter.unit == "m" else ANGLE_ERROR_RAD


def draw_poses(
    layout: Layout, kinematics: FourUPUKinematics, count: int, seed: int, tilt_sign: float = 1.0
) -> BatchCommand:
    """Draw poses uniformly from the workspace box of a layout; ``tilt_sign`` −1 turns its tilt over.

    Raises:
        BadInputError: fewer than two poses are asked for, or the seed is negative.
    """
    if count < 2 or seed < 0:
        raise BadInputError(f"give at least two poses and a seed from 0 on, not {count} poses and seed {seed}")
    poses = np.random.default_rng(seed).uniform(*layout.box, (count, 4))
    return kinematics.commands(poses * np.array([1.0, 1.0, 1.0, tilt_sign]))


@dataclass(frozen=True, eq=False)
class OpenStudy:
    """What the claims on open branches are judged by.

    Attributes:
        layout_name: of the robot.
        layout: its sizes.
        table: its DH table.
        seed: that the poses were drawn with.
        command: the poses where the errors were put in.
        open_branch: each of the parameters that do not drop out, in its chain alone.
        lip_lever_m: distance from o to the pouring lip, in m.
    """

    layout_name: str
    layout: Layout
    table: DHTable
    seed: int
    command: BatchCommand
    open_branch: ErrorSamples
    lip_lever_m: float


@dataclass(frozen=True, eq=False)
class GeometryStudy(OpenStudy):
    """Everything the claims are judged by.

    Attributes:
        closed_chain: the errors of ``open_branch`` in the closed mechanism.
        closure: what else the closed mechanism was asked.
        together_m: translation of o in chain 1 alone with all its errors at once, shape (n, 3), in m.
        reproduction_m: largest distance between the DH table's poses and the nominal ones, in m.
    """

    closed_chain: ErrorSamples
    closure: ClosedChainStudy
    together_m: FloatArray
    reproduction_m: float


def run_open_study(model: RobotModel, count: int, seed: int, *, chain: int | None, tilt_sign: float = 1.0) -> OpenStudy:
    """Put every error of the paper's size into its open branch, at poses drawn from the workspace.

    Args:
        model: for its layout.
        count: poses.
        seed: of the drawing.
        chain: only this chain's errors; None: of all.
        tilt_sign: −1 reads the paper's tilt r the other way round.

    Raises:
        BadInputError: there is no such layout, fewer than two poses are asked for, or the seed is negative.
    """
    layout = load_layout(model.layout, model.layouts_path)
    mechanism = model.definition.mechanism()
    table = DHTable.from_mechanism(mechanism)
    command = draw_poses(layout, FourUPUKinematics(mechanism), count, seed, tilt_sign)
    errors = open_branch_errors(table, table.selection(chain=chain), command)
    return OpenStudy(model.layout, layout, table, seed, command, errors, _lip_lever(mechanism))


def run_study(layout_name: str, count: int, seed: int, progress: Progress = say_nothing) -> GeometryStudy:
    """Put every error of the paper's size into the robot, one at a time, at poses drawn from its workspace.

    Args:
        layout_name: of the shipped dimensions file.
        count: poses.
        seed: of the drawing.
        progress: told of every closed error.

    Raises:
        UnknownLayoutError: there is no such layout.
        BadInputError: fewer than two poses are asked for, or the seed is negative.
        BatchClosureError: the closed mechanism finds no equilibrium at a pose.
    """
    model = RobotModel(layout=layout_name)
    opened = run_open_study(model, count, seed, chain=None)
    table, command, parameters = opened.table, opened.command, opened.open_branch.parameters
    sizes = np.array([error_size(parameter) for parameter in parameters])
    closure = ClosedChainStudy(model.definition.mechanism(), table, command)
    closed = ErrorSamples("closed chain", parameters, *closure.exact(parameters, sizes, progress))
    missed = [_branch(table, i, command)[:, :3, 3] - command.start.position for i in table.chains]
    own = {parameter.name: error_size(parameter) for parameter in table.selection(chain=1)}
    return GeometryStudy(
        **vars(opened),
        closed_chain=closed,
        closure=closure,
        together_m=_branch(table, 1, command, own)[:, :3, 3] - command.start.position,
        reproduction_m=float(np.linalg.norm(missed, axis=-1).max()),
    )


def open_branch_errors(table: DHTable, parameters: Sequence[DHParameter], command: BatchCommand) -> ErrorSamples:
    """Return how each error moves o when its chain hangs alone with its joints held, as in the paper."""
    nominal = command.start
    translation, rotation = np.zeros((2, len(parameters), len(command), 3))
    for k, parameter in enumerate(parameters):
        moved = _branch(table, parameter.chain, command, {parameter.name: error_size(parameter)})
        translation[k] = moved[:, :3, 3] - nominal.position
        rotation[k] = rotation_vectors(moved[:, :3, :3] @ np.swapaxes(nominal.rotation, 1, 2))
    return ErrorSamples("open branch", tuple(parameters), translation, rotation)


def _branch(table: DHTable, chain: int, command: BatchCommand, errors: Mapping[str, float] | None = None) -> FloatArray:
    """Return the poses of o that one chain alone gives with its nominal joint values, homogeneous, (n, 4, 4)."""
    return table.chain_poses(chain, command.start.joints[:, chain - 1], errors)


def _lip_lever(mechanism: ClosedChainMechanism) -> float:
    """Return the distance from o to the pouring lip, in m; both are on one body."""
    data = mechanism.shared_model.createData()
    pin.framesForwardKinematics(mechanism.shared_model, data, mechanism.neutral_configuration())
    platform, lip = (data.oMf[mechanism.frame_id(name)] for name in ("moving_platform", "ladle_lip"))
    return float(np.linalg.norm(lip.translation - platform.translation))
