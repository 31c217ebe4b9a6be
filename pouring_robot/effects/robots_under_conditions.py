"""A robot whose effects depend on conditions, as it is at each of many commands.

    robots = robots_under("found/model.yaml", poses, {"time_s": 3600.0, "leg1_degC": temperatures})
    robots[0].locate(poses[0])

What effects change at a command is put into placements and drive offsets, so that a robot can do all that it can do
(locate, transfer, compensate, draw) under conditions. A base that moves takes every joint on it along: poses are then
relative to where the base was by the drawing, or in the mean of the campaign where only the frames show it.
"""

import contextlib
import copy
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pouring_robot.batch import engine_for
from pouring_robot.campaign.columns import arrays_from, condition_headings
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.metadata import CampaignMetadata
from pouring_robot.campaign.plan import approaches
from pouring_robot.compensation.pose import Compensation, DriveCompensation
from pouring_robot.effects.available import all_effects
from pouring_robot.effects.conditions import of_commands, recorded
from pouring_robot.effects.link_attachments import carrier, joint_attachments
from pouring_robot.effects.nominal_rows import nominal_rows
from pouring_robot.effects.stack_in_rows import learned_ranges, stack_of
from pouring_robot.estimation.changes import RowChanges
from pouring_robot.exceptions import (
    BadInputError,
    DescriptionError,
    MissingConditionsError,
    NoSolutionError,
    TooLargeError,
    UnsettledCommandsError,
    closest,
    counted,
)
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.quantity_columns import first_fault
from pouring_robot.io.tables import read_table
from pouring_robot.io.units import UNITS, to_inner
from pouring_robot.mechanism.arrays import FloatArray, real
from pouring_robot.mechanism.local_parameters import placements
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot, robot_of
from pouring_robot.robot.robot import NUMBERS, Command, Robot

Given = Mapping[str, ArrayLike | str | Sequence[str]]
"""Conditions by a campaign's heading: a number for all commands, or one for each; for ``session`` a name or names."""
Found = TypeVar("Found", Compensation, DriveCompensation)
_SETTLED, _MOST_TURNS = 1e-11, 25
_ROUND_OFF = 1e-6  # of the largest: directions in which commands varied by less show nothing of their answers
_SAME = 1e-6  # of its range: by how much a condition may lie beyond it


def understood(robot: RobotDefinition, given: Given) -> dict[str, Any]:
    """Return conditions by quantity name, numbers in inner units.

    Raises BadInputError if a heading is no condition of the robot, one is given twice, or a value is impossible.
    """
    if not hasattr(given, "items"):  # those of a data frame will do
        said = "conditions must be a mapping by headings of a campaign, such as {'payload_kg': 400}"
        raise BadInputError(f"{said}, not a {type(given).__name__}")
    known = {heading: quantity for quantity in robot.condition_columns for heading in quantity.headings}
    found: dict[str, Any] = {}
    for heading, values in given.items():
        expect(heading, str, "the key of a condition must be a heading of a campaign")
        if heading not in known:
            stems = heading, heading.rpartition("_")[0]  # a unit may be missing, or wrong
            same = [f"'{name}'" for name, quantity in known.items() if quantity.name in stems]
            near = f"; did you mean {' or '.join(same)}?" if same else closest(heading, known)
            raise BadInputError(f"'{heading}' is not a condition of {robot.name}{near}")
        quantity = known[heading]
        if quantity.name in found:
            raise BadInputError(f"'{heading}': the condition '{quantity.name}' is given twice; keep one")
        if quantity.kind == "label":
            found[quantity.name] = values
            continue
        try:
            # Masked values are not given.
            numbers = np.where(np.ma.getmaskarray(np.ma.asarray(values)), np.nan, real(values))
        except (TypeError, ValueError):
            numbers = np.array(np.nan)
        if UNITS[quantity.kind]:
            numbers = np.asarray(to_inner(numbers, heading.removeprefix(f"{quantity.name}_")))
        if not np.isfinite(numbers).all() or (quantity.kind == "sign" and (np.abs(numbers) != 1.0).any()):
            wanted = "+1 or -1" if quantity.kind == "sign" else "a finite number"
            shown = "" if np.ndim(numbers) else f", not {values!s}"
            raise BadInputError(f"{heading}: give {wanted} for every command{shown}")
        if fault := first_fault(numbers, quantity.kind):
            index, said = fault
            raise BadInputError(f"{heading}{f' of command {index + 1}' if np.ndim(numbers) else ''}: {said}")
        found[quantity.name] = numbers
    return found


