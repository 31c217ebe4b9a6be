"""A prepared sweep: the file resolved for the robot, divided into chunks that can each be computed anywhere.

Its commands are a grid, random poses or a list, all within the robot's reach.
"""

import functools
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import pinocchio as pin

import pouring_robot
from pouring_robot.batch import BatchClosure, BatchCommand, CompiledEngine, Engine, engine_for
from pouring_robot.batch.structure import ByteArray
from pouring_robot.exceptions import NoSolutionError, PathPoseError, UnknownFrameError
from pouring_robot.io.seeds import spawned
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, grid
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.status import CLOSED
from pouring_robot.mechanism.rotations import rotation_vectors
from pouring_robot.robot.description.command import command_box
from pouring_robot.robot.description.drawing import agreed
from pouring_robot.robot.location import as_poses
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot, robot_of
from pouring_robot.robot.robot import Robot
from pouring_robot.sweeps.config import Box, Grouping, SweepConfig
from pouring_robot.sweeps.draws import Draws, ErrorMap, completed, select

_MOST_ROUNDS = 20


@dataclass(frozen=True)
class Chunk:
    """A block of robots (samples) at a block of poses, and its index by both."""

    index: tuple[int, int]
    samples: slice
    poses: slice


@dataclass(frozen=True, eq=False)
class ChunkResult:
    """Results of one chunk; NaN where the status is not 0."""

    displacement: FloatArray  # with minus without the errors, shape (samples, poses, frames, 3), in m
    rotation: FloatArray  # the same as rotation vector, shape (samples, poses, 3), in rad
    gap_m: FloatArray  # largest distance left open in a loop, shape (samples, poses)
    gap_rad: FloatArray  # largest angle, of the same shape
    status: ByteArray  # see :data:`~pouring_robot.sweeps.store.STATUS_NAMES`, of the same shape
    errors: FloatArray  # the errors of each robot, shape (samples, parameters), in m and rad
    version: str  # of the package that computed it


