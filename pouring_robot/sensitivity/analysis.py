r"""Each error alone, to first order: displacement = G · size, at poses all over the workspace.

``closed chain`` is the robot; ``open branch`` is the paper's eq. 5: one chain, its joints held, as if no other chain
held the end. For a robot without loops both are the same. First order is compared with exact closures of all errors, at
the poses where each moves the robot furthest and at some others, and the largest difference is reported.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pouring_robot.batch import BatchStart, CompiledEngine, SiteErrors, engine_for
from pouring_robot.batch.interface import Engine
from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray, Indices, evenly_spaced
from pouring_robot.mechanism.local_parameters import DriveParameter, PlacementParameter
from pouring_robot.mechanism.rotations import moved_point
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import Parameter, ParameterCatalogue
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.layout import load_layout
from pouring_robot.sensitivity.report import Request, SensitivityReport, ranges
from pouring_robot.sensitivity.samples import ChainKind, ErrorSamples

_AT_ONCE = 1000
_CLOSURES, _CLOSURES_BY_ROW = 10_000, 2000
"""About how many exact closures first order is compared with; an engine that closes row by row is much slower."""


def sensitivity(
    robot: RobotModel | Path | str | None = None, request: Request | None = None, progress: Progress = say_nothing
) -> SensitivityReport:
    """Study the effect of each geometric error alone on a robot as drawn.

    ``robot``: a model, a model file or a robot file; by default the pouring robot. Only the drawing of a model is used:
    a warning says if it has more.

    Raises:
        BadInputError: a name or a range is wrong, or the request is none.
        NoSolutionError: the robot closes at fewer than two poses, or reaches fewer within the ranges.
    """
    model = RobotModel.of(robot)
    if said := left_out(model, "sensitivity", "the model"):
        warnings.warn(said, stacklevel=2)
    return study(model, request, progress)


def left_out(model: RobotModel, who: str, name: str) -> str:
    """Return, in a line, what ``who``, which studies the drawing, leaves out of the model ``name``; "" if nothing."""
    if model.is_drawing and not model.effects and not model.heat:
        return ""
    return f"{who} studies the drawing; errors, effects and heat of {name} are left out"


def study(model: RobotModel, request: Request | None, progress: Progress) -> SensitivityReport:
    """As :func:`sensitivity`, for callers that report :func:`left_out` otherwise."""
    request = request or Request()
    expect(request, Request, "the request of a study is a Request")
    definition = model.definition
    drawing = definition.drawing()
    mechanism = drawing.mechanism
    catalogue = ParameterCatalogue(definition, mechanism)
    parameters = _chosen(catalogue, request)
    sizes = np.array([request.length_m if p.unit == "m" else request.angle_rad for p in parameters])
    frame = request.frame or mechanism.loops.end_frame or mechanism.loops.working_frame
    offset = np.array(mechanism.placement_on_end(frame).translation)
    if isinstance(drawing, FourUPUKinematics):
        drives, start = _from_box(model, drawing, request)
    elif any(request.box):
        raise BadInputError("a range of poses is for the pouring robot; others are studied within their drives' limits")
    else:
        drives, start = definition.workspace(drawing, request.poses)
    if len(start) < 2:
        raise NoSolutionError(f"{definition.name} closes at {len(start)} poses only; check its home and its limits")
    engine = engine_for(mechanism)
    found = _transfers(engine, drives, start, [p.local for p in parameters], offset, progress)
    moves = {kind: np.ascontiguousarray(np.moveaxis(matrix * sizes, 2, 0)) for kind, matrix in found.items()}
    samples = tuple(ErrorSamples(kind, parameters, moved[..., :3], moved[..., 3:]) for kind, moved in moves.items())
    missed, unsolved = _against_exact(engine, drives, start, samples[0], sizes, offset)
    table = catalogue.table.parameters if catalogue.table else ()
    return SensitivityReport(definition.name, frame, request, tuple(parameters), samples, missed, table, unsolved)


def _chosen(catalogue: ParameterCatalogue, request: Request) -> tuple[Parameter, ...]:
    """Return the requested parameters, each once."""
    if request.parameters:
        chosen = {p.name: p for name in request.parameters for p in catalogue.match(name)}
    elif catalogue.table:
        chosen = {p.name: catalogue.parameters[p.name] for p in catalogue.table.selection()}
    else:
        chosen = dict(catalogue.parameters)
    return tuple(chosen.values())


def _from_box(model: RobotModel, kinematics: FourUPUKinematics, request: Request) -> tuple[FloatArray, BatchStart]:
    """Draw poses uniformly from the workspace box, or from the requested ranges."""
    box = np.array(load_layout(model.layout, model.layouts_path).box)
    lower, upper = box.copy()
    for k, limits in enumerate(request.box):
        if limits is not None:
            lower[k], upper[k] = limits
    commands = kinematics.commands(np.random.default_rng(request.seed).uniform(lower, upper, (request.poses, 4)))
    reached = np.flatnonzero(kinematics.in_reach(commands.start))
    if len(reached) < 2 and any(request.box):
        out = f"{len(reached)} of {request.poses} poses drawn within {', '.join(ranges(request.box))} are in reach"
        raise NoSolutionError(f"{out}; the workspace of '{model.layout}' is {', '.join(ranges(tuple(box.T)))}")
    return commands.drives[reached], commands.start[reached]


def _transfers(
    engine: Engine,
    drives: FloatArray,
    start: BatchStart,
    wanted: Sequence[PlacementParameter | DriveParameter],
    offset: FloatArray,
    progress: Progress,
) -> dict[ChainKind, FloatArray]:
    """Return G (n, 6, P) at an offset from the end's origin: of the closed chain and, if there are any, of branches."""
    chains = engine if isinstance(engine, CompiledEngine) and not engine.structure.is_serial else None
    parts: dict[ChainKind, list[FloatArray]] = {"closed chain": [], "open branch": []}
    for first in range(0, len(start), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        found = engine.close(drives[part], start[part]).require_all()
        opened = [chains.transfer_open_branch(found.joints, wanted)] if chains else []
        for own, transfer in zip(parts.values(), (engine.transfer(found, wanted), *opened), strict=False):
            if transfer.status.any():
                mend = "list every driven joint, or narrow the range of poses (of another robot, its joint limits)"
                raise NoSolutionError(f"the drives do not determine the robot at a pose of the workspace; {mend}")
            place = moved_point(transfer.matrix, found.rotation @ offset)
            own.append(np.concatenate([place, transfer.matrix[:, 3:]], axis=1))
        progress("transfer matrices", min(first + _AT_ONCE, len(start)), len(start))
    return {kind: np.concatenate(own) for kind, own in parts.items() if own}


def _against_exact(
    engine: Engine,
    drives: FloatArray,
    start: BatchStart,
    samples: ErrorSamples[Parameter],
    sizes: FloatArray,
    offset: FloatArray,
) -> tuple[tuple[float, float], int]:
    """Return the largest error of first order against exact closures, the robot's movement there, in m, and a count.

    The count is of closures without a solution. Each error is closed at as many poses as possible: half of them where
    it moves the frame furthest, which a few poses would miss, half spread over the others by how far it moves it.
    """
    most = _CLOSURES if isinstance(engine, CompiledEngine) else _CLOSURES_BY_ROW
    each = max(2, most // len(samples.parameters))
    pairs = [(k, pose) for k, moved in enumerate(samples.distance_m) for pose in _strongest_and_spread(moved, each)]
    error, pose = np.array(pairs, dtype=np.intp).T
    places, row = np.unique(pose, return_inverse=True)
    base = engine.close(drives[places], start[places]).require_all()
    shifted, site, twist = drives[pose], np.zeros(len(pose), dtype=np.int64), np.zeros((len(pose), 6))
    for k, parameter in enumerate(samples.parameters):
        own, local = error == k, parameter.local
        if isinstance(local, DriveParameter):
            shifted[own] += sizes[k] * (np.array(engine.structure.mechanism.loops.drives) == local.joint)
        else:
            site[own], twist[own] = engine.structure.site(local.joint), np.array(local.twist) * sizes[k]
    exact = engine.close(shifted, base.as_start()[row], SiteErrors.one_each(site, twist))
    if not exact.closed.any():
        exact.require_all()
    moved = exact.position + exact.rotation @ offset - (base.position + base.rotation @ offset)[row]
    missed = np.where(exact.closed, np.linalg.norm(moved - samples.translation_m[error, pose], axis=1), -1.0)
    at = int(missed.argmax())
    return (float(missed[at]), float(np.linalg.norm(moved[at]))), int(np.count_nonzero(~exact.closed))


def _strongest_and_spread(distance_m: FloatArray, most: int) -> Indices:
    """Return at most so many poses: all; or half where the distance is largest, half evenly by rank from the rest."""
    order = np.argsort(-distance_m, kind="stable")
    if len(order) <= most:
        return order
    first, rest = order[: most // 2], order[most // 2 :]
    return np.concatenate([first, rest[evenly_spaced(len(rest), most - most // 2)]])