def conditions_beside(path: Path, robot: RobotDefinition) -> dict[str, FloatArray | tuple[str, ...]]:
    """Return the conditions that a table has besides its commands, by heading.

    Raises TableError if the file cannot be read, or a condition is missing in a row or is not a number.
    """
    table, found = read_table(path, "time_s"), dict[str, FloatArray | tuple[str, ...]]()
    known = condition_headings(robot)
    for index, heading in enumerate(table.headings):
        if heading == "session":
            found[heading] = table.labels(index)
        elif heading in known:
            empty = "the value is missing; give the condition for every pose"
            found[heading] = table.numbers(index, empty=empty)
    return found


class RobotUnderConditions:
    """A robot as built, or the one of a model, under conditions: what its model's effects do under them is added.

    Raises:
        BadInputError: a condition is none of the robot's, or an effect does not say in which campaign it was learned.
    """

    notes: tuple[str, ...] = ()  # what to know about the commands and conditions of the last call, a line each

    def __init__(self, robot: Robot | RobotModel | Path | str, given: Given) -> None:
        self.robot = robot if isinstance(robot, Robot) else robot_of(RobotModel.of(robot))
        model, self.definition = self.robot.model, self.robot.model.definition
        self.given = understood(self.definition, given)
        lost = [entry.effect for entry in model.effects if not entry.placed and not entry.learned]
        if lost:
            raise model.fault(
                f"the model's effect '{lost[0]}' does not say in which campaign it was learned, so it is unknown "
                "what it does elsewhere; diagnose that campaign again"
            )

    def __repr__(self) -> str:
        model = self.robot.model
        effects = counted(sum(not entry.placed for entry in model.effects), "effect")
        under = ", ".join(self.given) or "no condition"
        return f"<{type(self).__name__}: {' '.join(*model.named.items())}, {effects} under {under}>"

    def robots(self, drives: ArrayLike) -> list[Robot]:
        """Return the robot as it is at each command: drives (n, drives), in m and rad.

        Raises:
            MissingConditionsError: effects need conditions that are not given.
            BadInputError: there are not as many values of a condition as commands, drives are no drive values, or
                conditions are given and nothing in the model depends on any.
            NoSolutionError: the drawing does not close at a command.
        """
        if self.given and not self.robot.model.conditional:
            raise BadInputError("nothing in the model depends on conditions: give none")
        robots, _ = self._at(drives, seen=False)
        known, own = all_effects(self.definition), (e.effect for e in self.robot.model.effects if not e.placed)
        still = (f"{e} does not move the robot, only what is measured" for e in own if not known[e].moves_robot)
        self.notes = (*self.notes, *still)
        return robots

    def seen(self, drives: ArrayLike) -> tuple[list[Robot], FloatArray]:
        """Return :meth:`robots`, and the relative error of the measuring device's scale at each command, (n,).

        The scale does not move the robot, but its measured positions: they are 1 + scale times as far from the device's
        own origin, as in :meth:`OuterFrames.seen`. Raises as :meth:`robots`.
        """
        return self._at(drives, seen=True)

    def _at(self, drives: ArrayLike, *, seen: bool) -> tuple[list[Robot], FloatArray]:
        """Return the robot and the device's scale at each command; with errors of the device where ``seen``."""
        drives, self.notes = self.robot.commands_of(drives), ()
        if not self.robot.model.conditional or not len(drives):
            return [self.robot] * len(drives), np.zeros(len(drives))
        campaign = self._rows(drives)
        engine = engine_for(self.robot.nominal_solver.mechanism)
        closure = engine.close(drives, self.robot.drawing.starts(drives))
        if not closure.closed.all():
            first = int(np.argmin(closure.closed)) + 1
            raise NoSolutionError(f"command {first}: no pose has these drive values; {NUMBERS}")
        nominal = nominal_rows(self.definition, engine, closure)
        local, not_learned = stack_of(self.robot.model, campaign, nominal, of_commands, seen=seen)
        changes, beyond = RowChanges.of(local, engine.structure, len(drives)), self._beyond(recorded(campaign))
        self.notes = (*beyond.values(), *not_learned)
        try:
            return [self._standing(changes, k, engine.structure.site_joints) for k in range(len(drives))], changes.scale
        except TooLargeError as problem:
            if far := self._far_out(drives, beyond):  # that, and no wrong unit, is the reason
                mend = "stay within that, or measure there and diagnose again"
                raise self.robot.model.fault(f"{far}; there {problem.problem}; {mend}") from problem
            raise

    def idle(self, drives: ArrayLike) -> tuple[str, ...]:
        """Return the conditions, by heading, without which the :meth:`robots` at commands would be the same."""
        headings = {quantity.name: quantity.canonical for quantity in self.definition.condition_columns}
        stands, found = [robot.model for robot in self.robots(drives)], []
        for name in self.given:
            others = copy.copy(self)
            others.given = {other: values for other, values in self.given.items() if other != name}
            with contextlib.suppress(MissingConditionsError):
                if [robot.model for robot in others.robots(drives)] == stands:
                    found.append(headings[name])
        return tuple(found)

    def _rows(self, drives: FloatArray) -> Campaign:
        """Return the commands as rows of a campaign in which nothing was measured."""
        count = len(drives)
        numbers = {name: values for name, values in self.given.items() if name != "session"}
        if count > 1:
            numbers = approaches(self.definition, drives) | numbers
        try:
            numbers = {name: np.broadcast_to(values, (count,)) for name, values in numbers.items()}
            session = np.broadcast_to(self.given.get("session", ""), (count,))
        except ValueError as problem:
            raise BadInputError(f"give each condition one value, or one for each of the {count} commands") from problem
        numbers |= self.definition.commanded(drives)
        return Campaign(
            robot=self.definition,
            path=Path("commands"),
            metadata=CampaignMetadata(),
            lines=np.arange(1, count + 1),
            samples=("",) * count,
            sessions=tuple(session.tolist()),  # of numbers only whole ones are names
            headings={},
            ignored_columns=(),
            **arrays_from(numbers, self.definition),
        )

    def _standing(self, changes: RowChanges, row: int, sites: Sequence[str]) -> Robot:
        """Return the robot with the changes of a row: displaced sites, by joint, and shifted drives and base."""
        base, moved = changes.base[row], placements(sites, changes.placements[row].reshape(-1, 6))
        drives = zip(self.definition.loops.drives, changes.drives[row].tolist(), strict=True)
        model = self.robot.model.displaced(moved, {joint: shift for joint, shift in drives if shift})
        if base.any():
            model = model.displaced(self._carried(model, pin.SE3(pin.exp3(base[3:]), base[:3])), {})
        return self.robot.built_as(model)

    def _carried(self, model: RobotModel, shift: pin.SE3) -> dict[str, pin.SE3]:
        """Return how a moving base displaces joints of a model; DescriptionError where no joints can represent it."""
        mechanism, loops, built = self.robot.nominal_solver.mechanism, self.definition.loops, model.displacements()
        above, paths = carrier(mechanism.shared_model, loops.base_frame), mechanism.frame_paths
        pairs = [(paths[loop.frame_a], paths[loop.frame_b]) for loop in loops.loops]
        own, end = paths[loops.base_frame], paths[str(loops.end_frame)]
        through = any((above.name in first) != (above.name in second) for first, second in ((own, end), *pairs))
        if own in itertools.chain(*pairs) or (through and above.type == pin.FrameType.JOINT):
            problem = f"the base moves, but chains end on base_frame '{loops.base_frame}' without a joint that can"
            mend = "in the URDF fix a separate link to it, and name that link as base_frame"
            raise DescriptionError(self.definition.path, f"{problem}; {mend}")
        carried = dict[str, pin.SE3]()
        for joint, (link, at) in joint_attachments(self.definition).items():
            if carrier(mechanism.shared_model, link).name == above.name:
                there = at * built[joint] if joint in built else at
                carried[joint] = there.actInv(shift * there)
        if above.type == pin.FrameType.FIXED_JOINT and above.name != "universe":  # the chain may begin there, too
            carried[above.name] = shift.inverse()
        return carried

    def _beyond(self, recorded: Mapping[str, FloatArray]) -> dict[str, str]:
        """Return, by heading, a line for each drive and condition beyond the range in which effects were learned."""
        lines = dict[str, str]()
        for heading, (low, high) in self._learned_over.items():
            if heading in recorded:
                values = recorded[heading]
                far = float(values[np.argmax(np.maximum(low - values, values - high))])
                if max(low - far, far - high) > _SAME * (high - low):
                    over = f"{low:.6g} to {high:.6g}, over" if low < high else f"{low:.6g}, at"
                    lines[heading] = f"{heading} {far:.6g} lies outside {over} which effects were learned"
        return lines

    def _far_out(self, drives: FloatArray, beyond: Mapping[str, str]) -> str:
        """Return which conditions beyond the learned range are why there are no robots; "" where that is not why."""
        ranges, nearer = self._learned_over, copy.copy(self)
        names = {q.name: q.canonical for q in self.definition.condition_columns if q.canonical in beyond}
        if not names:
            return ""
        nearer.given = self.given | {name: np.clip(self.given[name], *ranges[names[name]]) for name in names}
        try:
            nearer.robots(drives)
        except BadInputError:
            return ""
        return " and ".join(beyond[heading] for heading in names.values())

    @functools.cached_property
    def _learned_over(self) -> dict[str, tuple[float, float]]:
        """Range of each drive and condition over which effects were learned, by heading."""
        found, known = dict[str, tuple[float, float]](), all_effects(self.definition)
        for entry in (entry for entry in self.robot.model.effects if not entry.placed):
            learned = self.robot.model.learned[entry.learned]
            for heading, (low, high) in learned_ranges(known[entry.effect], learned, self.definition).items():
                lowest, highest = found.get(heading, (low, high))
                found[heading] = min(low, lowest), max(high, highest)
        return found