class SweepPlan:
    """A sweep, ready to be computed; ``threads`` share the work of a chunk, None: all available.

    Raises:
        BadInputError: a name in it does not fit the robot, correlated errors would be in different groups, or a file
            that it names is wrong.
        UnreachablePoseError: a pose is out of reach.
    """

    def __init__(self, config: SweepConfig) -> None:
        self.threads: int | None = None
        self.model = _model(config)
        robot = robot_of(self.model)
        self.mechanism: ClosedChainMechanism = robot.actual_solver.mechanism
        self.catalogue = robot.parameters
        self.config = config = completed(config, self.catalogue, self.model.definition)
        self.parameters = select(self.catalogue, config)
        self.draws = Draws.of(config, self.parameters)
        self._refuse_many_chains()
        if config.allocation:
            self.groups(config.allocation.by)
        self.tool_offsets_m = self._tool_offsets(self.mechanism)
        accuracy_m = robot.accuracy_m if config.accuracy_mm is None else config.accuracy_mm * MM
        if accuracy_m is None:
            raise config.problem("accuracy_mm is missing: this robot has no required accuracy")
        self.accuracy_m: float = accuracy_m
        self.poses: BatchCommand = sweep_commands(config, robot)
        self.pose_block = min(len(self.poses), config.chunk)
        self.sample_block = min(self.draws.count, config.chunk // self.pose_block)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a sweep file and prepare it.

        Raises:
            DescriptionError: the file is wrong; or as the constructor.
        """
        return cls(SweepConfig.load(path))

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to pickle: without compiled engines; files need not exist elsewhere."""
        return {name: value for name, value in self.__dict__.items() if name not in {"engine", "error_map"}}

    @property
    def off(self) -> str:
        """What displacements are, in words: those of a model's robot are from its pose without the sweep's errors."""
        return "off" if self.config.model is None else f"off its place in {Path(self.config.model).name}"

    @functools.cached_property
    def own_error_m(self) -> float | None:
        """Largest distance of the robot without the sweep's errors from its commanded poses, at its first frame.

        None where it closes at no pose.
        """
        start, without = self.poses.start, self._without
        drawn, built = self._tool_offsets(self.model.definition.mechanism())[0], self.tool_offsets_m[0]
        wanted = start.position + start.rotation @ drawn
        distance = np.linalg.norm(without.position + without.rotation @ built - wanted, axis=-1)
        return float(np.nanmax(distance)) if np.isfinite(distance).any() else None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the columns."""
        return tuple(p.name for p in self.parameters)

    @property
    def chunk_grid(self) -> tuple[int, int]:
        """Number of chunks by sample and by pose."""
        return -(-self.draws.count // self.sample_block), -(-len(self.poses) // self.pose_block)

    def chunks(self) -> Iterator[Chunk]:
        """Yield all chunks, in order."""
        for index in np.ndindex(self.chunk_grid):
            yield self.chunk(index)

    def chunk(self, index: tuple[int, int]) -> Chunk:
        """Return the chunk at an index of the grid."""
        blocks = zip(index, (self.sample_block, self.pose_block), (self.draws.count, len(self.poses)), strict=True)
        return Chunk(index, *(slice(k * size, min((k + 1) * size, count)) for k, size, count in blocks))

    def compute(self, chunk: Chunk) -> ChunkResult:
        """Compute one chunk; the results depend on the plan and the chunk only."""
        return self.moved(self.draws.values(chunk.samples.start, chunk.samples.stop), self.poses[chunk.poses])

    def moved(self, values: FloatArray, poses: BatchCommand) -> ChunkResult:
        """Return the displacements of robots at poses by errors (robots, parameters), in m and rad, by exact closures.

        A pose at which the robot does not close without the errors has no reference and so no solution.
        """
        position, axes = poses.start.position, poses.start.rotation  # without the errors of the sweep
        status_without = np.full(len(poses), CLOSED, dtype=np.uint8)
        if self.config.model is not None:
            without = self._without_errors(poses)
            position, axes, status_without = without.position, without.rotation, without.status
        closed, shape, offsets = self.closed(values, poses), (len(values), len(poses)), self.tool_offsets_m
        rotation = closed.rotation.reshape(*shape, 3, 3)
        found = closed.position.reshape(*shape, 1, 3) + np.einsum("spij,fj->spfi", rotation, offsets)
        moved = np.asarray(found - (position[:, None] + np.einsum("pij,fj->pfi", axes, offsets)))
        turned = rotation_vectors(rotation, since=axes)
        loops = closed.residual.shape[1]  # zero for a serial arm
        gaps = np.linalg.norm(closed.residual.reshape(*shape, loops, 2, 3), axis=-1).max(axis=2, initial=0.0)
        status = closed.status.reshape(shape)
        status = np.where(status == CLOSED, status_without, status)
        gaps[status != CLOSED] = np.nan
        return ChunkResult(moved, turned, gaps[..., 0], gaps[..., 1], status, values, pouring_robot.__version__)

    def within(self, status: ByteArray, distance_m: FloatArray) -> BoolArray:
        """Return which samples (...) keep the required accuracy; those without a solution do not."""
        return np.asarray((status == CLOSED) & (distance_m <= self.accuracy_m))

    def groups(self, by: Grouping) -> tuple[int, ...]:
        """Return for each parameter the index of its group, whose tolerances are scaled together."""
        keys = [{"parameter": p.name, "part": p.part, "entry": str(p.entry)}[by] for p in self.parameters]
        names = list(dict.fromkeys(keys))
        owner: dict[str, str] = {}
        for p, key, shared in zip(self.parameters, keys, self.draws.shared, strict=True):
            if shared and owner.setdefault(p.part, key) != key:
                raise self.config.problem(
                    f"allocation by {by}: errors of {p.part} are correlated, so their tolerances must be scaled "
                    "together; use 'by: part', or leave correlation out"
                )
        return tuple(names.index(key) for key in keys)

    def closed(self, values: FloatArray, poses: BatchCommand) -> BatchClosure:
        """Return robots with errors (robots, parameters; m, rad) closed at poses, robot by robot.

        An open branch is only the chain with the robot's errors, its joints held at the nominal robot's values, as in
        the paper's Section 4.
        """
        engine, robots = self.engine, len(values)
        robot, pose = (index.ravel() for index in np.indices((robots, len(poses))))
        placed = np.zeros((robots, engine.structure.site_count, 6))
        sites = [engine.structure.site(joint) for joint in self.error_map.joints]
        placed[:, sites] = self.error_map.placement_errors(values)
        flat = placed.reshape(robots, -1)
        of_all = flat[0] if robots == 1 else flat[robot]
        drives = self.model.actual_drive_values(poses.drives)[pose] + self.error_map.drive_errors(values)[robot]
        if self.config.kind == "open_branch":
            assert isinstance(engine, CompiledEngine)  # only a star has a DH table of its chains
            chains = np.array([p.chain - 1 for p in self.parameters])
            chain_of_robot = chains[(values != 0.0).argmax(axis=1)]  # all errors of a robot are in one
            return engine.carry(chain_of_robot[robot], drives, poses.start[pose], of_all)
        return engine.close(drives, poses.start[pose], of_all)

    @functools.cached_property
    def error_map(self) -> ErrorMap:
        """Map from parameter values to errors of joints and drives."""
        return ErrorMap(self.catalogue, self.parameters)

    @functools.cached_property
    def engine(self) -> Engine:
        """Engine that closes robots."""
        return engine_for(self.mechanism, self.threads)

    @functools.cached_property
    def content(self) -> dict[str, Any]:
        """Everything that results and their layout depend on; texts of files as SHA-256."""
        excluded = {"description", "allocation", "accuracy_mm", "model", "robot"}
        config = self.config.model_dump(mode="json", exclude=excluded)
        extra = {"drive_offsets": self.model.drive_offset_values(), "home": self.model.definition.file.home}
        return {
            "config": config,
            "parameters": list(self.names),
            "urdf": _digest(self.mechanism.urdf.encode()),
            **{name: values for name, values in extra.items() if values},
            "loops": _digest(self.mechanism.loops.model_dump_json().encode()),
            "poses": _digest(self.poses.poses.tobytes()),
            "version": pouring_robot.__version__,
        }

    @functools.cached_property
    def content_hash(self) -> str:
        """SHA-256 of :attr:`content`: two plans with the same hash give the same results."""
        return _digest(json.dumps(self.content, sort_keys=True).encode())

    @property
    def closing(self) -> BatchCommand:
        """Poses at which the robot closes without the errors of the sweep; all for the nominal robot."""
        return self.poses if self.config.model is None else self.poses[np.flatnonzero(self._without.closed)]

    @functools.cached_property
    def _without(self) -> BatchClosure:
        return self._without_errors(self.poses)

    def _without_errors(self, poses: BatchCommand) -> BatchClosure:
        return self.closed(np.zeros((1, len(self.parameters))), poses)

    def _refuse_many_chains(self) -> None:
        if self.config.kind != "open_branch":
            return
        if self.catalogue.table is None:
            raise self.config.problem("an open branch needs a robot with a DH table of its chains; use 'closed_chain'")
        chains = sorted({p.chain for p in self.parameters})
        if self.config.study != "one_at_a_time" and len(chains) > 1:
            raise self.config.problem(
                f"an open branch is one chain alone, but the errors lie in chains {', '.join(map(str, chains))}; "
                "choose those of one chain, or kind 'closed_chain'"
            )

    def _tool_offsets(self, mechanism: ClosedChainMechanism) -> FloatArray:
        """Return the origins of the observed frames in the moving platform, shape (frames, 3), in m."""
        frames = mechanism.shared_model.frames
        end = frames[mechanism.frame_id(mechanism.loops.end_frame or "")]
        bodies = {f.name for f in frames if f.type == pin.FrameType.BODY and f.parentJoint == end.parentJoint}
        for name in self.config.frames:
            if name not in bodies:
                raise self.config.problem(f"frames: {UnknownFrameError(name, bodies)}")
        return np.array([mechanism.placement_on_end(name).translation for name in self.config.frames])


def _model(config: SweepConfig) -> RobotModel:
    if config.model:
        return RobotModel.load(config.beside(config.model))
    if config.robot:
        return RobotModel.for_robot(config.beside(config.robot))
    return RobotModel(layout=config.layout) if config.layout else RobotModel()


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def sweep_commands(config: SweepConfig, robot: Robot) -> BatchCommand:
    """Return the commands of a sweep, with their drive values and the closed nominal poses.

    Raises:
        TableError: the file of poses is wrong.
        UnreachablePoseError: a joint would exceed its limits at a pose; PathPoseError: at a pose from a file.
    """
    if not isinstance(robot, PouringRobot):
        return _driven(config, robot)
    wanted, lines = _wanted(config, robot)
    commands = robot.kinematics.commands(wanted)
    beyond = ~robot.kinematics.in_reach(commands.start)
    if beyond.any():
        first = int(np.argmax(beyond))
        try:
            robot.kinematics.inverse(robot.command_at(commands.poses[first]))  # raises, and names the joint
        except NoSolutionError as error:
            if not lines:
                raise
            raise PathPoseError(config.beside(str(config.poses.file)), lines[first], error) from error
    return commands


def _driven(config: SweepConfig, robot: Robot) -> BatchCommand:
    """Return drive values from a file, or drawn uniformly between the drives' limits where the robot closes.

    Redundant drive values that are drawn are adjusted until they agree.
    """
    choice, drawing = config.poses, robot.drawing
    if choice.grid is not None or (choice.random is not None and choice.random.box != Box()):
        raise config.problem("grid and box are of the pouring robot; give random: {count, seed}, or a file of drives")
    if choice.random is None:
        listed = robot.read_commands(config.beside(str(choice.file)))
        if not all(isinstance(command, np.ndarray) for command in listed.values()):
            raise config.problem("poses.file: give a column for each drive")
        commands = drawing.commands(np.array(list(listed.values())))
        lost = ~_stands(robot, commands)
        if lost.any():
            line = list(listed)[int(np.argmax(lost))]
            raise config.problem(
                f"poses.file: line {line}: the robot does not close there, or only beyond a joint's limits"
            )
        return commands
    generator, count = spawned(choice.random.seed, "poses"), choice.random.count
    box = command_box(robot.command_axes)
    found = np.empty((0, box[0].size))
    for _ in range(_MOST_ROUNDS):
        drawn, agree = agreed(drawing, generator.uniform(*box, size=(count, box[0].size)))
        found = np.concatenate([found, drawn[agree & _stands(robot, drawing.commands(drawn))]])
        if len(found) >= count:
            return drawing.commands(found[:count])
    raise config.problem("hardly any drive values close within the joint limits; give poses.file")


def _stands(robot: Robot, commands: BatchCommand) -> BoolArray:
    """Return where the nominal robot closes within its joint limits, and redundant drives agree, (n,)."""
    engine = engine_for(robot.drawing.mechanism, options=robot.nominal_solver.options)
    return robot.drawing.in_reach(commands.start) & engine.close(commands.drives, commands.start).closed


def _wanted(config: SweepConfig, robot: PouringRobot) -> tuple[FloatArray, list[int]]:
    """Return x, y, z in m and the tilt in rad, shape (n, 4), and their line numbers if they are from a file."""
    even, random = config.poses.grid, config.poses.random
    if even is not None:
        limits, counts = even.box.limits(robot.layout.box), (even.x, even.y, even.z, even.tilt)
        axes = [
            np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])
            for low, high, count in zip(*limits, counts, strict=True)
        ]
        return grid(*axes), []
    if random is not None:
        lower, upper = random.box.limits(robot.layout.box)
        return spawned(random.seed, "poses").uniform(lower, upper, size=(random.count, 4)), []
    listed = robot.read_commands(config.beside(str(config.poses.file)))
    return as_poses([*listed.values()]), list(listed)