@overload
def robots_under(
    model: Robot | RobotModel | Path | str, commands: Sequence[PlatformPose], given: Given
) -> list[PouringRobot]: ...


@overload
def robots_under(model: Robot | RobotModel | Path | str, commands: Sequence[Command], given: Given) -> list[Robot]: ...


def robots_under(model: Robot | RobotModel | Path | str, commands: Sequence[Command], given: Given) -> list[Any]:
    """Return a robot as it is at each command under conditions; each is a robot like any other.

    Commands are poses of the pouring robot, or drive values in m and rad, in the order in which they are reached;
    conditions go by a campaign's heading, such as ``leg1_degC``: a number, or one per command. Sides of approach that
    are not given follow from the order of the commands. Raises as :class:`RobotUnderConditions` and its ``robots``.
    """
    under = RobotUnderConditions(model, given)
    return under.robots(_drives(under.robot, commands))


def _drives(robot: Robot, commands: Iterable[Command]) -> FloatArray:
    expect(commands, Iterable, "commands must be a list of poses or of drive values")
    return robot.commands_of([robot.drives_of(command) for command in commands])


def compensate_under(
    under: RobotUnderConditions,
    wanted: Sequence[Command],
    bring: Callable[[int, Any], Found],
    show: Progress = say_nothing,
) -> list[Found]:
    """Return what brings a robot to wanted poses, where what its effects do depends on what is commanded.

    The robot as it is at the last commands is compensated for the poses, until commands no longer change; ``bring``
    compensates such a robot, which does not change, for the pose of an index.

    Raises UnsettledCommandsError if commands do not settle, and as ``bring`` and :meth:`RobotUnderConditions.robots`.
    """
    expect(under, RobotUnderConditions, "the robot to compensate must be a RobotUnderConditions")
    commands = _drives(under.robot, wanted)
    first: list[Found] = []
    tried, answers = list[FloatArray](), list[FloatArray]()
    for _ in range(_MOST_TURNS):
        found: list[Found] = [bring(k, robot) for k, robot in enumerate(under.robots(commands))]
        first = first or found
        tried.append(commands)
        answers.append(np.array([list(one.drives.values()) for one in found]).reshape(commands.shape))
        moved = np.abs(answers[-1] - commands).max(axis=1)
        show("compensating", int(np.count_nonzero(moved <= _SETTLED)), len(commands))
        if (moved <= _SETTLED).all() or not under.robot.model.conditional:
            # The error without compensation is that of the wanted command: from the first iteration.
            return [replace(one, before=begun.before) for one, begun in zip(found, first, strict=True)]
        commands = np.where((moved > _SETTLED)[:, None], _mixed(np.array(tried), np.array(answers)), commands)
    raise UnsettledCommandsError(int(moved.argmax()) + 1, float(moved.max()))


def _mixed(tried: FloatArray, answers: FloatArray) -> FloatArray:
    """Return the fixed-point commands, (n, D), that those tried and their answers, (m, n, D), predict.

    Anderson's mixing (Walker & Ni, Anderson acceleration for fixed-point iterations, 2011): a secant method for each
    command, which also converges where compliant parts make plain iteration diverge.
    """
    last = tried.shape[2] + 1
    missed, answers = np.moveaxis((answers - tried)[-last:], 0, 2), np.moveaxis(answers[-last:], 0, 2)
    steps = np.linalg.pinv(np.diff(missed), rcond=_ROUND_OFF) @ missed[:, :, -1:]
    return np.asarray(answers[:, :, -1] - (np.diff(answers) @ steps)[:, :, 0])
